//! Carries a pose to the instant at which it is used: stamp and pose move together (Kurniawan
//! 2017, eq. 4.26 to 4.28).
//!
//! A pose is measured at one instant and used at a later one; at 3 m/s every millisecond between
//! the two is 3 mm. The pose is moved by the platform's motion in between,
//! `r_used = r_measured + delta r`, which is known from a desired motion ([`Guide`]), from an IMU
//! ([`Inertia`]) or from the poses themselves (a causal filter). The attitude is carried by a
//! rotation, not by rates of roll, pitch and yaw. The covariance grows by what is not known of the
//! motion and of the delay.

use super::guide::{Guide, Guided};
use super::inertia::Inertia;
use super::tracker::{Impulse, Increment, Measured, Model, Tracker};
use super::turn;
use crate::frame::{euler_to_fixed_axes, fixed_axes_to_euler};
use crate::record::{Pose, Stamp, Status, upper_index};
use nalgebra::{Matrix3, Matrix6, Vector6};

/// Where the motion between measurement and use is known from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CarryMethod {
    /// It is taken as none: only the stamp moves.
    None,
    /// The difference of the desired poses.
    DesiredExact,
    /// The mean of the desired velocities at both instants, times the delay, as published
    /// (Kurniawan 2017, eq. 4.27).
    DesiredTrapezoid,
    /// The poses before, with a velocity.
    ConstantVelocity,
    /// The poses before, with velocity and acceleration.
    ConstantAcceleration,
    /// An IMU's rates and accelerations, with the velocity of the poses before.
    Imu,
}

/// What carrying assumes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CarryOptions {
    /// Where the motion is known from.
    pub method: CarryMethod,
    /// A pose that would have to be carried further is emptied, s.
    pub max_horizon_s: f64,
    /// Standard deviation of the delay, s.
    pub delay_sigma_s: f64,
    /// Points of the desired motion, or IMU samples, that are further from an instant tell nothing
    /// about it, s.
    pub reach_s: f64,
    /// Standard deviation of the true velocity about the desired one, m/s.
    pub following_sigma_m_s: f64,
    /// Standard deviation of a position that comes without a covariance, m.
    pub position_sigma_m: f64,
    /// Standard deviation of an angle that comes without a covariance, rad.
    pub angle_sigma_rad: f64,
}

impl Default for CarryOptions {
    fn default() -> Self {
        CarryOptions {
            method: CarryMethod::ConstantAcceleration,
            max_horizon_s: 0.5,
            delay_sigma_s: 0.0,
            reach_s: 0.1,
            following_sigma_m_s: 0.0,
            position_sigma_m: 2e-3,
            angle_sigma_rad: 2e-3,
        }
    }
}

/// How differently from constant a desired velocity may go on beyond its points: standard
/// deviations of the acceleration, m/s^2 and rad/s^2.
const BEYOND_SIGMA: [f64; 2] = [3.0, 2.0];

/// As many poses must the IMU's samples have joined before they tell more than the poses alone.
const JOINED: u32 = 3;

/// Carries the poses of a stream, one after the other.
#[derive(Clone, Debug)]
pub struct Carrier {
    options: CarryOptions,
    /// What the poses say.
    tracker: Tracker,
    /// What poses and IMU together say.
    inertial: Tracker,
    /// How many poses in a row the samples of the IMU have joined.
    joined: u32,
    guide: Guide,
    inertia: Inertia,
    /// The pose that was measured last is the one to be carried.
    own: bool,
}

impl Carrier {
    /// A carrier that has seen nothing yet; `inertia` knows how the IMU is mounted.
    pub fn new(options: CarryOptions, inertia: Inertia) -> Carrier {
        let model = match options.method {
            CarryMethod::ConstantVelocity => Model::Velocity,
            _ => Model::Acceleration,
        };
        Carrier {
            options,
            tracker: Tracker::new(model),
            inertial: Tracker::new(Model::Inertial),
            joined: 0,
            guide: Guide::default(),
            inertia,
            own: false,
        }
    }

    /// The desired motion, to be filled as far as the next pose's use.
    pub fn guide(&mut self) -> &mut Guide {
        &mut self.guide
    }

    /// The IMU's samples, to be filled as far as the next pose's use.
    pub fn inertia(&mut self) -> &mut Inertia {
        &mut self.inertia
    }

