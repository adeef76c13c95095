//! Measured poses brought into the reference's frame, where that is wanted.
//!
//! The robot's poses are absolute, so that nothing is aligned unless asked for: an alignment would
//! hide a wrong mounting or a wrong frame file. What can be asked for:
//!
//! - `se2`: a turn about z and a shift along x, y and z (4 degrees of freedom, `posyaw` elsewhere),
//!   which minimises the sum of squared distances between positions;
//! - `se3`: any turn and a shift, which minimises the same sum (Umeyama 1991, eq. 34 to 43, without
//!   scale). Orientations are turned with it and have no say in it, as in evo;
//! - `full`: the same with a say for the orientations: it minimises the sum of squared distances plus
//!   [`LEVER_M`]^2 times the sum of squared differences of the rotation matrices' columns;
//! - `first:N`: `se3` of the first N poses; of a single pose its whole difference;
//! - `file:PATH`: the one of an earlier report, or written by hand.
//!
//! Where the positions do not say which way to turn (the platform stands, or moves along a straight
//! line), only the shift is taken, and a note says so.

use super::number::fixed;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use serde::Deserialize;

/// How measured poses are aligned.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Align {
    /// As measured.
    #[default]
    None,
    /// About z, and a shift.
    Se2,
    /// Any turn, and a shift.
    Se3,
    /// With a say for the orientations.
    Full,
    /// By the first so many poses.
    First(usize),
    /// By this one.
    Given(Box<Alignment>),
}

/// A turn and a shift that take measured positions to the reference's frame: p' = R p + t.
#[derive(Clone, Debug, PartialEq)]
pub struct Alignment {
    /// `none`, `se2`, `se3`, `full`, `first:N` or `file`.
    pub kind: String,
    /// R.
    pub rotation: Rotation3<f64>,
    /// t, m.
    pub shift_m: Vector3<f64>,
    /// What a reader should know of it.
    pub note: Option<String>,
}

impl Default for Alignment {
    fn default() -> Self {
        Alignment {
            kind: "none".to_owned(),
            rotation: Rotation3::identity(),
            shift_m: Vector3::zeros(),
            note: None,
        }
    }
}

/// Why a text is no alignment.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "{why}; an alignment has x_mm, y_mm, z_mm, roll_deg, pitch_deg, yaw_deg: as TOML, or in the JSON \
     of an earlier report"
)]
pub struct AlignmentError {
    why: String,
}

/// What a turn of one radian counts for against a distance in `full`, m.
pub const LEVER_M: f64 = 1.0;
/// Positions that spread less than this about their mean, or about a straight line, say nothing of
/// a turn, m (rms).
const STILL_M: f64 = 0.05;
/// Nor do those that spread less than this share of their length.
const STRAIGHT: f64 = 0.001;

/// A position (m) and an orientation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Placed {
    pub position_m: Vector3<f64>,
    /// As a quaternion: small angles keep their digits.
    pub rotation: UnitQuaternion<f64>,
}

impl Placed {
    /// From x, y, z (m), roll, pitch, yaw (rad).
    pub fn new([x, y, z, roll, pitch, yaw]: &[f64; 6]) -> Placed {
        Placed {
            position_m: Vector3::new(*x, *y, *z),
            rotation: UnitQuaternion::from_euler_angles(*roll, *pitch, *yaw),
        }
    }
}

