//! timesync set: a scanner's calendar clock is set to the host's.

use super::TOOL;
use super::live::{self, DeviceArgs, LoginArgs, PaceArgs, Poller, Which, fault};
use crate::clock::{ClockFit, FitSettings, Log, Verdict, fit};
use crate::link::HostInstant;
use crate::record::Stamp;
use crate::sick::client::commands::ScanContents;
use crate::sick::client::{Client, ClientError};
use crate::sick::scandata::Calendar;
use crate::stream::{Fault, Outcome, Stop, WholeFile};
use crate::tool::values::parse_duration;
use serde::Serialize;
use std::time::{Duration, Instant};

/// Set a scanner's calendar clock to the host's (UTC)
///
/// Logs in, sets the clock (LSPsetdatetime), watches it by the time block of polled scans, sets it
/// again with the delay that was found taken off, and says what is left. Not while scans are
/// recorded: a clock in use is translated, not moved. Where the time block was off it is switched on
/// for this, and off again at the end.
///
/// Where the time block says when a scan was done, and not when it was sent, it tells nothing of
/// delays: then the instants between which the device took the setting are gone by.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    device: DeviceArgs,
    #[command(flatten)]
    pace: PaceArgs,
    #[command(flatten)]
    login: LoginArgs,
    /// How long the clock is watched after each setting
    #[arg(long = "for", value_name = "TIME", default_value = "3s", value_parser = parse_duration)]
    duration: Duration,
    /// Leave the time block on
    #[arg(long)]
    keep_time_block: bool,
    /// Write the result as JSON
    #[arg(long)]
    json: bool,
    /// No remarks
    #[arg(short, long)]
    quiet: bool,
}

/// A residual of half a step of the calendar is good; otherwise it is set again, so often at most.
const GOOD_S: f64 = 0.5e-3;
const TRIES: u32 = 4;

/// What was done.
#[derive(Debug, Serialize)]
struct Report {
    /// How both were found.
    found_by: FoundBy,
    /// Device minus host after the first setting, s.
    first_s: f64,
    /// Device minus host after the second one, s.
    residual_s: f64,
    /// The scatter of the residual, s.
    sigma_s: Option<f64>,
    /// Half the shortest round trip of the polls, or of the setting, s: what asymmetry could hide.
    bracket_s: Option<f64>,
    /// The residual lies between these for certain, s: the value set minus the instants between
    /// which the device took it.
    probe_s: [f64; 2],
    /// The host's UTC at which the residual was found, ns.
    at_utc_ns: i64,
}

/// How the calendar clock was looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
enum FoundBy {
    /// By the time blocks of polled scans.
    Polls,
    /// By the instants between which the setting was taken: the time blocks precede the requests.
    Setting,
}

pub(super) fn run(args: &Args) -> anyhow::Result<Outcome> {
    if args.pace.stamp != Which::Transmit {
        return Err(Fault::Usage("set looks at the calendar: --stamp does not fit".into()).into());
    }
    let hash = args.login.hash()?;
    let stop = Stop::install()?;
    let mut client = live::connect(&args.device, &stop)?;
    log_in(&mut client, hash)?;
    let contents = client
        .ask(&ScanContents::request(), ScanContents::parse)
        .map_err(fault)?;
    let done = set_twice(args, &mut client, &contents, hash, &stop);
    // Whatever happened, the device is left as it was, and measuring.
    client.set_interrupted(None);
    let restored = restore(args, &mut client, &contents, hash);
    let done = done?;
    restored.map_err(fault)?;
    let Some(report) = done else {
        stop.check(0)?;
        return Ok(Outcome::Done);
    };
    let text = match args.json {
        true => serde_json::to_string_pretty(&report)? + "\n",
        false => words(&report),
    };
    WholeFile::open(None)?.finish(&text)?;
    Ok(Outcome::Done)
}

fn words(report: &Report) -> String {
    let us = |s: f64| format!("{:+.1} us", s * 1e6);
    let sigma = report
        .sigma_s
        .map_or(String::new(), |s| format!(" +- {:.1} us", s * 1e6));
    let bracket = report.bracket_s.map_or(String::new(), |s| {
        format!(
            "bracket           +- {:.1} us: what asymmetry could hide\n",
            s * 1e6
        )
    });
    let [low, high] = report.probe_s;
    format!(
        "after setting     {} (device - host)\nset again, left   {}{sigma}\n{bracket}\
         for certain       between {} and {}\n",
        us(report.first_s),
        us(report.residual_s),
        us(low),
        us(high)
    )
}

fn log_in(client: &mut Client, hash: u32) -> anyhow::Result<()> {
    client.log_in(hash).map_err(fault)
}

