//! scan-capture on devices that answer: the emulated scanner of `simulate --serve`, and scripted ones
//! that do what an emulator would not. All on loopback and pseudo terminals; every device ends with
//! its test.

mod shell;

use cablepose::sick::cola::{self, Dialect, Event, Framer};
use shell::{scratch, testdata};
use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Far more than anything here needs, even on a busy machine.
const LONG: Duration = Duration::from_secs(100);

/// An emulated scanner, ended with the test.
struct Emulator {
    child: Child,
    place: String,
}

impl Emulator {
    fn start(dir: &Path, args: &[&str]) -> Emulator {
        let mut child = Command::new(env!("CARGO_BIN_EXE_simulate"))
            .current_dir(dir)
            .args(["-f", "frame.toml", "--trajectory", "random"])
            .args(args)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
        let place = loop {
            let line = lines.next().expect("the emulator ended").unwrap();
            if let Some((_, place)) = line.split_once("serving lms511 at ") {
                break place.to_owned();
            }
        };
        // Nobody may block on a full pipe.
        std::thread::spawn(move || lines.for_each(drop));
        Emulator { child, place }
    }

    fn serve(dir: &Path, args: &[&str]) -> Emulator {
        let common = [
            "--serve",
            "127.0.0.1:0",
            "--n-scans",
            "3000",
            "--linger",
            "60s",
        ];
        Emulator::start(dir, &[&common, args].concat())
    }
}

impl Drop for Emulator {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A capture that is running.
struct Capture {
    child: Child,
    stderr: Option<JoinHandle<String>>,
    said: Receiver<String>,
}

/// How a capture ended.
struct Ended {
    status: i32,
    stderr: String,
}

impl Ended {
    #[track_caller]
    fn expect(self, status: i32) -> String {
        assert_eq!(self.status, status, "{}", self.stderr);
        self.stderr
    }
}

impl Capture {
    fn start(dir: &Path, stdout: Stdio, args: &[&str]) -> Capture {
        let mut child = Command::new(env!("CARGO_BIN_EXE_scan-capture"))
            .current_dir(dir)
            .args(args)
            .env_remove("CABLEPOSE_PASSWORD")
            .stdin(Stdio::null())
            .stdout(stdout)
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let lines = BufReader::new(child.stderr.take().unwrap()).lines();
        let (sender, said) = channel();
        let stderr = std::thread::spawn(move || {
            let mut all = String::new();
            for line in lines.map_while(Result::ok) {
                all.push_str(&line);
                all.push('\n');
                let _ = sender.send(line);
            }
            all
        });
        Capture {
            child,
            stderr: Some(stderr),
            said,
        }
    }

    /// Waits until a line of stderr holds `text`.
    #[track_caller]
    fn says(&self, text: &str) {
        let until = Instant::now() + LONG;
        loop {
            let left = until.saturating_duration_since(Instant::now());
            let line = self.said.recv_timeout(left);
            if line.expect("it never said it").contains(text) {
                return;
            }
        }
    }

    fn signal(&self, name: &str) {
        let pid = self.child.id().to_string();
        let status = Command::new("kill").args(["-s", name, &pid]).status();
        assert!(status.unwrap().success());
    }

    #[track_caller]
    fn end(mut self) -> Ended {
        let until = Instant::now() + LONG;
        let status = loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                break status;
            }
            if Instant::now() > until {
                let _ = self.child.kill();
                panic!("it did not end");
            }
            std::thread::sleep(Duration::from_millis(20));
        };
        Ended {
            status: status.code().unwrap_or(-1),
            stderr: self.stderr.take().unwrap().join().unwrap(),
        }
    }
}

