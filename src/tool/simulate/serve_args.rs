//! The part of `simulate`'s command line that is about emulated devices.

use crate::gx1::{Command, TickFactors};
use crate::link::faults::Faults;
use crate::sick::emulator::TransmitStamp;
use crate::stream::Fault;
use crate::tool::values::parse_duration;
use clap::ArgMatches;
use clap::parser::ValueSource;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::str::FromStr;
use std::time::Duration;

/// Where an emulated device is reached, how it behaves and what goes wrong.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Emulated devices")]
#[command(group(clap::ArgGroup::new("serving").multiple(true)))]
pub struct ServeArgs {
    /// Be the scanner at ADDR:PORT, or at its ports 2111 and 2112 of ADDR (see SERVING)
    #[arg(long, value_name = "ADDR", group = "serving")]
    pub serve: Option<Address>,
    /// Be the scanner on a serial line: a pseudo terminal that LINK points to
    #[arg(long, value_name = "LINK", group = "serving")]
    pub serve_pty: Option<PathBuf>,
    /// Speed of the serial line
    #[arg(
        long,
        value_name = "BAUD",
        default_value_t = 57_600,
        requires = "serve_pty"
    )]
    pub baud: u32,
    /// The scanner sees what this recording holds
    #[arg(long, value_name = "FILE", conflicts_with = "frame")]
    pub replay: Option<PathBuf>,
    /// Play the recording N times; 0 is without end
    #[arg(long, value_name = "N", default_value_t = 1, requires = "replay")]
    pub repeat: u64,
    /// Begin with the trajectory when the first client asks for scans
    #[arg(long)]
    pub hold: bool,
    /// How long to stay after the trajectory's end while clients are there
    #[arg(long, value_name = "TIME", default_value = "1s", value_parser = parse_duration)]
    pub linger: Duration,
    /// Seconds a second, or max: as fast as the clients take scans
    #[arg(long, value_name = "FACTOR", default_value = "1", value_parser = parse_speed)]
    pub speed: Speed,
    /// What goes wrong: a list such as drop=0.01,chunk=1..99,reset@10s (see SERVING)
    #[arg(
        long,
        value_name = "LIST",
        default_value = "",
        hide_default_value = true
    )]
    pub faults: Faults,
    /// Dialects that the host port answers: any, or what EIHstCola is set to: a, b
    #[arg(long, value_name = "WHICH", default_value = "any", value_parser = ["any", "a", "b"])]
    pub dialect: String,
    /// How long the scanner starts before it measures [default: 0s; 2s after a reboot]
    #[arg(long, value_name = "TIME", value_parser = parse_duration)]
    pub boot: Option<Duration>,
    /// How long no scans come after a change of the scan frequency; a device may need 30s [default: 500ms]
    #[arg(long, value_name = "TIME", value_parser = parse_duration)]
    pub settle: Option<Duration>,
    /// Set the scanner's calendar to this much ahead of UTC [default: nobody has set it]
    #[arg(long, value_name = "S", allow_hyphen_values = true, value_parser = parse_offset)]
    pub clock_offset_s: Option<f64>,
    /// How much too fast the scanner's clock runs
    #[arg(
        long,
        value_name = "PPM",
        default_value_t = 0.0,
        allow_hyphen_values = true,
        value_parser = parse_ppm
    )]
    pub clock_ppm: f64,
    /// What the scanner's counter shows at the start; it wraps at 4294.967296 s
    #[arg(long, value_name = "S", default_value_t = 0.0, allow_hyphen_values = true, value_parser = parse_uptime)]
    pub uptime_s: f64,
    /// When the time of transmission is taken: send, scan-end
    #[arg(long, value_name = "WHEN", default_value = "send", value_parser = parse_stamp)]
    pub stamp: TransmitStamp,
}

impl ServeArgs {
    /// Whether a scanner is to be emulated.
    pub fn is_asked(&self) -> bool {
        self.serve.is_some() || self.serve_pty.is_some()
    }
}

/// The options of an emulated device, and whether they also fit a stream of its telegrams.
const OPTIONS: [(&str, bool); 13] = [
    ("hold", false),
    ("linger", false),
    ("speed", false),
    ("boot", false),
    ("settle", false),
    ("replay", true),
    ("repeat", true),
    ("faults", true),
    ("dialect", true),
    ("clock_offset_s", true),
    ("clock_ppm", true),
    ("uptime_s", true),
    ("stamp", true),
];

/// Refuses options of an emulated device where there is none.
pub fn refuse_foreign(
    args: &ServeArgs,
    written: &ArgMatches,
    cola: bool,
    unit: bool,
) -> Result<(), Fault> {
    let is_written = |option| written.value_source(option) == Some(ValueSource::CommandLine);
    let unused = ["from", "to", "skip_bad", "jobs", "shard"];
    if let Some(option) = unused.into_iter().find(|option| is_written(option))
        && (args.is_asked() || cola)
    {
        let option = option.replace('_', "-");
        let text = format!("--{option} is for a stream of records");
        return Err(Fault::Usage(text));
    }
    for (option, fits_cola) in OPTIONS {
        if !is_written(option) || args.is_asked() || (cola && fits_cola) {
            continue;
        }
        if unit && option == "hold" {
            continue;
        }
        let option = option.replace('_', "-");
        let owners = if fits_cola {
            "--serve, --serve-pty and --format cola"
        } else {
            "--serve and --serve-pty"
        };
        return Err(Fault::Usage(format!("--{option} belongs to {owners}")));
    }
    Ok(())
}

