//! What carrying a pose over 62 ms leaves of the error, beside the goals, and what it costs.
//! `make delay-table` (`cargo bench --bench compensate`) prints the table and ends with an error
//! where a goal is missed.
//!
//! The platform runs to and fro between (0, -4, 0.465) and (0, 4, 3.5) m. Its poses are the truth
//! with white noise of known size, or come from simulated scans through lines and edges; either way
//! they are compared with the truth at the instant at which they are used. NEES is the mean squared
//! error over the predicted variance: 1 is honest.

use cablepose::edges::EdgeMeter;
use cablepose::frame::Frame;
use cablepose::lines::reflectors::{self, ReflectorFit};
use cablepose::motion::{
    Carrier, CarryMethod, CarryOptions, Inertia, Limits, Motion, Pose as Place, Quintic, SCurve,
    Shuttle,
};
use cablepose::pose::joint;
use cablepose::pose::pitch::Pitch;
use cablepose::record::{
    Axes, ImuSample, Pose, ReflectorLines, Stamp, Status, TrajectoryPoint, upper_index,
};
use cablepose::simulate::random::Purpose;
use cablepose::simulate::{Course, Effect, Effects, Seed, Setup, SharedMotion, Simulator};
use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

const DELAY_S: f64 = 0.062;
const START: Stamp = Stamp::from_ns(1_767_225_600_000_000_000);
const SEEDS: u64 = 4;
const LOOPS: u32 = 2;
/// Standard deviations of the poses of known noise: x, y, z (m), roll, pitch, yaw (rad). About
/// what single scans give.
const SIGMA: [f64; 6] = [4e-3, 0.45e-3, 0.45e-3, 1.5e-4, 3.5e-4, 2e-3];

/// A run: poses and what a carrier may know of the motion.
struct Run {
    truth: SharedMotion,
    poses: Vec<Pose>,
    desired: Vec<TrajectoryPoint>,
    imu: Vec<ImuSample>,
}

#[derive(Clone, Copy, PartialEq)]
enum Source {
    Noise,
    Scans,
    /// With the platform moving while it is scanned.
    MovingScans,
}

fn shuttle(profile: &str) -> SharedMotion {
    let (from, to) = (Place::level(0.0, -4.0, 0.465), Place::level(0.0, 4.0, 3.5));
    let limits = Limits {
        speed_m_s: 3.13,
        acceleration_m_s2: 5.0,
        jerk_m_s3: 50.0,
    };
    let distance_m = from.distance_m(&to);
    let dwell_s = 0.5;
    let loops = LOOPS;
    match profile {
        "quintic" => Box::new(Shuttle {
            from,
            to,
            profile: Quintic::new(distance_m, limits),
            dwell_s,
            loops,
        }),
        _ => Box::new(Shuttle {
            from,
            to,
            profile: SCurve::new(distance_m, limits),
            dwell_s,
            loops,
        }),
    }
}

fn point(motion: &dyn Motion, stamp: Stamp) -> TrajectoryPoint {
    let state = motion.at(stamp.since_s(START));
    TrajectoryPoint {
        stamp,
        position_m: state.position_m.into(),
        rotation_rad: state.rotation_rad.into(),
        velocity_m_s: state.velocity_m_s.into(),
    }
}

