//! report: its table, JSON and page, what it says of odd input, and how it ends.

mod shell;

use shell::{Ended, scratch, sh};
use snapbox::{assert_data_eq, file};
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

const NAMES: [&str; 6] = ["x", "y", "z", "roll", "pitch", "yaw"];

/// Columns of the covariance's upper triangle.
fn covariance_columns() -> String {
    let mut columns = String::new();
    for (i, a) in NAMES.iter().enumerate() {
        for b in &NAMES[i..] {
            let _ = write!(columns, ",cov_{a}_{b}");
        }
    }
    columns
}

/// Triangle wave of period `period` between -1 and 1: exact on every machine, as a sine is not.
fn triangle(i: usize, period: usize) -> f64 {
    let phase = (i % period) as f64 / period as f64;
    1.0 - 4.0 * (phase - 0.5).abs()
}

/// Writes truth.csv and, for each (name, scale), a run with errors of known size: a bias of a
/// quarter of sigma and a spread that alternates in sign.
fn write_runs(dir: &Path, rows: usize, runs: &[(&str, f64)]) {
    let sigma = [0.004, 0.0003, 0.0005, 1e-4, 2e-4, 1e-3];
    let mut truth = "stamp_ns,x_m,y_m,z_m,roll_rad,pitch_rad,yaw_rad\n".to_owned();
    let header = "stamp_ns,scan_stamp_ns,seq,x_m,y_m,z_m,roll_rad,pitch_rad,yaw_rad";
    let header = format!(
        "{header}{},edges,votes,range_bias_m,status\n",
        covariance_columns()
    );
    let mut poses = vec![header; runs.len()];
    for i in 0..rows {
        let stamp = 1_700_000_000_000_000_000 + i as i64 * 20_000_000;
        let place = [
            0.0,
            4.0 * triangle(i, 1900),
            2.2 + 1.7 * triangle(i, 700),
            0.0,
            0.0,
            0.02,
        ];
        let text = |values: [f64; 6]| values.map(|v| v.to_string()).join(",");
        let _ = writeln!(truth, "{stamp},{}", text(place));
        for ((_, scale), out) in runs.iter().zip(&mut poses) {
            let _ = write!(out, "{stamp},{stamp},{i}");
            if i % 100 == 99 {
                let _ = writeln!(out, "{}0,,,no-pose no-edges", ",".repeat(28));
                continue;
            }
            let error = if i % 2 == 0 { 1.25 } else { -0.75 } * triangle(i, 37).abs() * scale;
            let mut pose = place;
            for k in 0..6 {
                pose[k] += error * sigma[k];
            }
            let _ = write!(out, ",{}", text(pose));
            for (a, sigma) in sigma.iter().enumerate() {
                for b in a..6 {
                    let value = if a == b { sigma * sigma } else { 0.0 };
                    let _ = write!(out, ",{value}");
                }
            }
            let status = if i % 10 == 3 { "few-edges" } else { "ok" };
            let _ = writeln!(out, ",8,{},0.02,{status}", 20 + i % 7);
        }
    }
    fs::write(dir.join("truth.csv"), truth).unwrap();
    for ((name, _), text) in runs.iter().zip(poses) {
        fs::write(dir.join(format!("{name}.csv")), text).unwrap();
    }
}

fn two_runs(name: &str) -> PathBuf {
    let dir = scratch(name);
    write_runs(&dir, 2000, &[("vote", 4.0), ("joint", 1.0)]);
    dir
}

/// Keeps the first `rows` lines of truth.csv as NAME, changed by `edit`.
fn edited(dir: &Path, from: &str, to: &str, edit: impl Fn(usize, &str) -> String) {
    let text = fs::read_to_string(dir.join(from)).unwrap();
    let lines = text.lines().enumerate().map(|(i, line)| edit(i, line));
    fs::write(dir.join(to), lines.collect::<String>()).unwrap();
}

