//! Tests of the replay.

use super::*;
use crate::sick::scandata::{Calendar, Channel};

/// Scan `number` of a device at 25 Hz whose period is 40.1 ms, started `start` us before.
fn telegram(start: u32, number: u16) -> LmdScandata {
    let tick = start.wrapping_add(40_100 * u32::from(number));
    LmdScandata {
        serial_number: 7,
        telegram_counter: number,
        scan_counter: number,
        scan_tick_us: tick,
        transmit_tick_us: tick.wrapping_add(40_000),
        scan_frequency: 2500,
        channels: vec![Channel {
            name: *b"DIST1",
            scale: 1.0,
            start_angle: -50_000,
            angular_step: 5000,
            values: vec![0, 1, 2, 3, 15, 16, 1000],
            ..Channel::default()
        }],
        ..LmdScandata::default()
    }
}

fn push(replay: &mut Replay, telegram: &LmdScandata, arrival_ns: Option<i64>) -> Option<Scan> {
    let arrival = arrival_ns.map(HostInstant::from_one_clock);
    replay.push(telegram, arrival).unwrap().cloned()
}

#[test]
fn codes_are_not_distances() {
    let mut replay = Replay::new(Settings::default());
    let scan = push(&mut replay, &telegram(0, 0), None).unwrap();
    assert_eq!(scan.ranges_m[0], f64::INFINITY);
    assert!(scan.ranges_m[1..5].iter().all(|range_m| range_m.is_nan()));
    assert_eq!(scan.ranges_m[5..], [0.016, 1.0]);
    let mut double = telegram(0, 1);
    double.channels[0].scale = 2.0;
    let scan = push(&mut replay, &double, None).unwrap();
    assert_eq!(scan.ranges_m[5..], [0.032, 2.0]);
    assert_eq!(scan.range_max_m, 80.0);
}

#[test]
fn ticks_go_on_over_the_wrap_and_give_the_period() {
    let start = u32::MAX - 100_000;
    let mut replay = Replay::new(Settings::default());
    for number in 0..40 {
        let scan = push(&mut replay, &telegram(start, number), None).unwrap();
        let us = i64::from(start) + 40_100 * i64::from(number);
        assert_eq!(scan.device, Some(Stamp::from_ns(us * 1000)));
        assert_eq!(scan.stamp, Stamp::from_ns(us * 1000));
        let transmit = scan.info.unwrap().transmit;
        assert_eq!(transmit, Some(Stamp::from_ns((us + 40_000) * 1000)));
        let period_s = if number == 0 { 0.04 } else { 0.0401 };
        assert!((scan.scan_time_s - period_s).abs() < 1e-12);
        assert!((scan.time_increment_s - period_s / 720.0).abs() < 1e-12);
    }
}

#[test]
fn repetitions_go_gaps_stay_and_counters_may_wrap() {
    let mut replay = Replay::new(Settings::default());
    let mut seqs = Vec::new();
    for number in [0, 1, 1, 2, 5, 4, 5, 6] {
        let mut telegram = telegram(1000, number);
        telegram.scan_counter = 65_533u16.wrapping_add(number);
        seqs.extend(push(&mut replay, &telegram, None).map(|scan| scan.seq));
    }
    assert_eq!(seqs, [0, 1, 2, 5, 4, 6]);
    let counts = replay.counts();
    assert_eq!((counts.repeated, counts.missing, counts.late), (2, 2, 1));
    assert_eq!((counts.counter_restarts, counts.restarts), (0, 0));
}

#[test]
fn a_pause_is_no_loss_and_a_new_count_no_repetition() {
    let mut replay = Replay::new(Settings::default());
    push(&mut replay, &telegram(1000, 500), None);
    let mut later = telegram(60_000_000, 501);
    let scan = push(&mut replay, &later, None).unwrap();
    assert_eq!((scan.seq, scan.scan_time_s), (1, 0.04));
    later.scan_counter = 3;
    later.scan_tick_us += 2_000_000;
    let scan = push(&mut replay, &later, None).unwrap();
    assert_eq!(scan.seq, 2);
    assert_eq!(replay.counts().counter_restarts, 1);
    assert_eq!(replay.counts().missing, 0);
}

