//! `frame.toml`: reading it, checking it, saying which key is wrong.

use super::scanner_model::ScannerModel;
use super::toml_file::{self, ConfigError, Unsound};
use crate::record::Face;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// A frame file, checked.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Frame {
    /// What people call it.
    #[serde(default)]
    pub name: String,
    /// The box.
    #[serde(rename = "box")]
    pub bounds: FrameBox,
    /// Plain rectangular reflectors on the side faces.
    #[serde(default, rename = "plate")]
    pub plates: Vec<Plate>,
    /// Inclined reflectors with two parallel edges.
    #[serde(default, rename = "strip")]
    pub strips: Vec<Strip>,
    /// The scanner and its mounting on P.
    #[serde(default)]
    pub scanner: Scanner,
    /// The IMU's mounting on P.
    #[serde(default)]
    pub imu: Imu,
    /// What `solve-pose --calibrate` found.
    #[serde(default)]
    pub calibration: Calibration,
}

/// The frame's box: |x| <= dx/2, |y| <= dy/2, 0 <= z <= dz.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct FrameBox {
    /// Depth, m.
    pub dx_m: f64,
    /// Width, m.
    pub dy_m: f64,
    /// Height, m.
    pub dz_m: f64,
    /// How far behind every face the next surface is, m; none: nothing is behind.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub background_gap_m: Option<f64>,
}

/// A plain rectangular reflector on a side face.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Plate {
    /// The face.
    #[serde(with = "face_name")]
    pub face: Face,
    /// From and to along x, m.
    pub x_m: [f64; 2],
    /// From and to along z, m.
    pub z_m: [f64; 2],
}

/// An inclined reflector. Its edges are `v = offset +- width/2 + x tan(inclination)`, where v is y
/// on the upper face and z on a side face.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Strip {
    /// The face.
    #[serde(with = "face_name")]
    pub face: Face,
    /// Centre at x = 0 along y (upper) or z (sides), m.
    pub offset_m: f64,
    /// Width along y (upper) or z (sides), m.
    pub width_m: f64,
    /// Inclination against the x axis, deg.
    pub inclination_deg: f64,
    /// From and to along x, m; the whole depth where it is not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub x_m: Option<[f64; 2]>,
}

impl Strip {
    /// tan(inclination).
    pub fn slope(&self) -> f64 {
        self.inclination_deg.to_radians().tan()
    }
}

/// Where a device sits on P.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Mounting {
    /// Its origin in P, m.
    pub position_m: [f64; 3],
    /// Roll, pitch, yaw of its axes in P, deg.
    pub rotation_deg: [f64; 3],
}

/// The scanner and its mounting on P.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct Scanner {
    /// The data sheet's name.
    pub model: String,
    /// r_PS: its origin in P, m.
    pub position_m: [f64; 3],
    /// Roll, pitch, yaw of S in P, deg.
    pub rotation_deg: [f64; 3],
    /// From the zero index to the first beam, s.
    pub index_to_first_beam_s: f64,
}

impl Default for Scanner {
    fn default() -> Self {
        Scanner {
            model: "lms511-hr".to_owned(),
            position_m: [0.0; 3],
            rotation_deg: [0.0; 3],
            index_to_first_beam_s: 0.0,
        }
    }
}

/// The IMU's mounting: at zero its x is along P's x and its z along P's -z (NED, upright).
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct Imu {
    /// Roll, pitch, yaw of the IMU on P, deg.
    pub rotation_deg: [f64; 3],
}

/// Calibrated quantities, applied to the ranges and edges.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct Calibration {
    /// Added to the true range by the scanner, m.
    pub range_bias_m: f64,
    /// Measured range over true range.
    pub range_scale: f64,
    /// Share of the spot that must be on a reflector for a hit.
    pub hit_threshold: f64,
    /// True footprint over the data sheet's.
    pub footprint_scale: f64,
}

impl Default for Calibration {
    fn default() -> Self {
        Calibration {
            range_bias_m: 0.0,
            range_scale: 1.0,
            hit_threshold: 0.5,
            footprint_scale: 1.0,
        }
    }
}

impl Frame {
    /// Reads and checks a frame file.
    pub fn read(path: &Path) -> Result<Frame, ConfigError> {
        Ok(Frame::read_with_text(path)?.0)
    }

    /// Reads and checks a frame file; gives its text too.
    pub fn read_with_text(path: &Path) -> Result<(Frame, String), ConfigError> {
        let text = toml_file::read(path)?;
        Ok((Frame::parse(&text, path)?, text))
    }

    /// Parses and checks a frame file's text; `path` only names it in messages.
    pub fn parse(text: &str, path: &Path) -> Result<Frame, ConfigError> {
        toml_file::parse(text, path, Frame::check)
    }

