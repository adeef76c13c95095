//! The live capture of a SICK scanner.

use super::args::LiveArgs;
use super::configure::Plan;
use super::line::{FAREWELL, Line, patience};
use super::live::{Heard, LineFault, Scanner};
use crate::link::HostInstant;
use crate::record::Scan;
use crate::sick::client::commands::{self, Contamination, DeviceStatus};
use crate::sick::client::configure::{ConfigureError, Present};
use crate::sick::client::{self, Client, ClientError, Incoming, Reply, fact, load};
use crate::sick::cola::Telegram;
use crate::sick::replay::{self, Replay};
use crate::sick::scandata::{self, LmdScandata};
use crate::stream::Fault;
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// How long the first scan may take once the device says that it measures.
const FIRST_SCAN: Duration = Duration::from_secs(10);
/// How long a device that has been set may take until it measures and sends; the listing says 30 s.
const SETTLED: Duration = Duration::from_secs(40);
/// Between two questions whether the device is ready.
const ASK_EVERY: Duration = Duration::from_millis(200);
/// A scanner drifts for so long after power-on (Lee and Ehsani 2008, on an LMS200).
const WARM_AFTER: Duration = Duration::from_secs(53 * 60);

/// What is kept of the device between connections.
pub(super) struct Sick {
    line: Line,
    baud: u32,
    /// Requests a second; 0 is one a scan.
    poll: Option<f64>,
    plan: Option<Plan>,
    client: Option<Client>,
    replay: Replay,
    telegram: LmdScandata,
    scan_end: u64,
    polled: Option<Reply>,
    /// What became of a poll that was not answered.
    unanswered: Option<String>,
    next_poll: Instant,
    /// From scan to scan as far as it is known, s.
    interval_s: f64,
    /// How long a serial line needs for a scan, s; 0 on a network.
    line_s: f64,
    scans_on_line: u64,
    others: BTreeMap<String, u64>,
    notes: BTreeMap<String, String>,
    uptime: Option<Duration>,
    warned: bool,
    overloaded: bool,
    /// The device has just been set, and may take its time.
    set_now: bool,
    said_state: Option<u16>,
}

impl Sick {
    pub(super) fn new(
        line: Line,
        args: &LiveArgs,
        plan: Option<Plan>,
        settings: replay::Settings,
    ) -> Sick {
        Sick {
            line,
            baud: args.baud.unwrap_or(client::Settings::default().baud),
            poll: args.poll,
            plan,
            client: None,
            replay: Replay::new(settings),
            telegram: LmdScandata::default(),
            scan_end: 0,
            polled: None,
            unanswered: None,
            next_poll: Instant::now(),
            interval_s: 0.04,
            line_s: 0.0,
            scans_on_line: 0,
            others: BTreeMap::new(),
            notes: BTreeMap::new(),
            uptime: None,
            warned: false,
            overloaded: false,
            set_now: false,
            said_state: None,
        }
    }

    fn connect(&self) -> Result<Client, ClientError> {
        let settings = client::Settings {
            baud: self.baud,
            connect: self.line.connect_limit(),
            answer: self.line.answer_limit(),
            dialect: None,
        };
        let (tap, interrupted) = (self.line.tap(), self.line.interrupted());
        Client::connect(self.line.place(), &settings, Some(tap), Some(interrupted))
    }

