//! An IMU sample: `/imu_info` with every column, then `/mag` and `/imu` for other programs.

use super::types::{Header, Imu, MagneticField, PLATFORM, Time, UNKNOWN_VARIANCE, Vector3};
use super::{Bodies, Exact, Message, Messages, Topic, definitions, every, rotation};
use crate::record::{Axes, ImuSample, Stamp};
use crate::stream::check::BadField;
use crate::stream::{Role, cdr};

static IMU_INFO: Topic = Topic {
    name: "/imu_info",
    type_name: "cablepose_msgs/msg/ImuInfo",
    definition: |_| definitions::of_columns::<ImuSample>(every),
};
static MAG: Topic = Topic::standard("/mag", "sensor_msgs/msg/MagneticField");
static IMU: Topic = Topic::standard("/imu", "sensor_msgs/msg/Imu");
static TOPICS: [&Topic; 3] = [&IMU_INFO, &MAG, &IMU];

const TESLA_PER_GAUSS: f64 = 1e-4;

/// Frames that say which axes a sample has.
const FRAMES: [(Axes, &str); 3] = [
    (Axes::Ned, "imu_ned"),
    (Axes::Enu, "imu_enu"),
    (Axes::Platform, PLATFORM),
];

/// What has come before an `/imu`.
#[derive(Debug, Default)]
pub struct ImuParts {
    exact: Exact,
    mag: Option<(Time, [f64; 3])>,
}

impl Messages for ImuSample {
    type Parts = ImuParts;

    fn read_from(_: Role) -> &'static [&'static Topic] {
        &TOPICS
    }

    fn written_to(_: Role) -> &'static [&'static Topic] {
        &TOPICS
    }

    fn encode(&self, _: Role, out: &mut Bodies) -> Result<(), BadField> {
        out.sequence = Some(self.seq);
        out.received = self.received;
        out.add(&IMU_INFO, |out| cdr::encode_columns(out, self, every))?;
        let frame = FRAMES.iter().find(|(axes, _)| *axes == self.axes);
        let header = Header::new(self.stamp, frame.map_or(PLATFORM, |(_, frame)| frame));
        let mag_gauss = [self.mag_x_gauss, self.mag_y_gauss, self.mag_z_gauss];
        if mag_gauss.iter().any(|v| v.is_finite()) {
            let message = MagneticField {
                header: header.clone(),
                magnetic_field: Vector3::new(mag_gauss.map(|v| v * TESLA_PER_GAUSS)),
                magnetic_field_covariance: [0.0; 9],
            };
            out.add(&MAG, |out| cdr::encode(out, &message))?;
        }
        out.add(&IMU, |out| cdr::encode(out, &to_message(self, header)))
    }

    fn decode(
        &mut self,
        topic: &'static Topic,
        message: Message<'_>,
        parts: &mut ImuParts,
    ) -> Result<bool, BadField> {
        if topic.name == IMU_INFO.name {
            cdr::decode_columns(message.body, self, every, None)?;
            parts.exact.set(self.stamp);
            return Ok(true);
        }
        if topic.name == MAG.name {
            let (mag, _) = cdr::decode::<MagneticField>(message.body)?;
            let gauss = mag.magnetic_field.to_array().map(|v| v / TESLA_PER_GAUSS);
            parts.mag = Some((mag.header.stamp, gauss));
            return Ok(false);
        }
        let (imu, _) = cdr::decode::<Imu>(message.body)?;
        if parts.exact.repeats(imu.header.stamp) {
            return Ok(false);
        }
        *self = from_message(&imu, message.sequence);
        if let Some((stamp, [x, y, z])) = parts.mag.take()
            && stamp == imu.header.stamp
        {
            (self.mag_x_gauss, self.mag_y_gauss, self.mag_z_gauss) = (x, y, z);
        }
        Ok(true)
    }
}

