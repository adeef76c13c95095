//! Polls of a device's clock over a network with tails and bursts, truth known.

use super::random::{Draws, Purpose, Seed};

/// How long messages take and how the clocks run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExchangeModel {
    /// Polls a second.
    pub rate_hz: f64,
    /// How long it polls, s.
    pub duration_s: f64,
    /// Device minus host at the start, s.
    pub offset_s: f64,
    /// How much faster the device's clock runs, parts per million.
    pub drift_ppm: f64,
    /// Change of the drift from start to end, parts per million.
    pub wander_ppm: f64,
    /// Shortest delay of request and reply, s.
    pub minimum_s: [f64; 2],
    /// What is added to it is lognormal: medians, s.
    pub median_s: [f64; 2],
    /// Logarithmic standard deviations.
    pub sigma: [f64; 2],
    /// Share of the time in which the host is busy; 0 is never.
    pub bursts: f64,
    /// What is then added on request and reply: means of an exponential, s.
    pub burst_s: [f64; 2],
    /// The device's stamp is cut to this step, ns.
    pub tick_ns: i64,
}

impl Default for ExchangeModel {
    /// Delays like those of a scanner on a busy office network.
    fn default() -> Self {
        ExchangeModel {
            rate_hz: 35.0,
            duration_s: 60.0,
            offset_s: 3.2,
            drift_ppm: 20.0,
            wander_ppm: 0.0,
            minimum_s: [150e-6; 2],
            median_s: [80e-6, 200e-6],
            sigma: [1.0, 1.2],
            bursts: 0.06,
            burst_s: [0.5e-3, 2e-3],
            tick_ns: 1000,
        }
    }
}

/// Mean length of a burst, s.
const BURST_S: f64 = 0.2;

impl ExchangeModel {
    /// Device minus host at `t_s` on the host's clock, ns.
    pub fn offset_ns(&self, t_s: f64) -> f64 {
        let wander = self.wander_ppm * (t_s / self.duration_s - 1.0) * 0.5;
        self.offset_s * 1e9 + (self.drift_ppm + wander) * 1e3 * t_s
    }

    /// Run number `number`: host send, device, host receive, ns; host time 0 is the start.
    pub fn run(&self, seed: Seed, number: u64) -> Vec<[i64; 3]> {
        let mut draws = seed.draws(Purpose::Clocks, number);
        let mut burst = self.bursts > 0.0 && draws.unit() < self.bursts;
        let mut until_s = self.phase_s(burst, &mut draws);
        let polls = (self.rate_hz * self.duration_s).round() as u64;
        let poll = |k: u64| {
            let sent_s = (k as f64 + 0.2 * draws.unit()) / self.rate_hz;
            while sent_s > until_s {
                burst = !burst;
                until_s += self.phase_s(burst, &mut draws);
            }
            let mut delay_s = |way: usize| {
                let tail = libm::exp(self.sigma[way] * draws.normal()) * self.median_s[way];
                let extra = if burst { self.burst_s[way] } else { 0.0 } * draws.exponential();
                self.minimum_s[way] + tail + extra
            };
            let read_s = sent_s + delay_s(0);
            let device_ns = (read_s * 1e9 + self.offset_ns(read_s)) as i64;
            let received_s = read_s + delay_s(1);
            [
                (sent_s * 1e9) as i64,
                device_ns - device_ns.rem_euclid(self.tick_ns.max(1)),
                (received_s * 1e9) as i64,
            ]
        };
        (0..polls).map(poll).collect()
    }

    /// How long a burst or the time between two of them lasts, s.
    fn phase_s(&self, burst: bool, draws: &mut Draws) -> f64 {
        if self.bursts <= 0.0 {
            return f64::INFINITY;
        }
        let between_s = BURST_S * (1.0 - self.bursts) / self.bursts;
        draws.exponential() * if burst { BURST_S } else { between_s }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn delays_are_as_said() {
        let model = ExchangeModel {
            duration_s: 600.0,
            ..ExchangeModel::default()
        };
        let run = model.run(Seed(1), 0);
        let n = run.len() as f64;
        let (mut busy, mut sum_us, mut least_us) = (0.0, [0.0; 2], [f64::INFINITY; 2]);
        for [sent, device, received] in &run {
            let at_s = *sent as f64 * 1e-9;
            let read_ns = *device as f64 - model.offset_ns(at_s);
            let us = [
                (read_ns - *sent as f64) * 1e-3,
                (*received as f64 - read_ns) * 1e-3,
            ];
            for way in 0..2 {
                sum_us[way] += us[way];
                least_us[way] = least_us[way].min(us[way]);
            }
            busy += f64::from(u8::from(us[1] > 3000.0));
        }
        // Means of the lognormals: 80 exp(1 / 2), 200 exp(0.72); bursts add 30 and 120 us.
        assert!((sum_us[0] / n - (150.0 + 131.9 + 30.0)).abs() < 15.0);
        assert!((sum_us[1] / n - (150.0 + 410.9 + 120.0)).abs() < 45.0);
        assert!((149.0..160.0).contains(&least_us[0]) && (150.0..170.0).contains(&least_us[1]));
        assert!(busy > 0.0);
    }
}
