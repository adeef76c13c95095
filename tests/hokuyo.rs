//! scan-capture against an emulated UTM-30LX, over TCP and a pseudo terminal, both as processes.

use cablepose::hokuyo::scip::{Event, Framer, Measurement};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

const LIMIT: Duration = Duration::from_secs(60);

/// An emulated device, ended with the test.
struct Device {
    process: Child,
    place: String,
    stderr: Option<BufReader<std::process::ChildStderr>>,
}

impl Device {
    /// Starts one and waits until it says where it is.
    fn start(args: &[&str]) -> Device {
        let frame = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/cablar.toml");
        let mut process = Command::new(env!("CARGO_BIN_EXE_simulate"))
            .args(["--model", "utm-30lx", "-v", "-f"])
            .arg(frame)
            .args(args)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut stderr = BufReader::new(process.stderr.take().unwrap());
        let mut line = String::new();
        stderr.read_line(&mut line).unwrap();
        let place = line.trim().strip_prefix("simulate: serving utm-30lx at ");
        let place = place.unwrap_or_else(|| panic!("{line}")).to_owned();
        Device {
            process,
            place,
            stderr: Some(stderr),
        }
    }

    /// Asks it to end and gives what else it said.
    fn end(mut self) -> String {
        signal(&self.process, "TERM");
        self.said()
    }

