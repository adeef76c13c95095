//! What a strip edge says of the state.
//!
//! g is the signed distance of a beam's crossing from the strip's boundary, along y on the ceiling
//! and along z on a wall, with the sign that makes it fall while the beams pass the edge. It is
//! formed from the beams themselves, by the full rotations, so that no corner enters.

use super::state::{FOOTPRINT, STATE, THRESHOLD, Vector};
use crate::frame::{Crossing, Frame, ScannerPose, Strip};
use crate::pose::interval::BoxFactor;
use crate::record::{Edge, EdgeKind, Face};

/// Blur of an interval's bounds: this much, m, and this share of the spot's radius. Twice as much
/// leaves x and yaw of mixed pixels a fifth less certain than they are; half as much makes many strips
/// too sure of themselves.
const SOFT_M: f64 = 0.0001;
const SOFT_SPOT: f64 = 0.018;
/// Probability that an interval is off by a beam: a wild range beside the edge that looks like a
/// hit, or like the surface behind. A larger one costs more where nothing is wrong.
const DOUBT: f64 = 0.0003;

/// A linear measurement `row . state = value` with a variance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointFactor {
    /// The linear form, rad of the edge's angle for a unit of the component.
    pub row: Vector,
    /// Its measured value, rad.
    pub value: f64,
    /// Its variance, rad^2.
    pub variance: f64,
}

/// A strip's boundary as the beams pass it.
pub(in crate::pose) struct Boundary {
    face: Face,
    /// The axis along which the strip's width is measured: y on the ceiling, z on a wall.
    v: usize,
    pub(in crate::pose) sign: f64,
    pub(in crate::pose) slope: f64,
    offset_m: f64,
}

impl Boundary {
    pub(in crate::pose) fn of(edge: &Edge, frame: &Frame) -> Option<Boundary> {
        let strip: &Strip = frame.strips.get(usize::try_from(edge.strip).ok()?)?;
        if strip.face != edge.face {
            return None;
        }
        // With growing beam angle v falls on ceiling and left wall and rises on the right wall.
        let rising = edge.face == Face::Right;
        let side = if (edge.kind == EdgeKind::On) == rising {
            -1.0
        } else {
            1.0
        };
        Some(Boundary {
            face: edge.face,
            v: if edge.face == Face::Upper { 1 } else { 2 },
            sign: if rising { -1.0 } else { 1.0 },
            slope: strip.slope(),
            offset_m: strip.offset_m + side * strip.width_m / 2.0,
        })
    }

    /// g of a crossing, m.
    pub(in crate::pose) fn g_m(&self, crossing: &Crossing) -> f64 {
        self.sign * (crossing.point_m[self.v] - self.offset_m - self.slope * crossing.point_m[0])
    }

    /// Derivative of g along a displacement of the crossing.
    pub(in crate::pose) fn d_g(&self, d_point: &[f64; 3]) -> f64 {
        self.sign * (d_point[self.v] - self.slope * d_point[0])
    }
}

/// The edge as the interval between two beams: g(from) >= 0 >= g(to), as bounds on a linear form of
/// the state (m), linearised at the state `at`, whose pose is `pose`. None where the edge belongs to
/// no strip or its beams do not pass the boundary from there.
pub fn interval(
    edge: &Edge,
    frame: &Frame,
    pose: &ScannerPose,
    at: &Vector,
) -> Option<BoxFactor<STATE>> {
    let boundary = Boundary::of(edge, frame)?;
    let from = pose.crossing(edge.from_rad, boundary.face)?;
    let to = pose.crossing(edge.to_rad, boundary.face)?;
    let (g_from_m, g_to_m) = (boundary.g_m(&from), boundary.g_m(&to));
    let mut row = Vector::zeros();
    for k in 0..6 {
        row[k] = 0.5 * (boundary.d_g(&from.d_point[k]) + boundary.d_g(&to.d_point[k]));
    }
    let centre = row.dot(at);
    // A threshold moves the edge's angle, which moves g by its slope over the angle. g is formed
    // without it, so that all of the state's threshold counts, not what it changes by.
    let rate = (g_to_m - g_from_m) / (edge.to_rad - edge.from_rad);
    row[THRESHOLD] = -rate * edge.d_threshold;
    if !(g_from_m > g_to_m && row.iter().all(|r| r.is_finite())) {
        return None;
    }
    Some(BoxFactor {
        row,
        low: centre - g_from_m,
        high: centre - g_to_m,
        softness: f64::hypot(SOFT_M, SOFT_SPOT * row[THRESHOLD]),
        doubt: DOUBT,
    })
}

/// The edge's sub-beam angle as a measurement of a linear form of the state, linearised at the state
/// `at`, whose pose is `pose`. The angle was measured with the frame file's footprint scale and
/// moves with the true one. None where the edge has no such angle or belongs to no strip.
pub fn point(edge: &Edge, frame: &Frame, pose: &ScannerPose, at: &Vector) -> Option<PointFactor> {
    if !(edge.edge_rad.is_finite() && edge.sigma_rad > 0.0 && edge.sigma_rad.is_finite()) {
        return None;
    }
    let boundary = Boundary::of(edge, frame)?;
    let crossing = pose.crossing(edge.edge_rad, boundary.face)?;
    let rate = boundary.d_g(&crossing.d_angle);
    if !(rate < 0.0) {
        return None;
    }
    let mut row = Vector::zeros();
    for k in 0..6 {
        row[k] = -boundary.d_g(&crossing.d_point[k]) / rate;
    }
    // Where the edge would be seen is the measured angle less g / rate.
    let mut value = row.dot(at) + boundary.g_m(&crossing) / rate;
    if edge.d_footprint.is_finite() {
        row[FOOTPRINT] = -edge.d_footprint;
        value -= edge.d_footprint * frame.calibration.footprint_scale;
    }
    Some(PointFactor {
        row,
        value,
        variance: edge.sigma_rad * edge.sigma_rad,
    })
}

/// Takes out of `second` what it shares with `first`, their errors having the given covariance
/// (rad^2), so that both can be taken in one after the other.
pub(super) fn decorrelate(
    first: &PointFactor,
    second: &PointFactor,
    covariance: f64,
) -> PointFactor {
    // A covariance that the variances do not allow is none.
    let most = 0.98 * (first.variance * second.variance).sqrt();
    let covariance = if covariance.is_finite() {
        covariance.clamp(-most, most)
    } else {
        0.0
    };
    let share = covariance / first.variance;
    PointFactor {
        row: second.row - first.row * share,
        value: second.value - first.value * share,
        variance: second.variance - covariance * share,
    }
}
