//! How much of a beam's spot lies on a reflector.
//!
//! The spot is a uniform disc across the beam. Seen along the beam a reflector's straight edges
//! stay straight, so that the share of the spot inside follows from the edges' distances from the
//! beam's axis, measured across the beam in spot radii.

use std::f64::consts::PI;

/// Share of a unit disc on the inner side of a straight line whose distance from the centre is `q`,
/// positive where the centre is inside: 1/2 + (q sqrt(1-q^2) + asin q)/pi.
pub fn beyond_edge(q: f64) -> f64 {
    if q >= 1.0 {
        1.0
    } else if q <= -1.0 {
        0.0
    } else {
        0.5 + (q * (1.0 - q * q).sqrt() + libm::asin(q)) / PI
    }
}

/// Share of the unit disc about the origin that a polygon covers. Exact for any simple polygon,
/// whichever way round its corners are listed.
pub fn of_polygon(corners: &[[f64; 2]]) -> f64 {
    let nexts = corners.iter().skip(1).chain(corners.first());
    let area: f64 = corners
        .iter()
        .zip(nexts)
        .map(|(a, b)| disc_triangle(*a, *b))
        .sum();
    (area.abs() / PI).min(1.0)
}

fn cross(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

fn dot(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

/// Signed area of the sector between two directions.
fn sector(a: [f64; 2], b: [f64; 2]) -> f64 {
    0.5 * libm::atan2(cross(a, b), dot(a, b))
}

/// Signed area of the part of the triangle (origin, a, b) within the unit disc.
fn disc_triangle(a: [f64; 2], b: [f64; 2]) -> f64 {
    let d = [b[0] - a[0], b[1] - a[1]];
    let (dd, ad, aa) = (dot(d, d), dot(a, d), dot(a, a) - 1.0);
    let discriminant = ad * ad - dd * aa;
    if dd == 0.0 || discriminant <= 0.0 {
        return sector(a, b);
    }
    let root = discriminant.sqrt();
    let (enter, leave) = ((-ad - root) / dd, (-ad + root) / dd);
    if leave <= 0.0 || enter >= 1.0 {
        return sector(a, b);
    }
    let at = |t: f64| [a[0] + d[0] * t, a[1] + d[1] * t];
    let (p, q) = (at(enter.max(0.0)), at(leave.min(1.0)));
    let mut area = 0.5 * cross(p, q);
    if enter > 0.0 {
        area += sector(a, p);
    }
    if leave < 1.0 {
        area += sector(q, b);
    }
    area
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Share of a grid of points of the disc that `inside` accepts.
    fn counted(inside: impl Fn(f64, f64) -> bool) -> f64 {
        let n = 700;
        let (mut hits, mut all) = (0u32, 0u32);
        for i in 0..n {
            for k in 0..n {
                let x = (f64::from(i) + 0.5) / f64::from(n) * 2.0 - 1.0;
                let y = (f64::from(k) + 0.5) / f64::from(n) * 2.0 - 1.0;
                if x * x + y * y < 1.0 {
                    all += 1;
                    hits += u32::from(inside(x, y));
                }
            }
        }
        f64::from(hits) / f64::from(all)
    }

    #[test]
    fn half_plane_agrees_with_counting() {
        for q in [-1.2, -0.9, -0.31, 0.0, 0.2, 0.77, 1.0, 3.0] {
            let expected = counted(|x, _| x < q);
            assert!((beyond_edge(q) - expected).abs() < 2e-3, "{q}");
        }
    }

    #[test]
    fn polygons_agree_with_counting() {
        // A corner within the disc, a narrow parallelogram across it, one far away, one around it.
        let square = [[0.2, -0.3], [5.0, -0.3], [5.0, 5.0], [0.2, 5.0]];
        let expected = counted(|x, y| x > 0.2 && y > -0.3);
        assert!((of_polygon(&square) - expected).abs() < 2e-3);
        let narrow = [[-9.1, -9.0], [-8.5, -9.0], [9.1, 9.0], [8.5, 9.0]];
        let expected = counted(|x, y| {
            let centre = y * 8.8 / 9.0;
            (x - centre).abs() < 0.3
        });
        let narrow = [narrow[0], narrow[1], narrow[2], narrow[3]];
        assert!((of_polygon(&narrow) - expected).abs() < 3e-3);
        assert!(of_polygon(&[[2.0, 2.0], [3.0, 2.0], [3.0, 3.0]]) < 1e-15);
        let around = [[-9.0, -9.0], [9.0, -9.0], [9.0, 9.0], [-9.0, 9.0]];
        assert!((of_polygon(&around) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_strip_is_two_edges() {
        for (up, low) in [(0.4, 0.7), (0.1, 0.15), (1.4, -0.5)] {
            let strip = [[-50.0, -low], [50.0, -low], [50.0, up], [-50.0, up]];
            let edges = (beyond_edge(up) + beyond_edge(low) - 1.0).max(0.0);
            assert!((of_polygon(&strip) - edges).abs() < 1e-9, "{up} {low}");
        }
    }
}
