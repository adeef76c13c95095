//! Where the scan plane's beams and the faces of the box meet, exactly, with derivatives.
//!
//! This is the estimator's geometry: closed forms of the full rotation R = Rz(yaw) Ry(pitch)
//! Rx(roll), the scanner's mounting rotation and lever arm included, and their exact derivatives to
//! the platform's pose. The simulator casts rays with its own arithmetic and does not use it.
//!
//! State order everywhere: x, y, z, roll, pitch, yaw.

use super::{Frame, FrameBox};
use crate::record::{Face, NormalLine};

type Vec3 = [f64; 3];

/// A platform pose made ready for many beams: the scanner's origin and axes in B.
#[derive(Clone, Copy, Debug)]
pub struct ScannerPose {
    /// R, row by row.
    rotation: [Vec3; 3],
    /// Axis of the pitch rotation in P: Rx(roll)^T e_y.
    pitch_axis: Vec3,
    /// Mounting rotation of S on P, row by row.
    mounting: [Vec3; 3],
    /// Lever arm r_PS in P, m.
    lever_m: Vec3,
    /// Scanner origin in B, m, and its derivatives to roll, pitch and yaw.
    origin_m: Vec3,
    d_origin: [Vec3; 3],
    /// Beams at 0 and at 90 deg: what all others are made of.
    beams: [Axis; 2],
    bounds: FrameBox,
}

/// A direction in B with its derivatives to roll, pitch and yaw.
#[derive(Clone, Copy, Debug)]
struct Axis {
    direction: Vec3,
    d_direction: [Vec3; 3],
}

/// Where a beam meets the plane of a face.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// Distance along the beam, m.
    pub range_m: f64,
    /// The point in B, m.
    pub point_m: Vec3,
    /// Beam direction in B.
    pub direction: Vec3,
    /// Derivatives of the point to (x, y, z, roll, pitch, yaw), m/m and m/rad.
    pub d_point: [Vec3; 6],
    /// Derivative of the point to the beam's angle, m/rad.
    pub d_angle: Vec3,
}

/// A face's line in the scan plane with its derivatives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FaceLine {
    /// The line in normal parametrisation.
    pub normal: NormalLine,
    /// Derivatives of d to (x, y, z, roll, pitch, yaw), m/m and m/rad.
    pub d_d: [f64; 6],
    /// Derivatives of alpha, rad/m and rad/rad.
    pub d_alpha: [f64; 6],
}

impl ScannerPose {
    /// The scanner's pose for a platform at `position_m` with `rotation_rad` (roll, pitch, yaw).
    pub fn new(frame: &Frame, position_m: Vec3, rotation_rad: Vec3) -> ScannerPose {
        let mounting = rotation_matrix(frame.scanner.rotation_deg.map(f64::to_radians));
        let lever_m = frame.scanner.position_m;
        Self::mounted(mounting, lever_m, frame.bounds, position_m, rotation_rad)
    }

    /// The same scanner, with its platform at `position_m` with `rotation_rad` (roll, pitch, yaw).
    pub fn moved_to(&self, position_m: Vec3, rotation_rad: Vec3) -> ScannerPose {
        let bounds = self.bounds;
        Self::mounted(
            self.mounting,
            self.lever_m,
            bounds,
            position_m,
            rotation_rad,
        )
    }

    fn mounted(
        mounting: [Vec3; 3],
        lever_m: Vec3,
        bounds: FrameBox,
        position_m: Vec3,
        rotation_rad: Vec3,
    ) -> ScannerPose {
        let rotation = rotation_matrix(rotation_rad);
        let (sin_roll, cos_roll) = rotation_rad[0].sin_cos();
        let pitch_axis = [0.0, cos_roll, -sin_roll];
        let turned = |in_p: Vec3| {
            let direction = mul(&rotation, in_p);
            Axis {
                direction,
                d_direction: [
                    mul(&rotation, cross([1.0, 0.0, 0.0], in_p)),
                    mul(&rotation, cross(pitch_axis, in_p)),
                    cross([0.0, 0.0, 1.0], direction),
                ],
            }
        };
        let lever = turned(lever_m);
        ScannerPose {
            rotation,
            pitch_axis,
            mounting,
            lever_m,
            origin_m: add(position_m, lever.direction),
            d_origin: lever.d_direction,
            beams: [1, 2].map(|j| turned(mounting.map(|row| row[j]))),
            bounds,
        }
    }

