//! Arguments that the live stream and the replay share.

use crate::frame::Frame;
use crate::gx1::attitude::Sense;
use crate::gx1::{Command, Gains, TickFactors};
use crate::link::Endpoint;
use crate::record::Axes;
use crate::stream::Fault;
use crate::tool::values::parse_duration;
use std::path::PathBuf;

/// What becomes of the unit's numbers.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Samples")]
pub struct SampleArgs {
    /// Axes of the records: ned, enu or platform (which needs -f)
    #[arg(long, value_name = "AXES", default_value = "ned", value_parser = parse_axes)]
    pub axes: Axes,
    /// Frame file: the IMU's mounting on the platform
    #[arg(short, long, value_name = "FILE")]
    pub frame: Option<PathBuf>,
    /// The unit's accelerations at rest, Z down: force (-1 g on Z) or gravity (+1 g on Z)
    #[arg(long, value_name = "SIGN", default_value = "force", value_parser = parse_accel_sign)]
    pub accel_sign: f64,
    /// Sense of the unit's quaternion: attitude (device to earth) or inverse
    #[arg(long, value_name = "SENSE", default_value = "attitude", value_parser = parse_sense)]
    pub quaternion: SenseArg,
    /// Gain cells 230, 130, 232 (accel, rate, mag) instead of those read from the unit
    #[arg(long, value_name = "A,R,M", value_parser = parse_gains)]
    pub gains: Option<Gains>,
    /// Standard deviation of roll and pitch, deg
    #[arg(long, value_name = "DEG", default_value = "0.5", value_parser = parse_sigma)]
    pub sigma_tilt_deg: f64,
    /// Standard deviation of yaw, deg
    #[arg(long, value_name = "DEG", default_value = "2", value_parser = parse_sigma)]
    pub sigma_yaw_deg: f64,
    /// Standard deviation of each rate, rad/s
    #[arg(long, value_name = "RAD_S", default_value = "0.0086", value_parser = parse_sigma)]
    pub sigma_gyro_rad_s: f64,
    /// Standard deviation of each acceleration, m/s^2 (noise and a bias of 10 mg)
    #[arg(long, value_name = "M_S2", default_value = "0.1", value_parser = parse_sigma)]
    pub sigma_accel_m_s2: f64,
}

/// A [`Sense`] for the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SenseArg(pub Sense);

impl SampleArgs {
    /// The frame and its text, where one is given.
    ///
    /// # Errors
    /// A usage fault where `--axes platform` comes without one.
    pub fn frame(&self) -> anyhow::Result<Option<(Frame, String)>> {
        match &self.frame {
            Some(path) => Ok(Some(Frame::read_with_text(path)?)),
            None if self.axes == Axes::Platform => Err(Fault::Usage(
                "--axes platform needs the IMU's mounting: give -f FRAME.toml".into(),
            )
            .into()),
            None => Ok(None),
        }
    }
}

/// Which commands.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Commands")]
pub struct CommandArgs {
    /// Commands by number or name (0x31, euler, ...); the first is streamed, the others polled [default: 0x31]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = parse_command)]
    pub command: Vec<Command>,
    /// Quantities instead of commands: of attitude, accel, gyro, mag
    #[arg(
        long,
        value_name = "LIST",
        value_delimiter = ',',
        conflicts_with = "command"
    )]
    pub quantities: Vec<Quantity>,
    /// With --quantities: as the sensors have them at each instant, not gyro-stabilised
    #[arg(long, requires = "quantities")]
    pub instant: bool,
    /// Ask for every sample, HZ times a second, instead of having the unit stream
    #[arg(long, value_name = "HZ", value_parser = parse_rate)]
    pub poll: Option<f64>,
}

/// What a sample can hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Quantity {
    /// Roll, pitch, yaw.
    Attitude,
    /// Acceleration.
    Accel,
    /// Angular rate.
    Gyro,
    /// Magnetic field.
    Mag,
}

