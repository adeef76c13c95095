//! An LMS5xx that behaves like one: telegrams and the time go in, telegrams come out.
//!
//! It knows nothing of sockets ([`link::emulation`](crate::link::emulation) has those) and nothing
//! of what it sees: a [`Source`] gives it one revolution after the other.
//!
//! - [`Behaviour`]: who it is and how it behaves
//! - `commands`: every request and its answer, login levels, `sFA`
//! - `configuration`: variables, scan modes, passwords; what is written becomes active with `Run`
//! - `clock`: the counter since power-on and the calendar
//! - `output`: echo and mean filter, output rate and range
//! - [`recording`]: a source that replays a byte stream
//!
//! Where the telegram listing and recorded devices differ, the devices hold.

mod behaviour;
mod clock;
mod commands;
mod configuration;
mod output;
pub mod recording;
mod values;

use crate::frame::ScanMode;
use crate::link::emulation::{Device, LineId, Outbox, nanoseconds};
use crate::record::Encoder;
use crate::sick::cola::{Dialect, Event, Framer};
use crate::sick::encode::encode;
use crate::sick::scandata::{Calendar, LmdScandata, Position};
use clock::DeviceClock;
use configuration::Configuration;
use output::Output;
use std::collections::BTreeMap;
use std::time::Duration;

pub use behaviour::{Behaviour, Identity, Speech, TransmitStamp};
pub use output::fill;

/// What the device sees: one revolution of the mirror after the other.
pub trait Source {
    /// Writes the next revolution in a mode; its channels only where it is to be `measured`. None
    /// after the last. Times count from the source's own start and go on over a change of mode.
    fn next(
        &mut self,
        mode: ScanMode,
        measured: bool,
        telegram: &mut LmdScandata,
    ) -> Option<Revolution>;

    /// The source's own start is at `now_ns` of the emulation.
    fn began(&mut self, _now_ns: i64) {}

    /// The only mode there is, where it cannot be changed.
    fn fixed_mode(&self) -> Option<ScanMode> {
        None
    }

    /// First and last angle there are, 1e-4 deg, where that is not the whole aperture.
    fn coverage(&self) -> Option<[i32; 2]> {
        None
    }
}

/// When a revolution happens, ns after the source's start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Revolution {
    /// The mirror passes the zero index.
    pub index_ns: i64,
    /// The last beam has fired.
    pub end_ns: i64,
    /// Where a recording says it: how long after the zero index the telegram goes out.
    pub transmit_after_ns: Option<i64>,
}

/// What the account of a run says.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Scans made.
    pub scans: u64,
    /// Telegrams with a scan handed to the lines.
    pub telegrams: u64,
    /// Requests answered.
    pub requests: u64,
    /// Of these, refused.
    pub refused: u64,
    /// Bytes from clients that belong to no telegram.
    pub noise_bytes: u64,
}

/// What the device is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// It starts, until then.
    Boot(i64),
    /// It gets up to a new speed, until then.
    Settle(i64),
    /// The laser is on.
    Measuring,
    /// The laser is off, the mirror turns.
    Stopped,
    /// The laser is off, the mirror turns slowly.
    Standby,
}

/// What a client has asked to be told of, and in which dialect.
#[derive(Clone, Copy, Debug, Default)]
struct Subscriptions {
    scans: Option<Dialect>,
    outputs: Option<Dialect>,
    inputs: Option<Dialect>,
    fields: Option<Dialect>,
    parameters: Option<Dialect>,
    contamination: Option<Dialect>,
}

struct Client {
    framer: Framer,
    /// The only dialect that it is answered in; none: that in which it speaks.
    only: Option<Dialect>,
    /// Whether `EIHstCola` decides it.
    is_host: bool,
    /// Login level; 0: nobody.
    level: i32,
    subscriptions: Subscriptions,
    telegrams: u16,
    /// Polls that wait for the first scan.
    polls: Vec<Dialect>,
}

