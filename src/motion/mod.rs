//! Trajectories of the platform: profiles of speed along a path, paths in the robot frame, and
//! motion interpolated from recorded points; prediction: poses carried to the time they are used;
//! deskew: the motion within a scan.
//!
//! A [`Motion`] says for every instant where the platform is, which way it is turned and how both
//! change. Times are seconds after the motion's start; before it and after its end the platform
//! rests. Positions are in the robot frame B, rotations are roll, pitch, yaw of
//! R = Rz(yaw) Ry(pitch) Rx(roll).

mod axis;
mod carry;
mod deskew;
mod guide;
mod gyro;
mod inertia;
mod liveliness;
mod path;
mod profile;
mod sampled;
mod tracker;
mod turn;

pub use carry::{Carrier, CarryMethod, CarryOptions};
pub use deskew::{AT_REST, Deskewed, KnownMotion, LineFit, Relation, SelfMotion, guided};
pub use guide::Guide;
pub use gyro::Gyro;
pub use inertia::Inertia;
pub use liveliness::{Gait, Liveliness};
pub use path::{Pose, Shuttle, Straight, Wobble};
pub use profile::{Limits, Profile, Quintic, SCurve, Travel};
pub use sampled::{Sampled, SampledError};

use nalgebra::Vector3;

/// Where the platform is at an instant and how it moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    /// Platform origin in B, m.
    pub position_m: Vector3<f64>,
    /// Roll, pitch, yaw, rad.
    pub rotation_rad: Vector3<f64>,
    /// Velocity of the origin in B, m/s.
    pub velocity_m_s: Vector3<f64>,
    /// Rates of roll, pitch and yaw (not the body's angular velocity), rad/s.
    pub rotation_rate_rad_s: Vector3<f64>,
    /// Acceleration of the origin in B, m/s^2.
    pub acceleration_m_s2: Vector3<f64>,
}

impl State {
    /// At rest in a pose.
    pub fn resting(pose: Pose) -> State {
        State {
            position_m: pose.position_m,
            rotation_rad: pose.rotation_rad,
            velocity_m_s: Vector3::zeros(),
            rotation_rate_rad_s: Vector3::zeros(),
            acceleration_m_s2: Vector3::zeros(),
        }
    }
}

/// A motion of the platform.
pub trait Motion {
    /// The state `t_s` seconds after the motion's start.
    fn at(&self, t_s: f64) -> State;
    /// How long it takes, s; the platform rests afterwards.
    fn duration_s(&self) -> f64;
}

impl<M: Motion + ?Sized> Motion for Box<M> {
    fn at(&self, t_s: f64) -> State {
        (**self).at(t_s)
    }
    fn duration_s(&self) -> f64 {
        (**self).duration_s()
    }
}
