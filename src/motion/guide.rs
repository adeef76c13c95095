//! The desired motion as a stretch of its points that moves along with the time: what a live side
//! input can give.
//!
//! Between two points the position is the cubic through both with their velocities, and the
//! attitude turns by a rotation vector that is a cubic too; a velocity that a point does not have
//! is the slope of the parabola through it and its neighbours.

use super::sampled::hermite;
use super::turn;
use crate::record::{Stamp, TrajectoryPoint};
use nalgebra::{UnitQuaternion, Vector3};
use std::collections::VecDeque;

/// Desired position, attitude and their changes at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Guided {
    pub position_m: Vector3<f64>,
    pub attitude: UnitQuaternion<f64>,
    pub velocity_m_s: Vector3<f64>,
    /// About the axes of B, rad/s.
    pub rate_rad_s: Vector3<f64>,
    /// How far the instant is from the nearest point where it is not between two, s.
    pub beyond_s: f64,
}

#[derive(Clone, Copy, Debug)]
struct Knot {
    stamp: Stamp,
    position_m: Vector3<f64>,
    attitude: UnitQuaternion<f64>,
    velocity_m_s: Vector3<f64>,
}

/// Points of a desired motion around the present.
#[derive(Clone, Debug, Default)]
pub struct Guide {
    knots: VecDeque<Knot>,
}

/// More points than this are never kept: ten seconds at 10 kHz.
const KEPT: usize = 100_000;

impl Guide {
    /// Takes the next point. One that is not later than the last, or has a number missing, is
    /// passed over.
    pub fn push(&mut self, point: &TrajectoryPoint) {
        let whole = point.position_m.iter().chain(&point.rotation_rad);
        let later = self.knots.back().is_none_or(|k| k.stamp < point.stamp);
        if !later || whole.into_iter().any(|v| !v.is_finite()) {
            return;
        }
        if self.knots.len() == KEPT {
            self.knots.pop_front();
        }
        self.knots.push_back(Knot {
            stamp: point.stamp,
            position_m: point.position_m.into(),
            attitude: turn::attitude(point.rotation_rad),
            velocity_m_s: point.velocity_m_s.into(),
        });
    }

    /// Forgets what is not needed for instants from `stamp` on.
    pub fn forget_before(&mut self, stamp: Stamp) {
        // The slope at a point needs the one before it.
        while self.knots.get(2).is_some_and(|k| k.stamp <= stamp) {
            self.knots.pop_front();
        }
    }

    /// The motion at an instant that is within `reach_s` of the points around it.
    pub(super) fn at(&self, stamp: Stamp, reach_s: f64) -> Option<Guided> {
        let next = self.knots.partition_point(|knot| knot.stamp <= stamp);
        let before = next.checked_sub(1);
        let near = |index: Option<usize>| {
            let knot = self.knots.get(index?)?;
            let off_s = stamp.since_s(knot.stamp);
            (off_s.abs() <= reach_s).then_some((index?, knot, off_s))
        };
        match (near(before), near(Some(next))) {
            (Some((k, from, t_s)), Some((_, to, _))) => Some(self.between(k, from, to, t_s)),
            (Some((k, knot, off_s)), None) | (None, Some((k, knot, off_s))) => {
                let (velocity_m_s, rate_rad_s) = self.slopes(k);
                Some(Guided {
                    position_m: knot.position_m + velocity_m_s * off_s,
                    attitude: turn::turn(rate_rad_s * off_s) * knot.attitude,
                    velocity_m_s,
                    rate_rad_s,
                    beyond_s: off_s.abs(),
                })
            }
            (None, None) => None,
        }
    }

    fn between(&self, k: usize, from: &Knot, to: &Knot, t_s: f64) -> Guided {
        let h = to.stamp.since_s(from.stamp);
        let u = t_s / h;
        let ((v0, w0), (v1, w1)) = (self.slopes(k), self.slopes(k + 1));
        let [position_m, velocity_m_s, _] =
            hermite((from.position_m, v0), (to.position_m, v1), h, u);
        let whole = turn::vector(&(to.attitude * from.attitude.inverse()));
        let [part, rate_rad_s, _] = hermite((Vector3::zeros(), w0), (whole, w1), h, u);
        Guided {
            position_m,
            attitude: turn::turn(part) * from.attitude,
            velocity_m_s,
            rate_rad_s,
            beyond_s: 0.0,
        }
    }

