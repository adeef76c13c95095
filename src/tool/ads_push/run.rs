//! The loop that has the connection: it writes poses, hands on what is read, and sees to it that
//! there is a connection.

use super::mailbox::Mailbox;
use super::session::{Found, Link, ReadPlan, Session, Setback, WritePlan, told};
use super::spans::Spans;
use super::trajectory::Trajectory;
use crate::link::{Backoff, HostInstant, Waiter};
use crate::record::{Pose, Stamp, Status};
use crate::stream::{Outcome, Stop};
use crate::tool::ads_push::TOOL;
use crate::twincat::fields::{Sample, bits};
use crate::twincat::image::Image;
use crate::twincat::variables::VariableError;
use crate::twincat::{ClientError, Code};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The first and the longest wait between two attempts to connect.
const FIRST_WAIT: Duration = Duration::from_millis(100);
const LONGEST_WAIT: Duration = Duration::from_secs(2);
/// For how long the first connection is tried, and how long a program that does not fit is borne.
const PATIENCE: Duration = Duration::from_secs(10);
/// A connection that lasted for so long was a good one: losing it is no reason to hold back. Two
/// programs that end each other's connections would do so as fast as they can.
const STEADY: Duration = Duration::from_secs(5);
/// A variable that is refused so soon after it was found and checked again is not refused because
/// the program was changed.
const IN_VAIN: Duration = Duration::from_secs(1);
/// What follows from a write that failed over a good connection.
const POSE_LOST: &str = "The pose may or may not have arrived; the next ones go on";
/// The longest wait between two looks at whether to stop.
const NAP: Duration = Duration::from_millis(50);

/// What is wanted of the loop.
pub(super) struct Wishes {
    pub link: Link,
    pub write: Option<WritePlan>,
    pub read: Option<ReadPlan>,
    pub every: bool,
    pub stale: Duration,
    pub wait: Option<Duration>,
    pub quiet: bool,
    pub verbose: bool,
}

/// What became of the poses.
#[derive(Clone, Copy, Debug, Default)]
struct Tally {
    /// Acknowledged.
    pushed: u64,
    /// Came before the first connection, and a newer one came before it as well.
    early: u64,
    /// Was to be written once more, and a newer one came.
    overtaken: u64,
    /// Came while there was no connection.
    missed: u64,
    /// Sent, and not acknowledged.
    failed: u64,
    /// Connections that were lost.
    lost: u64,
}

impl Tally {
    /// A pose that waited to be written gave way to a newer one.
    fn replace(&mut self, connected: bool) {
        if connected {
            self.overtaken += 1;
        } else {
            self.early += 1;
        }
    }
}

/// The loop's state.
pub(super) struct Run {
    wishes: Wishes,
    mailbox: Option<Arc<Mailbox>>,
    trajectory: Option<Trajectory>,
    waiter: Waiter,
    stop: Stop,
    session: Option<Session>,
    /// What was written last, to go on from there.
    image: Option<Image>,
    backoff: Backoff,
    attempt_due: Instant,
    /// Since when there is no connection that can be used.
    down_since: Option<Instant>,
    /// When the last one was made.
    connected_at: Instant,
    /// When everything was last found again over the same connection.
    renewed_at: Option<Instant>,
    /// Whether there ever was one.
    connected: bool,
    said: String,
    bytes: Vec<u8>,
    /// A pose that is still to be written,
    pending: Option<Pose>,
    /// and when it is tried again, where it was refused.
    retry_due: Instant,
    newest: Pose,
    counter: u64,
    fresh_at: Instant,
    stale_at: Instant,
    tally: Tally,
    spans: Spans,
}

impl Run {
    pub(super) fn new(
        wishes: Wishes,
        mailbox: Option<Arc<Mailbox>>,
        trajectory: Option<Trajectory>,
        waiter: Waiter,
        stop: Stop,
    ) -> Run {
        let now = Instant::now();
        Run {
            wishes,
            mailbox,
            trajectory,
            waiter,
            stop,
            session: None,
            image: None,
            backoff: Backoff::new(FIRST_WAIT, LONGEST_WAIT),
            attempt_due: now,
            down_since: None,
            connected_at: now,
            renewed_at: None,
            connected: false,
            said: String::new(),
            bytes: Vec::new(),
            pending: None,
            retry_due: now,
            newest: Pose {
                status: Status::NO_POSE,
                ..Pose::default()
            },
            counter: 0,
            fresh_at: now,
            stale_at: now,
            tally: Tally::default(),
            spans: Spans::default(),
        }
    }

