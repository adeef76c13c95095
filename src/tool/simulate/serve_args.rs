//! The part of `simulate`'s command line that is about emulated devices.

use crate::link::faults::Faults;
use crate::sick::emulator::TransmitStamp;
use crate::stream::Fault;
use crate::tool::common::parse_duration;
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
    /// Dialect that the host port answers: any, a, b
    #[arg(long, value_name = "WHICH", default_value = "any", value_parser = ["any", "a", "b"])]
    pub dialect: String,
    /// How long the scanner starts before it measures [default: 0s; 2s after a reboot]
    #[arg(long, value_name = "TIME", value_parser = parse_duration)]
    pub boot: Option<Duration>,
    /// Set the scanner's calendar to this much ahead of UTC [default: nobody has set it]
    #[arg(long, value_name = "S", allow_hyphen_values = true)]
    pub clock_offset_s: Option<f64>,
    /// How much too fast the scanner's clock runs
    #[arg(
        long,
        value_name = "PPM",
        default_value_t = 0.0,
        allow_hyphen_values = true
    )]
    pub clock_ppm: f64,
    /// What the scanner's counter shows at the start; it wraps at 4294.967296 s
    #[arg(long, value_name = "S", default_value_t = 0.0)]
    pub uptime_s: f64,
    /// When the time of transmission is taken: send, scan-end
    #[arg(long, value_name = "WHEN", default_value = "send", value_parser = parse_stamp)]
    pub stamp: TransmitStamp,
}

impl ServeArgs {
    /// Whether a device is to be emulated.
    pub fn is_asked(&self) -> bool {
        self.serve.is_some() || self.serve_pty.is_some()
    }
}

/// The options of an emulated device, and whether they also fit a stream of its telegrams.
const OPTIONS: [(&str, bool); 12] = [
    ("hold", false),
    ("linger", false),
    ("speed", false),
    ("boot", false),
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
pub fn refuse_foreign(args: &ServeArgs, written: &ArgMatches, cola: bool) -> Result<(), Fault> {
    for (option, fits_cola) in OPTIONS {
        let is_written = written.value_source(option) == Some(ValueSource::CommandLine);
        if !is_written || args.is_asked() || (cola && fits_cola) {
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

fn parse_stamp(text: &str) -> Result<TransmitStamp, String> {
    match text {
        "send" => Ok(TransmitStamp::Send),
        "scan-end" => Ok(TransmitStamp::ScanEnd),
        _ => Err("send or scan-end is wanted".to_owned()),
    }
}
