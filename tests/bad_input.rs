//! Bad input of every kind: a clear message, the right exit status, and nothing before the fault
//! is lost.

mod shell;

use shell::{Ended, scratch, sh, testdata};
use std::fs;
use std::path::{Path, PathBuf};

/// Five scans in `scans.csv`, their lines in `lines.csv`, their poses in `poses.csv`.
const SCANS: usize = 5;

fn a_run(name: &str) -> PathBuf {
    let dir = scratch(name);
    let run =
        "simulate -f frame.toml --trajectory line --from-pose 0,-1,2 --to-pose 0,1,2 --n-scans 5";
    sh(&dir, &format!("{run} --truth truth.csv -o scans.csv")).expect(0);
    sh(&dir, "extract-lines -f frame.toml -o lines.csv scans.csv").expect(0);
    sh(&dir, "solve-pose -f frame.toml -o poses.csv lines.csv").expect(0);
    assert_eq!(rows(&dir, "scans.csv"), SCANS);
    assert_eq!(rows(&dir, "poses.csv"), SCANS);
    dir
}

fn rows(dir: &Path, file: &str) -> usize {
    fs::read_to_string(dir.join(file)).unwrap().lines().count() - 1
}

/// Writes `to` as `from` with the field of a column in a row (1 is the first) changed.
fn change(
    dir: &Path,
    from: &str,
    to: &str,
    row: usize,
    column: &str,
    with: impl Fn(&str) -> String,
) {
    let text = fs::read_to_string(dir.join(from)).unwrap();
    let header: Vec<&str> = text.lines().next().unwrap().split(',').collect();
    let at = header.iter().position(|name| *name == column).unwrap();
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let mut fields: Vec<String> = lines[row].split(',').map(str::to_owned).collect();
    fields[at] = with(&fields[at]);
    lines[row] = fields.join(",");
    fs::write(dir.join(to), lines.join("\n") + "\n").unwrap();
}

#[track_caller]
fn assert_says(ended: &Ended, what: &[&str]) {
    for part in what {
        assert!(
            ended.stderr.contains(part),
            "{part:?} not in: {}",
            ended.stderr
        );
    }
    assert!(!ended.stderr.contains("panicked"), "{}", ended.stderr);
}

#[test]
fn a_truncated_row() {
    let dir = a_run("bad-truncated");
    for (file, tool) in [
        ("scans.csv", "extract-lines -f frame.toml"),
        ("lines.csv", "solve-pose -f frame.toml"),
    ] {
        let text = fs::read(dir.join(file)).unwrap();
        let whole_rows: usize = text
            .split_inclusive(|b| *b == b'\n')
            .take(SCANS)
            .map(<[u8]>::len)
            .sum();
        fs::write(dir.join("cut.csv"), &text[..whole_rows + 60]).unwrap();
        let good = sh(&dir, &format!("{tool} {file}")).expect(0);
        let cut = sh(&dir, &format!("{tool} cut.csv")).expect(65);
        assert_says(&cut, &["cut.csv:6: ", "fields where the header has"]);
        assert_eq!(cut.rows(), good.rows()[..SCANS - 1]);
        let skipped = sh(&dir, &format!("{tool} --skip-bad cut.csv")).expect(3);
        assert_says(&skipped, &["1 bad record skipped", "cut.csv:6: "]);
        assert_eq!(skipped.rows(), good.rows()[..SCANS - 1]);
    }
}

/// What a program that was killed leaves: a number that only looks whole.
#[test]
fn a_row_that_is_cut_off_in_its_last_number() {
    let dir = a_run("bad-cut-number");
    for (file, tool, rows) in [
        ("scans.csv", "extract-lines -f frame.toml", SCANS),
        ("lines.csv", "solve-pose -f frame.toml", SCANS),
    ] {
        let text = fs::read(dir.join(file)).unwrap();
        let good = sh(&dir, &format!("{tool} {file}")).expect(0);
        for less in [1, 2] {
            fs::write(dir.join("cut.csv"), &text[..text.len() - less]).unwrap();
            for from in ["cut.csv", "- < cut.csv"] {
                let name = if from == "cut.csv" { from } else { "stdin" };
                let line = format!("{name}:{}: ", rows + 1);
                let cut = sh(&dir, &format!("{tool} {from}")).expect(65);
                assert_says(&cut, &[&line, "cut off"]);
                assert_eq!(cut.rows(), good.rows()[..rows - 1]);
                let skipped = sh(&dir, &format!("{tool} --skip-bad {from}")).expect(3);
                assert_says(&skipped, &["1 bad record skipped", &line]);
                assert_eq!(skipped.rows(), good.rows()[..rows - 1]);
            }
        }
    }
}