    /// Runs until the poses end, a signal comes, the points are all there, or nothing helps.
    pub(super) fn run(mut self) -> anyhow::Result<Outcome> {
        let ended = self.turn_until_the_end();
        // A pose that still waits is one that the controller has not got.
        self.tally.missed += u64::from(self.pending.is_some() && self.connected);
        let farewell = self.say_farewell();
        if let Some(mailbox) = &self.mailbox {
            mailbox.close();
        }
        let written = self.trajectory.as_mut().map_or(Ok(()), Trajectory::finish);
        self.sum_up();
        let outcome = ended?;
        written?;
        let points = self.trajectory.as_ref().map_or(0, |t| t.points);
        self.stop.check(self.tally.pushed + points)?;
        let lost = self.tally.missed + self.tally.failed;
        let dropped = self.trajectory.as_ref().map_or(0, |t| t.dropped);
        Ok(if lost + dropped > 0 || !farewell {
            outcome.and(Outcome::Degraded)
        } else {
            outcome
        })
    }

    fn turn_until_the_end(&mut self) -> anyhow::Result<Outcome> {
        let mut over_at: Option<(Instant, super::mailbox::Ended)> = None;
        loop {
            if self.stop.requested() {
                return Ok(Outcome::Done);
            }
            if let Some(trajectory) = &self.trajectory {
                // Beside a push the push goes on.
                if self.mailbox.is_none() && (trajectory.is_full() || trajectory.is_over()) {
                    return Ok(Outcome::Done);
                }
            }
            self.connect()?;
            if let Some(mailbox) = &self.mailbox {
                if (self.pending.is_none() || !self.wishes.every)
                    && let Some(pose) = mailbox.take()
                {
                    self.fresh_at = Instant::now();
                    self.newest.clone_from(&pose);
                    if self.pending.replace(pose).is_some() {
                        self.tally.replace(self.connected);
                    }
                }
                if over_at.is_none()
                    && let Some(ended) = mailbox.ended()
                {
                    over_at = Some((Instant::now(), ended));
                }
            }
            self.push_pending()?;
            if let Some((at, _)) = &over_at {
                // The last pose has a first connection to wait for, and every pose its turn.
                let waits = self.pending.is_some() && at.elapsed() < PATIENCE;
                if !waits || (self.connected && !self.wishes.every) {
                    let ended = over_at.map(|(_, ended)| ended);
                    return ended.unwrap_or(Ok(Outcome::Done));
                }
            }
            self.look_after()?;
            self.wait();
        }
    }

    /// Makes a connection where there is none and it is time.
    fn connect(&mut self) -> anyhow::Result<()> {
        if self.session.is_some() || Instant::now() < self.attempt_due {
            return Ok(());
        }
        let Wishes {
            link, write, read, ..
        } = &self.wishes;
        let older = self.image.as_ref();
        match Session::open(link, write.as_ref(), read.as_ref(), older) {
            Ok(session) => {
                let place = session.client.place().to_owned();
                if !session.state.runs() {
                    self.say(format!(
                        "the PLC is in {}: what is written is not used until it runs",
                        session.state.name()
                    ));
                }
                let down = self.down_since.take();
                if let Some(since) = down.filter(|_| self.connected) {
                    self.say(format!(
                        "{place}: connected again after {:.1} s; everything was found and checked \
                         again",
                        since.elapsed().as_secs_f64()
                    ));
                } else if down.is_some() || self.wishes.verbose {
                    let ams = session.client.source();
                    self.say(format!("{place}: connected as {ams}"));
                }
                self.said.clear();
                self.connected = true;
                self.connected_at = Instant::now();
                self.session = Some(session);
                Ok(())
            }
            Err(setback) => self.set_back(setback),
        }
    }

    /// There is no connection that can be used; an error once the patience is over.
    fn set_back(&mut self, setback: Setback) -> anyhow::Result<()> {
        self.leave();
        let since = *self.down_since.get_or_insert_with(Instant::now);
        let patience = match (&setback, self.connected) {
            (Setback::Unfit(_), false) => Duration::ZERO,
            (Setback::Unfit(_), true) | (Setback::Away(_), false) => {
                self.wishes.wait.unwrap_or(PATIENCE)
            }
            (Setback::Away(_), true) => self.wishes.wait.unwrap_or(Duration::MAX),
        };
        if since.elapsed() >= patience {
            return Err(setback.fault().into());
        }
        let wait = self.backoff.wait();
        let left = patience.saturating_sub(since.elapsed());
        self.attempt_due = Instant::now() + wait.min(left);
        if self.said != setback.text() {
            self.said = setback.text().to_owned();
            self.say(format!("{}; trying again", setback.text()));
        }
        Ok(())
    }

    /// Gives up the connection.
    fn leave(&mut self) {
        if let Some(session) = self.session.take() {
            self.tally.lost += 1;
            if self.connected_at.elapsed() >= STEADY {
                self.backoff.reset();
            }
            if let Some((image, _)) = session.write {
                self.image = Some(image);
            }
        }
    }

