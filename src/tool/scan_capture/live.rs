//! What every scanner's capture has in common: connecting and connecting again, time limits,
//! outages, the end.
//!
//! A record goes out before the line is read again, so that it is not held back; nothing is started
//! beside this one loop.

use super::NAME;
use super::args::{Args, DeviceKind};
use crate::link::{Backoff, Endpoint, RecordingError};
use crate::record::Scan;
use crate::stream::{Fault, Options, Outcome, Output, Place, WindowState};
use crate::tool::ending::Ending;
use crate::tool::tee::Tee;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;
use std::time::{Duration, Instant};

/// The longest wait for bytes between two looks at whether to end.
const GLANCE: Duration = Duration::from_millis(100);
/// The waits between two attempts to connect.
const BACKOFF: [Duration; 2] = [Duration::from_millis(100), Duration::from_secs(1)];
/// How long a scanner may take to be ready, unless told.
const READY: Duration = Duration::from_secs(60);
/// No two remarks on lost scans, or on bad pieces, come closer than this.
const REMARKS_APART: Duration = Duration::from_secs(1);

/// Why there is no stream (any more).
#[derive(Debug)]
pub(super) enum LineFault {
    /// The next attempt may have more luck.
    Down(String),
    /// The device says no. One that has given scans before will again: it is busy, or starts.
    Refused(String),
    /// No attempt will have more luck.
    Hopeless(anyhow::Error),
    /// The capture is to end.
    Ended,
}

/// Something that has come from the device.
pub(super) enum Heard {
    /// A scan, which [`Scanner::scan`] now gives.
    Scan,
    /// Something that is no good; the text says what.
    Fault(String),
}

/// What speaks to one kind of device.
pub(super) trait Scanner {
    /// Connects and lets the device send scans. Called again after every outage.
    ///
    /// `deadline` is until when a device that answers is waited for to be ready.
    fn start(&mut self, deadline: Instant) -> Result<(), LineFault>;
    /// Waits for bytes at most `timeout`.
    fn wait(&mut self, timeout: Duration) -> Result<(), LineFault>;
    /// The next thing that has come; none until [`Scanner::wait`] has more.
    fn next(&mut self) -> Option<Heard>;
    /// The newest scan.
    fn scan(&self) -> &Scan;
    /// Where the newest scan's telegram ended in this connection's stream, for the recording.
    fn scan_end(&self) -> u64;
    /// Silence longer than this means that the line is down.
    fn patience(&self) -> Duration;
    /// Whether the device has answered at all, now or before.
    fn has_answered(&self) -> bool;
    /// Scans lost so far, by the device's count.
    fn lost(&self) -> u64;
    /// Times that the device was found restarted so far.
    fn restarts(&self) -> u64;
    /// Lets the device send no more and closes the line.
    fn stop(&mut self);
    /// Closes a line that is down.
    fn hang_up(&mut self);
    /// What is known of the device, for the stream's provenance.
    fn notes(&self) -> BTreeMap<String, String>;
    /// What is to be said at the end, with how verbose to be.
    fn summary(&self, verbose: u8) -> Vec<String>;
}

/// The limits of a capture.
#[derive(Clone, Debug)]
pub(super) struct Settings {
    device: Endpoint,
    kind: DeviceKind,
    n_scans: Option<u64>,
    span: Option<Duration>,
    wait: Option<Duration>,
}

impl Settings {
    pub(super) fn new(device: Endpoint, args: &Args) -> Settings {
        Settings {
            device,
            kind: args.live.kind,
            n_scans: args.n_scans,
            span: args.live.span,
            wait: args.live.wait,
        }
    }
}