    /// Waits until the device measures, or until it could; whether it does.
    fn await_measuring(
        &mut self,
        client: &mut Client,
        deadline: Instant,
        or_ready: bool,
    ) -> Result<bool, LineFault> {
        loop {
            let status = match client.ask(&DeviceStatus::request(), DeviceStatus::parse) {
                Ok(status) => status,
                // It does not know the question, or answers it in a form of its own: its scans tell. But
                // where it may have to be started, its state must be read.
                Err(ClientError::Refused { .. }) => return Ok(true),
                Err(ClientError::Answer { .. }) if !or_ready => return Ok(true),
                Err(error) => return Err(fault(error)),
            };
            if self.uptime.is_none() {
                self.uptime = status.uptime();
            }
            if status.state == DeviceStatus::MEASURING {
                if self.said_state.take().is_some() {
                    self.line.remark("the scanner measures");
                }
                return Ok(true);
            }
            if or_ready && status.state == DeviceStatus::READY {
                return Ok(false);
            }
            if Instant::now() >= deadline {
                let advice = match status.state {
                    DeviceStatus::READY => {
                        "The measurement has been switched off: --configure --start logs in and \
                         starts it"
                    }
                    _ => "Look at its LEDs and display, or give it longer with --wait",
                };
                let text = format!(
                    "{}: the scanner does not measure: it is {} (STlms {}). {advice}",
                    self.line.place(),
                    status.words(),
                    status.state
                );
                return Err(LineFault::Hopeless(Fault::Unavailable(text).into()));
            }
            if self.said_state != Some(status.state) {
                self.said_state = Some(status.state);
                self.line.remark(&format!(
                    "waiting for the scanner to measure: it is {} (STlms {})",
                    status.words(),
                    status.state
                ));
            }
            self.line.ending().sleep(ASK_EVERY);
            if self.line.ending().reached() {
                return Err(LineFault::Ended);
            }
        }
    }

    /// Sets the device where that is asked for and it is not set so already.
    fn configure(&mut self, client: &mut Client, measuring: bool) -> Result<(), LineFault> {
        let Some(plan) = self.plan.clone() else {
            return Ok(());
        };
        let mut remark = |text: &str| self.line.remark(text);
        let set = plan.wanted.apply(client, plan.hash, measuring, &mut remark);
        let reason = match set {
            Ok(set) => {
                self.set_now = set;
                // Saving once is enough: the EEPROM wears out.
                if let Some(plan) = &mut self.plan {
                    plan.wanted.save = false;
                }
                return Ok(());
            }
            Err(error @ ConfigureError::ReadBack(_)) => error.to_string(),
            Err(ConfigureError::Client(error)) => match fault(error) {
                LineFault::Refused(reason) => reason,
                other => return Err(other),
            },
        };
        // Scans that are made otherwise than was asked for are not wanted.
        let text = format!("{}: {reason}", self.line.place());
        Err(LineFault::Hopeless(Fault::Unavailable(text).into()))
    }

    /// Asks how often scans come, for the time limits, and whether a serial line carries them.
    fn ask_interval(&mut self, client: &mut Client) -> Result<(), ClientError> {
        let present = Present::read(client)?;
        self.interval_s = present.interval_s().unwrap_or(0.04);
        if client.line().is_tcp() {
            return Ok(());
        }
        let dialect = client.dialect();
        self.line_s = match load::carried(dialect, self.baud, &present) {
            Some((_, scans_a_second)) => 1.0 / scans_a_second,
            None => 1.0,
        };
        if let Some(text) = load::overload(dialect, self.baud, &present)
            && !self.overloaded
        {
            self.line.remark(&text);
            self.overloaded = true;
        }
        Ok(())
    }

    /// Asks who the device is and how it feels.
    fn ask_notes(&mut self, client: &mut Client) -> Result<(), ClientError> {
        let mut note = |name: &str, text: String| self.notes.insert(name.to_owned(), text);
        note("place", client.place().to_owned());
        note("dialect", format!("{:?}", client.dialect()));
        for (name, key) in [
            ("device", "device"),
            ("firmware", "firmware"),
            ("serial number", "serial_number"),
            ("location", "location"),
            ("operating hours", "operating_h"),
        ] {
            if let Some(fact) = fact(client, key)? {
                note(name, fact.text());
            }
        }
        if let Some(uptime) = self.uptime {
            note("seconds since power-on", uptime.as_secs().to_string());
        }
        let contamination = client.ask_if_known(&Contamination::request(), Contamination::parse)?;
        if let Some(state) = contamination {
            note("contamination", state.to_string());
            if state.0 != 0 {
                self.line
                    .remark(&format!("{state}: clean the front screen"));
            }
        }
        Ok(())
    }

