//! The unsteady motor: scan periods that hunt, and scans that are turned in step with them.

use super::parameters::AngleJitter;
use super::random::{Purpose, Seed};
use std::f64::consts::TAU;

/// Pole of the hunting: 0.31 cycles a scan, damped to the autocorrelations of the recordings
/// (about -0.3, -0.5, +0.5 at lags 1 to 3).
const POLE: f64 = 0.85;
const CYCLES_PER_SCAN: f64 = 0.31;

/// One scan's share in it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Turn {
    /// The scan's true angles are larger than the stated ones by this, rad.
    pub offset_rad: f64,
    /// Relative deviation of the time to the next scan from the nominal period.
    pub period_deviation: f64,
}

/// The sequence of scans. The scan periods are a second-order autoregression whose innovations are
/// numbered by scan, so that a run can be repeated.
#[derive(Clone, Debug)]
pub struct Hunting {
    seed: Seed,
    parameters: AngleJitter,
    /// Deviations of the last two periods.
    last: [f64; 2],
}

impl Hunting {
    /// Starts in the stationary state.
    pub fn new(seed: Seed, parameters: &AngleJitter) -> Hunting {
        let mut hunting = Hunting {
            seed,
            parameters: parameters.clone(),
            last: [0.0; 2],
        };
        // Numbers far from any scan's; the start has died away after 50 steps of the pole.
        for k in 0..50 {
            let innovation = hunting.innovation(u64::MAX - k);
            hunting.step(innovation);
        }
        hunting
    }

    fn innovation(&self, number: u64) -> f64 {
        self.seed.draws(Purpose::AngleJitter, number).normal()
    }

    fn step(&mut self, innovation: f64) -> f64 {
        let (p1, p2) = (2.0 * POLE * libm::cos(TAU * CYCLES_PER_SCAN), -POLE * POLE);
        // Variance of a stationary second-order autoregression over that of its innovations.
        let gain = (1.0 - p2) / ((1.0 + p2) * ((1.0 - p2) * (1.0 - p2) - p1 * p1));
        let sigma = self.parameters.period_jitter / gain.sqrt();
        let value = p1 * self.last[0] + p2 * self.last[1] + sigma * innovation;
        self.last = [value, self.last[0]];
        value
    }

    /// The turn of the next scan, whose number is `number`.
    pub fn next(&mut self, number: u64) -> Turn {
        let [before, before_that] = self.last;
        let mut draws = self.seed.draws(Purpose::AngleJitter, number);
        let now = self.step(draws.normal());
        let [a, b, c] = self.parameters.period_to_angle_deg;
        let residual = self.parameters.residual_deg * draws.normal();
        let offset_deg = a * now + b * before + c * before_that + residual;
        Turn {
            offset_rad: offset_deg.to_radians(),
            period_deviation: now,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn correlation(a: &[f64], b: &[f64]) -> f64 {
        let dot = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>();
        dot(a, b) / (dot(a, a) * dot(b, b)).sqrt()
    }

    #[test]
    fn figures_of_the_recordings() {
        let mut hunting = Hunting::new(Seed(5), &AngleJitter::default());
        let turns: Vec<Turn> = (0..20_000).map(|k| hunting.next(k)).collect();
        let periods: Vec<f64> = turns.iter().map(|t| t.period_deviation).collect();
        let angles: Vec<f64> = turns.iter().map(|t| t.offset_rad.to_degrees()).collect();
        let rms = |v: &[f64]| (v.iter().map(|x| x * x).sum::<f64>() / v.len() as f64).sqrt();
        // 127 us of 40 ms; 0.016 to 0.018 deg; r = 0.74 to 0.84 with the period just before.
        assert!((rms(&periods) * 40e3 - 127.0).abs() < 4.0);
        assert!((0.016..0.018).contains(&rms(&angles)), "{}", rms(&angles));
        let lag = |n: usize| correlation(&periods[n..], &periods[..periods.len() - n]);
        assert!((lag(1) + 0.3).abs() < 0.1 && (lag(2) + 0.5).abs() < 0.1 && lag(3) > 0.4);
        let before = correlation(&angles[1..], &periods[..periods.len() - 1]);
        assert!((0.74..0.95).contains(&before), "{before}");
    }
}
