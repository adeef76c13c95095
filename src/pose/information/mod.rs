//! How well one scan can tell the pose: the bound that estimators are measured against, without
//! drawing any noise.
//!
//! Lines are linear measurements, and so is remission along a strip: their information adds up to
//! the Cramer-Rao bound. An interval is none: what it says depends on where the beams happen to fall.
//! For a pose the intervals are known exactly, and so is the posterior of x and yaw under them: even
//! over a polygon, for every set of values that the lines leave to the other unknowns. That is the least
//! that any estimator can reach (Bayesian bound); over many poses of a place its mean variance is what
//! is to be expected there.
//!
//! The formulas are those of the estimator's geometry; the simulator's are not used.

mod polygon;
mod view;

use super::gaussian::Gaussian;
use super::interval::propagate;
use super::joint;
use crate::frame::Frame;
use polygon::polygons;
use view::View;

/// The beams of a scan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fan {
    /// Angle of the first beam, rad.
    pub angle_min_rad: f64,
    /// From beam to beam, rad.
    pub step_rad: f64,
    /// How many.
    pub count: usize,
}

/// What the edges are measured with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EdgeModel {
    /// Ranges tell between which two beams an edge lies.
    Ranges,
    /// Remissions tell which share of a spot is on the strip.
    Remission(Remissions),
}

/// How well a beam's remission tells the share of its spot on a strip. Levels are in units of the
/// strip's own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Remissions {
    /// White relative noise of a beam, standard deviation.
    pub noise: f64,
    /// Background's remission over the strip's.
    pub contrast: f64,
    /// Noise that does not go with the level, standard deviation: that of the digits.
    pub floor: f64,
}

impl Remissions {
    /// Variance of a beam's remission at a level. The two noises are independent.
    fn variance(&self, level: f64) -> f64 {
        (self.noise * level).powi(2) + self.floor.powi(2)
    }
}

/// What is assumed of the scanner and known before the scan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Assumptions {
    /// Standard deviation of a range, m.
    pub range_sigma_m: f64,
    /// Prior of the range bias, m.
    pub bias_sigma_m: f64,
    /// Of the pitch, rad; 0 is known.
    pub pitch_sigma_rad: f64,
    /// Of the hit threshold, spot radii (ranges).
    pub threshold_sigma: f64,
    /// Of the footprint scale (remission).
    pub footprint_sigma: f64,
    /// Of x, m, and of yaw, rad.
    pub x_sigma_m: f64,
    /// See `x_sigma_m`.
    pub yaw_sigma_rad: f64,
    /// The edges.
    pub edges: EdgeModel,
}

impl Default for Assumptions {
    /// The set-up in which the estimators' figures are stated.
    fn default() -> Self {
        Assumptions {
            range_sigma_m: 0.0065,
            bias_sigma_m: 0.015,
            pitch_sigma_rad: 0.0,
            threshold_sigma: 0.0,
            footprint_sigma: 0.15,
            x_sigma_m: 0.5,
            yaw_sigma_rad: 8f64.to_radians(),
            edges: EdgeModel::Ranges,
        }
    }
}

/// Variance of a range's last digit, m^2.
const DIGIT_VARIANCE: f64 = 1e-6 / 12.0;
/// What else is open before a scan: y, z (m), roll (rad); pitch that is known.
const ANYWHERE_M: f64 = 20.0;
const ANY_RAD: f64 = 1.0;
const KNOWN: f64 = 1e-7;
const SWEEPS: usize = 12;

/// What one scan from this pose leaves open: variances of x, y, z (m^2), roll, pitch, yaw (rad^2). None
/// where ceiling or walls are not seen.
pub fn of_scan(
    frame: &Frame,
    fan: &Fan,
    position_m: [f64; 3],
    rotation_rad: [f64; 3],
    assumed: &Assumptions,
) -> Option<[f64; 6]> {
    let view = View::new(frame, fan, position_m, rotation_rad);
    let mut state = Gaussian::independent(
        view.at.into(),
        [
            assumed.x_sigma_m,
            ANYWHERE_M,
            ANYWHERE_M,
            ANY_RAD,
            assumed.pitch_sigma_rad.max(KNOWN),
            assumed.yaw_sigma_rad,
            assumed.bias_sigma_m,
            assumed.threshold_sigma.max(KNOWN),
            assumed.footprint_sigma.max(KNOWN),
        ],
    );
    let variance = assumed.range_sigma_m * assumed.range_sigma_m + DIGIT_VARIANCE;
    let mut information = state.covariance.cholesky()?.inverse();
    information += view.lines(variance)?;
    match assumed.edges {
        EdgeModel::Ranges => {
            state.covariance = information.cholesky()?.inverse();
            let boxes: Vec<_> = view
                .edges()
                .filter_map(|edge| joint::interval(&edge, frame, &view.pose, &view.at))
                .collect();
            let polygons = polygons(&state, &boxes);
            propagate(&mut state, &boxes, &mut Vec::new(), SWEEPS);
            let mut variances = std::array::from_fn(|k| state.covariance[(k, k)]);
            // Strips on the walls with an open pitch bind more than two unknowns, and few of the
            // polygons are left: there the expectation propagation stands, which with many intervals
            // is up to 15 % too sure.
            if let Some([x, yaw]) = polygons {
                (variances[joint::X], variances[joint::YAW]) = (x, yaw);
            }
            Some(variances)
        }
        EdgeModel::Remission(remissions) => {
            for (index, strip) in frame.strips.iter().enumerate() {
                information += view.strip(index, strip, &remissions);
            }
            let covariance = information.cholesky()?.inverse();
            Some(std::array::from_fn(|k| covariance[(k, k)]))
        }
    }
}

/// Poses of the place (y, z), m: position, m, and roll, pitch, yaw, rad. x lies between the two given,
/// angles are up to `tilt_rad` to both sides, and y is up to 2 cm, because beams fall on edges in
/// another way every few centimetres.
pub fn poses_at(
    [y_m, z_m]: [f64; 2],
    x_m: [f64; 2],
    tilt_rad: f64,
    count: usize,
) -> impl Iterator<Item = [[f64; 3]; 2]> {
    let within = |u: f64, [low, high]: [f64; 2]| low + u * (high - low);
    let tilt = move |u: f64| within(u, [-tilt_rad, tilt_rad]);
    spread(count).map(move |[a, b, c, d]| {
        let beside_m = within((7.0 * a).fract(), [-0.02, 0.02]);
        [
            [within(a, x_m), y_m + beside_m, z_m],
            [tilt(b), tilt(c), tilt(d)],
        ]
    })
}

/// Evenly spread without a pattern (additive recurrence with the generalised golden ratio): `count`
/// points of the unit cube in four dimensions.
fn spread(count: usize) -> impl Iterator<Item = [f64; 4]> {
    // The positive root of x^5 = x + 1.
    const ROOT: f64 = 1.167_303_978_261_418_7;
    (0..count).map(|i| {
        let mut step = 1.0;
        [0; 4].map(|_| {
            step /= ROOT;
            (0.5 + step * (i + 1) as f64).fract()
        })
    })
}

#[cfg(test)]
mod tests;
