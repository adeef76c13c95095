//! The device as its clients see it, without lines and with a source that is known to the digit.

use super::*;
use crate::link::emulation::Message;
use crate::record::{Ranges, Scan};
use crate::sick::cola::{Telegram, frame, xor};
use proptest::prelude::*;
use std::path::PathBuf;

const LMS: &str = "lms511-hr";

/// Scan `n`, beam `b`, echo `e`: 1000 + n + b + 100 e mm, remission 10 + n + e.
struct Counting {
    number: i64,
    now_ns: i64,
    scans: i64,
    echoes: usize,
}

impl Source for Counting {
    fn next(
        &mut self,
        mode: ScanMode,
        measured: bool,
        telegram: &mut LmdScandata,
    ) -> Option<Revolution> {
        if self.number == self.scans {
            return None;
        }
        let period_ns = (1e9 / mode.frequency_hz) as i64;
        if measured {
            let place = self.number % i64::from(mode.interlace);
            let start_deg = -5.0 + place as f64 * mode.resolution_deg();
            let beams = ((185.0 - start_deg) / mode.step_deg() + 1e-9) as usize + 1;
            let ranges = |echo: usize| {
                let mm = |beam: usize| (1000 + self.number as usize + beam + 100 * echo) as f64;
                let mut ranges = Ranges::default();
                ranges.extend((0..beams).map(|beam| mm(beam) / 1000.0));
                ranges
            };
            let remissions = |echo: usize| vec![(10 + self.number as usize + echo) as f32; beams];
            let scan = Scan {
                angle_min_rad: start_deg.to_radians(),
                angle_increment_rad: mode.step_rad(),
                ranges_m: ranges(0),
                remissions: remissions(0),
                further_ranges_m: (1..self.echoes).map(ranges).collect(),
                further_remissions: (1..self.echoes).map(remissions).collect(),
                ..Scan::default()
            };
            fill(&scan, telegram);
        }
        let index_ns = self.now_ns;
        self.now_ns += period_ns;
        self.number += 1;
        Some(Revolution {
            index_ns,
            end_ns: index_ns + period_ns / 2,
            transmit_after_ns: None,
        })
    }
}

fn behaviour() -> Behaviour {
    let model = ScannerModel::by_name(LMS).unwrap();
    Behaviour {
        identity: Identity::default(),
        model,
        mode: model.mode(25.0, 0.1667).unwrap(),
        speech: vec![Speech::Both],
        boot: Duration::ZERO,
        reboot: Duration::from_secs(3),
        settle: Duration::from_millis(500),
        hold: false,
        linger: Duration::ZERO,
        clock_ppm: 0.0,
        calendar_ns: None,
        uptime: Duration::ZERO,
        transmit_stamp: TransmitStamp::Send,
    }
}

/// A device, one client (line 1) and the time.
struct Bench {
    device: Emulator<Counting>,
    out: Outbox,
    now_ns: i64,
    dialect: Dialect,
}

impl Bench {
    fn new(behaviour: Behaviour, echoes: usize) -> Bench {
        let source = Counting {
            number: 0,
            now_ns: 0,
            scans: 100_000,
            echoes,
        };
        let mut device = Emulator::new(behaviour, source);
        device.connected(1, 0, 0);
        let mut bench = Bench {
            device,
            out: Outbox::default(),
            now_ns: 0,
            dialect: Dialect::Text,
        };
        bench.device.advance(0, &mut bench.out);
        bench
    }

    fn lms() -> Bench {
        Bench::new(behaviour(), 2)
    }

    fn logged_in() -> Bench {
        let mut bench = Bench::lms();
        bench.log_in();
        bench
    }

    fn log_in(&mut self) {
        assert_eq!(
            self.ask("sMN SetAccessMode 03 F4724744"),
            "sAN SetAccessMode 1"
        );
    }

    /// Sends a telegram; every body that came back at once.
    fn send(&mut self, body: &[u8]) -> Vec<Vec<u8>> {
        self.send_from(1, body)
    }

    fn send_from(&mut self, line: LineId, body: &[u8]) -> Vec<Vec<u8>> {
        let mut bytes = Vec::new();
        frame(self.dialect, body, &mut bytes);
        self.device.input(line, &bytes, self.now_ns, &mut self.out);
        self.out
            .take()
            .iter()
            .map(|(_, _, sent)| body_of(sent))
            .collect()
    }

