//! timesync poll: a log of exchanges with a scanner.

use super::TOOL;
use super::live::{self, DeviceArgs, PaceArgs, Poller};
use crate::record::ClockExchange;
use crate::stream::{Outcome, Output, Stop};
use crate::tool::arguments::CommonArgs;
use crate::tool::values::parse_duration;
use std::time::{Duration, Instant};

/// Ask a scanner for its time, again and again, and log the exchanges
///
/// Writes clock records for timesync fit: when the request was sent, what the device's clock said
/// when it answered, when the answer's first and last byte came; on the host's calendar clock and on
/// its monotonic one. The scanner need not be logged in to and is not changed.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    device: DeviceArgs,
    #[command(flatten)]
    pace: PaceArgs,
    /// How long
    #[arg(long = "for", value_name = "TIME", default_value = "60s", value_parser = parse_duration)]
    duration: Duration,
    /// How many exchanges at most
    #[arg(short, long, value_name = "N")]
    number: Option<u64>,
    #[command(flatten)]
    common: CommonArgs,
}

pub(super) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let options = args.common.options(TOOL)?;
    let stop = Stop::install()?;
    let mut client = live::connect(&args.device, &stop)?;
    let mut output = Output::open(&options)?;
    let mut poller = Poller::new(&args.device, &args.pace);
    let until = Instant::now() + args.duration;
    let mut written = 0;
    while args.number.is_none_or(|number| written < number) {
        let Some(exchange) = poller.next(&mut client, &stop, Some(until))? else {
            break;
        };
        output.write(&exchange)?;
        output.flush()?;
        written += 1;
    }
    output.finish_kind::<ClockExchange>()?;
    let counts = poller.counts;
    if counts.restarts > 0 && !options.quiet {
        eprintln!("{TOOL}: the device restarted {} times", counts.restarts);
    }
    if counts.lost > 0 {
        eprintln!(
            "{TOOL}: {} of {} requests were not answered",
            counts.lost, counts.asked
        );
    } else if options.verbose > 0 {
        eprintln!("{TOOL}: {written} exchanges");
    }
    stop.check(written)?;
    Ok(if counts.lost > 0 {
        Outcome::Degraded
    } else {
        Outcome::Done
    })
}
