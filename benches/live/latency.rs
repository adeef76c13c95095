//! From a telegram's last byte to its record out of the pipe.

use crate::capture::{Arrival, Capture, Captured, Format};
use crate::relay::{Pieces, Relay};
use crate::scanner::{Recording, Scanner};
use crate::{Failure, during};
use cablepose::link::HostInstant;
use cablepose::sick::cola::{Event, Framer};
use cablepose::sick::scandata::is_scan;
use std::io::{Read, Write};
use std::net::TcpStream;

/// What is promised, us.
const GOAL_P50_US: f64 = 100.0;
const GOAL_P99_US: f64 = 1000.0;
/// Scans before the measurement: the first ones pay for pages and caches.
const FIRST: usize = 100;

/// Measures and prints; an error only where the measurement fails.
pub fn table(scans: u64) -> Result<(), Failure> {
    println!("latency, loopback, 761 beams at 100 Hz, {scans} scans each, us");
    println!("{:<44} {:>8} {:>8} {:>8}", "", "p50", "p99", "max");
    let scans = scans + FIRST as u64;
    let recording = Recording::at_100_hz(500)?;
    let (sent, seen) = passed_on(&recording, scans)?;
    let spans = sent.iter().zip(&seen);
    let mut spans: Vec<i64> = spans
        .map(|(s, t)| t.raw_ns - s.raw_ns)
        .skip(FIRST)
        .collect();
    line("bytes only passed on by a thread", &mut spans, None);
    for (name, format) in [("CSV", Format::Csv), ("MCAP", Format::Mcap)] {
        let (sent, records) = captured(&recording, scans, format)?;
        let pairs = || sent.iter().zip(&records).skip(FIRST);
        let mut whole: Vec<i64> = pairs().map(|(s, r)| r.at.raw_ns - s.raw_ns).collect();
        let mut into: Vec<i64> = pairs().map(|(s, r)| r.received_ns - s.utc.ns()).collect();
        let mut out: Vec<i64> = pairs()
            .map(|(_, r)| r.at.utc.ns() - r.received_ns)
            .collect();
        line(
            &format!("{name}, last byte in to record out"),
            &mut whole,
            Some((GOAL_P50_US, GOAL_P99_US)),
        );
        line("  last byte in to received_ns", &mut into, None);
        line("  received_ns to record out", &mut out, None);
    }
    println!("{:<44} {GOAL_P50_US:>8.0} {GOAL_P99_US:>8.0}", "goal");
    Ok(())
}

/// Prints the quantiles of spans, and whether they miss a goal (p50 and p99, us).
pub fn line(name: &str, spans_ns: &mut [i64], goal: Option<(f64, f64)>) {
    spans_ns.sort_unstable();
    let at = |share: f64| {
        let place = ((spans_ns.len() as f64 * share) as usize).min(spans_ns.len() - 1);
        spans_ns.get(place).map_or(f64::NAN, |ns| *ns as f64 * 1e-3)
    };
    let (p50, p99, most) = (at(0.5), at(0.99), at(1.0));
    let missed = goal.is_some_and(|goal| p50 > goal.0 || p99 > goal.1);
    let mark = if missed { "  MISSED" } else { "" };
    println!("{name:<44} {p50:>8.1} {p99:>8.1} {most:>8.1}{mark}");
}

/// When each scan was sent to scan-capture, and its record.
fn captured(
    recording: &Recording,
    scans: u64,
    format: Format,
) -> Result<(Vec<HostInstant>, Vec<Arrival>), Failure> {
    let scanner = Scanner::replay(recording)?;
    let relay = Relay::start(&scanner.address, Pieces::Telegrams)?;
    let place = relay.address.to_string();
    let capture = Capture::start(&place, format, &["-n", &scans.to_string()])?;
    let Captured {
        records,
        said,
        status,
    } = capture.end()?;
    let sent = relay.end()?;
    // Scans are 10 ms apart: a pair that does not belong together does not pass for one.
    let fits = |(sent, record): (&HostInstant, &Arrival)| {
        (sent.utc.ns()..=record.at.utc.ns()).contains(&record.received_ns)
    };
    let paired = sent.len() >= records.len() && sent.iter().zip(&records).all(fits);
    if !status.success() || records.len() as u64 != scans || !paired {
        return Err(format!(
            "{} of {scans} scans, {} sent, {status}; scan-capture said:\n{}",
            records.len(),
            sent.len(),
            said.join("\n")
        ));
    }
    Ok((sent, records))
}

/// The same with a thread in the place of scan-capture: it waits, reads and writes.
fn passed_on(
    recording: &Recording,
    scans: u64,
) -> Result<(Vec<HostInstant>, Vec<HostInstant>), Failure> {
    let request = b"\x02\x02\x02\x02\x00\x00\x00\x11sEN LMDscandata \x01\x33";
    let answer = b"\x02\x02\x02\x02\x00\x00\x00\x11sEA LMDscandata \x01\x3f".len();
    let scanner = Scanner::replay(recording)?;
    let relay = Relay::start(&scanner.address, Pieces::Telegrams)?;
    let mut line = TcpStream::connect(relay.address).map_err(during("relay"))?;
    line.write_all(request).map_err(during("relay"))?;
    let (mut out, mut pipe) = std::io::pipe()
        .map(|(r, w)| (w, r))
        .map_err(during("pipe"))?;
    let passing = std::thread::spawn(move || {
        let mut buffer = vec![0; 1 << 16];
        while let Ok(count @ 1..) = line.read(&mut buffer) {
            if out
                .write_all(buffer.get(..count).unwrap_or_default())
                .is_err()
            {
                return;
            }
        }
    });
    let mut buffer = vec![0; 1 << 16];
    pipe.read_exact(buffer.get_mut(..answer).unwrap_or_default())
        .map_err(during("answer"))?;
    let (mut framer, mut seen) = (Framer::new(), Vec::new());
    while (seen.len() as u64) < scans {
        let count = pipe.read(&mut buffer).map_err(during("pipe"))?;
        let at = HostInstant::now();
        if count == 0 {
            return Err("the scanner left too early".to_owned());
        }
        framer.feed(buffer.get(..count).unwrap_or_default());
        while let Some(event) = framer.next() {
            if matches!(event, Event::Telegram(telegram) if is_scan(&telegram)) {
                seen.push(at);
            }
        }
    }
    drop(pipe);
    let _ = passing.join();
    let sent = relay.end()?;
    Ok((sent, seen))
}
