//! What a calibration from a run leaves of the survey's errors, beside the goals.
//! `make calibration-table` (`cargo bench --bench calibration`) prints the table and ends with an
//! error where a goal is missed.
//!
//! In every campaign the strips of the true frame are elsewhere than the frame file says, each edge by
//! an error of 2 mm; 600 scans at scattered places are solved with the frame file, the run calibrates
//! it, and 300 other scans are solved with it as it was, as it is now, and with the true one. A common
//! shift of all strips along x and a common turn about the vertical, which no run shows, are taken
//! out of edges and poses.

use cablepose::edges::EdgeMeter;
use cablepose::frame::Frame;
use cablepose::lines::reflectors::{self, ReflectorFit};
use cablepose::pose::calibration::{Calibration, Calibrator, Settings};
use cablepose::pose::joint::{self, Estimator};
use cablepose::pose::pitch::{Attitude, Pitch};
use cablepose::record::{Face, ReflectorLines};
use cablepose::simulate::random::Purpose;
use cablepose::simulate::{Course, Scatter, Seed, Setup, Simulator, Step};
use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

const CAMPAIGNS: u64 = 8;
const SCANS: u64 = 600;
const CHECKS: u64 = 300;
const SURVEY_M: f64 = 0.002;
const PITCH_BIAS_DEG: f64 = 0.31;

/// A kind of campaign.
struct Case {
    name: &'static str,
    frame: &'static str,
    effects: &'static str,
    /// Half of the range of x, m, and of the angles, deg.
    x_m: f64,
    tilt_deg: f64,
    x_constant: bool,
    /// Standard deviation of a constant error of the pitch, deg.
    pitch_bias_deg: f64,
    /// Largest rms of the observable edge patterns, mm, and of the pitch bias, deg, after it.
    edges_goal_mm: f64,
    pitch_goal_deg: f64,
    /// Whether x after it must be that with the true frame (within 5 %).
    x_as_true: bool,
}

const CABLAR: &str = include_str!("../testdata/cablar.toml");
const INCLINED: &str = include_str!("../testdata/inclined.toml");

const CASES: [Case; 5] = [
    Case {
        name: "strips, ranges",
        frame: CABLAR,
        effects: "reference,mixed,-remission",
        x_m: 0.05,
        tilt_deg: 1.0,
        x_constant: false,
        pitch_bias_deg: 0.0,
        edges_goal_mm: 0.5,
        pitch_goal_deg: f64::INFINITY,
        x_as_true: false,
    },
    Case {
        name: "strips, remission",
        frame: CABLAR,
        effects: "reference,mixed",
        x_m: 0.05,
        tilt_deg: 1.0,
        x_constant: false,
        pitch_bias_deg: 0.0,
        edges_goal_mm: 0.5,
        pitch_goal_deg: f64::INFINITY,
        x_as_true: true,
    },
    Case {
        name: "pitch, x constant, ranges",
        frame: CABLAR,
        effects: "reference,mixed,-remission",
        x_m: 0.002,
        tilt_deg: 1.0,
        x_constant: true,
        pitch_bias_deg: PITCH_BIAS_DEG,
        edges_goal_mm: f64::INFINITY,
        pitch_goal_deg: 0.02,
        x_as_true: false,
    },
    Case {
        name: "pitch, wall strips, ranges",
        frame: INCLINED,
        effects: "reference,mixed,-remission",
        x_m: 0.05,
        tilt_deg: 1.0,
        x_constant: false,
        pitch_bias_deg: PITCH_BIAS_DEG,
        edges_goal_mm: f64::INFINITY,
        pitch_goal_deg: 0.02,
        x_as_true: false,
    },
    Case {
        name: "pitch, wall strips, remission",
        frame: INCLINED,
        effects: "reference,mixed",
        x_m: 0.05,
        tilt_deg: 1.0,
        x_constant: false,
        pitch_bias_deg: PITCH_BIAS_DEG,
        edges_goal_mm: f64::INFINITY,
        pitch_goal_deg: 0.02,
        x_as_true: true,
    },
];

/// Squared errors of a campaign, before and after.
#[derive(Default)]
struct Sums {
    edges: [f64; 2],
    edge_count: f64,
    pitch: [f64; 2],
    /// x and yaw with the surveyed, calibrated and true frame.
    x: [f64; 3],
    yaw: [f64; 3],
    checks: f64,
    /// Squared errors of all parameters over their posterior variances.
    nees: f64,
    nees_count: f64,
    seconds: f64,
    hidden: usize,
}