#[test]
fn a_restart_and_another_device_begin_anew() {
    let mut replay = Replay::new(Settings::default());
    push(&mut replay, &telegram(1_000_000_000, 500), None);
    let scan = push(&mut replay, &telegram(3_000_000, 1), None).unwrap();
    assert_eq!(scan.device, Some(Stamp::from_ns(3_040_100_000)));
    assert_eq!((scan.seq, replay.counts().restarts), (1, 1));
    let mut other = telegram(9_000_000, 700);
    other.serial_number = 8;
    let scan = push(&mut replay, &other, None).unwrap();
    assert_eq!((scan.seq, replay.counts().restarts), (2, 2));
    // Shortly before the wrap only the scan counter tells.
    let mut replay = Replay::new(Settings::default());
    push(&mut replay, &telegram(4_100_000_000, 500), None);
    let scan = push(&mut replay, &telegram(3_000_000, 1), None).unwrap();
    assert_eq!(scan.device, Some(Stamp::from_ns(3_040_100_000)));
}

#[test]
fn a_restart_that_sets_the_clock_back_by_little_is_no_late_scan() {
    for connects in [false, true] {
        let mut replay = Replay::new(Settings::default());
        // Seen from its start on for 7 s, then off for 0.8 s.
        let (count, again_us) = (175, 7_817_500);
        let (least_us, begin_ns) = (150, 1_700_000_000_000_000_000);
        let mut last_ns = 0;
        for k in 0..2 * count {
            let number = k % count;
            let start_us = if k < count { 0 } else { again_us };
            if k == count && connects {
                replay.new_connection();
            }
            let sent_us = start_us + 40_100 * i64::from(number) + 40_000;
            let arrival_ns = begin_ns + (sent_us + least_us) * 1000;
            let scan = push(&mut replay, &telegram(0, number), Some(arrival_ns)).unwrap();
            // 0.8 s without scans: 20 are missing, by the time.
            assert_eq!(scan.seq, u32::from(k) + if k < count { 0 } else { 20 });
            assert!(scan.stamp.ns() > last_ns);
            last_ns = scan.stamp.ns();
            let index_ns = begin_ns + (start_us + 40_100 * i64::from(number) + least_us) * 1000;
            assert!((scan.stamp.ns() - index_ns).abs() < 1000, "{k}");
        }
        let counts = replay.counts();
        assert_eq!((counts.restarts, counts.late, counts.repeated), (1, 0, 0));
        assert_eq!((counts.missing, counts.estimated), (0, 20));
    }
}

#[test]
fn a_scan_that_was_missed_and_comes_seconds_late_is_no_restart() {
    let mut replay = Replay::new(Settings::default());
    let mut last_seq = 0;
    // Numbers 20 to 29 are overtaken by all up to 120, which are 3.6 s.
    for number in (0..20).chain(30..120).chain(20..30).chain(120..200) {
        let scan = push(&mut replay, &telegram(1000, number), None).unwrap();
        assert_eq!(scan.seq, u32::from(number));
        assert_eq!(
            scan.device,
            Some(Stamp::from_ns(1_000_000 + 40_100_000 * i64::from(number)))
        );
        last_seq = scan.seq;
    }
    let counts = replay.counts();
    assert_eq!((last_seq, counts.late, counts.restarts), (199, 10, 0));
    // Restarted after these losses: the count fits no gap at the time that the device tells.
    for number in 0..40 {
        push(&mut replay, &telegram(4_000_000, number), None).unwrap();
    }
    assert_eq!((replay.counts().late, replay.counts().restarts), (10, 1));
}

#[test]
fn a_poller_gets_the_newest_scan_again_and_no_late_one() {
    let mut replay = Replay::new(Settings::default());
    let polled = |number| LmdScandata {
        polled: true,
        ..telegram(0, number)
    };
    for number in [10, 60, 110] {
        assert!(push(&mut replay, &polled(number), None).is_some());
    }
    replay.new_connection();
    assert!(push(&mut replay, &polled(110), None).is_none());
    assert!(push(&mut replay, &polled(120), None).is_some());
    assert_eq!((replay.counts().repeated, replay.counts().restarts), (1, 0));
    // Its times would fit between those of two polls.
    assert!(push(&mut replay, &polled(30), None).is_some());
    assert_eq!((replay.counts().late, replay.counts().restarts), (0, 1));
}