    /// Sends text and gets the one answer.
    fn ask(&mut self, text: &str) -> String {
        let answers = self.send(text.as_bytes());
        assert_eq!(answers.len(), 1, "{text}");
        String::from_utf8(answers.into_iter().next().unwrap()).unwrap()
    }

    /// Lets time pass; every scan that came on line 1, with its true time.
    fn wait(&mut self, for_ms: i64) -> Vec<(i64, LmdScandata)> {
        let until_ns = self.now_ns + for_ms * 1_000_000;
        let mut scans = Vec::new();
        loop {
            self.device.prepare();
            match self.device.due_ns() {
                Some(due_ns) if due_ns <= until_ns => self.now_ns = due_ns.max(self.now_ns),
                _ => break,
            }
            self.device.advance(self.now_ns, &mut self.out);
            for (line, what, bytes) in self.out.take() {
                if line == 1 && what != Message::Reply {
                    scans.push((self.now_ns, scan_of(&bytes)));
                }
            }
        }
        self.now_ns = until_ns;
        scans
    }
}

fn body_of(frame: &[u8]) -> Vec<u8> {
    match frame {
        [2, 2, 2, 2, _, _, _, _, body @ .., check] => {
            assert_eq!(xor(body), *check);
            body.to_vec()
        }
        [2, body @ .., 3] => body.to_vec(),
        _ => panic!("no frame: {frame:?}"),
    }
}

fn scan_of(frame: &[u8]) -> LmdScandata {
    let dialect = if frame.starts_with(&[2, 2]) {
        Dialect::Binary
    } else {
        Dialect::Text
    };
    let body = body_of(frame);
    let mut scan = LmdScandata::default();
    let telegram = Telegram {
        dialect,
        offset: 0,
        body: &body,
    };
    scan.parse(&telegram).unwrap();
    assert_eq!(scan.surplus, 0);
    scan
}

fn values<'a>(scan: &'a LmdScandata, name: &[u8; 5]) -> &'a [u16] {
    &scan.channel(name).unwrap().values
}

#[test]
fn a_recorded_session_is_answered_as_the_recorded_lms511_did() {
    let Some(data) = recordings() else {
        return;
    };
    let bodies = |name: &str| {
        let bytes = std::fs::read(data.join(name)).unwrap();
        let mut framer = Framer::new();
        framer.feed(&bytes);
        framer.end();
        let mut bodies = Vec::new();
        while let Some(event) = framer.next() {
            if let Event::Telegram(telegram) = event {
                bodies.push(telegram.body.to_vec());
            }
        }
        bodies
    };
    let requests = bodies("20210302_lms511.host.cola");
    let recorded = bodies("20210302_lms511.cola");
    let is_event = |body: &&Vec<u8>| body.starts_with(b"sSN ");
    let due: Vec<_> = recorded.iter().filter(|body| !is_event(body)).collect();
    assert_eq!((requests.len(), due.len()), (49, 49));
    let mut bench = Bench::lms();
    bench.dialect = Dialect::Binary;
    bench.now_ns = 3_000_000_000;
    let mut events = 0;
    for (request, due) in requests.iter().zip(due) {
        let mut answers = bench.send(request);
        let name = String::from_utf8_lossy(request).into_owned();
        events += answers.len() - 1;
        let answer = answers.remove(0);
        let is_defined = |n: u32| name == format!("sRN field{n:03}");
        if (0..10).any(is_defined) {
            // That unit had fields defined; this one has none.
            assert_eq!(answer.get(..13), due.get(..13), "{name}");
        } else if name == "sRN LIDinputstate" {
            // Counter and calendar are what the time is; the date is that of an unset clock.
            assert_eq!(
                (answer.len(), &answer[..20]),
                (due.len(), &due[..20]),
                "{name}"
            );
            assert_eq!(answer[24..34], due[24..34], "{name}");
        } else {
            assert_eq!(&answer, due, "{name}");
        }
    }
    // Two events came with the subscription, of the recorded length.
    let event = recorded
        .iter()
        .find(|body| body.starts_with(b"sSN LIDoutputstate"));
    assert_eq!(events, 2);
    let ours = bench.send(b"sEN LIDoutputstate \x01");
    assert_eq!(ours[1].len(), event.unwrap().len());
    assert_eq!(ours[1][..20], event.unwrap()[..20]);
    // The scans have the recorded length and layout.
    let theirs = recorded
        .iter()
        .find(|body| body.starts_with(b"sSN LMDscandata"));
    let telegram = Telegram {
        dialect: Dialect::Binary,
        offset: 0,
        body: theirs.unwrap(),
    };
    let mut theirs = LmdScandata::default();
    theirs.parse(&telegram).unwrap();
    let (_, ours) = bench.wait(200).pop().unwrap();
    let shape = |scan: &LmdScandata| {
        let channels = scan.channels.iter();
        let channels: Vec<_> = channels
            .map(|c| {
                (
                    c.name,
                    c.width,
                    c.scale,
                    c.start_angle,
                    c.angular_step,
                    c.values.len(),
                )
            })
            .collect();
        let fixed = (
            scan.version,
            scan.device_number,
            scan.serial_number,
            scan.outputs,
        );
        let rates = (scan.scan_frequency, scan.measurement_frequency);
        (
            channels,
            fixed,
            rates,
            scan.time.is_some(),
            scan.encoders.len(),
        )
    };
    assert_eq!(shape(&ours), shape(&theirs));
}

