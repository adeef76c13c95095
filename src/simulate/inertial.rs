//! The IMU: attitude, rates and specific force, in the platform's axes or the device's own.

use super::parameters::Imu as Parameters;
use super::random::{Draws, Purpose, Seed};
use super::rotation;
use crate::frame::Frame;
use crate::motion::State;
use crate::record::{Axes, ImuSample, Stamp};
use nalgebra::{UnitQuaternion, Vector3};
use std::f64::consts::PI;

/// Standard gravity, m/s^2.
const GRAVITY_M_S2: f64 = 9.806_65;

/// An IMU on the platform.
#[derive(Clone, Debug)]
pub struct Unit {
    axes: Axes,
    /// The device's axes in P.
    mounting: UnitQuaternion<f64>,
    errors: Option<Errors>,
    next_seq: u32,
}

/// Constant errors of a run and the state of the slow ones.
#[derive(Clone, Debug)]
struct Errors {
    seed: Seed,
    parameters: Parameters,
    attitude_bias_rad: Vector3<f64>,
    walk_rad: Vector3<f64>,
    gyro_bias_rad_s: Vector3<f64>,
    accel_bias_m_s2: Vector3<f64>,
    misalignment: UnitQuaternion<f64>,
    last: Option<Stamp>,
}

impl Unit {
    /// A faultless IMU as the frame file mounts it. The device's axes are its nominal ones (x along
    /// P's x, z along P's -z) turned in P by the configured roll, pitch and yaw.
    pub fn new(frame: &Frame, axes: Axes) -> Unit {
        Unit {
            axes,
            mounting: rotation::attitude_deg(frame.imu.rotation_deg) * upside_down(),
            errors: None,
            next_seq: 0,
        }
    }

    /// Adds errors.
    pub fn with_errors(mut self, parameters: &Parameters, seed: Seed) -> Unit {
        let mut draws = seed.draws(Purpose::ImuBias, 0);
        let mut drawn = |sigma: f64| vector(&mut draws) * sigma;
        self.errors = Some(Errors {
            seed,
            parameters: parameters.clone(),
            attitude_bias_rad: drawn(parameters.attitude_bias_deg.to_radians()),
            walk_rad: Vector3::zeros(),
            gyro_bias_rad_s: drawn(parameters.gyro_bias_deg_s.to_radians()),
            accel_bias_m_s2: drawn(parameters.accel_bias_mg * 1e-3 * GRAVITY_M_S2),
            misalignment: rotation::attitude(drawn(parameters.misalignment_deg.to_radians())),
            last: None,
        });
        self
    }

    /// The sample of a state.
    pub fn sample(&mut self, state: &State, stamp: Stamp) -> ImuSample {
        // Attitude of P in B; specific force is what holds the platform up and moves it.
        let attitude = rotation::attitude(state.rotation_rad);
        let rate = rotation::body_rate(state.rotation_rad, state.rotation_rate_rad_s);
        let force = attitude.inverse() * (state.acceleration_m_s2 + Vector3::z() * GRAVITY_M_S2);
        let (mut angles, mut rate, mut force) = match self.axes {
            Axes::Platform | Axes::Enu => (state.rotation_rad, rate, force),
            Axes::Ned => {
                // Device in an earth frame whose x is B's x and whose z points down.
                let device = upside_down().inverse() * attitude * self.mounting;
                let into_device = self.mounting.inverse();
                (
                    rotation::roll_pitch_yaw(&device),
                    into_device * rate,
                    into_device * force,
                )
            }
        };
        let mut device = None;
        if let Some(errors) = &mut self.errors {
            errors.disturb(&mut angles, &mut rate, &mut force, stamp, self.next_seq);
            let tick_ns = (errors.parameters.tick_ms * 1e6).round().max(1.0) as i64;
            device = Some(Stamp::from_ns(stamp.ns().div_euclid(tick_ns) * tick_ns));
        }
        let seq = self.next_seq;
        self.next_seq = seq.wrapping_add(1);
        ImuSample {
            stamp,
            device,
            seq,
            axes: self.axes,
            roll_rad: angles.x,
            pitch_rad: angles.y,
            yaw_rad: angles.z,
            gyro_x_rad_s: rate.x,
            gyro_y_rad_s: rate.y,
            gyro_z_rad_s: rate.z,
            accel_x_m_s2: force.x,
            accel_y_m_s2: force.y,
            accel_z_m_s2: force.z,
            ..ImuSample::default()
        }
    }
}

impl Errors {
    fn disturb(
        &mut self,
        angles: &mut Vector3<f64>,
        rate: &mut Vector3<f64>,
        force: &mut Vector3<f64>,
        stamp: Stamp,
        seq: u32,
    ) {
        let p = &self.parameters;
        let mut draws = self.seed.draws(Purpose::Imu, u64::from(seq));
        let step_s = self.last.map_or(0.01, |last| stamp.since_s(last)).max(1e-6);
        self.last = Some(stamp);
        let walk = p.attitude_walk_deg_sqrt_s.to_radians() * step_s.sqrt();
        self.walk_rad += vector(&mut draws) * walk;
        *angles += self.attitude_bias_rad
            + self.walk_rad
            + vector(&mut draws) * p.attitude_noise_deg.to_radians();
        let digit = p.angle_resolution_deg.to_radians();
        if digit > 0.0 {
            angles.apply(|angle| *angle = (*angle / digit).round() * digit);
        }
        let rate_noise = p.gyro_noise_deg_sqrt_h.to_radians() / 60.0 / step_s.sqrt();
        *rate = self.misalignment * *rate + self.gyro_bias_rad_s + vector(&mut draws) * rate_noise;
        *force = self.misalignment * *force
            + self.accel_bias_m_s2
            + vector(&mut draws) * p.accel_noise_m_s2;
    }
}

