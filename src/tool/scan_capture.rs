//! scan-capture: scans from a SICK laser scanner, for now from a recorded byte stream of one.

use super::common::CommonArgs;
use crate::frame::Frame;
use crate::link::{Arrivals, parse_seconds_ns};
use crate::record::{Scan, Stamp};
use crate::sick::cola::{Event, Framer, Skipped, Telegram};
use crate::sick::replay::{Replay, Settings};
use crate::sick::scan;
use crate::sick::scandata::{self, LmdScandata};
use crate::stream::{Bytes, Fault, Options, Outcome, Output, Place, Stop, WindowState};
use anyhow::Context;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// The tool's name.
const NAME: &str = "scan-capture";

/// Bytes read at a time.
const CHUNK: usize = 1 << 16;

const LONG_ABOUT: &str = "\
Decodes the byte stream of a SICK LMS5xx, LMS1xx or TiM, recorded as the device sent it, to scan \
records. CoLa A and CoLa B are told apart telegram by telegram; whatever else the device sent \
(replies, other events) is passed over.

Time. The device stamps a scan at its zero index, in microseconds since its start-up: device_ns, \
unwrapped to 64 bits. With arrival times (NAME.times.csv beside NAME.cola, or --times) stamp_ns is \
the host's time by the earliest arrivals after transmission in the last 50 scans. Without them it \
is --epoch plus the time since the first scan; without --epoch it counts from the device's \
calendar clock where somebody has set it (2000 or later, taken for UTC), else it is device_ns, \
as if the device had been started in 1970. The zero index comes before the first beam: the frame \
file's index_to_first_beam_s (-f), and the turn from the aperture's start to the first angle that \
the telegram holds, are added.

Scans. Angles are the device's, 0 deg to its right and 90 ahead, freed of the rounding on the wire. \
A raw distance of 0 (no return) is inf; 1 (dazzled), 2 (implausible), 3 (filtered) and the reserved \
values up to 15 are nan. seq follows the scan counter, so that a gap is a scan that the recording \
lacks; a telegram that repeats a scan is dropped. time_increment_s and scan_time_s come from the \
period of the last 32 scans by the device's clock.

Faults. A wrong XOR, a senseless length, bytes that belong to no telegram and a scan that does not \
decode end the tool with status 65 after everything before them has been written; with --skip-bad \
they are counted and skipped (status 3). A recording that starts or ends in mid-telegram is none: \
that is said on stderr.";

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
  From a pipe
    cat run.cola | scan-capture --replay - | head -n 2";

/// Records scans from a SICK laser scanner (for now: from a recorded byte stream)
#[derive(Clone, Debug, clap::Parser)]
#[command(name = NAME, version, long_about = LONG_ABOUT, after_long_help = EXAMPLES)]
pub struct Args {
    /// Scanner to connect to, HOST, HOST:PORT or a serial port (not built yet)
    #[arg(value_name = "DEVICE", required_unless_present = "replay")]
    pub device: Option<String>,
    /// Decode a recorded byte stream; - is stdin
    #[arg(long, value_name = "FILE", conflicts_with = "device")]
    pub replay: Option<PathBuf>,
    /// Arrival times of the telegrams: CSV with t_s and offset [default: NAME.times.csv beside NAME.cola]
    #[arg(long, value_name = "FILE", requires = "replay")]
    pub times: Option<PathBuf>,
    /// Take no notice of arrival times beside the recording
    #[arg(long, requires = "replay", conflicts_with = "times")]
    pub no_times: bool,
    /// Start of the capture, seconds since 1970 UTC: added to arrival times, or the time of the first scan
    #[arg(long, value_name = "SECONDS", value_parser = parse_epoch, requires = "replay")]
    pub epoch: Option<Stamp>,
    /// Frame file: the scanner's time from zero index to first beam, its aperture and least range
    #[arg(short, long, value_name = "FILE")]
    pub frame: Option<PathBuf>,
    /// The streams
    #[command(flatten)]
    pub common: CommonArgs,
}

