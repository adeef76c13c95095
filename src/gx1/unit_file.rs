//! What must be known of a unit to read a recording of it: `NAME.unit.toml` beside `NAME.gx1`.
//!
//! The bytes themselves do not tell it: a cell's answer does not say which cell it is.

use super::command::Command;
use super::scale::{Gains, GainsError};
use super::session::Identity;
use super::ticks::{TickError, TickFactors};
use crate::link::RecordingError;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// The file's contents.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UnitFile {
    /// The firmware's number; absent where it could not be asked.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub firmware: Option<u16>,
    /// The serial number.
    pub serial: u16,
    /// Speed of the line, Bd.
    pub baud: u32,
    /// The commands by their bytes, the leading one first.
    pub commands: Vec<u8>,
    /// How often they were polled, Hz; absent where the first was streamed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub poll_hz: Option<f64>,
    /// Its address on RS-485; absent on RS-232.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bus_address: Option<u8>,
    /// Factors of the tick, cells 238, 240, 242, 246.
    pub tick_factors: [u16; 4],
    /// Gains, cells 230, 130, 232.
    pub accel_gain: u16,
    /// Cell 130.
    pub rate_gain: u16,
    /// Cell 232.
    pub mag_gain: u16,
}

/// Why a unit file is of no use.
#[derive(Debug, thiserror::Error)]
pub enum UnitFileError {
    /// It is no TOML of this kind.
    #[error("{0}")]
    Syntax(String),
    /// A command that does not exist or cannot be streamed.
    #[error("command 0x{0:02X} is no measurement")]
    Command(u8),
    /// Nothing was read from the unit.
    #[error("commands is empty: which replies are in the recording?")]
    NoCommand,
    /// A rate at which nothing can be asked.
    #[error("poll_hz is {0}: a number above 0 is wanted")]
    Rate(f64),
    /// Gains that make no sense.
    #[error(transparent)]
    Gains(#[from] GainsError),
    /// A tick that makes no sense.
    #[error(transparent)]
    Tick(#[from] TickError),
}

impl UnitFile {
    /// For a unit that was asked.
    pub fn new(identity: Identity, baud: u32, gains: Gains, tick: TickFactors) -> UnitFile {
        UnitFile {
            firmware: identity.firmware,
            serial: identity.serial,
            baud,
            commands: Vec::new(),
            poll_hz: None,
            bus_address: None,
            tick_factors: tick.0,
            accel_gain: gains.accel,
            rate_gain: gains.rate,
            mag_gain: gains.mag,
        }
    }

    /// Reads the text.
    ///
    /// # Errors
    /// [`UnitFileError`].
    pub fn parse(text: &str) -> Result<UnitFile, UnitFileError> {
        let file: UnitFile =
            toml::from_str(text).map_err(|error| UnitFileError::Syntax(error.to_string()))?;
        if file.measurements()?.is_empty() {
            return Err(UnitFileError::NoCommand);
        }
        if let Some(hz) = file.poll_hz
            && !(hz > 0.0 && hz.is_finite())
        {
            return Err(UnitFileError::Rate(hz));
        }
        Ok(file)
    }

    /// The text.
    pub fn text(&self) -> String {
        let head =
            "# What imu-read must know of the unit to read the recording beside this file.\n";
        // A plain table of numbers is always TOML.
        format!("{head}{}", toml::to_string(self).unwrap_or_default())
    }

    /// Writes it beside a recording.
    ///
    /// # Errors
    /// [`RecordingError`] with the name of this file.
    pub fn save_beside(&self, recording: &Path) -> Result<(), RecordingError> {
        let path = beside(recording);
        std::fs::write(&path, self.text()).map_err(|error| RecordingError::new(&path, &error))
    }

    /// The gains. They are looked at here and not when the file is read, for whoever states others.
    ///
    /// # Errors
    /// [`UnitFileError::Gains`].
    pub fn gains(&self) -> Result<Gains, UnitFileError> {
        let gains = Gains {
            accel: self.accel_gain,
            rate: self.rate_gain,
            mag: self.mag_gain,
        };
        Ok(gains.check()?)
    }

    /// The tick, likewise.
    ///
    /// # Errors
    /// [`UnitFileError::Tick`].
    pub fn tick(&self) -> Result<TickFactors, UnitFileError> {
        Ok(TickFactors(self.tick_factors).check()?)
    }

    /// The commands.
    ///
    /// # Errors
    /// [`UnitFileError::Command`].
    pub fn measurements(&self) -> Result<Vec<Command>, UnitFileError> {
        let command = |byte: &u8| {
            Command::from_byte(*byte)
                .filter(|command| command.is_measurement())
                .ok_or(UnitFileError::Command(*byte))
        };
        self.commands.iter().map(command).collect()
    }
}

/// The unit file of a recording: `run.unit.toml` for `run.gx1`, and for its parts `run.000.gx1` as
/// well.
pub fn beside(recording: &Path) -> PathBuf {
    let own = recording.with_extension("unit.toml");
    let stem = recording.file_stem().unwrap_or_default().to_string_lossy();
    match stem.rsplit_once('.') {
        Some((name, part))
            if !own.is_file() && part.len() >= 3 && part.bytes().all(|b| b.is_ascii_digit()) =>
        {
            recording.with_file_name(format!("{name}.unit.toml"))
        }
        _ => own,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn survives_its_text() {
        let identity = Identity {
            firmware: Some(3201),
            serial: 4021,
        };
        let mut file = UnitFile::new(identity, 38_400, Gains::FACTORY, TickFactors::FACTORY);
        file.commands = vec![0x31, 0x0E];
        assert_eq!(UnitFile::parse(&file.text()).unwrap(), file);
        file.poll_hz = Some(12.5);
        assert_eq!(UnitFile::parse(&file.text()).unwrap(), file);
        file.firmware = None;
        assert_eq!(UnitFile::parse(&file.text()).unwrap(), file);
        assert!(UnitFile::parse("baud = 3").is_err());
    }

    #[test]
    fn what_makes_no_sense_is_refused_by_name() {
        let identity = Identity {
            firmware: None,
            serial: 1,
        };
        let mut good = UnitFile::new(identity, 38_400, Gains::FACTORY, TickFactors::FACTORY);
        good.commands = vec![0x31];
        assert!(UnitFile::parse(&good.text()).is_ok());
        let refused = |change: fn(&mut UnitFile)| {
            let mut file = good.clone();
            change(&mut file);
            UnitFile::parse(&file.text()).unwrap_err().to_string()
        };
        for (why, name) in [
            (refused(|file| file.commands = vec![0x10]), "0x10"),
            (refused(|file| file.commands.clear()), "commands"),
            (refused(|file| file.poll_hz = Some(0.0)), "poll_hz"),
            (refused(|file| file.poll_hz = Some(f64::NAN)), "poll_hz"),
        ] {
            assert!(why.contains(name), "{name}: {why}");
        }
    }

    #[test]
    fn senseless_gains_and_ticks_are_no_ones_that_are_asked_for() {
        let identity = Identity {
            firmware: None,
            serial: 1,
        };
        let good = UnitFile::new(identity, 38_400, Gains::FACTORY, TickFactors::FACTORY);
        assert_eq!(good.gains().unwrap(), Gains::FACTORY);
        assert_eq!(good.tick().unwrap(), TickFactors::FACTORY);
        let mut bad = good.clone();
        bad.accel_gain = 0;
        assert!(bad.gains().unwrap_err().to_string().contains("cell 230"));
        bad.accel_gain = Gains::FACTORY.accel;
        bad.rate_gain = 64;
        assert!(bad.gains().unwrap_err().to_string().contains("3DM-G"));
        bad.tick_factors[3] = 0;
        let why = bad.tick().unwrap_err().to_string();
        assert!(why.contains("tick factors"), "{why}");
    }

    #[test]
    fn parts_share_one() {
        assert_eq!(beside(Path::new("d/run.gx1")), Path::new("d/run.unit.toml"));
        assert_eq!(
            beside(Path::new("d/run.007.gx1")),
            Path::new("d/run.unit.toml")
        );
        assert_eq!(
            beside(Path::new("d/run.7.gx1")),
            Path::new("d/run.7.unit.toml")
        );
    }
}
