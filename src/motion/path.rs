//! Straight paths between poses, run once at constant speed or to and fro, and a wobble on top.

use super::profile::{Profile, Travel};
use super::{Motion, State};
use nalgebra::Vector3;
use std::f64::consts::TAU;

/// A pose of the platform in B.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Platform origin, m.
    pub position_m: Vector3<f64>,
    /// Roll, pitch, yaw, rad.
    pub rotation_rad: Vector3<f64>,
}

impl Pose {
    /// Level, at a place, m.
    pub const fn level(x_m: f64, y_m: f64, z_m: f64) -> Pose {
        Pose {
            position_m: Vector3::new(x_m, y_m, z_m),
            rotation_rad: Vector3::new(0.0, 0.0, 0.0),
        }
    }

    /// Distance of the origins, m.
    pub fn distance_m(&self, other: &Pose) -> f64 {
        (other.position_m - self.position_m).norm()
    }
}

/// The state between two poses; roll, pitch and yaw change in proportion to the distance.
fn between(from: &Pose, to: &Pose, travel: Travel) -> State {
    let distance_m = from.distance_m(to);
    if distance_m == 0.0 {
        return State::resting(*from);
    }
    let step = to.position_m - from.position_m;
    let turn = to.rotation_rad - from.rotation_rad;
    let share = travel.distance_m / distance_m;
    State {
        position_m: from.position_m + step * share,
        rotation_rad: from.rotation_rad + turn * share,
        velocity_m_s: step * (travel.speed_m_s / distance_m),
        rotation_rate_rad_s: turn * (travel.speed_m_s / distance_m),
        acceleration_m_s2: step * (travel.acceleration_m_s2 / distance_m),
    }
}

/// A straight line at constant speed. The platform already moves at the start and still at the end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Straight {
    /// Pose at the start.
    pub from: Pose,
    /// Pose at the end.
    pub to: Pose,
    /// m/s, positive.
    pub speed_m_s: f64,
}

impl Motion for Straight {
    fn at(&self, t_s: f64) -> State {
        let full_s = self.duration_s();
        let speed_m_s = if (0.0..=full_s).contains(&t_s) {
            self.speed_m_s
        } else {
            0.0
        };
        let travel = Travel {
            distance_m: self.speed_m_s * t_s.clamp(0.0, full_s),
            speed_m_s,
            acceleration_m_s2: 0.0,
        };
        between(&self.from, &self.to, travel)
    }

    fn duration_s(&self) -> f64 {
        self.from.distance_m(&self.to) / self.speed_m_s
    }
}

/// From one pose to another and back, from rest to rest each way, with a rest at each end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shuttle<P> {
    /// Pose at the start.
    pub from: Pose,
    /// The other end.
    pub to: Pose,
    /// Profile over the distance between the two.
    pub profile: P,
    /// Rest before each run, s.
    pub dwell_s: f64,
    /// Number of runs there and back.
    pub loops: u32,
}

impl<P: Profile> Shuttle<P> {
    fn leg_s(&self) -> f64 {
        self.dwell_s + self.profile.duration_s()
    }
}

impl<P: Profile> Motion for Shuttle<P> {
    fn at(&self, t_s: f64) -> State {
        let legs = 2 * u64::from(self.loops);
        let leg_s = self.leg_s();
        if legs == 0 || leg_s <= 0.0 || t_s >= self.duration_s() {
            return State::resting(self.from);
        }
        let leg = ((t_s / leg_s).max(0.0) as u64).min(legs - 1);
        let travel = self.profile.at(t_s - leg as f64 * leg_s - self.dwell_s);
        if leg.is_multiple_of(2) {
            between(&self.from, &self.to, travel)
        } else {
            between(&self.to, &self.from, travel)
        }
    }

    fn duration_s(&self) -> f64 {
        2.0 * f64::from(self.loops) * self.leg_s() + self.dwell_s
    }
}

