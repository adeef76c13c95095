//! Scans from the telegrams of one byte stream, in their order.
//!
//! Knows what one telegram cannot tell: which scan is a repetition, how many scans are missing
//! between two, the period in the device's own time, when the device restarted, and the host's time
//! of each scan.
//!
//! **Time.** The device stamps a scan at its zero index, before the first beam. With arrival times
//! its clock is mapped to the host's by the line under the cloud of arrival minus transmission, as
//! far as it has come ([`OneWayHull`]): offset and rate, from the past alone. The map is kept against
//! the host's monotonic clock, so that a step of its real time moves the stamps by just that step
//! and nothing else. Without arrival times the time since the device's start-up counts from
//! [`Settings::epoch`], from the device's calendar if somebody has set it, or from 1970.
//!
//! **Numbers.** `seq` counts the scans that the device was to send. Where it sends every n-th one
//! (output divider) or the mean of n (mean filter), the scan counter advances by n from telegram to
//! telegram; the telegram counter tells that from a loss.
//!
//! **Restarts.** A device that was started again counts and keeps time from zero. Where that goes
//! back by little it looks like telegrams that were overtaken. But an overtaken telegram was missed
//! before: one whose time and number fall into no gap, and one that goes back on a new connection,
//! comes from a device that was started again.

use super::angle_jitter::{AngleJitter, Correction, Delay};
use super::scan::{self, BeamTiming, ScanError};
use super::scandata::LmdScandata;
use super::succession::{Step, Succession};
use crate::clock::{OneWayHull, Tick, TickUnwrapper};
use crate::link::HostInstant;
use crate::record::{Scan, Stamp};
use std::collections::VecDeque;

/// Scans over which the period is averaged.
const PERIOD_SCANS: usize = 32;
/// How many scans back a repetition is recognised.
const REMEMBERED: usize = 16;
/// How many gaps back an overtaken scan may belong.
const GAPS: usize = 1024;
/// How far a measured period may be from the nominal one and still be a period.
pub(super) const PERIOD_TOLERANCE: f64 = 0.2;

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
    /// The scanner's angle jitter, which is taken out of every scan by the period before it.
    pub angle_jitter: Option<AngleJitter>,
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
            angle_jitter: None,
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
    /// Scans that the device was to send and that did not come. For a poller, who takes what there
    /// is, none are missing.
    pub missing: u64,
    /// Scans that should have come while the device or its count began anew, estimated from the
    /// arrival times.
    pub estimated: u64,
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
    /// The next scan is the first of a connection.
    connected: bool,
    jitter: Option<Correction>,
    scan: Scan,
}

/// What is known of a device since it was started.
#[derive(Debug)]
struct Session {
    serial_number: u32,
    ticks: TickUnwrapper,
    newest: Newest,
    recent: VecDeque<Key>,
    /// Where scans are missing, which may still come.
    gaps: VecDeque<Gap>,
    succession: Succession,
    /// Turn and time (us) of the last scans made in even succession.
    history: VecDeque<(i64, i64)>,
    hull: OneWayHull,
    /// The host's real time minus its monotonic time at the newest arrival, ns.
    utc_minus_raw_ns: i64,
    /// Host minus device time where there are no arrival times, ns.
    offset_ns: i64,
}

#[derive(Clone, Copy, Debug)]
struct Newest {
    counter: u16,
    /// The scan's number in the stream.
    number: i64,
    /// Turns of the mirror since the first scan.
    turn: i64,
    tick: u32,
    us: i64,
    arrival_raw_ns: Option<i64>,
}

/// Scans that are missing between two, which both are there.
#[derive(Clone, Copy, Debug)]
struct Gap {
    counter: u16,
    us: i64,
    end_counter: u16,
    end_us: i64,
}

