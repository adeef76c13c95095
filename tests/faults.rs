//! What becomes of the tools when things around them fail: killed neighbours, signals, terminals
//! that go away, readers that stop, disks that are full. All with real processes on the loopback.

#![cfg(unix)]

mod shell;
mod stages;

use cablepose::link::emulation::Conditions;
use cablepose::twincat::emulator::{Plc, Service, SharedPlc};
use shell::{TOOLS, scratch, sh, testdata};
use stages::{Ended, LONG, Scanner, Stage, column, lines_of, rows, wait_for};
use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::Duration;

const SYMBOL: &str = "MAIN.SickValue";
/// Bit of the status word that says that the stream has ended.
const ENDED: u32 = 1 << 17;
const SIGINT: u32 = 2;
const SIGKILL: i32 = 9;
const SIGTERM: i32 = 15;

/// The stages of a live chain behind the scanner, each with what it needs to be killed for.
struct Chain {
    stages: Vec<(&'static str, Stage)>,
}

impl Chain {
    /// scan-capture | extract-lines | solve-pose | compensate-delay | ads-push > pushed.csv
    fn start(dir: &Path, scanner: &str, target: &str) -> Chain {
        let lines = [
            format!("scan-capture {scanner} --tee run.cola"),
            "extract-lines -f frame.toml".to_owned(),
            "solve-pose -f frame.toml --pitch-deg 0".to_owned(),
            "compensate-delay --delay 1ms".to_owned(),
            format!("ads-push {target} {SYMBOL} --every"),
        ];
        let mut stages = Vec::new();
        let mut before: Option<Stdio> = None;
        for (k, line) in lines.iter().enumerate() {
            let name = TOOLS.into_iter().find(|tool| line.starts_with(tool));
            let last = k + 1 == lines.len();
            let stdin = before.take().unwrap_or(Stdio::null());
            let stdout = match last {
                true => fs::File::create(dir.join("pushed.csv")).unwrap().into(),
                false => Stdio::piped(),
            };
            let mut stage = Stage::start(dir, line, stdin, stdout);
            if !last {
                before = Some(stage.stdout().into());
            }
            stages.push((name.unwrap(), stage));
        }
        Chain { stages }
    }

