//! `--configure`: what the scanner is to be set to.

use super::NAME;
use crate::sick::client::commands::EchoFilter;
use crate::sick::client::configure::{APERTURE, Present, Wanted};
use crate::sick::client::modes::Mode;
use crate::sick::cola::Dialect;
use crate::stream::{Fault, Outcome};
use crate::tool::password;
use crate::tool::values::positive;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use std::io::Write;
use std::path::PathBuf;

/// What the scanner is set to before the capture.
#[derive(Clone, Debug, Default, clap::Args)]
#[command(
    next_help_heading = "Configuration (with --configure; the device is not changed otherwise)"
)]
#[group(id = "configuration", multiple = true, requires = "configure")]
pub struct ConfigureArgs {
    /// Set the scanner as the following options say, log in for it, and read everything back
    #[arg(long)]
    pub configure: bool,
    /// Scan frequency; goes with --resolution-deg
    #[arg(long, value_name = "HZ", requires = "resolution_deg", value_parser = parse_fraction)]
    pub frequency_hz: Option<f64>,
    /// Angle from beam to beam; goes with --frequency-hz
    #[arg(long, value_name = "DEG", requires = "frequency_hz", value_parser = parse_fraction)]
    pub resolution_deg: Option<f64>,
    /// First and last angle that are sent, within -5 and 185
    #[arg(long, value_name = "FROM,TO", allow_hyphen_values = true, value_parser = parse_range)]
    pub range_deg: Option<[i32; 2]>,
    /// Which echoes are sent
    #[arg(long, value_enum, value_name = "WHICH")]
    pub echoes: Option<Echoes>,
    /// Whether remissions are sent
    #[arg(long, value_name = "ON|OFF", value_parser = on_off(), hide_possible_values = true)]
    pub remission: Option<bool>,
    /// Scans to a mean, 2 to 100; 1 switches the filter off
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=100))]
    pub mean_scans: Option<u16>,
    /// The particle filter
    #[arg(long, value_name = "ON|OFF", value_parser = on_off(), hide_possible_values = true)]
    pub particle_filter: Option<bool>,
    /// Send every N-th scan
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=50_000))]
    pub divider: Option<u16>,
    /// Whether encoder values are sent
    #[arg(long, value_name = "ON|OFF", value_parser = on_off(), hide_possible_values = true)]
    pub encoder: Option<bool>,
    /// Whether the device's calendar time is sent
    #[arg(long, value_name = "ON|OFF", value_parser = on_off(), hide_possible_values = true)]
    pub time_block: Option<bool>,
    /// Start the measurement where it has been switched off
    #[arg(long)]
    pub start: bool,
    /// Keep the parameters over power-off (EEPROM)
    #[arg(long)]
    pub save: bool,
    /// Print the telegrams and connect to nothing
    #[arg(long)]
    pub dry_run: bool,
    /// File with the password's hash, 8 hexadecimal digits [default: CABLEPOSE_PASSWORD, or that of delivery]
    #[arg(long, value_name = "FILE")]
    pub password_file: Option<PathBuf>,
}

/// Which echoes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Echoes {
    /// The first
    First,
    /// All, up to five
    All,
    /// The last, as delivered
    Last,
}

/// What is to be set, and the hash that opens the device.
#[derive(Clone, Debug)]
pub(super) struct Plan {
    pub(super) wanted: Wanted,
    pub(super) hash: u32,
}

impl ConfigureArgs {
    /// The plan; none without `--configure`.
    ///
    /// # Errors
    /// A pair that no scanner has, nothing to set (2), or a password that cannot be read (66, 78).
    pub(super) fn plan(&self) -> anyhow::Result<Option<Plan>> {
        if !self.configure {
            return Ok(None);
        }
        let mode = match (self.frequency_hz, self.resolution_deg) {
            (Some(frequency_hz), Some(resolution_deg)) => Some(
                Mode::find(frequency_hz, resolution_deg)
                    .map_err(|error| Fault::Usage(error.to_string()))?,
            ),
            _ => None,
        };
        let wanted = Wanted {
            mode,
            range: self.range_deg,
            echoes: self.echoes.map(|echoes| match echoes {
                Echoes::First => EchoFilter::First,
                Echoes::All => EchoFilter::All,
                Echoes::Last => EchoFilter::Last,
            }),
            remission: self.remission,
            time: self.time_block,
            encoder: self.encoder,
            every: self.divider,
            mean: self.mean_scans,
            particle: self.particle_filter,
            start: self.start,
            save: self.save,
        };
        if wanted == Wanted::default() {
            let text = "--configure: nothing to set; give --frequency-hz, --range-deg or others";
            return Err(Fault::Usage(text.into()).into());
        }
        Ok(Some(Plan {
            wanted,
            hash: password::hash(self.password_file.as_deref())?,
        }))
    }
}