impl Gap {
    /// Whether a scan with this count and time belongs here.
    fn holds(&self, counter: u16, us: i64) -> bool {
        let turns = self.end_counter.wrapping_sub(self.counter);
        let turn = counter.wrapping_sub(self.counter);
        (1..turns).contains(&turn) && self.us < us && us < self.end_us
    }
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
        let jitter = settings.angle_jitter.clone();
        Replay {
            jitter: jitter.map(|model| Correction::new(model, Delay::None)),
            settings,
            counts: Counts::default(),
            session: None,
            newest: None,
            any_arrival: false,
            connected: false,
            scan: Scan::default(),
        }
    }

    /// What happened so far.
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// The scan given last.
    pub fn newest(&self) -> &Scan {
        &self.scan
    }

    /// The telegrams that follow come on a new connection: the device made them after all that came
    /// before, but for the newest scan, which it may give again.
    pub fn new_connection(&mut self) {
        self.connected = true;
        if let Some(session) = &mut self.session {
            let older = session.recent.len().saturating_sub(1);
            session.recent.drain(..older);
        }
    }

    /// Takes the next telegram, with the host's instant at which its last byte had arrived if that
    /// is known. Gives its scan, or none if it repeats one.
    pub fn push(
        &mut self,
        telegram: &LmdScandata,
        arrival: Option<HostInstant>,
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
        let gap = self.gap_before(telegram, arrival);
        let first_number = self.next_number() + gap;
        let before = self.counts.restarts;
        let session = match self.session.take() {
            Some(session) if session.serial_number == telegram.serial_number => session,
            other => {
                self.counts.restarts += u64::from(other.is_some());
                Session::new(telegram, first_number)
            }
        };
        let mut session = self.session.insert(session);
        let connected = std::mem::take(&mut self.connected);
        let mut number = session.place(telegram, arrival, connected, &mut self.counts);
        if number.is_none() {
            self.counts.restarts += 1;
            session = self.session.insert(Session::new(telegram, first_number));
            number = session.place(telegram, arrival, false, &mut self.counts);
        }
        let Some((number, us)) = number else {
            return Ok(None);
        };
        if self.counts.restarts > before {
            self.counts.estimated += gap.unsigned_abs();
        }
        session.remember(key);
        let timing = BeamTiming {
            period_s: session.period_s(telegram),
            index_to_first_beam_s: self.settings.index_to_first_beam_s,
            aperture_start_rad: self.settings.aperture_start_rad,
        };
        let generation_us = transmit_after_scan_us(telegram);
        let transmit_us = us + generation_us;
        self.any_arrival |= arrival.is_some();
        self.counts.without_arrival += u64::from(self.any_arrival && arrival.is_none());
        if session.recent.len() == 1 {
            session.offset_ns = start_offset_ns(&self.settings, self.newest, telegram, us);
        }
        let epoch_ns = self.settings.epoch.map_or(0, Stamp::ns);
        let index_ns = match arrival {
            Some(arrival) => session
                .index_raw_ns(us, generation_us, arrival)
                .saturating_add(arrival.utc_minus_raw_ns())
                .saturating_add(epoch_ns),
            None => session.index_without_arrival_ns(us, epoch_ns),
        };

        let record = &mut self.scan;
        scan::fill(record, telegram, timing, self.settings.range_min_m);
        record.scan_time_s *= session.succession.stride() as f64;
        record.seq = u32::try_from(number).unwrap_or(0);
        record.received =
            arrival.map(|arrival| Stamp::from_ns(arrival.utc.ns().saturating_add(epoch_ns)));
        record.device = Some(Stamp::from_ns(us * 1000));
        let index = Stamp::from_ns(index_ns);
        record.stamp = index.plus_s(timing.first_beam_s(record.angle_min_rad));
        if let Some(info) = &mut record.info {
            info.transmit = Some(Stamp::from_ns(transmit_us * 1000));
        }
        // The stamp is the first beam's where the scan is nominally; the jitter is below 0.1 us.
        if let Some(jitter) = &mut self.jitter {
            jitter.turn(record);
        }
        self.newest = Some((record.stamp, timing.period_s));
        self.counts.scans += 1;
        self.counts.flagged += u64::from(telegram.device_status != [0, 0]);
        Ok(Some(&self.scan))
    }

    /// How many scans should have come since the newest one, by the arrival times; for where the
    /// device's own count does not tell.
    fn gap_before(&self, telegram: &LmdScandata, arrival: Option<HostInstant>) -> i64 {
        let known = self.session.as_ref().and_then(|session| {
            let elapsed_ns = arrival?
                .raw_ns
                .saturating_sub(session.newest.arrival_raw_ns?);
            Some(session.scans_within(elapsed_ns / 1000, telegram))
        });
        known.unwrap_or(0)
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

/// The nominal period, s; none where the telegram does not say.
pub(super) fn nominal_period_s(telegram: &LmdScandata) -> Option<f64> {
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
                number,
                turn: 0,
                tick: telegram.scan_tick_us,
                us: i64::from(telegram.scan_tick_us),
                arrival_raw_ns: None,
            },
            succession: Succession::new(telegram),
            recent: VecDeque::with_capacity(REMEMBERED + 1),
            gaps: VecDeque::new(),
            history: VecDeque::with_capacity(PERIOD_SCANS + 2),
            hull: OneWayHull::default(),
            utc_minus_raw_ns: 0,
            offset_ns: 0,
        }
    }

    /// The host's monotonic time at the zero index, ns: the transmission's, by the earliest
    /// arrivals, less what the device needed to get there.
    fn index_raw_ns(&mut self, us: i64, generation_us: i64, arrival: HostInstant) -> i64 {
        self.utc_minus_raw_ns = arrival.utc_minus_raw_ns();
        let transmit_ns = us.saturating_add(generation_us).saturating_mul(1000);
        let mapped = self.hull.push(transmit_ns, arrival.raw_ns);
        mapped.host_ns.saturating_sub(generation_us * 1000)
    }

    /// The host's real time at the zero index of a scan whose arrival is not known, ns.
    fn index_without_arrival_ns(&self, us: i64, epoch_ns: i64) -> i64 {
        match self.hull.host_ns(us * 1000) {
            Some(raw_ns) => raw_ns
                .saturating_add(self.utc_minus_raw_ns)
                .saturating_add(epoch_ns),
            None => self.offset_ns.saturating_add(us * 1000),
        }
    }

    fn remember(&mut self, key: Key) {
        if self.recent.len() == REMEMBERED {
            self.recent.pop_front();
        }
        self.recent.push_back(key);
    }

    fn note_gap(&mut self, telegram: &LmdScandata, us: i64) {
        if self.gaps.len() == GAPS {
            self.gaps.pop_front();
        }
        self.gaps.push_back(Gap {
            counter: self.newest.counter,
            us: self.newest.us,
            end_counter: telegram.scan_counter,
            end_us: us,
        });
    }

    /// Whether a scan that comes after a newer one is one of those that were missed. Who polls is
    /// answered in turn.
    fn was_missed(&self, telegram: &LmdScandata, us: i64) -> bool {
        let holds = |gap: &Gap| gap.holds(telegram.scan_counter, us);
        !telegram.polled && self.gaps.iter().rev().any(holds)
    }

    /// The scan's number and its time since start-up, us; none if the device has restarted.
    /// `connected` says that it is the first one of a connection.
    fn place(
        &mut self,
        telegram: &LmdScandata,
        arrival: Option<HostInstant>,
        connected: bool,
        counts: &mut Counts,
    ) -> Option<(i64, i64)> {
        let last = self.newest;
        let arrival_raw_ns = arrival.map(|arrival| arrival.raw_ns);
        let elapsed_us = match (arrival_raw_ns, last.arrival_raw_ns) {
            (Some(now), Some(then)) => Some(now.saturating_sub(then) / 1000),
            _ => None,
        };
        let is_first = self.ticks.newest_us().is_none();
        let tick = match connected {
            true => self.ticks.push_connected(telegram.scan_tick_us, elapsed_us),
            false => self.ticks.push(telegram.scan_tick_us, elapsed_us),
        };
        let us = match tick {
            Tick::Restart(_) => return None,
            Tick::Late(us) if !self.was_missed(telegram, us) => return None,
            Tick::Late(us) => {
                counts.late += 1;
                let behind = last.counter.wrapping_sub(telegram.scan_counter);
                let behind = i64::from(behind) / self.succession.stride();
                return Some(((last.number - behind).max(0), us));
            }
            Tick::Forward(us) => us,
        };
        let (mut number, mut turn) = (last.number, last.turn);
        if !is_first {
            let elapsed_s = (us - last.us) as f64 * 1e-6;
            match self
                .succession
                .push(telegram, elapsed_s, self.measured_period_s())
            {
                Step::On {
                    scans,
                    turns,
                    missing,
                } => {
                    counts.missing += missing;
                    if scans > 1 {
                        self.note_gap(telegram, us);
                    }
                    number += scans;
                    turn += turns;
                }
                // The counter began anew where the clock would have to have wrapped.
                Step::Anew if telegram.scan_tick_us < last.tick && elapsed_us.is_none() => {
                    return None;
                }
                Step::Anew => {
                    let gap = elapsed_us.map_or(0, |us| self.scans_within(us, telegram));
                    counts.counter_restarts += 1;
                    counts.estimated += gap.unsigned_abs();
                    self.history.clear();
                    number += 1 + gap;
                    turn += 1;
                }
            }
        }
        self.newest = Newest {
            counter: telegram.scan_counter,
            number,
            turn,
            tick: telegram.scan_tick_us,
            us,
            arrival_raw_ns,
        };
        self.note_period(telegram, turn, us);
        Some((number, us))
    }

    /// Keeps the scans from which the period is measured.
    fn note_period(&mut self, telegram: &LmdScandata, turn: i64, us: i64) {
        if let Some(&(last_turn, last_us)) = self.history.back() {
            if turn == last_turn {
                return;
            }
            let period_s = (us - last_us) as f64 * 1e-6 / (turn - last_turn) as f64;
            let uneven = nominal_period_s(telegram)
                .is_some_and(|nominal_s| (period_s / nominal_s - 1.0).abs() > PERIOD_TOLERANCE);
            if uneven {
                self.history.clear();
            }
        }
        self.history.push_back((turn, us));
        if self.history.len() > PERIOD_SCANS + 1 {
            self.history.pop_front();
        }
    }

    /// How many scans fit between two that came `elapsed_us` apart.
    fn scans_within(&self, elapsed_us: i64, telegram: &LmdScandata) -> i64 {
        let interval_s = self.period_s(telegram) * self.succession.stride() as f64;
        let scans = (elapsed_us as f64 * 1e-6 / interval_s - 1.0).round();
        if scans.is_finite() && !telegram.polled {
            scans.clamp(0.0, f64::from(u32::MAX)) as i64
        } else {
            0
        }
    }

    /// The mean period of the last turns by the device's clock, s; none before there are two.
    fn measured_period_s(&self) -> Option<f64> {
        let ((turn_0, us_0), (turn_1, us_1)) = (*self.history.front()?, *self.history.back()?);
        (turn_1 > turn_0).then(|| (us_1 - us_0) as f64 * 1e-6 / (turn_1 - turn_0) as f64)
    }

    /// The same, or the nominal one.
    fn period_s(&self, telegram: &LmdScandata) -> f64 {
        let measured_s = self.measured_period_s();
        measured_s.unwrap_or_else(|| nominal_period_s(telegram).unwrap_or(f64::NAN))
    }
}

#[cfg(test)]
#[path = "replay_tests.rs"]
mod tests;