    fn end(self) -> Vec<(&'static str, Ended)> {
        let ends = self
            .stages
            .into_iter()
            .map(|(name, stage)| (name, stage.end()));
        ends.collect()
    }
}

fn a_plc() -> (SharedPlc, Service) {
    let plc = SharedPlc::new(Plc::with_sick_value());
    let address = ([127, 0, 0, 1], 0).into();
    let service = Service::start(&plc, address, Conditions::default()).unwrap();
    (plc, service)
}

fn length(path: &Path) -> u64 {
    fs::metadata(path).map_or(0, |found| found.len())
}

#[track_caller]
fn more_writes(plc: &SharedPlc, more: u64) {
    let before = plc.lock().writes(SYMBOL);
    let done = plc.wait_until(LONG, |plc| plc.writes(SYMBOL) >= before + more);
    assert!(done, "no {more} writes more");
}

#[test]
fn a_stage_that_is_killed_ends_the_chain() {
    for victim in 0..5 {
        let dir = scratch(&format!("faults-kill-{victim}"));
        let scanner = Scanner::serve(&dir, "127.0.0.1:0", "--n-scans 3000");
        let (plc, service) = a_plc();
        let chain = Chain::start(&dir, &scanner.place, &service.target(&plc));
        more_writes(&plc, 20);
        // A recording stays in memory for up to a second.
        wait_for("the recording", || length(&dir.join("run.cola")) > 0);
        let killed = chain.stages[victim].0;
        chain.stages[victim].1.signal("KILL");
        for (k, (name, ended)) in chain.end().into_iter().enumerate() {
            if k == victim {
                assert_eq!(ended.signal, Some(SIGKILL), "{name}");
                continue;
            }
            // Before it, the reader has left. Behind it, the stream ends, perhaps within a row, which
            // is then said; and a scan that the scanner itself could not get rid of is counted.
            let what = format!("{name} after {killed}: {}", ended.stderr);
            match ended.status {
                Some(0) => {}
                Some(3) if k == 0 => assert!(what.contains("scans lost"), "{what}"),
                Some(65) if k == victim + 1 => assert!(what.contains("cut off"), "{what}"),
                status => panic!("{status:?}: {what}"),
            }
            assert!(
                !what.contains("panicked") && !what.contains("os error"),
                "{what}"
            );
        }
        if victim < 4 {
            // The controller is told that nothing more comes.
            let word = plc.lock().lreals(SYMBOL)[7] as u32;
            assert_eq!(word & ENDED, ENDED, "after {killed}");
        }
        // What went out is whole, but for the end of what was killed.
        let pushed = fs::read_to_string(dir.join("pushed.csv")).unwrap();
        let seqs = column(&pushed, "seq");
        assert!(seqs.len() >= 19, "{} rows after {killed}", seqs.len());
        assert!(seqs.is_sorted_by(|a, b| a < b));
        // So is the recording, up to its last whole telegram.
        let replay = sh(&dir, "scan-capture --replay run.cola --skip-bad -q");
        assert!(matches!(replay.status, 0 | 3), "{}", replay.stderr);
        let kept = column(replay.text(), "seq");
        let both = match victim {
            0 => kept.len().min(seqs.len()),
            _ => seqs.len(),
        };
        assert!(both > 5, "{both} after {killed}");
        assert_eq!(seqs[..both], kept[..both], "after {killed}");
    }
}

#[test]
fn a_scanner_that_is_killed_comes_back_and_the_chain_goes_on() {
    let dir = scratch("faults-kill-scanner");
    let scanner = Scanner::serve(&dir, "127.0.0.1:0", "--n-scans 3000");
    let place = scanner.place.clone();
    let (plc, service) = a_plc();
    let chain = Chain::start(&dir, &place, &service.target(&plc));
    more_writes(&plc, 20);
    scanner.stage.signal("KILL");
    assert_eq!(scanner.stage.end().signal, Some(SIGKILL));
    chain.stages[0].1.says("reconnecting");
    let _again = Scanner::serve(&dir, &place, "--n-scans 3000");
    more_writes(&plc, 20);
    // Ctrl-C reaches all of them.
    chain
        .stages
        .iter()
        .for_each(|(_, stage)| stage.signal("INT"));
    let mut seqs = Vec::new();
    for (name, ended) in chain.end() {
        let stderr = ended.expect(if name == "scan-capture" { &[3] } else { &[0] });
        if name == "scan-capture" {
            assert!(stderr.contains("1 outages"), "{stderr}");
        }
        let pushed = fs::read_to_string(dir.join("pushed.csv")).unwrap();
        seqs = column(&pushed, "seq");
    }
    // Nothing was lost on the way from the scanner's telegrams to the controller.
    let replay = sh(&dir, "scan-capture --replay run.cola --skip-bad -q");
    assert_eq!(seqs, column(replay.text(), "seq"));
    assert_eq!(plc.lock().writes(SYMBOL), seqs.len() as u64 + 1);
}

#[test]
fn files_of_killed_stages_are_readable_to_the_last_whole_record() {
    let dir = scratch("faults-partial");
    let scanner = Scanner::serve(&dir, "127.0.0.1:0", "--n-scans 6000");
    for format in ["csv", "mcap"] {
        let name = format!("scans.{format}");
        let partial = dir.join(format!("{name}.partial"));
        let line = format!(
            "scan-capture {} --format {format} -o {name} --tee {format}.cola",
            scanner.place
        );
        let capture = Stage::start(&dir, &line, Stdio::null(), Stdio::null());
        // Of MCAP a chunk, which is closed after a second.
        wait_for("records", || {
            length(&partial) > 50_000 && length(&dir.join(format!("{format}.cola"))) > 0
        });
        capture.signal("KILL");
        assert_eq!(capture.end().signal, Some(SIGKILL));
        assert!(!dir.join(&name).exists());
        let line = format!(
            "extract-lines -f frame.toml --format csv {}",
            partial.display()
        );
        let read = sh(&dir, &line);
        match read.status {
            0 => {}
            65 => assert!(read.stderr.contains("cut off"), "{}", read.stderr),
            status => panic!("{status}: {}", read.stderr),
        }
        let read = column(read.text(), "seq");
        let recorded = sh(
            &dir,
            &format!("scan-capture --replay {format}.cola --skip-bad -q"),
        );
        let recorded = column(recorded.text(), "seq");
        let both = read.len().min(recorded.len());
        assert!(both > 5, "{} and {}", read.len(), recorded.len());
        assert_eq!(read[..both], recorded[..both]);
        if format == "csv" {
            assert_eq!(read.len(), rows(&partial));
        }
    }
}

/// How a tool takes a signal.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    /// It has a device, or makes its records: it ends in good order.
    Source,
    /// It has an input that ends: it goes on to that end.
    Filter,
    /// The same, but it has a last word to say when it is asked to end.
    FilterWithLastWord,
}