    /// Writes the pose that waits, if it can be.
    fn push_pending(&mut self) -> anyhow::Result<()> {
        let Some(pose) = self.pending.take() else {
            return Ok(());
        };
        if self.session.is_some() && Instant::now() < self.retry_due {
            self.pending = Some(pose);
            return Ok(());
        }
        if self.session.is_none() {
            if self.wishes.every || !self.connected {
                self.pending = Some(pose);
            } else {
                self.tally.missed += 1;
                self.settle(None);
            }
            return Ok(());
        }
        match self.write(&pose, 0) {
            Ok(()) => {
                self.tally.pushed += 1;
                self.said.clear();
                self.settle(Some(HostInstant::now().utc));
            }
            Err(error) => {
                // One that finds its handle stale gets another chance at once; a controller that
                // refuses for other reasons is not asked as fast as can be.
                let stale = error.code().is_some_and(Code::is_stale_handle);
                self.see_to(&error, POSE_LOST)?;
                if self.wishes.every || (stale && self.session.is_some()) {
                    let wait = if stale { Duration::ZERO } else { NAP };
                    self.retry_due = Instant::now() + wait;
                    self.pending = Some(pose);
                } else {
                    self.tally.failed += 1;
                    self.settle(None);
                }
            }
        }
        Ok(())
    }

    fn settle(&self, acknowledged: Option<Stamp>) {
        if let Some(mailbox) = &self.mailbox {
            mailbox.settle(acknowledged);
        }
    }

    /// Writes a pose with further bits of status.
    fn write(&mut self, pose: &Pose, further: u32) -> Result<(), ClientError> {
        let Some(session) = &mut self.session else {
            return Ok(());
        };
        let Some((image, handles)) = &mut session.write else {
            return Ok(());
        };
        self.counter += 1;
        let start = Instant::now();
        let sample = Sample {
            pose,
            bits: further,
            counter: self.counter,
            now: HostInstant::now().utc,
        };
        image.fill(&sample, &mut self.bytes);
        handles.write(&mut session.client, &self.bytes, self.wishes.link.timeout)?;
        self.spans.add(start.elapsed());
        self.stale_at = Instant::now();
        Ok(())
    }

    /// Does what an error asks for; `otherwise` is what follows from one that asks for nothing.
    fn see_to(&mut self, error: &ClientError, otherwise: &str) -> anyhow::Result<()> {
        if let Some(code) = error.code() {
            if code.is_stale_handle() || code == Code::SIZE {
                let in_vain = |at: Instant| at.elapsed() < IN_VAIN;
                if self.renewed_at.is_some_and(in_vain) {
                    let text = format!(
                        "{}: {code}, though the variables were found a moment ago and fit",
                        self.wishes.link.target
                    );
                    return self.set_back(Setback::Away(text));
                }
                return self.renew(&format!("{code}"));
            }
            if code.is_absence() {
                let text = told(error, &self.wishes.link, self.client());
                return self.set_back(Setback::Away(text));
            }
        }
        let text = told(error, &self.wishes.link, self.client());
        let silent = self.session.as_ref().is_some_and(Session::is_silent);
        if error.is_fatal() || silent {
            return self.set_back(Setback::Away(text));
        }
        if self.said != text {
            self.say(format!("{text}. {otherwise}"));
            self.said = text;
        }
        Ok(())
    }

    fn client(&self) -> Option<&crate::twincat::Client> {
        self.session.as_ref().map(|session| &session.client)
    }

    /// Finds everything again: the program in the controller has changed.
    fn renew(&mut self, why: &str) -> anyhow::Result<()> {
        let Some(session) = &mut self.session else {
            return Ok(());
        };
        if let Some((image, _)) = &session.write {
            self.image = Some(image.clone());
        }
        let Wishes {
            link, write, read, ..
        } = &self.wishes;
        match session.renew(write.as_ref(), read.as_ref()) {
            Ok(()) => {
                self.renewed_at = Some(Instant::now());
                self.say(format!(
                    "{why}: the variables were found and checked again, and fit"
                ));
                Ok(())
            }
            Err(error) => {
                let setback = match &error {
                    VariableError::Client(ClientError::Refused(code)) if code.is_stale_handle() => {
                        Setback::Away(format!("{}: {code}", link.target))
                    }
                    error => Setback::of(error, link, Some(&session.client)),
                };
                self.set_back(setback)
            }
        }
    }

