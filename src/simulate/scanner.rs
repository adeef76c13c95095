//! The scanner's beams: their angles and when they fire.

use super::rotation;
use crate::frame::{Frame, ScanMode, ScannerModel};
use nalgebra::{Rotation3, Vector3};
use std::f64::consts::{FRAC_PI_2, TAU};

/// Why a scanner cannot run as asked.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ModeError {
    /// The model is not known.
    #[error("scanner model \"{name}\" is not known; one of {known}")]
    Model {
        /// As asked.
        name: String,
        /// All names.
        known: String,
    },
    /// The model has no such mode.
    #[error("{model} has no mode {asked}; valid neighbours: {valid}")]
    Mode {
        /// The model.
        model: &'static str,
        /// As asked.
        asked: String,
        /// Modes that share the frequency or the resolution.
        valid: String,
    },
}

/// A scanner in one of its modes, mounted on P.
#[derive(Clone, Debug)]
pub struct Scanner {
    /// The data sheet.
    pub model: &'static ScannerModel,
    /// Frequency and resolution.
    pub mode: ScanMode,
    /// r_PS, m.
    position_m: Vector3<f64>,
    /// S in P.
    rotation: Rotation3<f64>,
    /// The scan's place in its sequence; 0 unless the mode is interlaced.
    place: u32,
    /// Beam directions in P.
    beams: Vec<Vector3<f64>>,
}

/// The model of a name, or the frame's.
pub fn model(frame: &Frame, name: Option<&str>) -> Result<&'static ScannerModel, ModeError> {
    let Some(name) = name else {
        return Ok(frame.scanner_model());
    };
    ScannerModel::by_name(name).ok_or_else(|| {
        let names: Vec<&str> = ScannerModel::all().iter().map(|m| m.name).collect();
        ModeError::Model {
            name: name.to_owned(),
            known: names.join(", "),
        }
    })
}

/// The mode with the given frequency and resolution; where one is not given, the model's first that
/// has the other; where neither is, its first.
pub fn mode(
    model: &'static ScannerModel,
    frequency_hz: Option<f64>,
    resolution_deg: Option<f64>,
) -> Result<ScanMode, ModeError> {
    let fits = |mode: &&ScanMode| {
        let (frequency, resolution) = (mode.frequency_hz, mode.resolution_deg());
        model
            .mode(
                frequency_hz.unwrap_or(frequency),
                resolution_deg.unwrap_or(resolution),
            )
            .is_some_and(|found| found == **mode)
    };
    if let Some(mode) = model.modes.iter().find(fits) {
        return Ok(*mode);
    }
    let asked = [
        frequency_hz.map(|hz| format!("{hz} Hz")),
        resolution_deg.map(|deg| format!("{deg} deg")),
    ];
    let neighbours = model.neighbours(
        frequency_hz.unwrap_or(f64::NAN),
        resolution_deg.unwrap_or(f64::NAN),
    );
    let valid: Vec<String> = neighbours.iter().map(ToString::to_string).collect();
    Err(ModeError::Mode {
        model: model.name,
        asked: asked.into_iter().flatten().collect::<Vec<_>>().join("/"),
        valid: valid.join(", "),
    })
}

impl Scanner {
    /// The frame's mounting with a model and a mode.
    pub fn new(frame: &Frame, model: &'static ScannerModel, mode: ScanMode) -> Scanner {
        let mut scanner = Scanner {
            model,
            mode,
            position_m: Vector3::from(frame.scanner.position_m),
            rotation: rotation::attitude_deg(frame.scanner.rotation_deg).to_rotation_matrix(),
            place: 0,
            beams: Vec::new(),
        };
        scanner.go_to(0);
        scanner.aim(0.0);
        scanner
    }

    /// Angle by which the scan's first beam comes after the aperture's start, deg.
    fn lead_deg(&self) -> f64 {
        self.mode.first_beam_deg() + f64::from(self.place) * self.mode.resolution_deg()
    }

    /// Number of beams.
    pub fn count(&self) -> usize {
        self.beams.len()
    }

    /// Angle of the first beam, rad.
    pub fn angle_min_rad(&self) -> f64 {
        (self.model.aperture_deg[0] + self.lead_deg()).to_radians()
    }

    /// Angle of a beam as the device states it, rad.
    pub fn angle_rad(&self, beam: usize) -> f64 {
        self.angle_min_rad() + beam as f64 * self.mode.step_rad()
    }

    /// From beam to beam, s: increment / (2 pi f).
    pub fn time_increment_s(&self) -> f64 {
        self.mode.step_rad() / (TAU * self.mode.frequency_hz)
    }

    /// From scan to scan, s: the mirror turns on outside the field of view.
    pub fn period_s(&self) -> f64 {
        1.0 / self.mode.frequency_hz
    }

    /// From the instant at which the mirror passes the aperture's start to the first beam, s.
    pub fn lead_s(&self) -> f64 {
        self.lead_deg() / 360.0 / self.mode.frequency_hz
    }

    /// From the first beam to the reference instant, when the beam at 90 degrees fires (or would,
    /// where the angles miss it), s.
    pub fn reference_s(&self) -> f64 {
        (FRAC_PI_2 - self.angle_min_rad()) / self.mode.step_rad() * self.time_increment_s()
    }

    /// From the first beam to the last, s.
    pub fn sweep_s(&self) -> f64 {
        (self.count() - 1) as f64 * self.time_increment_s()
    }

    /// Goes to scan `number` of an interlaced sequence.
    pub fn go_to(&mut self, number: u64) {
        self.place = (number % u64::from(self.mode.interlace)) as u32;
        let [first_deg, last_deg] = self.model.aperture_deg;
        let room_deg = last_deg - first_deg - self.lead_deg();
        let steps = (room_deg / self.mode.step_deg() + 1e-9).floor() as usize;
        self.beams.resize(steps + 1, Vector3::zeros());
    }