#[test]
fn arrival_times_give_the_hosts_time_by_the_earliest() {
    let epoch = 1_600_000_000_000_000_000;
    let mut replay = Replay::new(Settings {
        epoch: Some(Stamp::from_ns(epoch)),
        ..Settings::default()
    });
    // Transmission delays in us; the least is 100.
    for (number, delay_us) in [700, 100, 900, 4000, 150].into_iter().enumerate() {
        let telegram = telegram(5000, number as u16);
        let sent_us = 5000 + 40_100 * number as i64 + 40_000;
        let arrival_ns = (sent_us + delay_us) * 1000;
        let scan = push(&mut replay, &telegram, Some(arrival_ns)).unwrap();
        assert_eq!(scan.received, Some(Stamp::from_ns(epoch + arrival_ns)));
        let least_us = if number == 0 { 700 } else { 100 };
        let index_ns = (sent_us - 40_000 + least_us) * 1000;
        // The line may lean by some ns while its points are few.
        assert!((scan.stamp.ns() - epoch - index_ns).abs() < 1000);
    }
}

#[test]
fn the_first_beam_comes_after_the_index() {
    let mut replay = Replay::new(Settings {
        index_to_first_beam_s: 0.010,
        ..Settings::default()
    });
    push(&mut replay, &telegram(0, 0), None);
    let mut cut = telegram(0, 1);
    cut.channels[0].start_angle = 850_000;
    let scan = push(&mut replay, &cut, None).unwrap();
    // A quarter of a turn after -5 deg.
    assert_eq!(
        scan.stamp,
        Stamp::from_ns(40_100_000 + 10_000_000 + 10_025_000)
    );
}

#[test]
fn a_set_calendar_tells_the_time_where_nothing_else_does() {
    let set = |year| Calendar {
        year,
        month: 3,
        day: 2,
        microsecond: 40_000,
        ..Calendar::default()
    };
    let mut first = telegram(5000, 0);
    first.time = Some(set(2021));
    let scan = push(&mut Replay::new(Settings::default()), &first, None).unwrap();
    assert_eq!(scan.stamp, Stamp::from_ns(1_614_643_200_000_000_000));
    let device_time = scan.info.unwrap().device_time;
    assert_eq!(device_time, Some(Stamp::from_ns(1_614_643_200_040_000_000)));
    first.time = Some(set(1970));
    let scan = push(&mut Replay::new(Settings::default()), &first, None).unwrap();
    assert_eq!(scan.stamp, Stamp::from_ns(5_000_000));
    let epoch = Some(Stamp::from_ns(77));
    let settings = Settings {
        epoch,
        ..Settings::default()
    };
    let scan = push(&mut Replay::new(settings), &first, None).unwrap();
    assert_eq!(scan.stamp, Stamp::from_ns(77));
}

#[test]
fn channels_must_fit_together() {
    let mut replay = Replay::new(Settings::default());
    let mut bad = telegram(0, 0);
    bad.channels.push(Channel {
        name: *b"RSSI1",
        values: vec![1],
        ..Channel::default()
    });
    let error = replay.push(&bad, None).unwrap_err();
    assert_eq!(error.to_string(), "channel RSSI1 has 1 values, DIST1 has 7");
    bad.channels.remove(0);
    assert_eq!(replay.push(&bad, None), Err(ScanError::NoDistances));
}