/// Where recordings of real devices are; none, and it is said, where they are not.
fn recordings() -> Option<PathBuf> {
    let beside = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    let data = std::env::var_os("CABLEPOSE_DATA").map_or(beside, PathBuf::from);
    let data = data.join("lms5xx");
    if data.join("20210302_lms511.cola").exists() {
        return Some(data);
    }
    println!("skipped: no recordings in {}", data.display());
    None
}

#[test]
fn who_is_not_logged_in_may_read_and_listen_but_not_change() {
    let mut bench = Bench::lms();
    let asked = [
        ("sRN FirmwareVersion", "sRA FirmwareVersion 9 V1.80    "),
        ("sRN SerialNumber", "sRA SerialNumber 8 18110550"),
        (
            "sRN DeviceIdent",
            "sRA DeviceIdent 10 LMS511-10100 PRO 10 V1.80 (emulated)",
        ),
        ("sRN SCdevicestate", "sRA SCdevicestate 1"),
        ("sRN LCMstate", "sRA LCMstate 0"),
        ("sRN LMPscancfg", "sRA LMPscancfg 9C4 1 683 FFFF3CB0 1C3A90"),
        (
            "sRN LMPoutputRange",
            "sRA LMPoutputRange 1 683 FFFF3CB0 1C3A90",
        ),
        ("sRN STlms", "sRA STlms 7 0 8 00:00:00 A 01.01.1970 0 0 0"),
        ("sRN TSCTCmaxoffset", "sRA TSCTCmaxoffset 00000000"),
        ("sWN FREchoFilter 1", "sFA A"),
        ("sWN FirmwareVersion 1", "sFA A"),
        ("sMN LMCstopmeas", "sFA 1"),
        ("sMN mEEwriteall", "sFA 1"),
        ("sMN mSCreboot", "sFA 1"),
        ("sMN LSPsetdatetime 7E9 1 1 0 0 0 0", "sFA 1"),
        ("sMN mNonsense", "sFA 2"),
        ("sRN Nonsense", "sFA 3"),
        ("sWN Nonsense 1", "sFA 3"),
        ("sEN Nonsense 1", "sFA F"),
        ("sEN LMDscandata 2", "sFA 4"),
        ("sEN LMDscandata", "sFA 8"),
        ("sEN LMDscandata 1 1", "sFA 5"),
        ("sEN LMDscandata x", "sFA 11"),
        ("sEN LMDscandata 100", "sFA 10"),
        ("sRA LMPscancfg", "sFA C"),
        ("sMN SetAccessMode 03 DEADBEEF", "sAN SetAccessMode 0"),
        ("sMN SetAccessMode 09 F4724744", "sAN SetAccessMode 0"),
        ("sMN CheckPassword 3 F4724744", "sAN CheckPassword 1"),
        ("sMN Run", "sAN Run 1"),
    ];
    for (request, answer) in asked {
        assert_eq!(bench.ask(request), answer, "{request}");
    }
    bench.log_in();
    assert_eq!(bench.ask("sRN SCdevicestate"), "sRA SCdevicestate 0");
    assert_eq!(bench.ask("sWN FREchoFilter 1"), "sWA FREchoFilter");
    assert_eq!(bench.ask("sWN FREchoFilter 3"), "sFA 4");
    assert_eq!(bench.ask("sWN FREchoFilter"), "sFA 8");
    assert_eq!(bench.ask("sMN mEEwriteall"), "sAN mEEwriteall 1");
    assert_eq!(bench.ask("sMN SetPassword 3 12345678"), "sAN SetPassword 1");
    assert_eq!(bench.ask("sMN Run"), "sAN Run 1");
    // Logged out, and the password is another.
    assert_eq!(bench.ask("sWN FREchoFilter 0"), "sFA A");
    assert_eq!(
        bench.ask("sMN SetAccessMode 3 F4724744"),
        "sAN SetAccessMode 0"
    );
    assert_eq!(
        bench.ask("sMN SetAccessMode 3 12345678"),
        "sAN SetAccessMode 1"
    );
    bench.dialect = Dialect::Binary;
    assert_eq!(bench.send(b"sMN mNonsense"), [b"sFA\x00\x02"]);
    assert_eq!(
        bench.send(b"sRN STlms")[0][..13],
        *b"sRA STlms \x00\x07\x00"
    );
}