/// The device.
pub struct Emulator<S> {
    behaviour: Behaviour,
    source: S,
    clock: DeviceClock,
    /// The calendar at power-on, where inputs and outputs have not changed since.
    powered_on: Calendar,
    state: State,
    clients: BTreeMap<LineId, Client>,
    /// As written by clients; in the EEPROM; in force.
    written: Configuration,
    saved: Configuration,
    active: Configuration,
    factory: Configuration,
    /// True time of the source's start.
    origin_ns: Option<i64>,
    /// The revolution that comes next.
    next: Option<Revolution>,
    /// True time of the zero index that was passed last, ns.
    index_ns: i64,
    measured: LmdScandata,
    /// Whether `measured` holds channels.
    is_measured: bool,
    output: Output,
    /// The scan that was sent last.
    last: LmdScandata,
    /// When it was complete; none before the first.
    last_ns: Option<i64>,
    /// When the last revolution was complete, seen or not.
    due_last_ns: i64,
    scan_counter: u16,
    /// Nothing was sent since the last `Run`.
    after_run: bool,
    /// The source has ended at this time.
    over_ns: Option<i64>,
    ended: bool,
    max_offset_s: f32,
    tally: Tally,
    spare: Vec<u8>,
}

/// The transmission comes 0.95 periods and 3 ms after the zero index (recorded telegrams).
const TRANSMIT_PERIODS: f64 = 0.95;
const TRANSMIT_NS: i64 = 3_000_000;
/// Polls of one client that may wait for the first scan.
const MOST_POLLS: usize = 64;

impl<S: Source> Emulator<S> {
    /// A device at the moment of power-on.
    pub fn new(mut behaviour: Behaviour, source: S) -> Emulator<S> {
        behaviour.mode = source.fixed_mode().unwrap_or(behaviour.mode);
        let name = format!("SN {:08}", behaviour.identity.serial);
        let mut factory = Configuration::factory(behaviour.model, behaviour.mode, &name);
        if let Some(coverage) = source.coverage() {
            factory.narrow(coverage);
        }
        let mut saved = factory.clone();
        saved.set_host_dialect(behaviour.host_dialect);
        let uptime_ns = nanoseconds(behaviour.uptime);
        let mut clock = DeviceClock::new(behaviour.clock_ppm, uptime_ns);
        if let Some(calendar_ns) = behaviour.calendar_ns {
            clock.set(0, calendar_ns);
        }
        Emulator {
            state: State::Boot(nanoseconds(behaviour.boot)),
            behaviour,
            source,
            powered_on: clock.calendar_at_power_on(),
            clock,
            clients: BTreeMap::new(),
            written: saved.clone(),
            active: saved.clone(),
            saved,
            factory,
            origin_ns: None,
            next: None,
            index_ns: 0,
            measured: LmdScandata::default(),
            is_measured: false,
            output: Output::default(),
            last: LmdScandata::default(),
            last_ns: None,
            due_last_ns: 0,
            scan_counter: 0,
            after_run: false,
            over_ns: None,
            ended: false,
            max_offset_s: 0.0,
            tally: Tally::default(),
            spare: Vec::new(),
        }
    }

    /// What has been done so far.
    pub fn tally(&self) -> Tally {
        self.tally
    }

    /// The source, at the end.
    pub fn into_source(self) -> S {
        self.source
    }

    fn is_wanted(&self) -> bool {
        self.clients
            .values()
            .any(|client| client.subscriptions.scans.is_some())
    }

    /// The source begins now, if it is time for it.
    fn begin(&mut self, now_ns: i64, asked: bool) {
        if self.state == State::Measuring
            && self.origin_ns.is_none()
            && (asked || !self.behaviour.hold)
        {
            self.origin_ns = Some(now_ns);
            self.source.began(now_ns);
        }
    }

