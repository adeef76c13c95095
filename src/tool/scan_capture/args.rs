//! The command line.

use super::NAME;
use super::configure::ConfigureArgs;
use super::info::{InfoArgs, ListArgs};
use crate::link::{Endpoint, Rotation, parse_seconds_ns, would_write};
use crate::record::Stamp;
use crate::stream::Fault;
use crate::tool::arguments::CommonArgs;
use crate::tool::values::{parse_duration, parse_rotation};
use std::path::PathBuf;
use std::time::Duration;

const LONG_ABOUT: &str = "\
Writes the scans of a SICK LMS5xx, LMS1xx or TiM as it makes them, or decodes a recorded byte \
stream of one (--replay).

Live. DEVICE is HOST, HOST:PORT (2112 without a port) or a serial port. The dialect, CoLa A or CoLa \
B, is found out; nothing is written to the device but the request to send scans, and no login is \
needed. --configure sets the scanner first, in the order that it takes, and only where it is not set \
so already; every value is read back, and set again where a restart has lost it. A scanner that is \
not measuring yet is waited for (--wait). When the line breaks or falls silent for three scans, it is opened again for as long as it takes; seq then jumps by the number of \
scans lost, stderr says how long and how many, and the status at the end is 3. SIGINT, SIGTERM, -n, \
--for, or a reader of stdout that leaves end the capture: the device is told to send no more, the \
files are finished.

Time. The device stamps a scan at its zero index, in microseconds since its start-up: device_ns, \
unwrapped to 64 bits. With arrival times (live, NAME.times.csv beside NAME.cola, or --times) \
stamp_ns is the host's time by the earliest arrivals after transmission. Without them it \
is --epoch plus the time since the first scan; without --epoch it counts from the device's \
calendar clock where somebody has set it (2000 or later, taken for UTC), else it is device_ns, \
as if the device had been started in 1970. The zero index comes before the first beam: the frame \
file's index_to_first_beam_s (-f), and the turn from the aperture's start to the first angle that \
the telegram holds, are added.

Scans. Angles are the device's, 0 deg to its right and 90 ahead, freed of the rounding on the wire. \
A raw distance of 0 (no return) is inf; 1 (dazzled), 2 (implausible), 3 (filtered) and the reserved \
values up to 15 are nan. seq follows the scan counter, so that a gap is a scan that is \
lacking; a telegram that repeats a scan is dropped. time_increment_s and scan_time_s come from the \
period of the last 32 scans by the device's clock.

A Hokuyo (--device hokuyo) is asked for distances with intensities of its whole aperture (ME, or MD \
where it does not know that), after its time (TM1) has been compared with the host's. Its stamps are \
whole milliseconds; seq follows them, as the device counts no scans. Whatever ends the capture, its \
laser is switched off (QT).

Faults. In a recording a wrong XOR, a senseless length, bytes that belong to no telegram and a scan \
that does not decode end the tool with status 65 after everything before them has been written; \
with --skip-bad, and live, they are counted and skipped (status 3). A recording that starts or ends \
in mid-telegram is none: that is said on stderr.";

const EXAMPLES: &str = "\
EXAMPLES
  Decode a recording; run.times.csv beside it is used if it is there
    scan-capture --replay run.cola > scans.csv
  The straight lines of whatever the scanner saw
    scan-capture --replay run.cola | extract-lines --method split-and-merge > segments.csv
  As MCAP, with the scanner's delay and range from the frame file
    scan-capture --replay run.cola -f frame.toml --format mcap -o capture.mcap
  From 0.2 s on, in true time
    scan-capture --replay run.cola --epoch 1614680100.5 --from +200ms > late.csv
  What would be sent to set a scanner to 50 Hz and half the aperture
    scan-capture --configure --frequency-hz 50 --resolution-deg 0.5 --range-deg 0,90 --dry-run
  From a pipe
    cat run.cola | scan-capture --replay - | head -n 2

ANGLE JITTER
  The scans of an LMS511 are turned against each other by about 0.017 deg, all beams alike. The time
  from one turn of its motor to the next foretells about half of that, by a factor that is learned
  from some seconds in which scanner and scene stand still (with corners, or walls at a slant):
  scan-capture --replay still.cola --angle-jitter learn > jitter.toml
  scan-capture 192.168.0.1 --angle-jitter jitter.toml > scans.csv

