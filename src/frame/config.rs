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

    /// From and to along x, m: the whole depth of the box where nothing else is said.
    pub fn x_span_m(&self, bounds: &FrameBox) -> [f64; 2] {
        let [depth_m, _, _] = bounds.spans_m();
        self.x_m.unwrap_or(depth_m)
    }
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
        self.bounds.check()?;
        for (i, plate) in self.plates.iter().enumerate() {
            plate.check(i, &self.bounds)?;
        }
        for (i, strip) in self.strips.iter().enumerate() {
            strip.check(i, &self.bounds)?;
        }
        self.check_strips_apart()?;
        self.scanner.check()?;
        check_finite("imu.rotation_deg", &self.imu.rotation_deg)?;
        self.calibration.check()
    }

    /// No two strips cover the same spot of a face.
    fn check_strips_apart(&self) -> Result<(), Unsound> {
        for (i, a) in self.strips.iter().enumerate() {
            for (j, b) in self.strips.iter().enumerate().skip(i + 1) {
                let [a_x, b_x] = [a, b].map(|strip| strip.x_span_m(&self.bounds));
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
                if least < (a.width_m + b.width_m) / 2.0 - ROUNDING_M {
                    let face = a.face.name();
                    let why = format!("overlaps strip[{j}] on the {face} face");
                    return Err((format!("strip[{i}]"), why));
                }
            }
        }
        Ok(())
    }
}

/// Lengths beyond this are not those of a hall, m: somebody meant millimetres.
const LONGEST_M: f64 = 1000.0;
/// A reflector may reach out of its face by this, m: sums of rounded lengths do.
const ROUNDING_M: f64 = 1e-9;

impl FrameBox {
    fn check(&self) -> Result<(), Unsound> {
        let is_length = |length_m: f64| length_m > 0.0 && length_m <= LONGEST_M;
        for (key, length_m) in [
            ("box.dx_m", self.dx_m),
            ("box.dy_m", self.dy_m),
            ("box.dz_m", self.dz_m),
        ] {
            if !is_length(length_m) {
                let why = format!("{length_m} is not a length above 0 and up to {LONGEST_M} m");
                return Err((key.to_owned(), why));
            }
        }
        match self.background_gap_m {
            Some(gap_m) if !is_length(gap_m) => {
                let why = format!(
                    "{gap_m} is not a length above 0 and up to {LONGEST_M} m; omit the key where \
                     nothing is behind"
                );
                Err(("box.background_gap_m".to_owned(), why))
            }
            _ => Ok(()),
        }
    }

    /// From and to along x, y and z, m.
    fn spans_m(&self) -> [[f64; 2]; 3] {
        let (half_x, half_y) = (self.dx_m / 2.0, self.dy_m / 2.0);
        [[-half_x, half_x], [-half_y, half_y], [0.0, self.dz_m]]
    }
}

impl Plate {
    fn check(&self, index: usize, bounds: &FrameBox) -> Result<(), Unsound> {
        let key = |name: &str| format!("plate[{index}].{name}");
        if self.face == Face::Upper {
            let why = "a plate sits on \"right\" or \"left\"; use [[strip]] on the upper face";
            return Err((key("face"), why.to_owned()));
        }
        let [depth_m, _, height_m] = bounds.spans_m();
        check_span(key("x_m"), self.x_m, depth_m, "depth")?;
        check_span(key("z_m"), self.z_m, height_m, "height")
    }
}

impl Strip {
    fn check(&self, index: usize, bounds: &FrameBox) -> Result<(), Unsound> {
        let key = |name: &str| format!("strip[{index}].{name}");
        if !(self.width_m.is_finite() && self.width_m > 0.0) {
            let why = format!("{} is not a positive length", self.width_m);
            return Err((key("width_m"), why));
        }
        if !(self.inclination_deg.abs() < 80.0) {
            let why = format!("{} must lie between -80 and 80 deg", self.inclination_deg);
            return Err((key("inclination_deg"), why));
        }
        let [depth_m, width_m, height_m] = bounds.spans_m();
        let x_m = self.x_span_m(bounds);
        check_span(key("x_m"), x_m, depth_m, "depth")?;
        if !self.offset_m.is_finite() {
            let why = format!("{} is not a number", self.offset_m);
            return Err((key("offset_m"), why));
        }
        let ([low, high], what) = match self.face {
            Face::Upper => (width_m, "width"),
            Face::Right | Face::Left => (height_m, "height"),
        };
        for x in x_m {
            let centre = self.offset_m + x * self.slope();
            let [from, to] = [-0.5, 0.5].map(|side| centre + side * self.width_m);
            if from < low - ROUNDING_M || to > high + ROUNDING_M {
                let why = format!(
                    "at x = {x} m the strip covers [{from:.3}, {to:.3}] m, outside the box, whose \
                     {what} is [{low}, {high}] m"
                );
                return Err((key("offset_m"), why));
            }
        }
        Ok(())
    }
}

