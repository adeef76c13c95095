//! The estimator's state and its priors.

use super::Options;
use crate::frame::{Frame, disc_centre, disc_share};
use crate::pose::gaussian::Gaussian;
use crate::pose::pitch::Pitch;
use nalgebra::SVector;

/// Components of the state.
pub const STATE: usize = 9;
/// Platform position, m.
pub const X: usize = 0;
/// See [`X`].
pub const Y: usize = 1;
/// See [`X`].
pub const Z: usize = 2;
/// Platform rotation, rad.
pub const ROLL: usize = 3;
/// See [`ROLL`].
pub const PITCH: usize = 4;
/// See [`ROLL`].
pub const YAW: usize = 5;
/// Range bias common to all beams, m.
pub const BIAS: usize = 6;
/// Hit threshold: by how many spot radii the spot's centre is outside a strip when hits begin.
pub const THRESHOLD: usize = 7;
/// True footprint over the data sheet's.
pub const FOOTPRINT: usize = 8;

/// A state, or a row that multiplies one: x, y, z (m), roll, pitch, yaw (rad), range bias (m), hit
/// threshold (spot radii), footprint scale.
pub type Vector = SVector<f64, STATE>;

/// Standard deviations of what the lines always tell well: nothing but room for the numbers.
const ANYWHERE_M: f64 = 20.0;
const ANY_RAD: f64 = 1.0;
const ANY_BIAS_M: f64 = 1.0;
/// Least standard deviation of a pitch that is said to be exact, rad.
const EXACT_RAD: f64 = 1e-7;

/// What is known of the state before a scan when there is no scan before it.
/// `threshold` is the mean of the hit threshold.
pub(super) fn prior(
    frame: &Frame,
    threshold: f64,
    pitch: &Pitch,
    options: &Options,
) -> Gaussian<STATE> {
    let calibration = &frame.calibration;
    Gaussian::independent(
        [
            0.0,
            0.0,
            0.0,
            0.0,
            pitch.rad,
            0.0,
            0.0,
            threshold,
            calibration.footprint_scale,
        ],
        [
            options.x_sigma_m,
            ANYWHERE_M,
            ANYWHERE_M,
            ANY_RAD,
            pitch.sigma_rad.max(EXACT_RAD),
            options.yaw_sigma_rad,
            ANY_BIAS_M,
            options.threshold_sigma,
            options.footprint_sigma,
        ],
    )
}

/// By how many spot radii the spot's centre is outside a strip when a share of it is inside.
pub(in crate::pose) fn threshold_mean(share: f64) -> f64 {
    -disc_centre(share)
}

/// The share of the spot that is inside a strip when its centre is `outside` spot radii off it.
pub(in crate::pose) fn hit_share(outside: f64) -> f64 {
    disc_share(-outside).0
}

/// Keeps a linearisation point where the geometry makes sense.
pub(super) fn bounded(mut state: Vector) -> Vector {
    for k in ROLL..=YAW {
        state[k] = state[k].clamp(-0.5, 0.5);
    }
    state[X] = state[X].clamp(-2.0, 2.0);
    state
}