    /// The next revolution that is not over yet at `now_ns`; those before it are not measured.
    fn fetch(&mut self, now_ns: Option<i64>) {
        let Some(origin_ns) = self.origin_ns else {
            return;
        };
        if self.state != State::Measuring || self.over_ns.is_some() {
            return;
        }
        while self.next.is_none() {
            let mode = self.active.mode;
            // What is certainly over needs not be measured; periods hunt by less than a tenth.
            let latest_ns = self.index_ns + (1.1e9 / mode.frequency_hz) as i64;
            let may_be_next = now_ns.is_none_or(|now_ns| latest_ns >= now_ns);
            let measured = may_be_next && !self.clients.is_empty();
            let Some(revolution) = self.source.next(mode, measured, &mut self.measured) else {
                self.over_ns = Some(self.due_last_ns);
                return;
            };
            self.is_measured = measured;
            self.index_ns = origin_ns + revolution.index_ns;
            if now_ns.is_none_or(|now_ns| origin_ns + revolution.index_ns >= now_ns) {
                self.next = Some(revolution);
            }
        }
    }

    fn transmit_ns(&self, revolution: Revolution) -> i64 {
        let period_ns = 1e9 / self.active.mode.frequency_hz;
        let after_ns = (TRANSMIT_PERIODS * period_ns) as i64 + TRANSMIT_NS;
        let due_ns = revolution.index_ns + revolution.transmit_after_ns.unwrap_or(after_ns);
        self.origin_ns.unwrap_or(0) + due_ns.max(revolution.end_ns)
    }

    /// Starts or resumes measuring: what passed meanwhile was not seen.
    fn resume(&mut self, now_ns: i64) {
        self.state = State::Measuring;
        self.next = None;
        self.output = Output::default();
        if self.origin_ns.is_some() {
            self.fetch(Some(now_ns));
        } else {
            self.begin(now_ns, self.is_wanted());
        }
    }

    /// What was written becomes active.
    fn activate(&mut self, now_ns: i64) {
        let new_mode = self.active.mode != self.written.mode;
        self.active = self.written.clone();
        self.output = Output::default();
        self.after_run = true;
        if new_mode && self.state == State::Measuring {
            self.next = None;
            self.state = State::Settle(now_ns + nanoseconds(self.behaviour.settle));
        }
    }

    /// A scan is complete and goes out.
    fn transmit(&mut self, revolution: Revolution, now_ns: i64, out: &mut Outbox) {
        let origin_ns = self.origin_ns.unwrap_or(0);
        self.scan_counter = self.scan_counter.wrapping_add(1);
        self.tally.scans += 1;
        let due_ns = self.transmit_ns(revolution);
        self.due_last_ns = due_ns;
        if !self.is_measured {
            return;
        }
        if !self
            .output
            .take(&self.measured, &self.active, &mut self.last)
        {
            return;
        }
        self.last_ns = Some(due_ns);
        self.describe(origin_ns + revolution.index_ns);
        let sent_ns = match self.behaviour.transmit_stamp {
            TransmitStamp::Send => now_ns.max(due_ns),
            TransmitStamp::ScanEnd => due_ns,
        };
        self.stamp(sent_ns);
        for (line, client) in &mut self.clients {
            let polls = std::mem::take(&mut client.polls);
            let polls = polls.into_iter().map(|dialect| (dialect, true));
            let event = client.subscriptions.scans.map(|dialect| (dialect, false));
            for (dialect, polled) in polls.chain(event) {
                client.telegrams = client.telegrams.wrapping_add(1);
                self.last.polled = polled;
                self.last.telegram_counter = client.telegrams;
                self.spare.clear();
                encode(&self.last, dialect, &mut self.spare);
                if polled {
                    out.polled(*line, &self.spare);
                } else {
                    out.data(*line, &self.spare);
                }
                self.tally.telegrams += 1;
            }
        }
    }

