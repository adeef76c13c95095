//! Recordings: byte streams of a SICK scanner, decoded to scans.

use super::NAME;
use super::args::Args;
use crate::link::Arrivals;
use crate::record::Scan;
use crate::sick::cola::{Event, Framer, Skipped, Telegram};
use crate::sick::replay::{Replay, Settings};
use crate::sick::scan;
use crate::sick::scandata::{self, LmdScandata};
use crate::stream::{Bytes, Fault, Options, Outcome, Output, Place, Stop, WindowState};
use crate::tool::recording::Times;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

/// Bytes read at a time.
const CHUNK: usize = 1 << 16;

/// Decodes the recordings, one after the other.
pub(super) fn run(args: &Args, options: Options, settings: Settings) -> anyhow::Result<Outcome> {
    let times = Times::new(&args.replay, args.times.as_deref(), args.no_times)?;
    let like = widest_scan(&args.replay);
    let mut decoding = Decoding {
        name: String::new(),
        output: Some(Output::open(&options)?),
        window: WindowState::new(options.window),
        replay: Replay::new(settings),
        telegram: LmdScandata::default(),
        others: BTreeMap::new(),
        faults: 0,
        surplus: 0,
        left: args.n_scans,
        done: false,
        begin: 0,
        arrivals: None,
        telegrams: 0,
        like,
        options,
    };
    let stop = Stop::install()?;
    let mut framer = Framer::new();
    for recording in &args.replay {
        let arrivals = times.read(recording)?;
        let goes_on = match (&decoding.arrivals, &arrivals) {
            (Some(before), Some(arrivals)) => arrivals.continues(before),
            _ => true,
        };
        if !goes_on {
            decoding.break_off(&mut framer)?;
        }
        decoding.arrivals = arrivals;
        decoding.begin = framer.bytes();
        let bytes = Bytes::open(Some(recording), &decoding.options)?;
        decoding.name = bytes.name().to_owned();
        decoding.part(bytes, &mut framer, &stop)?;
        if decoding.done || stop.requested() {
            break;
        }
    }
    if !decoding.done && !stop.requested() {
        framer.end();
        decoding.drain(&mut framer)?;
    }
    decoding.finish(&framer)
}

/// A scan that has a value in every column in which one of the recording's scans has, so that
/// scans of several devices fit one CSV; none for a stream, which cannot be read twice, where the
/// first scan decides.
fn widest_scan(recordings: &[PathBuf]) -> Option<Scan> {
    let mut replay = Replay::new(Settings::default());
    let mut framer = Framer::new();
    let mut widest = None;
    for recording in recordings {
        let file = File::open(recording).ok()?;
        if recording == Path::new("-") || !file.metadata().ok()?.is_file() {
            return None;
        }
        let widen = |scan: &Scan| {
            scan::widen(widest.get_or_insert_with(|| scan.clone()), scan);
            true
        };
        each_scan(file, &mut framer, &mut replay, widen).ok()?;
    }
    widest
}

/// Hands over the scans of a recording, its bad pieces passed over, until `take` has had enough.
pub(super) fn each_scan(
    mut bytes: impl Read,
    framer: &mut Framer,
    replay: &mut Replay,
    mut take: impl FnMut(&Scan) -> bool,
) -> io::Result<()> {
    let mut telegram = LmdScandata::default();
    let mut chunk = vec![0; CHUNK];
    loop {
        let length = bytes.read(&mut chunk)?;
        if length == 0 {
            return Ok(());
        }
        framer.feed(chunk.get(..length).unwrap_or_default());
        while let Some(event) = framer.next() {
            if let Event::Telegram(found) = event
                && scandata::is_scan(&found)
                && telegram.parse(&found).is_ok()
                && let Ok(Some(scan)) = replay.push(&telegram, None)
                && !take(scan)
            {
                return Ok(());
            }
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
    /// Records still wanted.
    left: Option<u64>,
    /// All that was wanted has been written.
    done: bool,
    /// Where in the whole stream this file begins.
    begin: u64,
    /// Telegrams of connections that have ended.
    telegrams: u64,
}

impl Decoding {
    /// Decodes one file.
    fn part(&mut self, mut bytes: Bytes, framer: &mut Framer, stop: &Stop) -> anyhow::Result<()> {
        let mut chunk = vec![0; CHUNK];
        while !self.done && !stop.requested() {
            let length = bytes.read(&mut chunk)?;
            if length == 0 {
                return Ok(());
            }
            let mut rest = chunk.get(..length).unwrap_or_default();
            while !rest.is_empty() && !self.done {
                let here = framer.bytes() - self.begin;
                // Another connection may begin within the chunk. Byte 0 was dealt with.
                let arrivals = self.arrivals.as_ref();
                let after = |offset| arrivals.and_then(|arrivals| arrivals.next_session(offset));
                let begins = here > 0 && after(here - 1) == Some(here);
                let until = after(here).map_or(usize::MAX, |next| {
                    usize::try_from(next - here).unwrap_or(usize::MAX)
                });
                if begins {
                    self.break_off(framer)?;
                }
                let (now, later) = rest.split_at(until.min(rest.len()));
                framer.feed(now);
                self.drain(framer)?;
                rest = later;
            }
        }
        Ok(())
    }

    /// What the framer holds is the end of a connection; another one follows.
    fn break_off(&mut self, framer: &mut Framer) -> anyhow::Result<()> {
        framer.end();
        self.drain(framer)?;
        self.telegrams += framer.telegrams();
        self.replay.new_connection();
        *framer = Framer::at(framer.bytes());
        Ok(())
    }

    fn drain(&mut self, framer: &mut Framer) -> anyhow::Result<()> {
        while let Some(event) = framer.next() {
            if self.done {
                break;
            }
            match event {
                Event::Telegram(telegram) => self.telegram(&telegram)?,
                Event::Skipped(skipped) => self.skipped(&skipped)?,
            }
        }
        Ok(())
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
        let last = telegram.last_offset().saturating_sub(self.begin);
        let arrival = arrivals.and_then(|arrivals| arrivals.at(last));
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
                        if let Some(left) = &mut self.left {
                            *left = left.saturating_sub(1);
                            self.done = *left == 0;
                        }
                    }
                    (Place::After, _) => self.done = true,
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
            let offset = skipped.offset.saturating_sub(self.begin);
            self.remark(&format!("{}: offset {offset}: {text}", self.name));
            return Ok(());
        }
        self.fault(skipped.offset, &text)
    }

    /// Counts a fault, or ends with it.
    fn fault(&mut self, offset: u64, text: &str) -> anyhow::Result<()> {
        let offset = offset.saturating_sub(self.begin);
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
        let telegrams = self.telegrams + framer.telegrams();
        if telegrams == 0 && self.faults == 0 {
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
            eprintln!("{NAME}: {}: no scan among {telegrams} telegrams", self.name);
            return Ok(Outcome::Degraded);
        }
        Ok(Outcome::Done)
    }

    fn remark_counts(&self) {
        let counts = self.replay.counts();
        for (count, what) in [
            (counts.repeated, "telegrams repeat a scan and were dropped"),
            (counts.missing, "scans are missing by the scan counter"),
            (
                counts.estimated,
                "scans are missing around a restart, estimated from the time",
            ),
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