/// Captures until the end, and leaves the device sending nothing.
pub(super) fn run<S: Scanner>(
    scanner: S,
    settings: &Settings,
    options: Options,
    ending: &Rc<Ending>,
    tee: &Rc<RefCell<Tee>>,
) -> anyhow::Result<Outcome> {
    let mut capture = Capture {
        scanner,
        settings,
        window: WindowState::new(options.window),
        options,
        ending,
        output: None,
        scans: 0,
        written: 0,
        faults: 0,
        outages: 0,
        newest: None,
        told: Told::default(),
        done: None,
    };
    let streamed = capture.all();
    ending.set_over();
    // The recording ends where the records do.
    let recorded = tee.borrow_mut().finish(capture.done);
    // The last record does not wait for the device's farewell.
    let flushed = capture.flush();
    capture.scanner.stop();
    streamed?;
    flushed?;
    capture.finish(recorded)
}

struct Capture<'a, S> {
    scanner: S,
    settings: &'a Settings,
    options: Options,
    ending: &'a Ending,
    window: WindowState,
    output: Option<Output>,
    /// Scans that came.
    scans: u64,
    /// Scans that were written.
    written: u64,
    faults: u64,
    outages: u64,
    /// When the last scan came.
    newest: Option<Instant>,
    told: Told,
    /// Where in the stream the last scan wanted ended: there is no more to do.
    done: Option<u64>,
}

/// What has been said about losses, and about bad pieces.
#[derive(Default)]
struct Told {
    lost: u64,
    restarts: u64,
    at: Option<Instant>,
    faults: u64,
    faults_at: Option<Instant>,
    /// The last of them.
    fault: String,
}

/// A line that is down.
struct Outage {
    /// When the last scan came.
    since: Instant,
}