    /// Writes everything but channels, the time of transmission and the telegram counter.
    fn describe(&mut self, index_ns: i64) {
        let active = &self.active;
        let flag = |place| active.number("LMDscandatacfg", place) != 0;
        let last = &mut self.last;
        last.version = 0;
        last.device_number = 1;
        last.serial_number = self.behaviour.identity.serial;
        // The first telegram after the start and after Run is flagged (recorded on an LMS511).
        let is_first = self.scan_counter == 1 || std::mem::take(&mut self.after_run);
        last.device_status = [is_first.into(), 0];
        last.scan_counter = self.scan_counter;
        last.scan_tick_us = self.clock.tick_us(index_ns);
        last.inputs = [0, 0];
        last.outputs = [0, 0];
        last.layer = 0;
        last.scan_frequency = active.frequency_raw();
        let shots_hz = active.mode.frequency_hz * 360.0 / active.mode.step_deg();
        last.measurement_frequency = (shots_hz / 100.0).round() as u32;
        last.encoders.clear();
        if flag(5) {
            last.encoders.push(encoder(active, index_ns));
        }
        last.position = flag(7).then(Position::default);
        last.device_name.clear();
        if flag(8) {
            last.device_name.push_str(active.text("LocationName"));
        }
        last.comment.clear();
        if flag(9) {
            last.comment.push_str(&self.behaviour.identity.comment);
        }
        last.events.clear();
    }

    /// Writes the time of transmission, on the counter and, where asked for, on the calendar.
    fn stamp(&mut self, sent_ns: i64) {
        self.last.transmit_tick_us = self.clock.tick_us(sent_ns);
        let with_time = self.active.number("LMDscandatacfg", 10) != 0;
        self.last.time = with_time.then(|| self.clock.calendar(sent_ns));
    }

    /// The answer to a poll: the last scan, also while none is made.
    fn answer_poll(
        &mut self,
        line: LineId,
        dialect: Dialect,
        now_ns: i64,
        out: &mut Outbox,
    ) -> bool {
        self.begin(now_ns, true);
        let comes = matches!(
            self.state,
            State::Measuring | State::Boot(_) | State::Settle(_)
        );
        let Some(last_ns) = self.last_ns else {
            let waiting = self.clients.get_mut(&line).map(|client| &mut client.polls);
            return match waiting {
                Some(polls) if comes && self.over_ns.is_none() && polls.len() < MOST_POLLS => {
                    polls.push(dialect);
                    true
                }
                _ => false,
            };
        };
        let sent_ns = match self.behaviour.transmit_stamp {
            TransmitStamp::Send => now_ns,
            TransmitStamp::ScanEnd => last_ns,
        };
        self.stamp(sent_ns);
        let Some(client) = self.clients.get_mut(&line) else {
            return true;
        };
        client.telegrams = client.telegrams.wrapping_add(1);
        self.last.polled = true;
        self.last.telegram_counter = client.telegrams;
        self.spare.clear();
        encode(&self.last, dialect, &mut self.spare);
        out.polled(line, &self.spare);
        self.tally.telegrams += 1;
        true
    }

    /// Power goes off and on: counters, clock and what was not saved are gone.
    fn power_cycle(&mut self, now_ns: i64, boot: Duration) {
        self.clock.restart(now_ns);
        self.powered_on = self.clock.calendar_at_power_on();
        self.state = State::Boot(now_ns + nanoseconds(boot));
        self.written = self.saved.clone();
        self.active = self.saved.clone();
        self.next = None;
        self.last_ns = None;
        self.scan_counter = 0;
        self.after_run = false;
        self.max_offset_s = 0.0;
        self.output = Output::default();
        // A serial line's client stays through it all.
        let host_dialect = self.saved.host_dialect();
        for client in self.clients.values_mut() {
            if client.is_host {
                client.only = Some(host_dialect);
            }
            client.level = 0;
            client.subscriptions = Subscriptions::default();
            client.telegrams = 0;
            client.polls.clear();
            client.framer = Framer::new();
        }
    }
}