impl Scanner {
    fn check(&self) -> Result<(), Unsound> {
        if ScannerModel::by_name(&self.model).is_none() {
            let known: Vec<&str> = ScannerModel::all().iter().map(|model| model.name).collect();
            let why = format!(
                "\"{}\" is not known; one of {}",
                self.model,
                known.join(", ")
            );
            return Err(("scanner.model".to_owned(), why));
        }
        check_finite("scanner.position_m", &self.position_m)?;
        check_finite("scanner.rotation_deg", &self.rotation_deg)?;
        check_finite(
            "scanner.index_to_first_beam_s",
            &[self.index_to_first_beam_s],
        )
    }
}

impl Calibration {
    fn check(&self) -> Result<(), Unsound> {
        let fault = |key: &str, why: String| Err((format!("calibration.{key}"), why));
        if !self.range_bias_m.is_finite() {
            return fault("range_bias_m", "not a number".to_owned());
        }
        if !(self.range_scale > 0.5 && self.range_scale < 2.0) {
            return fault("range_scale", format!("{} is not near 1", self.range_scale));
        }
        if !(self.hit_threshold > 0.0 && self.hit_threshold < 1.0) {
            let why = format!("{} must lie between 0 and 1", self.hit_threshold);
            return fault("hit_threshold", why);
        }
        if !(self.footprint_scale > 0.1 && self.footprint_scale < 10.0) {
            let why = format!("{} is not near 1", self.footprint_scale);
            return fault("footprint_scale", why);
        }
        Ok(())
    }
}

/// A span goes from a smaller to a larger number, within the box; `what` is the box's in words.
fn check_span(
    key: String,
    [from, to]: [f64; 2],
    [low, high]: [f64; 2],
    what: &str,
) -> Result<(), Unsound> {
    if !(from.is_finite() && to.is_finite() && from < to) {
        let why = format!("[{from}, {to}] must go from a smaller to a larger number");
        return Err((key, why));
    }
    if from < low - ROUNDING_M || to > high + ROUNDING_M {
        let why = format!("[{from}, {to}] m is outside the box, whose {what} is [{low}, {high}] m");
        return Err((key, why));
    }
    Ok(())
}

fn check_finite(key: &str, values: &[f64]) -> Result<(), Unsound> {
    if values.iter().all(|v| v.is_finite()) {
        return Ok(());
    }
    let why = format!("{values:?} has an entry that is not a number");
    Err((key.to_owned(), why))
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
        let text = CABLAR.replace(
            "position_m = [0.0,",
            "index_to_first_beam_s = inf\nposition_m = [0.0,",
        );
        assert!(
            fault(&text).contains("scanner.index_to_first_beam_s"),
            "{}",
            fault(&text)
        );
    }

    /// Everything that is sized by the box (the search for the lines has a cell every 4 cm) would
    /// take the memory for it.
    #[test]
    fn a_box_is_no_larger_than_any_hall() {
        for (key, value) in [
            ("dy_m = 10.45", "10450"),
            ("dx_m = 1.50", "inf"),
            ("dz_m = 5.50", "0"),
        ] {
            let name = key.split(' ').next().unwrap();
            let says = fault(&CABLAR.replace(key, &format!("{name} = {value}")));
            assert!(
                says.contains(&format!("box.{name}: {value} is not a length")),
                "{says}"
            );
        }
        let says = fault(&CABLAR.replace("background_gap_m = 0.70", "background_gap_m = 1e300"));
        assert!(says.contains("box.background_gap_m: 1"), "{says}");
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
