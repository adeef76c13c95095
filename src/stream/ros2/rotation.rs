//! Rotations between Euler angles, as the records have them, and ROS's quaternions and fixed axes.

use super::types::{Quaternion, Square6};
use crate::frame::{euler_to_fixed_axes, fixed_axes_to_euler};
use crate::record::upper_index;
use nalgebra::{Matrix3, Matrix6, Rotation3, UnitQuaternion};

/// The quaternion of R = Rz(yaw) Ry(pitch) Rx(roll).
pub(crate) fn quaternion([roll, pitch, yaw]: [f64; 3]) -> Quaternion {
    UnitQuaternion::from_euler_angles(roll, pitch, yaw).into()
}

impl From<UnitQuaternion<f64>> for Quaternion {
    fn from(q: UnitQuaternion<f64>) -> Quaternion {
        Quaternion {
            x: q.i,
            y: q.j,
            z: q.k,
            w: q.w,
        }
    }
}

/// Roll, pitch and yaw of a quaternion; NaN for one without a length.
pub(crate) fn euler(q: &Quaternion) -> [f64; 3] {
    let q = nalgebra::Quaternion::new(q.w, q.x, q.y, q.z);
    let norm = q.norm();
    if !(norm.is_finite() && norm > 0.0) {
        return [f64::NAN; 3];
    }
    let (roll, pitch, yaw) = UnitQuaternion::new_normalize(q).euler_angles();
    [roll, pitch, yaw]
}

/// A vector given in B, in the axes of the frame that R = Rz Ry Rx turns B into.
pub(crate) fn to_child([roll, pitch, yaw]: [f64; 3], v: [f64; 3]) -> [f64; 3] {
    let r = Rotation3::from_euler_angles(roll, pitch, yaw);
    (r.inverse() * nalgebra::Vector3::from(v)).into()
}

/// The inverse of [`to_child`].
pub(crate) fn from_child([roll, pitch, yaw]: [f64; 3], v: [f64; 3]) -> [f64; 3] {
    let r = Rotation3::from_euler_angles(roll, pitch, yaw);
    (r * nalgebra::Vector3::from(v)).into()
}

fn with_rotation_block(block: &Matrix3<f64>) -> Matrix6<f64> {
    let mut whole = Matrix6::identity();
    whole.fixed_view_mut::<3, 3>(3, 3).copy_from(block);
    whole
}

/// A pose's covariance over (x, y, z, roll, pitch, yaw), carried to ROS's (x, y, z, rotation about
/// the fixed axes X, Y, Z) at the attitude `rotation_rad`.
pub(crate) fn to_fixed_axes(covariance: &[f64; 21], rotation_rad: [f64; 3]) -> Square6 {
    let c = Matrix6::from_fn(|row, col| covariance[upper_index(6, row, col)]);
    let a = with_rotation_block(&euler_to_fixed_axes(rotation_rad));
    let c = a * c * a.transpose();
    Square6(std::array::from_fn(|row| {
        // Symmetric to the last digit: both halves are the mean of the two products.
        std::array::from_fn(|col| 0.5 * (c[(row, col)] + c[(col, row)]))
    }))
}

/// The inverse of [`to_fixed_axes`].
pub(crate) fn from_fixed_axes(covariance: &Square6, rotation_rad: [f64; 3]) -> [f64; 21] {
    let c = Matrix6::from_fn(|row, col| covariance.0[row][col]);
    let a = with_rotation_block(&fixed_axes_to_euler(rotation_rad));
    let c = a * c * a.transpose();
    let mut upper = [0.0; 21];
    for row in 0..6 {
        for col in row..6 {
            upper[upper_index(6, row, col)] = 0.5 * (c[(row, col)] + c[(col, row)]);
        }
    }
    upper
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    const ATTITUDES: [[f64; 3]; 4] = [
        [0.0, 0.0, 0.0],
        [0.3, -0.2, 0.9],
        [-1.1, 0.7, -2.5],
        [0.02, 0.01, -0.03],
    ];

    fn product(rotation_rad: [f64; 3]) -> Matrix3<f64> {
        let [roll, pitch, yaw] = rotation_rad;
        let (sr, cr) = roll.sin_cos();
        let (sp, cp) = pitch.sin_cos();
        let (sy, cy) = yaw.sin_cos();
        let rx = Matrix3::new(1.0, 0.0, 0.0, 0.0, cr, -sr, 0.0, sr, cr);
        let ry = Matrix3::new(cp, 0.0, sp, 0.0, 1.0, 0.0, -sp, 0.0, cp);
        let rz = Matrix3::new(cy, -sy, 0.0, sy, cy, 0.0, 0.0, 0.0, 1.0);
        rz * ry * rx
    }

    #[test]
    fn the_quaternion_turns_as_the_three_rotations_do() {
        for attitude in ATTITUDES {
            let q = quaternion(attitude);
            let q = UnitQuaternion::new_normalize(nalgebra::Quaternion::new(q.w, q.x, q.y, q.z));
            let v = Vector3::new(0.3, -1.2, 2.0);
            assert!((q * v - product(attitude) * v).norm() < 1e-14);
            for (back, angle) in euler(&quaternion(attitude)).iter().zip(attitude) {
                assert!((back - angle).abs() < 1e-14);
            }
            let in_child = Vector3::from(to_child(attitude, v.into()));
            assert!((in_child - product(attitude).transpose() * v).norm() < 1e-14);
            let back = Vector3::from(from_child(attitude, in_child.into()));
            assert!((back - v).norm() < 1e-14);
        }
        assert!(euler(&Quaternion::default())[0].is_nan());
    }

    #[test]
    fn a_covariance_comes_back() {
        let attitude = [0.1, -0.3, 0.8];
        let mut covariance = [0.0; 21];
        for row in 0..6 {
            for col in row..6 {
                let value = if row == col {
                    2.0 + row as f64
                } else {
                    0.1 * (row + col) as f64
                };
                covariance[upper_index(6, row, col)] = value;
            }
        }
        let fixed = to_fixed_axes(&covariance, attitude);
        let back = from_fixed_axes(&fixed, attitude);
        for (back, value) in back.iter().zip(covariance) {
            assert!((back - value).abs() < 1e-12);
        }
        // Positions are not touched; at zero attitude nothing is.
        assert!((fixed.0[0][1] - 0.1).abs() < 1e-15);
        let level = to_fixed_axes(&covariance, [0.4, 0.0, 0.0]);
        for row in 0..6 {
            for col in 0..6 {
                let value = covariance[upper_index(6, row, col)];
                assert!((level.0[row][col] - value).abs() < 1e-15);
            }
        }
    }
}
