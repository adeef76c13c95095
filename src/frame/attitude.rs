//! Small rotations: between changes of roll, pitch and yaw and turns about the axes of B.

use nalgebra::Matrix3;

/// The small rotation about the fixed axes of B that small changes of roll, pitch and yaw make:
/// `d_theta = J (d_roll, d_pitch, d_yaw)`, with columns Rz Ry ex, Rz ey, ez.
pub fn euler_to_fixed_axes([_, pitch, yaw]: [f64; 3]) -> Matrix3<f64> {
    let (sp, cp) = pitch.sin_cos();
    let (sy, cy) = yaw.sin_cos();
    Matrix3::new(
        cy * cp,
        -sy,
        0.0, //
        sy * cp,
        cy,
        0.0, //
        -sp,
        0.0,
        1.0,
    )
}

/// The inverse of [`euler_to_fixed_axes`]; not finite at a pitch of 90 degrees.
pub fn fixed_axes_to_euler([_, pitch, yaw]: [f64; 3]) -> Matrix3<f64> {
    let (sp, cp) = pitch.sin_cos();
    let (sy, cy) = yaw.sin_cos();
    let tp = sp / cp;
    Matrix3::new(
        cy / cp,
        sy / cp,
        0.0, //
        -sy,
        cy,
        0.0, //
        cy * tp,
        sy * tp,
        1.0,
    )
}

#[cfg(test)]
mod tests {
    use super::super::crossing::rotation_matrix;
    use super::*;

    const ATTITUDES: [[f64; 3]; 4] = [
        [0.0, 0.0, 0.0],
        [0.3, -0.2, 0.9],
        [-1.1, 0.7, -2.5],
        [0.02, 0.01, -0.03],
    ];

    fn matrix(rotation_rad: [f64; 3]) -> Matrix3<f64> {
        let rows = rotation_matrix(rotation_rad);
        Matrix3::from_fn(|row, col| rows[row][col])
    }

    /// Against the rotation that a finite change of each angle really makes.
    #[test]
    fn the_jacobian_is_the_finite_difference() {
        let h = 1e-6;
        for attitude in ATTITUDES {
            let j = euler_to_fixed_axes(attitude);
            for angle in 0..3 {
                let shifted = |by: f64| {
                    let mut shifted = attitude;
                    shifted[angle] += by;
                    matrix(shifted)
                };
                // d(R) R^T is the cross product matrix of the small rotation in fixed axes.
                let d = (shifted(h) - shifted(-h)) / (2.0 * h) * matrix(attitude).transpose();
                let vector = nalgebra::Vector3::new(d[(2, 1)], d[(0, 2)], d[(1, 0)]);
                assert!(
                    (j.column(angle) - vector).norm() < 1e-9,
                    "{attitude:?} {angle}"
                );
            }
            let unit = j * fixed_axes_to_euler(attitude);
            assert!((unit - Matrix3::identity()).norm() < 1e-14);
        }
    }
}
