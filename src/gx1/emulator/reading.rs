//! From what the unit feels to the words of a reply.

use super::super::command::{Command, Word};
use super::super::scale::{self, Gains};
use crate::record::ImuSample;
use nalgebra::{UnitQuaternion, Vector3};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

/// The earth's field in north, east, down, gauss: middle Europe.
const FIELD_GAUSS: [f64; 3] = [0.19, 0.0, 0.45];
/// Noise of the field, gauss: 0.24 deg of heading, as a still unit showed.
const NOISE_GAUSS: f64 = 0.0008;
/// Temperature inside and its noise, degC.
const INSIDE_DEG_C: f64 = 31.0;
const NOISE_DEG_C: f64 = 0.05;

/// The sensors and what they have been taught.
#[derive(Clone, Debug)]
pub(super) struct Sensors {
    noisy: bool,
    random: ChaCha8Rng,
    gyro_bias_rad_s: [f64; 3],
    tare: Option<UnitQuaternion<f64>>,
    /// Smallest and largest field of the calibration that runs, and the last one.
    hard_iron: [[f64; 3]; 3],
}

impl Sensors {
    pub(super) fn new(noisy: bool, seed: u64) -> Sensors {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(0x31);
        Sensors {
            noisy,
            random,
            gyro_bias_rad_s: [0.0; 3],
            tare: None,
            hard_iron: [[0.0; 3]; 3],
        }
    }

    /// Power was off.
    pub(super) fn forget(&mut self) {
        self.gyro_bias_rad_s = [0.0; 3];
    }

    /// The bias found, on top of the one that was taken off already.
    pub(super) fn set_gyro_bias(&mut self, mean_rad_s: [f64; 3]) {
        self.gyro_bias_rad_s = mean_rad_s;
    }

    pub(super) fn tare(&mut self, sample: &ImuSample) {
        self.tare = Some(attitude(sample));
    }

    pub(super) fn remove_tare(&mut self) {
        self.tare = None;
    }

    pub(super) fn begin_hard_iron(&mut self) {
        self.hard_iron = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3], [0.0; 3]];
    }

    pub(super) fn collect_hard_iron(&mut self, reading: &Reading) {
        let [low, high, _] = &mut self.hard_iron;
        for (k, value) in reading.mag_gauss.iter().enumerate() {
            low[k] = low[k].min(*value);
            high[k] = high[k].max(*value);
        }
    }

    /// The middle between the smallest and the largest field.
    pub(super) fn hard_iron_offset(&mut self) -> [f64; 3] {
        let [low, high, offset] = &mut self.hard_iron;
        for (k, offset) in offset.iter_mut().enumerate() {
            let middle = 0.5 * (low[k] + high[k]);
            *offset = if middle.is_finite() { middle } else { 0.0 };
        }
        *offset
    }

    pub(super) fn hard_iron_word(&self, word: Word, gains: Gains) -> u16 {
        let [low, high, offset] = &self.hard_iron;
        let (values, k) = match word {
            Word::MagMin(k) => (low, k),
            Word::MagMax(k) => (high, k),
            Word::MagOffset(k) => (offset, k),
            _ => return 0,
        };
        gains.mag_word(values.get(usize::from(k)).copied().unwrap_or(0.0))
    }

    /// Everything that a reply may hold, at one instant.
    pub(super) fn read(&mut self, sample: &ImuSample, hard_iron_gauss: [f64; 3]) -> Reading {
        let true_attitude = attitude(sample);
        let field = true_attitude.inverse() * Vector3::from(FIELD_GAUSS);
        let mag_gauss = [0, 1, 2].map(|k| {
            let noise = self.noise(NOISE_GAUSS);
            field[k] - hard_iron_gauss[k] + noise
        });
        let down = true_attitude.inverse() * Vector3::z();
        let rates = [
            sample.gyro_x_rad_s,
            sample.gyro_y_rad_s,
            sample.gyro_z_rad_s,
        ];
        let stabilised = match self.tare {
            None => true_attitude,
            Some(tare) => tare.inverse() * true_attitude,
        };
        let accel_m_s2 = [
            sample.accel_x_m_s2,
            sample.accel_y_m_s2,
            sample.accel_z_m_s2,
        ];
        Reading {
            stabilised,
            instant: from_vectors(accel_m_s2, mag_gauss),
            mag_gauss,
            accel_m_s2,
            stabilised_mag_gauss: field.into(),
            stabilised_accel_m_s2: (-down * scale::G_M_S2).into(),
            rate_rad_s: [0, 1, 2].map(|k| rates[k] - self.gyro_bias_rad_s[k]),
            temperature_deg_c: INSIDE_DEG_C + self.noise(NOISE_DEG_C),
        }
    }

    fn noise(&mut self, sigma: f64) -> f64 {
        let drawn: f64 = StandardNormal.sample(&mut self.random);
        if self.noisy { sigma * drawn } else { 0.0 }
    }
}

