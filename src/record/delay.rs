//! The error that is left of a measured trajectory when a delay is assumed.

use super::columns::columns;
use super::time::Stamp;

/// One point of the curve of error against delay.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DelayPoint {
    /// Start of the desired trajectory.
    pub stamp: Stamp,
    /// The delay that is assumed, s; positive: the measurement lags.
    pub delay_s: f64,
    /// How many measured positions were compared.
    pub samples: u32,
    /// Rms distance between measured and delayed desired position along x, y, z, m.
    pub rms_m: [f64; 3],
    /// The largest such distance, m.
    pub max_m: [f64; 3],
}

impl Default for DelayPoint {
    fn default() -> Self {
        DelayPoint {
            stamp: Stamp::default(),
            delay_s: f64::NAN,
            samples: 0,
            rms_m: [f64::NAN; 3],
            max_m: [f64::NAN; 3],
        }
    }
}

columns!(DelayPoint, kind = "delay", stamp = stamp, {
    Required "stamp_ns" => stamp;
    Required "delay_s" => delay_s;
    Optional "samples" => samples;
    Required "rms_x_m" => rms_m[0];
    Required "rms_y_m" => rms_m[1];
    Required "rms_z_m" => rms_m[2];
    Required "max_x_m" => max_m[0];
    Required "max_y_m" => max_m[1];
    Required "max_z_m" => max_m[2];
});
