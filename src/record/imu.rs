//! Samples of the inertial unit.

use super::columns::{Value, ValueError, columns};
use super::time::Stamp;
use serde::Serialize;

/// The axes that an IMU sample's quantities are given in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Axes {
    /// North, east, down as the device has them: pitch has the opposite sign of the platform's.
    Ned,
    /// East, north, up.
    Enu,
    /// The platform's own frame P, attitude as R = Rz(yaw) Ry(pitch) Rx(roll) of P in B.
    #[default]
    Platform,
}

impl Axes {
    const ALL: [Axes; 3] = [Axes::Ned, Axes::Enu, Axes::Platform];

    /// The axes of a name in the axes column.
    fn named(name: &[u8]) -> Option<Axes> {
        Axes::ALL
            .into_iter()
            .find(|axes| axes.name().as_bytes() == name)
    }

    /// The name in the axes column.
    pub fn name(self) -> &'static str {
        match self {
            Axes::Ned => "ned",
            Axes::Enu => "enu",
            Axes::Platform => "platform",
        }
    }
}

impl Value for Axes {
    const ROS_TYPE: &'static str = "string";
    type Wire = String;
    fn is_missing(&self) -> bool {
        false
    }
    fn push_text(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(self.name().as_bytes());
    }
    fn parse_text(&mut self, text: &[u8]) -> Result<(), ValueError> {
        *self = if text.is_empty() {
            Axes::Platform
        } else {
            Axes::named(text).ok_or(ValueError::Not("ned, enu or platform"))?
        };
        Ok(())
    }
    fn to_wire(&self) -> impl Serialize {
        self.name()
    }
    fn from_wire(wire: String) -> Axes {
        Axes::named(wire.as_bytes()).unwrap_or_default()
    }
}

/// One IMU sample. Quantities that the device did not send are NaN.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuSample {
    /// When the sample was taken, on the host's clock.
    pub stamp: Stamp,
    /// Host clock when its last byte had arrived.
    pub received: Option<Stamp>,
    /// The device's own clock.
    pub device: Option<Stamp>,
    /// Running number.
    pub seq: u32,
    /// The axes of everything below.
    pub axes: Axes,
    /// Roll, rad.
    pub roll_rad: f64,
    /// Pitch, rad.
    pub pitch_rad: f64,
    /// Yaw, rad.
    pub yaw_rad: f64,
    /// Angular rate about x, rad/s.
    pub gyro_x_rad_s: f64,
    /// Angular rate about y, rad/s.
    pub gyro_y_rad_s: f64,
    /// Angular rate about z, rad/s.
    pub gyro_z_rad_s: f64,
    /// Specific force along x, m/s^2.
    pub accel_x_m_s2: f64,
    /// Specific force along y, m/s^2.
    pub accel_y_m_s2: f64,
    /// Specific force along z, m/s^2.
    pub accel_z_m_s2: f64,
    /// Magnetic field along x, gauss.
    pub mag_x_gauss: f64,
    /// Magnetic field along y, gauss.
    pub mag_y_gauss: f64,
    /// Magnetic field along z, gauss.
    pub mag_z_gauss: f64,
    /// Standard deviation of roll, rad; NaN where the source does not state it.
    pub roll_sigma_rad: f64,
    /// Standard deviation of pitch, rad.
    pub pitch_sigma_rad: f64,
    /// Standard deviation of yaw, rad.
    pub yaw_sigma_rad: f64,
    /// Standard deviation of each angular rate, rad/s.
    pub gyro_sigma_rad_s: f64,
    /// Standard deviation of each specific force, m/s^2.
    pub accel_sigma_m_s2: f64,
}

impl Default for ImuSample {
    fn default() -> Self {
        ImuSample {
            stamp: Stamp::default(),
            received: None,
            device: None,
            seq: 0,
            axes: Axes::Platform,
            roll_rad: f64::NAN,
            pitch_rad: f64::NAN,
            yaw_rad: f64::NAN,
            gyro_x_rad_s: f64::NAN,
            gyro_y_rad_s: f64::NAN,
            gyro_z_rad_s: f64::NAN,
            accel_x_m_s2: f64::NAN,
            accel_y_m_s2: f64::NAN,
            accel_z_m_s2: f64::NAN,
            mag_x_gauss: f64::NAN,
            mag_y_gauss: f64::NAN,
            mag_z_gauss: f64::NAN,
            roll_sigma_rad: f64::NAN,
            pitch_sigma_rad: f64::NAN,
            yaw_sigma_rad: f64::NAN,
            gyro_sigma_rad_s: f64::NAN,
            accel_sigma_m_s2: f64::NAN,
        }
    }
}

columns!(ImuSample, kind = "imu", stamp = stamp, {
    Required "stamp_ns" => stamp;
    Optional "received_ns" => received;
    Optional "device_ns" => device;
    Optional "seq" => seq;
    Optional "axes" => axes;
    Required "roll_rad" => roll_rad;
    Required "pitch_rad" => pitch_rad;
    Optional "yaw_rad" => yaw_rad;
    Optional "gyro_x_rad_s" => gyro_x_rad_s;
    Optional "gyro_y_rad_s" => gyro_y_rad_s;
    Optional "gyro_z_rad_s" => gyro_z_rad_s;
    Optional "accel_x_m_s2" => accel_x_m_s2;
    Optional "accel_y_m_s2" => accel_y_m_s2;
    Optional "accel_z_m_s2" => accel_z_m_s2;
    Optional "mag_x_gauss" => mag_x_gauss;
    Optional "mag_y_gauss" => mag_y_gauss;
    Optional "mag_z_gauss" => mag_z_gauss;
    Extra "roll_sigma_rad" => roll_sigma_rad;
    Extra "pitch_sigma_rad" => pitch_sigma_rad;
    Extra "yaw_sigma_rad" => yaw_sigma_rad;
    Extra "gyro_sigma_rad_s" => gyro_sigma_rad_s;
    Extra "accel_sigma_m_s2" => accel_sigma_m_s2;
});
