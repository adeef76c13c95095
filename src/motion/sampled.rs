//! Motion through recorded points: cubic Hermite pieces, smooth in velocity.

use super::{Motion, State};
use crate::record::TrajectoryPoint;
use nalgebra::Vector3;
use std::f64::consts::{PI, TAU};

/// Why points make no motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SampledError {
    /// There are none.
    #[error("the trajectory has no points")]
    Empty,
    /// A point is not later than the one before it.
    #[error("point {index} of the trajectory is not later than the one before it")]
    Order {
        /// Counted from 0.
        index: usize,
    },
    /// A point without a position or attitude.
    #[error("point {index} of the trajectory has a number missing in its pose")]
    Missing {
        /// Counted from 0.
        index: usize,
    },
}

#[derive(Clone, Copy, Debug)]
struct Knot {
    t_s: f64,
    position_m: Vector3<f64>,
    rotation_rad: Vector3<f64>,
    velocity_m_s: Vector3<f64>,
    rotation_rate_rad_s: Vector3<f64>,
}

/// Motion interpolated from a recorded or planned trajectory. Positions pass through the points
/// with their velocities (estimated from the neighbours where a point has none); roll, pitch and
/// yaw are unwrapped and treated alike. Time 0 is the first point.
#[derive(Clone, Debug)]
pub struct Sampled {
    knots: Vec<Knot>,
}

impl Sampled {
    /// The motion through `points`, whose stamps must grow.
    pub fn new(points: &[TrajectoryPoint]) -> Result<Sampled, SampledError> {
        let first = points.first().ok_or(SampledError::Empty)?;
        let mut knots: Vec<Knot> = Vec::with_capacity(points.len());
        for (index, point) in points.iter().enumerate() {
            let pose = point.position_m.iter().chain(&point.rotation_rad);
            if pose.into_iter().any(|v| !v.is_finite()) {
                return Err(SampledError::Missing { index });
            }
            let t_s = point.stamp.since_s(first.stamp);
            let mut rotation_rad = Vector3::from(point.rotation_rad);
            if let Some(last) = knots.last() {
                if t_s <= last.t_s {
                    return Err(SampledError::Order { index });
                }
                for (angle, before) in rotation_rad.iter_mut().zip(&last.rotation_rad) {
                    *angle -= TAU * ((*angle - before) / TAU).round();
                }
            }
            knots.push(Knot {
                t_s,
                position_m: point.position_m.into(),
                rotation_rad,
                velocity_m_s: point.velocity_m_s.into(),
                rotation_rate_rad_s: Vector3::zeros(),
            });
        }
        let rates = slopes(&knots, |knot| knot.rotation_rad);
        let velocities = slopes(&knots, |knot| knot.position_m);
        for ((knot, rate), velocity) in knots.iter_mut().zip(rates).zip(velocities) {
            knot.rotation_rate_rad_s = rate;
            if knot.velocity_m_s.iter().any(|v| !v.is_finite()) {
                knot.velocity_m_s = velocity;
            }
        }
        Ok(Sampled { knots })
    }
}

/// Slopes at the knots: of the parabola through a knot and its neighbours, one-sided at the ends.
fn slopes(knots: &[Knot], value: impl Fn(&Knot) -> Vector3<f64>) -> Vec<Vector3<f64>> {
    let chords: Vec<(f64, Vector3<f64>)> = knots
        .iter()
        .zip(knots.iter().skip(1))
        .map(|(a, b)| (b.t_s - a.t_s, (value(b) - value(a)) / (b.t_s - a.t_s)))
        .collect();
    (0..knots.len())
        .map(|k| {
            let before = k.checked_sub(1).and_then(|k| chords.get(k));
            match (before, chords.get(k)) {
                (Some((h0, s0)), Some((h1, s1))) => (s0 * *h1 + s1 * *h0) / (h0 + h1),
                (Some((_, s)), None) | (None, Some((_, s))) => *s,
                (None, None) => Vector3::zeros(),
            }
        })
        .collect()
}

/// Value, first and second derivative of the cubic with the given ends and slopes, at share `u` of
/// an interval of `h` seconds.
pub(super) fn hermite(
    (p0, m0): (Vector3<f64>, Vector3<f64>),
    (p1, m1): (Vector3<f64>, Vector3<f64>),
    h: f64,
    u: f64,
) -> [Vector3<f64>; 3] {
    let (c2, c3) = (
        (p1 - p0) * 3.0 - (m0 * 2.0 + m1) * h,
        (p0 - p1) * 2.0 + (m0 + m1) * h,
    );
    [
        p0 + (m0 * h + (c2 + c3 * u) * u) * u,
        m0 + (c2 * 2.0 + c3 * (3.0 * u)) * (u / h),
        (c2 * 2.0 + c3 * (6.0 * u)) / (h * h),
    ]
}

