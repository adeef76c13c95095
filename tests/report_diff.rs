//! report diff: on the real programs, with its exit statuses, for golden files.

#![cfg(unix)]

mod shell;

use shell::{scratch, sh};
use std::path::PathBuf;

fn a_run(name: &str) -> PathBuf {
    let dir = scratch(name);
    let line = "simulate -f frame.toml --n-scans 30 --effects reference --truth truth.csv \
                --imu imu.csv > scans.csv && extract-lines -f frame.toml scans.csv > lines.csv && \
                solve-pose -f frame.toml --imu imu.csv lines.csv > poses.csv && \
                simulate -f frame.toml --n-scans 30 --effects reference --format mcap -o run.mcap";
    sh(&dir, line).expect(0);
    dir
}

#[test]
fn equal_files_are_equal_and_quiet() {
    let dir = a_run("diff-equal");
    for line in [
        "report diff poses.csv poses.csv",
        "cat scans.csv | report diff scans.csv -",
        "report diff <(cat scans.csv) <(cat scans.csv)",
        "cp run.mcap again.mcap; report diff run.mcap again.mcap",
        "report --json --truth truth.csv poses.csv > a.json; report diff a.json a.json",
        // Provenance is no difference; two simulations are one.
        "simulate -f frame.toml --n-scans 30 --effects reference --format mcap -q -o c.mcap; \
         report diff run.mcap c.mcap",
    ] {
        let ended = sh(&dir, line).expect(0);
        assert!(
            ended.stdout.is_empty() && ended.stderr.is_empty(),
            "{line}: {}",
            ended.stderr
        );
    }
    let ended = sh(&dir, "report diff -v scans.csv scans.csv").expect(0);
    assert!(
        ended
            .stderr
            .starts_with("scans.csv and scans.csv are equal: 30 rows, ")
    );
}

#[test]
fn tolerances_are_kept_to_the_edge() {
    let dir = a_run("diff-tolerance");
    let shift = |by: &str| {
        format!(
            "awk -F, -v OFS=, 'NR == 1 {{ for (i = 1; i <= NF; i++) if ($i == \"x_m\") c = i }} \
             NR == 11 {{ $c = sprintf(\"%.17g\", $c + {by}) }} {{ print }}' poses.csv > near.csv"
        )
    };
    sh(&dir, &shift("0.0009")).expect(0);
    let differ = sh(&dir, "report diff poses.csv near.csv").expect(4);
    assert!(
        differ.text().starts_with("poses.csv and near.csv differ in 1 row of 30, 1 field\n  x_m: 1 difference, the first in row 10 (line 11): "),
        "{}",
        differ.text()
    );
    assert!(
        differ.text().contains("; the largest "),
        "{}",
        differ.text()
    );
    sh(&dir, "report diff --tol x_m=1e-3 poses.csv near.csv").expect(0);
    sh(&dir, "report diff --tol '*_m=1e-3' poses.csv near.csv").expect(0);
    sh(&dir, "report diff --ignore x_m poses.csv near.csv").expect(0);
    sh(&dir, "report diff --tol 'y_m=1' poses.csv near.csv").expect(4);
    let quiet = sh(&dir, "report diff -q --tol x_m=8e-4 poses.csv near.csv").expect(4);
    assert!(quiet.stdout.is_empty() && quiet.stderr.is_empty());
    let said = sh(&dir, "report diff -v --tol x_m=1e-3 poses.csv near.csv").expect(0);
    assert!(
        said.stderr.contains("x_m: within its tolerance, at most "),
        "{}",
        said.stderr
    );
    // A row that is missing shifts the rest, unless rows are met by their stamp.
    sh(&dir, "sed 5d poses.csv > fewer.csv").expect(0);
    let many = sh(&dir, "report diff poses.csv fewer.csv").expect(4);
    assert!(
        many.text()
            .contains("only in poses.csv: row 30, the last one"),
        "{}",
        many.text()
    );
    let one = sh(&dir, "report diff --key stamp_ns poses.csv fewer.csv").expect(4);
    assert_eq!(one.text().lines().count(), 2, "{}", one.text());
    assert!(
        one.text()
            .contains("only in poses.csv: row with stamp_ns 17"),
        "{}",
        one.text()
    );
}