    /// The scanner's data sheet.
    pub fn scanner_model(&self) -> &'static ScannerModel {
        // `check` has refused every other name.
        ScannerModel::by_name(&self.scanner.model).unwrap_or(&ScannerModel::all()[0])
    }

    /// The strips on a face, with their index in the file.
    pub fn strips_on(&self, face: Face) -> impl Iterator<Item = (usize, &Strip)> {
        self.strips
            .iter()
            .enumerate()
            .filter(move |(_, strip)| strip.face == face)
    }

    fn check(&self) -> Result<(), Unsound> {
        let fault = |key: String, why: String| Err((key, why));
        let b = &self.bounds;
        for (key, value) in [
            ("box.dx_m", b.dx_m),
            ("box.dy_m", b.dy_m),
            ("box.dz_m", b.dz_m),
        ] {
            if !(value.is_finite() && value > 0.0) {
                return fault(
                    key.into(),
                    format!("{value} is not a positive length in metres"),
                );
            }
        }
        if let Some(gap_m) = b.background_gap_m
            && !(gap_m.is_finite() && gap_m > 0.0)
        {
            return fault(
                "box.background_gap_m".into(),
                format!("{gap_m} is not a positive length; omit the key where nothing is behind"),
            );
        }
        let (half_x, half_y) = (b.dx_m / 2.0, b.dy_m / 2.0);
        let span = |key: String, [from, to]: [f64; 2], low: f64, high: f64, what: &str| {
            if !(from.is_finite() && to.is_finite() && from < to) {
                return Err((
                    key,
                    format!("[{from}, {to}] must go from a smaller to a larger number"),
                ));
            }
            if from < low - 1e-9 || to > high + 1e-9 {
                return Err((
                    key,
                    format!(
                        "[{from}, {to}] m is outside the box, whose {what} is [{low}, {high}] m"
                    ),
                ));
            }
            Ok(())
        };
        for (i, plate) in self.plates.iter().enumerate() {
            if plate.face == Face::Upper {
                return fault(
                    format!("plate[{i}].face"),
                    "a plate sits on \"right\" or \"left\"; use [[strip]] on the upper face".into(),
                );
            }
            span(
                format!("plate[{i}].x_m"),
                plate.x_m,
                -half_x,
                half_x,
                "depth",
            )?;
            span(format!("plate[{i}].z_m"), plate.z_m, 0.0, b.dz_m, "height")?;
        }
        for (i, strip) in self.strips.iter().enumerate() {
            let key = |name: &str| format!("strip[{i}].{name}");
            if !(strip.width_m.is_finite() && strip.width_m > 0.0) {
                return fault(
                    key("width_m"),
                    format!("{} is not a positive length", strip.width_m),
                );
            }
            if !(strip.inclination_deg.abs() < 80.0) {
                return fault(
                    key("inclination_deg"),
                    format!("{} must lie between -80 and 80 deg", strip.inclination_deg),
                );
            }
            let x_m = strip.x_m.unwrap_or([-half_x, half_x]);
            span(key("x_m"), x_m, -half_x, half_x, "depth")?;
            let (low, high, what) = match strip.face {
                Face::Upper => (-half_y, half_y, "width"),
                Face::Right | Face::Left => (0.0, b.dz_m, "height"),
            };
            if !strip.offset_m.is_finite() {
                return fault(
                    key("offset_m"),
                    format!("{} is not a number", strip.offset_m),
                );
            }
            let reach = strip.width_m / 2.0;
            for x in x_m {
                let centre = strip.offset_m + x * strip.slope();
                if centre - reach < low - 1e-9 || centre + reach > high + 1e-9 {
                    return fault(
                        key("offset_m"),
                        format!(
                            "at x = {x} m the strip covers [{:.3}, {:.3}] m, outside the box, whose \
                             {what} is [{low}, {high}] m",
                            centre - reach,
                            centre + reach
                        ),
                    );
                }
            }
        }
        self.check_strips_apart()?;
        if ScannerModel::by_name(&self.scanner.model).is_none() {
            let known: Vec<&str> = ScannerModel::all().iter().map(|model| model.name).collect();
            return fault(
                "scanner.model".into(),
                format!(
                    "\"{}\" is not known; one of {}",
                    self.scanner.model,
                    known.join(", ")
                ),
            );
        }
        let finite = [
            ("scanner.position_m", &self.scanner.position_m),
            ("scanner.rotation_deg", &self.scanner.rotation_deg),
            ("imu.rotation_deg", &self.imu.rotation_deg),
        ];
        for (key, values) in finite {
            if values.iter().any(|v| !v.is_finite()) {
                return fault(
                    key.into(),
                    format!("{values:?} has an entry that is not a number"),
                );
            }
        }
        let c = &self.calibration;
        if !(c.range_scale > 0.5 && c.range_scale < 2.0) {
            return fault(
                "calibration.range_scale".into(),
                format!("{} is not near 1", c.range_scale),
            );
        }
        if !(c.hit_threshold > 0.0 && c.hit_threshold < 1.0) {
            return fault(
                "calibration.hit_threshold".into(),
                format!("{} must lie between 0 and 1", c.hit_threshold),
            );
        }
        if !(c.footprint_scale > 0.1 && c.footprint_scale < 10.0) {
            return fault(
                "calibration.footprint_scale".into(),
                format!("{} is not near 1", c.footprint_scale),
            );
        }
        if !c.range_bias_m.is_finite() {
            return fault("calibration.range_bias_m".into(), "not a number".into());
        }
        Ok(())
    }
}