/// A tool that runs until it is ended: its command line, and what it is fed.
struct Running {
    kind: Kind,
    line: String,
    fed: Option<String>,
    /// Whether a record comes out while it runs.
    speaks: bool,
}

/// The nine tools, at work.
fn nine(dir: &Path, scanner: &str, target: &str) -> Vec<Running> {
    let text = |name: &str| Some(fs::read_to_string(dir.join(name)).unwrap());
    let make = |kind, line: String, fed, speaks| Running {
        kind,
        line,
        fed,
        speaks,
    };
    let course = "--trajectory random --n-scans 1000000";
    vec![
        make(Kind::Source, format!("scan-capture {scanner}"), None, true),
        make(Kind::Source, "imu-read ./imu".to_owned(), None, true),
        make(Kind::Source, format!("timesync poll {scanner}"), None, true),
        make(
            Kind::Source,
            format!("simulate -f frame.toml {course} --real-time"),
            None,
            true,
        ),
        make(
            Kind::Filter,
            "extract-lines -f frame.toml".to_owned(),
            text("scans.csv"),
            true,
        ),
        make(
            Kind::Filter,
            "solve-pose -f frame.toml".to_owned(),
            text("lines.csv"),
            true,
        ),
        make(
            Kind::Filter,
            "compensate-delay --delay 1ms".to_owned(),
            text("poses.csv"),
            true,
        ),
        make(
            Kind::FilterWithLastWord,
            format!("ads-push {target} {SYMBOL} --every"),
            text("poses.csv"),
            true,
        ),
        make(
            Kind::Filter,
            "report --truth truth.csv -".to_owned(),
            text("poses.csv"),
            false,
        ),
    ]
}

/// Devices for all of them, and a run to be fed.
fn workbench(name: &str) -> (PathBuf, Scanner, Stage, (SharedPlc, Service)) {
    let dir = scratch(name);
    let run = "simulate -f frame.toml --trajectory line --from-pose 0,-1,2 --to-pose 0,1,2 \
               --n-scans 5";
    sh(&dir, &format!("{run} --truth truth.csv -o scans.csv")).expect(0);
    sh(&dir, "extract-lines -f frame.toml -o lines.csv scans.csv").expect(0);
    sh(&dir, "solve-pose -f frame.toml -o poses.csv lines.csv").expect(0);
    let scanner = Scanner::serve(&dir, "127.0.0.1:0", "--n-scans 20000");
    let imu = Stage::start(
        &dir,
        "simulate -f frame.toml --effects none --trajectory random --n-scans 100000 \
         --scans-per-pose 100000 --imu-pty imu",
        Stdio::null(),
        Stdio::null(),
    );
    wait_for("the IMU", || fs::symlink_metadata(dir.join("imu")).is_ok());
    (dir, scanner, imu, a_plc())
}

/// Starts a tool and waits until it is at work. Its input stays open as long as what is given back.
fn at_work(
    dir: &Path,
    tool: &Running,
) -> (
    Stage,
    Option<std::process::ChildStdin>,
    BufReader<std::process::ChildStdout>,
) {
    let stdin = if tool.fed.is_some() {
        Stdio::piped()
    } else {
        Stdio::null()
    };
    let mut stage = Stage::start(dir, &tool.line, stdin, Stdio::piped());
    let stdin = tool.fed.as_ref().map(|text| {
        let mut stdin = stage.stdin();
        stdin.write_all(text.as_bytes()).unwrap();
        stdin
    });
    let mut stdout = BufReader::new(stage.stdout());
    stage.catches(SIGINT);
    if tool.speaks {
        for _ in 0..2 {
            let mut line = String::new();
            stdout.read_line(&mut line).unwrap();
            assert!(!line.is_empty(), "{}: {}", tool.line, stage.said());
        }
    }
    (stage, stdin, stdout)
}