/// Runs the tool.
pub fn run(args: Args) -> anyhow::Result<Outcome> {
    let mut options = args.common.options(NAME)?;
    let mut settings = Settings {
        epoch: args.epoch,
        ..Settings::default()
    };
    if let Some(path) = &args.frame {
        options.configuration = Some(apply_frame(path, &mut settings)?);
    }
    let Some(recording) = &args.replay else {
        let device = args.device.unwrap_or_default();
        return Err(Fault::Unavailable(format!(
            "{device}: not built yet. This will log in to the scanner, set its clock if asked, \
             start the measurement, and write each scan as it arrives; --replay FILE works now"
        ))
        .into());
    };
    let arrivals = if args.no_times {
        None
    } else {
        find_arrivals(recording, args.times.as_deref())?
    };
    let like = widest_scan(recording);
    let bytes = Bytes::open(Some(recording), &options)?;
    let mut decoding = Decoding {
        name: bytes.name().to_owned(),
        output: Some(Output::open(&options)?),
        window: WindowState::new(options.window),
        replay: Replay::new(settings),
        telegram: LmdScandata::default(),
        others: BTreeMap::new(),
        faults: 0,
        surplus: 0,
        passed_end: false,
        arrivals,
        like,
        options,
    };
    decoding.run(bytes)
}

/// Takes over what the frame file says of the scanner; gives its text.
fn apply_frame(path: &Path, settings: &mut Settings) -> anyhow::Result<String> {
    let frame = Frame::read(path)?;
    let model = frame.scanner_model();
    settings.index_to_first_beam_s = frame.scanner.index_to_first_beam_s;
    settings.aperture_start_rad = model.aperture_deg[0].to_radians();
    settings.range_min_m = Some(model.range_m[0]);
    std::fs::read_to_string(path).with_context(|| path.display().to_string())
}

fn parse_epoch(text: &str) -> Result<Stamp, String> {
    parse_seconds_ns(text)
        .map(Stamp::from_ns)
        .ok_or_else(|| "seconds since 1970-01-01 UTC are wanted, such as 1614680100.5".to_owned())
}

/// The arrival times asked for, or those beside the recording if there are any.
fn find_arrivals(recording: &Path, asked: Option<&Path>) -> anyhow::Result<Option<Arrivals>> {
    let beside = recording.with_extension("times.csv");
    let path = match asked {
        Some(path) => path,
        None if recording != Path::new("-") && beside.is_file() => &beside,
        None => return Ok(None),
    };
    let file =
        File::open(path).map_err(|error| Fault::NoInput(format!("{}: {error}", path.display())))?;
    let arrivals = Arrivals::read(file)
        .map_err(|error| Fault::BadData(format!("{}: {error}", path.display())))?;
    Ok(Some(arrivals))
}

/// A scan that has a value in every column in which one of the recording's scans has, so that
/// scans of several devices fit one CSV; none for a stream, which cannot be read twice, where the
/// first scan decides.
fn widest_scan(recording: &Path) -> Option<Scan> {
    let mut file = File::open(recording).ok()?;
    if recording == Path::new("-") || !file.metadata().ok()?.is_file() {
        return None;
    }
    let mut framer = Framer::new();
    let mut telegram = LmdScandata::default();
    let mut replay = Replay::new(Settings::default());
    let mut like = None;
    let mut chunk = vec![0; CHUNK];
    loop {
        let length = file.read(&mut chunk).ok()?;
        framer.feed(chunk.get(..length)?);
        while let Some(event) = framer.next() {
            if let Event::Telegram(found) = event
                && scandata::is_scan(&found)
                && telegram.parse(&found).is_ok()
                && let Ok(Some(scan)) = replay.push(&telegram, None)
            {
                scan::widen(like.get_or_insert_with(|| scan.clone()), scan);
            }
        }
        if length == 0 {
            return like;
        }
    }
}

/// A recording on its way to records.
struct Decoding {
    options: Options,
    name: String,
    output: Option<Output>,
    window: WindowState,
    replay: Replay,
    telegram: LmdScandata,
    arrivals: Option<Arrivals>,
    /// A scan with all columns that the recording will need, where it can be read in advance.
    like: Option<Scan>,
    /// Telegrams that carry no scan, by verb and name.
    others: BTreeMap<String, u64>,
    faults: u64,
    /// Scans whose telegrams hold more than is known.
    surplus: u64,
    passed_end: bool,
}

impl Decoding {
    fn run(&mut self, mut bytes: Bytes) -> anyhow::Result<Outcome> {
        let stop = Stop::install()?;
        let mut framer = Framer::new();
        let mut chunk = vec![0; CHUNK];
        while !self.passed_end && !stop.requested() {
            let length = bytes.read(&mut chunk)?;
            framer.feed(chunk.get(..length).unwrap_or_default());
            if length == 0 {
                framer.end();
            }
            while let Some(event) = framer.next() {
                match event {
                    Event::Telegram(telegram) => self.telegram(&telegram)?,
                    Event::Skipped(skipped) => self.skipped(&skipped)?,
                }
            }
            if length == 0 {
                break;
            }
        }
        self.finish(&framer)
    }

