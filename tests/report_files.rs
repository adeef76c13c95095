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
    // Each pipe is read once, for its poses and for its truth.
    for parts in [
        "all=b.mcap all=a.mcap",
        "all=<(cat b.mcap) all=<(cat a.mcap)",
    ] {
        let merged = sh(&dir, &format!("report --json --merge {parts}")).expect(0);
        let merged = json(merged.text());
        let n = |report: &serde_json::Value| report["runs"][0]["scans"]["rows"].clone();
        assert_eq!(n(&merged), n(&whole), "{parts}");
        assert_eq!(merged["runs"][0]["matching"], whole["runs"][0]["matching"]);
    }
}

#[test]
fn tables_have_the_numbers_of_the_json() {
    let dir = a_run("report-tables");
    let options = "--truth truth.csv --zone 'low=z<=2' --zone 'high=z>2' poses.csv";
    let tree = sh(&dir, &format!("report --json {options}")).expect(0);
    let tree = json(tree.text());
    let ended = sh(&dir, &format!("report --csv {options}")).expect(0);
    let mut rows = csv::Reader::from_reader(&ended.stdout[..]);
    let columns: Vec<&str> = rows.headers().unwrap().iter().collect();
    assert_eq!(columns, ["run", "zone", "axis", "statistic", "value"]);
    let mut count = 0;
    for row in rows.records().map(Result::unwrap) {
        let run = tree["runs"]
            .as_array()
            .unwrap()
            .iter()
            .find(|run| run["zone"] == row[1])
            .unwrap();
        let path = [&row[2], &row[3]].join(".");
        let pointer = format!("/{}", path.trim_start_matches('.').replace('.', "/"));
        let Some(value) = run.pointer(&pointer) else {
            // A whole section that is not there is null in JSON.
            assert!(row[4].is_empty() || &row[4] == "0", "{path}: {}", &row[4]);
            continue;
        };
        let written = row[4].parse::<f64>().ok();
        match (value.as_f64(), written) {
            // The JSON reader is off by a last digit now and then.
            (Some(a), Some(b)) => assert!((a - b).abs() <= 1e-12 * a.abs(), "{path}: {a} {b}"),
            (a, b) => assert_eq!(a, b, "{path}"),
        }
        count += usize::from(written.is_some());
    }
    assert!(count > 200, "{count}");
    for (option, begin, parts) in [
        (
            "--markdown",
            "# Pose report: poses\n",
            ["| Error in mm | n |", "## Side by side"],
        ),
        (
            "--latex",
            "% \\usepackage{booktabs}\n",
            ["\\toprule", "poses in high against truth"],
        ),
    ] {
        let ended = sh(&dir, &format!("report {option} {options}")).expect(0);
        assert!(ended.text().starts_with(begin), "{:.200}", ended.text());
        assert!(
            parts.iter().all(|part| ended.text().contains(part)),
            "{}",
            ended.text()
        );
        let file = format!("report {option} {options} -o table && cat table");
        assert_eq!(
            sh(&dir, &file).expect(0).text().lines().count(),
            ended.text().lines().count()
        );
    }
    let two = sh(&dir, &format!("report --csv --json {options}")).expect(2);
    assert!(two.stderr.contains("cannot be used with"), "{}", two.stderr);
}