#[test]
fn a_port_may_know_one_dialect_only() {
    let mut bench = Bench::new(
        Behaviour {
            speech: vec![Speech::Text, Speech::Binary],
            ..behaviour()
        },
        1,
    );
    bench.device.connected(2, 1, 0);
    assert_eq!(bench.ask("sRN SCdevicestate"), "sRA SCdevicestate 1");
    assert!(bench.send_from(2, b"sRN SCdevicestate").is_empty());
    bench.dialect = Dialect::Binary;
    assert_eq!(bench.send(b"sRN SCdevicestate"), [b"sFA 11"]);
    assert_eq!(
        bench.send_from(2, b"sRN SCdevicestate"),
        [b"sRA SCdevicestate \x01"]
    );
}

#[test]
fn what_is_written_reads_back_and_becomes_active_with_run() {
    let mut bench = Bench::logged_in();
    assert_eq!(bench.ask("sEN LMDscandata 1"), "sEA LMDscandata 1");
    let scans = bench.wait(1000);
    assert_eq!(scans.len(), 24);
    let scancfg = "sMN mLMPsetscancfg +5000 +1 +5000 -50000 +1850000";
    assert_eq!(
        bench.ask(scancfg),
        "sAN mLMPsetscancfg 0 1388 1 1388 FFFF3CB0 1C3A90"
    );
    let refused = bench.ask("sMN mLMPsetscancfg +3500 +1 +1667 -50000 +1850000");
    assert_eq!(refused, "sAN mLMPsetscancfg 3 1388 1 1388 FFFF3CB0 1C3A90");
    bench.ask("sWN LMPoutputRange 1 1388 +450000 +1350000");
    bench.ask("sWN LMDscandatacfg 01 00 0 0 0 01 00 1 1 1 0 +2");
    let configuration = "sRA LMDscandatacfg 1 0 0 0 0 1 0 1 1 1 0 2";
    assert_eq!(bench.ask("sRN LMDscandatacfg"), configuration);
    // Not yet: the old mode goes on.
    let scans = bench.wait(1000);
    assert_eq!((scans.len(), scans[0].1.scan_frequency), (25, 2500));
    assert_eq!(bench.ask("sMN Run"), "sAN Run 1");
    assert_eq!(bench.ask("sRN STlms")[..11], *"sRA STlms 5");
    // Half a second of silence, then every second scan of 50 Hz.
    let scans = bench.wait(1500);
    assert!((24..=25).contains(&scans.len()), "{}", scans.len());
    assert_eq!(bench.ask("sRN STlms")[..11], *"sRA STlms 7");
    for pair in scans.windows(2) {
        let [(before_ns, before), (after_ns, after)] = pair else {
            unreachable!()
        };
        assert_eq!(after_ns - before_ns, 40_000_000);
        assert_eq!(after.scan_counter - before.scan_counter, 2);
        assert_eq!(after.telegram_counter - before.telegram_counter, 1);
    }
    let (_, scan) = &scans[0];
    assert_eq!(
        (scan.scan_frequency, scan.measurement_frequency),
        (5000, 360)
    );
    let names: Vec<_> = scan.channels.iter().map(|c| c.name).collect();
    assert_eq!(names, [*b"DIST1"]);
    assert_eq!(scan.channels[0].start_angle, 450_000);
    assert_eq!(scan.channels[0].angular_step, 5000);
    assert_eq!(values(scan, b"DIST1").len(), 181);
    // Beam 100 of the aperture is the first inside.
    let first = values(scan, b"DIST1");
    assert_eq!(first[1] - first[0], 1);
    assert_eq!(scan.encoders.len(), 1);
    assert!(scan.position.is_some() && scan.time.is_none());
    assert_eq!(
        (&*scan.device_name, &*scan.comment),
        ("SN 18110550", "emulated")
    );
}