impl Drop for Capture {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Captures into `out.csv` until it ends by itself.
fn capture(dir: &Path, args: &[&str]) -> Ended {
    let all = [args, &["-o", "out.csv"]].concat();
    Capture::start(dir, Stdio::null(), &all).end()
}

fn column(path: &Path, name: &str) -> Vec<i64> {
    let mut reader = csv::Reader::from_path(path).unwrap();
    let headers = reader.headers().unwrap().clone();
    let index = headers.iter().position(|column| column == name).unwrap();
    let rows = reader.records();
    rows.map(|row| row.unwrap()[index].parse().unwrap())
        .collect()
}

/// Waits until a file that is being written has a record.
#[track_caller]
fn await_record(path: &Path) {
    let until = Instant::now() + LONG;
    while fs::read_to_string(path).map_or(0, |text| text.lines().count()) < 2 {
        assert!(Instant::now() < until, "no record in {}", path.display());
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// Replays recordings and compares with what the capture wrote.
#[track_caller]
fn assert_replay_is_the_same(dir: &Path, recordings: &[&str]) {
    let ended = Command::new(env!("CARGO_BIN_EXE_scan-capture"))
        .current_dir(dir)
        .arg("--replay")
        .args(recordings)
        .output()
        .unwrap();
    let stderr = String::from_utf8_lossy(&ended.stderr);
    assert!(ended.status.success(), "{stderr}");
    let live = fs::read(dir.join("out.csv")).unwrap();
    assert!(live == ended.stdout, "{stderr}");
}

/// Where the line breaks come, no scan is written twice, every gap is counted.
#[track_caller]
fn assert_gaps_are_counted(dir: &Path, stderr: &str) {
    let seqs = column(&dir.join("out.csv"), "seq");
    assert!(seqs.is_sorted_by(|a, b| a < b), "{seqs:?}");
    let gaps: i64 = seqs.windows(2).map(|pair| pair[1] - pair[0] - 1).sum();
    assert!(gaps > 0);
    let counted = format!("{gaps} scans lost, ");
    assert!(stderr.contains(&counted), "{gaps} in seq; {stderr}");
    let devices = column(&dir.join("out.csv"), "received_ns");
    assert!(devices.is_sorted(), "{devices:?}");
}

/// What a scripted device does with a request, given as `sRN NAME ...`.
enum Answer {
    /// Answers with this body.
    Body(Vec<u8>),
    /// Says no.
    Refuse,
}

/// A device that speaks CoLa B: `script` answers all but the probe and `sEN`, after which it sends
/// the first `scans` scans of a recording, one every 10 ms, and then `after`.
struct Scripted {
    listener: TcpListener,
    place: String,
    /// It is asked for scans and refuses.
    is_busy: bool,
}

/// What a scripted device does when it has sent its scans.
#[derive(Clone, Copy, PartialEq)]
enum After {
    /// It hangs up.
    Close,
    /// It goes on answering requests.
    Answer,
}

impl Scripted {
    fn new() -> Scripted {
        Scripted::at("127.0.0.1:0")
    }

    fn at(place: &str) -> Scripted {
        let listener = TcpListener::bind(place).unwrap();
        let place = listener.local_addr().unwrap().to_string();
        Scripted {
            listener,
            place,
            is_busy: false,
        }
    }

    /// Serves one connection; gives the requests that came, in their order.
    fn serve(
        self,
        scans: usize,
        after: After,
        mut script: impl FnMut(&str) -> Answer + Send + 'static,
    ) -> JoinHandle<Vec<String>> {
        std::thread::spawn(move || {
            let (mut stream, _) = self.listener.accept().unwrap();
            drop(self.listener);
            stream.set_read_timeout(Some(LONG)).unwrap();
            let mut requests = Vec::new();
            let mut framer = Framer::new();
            let mut chunk = [0; 4096];
            while let Ok(length @ 1..) = stream.read(&mut chunk) {
                framer.feed(&chunk[..length]);
                while let Some(event) = framer.next() {
                    let Event::Telegram(telegram) = event else {
                        continue;
                    };
                    if telegram.dialect == Dialect::Text {
                        continue;
                    }
                    let text = telegram.body.escape_ascii().to_string();
                    let answer = match telegram.body {
                        b"sRN SCdevicestate" => Answer::Body(b"sRA SCdevicestate \x01".to_vec()),
                        b"sRN DeviceIdent" => {
                            Answer::Body(b"sRA DeviceIdent \0\x01L\0\x011".to_vec())
                        }
                        [b's', b'E', b'N', ..] if self.is_busy => Answer::Refuse,
                        [b's', b'E', b'N', rest @ ..] => Answer::Body([b"sEA", rest].concat()),
                        _ => script(&text),
                    };
                    let starts = telegram.body == b"sEN LMDscandata \x01" && !self.is_busy;
                    requests.push(text);
                    let body = match answer {
                        Answer::Body(body) => body,
                        Answer::Refuse => b"sFA\0\x03".to_vec(),
                    };
                    if write(&mut stream, &body).is_err() {
                        return requests;
                    }
                    if starts {
                        for scan in recorded_scans().iter().take(scans) {
                            if stream.write_all(scan).is_err() {
                                return requests;
                            }
                            std::thread::sleep(Duration::from_millis(10));
                        }
                        if after == After::Close {
                            return requests;
                        }
                    }
                }
            }
            requests
        })
    }
}

fn write(stream: &mut TcpStream, body: &[u8]) -> std::io::Result<()> {
    let mut bytes = Vec::new();
    cola::frame(Dialect::Binary, body, &mut bytes);
    stream.write_all(&bytes)
}

/// The scans of the recording in testdata, framed.
fn recorded_scans() -> Vec<Vec<u8>> {
    let stream = fs::read(testdata("lms511.cola")).unwrap();
    let mut framer = Framer::new();
    framer.feed(&stream);
    let mut scans = Vec::new();
    while let Some(Event::Telegram(telegram)) = framer.next() {
        if telegram.verb() == b"sSN" {
            let mut bytes = Vec::new();
            cola::frame(Dialect::Binary, telegram.body, &mut bytes);
            scans.push(bytes);
        }
    }
    scans
}

#[test]
fn what_is_kept_on_the_side_replays_to_the_same_records() {
    let dir = scratch("live-tee");
    for (serve, args) in [
        (&["--faults", "chunk=1..900"][..], &[][..]),
        (&["--dialect", "a"], &[]),
        (&[], &["--poll"]),
    ] {
        let device = Emulator::serve(&dir, serve);
        let common = [&*device.place, "-n", "40", "--tee", "run.cola"];
        let stderr = capture(&dir, &[&common, args].concat()).expect(0);
        let seqs = column(&dir.join("out.csv"), "seq");
        assert_eq!(seqs.len(), 40, "{stderr}");
        assert!(!args.is_empty() || seqs.windows(2).all(|pair| pair[1] == pair[0] + 1));
        assert_replay_is_the_same(&dir, &["run.cola"]);
    }
}

#[test]
fn the_parts_of_a_recording_are_one_stream() {
    let dir = scratch("live-parts");
    let device = Emulator::serve(&dir, &["--faults", "reset@1s"]);
    let args = ["-n", "60", "--tee", "run.cola", "--tee-rotate", "40kB"];
    capture(&dir, &[&[&*device.place], &args[..]].concat()).expect(3);
    let mut parts: Vec<PathBuf> = fs::read_dir(&dir)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|end| end == "cola"))
        .collect();
    parts.sort();
    assert!(parts.len() > 2, "{parts:?}");
    let parts: Vec<&str> = parts.iter().map(|part| part.to_str().unwrap()).collect();
    assert_replay_is_the_same(&dir, &parts);
}

#[test]
fn a_cable_that_is_pulled_leaves_a_gap_and_no_duplicate() {
    for (name, faults) in [
        ("reset", "reset@1s"),
        ("blackhole", "blackhole=2s@1s"),
        ("reboot", "reboot=1s@1s"),
    ] {
        let dir = scratch(&format!("live-{name}"));
        let device = Emulator::serve(&dir, &["--faults", faults]);
        let args = [&*device.place, "-n", "120", "--tee", "run.cola"];
        let stderr = capture(&dir, &args).expect(3);
        assert!(stderr.contains("1 outages"), "{name}: {stderr}");
        assert!(stderr.contains("scans again after"), "{name}: {stderr}");
        assert_gaps_are_counted(&dir, &stderr);
        assert_replay_is_the_same(&dir, &["run.cola"]);
    }
}

#[test]
fn a_restart_soon_after_the_last_is_no_late_telegram() {
    // The device's clock and counts are seen from zero on, and go back to it twice, by 2.5 s or so.
    let dir = scratch("live-reboot-soon");
    let faults = "reboot=800ms@2500ms,reboot=600ms@5500ms";
    let device = Emulator::serve(&dir, &["--faults", faults]);
    let args = [&*device.place, "-n", "200", "--tee", "run.cola"];
    let stderr = capture(&dir, &args).expect(3);
    assert!(stderr.contains("2 times the device restarted"), "{stderr}");
    assert!(!stderr.contains("came after a newer one"), "{stderr}");
    assert_gaps_are_counted(&dir, &stderr);
    assert_replay_is_the_same(&dir, &["run.cola"]);
    // On the host's clock: no stamp goes back, none is older than a stalled machine makes it.
    let stamps = column(&dir.join("out.csv"), "stamp_ns");
    assert!(stamps.is_sorted(), "{stamps:?}");
    let received = column(&dir.join("out.csv"), "received_ns");
    let ages_s = stamps
        .iter()
        .zip(&received)
        .map(|(s, r)| (r - s) as f64 * 1e-9);
    let oldest_s = ages_s.fold(0.0, f64::max);
    assert!(oldest_s < 1.5, "{oldest_s} s");
    // Between two starts the scans are missing for about as long as the stamps say.
    let seqs = column(&dir.join("out.csv"), "seq");
    let scans = (seqs[seqs.len() - 1] - seqs[0]) as f64;
    let lasted_s = (stamps[stamps.len() - 1] - stamps[0]) as f64 * 1e-9;
    assert!(
        (lasted_s * 35.0 / scans - 1.0).abs() < 0.2,
        "{scans} in {lasted_s} s"
    );
}

#[test]
fn lost_scans_are_counted_exactly() {
    let dir = scratch("live-drop");
    let device = Emulator::serve(&dir, &["--faults", "drop=0.1,flip=0.05,repeat=0.1"]);
    let args = [&*device.place, "-n", "150", "--tee", "run.cola"];
    let stderr = capture(&dir, &args).expect(3);
    assert!(stderr.contains(" 0 outages"), "{stderr}");
    assert_gaps_are_counted(&dir, &stderr);
}

#[test]
fn telegrams_that_are_cut_cost_themselves_and_are_not_said_one_by_one() {
    let dir = scratch("live-cut");
    let device = Emulator::serve(&dir, &["--faults", "cut=0.2,garbage=0.2,chunk=1..900"]);
    let args = [&*device.place, "-n", "200", "--tee", "run.cola"];
    let stderr = capture(&dir, &args).expect(3);
    assert!(stderr.contains(" 0 outages"), "{stderr}");
    assert_gaps_are_counted(&dir, &stderr);
    let bad = stderr.split(" bad pieces skipped").next().unwrap();
    let bad: usize = bad.rsplit(' ').next().unwrap().parse().unwrap();
    assert!(bad > 60, "{stderr}");
    // Two remarks a second at most, and the run takes longer on a busy machine.
    let said = stderr.lines().count();
    assert!(said < bad, "{said} lines: {stderr}");
    assert!(stderr.contains(" bad pieces, the last: "), "{stderr}");
    let ended = Command::new(env!("CARGO_BIN_EXE_scan-capture"))
        .current_dir(&dir)
        .args(["--replay", "run.cola", "--skip-bad"])
        .output();
    assert!(fs::read(dir.join("out.csv")).unwrap() == ended.unwrap().stdout);
}

#[test]
fn a_poll_may_be_slow_and_one_without_an_answer_is_no_outage() {
    let dir = scratch("live-poll");
    let device = Emulator::serve(&dir, &[]);
    let stderr = capture(&dir, &[&device.place, "--poll=1", "-n", "3"]).expect(0);
    assert!(!stderr.contains("reconnecting"), "{stderr}");
    let device = Emulator::serve(&dir, &["--faults", "drop=0.15"]);
    let stderr = capture(&dir, &[&device.place, "--poll=4", "-n", "20"]).expect(3);
    assert!(stderr.contains("was not answered"), "{stderr}");
    assert!(stderr.contains(" 0 outages"), "{stderr}");
}

#[test]
fn signals_stop_the_device_and_finish_the_file() {
    for signal in ["INT", "TERM"] {
        let dir = scratch(&format!("live-{signal}"));
        let device = Scripted::new();
        let place = device.place.clone();
        let requests = device.serve(20, After::Answer, |_| Answer::Refuse);
        let args = [&*place, "--tee", "run.cola", "-o", "out.csv"];
        let capture = Capture::start(&dir, Stdio::null(), &args);
        await_record(&dir.join("out.csv.partial"));
        capture.signal(signal);
        capture.end().expect(0);
        let requests = requests.join().unwrap();
        assert_eq!(requests.last().unwrap(), "sEN LMDscandata \\x00");
        assert!(!column(&dir.join("out.csv"), "seq").is_empty());
        assert_replay_is_the_same(&dir, &["run.cola"]);
    }
}

#[test]
fn a_signal_before_anything_has_come_is_told_by_the_status() {
    let dir = scratch("live-nothing");
    for (signal, status) in [("INT", 130), ("TERM", 143)] {
        let device = Scripted::new();
        let place = device.place.clone();
        let booting = |request: &str| match request {
            "sRN STlms" => Answer::Body(b"sRA STlms \0\x04\0\0\x0800:00:01\0\x0801.01.70".to_vec()),
            _ => Answer::Refuse,
        };
        let requests = device.serve(0, After::Answer, booting);
        let capture = Capture::start(&dir, Stdio::null(), &[&place, "-o", "out.csv"]);
        capture.says("waiting for the scanner to measure: it is rotating up to speed (STlms 4)");
        capture.signal(signal);
        capture.end().expect(status);
        assert!(!dir.join("out.csv").exists());
        requests.join().unwrap();
    }
}

#[test]
fn a_reader_that_leaves_while_the_line_is_down_is_noticed() {
    let dir = scratch("live-reader");
    let device = Scripted::new();
    let place = device.place.clone();
    let requests = device.serve(3, After::Close, |_| Answer::Refuse);
    let mut capture = Capture::start(&dir, Stdio::piped(), &[&place]);
    let mut stdout = BufReader::new(capture.child.stdout.take().unwrap()).lines();
    for _ in 0..4 {
        stdout.next().unwrap().unwrap();
    }
    capture.says("reconnecting");
    drop(stdout);
    // Scans were lost or not, nobody can tell; it ends, and quietly.
    let ended = capture.end();
    assert!(matches!(ended.status, 0 | 3), "{}", ended.stderr);
    requests.join().unwrap();
}

#[test]
fn time_limits_hold_while_the_line_is_down() {
    let dir = scratch("live-for");
    let device = Scripted::new();
    let place = device.place.clone();
    let requests = device.serve(3, After::Close, |_| Answer::Refuse);
    let stderr = capture(&dir, &[&place, "--for", "1500ms"]).expect(3);
    assert!(stderr.contains("0 scans lost, 1 outages"), "{stderr}");
    assert_eq!(column(&dir.join("out.csv"), "seq").len(), 3);
    requests.join().unwrap();
}

#[test]
fn a_refusal_ends_no_capture_that_has_scans() {
    let dir = scratch("live-busy");
    let device = Scripted::new();
    let place = device.place.clone();
    let first = device.serve(3, After::Close, |_| Answer::Refuse);
    let args = [&*place, "-n", "8", "-o", "out.csv"];
    let capture = Capture::start(&dir, Stdio::null(), &args);
    first.join().unwrap();
    let busy = Scripted {
        is_busy: true,
        ..Scripted::at(&place)
    };
    let second = busy.serve(0, After::Answer, |_| Answer::Refuse);
    assert_eq!(
        second.join().unwrap().last().unwrap(),
        "sEN LMDscandata \\x01"
    );
    let third = Scripted::at(&place).serve(20, After::Answer, |_| Answer::Refuse);
    let stderr = capture.end().expect(3);
    assert!(stderr.contains(" 1 outages"), "{stderr}");
    assert_eq!(stderr.matches("refused with sFA 3").count(), 1, "{stderr}");
    assert_eq!(column(&dir.join("out.csv"), "seq").len(), 8);
    third.join().unwrap();
    // One that refuses from the beginning is given up.
    let busy = Scripted {
        is_busy: true,
        ..Scripted::new()
    };
    let place = busy.place.clone();
    let refusing = busy.serve(0, After::Answer, |_| Answer::Refuse);
    let stderr = self::capture(&dir, &[&place]).expect(69);
    assert!(stderr.contains("refused with sFA 3"), "{stderr}");
    refusing.join().unwrap();
}

#[test]
fn a_scanner_that_starts_is_waited_for() {
    let dir = scratch("live-wait");
    let device = Emulator::serve(&dir, &["--boot", "2s"]);
    let stderr = capture(&dir, &[&device.place, "-n", "3"]).expect(0);
    assert!(
        stderr.contains("waiting for the scanner to measure"),
        "{stderr}"
    );
    drop(device);
    // One that refuses connections is waited for where that is asked for.
    let port = TcpListener::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap();
    let place = port.to_string();
    let args = [&*place, "--wait", "90s", "-n", "3", "-o", "out.csv"];
    let late = Capture::start(&dir, Stdio::null(), &args);
    late.says("Connection refused; trying again");
    let serve = ["--serve", &place, "--n-scans", "3000", "--linger", "60s"];
    let _device = Emulator::start(&dir, &serve);
    late.end().expect(0);
}

#[test]
fn a_scanner_that_never_measures_is_given_up() {
    let dir = scratch("live-never");
    let device = Scripted::new();
    let place = device.place.clone();
    let stopped = |request: &str| match request {
        "sRN STlms" => Answer::Body(b"sRA STlms \0\x06\0\0\x0800:00:01\0\x0801.01.70".to_vec()),
        _ => Answer::Refuse,
    };
    let requests = device.serve(0, After::Answer, stopped);
    let stderr = capture(&dir, &[&place, "--wait", "300ms"]).expect(69);
    assert!(
        stderr.contains("ready, not measuring (STlms 6)"),
        "{stderr}"
    );
    assert!(stderr.contains("--configure --start"), "{stderr}");
    requests.join().unwrap();
}

#[test]
fn what_is_set_reads_back_and_is_not_set_twice() {
    let dir = scratch("live-configure");
    let device = Emulator::serve(&dir, &[]);
    let set = [
        "--configure",
        "--frequency-hz",
        "50",
        "--resolution-deg",
        "0.5",
    ];
    let more = [
        "--range-deg",
        "0,90",
        "--remission",
        "off",
        "--divider",
        "2",
        "-n",
        "20",
    ];
    let args = [&[&*device.place], &set[..], &more].concat();
    let stderr = capture(&dir, &args).expect(0);
    assert!(stderr.contains("the frequency changes"), "{stderr}");
    let seqs = column(&dir.join("out.csv"), "seq");
    assert!(
        seqs.windows(2).all(|pair| pair[1] == pair[0] + 1),
        "{seqs:?}"
    );
    let counters = column(&dir.join("out.csv"), "scan_counter");
    assert!(
        counters
            .windows(2)
            .all(|pair| (pair[1] - pair[0]) % 65_536 == 2)
    );
    let text = fs::read_to_string(dir.join("out.csv")).unwrap();
    let header = text.lines().next().unwrap();
    let column = |name| header.split(',').position(|column| column == name).unwrap();
    let first: Vec<&str> = text.lines().nth(1).unwrap().split(',').collect();
    assert_eq!(first[column("ranges_mm")].split(' ').count(), 181);
    assert_eq!(first[column("remissions")], "");

    let stderr = capture(&dir, &args).expect(0);
    assert!(!stderr.contains("the frequency changes"), "{stderr}");

    let info = Command::new(env!("CARGO_BIN_EXE_scan-capture"))
        .args(["info", &device.place, "--json"])
        .output()
        .unwrap();
    assert!(info.status.success(), "{info:?}");
    let info: serde_json::Value = serde_json::from_slice(&info.stdout).unwrap();
    assert_eq!(info["frequency_hz"], 50.0);
    assert_eq!(info["resolution_deg"], 0.5);
    assert_eq!(info["range_deg"], serde_json::json!([0.0, 90.0]));
    assert_eq!(
        (&info["remission"], &info["divider"]),
        (&false.into(), &2.into())
    );
    assert_eq!(info["state"], "measuring (7)");
    assert_eq!(info["firmware"], "V1.80");

    fs::write(dir.join("hash"), "12345678").unwrap();
    let args = ["--configure", "--echoes", "all", "--password-file", "hash"];
    let stderr = capture(&dir, &[&[&*device.place], &args[..]].concat()).expect(69);
    assert!(
        stderr.contains("login refused") && !stderr.contains("12345678"),
        "{stderr}"
    );
}

#[test]
fn a_device_that_reads_back_otherwise_is_not_captured() {
    let dir = scratch("live-liar");
    let device = Scripted::new();
    let place = device.place.clone();
    let liar = |request: &str| match request.split(' ').nth(1).unwrap() {
        "SetAccessMode" => Answer::Body(b"sAN SetAccessMode \x01".to_vec()),
        "Run" => Answer::Body(b"sAN Run \x01".to_vec()),
        "FREchoFilter" if request.starts_with("sWN") => Answer::Body(b"sWA FREchoFilter ".to_vec()),
        "FREchoFilter" => Answer::Body(b"sRA FREchoFilter \x02".to_vec()),
        _ => Answer::Refuse,
    };
    let requests = device.serve(3, After::Answer, liar);
    let args = [&*place, "--configure", "--echoes", "all"];
    let stderr = capture(&dir, &args).expect(69);
    assert!(stderr.contains("the echo filter is last"), "{stderr}");
    let requests = requests.join().unwrap();
    assert!(requests.contains(&"sMN Run".to_owned()));
    assert!(!requests.iter().any(|request| request.starts_with("sEN")));
}

#[test]
fn an_older_recording_survives_a_failed_start() {
    let dir = scratch("live-keep");
    fs::write(dir.join("run.cola"), "old").unwrap();
    let stderr = capture(&dir, &["127.0.0.1:1", "--tee", "run.cola"]).expect(69);
    assert!(stderr.contains("Connection refused"), "{stderr}");
    assert_eq!(fs::read(dir.join("run.cola")).unwrap(), b"old");
    let stderr = capture(&dir, &["127.0.0.1:1", "--tee", "./out.csv"]).expect(2);
    assert!(stderr.contains("the same file"), "{stderr}");
}

#[test]
fn a_full_disk_ends_the_recording_not_the_records() {
    if !Path::new("/dev/full").exists() {
        return;
    }
    let dir = scratch("live-full");
    std::os::unix::fs::symlink("/dev/full", dir.join("run.cola")).unwrap();
    let device = Emulator::serve(&dir, &[]);
    let args = [&*device.place, "-n", "50", "--tee", "run.cola"];
    let stderr = capture(&dir, &args).expect(74);
    assert!(stderr.contains("No space left on device"), "{stderr}");
    assert_eq!(column(&dir.join("out.csv"), "seq").len(), 50);
}

#[test]
fn a_serial_line_works_and_says_what_it_cannot_carry() {
    let dir = scratch("live-serial");
    let link = dir.join("lms");
    let link = link.to_str().unwrap();
    let serve = [
        "--serve-pty",
        link,
        "--baud",
        "19200",
        "--n-scans",
        "3000",
        "--linger",
        "60s",
    ];
    let _device = Emulator::start(&dir, &serve);
    let args = [link, "--baud", "19200", "-n", "4", "--tee", "run.cola"];
    // The line is too slow on purpose: scans are lost, and that is said before and after; that each
    // takes more than a second is no outage.
    let stderr = capture(&dir, &args).expect(3);
    assert!(stderr.contains("19200 baud carry"), "{stderr}");
    assert!(stderr.contains(" 0 outages"), "{stderr}");
    assert_eq!(column(&dir.join("out.csv"), "seq").len(), 4);
    assert_replay_is_the_same(&dir, &["run.cola"]);
}

#[test]
fn what_does_not_go_together_is_refused() {
    let dir = scratch("live-usage");
    for args in [
        &["host", "--baud", "9600"][..],
        &["host", "--frequency-hz", "50", "--resolution-deg", "0.5"],
        &["host", "--configure"],
        &[
            "host",
            "--configure",
            "--frequency-hz",
            "30",
            "--resolution-deg",
            "0.5",
        ],
        &["host", "--configure", "--frequency-hz", "50"],
        &["host", "--tee-rotate", "1MB"],
        &["host", "--replay", "x"],
        &["--replay", "x", "--for", "1s"],
        &["--replay", "x", "y", "--times", "z"],
        &["--replay", "x", "--configure", "--save"],
        &["host", "-n", "0"],
        &["host", "--poll=1e-300"],
        &["host", "--device", "hokuyo", "--configure", "--save"],
        &["list", "--baud", "9600"],
    ] {
        let ended = Capture::start(&dir, Stdio::null(), args).end();
        assert_eq!(ended.status, 2, "{args:?}: {}", ended.stderr);
    }
}