fn says(ended: &Ended, words: &str) {
    assert!(ended.stderr.contains(words), "{words}: {}", ended.stderr);
}

#[test]
fn the_table() {
    let dir = two_runs("report-table");
    let line = "LC_ALL=C.UTF-8 report --truth truth.csv --cells vote=vote.csv joint=- < joint.csv \
                --fail-if 'vote:x.rms_mm>4.1' --fail-if 'joint:x.rms_mm>4.1'";
    let ended = sh(&dir, line).expect(4);
    assert_data_eq!(ended.text(), file!["../testdata/golden/report.txt"]);
    says(&ended, "report: vote: x.rms_mm is ");
    assert_eq!(ended.stderr.lines().count(), 1, "{}", ended.stderr);
    let ended = sh(&dir, "report --truth truth.csv joint.csv").expect(0);
    assert!(ended.text().is_ascii(), "the C locale has only ASCII");
}

#[test]
fn json_alone_is_on_stdout() {
    let dir = two_runs("report-json");
    let zones = "--zone 'low=z<=2.2' --zone 'z>2.2'";
    let ended = sh(
        &dir,
        &format!("report --truth truth.csv --json {zones} joint.csv"),
    )
    .expect(0);
    assert_data_eq!(ended.text(), file!["../testdata/golden/report.json"]);
    assert!(ended.stderr.is_empty(), "{}", ended.stderr);
    let json: serde_json::Value = serde_json::from_slice(&ended.stdout).unwrap();
    let solved = |run: usize| json["runs"][run]["scans"]["rows"].as_u64().unwrap();
    assert_eq!(solved(0) + solved(1), 2000);
    assert_eq!(json["runs"][0]["zone"], "low");
}

#[test]
fn the_page_is_whole_small_and_quiet() {
    let dir = scratch("report-page");
    write_runs(&dir, 20_000, &[("vote", 4.0), ("joint", 1.0)]);
    fs::create_dir_all(dir.join("out")).unwrap();
    let here = dir.display();
    let make = |name: &str, runs: &str| {
        let line =
            format!("report -q --truth {here}/truth.csv --html out/{name} {runs} > {name}.txt");
        sh(&dir, &line).expect(0);
        fs::read_to_string(dir.join("out").join(name)).unwrap()
    };
    let one = make("page.html", &format!("{here}/joint.csv"));
    fs::rename(dir.join("out/page.html"), dir.join("first.html")).unwrap();
    assert_eq!(
        one,
        make("page.html", &format!("{here}/joint.csv")),
        "twice the same bytes"
    );
    let two = make("two.html", "vote.csv joint.csv");
    for page in [&one, &two] {
        assert!(page.len() <= 250_000, "{} bytes", page.len());
        for absent in [
            "http",
            "<script",
            "src=",
            "@import",
            "url(",
            &here.to_string(),
            "NaN",
        ] {
            assert!(!page.contains(absent), "{absent}");
        }
        assert_eq!(page.matches("<svg").count(), page.matches("</svg>").count());
        assert!(page.contains("prefers-color-scheme:dark") && page.contains("@media print"));
        for section in [
            "Errors",
            "Over the workspace",
            "Over time",
            "Distribution",
            "Covariances",
            "Scans",
        ] {
            assert!(page.contains(&format!("<h2>{section}</h2>")), "{section}");
        }
        assert!(page.contains("no-pose no-edges"));
    }
    for title in [
        "Position error, rms",
        "Bias in x",
        "Yaw error, rms",
        "Bias in y",
        "Bias in z",
        "Bias in yaw",
        "x error, max",
        "y error, rms",
        "z error, rms",
        "Votes",
        "Edges",
        "Poses",
    ] {
        assert!(
            one.contains(&format!("aria-label=\"{title} over the workspace, joint\"")),
            "{title}"
        );
    }
    for name in NAMES {
        let over_time = format!("aria-label=\"Error in {name}, with the solver’s ±3σ\"");
        assert_eq!(one.matches(&over_time).count(), 1, "{name}");
        assert!(one.contains(&format!(
            "aria-label=\"Distribution of the error in {name}\""
        )));
    }
    assert!(one.contains("report -q --truth truth.csv --html page.html joint.csv"));
    assert!(two.contains("<h2>Before and after</h2>"));
    let line = "SOURCE_DATE_EPOCH=951782400 report --truth truth.csv --html dated.html joint.csv";
    sh(&dir, line).expect(0);
    assert!(
        fs::read_to_string(dir.join("dated.html"))
            .unwrap()
            .contains("2000-02-29")
    );
    assert!(!one.contains("2000-02-29"));
}

