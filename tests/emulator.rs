//! The emulated scanner as a process, with plain clients: a `TcpStream` and the decoder.

#![cfg(unix)]

mod shell;

use cablepose::link::{Connection, Endpoint};
use cablepose::sick::cola::{Dialect, Event, Framer, frame};
use cablepose::sick::scandata::{LmdScandata, is_scan};
use shell::{scratch, sh, testdata};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, Command, Stdio};
use std::time::{Duration, Instant};

/// Longer than anything here takes; what is late by this much does not come.
const PATIENCE: Duration = Duration::from_secs(120);

/// A `simulate --serve` in its own process; it is ended with the test.
struct Served {
    child: Child,
    stderr: BufReader<ChildStderr>,
    /// Where it says it is, in the order of its services.
    places: Vec<String>,
}

impl Served {
    fn start(dir: &Path, args: &str) -> Served {
        let mut child = Command::new(env!("CARGO_BIN_EXE_simulate"))
            .args(args.split_whitespace())
            .current_dir(dir)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut stderr = BufReader::new(child.stderr.take().unwrap());
        let services = args.matches("--serve").count();
        let places = (0..services).map(|_| {
            let mut line = String::new();
            stderr.read_line(&mut line).unwrap();
            let place = line.strip_prefix("simulate: serving lms511 at ");
            place.unwrap_or_else(|| panic!("{line}")).trim().to_owned()
        });
        Served {
            places: places.collect(),
            child,
            stderr,
        }
    }

    fn client(&self) -> Client {
        Client::new(TcpStream::connect(&self.places[0]).unwrap())
    }

    fn signal(&self, name: &str) {
        let pid = self.child.id().to_string();
        let status = Command::new("kill").args(["-s", name, &pid]).status();
        assert!(status.unwrap().success());
    }