DEVICES
  An hour of a scanner on the network, with its bytes kept in files of 100 MB:
  scan-capture 192.168.0.1 --for 1h --tee run.cola --tee-rotate 100MB -o run.mcap --format mcap
  One on a serial line:
  scan-capture /dev/ttyUSB0 --baud 500000 -n 1000 > scans.csv
  A Hokuyo UTM-30LX on USB, and one with Ethernet:
  scan-capture --device hokuyo /dev/ttyACM0 > scans.csv
  scan-capture --device hokuyo 192.168.0.10 --for 1min -o run.mcap --format mcap";

/// Records scans from a laser scanner, or from a recorded byte stream of one
#[derive(Clone, Debug, clap::Parser)]
#[command(name = NAME, version, long_about = LONG_ABOUT, after_long_help = EXAMPLES)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct Args {
    /// Something else than a capture.
    #[command(subcommand)]
    pub command: Option<Command>,
    /// Scanner: HOST, HOST:PORT or a serial port
    #[arg(value_name = "DEVICE", required_unless_present_any = ["replay", "dry_run"])]
    pub device: Option<Endpoint>,
    /// End after N scans
    #[arg(short, long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub n_scans: Option<u64>,
    /// Frame file: the scanner's time from zero index to first beam, its aperture and least range
    #[arg(short, long, value_name = "FILE")]
    pub frame: Option<PathBuf>,
    /// Angle jitter of a SICK's motor: FILE takes it out of the scans, learn writes such a file
    /// from a recording of a scene at rest
    #[arg(long, value_name = "learn|FILE|off", default_value = "off")]
    pub angle_jitter: AngleJitterArg,
    /// Live
    #[command(flatten)]
    pub live: LiveArgs,
    /// Configuration
    #[command(flatten)]
    pub configure: ConfigureArgs,
    /// Keep the raw bytes in FILE, and their times of arrival in FILE's name with .times.csv
    #[arg(
        long,
        value_name = "FILE",
        conflicts_with = "replay",
        help_heading = "Recording"
    )]
    pub tee: Option<PathBuf>,
    /// Begin a new file (FILE.000, FILE.001 ...) after a size (100MB), an age (10min), or either (100MB|10min)
    #[arg(long, value_name = "LIMIT", value_parser = parse_rotation, requires = "tee", help_heading = "Recording")]
    pub tee_rotate: Option<Rotation>,
    /// Decode recorded byte streams, one after the other; - is stdin
    #[arg(long, value_name = "FILE", num_args = 1.., conflicts_with = "device", help_heading = "Recording")]
    pub replay: Vec<PathBuf>,
    /// Arrival times of the bytes: CSV with t_s and offset [default: NAME.times.csv beside NAME.cola]
    #[arg(
        long,
        value_name = "FILE",
        requires = "replay",
        help_heading = "Recording"
    )]
    pub times: Option<PathBuf>,
    /// Take no notice of arrival times beside the recording
    #[arg(
        long,
        requires = "replay",
        conflicts_with = "times",
        help_heading = "Recording"
    )]
    pub no_times: bool,
    /// Start of the capture, seconds since 1970 UTC: added to arrival times, or the time of the first scan
    #[arg(long, value_name = "SECONDS", value_parser = parse_epoch, requires = "replay", help_heading = "Recording")]
    pub epoch: Option<Stamp>,
    /// The streams
    #[command(flatten)]
    pub common: CommonArgs,
}

/// What is done about the angle jitter.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum AngleJitterArg {
    /// Nothing.
    Off,
    /// A model is learned from the recording; no scans are written.
    Learn,
    /// It is taken out by the model of this file.
    Model(PathBuf),
}

impl std::str::FromStr for AngleJitterArg {
    type Err = std::convert::Infallible;

    fn from_str(text: &str) -> Result<AngleJitterArg, Self::Err> {
        Ok(match text {
            "off" => AngleJitterArg::Off,
            "learn" => AngleJitterArg::Learn,
            path => AngleJitterArg::Model(path.into()),
        })
    }
}

/// What else there is to do.
#[derive(Clone, Debug, clap::Subcommand)]
pub enum Command {
    Info(InfoArgs),
    List(ListArgs),
}

/// What kind of scanner is captured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum DeviceKind {
    /// LMS5xx, LMS1xx, TiM: CoLa A and B.
    #[default]
    Sick,
    /// UTM-30LX: SCIP 2.0.
    Hokuyo,
}

