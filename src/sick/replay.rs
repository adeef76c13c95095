//! Scans from the telegrams of one byte stream, in their order.
//!
//! Knows what one telegram cannot tell: which scan is a repetition, how many scans are missing
//! between two, the period in the device's own time, when the device restarted, and the host's time
//! of each scan.
//!
//! **Time.** The device stamps a scan at its zero index, before the first beam. With arrival times
//! its clock is mapped to the host's by the causal lower envelope of arrival minus transmission
//! ([`LowerEnvelope`]). Without them the time since the device's start-up counts from
//! [`Settings::epoch`], from the device's calendar if somebody has set it, or from 1970.

use super::scan::{self, BeamTiming, ScanError};
use super::scandata::LmdScandata;
use crate::clock::{LowerEnvelope, Tick, TickUnwrapper};
use crate::record::{Scan, Stamp};
use std::collections::VecDeque;

/// Scans over which the offset of the clocks is taken from the earliest arrival.
const ENVELOPE_SCANS: usize = 50;
/// Scans over which the period is averaged.
const PERIOD_SCANS: usize = 32;
/// How many scans back a repetition is recognised.
const REMEMBERED: usize = 16;
/// How far a measured period may be from the nominal one and still be a period.
const PERIOD_TOLERANCE: f64 = 0.2;

/// What a replay is told from outside.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Host time of the first scan's zero index, where there are no arrival times; with them, what
    /// is added to them.
    pub epoch: Option<Stamp>,
    /// From the zero index to the beam at `aperture_start_rad`, s.
    pub index_to_first_beam_s: f64,
    /// Where the device's aperture begins, rad: a telegram whose range is cut begins later.
    pub aperture_start_rad: f64,
    /// Smallest range the device can measure, m; none is the smallest it can send.
    pub range_min_m: Option<f64>,
}

impl Default for Settings {
    /// An LMS5xx: its aperture begins at -5 deg. A device that begins before that is taken to send
    /// all of its aperture.
    fn default() -> Self {
        Settings {
            epoch: None,
            index_to_first_beam_s: 0.0,
            aperture_start_rad: (-5.0f64).to_radians(),
            range_min_m: None,
        }
    }
}

/// What happened on the way, counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Scans given out.
    pub scans: u64,
    /// Telegrams that repeat a scan: retransmissions, or polls without a new scan.
    pub repeated: u64,
    /// Scans that the scan counter passed over.
    pub missing: u64,
    /// Scans that came after a newer one.
    pub late: u64,
    /// Times that the scan counter began anew while the clock ran on.
    pub counter_restarts: u64,
    /// Times that the device restarted or another one took its place.
    pub restarts: u64,
    /// Scans whose device status was not (0, 0).
    pub flagged: u64,
    /// Scans without an arrival time although others have one.
    pub without_arrival: u64,
}

/// Makes scans of telegrams.
#[derive(Debug)]
pub struct Replay {
    settings: Settings,
    counts: Counts,
    session: Option<Session>,
    /// Stamp and period of the newest scan, for the time after a restart.
    newest: Option<(Stamp, f64)>,
    any_arrival: bool,
    scan: Scan,
}

/// What is known of a device since it was started.
#[derive(Debug)]
struct Session {
    serial_number: u32,
    ticks: TickUnwrapper,
    newest: Newest,
    recent: VecDeque<Key>,
    /// Scan number and time (us) of the last scans made in even succession.
    history: VecDeque<(i64, i64)>,
    envelope: LowerEnvelope,
    /// Host minus device time where there are no arrival times, ns.
    offset_ns: i64,
}

#[derive(Clone, Copy, Debug)]
struct Newest {
    counter: u16,
    layer: u16,
    number: i64,
    tick: u32,
    us: i64,
    arrival_ns: Option<i64>,
}

/// What tells one scan from another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Key {
    counter: u16,
    tick: u32,
    layer: u16,
}

impl Key {
    fn of(telegram: &LmdScandata) -> Key {
        Key {
            counter: telegram.scan_counter,
            tick: telegram.scan_tick_us,
            layer: telegram.layer,
        }
    }
}

impl Replay {
    /// A replay at the start of a stream.
    pub fn new(settings: Settings) -> Replay {
        Replay {
            settings,
            counts: Counts::default(),
            session: None,
            newest: None,
            any_arrival: false,
            scan: Scan::default(),
        }
    }

