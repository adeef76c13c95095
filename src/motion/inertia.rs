//! An IMU's samples as a stretch that moves along with the time, and what they say of the motion
//! between two instants: rates integrated to a turn, accelerations to velocity and position.

use super::tracker::Impulse;
use super::turn;
use crate::record::{Axes, ImuSample, Stamp};
use nalgebra::{UnitQuaternion, Vector3};
use std::collections::VecDeque;
use std::f64::consts::PI;

/// Standard gravity, m/s^2.
const GRAVITY_M_S2: f64 = 9.80665;
/// More samples than this are never kept: ten seconds at 1 kHz.
const KEPT: usize = 10_000;

#[derive(Clone, Copy, Debug)]
struct Reading {
    stamp: Stamp,
    /// In P, rad/s.
    rate_rad_s: Vector3<f64>,
    /// Specific force in P, m/s^2; NaN where there is no accelerometer.
    force_m_s2: Vector3<f64>,
}

/// IMU samples around the present, in the platform's axes.
#[derive(Clone, Debug)]
pub struct Inertia {
    readings: VecDeque<Reading>,
    mounting: UnitQuaternion<f64>,
    half_turn: UnitQuaternion<f64>,
}

impl Default for Inertia {
    fn default() -> Self {
        Inertia::mounted([0.0; 3])
    }
}

impl Inertia {
    /// For an IMU whose axes are turned by roll, pitch and yaw (rad) from its nominal ones: x along
    /// P's x, z along P's -z (`imu.rotation_deg` of the frame file). It counts for samples in the
    /// device's own axes only.
    pub fn mounted(rotation_rad: [f64; 3]) -> Inertia {
        Inertia {
            readings: VecDeque::new(),
            mounting: turn::attitude(rotation_rad),
            half_turn: turn::attitude([PI, 0.0, 0.0]),
        }
    }

    /// Takes the next sample. One that is not later than the last, or has no rates, is passed over.
    pub fn push(&mut self, sample: &ImuSample) {
        let rate = Vector3::new(
            sample.gyro_x_rad_s,
            sample.gyro_y_rad_s,
            sample.gyro_z_rad_s,
        );
        let force = Vector3::new(
            sample.accel_x_m_s2,
            sample.accel_y_m_s2,
            sample.accel_z_m_s2,
        );
        let later = self
            .readings
            .back()
            .is_none_or(|last| last.stamp < sample.stamp);
        if !later || rate.iter().any(|v| !v.is_finite()) {
            return;
        }
        let into_platform = match sample.axes {
            Axes::Platform => UnitQuaternion::identity(),
            Axes::Ned => self.mounting * self.half_turn,
            Axes::Enu => self.mounting,
        };
        if self.readings.len() == KEPT {
            self.readings.pop_front();
        }
        self.readings.push_back(Reading {
            stamp: sample.stamp,
            rate_rad_s: into_platform * rate,
            force_m_s2: into_platform * force,
        });
    }

    /// Forgets what is not needed for instants from `stamp` on.
    pub fn forget_before(&mut self, stamp: Stamp) {
        while self.readings.get(1).is_some_and(|r| r.stamp <= stamp) {
            self.readings.pop_front();
        }
    }

    /// When the newest sample was taken.
    pub fn newest(&self) -> Option<Stamp> {
        self.readings.back().map(|reading| reading.stamp)
    }

    /// Whether there are no samples.
    pub(super) fn is_empty(&self) -> bool {
        self.readings.is_empty()
    }

    /// Whether there are samples and they come without accelerations.
    pub(super) fn lacks_force(&self) -> bool {
        self.readings
            .back()
            .is_some_and(|r| !r.force_m_s2.iter().all(|v| v.is_finite()))
    }

    /// The motion from one instant to a later one, of a platform whose attitude is `start` at the
    /// first, and for how long of that time there are no samples around, s. None where the nearest
    /// sample is further away than `reach_s`.
    pub(super) fn impulse(
        &self,
        from: Stamp,
        to: Stamp,
        start: UnitQuaternion<f64>,
        reach_s: f64,
    ) -> Option<(Impulse, f64)> {
        let (first, last) = (self.readings.front()?, self.readings.back()?);
        let early_s = first.stamp.since_s(from).max(0.0);
        let late_s = to.since_s(last.stamp).max(0.0);
        if to < from || early_s > reach_s || late_s > reach_s {
            return None;
        }
        let mut attitude = start;
        let (mut velocity_m_s, mut position_m) = (Vector3::zeros(), Vector3::zeros());
        let next = self.readings.partition_point(|r| r.stamp <= from);
        let within = self
            .readings
            .range(next..)
            .take_while(|r| r.stamp < to)
            .copied();
        let mut here = self.reading(from)?;
        for there in within.chain(self.reading(to)) {
            let h = there.stamp.since_s(here.stamp);
            if h > 2.0 * reach_s {
                return None;
            }
            let turned = attitude * turn::turn((here.rate_rad_s + there.rate_rad_s) * (0.5 * h));
            // The acceleration goes in a straight line from one end of the step to the other.
            let gravity = Vector3::z() * GRAVITY_M_S2;
            let (a0, a1) = (
                attitude * here.force_m_s2 - gravity,
                turned * there.force_m_s2 - gravity,
            );
            position_m += velocity_m_s * h + (a0 * 2.0 + a1) * (h * h / 6.0);
            velocity_m_s += (a0 + a1) * (h / 2.0);
            attitude = turned;
            here = there;
        }
        let known = position_m.iter().all(|v| v.is_finite());
        let impulse = Impulse {
            position_m: if known { position_m } else { Vector3::zeros() },
            velocity_m_s: if known {
                velocity_m_s
            } else {
                Vector3::zeros()
            },
            turn: attitude * start.inverse(),
        };
        Some((impulse, early_s + late_s))
    }

    /// The reading at an instant: between two samples in proportion, otherwise the nearest one.
    fn reading(&self, stamp: Stamp) -> Option<Reading> {
        let next = self.readings.partition_point(|r| r.stamp <= stamp);
        let before = next.checked_sub(1).and_then(|i| self.readings.get(i));
        let reading = match (before, self.readings.get(next)) {
            (Some(a), Some(b)) => {
                let share = stamp.since_s(a.stamp) / b.stamp.since_s(a.stamp);
                Reading {
                    stamp,
                    rate_rad_s: a.rate_rad_s.lerp(&b.rate_rad_s, share),
                    force_m_s2: a.force_m_s2.lerp(&b.force_m_s2, share),
                }
            }
            (Some(only), None) | (None, Some(only)) => Reading { stamp, ..*only },
            (None, None) => return None,
        };
        Some(reading)
    }
}
