//! scan-capture on recordings of real devices: an LMS511 and an LMS111 in CoLa B, six LMS5xx units
//! in CoLa A.
//!
//! The recordings lie outside the repository, in ../shared/data or where CABLEPOSE_DATA says;
//! without them these tests say so and pass. What needs no recording uses testdata/lms511.cola.

mod shell;

use cablepose::record::{Scan, Stamp};
use cablepose::sick::cola::{Event, Framer};
use cablepose::sick::replay::{Replay, Settings};
use cablepose::sick::scandata::{self, LmdScandata};
use shell::{recording, testdata};
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Every scan of a stream fed in chunks, and the number of telegrams; nothing may be skipped.
fn scans(stream: &[u8], chunk: usize) -> (Vec<Scan>, u64) {
    let mut framer = Framer::new();
    let mut telegram = LmdScandata::default();
    let mut replay = Replay::new(Settings::default());
    let mut scans = Vec::new();
    let mut take = |framer: &mut Framer| {
        while let Some(event) = framer.next() {
            let Event::Telegram(found) = event else {
                panic!("{event:?}");
            };
            if scandata::is_scan(&found) {
                telegram.parse(&found).unwrap();
                assert_eq!(telegram.surplus, 0);
                scans.extend(replay.push(&telegram, None).unwrap().cloned());
            }
        }
    };
    for chunk in stream.chunks(chunk) {
        framer.feed(chunk);
        take(&mut framer);
    }
    framer.end();
    take(&mut framer);
    (scans, framer.telegrams())
}

fn scan_capture(args: &[&str], path: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_scan-capture"))
        .args(args)
        .arg("--replay")
        .arg(path)
        .output()
        .unwrap()
}

fn scratch(name: &str) -> PathBuf {
    let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join("scan-capture");
    std::fs::create_dir_all(&dir).unwrap();
    dir.join(name)
}

#[test]
fn every_scan_of_the_lms511() {
    let Some(path) = recording("20210302_lms511.cola") else {
        return;
    };
    let stream = std::fs::read(path).unwrap();
    let (scans, telegrams) = scans(&stream, 1448);
    assert_eq!((scans.len(), telegrams), (174, 228));
    for (seq, scan) in scans.iter().enumerate() {
        assert_eq!(scan.seq as usize, seq);
        assert_eq!((scan.beams(), scan.remissions.len()), (1141, 1141));
        assert!((scan.angle_rad(0) - (-5f64).to_radians()).abs() < 1e-15);
        assert!((scan.angle_rad(1140) - 185f64.to_radians()).abs() < 1e-12);
        let info = scan.info.as_deref().unwrap();
        assert_eq!(info.serial_number, Some(18_110_550));
        assert_eq!(info.scan_counter, Some(54_484 + seq as u32));
        let delay_ns = info.transmit.unwrap() - scan.device.unwrap();
        assert!((40_000_000..41_500_000).contains(&delay_ns));
        assert!((scan.scan_time_s - 0.04).abs() < 0.0003);
        let per_beam_s = scan.angle_increment_rad / TAU * scan.scan_time_s;
        assert_eq!(scan.time_increment_s, per_beam_s);
    }
    // Mean period of the whole recording: 40000.6 us (measured apart).
    let span_s = scans[173].device.unwrap().since_s(scans[0].device.unwrap());
    assert!((span_s / 173.0 - 0.040_000_6).abs() < 1e-7);
}

#[test]
fn chunks_do_not_matter() {
    for name in ["20210302_lms511.cola", "lms5xx_ascii_samples.cola"] {
        let Some(path) = recording(name) else { return };
        let stream = std::fs::read(path).unwrap();
        let text = |chunk| format!("{:?}", scans(&stream, chunk)); // NaN equals NaN as text
        let whole = text(stream.len());
        for chunk in [1, 7, 1448, 1 << 16] {
            assert!(text(chunk) == whole, "{name} in chunks of {chunk}");
        }
    }
}

#[test]
fn the_lms111_repeats_three_telegrams() {
    let Some(path) = recording("20210302_lms111.cola") else {
        return;
    };
    let (scans, _) = scans(&std::fs::read(path).unwrap(), 1448);
    assert_eq!(scans.len(), 172);
    assert!(
        scans
            .iter()
            .enumerate()
            .all(|(seq, scan)| scan.seq as usize == seq)
    );
    // Nominally 50 Hz; the device's own clock says 20.114 ms.
    assert!((scans[171].scan_time_s - 0.020_114).abs() < 1e-4);
    assert_eq!(scans[0].angle_min_rad, (-45f64).to_radians());
}