impl<S: Scanner> Capture<'_, S> {
    /// Connects and streams until the end.
    fn all(&mut self) -> anyhow::Result<()> {
        let mut backoff = Backoff::new(BACKOFF[0], BACKOFF[1]);
        let began = Instant::now();
        let mut outage: Option<Outage> = None;
        let mut said = String::new();
        while !self.over() {
            let deadline = match self.scans {
                0 => began + self.settings.wait.unwrap_or(READY),
                _ => Instant::now() + READY,
            };
            let down = match self.scanner.start(deadline) {
                Ok(()) => {
                    said.clear();
                    let before = self.scans;
                    let result = self.stream(&mut outage);
                    if self.scans > before {
                        backoff.reset();
                    }
                    result?
                }
                Err(fault) => Some(fault),
            };
            match down {
                // The line stays open, for the farewell.
                None | Some(LineFault::Ended) => return Ok(()),
                Some(LineFault::Hopeless(error)) => return Err(error),
                Some(LineFault::Refused(reason)) if self.scans == 0 => {
                    return Err(Fault::Unavailable(reason).into());
                }
                Some(fault @ (LineFault::Down(_) | LineFault::Refused(_))) => {
                    self.scanner.hang_up();
                    self.down(&fault, began, &mut outage, &mut said)?;
                }
            }
            self.flush()?;
            self.ending.sleep(backoff.wait());
        }
        Ok(())
    }

    fn over(&self) -> bool {
        self.done.is_some() || self.ending.reached()
    }

    /// Takes scans until the line is down or the end has come (none).
    fn stream(&mut self, outage: &mut Option<Outage>) -> anyhow::Result<Option<LineFault>> {
        if self.output.is_none() {
            self.options.notes = self.scanner.notes();
            self.output = Some(Output::open(&self.options)?);
        }
        let mut last = Instant::now();
        loop {
            let mut heard = false;
            while let Some(what) = self.scanner.next() {
                match what {
                    Heard::Scan => {
                        heard = true;
                        if let Some(outage) = outage.take() {
                            self.back(&outage);
                        }
                        self.scan()?;
                        if self.done.is_some() {
                            return Ok(None);
                        }
                    }
                    Heard::Fault(text) => {
                        self.faults += 1;
                        self.told.fault = text;
                        self.tell_faults();
                    }
                }
            }
            if heard {
                last = Instant::now();
                self.tell_losses(false);
            }
            self.tell_faults();
            self.flush()?;
            if self.ending.reached() {
                return Ok(None);
            }
            let left = self.scanner.patience().saturating_sub(last.elapsed());
            if left.is_zero() {
                let silent_s = last.elapsed().as_secs_f64();
                let text = format!("no scan for {silent_s:.1} s");
                return Ok(Some(LineFault::Down(text)));
            }
            let timeout = self.ending.shortened(left.min(GLANCE));
            if let Err(fault) = self.scanner.wait(timeout) {
                return Ok(Some(fault));
            }
        }
    }

    /// Writes the newest scan, if it is wanted.
    fn scan(&mut self) -> anyhow::Result<()> {
        if self.scans == 0
            && let Some(span) = self.settings.span
        {
            self.ending.due_in(span);
        }
        self.scans += 1;
        self.newest = Some(Instant::now());
        let scan = self.scanner.scan();
        match (self.window.place(scan.stamp), &mut self.output) {
            (Place::Inside, Some(output)) => {
                output.write(scan)?;
                self.written += 1;
                if self
                    .settings
                    .n_scans
                    .is_some_and(|most| self.written >= most)
                {
                    self.done = Some(self.scanner.scan_end());
                }
            }
            (Place::After, _) => self.done = Some(self.scanner.scan_end()),
            _ => {}
        }
        Ok(())
    }

    fn flush(&mut self) -> anyhow::Result<()> {
        match &mut self.output {
            Some(output) => output.flush(),
            None => Ok(()),
        }
    }

    /// What is said and done when the line is found down.
    fn down(
        &mut self,
        fault: &LineFault,
        began: Instant,
        outage: &mut Option<Outage>,
        said: &mut String,
    ) -> anyhow::Result<()> {
        let place = &self.settings.device;
        let (LineFault::Down(reason) | LineFault::Refused(reason)) = fault else {
            return Ok(());
        };
        if self.scans == 0 {
            let patient = self.settings.wait.is_some() || self.scanner.has_answered();
            let late = began.elapsed() >= self.settings.wait.unwrap_or(READY);
            if !patient || late {
                let reason = with_place(place, reason);
                let advice = advice(place, self.settings.kind, patient);
                return Err(Fault::Unavailable(format!("{reason}. {advice}")).into());
            }
            if said != reason {
                self.remark(&format!("{}; trying again", with_place(place, reason)));
                reason.clone_into(said);
            }
            return Ok(());
        }
        if outage.is_none() {
            self.outages += 1;
            self.tell_losses(true);
            self.remark(&format!("{}; reconnecting", with_place(place, reason)));
            reason.clone_into(said);
            *outage = Some(Outage {
                since: self.newest.unwrap_or_else(Instant::now),
            });
        } else if said != reason
            && (self.options.verbose > 0 || matches!(fault, LineFault::Refused(_)))
        {
            // A refusal may need somebody's help; that a line stays down is known.
            self.remark(&with_place(place, reason));
            reason.clone_into(said);
        }
        Ok(())
    }

    /// Says how long an outage lasted and what it cost, now that the first scan after it is there.
    fn back(&mut self, outage: &Outage) {
        let lost = self.scanner.lost().saturating_sub(self.told.lost);
        let restarted = self.scanner.restarts() > self.told.restarts;
        let how = if restarted {
            "about, by the time: the device was restarted"
        } else {
            "by its count"
        };
        let cost = match lost {
            0 => String::new(), // a poller does not miss the scans it has not asked for
            lost => format!("; {lost} lost ({how})"),
        };
        let text = format!(
            "{}: scans again after {:.2} s{cost}",
            self.settings.device,
            outage.since.elapsed().as_secs_f64(),
        );
        self.told.lost = self.scanner.lost();
        self.told.restarts = self.scanner.restarts();
        self.remark(&text);
    }

    /// Says what was lost while the line was up, not too often.
    fn tell_losses(&mut self, now: bool) {
        let lost = self.scanner.lost().saturating_sub(self.told.lost);
        let recent = self.told.at.is_some_and(|at| at.elapsed() < REMARKS_APART);
        if lost == 0 || (recent && !now) {
            return;
        }
        self.told.lost += lost;
        self.told.at = Some(Instant::now());
        let seq = self.scanner.scan().seq;
        self.remark(&format!(
            "{}: {lost} scans lost before scan {seq}",
            self.settings.device
        ));
    }

    /// Says what was skipped: at once, but not too often. The end has the sum.
    fn tell_faults(&mut self) {
        let new = self.faults - self.told.faults;
        let since = self.told.faults_at.map(|at| at.elapsed());
        if new == 0 || since.is_some_and(|since| since < REMARKS_APART) {
            return;
        }
        self.told.faults = self.faults;
        self.told.faults_at = Some(Instant::now());
        let (place, last) = (&self.settings.device, &self.told.fault);
        self.remark(&match new {
            1 => format!("{place}: {last}"),
            new => format!("{place}: {new} bad pieces, the last: {last}"),
        });
    }

    fn finish(mut self, recorded: Result<(), RecordingError>) -> anyhow::Result<Outcome> {
        self.tell_losses(true);
        if let Some(output) = self.output.take() {
            self.ending.check(output.records())?;
            output.finish_kind::<Scan>()?;
        } else {
            self.ending.check(0)?;
        }
        let lost = self.scanner.lost();
        let mut lines = self.scanner.summary(self.options.verbose);
        if self.options.verbose > 0 {
            lines.insert(0, format!("{} scans, {} written", self.scans, self.written));
        }
        if self.options.verbose > 0 || lost > 0 || self.outages > 0 || self.faults > 0 {
            let (outages, faults) = (self.outages, self.faults);
            lines.push(format!(
                "{lost} scans lost, {outages} outages, {faults} bad pieces skipped"
            ));
        }
        for line in lines {
            self.remark(&format!("{}: {line}", self.settings.device));
        }
        if let Err(error) = recorded {
            return Err(Fault::Io(format!("{error}: the recording is incomplete")).into());
        }
        let degraded = lost > 0 || self.outages > 0 || self.faults > 0;
        Ok(if degraded {
            Outcome::Degraded
        } else {
            Outcome::Done
        })
    }

    fn remark(&self, text: &str) {
        if !self.options.quiet {
            eprintln!("{NAME}: {text}");
        }
    }
}

