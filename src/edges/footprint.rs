//! The spot of a beam and how a slanted edge cuts it.

use super::components;
use crate::frame::{Frame, Optics, ScannerPose};
use crate::record::{Edge, Face, ReflectorLines};
use std::f64::consts::FRAC_1_PI;

/// Share of a unit disc on the inner side of a line at distance `q` from its centre, and its
/// derivative: 1/2 + (q sqrt(1 - q^2) + asin q)/pi.
#[inline]
pub(super) fn share(q: f64) -> (f64, f64) {
    if q >= 1.0 {
        (1.0, 0.0)
    } else if q <= -1.0 {
        (0.0, 0.0)
    } else {
        let root = (1.0 - q * q).sqrt();
        (
            0.5 + FRAC_1_PI * (q * root + q.asin()),
            2.0 * FRAC_1_PI * root,
        )
    }
}

/// The inverse of [`share`]: the distance inside the line at which a unit disc has this share of
/// itself there.
pub(super) fn centre(wanted: f64) -> f64 {
    // The smaller side of the line is a segment of the disc, whose share grows with its height t
    // like c t^(3/2) (1 - 3 t/20): its inverse is off by 4 % at most, and three steps by Newton's
    // method leave nothing of that.
    const C: f64 = 4.0 * std::f64::consts::SQRT_2 / 3.0 * FRAC_1_PI;
    let smaller = wanted.min(1.0 - wanted);
    if !(smaller > 1e-12) {
        return if wanted > 0.5 { 1.0 } else { -1.0 };
    }
    let coarse = (smaller / C).cbrt().powi(2);
    let mut height = coarse * (1.0 + 0.1 * coarse);
    for _ in 0..3 {
        let (reached, slope) = share(height - 1.0);
        height = (height + (smaller - reached) / slope).clamp(0.0, 1.0);
    }
    if wanted < 0.5 {
        height - 1.0
    } else {
        1.0 - height
    }
}

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_centre_has_the_share_that_is_wanted() {
        for k in 1..1000 {
            let wanted = f64::from(k) / 1000.0;
            assert!((share(centre(wanted)).0 - wanted).abs() < 1e-13, "{wanted}");
        }
        // Near the rim a share says little of the place.
        for wanted in [1e-11, 1e-9, 1e-6] {
            let inside = centre(wanted);
            assert!((share(inside).0 / wanted - 1.0).abs() < 1e-4, "{wanted}");
            assert!((centre(1.0 - wanted) + inside).abs() < 1e-6, "{wanted}");
        }
        for (wanted, rim) in [(0.0, -1.0), (1.0, 1.0), (-0.1, -1.0), (1.1, 1.0)] {
            assert_eq!(centre(wanted), rim);
        }
    }
}