/// Takes the rest, so that nothing waits for a reader.
fn drain(mut stdout: impl Read + Send + 'static) {
    std::thread::spawn(move || std::io::copy(&mut stdout, &mut std::io::sink()));
}

/// Whether whoever started these tests has SIGHUP ignored, which the tools then leave so.
fn hangup_is_ignored() -> bool {
    let status = fs::read_to_string("/proc/self/status").unwrap();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    u64::from_str_radix(mask.unwrap().trim(), 16).unwrap() & 1 == 1
}

#[test]
fn every_tool_takes_every_signal_as_it_should() {
    if !Path::new("/proc/self/status").exists() {
        println!("skipped: needs /proc");
        return;
    }
    let (dir, scanner, _imu, (plc, service)) = workbench("faults-signals");
    for tool in nine(&dir, &scanner.place, &service.target(&plc)) {
        for signal in ["INT", "TERM", "HUP"] {
            if signal == "HUP" && hangup_is_ignored() {
                println!("SIGHUP skipped: these tests run under nohup");
                continue;
            }
            let what = format!("{} on {signal}", tool.line);
            let (stage, stdin, stdout) = at_work(&dir, &tool);
            drain(stdout);
            stage.signal(signal);
            if signal == "HUP" {
                // A terminal that goes away says so twice.
                stage.signal(signal);
            }
            let asked = tool.kind == Kind::Source
                || (tool.kind == Kind::FilterWithLastWord && signal == "TERM");
            match (tool.kind, signal) {
                _ if asked => {
                    let ended = stage.end();
                    // A record that was lost before the end is counted.
                    let right = matches!(ended.status, Some(0 | 3));
                    assert!(right, "{what}: {:?} {}", ended.status, ended.stderr);
                }
                (Kind::Filter, "TERM") => assert_eq!(stage.end().signal, Some(SIGTERM), "{what}"),
                _ => {
                    let mut stage = stage;
                    assert!(stage.runs(), "{what}: {}", stage.said());
                    drop(stdin);
                    let ended = stage.end();
                    assert_eq!(ended.status, Some(0), "{what}: {}", ended.stderr);
                    continue;
                }
            }
            drop(stdin);
        }
        // A second Ctrl-C is meant.
        if tool.kind == Kind::Filter {
            let (stage, stdin, stdout) = at_work(&dir, &tool);
            drain(stdout);
            stage.signal("INT");
            std::thread::sleep(Duration::from_millis(50));
            stage.signal("INT");
            assert_eq!(stage.end().status, Some(130), "{}", tool.line);
            drop(stdin);
        }
    }
}

#[test]
fn every_tool_ends_quietly_when_its_reader_leaves() {
    let (dir, scanner, _imu, (plc, service)) = workbench("faults-reader");
    for tool in nine(&dir, &scanner.place, &service.target(&plc)) {
        if !tool.speaks {
            // report speaks at its end.
            let line = "report --truth truth.csv poses.csv";
            let mut stage = Stage::start(&dir, line, Stdio::null(), Stdio::piped());
            drop(stage.stdout());
            assert_eq!(stage.end().expect(&[0]), "", "{line}");
            continue;
        }
        let (stage, stdin, stdout) = at_work(&dir, &tool);
        drop(stdout);
        // Filters notice when they write: the same rows again.
        let feeder = stdin.map(|mut stdin| {
            let text = tool.fed.clone().unwrap();
            let rows = text.split_once('\n').unwrap().1.to_owned();
            std::thread::spawn(move || while stdin.write_all(rows.as_bytes()).is_ok() {})
        });
        let ended = stage.end();
        let right = matches!(ended.status, Some(0 | 3)) && !ended.stderr.contains("roken pipe");
        assert!(right, "{}: {:?} {}", tool.line, ended.status, ended.stderr);
        if let Some(feeder) = feeder {
            feeder.join().unwrap();
        }
    }
}