/// Both settings and what is seen after them; none where it was interrupted.
fn set_twice(
    args: &Args,
    client: &mut Client,
    contents: &ScanContents,
    hash: u32,
    stop: &Stop,
) -> anyhow::Result<Option<Report>> {
    if !contents.time {
        let with_time = ScanContents {
            time: true,
            ..*contents
        };
        client.request(&with_time.set()).map_err(fault)?;
        if !args.quiet {
            eprintln!("{TOOL}: the scans' time block is switched on");
        }
    }
    let taken = set(client, 0)?;
    client.run().map_err(fault)?;
    let Some(seen) = look(args, client, stop)? else {
        return Ok(None);
    };
    let first = Left::of(&seen, taken);
    if first.found_by == FoundBy::Setting && !args.quiet {
        eprintln!(
            "{TOOL}: the time blocks precede the requests that they answer; going by the setting's \
             own round trip"
        );
    }
    // The device was set to the time at which the request left, and took it later: it is behind.
    let mut late_ns = -first.offset_ns;
    let mut last: Option<Report> = None;
    for _ in 0..TRIES {
        log_in(client, hash)?;
        let taken = set(client, late_ns)?;
        client.run().map_err(fault)?;
        let Some(seen) = look(args, client, stop)? else {
            return Ok(None);
        };
        let left = Left::of(&seen, taken);
        let report = Report {
            found_by: left.found_by,
            first_s: first.offset_ns as f64 * 1e-9,
            residual_s: left.offset_ns as f64 * 1e-9,
            sigma_s: left.sigma_ns.map(|ns| ns * 1e-9),
            bracket_s: left.bracket_ns.map(|ns| ns * 1e-9),
            probe_s: taken.probe_ns().map(|ns| ns as f64 * 1e-9),
            at_utc_ns: left.at_utc_ns,
        };
        let left_s = report.residual_s.abs();
        last = Some(report);
        if left_s <= GOOD_S {
            break;
        }
        // The first request may have been the one that was held up.
        late_ns = late_ns.min(late_ns - left.offset_ns).max(0);
        if !args.quiet {
            eprintln!(
                "{TOOL}: {:.1} ms are left, the request was held up: once more",
                left_s * 1e3
            );
        }
    }
    Ok(last)
}

/// A setting: the value, and the host's UTC between which the device took it, ns.
#[derive(Clone, Copy, Debug)]
struct Taken {
    value_ns: i64,
    sent_ns: i64,
    received_ns: i64,
}

impl Taken {
    /// Least and most that the calendar can be off right after it, ns.
    fn probe_ns(&self) -> [i64; 2] {
        [
            self.value_ns.saturating_sub(self.received_ns),
            self.value_ns.saturating_sub(self.sent_ns),
        ]
    }
}

/// What is left after a setting.
#[derive(Clone, Copy, Debug)]
struct Left {
    found_by: FoundBy,
    offset_ns: i64,
    sigma_ns: Option<f64>,
    bracket_ns: Option<f64>,
    at_utc_ns: i64,
}

impl Left {
    fn of(seen: &Seen, taken: Taken) -> Left {
        if seen.fit.verdict != Verdict::OneWayStampsVoid {
            return Left {
                found_by: FoundBy::Polls,
                offset_ns: seen.offset_ns,
                sigma_ns: seen.fit.offset_sigma_ns,
                bracket_ns: seen.fit.bracket_ns,
                at_utc_ns: seen.at_utc_ns,
            };
        }
        let [least_ns, most_ns] = taken.probe_ns();
        let half_ns = most_ns.saturating_sub(least_ns) / 2;
        Left {
            found_by: FoundBy::Setting,
            offset_ns: least_ns.saturating_add(half_ns),
            sigma_ns: None,
            bracket_ns: Some(half_ns as f64),
            at_utc_ns: taken.sent_ns.saturating_add(half_ns),
        }
    }
}

/// Sets the clock to the host's time plus `ahead_ns`.
fn set(client: &mut Client, ahead_ns: i64) -> anyhow::Result<Taken> {
    let now_ns = HostInstant::now().utc.ns() + ahead_ns;
    let value_ns = now_ns - now_ns.rem_euclid(1000);
    let calendar = Calendar::at(Stamp::from_ns(value_ns)).ok_or_else(|| {
        Fault::Unavailable("the host's clock is outside the years 1970 to 2261".into())
    })?;
    let reply = client.set_date_time(&calendar).map_err(fault)?;
    Ok(Taken {
        value_ns,
        sent_ns: reply.sent.utc.ns(),
        received_ns: reply.received.utc.ns(),
    })
}

/// What the calendar clock is off.
struct Seen {
    /// Device minus host's calendar, ns.
    offset_ns: i64,
    at_utc_ns: i64,
    fit: ClockFit,
}

/// Watches the calendar clock for a while; none where it was interrupted.
fn look(args: &Args, client: &mut Client, stop: &Stop) -> anyhow::Result<Option<Seen>> {
    let pace = PaceArgs {
        stamp: Which::Calendar,
        ..args.pace.clone()
    };
    let mut poller = Poller::new(&args.device, &pace);
    let until = Instant::now() + args.duration;
    let mut records = Vec::new();
    while let Some(exchange) = poller.next(client, stop, Some(until))? {
        records.push(exchange);
    }
    if stop.requested() {
        return Ok(None);
    }
    let log = Log::of(&records, None);
    let session = log.sessions.last();
    let session = session.ok_or_else(|| Fault::Unavailable("no scan was answered".into()))?;
    let found = fit(&session.exchanges, &FitSettings::default())
        .map_err(|error| Fault::Unavailable(format!("{error}; give a longer --for")))?;
    Ok(Some(Seen {
        offset_ns: found
            .line
            .offset_ns
            .saturating_sub(session.utc_minus_host_ns),
        at_utc_ns: found
            .line
            .at_host_ns
            .saturating_add(session.utc_minus_host_ns),
        fit: found,
    }))
}

/// Leaves the device as it was, and measuring.
fn restore(
    args: &Args,
    client: &mut Client,
    contents: &ScanContents,
    hash: u32,
) -> Result<(), ClientError> {
    if contents.time || args.keep_time_block {
        return client.run();
    }
    client.log_in(hash)?;
    client.request(&contents.set())?;
    client.run()
}
