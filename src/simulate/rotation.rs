//! Rotations as compositions of quaternions about the axes.
//!
//! The simulator turns vectors with these and meets surfaces with rays, while the solver works with
//! closed forms of angles; an error in one does not hide in the other. Sines and cosines come from
//! `libm`, so that a seed gives the same digits on every machine.

use nalgebra::{Quaternion, Rotation3, UnitQuaternion, Vector3};

/// The turn by `angle_rad` about a unit axis.
fn about(axis: Vector3<f64>, angle_rad: f64) -> UnitQuaternion<f64> {
    let (sin, cos) = libm::sincos(angle_rad / 2.0);
    UnitQuaternion::new_unchecked(Quaternion::from_parts(cos, axis * sin))
}

/// R = Rz(yaw) Ry(pitch) Rx(roll) (Kurniawan 2017, eq. 3.3 to 3.6) of roll, pitch, yaw in rad.
pub fn attitude(roll_pitch_yaw: Vector3<f64>) -> UnitQuaternion<f64> {
    about(Vector3::z(), roll_pitch_yaw.z)
        * about(Vector3::y(), roll_pitch_yaw.y)
        * about(Vector3::x(), roll_pitch_yaw.x)
}

/// As [`attitude`], as a matrix, for turning many vectors.
pub fn attitude_matrix(roll_pitch_yaw: Vector3<f64>) -> Rotation3<f64> {
    attitude(roll_pitch_yaw).to_rotation_matrix()
}

/// As [`attitude`], from degrees as configuration has them.
pub fn attitude_deg(roll_pitch_yaw_deg: [f64; 3]) -> UnitQuaternion<f64> {
    attitude(Vector3::from(roll_pitch_yaw_deg.map(f64::to_radians)))
}

/// Roll, pitch and yaw of a rotation, rad; pitch in [-pi/2, pi/2].
pub fn roll_pitch_yaw(rotation: &UnitQuaternion<f64>) -> Vector3<f64> {
    let m = rotation.to_rotation_matrix();
    Vector3::new(
        libm::atan2(m[(2, 1)], m[(2, 2)]),
        libm::asin((-m[(2, 0)]).clamp(-1.0, 1.0)),
        libm::atan2(m[(1, 0)], m[(0, 0)]),
    )
}

/// Angular velocity in the body's own axes from roll, pitch, yaw and their rates, rad/s.
pub fn body_rate(roll_pitch_yaw: Vector3<f64>, rate_rad_s: Vector3<f64>) -> Vector3<f64> {
    // Each rate turns about an axis that the later turns carry along.
    let roll = about(Vector3::x(), roll_pitch_yaw.x).inverse();
    let pitch = about(Vector3::y(), roll_pitch_yaw.y).inverse();
    Vector3::x() * rate_rad_s.x
        + roll * (Vector3::y() * rate_rad_s.y)
        + roll * (pitch * (Vector3::z() * rate_rad_s.z))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matrix_is_the_product_of_the_axis_turns() {
        let (roll, pitch, yaw) = (0.3f64, -0.2f64, 1.1f64);
        let m = attitude_matrix(Vector3::new(roll, pitch, yaw));
        // Third row and first column of Rz Ry Rx, written out.
        assert!((m[(2, 0)] + pitch.sin()).abs() < 1e-15);
        assert!((m[(2, 1)] - pitch.cos() * roll.sin()).abs() < 1e-15);
        assert!((m[(0, 0)] - yaw.cos() * pitch.cos()).abs() < 1e-15);
        assert!((m[(1, 0)] - yaw.sin() * pitch.cos()).abs() < 1e-15);
        let back = roll_pitch_yaw(&attitude(Vector3::new(roll, pitch, yaw)));
        assert!((back - Vector3::new(roll, pitch, yaw)).norm() < 1e-14);
    }

    #[test]
    fn body_rate_is_the_logarithm_of_a_small_turn() {
        let at = Vector3::new(0.3, -0.4, 1.0);
        let rate = Vector3::new(0.5, -0.7, 0.9);
        let h = 1e-5;
        let turn = attitude(at - rate * h).inverse() * attitude(at + rate * h);
        let expected = turn.scaled_axis() / (2.0 * h);
        assert!((body_rate(at, rate) - expected).norm() < 1e-8);
    }
}