#[test]
fn nohup_outlives_its_terminal() {
    let dir = scratch("faults-nohup");
    let scanner = Scanner::serve(&dir, "127.0.0.1:0", "--n-scans 3000");
    let line = format!(
        "trap '' HUP; exec scan-capture {} -o out.csv",
        scanner.place
    );
    let mut capture = Stage::shell(&dir, &line, Stdio::null(), Stdio::null());
    let partial = dir.join("out.csv.partial");
    wait_for("records", || rows(&partial) > 2);
    let before = rows(&partial);
    capture.signal("HUP");
    wait_for("more records", || rows(&partial) > before + 20);
    assert!(capture.runs());
    capture.signal("TERM");
    capture.end().expect(&[0, 3]);
    assert!(rows(&dir.join("out.csv")) > before);
}

#[test]
fn a_reader_that_stops_does_not_keep_a_source_from_ending() {
    let dir = scratch("faults-stuck");
    let scanner = Scanner::serve(&dir, "127.0.0.1:0", "--n-scans 6000");
    let line = format!("scan-capture {}", scanner.place);
    let mut capture = Stage::start(&dir, &line, Stdio::null(), Stdio::piped());
    let stdout = capture.stdout();
    // Nobody reads: the pipe is full once it holds no more than before.
    let mut held = 0;
    wait_for("a full pipe", || {
        let now = rustix::io::ioctl_fionread(&stdout).unwrap();
        let full = now > 0 && now == held;
        held = now;
        std::thread::sleep(Duration::from_millis(500));
        full
    });
    capture.signal("TERM");
    let stderr = capture.end().expect(&[74]);
    assert!(stderr.contains("stdout: nobody reads"), "{stderr}");
    // What it had taken is still there, and whole but for its end.
    let text: Vec<String> = lines_of(stdout).collect();
    assert!(text.len() > 2);

    // A FIFO that nobody has opened.
    sh(&dir, "mkfifo fifo").expect(0);
    let line = format!("scan-capture {} -o fifo", scanner.place);
    let capture = Stage::start(&dir, &line, Stdio::null(), Stdio::null());
    capture.catches(SIGINT);
    std::thread::sleep(Duration::from_millis(500));
    capture.signal("INT");
    let ended = capture.end();
    assert!(
        matches!(ended.status, Some(74 | 130)),
        "{:?} {}",
        ended.status,
        ended.stderr
    );
}

/// A reader that is slower than the scanner: what does not fit is dropped at the device's end of the
/// line and counted, and nothing grows.
#[test]
fn a_slow_reader_costs_scans_and_no_memory() {
    let dir = scratch("faults-slow");
    let scanner = Scanner::serve(&dir, "127.0.0.1:0", "--n-scans 100000 --speed 10");
    let line = format!("scan-capture {}", scanner.place);
    let mut capture = Stage::start(&dir, &line, Stdio::null(), Stdio::piped());
    let mut lines = lines_of(capture.stdout());
    let header = lines.next().unwrap();
    let mut text = header + "\n";
    let mut least_kb = None;
    // Until something has been lost, and then some.
    let lost = |capture: &Stage| capture.said().contains("scans lost before scan");
    let mut more = 60;
    while more > 0 {
        text += &lines.next().unwrap();
        text.push('\n');
        std::thread::sleep(Duration::from_millis(20));
        more -= u32::from(lost(&capture));
        assert!(
            text.len() < 64 << 20,
            "a slow reader lost nothing: {}",
            capture.said()
        );
        if least_kb.is_none() {
            least_kb = memory_kb(&capture);
        }
    }
    let most_kb = memory_kb(&capture);
    capture.signal("INT");
    for line in lines {
        text += &line;
        text.push('\n');
    }
    let stderr = capture.end().expect(&[3]);
    let seqs = column(&text, "seq");
    let gaps: i64 = seqs.windows(2).map(|pair| pair[1] - pair[0] - 1).sum();
    assert!(gaps > 0);
    assert!(
        stderr.contains(&format!("{gaps} scans lost, ")),
        "{gaps}: {stderr}"
    );
    if let (Some(least), Some(most)) = (least_kb, most_kb) {
        assert!(most < least + 16_384, "from {least} kB to {most} kB");
    }
}