#[test]
fn the_samples_in_cola_a() {
    let Some(path) = recording("lms5xx_ascii_samples.cola") else {
        return;
    };
    let (scans, _) = scans(&std::fs::read(path).unwrap(), 1448);
    let [a, b, c, d, e, f] = &scans[..] else {
        panic!("{} scans", scans.len());
    };
    let info = |scan: &Scan| scan.info.clone().unwrap();
    assert_eq!(
        scans.iter().map(Scan::beams).collect::<Vec<_>>(),
        [570, 181, 241, 1141, 286, 61]
    );
    // An encoder with nothing connected, a name with a blank, the calendar.
    assert_eq!(info(a).encoder, [0, 0]);
    assert_eq!(info(a).device_name, "SN 18220118");
    let unset = Stamp::from_ns((8 * 3600 + 36 * 60 + 22) * 1_000_000_000 + 364_000_000);
    assert_eq!(info(a).device_time, Some(unset));
    assert!((a.angle_min_rad.to_degrees() + 29.0 / 6.0).abs() < 1e-12);
    assert_eq!(a.ranges_m[..3], [2.433, 2.428, 2.434]);
    assert_eq!(a.remissions[..4], [254.0, 254.0, 254.0, 253.0]);
    // A cut range, scale 2, five echoes.
    assert!((b.angle_min_rad.to_degrees() - 91.0 / 3.0).abs() < 1e-12);
    assert_eq!((info(c).scale, c.ranges_m[0]), (2.0, 1.734));
    assert_eq!(
        (info(d).telegram_counter, info(d).scan_counter),
        (Some(0), Some(0x3F0E))
    );
    assert_eq!(e.ranges_m[0], 8.274);
    assert_eq!(f.further_ranges_m.len(), 4);
    assert!(
        f.further_ranges_m
            .iter()
            .all(|ranges_m| ranges_m.len() == 61)
    );
    assert_eq!(f.further_ranges_m[3][0], f64::INFINITY);
    assert_eq!(info(f).device_name, "SL1");
}

#[test]
fn one_csv_holds_scans_of_several_devices() {
    let Some(path) = recording("lms5xx_ascii_samples.cola") else {
        return;
    };
    let ended = scan_capture(&[], &path);
    assert!(ended.status.success(), "{ended:?}");
    let text = String::from_utf8(ended.stdout).unwrap();
    assert_eq!(text.lines().count(), 7);
    assert!(text.lines().next().unwrap().contains("ranges_5_mm"));
}

#[test]
fn arrival_times_beside_the_recording_are_used() {
    let Some(path) = recording("20210302_lms511.cola") else {
        return;
    };
    let column = |args: &[&str], name: &str| -> Vec<i64> {
        let ended = scan_capture(args, &path);
        assert!(ended.status.success(), "{ended:?}");
        let mut reader = csv::Reader::from_reader(&ended.stdout[..]);
        let at = reader
            .headers()
            .unwrap()
            .iter()
            .position(|c| c == name)
            .unwrap();
        reader
            .records()
            .map(|row| row.unwrap()[at].parse().unwrap())
            .collect()
    };
    let (stamps, received) = (column(&[], "stamp_ns"), column(&[], "received_ns"));
    assert_eq!(received[0], 1_727_405_071);
    // Stamps lie one generation delay before the arrivals, and scatter less than they do.
    let delays = stamps
        .iter()
        .zip(&received)
        .map(|(stamp, received)| received - stamp);
    assert!(
        delays
            .clone()
            .all(|delay_ns| (39_500_000..43_000_000).contains(&delay_ns))
    );
    assert_eq!(
        column(&["--no-times"], "stamp_ns"),
        column(&[], "device_ns")
    );
    let moved = column(&["--epoch", "1614680100.5"], "stamp_ns");
    assert!(
        moved
            .iter()
            .zip(&stamps)
            .all(|(a, b)| a - b == 1_614_680_100_500_000_000)
    );
}

#[test]
fn a_recording_cut_anywhere_is_in_order() {
    let stream = std::fs::read(testdata("lms511.cola")).unwrap();
    let path = scratch("cut.cola");
    std::fs::write(&path, &stream[40..stream.len() - 100]).unwrap();
    let ended = scan_capture(&[], &path);
    let stderr = String::from_utf8(ended.stderr).unwrap();
    assert_eq!(ended.status.code(), Some(0), "{stderr}");
    assert!(stderr.contains("starts in mid-telegram"), "{stderr}");
    assert!(stderr.contains("ends in mid-telegram"), "{stderr}");
    // The first and the last of the twenty are incomplete.
    assert_eq!(
        ended.stdout.iter().filter(|byte| **byte == b'\n').count(),
        1 + 18
    );
}