    /// What happened so far.
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// Takes the next telegram, with the host's time in ns when it had arrived if that is known.
    /// Gives its scan, or none if it repeats one.
    pub fn push(
        &mut self,
        telegram: &LmdScandata,
        arrival_ns: Option<i64>,
    ) -> Result<Option<&Scan>, ScanError> {
        scan::check(telegram)?;
        let key = Key::of(telegram);
        if let Some(session) = &self.session
            && session.serial_number == telegram.serial_number
            && session.recent.contains(&key)
        {
            self.counts.repeated += 1;
            return Ok(None);
        }
        let first_number = self.next_number();
        let session = match self.session.take() {
            Some(session) if session.serial_number == telegram.serial_number => session,
            other => {
                self.counts.restarts += u64::from(other.is_some());
                Session::new(telegram, first_number)
            }
        };
        let mut session = self.session.insert(session);
        let mut number = session.place(telegram, arrival_ns, &mut self.counts);
        if number.is_none() {
            self.counts.restarts += 1;
            session = self.session.insert(Session::new(telegram, first_number));
            number = session.place(telegram, arrival_ns, &mut self.counts);
        }
        let Some((number, us)) = number else {
            return Ok(None);
        };
        session.remember(key);
        let timing = BeamTiming {
            period_s: session.period_s(telegram),
            index_to_first_beam_s: self.settings.index_to_first_beam_s,
            aperture_start_rad: self.settings.aperture_start_rad,
        };
        let transmit_us = us + transmit_after_scan_us(telegram);
        self.any_arrival |= arrival_ns.is_some();
        self.counts.without_arrival += u64::from(self.any_arrival && arrival_ns.is_none());
        if session.recent.len() == 1 {
            session.offset_ns = start_offset_ns(&self.settings, self.newest, telegram, us);
        }
        let epoch_ns = self.settings.epoch.map_or(0, Stamp::ns);
        let received_ns = arrival_ns.map(|arrival| arrival.saturating_add(epoch_ns));
        if let Some(received) = received_ns {
            session
                .envelope
                .push(received.saturating_sub(transmit_us * 1000));
        }
        let offset_ns = session.envelope.offset_ns().unwrap_or(session.offset_ns);

        let record = &mut self.scan;
        scan::fill(record, telegram, timing, self.settings.range_min_m);
        record.seq = u32::try_from(number).unwrap_or(0);
        record.received = received_ns.map(Stamp::from_ns);
        record.device = Some(Stamp::from_ns(us * 1000));
        let index = Stamp::from_ns(offset_ns.saturating_add(us * 1000));
        record.stamp = index.plus_s(timing.first_beam_s(record.angle_min_rad));
        if let Some(info) = &mut record.info {
            info.transmit = Some(Stamp::from_ns(transmit_us * 1000));
        }
        self.newest = Some((record.stamp, timing.period_s));
        self.counts.scans += 1;
        self.counts.flagged += u64::from(telegram.device_status != [0, 0]);
        Ok(Some(&self.scan))
    }

    /// The number of a scan that follows the newest one without a known gap.
    fn next_number(&self) -> i64 {
        let newest = self.session.as_ref().map(|session| session.newest.number);
        newest.map_or(0, |number| number + 1)
    }
}

/// Host minus device time at the first scan since a (re)start, ns.
fn start_offset_ns(
    settings: &Settings,
    newest: Option<(Stamp, f64)>,
    telegram: &LmdScandata,
    us: i64,
) -> i64 {
    let calendar = telegram.time.filter(|time| time.is_set());
    let calendar = calendar.and_then(|time| time.stamp());
    match (settings.epoch, newest, calendar) {
        (Some(epoch), None, _) => epoch.ns() - us * 1000,
        (Some(_), Some((stamp, period_s)), _) => stamp.plus_s(period_s).ns() - us * 1000,
        (None, _, Some(calendar)) => calendar.ns() - (us + transmit_after_scan_us(telegram)) * 1000,
        (None, _, None) => 0,
    }
}

/// From the zero index to the transmission, us; the counter may wrap between them.
fn transmit_after_scan_us(telegram: &LmdScandata) -> i64 {
    let delay = telegram
        .transmit_tick_us
        .wrapping_sub(telegram.scan_tick_us);
    i64::from(delay.cast_signed())
}

/// The nominal period, s.
fn nominal_period_s(telegram: &LmdScandata) -> Option<f64> {
    let hundredths = telegram.scan_frequency;
    (hundredths > 0).then(|| 100.0 / f64::from(hundredths))
}