/// `reason`, with the device's place before it where it does not begin with one.
fn with_place(place: &Endpoint, reason: &str) -> String {
    let host = match place {
        Endpoint::Tcp { host, .. } => host.clone(),
        Endpoint::Serial(path) => path.display().to_string(),
    };
    if reason.contains(&host) {
        reason.to_owned()
    } else {
        format!("{place}: {reason}")
    }
}

/// What to try where a device cannot be reached.
fn advice(place: &Endpoint, kind: DeviceKind, waited: bool) -> String {
    let text = match (place, kind) {
        (Endpoint::Tcp { .. }, DeviceKind::Hokuyo) => {
            "Is the scanner on, is it one that speaks SCIP 2.0, is this its address (192.168.0.10 \
             as delivered) and port (10940), and is no other program connected to it?"
        }
        (Endpoint::Tcp { .. }, DeviceKind::Sick) => {
            "Is the scanner on, is this its address (192.168.0.1 as delivered) and port (2112 or \
             2111), and is the host in its network?"
        }
        (Endpoint::Serial(_), _) => {
            "Is this the port (scan-capture list shows them), may you open it (group dialout), and \
             is no other program using it?"
        }
    };
    let more = match waited {
        true => "",
        false => " --wait 60s waits for one that is being switched on",
    };
    format!("{text}{more}")
}