fn run(profile: &str, source: Source, seed: u64) -> Run {
    let text = include_str!("../testdata/cablar.toml");
    let frame = Frame::parse(text, Path::new("cablar.toml")).expect("a good frame file");
    let mut effects = Effects::reference();
    effects.insert(Effect::Imu);
    if source == Source::MovingScans {
        effects.insert(Effect::Motion);
    }
    let truth = shuttle(profile);
    let course = Course::Moving {
        truth: shuttle(profile),
        desired: shuttle(profile),
        lag_s: 0.0,
    };
    let mut simulator = Simulator::new(Setup {
        effects,
        seed: Seed(seed),
        start: START,
        imu_rate_hz: Some(100.0),
        imu_axes: Axes::Ned,
        ..Setup::new(frame.clone(), course)
    });
    let mut fit = ReflectorFit::new(&frame, reflectors::Options::default());
    let mut edges = EdgeMeter::new(&frame);
    let mut joint = joint::Estimator::new(&frame, joint::Options::default());
    let mut lines = ReflectorLines::default();
    let (mut poses, mut imu) = (Vec::new(), Vec::new());
    while let Some(step) = simulator.advance() {
        imu.extend_from_slice(&step.imu);
        if source == Source::Noise {
            poses.push(noisy(&step.truth, Seed(seed), poses.len() as u64));
            continue;
        }
        lines.begin(&step.scan);
        if let Some(found) = fit.fit(&step.scan) {
            fit.record(&found, &mut lines);
            edges.measure(&step.scan, &mut lines);
        }
        let pitch = Pitch::within(step.truth.rotation_rad[1], 1e-4);
        poses.push(joint.solve(&lines, Some(pitch), &[]));
    }
    // The controller's trajectory every 10 ms, to a second beyond the last pose.
    let points = (truth.duration_s() / 0.01) as i64 + 100;
    let desired = (0..points).map(|k| point(&*truth, START + k * 10_000_000));
    Run {
        desired: desired.collect(),
        truth,
        poses,
        imu,
    }
}

/// The truth with white noise, and a covariance that says so.
fn noisy(truth: &TrajectoryPoint, seed: Seed, number: u64) -> Pose {
    let mut draws = seed.draws(Purpose::Noise, number);
    let mut pose = Pose {
        stamp: truth.stamp,
        scan_stamp: truth.stamp,
        position_m: truth.position_m,
        rotation_rad: truth.rotation_rad,
        covariance: [0.0; 21],
        status: Status::OK,
        ..Pose::default()
    };
    let values = pose.position_m.iter_mut().chain(&mut pose.rotation_rad);
    for (i, (value, sigma)) in values.zip(SIGMA).enumerate() {
        *value += sigma * draws.normal();
        pose.covariance[upper_index(6, i, i)] = sigma * sigma;
    }
    pose
}

/// Errors of one component over a run.
#[derive(Clone, Copy, Default)]
struct Errors {
    n: u32,
    square: f64,
    most: f64,
    nees: f64,
}

impl Errors {
    fn add(&mut self, error: f64, variance: f64) {
        self.n += 1;
        self.square += error * error;
        self.most = self.most.max(error.abs());
        self.nees += error * error / variance;
    }
    fn rms_mm(&self) -> f64 {
        1e3 * (self.square / f64::from(self.n)).sqrt()
    }
    fn max_mm(&self) -> f64 {
        1e3 * self.most
    }
    fn mean_nees(&self) -> f64 {
        self.nees / f64::from(self.n)
    }
}

/// Carries all poses; the errors of y and z at the time of use.
fn carry(run: &Run, method: CarryMethod, errors: &mut [Errors; 2]) {
    let options = CarryOptions {
        method,
        ..CarryOptions::default()
    };
    let mut carrier = Carrier::new(options, Inertia::default());
    let (mut desired, mut imu) = (run.desired.iter().peekable(), run.imu.iter().peekable());
    // Until there are three poses nobody knows whether the platform moves.
    for (number, pose) in run.poses.iter().enumerate() {
        let used = pose.stamp.plus_s(DELAY_S);
        while let Some(point) = desired.next_if(|p| p.stamp <= used.plus_s(0.01)) {
            carrier.guide().push(point);
        }
        // Only what an IMU has said by then.
        while let Some(sample) = imu.next_if(|s| s.stamp <= used) {
            carrier.inertia().push(sample);
        }
        carrier.measure(pose, pose.stamp);
        let carried = carrier.carried(pose, pose.stamp, used);
        let truth = run.truth.at(used.since_s(START));
        if number < 3 || !carried.is_solved() {
            continue;
        }
        for (k, errors) in errors.iter_mut().enumerate() {
            let axis = k + 1;
            let error = carried.position_m[axis] - truth.position_m[axis];
            errors.add(error, carried.cov(axis, axis));
        }
    }
}