fn main() -> ExitCode {
    let only = std::env::args().skip(1).find(|a| !a.starts_with('-'));
    println!(
        "{:<30} {:>15} {:>17} {:>20} {:>23} {:>5} {:>6}",
        "case (8 campaigns)",
        "edges mm",
        "pitch deg",
        "x mm svy/cal/true",
        "yaw deg svy/cal/true",
        "NEES",
        "s"
    );
    let mut missed = Vec::new();
    for case in &CASES {
        if only
            .as_ref()
            .is_some_and(|o| !case.name.contains(o.as_str()))
        {
            continue;
        }
        let mut sums = Sums::default();
        for seed in 1..=CAMPAIGNS {
            campaign(case, seed, &mut sums);
        }
        report(case, &sums, &mut missed);
    }
    for what in &missed {
        println!("MISSED: {what}");
    }
    if missed.is_empty() {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}

fn report(case: &Case, sums: &Sums, missed: &mut Vec<String>) {
    let n = CAMPAIGNS as f64;
    let edges = sums.edges.map(|s| (s / sums.edge_count).sqrt() * 1e3);
    let pitch = sums.pitch.map(|s| (s / n).sqrt());
    let x = sums.x.map(|s| (s / sums.checks).sqrt() * 1e3);
    let yaw = sums.yaw.map(|s| (s / sums.checks).sqrt().to_degrees());
    println!(
        "{:<30} {:>6.2} -> {:>5.2} {:>7.4} -> {:>6.4} {:>6.2} {:>6.2} {:>6.2} {:>7.4} {:>7.4} {:>7.4} {:>5.2} {:>6.1}",
        case.name,
        edges[0],
        edges[1],
        pitch[0],
        pitch[1],
        x[0],
        x[1],
        x[2],
        yaw[0],
        yaw[1],
        yaw[2],
        sums.nees / sums.nees_count,
        sums.seconds / n
    );
    let mut judge = |good: bool, what: String| {
        if !good {
            missed.push(format!("{}: {what}", case.name));
        }
    };
    judge(
        edges[1] <= case.edges_goal_mm,
        format!("edges {:.2} mm, goal {:.2}", edges[1], case.edges_goal_mm),
    );
    judge(
        pitch[1] <= case.pitch_goal_deg,
        format!("pitch {:.4} deg, goal {:.4}", pitch[1], case.pitch_goal_deg),
    );
    judge(
        !case.x_as_true || x[1] <= 1.05 * x[2],
        format!("x {:.3} mm, with the true frame {:.3}", x[1], x[2]),
    );
}

fn parsed(text: &str) -> Frame {
    Frame::parse(text, Path::new("frame.toml")).expect("a frame")
}

fn campaign(case: &Case, seed: u64, sums: &mut Sums) {
    let truth = parsed(case.frame);
    let mut draws = Seed(seed).draws(Purpose::FaceBias, 1_000_000);
    let mut surveyed = truth.clone();
    for strip in &mut surveyed.strips {
        let (upper, lower) = (draws.normal() * SURVEY_M, draws.normal() * SURVEY_M);
        strip.offset_m += 0.5 * (upper + lower);
        strip.width_m += upper - lower;
    }
    let bias_rad = (case.pitch_bias_deg * draws.normal()).to_radians();
    let steps = scans(case, &truth, SCANS, seed);
    let mut calibrator = Calibrator::default();
    let mut solver = Estimator::new(&surveyed, joint::Options::default());
    for (step, lines) in steps.iter().zip(lines_of(&surveyed, &steps)) {
        let [roll, pitch, _] = step.truth.rotation_rad;
        // An IMU with noise of 0.05 deg a sample and a constant error of its pitch.
        let sigma_rad = 0.05f64.to_radians();
        let with_imu = case.pitch_bias_deg > 0.0;
        let noise = if with_imu { sigma_rad } else { 0.0 };
        let attitude = Attitude {
            roll_rad: roll + noise * draws.normal(),
            pitch_rad: pitch + bias_rad + noise * draws.normal(),
            pitch_sigma_rad: noise,
            stale: false,
        };
        let pitch = Some(attitude.pitch());
        let pose = solver.solve(&lines, pitch, &[]);
        let attitude = with_imu.then_some(&attitude);
        calibrator.add(&lines, &pose, pitch, attitude, &[]);
    }
    let settings = Settings {
        x_constant_sigma_m: case.x_constant.then_some(0.002),
        ..Settings::default()
    };
    let begun = Instant::now();
    let found = calibrator
        .solve(&surveyed, &settings)
        .expect("a calibration");
    sums.seconds += begun.elapsed().as_secs_f64();
    sums.hidden = found.hidden[0];
    for (k, frame) in [&surveyed, &found.frame].into_iter().enumerate() {
        let (sum, count) = observable(frame, &truth);
        sums.edges[k] += sum;
        sums.edge_count += count * if k == 0 { 1.0 } else { 0.0 };
    }
    let change = |key: &str| entry(&found, key);
    // The IMU reads too much by the error: turned about y by it, it reads right.
    let turned_deg = change("imu.rotation_deg pitch").0;
    sums.pitch[0] += bias_rad.to_degrees().powi(2);
    sums.pitch[1] += (bias_rad.to_degrees() - turned_deg).powi(2);
    for (k, strip) in truth.strips.iter().enumerate() {
        let before = surveyed.strips[k];
        for (name, error_mm) in [
            ("offset_m", (strip.offset_m - before.offset_m) * 1e3),
            ("width_m", (strip.width_m - before.width_m) * 1e3),
        ] {
            let (change, posterior) = change(&format!("strip[{k}].{name}"));
            sums.nees += ((change - error_mm) / posterior).powi(2);
            sums.nees_count += 1.0;
        }
    }
    if std::env::var_os("VERBOSE").is_some() {
        for e in &found.entries {
            println!(
                "  {:<30} {:>8.3} {:>8.3} {:>8.3} {}",
                e.key, e.change, e.prior, e.posterior, e.unit
            );
        }
        println!(
            "  {:?} {:?} {:.1e} {:?}",
            found.patterns, found.hidden, found.condition, found.edges
        );
    }
    let checks = scans(case, &truth, CHECKS, seed + 1000);
    for (k, frame) in [&surveyed, &found.frame, &truth].into_iter().enumerate() {
        let (x, yaw) = errors(frame, &checks);
        sums.x[k] += x;
        sums.yaw[k] += yaw;
    }
    sums.checks += CHECKS as f64;
}

fn entry(found: &Calibration, key: &str) -> (f64, f64) {
    let entry = found.entries.iter().find(|e| e.key == key).expect("a key");
    (entry.change, entry.posterior)
}

fn scans(case: &Case, frame: &Frame, count: u64, seed: u64) -> Vec<Step> {
    let tilt = case.tilt_deg.to_radians();
    let scatter = Scatter {
        position_m: [[-case.x_m, case.x_m], [-4.0, 4.0], [0.5, 4.0]],
        rotation_rad: [[-tilt, tilt]; 3],
    };
    let setup = Setup {
        effects: case.effects.parse().expect("effects"),
        seed: Seed(seed),
        ..Setup::new(frame.clone(), Course::scattered(scatter, Seed(seed), count))
    };
    Simulator::new(setup).all()
}

fn lines_of(frame: &Frame, steps: &[Step]) -> Vec<ReflectorLines> {
    let mut fit = ReflectorFit::new(frame, reflectors::Options::default());
    let mut edges = EdgeMeter::new(frame);
    let lines = |step: &Step| {
        let mut lines = ReflectorLines::default();
        lines.begin(&step.scan);
        if let Some(found) = fit.fit(&step.scan) {
            fit.record(&found, &mut lines);
            edges.measure(&step.scan, &mut lines);
        }
        lines
    };
    steps.iter().map(lines).collect()
}

/// Sum of the squares of the edge errors without the two patterns that move the whole frame, and how
/// many patterns that leaves. Ceiling only.
fn observable(frame: &Frame, truth: &Frame) -> (f64, f64) {
    let mut errors = Vec::new();
    let mut patterns = [Vec::new(), Vec::new()];
    for (strip, right) in frame.strips.iter().zip(&truth.strips) {
        if strip.face != Face::Upper {
            continue;
        }
        for side in [0.5, -0.5] {
            let at = |s: &cablepose::frame::Strip| s.offset_m + side * s.width_m;
            errors.push(at(strip) - at(right));
            patterns[0].push(right.slope());
            patterns[1].push(right.slope() * at(right));
        }
    }
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let count = errors.len() as f64 - 2.0;
    let mut basis: Vec<Vec<f64>> = Vec::new();
    for mut pattern in patterns {
        for other in &basis {
            let along = dot(&pattern, other);
            pattern
                .iter_mut()
                .zip(other)
                .for_each(|(p, o)| *p -= along * o);
        }
        let size = dot(&pattern, &pattern).sqrt();
        pattern.iter_mut().for_each(|p| *p /= size);
        let along = dot(&errors, &pattern);
        errors
            .iter_mut()
            .zip(&pattern)
            .for_each(|(e, p)| *e -= along * p);
        basis.push(pattern);
    }
    (dot(&errors, &errors), count)
}

/// Sums of the squared errors of x and yaw with the pitch known, less a common shift along x and a
/// common turn about the vertical.
fn errors(frame: &Frame, steps: &[Step]) -> (f64, f64) {
    let mut rows = Vec::new();
    let mut solver = Estimator::new(frame, joint::Options::default());
    for (step, lines) in steps.iter().zip(lines_of(frame, steps)) {
        let t = &step.truth;
        let pitch = Pitch {
            rad: t.rotation_rad[1],
            sigma_rad: 0.0,
            stale: false,
        };
        let pose = solver.solve(&lines, Some(pitch), &[]);
        let x = pose.position_m[0] - t.position_m[0];
        let yaw = pose.rotation_rad[2] - t.rotation_rad[2];
        if x.is_finite() && yaw.is_finite() {
            rows.push((x, yaw, t.position_m[1]));
        }
    }
    let n = rows.len() as f64;
    let mean = |f: &dyn Fn(&(f64, f64, f64)) -> f64| rows.iter().map(f).sum::<f64>() / n;
    let (x, yaw, y) = (mean(&|r| r.0), mean(&|r| r.1), mean(&|r| r.2));
    let slope = mean(&|r| (r.0 - x) * (r.2 - y)) / mean(&|r| (r.2 - y) * (r.2 - y));
    let scale = steps.len() as f64 / n;
    let square = |v: f64| v * v;
    (
        scale
            * rows
                .iter()
                .map(|r| square(r.0 - x - slope * (r.2 - y)))
                .sum::<f64>(),
        scale * rows.iter().map(|r| square(r.1 - yaw)).sum::<f64>(),
    )
}