/// How a device is captured.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Live")]
pub struct LiveArgs {
    /// What kind of scanner it is: SICK's CoLa, or Hokuyo's SCIP 2.0 (UTM-30LX, port 10940)
    #[arg(long = "device", value_name = "KIND", default_value = "sick")]
    pub kind: DeviceKind,
    /// Speed of the serial port [default: 57600, as delivered]
    #[arg(long, value_name = "BAUD", value_parser = clap::value_parser!(u32).range(300..=4_000_000))]
    pub baud: Option<u32>,
    /// Ask for each scan instead of letting the device send them; HZ times a second [default: once a scan]
    #[arg(long, value_name = "HZ", num_args = 0..=1, require_equals = true, default_missing_value = "0", value_parser = parse_rate)]
    pub poll: Option<f64>,
    /// End this long after the first scan
    #[arg(long = "for", value_name = "TIME", value_parser = parse_duration)]
    pub span: Option<Duration>,
    /// How long the scanner may take to be ready [default: 60s]; given, one that refuses connections is waited for as well
    #[arg(long, value_name = "TIME", value_parser = parse_duration)]
    pub wait: Option<Duration>,
}

impl LiveArgs {
    /// The first option that is given.
    fn given(&self) -> Option<&'static str> {
        let options = [
            (self.kind != DeviceKind::Sick, "--device hokuyo"),
            (self.baud.is_some(), "--baud"),
            (self.poll.is_some(), "--poll"),
            (self.span.is_some(), "--for"),
            (self.wait.is_some(), "--wait"),
        ];
        options
            .iter()
            .find(|(given, _)| *given)
            .map(|(_, name)| *name)
    }
}

impl Args {
    /// Refuses what does not go together.
    pub(super) fn check(&self) -> anyhow::Result<()> {
        let usage = |text: String| Err(Fault::Usage(text).into());
        if !self.replay.is_empty() {
            if let Some(option) = self.live.given() {
                return usage(format!("{option} is for a device, not for --replay"));
            }
            if self.configure.configure {
                return usage("--configure is for a device, not for --replay".into());
            }
        }
        if self.angle_jitter == AngleJitterArg::Learn && self.replay.is_empty() {
            let text = "--angle-jitter learn needs a recording: --replay FILE";
            return usage(text.into());
        }
        if self.live.kind == DeviceKind::Hokuyo && self.angle_jitter != AngleJitterArg::Off {
            return usage("--angle-jitter is for a SICK scanner".into());
        }
        if self.live.kind == DeviceKind::Hokuyo && self.live.poll.is_some() {
            return usage("--poll is for a SICK scanner; a Hokuyo sends every scan".into());
        }
        if self.live.kind == DeviceKind::Hokuyo && self.configure.configure {
            return usage("--configure is for a SICK scanner".into());
        }
        if let (Some(Endpoint::Tcp { host, .. }), Some(_)) = (&self.device, self.live.baud) {
            return usage(format!("--baud is for a serial port, and {host} is a host"));
        }
        if let (Some(tee), Some(output)) = (&self.tee, &self.common.output) {
            let (tee, output) = (absolute(tee), absolute(output));
            let partial = PathBuf::from(format!("{}.partial", output.display()));
            let rotation = self.tee_rotate.unwrap_or_default();
            if [&output, &partial]
                .iter()
                .any(|path| would_write(&tee, rotation, path))
            {
                let text = format!(
                    "{}: --tee and -o would write the same file",
                    output.display()
                );
                return usage(text);
            }
        }
        Ok(())
    }
}

/// A file's path, links in its directory followed and itself where it is there.
fn absolute(path: &std::path::Path) -> PathBuf {
    if let Ok(path) = path.canonicalize() {
        return path;
    }
    let directory = match path.parent() {
        Some(parent) if parent != std::path::Path::new("") => parent,
        _ => std::path::Path::new("."),
    };
    match (directory.canonicalize(), path.file_name()) {
        (Ok(directory), Some(name)) => directory.join(name),
        _ => path.to_owned(),
    }
}

fn parse_epoch(text: &str) -> Result<Stamp, String> {
    parse_seconds_ns(text)
        .map(Stamp::from_ns)
        .ok_or_else(|| "seconds since 1970-01-01 UTC are wanted, such as 1614680100.5".to_owned())
}

fn parse_rate(text: &str) -> Result<f64, String> {
    match text.parse() {
        // What stands for once a scan.
        Ok(0.0) => Ok(0.0),
        Ok(rate_hz) if (0.001..=10_000.0).contains(&rate_hz) => Ok(rate_hz),
        _ => Err("a number of requests a second from 0.001 to 10000 is wanted".to_owned()),
    }
}
