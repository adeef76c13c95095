//! timesync fit: offset and drift from a log of exchanges.

use super::text::{seconds, sigma};
use super::{Estimator, TOOL};
use crate::clock::{
    ClockEvent, ClockFit, Exchange, FitError, FitSettings, LEAST_EXCHANGES, Log, Session, Verdict,
    Wire, fit,
};
use crate::record::ClockExchange;
use crate::stream::{self, Fault, Outcome, WholeFile};
use crate::tool::arguments::CommonArgs;
use crate::tool::values::parse_signed_duration;
use serde::Serialize;
use std::fmt::Write;
use std::path::PathBuf;

/// Offset and drift of a device's clock, from a log of exchanges
///
/// Reads clock records as timesync poll writes them. The offset is device minus host, on the host's
/// monotonic clock where the records have it, which no step of the calendar clock can reach.
///
/// What is checked: whether the stamps of the device can be trusted for the way there (they may say
/// when a scan was done, and precede the request); whether the rate changed (then the pieces hold,
/// not the line); wraps of the device's counter, restarts, steps of the host's clock.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Clock records, CSV or MCAP [default: stdin]
    #[arg(value_name = "EXCHANGES")]
    input: Option<PathBuf>,
    #[command(flatten)]
    how: FitArgs,
    /// Write the result as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    common: CommonArgs,
}

/// How a fit is made; watch uses the same.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Fit")]
pub(super) struct FitArgs {
    /// Estimator
    #[arg(long, value_enum, value_name = "METHOD", default_value_t = Estimator::Hull)]
    method: Estimator,
    /// Take off the time on the wire of request and answer, by their lengths, at this speed: 100Mbit
    #[arg(long, value_name = "SPEED", value_parser = parse_wire)]
    wire: Option<Wire>,
    /// How much longer the shortest answer takes than the shortest request, where it is known;
    /// negative where it is the request
    #[arg(long, value_name = "TIME", default_value = "0us", value_parser = parse_signed_duration, allow_hyphen_values = true)]
    asymmetry: f64,
    /// How often the log is drawn anew to find the scatter; 0 is never
    #[arg(long, value_name = "N", default_value_t = 200, value_parser = clap::value_parser!(u32).range(0..=10_000))]
    resamples: u32,
}

impl FitArgs {
    pub fn settings(&self) -> FitSettings {
        FitSettings {
            method: self.method.method(),
            resamples: self.resamples,
            asymmetry_ns: self.asymmetry * 1e9,
            tick_ns: None,
        }
    }

    pub fn wire(&self) -> Option<Wire> {
        self.wire
    }

    /// Whether what was said of the link can be: no way takes less than no time.
    ///
    /// # Errors
    /// A fault of usage that gives the shortest round trip.
    pub fn fits(&self, log: &Log) -> Result<(), Fault> {
        let exchanges = log.sessions.iter().flat_map(|s| &s.exchanges);
        let Some(least_ns) = exchanges.map(Exchange::round_trip_ns).min() else {
            return Ok(());
        };
        let least_us = least_ns as f64 * 1e-3;
        if self.wire.is_some() && least_ns < 0 {
            return Err(Fault::Usage(format!(
                "--wire: at that speed request and answer would be on the wire for {:.1} us longer \
                 than the shortest round trip took; the link is faster",
                -least_us
            )));
        }
        if self.asymmetry.abs() * 1e6 > least_us {
            return Err(Fault::Usage(format!(
                "--asymmetry: more than the shortest round trip, {least_us:.1} us"
            )));
        }
        Ok(())
    }
}

/// What is printed of a session.
#[derive(Debug, Serialize)]
struct Found<'a> {
    #[serde(flatten)]
    fit: &'a ClockFit,
    /// Host's calendar minus the clock that host times above are on, ns.
    utc_minus_host_ns: i64,
}

#[derive(Debug, Serialize)]
struct Report<'a> {
    #[serde(flatten)]
    longest: Found<'a>,
    events: &'a [ClockEvent],
    sessions: Vec<Found<'a>>,
}

