//! Telegrams a second from bytes to fields and from bytes to a scan record, on one core: 1141
//! distances and 1141 remissions, in both dialects, fed as TCP would (1448 bytes) and in blocks.

use cablepose::sick::cola::{Dialect, Event, Framer};
use cablepose::sick::encode::encode;
use cablepose::sick::replay::{Replay, Settings};
use cablepose::sick::scandata::{Channel, LmdScandata, Width, is_scan};
use std::hint::black_box;
use std::time::{Duration, Instant};

const TELEGRAMS: u16 = 1000;

fn stream(dialect: Dialect) -> Vec<u8> {
    let channel = |name, width, values| Channel {
        name,
        width,
        scale: 1.0,
        start_angle: -50_000,
        angular_step: 1667,
        values,
        ..Channel::default()
    };
    let mut out = Vec::new();
    for number in 0..TELEGRAMS {
        let distances = (0..1141).map(|beam| 400 + 7 * beam % 2500 + number % 9);
        let remissions = (0..1141).map(|beam| 90 + beam % 165);
        let scan = LmdScandata {
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
        };
        encode(&scan, dialect, &mut out);
    }
    out
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
    for (name, dialect) in [("CoLa B", Dialect::Binary), ("CoLa A", Dialect::Text)] {
        let stream = stream(dialect);
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
                println!("{name}, chunks of {chunk:5}, to {kind}: {rate:10.0} telegrams/s");
            }
        }
    }
}