#[test]
fn figures_leave_the_page_as_files() {
    let dir = two_runs("report-figures");
    let make = |to: &str, more: &str, runs: &str| {
        let line = format!(
            "report -q --truth truth.csv --svg {to}/svg --png {to}/png {more} {runs} > {to}.txt"
        );
        sh(&dir, &line).expect(0);
    };
    let names = |folder: &str| {
        let files = fs::read_dir(dir.join(folder)).unwrap();
        let name = |f: fs::DirEntry| f.file_name().into_string().unwrap();
        let mut names: Vec<String> = files.map(|f| name(f.unwrap())).collect();
        names.sort();
        names
    };
    make("one", "", "joint.csv");
    let svg = names("one/svg");
    for name in [
        "error-x",
        "map-position-rms",
        "map-x-bias",
        "distribution-yaw",
        "nees",
        "coverage",
        "edges",
    ] {
        assert!(svg.contains(&format!("{name}.svg")), "{name}: {svg:?}");
    }
    let png = names("one/png");
    let stems = |names: &[String]| -> Vec<String> {
        let stem = |n: &String| n.split('.').next().unwrap().to_owned();
        names.iter().map(stem).collect()
    };
    assert_eq!(stems(&svg), stems(&png));
    for name in &svg {
        let text = fs::read_to_string(dir.join("one/svg").join(name)).unwrap();
        assert!(
            text.starts_with("<svg xmlns=") && text.ends_with("</svg>\n"),
            "{name}"
        );
        for absent in ["class=", "var(", "NaN", "href"] {
            assert!(!text.contains(absent), "{name}: {absent}");
        }
    }
    for name in &png {
        let bytes = fs::read(dir.join("one/png").join(name)).unwrap();
        assert_eq!(bytes[..8], *b"\x89PNG\r\n\x1a\n", "{name}");
        let side = |at: usize| u32::from_be_bytes(bytes[at..at + 4].try_into().unwrap());
        assert!(side(16) > 600 && side(20) > 200, "{name}");
    }
    // The same bytes twice; contours are other pictures, courses are not.
    make("again", "", "joint.csv");
    make("contours", "--maps contours", "joint.csv");
    let same = |a: &str, b: &str, name: &str| {
        fs::read(dir.join(a).join(name)).unwrap() == fs::read(dir.join(b).join(name)).unwrap()
    };
    assert!(svg.iter().all(|n| same("one/svg", "again/svg", n)));
    assert!(png.iter().all(|n| same("one/png", "again/png", n)));
    assert!(!same("one/svg", "contours/svg", "map-position-rms.svg"));
    assert!(same("one/svg", "contours/svg", "error-x.svg"));
    // Of several runs, each has its own.
    make("two", "", "vote.csv joint.csv");
    let two = names("two/svg");
    for name in ["vote-error-x.svg", "joint-error-x.svg"] {
        assert!(two.iter().any(|n| n == name), "{two:?}");
    }
}

