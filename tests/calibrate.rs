//! solve-pose --calibrate through the programs: a frame file that is wrong becomes one that is right,
//! as far as the run shows it.

mod shell;

use cablepose::frame::Frame;
use shell::{scratch, sh, testdata};
use std::fs;
use std::path::Path;

/// A frame file from testdata with the rotations of scanner and IMU.
fn write(dir: &Path, source: &str, name: &str, scanner_deg: &str, imu_deg: &str) {
    let text = fs::read_to_string(testdata(source)).unwrap();
    let nominal = "rotation_deg = [0.0, 0.0, 0.0]";
    let parts: Vec<&str> = text.split(nominal).collect();
    assert_eq!(parts.len(), 3);
    let (a, b, c) = (parts[0], parts[1], parts[2]);
    let key = "rotation_deg = ";
    fs::write(
        dir.join(name),
        format!("{a}{key}{scanner_deg}{b}{key}{imu_deg}{c}"),
    )
    .unwrap();
}

fn read(dir: &Path, name: &str) -> Frame {
    Frame::read(&dir.join(name)).unwrap()
}

const RUN: &str = "--effects reference --trajectory random --n-scans 200 --z-range 0.5,4 \
                   --imu imu.csv --imu-axes ned > scans.csv";

/// Scanner and IMU are both turned against the frame file; which of the two is put right is asked.
#[test]
fn the_turn_between_scanner_and_imu_goes_where_it_is_asked_for() {
    let dir = scratch("calibrate-turn");
    write(
        &dir,
        "inclined.toml",
        "imu.toml",
        "[0.0, 0.0, 0.0]",
        "[0.30, -0.40, 0.0]",
    );
    write(
        &dir,
        "inclined.toml",
        "scanner.toml",
        "[0.30, -0.40, 0.0]",
        "[0.0, 0.0, 0.0]",
    );
    write(
        &dir,
        "inclined.toml",
        "frame.toml",
        "[0.0, 0.0, 0.0]",
        "[0.0, 0.0, 0.0]",
    );
    for (device, turn) in [("imu", ""), ("scanner", "--calibrate-turn scanner")] {
        sh(
            &dir,
            &format!("simulate -q -f {device}.toml --seed 5 {RUN}"),
        )
        .expect(0);
        let command = format!(
            "extract-lines -q -f frame.toml scans.csv | solve-pose -f frame.toml --imu imu.csv \
             --imu-pitch-sigma-deg 0.01 --calibrate out-{device}.toml {turn} > poses.csv"
        );
        let ended = sh(&dir, &command).expect(0);
        assert!(
            ended.stderr.contains("condition number"),
            "{}",
            ended.stderr
        );
        assert!(ended.stderr.contains("box.dz_m"), "{}", ended.stderr);
        let found = read(&dir, &format!("out-{device}.toml"));
        let (turned, other) = match device {
            "imu" => (found.imu.rotation_deg, found.scanner.rotation_deg),
            _ => (found.scanner.rotation_deg, found.imu.rotation_deg),
        };
        assert!((turned[0] - 0.30).abs() < 0.02, "{device} {turned:?}");
        assert!((turned[1] + 0.40).abs() < 0.05, "{device} {turned:?}");
        assert_eq!(other, [0.0; 3]);
        // Comments of the file are still there, and say now where numbers come from.
        let text = fs::read_to_string(dir.join(format!("out-{device}.toml"))).unwrap();
        assert!(text.contains("# the next surface behind every face"));
        assert!(text.contains("calibrated by"));
    }
}

#[test]
fn a_run_that_shows_too_little_says_so() {
    let dir = scratch("calibrate-little");
    fs::copy(testdata("cablar.toml"), dir.join("frame.toml")).unwrap();
    sh(&dir, "simulate -q -f frame.toml --n-scans 5 > scans.csv").expect(0);
    let command = "extract-lines -q -f frame.toml scans.csv \
                   | solve-pose -f frame.toml --pitch-deg 0 --calibrate out.toml > poses.csv";
    let ended = sh(&dir, command).expect(3);
    assert!(
        ended.stderr.contains("at least 16 are needed"),
        "{}",
        ended.stderr
    );
    assert!(!dir.join("out.toml").exists());
    let ended = sh(
        &dir,
        "solve-pose -f frame.toml --method vote --calibrate out.toml scans.csv",
    )
    .expect(2);
    assert!(ended.stderr.contains("--method joint"), "{}", ended.stderr);
}