#[test]
fn mcap_is_compared_topic_by_topic() {
    let dir = a_run("diff-mcap");
    let other = "simulate -f frame.toml --n-scans 30 --effects reference --seed 9 --format mcap -o other.mcap";
    sh(&dir, other).expect(0);
    let ended = sh(&dir, "report diff run.mcap other.mcap").expect(4);
    assert!(
        ended.text().contains("scans.ranges_mm: "),
        "{}",
        ended.text()
    );
    assert!(!ended.text().contains("truth.x_m"), "{}", ended.text());
    sh(&dir, "report diff --tol scans.ranges_mm=100 --tol 'scans.remissions=1e6' --tol 'imu.*=1' run.mcap other.mcap").expect(0);
    sh(&dir, "extract-lines -f frame.toml run.mcap -o lines.mcap").expect(0);
    let ended = sh(&dir, "report diff run.mcap lines.mcap").expect(4);
    assert!(
        ended.text().contains("only in lines.mcap: topic /lines"),
        "{}",
        ended.text()
    );
    // Records are records, whatever they are written in.
    // A tolerance for what only one of them has is a tolerance for something.
    sh(&dir, "report diff --tol 'lines.*=1' run.mcap lines.mcap").expect(4);
    sh(&dir, "report diff scans.csv run.mcap").expect(0);
    sh(&dir, "report diff lines.csv lines.mcap").expect(0);
    let ended = sh(&dir, "report diff poses.csv lines.mcap").expect(65);
    assert!(
        ended.stderr.contains("no records of one kind"),
        "{}",
        ended.stderr
    );
}

#[test]
fn what_cannot_be_compared_ends_with_its_status() {
    let dir = a_run("diff-faults");
    sh(
        &dir,
        "echo '{}' > a.json; printf 'a,b\\n1\\n' > ragged.csv; head -c 2000 run.mcap > cut.mcap",
    )
    .expect(0);
    for (line, status, words) in [
        (
            "report diff poses.csv nowhere.csv",
            66,
            "nowhere.csv: No such file",
        ),
        ("report diff poses.csv", 2, "required"),
        ("report diff - -", 2, "only one of the two"),
        (
            "report diff --tol x_m poses.csv poses.csv",
            2,
            "is no tolerance",
        ),
        ("report diff poses.csv a.json", 65, "one is JSON"),
        (
            "report diff frame.toml poses.csv",
            65,
            "no column in common",
        ),
        (
            "report diff ragged.csv ragged.csv",
            65,
            "ragged.csv:2: 1 fields where the header has 2",
        ),
        ("report diff run.mcap cut.mcap", 65, "cut.mcap"),
        (
            "cat run.mcap | report diff run.mcap -",
            2,
            "a file is wanted, not a pipe",
        ),
        (
            "report diff --key no poses.csv poses.csv",
            2,
            "neither poses.csv nor poses.csv has a column no to be the key; there are stamp_ns",
        ),
        (
            "report diff --tol foo=1 poses.csv poses.csv",
            2,
            "neither poses.csv nor poses.csv has a column foo; there are stamp_ns, ",
        ),
        (
            "report diff --ignore foo run.mcap run.mcap",
            2,
            "has a column foo; there are scans.stamp_ns, ",
        ),
        (
            "report diff poses.csv lines.csv",
            65,
            "poses.csv and lines.csv cannot be compared: these are poses and those lines",
        ),
        (
            "report diff scans.csv truth.csv",
            65,
            "these are scans and those truth",
        ),
        ("report diff /tmp poses.csv", 66, "/tmp: is a directory"),
        ("report diff poses.csv /tmp", 66, "/tmp: is a directory"),
    ] {
        let ended = sh(&dir, line).expect(status);
        assert!(ended.stderr.contains(words), "{line}: {}", ended.stderr);
    }
    // A trajectory has a pose's columns.
    let head = sh(&dir, "report diff poses.csv truth.csv | head -1").expect(4);
    assert!(head.stderr.is_empty(), "{}", head.stderr);
}