#[test]
fn an_output_range_that_no_run_made_active_is_lost_with_the_next_mode() {
    let mut bench = Bench::logged_in();
    bench.ask("sWN LMPoutputRange 1 683 +0 +900000");
    assert_eq!(
        bench.ask("sRN LMPoutputRange"),
        "sRA LMPoutputRange 1 683 0 DBBA0"
    );
    bench.ask("sMN mLMPsetscancfg +2500 +1 +2500 -50000 +1850000");
    let whole = "sRA LMPoutputRange 1 9C4 FFFF3CB0 1C3A90";
    assert_eq!(bench.ask("sRN LMPoutputRange"), whole);
    // The order that the LMS511 wants.
    bench.ask("sWN LMPoutputRange 1 683 +0 +900000");
    bench.ask("sMN Run");
    bench.log_in();
    bench.ask("sMN mLMPsetscancfg +2500 +1 +1667 -50000 +1850000");
    bench.ask("sMN Run");
    assert_eq!(
        bench.ask("sRN LMPoutputRange"),
        "sRA LMPoutputRange 1 683 0 DBBA0"
    );
    bench.ask("sEN LMDscandata 1");
    let scans = bench.wait(2000);
    let (_, scan) = scans.last().unwrap();
    assert_eq!(values(scan, b"DIST1").len(), 541);
    assert_eq!(scan.channels[0].start_angle, 0);
    // Beam 30 of the aperture.
    let number = u16::from(scan.channels[1].values[0]) - 11;
    assert_eq!(values(scan, b"DIST1")[0], 1000 + number + 30 + 100);
}

#[test]
fn echoes_and_remissions() {
    let scan_with = |filter: &str, contents: &str| {
        let mut bench = Bench::logged_in();
        bench.ask(&format!("sWN FREchoFilter {filter}"));
        bench.ask(&format!("sWN LMDscandatacfg {contents}"));
        bench.ask("sMN Run");
        bench.ask("sEN LMDscandata 1");
        bench.wait(100).remove(0).1
    };
    let with = "01 00 1 0 0 00 00 0 0 0 1 +1";
    let names = |scan: &LmdScandata| {
        let names = scan
            .channels
            .iter()
            .map(|c| String::from_utf8(c.name.to_vec()).unwrap());
        names.collect::<Vec<_>>().join(" ")
    };
    let first = scan_with("0", with);
    assert_eq!(names(&first), "DIST1 RSSI1");
    assert_eq!(values(&first, b"DIST1")[..2], [1000, 1001]);
    assert_eq!(values(&first, b"RSSI1")[0], 10);
    // Two echoes came: the last is the second.
    let last = scan_with("2", with);
    assert_eq!(names(&last), "DIST1 RSSI1");
    assert_eq!(values(&last, b"DIST1")[..2], [1100, 1101]);
    assert_eq!(values(&last, b"RSSI1")[0], 11);
    let all = scan_with("1", with);
    let due = "DIST1 DIST2 DIST3 DIST4 DIST5 RSSI1 RSSI2 RSSI3 RSSI4 RSSI5";
    assert_eq!(names(&all), due);
    assert_eq!(values(&all, b"DIST2")[0], 1100);
    assert!(values(&all, b"DIST3").iter().all(|value| *value == 0));
    assert_eq!(values(&all, b"RSSI5").len(), 1141);
    let without = scan_with("1", "01 00 0 0 0 00 00 0 0 0 0 +1");
    assert_eq!(names(&without), "DIST1 DIST2 DIST3 DIST4 DIST5");
}

#[test]
fn the_mean_filter_averages_and_lowers_the_rate() {
    let mut bench = Bench::logged_in();
    bench.ask("sWN LFPmeanfilter 1 +4 0");
    bench.ask("sWN FREchoFilter 0");
    bench.ask("sMN Run");
    bench.ask("sEN LMDscandata 1");
    let scans = bench.wait(2000);
    assert_eq!(scans.len(), 12);
    for (n, (_, scan)) in scans.iter().enumerate() {
        // Scans 4 n .. 4 n + 3; their mean ends in .5 and is rounded up.
        assert_eq!(values(scan, b"DIST1")[0], 1002 + 4 * n as u16);
        assert_eq!(values(scan, b"RSSI1")[0], 12 + 4 * n as u16);
        assert_eq!(scan.scan_counter, 4 + 4 * n as u16);
    }
}

