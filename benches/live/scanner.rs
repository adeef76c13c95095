//! An emulated scanner in a process of its own.

use crate::{Failure, during};
use cablepose::sick::cola::{Dialect, Event, Framer};
use cablepose::sick::encode::encode;
use cablepose::sick::scandata::{LmdScandata, is_scan};
use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

const FRAME: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/testdata/cablar.toml");
/// How long the emulator may take to end once its client has had everything.
const ENDS_IN: Duration = Duration::from_secs(20);

/// What the emulator says of its messages with data.
#[derive(Clone, Copy, Debug, Default)]
pub struct Account {
    pub sent: u64,
    pub lost_on_purpose: u64,
    pub twice: u64,
    pub garbage_bytes: u64,
    /// Lost by a slow client, or not taken by one that left.
    pub lost_else: u64,
}

/// The process; it ends with this.
pub struct Scanner {
    process: Child,
    said: Receiver<String>,
    pub address: String,
}

impl Scanner {
    /// A scanner that makes so many scans for its first client and then leaves.
    pub fn start(scans: u64, more: &[&str]) -> Result<Scanner, Failure> {
        let (loops, scans) = ((scans / 100 + 1).to_string(), scans.to_string());
        let mut command = simulate();
        command
            .args(["--loops", &loops, "--n-scans", &scans])
            .args(more);
        Scanner::serve(command)
    }

    /// A scanner that replays a recording over and over.
    pub fn replay(recording: &Recording) -> Result<Scanner, Failure> {
        let mut command = Command::new(env!("CARGO_BIN_EXE_simulate"));
        command
            .arg("--replay")
            .arg(&recording.0)
            .args(["--repeat", "0"]);
        Scanner::serve(command)
    }

    fn serve(mut command: Command) -> Result<Scanner, Failure> {
        let mut process = command
            .args(["--serve", "127.0.0.1:0", "--hold", "--linger", "1s", "-v"])
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(during("simulate"))?;
        let stderr = process.stderr.take().ok_or("simulate has no stderr")?;
        let (tell, said) = channel();
        std::thread::spawn(move || {
            for line in BufReader::new(stderr).lines().map_while(Result::ok) {
                let _ = tell.send(line);
            }
        });
        let mut scanner = Scanner {
            process,
            said,
            address: String::new(),
        };
        while scanner.address.is_empty() {
            let line = scanner.said.recv_timeout(ENDS_IN);
            let line = line.map_err(|_| "simulate said no address")?;
            if let Some(place) = line.strip_prefix("simulate: serving lms511 at ") {
                place.clone_into(&mut scanner.address);
            }
        }
        Ok(scanner)
    }

    /// Waits for its end; what it says it has sent.
    pub fn end(self) -> Result<Account, Failure> {
        let due = Instant::now() + ENDS_IN;
        let mut account = None;
        while let Ok(line) = self.said.recv_timeout(due - Instant::now().min(due)) {
            if line.contains(" lost on purpose") {
                account = read_account(&line);
            }
        }
        account.ok_or_else(|| "simulate gave no account of its messages".to_owned())
    }
}

impl Drop for Scanner {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// The simulated scanner: 761 beams in the frame of the README.
fn simulate() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_simulate"));
    command.args(["-f", FRAME, "--trajectory", "loop"]);
    command
}

/// A recorded byte stream; its file goes with this.
pub struct Recording(PathBuf);

impl Recording {
    /// Scans of 761 beams, which an LMS511 makes 35 times a second, at 100 Hz: every 10 ms by their
    /// ticks, which is what a replay goes by. The platform creeps: at other ticks a fast one would move
    /// otherwise between the scans than within them, and extract-lines would start anew all the time.
    pub fn at_100_hz(scans: u32) -> Result<Recording, Failure> {
        const PERIOD_US: u32 = 10_000;
        let made = simulate()
            .args(["-q", "--n-scans", &scans.to_string(), "--format", "cola"])
            .args(["--speed-m-s", "0.05"])
            .output()
            .map_err(during("simulate"))?;
        let (mut framer, mut stream) = (Framer::new(), Vec::new());
        let (mut scan, mut number) = (LmdScandata::default(), 0);
        framer.feed(&made.stdout);
        while let Some(event) = framer.next() {
            if let Event::Telegram(telegram) = event
                && is_scan(&telegram)
            {
                scan.parse(&telegram).map_err(during("simulated scan"))?;
                let way_us = scan.transmit_tick_us.wrapping_sub(scan.scan_tick_us);
                scan.scan_tick_us = number * PERIOD_US;
                scan.transmit_tick_us = scan.scan_tick_us + way_us;
                encode(&scan, Dialect::Binary, &mut stream);
                number += 1;
            }
        }
        if number != scans {
            return Err(format!("simulate made {number} scans, not {scans}"));
        }
        let name = format!("cablepose-bench-live-{}.cola", std::process::id());
        let path = std::env::temp_dir().join(name);
        std::fs::write(&path, stream).map_err(during("recording"))?;
        Ok(Recording(path))
    }
}

impl Drop for Recording {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
    }
}

fn read_account(line: &str) -> Option<Account> {
    Some(Account {
        sent: number_before(line, " messages to")?,
        lost_on_purpose: number_before(line, " lost on purpose")?,
        twice: number_before(line, " sent twice")?,
        garbage_bytes: number_before(line, " bytes of garbage")?,
        lost_else: number_before(line, " lost by slow")? + number_before(line, " not taken by")?,
    })
}

/// The number just before some words.
pub fn number_before(text: &str, words: &str) -> Option<u64> {
    let (before, _) = text.split_once(words)?;
    let digits = before.rsplit(|c: char| !c.is_ascii_digit()).next()?;
    digits.parse().ok()
}