#[test]
fn a_wrong_number_of_ranges() {
    let dir = a_run("bad-ranges");
    let column = "ranges_mm";
    change(&dir, "scans.csv", "bad.csv", 3, column, |ranges| {
        ranges.rsplit_once(' ').unwrap().0.to_owned()
    });
    let ended = sh(&dir, "extract-lines -f frame.toml bad.csv").expect(65);
    assert_says(&ended, &["extract-lines: ", "bad.csv:4: ", column]);
    assert_eq!(ended.rows().len(), 2);
    let ended = sh(&dir, "extract-lines -f frame.toml --skip-bad bad.csv").expect(3);
    assert_eq!(ended.rows().len(), SCANS - 1);

    // Without remissions only the other scans know how many there should be.
    for row in 1..=SCANS {
        let none = |_: &str| String::new();
        fs::copy(dir.join("scans.csv"), dir.join("bare.csv")).unwrap();
        for i in 1..=SCANS {
            change(&dir, "bare.csv", "bare.csv", i, "remissions", none);
        }
        change(&dir, "bare.csv", "bad.csv", row, column, |ranges| {
            ranges.rsplit_once(' ').unwrap().0.to_owned()
        });
        let line = format!("bad.csv:{}: ranges_mm: ", row.max(2) + 1);
        let ended = sh(&dir, "extract-lines -f frame.toml bad.csv").expect(65);
        assert_says(&ended, &[&line, "ranges where the scans before"]);
        let ended = sh(&dir, "extract-lines -f frame.toml --skip-bad bad.csv").expect(3);
        assert_says(&ended, &[&line, "1 bad record skipped"]);
        assert_eq!(ended.rows().len(), SCANS - 1);
    }
}

#[test]
fn ranges_and_increments_that_cannot_be() {
    let dir = a_run("bad-values");
    for (column, with) in [
        ("angle_increment_rad", "0"),
        ("angle_increment_rad", "-0.004"),
        ("ranges_mm", "-5 "),
        ("ranges_mm", "1000001 "),
    ] {
        change(&dir, "scans.csv", "bad.csv", 3, column, |old| {
            let rest = old.split_once(' ').map_or("", |(_, rest)| rest);
            format!("{with}{rest}")
        });
        let ended = sh(&dir, "extract-lines -f frame.toml bad.csv").expect(65);
        assert_says(&ended, &[&format!("bad.csv:4: {column}: {}", with.trim())]);
        assert_eq!(ended.rows().len(), 2);
    }
}

#[test]
fn text_in_a_number() {
    let dir = a_run("bad-text");
    let nan = |_: &str| "1;5".to_owned();
    change(&dir, "scans.csv", "bad.csv", 3, "angle_min_rad", nan);
    let ended = sh(&dir, "extract-lines -f frame.toml bad.csv").expect(65);
    assert_says(&ended, &["bad.csv:4: angle_min_rad: not a number: \"1;5\""]);
    assert_eq!(ended.rows().len(), 2);

    change(&dir, "scans.csv", "bad.csv", 4, "ranges_mm", |ranges| {
        ranges.replacen(' ', " 12x ", 1)
    });
    let ended = sh(&dir, "extract-lines -f frame.toml bad.csv").expect(65);
    assert_says(&ended, &["bad.csv:5: ranges_mm: ", "12x"]);
    assert_eq!(ended.rows().len(), 3);

    change(&dir, "lines.csv", "bad.csv", 2, "upper_d_m", nan);
    let ended = sh(&dir, "solve-pose -f frame.toml bad.csv").expect(65);
    assert_says(&ended, &["solve-pose: ", "bad.csv:3: upper_d_m: ", "1;5"]);
    assert_eq!(ended.rows().len(), 1);

    change(&dir, "poses.csv", "bad.csv", 2, "x_m", nan);
    let ended = sh(&dir, "report --truth truth.csv bad.csv").expect(65);
    assert_says(&ended, &["report: ", "bad.csv:3: x_m: ", "1;5"]);
    change(&dir, "truth.csv", "bad.csv", 2, "y_m", nan);
    let ended = sh(&dir, "report --truth bad.csv poses.csv").expect(65);
    assert_says(&ended, &["report: ", "bad.csv:3: y_m: ", "1;5"]);
}