pub(super) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let options = args.common.options(TOOL)?;
    if args.common.format.is_some() {
        return Err(
            Fault::Usage("fit writes text, or --json: --format does not fit".into()).into(),
        );
    }
    let output = WholeFile::open(args.common.output.as_deref())?;
    let records: Vec<ClockExchange> = stream::read_all(args.input.as_deref(), &options)?;
    let log = Log::of(&records, args.how.wire());
    if args.how.wire.is_some() && records.iter().all(|r| r.reply_bytes.is_none()) {
        let what = "--wire needs the lengths of the messages (reply_bytes, request_bytes), and the \
                    records have none: give --asymmetry";
        return Err(Fault::BadData(what.into()).into());
    }
    args.how.fits(&log)?;
    let fits: Vec<(ClockFit, &Session)> = fitted(&log, &args.how.settings())?;
    let text = match args.json {
        true => json(&log, &fits)?,
        false => words(&log, &fits),
    };
    output.finish(&text)?;
    Ok(Outcome::Done)
}

/// Events that are told beside an error.
const EVENTS_TOLD: usize = 3;

/// Fits every session that is long enough, the longest first.
pub(super) fn fitted<'a>(
    log: &'a Log,
    settings: &FitSettings,
) -> anyhow::Result<Vec<(ClockFit, &'a Session)>> {
    let mut sessions: Vec<&Session> = log.sessions.iter().collect();
    sessions.sort_by_key(|session| std::cmp::Reverse(session.exchanges.len()));
    let mut fits = Vec::new();
    let mut first_error = None;
    for session in sessions {
        match fit(&session.exchanges, settings) {
            Ok(found) => fits.push((found, session)),
            Err(error) => {
                first_error.get_or_insert(error);
            }
        }
    }
    if fits.is_empty() {
        let error = first_error.unwrap_or(FitError::TooFew {
            found: 0,
            needed: LEAST_EXCHANGES,
        });
        // What the clocks did may be the reason.
        let events = log.events.iter().take(EVENTS_TOLD).map(event_words);
        let text: Vec<String> = [error.to_string()].into_iter().chain(events).collect();
        return Err(Fault::BadData(text.join("; ")).into());
    }
    Ok(fits)
}

fn json(log: &Log, fits: &[(ClockFit, &Session)]) -> anyhow::Result<String> {
    let mut found = fits.iter().map(|(fit, session)| Found {
        fit,
        utc_minus_host_ns: session.utc_minus_host_ns,
    });
    let Some(longest) = found.next() else {
        return Ok(String::new());
    };
    let report = Report {
        longest,
        events: &log.events,
        sessions: found.collect(),
    };
    Ok(serde_json::to_string_pretty(&report)? + "\n")
}

fn words(log: &Log, fits: &[(ClockFit, &Session)]) -> String {
    let mut text = String::new();
    for event in &log.events {
        let _ = writeln!(text, "note              {}", event_words(event));
    }
    for (k, (found, _)) in fits.iter().enumerate() {
        if k > 0 {
            text.push('\n');
        }
        session_words(found, &mut text);
    }
    text
}

/// An event in a sentence.
pub(super) fn event_words(event: &ClockEvent) -> String {
    match event {
        ClockEvent::Wrapped { exchange } => {
            format!("at exchange {exchange} the device's counter wrapped; it was unwrapped")
        }
        ClockEvent::Restarted { exchange } => {
            format!("at exchange {exchange} the device restarted: a new line begins")
        }
        ClockEvent::HostStepped { exchange, by_s } => {
            format!("at exchange {exchange} the host's calendar clock was set by {by_s:+.6} s")
        }
        ClockEvent::Backwards { exchanges } => {
            format!("{exchanges} exchanges whose answer precedes the question were left out")
        }
    }
}