/// An emulated IMU beside the scanner, or alone.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Emulated IMU (3DM-GX1)")]
#[group(id = "imu_emulation", multiple = true)]
pub struct ImuArgs {
    /// Be the IMU on a serial line: a pseudo terminal that LINK points to (see SERVING)
    #[arg(long, value_name = "LINK", conflicts_with_all = ["replay", "real_time"])]
    pub imu_pty: Option<PathBuf>,
    /// Record what a reader of the IMU would get over the run: bytes in FILE, with FILE.times.csv and FILE.unit.toml beside it
    #[arg(long, value_name = "FILE", conflicts_with_all = ["imu_pty", "serving", "real_time"])]
    pub imu_record: Option<PathBuf>,
    /// Its speed: 19200, 38400, 115200; who listens at another hears garbage
    #[arg(long, value_name = "BAUD", default_value = "38400", value_parser = ["19200", "38400", "115200"])]
    pub imu_baud: String,
    /// Length of its tick: 2ms, 10ms [default: 6.5536ms, as it leaves the factory]
    #[arg(long, value_name = "TIME", value_parser = parse_tick)]
    pub imu_tick: Option<TickFactors>,
    /// The command that it streams after power-up, such as 0x31 [default: none; with --imu-record 0x31]
    #[arg(long, value_name = "HEX", value_parser = parse_command)]
    pub imu_streams: Option<Command>,
    /// The adapter behind it hands bytes over every so often: 16ms, 1ms; 0ms is a plain port
    #[arg(long, value_name = "TIME", default_value = "0ms", value_parser = parse_duration)]
    pub imu_adapter: Duration,
    /// How much too fast its clock runs
    #[arg(
        long,
        value_name = "PPM",
        default_value_t = 0.0,
        allow_hyphen_values = true
    )]
    pub imu_ppm: f64,
    /// What its tick counter shows at the start; it wraps at 65536
    #[arg(long, value_name = "TICKS", default_value_t = 0)]
    pub imu_first_tick: u16,
    /// What goes wrong with it: as --faults, and unplug=TIME@TIME
    #[arg(
        long,
        value_name = "LIST",
        default_value = "",
        hide_default_value = true,
        requires = "imu_pty"
    )]
    pub imu_faults: Faults,
}

/// The options that make sense only with one of `--imu-pty` and `--imu-record`.
pub(super) const IMU_OPTIONS: [&str; 7] = [
    "imu_baud",
    "imu_tick",
    "imu_streams",
    "imu_adapter",
    "imu_ppm",
    "imu_first_tick",
    "imu_faults",
];

fn parse_tick(text: &str) -> Result<TickFactors, String> {
    let length = parse_duration(text)?;
    let ns = u64::try_from(length.as_nanos()).unwrap_or(u64::MAX);
    TickFactors::of_tick_ns(ns)
        .ok_or_else(|| "a multiple of 0.1us from 0.1ms to 100ms is wanted".to_owned())
}

fn parse_command(text: &str) -> Result<Command, String> {
    let wanted = || "the byte of a command with a reply is wanted, such as 0x31".to_owned();
    let hex = text.strip_prefix("0x").ok_or_else(wanted)?;
    let byte = u8::from_str_radix(hex, 16).map_err(|_| wanted())?;
    let command = Command::from_byte(byte).filter(|c| !c.words().is_empty());
    command.ok_or_else(wanted)
}

/// Where to be reached; without a port at the device's own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Address {
    /// One port.
    Port(SocketAddr),
    /// The device's own ports.
    Host(IpAddr),
}

impl FromStr for Address {
    type Err = String;

    fn from_str(text: &str) -> Result<Address, String> {
        let wrong = || "an address is wanted, such as 127.0.0.1 or 127.0.0.1:2112".to_owned();
        if let Some(port) = text.strip_prefix("localhost:") {
            let port = port.parse().map_err(|_| wrong())?;
            return Ok(Address::Port((Ipv4Addr::LOCALHOST, port).into()));
        }
        if text == "localhost" {
            return Ok(Address::Host(Ipv4Addr::LOCALHOST.into()));
        }
        let address = text.parse().map(Address::Port);
        address
            .or_else(|_| text.parse().map(Address::Host))
            .map_err(|_| wrong())
    }
}

/// How time goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Speed {
    /// So many seconds a second.
    Factor(f64),
    /// As fast as can be.
    Max,
}

impl Speed {
    /// Seconds a second; none is as fast as can be.
    pub fn factor(self) -> Option<f64> {
        match self {
            Speed::Factor(factor) => Some(factor),
            Speed::Max => None,
        }
    }
}

fn parse_speed(text: &str) -> Result<Speed, String> {
    if text == "max" {
        return Ok(Speed::Max);
    }
    let factor = text.parse().ok();
    factor
        .filter(|factor: &f64| (1e-3..=1e6).contains(factor))
        .map(Speed::Factor)
        .ok_or_else(|| "a number from 0.001 to 1000000 is wanted, or max".to_owned())
}

/// A number of at most `most` to both sides.
fn number(text: &str, most: f64) -> Result<f64, String> {
    let number = text.parse().ok();
    number
        .filter(|number: &f64| number.abs() <= most)
        .ok_or_else(|| format!("a number from {} to {most} is wanted", -most))
}

fn parse_offset(text: &str) -> Result<f64, String> {
    number(text, 1e9)
}

fn parse_ppm(text: &str) -> Result<f64, String> {
    number(text, 1e5)
}

fn parse_uptime(text: &str) -> Result<f64, String> {
    number(text, 1e9).and_then(|uptime_s| match uptime_s < 0.0 {
        true => Err("a time before power-on cannot be".to_owned()),
        false => Ok(uptime_s),
    })
}

fn parse_stamp(text: &str) -> Result<TransmitStamp, String> {
    match text {
        "send" => Ok(TransmitStamp::Send),
        "scan-end" => Ok(TransmitStamp::ScanEnd),
        _ => Err("send or scan-end is wanted".to_owned()),
    }
}