    /// Takes a pose that was measured at `at`: what the poses say of the motion is learned from
    /// it. To be called once for every pose, before it is carried; a pose that is not later than
    /// the one before teaches nothing.
    pub fn measure(&mut self, pose: &Pose, at: Stamp) {
        self.own = false;
        if self.options.method == CarryMethod::None || !pose.is_solved() {
            return;
        }
        let measured = self.measured(pose);
        if self.options.method == CarryMethod::Imu {
            self.join(at, &measured);
        }
        self.tracker.measure(at, &measured, &Impulse::none());
        self.own = self.tracker.last() == Some(at);
        // Poses may come a little out of order, and be carried back.
        let needed = at.plus_s(-self.options.max_horizon_s - self.options.reach_s);
        self.guide.forget_before(needed);
        self.inertia.forget_before(needed);
    }

    /// Joins the pose to the last one by the IMU's samples in between, or starts afresh.
    fn join(&mut self, at: Stamp, measured: &Measured) {
        let impulse = match self.inertial.last() {
            Some(last) if at <= last && last.since_s(at) < 1.0 => return,
            Some(last) => {
                let start = self.inertial.attitude();
                self.inertia
                    .impulse(last, at, start, self.options.reach_s)
                    .filter(|(_, beyond_s)| *beyond_s <= self.options.reach_s / 2.0)
            }
            None => None,
        };
        match impulse {
            Some((impulse, _)) => {
                self.inertial.measure(at, measured, &impulse);
                self.joined = self.joined.saturating_add(1);
            }
            None => {
                self.inertial = Tracker::new(if self.inertia.lacks_force() {
                    Model::Rates
                } else {
                    Model::Inertial
                });
                self.inertial.measure(at, measured, &Impulse::none());
                self.joined = 0;
            }
        }
    }

    fn measured(&self, pose: &Pose) -> Measured {
        let known = pose.rotation_rad.map(f64::is_finite);
        let angles = pose.rotation_rad.map(finite_or_zero);
        let sigma = |i: usize| {
            if i < 3 {
                self.options.position_sigma_m
            } else {
                self.options.angle_sigma_rad
            }
        };
        let cov = |row: usize, col: usize| match pose.cov(row, col) {
            value if value.is_finite() => value,
            _ if row == col => sigma(row) * sigma(row),
            _ => 0.0,
        };
        let euler = Matrix3::from_fn(|row, col| cov(row + 3, col + 3));
        let jacobian = euler_to_fixed_axes(angles);
        let fixed = jacobian * euler * jacobian.transpose();
        Measured {
            position_m: pose.position_m.into(),
            attitude: turn::attitude(angles),
            angles: known,
            variance: std::array::from_fn(|i| match i.checked_sub(3) {
                None => cov(i, i),
                Some(i) => fixed[(i, i)],
            }),
        }
    }

    /// The pose measured at `at`, carried to `to`. A pose without numbers only gets the stamp; one
    /// that is further away than the limit loses its numbers.
    pub fn carried(&self, pose: &Pose, at: Stamp, to: Stamp) -> Pose {
        let mut carried = pose.clone();
        carried.stamp = to;
        if !pose.is_solved() {
            return carried;
        }
        let span_s = to.since_s(at);
        if !(span_s.abs() <= self.options.max_horizon_s) {
            carried.position_m = [f64::NAN; 3];
            carried.rotation_rad = [f64::NAN; 3];
            carried.covariance = [f64::NAN; 21];
            carried.range_bias_m = f64::NAN;
            carried.status |= Status::TOO_FAR | Status::NO_POSE;
            return carried;
        }
        let (increment, status) = self.increment(pose, at, to, span_s);
        carried.status |= status;
        if let Some(increment) = increment {
            apply(&mut carried, &increment, self.options.delay_sigma_s);
        }
        carried
    }

