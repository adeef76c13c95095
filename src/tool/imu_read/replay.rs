//! A recording on its way to the records of its capture.

use super::NAME;
use super::arguments::{CommandArgs, SampleArgs, parse_baud, parse_tick};
use super::packets;
use super::sink::Sink;
use crate::gx1::framer::Framer;
use crate::gx1::ticks::TickFactors;
use crate::gx1::unit_file::{self, UnitFile, UnitFileError};
use crate::gx1::{Arrived, Command, Gains, Mode, Samples, Setup};
use crate::link::{Arrivals, HostInstant};
use crate::record::Stamp;
use crate::stream::{Bytes, Fault, Options, Outcome, Stop};
use crate::tool::arguments::CommonArgs;
use crate::tool::recording::Times;
use std::io::{BufWriter, Read, Write};
use std::path::PathBuf;

/// Arguments of the replay.
#[derive(Clone, Debug, clap::Args)]
#[command(after_long_help = super::REPLAY_EXAMPLES)]
pub struct ReplayArgs {
    /// Recordings (FILE.gx1), one after the other
    #[arg(value_name = "FILE", required = true)]
    pub files: Vec<PathBuf>,
    /// End after N samples
    #[arg(short, long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub n_samples: Option<u64>,
    /// Arrival times of the bytes [default: NAME.times.csv beside NAME.gx1]
    #[arg(long, value_name = "FILE")]
    pub times: Option<PathBuf>,
    /// Take no notice of arrival times: stamps are then the unit's own time
    #[arg(long, conflicts_with = "times")]
    pub no_times: bool,
    /// What the unit was, if NAME.unit.toml is not beside NAME.gx1
    #[arg(long, value_name = "FILE")]
    pub unit: Option<PathBuf>,
    /// Length of the unit's tick, where no unit file says it
    #[arg(long, value_name = "TIME", value_parser = parse_tick)]
    pub tick: Option<TickFactors>,
    /// Speed of the line, Bd, where no unit file says it
    #[arg(long, value_name = "BD", value_parser = parse_baud)]
    pub baud: Option<u32>,
    /// Print every reply of any command, word by word, instead of samples
    #[arg(long)]
    pub packets: bool,
    /// The commands
    #[command(flatten)]
    pub commands: CommandArgs,
    /// The samples
    #[command(flatten)]
    pub samples: SampleArgs,
    /// The streams
    #[command(flatten)]
    pub common: CommonArgs,
}

/// Bytes read at a time.
const CHUNK: usize = 1 << 16;

/// Decodes.
pub(super) fn run(args: ReplayArgs) -> anyhow::Result<Outcome> {
    let mut options = args.common.options(NAME)?;
    let times = Times::new(&args.files, args.times.as_deref(), args.no_times)?;
    let stop = Stop::install()?;
    let unit = find_unit(&args)?;
    if args.packets {
        if options.output.is_some() || args.common.format.is_some() {
            let text = "--packets prints text to stdout: -o and --format are of samples";
            return Err(Fault::Usage(text.into()).into());
        }
        return print_packets(&args, &options, times, unit.as_ref(), &stop);
    }
    let frame = args.samples.frame()?;
    options.configuration = frame.as_ref().map(|(_, text)| text.clone());
    let setup = setup(&args, unit.as_ref())?;
    let frame = frame.as_ref().map(|(frame, _)| frame);
    let commands = setup.commands.clone();
    let mut sink = Sink::open(&options, &args.samples, frame, &commands, args.n_samples)?;
    let mut framer = Framer::of_session(setup.baud, &commands);
    let mut samples = Samples::new(setup);
    if unit.as_ref().is_none_or(|unit| unit.bus_address.is_some()) {
        // Without the capture's own questions in it, the stream is taken as it is.
        samples.begin();
    }
    let mut own_time = OwnTime::default();
    read(&args, times, &options, &mut framer, |framer, timed| {
        while let Some(mut arrived) = framer.next() {
            if !timed {
                own_time.stamp(&mut arrived, &samples);
            }
            samples.push(&arrived);
            sink.drain(&mut samples)?;
        }
        Ok(!sink.done() && !stop.requested())
    })?;
    samples.finish();
    sink.drain(&mut samples)?;
    let written = sink.finish()?;
    let counts = samples.counts();
    let framed = framer.counts();
    if options.verbose > 0 {
        eprintln!(
            "{NAME}: {} samples, {} replies lost by the ticks, {} repeated, {} late, {} implausible, {} bytes \
             skipped, {} bad sums",
            written,
            counts.lost,
            counts.repeated,
            counts.late,
            counts.implausible,
            framed.skipped + framer.pending() as u64,
            framed.bad_sums,
        );
    }
    stop.check(written)?;
    if counts.samples == 0 {
        let names: Vec<String> = commands
            .iter()
            .map(|c| format!("0x{:02X}", c.byte()))
            .collect();
        let text = format!(
            "{}: no reply of {} in {} bytes; --packets shows what there is",
            args.files
                .first()
                .map_or_else(String::new, |file| file.display().to_string()),
            names.join(", "),
            framed.bytes
        );
        return Err(Fault::BadData(text).into());
    }
    if counts.lost + counts.implausible + counts.restarts > 0 {
        if !options.quiet {
            eprintln!("{NAME}: {} samples written, {} lost", written, counts.lost);
        }
        return Ok(Outcome::Degraded);
    }
    Ok(Outcome::Done)
}