/// Where the `n`-th telegram of a CoLa B stream begins.
fn begin_of(stream: &[u8], n: usize) -> usize {
    let mut framer = Framer::new();
    framer.feed(stream);
    let mut offsets = std::iter::from_fn(|| match framer.next()? {
        Event::Telegram(found) => Some(found.offset),
        Event::Skipped(skipped) => panic!("{skipped:?}"),
    });
    offsets.nth(n).unwrap() as usize
}

/// The own recording with `bytes` put `after` bytes behind the channel's name in the fourth
/// telegram, whose XOR is made to fit; and where that telegram begins.
fn with_changed_channel(channel: &[u8], after: isize, bytes: &[u8]) -> (Vec<u8>, usize) {
    let mut stream = std::fs::read(testdata("lms511.cola")).unwrap();
    let (begin, end) = (begin_of(&stream, 3), begin_of(&stream, 4));
    let telegram = &mut stream[begin..end];
    let at = telegram
        .windows(channel.len())
        .position(|window| window == channel)
        .unwrap();
    let at = (at + channel.len()).wrapping_add_signed(after);
    telegram[at..at + bytes.len()].copy_from_slice(bytes);
    let last = telegram.len() - 1;
    telegram[last] = telegram[8..last].iter().fold(0, |xor, byte| xor ^ byte);
    (stream, begin)
}

#[test]
fn a_senseless_scan_is_a_bad_telegram_though_its_xor_is_right() {
    let path = scratch("senseless.cola");
    let scale = |value: f32| value.to_be_bytes();
    for (channel, after, bytes, reason) in [
        (b"DIST1", 0, &scale(f32::NAN)[..], "scale factor NaN"),
        (b"DIST1", 0, &scale(0.0), "scale factor 0"),
        (b"DIST1", 0, &scale(-1.0), "scale factor -1"),
        (b"DIST1", 0, &scale(f32::INFINITY), "scale factor inf"),
        (b"RSSI1", 0, &scale(f32::NAN), "channel RSSI1: scale factor"),
        (b"DIST1", 12, &[0, 0], "angular step 0"),
        (b"DIST1", 12, &[0x40, 0], "beams from"),
        (b"DIST1", -5, b"DISTX", "no channel DIST1"),
    ] {
        let (stream, begin) = with_changed_channel(channel, after, bytes);
        std::fs::write(&path, stream).unwrap();
        let ended = scan_capture(&[], &path);
        let stderr = String::from_utf8(ended.stderr).unwrap();
        assert_eq!(ended.status.code(), Some(65), "{reason}: {stderr}");
        let offset = format!("offset {begin}: ");
        assert!(stderr.contains(&offset), "{stderr}");
        assert!(stderr.contains(reason), "{reason}: {stderr}");
        let ended = scan_capture(&["--skip-bad"], &path);
        let stderr = String::from_utf8(ended.stderr).unwrap();
        assert_eq!(ended.status.code(), Some(3), "{reason}: {stderr}");
        assert!(stderr.contains("1 bad pieces skipped"), "{stderr}");
        let lines = ended.stdout.iter().filter(|byte| **byte == b'\n').count();
        assert_eq!(lines, 1 + 19);
    }
}

#[test]
fn a_stream_without_scans_says_so() {
    let path = scratch("replies.cola");
    std::fs::write(&path, b"\x02sRA SCdevicestate 1\x03").unwrap();
    let ended = scan_capture(&[], &path);
    assert_eq!(ended.status.code(), Some(3));
    assert!(String::from_utf8(ended.stderr).unwrap().contains("no scan"));
    std::fs::write(&path, b"this is not a recording").unwrap();
    assert_eq!(scan_capture(&[], &path).status.code(), Some(65));
}

#[test]
fn a_device_that_is_not_there_is_said_with_what_to_try() {
    for (device, hint) in [
        ("127.0.0.1:1", "--wait 60s"),
        ("no-such-host.invalid", "no-such-host.invalid:2112"),
        ("/dev/no-such-port", "scan-capture list"),
    ] {
        let ended = Command::new(env!("CARGO_BIN_EXE_scan-capture"))
            .arg(device)
            .output()
            .unwrap();
        let stderr = String::from_utf8(ended.stderr).unwrap();
        assert_eq!(ended.status.code(), Some(69), "{stderr}");
        assert!(stderr.contains(device) && stderr.contains(hint), "{stderr}");
        assert!(!stderr.contains("os error"), "{stderr}");
        assert!(ended.stdout.is_empty());
    }
}
