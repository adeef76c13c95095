//! What a scan costs in solve-pose's joint estimate, without input and output.
//! `cargo bench --bench pose` prints figures and passes no judgement.

use cablepose::edges::EdgeMeter;
use cablepose::frame::Frame;
use cablepose::lines::reflectors::{Options, ReflectorFit};
use cablepose::pose::joint::{self, Estimator};
use cablepose::pose::pitch::Pitch;
use cablepose::record::ReflectorLines;
use cablepose::simulate::{Course, Scatter, Seed, Setup, Simulator};
use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

const SCANS: u64 = 400;
const ROUNDS: usize = 20;
const CABLAR: &str = include_str!("../testdata/cablar.toml");
const INCLINED: &str = include_str!("../testdata/inclined.toml");

fn main() -> anyhow::Result<()> {
    let exact = Some(0.0);
    let imu = Some(0.5f64.to_radians());
    for (name, text, effects, sigma_rad) in [
        ("ranges", CABLAR, "reference,-remission", exact),
        ("ranges, mixed", CABLAR, "reference,mixed,-remission", exact),
        ("remission", CABLAR, "reference,mixed", exact),
        ("remission, IMU", CABLAR, "reference,mixed", imu),
        (
            "wall strips, ranges",
            INCLINED,
            "reference,mixed,-remission",
            imu,
        ),
        ("wall strips", INCLINED, "reference,mixed", imu),
        ("wall strips, no IMU", INCLINED, "reference,mixed", None),
        ("no IMU", CABLAR, "reference,mixed", None),
    ] {
        let frame = Frame::parse(text, Path::new("frame.toml"))?;
        let scans = lines(&frame, effects)?;
        let mut estimator = Estimator::new(&frame, joint::Options::default());
        let mut best = f64::INFINITY;
        let mut edges = 0;
        for _ in 0..ROUNDS {
            edges = 0;
            let start = Instant::now();
            for (lines, pitch_rad) in &scans {
                let pitch = sigma_rad.map(|sigma_rad| Pitch::within(*pitch_rad, sigma_rad));
                let pose = estimator.solve(black_box(lines), pitch, &[]);
                edges += black_box(&pose).edges;
            }
            best = best.min(start.elapsed().as_secs_f64());
        }
        println!(
            "{name:20} {:7.2} us a scan   {:.2} edges a scan",
            1e6 * best / scans.len() as f64,
            f64::from(edges) / scans.len() as f64
        );
    }
    Ok(())
}

/// Lines and edges of a platform anywhere in the workspace, each with its true pitch.
fn lines(frame: &Frame, effects: &str) -> anyhow::Result<Vec<(ReflectorLines, f64)>> {
    let course = Course::scattered(Scatter::workspace([0.5, 3.5]), Seed(1), SCANS);
    let mut simulator = Simulator::new(Setup {
        effects: effects.parse()?,
        ..Setup::new(frame.clone(), course)
    });
    let mut fit = ReflectorFit::new(frame, Options::default());
    let mut meter = EdgeMeter::new(frame);
    let mut all = Vec::new();
    while let Some(step) = simulator.advance() {
        let mut lines = ReflectorLines::default();
        lines.begin(&step.scan);
        if let Some(found) = fit.fit(&step.scan) {
            fit.record(&found, &mut lines);
            meter.measure(&step.scan, &mut lines);
        }
        all.push((lines, step.truth.rotation_rad[1]));
    }
    Ok(all)
}
