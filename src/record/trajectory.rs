//! True and desired motion of the platform.

use super::time::Stamp;

/// The platform's pose and velocity in B at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrajectoryPoint {
    /// The instant.
    pub stamp: Stamp,
    /// Platform origin in B, m.
    pub position_m: [f64; 3],
    /// Roll, pitch, yaw, rad: R = Rz(yaw) Ry(pitch) Rx(roll).
    pub rotation_rad: [f64; 3],
    /// Velocity of the platform origin in B, m/s; NaN where not known.
    pub velocity_m_s: [f64; 3],
}

impl Default for TrajectoryPoint {
    fn default() -> Self {
        TrajectoryPoint {
            stamp: Stamp::default(),
            position_m: [f64::NAN; 3],
            rotation_rad: [f64::NAN; 3],
            velocity_m_s: [f64::NAN; 3],
        }
    }
}

impl super::Record for TrajectoryPoint {
    const KIND: &'static str = "trajectory";
    fn stamp(&self) -> Stamp {
        self.stamp
    }
    fn visit<V: super::Visit>(&self, v: &mut V) -> Result<(), V::Error> {
        use super::Presence::{Optional, Required};
        v.column("stamp_ns", Required, &self.stamp)?;
        for (name, value) in POSE_COLUMNS
            .iter()
            .zip(self.position_m.iter().chain(&self.rotation_rad))
        {
            v.column(name, Required, value)?;
        }
        for (name, value) in VELOCITY_COLUMNS.iter().zip(&self.velocity_m_s) {
            v.column(name, Optional, value)?;
        }
        Ok(())
    }
    fn visit_mut<V: super::VisitMut>(&mut self, v: &mut V) -> Result<(), V::Error> {
        use super::Presence::{Optional, Required};
        v.column("stamp_ns", Required, &mut self.stamp)?;
        let pose = self.position_m.iter_mut().chain(&mut self.rotation_rad);
        for (name, value) in POSE_COLUMNS.iter().zip(pose) {
            v.column(name, Required, value)?;
        }
        for (name, value) in VELOCITY_COLUMNS.iter().zip(&mut self.velocity_m_s) {
            v.column(name, Optional, value)?;
        }
        Ok(())
    }
}

/// Names of the six pose columns, as poses and trajectories have them.
pub(crate) const POSE_COLUMNS: [&str; 6] =
    ["x_m", "y_m", "z_m", "roll_rad", "pitch_rad", "yaw_rad"];
/// Names of the three velocity columns of a trajectory.
pub(crate) const VELOCITY_COLUMNS: [&str; 3] = ["vx_m_s", "vy_m_s", "vz_m_s"];
