//! The dissertation's way to a delay (Kurniawan 2017, section 5.2 and Fig. 5.21): the total delay, a
//! plain cross-correlation, and an adjustment by hand until the spike in the error is gone.

use super::correlation::{main_axis, plain};
use super::{DelayError, DelaySettings, Measured};
use crate::motion::Motion;
use serde::Serialize;

/// The steps of the procedure.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Dissertation {
    /// Median time from stamp to now, s; none where the poses are a recording.
    pub total_delay_s: Option<f64>,
    /// What the cross-correlation says, s.
    pub cross_correlation_s: f64,
    /// What was added to it by hand, s.
    pub adjustment_s: f64,
    /// The adjustment with which the spike is smallest, s: what a patient hand would find.
    pub best_adjustment_s: f64,
    /// The spike without compensation, with the total delay (NaN where that is not known), with the
    /// cross-correlation's and with the adjusted one, m.
    pub spike_m: [f64; 4],
}

impl Dissertation {
    /// The delay that the procedure ends with, s.
    pub fn delay_s(&self) -> f64 {
        self.cross_correlation_s + self.adjustment_s
    }
}

/// The longest delay that is tried by hand, ms.
const MOST_TRIED_MS: f64 = 10_000.0;

/// Goes through the procedure with an adjustment of `adjustment_s`. The best one is looked for by
/// whole milliseconds, as one would by hand.
///
/// # Errors
/// [`DelayError`] where there is nothing to correlate.
pub fn dissertation(
    measured: &[Measured],
    motion: &dyn Motion,
    settings: &DelaySettings,
    total_delay_s: Option<f64>,
    adjustment_s: f64,
) -> Result<Dissertation, DelayError> {
    let axis = main_axis(motion, settings)?;
    let spike_m = |delay_s: f64| spike_m(measured, motion, axis, delay_s);
    let correlated_s = plain(measured, motion, settings)?;
    let most_ms = (settings.most_s * 1e3).min(MOST_TRIED_MS) as i64;
    let best_s = (-most_ms..=most_ms)
        .map(|ms| ms as f64 * 1e-3)
        .map(|delay_s| (delay_s, spike_m(delay_s)))
        .filter(|(_, spike)| spike.is_finite())
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .map_or(correlated_s, |(delay_s, _)| delay_s);
    Ok(Dissertation {
        total_delay_s,
        cross_correlation_s: correlated_s,
        adjustment_s,
        best_adjustment_s: best_s - correlated_s,
        spike_m: [
            spike_m(0.0),
            total_delay_s.map_or(f64::NAN, spike_m),
            spike_m(correlated_s),
            spike_m(correlated_s + adjustment_s),
        ],
    })
}

/// The error along an axis that only one position in a hundred exceeds, m: a spike, and not one wild
/// pose. NaN where no position lies within the motion.
fn spike_m(measured: &[Measured], motion: &dyn Motion, axis: usize, delay_s: f64) -> f64 {
    let mut errors_m: Vec<f64> = measured
        .iter()
        .filter(|m| (0.0..=motion.duration_s()).contains(&(m.t_s - delay_s)))
        .map(|m| (m.position_m[axis] - motion.at(m.t_s - delay_s).position_m[axis]).abs())
        .filter(|error| error.is_finite())
        .collect();
    errors_m.sort_by(f64::total_cmp);
    let last = errors_m.len().saturating_sub(1 + errors_m.len() / 100);
    errors_m.get(last).copied().unwrap_or(f64::NAN)
}
