//! From a telegram's last byte to the acknowledged write, through four processes, and through five
//! with compensate-delay.

use crate::latency::line;
use crate::relay::{Pieces, Relay};
use crate::scanner::{Recording, Scanner};
use crate::{Failure, during};
use cablepose::link::emulation::Conditions;
use cablepose::twincat::emulator::{Plc, Service, SharedPlc};
use std::path::Path;
use std::process::{Command, Stdio};

/// What is promised of a record through four processes, and asked of five as well, us.
const GOAL_US: (f64, f64) = (500.0, 2000.0);
/// What is promised of the first record through five, us: no stage keeps it back.
const GOAL_FIRST_US: f64 = 1000.0;
/// How often a chain is started for its first record.
const STARTS: usize = 25;
/// Scans before the measurement.
const FIRST: usize = 100;
const FRAME: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/testdata/cablar.toml");

/// Measures and prints; an error only where the measurement fails.
pub fn table(scans: u64) -> Result<(), Failure> {
    println!("last byte of a scan to acknowledged write, 761 beams at 100 Hz, {scans} scans, us");
    println!("{:<44} {:>8} {:>8} {:>8}", "", "p50", "p99", "max");
    let recording = Recording::at_100_hz(500)?;
    for (processes, delay) in [("four", ""), ("five", "--delay 10ms")] {
        for format in ["csv", "mcap"] {
            let chain = Chain {
                format,
                deskew: "self",
                delay,
            };
            let mut spans = chain
                .pushed(&recording, scans + FIRST as u64)?
                .split_off(FIRST);
            line(
                &format!("{processes} processes, {format}"),
                &mut spans,
                Some(GOAL_US),
            );
        }
    }
    let (p50, p99) = GOAL_US;
    println!("{:<44} {p50:>8.0} {p99:>8.0}", "goal");
    println!("the first scan of a run, five processes just started, {STARTS} runs, us");
    for format in ["csv", "mcap"] {
        // The first scan's motion is known when the second has come: here nothing waits for it.
        let chain = Chain {
            format,
            deskew: "none",
            delay: "--delay 10ms",
        };
        let mut firsts = (0..STARTS)
            .map(|_| Ok(chain.pushed(&recording, 3)?[0]))
            .collect::<Result<Vec<i64>, Failure>>()?;
        line(
            &format!("first, {format}"),
            &mut firsts,
            Some((GOAL_FIRST_US, f64::INFINITY)),
        );
    }
    println!("{:<44} {GOAL_FIRST_US:>8.0}", "goal");
    Ok(())
}

/// How the programs are called.
struct Chain {
    format: &'static str,
    deskew: &'static str,
    /// compensate-delay's options; none leave it out.
    delay: &'static str,
}

impl Chain {
    /// How long each scan took, ns.
    fn pushed(&self, recording: &Recording, scans: u64) -> Result<Vec<i64>, Failure> {
        let Chain {
            format,
            deskew,
            delay,
        } = *self;
        let plc = SharedPlc::new(Plc::with_sick_value());
        let address = ([127, 0, 0, 1], 0).into();
        let service =
            Service::start(&plc, address, Conditions::default()).map_err(during("PLC"))?;
        let scanner = Scanner::replay(recording)?;
        let relay = Relay::start(&scanner.address, Pieces::Telegrams)?;
        let bin = Path::new(env!("CARGO_BIN_EXE_ads-push"));
        let bin = bin.parent().ok_or("no programs")?.display();
        let compensate = match delay {
            "" => String::new(),
            delay => format!("| {bin}/compensate-delay -q {delay}"),
        };
        let chain = format!(
            "set -o pipefail; {bin}/scan-capture -q {} -n {scans} --format {format} \
              | {bin}/extract-lines -q -f {FRAME} --deskew {deskew} \
             | {bin}/solve-pose -q -f {FRAME} --pitch-deg 0 \
             {compensate} | {bin}/ads-push -q {} MAIN.SickValue --stamp-push --format csv",
            relay.address,
            service.target(&plc)
        );
        let ended = Command::new("bash")
            .args(["-c", &chain])
            .stdin(Stdio::null())
            .stderr(Stdio::inherit())
            .output()
            .map_err(during("chain"))?;
        let sent = relay.end()?;
        let text = String::from_utf8(ended.stdout).map_err(during("poses"))?;
        let mut rows = text.lines();
        let header: Vec<&str> = rows.next().unwrap_or_default().split(',').collect();
        let place = header.iter().position(|name| *name == "pushed_ns");
        let place = place.ok_or("ads-push wrote no pushed_ns")?;
        let stamps: Vec<i64> = rows
            .filter_map(|row| row.split(',').nth(place)?.parse().ok())
            .collect();
        let writes = plc.lock().writes("MAIN.SickValue");
        if !ended.status.success()
            || stamps.len() as u64 != scans
            || writes < scans
            || sent.len() < stamps.len()
        {
            return Err(format!(
                "{} of {scans} poses stamped, {writes} written, {} scans sent, {}",
                stamps.len(),
                sent.len(),
                ended.status
            ));
        }
        let pairs = sent.iter().zip(&stamps);
        Ok(pairs.map(|(sent, pushed)| pushed - sent.utc.ns()).collect())
    }
}
