//! How well clocks and delays are found, on simulated exchanges and motions whose truth is known.
//! `make clock-table` prints the figures beside the goals and fails where one is missed.
//!
//! The models are those for which the reference figures were computed: delays with lognormal tails
//! and bursts of a busy host; there-and-back moves of 8 m at up to 3.13 m/s, seen at 35 Hz.

use cablepose::clock::delay::{self, DelaySettings, Measured};
use cablepose::clock::{Exchange, FitSettings, Method, OneWayHull, SoftwarePll, fit};
use cablepose::motion::{Limits, Motion, Profile, Quintic, State};
use cablepose::record::{ImuSample, Scan, Stamp};
use cablepose::simulate::Seed;
use cablepose::simulate::exchanges::ExchangeModel;
use cablepose::simulate::random::Purpose;
use cablepose::stream::{self, Emit, Encoding, Options, Output, Stage, StreamRecord};
use cablepose::tool::timesync;
use clap::Parser;
use nalgebra::Vector3;
use std::hint::black_box;
use std::process::ExitCode;
use std::time::Instant;

/// Runs of each case, unless an argument says otherwise.
const RUNS: u64 = 200;
/// Delays are cheap to fit, and a coverage needs many.
const DELAY_RUNS: u64 = 600;

fn main() -> ExitCode {
    let runs = std::env::args().filter_map(|a| a.parse().ok()).next();
    let mut table = Table { missed: 0 };
    clocks(&mut table, runs.unwrap_or(RUNS));
    delays(&mut table, runs.unwrap_or(DELAY_RUNS));
    speed(&mut table);
    if table.missed > 0 {
        eprintln!("{} goals missed", table.missed);
        return ExitCode::FAILURE;
    }
    ExitCode::SUCCESS
}

/// Prints rows and counts what missed its goal.
struct Table {
    missed: u32,
}

impl Table {
    fn head(&self, title: &str) {
        println!(
            "\n{title:<66} {:>10} {:>10} {:>10}",
            "found", "reference", "goal"
        );
    }

    /// A figure that must lie between two bounds.
    fn row(&mut self, what: &str, found: f64, reference: &str, goal: [f64; 2], unit: &str) {
        let held = (goal[0]..=goal[1]).contains(&found);
        self.missed += u32::from(!held);
        let goal = match goal {
            [f64::NEG_INFINITY, f64::INFINITY] => String::new(),
            [f64::NEG_INFINITY, most] => format!("<= {most}"),
            [least, f64::INFINITY] => format!(">= {least}"),
            [least, most] => format!("{least}..{most}"),
        };
        let mark = if held { "" } else { "  MISSED" };
        let what = format!("{what}, {unit}");
        println!("{what:<66} {found:>10.3} {reference:>10} {goal:>10}{mark}");
    }

    fn most(&mut self, what: &str, found: f64, reference: &str, most: f64, unit: &str) {
        self.row(what, found, reference, [f64::NEG_INFINITY, most], unit);
    }

    fn tell(&mut self, what: &str, found: f64, reference: &str, unit: &str) {
        let any = [f64::NEG_INFINITY, f64::INFINITY];
        self.row(what, found, reference, any, unit);
    }
}

fn exchanges(run: &[[i64; 3]]) -> Vec<Exchange> {
    let exchange = |&[send_ns, device_ns, receive_ns]: &[i64; 3]| Exchange {
        send_ns,
        device_ns,
        receive_ns,
    };
    run.iter().map(exchange).collect()
}

/// Errors of some runs.
#[derive(Default)]
struct Errors(Vec<f64>);

impl Errors {
    fn rms(&self) -> f64 {
        (self.0.iter().map(|e| e * e).sum::<f64>() / self.0.len() as f64).sqrt()
    }
    fn most(&self) -> f64 {
        self.0.iter().fold(0.0, |most, e| most.max(e.abs()))
    }
    fn mean(&self) -> f64 {
        self.0.iter().sum::<f64>() / self.0.len() as f64
    }
}

/// Errors of a method: offset at the middle and at the end, us; drift, ppb; and how often they were
/// within two of their standard deviations.
#[derive(Default)]
struct Found {
    middle: Errors,
    end: Errors,
    drift: Errors,
    offset_ratio: Errors,
    drift_ratio: Errors,
}