/// The unit file asked for, or the one beside the recording if there is one.
fn find_unit(args: &ReplayArgs) -> anyhow::Result<Option<UnitFile>> {
    let first = args.files.first().map(|file| unit_file::beside(file));
    let path = match (&args.unit, first) {
        (Some(path), _) => path.clone(),
        (None, Some(beside)) if beside.is_file() => beside,
        _ => return Ok(None),
    };
    let text = std::fs::read_to_string(&path)
        .map_err(|error| Fault::NoInput(format!("{}: {error}", path.display())))?;
    let unit = UnitFile::parse(&text)
        .map_err(|error| Fault::BadData(format!("{}: {error}", path.display())))?;
    Ok(Some(unit))
}

/// What the unit file and the arguments together say.
fn setup(args: &ReplayArgs, unit: Option<&UnitFile>) -> anyhow::Result<Setup> {
    let missing = |what: &str, option: &str| {
        let text = format!(
            "the {what} must be known: no unit file lies beside the recording; give {option}"
        );
        anyhow::Error::from(Fault::Usage(text))
    };
    let unsound = |option: &'static str| {
        move |error: UnitFileError| {
            Fault::BadData(format!("the unit file: {error}; {option} states another"))
        }
    };
    let gains = match (args.samples.gains, unit) {
        (None, Some(unit)) => Some(unit.gains().map_err(unsound("--gains"))?),
        (stated, _) => stated,
    };
    let tick = match (args.tick, unit) {
        (None, Some(unit)) => Some(unit.tick().map_err(unsound("--tick"))?),
        (stated, _) => stated,
    };
    let commands = match unit {
        Some(unit) if args.commands.is_default() => unit
            .measurements()
            .map_err(|error| Fault::BadData(error.to_string()))?,
        _ => args.commands.commands(false),
    };
    let poll_hz = args.commands.poll.or(unit.and_then(|unit| unit.poll_hz));
    Ok(Setup {
        commands,
        mode: poll_hz.map_or(Mode::Continuous, Mode::Polled),
        gains: gains.ok_or_else(|| missing("unit's gains", "--gains"))?,
        tick: tick.ok_or_else(|| missing("unit's tick", "--tick"))?,
        baud: args.baud.or(unit.map(|unit| unit.baud)).unwrap_or(38_400),
        accel_sign: args.samples.accel_sign,
        quaternion: args.samples.quaternion.0,
    })
}