/// Device to north, east, down.
fn attitude(sample: &ImuSample) -> UnitQuaternion<f64> {
    UnitQuaternion::from_euler_angles(sample.roll_rad, sample.pitch_rad, sample.yaw_rad)
}

/// Attitude from specific force and field alone: at rest the force points up.
fn from_vectors(accel_m_s2: [f64; 3], mag_gauss: [f64; 3]) -> UnitQuaternion<f64> {
    let [fx, fy, fz] = accel_m_s2;
    let roll = (-fy).atan2(-fz);
    let pitch = fx.atan2(f64::hypot(fy, fz));
    let level = UnitQuaternion::from_euler_angles(roll, pitch, 0.0) * Vector3::from(mag_gauss);
    UnitQuaternion::from_euler_angles(roll, pitch, (-level.y).atan2(level.x))
}

/// All quantities of one instant.
#[derive(Clone, Debug)]
pub(super) struct Reading {
    stabilised: UnitQuaternion<f64>,
    instant: UnitQuaternion<f64>,
    mag_gauss: [f64; 3],
    accel_m_s2: [f64; 3],
    stabilised_mag_gauss: [f64; 3],
    stabilised_accel_m_s2: [f64; 3],
    rate_rad_s: [f64; 3],
    temperature_deg_c: f64,
}

impl Reading {
    /// A word of a command's reply.
    pub(super) fn word(&self, command: Command, word: Word, gains: Gains) -> u16 {
        let attitude = match command {
            Command::InstantQuaternion | Command::InstantMatrix | Command::InstantEuler => {
                &self.instant
            }
            _ => &self.stabilised,
        };
        let stabilised_vectors = matches!(
            command,
            Command::StabilisedVectors | Command::StabilisedQuaternionVectors
        );
        let (mag, accel) = if stabilised_vectors {
            (&self.stabilised_mag_gauss, &self.stabilised_accel_m_s2)
        } else {
            (&self.mag_gauss, &self.accel_m_s2)
        };
        let of = |values: &[f64; 3], k: u8| values.get(usize::from(k)).copied().unwrap_or(0.0);
        let (roll, pitch, yaw) = attitude.euler_angles();
        match word {
            Word::RawMag(k) => raw(gains.mag_word(of(mag, k))),
            Word::RawAccel(k) => raw(gains.accel_word(of(accel, k))),
            Word::RawRate(k) => raw(gains.rate_word(of(&self.rate_rad_s, k))),
            Word::Mag(k) => gains.mag_word(of(mag, k)),
            Word::Accel(k) => gains.accel_word(of(accel, k)),
            Word::Rate(k) => gains.rate_word(of(&self.rate_rad_s, k)),
            Word::Quaternion(k) => {
                let q = attitude.quaternion();
                // One of the two that mean the same: the scalar is not negative.
                let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
                let component = match k {
                    0 => q.w,
                    1 => q.i,
                    2 => q.j,
                    _ => q.k,
                };
                scale::unit_word(sign * component)
            }
            Word::Matrix(row, column) => {
                // M takes the earth's vectors into the device.
                let matrix = attitude.inverse().to_rotation_matrix();
                let place = (usize::from(row) - 1, usize::from(column) - 1);
                scale::unit_word(matrix.matrix().get(place).copied().unwrap_or(0.0))
            }
            Word::Roll => scale::angle_word(roll),
            Word::Pitch => scale::angle_word(pitch),
            Word::Yaw => scale::angle_word(yaw),
            Word::Temperature => scale::temperature_word(self.temperature_deg_c),
            Word::MagMin(_)
            | Word::MagMax(_)
            | Word::MagOffset(_)
            | Word::Value(_)
            | Word::Ticks => 0,
        }
    }
}

/// Raw bits are unsigned around the middle of the converter's range.
fn raw(word: u16) -> u16 {
    word ^ 0x8000
}