#[test]
fn an_empty_file() {
    let dir = a_run("bad-empty");
    fs::write(dir.join("empty"), "").unwrap();
    for tool in [
        "extract-lines -f frame.toml",
        "solve-pose -f frame.toml",
        "report --truth truth.csv",
        "scan-capture --replay",
    ] {
        let ended = sh(&dir, &format!("{tool} empty")).expect(65);
        assert_says(&ended, &["empty: empty"]);
        assert!(ended.stdout.is_empty(), "{}", ended.text());
    }
}

#[test]
fn a_file_that_is_not_there() {
    let dir = a_run("bad-missing");
    for tool in [
        "extract-lines -f frame.toml",
        "solve-pose -f frame.toml",
        "report --truth truth.csv",
        "scan-capture --replay",
        "report poses.csv --truth",
    ] {
        let ended = sh(&dir, &format!("{tool} nowhere.csv")).expect(66);
        assert_says(&ended, &["nowhere.csv", "No such file"]);
    }
}

#[test]
fn a_csv_of_another_record_type() {
    let dir = a_run("bad-type");
    for (tool, file, missing) in [
        ("extract-lines -f frame.toml", "poses.csv", "angle_min_rad"),
        ("solve-pose -f frame.toml", "scans.csv", "scan_stamp_ns"),
        ("report --truth truth.csv", "lines.csv", "x_m"),
    ] {
        let ended = sh(&dir, &format!("{tool} {file}")).expect(65);
        assert_says(&ended, &[file, missing]);
        assert!(ended.stdout.is_empty(), "{}", ended.text());
    }
}

#[test]
fn an_mcap_file_that_is_cut_off() {
    let dir = a_run("bad-mcap");
    // Many chunks, so that whole ones stand before the cut.
    let run = "simulate -f frame.toml --trajectory line --from-pose 0,-2,2 --to-pose 0,2,2 --n-scans 1500 --speed-m-s 0.08";
    sh(&dir, &format!("{run} --format mcap -o run.mcap")).expect(0);
    let good = sh(&dir, "extract-lines -f frame.toml --format csv run.mcap").expect(0);
    let bytes = fs::read(dir.join("run.mcap")).unwrap();
    fs::write(dir.join("cut.mcap"), &bytes[..bytes.len() * 2 / 3]).unwrap();
    let cut = sh(&dir, "extract-lines -f frame.toml --format csv cut.mcap").expect(65);
    assert_says(&cut, &["extract-lines: cut.mcap"]);
    let kept = cut.rows().len();
    assert!(
        kept > good.rows().len() / 3,
        "{kept} of {}",
        good.rows().len()
    );
    assert_eq!(cut.rows(), good.rows()[..kept]);
}

#[test]
fn an_mcap_pipe_that_is_cut_off() {
    let dir = a_run("bad-mcap-pipe");
    let run =
        "simulate -f frame.toml --trajectory line --from-pose 0,-1,2 --to-pose 0,1,2 --n-scans 20";
    let stages = "extract-lines -f frame.toml --format csv";
    let good = sh(&dir, &format!("{run} --format mcap | {stages}")).expect(0);
    sh(&dir, &format!("{run} --format mcap > run.mcap")).expect(0);
    let half = fs::metadata(dir.join("run.mcap")).unwrap().len() / 2;
    let cut = sh(&dir, &format!("head -c {half} run.mcap | {stages}"));
    assert_eq!(cut.status, 65, "{}", cut.stderr);
    assert_says(&cut, &["extract-lines: stdin"]);
    let kept = cut.rows().len();
    assert!((5..=10).contains(&kept), "{kept}");
    assert_eq!(cut.rows(), good.rows()[..kept]);
}