    /// Where the beam at `angle_rad` meets the plane of `face`; none where it points away from it.
    #[inline]
    pub fn crossing(&self, angle_rad: f64, face: Face) -> Option<Crossing> {
        let (sin, cos) = angle_rad.sin_cos();
        let [level, upright] = &self.beams;
        let of_both = |a: Vec3, b: Vec3| add(scale(a, cos), scale(b, sin));
        let direction = of_both(level.direction, upright.direction);
        let (axis, at_m) = plane(face, &self.bounds);
        let range_m = (at_m - self.origin_m[axis]) / direction[axis];
        if !(range_m > 0.0 && range_m < 1e6) {
            return None;
        }
        let per_range = 1.0 / direction[axis];
        let mut d_point = [[0.0; 3]; 6];
        for (k, d_point) in d_point.iter_mut().enumerate() {
            // The point is origin + range * direction, with the range such that it stays on the face.
            let mut moved = [0.0; 3];
            if k < 3 {
                moved[k] = 1.0;
            } else {
                let j = k - 3;
                let turned = of_both(level.d_direction[j], upright.d_direction[j]);
                moved = add(self.d_origin[j], scale(turned, range_m));
            }
            let d_range = -moved[axis] * per_range;
            *d_point = add(moved, scale(direction, d_range));
        }
        let point_m = add(self.origin_m, scale(direction, range_m));
        let turned = add(scale(level.direction, -sin), scale(upright.direction, cos));
        let d_range = -range_m * turned[axis] * per_range;
        let d_angle = add(scale(turned, range_m), scale(direction, d_range));
        Some(Crossing {
            range_m,
            point_m,
            direction,
            d_point,
            d_angle,
        })
    }

    /// A direction of B in the axes of S.
    pub fn in_scanner(&self, direction: Vec3) -> Vec3 {
        mul_transposed(&self.mounting, mul_transposed(&self.rotation, direction))
    }

    /// The line in which the scan plane cuts `face`, without derivatives.
    pub fn normal(&self, face: Face) -> NormalLine {
        let Outward {
            in_s, distance_m, ..
        } = self.outward(face);
        let norm = (in_s[1] * in_s[1] + in_s[2] * in_s[2]).sqrt();
        NormalLine::new(distance_m / norm, in_s[2].atan2(in_s[1]))
    }

    fn outward(&self, face: Face) -> Outward {
        let (axis, at_m) = plane(face, &self.bounds);
        let sign = if at_m < 0.0 { -1.0 } else { 1.0 };
        let mut in_b = [0.0; 3];
        in_b[axis] = sign;
        let in_p = mul_transposed(&self.rotation, in_b);
        Outward {
            in_b,
            in_p,
            in_s: mul_transposed(&self.mounting, in_p),
            distance_m: at_m.abs() - dot(in_b, self.origin_m),
        }
    }