impl CommandArgs {
    /// Whether the commands are left to the default.
    pub fn is_default(&self) -> bool {
        self.command.is_empty() && self.quantities.is_empty()
    }

    /// The commands asked for, each once. On RS-485 0x31 cannot be asked: 0x0C stands for it.
    pub fn commands(&self, on_bus: bool) -> Vec<Command> {
        if !self.quantities.is_empty() {
            let mut commands = commands_for(&self.quantities, self.instant);
            if on_bus && commands == [Command::StabilisedEulerAccelRate] {
                commands = vec![Command::StabilisedQuaternionVectors];
            }
            return commands;
        }
        let mut commands = Vec::new();
        for command in &self.command {
            if !commands.contains(command) {
                commands.push(*command);
            }
        }
        if commands.is_empty() {
            commands.push(if on_bus {
                Command::StabilisedQuaternionVectors
            } else {
                Command::StabilisedEulerAccelRate
            });
        }
        commands
    }
}

/// The shortest replies that hold the quantities.
fn commands_for(quantities: &[Quantity], instant: bool) -> Vec<Command> {
    let has = |quantity| quantities.contains(&quantity);
    let attitude = has(Quantity::Attitude);
    let vectors = has(Quantity::Accel) || has(Quantity::Gyro);
    let mag = has(Quantity::Mag);
    match (attitude, vectors, mag, instant) {
        (true, false, false, false) => vec![Command::StabilisedEuler],
        (true, false, false, true) => vec![Command::InstantEuler],
        (true, true, false, false) => vec![Command::StabilisedEulerAccelRate],
        (true, _, _, false) => vec![Command::StabilisedQuaternionVectors],
        (true, _, _, true) => vec![Command::InstantEuler, Command::InstantVectors],
        (false, _, _, false) => vec![Command::StabilisedVectors],
        (false, _, _, true) => vec![Command::InstantVectors],
    }
}

/// A command by its number or its name.
fn parse_command(text: &str) -> Result<Command, String> {
    let by_number = text
        .strip_prefix("0x")
        .and_then(|digits| u8::from_str_radix(digits, 16).ok())
        .and_then(Command::from_byte);
    let by_name = || Command::ALL.iter().copied().find(|c| c.name() == text);
    by_number
        .or_else(by_name)
        .filter(|command| command.is_measurement())
        .ok_or_else(|| {
            let names: Vec<String> = Command::ALL
                .iter()
                .filter(|command| command.is_measurement())
                .map(|command| format!("0x{:02X} {}", command.byte(), command.name()))
                .collect();
            format!("a measurement is wanted: {}", names.join(", "))
        })
}

fn parse_axes(text: &str) -> Result<Axes, String> {
    [Axes::Ned, Axes::Enu, Axes::Platform]
        .into_iter()
        .find(|axes| axes.name() == text)
        .ok_or_else(|| "ned, enu or platform is wanted".to_owned())
}

fn parse_accel_sign(text: &str) -> Result<f64, String> {
    match text {
        "force" => Ok(1.0),
        "gravity" => Ok(-1.0),
        _ => Err("force or gravity is wanted".to_owned()),
    }
}

fn parse_sense(text: &str) -> Result<SenseArg, String> {
    match text {
        "attitude" => Ok(SenseArg(Sense::Attitude)),
        "inverse" => Ok(SenseArg(Sense::Inverse)),
        _ => Err("attitude or inverse is wanted".to_owned()),
    }
}

fn parse_gains(text: &str) -> Result<Gains, String> {
    let numbers: Result<Vec<u16>, _> = text.split(',').map(|n| n.trim().parse::<u16>()).collect();
    let Ok([accel, rate, mag]) = numbers.as_deref() else {
        return Err("three numbers are wanted, such as 8500,10000,2000".to_owned());
    };
    let (accel, rate, mag) = (*accel, *rate, *mag);
    Gains { accel, rate, mag }
        .check()
        .map_err(|error| error.to_string())
}

