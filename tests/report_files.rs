//! report's files: runs that were split up, tables for other programs, trajectories to take away.

#![cfg(unix)]

mod shell;

use shell::{scratch, sh};
use std::path::PathBuf;

/// A run of 60 poses with noise: truth.csv, lines.csv, poses.csv.
fn a_run(name: &str) -> PathBuf {
    let dir = scratch(name);
    let line = "simulate -f frame.toml --trajectory random --n-scans 60 --effects reference \
                --truth truth.csv | tee scans.csv | extract-lines -f frame.toml --deskew none \
                | tee lines.csv | solve-pose -f frame.toml --pitch-deg 0 > poses.csv";
    sh(&dir, line).expect(0);
    dir
}

fn json(text: &str) -> serde_json::Value {
    serde_json::from_str(text).unwrap()
}

#[test]
fn parts_are_merged_to_the_whole() {
    let dir = a_run("report-merge");
    let split = "for f in poses truth; do
        { head -1 $f.csv; sed -n 2,21p $f.csv; } > $f-1.csv
        { head -1 $f.csv; sed -n 22,22p $f.csv; } > $f-2.csv
        { head -1 $f.csv; sed -n 23,61p $f.csv; } > $f-10.csv
    done";
    sh(&dir, split).expect(0);
    let whole = sh(&dir, "report --json --truth truth.csv all=poses.csv").expect(0);
    let mut whole = json(whole.text());
    for files in [
        "--truth truth-1.csv --truth truth-10.csv --truth truth-2.csv all=poses-1.csv \
         all=poses-10.csv all=poses-2.csv",
        "--truth truth-2.csv --truth <(cat truth-10.csv) --truth truth-1.csv all=poses-2.csv \
         all=<(cat poses-10.csv) all=- < poses-1.csv",
    ] {
        let merged = sh(&dir, &format!("report --json --merge {files}")).expect(0);
        assert!(merged.stderr.is_empty(), "{}", merged.stderr);
        let mut merged = json(merged.text());
        assert_eq!(merged["runs"].as_array().unwrap().len(), 1);
        for report in [&mut merged, &mut whole] {
            // Only the names of files may differ.
            report["runs"][0]["source"] = "".into();
            report["reference"]["source"] = "".into();
        }
        assert_eq!(merged, whole);
    }
    let text = sh(&dir, "report --merge --truth truth.csv poses-*.csv").expect(0);
    assert!(
        text.text()
            .starts_with("poses against truth\n  3 files, poses-1.csv to poses-2.csv, 60 rows"),
        "{}",
        text.text()
    );
    // Without --merge they are three runs.
    let apart = sh(&dir, "report --json --truth truth.csv poses-*.csv").expect(0);
    assert_eq!(json(apart.text())["runs"].as_array().unwrap().len(), 3);
    // A part that is given twice does not count twice, and that is said.
    let line = "report --merge --truth truth.csv poses.csv poses-2.csv";
    let twice = sh(&dir, line).expect(3);
    assert!(
        twice
            .stderr
            .contains("rows at the stamp of another: 1 left out"),
        "{}",
        twice.stderr
    );
}

#[test]
fn parts_in_mcap_bring_their_own_truth() {
    let dir = scratch("report-merge-mcap");
    let run = "simulate -f frame.toml --n-scans 30 --format mcap | extract-lines -f frame.toml \
               | solve-pose -f frame.toml > run.mcap";
    sh(&dir, run).expect(0);
    let whole = sh(&dir, "report --json all=run.mcap").expect(0);
    let whole = json(whole.text());
    // A scan's stamp lies between those of two poses.
    let line = "simulate -f frame.toml --n-scans 30 | sed -n 13p | cut -d, -f1";
    let ended = sh(&dir, line).expect(0);
    let between = ended.text().trim();
    let cut = format!(
        "compensate-delay --delay 0ms --to {between} run.mcap > a.mcap; \
         compensate-delay --delay 0ms --from {between} run.mcap > b.mcap"
    );
    sh(&dir, &cut).expect(0);
    let merged = sh(&dir, "report --json --merge all=b.mcap all=a.mcap").expect(0);
    let merged = json(merged.text());
    let n = |report: &serde_json::Value| report["runs"][0]["scans"]["rows"].clone();
    assert_eq!(n(&merged), n(&whole));
    assert_eq!(merged["runs"][0]["matching"], whole["runs"][0]["matching"]);
}
