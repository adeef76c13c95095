//! The axes of an IMU's samples, and how to get from one to another.
//!
//! Three are in use ([`Axes`]). With R for the attitude (it takes a vector from the body's axes to
//! the earth's) and `half_turn` about x:
//!
//! - ned: R of the device as mounted (x forward, y right, z down) in north, east, down. Roll and yaw
//!   are positive to the right, pitch upward.
//! - enu: R of the same device with its axes turned upright (x forward, y left, z up) in east,
//!   north, up (REP 103): yaw counts from east, counter-clockwise. pitch has the opposite sign.
//! - platform: R of the platform P in the robot frame B. B's x is taken for north, its y for west;
//!   the mounting (`imu.rotation_deg`) is taken out. At zero mounting, roll is the device's, pitch
//!   and yaw have the opposite sign.
//!
//! Rates, specific force and magnetic field are in the body's axes: the device's, the same turned
//! upright, the platform's.

use super::Imu;
use crate::record::{Axes, ImuSample};
use nalgebra::{Rotation3, Vector3};
use std::f64::consts::{FRAC_PI_2, PI};

/// Turns samples from one kind of axes to another.
#[derive(Clone, Copy, Debug)]
pub struct ImuAxes {
    /// The device's axes, turned upright, in P.
    mounting: Rotation3<f64>,
}

impl ImuAxes {
    /// For an IMU mounted so.
    pub fn new(imu: &Imu) -> ImuAxes {
        let [roll, pitch, yaw] = imu.rotation_deg.map(f64::to_radians);
        ImuAxes {
            mounting: Rotation3::from_euler_angles(roll, pitch, yaw),
        }
    }

    /// The sample in other axes. A missing yaw stays missing; roll and pitch are then right for a
    /// mounting that is level, and for small angles close for others.
    pub fn turned(&self, sample: &ImuSample, to: Axes) -> ImuSample {
        if sample.axes == to {
            return *sample;
        }
        let mut turned = *sample;
        turned.axes = to;
        // An attitude without yaw is turned with yaw 0.
        let yaw_rad = Some(sample.yaw_rad).filter(|yaw| yaw.is_finite());
        let measured =
            Rotation3::from_euler_angles(sample.roll_rad, sample.pitch_rad, yaw_rad.unwrap_or(0.0));
        let attitude = earth_from_enu(to)
            * earth_from_enu(sample.axes).inverse()
            * measured
            * self.body_from_upright(sample.axes)
            * self.body_from_upright(to).inverse();
        (turned.roll_rad, turned.pitch_rad, turned.yaw_rad) = attitude.euler_angles();
        if yaw_rad.is_none() {
            turned.yaw_rad = f64::NAN;
        }
        let body = self.body_from_upright(to) * self.body_from_upright(sample.axes).inverse();
        let vector = |x: &mut f64, y: &mut f64, z: &mut f64| {
            let v = body * Vector3::new(*x, *y, *z);
            (*x, *y, *z) = (v.x, v.y, v.z);
        };
        let t = &mut turned;
        vector(
            &mut t.gyro_x_rad_s,
            &mut t.gyro_y_rad_s,
            &mut t.gyro_z_rad_s,
        );
        vector(
            &mut t.accel_x_m_s2,
            &mut t.accel_y_m_s2,
            &mut t.accel_z_m_s2,
        );
        vector(&mut t.mag_x_gauss, &mut t.mag_y_gauss, &mut t.mag_z_gauss);
        turned
    }

    /// Takes a vector from the upright device's axes (x forward, y left, z up) to a body's.
    fn body_from_upright(&self, axes: Axes) -> Rotation3<f64> {
        match axes {
            Axes::Ned => half_turn(),
            Axes::Enu => Rotation3::identity(),
            Axes::Platform => self.mounting,
        }
    }
}

/// Takes a vector from east, north, up to the earth of these axes.
fn earth_from_enu(axes: Axes) -> Rotation3<f64> {
    let x_north = Rotation3::from_euler_angles(0.0, 0.0, -FRAC_PI_2);
    match axes {
        Axes::Ned => half_turn() * x_north,
        Axes::Enu => Rotation3::identity(),
        Axes::Platform => x_north,
    }
}