#[test]
fn interlaced_scans_start_one_resolution_apart() {
    let mut bench = Bench::logged_in();
    assert_eq!(
        bench.ask("sMN mCLsetscancfglist 11"),
        "sAN mCLsetscancfglist 1"
    );
    assert_eq!(
        bench.ask("sMN mCLsetscancfglist A"),
        "sAN mCLsetscancfglist 0"
    );
    bench.ask("sMN Run");
    bench.ask("sEN LMDscandata 1");
    let scans = bench.wait(1000);
    let starts: Vec<i32> = scans
        .iter()
        .map(|(_, s)| s.channels[0].start_angle)
        .collect();
    let steps: Vec<u16> = scans
        .iter()
        .map(|(_, s)| s.channels[0].angular_step)
        .collect();
    assert!(starts.len() > 20);
    assert!(steps.iter().all(|step| *step == 3333), "{steps:?}");
    for pair in starts.windows(2) {
        assert!(
            matches!(pair, [-50_000, -48_333] | [-48_333, -50_000]),
            "{pair:?}"
        );
    }
}

#[test]
fn stop_standby_and_polls() {
    let mut bench = Bench::logged_in();
    let scans = bench.wait(500);
    assert!(scans.is_empty());
    let polled = scan_of_poll(&mut bench);
    assert!(polled.polled);
    let again = scan_of_poll(&mut bench);
    assert_eq!(polled.scan_counter, again.scan_counter);
    assert_eq!(polled.telegram_counter + 1, again.telegram_counter);
    assert_eq!(bench.ask("sMN LMCstopmeas"), "sAN LMCstopmeas 0");
    assert_eq!(bench.ask("sRN STlms")[..11], *"sRA STlms 6");
    bench.ask("sEN LMDscandata 1");
    assert!(bench.wait(500).is_empty());
    // The last scan is still there.
    assert_eq!(scan_of_poll(&mut bench).scan_counter, polled.scan_counter);
    assert_eq!(bench.ask("sMN LMCstandby"), "sAN LMCstandby 0");
    bench.ask("sMN Run");
    assert_eq!(bench.ask("sRN SCdevicestate"), "sRA SCdevicestate 3");
    bench.log_in();
    assert_eq!(bench.ask("sMN LMCstartmeas"), "sAN LMCstartmeas 0");
    let scans = bench.wait(1000);
    assert!((11..=13).contains(&scans.len()), "{}", scans.len());
    // Counters run on; what was seen meanwhile is gone.
    assert_eq!(scans[0].1.scan_counter, polled.scan_counter + 1);
    let number = values(&scans[0].1, b"DIST1")[0];
    assert!(number > 1000 + 100 + 37, "{number}");
    bench.ask("sEN LMDscandata 0");
    assert!(bench.wait(500).is_empty());
}

fn scan_of_poll(bench: &mut Bench) -> LmdScandata {
    let mut bytes = Vec::new();
    frame(bench.dialect, b"sRN LMDscandata", &mut bytes);
    bench.device.input(1, &bytes, bench.now_ns, &mut bench.out);
    let sent = bench.out.take();
    assert_eq!((sent.len(), sent[0].1), (1, Message::Polled));
    scan_of(&sent[0].2)
}

#[test]
fn a_held_course_begins_with_the_first_client_that_asks() {
    for request in ["sEN LMDscandata 1", "sRN LMDscandata"] {
        let held = Behaviour {
            hold: true,
            ..behaviour()
        };
        let mut bench = Bench::new(held, 1);
        assert!(bench.wait(10_000).is_empty());
        assert_eq!(bench.ask("sRN STlms")[..11], *"sRA STlms 7");
        bench.send(request.as_bytes());
        let scans = bench.wait(100);
        assert_eq!(values(&scans[0].1, b"DIST1")[0], 1000, "{request}");
        assert_eq!(scans[0].1.scan_counter, 1);
    }
}

