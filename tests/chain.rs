//! The programs as one: simulate | extract-lines | solve-pose | report, in CSV and in MCAP, against
//! the accuracy that is promised and against golden files.

mod shell;

use shell::{Ended, scratch, sh, testdata};
use std::path::Path;

/// |y| <= 4 m at 0.25 deg and 35 Hz, noise-free.
const GRID: &str = "simulate -f frame.toml --trajectory grid --step-m 0.2 --effects none";
/// |y| <= 4 m, x within 50 mm, angles within 1 deg, 0.5 <= z <= 3.5 m.
const RANDOM: &str = "simulate -f frame.toml --trajectory random --n-scans 500";
/// Pitch is known.
const SOLVE: &str = "solve-pose -f frame.toml --imu imu.csv --imu-pitch-sigma-deg 0";

/// A platform that stands still in each scan and is centimetres further in the next one is no
/// motion, and is not to be taken for one.
const STEPPED: &str = "--deskew none";

/// Runs `source | extract-lines | solve-pose | report` with gates.
fn run(dir: &Path, source: &str, gates: &[&str]) -> Ended {
    run_with(dir, source, "", gates)
}

/// The same with options of extract-lines.
fn run_with(dir: &Path, source: &str, extract: &str, gates: &[&str]) -> Ended {
    let gates: String = gates
        .iter()
        .map(|gate| format!(" --fail-if '{gate}'"))
        .collect();
    sh(
        dir,
        &format!(
            "{source} --truth truth.csv --imu imu.csv > scans.csv && \
             < scans.csv extract-lines -f frame.toml {extract} | {SOLVE} \
             | report --truth truth.csv{gates} -"
        ),
    )
}

#[test]
fn a_noise_free_grid_is_solved_as_well_as_its_edges_allow() {
    // x is a matter of luck with beams and edges: over the grid of 2 cm its rms is 3.95 mm, over
    // this sample of it 4.11.
    let gates = [
        "scans.solved_pct<100",
        "y.max_mm>0.7",
        "z.max_mm>0.7",
        "roll.max_deg>0.01",
        "x.max_mm>18.5",
        "x.rms_mm>4.2",
        "yaw.rms_deg>0.105",
    ];
    run_with(&scratch("chain-grid-low"), GRID, STEPPED, &gates).expect(0);
}

#[test]
fn above_3_5_m_the_grid_is_solved_too() {
    let high = format!("{GRID} --z-range 3.6,4.0");
    let gates = [
        "scans.solved_pct<100",
        "x.max_mm>9",
        "x.rms_mm>2.7",
        "y.max_mm>0.7",
        "z.max_mm>0.7",
    ];
    run_with(&scratch("chain-grid-high"), &high, STEPPED, &gates).expect(0);
}

#[test]
fn noise_bias_and_footprint_cost_little() {
    // The bounds are the goals widened by what 500 scans scatter: about 7 % of an rms.
    let gates = [
        "scans.solved_pct<100",
        "x.rms_mm>4.4",
        "y.rms_mm>0.53",
        "z.rms_mm>0.75",
        "roll.rms_deg>0.0095",
        "x.nees<0.7",
        "x.nees>1.4",
        "yaw.nees<0.7",
        "yaw.nees>1.4",
    ];
    let source = format!("{RANDOM} --effects reference");
    run(&scratch("chain-reference"), &source, &gates).expect(0);
}

#[test]
fn mixed_pixels_cost_a_millimetre_of_x() {
    let gates = [
        "scans.solved_pct<100",
        "x.rms_mm>5.8",
        "y.rms_mm>0.53",
        "z.rms_mm>0.75",
        "x.nees>1.4",
        "yaw.nees>1.4",
    ];
    let source = format!("{RANDOM} --effects reference,mixed");
    run(&scratch("chain-mixed"), &source, &gates).expect(0);
}

