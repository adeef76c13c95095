//! The pairs of frequency and resolution that an LMS5xx can be set to.
//!
//! Source: SICK telegram listing 8014631, table of `mCLsetscancfglist`; some of its editions print
//! 75 Hz wrongly.

use crate::sick::angles::true_step_deg;
use std::fmt;

/// One pair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mode {
    /// Scan frequency, 1/100 Hz.
    pub frequency: u32,
    /// Angle from beam to beam, 1e-4 deg, rounded as the device does.
    pub resolution: u16,
    /// Scans whose beams lie between each other's; 1 is an ordinary mode.
    pub interlaced: u8,
}

const fn mode(frequency_hz: u32, resolution: u16, interlaced: u8) -> Mode {
    Mode {
        frequency: frequency_hz * 100,
        resolution,
        interlaced,
    }
}

/// The pairs of an LMS5xx PRO. A Lite has 25, 50 and 75 Hz with 0.25, 0.5 and 1 deg only.
pub const MODES: [Mode; 17] = [
    mode(25, 1667, 1),
    mode(25, 2500, 1),
    mode(35, 2500, 1),
    mode(35, 5000, 1),
    mode(50, 3333, 1),
    mode(50, 5000, 1),
    mode(75, 5000, 1),
    mode(75, 10_000, 1),
    mode(100, 6667, 1),
    mode(100, 10_000, 1),
    mode(50, 1667, 2),
    mode(75, 2500, 2),
    mode(100, 1667, 2),
    mode(100, 3333, 2),
    mode(100, 5000, 2),
    mode(25, 833, 4),
    mode(25, 417, 4),
];

/// How far what is typed may be from a mode's value: 0.33 for 1/3.
const TYPED: f64 = 0.02;

/// A pair that no LMS5xx has.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{frequency_hz} Hz with {resolution_deg} deg is no mode of an LMS5xx; near it are {near}")]
pub struct NoMode {
    frequency_hz: f64,
    resolution_deg: f64,
    near: String,
}

impl Mode {
    /// The mode that is meant.
    ///
    /// # Errors
    /// Names the modes near by.
    pub fn find(frequency_hz: f64, resolution_deg: f64) -> Result<Mode, NoMode> {
        let is = |value: f64, typed: f64| (value / typed - 1.0).abs() <= TYPED;
        let fits_frequency = |mode: &Mode| is(mode.frequency_hz(), frequency_hz);
        let fits_resolution = |mode: &Mode| is(mode.resolution_deg(), resolution_deg);
        if let Some(mode) = MODES
            .iter()
            .find(|mode| fits_frequency(mode) && fits_resolution(mode))
        {
            return Ok(*mode);
        }
        let mut near: Vec<Mode> = MODES
            .into_iter()
            .filter(|mode| fits_frequency(mode) || fits_resolution(mode))
            .collect();
        if near.is_empty() {
            let distance = |mode: &Mode| {
                let frequency = (mode.frequency_hz() / frequency_hz).ln().abs();
                frequency + (mode.resolution_deg() / resolution_deg).ln().abs()
            };
            near = MODES.to_vec();
            near.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
            near.truncate(3);
        }
        let near: Vec<String> = near.iter().map(ToString::to_string).collect();
        Err(NoMode {
            frequency_hz,
            resolution_deg,
            near: near.join(", "),
        })
    }

    /// Scan frequency, Hz.
    pub fn frequency_hz(&self) -> f64 {
        f64::from(self.frequency) / 100.0
    }

    /// Angle from beam to beam, deg, freed of the rounding.
    pub fn resolution_deg(&self) -> f64 {
        true_step_deg(self.resolution)
    }
}

impl fmt::Display for Mode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let resolution = format!("{:.4}", self.resolution_deg());
        let resolution = resolution.trim_end_matches('0').trim_end_matches('.');
        write!(f, "{} Hz {resolution} deg", self.frequency_hz())?;
        match self.interlaced {
            1 => Ok(()),
            times => write!(f, " (interlaced {times}x)"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_mode_is_found_as_people_write_it() {
        for mode in MODES {
            let found = Mode::find(mode.frequency_hz(), mode.resolution_deg());
            assert_eq!(found, Ok(mode));
            let rounded = (mode.resolution_deg() * 1e3).round() / 1e3;
            assert_eq!(Mode::find(mode.frequency_hz(), rounded), Ok(mode), "{mode}");
        }
        assert_eq!(Mode::find(50.0, 0.33).unwrap().resolution, 3333);
    }

    #[test]
    fn others_are_refused_with_what_is_near() {
        let text =
            |frequency, resolution| Mode::find(frequency, resolution).unwrap_err().to_string();
        assert!(text(35.0, 1.0).contains("35 Hz 0.25 deg, 35 Hz 0.5 deg, 75 Hz 1 deg"));
        assert!(text(40.0, 0.4).contains("50 Hz 0.3333 deg"));
        assert!(text(25.0, 1.0).contains("25 Hz 0.0833 deg (interlaced 4x)"));
    }
}