impl Alignment {
    /// The alignment of `pairs` (measured, reference), which must be all numbers.
    pub(super) fn of(align: &Align, pairs: impl Iterator<Item = (Placed, Placed)> + Clone) -> Self {
        let kind = match align {
            Align::None => return Alignment::default(),
            Align::Given(given) => return (**given).clone(),
            Align::Se2 => "se2".to_owned(),
            Align::Se3 => "se3".to_owned(),
            Align::Full => "full".to_owned(),
            Align::First(count) => format!("first:{count}"),
        };
        let found = match align {
            Align::First(count) => Sums::of(pairs.take(*count)),
            _ => Sums::of(pairs),
        };
        let (rotation, note) = match (align, found.n) {
            (_, 0) => {
                let note = "no pose to align by: nothing was aligned".to_owned();
                return Alignment {
                    note: Some(note),
                    kind,
                    ..Alignment::default()
                };
            }
            // One pose knows all by itself.
            (Align::First(_), 1) => (found.turn(0.0, 1.0), None),
            (Align::Full, _) => (found.turn(1.0, LEVER_M * LEVER_M), None),
            (Align::Se2, _) => match found.horizontal_m() {
                spread if spread > STILL_M => (found.turn_about_z(), None),
                _ => (
                    None,
                    Some("the platform moves too little sideways to tell a turn about z"),
                ),
            },
            _ => match found.spreads_m() {
                [length, _, _] if length <= STILL_M => {
                    (None, Some("the platform stands, which tells no turn"))
                }
                [length, width, _] if width <= STILL_M.max(STRAIGHT * length) => (
                    None,
                    Some("the platform moves along a straight line, which tells no turn about it"),
                ),
                _ => (found.turn(1.0, 0.0), None),
            },
        };
        let rotation = rotation.unwrap_or_else(Rotation3::identity);
        Alignment {
            kind,
            rotation,
            shift_m: found.mean_reference - rotation * found.mean_measured,
            note: note.map(|why| format!("{why}: only the shift was aligned")),
        }
    }

    /// Whether it changes nothing.
    pub fn is_none(&self) -> bool {
        self.shift_m == Vector3::zeros() && self.rotation == Rotation3::identity()
    }

    /// The angle of the turn, rad.
    pub fn angle_rad(&self) -> f64 {
        self.rotation.angle()
    }

    /// Roll, pitch, yaw of the turn, rad.
    pub fn angles_rad(&self) -> [f64; 3] {
        let (roll, pitch, yaw) = self.rotation.euler_angles();
        [roll, pitch, yaw]
    }

    /// First `self`, then `next`.
    #[must_use]
    pub(super) fn then(&self, next: &Alignment) -> Alignment {
        Alignment {
            rotation: next.rotation * self.rotation,
            shift_m: next.rotation * self.shift_m + next.shift_m,
            ..next.clone()
        }
    }

    /// A pose (m, rad) in the reference's frame. A component that is not known stays so; a turn
    /// spreads that to the components that it mixes it with.
    pub(super) fn apply(&self, position_m: &mut [f64; 3], rotation_rad: &mut [f64; 3]) {
        if self.rotation == Rotation3::identity() {
            for (p, shift) in position_m.iter_mut().zip(&self.shift_m) {
                *p += shift;
            }
            return;
        }
        let [roll, pitch, yaw] = *rotation_rad;
        let turned = self.rotation * Rotation3::from_euler_angles(roll, pitch, yaw);
        *position_m = (self.rotation * Vector3::from(*position_m) + self.shift_m).into();
        let (roll, pitch, yaw) = turned.euler_angles();
        *rotation_rad = if rotation_rad.iter().all(|v| v.is_finite()) {
            [roll, pitch, yaw]
        } else {
            [f64::NAN; 3]
        };
    }

    /// The sentence that a table has of it; none where nothing was aligned.
    pub fn sentence(&self) -> Option<String> {
        if self.kind == "none" {
            return None;
        }
        let shift = self.shift_m.map(|v| v * 1e3);
        let turn = self.angles_rad().map(f64::to_degrees);
        let list = |values: &[f64], decimals| {
            let values = values.iter().map(|v| fixed(*v, decimals));
            values.collect::<Vec<_>>().join(", ")
        };
        let note = self.note.as_ref().map(|note| format!("; {note}"));
        Some(format!(
            "poses moved by {} mm and turned by {} deg ({}){}",
            list(shift.as_slice(), 2),
            list(&turn, 3),
            self.kind,
            note.unwrap_or_default()
        ))
    }

