//! Pipe manners, on the real programs: live records, consumers that leave, signals, files that are
//! cut off, disks that are full, and the same result in both encodings.

#![cfg(unix)]

mod shell;

use shell::{scratch, sh};
use std::collections::BTreeSet;
use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::thread;
use std::time::Duration;

/// Longer than anything here takes; what is late by this much does not come.
const PATIENCE: Duration = Duration::from_secs(120);

/// The simulator moving along a line past the middle of the frame.
const LINE: &str = "simulate -f frame.toml --trajectory line --from-pose 0,-1,2 --to-pose 0,1,2";

/// A directory with `scans.csv`, the first scans of that line.
fn a_run(name: &str, scans: usize) -> PathBuf {
    let dir = scratch(name);
    sh(&dir, &format!("{LINE} --n-scans {scans} -o scans.csv")).expect(0);
    assert_eq!(rows_of(&dir, "scans.csv").len(), scans + 1);
    dir
}

fn rows_of(dir: &Path, file: &str) -> Vec<String> {
    let text = fs::read_to_string(dir.join(file)).unwrap();
    text.lines().map(|line| format!("{line}\n")).collect()
}

/// A line of shell that is fed by hand; the rows that it writes come through a channel.
struct Live {
    child: Child,
    input: Option<ChildStdin>,
    rows: Receiver<String>,
}

impl Live {
    fn start(dir: &Path, line: &str) -> Live {
        let bin = Path::new(env!("CARGO_BIN_EXE_extract-lines"))
            .parent()
            .unwrap();
        let path = format!("{}:{}", bin.display(), std::env::var("PATH").unwrap());
        let mut child = Command::new("bash")
            .args(["-o", "pipefail", "-c", line])
            .current_dir(dir)
            .env("PATH", path)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let output = BufReader::new(child.stdout.take().unwrap());
        let (sender, rows) = channel();
        thread::spawn(move || {
            for row in output.lines().map_while(Result::ok) {
                if sender.send(row).is_err() {
                    break;
                }
            }
        });
        Live {
            input: child.stdin.take(),
            child,
            rows,
        }
    }

    fn feed(&mut self, text: &str) {
        let input = self.input.as_mut().unwrap();
        input.write_all(text.as_bytes()).unwrap();
        input.flush().unwrap();
    }

    #[track_caller]
    fn row(&self) -> String {
        self.rows.recv_timeout(PATIENCE).expect("no row came")
    }

    /// Sends a signal to the program itself, which `exec` has put in the shell's place.
    fn signal(&self, name: &str) {
        let id = self.child.id().to_string();
        let sent = Command::new("kill")
            .args(["-s", name, &id])
            .status()
            .unwrap();
        assert!(sent.success());
    }

    /// Ends the input, and waits: the status (128 and the signal for a killed one) and stderr.
    fn end(mut self) -> (i32, String) {
        use std::os::unix::process::ExitStatusExt;
        drop(self.input.take());
        let mut stderr = String::new();
        let mut pipe = self.child.stderr.take().unwrap();
        pipe.read_to_string(&mut stderr).unwrap();
        let status = self.child.wait().unwrap();
        let killed = status.signal().map(|signal| 128 + signal);
        (status.code().or(killed).unwrap(), stderr)
    }
}

/// Every pose comes out before the next scan goes in, whatever is spoken between the two.
#[test]
fn a_live_record_comes_through_at_once() {
    let dir = a_run("pipes-live", 4);
    let scans = rows_of(&dir, "scans.csv");
    for format in ["csv", "mcap"] {
        let mut live = Live::start(
            &dir,
            &format!(
                "extract-lines -f frame.toml --deskew none --format {format} \
                 | solve-pose -f frame.toml --format csv"
            ),
        );
        live.feed(&scans[0]);
        for (i, scan) in scans[1..].iter().enumerate() {
            live.feed(scan);
            if i == 0 {
                assert!(live.row().starts_with("stamp_ns,"), "{format}");
            }
            assert!(live.row().contains(','), "{format}");
        }
        assert_eq!(live.end(), (0, String::new()), "{format}");
    }
    // Only the second scan tells how the platform moved in the first one; from then on it is at once.
    let mut live = Live::start(&dir, "extract-lines -f frame.toml");
    live.feed(&scans[0]);
    live.feed(&scans[1]);
    live.feed(&scans[2]);
    assert!(live.row().starts_with("stamp_ns,"));
    live.row();
    live.row();
    live.feed(&scans[3]);
    live.row();
    assert_eq!(live.end(), (0, String::new()));
}