    /// What it says until it ends by itself.
    fn said(&mut self) -> String {
        let mut text = String::new();
        let mut stderr = self.stderr.take().unwrap();
        stderr.read_to_string(&mut text).unwrap();
        let status = wait(&mut self.process);
        assert_eq!(status, Some(0), "{text}");
        text
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

fn signal(process: &Child, name: &str) {
    let id = process.id().to_string();
    let sent = Command::new("kill").args(["-s", name, &id]).status();
    assert!(sent.unwrap().success());
}

/// The exit status; a process that does not end is killed, and the test fails.
fn wait(process: &mut Child) -> Option<i32> {
    let due = Instant::now() + LIMIT;
    while Instant::now() < due {
        if let Some(status) = process.try_wait().unwrap() {
            return status.code();
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    process.kill().unwrap();
    panic!("a process did not end within {LIMIT:?}");
}

fn capture(place: &str, args: &[&str]) -> Output {
    let mut process = Command::new(env!("CARGO_BIN_EXE_scan-capture"))
        .args(["--device", "hokuyo", place])
        .args(args)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut stdout = process.stdout.take().unwrap();
    let reader = std::thread::spawn(move || {
        let mut bytes = Vec::new();
        stdout.read_to_end(&mut bytes).unwrap();
        bytes
    });
    let mut stderr = process.stderr.take().unwrap();
    let errors = std::thread::spawn(move || {
        let mut bytes = Vec::new();
        stderr.read_to_end(&mut bytes).unwrap();
        bytes
    });
    wait(&mut process);
    Output {
        status: process.wait().unwrap(),
        stdout: reader.join().unwrap(),
        stderr: errors.join().unwrap(),
    }
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// A column of a CSV stream.
fn column(csv: &[u8], name: &str) -> Vec<String> {
    let mut reader = csv::Reader::from_reader(csv);
    let at = reader.headers().unwrap().iter().position(|c| c == name);
    let at = at.unwrap_or_else(|| panic!("no column {name}"));
    let rows = reader.records().map(|row| row.unwrap()[at].to_owned());
    rows.collect()
}

fn numbers(csv: &[u8], name: &str) -> Vec<i64> {
    let column = column(csv, name);
    column.iter().map(|text| text.parse().unwrap()).collect()
}

fn scratch(name: &str) -> PathBuf {
    let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join("hokuyo");
    std::fs::create_dir_all(&dir).unwrap();
    dir.join(name)
}

const RUN: [&str; 4] = ["--effects", "none", "--trajectory", "loop"];

#[test]
fn the_scans_are_the_simulations_and_in_its_time() {
    let scene = ["--effects", "none", "--n-scans", "60"];
    let mut args = vec!["--serve", "127.0.0.1:0", "--hold", "--uptime-s", "16777"];
    args.extend(scene);
    let mut device = Device::start(&args);
    let ended = capture(&device.place, &["-n", "40"]);
    let stderr = text(&ended.stderr);
    assert_eq!(ended.status.code(), Some(0), "{stderr}");
    // The same as the simulation gives without a wire.
    let frame = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/cablar.toml");
    let simulated = Command::new(env!("CARGO_BIN_EXE_simulate"))
        .args(["--model", "utm-30lx", "-f"])
        .arg(frame)
        .args(scene)
        .output()
        .unwrap();
    assert!(simulated.status.success());
    let (ours, theirs) = (
        column(&ended.stdout, "ranges_mm"),
        column(&simulated.stdout, "ranges_mm"),
    );
    assert_eq!(ours.len(), 40);
    let mut compared = 0;
    for (ours, theirs) in ours.iter().zip(&theirs) {
        let beams: Vec<(&str, &str)> = ours.split(' ').zip(theirs.split(' ')).collect();
        assert_eq!(beams.len(), 1081);
        for (ours, theirs) in beams {
            if theirs == "inf" || theirs == "nan" {
                assert_eq!(ours, theirs);
                continue;
            }
            let (ours, theirs): (f64, f64) = (ours.parse().unwrap(), theirs.parse().unwrap());
            // Whole millimetres on the wire.
            assert!((ours - theirs).abs() <= 0.5 + 1e-9, "{ours} {theirs}");
            compared += 1;
        }
    }
    assert!(compared > 10_000, "{compared}");
    for name in ["angle_min_rad", "angle_increment_rad"] {
        let (ours, theirs) = (column(&ended.stdout, name), column(&simulated.stdout, name));
        for (ours, theirs) in ours.iter().zip(&theirs) {
            let (ours, theirs): (f64, f64) = (ours.parse().unwrap(), theirs.parse().unwrap());
            assert!((ours - theirs).abs() < 1e-9, "{name}");
        }
    }
    assert_eq!(numbers(&ended.stdout, "seq"), (0..40).collect::<Vec<_>>());
    // The stamps wrap at 16777.216 s; 25 ms a scan, each to the millisecond.
    let device_ns = numbers(&ended.stdout, "device_ns");
    let stamps = numbers(&ended.stdout, "stamp_ns");
    for (k, ns) in device_ns.iter().enumerate() {
        let off_ns = ns - device_ns[0] - 25_000_000 * k as i64;
        assert!(off_ns.abs() <= 1_000_000, "{off_ns}");
    }
    // A scan's sweep of 18.75 ms and a millisecond lie between stamp and arrival, and what a loaded
    // host adds.
    let received = numbers(&ended.stdout, "received_ns");
    for (stamp, received) in stamps.iter().zip(&received) {
        assert!(received - stamp > 18_000_000, "{}", received - stamp);
    }
    assert!(stamps.windows(2).all(|pair| pair[1] > pair[0]));
    let said = device.said();
    assert!(said.contains("60 scans made"), "{said}");
}

#[test]
fn a_pseudo_terminal_and_a_recording_on_the_side() {
    let link = scratch(&format!("tty-{}", std::process::id()));
    let link_text = link.to_str().unwrap();
    let mut args = vec!["--serve-pty", link_text, "--faults", "chunk=1..99"];
    args.extend(RUN);
    let device = Device::start(&args);
    assert_eq!(device.place, link_text);
    let tee = scratch("run.scip");
    let ended = capture(link_text, &["-n", "20", "--tee", tee.to_str().unwrap()]);
    let stderr = text(&ended.stderr);
    assert_eq!(ended.status.code(), Some(0), "{stderr}");
    let seqs = numbers(&ended.stdout, "seq");
    assert_eq!(seqs.len(), 20);
    // The raw bytes hold the same distances.
    let mut framer = Framer::new();
    framer.feed(&std::fs::read(&tee).unwrap());
    let (mut measurement, mut kept) = (Measurement::default(), Vec::new());
    while let Some(event) = framer.next() {
        let Event::Reply(reply) = event else { continue };
        if Measurement::is_one(&reply) {
            measurement.parse(&reply).unwrap();
            kept.push(measurement.distances.clone());
        }
    }
    let ranges = column(&ended.stdout, "ranges_mm");
    let last: Vec<String> = kept[19]
        .iter()
        .map(|mm| match mm {
            1 => "inf".to_owned(),
            3 => "nan".to_owned(),
            mm => mm.to_string(),
        })
        .collect();
    assert_eq!(ranges[19], last.join(" "));
    device.end();
    assert!(!link.exists());
}

#[test]
fn losses_on_purpose_are_counted_and_garbage_is_none() {
    let mut args = vec!["--serve", "127.0.0.1:0", "--hold", "--n-scans", "160"];
    args.extend([
        "--faults",
        "drop=0.05,flip=0.03,cut=0.03,chunk=1..1448",
        "--seed",
        "3",
    ]);
    args.extend(["--effects", "none"]);
    let mut device = Device::start(&args);
    let ended = capture(&device.place, &["-n", "130"]);
    let stderr = text(&ended.stderr);
    assert_eq!(ended.status.code(), Some(3), "{stderr}");
    let seqs = numbers(&ended.stdout, "seq");
    assert_eq!(seqs.len(), 130);
    let missing = seqs[129] - seqs[0] - 129;
    assert!(missing >= 5, "{missing}");
    let counted = format!(" {missing} scans lost, 0 outages, ");
    assert!(stderr.contains(&counted), "{missing}: {stderr}");
    let said = device.said();
    assert!(said.contains("lost on purpose"), "{said}");
}

#[test]
fn a_cut_cable_is_reconnected_and_the_end_stops_the_laser() {
    let mut args = vec!["--serve", "127.0.0.1:0", "--faults", "reset@1500ms"];
    args.extend(RUN);
    args.extend(["--speed-m-s", "0.5", "--loops", "20"]);
    let device = Device::start(&args);
    let ended = capture(&device.place, &["-n", "120"]);
    let stderr = text(&ended.stderr);
    assert_eq!(ended.status.code(), Some(3), "{stderr}");
    assert!(stderr.contains("reconnecting"), "{stderr}");
    assert!(stderr.contains("scans again after"), "{stderr}");
    let seqs = numbers(&ended.stdout, "seq");
    assert!(
        seqs.windows(2).all(|pair| pair[1] > pair[0]),
        "no scan twice"
    );
    // The device tells another client that its laser is off.
    let mut line = TcpStream::connect(&device.place).unwrap();
    line.set_read_timeout(Some(LIMIT)).unwrap();
    line.write_all(b"II\n").unwrap();
    let mut reply = Vec::new();
    let mut buffer = [0; 1024];
    while !reply.ends_with(b"\n\n") {
        let length = line.read(&mut buffer).unwrap();
        assert!(length > 0);
        reply.extend_from_slice(&buffer[..length]);
    }
    let reply = text(&reply);
    assert!(
        reply.contains("LASR:OFF;") && reply.contains("MESM:Idle;"),
        "{reply}"
    );
    device.end();
}

#[test]
fn a_signal_ends_a_capture_in_order() {
    let mut args = vec!["--serve", "127.0.0.1:0"];
    args.extend(RUN);
    args.extend(["--loops", "20"]);
    let device = Device::start(&args);
    let mut process = Command::new(env!("CARGO_BIN_EXE_scan-capture"))
        .args(["--device", "hokuyo", &device.place])
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut stdout = BufReader::new(process.stdout.take().unwrap());
    let mut line = String::new();
    for _ in 0..3 {
        line.clear();
        assert!(stdout.read_line(&mut line).unwrap() > 0);
    }
    signal(&process, "INT");
    let mut rest = String::new();
    stdout.read_to_string(&mut rest).unwrap();
    assert!(rest.is_empty() || rest.ends_with('\n'));
    assert_eq!(wait(&mut process), Some(0));
    device.end();
}

#[test]
fn what_is_no_hokuyo_is_said() {
    // Nobody is there.
    let port = {
        let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        listener.local_addr().unwrap()
    };
    let ended = capture(&port.to_string(), &[]);
    assert_eq!(ended.status.code(), Some(69));
    let said = text(&ended.stderr);
    assert!(said.contains("refused") && said.contains("10940"), "{said}");
    // Somebody who talks something else: garbage to every line.
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let peer = std::thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        stream.set_read_timeout(Some(LIMIT)).unwrap();
        let mut buffer = [0; 256];
        while let Ok(length) = stream.read(&mut buffer) {
            if length == 0 || stream.write_all(b"\xFF\x00hello\n\nwhat?\n\n").is_err() {
                break;
            }
        }
    });
    let ended = capture(&address.to_string(), &["--wait", "2s"]);
    assert_eq!(ended.status.code(), Some(69), "{}", text(&ended.stderr));
    assert!(
        text(&ended.stderr).contains("no answer to QT"),
        "{}",
        text(&ended.stderr)
    );
    peer.join().unwrap();
    // Options of the other kind.
    let ended = capture("127.0.0.1:1", &["--poll"]);
    assert_eq!(ended.status.code(), Some(2));
}