fn session_words(found: &ClockFit, text: &mut String) {
    let line = &found.line;
    let method = serde_json::to_value(found.method).ok();
    let method = method.as_ref().and_then(|m| m.as_str()).unwrap_or("?");
    let mut row = |name: &str, value: String| {
        let _ = writeln!(text, "{name:<18}{value}");
    };
    row("method", method.to_owned());
    row(
        "exchanges",
        format!("{} over {:.3} s", found.exchanges, found.span_s),
    );
    row(
        "offset",
        format!(
            "{} s{}, device - host, at host {} ns",
            seconds(line.offset_ns),
            sigma(found.offset_sigma_ns, 1e-3, "us"),
            line.at_host_ns
        ),
    );
    row(
        "at the end",
        sigma(found.end_sigma_ns, 1e-3, "us")
            .trim_start()
            .to_owned(),
    );
    row(
        "drift",
        format!(
            "{:+.4} ppm{}",
            line.drift_ppb * 1e-3,
            sigma(found.drift_sigma_ppb, 1.0, "ppb")
        ),
    );
    row("rtt min", format!("{:.1} us", found.rtt_min_ns * 1e-3));
    row(
        "bracket",
        match found.bracket_ns {
            Some(ns) => format!("+- {:.1} us: what asymmetry could hide", ns * 1e-3),
            None => "none: the shortest delay is in the offset".to_owned(),
        },
    );
    row(
        "asymmetry",
        format!("{:.1} us taken off", found.asymmetry_ns / 2e3),
    );
    if let Some(gap) = found.hull_gap_ns {
        row("hull gap", format!("{:.1} us", gap * 1e-3));
    }
    row("support", format!("{} points", found.support_points));
    row("verdict", verdict_words(found));
    if found.pieces.len() > 1 {
        for piece in &found.pieces {
            row(
                "piece",
                format!(
                    "{} s at host {} ns, {:+.4} ppm, from {} to {} ns",
                    seconds(piece.line.offset_ns),
                    piece.line.at_host_ns,
                    piece.line.drift_ppb * 1e-3,
                    piece.from_host_ns,
                    piece.to_host_ns
                ),
            );
        }
    }
}

fn verdict_words(found: &ClockFit) -> String {
    match found.verdict {
        Verdict::TwoWay => "two-way".to_owned(),
        Verdict::OneWay => "one-way, as asked: the shortest delay is in the offset".to_owned(),
        Verdict::OneWayStampsVoid => "one-way: the device's stamps precede the requests that they \
            answer, so that they say nothing of the way there"
            .to_owned(),
        Verdict::DriftChanged => format!(
            "drift changed: take the {} pieces, not the line",
            found.pieces.len()
        ),
    }
}

/// `100Mbit`, `1Gbit`, `57600bit`.
fn parse_wire(text: &str) -> Result<Wire, String> {
    let wanted = || "a speed is wanted: 100Mbit, 1Gbit, 10Mbit, 57600bit".to_owned();
    let number = text.strip_suffix("bit").ok_or_else(wanted)?;
    let (number, scale) = match number.as_bytes().last() {
        Some(b'k') => (&number[..number.len() - 1], 1e3),
        Some(b'M') => (&number[..number.len() - 1], 1e6),
        Some(b'G') => (&number[..number.len() - 1], 1e9),
        _ => (number, 1.0),
    };
    let number: f64 = number.trim().parse().map_err(|_| wanted())?;
    let bits_per_s = number * scale;
    if !(1.0..=1e13).contains(&bits_per_s) {
        return Err(wanted());
    }
    Ok(Wire { bits_per_s })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn speeds_have_a_unit() {
        let speed = |text| parse_wire(text).map(|wire| wire.bits_per_s);
        assert_eq!(speed("100Mbit"), Ok(100e6));
        assert_eq!(speed("1Gbit"), Ok(1e9));
        assert_eq!(speed("57600bit"), Ok(57_600.0));
        for text in ["", "100", "bit", "Mbit", "-1Mbit", "nanbit", "1e99Gbit"] {
            assert!(speed(text).is_err(), "{text}");
        }
    }
}
