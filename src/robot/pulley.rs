//! A cable over a pulley that swivels about the direction in which the cable runs onto it.
//!
//! In the plane of that direction `k`, through the point A where the cable runs onto the pulley, and
//! of the anchor B: A is the origin, h along k and d across it, towards B. The pulley's centre is at
//! (d, h) = (radius, 0). The cable follows the circle by the wrap angle beta and leaves it along
//! (sin beta, cos beta), straight to B:
//!
//! - s = sqrt((d - radius)^2 + h^2 - radius^2), the straight part;
//! - sin beta = (s (d - radius) + radius h) / (radius^2 + s^2),
//!   cos beta = (s h - radius (d - radius)) / (radius^2 + s^2);
//! - length = radius beta + s.
//!
//! The end of a cable that is wound off a circle moves across the cable (it draws an involute), so
//! that the length changes with B only along the cable's own direction, and with the radius by
//! beta - sin beta.

use nalgebra::Vector3;
use std::f64::consts::TAU;

/// A cable between its pulley and its anchor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Span {
    /// From where it runs onto the pulley to the anchor, m.
    pub length_m: f64,
    /// The direction in which it reaches the anchor, in B: the length's gradient with the anchor.
    pub direction: Vector3<f64>,
    /// How far it is wrapped around the pulley, rad.
    pub wrap_rad: f64,
}

/// The cable from A, where it runs onto a pulley of `radius_m` along `axis` (of any length but 0),
/// to the anchor, both in B. None where the anchor is within the pulley, or where `axis` leads to it,
/// so that the pulley does not know which way to turn.
pub fn span(
    pulley_m: Vector3<f64>,
    axis: Vector3<f64>,
    radius_m: f64,
    anchor_m: Vector3<f64>,
) -> Option<Span> {
    let k = axis.normalize();
    let reach = anchor_m - pulley_m;
    let h = reach.dot(&k);
    let across = reach - k * h;
    let d = across.norm();
    let beyond = d - radius_m;
    let square = beyond * beyond + h * h - radius_m * radius_m;
    if !(square > 0.0 && d > 0.0) {
        return None;
    }
    let s = square.sqrt();
    let circle = radius_m * radius_m + square;
    let sine = (s * beyond + radius_m * h) / circle;
    let cosine = (s * h - radius_m * beyond) / circle;
    let wrap = libm::atan2(sine, cosine);
    // Just below 0 by rounding is 0; below that it is more than half a turn.
    let wrap_rad = match wrap {
        w if w < -1e-9 => w + TAU,
        w => w.max(0.0),
    };
    Some(Span {
        length_m: radius_m * wrap_rad + s,
        direction: across * (sine / d) + k * cosine,
        wrap_rad,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    const UP: Vector3<f64> = Vector3::new(0.0, 0.0, 1.0);

    fn close(a: f64, b: f64) -> bool {
        (a - b).abs() < 1e-12
    }

    /// An anchor straight below the pulley's far side hangs on half a turn; one level with its top,
    /// on a quarter of a turn.
    #[test]
    fn closed_forms() {
        let a = Vector3::new(1.0, 2.0, 3.0);
        let below = span(a, UP, 0.1, a + Vector3::new(0.2, 0.0, -4.0)).unwrap();
        assert!(close(below.length_m, 0.1 * PI + 4.0));
        assert!(close(below.wrap_rad, PI));
        assert!((below.direction + UP).norm() < 1e-12);
        let level = span(a, UP, 0.1, a + Vector3::new(0.0, 5.1, 0.1)).unwrap();
        assert!(close(level.length_m, 0.1 * FRAC_PI_2 + 5.0));
        assert!((level.direction - Vector3::y()).norm() < 1e-12);
        // An eyelet has the straight distance.
        let eyelet = span(a, UP, 0.0, a + Vector3::new(3.0, 0.0, -4.0)).unwrap();
        assert!(close(eyelet.length_m, 5.0));
        // A lower pulley is an upper one upside down.
        let mirrored = span(a, -UP, 0.1, a + Vector3::new(0.2, 0.0, 4.0)).unwrap();
        assert!(close(mirrored.length_m, below.length_m));
    }

    /// Against the point where the cable leaves the circle found by bisection: the anchor comes into
    /// sight there.
    #[test]
    fn the_cable_leaves_its_pulley_at_a_tangent() {
        let (radius, a) = (0.08, Vector3::zeros());
        for anchor in [
            Vector3::new(1.0, 0.7, -2.0),
            Vector3::new(-0.3, 4.0, 0.4),
            Vector3::new(-2.0, -0.5, -0.1),
        ] {
            let found = span(a, UP, radius, anchor).unwrap();
            let across = Vector3::new(anchor.x, anchor.y, 0.0).normalize();
            let centre = across * radius;
            let way = |beta: f64| {
                let leaving = centre + (-across * beta.cos() + UP * beta.sin()) * radius;
                radius * beta + (anchor - leaving).norm()
            };
            let touches = |beta: f64| {
                let radial = -across * beta.cos() + UP * beta.sin();
                (anchor - centre - radial * radius).dot(&radial)
            };
            let (mut low, mut high) = (0.0, PI);
            for _ in 0..100 {
                let middle = 0.5 * (low + high);
                if touches(middle) > 0.0 {
                    high = middle;
                } else {
                    low = middle;
                }
            }
            assert!(touches(0.0) < 0.0 && touches(PI) > 0.0, "{anchor:?}");
            assert!(
                (found.wrap_rad - low).abs() < 1e-9,
                "{anchor:?} {found:?} {low}"
            );
            assert!((found.length_m - way(low)).abs() < 1e-9);
        }
    }

    #[test]
    fn derivatives_are_finite_differences() {
        let a = Vector3::new(0.7, 5.0, 5.3);
        let axis = Vector3::new(0.1, -0.05, 2.0);
        let length = |b: Vector3<f64>, radius: f64| span(a, axis, radius, b).unwrap().length_m;
        let h = 1e-6;
        for anchor in [Vector3::new(0.6, 0.5, 1.0), Vector3::new(-0.3, -4.0, 5.6)] {
            let found = span(a, axis, 0.06, anchor).unwrap();
            for i in 0..3 {
                let step = Vector3::ith(i, h);
                let slope = (length(anchor + step, 0.06) - length(anchor - step, 0.06)) / (2.0 * h);
                assert!(
                    (slope - found.direction[i]).abs() < 1e-8,
                    "{i} {slope} {found:?}"
                );
            }
            let slope = (length(anchor, 0.06 + h) - length(anchor, 0.06 - h)) / (2.0 * h);
            let beta = found.wrap_rad;
            assert!((slope - (beta - beta.sin())).abs() < 1e-8);
            assert!(close(found.direction.norm(), 1.0));
        }
    }

    #[test]
    fn no_cable_leads_into_its_pulley() {
        let a = Vector3::zeros();
        assert_eq!(span(a, UP, 0.1, Vector3::new(0.1, 0.0, 0.05)), None);
        assert_eq!(span(a, UP, 0.1, Vector3::new(0.0, 0.0, -3.0)), None);
        assert_eq!(span(a, UP, 0.1, Vector3::new(f64::NAN, 0.0, -3.0)), None);
    }
}
