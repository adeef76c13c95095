//! compensate-delay as people run it: in pipes, live, beside a FIFO, with faults.

#![cfg(unix)]

mod shell;

use shell::{Ended, scratch, sh};
use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{SystemTime, UNIX_EPOCH};

const DELAY_NS: i64 = 62_000_000;
const LOOP: &str = "simulate -f frame.toml --trajectory loop --profile quintic --speed-m-s 3.13 \
                    --effects reference,motion";

/// A directory with a loop at 3.13 m/s: poses.csv, poses.mcap, truth.csv, desired.csv, imu.csv.
fn a_loop(name: &str) -> PathBuf {
    let dir = scratch(name);
    let chain = "extract-lines -f frame.toml | solve-pose -f frame.toml --pitch-deg 0";
    sh(
        &dir,
        &format!(
            "{LOOP} --truth truth.csv --desired desired.csv --imu imu.csv --imu-rate-hz 100 \
             | {chain} > poses.csv && {LOOP} --n-scans 30 --format mcap | {chain} > poses.mcap"
        ),
    )
    .expect(0);
    dir
}

fn stamps(ended: &Ended, column: &str) -> Vec<i64> {
    let stamps = ended.column(column);
    stamps.iter().map(|stamp| stamp.parse().unwrap()).collect()
}

fn poses(dir: &Path) -> Ended {
    sh(dir, "cat poses.csv").expect(0)
}

#[test]
fn stamp_and_pose_move_together() {
    let dir = a_loop("carry-moves");
    let before = poses(&dir);
    let none = sh(
        &dir,
        "compensate-delay --delay 62ms --method none poses.csv",
    )
    .expect(0);
    let moved: Vec<i64> = stamps(&before, "stamp_ns")
        .iter()
        .map(|stamp| stamp + DELAY_NS)
        .collect();
    assert_eq!(stamps(&none, "stamp_ns"), moved);
    for column in [
        "scan_stamp_ns",
        "seq",
        "y_m",
        "roll_rad",
        "cov_y_y",
        "edges",
        "status",
    ] {
        assert_eq!(none.column(column), before.column(column), "{column}");
    }
    let carried = sh(&dir, "compensate-delay --delay 62ms < poses.csv").expect(0);
    assert_eq!(stamps(&carried, "stamp_ns"), moved);
    assert_eq!(
        carried.column("scan_stamp_ns"),
        before.column("scan_stamp_ns")
    );
    // Poses that do not say which scan they came from keep the stamp that they came with.
    let bare = "cut -d, -f1,3- poses.csv | compensate-delay --delay 62ms --method none";
    let bare = sh(&dir, bare).expect(0);
    assert_eq!(
        bare.column("scan_stamp_ns"),
        before.column("stamp_ns"),
        "{}",
        bare.text()
    );
    // Stamps that are late already stay, and the poses move all the same.
    let used = sh(
        &dir,
        "compensate-delay --delay 62ms --stamps used poses.csv",
    )
    .expect(0);
    assert_eq!(used.column("stamp_ns"), before.column("stamp_ns"));
    for (a, b) in used.numbers("y_m").iter().zip(carried.numbers("y_m")) {
        assert!((a - b).abs() < 1e-9);
    }
    // A delay that is not known well shows in the covariance.
    let unsure = "compensate-delay --delay 62ms --delay-sigma 2ms --motion desired.csv poses.csv";
    let unsure = sh(&dir, unsure).expect(0);
    let most = unsure.numbers("cov_y_y").into_iter().fold(0.0, f64::max);
    assert!((most.sqrt() - 2e-3 * 2.92).abs() < 3e-4, "{}", most.sqrt());
}

#[test]
fn the_spike_goes() {
    let dir = a_loop("carry-spike");
    for (arguments, gates) in [
        (
            "--method none",
            "--fail-if 'y.max_mm<175' --fail-if 'z.max_mm<65'",
        ),
        (
            "--motion desired.csv",
            "--fail-if 'y.max_mm>2' --fail-if 'z.max_mm>3.5' --fail-if 'y.nees>1.4'",
        ),
        (
            "--motion desired.csv --integration trapezoid",
            "--fail-if 'y.max_mm>2.2' --fail-if 'z.max_mm>3.5'",
        ),
        (
            "--method constant-velocity",
            "--fail-if 'y.p99_mm>15' --fail-if 'z.p99_mm>12'",
        ),
        (
            "--method constant-acceleration",
            "--fail-if 'y.p99_mm>6' --fail-if 'z.p99_mm>8'",
        ),
        (
            "--imu imu.csv",
            "--fail-if 'y.p99_mm>3' --fail-if 'z.p99_mm>4'",
        ),
    ] {
        sh(
            &dir,
            &format!(
                "compensate-delay --delay 62ms {arguments} poses.csv \
                 | report --truth truth.csv {gates} -"
            ),
        )
        .expect(0);
    }
}