const METHODS: [(&str, CarryMethod); 6] = [
    ("none", CarryMethod::None),
    ("desired", CarryMethod::DesiredExact),
    ("desired, trapezoid", CarryMethod::DesiredTrapezoid),
    ("constant-velocity", CarryMethod::ConstantVelocity),
    ("constant-acceleration", CarryMethod::ConstantAcceleration),
    ("imu", CarryMethod::Imu),
];

/// The largest error allowed, mm, for methods that have a goal.
fn goal_mm(method: CarryMethod) -> Option<f64> {
    match method {
        CarryMethod::DesiredExact => Some(2.0),
        CarryMethod::ConstantAcceleration => Some(6.0),
        _ => None,
    }
}

fn main() -> ExitCode {
    let mut missed = 0;
    println!("62 ms carried, 3.13 m/s, 35 Hz; mm; {SEEDS} runs of {LOOPS} loops");
    for (profile, source, title) in [
        (
            "quintic",
            Source::Noise,
            "quintic, poses of known noise (y, z 0.45 mm)",
        ),
        (
            "quintic",
            Source::Scans,
            "quintic, poses from scans (the scan taken at one instant)",
        ),
        (
            "quintic",
            Source::MovingScans,
            "quintic, poses from scans, platform moving while it is scanned",
        ),
        (
            "s-curve",
            Source::Noise,
            "s-curve of 5 m/s2 and 50 m/s3, poses of known noise",
        ),
        (
            "s-curve",
            Source::Scans,
            "s-curve of 5 m/s2 and 50 m/s3, poses from scans",
        ),
    ] {
        let runs: Vec<Run> = (1..=SEEDS).map(|seed| run(profile, source, seed)).collect();
        println!("\n{title}");
        println!(
            "  {:22} {:>7} {:>7} {:>6}   {:>7} {:>7} {:>6}   goal",
            "method", "y rms", "y max", "NEES", "z rms", "z max", "NEES"
        );
        for (name, method) in METHODS {
            let mut errors = [Errors::default(); 2];
            for run in &runs {
                carry(run, method, &mut errors);
            }
            let [y, z] = errors;
            let gated = profile == "quintic" && source == Source::Noise;
            let verdict = match goal_mm(method).filter(|_| gated) {
                None => String::new(),
                Some(goal) => {
                    let near = y.max_mm() < goal && z.max_mm() < goal;
                    let honest = [y, z].iter().all(|e| (0.8..=1.3).contains(&e.mean_nees()));
                    missed += u32::from(!(near && honest));
                    let word = if near && honest { "met" } else { "MISSED" };
                    format!("max < {goal}, NEES 0.8 to 1.3: {word}")
                }
            };
            println!(
                "  {name:22} {:7.2} {:7.2} {:6.2}   {:7.2} {:7.2} {:6.2}   {verdict}",
                y.rms_mm(),
                y.max_mm(),
                y.mean_nees(),
                z.rms_mm(),
                z.max_mm(),
                z.mean_nees()
            );
        }
    }
    println!("\ntime a pose, measured and carried");
    let run = run("quintic", Source::Noise, 1);
    for (name, method) in METHODS {
        let rounds = (0..20).map(|_| {
            let start = Instant::now();
            let mut errors = [Errors::default(); 2];
            carry(&run, method, &mut errors);
            start.elapsed().as_secs_f64()
        });
        let best = rounds.fold(f64::INFINITY, f64::min);
        println!("  {name:22} {:7.2} us", 1e6 * best / run.poses.len() as f64);
    }
    if missed > 0 {
        println!("\n{missed} goals missed");
        return ExitCode::FAILURE;
    }
    ExitCode::SUCCESS
}
