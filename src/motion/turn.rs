//! Rotations as the motion room composes them: turns about the axes of B, put before an attitude.

use crate::frame::{euler_to_fixed_axes, fixed_axes_to_euler};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

/// The attitude R = Rz(yaw) Ry(pitch) Rx(roll) of roll, pitch, yaw in rad.
pub(super) fn attitude([roll, pitch, yaw]: [f64; 3]) -> UnitQuaternion<f64> {
    UnitQuaternion::from_euler_angles(roll, pitch, yaw)
}

/// Roll, pitch and yaw of an attitude, rad.
pub(super) fn euler(attitude: &UnitQuaternion<f64>) -> [f64; 3] {
    let (roll, pitch, yaw) = attitude.euler_angles();
    [roll, pitch, yaw]
}

/// The turn by the length of `vector_rad` about its direction.
pub(super) fn turn(vector_rad: Vector3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::from_scaled_axis(vector_rad)
}

/// The inverse of [`turn`], rad; at most half a turn.
pub(super) fn vector(turn: &UnitQuaternion<f64>) -> Vector3<f64> {
    turn.scaled_axis()
}

/// How small changes of an attitude's Euler angles show in those of the attitude turned by `by`:
/// the Jacobian of the Euler angles of `by * R` to those of `R`.
pub(super) fn carried_angles(
    before_rad: [f64; 3],
    by: &UnitQuaternion<f64>,
    after_rad: [f64; 3],
) -> Matrix3<f64> {
    fixed_axes_to_euler(after_rad)
        * by.to_rotation_matrix().matrix()
        * euler_to_fixed_axes(before_rad)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn carried_angles_are_the_finite_differences() {
        let h = 1e-6;
        for before in [[0.0; 3], [0.2, -0.3, 1.1], [-0.4, 0.1, -2.0]] {
            let by = turn(Vector3::new(0.3, -0.5, 0.2));
            let carried = |angles| Vector3::from(euler(&(by * attitude(angles))));
            let jacobian = carried_angles(before, &by, carried(before).into());
            for i in 0..3 {
                let shifted = |d: f64| {
                    let mut angles = before;
                    angles[i] += d;
                    carried(angles)
                };
                let expected = (shifted(h) - shifted(-h)) / (2.0 * h);
                assert!((jacobian.column(i) - expected).norm() < 1e-8);
            }
        }
    }
}