#[test]
fn mcap_comes_through_with_what_else_is_in_it() {
    let dir = a_loop("carry-mcap");
    let csv = sh(&dir, "head -n 31 poses.csv | compensate-delay --delay 62ms").expect(0);
    let mcap = sh(
        &dir,
        "compensate-delay --delay 62ms --format csv poses.mcap",
    )
    .expect(0);
    assert_eq!(csv.column("stamp_ns"), mcap.column("stamp_ns"));
    for (a, b) in csv.numbers("y_m").iter().zip(mcap.numbers("y_m")) {
        assert!((a - b).abs() < 1e-6, "{a} {b}");
    }
    sh(
        &dir,
        "compensate-delay --delay 62ms poses.mcap -o used.mcap",
    )
    .expect(0);
    let scans = sh(&dir, "extract-lines -f frame.toml --format csv used.mcap").expect(0);
    assert_eq!(scans.rows().len(), 30);
    let again = sh(&dir, "compensate-delay --delay 0s --format csv used.mcap").expect(0);
    assert_eq!(again.column("stamp_ns"), mcap.column("stamp_ns"));
    // The desired motion in the recording itself.
    let own = "compensate-delay --delay 62ms --motion poses.mcap --format csv poses.mcap";
    assert_eq!(sh(&dir, own).expect(0).rows().len(), 30);
}