fn run_all(model: &ExchangeModel, settings: &FitSettings, runs: u64) -> Found {
    let mut found = Found::default();
    for number in 0..runs {
        let log = exchanges(&model.run(Seed(1), number));
        let Ok(fit) = fit(&log, settings) else {
            continue;
        };
        let middle_s = model.duration_s / 2.0;
        let error_us = |t_s: f64| {
            let host_ns = (t_s * 1e9) as i64;
            let offset_ns = (fit.line.device_ns(host_ns) - host_ns) as f64;
            (offset_ns - model.offset_ns(t_s)) * 1e-3
        };
        let drift_ppb = fit.line.drift_ppb - model.drift_ppm * 1e3;
        found.middle.0.push(error_us(middle_s));
        found.end.0.push(error_us(model.duration_s));
        found.drift.0.push(drift_ppb);
        if let (Some(offset), Some(drift)) = (fit.offset_sigma_ns, fit.drift_sigma_ppb) {
            found.offset_ratio.0.push(error_us(middle_s) * 1e3 / offset);
            found.drift_ratio.0.push(drift_ppb / drift);
        }
    }
    found
}

fn clocks(table: &mut Table, runs: u64) {
    let model = ExchangeModel::default();
    let with = |method| FitSettings {
        method,
        resamples: if method == Method::Hull { 200 } else { 0 },
        ..FitSettings::default()
    };
    table.head(&format!("Clock, 60 s at 35 Hz, {runs} runs"));
    let hull = run_all(&model, &with(Method::Hull), runs);
    table.most(
        "hull: offset at the middle, rms",
        hull.middle.rms(),
        "0.94",
        1.0,
        "us",
    );
    table.most(
        "hull: offset at the middle, largest",
        hull.middle.most(),
        "3.1",
        4.0,
        "us",
    );
    table.tell(
        "hull: offset at the middle, mean",
        hull.middle.mean(),
        "-0.6",
        "us",
    );
    table.tell("hull: offset at the end, rms", hull.end.rms(), "1.8", "us");
    table.most("hull: drift, rms", hull.drift.rms(), "52", 60.0, "ppb");
    let ratios = [&hull.offset_ratio, &hull.drift_ratio].map(Errors::rms);
    let honest = [0.6, 1.4];
    table.row(
        "hull: offset error over its stated sigma, rms",
        ratios[0],
        "",
        honest,
        "1",
    );
    table.row(
        "hull: drift error over its stated sigma, rms",
        ratios[1],
        "",
        honest,
        "1",
    );
    for (method, name, reference, drift) in [
        (Method::Joint, "joint", "1.08", "53"),
        (Method::Window, "window", "2.9", "113"),
        (Method::MinRtt, "minrtt", "4.5", "113"),
        (Method::Weighted, "weighted", "45", "114"),
        (Method::OneWay, "one-way", "154", "93"),
        (Method::Mean, "mean", "190", "861"),
    ] {
        let found = run_all(&model, &with(method), runs);
        table.tell(
            &format!("{name}: offset, rms"),
            found.middle.rms(),
            reference,
            "us",
        );
        table.tell(
            &format!("{name}: drift, rms"),
            found.drift.rms(),
            drift,
            "ppb",
        );
    }
    let pll = software_pll_us(&model, runs);
    table.tell("software PLL of 7 arrivals: offset, rms", pll, "1191", "us");
    let least = [100.0, f64::INFINITY];
    table.row(
        "hull better than the software PLL by",
        pll / hull.middle.rms(),
        "",
        least,
        "times",
    );
    let short = ExchangeModel {
        duration_s: 10.0,
        ..model
    };
    let found = run_all(&short, &with(Method::Hull), runs);
    table.most(
        "10 s, hull: offset at the middle, rms",
        found.middle.rms(),
        "2.2",
        2.5,
        "us",
    );
    table.tell("10 s, hull: drift, rms", found.drift.rms(), "670", "ppb");
    let long = ExchangeModel {
        duration_s: 300.0,
        ..model
    };
    let found = run_all(&long, &with(Method::Joint), runs / 4);
    table.tell(
        "300 s, joint: offset at the middle, rms",
        found.middle.rms(),
        "0.5",
        "us",
    );
    let uneven = ExchangeModel {
        minimum_s: [150e-6, 320e-6],
        ..model
    };
    let known = FitSettings {
        asymmetry_ns: 170e3,
        ..with(Method::Hull)
    };
    let found = run_all(&uneven, &known, runs);
    let (mean, rms) = (found.middle.mean().abs(), found.middle.rms());
    table.most("answers 170 us slower, known: bias", mean, "", 2.0, "us");
    table.tell("answers 170 us slower, known: offset, rms", rms, "", "us");
    let found = run_all(&uneven, &with(Method::Hull), runs / 4);
    table.tell(
        "answers 170 us slower, not known: bias",
        found.middle.mean(),
        "-85",
        "us",
    );
}

