//! report on input that is not as it should be: each fault with its sentence and its exit status;
//! and limits on every statistic.

#![cfg(unix)]

mod shell;

use shell::{Ended, scratch, sh};
use std::fs;
use std::path::{Path, PathBuf};

/// Rows in poses.csv.
const ROWS: usize = 200;

/// A moving run of ROWS poses at 50 Hz in poses.csv, and its truth, made here to be exact.
fn a_run(name: &str) -> PathBuf {
    let dir = scratch(name);
    let mut poses =
        "stamp_ns,seq,x_m,y_m,z_m,roll_rad,pitch_rad,yaw_rad,cov_x_x,status\n".to_owned();
    let mut truth = "stamp_ns,x_m,y_m,z_m,roll_rad,pitch_rad,yaw_rad\n".to_owned();
    for i in 0..ROWS {
        let stamp = 1_700_000_000_000_000_000 + i as i64 * 20_000_000;
        let phase = (i % 100) as f64 / 100.0;
        let y = 1.0 - 4.0 * (phase - 0.5).abs();
        let z = 1.0 + 0.01 * i as f64;
        let off = if i % 2 == 0 { 0.002 } else { -0.001 };
        truth += &format!("{stamp},0,{y},{z},0,0,0\n");
        poses += &format!("{stamp},{i},{off},{y},{z},0,0,0,4e-6,ok\n");
    }
    fs::write(dir.join("poses.csv"), poses).unwrap();
    fs::write(dir.join("truth.csv"), truth).unwrap();
    dir
}

/// Writes odd.csv: poses.csv with its rows (fields, 0 the first) changed; none leaves one out.
fn odd(dir: &Path, mut change: impl FnMut(usize, &mut Vec<String>) -> bool) {
    let text = fs::read_to_string(dir.join("poses.csv")).unwrap();
    let mut lines = text.lines();
    let mut out = format!("{}\n", lines.next().unwrap());
    for (i, line) in lines.enumerate() {
        let mut fields: Vec<String> = line.split(',').map(str::to_owned).collect();
        if change(i, &mut fields) {
            out += &(fields.join(",") + "\n");
        }
    }
    fs::write(dir.join("odd.csv"), out).unwrap();
}

fn shifted(stamp: &str, ns: i64) -> String {
    (stamp.parse::<i64>().unwrap() + ns).to_string()
}

fn report(dir: &Path, options: &str) -> Ended {
    sh(dir, &format!("report --truth truth.csv {options}"))
}

/// Counts of the run's faults as JSON has them.
fn input(dir: &Path) -> serde_json::Value {
    let ended = report(dir, "--json odd.csv");
    let json: serde_json::Value = serde_json::from_slice(&ended.stdout).unwrap();
    json["runs"][0]["input"].clone()
}

#[track_caller]
fn says(ended: &Ended, on_stderr: &[&str], in_table: &[&str]) {
    for words in on_stderr {
        assert!(ended.stderr.contains(words), "{words}: {}", ended.stderr);
    }
    for words in in_table {
        assert!(ended.text().contains(words), "{words}: {}", ended.text());
    }
    assert!(!ended.stderr.contains("panicked"), "{}", ended.stderr);
}

#[test]
fn an_orderly_run_has_no_verdict() {
    let dir = a_run("verdict-none");
    let ended = report(&dir, "poses.csv").expect(0);
    assert!(ended.stderr.is_empty(), "{}", ended.stderr);
    // Only some variances are there.
    let notes = ended.text().lines().filter(|line| line.starts_with("note"));
    assert!(
        notes.clone().all(|note| note.contains("variance")),
        "{}",
        ended.text()
    );
}

