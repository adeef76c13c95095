//! The device as its clients see it, without lines and with a source that is known to the digit.

use super::*;
use crate::frame::ScannerModel;
use crate::link::emulation::Message;
use crate::record::{Ranges, Scan};
use crate::sick::cola::{Telegram, frame, xor};
use proptest::prelude::*;
use std::path::PathBuf;

mod recorded;
mod scans;

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
        host_dialect: Dialect::Binary,
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
        (
            "sRN STlms",
            "sRA STlms 7 0 8 00:00:00 A 01.01.1970 0 0 0 0 0 0",
        ),
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
            speech: vec![Speech::Text, Speech::Host],
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
    // Another dialect is one of the next connection.
    let asked: [&[u8]; 2] = [
        b"sMN SetAccessMode \x03\xf4\x72\x47\x44",
        b"sWN EIHstCola \x00",
    ];
    for request in asked {
        assert_eq!(bench.send_from(2, request).len(), 1);
    }
    assert_eq!(bench.send_from(2, b"sRN LCMstate"), [b"sRA LCMstate \x00"]);
    bench.device.disconnected(2);
    bench.device.connected(3, 1, 0);
    assert_eq!(bench.send_from(3, b"sRN LCMstate"), [b"sFA 11"]);
    // Nobody saved it: power-on brings the old one back, also to who stays on the line.
    bench.device.restart(bench.now_ns, Duration::ZERO);
    assert_eq!(bench.send_from(3, b"sRN LCMstate"), [b"sRA LCMstate \x00"]);
    for request in asked.iter().chain(&[&b"sMN mEEwriteall"[..]]) {
        assert_eq!(bench.send_from(3, request).len(), 1);
    }
    bench.device.restart(bench.now_ns, Duration::ZERO);
    assert_eq!(bench.send_from(3, b"sRN LCMstate"), [b"sFA 11"]);
    bench.dialect = Dialect::Text;
    assert_eq!(bench.send_from(3, b"sRN LCMstate"), [b"sRA LCMstate 0"]);
}

#[test]
fn a_driver_that_turns_the_host_port_to_cola_b_finds_it_on_its_next_connection() {
    let mut bench = Bench::new(
        Behaviour {
            speech: vec![Speech::Host],
            host_dialect: Dialect::Text,
            ..behaviour()
        },
        1,
    );
    bench.log_in();
    assert_eq!(bench.ask("sWN EIHstCola 1"), "sWA EIHstCola");
    assert_eq!(bench.ask("sRN LCMstate"), "sRA LCMstate 0");
    bench.device.disconnected(1);
    bench.device.connected(2, 0, bench.now_ns);
    assert!(bench.send_from(2, b"sRN LCMstate").is_empty());
    bench.dialect = Dialect::Binary;
    assert_eq!(bench.send_from(2, b"sRN LCMstate"), [b"sRA LCMstate \x00"]);
    // The framing with a CRC32 is not spoken, and so not accepted.
    bench.send_from(2, b"sMN SetAccessMode \x03\xf4\x72\x47\x44");
    assert_eq!(bench.send_from(2, b"sWN EIHstCola \x02"), [b"sFA\x00\x04"]);
    assert_eq!(
        bench.send_from(2, b"sRN EIHstCola"),
        [b"sRA EIHstCola \x01"]
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
fn inputs_and_outputs_say_when_they_changed_and_not_what_the_time_is() {
    let mut bench = Bench::logged_in();
    bench.wait(1500);
    let inputs = "sRA LIDinputstate 0 0 0 0 0 0 1 7B2 1 1 0 0 0 0";
    assert_eq!(bench.ask("sRN LIDinputstate"), inputs);
    bench.ask("sMN LSPsetdatetime +2026 +11 +22 +8 +9 +10 +0");
    assert_eq!(bench.ask("sRN LIDinputstate"), inputs);
    let outputs = bench.ask("sRN LIDoutputstate");
    assert!(outputs.starts_with("sRA LIDoutputstate 0 0 0 0 0 0 "));
    assert!(outputs.ends_with(" 1 7B2 1 1 0 0 0 0"), "{outputs}");
    // A calendar that was right from the start is counted back to power-on.
    let mut bench = Bench::new(
        Behaviour {
            calendar_ns: Some(1_767_225_600_000_000_000),
            uptime: Duration::from_secs(5),
            ..behaviour()
        },
        1,
    );
    assert_eq!(
        bench.ask("sRN LIDinputstate"),
        "sRA LIDinputstate 0 0 0 0 0 0 1 7E9 C 1F 17 3B 37 0"
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
    let number = scan.channels[1].values[0] - 11;
    assert_eq!(values(scan, b"DIST1")[0], 1000 + number + 30 + 100);
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