#[test]
fn branches_of_one_pipeline_are_read_together() {
    let dir = scratch("report-branches");
    write_runs(&dir, 20_000, &[("joint", 1.0)]);
    // Read one after the other, the first branch would wait for the second for ever.
    let line = "mkfifo a.fifo && cat joint.csv | tee a.fifo | \
                timeout 60 report --truth <(cat truth.csv) --json a=a.fifo b=-";
    let ended = sh(&dir, line).expect(0);
    let json: serde_json::Value = serde_json::from_slice(&ended.stdout).unwrap();
    assert_eq!(json["runs"][0]["x"], json["runs"][1]["x"]);
    assert_eq!(json["runs"][1]["x"]["n"], 19_800);
}

#[test]
fn a_file_that_the_pipeline_still_writes_is_waited_for() {
    let dir = two_runs("report-late");
    let line = "mv truth.csv late.csv; { cat joint.csv; sleep 0.3; mv late.csv truth.csv; } | \
                report --truth truth.csv -";
    let ended = sh(&dir, line).expect(0);
    assert!(
        ended.text().contains("1980 poses matched"),
        "{}",
        ended.text()
    );
}

#[test]
fn what_stands_beside_poses_is_read_with_them() {
    let dir = scratch("report-beside");
    write_runs(&dir, 20_000, &[("joint", 1.0)]);
    let lines = "simulate -q -f frame.toml --n-scans 5 | extract-lines -q -f frame.toml > lines.csv && \
                 mkfifo lines.fifo";
    sh(&dir, lines).expect(0);
    for line in [
        // A branch that comes after more poses than a pipe holds.
        "{ cat joint.csv; cat lines.csv > lines.fifo; } | \
         timeout 60 report --truth truth.csv --json --lines lines.fifo -",
        // A file that the pipeline is still to write.
        "mv lines.csv late.csv; { cat joint.csv; sleep 0.3; mv late.csv lines.csv; } | \
         report --truth truth.csv --json --lines lines.csv -",
    ] {
        let ended = sh(&dir, line).expect(0);
        let json: serde_json::Value = serde_json::from_slice(&ended.stdout).unwrap();
        assert_eq!(json["runs"][0]["quality"]["scans"], 5, "{line}");
    }
}

#[test]
fn standstills_and_their_desired_poses_may_be_branches_of_one_pipeline() {
    let dir = scratch("report-static-branches");
    write_runs(&dir, 20_000, &[("joint", 1.0)]);
    sh(&dir, "mkfifo desired.fifo").expect(0);
    // Nothing stands there (3). The branch is longer than a pipe holds and is written before the poses are.
    let line = "{ cat truth.csv > desired.fifo; cat joint.csv; } | \
                timeout 60 report static --json --desired desired.fifo -";
    let apart = sh(&dir, "report static --json --desired truth.csv joint.csv").expect(3);
    let ended = sh(&dir, line).expect(3);
    let of = |bytes: &[u8]| -> serde_json::Value { serde_json::from_slice(bytes).unwrap() };
    let (ended, apart) = (of(&ended.stdout), of(&apart.stdout));
    assert_eq!(ended["poses"], 20_000);
    assert!(apart["intervals"].is_array());
    assert_eq!(ended["intervals"], apart["intervals"]);
}

#[test]
fn what_cannot_be_read_as_named_is_refused() {
    let dir = two_runs("report-named");
    for (line, says) in [
        (
            "report --truth - --truth - joint.csv < truth.csv",
            "named twice",
        ),
        ("report convert - - < joint.csv", "named twice"),
        (
            "simulate -q -f frame.toml --n-scans 5 --imu imu.csv > scans.csv; \
             report --imu imu.csv --lines no-such-file.csv",
            "--lines belongs to poses",
        ),
    ] {
        let ended = sh(&dir, line).expect(2);
        assert!(ended.stderr.contains(says), "{line}: {}", ended.stderr);
    }
}

#[test]
fn a_folder_is_no_input() {
    let dir = two_runs("report-folder");
    for line in [
        "report .",
        "report --truth . joint.csv",
        "report --truth truth.csv --imu . joint.csv",
        "report scan .",
        "report static .",
        "report lines --truth . joint.csv",
        "report convert .",
    ] {
        says(&sh(&dir, line).expect(66), "report: .: is a directory");
    }
}