/// The encoder's block: with a fixed speed its position is reckoned, otherwise nothing turns it.
fn encoder(active: &Configuration, t_ns: i64) -> Encoder {
    let (speed_m_s, mm_per_tick) = (active.real("LICFixVel"), active.real("LICencres"));
    if active.number("LICsrc", 0) != 0 || mm_per_tick <= 0.0 {
        return Encoder::default();
    }
    let ticks = t_ns as f64 * 1e-6 * f64::from(speed_m_s) / f64::from(mm_per_tick);
    Encoder {
        position: ticks as i64 as u32,
        speed: (1.0 / mm_per_tick).round() as u16,
    }
}

impl<S: Source> Device for Emulator<S> {
    fn connected(&mut self, line: LineId, service: usize, _now_ns: i64) {
        let speech = self.behaviour.speech.get(service).copied();
        let only = match speech.unwrap_or(Speech::Both) {
            Speech::Both => None,
            Speech::Text => Some(Dialect::Text),
            // Clients write it, close and expect the other dialect on their next connection.
            Speech::Host => Some(self.written.host_dialect()),
        };
        let client = Client {
            framer: Framer::new(),
            only,
            is_host: speech == Some(Speech::Host),
            level: 0,
            subscriptions: Subscriptions::default(),
            telegrams: 0,
            polls: Vec::new(),
        };
        if self.clients.is_empty() && self.next.is_some() && !self.is_measured {
            // Nobody was looking; the next revolution is for this client.
            self.next = None;
        }
        self.clients.insert(line, client);
    }

    fn disconnected(&mut self, line: LineId) {
        self.clients.remove(&line);
    }

    fn input(&mut self, line: LineId, bytes: &[u8], now_ns: i64, out: &mut Outbox) {
        let Some(client) = self.clients.get_mut(&line) else {
            return;
        };
        // The framer lends from its own buffer, and the answer needs the whole device.
        let mut framer = std::mem::take(&mut client.framer);
        framer.feed(bytes);
        while let Some(event) = framer.next() {
            match event {
                Event::Telegram(telegram) => self.answer(line, &telegram, now_ns, out),
                Event::Skipped(skipped) => self.tally.noise_bytes += skipped.bytes,
            }
        }
        if let Some(client) = self.clients.get_mut(&line) {
            client.framer = framer;
        }
    }

    fn advance(&mut self, now_ns: i64, out: &mut Outbox) {
        match self.state {
            State::Boot(until_ns) | State::Settle(until_ns) if until_ns <= now_ns => {
                self.resume(now_ns);
            }
            _ => {}
        }
        self.fetch(None);
        if let Some(revolution) = self.next
            && self.transmit_ns(revolution) <= now_ns
        {
            self.next = None;
            self.transmit(revolution, now_ns, out);
            self.fetch(None);
        }
        if let Some(over_ns) = self.over_ns {
            let stays = now_ns < over_ns + nanoseconds(self.behaviour.linger);
            self.ended = self.clients.is_empty() || !stays;
        }
    }

    fn due_ns(&self) -> Option<i64> {
        if let Some(over_ns) = self.over_ns {
            let until_ns = over_ns + nanoseconds(self.behaviour.linger);
            let now = self.clients.is_empty();
            return Some(if now { over_ns } else { until_ns });
        }
        match self.state {
            State::Boot(until_ns) | State::Settle(until_ns) => Some(until_ns),
            State::Measuring => match (self.origin_ns, self.next) {
                (Some(_), Some(revolution)) => Some(self.transmit_ns(revolution)),
                // Something can be fetched at once.
                (Some(_), None) => Some(i64::MIN),
                (None, _) => None,
            },
            State::Stopped | State::Standby => None,
        }
    }

    fn prepare(&mut self) {
        self.fetch(None);
    }

    fn restart(&mut self, now_ns: i64, boot: Duration) {
        self.power_cycle(now_ns, boot);
    }

    fn hurries(&self) -> bool {
        self.over_ns.is_none() && self.is_wanted() && self.state == State::Measuring
    }

    fn ended(&self) -> bool {
        self.ended
    }
}

#[cfg(test)]
mod tests;