/// Another motion with a sinusoidal roll, pitch and yaw on top.
#[derive(Clone, Debug)]
pub struct Wobble<M> {
    /// What the platform does otherwise.
    pub motion: M,
    /// Amplitudes of roll, pitch, yaw, rad.
    pub amplitude_rad: Vector3<f64>,
    /// Frequency, Hz.
    pub frequency_hz: f64,
}

impl<M: Motion> Motion for Wobble<M> {
    fn at(&self, t_s: f64) -> State {
        let mut state = self.motion.at(t_s);
        let (sin, cos) = libm::sincos(TAU * self.frequency_hz * t_s);
        state.rotation_rad += self.amplitude_rad * sin;
        state.rotation_rate_rad_s += self.amplitude_rad * (TAU * self.frequency_hz * cos);
        state
    }

    fn duration_s(&self) -> f64 {
        self.motion.duration_s()
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::profile::{Limits, SCurve};
    use super::*;

    /// Rates against central differences.
    pub fn check_rates(motion: &dyn Motion, times_s: impl Iterator<Item = f64>) {
        let h = 1e-5;
        for t in times_s {
            let (before, now, after) = (motion.at(t - h), motion.at(t), motion.at(t + h));
            let velocity = (after.position_m - before.position_m) / (2.0 * h);
            let rate = (after.rotation_rad - before.rotation_rad) / (2.0 * h);
            let acceleration = (after.velocity_m_s - before.velocity_m_s) / (2.0 * h);
            assert!(
                (velocity - now.velocity_m_s).norm() < 1e-6,
                "velocity at {t}"
            );
            assert!(
                (rate - now.rotation_rate_rad_s).norm() < 1e-6,
                "rate at {t}"
            );
            assert!(
                (acceleration - now.acceleration_m_s2).norm() < 1e-2,
                "acceleration at {t}"
            );
        }
    }

    fn poses() -> (Pose, Pose) {
        (
            Pose {
                position_m: Vector3::new(0.0, -4.0, 0.465),
                rotation_rad: Vector3::new(0.01, 0.0, -0.02),
            },
            Pose {
                position_m: Vector3::new(0.1, 4.0, 3.5),
                rotation_rad: Vector3::new(-0.01, 0.02, 0.0),
            },
        )
    }

    #[test]
    fn straight_line_ends_where_it_should() {
        let (from, to) = poses();
        let line = Straight {
            from,
            to,
            speed_m_s: 2.0,
        };
        check_rates(
            &line,
            (1..40).map(|k| line.duration_s() * f64::from(k) / 40.0),
        );
        assert_eq!(line.at(-1.0).position_m, from.position_m);
        assert!((line.at(1e3).position_m - to.position_m).norm() < 1e-12);
        assert!((line.at(1.0).velocity_m_s.norm() - 2.0).abs() < 1e-12);
    }

    #[test]
    fn shuttle_returns_and_rests() {
        let (from, to) = poses();
        let limits = Limits {
            speed_m_s: 3.0,
            acceleration_m_s2: 5.0,
            jerk_m_s3: 50.0,
        };
        let shuttle = Shuttle {
            from,
            to,
            profile: SCurve::new(from.distance_m(&to), limits),
            dwell_s: 0.5,
            loops: 2,
        };
        let full_s = shuttle.duration_s();
        check_rates(&shuttle, (1..500).map(|k| full_s * f64::from(k) / 500.0));
        assert_eq!(shuttle.at(0.3), State::resting(from));
        let there_s = shuttle.leg_s() + 0.2;
        assert!((shuttle.at(there_s).position_m - to.position_m).norm() < 1e-12);
        assert!((shuttle.at(full_s).position_m - from.position_m).norm() < 1e-12);
        let wobbling = Wobble {
            motion: shuttle,
            amplitude_rad: Vector3::new(0.017, 0.0, 0.003),
            frequency_hz: 2.0,
        };
        check_rates(&wobbling, (1..500).map(|k| full_s * f64::from(k) / 500.0));
    }
}