/// Rms error of the common software PLL over all stamps.
fn software_pll_us(model: &ExchangeModel, runs: u64) -> f64 {
    let mut errors = Errors::default();
    for number in 0..runs {
        let mut pll = SoftwarePll::default();
        for exchange in exchanges(&model.run(Seed(1), number)) {
            if let Some(host_ns) = pll.push(&exchange) {
                let truth_ns = exchange.device_ns as f64 - model.offset_ns(host_ns as f64 * 1e-9);
                errors.0.push((host_ns as f64 - truth_ns) * 1e-3);
            }
        }
    }
    errors.rms()
}

/// Moves of 8 m along y, there and back, without rests.
struct Moves {
    moves: u32,
    profile: Quintic,
}

impl Moves {
    fn new(moves: u32) -> Moves {
        let limits = Limits {
            speed_m_s: 3.13,
            acceleration_m_s2: 100.0,
            jerk_m_s3: 1e3,
        };
        Moves {
            moves,
            profile: Quintic::new(8.0, limits),
        }
    }
}

/// Rests before and after each run of moves, s.
const REST_S: f64 = 0.5;

impl Motion for Moves {
    fn at(&self, t_s: f64) -> State {
        let move_s = self.profile.duration_s();
        let t_s = (t_s - REST_S).clamp(0.0, f64::from(self.moves) * move_s);
        let number = (t_s / move_s).floor().min(f64::from(self.moves - 1));
        let travel = self.profile.at(t_s - number * move_s);
        let back = number as u32 % 2 == 1;
        let (from_m, sign) = if back { (4.0, -1.0) } else { (-4.0, 1.0) };
        State {
            position_m: Vector3::new(0.0, from_m + sign * travel.distance_m, 2.0),
            rotation_rad: Vector3::zeros(),
            velocity_m_s: Vector3::new(0.0, sign * travel.speed_m_s, 0.0),
            rotation_rate_rad_s: Vector3::zeros(),
            acceleration_m_s2: Vector3::new(0.0, sign * travel.acceleration_m_s2, 0.0),
        }
    }

    fn duration_s(&self) -> f64 {
        f64::from(self.moves) * self.profile.duration_s() + 2.0 * REST_S
    }
}

/// One of the five cases.
struct Case {
    name: &'static str,
    moves: u32,
    jitter_s: f64,
    gain: f64,
    offset_m: f64,
    outliers: f64,
    missing: f64,
    reference: &'static str,
}

const DELAY_S: f64 = 0.060;
const NOISE_M: f64 = 3e-3;
const RATE_HZ: f64 = 35.0;

impl Case {
    fn measured(&self, motion: &Moves, number: u64) -> Vec<Measured> {
        let mut draws = Seed(2).draws(Purpose::Noise, number);
        // The scans begin anywhere in their period.
        let phase = draws.unit();
        let count = (motion.duration_s() * RATE_HZ) as u32;
        let mut measured = Vec::with_capacity(count as usize);
        for k in 0..count {
            let t_s = (f64::from(k) + phase) / RATE_HZ;
            let late_s = DELAY_S + self.jitter_s * draws.normal();
            let mut position_m = motion.at(t_s - late_s).position_m;
            position_m.y = self.gain * position_m.y + self.offset_m + NOISE_M * draws.normal();
            if draws.unit() < self.outliers {
                position_m.y += 0.1 * draws.normal();
            }
            if draws.unit() >= self.missing {
                measured.push(Measured { t_s, position_m });
            }
        }
        measured
    }