#[test]
fn a_run_is_taken_away_as_it_was_compared() {
    let dir = a_run("report-export");
    // Moved by 1 m and turned by 90 degrees, and 37 ms late: aligned and freed of the delay it is back.
    let away = "awk -F, -v OFS=, -v CONVFMT=%.17g 'NR == 1 { for (i = 1; i <= NF; i++) c[$i] = i; print; next }
        { x = $c[\"x_m\"]; y = $c[\"y_m\"]; $c[\"x_m\"] = 1 - y; $c[\"y_m\"] = x
          $c[\"yaw_rad\"] += 1.5707963267948966; print }' truth.csv > away.csv";
    sh(
        &dir,
        "simulate -f frame.toml --trajectory loop --effects none --truth truth.csv > scans.csv",
    )
    .expect(0);
    sh(&dir, away).expect(0);
    sh(
        &dir,
        "report convert -q poses=away.csv --format csv -o moved.csv",
    )
    .expect(0);
    let line = "report --truth truth.csv --align se2 --export tum out/ run=moved.csv";
    sh(&dir, line).expect(0);
    for name in ["out/run.tum", "out/truth.tum"] {
        assert!(dir.join(name).exists(), "{name}");
    }
    let diff = "report diff --tol '*_m=1e-6' --tol '*_rad=1e-6' out/run.tum out/truth.tum";
    sh(&dir, diff).expect(0);
    // As it is without being asked to change it.
    sh(
        &dir,
        "report --truth truth.csv --export euroc plain/ moved.csv",
    )
    .expect(0);
    let diff =
        "report diff --tol '*_rad=1e-12' --tol '*_m=0' --ignore 'v*' plain/truth.euroc truth.csv";
    sh(&dir, diff).expect(0);
    let far = sh(
        &dir,
        "report diff --tol '*=1e-3' plain/moved.euroc plain/truth.euroc",
    )
    .expect(4);
    assert!(far.text().contains("x_m: "), "{}", far.text());
    let late = "awk -F, -v OFS=, 'NR > 1 { $1 = sprintf(\"%s%09d\", substr($1, 1, 10), substr($1, 11) + 0); } { print }' truth.csv > same.csv; \
                report --truth truth.csv --delay 37ms --export tum late/ truth.csv";
    sh(&dir, late).expect(0);
    let first = |name: &str| {
        let line = format!("sed -n 2p 'late/{name}.tum'");
        let ended = sh(&dir, &line).expect(0);
        let stamp = ended.text().split(' ').next().unwrap().replace('.', "");
        stamp.parse::<i64>().unwrap()
    };
    assert_eq!(first("truth 2") - first("truth"), -37_000_000);
    let wrong = sh(
        &dir,
        "report --truth truth.csv --export kitti out/ moved.csv",
    )
    .expect(2);
    assert!(wrong.stderr.contains("tum or euroc"), "{}", wrong.stderr);
}

#[test]
fn the_chain_of_stages_is_shown() {
    let dir = scratch("report-chain");
    let line = "export CABLEPOSE_META=1; simulate -f frame.toml --n-scans 20 --seed 5 --truth truth.csv \
                | extract-lines -f frame.toml | solve-pose -f frame.toml > poses.csv";
    sh(&dir, line).expect(0);
    let chain = [
        "poses (poses.csv)",
        "simulate -f frame.toml --n-scans 20 --seed 5 --truth truth.csv  # seed 5",
        "solve-pose -f frame.toml",
        "truth (truth.csv)",
        "report ",
    ];
    for option in ["-v", "--markdown", "--latex"] {
        let ended = sh(
            &dir,
            &format!("report {option} --truth truth.csv poses.csv"),
        )
        .expect(0);
        let mut rest = ended.text();
        for part in chain {
            let at = rest.find(part);
            rest = &rest[at.unwrap_or_else(|| panic!("{option}: {part}: {}", ended.text()))..];
        }
    }
    let ended = sh(&dir, "report --json --truth truth.csv poses.csv").expect(0);
    let tree = json(ended.text());
    assert_eq!(tree["runs"][0]["stages"].as_array().unwrap().len(), 3);
    assert_eq!(tree["reference"]["stages"].as_array().unwrap().len(), 1);
    let bare = sh(
        &dir,
        "grep -v '^#' poses.csv | report -v --truth truth.csv -",
    )
    .expect(0);
    assert!(
        bare.text().contains("unknown: the stream does not say"),
        "{}",
        bare.text()
    );
}

#[test]
fn a_file_is_no_folder() {
    let dir = a_run("report-no-folder");
    std::fs::write(dir.join("there"), "").unwrap();
    for option in ["--svg there", "--png there", "--export tum there"] {
        let ended = sh(
            &dir,
            &format!("report -q --truth truth.csv {option} poses.csv"),
        );
        assert_eq!(ended.status, 74, "{option}: {}", ended.stderr);
        assert_eq!(
            ended.stderr, "report: there: is there and no folder\n",
            "{option}"
        );
    }
}