#[test]
fn a_frame_file_that_makes_no_sense() {
    let dir = a_run("bad-frame");
    let frame = fs::read_to_string(dir.join("frame.toml")).unwrap();
    for (from, to, says) in [
        ("offset_m = 3.90", "offset_m = 5.20", "strip[0].offset_m"),
        ("width_m = 0.80", "width_m = -0.80", "strip[0].width_m"),
        ("dy_m = 10.45", "dy_m = \"wide\"", "dy_m"),
        ("dy_m = 10.45", "width = 10.45", "width"),
        ("lms511-hr", "lms911", "scanner.model"),
        ("5.20]", "\"a\"]", "plate[0].z_m: invalid type"),
    ] {
        fs::write(dir.join("bad.toml"), frame.replacen(from, to, 1)).unwrap();
        for command in [
            "simulate -f bad.toml --trajectory grid",
            "extract-lines -f bad.toml scans.csv",
            "solve-pose -f bad.toml lines.csv",
        ] {
            let ended = sh(&dir, command).expect(78);
            assert_says(&ended, &["bad.toml", says]);
            assert!(ended.stdout.is_empty());
        }
    }
}

#[test]
fn a_frame_file_that_is_not_there() {
    let dir = a_run("bad-no-frame");
    for command in [
        "simulate -f nowhere.toml --trajectory grid",
        "extract-lines -f nowhere.toml scans.csv",
        "solve-pose -f nowhere.toml lines.csv",
    ] {
        let ended = sh(&dir, command).expect(66);
        assert_says(&ended, &["nowhere.toml: No such file"]);
        assert_eq!(ended.stderr.matches("No such file").count(), 1);
    }
}

#[test]
fn a_pair_of_frequency_and_resolution_that_the_scanner_lacks() {
    let dir = scratch("bad-pair");
    let ended = sh(
        &dir,
        "simulate -f frame.toml --trajectory grid --frequency-hz 100 --resolution-deg 0.25",
    )
    .expect(2);
    assert_says(&ended, &["100", "0.25", "35"]);
}

#[test]
fn a_telegram_with_a_wrong_checksum() {
    let dir = scratch("bad-xor");
    let recording = fs::read(testdata("lms511.cola")).unwrap();
    let good = capture(&dir, &recording).expect(0);
    let starts = telegrams(&recording);
    let third = starts[2];
    let mut bytes = recording.clone();
    bytes[third + 200] ^= 0x55;
    let bad = capture(&dir, &bytes).expect(65);
    assert_says(&bad, &["bad.cola", "checksum"]);
    assert_eq!(bad.rows(), good.rows()[..2]);
    let skipped = sh(&dir, "scan-capture --replay bad.cola --skip-bad").expect(3);
    assert_eq!(skipped.rows().len(), good.rows().len() - 1);
}

#[test]
fn a_telegram_longer_than_any_sense() {
    let dir = scratch("bad-length");
    let recording = fs::read(testdata("lms511.cola")).unwrap();
    let good = capture(&dir, &recording).expect(0);
    let third = telegrams(&recording)[2];
    let mut bytes = recording.clone();
    bytes[third + 4..third + 8].copy_from_slice(&0x7fff_ffff_u32.to_be_bytes());
    let bad = capture(&dir, &bytes).expect(65);
    assert_says(&bad, &["bad.cola", "2147483647"]);
    assert_eq!(bad.rows(), good.rows()[..2]);
    let skipped = sh(&dir, "scan-capture --replay bad.cola --skip-bad").expect(3);
    assert_eq!(skipped.rows().len(), good.rows().len() - 1);
}

fn capture(dir: &Path, bytes: &[u8]) -> Ended {
    fs::write(dir.join("bad.cola"), bytes).unwrap();
    sh(dir, "scan-capture --replay bad.cola")
}

/// Where the scan telegrams of a CoLa B recording start.
fn telegrams(bytes: &[u8]) -> Vec<usize> {
    let mut starts = Vec::new();
    let mut at = 0;
    while let Some(head) = bytes.get(at..at + 8) {
        let length = u32::from_be_bytes([head[4], head[5], head[6], head[7]]);
        if bytes[at + 8..].starts_with(b"sSN LMDscandata") {
            starts.push(at);
        }
        at += 9 + length as usize;
    }
    starts
}