/// Memory that a process has taken at most, kB.
fn memory_kb(stage: &Stage) -> Option<u64> {
    let text = stage.proc_status("VmHWM")?;
    text.split_whitespace().next()?.parse().ok()
}

/// Every tool's writing to a file, as (command line without the output, how the output is given).
fn writers(dir: &Path) -> Vec<(String, &'static str)> {
    let run = "simulate -f frame.toml --trajectory line --from-pose 0,-1,2 --to-pose 0,1,2 \
               --n-scans 400 --speed-m-s 0.3";
    sh(
        dir,
        &format!("{run} --truth truth.csv --imu imu.csv -o scans.csv"),
    )
    .expect(0);
    sh(dir, "extract-lines -f frame.toml -o lines.csv scans.csv").expect(0);
    sh(dir, "solve-pose -f frame.toml -o poses.csv lines.csv").expect(0);
    fs::copy(testdata("lms511.cola"), dir.join("run.cola")).unwrap();
    let lines = [
        (run, "-o"),
        ("scan-capture --replay run.cola", "-o"),
        ("extract-lines -f frame.toml scans.csv", "-o"),
        ("solve-pose -f frame.toml lines.csv", "-o"),
        ("compensate-delay --delay 1ms poses.csv", "-o"),
        ("timesync track scans.csv", "-o"),
        ("report --truth truth.csv poses.csv", "--html"),
    ];
    lines
        .map(|(line, option)| (line.to_owned(), option))
        .to_vec()
}

/// The message of a disk that is full: one line, the file's name, no number.
#[track_caller]
fn assert_says(stderr: &str, line: &str, what: &str) {
    let tool = line.split(' ').next().unwrap();
    let said: Vec<&str> = stderr.lines().filter(|line| line.contains(what)).collect();
    assert!(
        said.len() == 1 && said[0].starts_with(&format!("{tool}: ")),
        "{line}: {stderr}"
    );
    assert!(
        !stderr.contains("os error") && !stderr.contains("panicked"),
        "{stderr}"
    );
}

#[test]
fn a_file_that_may_grow_no_further_is_an_error_and_no_death() {
    let dir = scratch("faults-limit");
    for (line, option) in writers(&dir) {
        for to in [format!("{option} out"), "> out".to_owned()] {
            if option == "--html" && to.starts_with('>') {
                continue;
            }
            let _ = fs::remove_file(dir.join("out"));
            // In blocks of 1 KiB.
            let ended = sh(&dir, &format!("ulimit -f 8; {line} {to}"));
            assert_eq!(ended.status, 74, "{line} {to}: {}", ended.stderr);
            assert_says(&ended.stderr, &line, "File too large");
            assert!(to.starts_with('>') || !dir.join("out").exists(), "{line}");
        }
    }
}

#[test]
fn a_full_disk_is_said_by_every_tool() {
    if !Path::new("/dev/full").exists() {
        println!("skipped: there is no /dev/full");
        return;
    }
    let dir = scratch("faults-full");
    let writers = writers(&dir);
    for (line, option) in &writers {
        let to = format!("{line} {option} /dev/full");
        assert_says(
            &sh(&dir, &to).expect(74).stderr,
            line,
            "No space left on device",
        );
        if *option == "-o" {
            let to = format!("{line} > /dev/full");
            assert_says(
                &sh(&dir, &to).expect(74).stderr,
                line,
                "No space left on device",
            );
        }
    }
    // ads-push passes poses on.
    let (plc, service) = a_plc();
    let line = format!("ads-push {} {SYMBOL} --every", service.target(&plc));
    let ended = sh(&dir, &format!("{line} < poses.csv > /dev/full")).expect(74);
    assert_says(&ended.stderr, &line, "No space left on device");

    // A disk of 64 KiB, where that may be had.
    fs::create_dir(dir.join("disk")).unwrap();
    let mount = "mount -t tmpfs -o size=64k tmpfs disk";
    let inside = "unshare --user --map-root-user --mount bash -c";
    if sh(&dir, &format!("{inside} '{mount}'")).status != 0 {
        println!("skipped: no small disk may be mounted here");
        return;
    }
    for (line, option) in &writers {
        let many = if line.starts_with("scan-capture") {
            "head -c 61440 /dev/zero > disk/x; "
        } else {
            ""
        };
        let script = format!("{mount}; {many}{line} {option} disk/out; s=$?; ls disk; exit $s");
        let ended = sh(&dir, &format!("{inside} '{script}'"));
        assert_eq!(ended.status, 74, "{line}: {}", ended.stderr);
        assert_says(&ended.stderr, line, "No space left on device");
        assert!(
            !ended.text().lines().any(|name| name == "out"),
            "{}",
            ended.text()
        );
    }
}