    /// The Cramer-Rao bound, us; of delay, gain and offset together where `nuisances`.
    fn bound_us(&self, motion: &Moves, nuisances: bool) -> f64 {
        let mut information = nalgebra::Matrix3::<f64>::zeros();
        for k in 0..(motion.duration_s() * RATE_HZ) as u32 {
            let state = motion.at((f64::from(k) + 0.5) / RATE_HZ - DELAY_S);
            let (y, v) = (state.position_m.y, state.velocity_m_s.y);
            let weight = 1.0 / (NOISE_M.powi(2) + (v * self.jitter_s).powi(2));
            let gradient = Vector3::new(v, y, 1.0);
            information += weight * gradient * gradient.transpose();
        }
        let variance = match nuisances {
            true => information.try_inverse().map_or(f64::NAN, |c| c[(0, 0)]),
            false => 1.0 / information[(0, 0)],
        };
        variance.sqrt() * 1e6
    }
}

fn delays(table: &mut Table, runs: u64) {
    table.head(&format!(
        "Trajectory delay of 60 ms, 8 m moves at 35 Hz, {runs} runs"
    ));
    let case = Case {
        name: "5 loops, 3 mm, 1 ms jitter",
        moves: 10,
        jitter_s: 1e-3,
        gain: 1.0,
        offset_m: 0.0,
        outliers: 0.0,
        missing: 0.0,
        reference: "0.96",
    };
    let cases = [
        Case {
            name: "no jitter",
            jitter_s: 0.0,
            ..case
        },
        Case {
            name: "3 ms jitter",
            jitter_s: 3e-3,
            reference: "0.98",
            ..case
        },
        Case {
            name: "1 % outliers, 5 % scans missing",
            outliers: 0.01,
            missing: 0.05,
            reference: "1.03",
            ..case
        },
        Case {
            name: "one way, gain 1.002, offset 20 mm",
            moves: 1,
            jitter_s: 1e-3,
            gain: 1.002,
            offset_m: 0.02,
            reference: "1.04",
            ..case
        },
    ];
    for case in [case].iter().chain(&cases) {
        let motion = Moves::new(case.moves);
        let one_way = case.moves == 1;
        let bound_us = case.bound_us(&motion, one_way);
        let (mut errors, mut within, mut plain) = (Errors::default(), 0.0, Errors::default());
        for number in 0..runs {
            let measured = case.measured(&motion, number);
            let settings = DelaySettings::default();
            match delay::fit(&measured, &motion, &settings) {
                Ok(found) => {
                    let off_s = found.delay_s - DELAY_S;
                    errors.0.push(off_s * 1e6);
                    within += f64::from(u8::from(off_s.abs() <= 2.0 * found.sigma_s));
                }
                Err(_) => errors.0.push(f64::INFINITY),
            }
            if let Ok(parabolic) = delay::correlation::parabolic(&measured, &motion, &settings) {
                plain.0.push((parabolic - DELAY_S) * 1e6);
            }
        }
        let name = case.name;
        table.tell(&format!("{name}: Cramer-Rao bound"), bound_us, "", "us");
        table.tell(&format!("{name}: fit, rms"), errors.rms(), "", "us");
        let ratio = errors.rms() / bound_us;
        table.most(
            &format!("{name}: rms over bound"),
            ratio,
            case.reference,
            1.10,
            "1",
        );
        let covered = 100.0 * within / runs as f64;
        table.row(
            &format!("{name}: within two sigma"),
            covered,
            "93-95",
            [92.0, 97.0],
            "%",
        );
        table.tell(
            &format!("{name}: correlation with parabola, rms"),
            plain.rms(),
            "",
            "us",
        );
    }
}