fn print_packets(
    args: &ReplayArgs,
    options: &Options,
    times: Times,
    unit: Option<&UnitFile>,
    stop: &Stop,
) -> anyhow::Result<Outcome> {
    let known = unit.and_then(|unit| unit.gains().ok());
    let gains = args.samples.gains.or(known).unwrap_or_else(|| {
        if !options.quiet {
            eprintln!(
                "{NAME}: the unit's gains are not known: those of the factory stand for them"
            );
        }
        Gains::FACTORY
    });
    let mut framer = Framer::new(args.baud.unwrap_or(38_400));
    if args.commands.is_default() {
        framer.expect(Command::ALL);
    } else {
        framer.expect(&args.commands.commands(false));
    }
    let mut out = BufWriter::new(std::io::stdout().lock());
    writeln!(out, "{}", packets::HEADER)?;
    let mut written = 0;
    read(args, times, options, &mut framer, |framer, _| {
        while let Some(arrived) = framer.next() {
            packets::row(&mut out, &arrived, gains)?;
            written += 1;
            if args.n_samples.is_some_and(|most| written >= most) {
                return Ok(false);
            }
        }
        Ok(!stop.requested())
    })?;
    out.flush()?;
    let skipped = framer.counts().skipped + framer.pending() as u64;
    if skipped > 0 && !options.quiet {
        eprintln!("{NAME}: {skipped} bytes belong to no reply");
    }
    Ok(Outcome::Done)
}

/// Reads the recordings piece by piece, each piece with its time, until `take` has had enough.
/// `take` is told whether there are times.
fn read(
    args: &ReplayArgs,
    times: Times,
    options: &Options,
    framer: &mut Framer,
    mut take: impl FnMut(&mut Framer, bool) -> anyhow::Result<bool>,
) -> anyhow::Result<()> {
    let mut before: Option<Arrivals> = None;
    let mut chunk = vec![0; CHUNK];
    for file in &args.files {
        let arrivals = times.read(file)?;
        if let (Some(before), Some(now)) = (&before, &arrivals)
            && !now.continues(before)
        {
            framer.clear();
        }
        let mut bytes = Bytes::open(Some(file), options)?;
        let mut place = 0u64;
        loop {
            let length = bytes.read(&mut chunk)?;
            if length == 0 {
                break;
            }
            let mut rest = chunk.get(..length).unwrap_or_default();
            while !rest.is_empty() {
                let (at, size) = piece(arrivals.as_ref(), place, rest.len());
                let (now, later) = rest.split_at(size);
                framer.feed(now, at);
                rest = later;
                place += size as u64;
                if !take(framer, arrivals.is_some())? {
                    return Ok(());
                }
                // A reply cannot go on over the end of its connection.
                let session = arrivals.as_ref().and_then(|a| a.next_session(place - 1));
                if session == Some(place) {
                    framer.clear();
                }
            }
        }
        before = arrivals;
    }
    Ok(())
}

/// When the byte at `place` had come, and how many of the next `length` with it.
fn piece(arrivals: Option<&Arrivals>, place: u64, length: usize) -> (HostInstant, usize) {
    match arrivals.and_then(|arrivals| arrivals.piece(place)) {
        Some((at, end)) => {
            let size = usize::try_from(end.saturating_sub(place)).unwrap_or(usize::MAX);
            (at, size.clamp(1, length))
        }
        None => (HostInstant::default(), length),
    }
}

/// Arrival times for a recording without any: every reply comes as soon as its cycle is over.
#[derive(Default)]
struct OwnTime {
    ticks: Option<i64>,
}

impl OwnTime {
    fn stamp(&mut self, arrived: &mut Arrived, samples: &Samples) {
        let Some(reading) = arrived.packet.ticks() else {
            return;
        };
        let ticks = match self.ticks {
            None => i64::from(reading),
            Some(last) => last + i64::from(reading.wrapping_sub(last as u16).cast_signed()),
        };
        self.ticks = Some(self.ticks.unwrap_or(ticks).max(ticks));
        let tick_ns = i64::try_from(samples.setup().tick.tick_ns()).unwrap_or(i64::MAX);
        let ns = ticks.saturating_mul(tick_ns);
        arrived.at = HostInstant {
            utc: Stamp::from_ns(ns),
            raw_ns: ns,
        };
    }
}
