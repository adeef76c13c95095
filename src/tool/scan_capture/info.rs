//! `scan-capture info` and `scan-capture list`: what is there.

use super::NAME;
use crate::link::Endpoint;
use crate::link::baud::{MAX_ERROR, Realised};
use crate::sick::client::{Client, Settings, facts};
use crate::stream::{Fault, Outcome};
use crate::tool::ports;
use std::io::Write;

/// Say what a scanner is, how it feels and how it is set
#[derive(Clone, Debug, clap::Args)]
#[command(
    long_about = "Asks a scanner for its identity, firmware, temperature, contamination, state, clock \
and configuration, and prints a line for each. Nothing is changed and no login is needed. What a \
firmware does not know is left out.",
    after_long_help = "DEVICES\n  scan-capture info 192.168.0.1\n  scan-capture info /dev/ttyUSB0 \
--baud 500000 --json"
)]
pub struct InfoArgs {
    /// Scanner: HOST, HOST:PORT or a serial port
    #[arg(value_name = "DEVICE")]
    pub device: Endpoint,
    /// Speed of the serial port [default: 57600, as delivered]
    #[arg(long, value_name = "BAUD", value_parser = clap::value_parser!(u32).range(300..=4_000_000))]
    pub baud: Option<u32>,
    /// One JSON object
    #[arg(long)]
    pub json: bool,
}

/// List the serial ports; say what a converter's clock makes of a speed
#[derive(Clone, Debug, clap::Args)]
#[command(
    long_about = "Lists the serial ports with their adapters' USB numbers and latency timers. With \
--baud and --crystal it says instead which speed a converter's UART makes of a crystal (crystal / 32 \
over a whole divider; Kurniawan 2017, eq. 2.1 and 2.2) and whether its error is within the 2 % that practice allows.",
    after_long_help = "EXAMPLES\n  The speed that a converter with a 16 MHz crystal really has\n    \
scan-capture list --baud 500000 --crystal 16MHz"
)]
pub struct ListArgs {
    /// Wanted speed
    #[arg(long, value_name = "BAUD", requires = "crystal", value_parser = clap::value_parser!(u32).range(1..))]
    pub baud: Option<u32>,
    /// Frequency of the converter's crystal, such as 16MHz
    #[arg(long, value_name = "FREQUENCY", requires = "baud", value_parser = parse_frequency)]
    pub crystal: Option<f64>,
}

/// Prints what a scanner tells of itself.
pub(super) fn info(args: &InfoArgs) -> anyhow::Result<Outcome> {
    let settings = Settings {
        baud: args.baud.unwrap_or(Settings::default().baud),
        ..Settings::default()
    };
    let unavailable = |error: &dyn std::fmt::Display| Fault::Unavailable(error.to_string());
    let mut client = Client::connect(&args.device, &settings, None, None)
        .map_err(|error| unavailable(&error))?;
    let facts = facts(&mut client).map_err(|error| unavailable(&error))?;
    let mut out = std::io::stdout().lock();
    if args.json {
        let object: serde_json::Map<String, serde_json::Value> = facts
            .into_iter()
            .map(|fact| (fact.key.to_owned(), fact.value))
            .collect();
        writeln!(out, "{}", serde_json::to_string_pretty(&object)?)?;
        return Ok(Outcome::Done);
    }
    let width = facts.iter().map(|fact| fact.key.len()).max().unwrap_or(0);
    for fact in facts {
        writeln!(out, "{:width$}  {}", fact.key, fact.text())?;
    }
    Ok(Outcome::Done)
}

/// Prints the serial ports, or what a crystal makes of a speed.
pub(super) fn list(args: &ListArgs) -> anyhow::Result<Outcome> {
    if let (Some(baud), Some(crystal_hz)) = (args.baud, args.crystal) {
        let Some(realised) = Realised::new(crystal_hz, baud) else {
            let text = format!("a crystal of {crystal_hz} Hz is too slow for {baud} baud");
            return Err(Fault::Usage(text).into());
        };
        let verdict = match realised.fits() {
            true => "fits",
            false => "does not fit",
        };
        writeln!(
            std::io::stdout(),
            "{baud} baud from {} MHz: divider {}, {:.0} baud, error {:.4} %: {verdict} (at most {} %)",
            crystal_hz / 1e6,
            realised.divider,
            realised.baud,
            realised.error * 100.0,
            MAX_ERROR * 100.0,
        )?;
        return Ok(Outcome::Done);
    }
    ports::list(NAME)
}

fn parse_frequency(text: &str) -> Result<f64, String> {
    const UNITS: [(&str, f64); 3] = [("MHz", 1e6), ("kHz", 1e3), ("Hz", 1.0)];
    let wanted = || "a frequency with its unit is wanted, such as 16MHz".to_owned();
    let (number, unit_hz) = UNITS
        .iter()
        .find_map(|(unit, hz)| Some((text.strip_suffix(unit)?, hz)))
        .ok_or_else(wanted)?;
    let number: f64 = number.trim_end().parse().map_err(|_| wanted())?;
    let hz = number * unit_hz;
    (hz > 0.0 && hz.is_finite())
        .then_some(hz)
        .ok_or_else(wanted)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frequencies_have_a_unit() {
        assert_eq!(parse_frequency("16MHz"), Ok(16e6));
        assert_eq!(parse_frequency("7.3728 MHz"), Ok(7_372_800.0));
        assert_eq!(parse_frequency("40000000Hz"), Ok(40e6));
        for text in ["16", "MHz", "-1MHz", "0Hz", "infMHz"] {
            assert!(parse_frequency(text).is_err(), "{text}");
        }
    }
}