impl Frame {
    /// No two strips cover the same spot of a face.
    fn check_strips_apart(&self) -> Result<(), Unsound> {
        let half_x = self.bounds.dx_m / 2.0;
        for (i, a) in self.strips.iter().enumerate() {
            for (j, b) in self.strips.iter().enumerate().skip(i + 1) {
                let [a_x, b_x] = [a, b].map(|strip| strip.x_m.unwrap_or([-half_x, half_x]));
                let (from, to) = (a_x[0].max(b_x[0]), a_x[1].min(b_x[1]));
                if a.face != b.face || from >= to {
                    continue;
                }
                let apart = |x: f64| (a.offset_m - b.offset_m) + x * (a.slope() - b.slope());
                let (first, last) = (apart(from), apart(to));
                // The distance is linear in x: least at an end, or zero where it changes its sign.
                let least = if first * last <= 0.0 {
                    0.0
                } else {
                    first.abs().min(last.abs())
                };
                if least < (a.width_m + b.width_m) / 2.0 - 1e-9 {
                    let face = a.face.name();
                    let why = format!("overlaps strip[{j}] on the {face} face");
                    return Err((format!("strip[{i}]"), why));
                }
            }
        }
        Ok(())
    }
}

mod face_name {
    use crate::record::Face;
    use serde::{Deserialize, Deserializer, Serializer, de::Error};

    pub fn serialize<S: Serializer>(face: &Face, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(face.name())
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Face, D::Error> {
        let name = String::deserialize(deserializer)?;
        Face::from_name(name.as_bytes())
            .ok_or_else(|| D::Error::custom(format!("face \"{name}\" is not right, upper or left")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CABLAR: &str = include_str!("../../testdata/cablar.toml");

    fn fault(text: &str) -> String {
        Frame::parse(text, Path::new("frame.toml"))
            .unwrap_err()
            .to_string()
    }

    #[test]
    fn the_two_frames_are_valid() {
        let cablar = Frame::parse(CABLAR, Path::new("cablar.toml")).unwrap();
        assert_eq!(cablar.strips.len(), 4);
        assert_eq!(cablar.bounds.dy_m, 10.45);
        let inclined = include_str!("../../testdata/inclined.toml");
        let inclined = Frame::parse(inclined, Path::new("inclined.toml")).unwrap();
        assert_eq!(inclined.strips.len(), 12);
        assert_eq!(inclined.strips_on(Face::Left).count(), 4);
    }

    #[test]
    fn a_fault_names_its_key() {
        let outside = CABLAR.replace("offset_m = 3.90", "offset_m = 5.20");
        assert!(
            fault(&outside).contains("strip[0].offset_m"),
            "{}",
            fault(&outside)
        );
        let unknown = CABLAR.replace("dx_m", "depth");
        assert!(fault(&unknown).contains("depth"), "{}", fault(&unknown));
        let model = CABLAR.replace("lms511-hr", "lms9");
        assert!(fault(&model).contains("scanner.model"), "{}", fault(&model));
        let width = CABLAR.replacen("width_m = 0.80", "width_m = -1.0", 1);
        assert!(
            fault(&width).contains("strip[0].width_m"),
            "{}",
            fault(&width)
        );
        let text = CABLAR.replace("dz_m = 5.50", "dz_m = \"high\"");
        assert!(fault(&text).contains("dz_m"), "{}", fault(&text));
        let text = CABLAR.replacen("z_m = [0.20, 5.20]", "z_m = [0.20, \"a\"]", 1);
        let says = fault(&text);
        assert!(says.contains("plate[0].z_m: invalid type"), "{says}");
        let plate = CABLAR.replace("z_m = [0.20, 5.20]", "z_m = [0.20, 9.20]");
        assert!(fault(&plate).contains("plate[0].z_m"), "{}", fault(&plate));
    }

    #[test]
    fn strips_that_overlap_are_refused() {
        let strips = |second: &str| {
            let strip = "[[strip]]\nface = \"upper\"\nwidth_m = 0.8\ninclination_deg = ";
            let text = format!(
                "[box]\ndx_m = 1.5\ndy_m = 10\ndz_m = 5\n{strip}30.0\noffset_m = 1.0\n{strip}{second}\n"
            );
            Frame::parse(&text, Path::new("frame.toml"))
        };
        // Side by side, touching, crossing, and crossing only where one of them is not.
        assert!(strips("30.0\noffset_m = -0.5").is_ok());
        assert!(strips("30.0\noffset_m = 0.2").is_ok());
        assert!(strips("-30.0\noffset_m = 1.0\nx_m = [0.74, 0.75]").is_ok());
        for second in [
            "30.0\noffset_m = 0.21",
            "-30.0\noffset_m = 0.9",
            "-30.0\noffset_m = -0.2",
        ] {
            let says = strips(second).unwrap_err().to_string();
            assert!(
                says.contains("strip[0]") && says.contains("strip[1]"),
                "{says}"
            );
        }
    }
}
