//! Data sheets of the scanners that the kit knows.
//!
//! Sources: SICK LMS5xx operating instructions 8013796 and telegram listing 8014631 (valid pairs of
//! frequency and resolution, spot, errors); Kurniawan 2017, table of candidates (LMS200, Hokuyo
//! UTM-30LX); Hokuyo UTM-30LX specification.

use std::fmt;

/// A valid pair of scan frequency and angular resolution.
///
/// In an interlaced mode one revolution does not give the resolution: `interlace` scans in
/// succession, each with a step that many times as wide, start one resolution apart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScanMode {
    /// Revolutions a second, Hz.
    pub frequency_hz: f64,
    /// Angle from beam to beam is 1 deg * numerator / denominator.
    numerator: u32,
    denominator: u32,
    /// Scans that together have the resolution; 1: each has it.
    pub interlace: u32,
    /// The beams lie half a step after the grid that begins with the aperture.
    between: bool,
}

impl ScanMode {
    const fn new(frequency_hz: f64, numerator: u32, denominator: u32) -> ScanMode {
        ScanMode {
            frequency_hz,
            numerator,
            denominator,
            interlace: 1,
            between: false,
        }
    }

    const fn between(self) -> ScanMode {
        ScanMode {
            between: true,
            ..self
        }
    }

    const fn interlaced(self, interlace: u32) -> ScanMode {
        ScanMode { interlace, ..self }
    }

    /// Angle from beam to beam, of all scans of a sequence together, deg.
    pub fn resolution_deg(&self) -> f64 {
        f64::from(self.numerator) / f64::from(self.denominator)
    }

    /// Angle from beam to beam of one scan, deg.
    pub fn step_deg(&self) -> f64 {
        f64::from(self.numerator * self.interlace) / f64::from(self.denominator)
    }

    /// From the aperture's start to the first beam of the first scan, deg.
    pub fn first_beam_deg(&self) -> f64 {
        if self.between {
            0.5 * self.step_deg()
        } else {
            0.0
        }
    }

    /// Angle from beam to beam of one scan, rad.
    pub fn step_rad(&self) -> f64 {
        self.step_deg().to_radians()
    }
}

impl fmt::Display for ScanMode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} Hz/{:.4} deg",
            self.frequency_hz,
            self.resolution_deg()
        )?;
        match self.interlace {
            1 => Ok(()),
            scans => write!(f, " (interlaced {scans}x)"),
        }
    }
}

/// The beam's spot: a disc of `spot_m + divergence_rad * range` in diameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Optics {
    /// Diameter at the front screen, m.
    pub spot_m: f64,
    /// Growth with range, rad.
    pub divergence_rad: f64,
}

impl Optics {
    /// Diameter of the spot at a range, m.
    #[inline]
    pub fn diameter_m(&self, range_m: f64) -> f64 {
        self.spot_m + self.divergence_rad * range_m
    }
}

/// A scanner's data sheet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScannerModel {
    /// The name in `frame.toml` and on command lines.
    pub name: &'static str,
    /// First and last beam, deg (0 is to the device's right, 90 straight ahead).
    pub aperture_deg: [f64; 2],
    /// Every valid pair; the first is the default.
    pub modes: &'static [ScanMode],
    /// The beam's spot.
    pub optics: Optics,
    /// Smallest and largest range, m.
    pub range_m: [f64; 2],
    /// Standard deviation of a range: up to the first number (m) it is the second (m), and so on.
    pub noise: &'static [(f64, f64)],
}

// Modes 10 to 16 of the telegram listing are interlaced. It leaves two of them open: 100 Hz with 1/6
// deg (twofold or fourfold) and the frequency of 1/24 deg (25 or 100 Hz). Twofold, or at 100 Hz, they
// would need more than the 54 000 shots a second that no other mode exceeds.
// At 50 Hz with 1/3 deg a recorded LMS511 sent 570 beams from -4.8333 to 184.8333 deg.
const LMS5XX_MODES: &[ScanMode] = &[
    ScanMode::new(35.0, 1, 4),
    ScanMode::new(25.0, 1, 6),
    ScanMode::new(25.0, 1, 4),
    ScanMode::new(35.0, 1, 2),
    ScanMode::new(50.0, 1, 3).between(),
    ScanMode::new(50.0, 1, 2),
    ScanMode::new(75.0, 1, 2),
    ScanMode::new(75.0, 1, 1),
    ScanMode::new(100.0, 2, 3),
    ScanMode::new(100.0, 1, 1),
    ScanMode::new(50.0, 1, 6).interlaced(2),
    ScanMode::new(75.0, 1, 4).interlaced(2),
    ScanMode::new(100.0, 1, 6).interlaced(4),
    ScanMode::new(100.0, 1, 3).interlaced(2),
    ScanMode::new(100.0, 1, 2).interlaced(2),
    ScanMode::new(25.0, 1, 12).interlaced(4),
    ScanMode::new(25.0, 1, 24).interlaced(4),
];