#[test]
fn a_consumer_that_left_ends_the_pipeline_quietly() {
    let dir = a_run("pipes-head", 3);
    for format in ["csv", "mcap"] {
        let ended = sh(
            &dir,
            &format!(
                "{LINE} --speed-m-s 0.01 --format {format} \
                 | extract-lines -f frame.toml | head -c 100"
            ),
        )
        .expect(0);
        assert_eq!(ended.stderr, "", "{format}");
        assert_eq!(ended.stdout.len(), 100);
    }
}

#[test]
fn the_first_interrupt_drains_and_the_second_ends() {
    let dir = a_run("pipes-interrupt", 3);
    let scans = rows_of(&dir, "scans.csv");
    let mut live = Live::start(&dir, "exec extract-lines -f frame.toml --deskew none");
    live.feed(&scans[0]);
    live.feed(&scans[1]);
    assert!(live.row().starts_with("stamp_ns,"));
    live.row();
    live.signal("INT");
    live.feed(&scans[2]);
    live.row();
    assert_eq!(live.end(), (0, String::new()));

    let mut live = Live::start(&dir, "exec extract-lines -f frame.toml --deskew none");
    live.feed(&scans[0]);
    live.feed(&scans[1]);
    live.row();
    live.signal("INT");
    // The handler has run when a record that was sent after the signal has come through.
    live.feed(&scans[2]);
    live.row();
    live.row();
    live.signal("INT");
    let status = live.child.wait().unwrap();
    assert_eq!(status.code(), Some(130));
}

#[test]
fn a_file_gets_its_name_when_it_is_whole() {
    let dir = a_run("pipes-rename", 3);
    sh(
        &dir,
        "extract-lines -f frame.toml -o lines.mcap --format mcap scans.csv",
    )
    .expect(0);
    assert!(dir.join("lines.mcap").exists());
    assert!(!dir.join("lines.mcap.partial").exists());
    // A fault leaves the old file alone and what was done under the partial name.
    let before = fs::read(dir.join("lines.mcap")).unwrap();
    sh(&dir, "head -n 3 scans.csv > bad.csv; echo 1,2 >> bad.csv").expect(0);
    let ended = sh(
        &dir,
        "extract-lines -f frame.toml -o lines.mcap --format mcap bad.csv",
    );
    let ended = ended.expect(65);
    assert!(
        ended
            .stderr
            .starts_with("extract-lines: bad.csv:4: 2 fields where"),
        "{}",
        ended.stderr
    );
    assert_eq!(fs::read(dir.join("lines.mcap")).unwrap(), before);
    let ended = sh(
        &dir,
        "solve-pose -f frame.toml --format csv lines.mcap.partial",
    )
    .expect(0);
    assert_eq!(ended.rows().len(), 2);
}

#[test]
fn a_killed_run_leaves_what_it_had() {
    let dir = a_run("pipes-killed", 2);
    let scans = rows_of(&dir, "scans.csv");
    let mut live = Live::start(
        &dir,
        "exec extract-lines -f frame.toml --format mcap -o run.mcap",
    );
    live.feed(&scans[0]);
    let partial = dir.join("run.mcap.partial");
    let mut waited = Duration::ZERO;
    // A live stream's chunk is closed after a second, with the record that comes then.
    while fs::metadata(&partial).map_or(0, |found| found.len()) < 1000 {
        live.feed(&scans[1]);
        thread::sleep(Duration::from_millis(50));
        waited += Duration::from_millis(50);
        assert!(waited < PATIENCE, "no chunk was closed");
    }
    live.signal("KILL");
    live.child.wait().unwrap();
    assert!(!dir.join("run.mcap").exists());
    let ended = sh(
        &dir,
        "solve-pose -f frame.toml --format csv run.mcap.partial",
    )
    .expect(65);
    assert!(!ended.rows().is_empty());
    assert!(ended.stderr.contains("cut off after"), "{}", ended.stderr);
}

#[test]
fn a_full_disk_is_an_io_error_that_names_the_file() {
    if !Path::new("/dev/full").exists() {
        return;
    }
    let dir = a_run("pipes-full", 3);
    for format in ["csv", "mcap"] {
        let line = format!("extract-lines -f frame.toml --format {format} scans.csv");
        let to_file = sh(&dir, &format!("{line} -o /dev/full")).expect(74);
        assert_eq!(
            to_file.stderr,
            "extract-lines: /dev/full: No space left on device\n"
        );
        let to_stdout = sh(&dir, &format!("{line} > /dev/full")).expect(74);
        assert_eq!(
            to_stdout.stderr,
            "extract-lines: stdout: No space left on device\n"
        );
    }
}

#[test]
fn a_cut_file_gives_what_is_whole() {
    let dir = a_run("pipes-cut", 40);
    sh(
        &dir,
        "extract-lines -f frame.toml --format mcap scans.csv > whole.mcap",
    )
    .expect(0);
    sh(&dir, "head -c 20000 whole.mcap > cut.mcap").expect(0);
    let ended = sh(&dir, "solve-pose -f frame.toml --format csv cut.mcap").expect(65);
    let rows = ended.rows().len();
    assert!((5..40).contains(&rows), "{rows}");
    let expected = format!(
        "solve-pose: cut.mcap: ends in the middle: it was cut off after {rows} lines records\n"
    );
    assert_eq!(ended.stderr, expected);
}

