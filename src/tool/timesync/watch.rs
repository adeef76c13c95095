//! timesync watch: a scanner's clock, a line a second.

use super::TOOL;
use super::fit::FitArgs;
use super::live::{self, DeviceArgs, PaceArgs, Poller};
use super::text::seconds;
use crate::clock::{ClockFit, FitSettings, Log, Verdict, fit};
use crate::record::ClockExchange;
use crate::stream::{Encoding, Options, Outcome, Output, Stop, WholeFile};
use crate::tool::values::parse_duration;
use serde::Serialize;
use std::collections::VecDeque;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Watch a scanner's clock: a line a second
///
/// Offset (device minus host) now, drift, the shortest round trip, how many exchanges were used and
/// how many requests lost, over the last minute. --records logs the exchanges as timesync poll does.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    device: DeviceArgs,
    #[command(flatten)]
    pace: PaceArgs,
    #[command(flatten)]
    how: FitArgs,
    /// How long [default: until SIGINT]
    #[arg(long = "for", value_name = "TIME", value_parser = parse_duration)]
    duration: Option<Duration>,
    /// Over which time the line is fitted
    #[arg(long, value_name = "TIME", default_value = "60s", value_parser = parse_duration)]
    window: Duration,
    /// Time between two lines
    #[arg(long, value_name = "TIME", default_value = "1s", value_parser = parse_duration)]
    every: Duration,
    /// A line of JSON in place of text
    #[arg(long)]
    json: bool,
    /// Write the exchanges to FILE as clock records, CSV
    #[arg(long, value_name = "FILE")]
    records: Option<PathBuf>,
}

/// A line.
#[derive(Debug, Serialize)]
struct Line {
    utc_ns: i64,
    offset_ns: i64,
    drift_ppb: f64,
    rtt_min_ns: f64,
    verdict: Verdict,
    used: usize,
    lost: u64,
}

pub(super) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let options = Options {
        tool: TOOL,
        ..Options::default()
    };
    let stop = Stop::install()?;
    let mut client = live::connect(&args.device, &stop)?;
    let mut records = match &args.records {
        Some(path) => Some(Output::create(path, Encoding::Csv, &options)?),
        None => None,
    };
    let settings = FitSettings {
        resamples: 0,
        ..args.how.settings()
    };
    let mut poller = Poller::new(&args.device, &args.pace);
    let start = Instant::now();
    let until = args.duration.map(|duration| start + duration);
    let mut next = start + args.every;
    let span_ns = i64::try_from(args.window.as_nanos()).unwrap_or(i64::MAX);
    let mut window: VecDeque<ClockExchange> = VecDeque::new();
    let mut lines = 0;
    while let Some(exchange) = poller.next(&mut client, &stop, until)? {
        if let Some(records) = &mut records {
            records.write(&exchange)?;
        }
        window.push_back(exchange);
        // On the monotonic clock: a step of the calendar does not empty the window.
        let sent = |exchange: &ClockExchange| exchange.host_send_raw.unwrap_or(exchange.host_send);
        let old = |first: &ClockExchange| sent(&exchange) - sent(first) > span_ns;
        while window.front().is_some_and(old) {
            window.pop_front();
        }
        let now = Instant::now();
        if now >= next {
            // Lines that an outage has cost are not made up for.
            next += args.every;
            if next <= now {
                next = now + args.every;
            }
            let log = Log::of(window.make_contiguous(), args.how.wire());
            args.how.fits(&log)?;
            if let Some(line) = line(&log, &settings, poller.counts.lost) {
                let text = match args.json {
                    true => serde_json::to_string(&line)? + "\n",
                    false => words(&line),
                };
                WholeFile::open(None)?.finish(&text)?;
                lines += 1;
            }
            if let Some(records) = &mut records {
                records.flush()?;
            }
        }
    }
    if let Some(records) = records {
        records.finish_kind::<ClockExchange>()?;
    }
    stop.check(lines)?;
    Ok(Outcome::Done)
}

/// What the exchanges in the window say of now.
fn line(log: &Log, settings: &FitSettings, lost: u64) -> Option<Line> {
    // Only the newest session counts: the device may have restarted.
    let session = log.sessions.last()?;
    let found: ClockFit = fit(&session.exchanges, settings).ok()?;
    let now_ns = session.exchanges.last()?.receive_ns;
    let utc_ns = now_ns.saturating_add(session.utc_minus_host_ns);
    Some(Line {
        utc_ns,
        offset_ns: found.line.device_ns(now_ns).saturating_sub(utc_ns),
        drift_ppb: found.line.drift_ppb,
        rtt_min_ns: found.rtt_min_ns,
        verdict: found.verdict,
        used: found.exchanges,
        lost,
    })
}

fn words(line: &Line) -> String {
    let verdict = serde_json::to_value(line.verdict).ok();
    format!(
        "offset {} s  drift {:+.3} ppm  rtt {:.1} us  used {}  lost {}  {}\n",
        seconds(line.offset_ns),
        line.drift_ppb * 1e-3,
        line.rtt_min_ns * 1e-3,
        line.used,
        line.lost,
        verdict
            .as_ref()
            .and_then(|v| v.as_str())
            .unwrap_or_default()
    )
}