/// The angle in (-pi, pi].
fn wrapped(angle_rad: f64) -> f64 {
    angle_rad - TAU * ((angle_rad - PI) / TAU).ceil()
}

impl Motion for Sampled {
    fn at(&self, t_s: f64) -> State {
        let next = self.knots.partition_point(|knot| knot.t_s <= t_s);
        let before = next.checked_sub(1).and_then(|k| self.knots.get(k));
        let mut state = match (before, self.knots.get(next)) {
            (Some(a), Some(b)) => {
                let h = b.t_s - a.t_s;
                let u = (t_s - a.t_s) / h;
                let position = hermite(
                    (a.position_m, a.velocity_m_s),
                    (b.position_m, b.velocity_m_s),
                    h,
                    u,
                );
                let rotation = hermite(
                    (a.rotation_rad, a.rotation_rate_rad_s),
                    (b.rotation_rad, b.rotation_rate_rad_s),
                    h,
                    u,
                );
                State {
                    position_m: position[0],
                    rotation_rad: rotation[0],
                    velocity_m_s: position[1],
                    rotation_rate_rad_s: rotation[1],
                    acceleration_m_s2: position[2],
                }
            }
            (Some(knot), None) | (None, Some(knot)) => State::resting(super::Pose {
                position_m: knot.position_m,
                rotation_rad: knot.rotation_rad,
            }),
            // `new` refuses an empty trajectory.
            (None, None) => State::resting(super::Pose {
                position_m: Vector3::zeros(),
                rotation_rad: Vector3::zeros(),
            }),
        };
        state.rotation_rad.apply(|angle| *angle = wrapped(*angle));
        state
    }

    fn duration_s(&self) -> f64 {
        self.knots.last().map_or(0.0, |knot| knot.t_s)
    }
}

#[cfg(test)]
mod tests {
    use super::super::path::tests::check_rates;
    use super::*;
    use crate::record::Stamp;

    fn cubic(t: f64, with_velocity: bool) -> TrajectoryPoint {
        TrajectoryPoint {
            stamp: Stamp::from_ns(1_000_000_000).plus_s(t),
            position_m: [t * t * t, 1.0 - t * t, 2.0 * t],
            rotation_rad: [0.1 * t, -0.2, 0.0],
            velocity_m_s: if with_velocity {
                [3.0 * t * t, -2.0 * t, 2.0]
            } else {
                [f64::NAN; 3]
            },
        }
    }

    #[test]
    fn a_cubic_is_met_exactly() {
        let points: Vec<_> = [0.0, 0.4, 1.0, 1.3]
            .iter()
            .map(|t| cubic(*t, true))
            .collect();
        let motion = Sampled::new(&points).unwrap();
        for k in 0..=130 {
            let t = f64::from(k) * 0.01;
            let truth = cubic(t, true);
            let state = motion.at(t);
            assert!((state.position_m - Vector3::from(truth.position_m)).norm() < 1e-12);
            assert!((state.rotation_rad - Vector3::from(truth.rotation_rad)).norm() < 1e-12);
            if k < 130 {
                assert!((state.velocity_m_s - Vector3::from(truth.velocity_m_s)).norm() < 1e-10);
            }
        }
        check_rates(
            &motion,
            (1..130)
                .filter(|k| k % 10 != 0)
                .map(|k| f64::from(k) * 0.01),
        );
    }

    #[test]
    fn missing_velocities_are_estimated_and_yaw_is_unwrapped() {
        let mut points: Vec<_> = (0..20).map(|k| cubic(f64::from(k) * 0.05, false)).collect();
        for (k, point) in points.iter_mut().enumerate() {
            point.rotation_rad[2] = wrapped(3.0 + 0.05 * k as f64);
        }
        let motion = Sampled::new(&points).unwrap();
        let state = motion.at(0.475);
        assert!((state.velocity_m_s.x - 3.0 * 0.475 * 0.475).abs() < 5e-3);
        assert!((state.rotation_rate_rad_s.z - 1.0).abs() < 1e-9);
        assert!((state.rotation_rad.z - wrapped(3.475)).abs() < 1e-9);
    }

    #[test]
    fn faulty_points_are_refused() {
        assert_eq!(Sampled::new(&[]).unwrap_err(), SampledError::Empty);
        let twice = [cubic(0.1, true), cubic(0.1, true)];
        assert_eq!(
            Sampled::new(&twice).unwrap_err(),
            SampledError::Order { index: 1 }
        );
        let holes = [cubic(0.0, true), TrajectoryPoint::default()];
        assert_eq!(
            Sampled::new(&holes).unwrap_err(),
            SampledError::Missing { index: 1 }
        );
    }
}