/// About x: z up to z down.
fn half_turn() -> Rotation3<f64> {
    Rotation3::from_euler_angles(PI, 0.0, 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn axes(rotation_deg: [f64; 3]) -> ImuAxes {
        ImuAxes::new(&Imu { rotation_deg })
    }

    fn sample(axes: Axes, [roll_rad, pitch_rad, yaw_rad]: [f64; 3]) -> ImuSample {
        ImuSample {
            axes,
            roll_rad,
            pitch_rad,
            yaw_rad,
            ..ImuSample::default()
        }
    }

    fn angles(sample: &ImuSample) -> [f64; 3] {
        [sample.roll_rad, sample.pitch_rad, sample.yaw_rad]
    }

    fn assert_close(got: [f64; 3], wanted: [f64; 3]) {
        for (got_rad, wanted_rad) in got.iter().zip(wanted) {
            let (sin, cos) = (got_rad - wanted_rad).sin_cos();
            assert!(sin.abs() < 1e-9 && cos > 0.0, "{got:?} is not {wanted:?}");
        }
    }

    #[test]
    fn signs_of_all_three_angles() {
        let level = axes([0.0; 3]);
        let ned = sample(Axes::Ned, [0.02, 0.03, 0.4]);
        assert_close(
            angles(&level.turned(&ned, Axes::Platform)),
            [0.02, -0.03, -0.4],
        );
        assert_close(
            angles(&level.turned(&ned, Axes::Enu)),
            [0.02, -0.03, FRAC_PI_2 - 0.4],
        );
        // A device that looks north and level has yaw 90 deg in ENU and 0 in B.
        let north = sample(Axes::Enu, [0.0, 0.0, FRAC_PI_2]);
        assert_close(angles(&level.turned(&north, Axes::Platform)), [0.0; 3]);
        assert_close(angles(&level.turned(&north, Axes::Ned)), [0.0; 3]);
    }

    #[test]
    fn the_mounting_is_taken_out() {
        // A level platform whose IMU is pitched by 2 deg on P reads that pitch, NED signed.
        let pitched = axes([0.0, 2.0, 0.0]);
        let reads = sample(Axes::Ned, [0.0, -2f64.to_radians(), 0.0]);
        assert_close(angles(&pitched.turned(&reads, Axes::Platform)), [0.0; 3]);
        // One that is turned by 90 deg on P feels the platform's roll as its own pitch.
        let turned = axes([0.0, 0.0, 90.0]);
        let roll = sample(Axes::Platform, [0.1, 0.0, 0.0]);
        let feels = angles(&turned.turned(&roll, Axes::Ned));
        assert_close(feels, [0.0, 0.1, -FRAC_PI_2]);
    }

    #[test]
    fn vectors_go_with_the_body() {
        let mut ned = sample(Axes::Ned, [0.0; 3]);
        (ned.gyro_x_rad_s, ned.gyro_y_rad_s, ned.gyro_z_rad_s) = (1.0, 2.0, 3.0);
        // At rest, Z down: specific force points up.
        (ned.accel_x_m_s2, ned.accel_y_m_s2, ned.accel_z_m_s2) = (0.0, 0.0, -9.81);
        for to in [Axes::Enu, Axes::Platform] {
            let up = axes([0.0; 3]).turned(&ned, to);
            let gyro = [up.gyro_x_rad_s, up.gyro_y_rad_s, up.gyro_z_rad_s];
            assert_close(gyro, [1.0, -2.0, -3.0]);
            assert!((up.accel_z_m_s2 - 9.81).abs() < 1e-12);
            assert!(up.mag_x_gauss.is_nan());
        }
        let quarter = axes([0.0, 0.0, 90.0]).turned(&ned, Axes::Platform);
        let gyro = [
            quarter.gyro_x_rad_s,
            quarter.gyro_y_rad_s,
            quarter.gyro_z_rad_s,
        ];
        assert_close(gyro, [2.0, 1.0, -3.0]);
    }

    #[test]
    fn a_missing_yaw_stays_missing() {
        let ned = sample(Axes::Ned, [0.02, 0.03, f64::NAN]);
        let platform = axes([0.0; 3]).turned(&ned, Axes::Platform);
        assert!((platform.pitch_rad + 0.03).abs() < 1e-12 && platform.yaw_rad.is_nan());
    }

    fn any_axes() -> impl Strategy<Value = Axes> {
        prop_oneof![Just(Axes::Ned), Just(Axes::Enu), Just(Axes::Platform)]
    }

    proptest! {
        #[test]
        fn there_and_back(
            mounting in prop::array::uniform3(-180.0..180.0f64),
            roll in -3.0..3.0f64, pitch in -1.4..1.4f64, yaw in -3.0..3.0f64,
            from in any_axes(), through in any_axes(), to in any_axes(),
        ) {
            let axes = axes(mounting);
            let mut start = sample(from, [roll, pitch, yaw]);
            (start.mag_x_gauss, start.mag_y_gauss, start.mag_z_gauss) = (0.2, -0.1, 0.4);
            let direct = axes.turned(&start, to);
            let indirect = axes.turned(&axes.turned(&start, through), to);
            assert_close(angles(&direct), angles(&indirect));
            prop_assert!((direct.mag_z_gauss - indirect.mag_z_gauss).abs() < 1e-12);
            assert_close(angles(&axes.turned(&direct, from)), [roll, pitch, yaw]);
        }
    }
}
