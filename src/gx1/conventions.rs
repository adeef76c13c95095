//! Which of the disputed conventions a unit follows, from its answers while it lies still.
//!
//! The sense of the quaternion and the sign of the accelerometer are told differently by the
//! predecessor's document and by public drivers. One look at three forms of the same attitude and
//! at gravity decides both.

use super::attitude::{self, Sense};
use super::command::Word;
use super::packet::Packet;
use super::scale::{G_M_S2, Gains};
use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};

/// The mean of what a still unit answered.
#[derive(Clone, Debug, Default)]
pub struct Observation {
    quaternion: Mean<4>,
    matrix: Mean<9>,
    /// Sines and cosines of the Euler angles, so that angles near 180 deg have a mean.
    euler: Mean<6>,
    accel_m_s2: Mean<3>,
    rate_rad_s: Mean<3>,
}

#[derive(Clone, Copy, Debug)]
struct Mean<const N: usize> {
    sum: [f64; N],
    count: u32,
}

impl<const N: usize> Default for Mean<N> {
    fn default() -> Self {
        Mean {
            sum: [0.0; N],
            count: 0,
        }
    }
}

impl<const N: usize> Mean<N> {
    fn add(&mut self, values: [f64; N]) {
        for (sum, value) in self.sum.iter_mut().zip(values) {
            *sum += value;
        }
        self.count += 1;
    }

    fn get(&self) -> Option<[f64; N]> {
        (self.count > 0).then(|| self.sum.map(|sum| sum / f64::from(self.count)))
    }
}

/// Something that was looked at.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// What should hold.
    pub what: &'static str,
    /// What was found.
    pub found: String,
    /// Whether it holds.
    pub holds: bool,
}

/// All that was found.
#[derive(Clone, Debug, PartialEq)]
pub struct Conventions {
    /// One by one.
    pub findings: Vec<Finding>,
    /// The sense of the quaternion; none where the pose does not tell.
    pub sense: Option<Sense>,
    /// The sign that makes the unit's accelerations specific force; none where gravity is not seen.
    pub accel_sign: Option<f64>,
}

/// How far quaternion and matrix may be off their norm.
const NORM: f64 = 4e-3;
/// How far two forms of one attitude may be apart, rad: answers come one after the other, and the
/// unit's own noise is 0.3 deg.
const APART_RAD: f64 = 0.5 * std::f64::consts::PI / 180.0;
/// The two senses must differ by this much to be told apart, rad.
const TOLD_RAD: f64 = 2.0 * std::f64::consts::PI / 180.0;
/// How far the acceleration may be off 1 g, share.
const GRAVITY: f64 = 0.05;
/// The most that a still unit turns, rad/s.
const STILL_RAD_S: f64 = 0.02;

impl Observation {
    /// Takes an answer of any of the commands 0x05, 0x0B, 0x0E, 0x03.
    pub fn add(&mut self, packet: &Packet, gains: Gains) {
        if let Some([mut w, mut x, mut y, mut z]) = attitude::quaternion(packet) {
            // q and -q are one attitude.
            let dot: f64 = self
                .quaternion
                .sum
                .iter()
                .zip([w, x, y, z])
                .map(|(a, b)| a * b)
                .sum();
            if dot < 0.0 {
                (w, x, y, z) = (-w, -x, -y, -z);
            }
            self.quaternion.add([w, x, y, z]);
        }
        if let Some(m) = attitude::matrix(packet) {
            let mut values = [0.0; 9];
            values.copy_from_slice(m.as_slice());
            self.matrix.add(values);
        }
        if let Some(angles) = attitude::euler(packet) {
            let [(a, b), (c, d), (e, f)] = angles.map(f64::sin_cos);
            self.euler.add([a, b, c, d, e, f]);
        }
        if let Some(accel) = gains.vector(packet, Word::Accel) {
            self.accel_m_s2.add(accel);
        }
        if let Some(rate) = gains.vector(packet, Word::Rate) {
            self.rate_rad_s.add(rate);
        }
    }

