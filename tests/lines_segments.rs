//! Split-and-merge on a real scanner's recorded bytes: the wall that every extractor tried finds.
//!
//! The recording (an LMS511, 174 scans) is kept outside the repository, in `../shared/data` or
//! where CABLEPOSE_DATA says; without it the test says so and passes.

use cablepose::lines::extractor::Extractor;
use cablepose::lines::split_and_merge::SplitAndMerge;
use cablepose::record::{NormalLine, Scan, Segment};
use cablepose::sick::cola::{Event, Framer};
use cablepose::sick::replay::{Replay, Settings};
use cablepose::sick::scandata::{self, LmdScandata};
use std::path::{Path, PathBuf};

const RECORDING: &str = "lms5xx/20210302_lms511.cola";

/// The wall: its distance is from the recording, its direction about -13.5 deg in beam angles.
const WALL_M: f64 = 1.292;
const WALL_DEG: f64 = -13.5;

fn recording() -> Option<PathBuf> {
    let data = std::env::var_os("CABLEPOSE_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"),
        PathBuf::from,
    );
    let path = data.join(RECORDING);
    path.is_file().then_some(path)
}

fn scans(path: &Path) -> Vec<Scan> {
    let bytes = std::fs::read(path).unwrap();
    let mut framer = Framer::new();
    framer.feed(&bytes);
    framer.end();
    let mut replay = Replay::new(Settings::default());
    let mut telegram = LmdScandata::default();
    let mut scans = Vec::new();
    while let Some(event) = framer.next() {
        if let Event::Telegram(bytes) = event
            && scandata::is_scan(&bytes)
        {
            telegram.parse(&bytes).unwrap();
            scans.extend(replay.push(&telegram, None).unwrap().cloned());
        }
    }
    scans
}

/// alpha is kept in (-90, 270] deg, in which -13.5 deg is itself.
fn is_the_wall(normal: &NormalLine) -> bool {
    (normal.d_m - WALL_M).abs() < 0.01 && (normal.alpha_rad.to_degrees() - WALL_DEG).abs() < 0.5
}

fn scatter(values: &[f64]) -> f64 {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt()
}

#[test]
fn the_wall_of_the_recording_is_in_every_scan() {
    let Some(path) = recording() else {
        eprintln!("skipped: no {RECORDING} in ../shared/data or CABLEPOSE_DATA");
        return;
    };
    let scans = scans(&path);
    assert_eq!(scans.len(), 174);
    let mut extractor = SplitAndMerge::default();
    let mut segments: Vec<Segment> = Vec::new();
    let mut walls = Vec::new();
    for scan in &scans {
        extractor.extract(scan, &mut segments);
        let wall = segments.iter().find(|s| is_the_wall(&s.normal));
        walls.push(*wall.unwrap_or_else(|| panic!("no wall in scan {}: {segments:#?}", scan.seq)));
    }
    let d_mm: Vec<f64> = walls.iter().map(|s| 1e3 * s.normal.d_m).collect();
    let alpha_deg: Vec<f64> = walls
        .iter()
        .map(|s| s.normal.alpha_rad.to_degrees())
        .collect();
    let (d_mm, alpha_deg) = (scatter(&d_mm), scatter(&alpha_deg));
    eprintln!("scatter {d_mm:.3} mm, {alpha_deg:.4} deg");
    assert!(d_mm < 0.72, "{d_mm} mm");
    assert!(alpha_deg < 0.07, "{alpha_deg} deg");
}