    fn increment(
        &self,
        pose: &Pose,
        at: Stamp,
        to: Stamp,
        span_s: f64,
    ) -> (Option<Increment>, Status) {
        let by_poses = || self.tracker.increment(span_s, &Impulse::none(), self.own);
        let reach_s = self.options.reach_s;
        match self.options.method {
            CarryMethod::None => (None, Status::OK),
            CarryMethod::ConstantVelocity | CarryMethod::ConstantAcceleration => {
                (Some(by_poses()), Status::OK)
            }
            CarryMethod::DesiredExact | CarryMethod::DesiredTrapezoid => {
                let ends = self.guide.at(at, reach_s).zip(self.guide.at(to, reach_s));
                let Some((from, until)) = ends else {
                    return (Some(by_poses()), Status::STALE_MOTION);
                };
                let beyond = from.beyond_s > 0.0 || until.beyond_s > 0.0;
                let status = if beyond {
                    Status::EXTRAPOLATED
                } else {
                    Status::OK
                };
                (Some(self.desired(&from, &until, span_s)), status)
            }
            CarryMethod::Imu => {
                let start = turn::attitude(pose.rotation_rad.map(finite_or_zero));
                let impulse = self.inertia.impulse(at, to, start, reach_s);
                match impulse {
                    None if self.inertia.is_empty() => (Some(by_poses()), Status::NO_IMU),
                    None => (Some(by_poses()), Status::STALE_IMU),
                    Some(_) if self.joined < JOINED => (Some(by_poses()), Status::OK),
                    Some((impulse, beyond_s)) => {
                        let mut increment = self.inertial.increment(span_s, &impulse, self.own);
                        let rate = turn::vector(&impulse.turn);
                        if span_s != 0.0 {
                            increment.rate_rad_s += rate / span_s;
                        }
                        widen(&mut increment, beyond_s);
                        let status = if beyond_s > 0.0 {
                            Status::EXTRAPOLATED
                        } else {
                            Status::OK
                        };
                        (Some(increment), status)
                    }
                }
            }
        }
    }

    fn desired(&self, from: &Guided, until: &Guided, span_s: f64) -> Increment {
        let velocity_m_s = (from.velocity_m_s + until.velocity_m_s) / 2.0;
        let rate_rad_s = (from.rate_rad_s + until.rate_rad_s) / 2.0;
        let (translation_m, turn) = match self.options.method {
            CarryMethod::DesiredTrapezoid => {
                (velocity_m_s * span_s, turn::turn(rate_rad_s * span_s))
            }
            _ => (
                until.position_m - from.position_m,
                until.attitude * from.attitude.inverse(),
            ),
        };
        let following = self.options.following_sigma_m_s * span_s;
        let growth = following * following;
        let mut increment = Increment {
            translation_m,
            turn,
            velocity_m_s,
            rate_rad_s,
            growth: [growth, growth, growth, 0.0, 0.0, 0.0],
        };
        widen(&mut increment, from.beyond_s);
        widen(&mut increment, until.beyond_s);
        increment
    }
}

/// Grows an increment's variance by what a time without knowledge of the motion costs.
fn widen(increment: &mut Increment, beyond_s: f64) {
    for (i, growth) in increment.growth.iter_mut().enumerate() {
        let off = BEYOND_SIGMA[i / 3] * beyond_s * beyond_s / 2.0;
        *growth += off * off;
    }
}

fn finite_or_zero(value: f64) -> f64 {
    if value.is_finite() { value } else { 0.0 }
}

/// Moves a pose and its covariance. What was missing stays missing.
fn apply(pose: &mut Pose, increment: &Increment, delay_sigma_s: f64) {
    for (position, by) in pose.position_m.iter_mut().zip(&increment.translation_m) {
        *position += by;
    }
    let before = pose.rotation_rad;
    let angles = before.map(finite_or_zero);
    let after = turn::euler(&(increment.turn * turn::attitude(angles)));
    for (angle, after) in pose.rotation_rad.iter_mut().zip(after) {
        if angle.is_finite() {
            *angle = after;
        }
    }
    let mut carry = Matrix6::identity();
    let rotation = turn::carried_angles(angles, &increment.turn, after);
    carry.fixed_view_mut::<3, 3>(3, 3).copy_from(&rotation);
    // Growth is about the axes of B, the covariance in Euler angles.
    let mut to_euler = Matrix6::identity();
    let rotation = fixed_axes_to_euler(after);
    to_euler.fixed_view_mut::<3, 3>(3, 3).copy_from(&rotation);
    let (v, w) = (increment.velocity_m_s, increment.rate_rad_s);
    let late = Vector6::new(v.x, v.y, v.z, w.x, w.y, w.z) * delay_sigma_s;
    let growth = Matrix6::from_diagonal(&Vector6::from(increment.growth)) + late * late.transpose();
    let covariance = Matrix6::from_fn(|row, col| finite_or_zero(pose.cov(row, col)));
    let covariance =
        carry * covariance * carry.transpose() + to_euler * growth * to_euler.transpose();
    for row in 0..6 {
        for col in row..6 {
            let value = &mut pose.covariance[upper_index(6, row, col)];
            if value.is_finite() {
                *value = 0.5 * (covariance[(row, col)] + covariance[(col, row)]);
            }
        }
    }
}

#[cfg(test)]
#[path = "carry_tests.rs"]
mod tests;