    /// Says once that the device is not warm yet, by the time since its start-up.
    fn remark_warm_up(&mut self) {
        if self.warned {
            return;
        }
        self.warned = true;
        let by_tick = Duration::from_micros(self.telegram.scan_tick_us.into());
        let (uptime, sure) = match self.uptime {
            Some(uptime) => (uptime, true),
            None => (by_tick, false),
        };
        if uptime < WARM_AFTER {
            let minutes = uptime.as_secs() / 60;
            let doubt = match sure {
                true => "",
                false => " (by a counter that begins anew every 71.6 min)",
            };
            self.line.remark(&format!(
                "on for {minutes} min{doubt}: its distances drift until about 53 min after \
                 power-on"
            ));
        }
    }

    /// Makes a scan of a telegram.
    fn take(
        replay: &mut Replay,
        parsed: &mut LmdScandata,
        telegram: &Telegram,
        at: HostInstant,
    ) -> Result<bool, String> {
        let bad = |text: String| format!("a scan that makes no sense was skipped: {text}");
        parsed
            .parse(telegram)
            .map_err(|error| bad(error.to_string()))?;
        let scan = replay.push(parsed, Some(at));
        Ok(scan.map_err(|error| bad(error.to_string()))?.is_some())
    }

    fn scan_came(&mut self) {
        self.scans_on_line += 1;
        let scan_s = self.replay.newest().scan_time_s;
        if scan_s.is_finite() && scan_s > 0.0 {
            self.interval_s = scan_s;
        }
        self.remark_warm_up();
    }

    fn poll_now(&mut self, timeout: Duration) -> Result<(), ClientError> {
        // Some polls fit into the patience; one takes the line its time.
        let limit = (self.patience() / 3).max(Duration::from_secs_f64(1.5 * self.line_s));
        let Some(client) = &mut self.client else {
            return Ok(());
        };
        let left = self.next_poll.saturating_duration_since(Instant::now());
        if !left.is_zero() {
            client.wait(left.min(timeout))?;
            return Ok(());
        }
        let began = Instant::now();
        match client.request_within(&commands::last_scan(), limit) {
            Ok(reply) => self.polled = Some(reply),
            // A reply that a wrong bit has cost is no outage: the next poll shows whether it is one.
            Err(error @ ClientError::Silent { .. }) => self.unanswered = Some(error.to_string()),
            Err(error) => return Err(error),
        }
        self.next_poll = began + Duration::from_secs_f64(self.poll_pause_s());
        Ok(())
    }

    /// From poll to poll, s.
    fn poll_pause_s(&self) -> f64 {
        match self.poll {
            Some(rate_hz) if rate_hz > 0.0 => 1.0 / rate_hz,
            // One scan's period at most passes unseen between two polls.
            Some(_) => self.interval_s * 0.45,
            None => 0.0,
        }
    }

    /// How long a scan may be on its way, s.
    fn scan_s(&self) -> f64 {
        self.interval_s.max(self.line_s).max(self.poll_pause_s())
    }
}

impl Scanner for Sick {
    fn start(&mut self, deadline: Instant) -> Result<(), LineFault> {
        self.polled = None;
        self.unanswered = None;
        self.scans_on_line = 0;
        self.replay.new_connection();
        let mut client = self.connect().map_err(fault)?;
        let first = self.line.note_answer()?;
        self.set_now = false;
        let starts = self.plan.as_ref().is_some_and(|plan| plan.wanted.start);
        let measuring = self.await_measuring(&mut client, deadline, starts)?;
        self.configure(&mut client, measuring)?;
        if self.plan.is_some() {
            let deadline = deadline.max(Instant::now() + SETTLED);
            self.await_measuring(&mut client, deadline, false)?;
        }
        if first {
            self.ask_notes(&mut client).map_err(fault)?;
        }
        self.ask_interval(&mut client).map_err(fault)?;
        if self.poll.is_none() {
            client
                .call(&commands::scans(true), 1, "the device sends no scans")
                .map_err(fault)?;
        }
        self.next_poll = Instant::now();
        self.client = Some(client);
        Ok(())
    }

    fn wait(&mut self, timeout: Duration) -> Result<(), LineFault> {
        let result = match (&mut self.client, self.poll) {
            (None, _) => return Err(LineFault::Down("no connection".to_owned())),
            (Some(client), None) => client.wait(timeout).map(|_| ()),
            (Some(_), Some(_)) => self.poll_now(timeout),
        };
        result.map_err(fault)
    }