    /// What holds; none unless all four were answered.
    pub fn conventions(&self) -> Option<Conventions> {
        let q = self.quaternion.get()?;
        let matrix = Matrix3::from_column_slice(&self.matrix.get()?);
        let [a, b, c, d, e, f] = self.euler.get()?;
        let angles = [a.atan2(b), c.atan2(d), e.atan2(f)];
        let accel = Vector3::from(self.accel_m_s2.get()?);
        let rate = Vector3::from(self.rate_rad_s.get()?);
        let mut findings = Vec::new();
        let mut find = |what, found: String, holds| {
            findings.push(Finding { what, found, holds });
        };

        let norm = q.iter().map(|v| v * v).sum::<f64>().sqrt();
        find("|q| = 1", format!("{norm:.4}"), (norm - 1.0).abs() < NORM);
        let det = matrix.determinant();
        find(
            "det M = 1",
            format!("{det:.4}"),
            (det - 1.0).abs() < 3.0 * NORM,
        );

        // v_device = M v_earth.
        let attitude = Rotation3::from_matrix(&matrix.transpose());
        let [roll, pitch, yaw] = angles;
        let from_euler = Rotation3::from_euler_angles(roll, pitch, yaw);
        let apart = attitude.angle_to(&from_euler);
        find(
            "Euler angles and M agree",
            degrees(apart),
            apart < APART_RAD,
        );

        let from_q = UnitQuaternion::try_new(Quaternion::new(q[0], q[1], q[2], q[3]), 1e-3)?;
        let as_attitude = from_q.to_rotation_matrix().angle_to(&attitude);
        let as_inverse = from_q.inverse().to_rotation_matrix().angle_to(&attitude);
        let sense = if (as_attitude - as_inverse).abs() < TOLD_RAD {
            None
        } else if as_attitude < as_inverse {
            Some(Sense::Attitude)
        } else {
            Some(Sense::Inverse)
        };
        let found = format!(
            "{} as device to earth, {} as its inverse",
            degrees(as_attitude),
            degrees(as_inverse)
        );
        find(
            "q and M agree",
            found,
            as_attitude.min(as_inverse) < APART_RAD,
        );

        let g = accel.norm() / G_M_S2;
        find("|a| = 1 g", format!("{g:.3} g"), (g - 1.0).abs() < GRAVITY);
        // Down in the device's axes, by its attitude.
        let along = accel.dot(&(matrix * Vector3::z())) / G_M_S2;
        let accel_sign = ((along.abs() - 1.0).abs() < 2.0 * GRAVITY).then(|| -along.signum());
        find(
            "a is along the vertical",
            format!("{along:+.3} g downwards"),
            accel_sign.is_some(),
        );
        let turn = rate.norm();
        find(
            "|rate| < 0.02 rad/s",
            format!("{turn:.4} rad/s"),
            turn < STILL_RAD_S,
        );
        Some(Conventions {
            findings,
            sense,
            accel_sign,
        })
    }
}

fn degrees(rad: f64) -> String {
    format!("{:.2} deg", rad.to_degrees())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gx1::{Command, scale};

    /// A unit in an attitude, with these conventions.
    fn observed(angles: [f64; 3], sense: Sense, accel_sign: f64, turn_rad_s: f64) -> Conventions {
        let gains = Gains::FACTORY;
        let [roll, pitch, yaw] = angles;
        let attitude = Rotation3::from_euler_angles(roll, pitch, yaw);
        let q = UnitQuaternion::from_rotation_matrix(&attitude);
        let q = match sense {
            Sense::Attitude => q,
            Sense::Inverse => q.inverse(),
        };
        let m = attitude.transpose();
        let force = m * Vector3::new(0.0, 0.0, -G_M_S2) * accel_sign;
        let mut observation = Observation::default();
        let mut add = |command, words: Vec<u16>| {
            let packet = Packet::new(command, &words).unwrap();
            observation.add(&packet, gains);
        };
        for turn in 0..4 {
            // Either sign of a quaternion may come.
            let sign = if turn % 2 == 0 { 1.0 } else { -1.0 };
            let q = [q.w, q.i, q.j, q.k].map(|v| scale::unit_word(sign * v));
            add(Command::StabilisedQuaternion, [&q[..], &[0]].concat());
            let m: Vec<u16> = m
                .matrix()
                .iter()
                .map(|v| scale::unit_word(*v))
                .chain([0])
                .collect();
            add(Command::StabilisedMatrix, m);
            add(
                Command::StabilisedEuler,
                angles
                    .into_iter()
                    .map(scale::angle_word)
                    .chain([0])
                    .collect(),
            );
            let accel = force.iter().map(|v| gains.accel_word(*v));
            let rate = gains.rate_word(turn_rad_s);
            let vectors = [0; 3]
                .into_iter()
                .chain(accel)
                .chain([rate, 0, 0, 0])
                .collect();
            add(Command::InstantVectors, vectors);
        }
        observation.conventions().unwrap()
    }

    #[test]
    fn both_disputes_are_settled() {
        for angles in [[0.3, -0.2, 1.0], [-1.0, 0.5, 0.4], [1.2, -0.7, -1.0]] {
            for sense in [Sense::Attitude, Sense::Inverse] {
                for sign in [1.0, -1.0] {
                    let found = observed(angles, sense, sign, 0.0);
                    assert!(found.findings.iter().all(|f| f.holds), "{found:?}");
                    assert_eq!(found.sense, Some(sense));
                    assert_eq!(found.accel_sign, Some(sign));
                }
            }
        }
    }

    #[test]
    fn a_level_unit_that_looks_north_does_not_tell_the_sense() {
        let found = observed([0.0; 3], Sense::Inverse, -1.0, 0.0);
        assert_eq!(found.sense, None);
        assert_eq!(found.accel_sign, Some(-1.0));
    }

    #[test]
    fn a_unit_that_turns_is_seen() {
        let found = observed([0.1, 0.0, 0.0], Sense::Attitude, 1.0, 0.1);
        let failed: Vec<_> = found.findings.iter().filter(|f| !f.holds).collect();
        assert_eq!(failed.len(), 1);
        assert_eq!(failed[0].what, "|rate| < 0.02 rad/s");
    }

    #[test]
    fn nothing_is_said_of_what_was_not_answered() {
        assert_eq!(Observation::default().conventions(), None);
    }
}