#[test]
fn a_pipe_is_not_read_twice() {
    let dir = two_runs("report-twice");
    for line in [
        "report --truth truth.csv a=- b=- < joint.csv",
        "report --truth truth.csv --imu - - < joint.csv",
        "report static --desired - - < joint.csv",
        "report scan --lines - - < joint.csv",
        "report lines --truth - - < joint.csv",
    ] {
        let ended = sh(&dir, line).expect(2);
        says(
            &ended,
            "standard input is named twice: it can be read only once",
        );
    }
}

#[test]
fn an_argument_may_be_no_text() {
    let dir = two_runs("report-bytes");
    let line = "report -q --truth truth.csv --html $'\\xff.html' joint.csv && ls";
    sh(&dir, line).expect(0);
}

#[test]
fn nothing_to_compare_ends_with_status_3() {
    let dir = two_runs("report-nothing");
    edited(&dir, "truth.csv", "later.csv", |i, line| match i {
        0 => format!("{line}\n"),
        _ => format!("9{line}\n").replacen("91", "2", 1),
    });
    let ended = sh(&dir, "report --truth later.csv joint.csv").expect(3);
    says(&ended, "nothing to compare: the poses (");
    says(&ended, "do not overlap in time");
    edited(&dir, "joint.csv", "none.csv", |i, line| {
        if i == 0 {
            format!("{line}\n")
        } else {
            String::new()
        }
    });
    let ended = sh(&dir, "report --truth truth.csv --json none.csv").expect(3);
    says(&ended, "there are no poses");
    assert!(serde_json::from_slice::<serde_json::Value>(&ended.stdout).is_ok());
    let page = sh(&dir, "report --truth truth.csv --html none.html none.csv").expect(3);
    says(&page, "there are no poses");
    assert!(
        fs::read_to_string(dir.join("none.html"))
            .unwrap()
            .contains("there are no poses")
    );
    let ended = sh(
        &dir,
        "report --truth truth.csv --fail-if 'x.rms_mm>1' none.csv",
    )
    .expect(4);
    says(&ended, "x.rms_mm has no value");
}

#[test]
fn disorder_is_counted_and_said() {
    let dir = two_runs("report-disorder");
    edited(&dir, "joint.csv", "odd.csv", |i, line| match i {
        10 => String::new(),
        20 => format!("{line}\n{line}\n"),
        _ => format!("{line}\n"),
    });
    let ended = sh(
        &dir,
        "{ head -1 odd.csv; tail -n +2 odd.csv | tac; } | report --truth truth.csv -",
    )
    .expect(3);
    says(&ended, "rows at the stamp of another: 1 left out");
    assert!(
        ended
            .text()
            .contains("rows are out of order in time; they were sorted in")
    );
    assert!(
        ended.text().contains("1 scan has no row"),
        "{}",
        ended.text()
    );
    edited(&dir, "truth.csv", "holes.csv", |i, line| {
        match (i, line.split_once(',')) {
            (5, Some((stamp, _))) => format!("{stamp},,,,,,\n"),
            _ => format!("{line}\n"),
        }
    });
    let ended = sh(&dir, "report --truth holes.csv joint.csv").expect(65);
    says(&ended, "holes.csv:6: x_m");
    let ended = sh(&dir, "report --skip-bad --truth holes.csv joint.csv").expect(3);
    says(&ended, "holes.csv: 1 bad record skipped");
    assert!(ended.text().contains("1 interpolated"), "{}", ended.text());
}

#[test]
fn a_wrong_command_line_says_what_is_right() {
    let dir = two_runs("report-usage");
    for (options, words) in [
        ("--fail-if 'x.rms>4'", "there is no statistic 'x.rms'"),
        ("--fail-if 'x.rms_mm'", "no < or >"),
        ("--fail-if 'other:x.rms_mm>4'", "names no run"),
        ("--zone 'w<3'", "'w' is no component"),
        ("--max-diff 5", "a time with its unit"),
        ("--association best", "interpolated or nearest"),
    ] {
        let ended = sh(
            &dir,
            &format!("report --truth truth.csv {options} joint.csv"),
        )
        .expect(2);
        says(&ended, words);
    }
}