#[test]
fn senseless_scales_and_angles_are_no_scan() {
    let mut replay = Replay::new(Settings::default());
    let mut refused = |change: fn(&mut Channel)| {
        let mut bad = telegram(0, 0);
        change(&mut bad.channels[0]);
        replay.push(&bad, None).unwrap_err().to_string()
    };
    let scale = |text: &str| format!("channel DIST1: scale factor {text} cannot be");
    assert_eq!(refused(|c| c.scale = f32::NAN), scale("NaN"));
    assert_eq!(refused(|c| c.scale = 0.0), scale("0"));
    assert_eq!(refused(|c| c.scale = -1.0), scale("-1"));
    assert_eq!(refused(|c| c.scale = f32::INFINITY), scale("inf"));
    assert!(refused(|c| c.scale = f32::MIN_POSITIVE).contains("scale factor"));
    assert!(refused(|c| c.offset = f32::NAN).contains("scale offset NaN"));
    assert!(refused(|c| c.angular_step = 0).contains("angular step 0"));
    assert!(refused(|c| c.values.clear()).contains("DIST1 has no values"));
    assert!(refused(|c| c.values.resize(1141, 0)).contains("1141 beams from -50000"));
    assert!(refused(|c| c.start_angle = i32::MIN).contains("from -2147483648"));
    // Nothing of it has left a trace; a turn of 360 deg, rounded up, is one.
    assert_eq!(replay.counts(), Counts::default());
    let mut whole = telegram(0, 0);
    whole.channels[0].angular_step = 3334;
    whole.channels[0].values.resize(1081, 0);
    assert!(replay.push(&whole, None).unwrap().is_some());
}

#[test]
fn a_step_of_real_time_moves_the_stamps_and_not_the_map() {
    let mut replay = Replay::new(Settings::default());
    for number in 0..200 {
        let telegram = telegram(5000, number);
        let sent_us = 5000 + 40_100 * i64::from(number) + 40_000;
        let delay_us = 100 + i64::from(number * 5 % 7) * 130;
        let raw_ns = (sent_us + delay_us) * 1000;
        // Real time is set forward by an hour, then back by two.
        let utc_minus_raw_ns = match number {
            0..100 => 1_600_000_000_000_000_000,
            100..150 => 1_600_003_600_000_000_000,
            _ => 1_599_996_400_000_000_000,
        };
        let arrival = HostInstant {
            utc: Stamp::from_ns(raw_ns + utc_minus_raw_ns),
            raw_ns,
        };
        let scan = replay.push(&telegram, Some(arrival)).unwrap().unwrap();
        let index_ns = (sent_us - 40_000 + 100) * 1000 + utc_minus_raw_ns;
        // The line leans while its points are few.
        let allowed_ns = if number < 20 { 20_000 } else { 2000 };
        let off_ns = (scan.stamp.ns() - index_ns).abs();
        assert!(off_ns < allowed_ns, "scan {number}: {off_ns} ns");
    }
    assert_eq!(replay.counts().restarts, 0);
}

#[test]
fn every_nth_scan_is_no_loss_and_keeps_the_beams_time() {
    let mut replay = Replay::new(Settings::default());
    for number in 0..20u16 {
        let mut telegram = telegram(5000, 5 * number);
        telegram.telegram_counter = number;
        let scan = push(&mut replay, &telegram, None).unwrap();
        assert_eq!(scan.seq, u32::from(number));
        if number > 0 {
            assert!((scan.scan_time_s - 5.0 * 0.0401).abs() < 1e-12);
            assert!((scan.time_increment_s - 0.0401 / 720.0).abs() < 1e-12);
        }
    }
    assert_eq!(replay.counts().missing, 0);
}

#[test]
fn a_restart_that_the_host_saw_leaves_a_gap_by_the_time() {
    let mut replay = Replay::new(Settings::default());
    let arrival_ns = |s: f64| Some((s * 1e9) as i64);
    push(&mut replay, &telegram(1_000_000_000, 500), arrival_ns(10.0));
    push(
        &mut replay,
        &telegram(1_000_000_000, 501),
        arrival_ns(10.0401),
    );
    // The device came back after ten periods of 40.1 ms with a new count.
    let scan = push(&mut replay, &telegram(3_000_000, 1), arrival_ns(10.4411)).unwrap();
    assert_eq!(scan.seq, 11);
    let counts = replay.counts();
    assert_eq!((counts.restarts, counts.estimated), (1, 9));
    assert_eq!(counts.missing, 0);
}
