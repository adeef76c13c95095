//! How much of a beam's spot, a uniform disc across the beam, is on one side of a straight line.
//!
//! Kurniawan 2017 lets a beam hit where half of it does; edges by remission and a calibrated hit
//! threshold need the share and the place that it belongs to. The simulator has its own formula.

use std::f64::consts::FRAC_1_PI;

/// Share of a unit disc on the inner side of a line at distance `q` from its centre, and its
/// derivative: 1/2 + (q sqrt(1 - q^2) + asin q)/pi.
#[inline]
pub fn disc_share(q: f64) -> (f64, f64) {
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

/// The inverse of [`disc_share`]: the distance inside the line at which a unit disc has this share of
/// itself there.
pub fn disc_centre(wanted: f64) -> f64 {
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
        let (reached, slope) = disc_share(height - 1.0);
        height = (height + (smaller - reached) / slope).clamp(0.0, 1.0);
    }
    if wanted < 0.5 {
        height - 1.0
    } else {
        1.0 - height
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_centre_has_the_share_that_is_wanted() {
        for k in 1..1000 {
            let wanted = f64::from(k) / 1000.0;
            assert!(
                (disc_share(disc_centre(wanted)).0 - wanted).abs() < 1e-13,
                "{wanted}"
            );
        }
        // Near the rim a share says little of the place.
        for wanted in [1e-11, 1e-9, 1e-6] {
            let inside = disc_centre(wanted);
            assert!(
                (disc_share(inside).0 / wanted - 1.0).abs() < 1e-4,
                "{wanted}"
            );
            assert!(
                (disc_centre(1.0 - wanted) + inside).abs() < 1e-6,
                "{wanted}"
            );
        }
        for (wanted, rim) in [(0.0, -1.0), (1.0, 1.0), (-0.1, -1.0), (1.1, 1.0)] {
            assert_eq!(disc_centre(wanted), rim);
        }
    }
}
