//! The programs as one: simulate | extract-lines | solve-pose | report, in CSV and in MCAP, against
//! the accuracy that is promised.

mod shell;

use shell::{Ended, scratch, sh};
use std::path::Path;

/// 0.2 m apart over |y| <= 4 m, noise-free, at 0.25 deg and 35 Hz.
const GRID: &str = "simulate -f frame.toml --trajectory grid --step-m 0.2 --effects none";
/// Random poses, x in +-50 mm, angles in +-1 deg.
const RANDOM: &str = "simulate -f frame.toml --trajectory random --effects reference";
const CHAIN: &str = "extract-lines -f frame.toml | solve-pose -f frame.toml --imu imu.csv";

/// Runs `source | extract-lines | solve-pose | report` with gates.
fn run(dir: &Path, source: &str, gates: &[&str]) -> Ended {
    let gates: String = gates
        .iter()
        .map(|gate| format!(" --fail-if '{gate}'"))
        .collect();
    sh(
        dir,
        &format!(
            "{source} --truth truth.csv --imu imu.csv > scans.csv && \
             < scans.csv {CHAIN} | report --truth truth.csv{gates} -"
        ),
    )
}

#[test]
fn a_noise_free_grid_is_solved_as_well_as_its_edges_allow() {
    let low = format!("{GRID} --z-range 0.5,3.5");
    run(
        &scratch("chain-grid-low"),
        &low,
        &[
            "scans.solved_pct<100",
            "y.max_mm>0.7",
            "z.max_mm>0.7",
            "roll.max_deg>0.01",
            "x.max_mm>18.5",
            "x.rms_mm>4.1",
            "yaw.rms_deg>0.105",
        ],
    )
    .expect(0);
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
    run(&scratch("chain-grid-high"), &high, &gates).expect(0);
}