#[test]
fn a_number_that_is_missing() {
    let dir = a_run("verdict-nan");
    // With a status of ok it is a bad row.
    odd(&dir, |i, fields| {
        if i == 7 {
            fields[3].clear();
        }
        true
    });
    says(
        &report(&dir, "odd.csv").expect(65),
        &["odd.csv:9: y_m: empty, and the status is ok"],
        &[],
    );
    let skipped = report(&dir, "--skip-bad odd.csv").expect(3);
    says(
        &skipped,
        &["odd.csv: 1 bad record skipped"],
        &["1 scan has no row"],
    );
    // A NaN that is written out is none of our numbers.
    odd(&dir, |i, fields| {
        if i == 7 {
            fields[3] = "nan".to_owned();
        }
        true
    });
    says(
        &report(&dir, "odd.csv").expect(65),
        &["odd.csv:9: y_m: not a number: \"nan\""],
        &[],
    );
    // With a status that does not explain it, it is counted and said.
    odd(&dir, |i, fields| {
        if i == 7 {
            fields[3].clear();
            fields[9] = "few-edges".to_owned();
        }
        true
    });
    let ended = report(&dir, "odd.csv").expect(3);
    says(
        &ended,
        &["odd: rows with a number missing and no status that says why: 1"],
        &["1 row lacks a number, and its status does not say why"],
    );
    assert_eq!(input(&dir)["nan"], 1);
}

#[test]
fn rows_out_of_order() {
    let dir = a_run("verdict-unsorted");
    let swap =
        "awk 'NR == 51 { held = $0; next } { print } NR == 52 { print held }' poses.csv > odd.csv";
    sh(&dir, swap).expect(0);
    let ended = report(&dir, "odd.csv").expect(3);
    says(
        &ended,
        &["odd: rows out of order in time: 1 sorted in"],
        &["1 row is out of order in time; it was sorted in"],
    );
    let found = input(&dir);
    assert_eq!(
        (&found["unsorted"], &found["jumps"]),
        (&1.into(), &0.into())
    );
}

#[test]
fn two_rows_at_one_stamp() {
    let dir = a_run("verdict-repeated");
    sh(&dir, "sed 60p poses.csv > odd.csv").expect(0);
    let ended = report(&dir, "odd.csv").expect(3);
    says(
        &ended,
        &["odd: rows at the stamp of another: 1 left out"],
        &["1 row has the stamp of another; it was left out"],
    );
    assert_eq!(input(&dir)["repeated"], 1);
}

#[test]
fn a_gap_is_no_jump_of_the_clock() {
    let dir = a_run("verdict-gap");
    // Twenty scans were lost: the sequence numbers skip them.
    odd(&dir, |i, _| !(90..110).contains(&i));
    let ended = report(&dir, "odd.csv").expect(0);
    says(
        &ended,
        &[],
        &[
            "20 scans have no row",
            "rows are missing in time: once, up to 0.420 s",
        ],
    );
    let found = input(&dir);
    assert_eq!((&found["gaps"], &found["jumps"]), (&1.into(), &0.into()));
    // A clock that is set: the stamps step, the sequence numbers do not.
    for (ns, seconds, unsorted) in [(3_000_000_000, "3.000", 0), (-700_000_000, "−0.700", 1)] {
        odd(&dir, |i, fields| {
            if i >= 100 {
                fields[0] = shifted(&fields[0], ns);
            }
            true
        });
        let line = "LC_ALL=C.UTF-8 report --truth truth.csv odd.csv";
        let ended = sh(&dir, line).expect(3);
        let words =
            format!("the stamps jump against the sequence numbers: once, by up to {seconds} s");
        says(&ended, &["odd: jumps of the clock: 1"], &[&words]);
        let found = input(&dir);
        assert_eq!(
            (&found["jumps"], &found["unsorted"]),
            (&1.into(), &unsorted.into()),
            "{found}"
        );
    }
}

#[test]
fn an_alignment_that_the_motion_does_not_give() {
    let dir = a_run("verdict-alignment");
    // A straight line says nothing of the turn about it; standing says nothing of any.
    for (name, place) in [("line", "0,{i}e-2,2"), ("stand", "0,1,2")] {
        let file = |off: &str| {
            let mut text =
                "stamp_ns,seq,x_m,y_m,z_m,roll_rad,pitch_rad,yaw_rad,status\n".to_owned();
            for i in 0..100i64 {
                let place = place.replace("{i}", &i.to_string());
                let stamp = 1_700_000_000_000_000_000 + i * 20_000_000;
                text += &format!("{stamp},{i},{place}{off},0,0,0,ok\n");
            }
            text
        };
        fs::write(dir.join("odd.csv"), file("5")).unwrap();
        fs::write(dir.join("truth.csv"), file("")).unwrap();
        for align in ["se2", "se3"] {
            let ended = report(&dir, &format!("--align {align} odd.csv"));
            let ended = if align == "se2" && name == "line" {
                // A line along y says which way yaw is.
                ended.expect(0)
            } else {
                let ended = ended.expect(0);
                says(&ended, &[], &["only the shift was aligned"]);
                ended
            };
            assert!(!ended.text().contains("nan"), "{}", ended.text());
        }
    }
}