    fn next(&mut self) -> Option<Heard> {
        if let Some(text) = self.unanswered.take() {
            return Some(Heard::Fault(text));
        }
        if let Some(reply) = self.polled.take() {
            let telegram = reply.telegram();
            self.scan_end = telegram.last_offset();
            match Sick::take(
                &mut self.replay,
                &mut self.telegram,
                &telegram,
                reply.received,
            ) {
                Ok(true) => {
                    self.scan_came();
                    return Some(Heard::Scan);
                }
                Ok(false) => {}
                Err(text) => return Some(Heard::Fault(text)),
            }
        }
        let client = self.client.as_mut()?;
        loop {
            match client.next()? {
                Incoming::Skipped(skipped) if skipped.cause.is_edge() => {}
                Incoming::Skipped(skipped) => {
                    let text = format!("{} ({} bytes)", skipped.cause, skipped.bytes);
                    return Some(Heard::Fault(text));
                }
                Incoming::Telegram { telegram, at } if scandata::is_scan(&telegram) => {
                    let end = telegram.last_offset();
                    match Sick::take(&mut self.replay, &mut self.telegram, &telegram, at) {
                        Ok(false) => {}
                        Ok(true) => {
                            self.scan_end = end;
                            self.scan_came();
                            return Some(Heard::Scan);
                        }
                        Err(text) => return Some(Heard::Fault(text)),
                    }
                }
                Incoming::Telegram { telegram, .. } => {
                    let name = [telegram.verb(), telegram.name()].join(&b' ');
                    *self
                        .others
                        .entry(name.escape_ascii().to_string())
                        .or_default() += 1;
                }
            }
        }
    }

    fn scan(&self) -> &Scan {
        self.replay.newest()
    }

    fn scan_end(&self) -> u64 {
        self.scan_end
    }

    fn patience(&self) -> Duration {
        if self.scans_on_line == 0 {
            return if self.set_now { SETTLED } else { FIRST_SCAN };
        }
        patience(self.scan_s())
    }

    fn has_answered(&self) -> bool {
        self.line.has_answered()
    }

    fn lost(&self) -> u64 {
        let counts = self.replay.counts();
        counts.missing + counts.estimated
    }

    fn restarts(&self) -> u64 {
        let counts = self.replay.counts();
        counts.restarts + counts.counter_restarts
    }

    fn stop(&mut self) {
        let Some(mut client) = self.client.take() else {
            return;
        };
        client.set_interrupted(None);
        if self.poll.is_none() {
            // A device that does not answer is left as it is; the line is closed either way.
            let _ = client.request_within(&commands::scans(false), FAREWELL);
        }
        client.line().shut_down();
    }

    fn hang_up(&mut self) {
        if let Some(mut client) = self.client.take() {
            client.line().shut_down();
        }
    }

    fn notes(&self) -> BTreeMap<String, String> {
        self.notes.clone()
    }

    fn summary(&self, verbose: u8) -> Vec<String> {
        let counts = self.replay.counts();
        let mut lines: Vec<String> = [
            (counts.late, "scans came after a newer one"),
            (counts.counter_restarts, "times the scan counter began anew"),
            (counts.restarts, "times the device restarted or changed"),
        ]
        .into_iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, what)| format!("{count} {what}"))
        .collect();
        if verbose > 0 {
            lines.push(format!(
                "{} repeated telegrams dropped, {} scans with a device status",
                counts.repeated, counts.flagged
            ));
            let others = self.others.iter();
            let others: Vec<String> = others.map(|(name, n)| format!("{n} {name}")).collect();
            if !others.is_empty() {
                lines.push(format!("passed over: {}", others.join(", ")));
            }
        }
        lines
    }
}

/// Which faults another attempt may mend.
fn fault(error: ClientError) -> LineFault {
    match error {
        ClientError::Interrupted => LineFault::Ended,
        ClientError::Link(_)
        | ClientError::NoDialect { .. }
        | ClientError::Answer { .. }
        | ClientError::Silent { .. } => LineFault::Down(error.to_string()),
        ClientError::Refused { .. } | ClientError::Failed { .. } => {
            LineFault::Refused(error.to_string())
        }
    }
}