    /// The line in which the scan plane cuts `face` (02-geometry: d = distance / sqrt(1 - n^2)).
    pub fn line(&self, face: Face) -> FaceLine {
        let Outward {
            in_b: outward,
            in_p,
            in_s,
            distance_m,
        } = self.outward(face);
        let norm_sq = in_s[1] * in_s[1] + in_s[2] * in_s[2];
        let norm = norm_sq.sqrt();
        let mut d_d = [0.0; 6];
        let mut d_alpha = [0.0; 6];
        for k in 0..3 {
            d_d[k] = -outward[k] / norm;
        }
        let d_in_p = [
            scale(cross([1.0, 0.0, 0.0], in_p), -1.0),
            scale(cross(self.pitch_axis, in_p), -1.0),
            scale(
                mul_transposed(&self.rotation, cross([0.0, 0.0, 1.0], outward)),
                -1.0,
            ),
        ];
        for k in 0..3 {
            let d_in_s = mul_transposed(&self.mounting, d_in_p[k]);
            let d_norm = (in_s[1] * d_in_s[1] + in_s[2] * d_in_s[2]) / norm;
            let d_distance = -dot(outward, self.d_origin[k]);
            d_d[3 + k] = d_distance / norm - distance_m * d_norm / norm_sq;
            d_alpha[3 + k] = (in_s[1] * d_in_s[2] - in_s[2] * d_in_s[1]) / norm_sq;
        }
        let normal = NormalLine::new(distance_m / norm, in_s[2].atan2(in_s[1]));
        FaceLine {
            normal,
            d_d,
            d_alpha,
        }
    }
}

/// A face's normal, out of the box, in three axes, and how far the scanner is from the face.
struct Outward {
    in_b: Vec3,
    in_p: Vec3,
    in_s: Vec3,
    distance_m: f64,
}

/// The axis (1 is y, 2 is z) and the coordinate of a face's plane.
fn plane(face: Face, bounds: &FrameBox) -> (usize, f64) {
    match face {
        Face::Right => (1, bounds.dy_m / 2.0),
        Face::Upper => (2, bounds.dz_m),
        Face::Left => (1, -bounds.dy_m / 2.0),
    }
}

