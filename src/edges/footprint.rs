//! The spot of a beam and how a slanted edge cuts it.

use super::components;
use crate::frame::{Frame, Optics, ScannerPose};
use crate::record::{Edge, Face, ReflectorLines};

/// The beam's spot, a uniform disc across it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Spot {
    optics: Optics,
    scale: f64,
}

impl Spot {
    pub(super) fn new(frame: &Frame) -> Spot {
        Spot {
            optics: frame.scanner_model().optics,
            scale: frame.calibration.footprint_scale,
        }
    }

    /// m.
    pub(super) fn radius_m(&self, range_m: f64) -> f64 {
        0.5 * self.optics.diameter_m(range_m) * self.scale
    }
}

/// How an edge lies in the scan.
#[derive(Clone, Copy, Debug)]
pub(super) struct Slant {
    /// Distance across the beam by which it leaves the edge, for one radian and one metre of range:
    /// 1 where the edge is square to the scan plane, else less.
    pub across: f64,
    /// Spot radii for a radian.
    pub spots_per_rad: f64,
}

impl Slant {
    /// The edge and the scanner's origin span a plane with the normal m = u x e, u the beam to the
    /// edge and e the edge; a beam turned from the edge leaves that plane by the sine of the turn
    /// times the part of m/|m| that lies in the scan plane.
    pub(super) fn new(
        spot: &Spot,
        pose: &ScannerPose,
        lines: &ReflectorLines,
        edge: &Edge,
        slope: f64,
    ) -> Slant {
        let e = pose.in_scanner(if edge.face == Face::Upper {
            [1.0, slope, 0.0]
        } else {
            [1.0, 0.0, slope]
        });
        let (sin, cos) = (0.5 * (edge.from_rad + edge.to_rad)).sin_cos();
        let aside = cos * e[2] - sin * e[1];
        let across = e[0].abs() / (e[0] * e[0] + aside * aside).sqrt();
        let (y, z, d_m) = components(&lines.lines()[edge.face as usize].normal);
        let range_m = d_m / (cos * y + sin * z);
        Slant {
            across,
            spots_per_rad: across * range_m / spot.radius_m(range_m),
        }
    }
}
