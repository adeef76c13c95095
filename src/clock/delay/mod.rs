//! The delay between a desired motion and what was measured of it.
//!
//! Positive: the measurement lags. A platform that follows late, or with an error proportional to
//! its speed, looks exactly like a delay; only the clocks, compared by other means, tell transport
//! from motion.
//!
//! - [`fit()`] the recommended estimator, with its standard error
//! - [`correlation`] what is commonly done instead, and the fit's starting point
//! - [`dissertation()`] the published procedure, by hand
//! - [`curve()`] the error that is left against the delay that is assumed

pub mod correlation;
mod curve;
mod dissertation;
mod fit;
#[cfg(test)]
mod tests;

pub use curve::curve;
pub use dissertation::{Dissertation, dissertation};
pub use fit::{AxisFit, DelayFit, Part, PartFit, fit};

use crate::motion::Motion;
use nalgebra::Vector3;

/// A measured position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// Its stamp, s after the desired motion's start.
    pub t_s: f64,
    /// Position, m; NaN where it is not known.
    pub position_m: Vector3<f64>,
}

/// What is searched, and where.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DelaySettings {
    /// Which of x, y and z are used; none are those along which the desired motion goes.
    pub axes: Option<[bool; 3]>,
    /// The delay is searched between plus and minus this, s.
    pub most_s: f64,
    /// Whether the scale of the measured motion is free.
    pub free_gain: bool,
    /// Whether a constant offset is free.
    pub free_offset: bool,
}

impl Default for DelaySettings {
    /// All that moves, within half a second, gain and offset free.
    fn default() -> Self {
        DelaySettings {
            axes: None,
            most_s: 0.5,
            free_gain: true,
            free_offset: true,
        }
    }
}

/// Why there is no delay.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum DelayError {
    /// The desired motion and the measurement have too little in common.
    #[error(
        "{found} measured positions lie within the desired motion: at least {needed} are needed. Do \
         both have the same clock?"
    )]
    TooFew {
        /// How many do.
        found: usize,
        /// How many are needed.
        needed: usize,
    },
    /// Nothing moves.
    #[error("the desired motion stands still along the axes that are used: no delay can be seen")]
    Still,
    /// The equations have no solution.
    #[error("the fit does not settle: the measurement does not follow the desired motion")]
    Unsettled,
}

/// Fewer positions tell nothing.
pub const LEAST: usize = 12;
/// An axis along which the desired motion goes less far, m, or by less than this share of the longest
/// way, is left out.
const LEAST_TRAVEL_M: f64 = 0.02;
const LEAST_SHARE: f64 = 0.05;
/// The same for an axis that was asked for: less is rounding, and tells nothing of a gain.
const LEAST_ASKED_M: f64 = 1e-6;

/// How far the motion goes along each axis, m.
fn travel_m(motion: &dyn Motion) -> Vector3<f64> {
    const STEPS: u32 = 1000;
    let mut low = Vector3::repeat(f64::INFINITY);
    let mut high = -low;
    for k in 0..=STEPS {
        let t_s = motion.duration_s() * f64::from(k) / f64::from(STEPS);
        let position_m = motion.at(t_s).position_m;
        low = low.inf(&position_m);
        high = high.sup(&position_m);
    }
    high - low
}

/// The axes that are used: those asked for, or those along which the motion goes.
fn axes(motion: &dyn Motion, wanted: Option<[bool; 3]>) -> Result<Vec<usize>, DelayError> {
    let travel_m = travel_m(motion);
    let least_m = LEAST_TRAVEL_M.max(LEAST_SHARE * travel_m.max());
    let used = |axis: &usize| match wanted {
        Some(wanted) => {
            wanted.get(*axis).copied().unwrap_or(false) && travel_m[*axis] > LEAST_ASKED_M
        }
        None => travel_m[*axis] >= least_m,
    };
    let axes: Vec<usize> = (0..3).filter(used).collect();
    if axes.is_empty() {
        return Err(DelayError::Still);
    }
    Ok(axes)
}

/// The median; NaN of nothing.
fn median(values: &mut [f64]) -> f64 {
    let middle = values.len() / 2;
    if values.is_empty() {
        return f64::NAN;
    }
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}