const MODELS: &[ScannerModel] = &[
    ScannerModel {
        name: "lms511-hr",
        aperture_deg: [-5.0, 185.0],
        modes: LMS5XX_MODES,
        optics: Optics {
            spot_m: 0.0136,
            divergence_rad: 0.0047,
        },
        range_m: [0.2, 65.0],
        noise: &[(10.0, 0.007), (f64::INFINITY, 0.009)],
    },
    ScannerModel {
        name: "lms511-sr",
        aperture_deg: [-5.0, 185.0],
        modes: LMS5XX_MODES,
        optics: Optics {
            spot_m: 0.0136,
            divergence_rad: 0.0119,
        },
        range_m: [0.2, 65.0],
        noise: &[(10.0, 0.006), (20.0, 0.008), (f64::INFINITY, 0.014)],
    },
    ScannerModel {
        name: "lms200",
        aperture_deg: [0.0, 180.0],
        modes: &[
            ScanMode::new(37.5, 1, 2),
            ScanMode::new(75.0, 1, 1),
            ScanMode::new(18.75, 1, 4),
        ],
        optics: Optics {
            spot_m: 0.008,
            divergence_rad: 0.0044,
        },
        range_m: [0.1, 80.0],
        noise: &[(f64::INFINITY, 0.005)],
    },
    ScannerModel {
        name: "utm-30lx",
        aperture_deg: [-45.0, 225.0],
        modes: &[ScanMode::new(40.0, 1, 4)],
        optics: Optics {
            spot_m: 0.010,
            divergence_rad: 0.0065,
        },
        range_m: [0.1, 30.0],
        noise: &[(10.0, 0.010), (f64::INFINITY, 0.030)],
    },
];

impl ScannerModel {
    /// All known models.
    pub fn all() -> &'static [ScannerModel] {
        MODELS
    }

    /// The model of a name.
    pub fn by_name(name: &str) -> Option<&'static ScannerModel> {
        MODELS.iter().find(|model| model.name == name)
    }

    /// Standard deviation of one range by the data sheet, m.
    pub fn noise_m(&self, range_m: f64) -> f64 {
        let band = self.noise.iter().find(|(to_m, _)| range_m <= *to_m);
        band.map_or(f64::NAN, |(_, sigma_m)| *sigma_m)
    }

    /// The valid mode nearest to a wanted pair, if it is that pair (resolutions as people write
    /// them: 0.1667 is 1/6).
    pub fn mode(&self, frequency_hz: f64, resolution_deg: f64) -> Option<ScanMode> {
        self.modes.iter().copied().find(|mode| {
            (mode.frequency_hz - frequency_hz).abs() < 1e-6
                && (mode.resolution_deg() - resolution_deg).abs() < 1e-3
        })
    }

    /// The valid pairs that share the wanted frequency or resolution, or else all of them.
    pub fn neighbours(&self, frequency_hz: f64, resolution_deg: f64) -> Vec<ScanMode> {
        let near: Vec<ScanMode> = self
            .modes
            .iter()
            .copied()
            .filter(|mode| {
                (mode.frequency_hz - frequency_hz).abs() < 1e-6
                    || (mode.resolution_deg() - resolution_deg).abs() < 1e-3
            })
            .collect();
        if near.is_empty() {
            self.modes.to_vec()
        } else {
            near
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_are_looked_up_as_people_write_them() {
        let hr = ScannerModel::by_name("lms511-hr").unwrap();
        let mode = hr.mode(25.0, 0.1667).unwrap();
        assert!((mode.resolution_deg() - 1.0 / 6.0).abs() < 1e-15);
        assert!(hr.mode(35.0, 0.1667).is_none());
        let near = hr.neighbours(35.0, 0.1667);
        assert_eq!(near.len(), 5, "{near:?}");
        assert_eq!(hr.neighbours(1.0, 9.0).len(), hr.modes.len());
    }

    #[test]
    fn no_mode_of_the_lms5xx_fires_more_than_54_000_shots_a_second() {
        let hr = ScannerModel::by_name("lms511-hr").unwrap();
        for mode in hr.modes {
            let shots_hz = mode.frequency_hz * 360.0 / mode.step_deg();
            assert!(shots_hz < 54_000.0 + 1e-6, "{mode}: {shots_hz}");
        }
        let mode = hr.mode(100.0, 0.1667).unwrap();
        assert_eq!((mode.interlace, mode.step_deg()), (4, 2.0 / 3.0));
        assert_eq!(mode.to_string(), "100 Hz/0.1667 deg (interlaced 4x)");
        assert_eq!(hr.mode(50.0, 0.5).unwrap().interlace, 1);
        assert_eq!(hr.mode(25.0, 0.083).unwrap().step_deg(), 1.0 / 3.0);
        assert_eq!(hr.mode(25.0, 0.042).unwrap().step_deg(), 1.0 / 6.0);
    }

    #[test]
    fn spot_and_noise_by_range() {
        let hr = ScannerModel::by_name("lms511-hr").unwrap();
        assert!((hr.optics.diameter_m(30.0) - 0.1546).abs() < 1e-12);
        assert_eq!(hr.noise_m(5.0), 0.007);
        assert_eq!(hr.noise_m(15.0), 0.009);
    }
}