/// Rz(yaw) Ry(pitch) Rx(roll), row by row (Kurniawan 2017, eq. 3.3 to 3.6).
pub(super) fn rotation_matrix([roll, pitch, yaw]: Vec3) -> [Vec3; 3] {
    let ((sr, cr), (sp, cp), (sy, cy)) = (roll.sin_cos(), pitch.sin_cos(), yaw.sin_cos());
    [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
}

fn mul(m: &[Vec3; 3], v: Vec3) -> Vec3 {
    [dot(m[0], v), dot(m[1], v), dot(m[2], v)]
}

fn mul_transposed(m: &[Vec3; 3], v: Vec3) -> Vec3 {
    [0, 1, 2].map(|j| m[0][j] * v[0] + m[1][j] * v[1] + m[2][j] * v[2])
}

fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn add(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

fn scale(a: Vec3, by: f64) -> Vec3 {
    [a[0] * by, a[1] * by, a[2] * by]
}

fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn frame() -> Frame {
        let text = include_str!("../../testdata/cablar.toml")
            .replace(
                "position_m = [0.0, 0.0, 0.0]",
                "position_m = [0.05, -0.03, 0.20]",
            )
            .replacen(
                "rotation_deg = [0.0, 0.0, 0.0]",
                "rotation_deg = [0.4, -0.3, 0.7]",
                1,
            );
        Frame::parse(&text, Path::new("frame.toml")).unwrap()
    }

    const POSE: [f64; 6] = [0.04, -1.3, 2.2, 0.011, -0.017, 0.013];

    fn at(frame: &Frame, p: [f64; 6]) -> ScannerPose {
        ScannerPose::new(frame, [p[0], p[1], p[2]], [p[3], p[4], p[5]])
    }

    /// Rotation composed axis by axis by nalgebra, independent of the closed form above.
    fn by_nalgebra(p: [f64; 6]) -> nalgebra::Rotation3<f64> {
        nalgebra::Rotation3::from_euler_angles(p[3], p[4], p[5])
    }

    #[test]
    fn crossing_lies_on_the_face_and_on_the_ray() {
        let frame = frame();
        let pose = at(&frame, POSE);
        let rotation = by_nalgebra(POSE);
        let mounting = nalgebra::Rotation3::from_euler_angles(
            0.4f64.to_radians(),
            (-0.3f64).to_radians(),
            0.7f64.to_radians(),
        );
        for (angle, face) in [(0.2, Face::Right), (1.4, Face::Upper), (2.9, Face::Left)] {
            let c = pose.crossing(angle, face).unwrap();
            let u =
                rotation * mounting * nalgebra::Vector3::new(0.0, f64::cos(angle), f64::sin(angle));
            let o = nalgebra::Vector3::new(POSE[0], POSE[1], POSE[2])
                + rotation * nalgebra::Vector3::new(0.05, -0.03, 0.20);
            let hit = o + u * c.range_m;
            for k in 0..3 {
                assert!((hit[k] - c.point_m[k]).abs() < 1e-12);
            }
            let (axis, at_m) = plane(face, &frame.bounds);
            assert!((c.point_m[axis] - at_m).abs() < 1e-12);
            // The face's line gives the same range.
            assert!((pose.line(face).normal.range_m(angle) - c.range_m).abs() < 1e-10);
        }
        assert!(pose.crossing(3.0, Face::Right).is_none());
    }

    #[test]
    fn derivatives_are_the_finite_differences() {
        let frame = frame();
        let step = 1e-6;
        for k in 0..6 {
            let (mut low, mut high) = (POSE, POSE);
            low[k] -= step;
            high[k] += step;
            let (low, pose, high) = (at(&frame, low), at(&frame, POSE), at(&frame, high));
            for (angle, face) in [(0.3, Face::Right), (1.1, Face::Upper), (2.9, Face::Left)] {
                let [a, c, b] = [&low, &pose, &high].map(|p| p.crossing(angle, face).unwrap());
                for j in 0..3 {
                    let difference = (b.point_m[j] - a.point_m[j]) / (2.0 * step);
                    assert!(
                        (difference - c.d_point[k][j]).abs() < 1e-6,
                        "{face:?} {k} {j}"
                    );
                }
                let [a, c, b] = [&low, &pose, &high].map(|p| p.line(face));
                let d = (b.normal.d_m - a.normal.d_m) / (2.0 * step);
                let alpha = (b.normal.alpha_rad - a.normal.alpha_rad) / (2.0 * step);
                assert!(
                    (d - c.d_d[k]).abs() < 1e-6,
                    "{face:?} d {k}: {d} {}",
                    c.d_d[k]
                );
                assert!((alpha - c.d_alpha[k]).abs() < 1e-6, "{face:?} alpha {k}");
            }
        }
    }

    #[test]
    fn the_point_moves_with_the_beam() {
        let frame = frame();
        let pose = at(&frame, POSE);
        let step = 1e-6;
        for (angle, face) in [(0.3, Face::Right), (1.1, Face::Upper), (2.9, Face::Left)] {
            let [a, c, b] = [-step, 0.0, step].map(|s| pose.crossing(angle + s, face).unwrap());
            for j in 0..3 {
                let difference = (b.point_m[j] - a.point_m[j]) / (2.0 * step);
                assert!((difference - c.d_angle[j]).abs() < 1e-5, "{face:?} {j}");
            }
        }
    }

    #[test]
    fn lines_of_a_level_platform_are_the_closed_forms() {
        let text = include_str!("../../testdata/cablar.toml");
        let frame = Frame::parse(text, Path::new("frame.toml")).unwrap();
        let (pitch, yaw) = (0.01f64, 0.02f64);
        let pose = ScannerPose::new(&frame, [0.0, 1.5, 2.0], [0.0, pitch, yaw]);
        let n = (yaw.cos().powi(2) + (yaw.sin() * pitch.sin()).powi(2)).sqrt();
        assert!((pose.line(Face::Right).normal.d_m - (10.45 / 2.0 - 1.5) / n).abs() < 1e-12);
        assert!((pose.line(Face::Left).normal.d_m - (10.45 / 2.0 + 1.5) / n).abs() < 1e-12);
        assert!((pose.line(Face::Upper).normal.d_m - 3.5 / pitch.cos()).abs() < 1e-12);
        let rolled = ScannerPose::new(&frame, [0.0, 0.0, 2.0], [0.03, 0.0, 0.0]);
        let alpha = rolled.line(Face::Upper).normal.alpha_rad;
        assert!((alpha - (std::f64::consts::FRAC_PI_2 - 0.03)).abs() < 1e-12);
    }
}
