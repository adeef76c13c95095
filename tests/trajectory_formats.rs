//! TUM and EuRoC, on the real programs: the same poses whatever the file, faults named.

#![cfg(unix)]

mod shell;

use shell::{Ended, scratch, sh};
use std::fs;
use std::path::Path;

fn a_run(name: &str) -> std::path::PathBuf {
    let dir = scratch(name);
    let line = "simulate -f frame.toml --trajectory random --n-scans 40 --truth truth.csv --imu imu.csv \
         | extract-lines -f frame.toml > lines.csv; \
         solve-pose -f frame.toml --imu imu.csv --imu-pitch-sigma-deg 0 lines.csv > poses.csv";
    sh(&dir, line).expect(0);
    dir
}

fn in_format(dir: &Path, format: &str) -> Ended {
    let options = "--imu imu.csv --imu-pitch-sigma-deg 0 lines.csv -o";
    sh(
        dir,
        &format!("solve-pose -f frame.toml --format {format} {options} poses.{format}"),
    )
}

/// rms of x, y, z and rotations as report gives them, of a run against a truth.
fn errors(dir: &Path, truth: &str, poses: &str) -> Vec<f64> {
    let ended = sh(dir, &format!("report --truth {truth} --json {poses}")).expect(0);
    let report: serde_json::Value = serde_json::from_str(ended.text()).unwrap();
    let figure = |name: &str, unit: &str| {
        report["runs"][0][name][format!("rms_{unit}")]
            .as_f64()
            .unwrap()
    };
    let lengths = ["x", "y", "z"].map(|name| figure(name, "mm"));
    let angles = ["roll", "pitch", "yaw"].map(|name| figure(name, "deg"));
    lengths.into_iter().chain(angles).collect()
}

#[test]
fn a_run_is_the_same_run_in_every_format() {
    let dir = a_run("trajectory_formats_same");
    let own = errors(&dir, "truth.csv", "poses.csv");
    assert!(own[0] > 0.5, "{own:?}");
    for format in ["tum", "euroc"] {
        in_format(&dir, format).expect(0);
        let text = fs::read_to_string(dir.join(format!("poses.{format}"))).unwrap();
        assert!(text.starts_with('#'));
        assert_eq!(text.lines().count(), 41);
        for poses in [
            format!("poses.{format}"),
            format!("--input-format {format} - < poses.{format}"),
        ] {
            let truth = if poses.contains('<') {
                // --input-format is for all inputs.
                format!("poses.{format}")
            } else {
                "truth.csv".to_owned()
            };
            let found = errors(&dir, &truth, &poses);
            let wanted = if truth == "truth.csv" {
                own.clone()
            } else {
                vec![0.0; 6]
            };
            for (a, b) in found.iter().zip(&wanted) {
                assert!((a - b).abs() < 1e-5, "{format}: {found:?} {wanted:?}");
            }
        }
    }
}

#[test]
fn a_filter_reads_them_and_writes_csv() {
    let dir = a_run("trajectory_formats_filter");
    in_format(&dir, "tum").expect(0);
    let line = "compensate-delay --delay 0ms poses.tum | head -n 1 | cut -d, -f1,2";
    assert_eq!(
        sh(&dir, line).expect(0).text().trim(),
        "stamp_ns,scan_stamp_ns"
    );
}

#[test]
fn faults_name_the_file_s_own_line() {
    let dir = a_run("trajectory_formats_faults");
    in_format(&dir, "tum").expect(0);
    sh(&dir, "sed -i '7s/ [^ ]*$/ one/' poses.tum").expect(0);
    let ended = sh(&dir, "report --truth truth.csv poses.tum").expect(65);
    assert!(
        ended.stderr.contains("poses.tum:7: roll_rad"),
        "{}",
        ended.stderr
    );
    assert!(ended.stderr.contains("\"one\""), "{}", ended.stderr);
    sh(&dir, "sed -i '7d; 9s/^/1 /' poses.tum").expect(0);
    let ended = sh(&dir, "report --truth truth.csv poses.tum").expect(65);
    assert!(
        ended.stderr.contains("poses.tum:8: 9 fields"),
        "{}",
        ended.stderr
    );
}

#[test]
fn what_they_cannot_hold_is_said() {
    let dir = a_run("trajectory_formats_cannot");
    // Without the strips there are lines but no x and no yaw.
    let ended = sh(&dir, "extract-lines -f frame.toml --format tum < /dev/null");
    assert_eq!(ended.status, 65);
    sh(
        &dir,
        "simulate -f frame.toml --n-scans 3 | extract-lines -f frame.toml --format tum",
    )
    .expect(2);
    let columns = "edge_face|edge_strip|edge_kind|edge_from_rad|edge_to_rad";
    let strip = format!(
        "awk -F, -v OFS=, 'NR==1 {{ for (i=1;i<=NF;i++) if ($i ~ /^({columns}|edge_.*)$/) e[i]=1 }} \
         NR==3 {{ for (i in e) $i=\"\" }} {{ print }}' lines.csv > fewer.csv"
    );
    sh(&dir, &strip).expect(0);
    let ended = sh(
        &dir,
        "solve-pose -f frame.toml --pitch-deg 0 --format tum fewer.csv -o fewer.tum",
    )
    .expect(3);
    assert!(
        ended
            .stderr
            .contains("1 record without a whole pose left out"),
        "{}",
        ended.stderr
    );
}
