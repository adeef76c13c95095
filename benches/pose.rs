//! What a scan costs in solve-pose's joint estimate, without input and output.
//! `cargo bench --bench pose` prints figures and passes no judgement.

use cablepose::edges::EdgeMeter;
use cablepose::frame::{Frame, ScannerModel};
use cablepose::lines::reflectors::{Options, ReflectorFit};
use cablepose::pose::joint::{self, Estimator};
use cablepose::pose::pitch::Pitch;
use cablepose::record::{Axes, ReflectorLines, Stamp};
use cablepose::simulate::{Course, Parameters, Scatter, Seed, Setup, Simulator};
use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

const SCANS: u64 = 400;
const ROUNDS: usize = 20;
const CABLAR: &str = include_str!("../testdata/cablar.toml");
const INCLINED: &str = include_str!("../testdata/inclined.toml");

fn main() {
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
        let Ok(frame) = Frame::parse(text, Path::new("frame.toml")) else {
            return;
        };
        let scans = lines(&frame, effects);
        let mut estimator = Estimator::new(&frame, joint::Options::default());
        let mut best = f64::INFINITY;
        let mut edges = 0;
        for _ in 0..ROUNDS {
            edges = 0;
            let start = Instant::now();
            for (lines, pitch_rad) in &scans {
                let pitch = sigma_rad.map(|sigma_rad| Pitch {
                    rad: *pitch_rad,
                    sigma_rad,
                    stale: false,
                });
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
}

/// Lines and edges of a platform anywhere in the workspace, each with its true pitch.
fn lines(frame: &Frame, effects: &str) -> Vec<(ReflectorLines, f64)> {
    let tilt = 1f64.to_radians();
    let scatter = Scatter {
        position_m: [[-0.05, 0.05], [-4.0, 4.0], [0.5, 3.5]],
        rotation_rad: [[-tilt, tilt]; 3],
    };
    let Some(model) = ScannerModel::by_name("lms511-hr") else {
        return Vec::new();
    };
    let Ok(effects) = effects.parse() else {
        return Vec::new();
    };
    let mut simulator = Simulator::new(Setup {
        frame: frame.clone(),
        model,
        mode: model.modes[0],
        course: Course::Stations {
            poses: scatter.poses(Seed(1), SCANS).into(),
            scans_each: 1,
        },
        effects,
        parameters: Parameters::default(),
        seed: Seed(1),
        start: Stamp::from_ns(0),
        scans: Some(SCANS),
        imu_rate_hz: None,
        imu_axes: Axes::Platform,
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
    all
}
