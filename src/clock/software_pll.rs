//! The software PLL of `sick_scan_xd`, as the measure of what is common practice.

use super::exchange::Exchange;
use std::collections::VecDeque;

/// A line through the last few arrivals, hung up at the oldest of them: a late arrival shifts all
/// that follow. Nothing here uses that a message can only be late.
#[derive(Clone, Debug, Default)]
pub struct SoftwarePll {
    /// Device time and arrival, ns.
    recent: VecDeque<(i64, i64)>,
    refused: u32,
}

impl SoftwarePll {
    const KEPT: usize = 7;
    /// An arrival that is further off is refused, ns.
    const TOLERANCE_NS: i64 = 100_000_000;
    /// After so many refusals it begins anew.
    const MOST_REFUSED: u32 = 20;

    /// Takes an arrival; the host's time of the device's, ns, once it has enough of them.
    pub fn push(&mut self, exchange: &Exchange) -> Option<i64> {
        let (device, arrival) = (exchange.device_ns, exchange.receive_ns);
        if self.recent.len() < Self::KEPT {
            self.recent.push_back((device, arrival));
            return self.host_ns(device);
        }
        let predicted = self.host_ns(device)?;
        if predicted.saturating_sub(arrival).saturating_abs() < Self::TOLERANCE_NS {
            self.refused = 0;
            self.recent.pop_front();
            self.recent.push_back((device, arrival));
        } else {
            self.refused += 1;
            if self.refused > Self::MOST_REFUSED {
                *self = SoftwarePll::default();
                return None;
            }
        }
        self.host_ns(device)
    }

    /// The host's time at a device time, ns.
    fn host_ns(&self, device_ns: i64) -> Option<i64> {
        let &(device_0, arrival_0) = self.recent.front()?;
        if self.recent.len() < Self::KEPT {
            return None;
        }
        let n = self.recent.len() as f64;
        let since = |later: i64, earlier: i64| later.saturating_sub(earlier) as f64;
        let relative = |&(d, a): &(i64, i64)| (since(d, device_0), since(a, arrival_0));
        let (sum_x, sum_y) = self
            .recent
            .iter()
            .map(relative)
            .fold((0.0, 0.0), |s, p| (s.0 + p.0, s.1 + p.1));
        let (mean_x, mean_y) = (sum_x / n, sum_y / n);
        let (xx, xy) = self
            .recent
            .iter()
            .map(relative)
            .fold((0.0, 0.0), |s, (x, y)| {
                (
                    s.0 + (x - mean_x).powi(2),
                    s.1 + (x - mean_x) * (y - mean_y),
                )
            });
        let slope = if xx > 0.0 { xy / xx } else { 1.0 };
        let elapsed_ns = (slope * since(device_ns, device_0)).round() as i64;
        Some(arrival_0.saturating_add(elapsed_ns))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::Seed;
    use crate::simulate::exchanges::ExchangeModel;

    #[test]
    fn it_is_a_millisecond_off() {
        let model = ExchangeModel::default();
        let mut pll = SoftwarePll::default();
        let (mut squares, mut n) = (0.0, 0.0);
        for [send_ns, device_ns, receive_ns] in model.run(Seed(20), 0) {
            let exchange = Exchange {
                send_ns,
                device_ns,
                receive_ns,
            };
            let Some(host_ns) = pll.push(&exchange) else {
                continue;
            };
            let truth_ns = device_ns as f64 - model.offset_ns(host_ns as f64 * 1e-9);
            squares += (host_ns as f64 - truth_ns).powi(2);
            n += 1.0;
        }
        // 1.2 ms in 300 runs.
        let rms_us = (squares / n).sqrt() * 1e-3;
        assert!((500.0..3000.0).contains(&rms_us), "{rms_us}");
    }
}
