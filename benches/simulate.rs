//! How many scans a second the simulator makes: 761 beams on one core, by what is switched on, in
//! the thread's own time, with MCAP as into a pipe and without; and side by side on all cores, by
//! the clock.
//!
//! `cargo bench --bench simulate` (a part of `make bench`); figures and ratios to the goals, no
//! judgement.

mod timing;

use cablepose::frame::Frame;
use cablepose::motion::{Limits, Pose, SCurve, Shuttle};
use cablepose::record::Stamp;
use cablepose::simulate::{Course, Setup, Simulator};
use cablepose::stream::{Encoding, Options, Output, Role};
use std::hint::black_box;
use std::path::Path;
use std::time::Instant;
use timing::thread_s;

const SCANS: u64 = 4000;
const RUNS: usize = 5;

/// Effects, and the scans a second into MCAP that are wanted of them.
const ROWS: [(&str, Option<f64>); 6] = [
    ("none", None),
    ("noise,quantisation", Some(20e3)),
    ("reference", None),
    ("reference,motion", None),
    ("reference,mixed,motion", None),
    ("all", Some(2e3)),
];

fn simulator(effects: &str) -> anyhow::Result<Simulator> {
    let frame = Frame::parse(
        include_str!("../testdata/cablar.toml"),
        Path::new("testdata/cablar.toml"),
    )?;
    let (from, to) = (Pose::level(0.0, -4.0, 0.465), Pose::level(0.0, 4.0, 3.5));
    let limits = Limits {
        speed_m_s: 1.0,
        acceleration_m_s2: 5.0,
        jerk_m_s3: 50.0,
    };
    let shuttle = Shuttle {
        from,
        to,
        profile: SCurve::new(from.distance_m(&to), limits),
        dwell_s: 0.5,
        loops: 1000,
    };
    Ok(Simulator::new(Setup {
        effects: effects.parse()?,
        start: Stamp::from_ns(1_767_225_600_000_000_000),
        scans: Some(SCANS),
        ..Setup::new(frame, Course::along(shuttle))
    }))
}

/// The best of some runs, scans a second.
fn rate(mut run: impl FnMut() -> anyhow::Result<f64>) -> anyhow::Result<f64> {
    let mut best_s = f64::INFINITY;
    for _ in 0..RUNS {
        best_s = best_s.min(run()?);
    }
    Ok(SCANS as f64 / best_s)
}

fn alone(effects: &str) -> anyhow::Result<f64> {
    let mut simulator = simulator(effects)?;
    let start_s = thread_s();
    while let Some(step) = simulator.advance() {
        black_box(step);
    }
    Ok(thread_s() - start_s)
}

fn into_mcap(effects: &str) -> anyhow::Result<f64> {
    let mut simulator = simulator(effects)?;
    let mut output = Output::open(&Options {
        tool: "simulate",
        quiet: true,
        output: Some("/dev/null".into()),
        format: Some(Encoding::Mcap),
        ..Options::default()
    })?;
    let start_s = thread_s();
    while let Some(step) = simulator.advance() {
        for sample in &step.imu {
            output.write(sample)?;
        }
        output.write_trajectory(Role::Truth, &step.truth)?;
        output.write_trajectory(Role::Desired, &step.desired)?;
        output.write(&step.scan)?;
    }
    output.finish()?;
    Ok(thread_s() - start_s)
}

fn side_by_side(effects: &str, threads: usize) -> anyhow::Result<f64> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()?;
    let mut simulator = simulator(effects)?;
    let mut steps = Vec::new();
    let start = Instant::now();
    loop {
        pool.install(|| simulator.advance_many(64 * threads, &mut steps));
        if steps.is_empty() {
            return Ok(start.elapsed().as_secs_f64());
        }
        black_box(&steps);
    }
}

fn main() -> anyhow::Result<()> {
    println!("{SCANS} scans of 761 beams, one core; scans/s, best of {RUNS}");
    println!(
        "{:<24} {:>10} {:>10} {:>10} {:>7}",
        "effects", "alone", "into MCAP", "goal", "ratio"
    );
    for (effects, goal) in ROWS {
        let (made, written) = (rate(|| alone(effects))?, rate(|| into_mcap(effects))?);
        let goal = goal.map_or(String::new(), |goal| {
            format!("{goal:>10.0} {:>7.2}", written / goal)
        });
        println!("{effects:<24} {made:>10.0} {written:>10.0} {goal}");
    }
    let cores = std::thread::available_parallelism()?.get();
    println!("\nside by side, by the clock: scans/s, ratio to one thread");
    for effects in ["noise,quantisation", "all"] {
        let mut one = None;
        for threads in (0..).map(|k| 1 << k).take_while(|n| *n <= cores) {
            let now = rate(|| side_by_side(effects, threads))?;
            let ratio = now / *one.get_or_insert(now);
            println!("{effects:<24} {threads:>3} threads {now:>10.0} {ratio:>6.2}");
        }
    }
    Ok(())
}
