//! What a scan of 761 beams costs in extract-lines' two rooms, reflector fit and edges, without
//! input and output: processor time, so that a busy machine does little harm. `cargo bench --bench
//! edges` prints figures and passes no judgement.

mod timing;

use cablepose::edges::EdgeMeter;
use cablepose::frame::Frame;
use cablepose::lines::reflectors::{Options, ReflectorFit};
use cablepose::record::{ReflectorLines, Scan};
use cablepose::simulate::{Course, Scatter, Seed, Setup, Simulator};
use std::hint::black_box;
use std::path::Path;
use timing::thread_s;

const SCANS: u64 = 400;
const ROUNDS: usize = 10;

fn main() -> anyhow::Result<()> {
    let text = include_str!("../testdata/cablar.toml");
    let frame = Frame::parse(text, Path::new("cablar.toml"))?;
    for (name, effects, track, edges) in [
        ("reflectors", "reference,mixed,-remission", true, false),
        ("+ intervals", "reference,mixed,-remission", true, true),
        ("+ remissions", "reference,mixed", true, true),
        ("+ echoes", "reference,mixed,echoes", true, true),
        (
            "cold, cluttered",
            "reference,mixed,outliers,dropouts,cables,cargo",
            false,
            true,
        ),
    ] {
        let scans = scans(&frame, effects, track)?;
        let options = Options {
            track,
            ..Options::default()
        };
        let mut fit = ReflectorFit::new(&frame, options);
        let mut lines = ReflectorLines::default();
        let mut found = 0;
        let mut best = f64::INFINITY;
        for _ in 0..ROUNDS {
            found = 0;
            let mut meter = EdgeMeter::new(&frame);
            let start_s = thread_s();
            for scan in &scans {
                if !track {
                    meter = EdgeMeter::new(&frame);
                }
                lines.begin(black_box(scan));
                if let Some(fitted) = fit.fit(scan) {
                    fit.record(&fitted, &mut lines);
                    if edges {
                        meter.measure(scan, &mut lines);
                    }
                }
                found += black_box(&lines)
                    .edges
                    .iter()
                    .filter(|e| e.strip >= 0)
                    .count();
            }
            best = best.min(thread_s() - start_s);
        }
        println!(
            "{name:16} {:7.2} us a scan   {:.2} edges a scan",
            1e6 * best / scans.len() as f64,
            found as f64 / scans.len() as f64
        );
    }
    Ok(())
}

/// Scans of a platform that creeps (tracked) or is anywhere (cold).
fn scans(frame: &Frame, effects: &str, track: bool) -> anyhow::Result<Vec<Scan>> {
    let (stations, scans_each) = if track { (SCANS / 40, 40) } else { (SCANS, 1) };
    let poses = Scatter::workspace([0.5, 3.5]).poses(Seed(7), stations);
    let course = Course::Stations {
        poses: poses.into(),
        scans_each,
    };
    let mut simulator = Simulator::new(Setup {
        effects: effects.parse()?,
        seed: Seed(7),
        ..Setup::new(frame.clone(), course)
    });
    let mut scans = Vec::new();
    while let Some(step) = simulator.advance() {
        scans.push(step.scan.clone());
    }
    Ok(scans)
}