#[test]
fn ticks_come_from_the_clock_and_wrap() {
    let stamped = |stamp, ppm| {
        let mut bench = Bench::new(
            Behaviour {
                uptime: Duration::from_micros(4_294_967_296 - 100_000),
                clock_ppm: ppm,
                transmit_stamp: stamp,
                ..behaviour()
            },
            1,
        );
        bench.ask("sEN LMDscandata 1");
        bench.wait(1000)
    };
    for (_, scan) in stamped(TransmitStamp::Send, 0.0) {
        // 0.95 periods and 3 ms after the zero index.
        let after_us = scan.transmit_tick_us.wrapping_sub(scan.scan_tick_us);
        assert_eq!(after_us, 41_000);
    }
    let scans = stamped(TransmitStamp::ScanEnd, 1000.0);
    let first = scans[0].1.scan_tick_us;
    assert_eq!(first, (4_294_967_296u64 - 100_000) as u32);
    let last = &scans.last().unwrap().1;
    assert!(last.scan_tick_us < first);
    let elapsed_us = last.scan_tick_us.wrapping_sub(first);
    assert_eq!(elapsed_us, (scans.len() as u32 - 1) * 40_040);
}

#[test]
fn a_poll_takes_its_time_of_transmission_when_it_is_answered_or_when_the_scan_was_complete() {
    for (stamp, due_us) in [
        (TransmitStamp::Send, 1_000_000),
        (TransmitStamp::ScanEnd, 961_000),
    ] {
        let mut bench = Bench::new(
            Behaviour {
                transmit_stamp: stamp,
                ..behaviour()
            },
            1,
        );
        bench.wait(1000);
        assert_eq!(scan_of_poll(&mut bench).transmit_tick_us, due_us);
    }
}

#[test]
fn the_calendar_is_set_with_1_ms_resolution() {
    let mut bench = Bench::logged_in();
    bench.ask("sEN LMDscandata 1");
    let year = |bench: &mut Bench| {
        let (_, scan) = bench.wait(100).remove(0);
        scan.time.unwrap()
    };
    assert_eq!(year(&mut bench).year, 1970);
    let set = "sMN LSPsetdatetime +2026 +11 +22 +8 +9 +10 +123456";
    assert_eq!(bench.ask(set), "sAN LSPsetdatetime 1");
    let set_ns = bench.now_ns;
    let (at_ns, scan) = bench.wait(100).remove(0);
    let time = scan.time.unwrap();
    assert_eq!(
        (time.year, time.month, time.day, time.hour, time.minute),
        (2026, 11, 22, 8, 9)
    );
    assert_eq!(time.microsecond % 1000, 0);
    let elapsed_us = (at_ns - set_ns) / 1000;
    let shown_us = i64::from(time.second) * 1_000_000 + i64::from(time.microsecond);
    assert_eq!(shown_us, (10_123_456 + elapsed_us) / 1000 * 1000);
    assert_eq!(
        bench.ask("sMN LSPsetdatetime +2026 +2 +30 +0 +0 +0 +0"),
        "sFA 4"
    );
    bench.ask("sWN TSCRole 1");
    assert_eq!(bench.ask("sWN TSCTCSrvAddr C0 A8 0 0B"), "sWA TSCTCSrvAddr");
    assert_eq!(bench.ask("sRN TSCTCSrvAddr"), "sRA TSCTCSrvAddr C0 A8 0 B");
    assert_eq!(
        bench.ask("sMN LSPsetdatetime 7E9 1 1 0 0 0 0"),
        "sAN LSPsetdatetime 0"
    );
    assert_eq!(year(&mut bench).year, 2026);
}