#[test]
fn poses_are_not_compared_with_themselves() {
    let dir = two_runs("report-itself");
    let gate = "--fail-if 'x.rms_mm>4'";
    for line in [
        format!("report joint.csv {gate}"),
        format!("report - {gate} < joint.csv"),
        format!("report {gate} < joint.csv"),
        format!("cat joint.csv | report {gate}"),
        format!("report {gate} joint.csv vote.csv"),
    ] {
        let ended = sh(&dir, &line).expect(2);
        says(
            &ended,
            "without --truth or --desired, the first run must be MCAP with /truth",
        );
        assert!(ended.stdout.is_empty(), "{line}: {}", ended.text());
    }
}

#[test]
fn an_mcap_stream_is_compared_with_its_own_truth_or_not_at_all() {
    let dir = scratch("report-mcap");
    let run = "simulate -f frame.toml --n-scans 30";
    let stages = "extract-lines -f frame.toml | solve-pose -f frame.toml";
    sh(&dir, &format!("{run} --format mcap | {stages} > run.mcap")).expect(0);
    for line in ["report --json run.mcap", "cat run.mcap | report --json"] {
        let ended = sh(&dir, line).expect(0);
        let json: serde_json::Value = serde_json::from_slice(&ended.stdout).unwrap();
        assert_eq!(json["reference"]["role"], "truth", "{line}");
        let run = &json["runs"][0];
        assert_eq!(run["matching"]["matched"], run["scans"]["solved"], "{line}");
        assert!(run["y"]["rms_mm"].as_f64().unwrap() > 0.0, "{line}");
    }
    sh(&dir, &format!("{run} | {stages} --format mcap > none.mcap")).expect(0);
    for line in ["report none.mcap", "cat none.mcap | report"] {
        let ended = sh(&dir, line).expect(2);
        says(&ended, "the first run must be MCAP with /truth");
    }
}

#[test]
fn outputs_keep_what_they_are_given() {
    use std::os::unix::fs::FileTypeExt;
    let dir = two_runs("report-outputs");
    sh(&dir, "report --truth truth.csv joint.csv > table.txt").expect(0);
    let table = fs::read_to_string(dir.join("table.txt")).unwrap();
    let line = "mkfifo page table && { cat page > page.html & cat table > copy.txt & } && \
                timeout 60 report --truth truth.csv --html page -o table joint.csv && wait";
    sh(&dir, line).expect(0);
    for name in ["page", "table"] {
        let kind = fs::symlink_metadata(dir.join(name)).unwrap().file_type();
        assert!(kind.is_fifo(), "{name} is a FIFO still");
        assert!(!dir.join(format!("{name}.partial")).exists());
    }
    let page = fs::read_to_string(dir.join("page.html")).unwrap();
    assert!(page.starts_with("<!DOCTYPE html>") && page.ends_with("</html>\n"));
    let copy = fs::read_to_string(dir.join("copy.txt")).unwrap();
    assert_eq!(copy, table);
    // A link stays a link, whether its target is there (old) or not yet (new, by way of another).
    let line = "mkdir out && echo old > out/old && ln -s out/old here && \
                ln -s new out/hop && ln -s out/hop there && \
                report --truth truth.csv --html here -o there joint.csv";
    sh(&dir, line).expect(0);
    for name in ["here", "there", "out/hop"] {
        assert!(dir.join(name).is_symlink(), "{name} is a link still");
    }
    let written = |name: &str| fs::read_to_string(dir.join(name)).unwrap();
    assert!(written("out/old").starts_with("<!DOCTYPE html>"));
    assert_eq!(written("out/new"), table);
}