#[test]
fn a_result_of_timesync_delay_is_taken() {
    let dir = a_loop("carry-result");
    fs::write(
        dir.join("delay.json"),
        r#"{"delay_s": 0.062, "sigma_s": 0.002, "gain": 1.0}"#,
    )
    .unwrap();
    let given = "--delay 62ms --delay-sigma 2ms --stamps used poses.csv";
    let given = sh(&dir, &format!("compensate-delay {given}")).expect(0);
    let read = sh(&dir, "compensate-delay --delay-from delay.json poses.csv").expect(0);
    assert_eq!(given.text(), read.text());
    let ended = sh(&dir, "compensate-delay --delay-from no.json poses.csv").expect(66);
    assert!(
        ended.stderr.contains("no.json: No such file"),
        "{}",
        ended.stderr
    );
    fs::write(dir.join("bad.json"), r#"{"delay": 0.062}"#).unwrap();
    let ended = sh(&dir, "compensate-delay --delay-from bad.json poses.csv").expect(65);
    assert!(ended.stderr.contains("delay_s"), "{}", ended.stderr);
}

#[test]
fn beyond_the_horizon_there_are_no_numbers() {
    let dir = a_loop("carry-horizon");
    let ended = sh(&dir, "compensate-delay --delay 600ms poses.csv").expect(3);
    assert!(ended.column("y_m").iter().all(String::is_empty));
    assert!(ended.column("cov_y_y").iter().all(String::is_empty));
    let word = "extrapolated-too-far";
    assert!(
        ended
            .column("status")
            .iter()
            .all(|status| status.contains(word))
    );
    assert!(ended.stderr.contains("--max-horizon"), "{}", ended.stderr);
    let wide = "compensate-delay --delay 600ms --max-horizon 1s poses.csv";
    assert!(
        sh(&dir, wide)
            .expect(0)
            .numbers("y_m")
            .iter()
            .all(|y| y.is_finite())
    );
    // Poses of another time have no desired motion, and say so.
    let stale = "sed 's/^1767/1768/' desired.csv > other.csv; \
                 compensate-delay --delay 62ms --motion other.csv poses.csv";
    let stale = sh(&dir, stale).expect(0);
    assert!(
        stale
            .column("status")
            .iter()
            .all(|status| status == "stale-motion")
    );
    assert!(
        stale.stderr.contains("no motion around them"),
        "{}",
        stale.stderr
    );
}

#[test]
fn a_command_line_that_makes_no_sense_is_refused() {
    let dir = scratch("carry-usage");
    fs::write(dir.join("poses.csv"), "").unwrap();
    for (arguments, why) in [
        ("", "--delay"),
        ("--delay 62", "unit"),
        ("--delay 1ms --delay-from x", "--delay-from"),
        ("--delay 1ms --method desired", "--motion FILE"),
        ("--delay 1ms --method imu --motion x", "--motion belongs"),
        ("--delay 1ms --motion x --imu y", "--method"),
        (
            "--delay 1ms --integration trapezoid",
            "--integration belongs",
        ),
        ("--delay 1ms --motion-wait 1s", "--motion <FILE>"),
        ("--delay 1ms --following-sigma-m-s 1", "--motion <FILE>"),
        ("--delay 1ms --imu-wait 1s", "--imu <FILE>"),
        ("--delay 1ms -f frame.toml", "--frame has"),
        ("--delay --1ms", "one sign"),
        ("--to now --stamps used", "--stamps used"),
        ("--delay 1ms --to soon", "or now"),
        ("--delay 1ms --sigma-mm 0", "positive"),
    ] {
        let ended = sh(&dir, &format!("compensate-delay {arguments} poses.csv")).expect(2);
        assert!(ended.stderr.contains(why), "{arguments}: {}", ended.stderr);
    }
    sh(
        &dir,
        "compensate-delay --delay 1ms --motion no.csv poses.csv",
    )
    .expect(66);
}

#[test]
fn poses_without_numbers_pass_and_bad_rows_do_not() {
    let dir = a_loop("carry-bad");
    let empty = "head -n 20 poses.csv \
                 | awk -F, 'BEGIN{OFS=\",\"} NR%5==0{for(i=4;i<=30;i++)$i=\"\";$NF=\"no-pose\"} 1'";
    let ended = sh(&dir, &format!("{empty} | compensate-delay --delay 62ms")).expect(0);
    let status = ended.column("status");
    assert_eq!(
        status.iter().filter(|status| *status == "no-pose").count(),
        4
    );
    for (status, y) in status.iter().zip(ended.numbers("y_m")) {
        assert_eq!(status == "no-pose", y.is_nan());
    }
    let bad = "(head -n 5 poses.csv; echo 1,2,3) | compensate-delay --delay 62ms";
    let ended = sh(&dir, bad).expect(65);
    assert_eq!(ended.rows().len(), 4);
    assert!(ended.stderr.contains("stdin:6"), "{}", ended.stderr);
}

#[test]
fn a_reader_that_leaves_ends_it_quietly() {
    let dir = a_loop("carry-head");
    let many = "(cat poses.csv; for i in $(seq 200); do tail -n +2 poses.csv; done)";
    let ended = sh(
        &dir,
        &format!("{many} | compensate-delay --delay 62ms | head -n 3"),
    );
    // The shell's cat is told by a signal; the tool ends in good order and says nothing.
    assert_eq!(ended.text().lines().count(), 3);
    assert_eq!(ended.stderr, "");
}

/// The desired motion comes through a FIFO while the poses come through the pipe.
#[test]
fn a_live_motion_is_the_same_as_a_file() {
    let dir = a_loop("carry-fifo");
    let file = sh(
        &dir,
        "compensate-delay --delay 62ms --motion desired.csv poses.csv",
    )
    .expect(0);
    let live = sh(
        &dir,
        "mkfifo desired.fifo; cat desired.csv > desired.fifo & \
         compensate-delay --delay 62ms --motion desired.fifo --motion-wait 60s poses.csv",
    )
    .expect(0);
    assert_eq!(file.text(), live.text());
    // A FIFO that nobody writes to is waited for no longer than asked.
    let silent = sh(
        &dir,
        "mkfifo silent.fifo; head -n 4 poses.csv \
         | compensate-delay --delay 62ms --motion silent.fifo --motion-wait 1ms",
    )
    .expect(0);
    assert_eq!(silent.column("status"), ["stale-motion"; 3]);
}

fn now_ns() -> i64 {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap();
    i64::try_from(now.as_nanos()).unwrap()
}

/// `--to now`: each pose comes out at once, with the time at which it was written.
#[test]
fn live_poses_are_carried_to_the_present() {
    let dir = scratch("carry-now");
    let bin = Path::new(env!("CARGO_BIN_EXE_compensate-delay"));
    let mut child = Command::new(bin)
        .args([
            "--to",
            "now",
            "--max-horizon",
            "60s",
            "--method",
            "constant-velocity",
            // The poses of this test are exact.
            "--sigma-mm",
            "0.001",
        ])
        .current_dir(&dir)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut input = child.stdin.take().unwrap();
    let mut output = BufReader::new(child.stdout.take().unwrap()).lines();
    let columns = "stamp_ns,scan_stamp_ns,x_m,y_m,z_m,roll_rad,pitch_rad,yaw_rad";
    writeln!(input, "{columns}").unwrap();
    let start_ns = now_ns();
    for k in 0..10 {
        std::thread::sleep(std::time::Duration::from_millis(5));
        let stamp_ns = now_ns() - DELAY_NS;
        let y_m = (stamp_ns - start_ns) as f64 * 1e-9;
        writeln!(input, "{stamp_ns},7,0,{y_m},2,0,0,0").unwrap();
        input.flush().unwrap();
        if k == 0 {
            assert!(output.next().unwrap().unwrap().starts_with("stamp_ns,"));
        }
        let row = output.next().unwrap().unwrap();
        let after_ns = now_ns();
        let fields: Vec<&str> = row.split(',').collect();
        let used_ns: i64 = fields[0].parse().unwrap();
        assert!(
            stamp_ns + DELAY_NS <= used_ns && used_ns <= after_ns,
            "{row}"
        );
        assert_eq!(fields[1], "7");
        if k > 5 {
            // At 1 m/s; how far it is carried depends on the machine's load.
            let carried_m: f64 = fields[4].parse().unwrap();
            let expected_m = (used_ns - start_ns) as f64 * 1e-9;
            let horizon_s = (used_ns - stamp_ns) as f64 * 1e-9;
            assert!((carried_m - expected_m).abs() < 0.5 * horizon_s, "{row}");
        }
    }
    drop(input);
    assert!(child.wait().unwrap().success());
}
