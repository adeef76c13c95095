//! Telegrams a second from bytes to fields (frame, XOR and every field) and from bytes to a scan
//! record with its stamp, on one core: the scans of a recorded LMS511, 1141 distances and 1141
//! remissions each, in both dialects, fed as TCP would (1448 bytes) and in blocks. Where the
//! recording is absent, synthetic scans of the same size stand in, and the first line says so.
//!
//! Ends with status 1 where a goal is missed: 1 000 000 telegrams/s to fields in CoLa B, 25 000 in
//! CoLa A.

use cablepose::sick::cola::{Dialect, Event, Framer};
use cablepose::sick::encode::encode;
use cablepose::sick::replay::{Replay, Settings};
use cablepose::sick::scandata::{Channel, LmdScandata, Width, is_scan};
use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

const TELEGRAMS: u16 = 1000;

/// The scans of the recorded LMS511, repeated with counters and ticks that go on; none where the
/// recording is absent.
fn recorded() -> Option<Vec<LmdScandata>> {
    let data = std::env::var_os("CABLEPOSE_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"),
        PathBuf::from,
    );
    let bytes = std::fs::read(data.join("lms5xx/20210302_lms511.cola")).ok()?;
    let mut framer = Framer::new();
    let mut scans = Vec::new();
    framer.feed(&bytes);
    while let Some(event) = framer.next() {
        let mut scan = LmdScandata::default();
        if let Event::Telegram(found) = event
            && is_scan(&found)
            && scan.parse(&found).is_ok()
        {
            scans.push(scan);
        }
    }
    let numbers = 0..TELEGRAMS;
    let all = numbers
        .zip(scans.iter().cycle())
        .map(|(number, scan)| LmdScandata {
            telegram_counter: number,
            scan_counter: number,
            scan_tick_us: 40_000 * u32::from(number),
            transmit_tick_us: 40_000 * u32::from(number) + 40_650,
            ..scan.clone()
        });
    Some(all.collect())
}

fn synthetic() -> Vec<LmdScandata> {
    let channel = |name, width, values| Channel {
        name,
        width,
        scale: 1.0,
        start_angle: -50_000,
        angular_step: 1667,
        values,
        ..Channel::default()
    };
    let scan = |number: u16| {
        let distances = (0..1141).map(|beam| 400 + 7 * beam % 2500 + number % 9);
        let remissions = (0..1141).map(|beam| 90 + beam % 165);
        LmdScandata {
            telegram_counter: number,
            scan_counter: number,
            scan_tick_us: 40_000 * u32::from(number),
            transmit_tick_us: 40_000 * u32::from(number) + 40_650,
            scan_frequency: 2500,
            measurement_frequency: 540,
            channels: vec![
                channel(*b"DIST1", Width::Bits16, distances.collect()),
                channel(*b"RSSI1", Width::Bits8, remissions.collect()),
            ],
            ..LmdScandata::default()
        }
    };
    (0..TELEGRAMS).map(scan).collect()
}

fn decode(stream: &[u8], chunk: usize, to_records: bool) {
    let mut framer = Framer::new();
    let mut telegram = LmdScandata::default();
    let mut replay = Replay::new(Settings::default());
    let mut scans = 0;
    for chunk in stream.chunks(chunk) {
        framer.feed(chunk);
        while let Some(event) = framer.next() {
            if let Event::Telegram(found) = event
                && is_scan(&found)
                && telegram.parse(&found).is_ok()
            {
                scans += 1;
                black_box(&telegram);
                if to_records {
                    let _ = black_box(replay.push(&telegram, None));
                }
            }
        }
    }
    assert_eq!(scans, TELEGRAMS);
}

fn main() {
    let scans = recorded().unwrap_or_else(|| {
        println!("no recording: synthetic scans of its size (set CABLEPOSE_DATA)");
        synthetic()
    });
    let mut missed = false;
    for (name, dialect, goal) in [
        ("CoLa B", Dialect::Binary, 1e6),
        ("CoLa A", Dialect::Text, 25e3),
    ] {
        let mut stream = Vec::new();
        for scan in &scans {
            encode(scan, dialect, &mut stream);
        }
        let size = stream.len() / scans.len();
        for chunk in [1448, 1 << 16] {
            for (kind, to_records) in [("fields", false), ("record", true)] {
                let begin = Instant::now();
                let mut best = Duration::MAX;
                while begin.elapsed() < Duration::from_secs(1) {
                    let start = Instant::now();
                    decode(&stream, chunk, to_records);
                    best = best.min(start.elapsed());
                }
                let rate = f64::from(TELEGRAMS) / best.as_secs_f64();
                println!(
                    "{name}, {size} bytes, chunks of {chunk:5}, to {kind}: {rate:10.0} telegrams/s"
                );
                if !to_records && rate < goal {
                    println!("  below the goal of {goal:.0}");
                    missed = true;
                }
            }
        }
    }
    std::process::exit(missed.into());
}