#[test]
fn nothing_one_pose_and_no_overlap() {
    let dir = a_run("verdict-few");
    fs::write(dir.join("odd.csv"), "").unwrap();
    says(
        &report(&dir, "odd.csv").expect(65),
        &["odd.csv: empty: pose records start with a header row"],
        &[],
    );
    sh(&dir, "head -1 poses.csv > odd.csv").expect(0);
    says(
        &report(&dir, "odd.csv").expect(3),
        &["odd: nothing to compare: there are no poses"],
        &[],
    );
    says(
        &sh(&dir, "head -1 truth.csv | report --truth - poses.csv").expect(3),
        &["poses: nothing to compare: the reference has no points"],
        &[],
    );
    sh(&dir, "head -2 poses.csv > odd.csv").expect(0);
    let one = report(&dir, "odd.csv").expect(0);
    says(&one, &[], &["1 poses matched"]);
    assert!(
        !one.text().to_lowercase().contains("nan") && !one.text().contains("inf"),
        "{}",
        one.text()
    );
    for option in ["--json", "--csv", "--markdown", "--latex"] {
        let ended = report(&dir, &format!("{option} odd.csv")).expect(0);
        assert!(
            !ended.text().contains("NaN") && !ended.text().contains("inf"),
            "{option}"
        );
    }
    odd(&dir, |_, fields| {
        fields[0] = shifted(&fields[0], 60_000_000_000);
        true
    });
    says(
        &report(&dir, "odd.csv").expect(3),
        &[
            "odd: nothing to compare: the poses (17",
            "do not overlap in time",
        ],
        &[],
    );
}

#[test]
fn every_statistic_can_be_a_limit() {
    let dir = a_run("verdict-gates");
    let options = "--rpe 1s --rpe 10f poses.csv";
    let ended = report(&dir, &format!("--csv {options}")).expect(0);
    let mut reader = csv::Reader::from_reader(&ended.stdout[..]);
    let mut gates = String::new();
    let (mut with_value, mut without) = (0, 0);
    for row in reader.records().map(Result::unwrap) {
        let name = match &row[2] {
            "" => row[3].to_owned(),
            axis => format!("{axis}.{}", &row[3]),
        };
        // One that every value passes, and that a missing one fails.
        gates += &format!(" --fail-if '{name}<-1e300'");
        with_value += usize::from(!row[4].is_empty());
        without += usize::from(row[4].is_empty());
    }
    assert!(with_value > 200, "{with_value}");
    let ended = report(&dir, &format!("{options} {gates}")).expect(if without > 0 { 4 } else { 0 });
    let failed = ended
        .stderr
        .lines()
        .filter(|line| line.contains("has no value"))
        .count();
    assert_eq!(failed, without, "{}", ended.stderr);
    assert_eq!(ended.stderr.lines().count(), without, "{}", ended.stderr);
}

#[test]
fn limits_hold_for_every_run_or_for_one() {
    let dir = a_run("verdict-runs");
    odd(&dir, |_, fields| {
        fields[2] = format!("{}", 10.0 * fields[2].parse::<f64>().unwrap());
        true
    });
    let runs = "good=poses.csv bad=odd.csv";
    for (gate, status, words) in [
        ("x.rms_mm>100", 0, ""),
        (
            "x.rms_mm>5",
            4,
            "report: bad: x.rms_mm is 15.8114, 10.8114 beyond the limit 5",
        ),
        ("good:x.rms_mm>5", 0, ""),
        ("x.rms_mm>1", 4, "report: good: x.rms_mm is 1.5811"),
        ("rpe.1s.x.rms_mm>1", 4, "rpe.1s.x.rms_mm has no value"),
        ("none:x.rms_mm>1", 2, "names no run"),
        ("x.rms_cm>1", 2, "there is no statistic 'x.rms_cm'"),
    ] {
        let ended = report(&dir, &format!("{runs} --fail-if '{gate}'")).expect(status);
        if words.is_empty() {
            assert!(ended.stderr.is_empty(), "{}", ended.stderr);
        } else {
            says(&ended, &[words], &[]);
        }
    }
}
