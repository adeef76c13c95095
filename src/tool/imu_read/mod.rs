//! imu-read: samples from a MicroStrain 3DM-GX1 on a serial port, or from a recording of one.

mod arguments;
mod live;
mod packets;
mod polling;
mod replay;
mod sink;
mod unit;

use crate::gx1::command;
use crate::gx1::session::Identity;
use crate::stream::Outcome;
use crate::tool::ports;

/// The tool's name.
const NAME: &str = "imu-read";

const LONG_ABOUT: &str = "\
Streams imu records from a MicroStrain 3DM-GX1 on a serial port, or decodes a recording of one \
(imu-read replay). The unit's speed is found by asking it (19200, 38400, 115200 Bd); whatever it \
streams is stopped first; its gains and its tick are read from its EEPROM with checksum, and \
without them nothing is written unless --gains states them.

Commands. The first command is streamed by the unit at the end of each of its calculation cycles, \
the others are asked for with each of its replies: quantities of one cycle make one record, those \
of another cycle a record of their own. With --poll all are asked for that often.

Time. The tick counter says when a calculation began. It is unwrapped to 64 bits (device_ns), and \
mapped to the host's clock by the line under the earliest arrivals, less the cycle and the time on \
the line: stamp_ns. received_ns is the arrival itself, 16 to 25 ms later.

Losses. Replies are found again behind lost bytes by a search for header, length and sum. Those \
missing by the tick counter are gaps in seq; a reply that repeats is no sample. When the unit falls \
silent or the port goes away, it is looked for until it is back. Losses end the tool with status 3, \
and -v counts them.

Axes. ned is north, east, down as the device has them; enu is east, north, up with the body's axes \
turned upright; platform is the platform's own, with the mounting (imu.rotation_deg of -f) taken \
out. Accelerations are specific force: up at rest. Two public drivers disagree about the unit's own \
sign: 'imu-read check' tells, --accel-sign sets it.";

const EXAMPLES: &str = "\
EXAMPLES
  What a recording holds, in the platform's axes
    imu-read replay run.gx1 --axes platform -f frame.toml > imu.csv
  As MCAP with covariances
    imu-read replay run.gx1 --format mcap -o imu.mcap
  The replies themselves, word by word
    imu-read replay run.gx1 --packets | head -n 5
  The serial ports of this host
    imu-read list

DEVICES
  Attitude, acceleration and rate for a pose
  solve-pose -f frame.toml --imu <(imu-read /dev/ttyUSB0 -q) lines.csv
  An hour, with the raw bytes kept
  imu-read /dev/ttyUSB0 --for 1h --tee run.gx1 -o run.mcap --format mcap
  Stabilised angles streamed, instantaneous vectors polled beside them
  imu-read /dev/ttyUSB0 --command 0x0E,0x03 > imu.csv
  What a unit says of itself, and whether its signs are as assumed
  imu-read info /dev/ttyUSB0; imu-read check /dev/ttyUSB0";

const REPLAY_EXAMPLES: &str = "\
EXAMPLES
  The records of the capture again, in the platform's axes
    imu-read replay run.gx1 --axes platform -f frame.toml > imu.csv
  A recording of which nothing but the bytes is there
    imu-read replay bare.gx1 --gains 8500,10000,2000 --tick 10ms --command 0x31 > imu.csv
  Every reply in it, whatever it is
    imu-read replay run.gx1 --packets | head -n 20";

/// Streams the samples of a 3DM-GX1 inertial unit, shows and sets its cells
#[derive(Clone, Debug, clap::Parser)]
#[command(
    name = NAME,
    version,
    long_about = LONG_ABOUT,
    after_long_help = EXAMPLES,
    args_conflicts_with_subcommands = true,
    subcommand_negates_reqs = true
)]
pub struct Args {
    /// What to do instead of streaming
    #[command(subcommand)]
    pub question: Option<Question>,
    /// The stream
    #[command(flatten)]
    pub stream: live::LiveArgs,
}

/// What can be done besides streaming.
#[derive(Clone, Debug, clap::Subcommand)]
pub enum Question {
    /// Decodes a recording (--tee) to the records of the capture
    Replay(Box<replay::ReplayArgs>),
    /// Says who the unit is and what its cells hold
    Info(unit::InfoArgs),
    /// Shows and sets the unit's EEPROM cells
    #[command(subcommand)]
    Eeprom(unit::EepromArgs),
    /// Captures the gyros' bias; the unit must lie still
    Bias(unit::BiasArgs),
    /// Makes the present attitude the zero of the stabilised ones, or forgets that
    Tare(unit::TareArgs),
    /// Shows or sets the unit's tick, and says what rates follow
    Rate(unit::RateArgs),
    /// Tells from a still unit which of the disputed signs it follows
    Check(unit::CheckArgs),
    /// Lists the serial ports with their USB adapters
    List,
}

/// Runs the tool.
///
/// # Errors
/// 65 for a recording that holds no sample, 66 for one that is not there, 69 where no unit answers,
/// 78 for a bad frame file.
pub fn run(args: Args) -> anyhow::Result<Outcome> {
    match args.question {
        None => live::run(args.stream),
        Some(Question::Replay(args)) => replay::run(*args),
        Some(Question::Info(args)) => unit::info(args),
        Some(Question::Eeprom(args)) => unit::cells(args),
        Some(Question::Bias(args)) => unit::bias(args),
        Some(Question::Tare(args)) => unit::tare(args),
        Some(Question::Rate(args)) => unit::rate(args),
        Some(Question::Check(args)) => unit::check(args),
        Some(Question::List) => ports::list(NAME),
    }
}

/// The firmware's version in words.
fn firmware(identity: Identity) -> String {
    identity
        .firmware
        .map_or("not told on RS-485".to_owned(), command::firmware_version)
}
