//! How fast scans of 761 beams with remissions are read and written, and how fast they go through
//! a pipe; scans a second, the best of five runs.
//!
//! `cargo bench --bench streams`

use cablepose::record::Scan;
use cablepose::stream::{Encoding, Input, Options, Output};
use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::Instant;

const SCANS: u32 = 20_000;
const RUNS: usize = 5;
const BEAMS: u32 = 761;

fn scan(seq: u32) -> Scan {
    let wave = |i: u32| f64::from((i * 37 + seq * 11) % 4001);
    Scan {
        seq,
        angle_min_rad: (-5f64).to_radians(),
        angle_increment_rad: 0.25f64.to_radians(),
        time_increment_s: 0.25 / 360.0 / 35.0,
        scan_time_s: 1.0 / 35.0,
        range_min_m: 0.2,
        range_max_m: 65.0,
        ranges_m: (0..BEAMS).map(|i| (1500.0 + wave(i)) / 1e3).collect(),
        remissions: (0..BEAMS)
            .map(|i| (wave(i) / 16.0).floor() as f32)
            .collect(),
        ..Scan::default()
    }
}

fn write(path: &Path, encoding: Encoding) {
    let options = Options {
        output: Some(path.to_owned()),
        format: Some(encoding),
        ..options()
    };
    let mut output = Output::open(&options).expect("output");
    let scans: Vec<Scan> = (0..50).map(scan).collect();
    for scan in scans.iter().cycle().take(SCANS as usize) {
        output.write(scan).expect("write");
    }
    output.finish().expect("finish");
}

fn read(path: &Path) {
    let mut input = Input::<Scan>::open(Some(path), &options()).expect("input");
    let mut count = 0;
    while let Some(scan) = input.next().expect("read") {
        assert_eq!(scan.beams(), BEAMS as usize);
        count += 1;
    }
    assert_eq!(count, SCANS);
}

fn options() -> Options {
    Options {
        tool: "streams",
        quiet: true,
        ..Options::default()
    }
}

fn rate(name: &str, mut run: impl FnMut()) {
    let best = (0..RUNS)
        .map(|_| {
            let start = Instant::now();
            run();
            start.elapsed().as_secs_f64()
        })
        .fold(f64::INFINITY, f64::min);
    println!(
        "{name:<24} {:>8.1} k scans/s",
        f64::from(SCANS) / best / 1e3
    );
}

fn main() {
    let dir = std::env::temp_dir().join(format!("cablepose-streams-{}", std::process::id()));
    fs::create_dir_all(&dir).expect("directory");
    let null = Path::new("/dev/null");
    let fifo = dir.join("fifo");
    let made = Command::new("mkfifo").arg(&fifo).status();
    for (encoding, name) in [(Encoding::Csv, "csv"), (Encoding::Mcap, "mcap")] {
        rate(&format!("{name} write"), || write(null, encoding));
        let file = dir.join(name);
        write(&file, encoding);
        rate(&format!("{name} read, file"), || read(&file));
        if made.as_ref().is_ok_and(std::process::ExitStatus::success) {
            rate(&format!("{name} through a pipe"), || {
                let path = fifo.clone();
                let writer = std::thread::spawn(move || write(&path, encoding));
                read(&fifo);
                writer.join().expect("writer");
            });
        }
    }
    fs::remove_dir_all(&dir).expect("directory");
}