/// The standard message. A quantity that is missing has -1 in its covariance, as the definition
/// asks; a heading alone that is missing has a huge variance; a variance that is not known is 0.
fn to_message(sample: &ImuSample, header: Header) -> Imu {
    let or_zero = |v: f64| if v.is_finite() { v } else { 0.0 };
    let variance = |sigma: f64| if sigma > 0.0 { sigma * sigma } else { 0.0 };
    let stated = |values: [f64; 3], sigmas: [f64; 3]| {
        let mut covariance = [0.0; 9];
        for (k, sigma) in sigmas.into_iter().enumerate() {
            covariance[4 * k] = variance(sigma);
        }
        if values.iter().all(|v| !v.is_finite()) {
            covariance[0] = -1.0;
        }
        (Vector3::new(values.map(or_zero)), covariance)
    };
    let attitude = [sample.roll_rad, sample.pitch_rad, sample.yaw_rad];
    let sigmas = [
        sample.roll_sigma_rad,
        sample.pitch_sigma_rad,
        sample.yaw_sigma_rad,
    ];
    let (_, mut orientation_covariance) = stated([attitude[0], attitude[1], f64::NAN], sigmas);
    if !sample.yaw_rad.is_finite() {
        orientation_covariance[8] = UNKNOWN_VARIANCE;
    }
    let gyro = [
        sample.gyro_x_rad_s,
        sample.gyro_y_rad_s,
        sample.gyro_z_rad_s,
    ];
    let accel = [
        sample.accel_x_m_s2,
        sample.accel_y_m_s2,
        sample.accel_z_m_s2,
    ];
    let (angular_velocity, angular_velocity_covariance) =
        stated(gyro, [sample.gyro_sigma_rad_s; 3]);
    let (linear_acceleration, linear_acceleration_covariance) =
        stated(accel, [sample.accel_sigma_m_s2; 3]);
    Imu {
        header,
        orientation: rotation::quaternion(attitude.map(or_zero)),
        orientation_covariance,
        angular_velocity,
        angular_velocity_covariance,
        linear_acceleration,
        linear_acceleration_covariance,
    }
}

fn from_message(imu: &Imu, sequence: u32) -> ImuSample {
    let stated = |values: [f64; 3], covariance: &[f64; 9]| {
        if covariance[0] == -1.0 {
            [f64::NAN; 3]
        } else {
            values
        }
    };
    let attitude = rotation::euler(&imu.orientation);
    let [roll_rad, pitch_rad, yaw_rad] = stated(attitude, &imu.orientation_covariance);
    let yaw_known = imu.orientation_covariance[8] < UNKNOWN_VARIANCE;
    let [gyro_x_rad_s, gyro_y_rad_s, gyro_z_rad_s] = stated(
        imu.angular_velocity.to_array(),
        &imu.angular_velocity_covariance,
    );
    let [accel_x_m_s2, accel_y_m_s2, accel_z_m_s2] = stated(
        imu.linear_acceleration.to_array(),
        &imu.linear_acceleration_covariance,
    );
    let sigma = |covariance: &[f64; 9], k: usize| {
        let variance = covariance[4 * k];
        if variance > 0.0 && variance < UNKNOWN_VARIANCE {
            variance.sqrt()
        } else {
            f64::NAN
        }
    };
    let frame = FRAMES
        .iter()
        .find(|(_, frame)| *frame == imu.header.frame_id);
    ImuSample {
        stamp: Stamp::from(imu.header.stamp),
        seq: sequence,
        axes: frame.map_or(Axes::Platform, |(axes, _)| *axes),
        roll_rad,
        pitch_rad,
        yaw_rad: if yaw_known { yaw_rad } else { f64::NAN },
        gyro_x_rad_s,
        gyro_y_rad_s,
        gyro_z_rad_s,
        accel_x_m_s2,
        accel_y_m_s2,
        accel_z_m_s2,
        roll_sigma_rad: sigma(&imu.orientation_covariance, 0),
        pitch_sigma_rad: sigma(&imu.orientation_covariance, 1),
        yaw_sigma_rad: sigma(&imu.orientation_covariance, 2),
        gyro_sigma_rad_s: sigma(&imu.angular_velocity_covariance, 0),
        accel_sigma_m_s2: sigma(&imu.linear_acceleration_covariance, 0),
        ..ImuSample::default()
    }
}