fn parse_sigma(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|sigma: &f64| sigma.is_finite() && *sigma > 0.0)
        .ok_or_else(|| "a number above 0 is wanted".to_owned())
}

/// Polls a second.
fn parse_rate(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|hz: &f64| (0.01..=200.0).contains(hz))
        .ok_or_else(|| "a rate from 0.01 to 200 Hz is wanted".to_owned())
}

/// The unit's port, by its path: a name without a slash is a host's.
pub fn parse_port(text: &str) -> Result<Endpoint, String> {
    match text.parse() {
        Ok(port @ Endpoint::Serial(_)) => Ok(port),
        _ => Err("the path of a serial port is wanted, such as /dev/ttyUSB0 or ./unit".to_owned()),
    }
}

/// An address on RS-485.
pub fn parse_address(text: &str) -> Result<u8, String> {
    text.parse()
        .ok()
        .filter(|address| *address < 16)
        .ok_or_else(|| "an address from 0 to 15 is wanted".to_owned())
}

/// A tick that the unit can have, by its length.
pub fn parse_tick(text: &str) -> Result<TickFactors, String> {
    let ns = u64::try_from(parse_duration(text)?.as_nanos()).unwrap_or(u64::MAX);
    TickFactors::of_tick_ns(ns)
        .ok_or_else(|| "no unit has such a tick: 0.1 ms to 100 ms in steps of 0.1 us".to_owned())
}

/// One of the unit's speeds.
pub fn parse_baud(text: &str) -> Result<u32, String> {
    text.parse()
        .ok()
        .filter(|baud| crate::gx1::BAUD_RATES.contains(baud))
        .ok_or_else(|| "19200, 38400 or 115200 is wanted".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_by_number_and_name() {
        assert_eq!(parse_command("0x31"), Ok(Command::StabilisedEulerAccelRate));
        assert_eq!(
            parse_command("0x0c"),
            Ok(Command::StabilisedQuaternionVectors)
        );
        assert_eq!(
            parse_command("instant-vectors"),
            Ok(Command::InstantVectors)
        );
        // Nothing that writes, calibrates or tares can be streamed.
        for text in ["0x0F", "0x29", "tare", "0x06", "31", ""] {
            assert!(parse_command(text).is_err(), "{text}");
        }
    }

    #[test]
    fn a_port_is_a_path() {
        for text in ["/dev/ttyUSB0", "./unit", "COM3"] {
            assert_eq!(
                parse_port(text).map(|port| port.to_string()),
                Ok(text.to_owned())
            );
        }
        for text in ["unit", "192.168.0.1:2111", ""] {
            assert!(parse_port(text).is_err(), "{text}");
        }
    }

    #[test]
    fn quantities_find_their_commands() {
        use Quantity::{Accel, Attitude, Gyro, Mag};
        let all = [
            vec![Attitude],
            vec![Attitude, Gyro],
            vec![Attitude, Mag],
            vec![Accel, Mag],
        ];
        for quantities in &all {
            for instant in [false, true] {
                let commands = commands_for(quantities, instant);
                let has = crate::gx1::samples::quantities(&commands);
                for (quantity, has) in [Attitude, Accel, Gyro, Mag].iter().zip(has) {
                    assert!(has || !quantities.contains(quantity));
                }
                assert!(
                    commands
                        .iter()
                        .all(|c| c.title().starts_with("instant") == instant)
                );
            }
        }
    }

    #[test]
    fn gains_are_three_sensible_numbers() {
        assert_eq!(parse_gains("8500,10000,2000"), Ok(Gains::FACTORY));
        for text in ["8500,10000", "8500,64,2000", "0,1,2", "a,b,c"] {
            assert!(parse_gains(text).is_err(), "{text}");
        }
    }
}