#[test]
fn a_place_that_cannot_be_written_is_said_at_the_start() {
    let dir = scratch("faults-nowhere");
    sh(&dir, "mkfifo never").expect(0);
    // The inputs never come: what is wrong is said before.
    for line in [
        "solve-pose -f frame.toml --calibrate none/frame.toml",
        "solve-pose -f frame.toml --imu none.csv --align-imu none/frame.toml",
        "report --truth truth.csv --html none/page.html -",
        "report --truth truth.csv -o none/table.txt -",
        "report lines --truth truth.csv -o none/table.txt -",
        "timesync fit -o none/fit.txt",
        "scan-capture --replay never --angle-jitter learn -o none/model.toml",
        "extract-lines -f frame.toml -o none/lines.csv",
    ] {
        let mut stage = Stage::start(&dir, line, Stdio::piped(), Stdio::null());
        let input = stage.stdin();
        if line.starts_with("extract-lines") {
            // A filter's encoding is that of its input.
            (&input).write_all(b"stamp_ns\n").unwrap();
        }
        let stderr = stage.end().expect(&[74]);
        assert!(
            stderr.contains("none/") && stderr.contains("No such file"),
            "{line}: {stderr}"
        );
        drop(input);
    }
}

/// The host's calendar clock is set while a recording runs; its monotonic clock goes on.
#[test]
fn a_step_of_the_hosts_clock_loses_nothing() {
    let dir = scratch("faults-step");
    let scanner = Scanner::serve(&dir, "127.0.0.1:0", "--n-scans 3000");
    let line = format!(
        "scan-capture {} -n 200 --tee run.cola -o live.csv -q",
        scanner.place
    );
    Stage::start(&dir, &line, Stdio::null(), Stdio::null())
        .end()
        .expect(&[0, 3]);
    let times = fs::read_to_string(dir.join("run.times.csv")).unwrap();
    let mut rows: Vec<Vec<String>> = times
        .lines()
        .map(|line| line.split(',').map(str::to_owned).collect())
        .collect();
    let at = rows[0].iter().position(|name| name == "t_s").unwrap();
    let half = rows.len() / 2;
    for step_s in [3600, -3600] {
        let mut stepped = rows.clone();
        for row in stepped.iter_mut().skip(half) {
            let (whole, rest) = row[at].split_once('.').unwrap();
            let whole: i64 = whole.parse().unwrap();
            row[at] = format!("{}.{rest}", whole + step_s);
        }
        let text: Vec<String> = stepped.iter().map(|row| row.join(",")).collect();
        fs::write(dir.join("stepped.csv"), text.join("\n") + "\n").unwrap();
        let replay = "scan-capture --replay run.cola --times stepped.csv -q";
        let replayed = sh(&dir, replay);
        assert!(matches!(replayed.status, 0 | 3), "{}", replayed.stderr);
        let live = fs::read_to_string(dir.join("live.csv")).unwrap();
        for name in ["seq", "device_ns"] {
            assert_eq!(column(&live, name), column(replayed.text(), name), "{name}");
        }
        // Every stamp is that of the live run, or off by the step.
        let pairs: Vec<i64> = column(&live, "stamp_ns")
            .iter()
            .zip(column(replayed.text(), "stamp_ns"))
            .map(|(live, replayed)| replayed - live)
            .collect();
        let step_ns = step_s * 1_000_000_000;
        let near = |off: i64| off.abs() < 50_000_000;
        assert!(
            pairs.iter().all(|off| near(*off) || near(off - step_ns)),
            "{pairs:?}"
        );
        let jumps = pairs
            .windows(2)
            .filter(|pair| !near(pair[1] - pair[0]))
            .count();
        assert!(jumps <= 1, "{jumps} jumps");
    }
    rows.clear();
}