    /// Reads one from TOML (the six numbers, bare or in a table `alignment`), or from the JSON of an
    /// earlier report, of its first run.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn parse(text: &str) -> Result<Alignment, AlignmentError> {
        #[derive(Deserialize)]
        struct Six {
            x_mm: f64,
            y_mm: f64,
            z_mm: f64,
            roll_deg: f64,
            pitch_deg: f64,
            yaw_deg: f64,
        }
        #[derive(Deserialize)]
        struct Holder {
            alignment: Six,
        }
        #[derive(Deserialize)]
        struct Page {
            runs: Vec<Holder>,
        }
        let fail = |why: String| AlignmentError { why };
        let six: Six = if text.trim_start().starts_with('{') {
            let page: Result<Page, _> = serde_json::from_str(text);
            let first = page.map(|page| page.runs.into_iter().next().map(|run| run.alignment));
            match first {
                Ok(Some(six)) => six,
                Ok(None) => return Err(fail("the report has no run".to_owned())),
                Err(_) => serde_json::from_str::<Holder>(text)
                    .map(|holder| holder.alignment)
                    .or_else(|_| serde_json::from_str(text))
                    .map_err(|error| fail(error.to_string()))?,
            }
        } else {
            toml::from_str::<Holder>(text)
                .map(|holder| holder.alignment)
                .or_else(|_| toml::from_str(text))
                .map_err(|error| fail(error.message().to_owned()))?
        };
        let numbers = [
            six.x_mm,
            six.y_mm,
            six.z_mm,
            six.roll_deg,
            six.pitch_deg,
            six.yaw_deg,
        ];
        if !numbers.iter().all(|v| v.is_finite()) {
            return Err(fail("a number is not finite".to_owned()));
        }
        let [roll, pitch, yaw] = [six.roll_deg, six.pitch_deg, six.yaw_deg].map(f64::to_radians);
        Ok(Alignment {
            kind: "file".to_owned(),
            rotation: Rotation3::from_euler_angles(roll, pitch, yaw),
            shift_m: Vector3::new(six.x_mm, six.y_mm, six.z_mm) * 1e-3,
            note: None,
        })
    }
}

/// Sums over the pairs.
struct Sums {
    n: usize,
    mean_measured: Vector3<f64>,
    mean_reference: Vector3<f64>,
    /// Mean of (reference - its mean)(measured - its mean)^T, m^2.
    cross: Matrix3<f64>,
    /// Mean of (reference - its mean)(reference - its mean)^T, m^2.
    spread: Matrix3<f64>,
    /// Mean of R of the reference times that of the measured pose transposed.
    turns: Matrix3<f64>,
}

impl Sums {
    fn of(pairs: impl Iterator<Item = (Placed, Placed)> + Clone) -> Sums {
        let mut sums = Sums {
            n: 0,
            mean_measured: Vector3::zeros(),
            mean_reference: Vector3::zeros(),
            cross: Matrix3::zeros(),
            spread: Matrix3::zeros(),
            turns: Matrix3::zeros(),
        };
        for (measured, reference) in pairs.clone() {
            sums.n += 1;
            sums.mean_measured += measured.position_m;
            sums.mean_reference += reference.position_m;
        }
        let n = sums.n.max(1) as f64;
        sums.mean_measured /= n;
        sums.mean_reference /= n;
        // The means first: far from the origin the digits of the differences would be lost.
        for (measured, reference) in pairs {
            let m = measured.position_m - sums.mean_measured;
            let r = reference.position_m - sums.mean_reference;
            sums.cross += r * m.transpose() / n;
            sums.spread += r * r.transpose() / n;
            let turn = reference.rotation * measured.rotation.inverse();
            sums.turns += turn.to_rotation_matrix().matrix() / n;
        }
        sums
    }

