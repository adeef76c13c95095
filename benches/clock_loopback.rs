//! How well an emulated scanner's clock is found over a real loopback, idle and under load.
//! `make clock-loopback` prints the errors beside the goals and fails where one is missed.
//!
//! The truth is known: the emulator counts on the host's monotonic raw clock, from an instant that it
//! tells, with the rate that it is given. What is measured is everything else: two processes, the
//! kernel's network, sleeping CPUs.

use serde_json::Value;
use std::hint::black_box;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, ExitCode, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

const PPM: f64 = 20.0;
const UPTIME_S: f64 = 100.0;

fn main() -> ExitCode {
    let seconds = std::env::args().filter_map(|a| a.parse().ok()).next();
    match measure(seconds.unwrap_or(60)) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("clock-loopback: {error}");
            ExitCode::FAILURE
        }
    }
}

/// Whether all goals were met.
fn measure(seconds: u32) -> Result<bool, String> {
    println!(
        "{:<14} {:>10} {:>10} {:>10} {:>9} {:>9} {:>8}",
        "", "offset us", "drift ppb", "rtt us", "gap us", "exchanges", "goal us"
    );
    let mut all = true;
    for (name, busy, goal_us) in [("idle", 0, 15.0), ("4 busy", 4, 2.0), ("16 busy", 16, 2.0)] {
        let scanner = Scanner::start()?;
        let load = Load::new(busy);
        let log = std::env::temp_dir().join(format!("clock-loopback-{}.csv", std::process::id()));
        let polled = timesync(&[
            "poll",
            &scanner.address,
            "--for",
            &format!("{seconds}s"),
            "-o",
        ])
        .arg(&log)
        .status()
        .map_err(|error| error.to_string())?;
        drop(load);
        let fitted = timesync(&["fit", "--json"])
            .arg(&log)
            .output()
            .map_err(|error| error.to_string())?;
        let _ = std::fs::remove_file(&log);
        if !polled.success() || !fitted.status.success() {
            return Err(format!(
                "{name}: timesync ended with {polled}, {}",
                fitted.status
            ));
        }
        let found: Value = serde_json::from_slice(&fitted.stdout).map_err(|e| e.to_string())?;
        let number = |key: &str| found[key].as_f64().unwrap_or(f64::NAN);
        let at_ns = found["at_host_ns"].as_i64().unwrap_or(0);
        let elapsed_ns = (at_ns - scanner.start_ns) as f64;
        let truth_ns = (UPTIME_S * 1e9 - scanner.start_ns as f64) + elapsed_ns * PPM * 1e-6;
        let off_us = (number("offset_ns") - truth_ns) * 1e-3;
        let held = off_us.abs() <= goal_us;
        all &= held;
        println!(
            "{name:<14} {off_us:>10.2} {:>10.1} {:>10.1} {:>9.1} {:>9} {:>8}{}",
            number("drift_ppb") - PPM * 1e3,
            number("rtt_min_ns") * 1e-3,
            number("hull_gap_ns") * 1e-3,
            number("exchanges"),
            goal_us,
            if held { "" } else { "  MISSED" }
        );
    }
    Ok(all)
}

fn timesync(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_timesync"));
    command.args(arguments);
    command
}

/// An emulated scanner; it ends with this.
struct Scanner {
    process: Child,
    address: String,
    start_ns: i64,
}

impl Scanner {
    fn start() -> Result<Scanner, String> {
        let frame = concat!(env!("CARGO_MANIFEST_DIR"), "/testdata/cablar.toml");
        let (ppm, uptime) = (PPM.to_string(), UPTIME_S.to_string());
        let mut process = Command::new(env!("CARGO_BIN_EXE_simulate"))
            .args(["-f", frame, "--trajectory", "grid", "--step-m", "0.1", "-v"])
            .args(["--serve", "127.0.0.1:0", "--linger", "600s"])
            .args(["--clock-ppm", &ppm, "--uptime-s", &uptime])
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|error| error.to_string())?;
        let stderr = process.stderr.take().ok_or("no stderr")?;
        let mut lines = BufReader::new(stderr).lines().map_while(Result::ok);
        let (mut address, mut start_ns) = (None, None);
        for line in &mut lines {
            if let Some(place) = line.strip_prefix("simulate: serving lms511 at ") {
                address = Some(place.to_owned());
            } else if line.contains("counter was")
                && let Some((_, rest)) = line.split_once(" s at ")
            {
                start_ns = rest.split(' ').next().and_then(|ns| ns.parse().ok());
            }
            if address.is_some() && start_ns.is_some() {
                break;
            }
        }
        std::thread::spawn(move || lines.for_each(drop));
        Ok(Scanner {
            process,
            address: address.ok_or("the scanner said no address")?,
            start_ns: start_ns.ok_or("the scanner said no start")?,
        })
    }
}

impl Drop for Scanner {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Threads that do nothing, and much of it.
struct Load(Arc<AtomicBool>);

impl Load {
    fn new(threads: usize) -> Load {
        let stop = Arc::new(AtomicBool::new(false));
        for _ in 0..threads {
            let stop = Arc::clone(&stop);
            std::thread::spawn(move || {
                let mut number = 1u64;
                while !stop.load(Ordering::Relaxed) {
                    number = black_box(number.wrapping_mul(6_364_136_223_846_793_005) + 1);
                }
            });
        }
        Load(stop)
    }
}

impl Drop for Load {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}