#[test]
fn mcap_and_csv_give_the_same_poses() {
    let dir = scratch("chain-mcap");
    let run = "simulate -f frame.toml --n-scans 30 --effects reference";
    let csv = sh(
        &dir,
        &format!("{run} | extract-lines -f frame.toml | solve-pose -f frame.toml --pitch-deg 0"),
    )
    .expect(0);
    let mcap = sh(
        &dir,
        &format!(
            "{run} --format mcap | extract-lines -f frame.toml \
             | solve-pose -f frame.toml --pitch-deg 0 --format csv"
        ),
    )
    .expect(0);
    assert_eq!(csv.rows().len(), 30);
    for name in ["stamp_ns", "seq", "status", "edges"] {
        assert_eq!(csv.column(name), mcap.column(name), "{name}");
    }
    // Ranges come back from float32 metres rounded to 1 um; whole millimetres survive.
    for name in [
        "x_m",
        "y_m",
        "z_m",
        "roll_rad",
        "yaw_rad",
        "cov_x_x",
        "range_bias_m",
    ] {
        for (a, b) in csv.numbers(name).iter().zip(mcap.numbers(name)) {
            assert!((a - b).abs() <= 1e-9, "{name}: {a} {b}");
        }
    }
}

#[test]
fn one_mcap_stream_carries_the_whole_run() {
    let dir = scratch("chain-mcap-file");
    let run = "simulate -f frame.toml --n-scans 30 --effects reference --format mcap";
    sh(
        &dir,
        &format!("{run} | extract-lines -f frame.toml | solve-pose -f frame.toml -o run.mcap"),
    )
    .expect(0);
    // The truth is in it, and the stages that made it.
    let report = sh(&dir, "report --json run.mcap").expect(0);
    let report: serde_json::Value = serde_json::from_slice(&report.stdout).unwrap();
    assert_eq!(report["runs"][0]["scans"]["solved"], 30);
    assert_eq!(report["runs"][0]["matching"]["matched"], 30);
    let stages = report["runs"][0]["stages"].as_array().unwrap();
    assert_eq!(stages.len(), 3, "{stages:?}");
    // And so are the scans: the file can go through the chain again.
    let again = sh(&dir, "extract-lines -f frame.toml --format csv run.mcap").expect(0);
    assert_eq!(again.rows().len(), 30);
}

#[test]
fn both_methods_side_by_side_from_one_pair_of_pipes() {
    let dir = scratch("chain-methods");
    let ended = sh(
        &dir,
        "mkfifo vote joint; simulate -f frame.toml --n-scans 40 --truth truth.csv \
         | extract-lines -f frame.toml \
         | tee >(solve-pose -f frame.toml --pitch-deg 0 --method vote > vote) \
         | solve-pose -f frame.toml --pitch-deg 0 > joint & \
         report --json --truth truth.csv vote=vote joint=joint",
    )
    .expect(0);
    let report: serde_json::Value = serde_json::from_slice(&ended.stdout).unwrap();
    assert_eq!(report["runs"][0]["run"], "vote");
    assert_eq!(report["runs"][1]["run"], "joint");
    for run in 0..2 {
        assert_eq!(report["runs"][run]["scans"]["rows"], 40);
    }
}

#[test]
fn a_reader_that_leaves_ends_the_chain_quietly() {
    let dir = scratch("chain-head");
    let chain = "simulate -f frame.toml | extract-lines -f frame.toml | solve-pose -f frame.toml";
    let ended = sh(&dir, &format!("{chain} | head -n 3")).expect(0);
    assert_eq!(ended.text().lines().count(), 3);
    assert_eq!(ended.stderr, "");
}

/// Compares a CSV in `dir` with the golden file of its name, numbers within 1e-9; `SNAPSHOTS=overwrite`
/// (`make golden`) writes it.
///
/// Only a tolerance is the same on every machine: sines and cosines come from the system.
#[track_caller]
fn assert_golden(dir: &Path, name: &str) {
    let golden = testdata("golden").join(name);
    if std::env::var("SNAPSHOTS").is_ok_and(|how| how == "overwrite") {
        std::fs::copy(dir.join(name), &golden).unwrap();
    }
    let diff = format!("report diff --tol '*=1e-9' {} {name}", golden.display());
    let ended = sh(dir, &diff);
    assert_eq!(ended.status, 0, "{}{}", ended.text(), ended.stderr);
}

#[test]
fn golden_lines_and_poses() {
    let dir = scratch("chain-golden");
    let line = "simulate -f frame.toml --n-scans 4 --effects reference,mixed > scans.csv && \
                extract-lines -f frame.toml scans.csv > lines.csv && \
                solve-pose -f frame.toml --pitch-deg 0 lines.csv > poses.csv";
    sh(&dir, line).expect(0);
    assert_golden(&dir, "lines.csv");
    assert_golden(&dir, "poses.csv");
}