    fn telegram(&mut self, telegram: &Telegram) -> anyhow::Result<()> {
        if !scandata::is_scan(telegram) {
            let name = [telegram.verb(), telegram.name()].join(&b' ');
            *self.others.entry(printable(&name)).or_default() += 1;
            return Ok(());
        }
        if let Err(error) = self.telegram.parse(telegram) {
            return self.fault(telegram.offset, &error.to_string());
        }
        let arrivals = self.arrivals.as_ref();
        let arrival = arrivals.and_then(|arrivals| arrivals.at(telegram.last_offset()));
        match self.replay.push(&self.telegram, arrival) {
            Ok(None) => Ok(()),
            Ok(Some(scan)) => {
                self.surplus += u64::from(self.telegram.surplus > 0);
                match (self.window.place(scan.stamp), &mut self.output) {
                    (Place::Inside, Some(output)) => {
                        if let Some(like) = self.like.take() {
                            output.columns_like(&like)?;
                        }
                        output.write(scan)?;
                    }
                    (Place::After, _) => self.passed_end = true,
                    _ => {}
                }
                Ok(())
            }
            Err(error) => self.fault(telegram.offset, &error.to_string()),
        }
    }

    fn skipped(&mut self, skipped: &Skipped) -> anyhow::Result<()> {
        let text = format!("{} ({} bytes)", skipped.cause, skipped.bytes);
        if skipped.cause.is_edge() {
            self.remark(&format!("{}: offset {}: {text}", self.name, skipped.offset));
            return Ok(());
        }
        self.fault(skipped.offset, &text)
    }

    /// Counts a fault, or ends with it.
    fn fault(&mut self, offset: u64, text: &str) -> anyhow::Result<()> {
        let text = format!("{}: offset {offset}: {text}", self.name);
        self.faults += 1;
        if self.options.skip_bad {
            eprintln!("{NAME}: {text}");
            return Ok(());
        }
        if let Some(output) = &mut self.output {
            output.flush()?;
        }
        Err(Fault::BadData(text).into())
    }

    fn finish(&mut self, framer: &Framer) -> anyhow::Result<Outcome> {
        if framer.telegrams() == 0 && self.faults == 0 {
            let text = match framer.bytes() {
                0 => format!("{}: empty", self.name),
                bytes => format!("{}: no telegram in {bytes} bytes", self.name),
            };
            return Err(Fault::BadData(text).into());
        }
        if let Some(output) = self.output.take() {
            output.finish_kind::<Scan>()?;
        }
        let counts = self.replay.counts();
        self.remark_counts();
        if self.faults > 0 {
            eprintln!("{NAME}: {}: {} bad pieces skipped", self.name, self.faults);
            return Ok(Outcome::Degraded);
        }
        if counts.scans == 0 {
            eprintln!(
                "{NAME}: {}: no scan among {} telegrams",
                self.name,
                framer.telegrams()
            );
            return Ok(Outcome::Degraded);
        }
        Ok(Outcome::Done)
    }

    fn remark_counts(&self) {
        let counts = self.replay.counts();
        for (count, what) in [
            (counts.repeated, "telegrams repeat a scan and were dropped"),
            (counts.missing, "scans are missing by the scan counter"),
            (counts.late, "scans came after a newer one"),
            (counts.counter_restarts, "times the scan counter began anew"),
            (counts.restarts, "times the device restarted or changed"),
            (counts.without_arrival, "scans have no arrival time"),
            (self.surplus, "scans hold bytes after the last known field"),
        ] {
            if count > 0 {
                self.remark(&format!("{}: {count} {what}", self.name));
            }
        }
        if self.options.verbose > 0 {
            let (name, scans, flagged) = (&self.name, counts.scans, counts.flagged);
            self.remark(&format!(
                "{name}: {scans} scans, {flagged} with a device status"
            ));
            let others: Vec<String> = self
                .others
                .iter()
                .map(|(other, count)| format!("{count} {other}"))
                .collect();
            if !others.is_empty() {
                self.remark(&format!("{name}: passed over: {}", others.join(", ")));
            }
        }
    }

    fn remark(&self, text: &str) {
        if !self.options.quiet {
            eprintln!("{NAME}: {text}");
        }
    }
}

fn printable(bytes: &[u8]) -> String {
    bytes.escape_ascii().to_string()
}