#[test]
fn both_encodings_give_the_same_poses_and_mcap_keeps_everything() {
    let dir = a_run("pipes-same", 10);
    // A given pitch: the MCAP stream has the IMU's samples in it, the CSV has not.
    let chain = "extract-lines -f frame.toml | solve-pose -f frame.toml --pitch-deg 0";
    let csv = sh(&dir, &format!("< scans.csv {chain}")).expect(0);
    sh(
        &dir,
        &format!("{LINE} --n-scans 10 --format mcap | {chain} > run.mcap"),
    )
    .expect(0);
    let file = fs::read(dir.join("run.mcap")).unwrap();
    let summary = mcap::Summary::read(&file).unwrap().unwrap();
    let topics: BTreeSet<&str> = summary
        .channels
        .values()
        .map(|c| c.topic.as_str())
        .collect();
    for topic in [
        "/scan",
        "/scan_info",
        "/lines",
        "/pose",
        "/pose_status",
        "/tf",
        "/tf_static",
    ] {
        assert!(topics.contains(topic), "{topic} is not among {topics:?}");
    }
    // From scans that were in MCAP all the way, and from the CSV of the same scans.
    let poses = sh(
        &dir,
        "solve-pose -f frame.toml --pitch-deg 0 --format csv run.mcap",
    )
    .expect(0);
    assert_eq!(poses.text(), csv.text());
    assert_eq!(csv.rows().len(), 10);
    assert_eq!(stages(&file), ["simulate", "extract-lines", "solve-pose"]);
}

/// The programs in a file's provenance records, checked for their command lines.
fn stages(file: &[u8]) -> Vec<String> {
    let mut stages = Vec::new();
    for record in mcap::read::LinearReader::new(file).unwrap() {
        if let mcap::records::Record::Metadata(metadata) = record.unwrap() {
            assert_eq!(metadata.name, "provenance");
            let entries = metadata.metadata;
            assert_eq!(entries["stage"], stages.len().to_string());
            assert!(
                entries["command"].starts_with(&entries["tool"]),
                "{entries:?}"
            );
            assert!(entries["configuration"].contains("[box]"));
            stages.push(entries["tool"].clone());
        }
    }
    stages
}

#[test]
fn a_window_of_time() {
    let dir = a_run("pipes-window", 10);
    let all = sh(&dir, "extract-lines -f frame.toml scans.csv").expect(0);
    let stamps: Vec<i64> = all
        .column("scan_stamp_ns")
        .iter()
        .map(|text| text.parse().unwrap())
        .collect();
    let (from, to) = (stamps[3], stamps[6]);
    let cut = sh(
        &dir,
        &format!("extract-lines -f frame.toml --from {from} --to {to} scans.csv"),
    );
    assert_eq!(cut.expect(0).rows().len(), 4);
    let after_s = (stamps[3] - stamps[0]) as f64 * 1e-9 - 1e-3;
    let relative = format!("extract-lines -f frame.toml --from +{after_s}s scans.csv");
    assert_eq!(sh(&dir, &relative).expect(0).rows().len(), 7);
}

#[test]
fn bad_records_are_skipped_when_asked() {
    let dir = a_run("pipes-skip", 4);
    sh(
        &dir,
        "head -n 3 scans.csv > bad.csv; echo 1,2 >> bad.csv; tail -n 2 scans.csv >> bad.csv",
    )
    .expect(0);
    let ended = sh(&dir, "extract-lines -f frame.toml --skip-bad -v bad.csv").expect(3);
    assert_eq!(ended.rows().len(), 4);
    assert!(
        ended
            .stderr
            .contains("bad.csv: 1 bad record skipped, the first at bad.csv:4: 2 fields")
    );
    assert!(
        ended
            .stderr
            .contains("extract-lines: 4 records in, 4 out, 1 bad, "),
        "{}",
        ended.stderr
    );
}

#[test]
fn outputs_that_are_one_file_are_refused() {
    let dir = scratch("pipes-collide");
    fs::write(dir.join("a"), "before").unwrap();
    for outputs in ["-o a --truth a", "--truth a --imu ./a"] {
        let ended = sh(&dir, &format!("{LINE} --n-scans 2 {outputs}")).expect(2);
        assert!(ended.stderr.contains("two outputs"), "{}", ended.stderr);
        assert!(ended.stdout.is_empty());
        assert_eq!(fs::read_to_string(dir.join("a")).unwrap(), "before");
    }
}