    /// The rotation that maximises the trace of R^T times the weighted sums; none where they have no
    /// singular values.
    fn turn(&self, positions: f64, orientations: f64) -> Option<Rotation3<f64>> {
        let sum = self.cross * positions + self.turns * orientations;
        let svd = sum.try_svd(true, true, f64::EPSILON, 1000)?;
        let (u, v_t) = (svd.u?, svd.v_t?);
        // The smallest singular value's direction is turned over where the result would be a mirror.
        let smallest = svd.singular_values.imin();
        let mut signs = Vector3::repeat(1.0);
        if (u * v_t).determinant() < 0.0 {
            signs[smallest] = -1.0;
        }
        let rotation = u * Matrix3::from_diagonal(&signs) * v_t;
        Some(Rotation3::from_matrix_unchecked(rotation))
    }

    fn turn_about_z(&self) -> Option<Rotation3<f64>> {
        let c = &self.cross;
        let yaw = (c[(1, 0)] - c[(0, 1)]).atan2(c[(0, 0)] + c[(1, 1)]);
        Some(Rotation3::from_euler_angles(0.0, 0.0, yaw))
    }

    /// How far the positions spread along their main directions, m (rms), the longest first.
    fn spreads_m(&self) -> [f64; 3] {
        let mut values: [f64; 3] = self.spread.symmetric_eigenvalues().into();
        values.sort_unstable_by(|a, b| b.total_cmp(a));
        values.map(|v| v.max(0.0).sqrt())
    }