    /// Everything besides poses: the program's version, the PLC's state, the stale value, what is
    /// read.
    fn look_after(&mut self) -> anyhow::Result<()> {
        let Some(session) = &mut self.session else {
            return Ok(());
        };
        if let Some(trajectory) = &mut self.trajectory {
            let read = session.read(|image, bytes, notified, at| {
                trajectory.take(image, bytes, notified, at);
            });
            let remark = trajectory.remark();
            if let Err(error) = read {
                self.see_to(&error, "The next values are read all the same")?;
            }
            if let Some(remark) = remark {
                self.say(remark.to_owned());
            }
        }
        let Some(session) = &mut self.session else {
            return Ok(());
        };
        if session.is_silent() {
            let waited_ms = session.client.silence().as_millis();
            let error = ClientError::Timeout { waited_ms };
            let text = told(&error, &self.wishes.link, Some(&session.client));
            return self.set_back(Setback::Away(text));
        }
        match session.watch() {
            Ok(Found::Nothing) => {}
            Ok(Found::NewProgram) => self.renew("the program in the controller has changed")?,
            Ok(Found::NewState(state)) => self.say(format!("the PLC is in {} now", state.name())),
            // Nothing but a controller that is away: one that does not tell its state may take poses.
            Err(error) if error.is_fatal() || error.code().is_some_and(Code::is_absence) => {
                self.see_to(&error, "The PLC's state is asked for again")?;
            }
            Err(_) => {}
        }
        let stale = self.wishes.stale;
        if self.session.is_some()
            && self.mailbox.is_some()
            && !stale.is_zero()
            && self.fresh_at.elapsed() >= stale
            && self.stale_at.elapsed() >= stale
        {
            self.stale_at = Instant::now();
            let newest = self.newest.clone();
            if let Err(error) = self.write(&newest, bits::STALE) {
                self.see_to(&error, POSE_LOST)?;
            }
        }
        Ok(())
    }

    /// Waits for a pose, for bytes of the controller, or until something is due.
    fn wait(&mut self) {
        let mut limit = NAP;
        let pending = self.pending.is_some();
        match &mut self.session {
            Some(session) => {
                if pending {
                    let retry = self.retry_due.saturating_duration_since(Instant::now());
                    limit = limit.min(retry);
                }
                limit = limit.min(session.idle());
                if let Err(error) = session.client.wait(&self.waiter, limit) {
                    let text = told(&error, &self.wishes.link, Some(&session.client));
                    // A connection that was lost is always borne at first.
                    let held = self.connected_at.elapsed() >= STEADY;
                    self.down_since.get_or_insert_with(Instant::now);
                    self.leave();
                    self.attempt_due = Instant::now();
                    if !held {
                        self.attempt_due += self.backoff.wait();
                    }
                    self.say(format!("{text}; connecting again"));
                    self.said = text;
                }
            }
            None => {
                let due = self.attempt_due.saturating_duration_since(Instant::now());
                self.waiter.wait(limit.min(due));
            }
        }
    }

    /// Writes the last status, and gives everything back; whether the controller knows.
    fn say_farewell(&mut self) -> bool {
        if self.wishes.write.is_none() {
            if let Some(session) = self.session.take() {
                session.close();
            }
            return true;
        }
        let newest = self.newest.clone();
        let known = self.session.is_some() && self.write(&newest, bits::ENDED).is_ok();
        if let Some(session) = self.session.take() {
            if let Some((image, _)) = &session.write {
                self.image = Some(image.clone());
            }
            session.close();
        }
        if !known && self.connected {
            self.say(
                "the last status could not be written: the controller sees the counter stand still"
                    .to_owned(),
            );
        }
        known || !self.connected
    }

    fn sum_up(&self) {
        let Tally {
            pushed,
            early,
            overtaken,
            missed,
            failed,
            lost,
        } = self.tally;
        if self.wishes.write.is_some() {
            let passed_over = self
                .mailbox
                .as_ref()
                .map_or(0, |mailbox| mailbox.passed_over());
            let mut parts = vec![format!("{pushed} poses written")];
            for (count, what) in [
                (passed_over + overtaken, "passed over for newer ones"),
                (early, "not written before the first connection"),
                (missed, "not written while the controller was away"),
                (failed, "sent and not acknowledged"),
                (lost, "connections lost"),
                (
                    self.image.as_ref().map_or(0, Image::clipped),
                    "numbers cut to their type's range",
                ),
            ] {
                if count > 0 {
                    parts.push(format!("{count} {what}"));
                }
            }
            if parts.len() > 1 || self.wishes.verbose {
                self.say(parts.join(", "));
            }
            if self.wishes.verbose {
                self.say(format!("round trips: {}", self.spans));
            }
        }
        if let Some(trajectory) = &self.trajectory {
            let dropped = trajectory.dropped;
            if dropped > 0 || self.wishes.verbose {
                self.say(format!(
                    "{} points read, {dropped} dropped",
                    trajectory.points
                ));
            }
        }
    }

    fn say(&self, text: String) {
        if !self.wishes.quiet {
            eprintln!("{TOOL}: {text}");
        }
    }
}
