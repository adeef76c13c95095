//! The device's clock, the host's stamps and the telegrams' travel.

use super::parameters::Clocks;
use super::random::{Purpose, Seed};
use crate::record::{Scan, ScanInfo, Stamp};

/// Writes the times that a scanner and a host would have to a scan that is stamped with true time.
///
/// `start` is the first scan's true stamp, `period_s` the nominal time from scan to scan.
pub fn disturb(scan: &mut Scan, clocks: &Clocks, seed: Seed, start: Stamp, period_s: f64) {
    let number = u64::from(scan.seq);
    let mut draws = seed.draws(Purpose::Clocks, number);
    let fired = scan.stamp;
    let transmitted = fired.plus_s(clocks.transmission_periods * period_s)
        + (clocks.transmission_ms * 1e6).round() as i64;
    let stamp_error_us = clocks.stamp_sigma_us * draws.normal();
    let wait_ms = clocks.latency_ms + clocks.latency_jitter_ms * draws.exponential();
    let device = |instant: Stamp| {
        let seconds = instant.since_s(start) * (1.0 + clocks.drift_ppm * 1e-6);
        let digit_s = clocks.device_resolution_us * 1e-6;
        let ticks = ((seconds + clocks.device_start_s) / digit_s).floor();
        Stamp::from_ns((ticks * clocks.device_resolution_us * 1e3).round() as i64)
    };
    scan.device = Some(device(fired));
    scan.received = Some(transmitted + (wait_ms * 1e6).round() as i64);
    let digit_ns = (clocks.stamp_resolution_us * 1e3).round().max(1.0) as i64;
    let stamp_ns = fired.ns() + (stamp_error_us * 1e3).round() as i64;
    scan.stamp = Stamp::from_ns(stamp_ns.div_euclid(digit_ns) * digit_ns);
    let counter = scan.seq & 0xFFFF;
    scan.info = Some(Box::new(ScanInfo {
        transmit: Some(device(transmitted)),
        telegram_counter: Some(counter),
        scan_counter: Some(counter),
        device_status: Some(0),
        scan_frequency_hz: 1.0 / period_s,
        measurement_frequency_hz: 1.0 / scan.time_increment_s,
        ..ScanInfo::default()
    }));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps_scatter_and_the_device_drifts() {
        let clocks = Clocks::default();
        let start = Stamp::from_ns(1_767_225_600_000_000_000);
        let n = 4000u32;
        let (mut sum_us, mut squares, mut wait_ms) = (0.0, 0.0, 0.0);
        for seq in 0..n {
            let fired = start.plus_s(f64::from(seq) * 0.04);
            let mut scan = Scan {
                stamp: fired,
                seq,
                time_increment_s: 18.5e-6,
                ..Scan::default()
            };
            disturb(&mut scan, &clocks, Seed(2), start, 0.04);
            let error_us = scan.stamp.since_s(fired) * 1e6;
            sum_us += error_us;
            squares += error_us * error_us;
            assert_eq!(scan.stamp.ns() % 1000, 0);
            let device_s = scan.device.unwrap().ns() as f64 * 1e-9 - 1000.0;
            let true_s = f64::from(seq) * 0.04;
            assert!((device_s - true_s * (1.0 + 6.5e-6)).abs() < 1.1e-6);
            let travel_ms = scan.received.unwrap().since_s(fired) * 1e3 - 41.0;
            assert!(travel_ms >= 0.5);
            wait_ms += travel_ms - 0.5;
        }
        let n = f64::from(n);
        assert!((sum_us / n).abs() < 2.5, "{}", sum_us / n);
        assert!(((squares / n).sqrt() - 30.0).abs() < 1.5);
        assert!((wait_ms / n - 0.15).abs() < 0.01);
    }
}