/// The half turn about x that takes z up to z down.
fn upside_down() -> UnitQuaternion<f64> {
    rotation::attitude(Vector3::new(PI, 0.0, 0.0))
}

fn vector(draws: &mut Draws) -> Vector3<f64> {
    Vector3::new(draws.normal(), draws.normal(), draws.normal())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::Pose;
    use std::path::Path;

    fn frame(rotation_deg: &str) -> Frame {
        let text = include_str!("../../testdata/cablar.toml").replace(
            "[imu]\nrotation_deg = [0.0, 0.0, 0.0]",
            &format!("[imu]\nrotation_deg = {rotation_deg}"),
        );
        Frame::parse(&text, Path::new("cablar.toml")).unwrap()
    }

    fn tilted() -> State {
        let mut state = State::resting(Pose {
            position_m: Vector3::zeros(),
            rotation_rad: Vector3::new(0.02, -0.03, 0.1),
        });
        state.rotation_rate_rad_s = Vector3::new(0.4, 0.2, -0.3);
        state
    }

    #[test]
    fn upright_ned_has_pitch_and_yaw_turned_round() {
        let frame = frame("[0.0, 0.0, 0.0]");
        let stamp = Stamp::from_ns(5);
        let own = Unit::new(&frame, Axes::Platform).sample(&tilted(), stamp);
        let ned = Unit::new(&frame, Axes::Ned).sample(&tilted(), stamp);
        assert!((ned.roll_rad - own.roll_rad).abs() < 1e-15);
        assert!((ned.pitch_rad + own.pitch_rad).abs() < 1e-15);
        assert!((ned.yaw_rad + own.yaw_rad).abs() < 1e-15);
        assert!((ned.gyro_x_rad_s - own.gyro_x_rad_s).abs() < 1e-15);
        assert!((ned.gyro_y_rad_s + own.gyro_y_rad_s).abs() < 1e-15);
        assert!((ned.gyro_z_rad_s + own.gyro_z_rad_s).abs() < 1e-15);
        assert!((own.accel_x_m_s2 - 9.80665 * 0.03f64.sin()).abs() < 1e-12);
        assert!(own.accel_z_m_s2 > 9.7 && ned.accel_z_m_s2 < -9.7);
    }

    #[test]
    fn a_turned_mounting_shows_in_the_device_axes_only() {
        let frame = frame("[0.0, 0.0, 90.0]");
        let own = Unit::new(&frame, Axes::Platform).sample(&tilted(), Stamp::from_ns(5));
        let device = Unit::new(&frame, Axes::Ned).sample(&tilted(), Stamp::from_ns(5));
        // The device's x is P's y, its y is P's x, its z down.
        assert_eq!(own.roll_rad, 0.02);
        assert!((device.gyro_x_rad_s - own.gyro_y_rad_s).abs() < 1e-12);
        assert!((device.gyro_y_rad_s - own.gyro_x_rad_s).abs() < 1e-12);
        assert!((device.gyro_z_rad_s + own.gyro_z_rad_s).abs() < 1e-12);
        // Level platform, device turned by 90 deg about P's z: -90 deg of yaw about down.
        let level = State::resting(Pose {
            position_m: Vector3::zeros(),
            rotation_rad: Vector3::zeros(),
        });
        let device = Unit::new(&frame, Axes::Ned).sample(&level, Stamp::from_ns(5));
        assert!((device.yaw_rad + PI / 2.0).abs() < 1e-12 && device.pitch_rad.abs() < 1e-12);
    }

    #[test]
    fn errors_have_their_sizes() {
        let frame = frame("[0.0, 0.0, 0.0]");
        let parameters = Parameters {
            attitude_walk_deg_sqrt_s: 0.0,
            ..Parameters::default()
        };
        let mut noise = Vec::new();
        let mut biases = Vec::new();
        for seed in 0..300 {
            let mut unit = Unit::new(&frame, Axes::Platform).with_errors(&parameters, Seed(seed));
            let pitches: Vec<f64> = (0..40)
                .map(|k| {
                    let stamp = Stamp::from_ns(k * 10_000_000);
                    let sample = unit.sample(&tilted(), stamp);
                    (sample.pitch_rad + 0.03).to_degrees()
                })
                .collect();
            let mean = pitches.iter().sum::<f64>() / 40.0;
            biases.push(mean);
            noise.extend(pitches.iter().map(|p| p - mean));
        }
        let rms = |v: &[f64]| (v.iter().map(|x| x * x).sum::<f64>() / v.len() as f64).sqrt();
        assert!((rms(&biases) - 0.2).abs() < 0.03, "{}", rms(&biases));
        assert!((rms(&noise) - 0.05).abs() < 0.002, "{}", rms(&noise));
    }
}
