//! What the telegrams hold and when they come.

use super::*;

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
fn the_first_telegram_after_run_is_flagged() {
    let mut bench = Bench::logged_in();
    bench.ask("sEN LMDscandata 1");
    let flags = |bench: &mut Bench| {
        let scans = bench.wait(200);
        let flags = scans.iter().map(|(_, scan)| scan.device_status);
        flags.collect::<Vec<_>>()
    };
    let mut due = [[0, 0]; 4];
    due[0] = [1, 0];
    assert_eq!(flags(&mut bench), due);
    assert_eq!(flags(&mut bench), [[0, 0]; 5]);
    // Every second scan only: it is the telegram that is flagged.
    bench.ask("sWN LMDscandatacfg 01 00 1 0 0 00 00 0 0 0 1 +2");
    bench.ask("sMN Run");
    let flags = flags(&mut bench);
    assert_eq!(flags[..2], [[1, 0], [0, 0]]);
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
