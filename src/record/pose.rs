//! Where the platform is.

use super::columns::{Record, Visit, VisitMut};
use super::status::Status;
use super::time::Stamp;
use super::trajectory::POSE_COLUMNS;
use super::{Presence, upper_index};

/// Order of the pose's components in [`Pose::covariance`] and in column names.
pub const POSE_STATE: [&str; 6] = ["x", "y", "z", "roll", "pitch", "yaw"];

/// The platform's pose in B with its covariance.
///
/// R = Rz(yaw) Ry(pitch) Rx(roll) (Kurniawan 2017, eq. 3.3 to 3.6). A scan that gave no pose is
/// a record with NaN numbers and a status that says why.
#[derive(Clone, Debug, PartialEq)]
pub struct Pose {
    /// The instant that the pose is for.
    pub stamp: Stamp,
    /// Stamp of the scan it came from; where poses come without it, the stamp that they came with.
    pub scan_stamp: Stamp,
    /// Sequence number of that scan.
    pub seq: u32,
    /// Platform origin in B, m.
    pub position_m: [f64; 3],
    /// Roll, pitch, yaw, rad.
    pub rotation_rad: [f64; 3],
    /// Upper triangle, row by row, of the covariance of (x, y, z, roll, pitch, yaw), in m and rad.
    pub covariance: [f64; 21],
    /// Strip edges used.
    pub edges: u32,
    /// Votes of the winning cell (vote method).
    pub votes: Option<u32>,
    /// Range bias common to all beams, m.
    pub range_bias_m: f64,
    /// What a consumer must know.
    pub status: Status,
    /// When the robot's controller acknowledged the pose, on the host's clock; where that was noted.
    pub pushed: Option<Stamp>,
}

impl Default for Pose {
    fn default() -> Self {
        Pose {
            stamp: Stamp::default(),
            scan_stamp: Stamp::default(),
            seq: 0,
            position_m: [f64::NAN; 3],
            rotation_rad: [f64::NAN; 3],
            covariance: [f64::NAN; 21],
            edges: 0,
            votes: None,
            range_bias_m: f64::NAN,
            status: Status::OK,
            pushed: None,
        }
    }
}

impl Pose {
    /// Variance or covariance of two components, numbered as in [`POSE_STATE`].
    pub fn cov(&self, row: usize, col: usize) -> f64 {
        self.covariance[upper_index(6, row, col)]
    }

    /// The six components in the order of [`POSE_STATE`].
    pub fn components(&self) -> [f64; 6] {
        let ([x, y, z], [roll, pitch, yaw]) = (self.position_m, self.rotation_rad);
        [x, y, z, roll, pitch, yaw]
    }

    /// Whether there are numbers at all.
    pub fn is_solved(&self) -> bool {
        !self.status.has(Status::NO_POSE) && self.position_m.iter().any(|v| v.is_finite())
    }
}

const COVARIANCE_COLUMNS: [&str; 21] = [
    "cov_x_x",
    "cov_x_y",
    "cov_x_z",
    "cov_x_roll",
    "cov_x_pitch",
    "cov_x_yaw",
    "cov_y_y",
    "cov_y_z",
    "cov_y_roll",
    "cov_y_pitch",
    "cov_y_yaw",
    "cov_z_z",
    "cov_z_roll",
    "cov_z_pitch",
    "cov_z_yaw",
    "cov_roll_roll",
    "cov_roll_pitch",
    "cov_roll_yaw",
    "cov_pitch_pitch",
    "cov_pitch_yaw",
    "cov_yaw_yaw",
];

impl Record for Pose {
    const KIND: &'static str = "pose";

    fn stamp(&self) -> Stamp {
        self.stamp
    }

    fn visit<V: Visit>(&self, v: &mut V) -> Result<(), V::Error> {
        use Presence::{Optional, Required};
        v.column("stamp_ns", Required, &self.stamp)?;
        v.column("scan_stamp_ns", Optional, &self.scan_stamp)?;
        v.column("seq", Optional, &self.seq)?;
        let components = self.position_m.iter().chain(&self.rotation_rad);
        for (name, value) in POSE_COLUMNS.iter().zip(components) {
            v.column(name, Required, value)?;
        }
        for (name, value) in COVARIANCE_COLUMNS.iter().zip(&self.covariance) {
            v.column(name, Optional, value)?;
        }
        v.column("edges", Optional, &self.edges)?;
        v.column("votes", Optional, &self.votes)?;
        v.column("range_bias_m", Optional, &self.range_bias_m)?;
        v.column("status", Optional, &self.status)?;
        v.column("pushed_ns", Presence::Extra, &self.pushed)
    }

    fn visit_mut<V: VisitMut>(&mut self, v: &mut V) -> Result<(), V::Error> {
        use Presence::{Optional, Required};
        v.column("stamp_ns", Required, &mut self.stamp)?;
        self.scan_stamp = self.stamp;
        v.column("scan_stamp_ns", Optional, &mut self.scan_stamp)?;
        v.column("seq", Optional, &mut self.seq)?;
        let components = self.position_m.iter_mut().chain(&mut self.rotation_rad);
        for (name, value) in POSE_COLUMNS.iter().zip(components) {
            v.column(name, Required, value)?;
        }
        for (name, value) in COVARIANCE_COLUMNS.iter().zip(&mut self.covariance) {
            v.column(name, Optional, value)?;
        }
        v.column("edges", Optional, &mut self.edges)?;
        v.column("votes", Optional, &mut self.votes)?;
        v.column("range_bias_m", Optional, &mut self.range_bias_m)?;
        v.column("status", Optional, &mut self.status)?;
        v.column("pushed_ns", Presence::Extra, &mut self.pushed)
    }
}