impl Session {
    fn new(telegram: &LmdScandata, number: i64) -> Session {
        Session {
            serial_number: telegram.serial_number,
            ticks: TickUnwrapper::default(),
            newest: Newest {
                counter: telegram.scan_counter,
                layer: telegram.layer,
                number,
                tick: telegram.scan_tick_us,
                us: i64::from(telegram.scan_tick_us),
                arrival_ns: None,
            },
            recent: VecDeque::with_capacity(REMEMBERED + 1),
            history: VecDeque::with_capacity(PERIOD_SCANS + 2),
            envelope: LowerEnvelope::new(ENVELOPE_SCANS),
            offset_ns: 0,
        }
    }

    fn remember(&mut self, key: Key) {
        if self.recent.len() == REMEMBERED {
            self.recent.pop_front();
        }
        self.recent.push_back(key);
    }

    /// The scan's number and its time since start-up, us; none if the device has restarted.
    fn place(
        &mut self,
        telegram: &LmdScandata,
        arrival_ns: Option<i64>,
        counts: &mut Counts,
    ) -> Option<(i64, i64)> {
        let last = self.newest;
        let elapsed_us = match (arrival_ns, last.arrival_ns) {
            (Some(now), Some(then)) => Some(now.saturating_sub(then) / 1000),
            _ => None,
        };
        let is_first = self.ticks.newest_us().is_none();
        let us = match self.ticks.push(telegram.scan_tick_us, elapsed_us) {
            Tick::Restart(_) => return None,
            Tick::Late(us) => {
                counts.late += 1;
                let behind = last.counter.wrapping_sub(telegram.scan_counter);
                return Some(((last.number - i64::from(behind)).max(0), us));
            }
            Tick::Forward(us) => us,
        };
        let number = if is_first {
            last.number
        } else {
            let step = self.step(telegram, us, counts);
            if step.is_none() && telegram.scan_tick_us < last.tick && elapsed_us.is_none() {
                return None; // the counter began anew where the clock would have to have wrapped
            }
            last.number + step.unwrap_or(1)
        };
        self.newest = Newest {
            counter: telegram.scan_counter,
            layer: telegram.layer,
            number,
            tick: telegram.scan_tick_us,
            us,
            arrival_ns,
        };
        self.note_period(telegram, number, us);
        Some((number, us))
    }

    /// How many scans on from the newest this one is; none if the scan counter began anew.
    fn step(&self, telegram: &LmdScandata, us: i64, counts: &mut Counts) -> Option<i64> {
        let last = self.newest;
        let step = i64::from(telegram.scan_counter.wrapping_sub(last.counter));
        if step == 0 && telegram.layer != last.layer {
            return Some(0); // another layer of the same scan
        }
        // The device may stand still for any time between two scans, but it cannot make more of
        // them than the time allows.
        let elapsed_s = (us - last.us) as f64 * 1e-6;
        let most = nominal_period_s(telegram).map_or(f64::INFINITY, |period_s| {
            1.5 + elapsed_s / (period_s * (1.0 - PERIOD_TOLERANCE))
        });
        if step >= 1 && step as f64 <= most {
            counts.missing += (step - 1) as u64;
            Some(step)
        } else {
            counts.counter_restarts += 1;
            None
        }
    }

    /// Keeps the scans from which the period is measured.
    fn note_period(&mut self, telegram: &LmdScandata, number: i64, us: i64) {
        if let Some(&(last_number, last_us)) = self.history.back() {
            if number == last_number {
                return;
            }
            let period_s = (us - last_us) as f64 * 1e-6 / (number - last_number) as f64;
            let uneven = nominal_period_s(telegram)
                .is_some_and(|nominal_s| (period_s / nominal_s - 1.0).abs() > PERIOD_TOLERANCE);
            if uneven {
                self.history.clear();
            }
        }
        self.history.push_back((number, us));
        if self.history.len() > PERIOD_SCANS + 1 {
            self.history.pop_front();
        }
    }

    /// The mean period of the last scans, s; the nominal one before there are two of them.
    fn period_s(&self, telegram: &LmdScandata) -> f64 {
        match (self.history.front(), self.history.back()) {
            (Some((n0, us0)), Some((n1, us1))) if n1 > n0 => {
                (us1 - us0) as f64 * 1e-6 / (n1 - n0) as f64
            }
            _ => nominal_period_s(telegram).unwrap_or(f64::NAN),
        }
    }
}

#[cfg(test)]
mod tests {
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
        replay.push(telegram, arrival_ns).unwrap().cloned()
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
            assert_eq!(scan.stamp, Stamp::from_ns(epoch + index_ns));
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
}