    /// The same in the plane of x and y.
    fn horizontal_m(&self) -> f64 {
        (self.spread[(0, 0)] + self.spread[(1, 1)]).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Poses on a curve in space, and the same moved by `truth`.
    fn pairs(truth: &Alignment, n: usize, size_m: [f64; 3]) -> Vec<(Placed, Placed)> {
        (0..n)
            .map(|i| {
                let t = i as f64 * 0.1;
                let curve = [t.sin(), (1.7 * t).cos(), (0.6 * t).sin()];
                let place = [0, 1, 2].map(|k| 1.0 + curve[k] * size_m[k]);
                let [x, y, z] = place;
                let measured = [
                    x,
                    y,
                    z,
                    0.1 * t.sin(),
                    0.05 * t.cos(),
                    0.3 * (0.4 * t).sin(),
                ];
                let ([x, y, z, ..], [.., roll, pitch, yaw]) = (measured, measured);
                let (mut position, mut angles) = ([x, y, z], [roll, pitch, yaw]);
                truth.apply(&mut position, &mut angles);
                let ([x, y, z], [roll, pitch, yaw]) = (position, angles);
                let reference = [x, y, z, roll, pitch, yaw];
                (Placed::new(&measured), Placed::new(&reference))
            })
            .collect()
    }

    fn moved(angles_rad: [f64; 3], shift_m: [f64; 3]) -> Alignment {
        let [roll, pitch, yaw] = angles_rad;
        Alignment {
            kind: "file".to_owned(),
            rotation: Rotation3::from_euler_angles(roll, pitch, yaw),
            shift_m: shift_m.into(),
            note: None,
        }
    }

    fn off(found: &Alignment, truth: &Alignment) -> f64 {
        let turned = (found.rotation.matrix() - truth.rotation.matrix()).norm();
        turned.max((found.shift_m - truth.shift_m).norm())
    }

    proptest! {
        #[test]
        fn a_known_move_is_found(
            angles in [-3.0f64..3.0, -1.5f64..1.5, -3.0f64..3.0], shift in [-9.0f64..9.0, -9.0f64..9.0, -9.0f64..9.0]
        ) {
            let truth = moved(angles, shift);
            let seen = pairs(&truth, 60, [1.0, 2.0, 0.5]);
            for align in [Align::Se3, Align::Full, Align::First(30), Align::First(1)] {
                let found = Alignment::of(&align, seen.iter().copied());
                prop_assert!(off(&found, &truth) < 1e-9, "{align:?} {found:?}");
                prop_assert_eq!(found.note, None);
            }
            let flat = moved([0.0, 0.0, angles[2]], shift);
            let seen = pairs(&flat, 60, [1.0, 2.0, 0.5]);
            let found = Alignment::of(&Align::Se2, seen.iter().copied());
            prop_assert!(off(&found, &flat) < 1e-9, "{found:?}");
        }
    }

    #[test]
    fn a_plane_is_enough_and_a_line_is_not() {
        let truth = moved([0.02, -0.03, 0.05], [0.1, 0.2, 0.3]);
        let plane = pairs(&truth, 100, [0.0, 3.0, 1.0]);
        let found = Alignment::of(&Align::Se3, plane.iter().copied());
        assert!(
            off(&found, &truth) < 1e-9 && found.note.is_none(),
            "{found:?}"
        );
        for (size_m, words) in [([0.0, 3.0, 0.0], "straight line"), ([0.0; 3], "stands")] {
            let seen = pairs(&truth, 100, size_m);
            let found = Alignment::of(&Align::Se3, seen.iter().copied());
            let note = found.note.clone().unwrap();
            assert!(
                note.contains(words) && note.ends_with("only the shift was aligned"),
                "{note}"
            );
            assert_eq!(found.angle_rad(), 0.0);
            // The shift is the mean's.
            let mean = |which: fn(&(Placed, Placed)) -> Vector3<f64>| {
                seen.iter().map(which).sum::<Vector3<f64>>() / 100.0
            };
            let want = mean(|p| p.1.position_m) - mean(|p| p.0.position_m);
            assert!((found.shift_m - want).norm() < 1e-12);
            // Orientations know better, if they are asked.
            let full = Alignment::of(&Align::Full, seen.iter().copied());
            assert!(off(&full, &truth) < 1e-9, "{full:?}");
        }
        let upright = pairs(&moved([0.0; 3], [0.1; 3]), 100, [0.0, 0.0, 1.0]);
        let found = Alignment::of(&Align::Se2, upright.iter().copied());
        assert!(found.note.unwrap().contains("too little sideways"));
        let none = Alignment::of(&Align::Se3, std::iter::empty());
        assert!(none.is_none() && none.note.is_some());
    }

    #[test]
    fn files_are_read_and_bad_ones_refused() {
        let six = "x_mm = 1.5\ny_mm = -2.0\nz_mm = 0.0\nroll_deg = 0.0\npitch_deg = 0.0\nyaw_deg = 90.0\n";
        let bare = Alignment::parse(six).unwrap();
        assert_eq!(bare.shift_m, Vector3::new(0.0015, -0.002, 0.0));
        assert!((bare.angles_rad()[2].to_degrees() - 90.0).abs() < 1e-12);
        assert_eq!(
            Alignment::parse(&format!("[alignment]\n{six}")).unwrap(),
            bare
        );
        let json = r#"{"kind":"se3","x_mm":1.5,"y_mm":-2.0,"z_mm":0.0,"roll_deg":0.0,"pitch_deg":0.0,"yaw_deg":90.0}"#;
        assert_eq!(Alignment::parse(json).unwrap(), bare);
        let report = format!(r#"{{"version":"1","runs":[{{"run":"a","alignment":{json}}}]}}"#);
        assert_eq!(Alignment::parse(&report).unwrap(), bare);
        for bad in [
            "",
            "{",
            "x_mm = 1",
            r#"{"runs":[]}"#,
            "x_mm = nan",
            &six.replace("1.5", "inf"),
        ] {
            assert!(Alignment::parse(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn one_after_the_other_is_both() {
        let (a, b) = (
            moved([0.1, 0.2, 0.3], [1.0, 2.0, 3.0]),
            moved([-0.4, 0.1, 0.0], [0.0, 1.0, 0.0]),
        );
        let (mut one, mut angles) = ([0.3, 0.2, 0.1], [0.01, 0.02, 0.03]);
        let (mut both, mut both_angles) = (one, angles);
        a.apply(&mut one, &mut angles);
        b.apply(&mut one, &mut angles);
        a.then(&b).apply(&mut both, &mut both_angles);
        for k in 0..3 {
            assert!((one[k] - both[k]).abs() < 1e-12 && (angles[k] - both_angles[k]).abs() < 1e-12);
        }
    }
}