#[test]
fn a_reboot_keeps_what_was_saved_and_nothing_else() {
    let mut bench = Bench::logged_in();
    bench.ask("sEN LMDscandata 1");
    bench.wait(1000);
    bench.ask("sWN FREchoFilter 1");
    bench.ask("sMN mEEwriteall");
    bench.ask("sWN FREchoFilter 0");
    let now_ns = bench.now_ns;
    bench.device.restart(now_ns, Duration::from_secs(10));
    assert_eq!(bench.ask("sRN STlms")[..11], *"sRA STlms 1");
    assert_eq!(bench.ask("sRN FREchoFilter"), "sRA FREchoFilter 1");
    bench.log_in();
    assert_eq!(bench.ask("sWN LMPoutputRange 1 683 +0 +900000"), "sFA 4");
    assert_eq!(bench.ask("sMN LMCstartmeas"), "sAN LMCstartmeas 1");
    bench.ask("sEN LMDscandata 1");
    assert!(bench.wait(9_900).is_empty());
    assert_eq!(bench.ask("sRN STlms")[..11], *"sRA STlms 5");
    let scans = bench.wait(300);
    let (at_ns, scan) = &scans[0];
    assert_eq!((scan.scan_counter, scan.telegram_counter), (1, 1));
    assert_eq!(i64::from(scan.transmit_tick_us), (at_ns - now_ns) / 1000);
    assert_eq!(scan.device_status, [1, 0]);
    assert_eq!(scans[1].1.device_status, [0, 0]);
    assert_eq!(scan.channels.len(), 10);
    // A reboot that a client asks for saves everything.
    bench.ask("sWN FREchoFilter 0");
    let mut bytes = Vec::new();
    frame(Dialect::Text, b"sMN mSCreboot", &mut bytes);
    bench.device.input(1, &bytes, bench.now_ns, &mut bench.out);
    assert_eq!(bench.out.take().len(), 1);
    bench.device.restart(bench.now_ns, Duration::ZERO);
    bench.log_in();
    assert_eq!(bench.ask("sRN FREchoFilter"), "sRA FREchoFilter 0");
    assert_eq!(bench.ask("sMN mSCloadfacdef"), "sAN mSCloadfacdef 1");
    assert_eq!(bench.ask("sRN FREchoFilter"), "sRA FREchoFilter 2");
}

#[test]
fn it_ends_after_the_last_scan_and_the_linger() {
    let mut device = Emulator::new(
        Behaviour {
            linger: Duration::from_secs(5),
            ..behaviour()
        },
        Counting {
            number: 0,
            now_ns: 0,
            scans: 10,
            echoes: 1,
        },
    );
    device.connected(1, 0, 0);
    let mut out = Outbox::default();
    let mut now_ns = 0;
    while !device.ended() {
        now_ns = device.due_ns().unwrap().max(now_ns);
        device.advance(now_ns, &mut out);
    }
    assert_eq!(device.tally().scans, 10);
    // Ten periods, the transmission of the last and the linger.
    assert_eq!(now_ns, 9 * 40_000_000 + 41_000_000 + 5_000_000_000);
}

#[test]
fn pipelined_requests_are_all_answered_in_their_order() {
    let mut bench = Bench::lms();
    let mut bytes = Vec::new();
    for number in 0..200 {
        frame(
            Dialect::Text,
            format!("sRN field{:03}", number % 30).as_bytes(),
            &mut bytes,
        );
    }
    for chunk in bytes.chunks(7) {
        bench.device.input(1, chunk, 0, &mut bench.out);
    }
    let answers = bench.out.take();
    assert_eq!(answers.len(), 200);
    for (number, (_, _, answer)) in answers.iter().enumerate() {
        let due = format!("sRA field{:03} 0", number % 30);
        assert_eq!(body_of(answer), due.as_bytes());
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    /// Whatever comes, every answer is framed and nothing panics.
    #[test]
    fn any_bytes_are_answered_in_frames(
        bodies in prop::collection::vec(
            (any::<bool>(), prop::sample::select(REQUESTS), prop::collection::vec(any::<u8>(), 0..24)),
            0..12,
        ),
        noise in prop::collection::vec(any::<u8>(), 0..40),
    ) {
        let mut bench = Bench::lms();
        let mut bytes = noise;
        for (text, name, values) in bodies {
            let mut body = name.as_bytes().to_vec();
            body.push(b' ');
            body.extend(values);
            let dialect = if text { Dialect::Text } else { Dialect::Binary };
            frame(dialect, &body, &mut bytes);
        }
        for chunk in bytes.chunks(16) {
            bench.now_ns += 1_000_000;
            bench.device.input(1, chunk, bench.now_ns, &mut bench.out);
            bench.device.advance(bench.now_ns, &mut bench.out);
        }
        for (_, _, sent) in bench.out.take() {
            body_of(&sent);
        }
    }
}

const REQUESTS: &[&str] = &[
    "sMN SetAccessMode",
    "sMN mLMPsetscancfg",
    "sMN LSPsetdatetime",
    "sMN SetAccessMode 3 F4724744",
    "sMN Run",
    "sMN mCLsetscancfglist",
    "sMN LMCstopmeas",
    "sMN LMCstartmeas",
    "sWN LMDscandatacfg",
    "sWN LMPoutputRange",
    "sWN LocationName",
    "sWN LICencres",
    "sWN LFPmeanfilter",
    "sEN LMDscandata",
    "sEN LIDoutputstate",
    "sRN LMDscandata",
    "sRN STlms",
    "sXX",
    "",
];