#[test]
fn two_outputs_at_one_place_are_refused() {
    let dir = two_runs("report-same");
    sh(&dir, "mkdir out && ln -s same link").expect(0);
    for (page, table) in [
        ("same", "same"),
        ("same", "out/../same"),
        ("link", "./same"),
    ] {
        let line = format!("report --truth truth.csv --html {page} -o {table} joint.csv");
        says(
            &sh(&dir, &line).expect(2),
            "--html and -o name the same output",
        );
        assert!(!dir.join("same").exists());
    }
    sh(
        &dir,
        "report --truth truth.csv --html same -o out/same joint.csv",
    )
    .expect(0);
}

#[test]
fn poses_without_a_component_count_for_the_others() {
    let dir = two_runs("report-partial");
    // Columns 3 and 8 are x and yaw.
    edited(&dir, "joint.csv", "partial.csv", |i, line| {
        let mut fields: Vec<&str> = line.split(',').collect();
        if i % 100 == 5 {
            (fields[3], fields[8]) = ("", "");
            *fields.last_mut().unwrap() = "no-edges no-yaw";
        }
        fields.join(",") + "\n"
    });
    let ended = sh(&dir, "report --truth truth.csv partial.csv").expect(0);
    let text = ended.text();
    assert!(text.contains("1980 of 2000 solved (99.0 %), 20 refused, 0 lost; 20 lack a component"));
    assert!(
        text.contains("20 of 1980 solved poses lack a component"),
        "{text}"
    );
    assert!(text.contains("x 20, yaw 20"), "{text}");
    let ended = sh(&dir, "report --truth truth.csv --json partial.csv").expect(0);
    let json: serde_json::Value = serde_json::from_slice(&ended.stdout).unwrap();
    let run = &json["runs"][0];
    let n = NAMES.map(|name| run[name]["n"].as_u64().unwrap());
    assert_eq!(n, [1960, 1980, 1980, 1980, 1980, 1960]);
    assert_eq!(run["scans"]["partial"], 20);
}

#[test]
fn a_reader_that_leaves_is_no_fault() {
    let dir = two_runs("report-head");
    let ended = sh(&dir, "report --truth truth.csv --json joint.csv | head -1").expect(0);
    assert!(ended.stderr.is_empty(), "{}", ended.stderr);
    assert_eq!(ended.text(), "{\n");
}

#[test]
fn an_imu_at_rest_needs_no_poses() {
    let dir = scratch("report-imu");
    sh(
        &dir,
        "simulate -q -f frame.toml --trajectory random --n-scans 700 --effects imu --imu-rate-hz 100 \
         --imu-axes ned --imu still.csv > scans.csv",
    )
    .expect(0);
    let table = sh(&dir, "report --imu still.csv --html still.html --ascii").expect(0);
    assert!(table.text().contains("gyro_z") && table.text().contains("deg/sqrt(h)"));
    assert!(table.text().is_ascii(), "{}", table.text());
    let page = fs::read_to_string(dir.join("still.html")).unwrap();
    assert_eq!(page.matches("<svg").count(), 2);
    let json = sh(&dir, "report --imu still.csv --json").expect(0);
    let json: serde_json::Value = serde_json::from_str(json.text()).unwrap();
    let walk = &json["imu"]["channels"]["gyro_x"]["random_walk"];
    // 3.5 deg/sqrt(h) was put in.
    assert!((walk.as_f64().unwrap() / 3.5 - 1.0).abs() < 0.15, "{walk}");
    // A gate is about poses.
    sh(&dir, "report --imu still.csv --fail-if 'x.rms_mm>1'").expect(2);
    // Beside poses it is one more section.
    write_runs(&dir, 200, &[("a", 1.0)]);
    let both = sh(
        &dir,
        "report --imu still.csv --truth truth.csv a.csv --ascii",
    )
    .expect(0);
    assert!(
        both.text().contains("against truth") && both.text().contains("IMU at rest, still.csv")
    );
}