    /// Turns all beams by `offset_rad` against the angles that the device states.
    pub fn aim(&mut self, offset_rad: f64) {
        let (first, step) = (self.angle_min_rad(), self.mode.step_rad());
        for (k, beam) in self.beams.iter_mut().enumerate() {
            let (sin, cos) = libm::sincos(first + k as f64 * step + offset_rad);
            *beam = self.rotation * Vector3::new(0.0, cos, sin);
        }
    }

    /// Origin of the beams in P, m.
    pub fn origin_m(&self) -> Vector3<f64> {
        self.position_m
    }

    /// Directions of the beams in P, unit vectors.
    pub fn beams(&self) -> &[Vector3<f64>] {
        &self.beams
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn frame() -> Frame {
        let text = include_str!("../../testdata/cablar.toml");
        Frame::parse(text, Path::new("cablar.toml")).unwrap()
    }

    #[test]
    fn beams_of_every_mode() {
        let frame = frame();
        let hr = model(&frame, None).unwrap();
        let counts: Vec<usize> = hr
            .modes
            .iter()
            .map(|mode| Scanner::new(&frame, hr, *mode).count())
            .collect();
        let plain = [761, 1141, 761, 381, 570, 381, 381, 191, 286, 191];
        let interlaced = [571, 381, 286, 286, 191, 571, 1141];
        assert_eq!(counts, [&plain[..], &interlaced[..]].concat());
        let utm = model(&frame, Some("utm-30lx")).unwrap();
        assert_eq!(Scanner::new(&frame, utm, utm.modes[0]).count(), 1081);
        let lms200 = model(&frame, Some("lms200")).unwrap();
        assert_eq!(Scanner::new(&frame, lms200, lms200.modes[0]).count(), 361);
        // As recorded: from -4.8333 to 184.8333 deg.
        let between = Scanner::new(&frame, hr, hr.mode(50.0, 0.3333).unwrap());
        assert!((between.angle_rad(0).to_degrees() + 29.0 / 6.0).abs() < 1e-9);
        assert!((between.angle_rad(569).to_degrees() - 1109.0 / 6.0).abs() < 1e-9);
        let reference_s = between.lead_s() + between.reference_s();
        assert!((reference_s * 50.0 - 95.0 / 360.0).abs() < 1e-12);
        let scanner = Scanner::new(&frame, hr, hr.modes[0]);
        // 35 Hz: 1440 steps a revolution, 380 of them up to 90 deg.
        assert!((scanner.time_increment_s() - 1.0 / 35.0 / 1440.0).abs() < 1e-18);
        assert!((scanner.reference_s() - 380.0 / 35.0 / 1440.0).abs() < 1e-15);
        assert!((scanner.angle_rad(380) - FRAC_PI_2).abs() < 1e-12);
        assert!((scanner.beams()[380] - Vector3::z()).norm() < 1e-12);
    }

    #[test]
    fn the_scans_of_an_interlaced_sequence_make_up_the_resolution() {
        let frame = frame();
        let hr = model(&frame, None).unwrap();
        for mode in hr.modes.iter().filter(|mode| mode.interlace > 1) {
            let mut scanner = Scanner::new(&frame, hr, *mode);
            let first = scanner.count();
            let mut angles_deg = Vec::new();
            for number in 0..u64::from(mode.interlace) {
                scanner.go_to(number);
                // The first of a sequence has one beam more (telegram listing).
                assert_eq!(scanner.count(), first - usize::from(number > 0), "{mode}");
                let beams = 0..scanner.count();
                angles_deg.extend(beams.map(|k| scanner.angle_rad(k).to_degrees()));
                // The beam at 90 deg fires a quarter of a turn and 5 deg after the aperture's
                // start, whichever scan it is.
                let reference_s = scanner.lead_s() + scanner.reference_s();
                assert!((reference_s * mode.frequency_hz - 95.0 / 360.0).abs() < 1e-12);
            }
            angles_deg.sort_by(f64::total_cmp);
            assert_eq!(
                angles_deg.len() as f64,
                (190.0 / mode.resolution_deg()).round() + 1.0
            );
            for (k, angle_deg) in angles_deg.iter().enumerate() {
                let due_deg = -5.0 + k as f64 * mode.resolution_deg();
                assert!(
                    (angle_deg - due_deg).abs() < 1e-9,
                    "{mode}: {angle_deg} {due_deg}"
                );
            }
            scanner.go_to(u64::from(mode.interlace));
            assert_eq!((scanner.count(), scanner.lead_s()), (first, 0.0));
        }
    }

    #[test]
    fn modes_are_found_or_refused_with_neighbours() {
        let hr = model(&frame(), None).unwrap();
        assert_eq!(mode(hr, None, None).unwrap().frequency_hz, 35.0);
        assert_eq!(mode(hr, Some(75.0), None).unwrap().resolution_deg(), 0.5);
        assert_eq!(mode(hr, Some(100.0), None).unwrap().interlace, 1);
        assert_eq!(mode(hr, None, Some(0.3333)).unwrap().frequency_hz, 50.0);
        let error = mode(hr, Some(35.0), Some(0.1667)).unwrap_err().to_string();
        assert!(error.contains("35 Hz/0.1667 deg"), "{error}");
        assert!(error.contains("25 Hz/0.1667 deg") && error.contains("35 Hz/0.2500 deg"));
        let error = model(&frame(), Some("lms9")).unwrap_err().to_string();
        assert!(error.contains("utm-30lx"), "{error}");
    }
}
