//! The exact posterior of x and yaw under edges that are intervals: even over a polygon, for every
//! set of values of the other unknowns.

use crate::pose::gaussian::Gaussian;
use crate::pose::interval::BoxFactor;
use crate::pose::joint::{self, STATE, Vector};

/// Draws of the other unknowns, in pairs of opposite sign.
const DRAWS: usize = 32;
/// Fewest draws that must count.
const COUNTING: f64 = 6.0;
/// Where x, m, and yaw, rad, may be around the pose.
const WIDE: [f64; 2] = [0.6, 0.12];

/// Variances of x and yaw under the boxes, `state` being what the lines leave of the other unknowns.
/// Given those, x and yaw are even over the polygon that the boxes cut out; the area is its weight.
pub(super) fn polygons(state: &Gaussian<STATE>, boxes: &[BoxFactor<STATE>]) -> Option<[f64; 2]> {
    // The other unknowns without x and yaw, which the lines do not tell.
    let mut others = state.covariance;
    for k in [joint::X, joint::YAW] {
        others.fill_row(k, 0.0);
        others.fill_column(k, 0.0);
        others[(k, k)] = 1e-18;
    }
    let factor = others.cholesky()?.unpack();
    let mut total = Moments::default();
    let mut squares = 0.0;
    for normal in normals(DRAWS / 2) {
        for sign in [1.0, -1.0] {
            let at = state.mean + factor * normal * sign;
            let [x, yaw] = WIDE;
            let mut polygon = vec![[-x, -yaw], [x, -yaw], [x, yaw], [-x, yaw]];
            for b in boxes {
                let row = [b.row[joint::X], b.row[joint::YAW]];
                let here = b.row.dot(&at);
                polygon = clipped(&polygon, row, b.high - here);
                polygon = clipped(&polygon, row.map(|r| -r), here - b.low);
            }
            let moments = Moments::of(&polygon);
            squares += moments.area * moments.area;
            total.add(&moments);
        }
    }
    let counting = total.area * total.area / squares;
    if !(counting >= COUNTING) {
        return None;
    }
    let variance = |k: usize| total.second[k] / total.area - (total.first[k] / total.area).powi(2);
    Some([variance(0), variance(1)])
}

/// Draws of standard normal numbers, spread evenly (Box and Muller), each number with a mean square
/// of 1 over all draws.
fn normals(count: usize) -> Vec<Vector> {
    let mut draws: Vec<Vector> = Vec::with_capacity(count);
    for (i, u) in super::spread(count).enumerate() {
        let mut normal = Vector::zeros();
        for (k, pair) in [[0, 1], [2, 3], [1, 2], [3, 0], [0, 2]]
            .into_iter()
            .enumerate()
        {
            // The later pairs are turned, so that no number comes twice.
            let turned = |j: usize| (u[j] + 0.381_966 * (k * (i + 1)) as f64).fract().max(1e-9);
            let [a, b] = pair.map(turned);
            let radius = (-2.0 * a.ln()).sqrt();
            let (sin, cos) = (std::f64::consts::TAU * b).sin_cos();
            for (j, value) in [radius * cos, radius * sin].into_iter().enumerate() {
                if let Some(place) = normal.get_mut(2 * k + j) {
                    *place = value;
                }
            }
        }
        draws.push(normal);
    }
    let squares = draws.iter().map(|d| d.component_mul(d)).sum::<Vector>() / count as f64;
    draws
        .iter()
        .map(|d| d.component_div(&squares.map(f64::sqrt)))
        .collect()
}

/// The part of a convex polygon with row . p <= bound.
fn clipped(polygon: &[[f64; 2]], row: [f64; 2], bound: f64) -> Vec<[f64; 2]> {
    let over = |p: &[f64; 2]| row[0] * p[0] + row[1] * p[1] - bound;
    let mut kept = Vec::with_capacity(polygon.len() + 1);
    let nexts = polygon.iter().skip(1).chain(polygon.first());
    for (p, q) in polygon.iter().zip(nexts) {
        let (a, b) = (over(p), over(q));
        if a <= 0.0 {
            kept.push(*p);
        }
        if (a < 0.0 && b > 0.0) || (a > 0.0 && b < 0.0) {
            let t = a / (a - b);
            kept.push([0, 1].map(|k| p[k] + t * (q[k] - p[k])));
        }
    }
    kept
}

/// Area, and integrals of both coordinates and of their squares.
#[derive(Clone, Copy, Default)]
struct Moments {
    area: f64,
    first: [f64; 2],
    second: [f64; 2],
}

impl Moments {
    /// Of a convex polygon, triangle by triangle.
    fn of(polygon: &[[f64; 2]]) -> Moments {
        let mut moments = Moments::default();
        let Some(p) = polygon.first() else {
            return moments;
        };
        for pair in polygon.windows(2).skip(1) {
            let (q, r) = (pair[0], pair[1]);
            let cross = (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
            let area = 0.5 * cross.abs();
            moments.area += area;
            for k in 0..2 {
                let sum = p[k] + q[k] + r[k];
                let squares = p[k] * p[k] + q[k] * q[k] + r[k] * r[k];
                moments.first[k] += area * sum / 3.0;
                moments.second[k] += area / 12.0 * (squares + sum * sum);
            }
        }
        moments
    }

    fn add(&mut self, other: &Moments) {
        self.area += other.area;
        for k in 0..2 {
            self.first[k] += other.first[k];
            self.second[k] += other.second[k];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_polygon_has_the_moments_of_its_shape() {
        let square = [[-1.0, -2.0], [3.0, -2.0], [3.0, 2.0], [-1.0, 2.0]];
        let m = Moments::of(&square);
        assert!((m.area - 16.0).abs() < 1e-12 && (m.first[0] / m.area - 1.0).abs() < 1e-12);
        // Variance of an even distribution: width^2 / 12.
        let variance = m.second[0] / m.area - (m.first[0] / m.area).powi(2);
        assert!((variance - 16.0 / 12.0).abs() < 1e-12);
        let half = clipped(&square, [1.0, 0.0], 1.0);
        assert!((Moments::of(&half).area - 8.0).abs() < 1e-12);
        let corner = clipped(&half, [1.0, 1.0], -2.0);
        assert!((Moments::of(&corner).area - 0.5).abs() < 1e-12);
        assert!(clipped(&corner, [1.0, 0.0], -5.0).is_empty());
    }
}
