//! The unit's three forms of an attitude, as roll, pitch and yaw in north, east, down.

use super::command::Word;
use super::packet::Packet;
use super::scale;
use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion};

/// Sense of the unit's quaternion: the 3DM-G's text and every driver disagree.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Sense {
    /// (w, x, y, z) of the device in the earth: v_earth = q v_device q*, as every driver has it.
    #[default]
    Attitude,
    /// v_device = q v_earth q*, as the 3DM-G's text writes it.
    Inverse,
}

/// Roll, pitch, yaw, rad, of a reply that holds an attitude in any form.
pub fn of(packet: &Packet, sense: Sense) -> Option<[f64; 3]> {
    if let Some(angles) = euler(packet) {
        return Some(angles);
    }
    let rotation = match quaternion(packet) {
        Some(q) => {
            let q = UnitQuaternion::try_new(Quaternion::new(q[0], q[1], q[2], q[3]), 1e-3)?;
            match sense {
                Sense::Attitude => q,
                Sense::Inverse => q.inverse(),
            }
            .to_rotation_matrix()
        }
        // v_device = M v_earth.
        None => Rotation3::from_matrix_unchecked(matrix(packet)?.transpose()),
    };
    let (roll, pitch, yaw) = angles(&rotation);
    Some([roll, pitch, yaw])
}

/// Roll, pitch, yaw by the aircraft's convention: R = Rz(yaw) Ry(pitch) Rx(roll).
fn angles(rotation: &Rotation3<f64>) -> (f64, f64, f64) {
    let m = rotation.matrix();
    (
        m[(2, 1)].atan2(m[(2, 2)]),
        (-m[(2, 0)]).clamp(-1.0, 1.0).asin(),
        m[(1, 0)].atan2(m[(0, 0)]),
    )
}

/// The Euler words, rad.
pub fn euler(packet: &Packet) -> Option<[f64; 3]> {
    let angle = |word| packet.word(word).map(scale::angle_rad);
    Some([angle(Word::Roll)?, angle(Word::Pitch)?, angle(Word::Yaw)?])
}

/// The quaternion's words, not normalised.
pub fn quaternion(packet: &Packet) -> Option<[f64; 4]> {
    let component = |i| packet.word(Word::Quaternion(i)).map(scale::unit_value);
    Some([component(0)?, component(1)?, component(2)?, component(3)?])
}

/// The matrix M of v_device = M v_earth.
pub fn matrix(packet: &Packet) -> Option<Matrix3<f64>> {
    let mut matrix = Matrix3::zeros();
    for (word, bits) in packet.fields() {
        if let Word::Matrix(row, column) = word {
            let place = (usize::from(row) - 1, usize::from(column) - 1);
            *matrix.get_mut(place)? = scale::unit_value(bits);
        }
    }
    packet.word(Word::Matrix(1, 1)).map(|_| matrix)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gx1::Command;

    /// What the three forms of one attitude look like on the wire.
    fn packets(roll: f64, pitch: f64, yaw: f64) -> [Packet; 3] {
        let (sr, cr) = roll.sin_cos();
        let (sp, cp) = pitch.sin_cos();
        let (sy, cy) = yaw.sin_cos();
        // Printed: M11 = cos(yaw) cos(pitch), M12 = sin(yaw) cos(pitch), M13 = -sin(pitch).
        let m = [
            [cy * cp, sy * cp, -sp],
            [cy * sp * sr - sy * cr, sy * sp * sr + cy * cr, cp * sr],
            [cy * sp * cr + sy * sr, sy * sp * cr - cy * sr, cp * cr],
        ];
        let q = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
        let words = |values: &[f64]| -> Vec<u16> {
            values
                .iter()
                .map(|v| scale::unit_word(*v))
                .chain([7])
                .collect()
        };
        let matrix: Vec<f64> = (0..9).map(|k| m[k % 3][k / 3]).collect();
        let euler: Vec<u16> = [roll, pitch, yaw]
            .into_iter()
            .map(scale::angle_word)
            .chain([7])
            .collect();
        let packet = |command, words: &[u16]| Packet::new(command, words).unwrap();
        [
            packet(Command::StabilisedEuler, &euler),
            packet(Command::StabilisedQuaternion, &words(&[q.w, q.i, q.j, q.k])),
            packet(Command::StabilisedMatrix, &words(&matrix)),
        ]
    }

    #[test]
    fn three_forms_agree() {
        for [roll, pitch, yaw] in [
            [0.0; 3],
            [0.1, -0.2, 0.3],
            [-2.5, 1.0, -3.0],
            [0.3, -1.2, 1.6],
        ] {
            for packet in packets(roll, pitch, yaw) {
                let got = of(&packet, Sense::Attitude).unwrap();
                for (got, wanted) in got.iter().zip([roll, pitch, yaw]) {
                    // A count is 1/8192; near pitch 70 deg it weighs more.
                    assert!(
                        (got - wanted).abs() < 5e-4,
                        "{} {got} {wanted}",
                        packet.command()
                    );
                }
            }
        }
    }

    #[test]
    fn the_other_sense_is_the_inverse() {
        let [_, packet, _] = packets(0.2, 0.0, 0.0);
        let [roll, ..] = of(&packet, Sense::Inverse).unwrap();
        assert!((roll + 0.2).abs() < 2e-4);
    }

    #[test]
    fn senseless_words_are_no_attitude() {
        let zero = Packet::new(Command::StabilisedQuaternion, &[0; 5]).unwrap();
        assert_eq!(of(&zero, Sense::Attitude), None);
        let vectors = Packet::new(Command::InstantVectors, &[0; 10]).unwrap();
        assert_eq!(of(&vectors, Sense::Attitude), None);
    }
}