    /// Velocity and rate at a point.
    fn slopes(&self, k: usize) -> (Vector3<f64>, Vector3<f64>) {
        let chord = |a: &Knot, b: &Knot| {
            let h = b.stamp.since_s(a.stamp);
            let turned = turn::vector(&(b.attitude * a.attitude.inverse()));
            (h, (b.position_m - a.position_m) / h, turned / h)
        };
        let Some(knot) = self.knots.get(k) else {
            return (Vector3::zeros(), Vector3::zeros());
        };
        let before = k.checked_sub(1).and_then(|b| self.knots.get(b));
        let before = before.map(|b| chord(b, knot));
        let after = self.knots.get(k + 1).map(|a| chord(knot, a));
        let (velocity, rate) = match (before, after) {
            (Some((h0, v0, w0)), Some((h1, v1, w1))) => {
                let blend = |a: Vector3<f64>, b: Vector3<f64>| (a * h1 + b * h0) / (h0 + h1);
                (blend(v0, v1), blend(w0, w1))
            }
            (Some((_, v, w)), None) | (None, Some((_, v, w))) => (v, w),
            (None, None) => (Vector3::zeros(), Vector3::zeros()),
        };
        let given = knot.velocity_m_s.iter().all(|v| v.is_finite());
        (if given { knot.velocity_m_s } else { velocity }, rate)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cubic in time, turning about a fixed axis.
    fn point(t: f64, with_velocity: bool) -> TrajectoryPoint {
        let turned = turn::turn(Vector3::new(0.1, -0.2, 0.3) * t) * turn::attitude([0.2, 0.1, 3.0]);
        TrajectoryPoint {
            stamp: Stamp::from_ns(5_000_000_000).plus_s(t),
            position_m: [t * t * t, 1.0 - t * t, 2.0 * t],
            rotation_rad: turn::euler(&turned),
            velocity_m_s: if with_velocity {
                [3.0 * t * t, -2.0 * t, 2.0]
            } else {
                [f64::NAN; 3]
            },
        }
    }

    #[test]
    fn a_cubic_and_a_steady_turn_are_met_exactly() {
        let mut guide = Guide::default();
        for k in 0..40 {
            guide.push(&point(f64::from(k) * 0.05, true));
        }
        for k in 0..190 {
            let t = f64::from(k) * 0.01;
            let truth = point(t, true);
            let guided = guide.at(truth.stamp, 0.1).unwrap();
            assert!((guided.position_m - Vector3::from(truth.position_m)).norm() < 1e-9);
            assert!((guided.velocity_m_s - Vector3::from(truth.velocity_m_s)).norm() < 1e-7);
            let off = guided
                .attitude
                .angle_to(&turn::attitude(truth.rotation_rad));
            assert!(off < 1e-9, "{off}");
            assert!((guided.rate_rad_s - Vector3::new(0.1, -0.2, 0.3)).norm() < 1e-7);
            assert_eq!(guided.beyond_s, 0.0);
        }
    }

    #[test]
    fn forgetting_changes_nothing_after_it() {
        let mut whole = Guide::default();
        for k in 0..40 {
            whole.push(&point(f64::from(k) * 0.05, false));
        }
        let mut part = whole.clone();
        let from = Stamp::from_ns(5_000_000_000).plus_s(1.02);
        part.forget_before(from);
        assert!(part.knots.len() < 25);
        for k in 0..90 {
            let stamp = from.plus_s(f64::from(k) * 0.01);
            assert_eq!(part.at(stamp, 0.1), whole.at(stamp, 0.1));
        }
    }

    #[test]
    fn beyond_its_points_it_reaches_as_far_as_asked() {
        let mut guide = Guide::default();
        assert!(guide.at(Stamp::from_ns(0), 1.0).is_none());
        for t in [0.0, 0.05, 0.1, 0.6] {
            guide.push(&point(t, true));
        }
        // One that goes back and one with a hole.
        guide.push(&point(0.2, true));
        guide.push(&TrajectoryPoint::default());
        let at = |t: f64| guide.at(Stamp::from_ns(5_000_000_000).plus_s(t), 0.1);
        assert!(at(-0.11).is_none() && at(0.71).is_none());
        let end = at(0.7).unwrap();
        assert!((end.position_m.z - 1.4).abs() < 1e-9 && (end.beyond_s - 0.1).abs() < 1e-9);
        // In a gap nothing is known.
        assert!(at(0.35).is_none());
        assert!((at(0.15).unwrap().beyond_s - 0.05).abs() < 1e-9);
    }
}