    /// Waits for the end; the exit status and what else was said.
    fn end(mut self) -> (i32, String) {
        let mut said = String::new();
        self.stderr.read_to_string(&mut said).unwrap();
        (self.child.wait().unwrap().code().unwrap_or(-1), said)
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        // One that has ended needs no killing.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A client that knows nothing but the protocol.
struct Client {
    stream: TcpStream,
    framer: Framer,
    dialect: Dialect,
    skipped: u64,
}

enum Seen {
    Scan(Box<LmdScandata>),
    Body(Vec<u8>),
    End,
}

impl Client {
    fn new(stream: TcpStream) -> Client {
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        Client {
            stream,
            framer: Framer::new(),
            dialect: Dialect::Binary,
            skipped: 0,
        }
    }

    fn send(&mut self, body: &[u8]) {
        let mut bytes = Vec::new();
        frame(self.dialect, body, &mut bytes);
        self.stream.write_all(&bytes).unwrap();
    }

    /// The next telegram; the end, in order or not.
    fn next(&mut self) -> Seen {
        loop {
            match self.framer.next() {
                Some(Event::Telegram(telegram)) => {
                    let mut scan = LmdScandata::default();
                    if is_scan(&telegram) && scan.parse(&telegram).is_ok() {
                        return Seen::Scan(Box::new(scan));
                    }
                    return Seen::Body(telegram.body.to_vec());
                }
                Some(Event::Skipped(skipped)) => {
                    self.skipped += skipped.bytes;
                    continue;
                }
                None => {}
            }
            let mut chunk = [0; 65_536];
            match self.stream.read(&mut chunk) {
                Ok(count @ 1..) => self.framer.feed(&chunk[..count]),
                Ok(0) | Err(_) => {
                    self.framer.end();
                    if let Some(Event::Skipped(skipped)) = self.framer.next() {
                        self.skipped += skipped.bytes;
                    }
                    return Seen::End;
                }
            }
        }
    }

    /// Sends a request and waits for what is neither a scan nor another event.
    fn ask(&mut self, body: &[u8]) -> Vec<u8> {
        self.send(body);
        loop {
            match self.next() {
                Seen::Body(body) if !body.starts_with(b"sSN") => return body,
                Seen::End => panic!("no answer to {}", String::from_utf8_lossy(body)),
                _ => {}
            }
        }
    }

    fn start(&mut self) {
        assert_eq!(self.ask(b"sEN LMDscandata \x01"), b"sEA LMDscandata \x01");
    }

    fn scan(&mut self) -> LmdScandata {
        loop {
            match self.next() {
                Seen::Scan(scan) => return *scan,
                Seen::Body(_) => {}
                Seen::End => panic!("no scan"),
            }
        }
    }

    /// Every scan up to the end.
    fn scans_to_the_end(&mut self) -> Vec<LmdScandata> {
        let mut scans = Vec::new();
        loop {
            match self.next() {
                Seen::Scan(scan) => scans.push(*scan),
                Seen::Body(_) => {}
                Seen::End => return scans,
            }
        }
    }
}

/// A platform that rests in one pose after the other for longer than any test.
const LONG: &str = "-f frame.toml --trajectory random --n-scans 1000000 --serve 127.0.0.1:0";

fn number_before(said: &str, words: &str) -> u64 {
    let (before, _) = said
        .split_once(words)
        .unwrap_or_else(|| panic!("{words}: {said}"));
    let number = before.rsplit([' ', '(']).next().unwrap();
    number
        .parse()
        .unwrap_or_else(|_| panic!("{number}: {said}"))
}

#[test]
fn several_clients_in_both_dialects_and_a_signal() {
    let dir = scratch("emulator-clients");
    let served = Served::start(&dir, LONG);
    let mut binary = served.client();
    let mut text = served.client();
    text.dialect = Dialect::Text;
    assert_eq!(text.ask(b"sRN SCdevicestate"), b"sRA SCdevicestate 1");
    assert_eq!(binary.ask(b"sRN SCdevicestate"), b"sRA SCdevicestate \x01");
    binary.start();
    assert_eq!(text.ask(b"sEN LMDscandata 1"), b"sEA LMDscandata 1");
    let (one, other) = (binary.scan(), text.scan());
    assert_eq!(one.channels[0].values.len(), 761);
    assert_eq!(other.channels.len(), 2);
    // The same scan for both, and one after the other.
    let mut scans = vec![one];
    while scans.last().unwrap().scan_counter < other.scan_counter {
        scans.push(binary.scan());
    }
    while scans.len() < 5 {
        scans.push(binary.scan());
    }
    let same = scans
        .iter()
        .find(|scan| scan.scan_counter == other.scan_counter);
    if let Some(same) = same {
        assert_eq!(same.channels, other.channels);
    }
    for pair in scans.windows(2) {
        assert_eq!(pair[1].scan_counter, pair[0].scan_counter + 1);
        let period_us = pair[1].scan_tick_us - pair[0].scan_tick_us;
        assert!((28_560..=28_580).contains(&period_us), "{period_us}");
    }
    served.signal("TERM");
    // Both connections end in order.
    binary.scans_to_the_end();
    text.scans_to_the_end();
    assert_eq!((binary.skipped, text.skipped), (0, 0));
    assert_eq!(served.end(), (0, String::new()));
}

/// Replays the recording of 20 scans 500 times as fast as can be.
fn replay(dir: &Path, faults: &str) -> (Vec<LmdScandata>, u64, String) {
    std::fs::copy(testdata("lms511.cola"), dir.join("run.cola")).unwrap();
    let args = format!(
        "--replay run.cola --repeat 500 --serve 127.0.0.1:0 --hold --speed max -v --faults {faults}"
    );
    let served = Served::start(dir, &args);
    let mut client = served.client();
    client.start();
    let scans = client.scans_to_the_end();
    let skipped = client.skipped;
    drop(client);
    let (status, said) = served.end();
    assert_eq!(status, 0, "{said}");
    (scans, skipped, said)
}

#[test]
fn nothing_is_lost_in_small_pieces_with_garbage_between() {
    let dir = scratch("emulator-chunks");
    for chunk in ["1..7", "1448", "1..65536"] {
        let (scans, skipped, said) = replay(&dir, &format!("garbage=0.2,chunk={chunk}"));
        assert_eq!(scans.len(), 10_000, "{said}");
        let garbage = number_before(&said, " bytes of garbage");
        assert!(garbage > 10_000);
        // Ends of line before anything else are no damage to the framer.
        assert!(skipped <= garbage && skipped > garbage - garbage / 50);
        for (number, pair) in scans.windows(2).enumerate() {
            assert_eq!(pair[1].scan_counter, pair[0].scan_counter.wrapping_add(1));
            assert_eq!(
                pair[1].telegram_counter,
                pair[0].telegram_counter.wrapping_add(1)
            );
            // 20 ms of a device that is replayed over its seams.
            let period_us = pair[1].scan_tick_us.wrapping_sub(pair[0].scan_tick_us);
            assert!(
                (19_900..=20_100).contains(&period_us),
                "{number}: {period_us}"
            );
            // The recording comes again after 20 scans.
            if let Some(again) = scans.get(number + 20) {
                assert_eq!(again.channels, pair[0].channels);
            }
        }
    }
}

#[test]
fn every_loss_on_purpose_is_counted() {
    let dir = scratch("emulator-losses");
    let (scans, _, said) = replay(&dir, "drop=0.02,flip=0.02,repeat=0.02");
    let (lost, twice) = (
        number_before(&said, " lost on purpose"),
        number_before(&said, " sent twice"),
    );
    assert!(lost > 300 && twice > 100, "{said}");
    assert_eq!(scans.len() as u64, 10_000 - lost + twice, "{said}");
    assert_eq!(number_before(&said, " lost by slow clients"), 0);
    let gaps: u16 = scans
        .windows(2)
        .map(|pair| pair[1].scan_counter.wrapping_sub(pair[0].scan_counter))
        .map(|step| step.saturating_sub(1))
        .sum();
    let ends = u64::from(scans[0].scan_counter - 1) + 10_000
        - u64::from(scans.last().unwrap().scan_counter);
    assert_eq!(u64::from(gaps) + ends, lost);
}

#[test]
fn a_slow_client_loses_scans_and_holds_up_nobody() {
    let dir = scratch("emulator-slow");
    std::fs::copy(testdata("lms511.cola"), dir.join("run.cola")).unwrap();
    let served = Served::start(
        &dir,
        "--replay run.cola --repeat 0 --serve 127.0.0.1:0 --speed 400 -v",
    );
    let mut slow = served.client();
    slow.start();
    let mut quick = served.client();
    quick.start();
    // 40 000 telegrams are more than the kernel and the emulator keep for one client.
    let first = quick.scan();
    let mut made = 0u64;
    let mut last = first.scan_counter;
    while made < 40_000 {
        let scan = quick.scan();
        made += u64::from(scan.scan_counter.wrapping_sub(last));
        last = scan.scan_counter;
    }
    served.signal("INT");
    drop((slow, quick));
    let (status, said) = served.end();
    assert_eq!(status, 0);
    assert!(
        number_before(&said, " lost by slow clients") > 1000,
        "{said}"
    );
}

/// The poses of a run: everything but the stamps.
fn poses(dir: &Path, scans: &str) -> Vec<String> {
    let line =
        format!("extract-lines -f frame.toml {scans} | solve-pose -f frame.toml > poses.csv");
    sh(dir, &line).expect(0);
    let columns = ["seq", "x_m", "y_m", "z_m", "roll_rad", "yaw_rad", "status"];
    let ended = sh(dir, "cat poses.csv").expect(0);
    let columns = columns.map(|name| ended.column(name));
    let rows = columns[0].len();
    let row = |row: usize| {
        columns
            .iter()
            .map(|column| &*column[row])
            .collect::<Vec<_>>()
            .join(",")
    };
    (0..rows).map(row).collect()
}

/// The same poses, to a micrometre and a microradian: the device counts whole microseconds, by which
/// the motion inside a scan is known.
fn same_poses(live: &[String], file: &[String]) {
    assert_eq!(live.len(), file.len());
    for (live, file) in live.iter().zip(file) {
        for (a, b) in live.split(',').zip(file.split(',')) {
            let same = match (a.parse::<f64>(), b.parse::<f64>()) {
                (Ok(a), Ok(b)) => (a - b).abs() < 1e-6,
                _ => a == b,
            };
            assert!(same, "{live} {file}");
        }
    }
}

#[test]
fn a_held_course_gives_the_poses_of_the_file() {
    let dir = scratch("emulator-poses");
    let course = "-f frame.toml --trajectory line --from-pose 0,-1,2 --to-pose 0,1,2 \
                  --effects reference,motion --n-scans 40";
    sh(&dir, &format!("simulate {course} -o file.csv")).expect(0);
    let served = Served::start(
        &dir,
        &format!("{course} --serve 127.0.0.1:0 --hold --truth truth.csv"),
    );
    let mut client = served.client();
    client.start();
    let mut recording = Vec::new();
    client.stream.read_to_end(&mut recording).unwrap();
    assert_eq!(served.end(), (0, String::new()));
    std::fs::write(dir.join("live.cola"), recording).unwrap();
    sh(&dir, "scan-capture -q --replay live.cola -o live.csv").expect(0);
    let from_file = poses(&dir, "file.csv");
    assert_eq!(from_file.len(), 40);
    same_poses(&poses(&dir, "live.csv"), &from_file);
    let truth = std::fs::read_to_string(dir.join("truth.csv")).unwrap();
    assert_eq!(truth.lines().count(), 41);
}

#[test]
fn live_scans_through_the_pipeline_give_the_poses_of_the_file() {
    let dir = scratch("emulator-live");
    let course = "-f frame.toml --trajectory line --from-pose 0,-1,2 --to-pose 0,1,2 \
                  --effects reference,motion --n-scans 40";
    sh(&dir, &format!("simulate {course} -o file.csv")).expect(0);
    let from_file = poses(&dir, "file.csv");
    for dialect in ["a", "b"] {
        let serve = "--serve 127.0.0.1:0 --hold --linger 60s --dialect";
        let served = Served::start(&dir, &format!("{course} {serve} {dialect}"));
        let place = &served.places[0];
        let capture = format!("scan-capture -q -f frame.toml -n 40 {place} -o live.csv");
        sh(&dir, &capture).expect(0);
        // Nobody is there any more, so that the linger is cut short.
        assert_eq!(served.end(), (0, String::new()));
        same_poses(&poses(&dir, "live.csv"), &from_file);
    }
}

#[test]
fn a_byte_stream_holds_what_the_records_hold() {
    let dir = scratch("emulator-cola");
    let run = "simulate -f frame.toml --n-scans 30 --effects reference,motion";
    sh(&dir, &format!("{run} -o records.csv")).expect(0);
    sh(&dir, &format!("{run} --format cola -o run.cola")).expect(0);
    sh(&dir, &format!("{run} --format cola > stdout.cola")).expect(0);
    let read = |name: &str| std::fs::read(dir.join(name)).unwrap();
    assert!(read("run.cola") == read("stdout.cola"));
    let records = sh(&dir, "cat records.csv").expect(0);
    for dialect in ["b", "a"] {
        sh(
            &dir,
            &format!("{run} --format cola --dialect {dialect} -o {dialect}.cola"),
        )
        .expect(0);
        let decoded = sh(&dir, &format!("scan-capture -q --replay {dialect}.cola")).expect(0);
        for column in ["ranges_mm", "remissions", "seq"] {
            assert_eq!(decoded.column(column), records.column(column), "{dialect}");
        }
    }
    let times = String::from_utf8(read("run.times.csv")).unwrap();
    // The header, the answer and a row a scan.
    assert_eq!(times.lines().count(), 32);
    let damaged = sh(
        &dir,
        &format!("{run} --format cola --faults drop=0.5 -v > d.cola"),
    )
    .expect(0);
    let lost = number_before(&damaged.stderr, " lost on purpose");
    assert!((5..=25).contains(&lost), "{}", damaged.stderr);
    let decoded = sh(&dir, "scan-capture -q --replay d.cola");
    assert_eq!(decoded.rows().len() as u64, 30 - lost);
}

#[test]
fn beams_between_the_grid_are_the_same_in_records_and_telegrams() {
    let dir = scratch("emulator-between");
    let run = "simulate -f frame.toml --frequency-hz 50 --resolution-deg 0.3333 --n-scans 5 \
               --effects reference";
    sh(&dir, &format!("{run} -o records.csv")).expect(0);
    sh(&dir, &format!("{run} --format cola -o run.cola")).expect(0);
    let records = sh(&dir, "cat records.csv").expect(0);
    let decoded = sh(&dir, "scan-capture -q --replay run.cola").expect(0);
    assert_eq!(decoded.column("ranges_mm"), records.column("ranges_mm"));
    let mut framer = Framer::new();
    framer.feed(&std::fs::read(dir.join("run.cola")).unwrap());
    let mut scans = 0;
    while let Some(event) = framer.next() {
        let mut scan = LmdScandata::default();
        if let Event::Telegram(telegram) = event
            && is_scan(&telegram)
        {
            scan.parse(&telegram).unwrap();
            // As a real LMS511 has it.
            let channel = &scan.channels[0];
            let head = (channel.start_angle, channel.angular_step);
            assert_eq!((head, channel.values.len()), ((-48_333, 3333), 570));
            scans += 1;
        }
    }
    assert_eq!(scans, 5);
}

/// A client that has asked for scans and was told that they come, however often it must try.
fn started(served: &Served) -> Client {
    let since = Instant::now();
    let request = b"\x02\x02\x02\x02\x00\x00\x00\x11sEN LMDscandata \x01\x33";
    loop {
        // A device that starts turns clients away.
        if let Ok(stream) = TcpStream::connect(&served.places[0]) {
            let mut client = Client::new(stream);
            let sent = client.stream.write_all(request).is_ok();
            if let (true, Seen::Body(body)) = (sent, client.next()) {
                assert_eq!(body, b"sEA LMDscandata \x01");
                return client;
            }
        }
        assert!(since.elapsed() < PATIENCE);
        std::thread::sleep(Duration::from_millis(10));
    }
}

#[test]
fn resets_reboots_and_dark_lines() {
    let dir = scratch("emulator-faults");
    let served = Served::start(&dir, &format!("{LONG} --faults reset@1s"));
    let mut client = started(&served);
    client.scans_to_the_end();
    started(&served).scan();

    // A client may ask for it: the connection ends, and the device starts again.
    let served = Served::start(&dir, &format!("{LONG} --boot 1s"));
    let mut client = started(&served);
    client.scan();
    client.scan();
    assert_eq!(
        client.ask(b"sMN SetAccessMode \x03\xf4\x72\x47\x44"),
        b"sAN SetAccessMode \x01"
    );
    assert_eq!(client.ask(b"sMN mSCreboot"), b"sAN mSCreboot ");
    client.scans_to_the_end();
    let scan = started(&served).scan();
    assert_eq!((scan.scan_counter, scan.device_status), (1, [1, 0]));

    // A dark line says nothing and then is dead.
    let served = Served::start(&dir, &format!("{LONG} --faults blackhole=1s@500ms -v"));
    let mut client = started(&served);
    client.scans_to_the_end();
    started(&served).scan();
    served.signal("TERM");
    let (status, said) = served.end();
    assert_eq!(status, 0);
    assert!(number_before(&said, " left out") > 10, "{said}");
}

#[test]
fn a_driver_that_reconnects_and_changes_the_frequency_finds_a_course_that_waits() {
    let dir = scratch("emulator-driver");
    // As the help has it for drivers.
    let recipe = "-f frame.toml --hold --trajectory loop --loops 1000 --serve 127.0.0.1:0";
    let served = Served::start(&dir, &format!("{recipe} --dialect a --settle 1500ms"));
    let mut client = served.client();
    client.dialect = Dialect::Text;
    let login = client.ask(b"sMN SetAccessMode 03 F4724744");
    assert_eq!(login, b"sAN SetAccessMode 1");
    assert_eq!(client.ask(b"sWN EIHstCola 1"), b"sWA EIHstCola");
    drop(client);
    let mut client = served.client();
    assert_eq!(
        client.ask(b"sMN SetAccessMode \x03\xf4\x72\x47\x44"),
        b"sAN SetAccessMode \x01"
    );
    client.start();
    let last = client.scan();
    assert_eq!((last.scan_counter, last.scan_frequency), (1, 3500));
    let mode = client
        .ask(b"sMN mLMPsetscancfg \0\0\x13\x88\0\x01\0\0\x13\x88\xff\xff\x3c\xb0\0\x1c\x3a\x90");
    assert!(mode.starts_with(b"sAN mLMPsetscancfg \0"));
    assert_eq!(client.ask(b"sMN Run"), b"sAN Run \x01");
    let first = loop {
        let scan = client.scan();
        if scan.scan_frequency == 5000 {
            break scan;
        }
    };
    // By the scanner's own clock, however late a loaded machine may be.
    let silent_us = first.scan_tick_us - last.transmit_tick_us;
    assert!(silent_us >= 1_500_000, "{silent_us}");
    drop(client);
    served.client().start();
    served.signal("TERM");
    assert_eq!(served.end(), (0, String::new()));
}

#[test]
fn a_serial_line_carries_what_its_speed_allows() {
    let dir = scratch("emulator-serial");
    let link = dir.join("lms");
    let args = "-f frame.toml --trajectory random --n-scans 1000000 --frequency-hz 50 \
                --resolution-deg 0.5 --serve-pty lms --baud 500000";
    let served = Served::start(&dir, args);
    assert_eq!(served.places, ["lms"]);
    let endpoint = Endpoint::Serial(link.clone());
    let mut line = Connection::open(&endpoint, 0, 500_000, PATIENCE).unwrap();
    let mut bytes = Vec::new();
    frame(Dialect::Binary, b"sRN FirmwareVersion", &mut bytes);
    frame(Dialect::Binary, b"sEN LMDscandata \x01", &mut bytes);
    line.write_all(&bytes, PATIENCE).unwrap();
    let mut framer = Framer::new();
    let (mut scans, mut replies) = (Vec::new(), 0);
    let since = Instant::now();
    while scans.len() < 20 {
        assert!(since.elapsed() < PATIENCE);
        let mut chunk = [0; 4096];
        if let Some(received) = line.read(&mut chunk, Duration::from_secs(1)).unwrap() {
            framer.feed(&chunk[..received.bytes]);
        }
        while let Some(event) = framer.next() {
            match event {
                Event::Telegram(telegram) if is_scan(&telegram) => {
                    let mut scan = LmdScandata::default();
                    scan.parse(&telegram).unwrap();
                    scans.push(scan);
                }
                Event::Telegram(_) => replies += 1,
                Event::Skipped(skipped) => panic!("{skipped:?}"),
            }
        }
    }
    assert_eq!(replies, 2);
    assert_eq!(scans[0].channels[0].values.len(), 381);
    served.signal("TERM");
    assert_eq!(served.end().0, 0);
    // Whoever looks for it finds nothing.
    assert!(link.symlink_metadata().is_err());
}

#[test]
fn what_does_not_go_together_is_refused() {
    let dir = scratch("emulator-refusals");
    std::fs::copy(testdata("lms511.cola"), dir.join("run.cola")).unwrap();
    std::fs::write(dir.join("none.cola"), b"nothing").unwrap();
    let frame = "-f frame.toml";
    for (args, status, word) in [
        ("--serve 127.0.0.1:0", 2, "--frame"),
        ("-f frame.toml --serve 127.0.0.1:0 --from +1s", 2, "--from"),
        (
            "-f frame.toml --serve 127.0.0.1:0 --uptime-s -1",
            2,
            "power-on",
        ),
        (
            "-f frame.toml --serve 127.0.0.1:0 --clock-ppm nan",
            2,
            "100000",
        ),
        ("-f frame.toml --format cola --faults chunk=3", 2, "chunks"),
        ("-f frame.toml --hold", 2, "--hold belongs to --serve"),
        (
            "-f frame.toml --format cola --settle 1s",
            2,
            "--settle belongs",
        ),
        ("-f frame.toml --clock-ppm 20", 2, "--format cola"),
        (
            "-f frame.toml --format cola --speed max",
            2,
            "--speed belongs",
        ),
        (
            "-f frame.toml --format cola --faults reset@1s",
            2,
            "set times",
        ),
        ("-f frame.toml --serve 127.0.0.1:0 -o x.csv", 2, "--serve"),
        (
            "-f frame.toml --serve 127.0.0.1:0 --format mcap",
            2,
            "--serve",
        ),
        (
            "-f frame.toml --serve 127.0.0.1:0 --real-time",
            2,
            "--real-time",
        ),
        ("-f frame.toml --serve nowhere", 2, "127.0.0.1:2112"),
        ("-f frame.toml --serve 127.0.0.1:0 --speed 0", 2, "max"),
        (
            "-f frame.toml --serve 127.0.0.1:0 --faults drop=2",
            2,
            "SHARE",
        ),
        (
            "-f frame.toml --serve 127.0.0.1:0 --baud 9600",
            2,
            "--serve-pty",
        ),
        (
            "-f frame.toml --serve 127.0.0.1:0 --model lms200",
            2,
            "LMS5xx",
        ),
        (
            "-f frame.toml --serve 203.0.113.1:2112",
            69,
            "203.0.113.1:2112",
        ),
        ("--replay run.cola", 2, "--serve"),
        (
            "--replay run.cola --serve 127.0.0.1:0 --effects none",
            2,
            "--effects",
        ),
        (
            "--replay run.cola --serve 127.0.0.1:0 --frequency-hz 50",
            2,
            "--frequency-hz",
        ),
        (
            "-f frame.toml --replay run.cola --serve 127.0.0.1:0",
            2,
            "cannot be used with",
        ),
        ("--replay none.cola --serve 127.0.0.1:0", 65, "none.cola"),
        (
            "--replay missing.cola --serve 127.0.0.1:0",
            66,
            "missing.cola",
        ),
        ("-f frame.toml --serve-pty frame.toml", 69, "frame.toml"),
        ("-f frame.toml --format cobol", 2, "csv, mcap"),
    ] {
        let ended = sh(&dir, &format!("timeout 100 simulate {args}"));
        assert_eq!(ended.status, status, "{args}: {}", ended.stderr);
        assert!(ended.stderr.contains(word), "{args}: {}", ended.stderr);
        assert!(!ended.stderr.contains("os error"), "{}", ended.stderr);
    }
    let foreign = sh(
        &dir,
        &format!("extract-lines {frame} --format cola < run.cola"),
    );
    assert_eq!(foreign.status, 2);
}

#[test]
fn the_independent_client_accepts_it() {
    if Command::new("python3").arg("--version").output().is_err() {
        println!("skipped: no python3");
        return;
    }
    let dir = scratch("emulator-python");
    let script = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("interop/sick_client.py");
    let served = Served::start(&dir, LONG);
    for dialect in ["a", "b"] {
        let output = Command::new("python3")
            .arg(&script)
            .args([&served.places[0], "--dialect", dialect, "--seconds", "0.5"])
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{said}");
    }
}