fn speed(table: &mut Table) {
    table.head("Speed");
    let model = ExchangeModel {
        duration_s: 1e6 / 35.0,
        ..ExchangeModel::default()
    };
    let log = exchanges(&model.run(Seed(3), 0));
    let best_s = (0..3)
        .map(|_| {
            let start = Instant::now();
            let found = fit(black_box(&log), &FitSettings::default());
            black_box(&found);
            start.elapsed().as_secs_f64()
        })
        .fold(f64::INFINITY, f64::min);
    let name = format!("{} exchanges fitted, 200 resamples", log.len());
    table.most(&name, best_s, "", 1.0, "s");
    let mut hull = OneWayHull::default();
    let start = Instant::now();
    for exchange in &log {
        black_box(hull.push(exchange.device_ns, exchange.receive_ns));
    }
    let each_us = start.elapsed().as_secs_f64() * 1e6 / log.len() as f64;
    table.most("a record mapped by the causal hull", each_us, "", 2.0, "us");
    tracking(table, &log);
}

/// Passes records on as they are.
struct Pass<R>(std::marker::PhantomData<R>);

impl<R: StreamRecord> Stage for Pass<R> {
    type In = R;
    type Out = R;
    fn push(&mut self, record: &R, emit: &mut Emit<'_, R>) -> anyhow::Result<()> {
        emit.write(record)
    }
    fn finish(&mut self, _: &mut Emit<'_, R>) -> anyhow::Result<stream::Outcome> {
        Ok(stream::Outcome::Done)
    }
}

/// What `timesync track` as a whole adds to a record that passes through.
fn tracking(table: &mut Table, log: &[Exchange]) {
    let times = log
        .iter()
        .map(|e| (Stamp::from_ns(e.device_ns), Stamp::from_ns(e.receive_ns)));
    let samples: Vec<ImuSample> = times
        .clone()
        .take(200_000)
        .map(|(device, received)| ImuSample {
            stamp: received,
            device: Some(device),
            received: Some(received),
            ..ImuSample::default()
        })
        .collect();
    let each_us = added_us(&samples, Encoding::Csv, "imu");
    table.most("track: added to an IMU sample, CSV", each_us, "", 2.0, "us");
    let scans: Vec<Scan> = times
        .take(20_000)
        .map(|(device, received)| Scan {
            stamp: received,
            device: Some(device),
            received: Some(received),
            angle_min_rad: -0.1,
            angle_increment_rad: 0.25f64.to_radians(),
            time_increment_s: 0.25 / 360.0 / 35.0,
            scan_time_s: 1.0 / 35.0,
            range_max_m: 65.0,
            ranges_m: (0..761u16).map(|k| f64::from(k) * 0.01 + 1.0).collect(),
            remissions: vec![100.0; 761],
            ..Scan::default()
        })
        .collect();
    let each_us = added_us(&scans, Encoding::Mcap, "scan");
    let name = "track: added to a scan of 761 beams, MCAP";
    table.most(name, each_us, "", 2.0, "us");
}

/// The least time of `timesync track` less the least time of passing the same file through, a record.
fn added_us<R: StreamRecord>(records: &[R], encoding: Encoding, kind: &str) -> f64 {
    let path = std::env::temp_dir().join(format!("clock-track-{}-{kind}", std::process::id()));
    let options = Options {
        quiet: true,
        output: Some("/dev/null".into()),
        ..Options::default()
    };
    let mut file = Output::create(&path, encoding, &options).expect("a file");
    for record in records {
        file.write(record).expect("written");
    }
    file.finish().expect("finished");
    let mut best_s = [f64::INFINITY; 2];
    for _ in 0..7 {
        let start = Instant::now();
        let mut pass = Pass::<R>(std::marker::PhantomData);
        stream::filter(&options, Some(&path), &mut pass).expect("passed");
        best_s[0] = best_s[0].min(start.elapsed().as_secs_f64());
        let start = Instant::now();
        let file = path.to_string_lossy();
        let line = [
            "timesync",
            "track",
            "-q",
            "--kind",
            kind,
            &file,
            "-o",
            "/dev/null",
        ];
        timesync::run(timesync::Args::parse_from(line)).expect("tracked");
        best_s[1] = best_s[1].min(start.elapsed().as_secs_f64());
    }
    let _ = std::fs::remove_file(&path);
    (best_s[1] - best_s[0]) * 1e6 / records.len() as f64
}