impl Plan {
    /// Prints the telegrams, as CoLa A text and, but for the password, as CoLa B bytes.
    pub(super) fn print(&self) -> anyhow::Result<Outcome> {
        let mut out = std::io::stdout().lock();
        let requests = self.wanted.requests(&Present::default(), self.hash);
        for request in requests {
            if request.name() == "SetAccessMode" {
                writeln!(out, "{request}")?;
                continue;
            }
            let mut bytes = Vec::new();
            request.encode(Dialect::Binary, &mut bytes);
            let hex: Vec<String> = bytes.iter().map(|byte| format!("{byte:02X}")).collect();
            writeln!(out, "{request}\n    {}", hex.join(" "))?;
        }
        if self.wanted.range.is_some() && self.wanted.mode.is_none() {
            eprintln!(
                "{NAME}: frequency and resolution, as read from the device, are set again after Run"
            );
        }
        Ok(Outcome::Done)
    }
}

fn on_off() -> impl TypedValueParser<Value = bool> {
    PossibleValuesParser::new(["on", "off"]).map(|text| text == "on")
}

/// Reads a positive number or a fraction of two: 0.5, 1/3.
fn parse_fraction(text: &str) -> Result<f64, String> {
    let (above, below) = text.split_once('/').unwrap_or((text, "1"));
    match (positive(above), positive(below)) {
        (Ok(above), Ok(below)) if above / below > 0.0 && (above / below).is_finite() => {
            Ok(above / below)
        }
        _ => Err("a positive number is wanted, such as 0.5 or 1/3".to_owned()),
    }
}

fn parse_range(text: &str) -> Result<[i32; 2], String> {
    let wanted = || "two angles between -5 and 185 deg are wanted, such as 0,180".to_owned();
    let (from, to) = text.split_once(',').ok_or_else(wanted)?;
    let angle = |text: &str| {
        let degrees: f64 = text.trim().parse().ok()?;
        let angle = degrees * 1e4;
        let [least, most] = APERTURE.map(f64::from);
        (least..=most)
            .contains(&angle)
            .then_some(angle.round() as i32)
    };
    match (angle(from), angle(to)) {
        (Some(from), Some(to)) if from < to => Ok([from, to]),
        _ => Err(wanted()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_lie_in_the_aperture() {
        assert_eq!(parse_range("-5,185"), Ok([-50_000, 1_850_000]));
        assert_eq!(parse_range("0, 90.5"), Ok([0, 905_000]));
        for text in ["", "0", "90,0", "-6,0", "0,186", "a,b", "nan,5"] {
            assert!(parse_range(text).is_err(), "{text}");
        }
        assert_eq!(parse_fraction("1/3"), Ok(1.0 / 3.0));
        for text in ["1/0", "-1", "x", "1/2/3", "1e300/1e-300", "/"] {
            assert!(parse_fraction(text).is_err(), "{text}");
        }
    }

    #[test]
    fn nothing_to_set_is_refused() {
        let args = ConfigureArgs {
            configure: true,
            ..ConfigureArgs::default()
        };
        assert!(args.plan().is_err());
        let args = ConfigureArgs {
            frequency_hz: Some(30.0),
            resolution_deg: Some(0.5),
            ..args
        };
        let error = args.plan().unwrap_err().to_string();
        assert!(
            error.contains("25 Hz") || error.contains("35 Hz 0.5 deg"),
            "{error}"
        );
        assert!(ConfigureArgs::default().plan().unwrap().is_none());
    }
}
