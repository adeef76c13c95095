//! The stream of a unit on a port.

use super::NAME;
use super::arguments::{CommandArgs, SampleArgs, parse_address, parse_baud, parse_port};
use super::polling::Polling;
use super::sink::Sink;
use crate::gx1::framer::FramerCounts;
use crate::gx1::samples::SampleCounts;
use crate::gx1::session::{Identity, Line, Tap};
use crate::gx1::ticks::cycle_ticks;
use crate::gx1::unit_file::{self, UnitFile};
use crate::gx1::{Command, Mode, Samples, Session, SessionError, Setup, samples, wire_time_s};
use crate::link::{
    Backoff, Endpoint, HostInstant, LinkError, RecordingError, Rotation, latency_timer,
};
use crate::stream::{Fault, Options, Outcome, Stop};
use crate::tool::arguments::CommonArgs;
use crate::tool::ending::Ending;
use crate::tool::tee::Tee;
use crate::tool::values::{parse_duration, parse_rotation};
use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::time::{Duration, Instant};

/// Arguments of the live stream.
#[derive(Clone, Debug, clap::Args)]
pub struct LiveArgs {
    /// Serial port of the unit
    #[arg(value_name = "DEVICE", required = true, value_parser = parse_port)]
    pub device: Option<Endpoint>,
    /// End after N samples
    #[arg(short, long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub n_samples: Option<u64>,
    /// End after TIME (30s, 10min)
    #[arg(long = "for", value_name = "TIME", value_parser = parse_duration)]
    pub for_time: Option<Duration>,
    /// The commands
    #[command(flatten)]
    pub commands: CommandArgs,
    /// The samples
    #[command(flatten)]
    pub samples: SampleArgs,
    /// The line
    #[command(flatten)]
    pub line: LineArgs,
    /// The raw bytes
    #[command(flatten)]
    pub recording: RecordingArgs,
    /// The streams
    #[command(flatten)]
    pub common: CommonArgs,
}

/// How the unit is reached.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Line")]
pub struct LineArgs {
    /// Speed of the unit, Bd [default: found by asking at 38400, 115200 and 19200]
    #[arg(long, value_name = "BD", value_parser = parse_baud)]
    pub baud: Option<u32>,
    /// Address of the unit on an RS-485 line (needs --poll; commands up to 0x0F)
    #[arg(long, value_name = "N", value_parser = parse_address, requires = "poll")]
    pub rs485_address: Option<u8>,
    /// Wait this long for the port and the unit to appear
    #[arg(long, value_name = "TIME", default_value = "5s", value_parser = parse_duration)]
    pub wait: Duration,
}

/// The raw bytes of the stream.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Recording")]
pub struct RecordingArgs {
    /// Keep the raw bytes in FILE, with FILE.times.csv and FILE.unit.toml beside it
    #[arg(long, value_name = "FILE")]
    pub tee: Option<PathBuf>,
    /// Begin a new file (FILE.000, FILE.001 ...) after a size (100MB), an age (10min), or either (100MB|10min)
    #[arg(long, value_name = "LIMIT", value_parser = parse_rotation, requires = "tee")]
    pub tee_rotate: Option<Rotation>,
    /// Leave the unit streaming at the end
    #[arg(long)]
    pub leave_streaming: bool,
}

/// The longest wait for bytes between two looks at what else there is to do.
const SLICE: Duration = Duration::from_millis(20);

/// Silence for which the unit is taken to be away, and in periods.
const SILENCE: Duration = Duration::from_millis(500);
const SILENT_PERIODS: f64 = 20.0;

/// For how long a unit is asked for on a port that is open, before the port is opened anew.
const RETRY_WAIT: Duration = Duration::from_millis(300);

/// Streams until the end.
pub(super) fn run(args: LiveArgs) -> anyhow::Result<Outcome> {
    let device = args.device.clone();
    let device = device.ok_or_else(|| Fault::Usage("a serial port is wanted".into()))?;
    let bus = args.line.rs485_address;
    let commands = args.commands.commands(bus.is_some());
    if let (Some(_), Some(command)) = (bus, commands.iter().find(|c| c.bus_byte(0).is_none())) {
        let text = SessionError::NotOnBus(*command).to_string();
        return Err(Fault::Usage(text).into());
    }
    if commands.len() > 4 {
        return Err(Fault::Usage("at most four commands at a time".into()).into());
    }
    let mut options = args.common.options(NAME)?;
    let frame = args.samples.frame()?;
    options.configuration = frame.as_ref().map(|(_, text)| text.clone());
    if let Some(tee) = &args.recording.tee {
        refuse_one_file(tee, args.recording.tee_rotate.unwrap_or_default(), &options)?;
    }
    let ending = Ending::new(Stop::install()?, &options);
    warn_of_timer(&device, &options);
    let rotation = args.recording.tee_rotate.unwrap_or_default();
    let tee = Tee::new(NAME, args.recording.tee.as_deref(), rotation);
    let mut live = Live {
        mode: args.commands.poll.map_or(Mode::Continuous, Mode::Polled),
        device,
        commands,
        args,
        options,
        ending,
        tee,
        baud: None,
        outages: 0,
        past: FramerCounts::default(),
    };
    let mut session = match live.first_session() {
        Ok(session) => session,
        Err(error) => return live.failed_start(error),
    };
    let (identity, setup) = match live.get_to_know(&mut session) {
        Ok(known) => known,
        Err(error) => {
            session.stop();
            return live.failed_start(error);
        }
    };
    let frame = frame.as_ref().map(|(frame, _)| frame);
    let mut sink = Sink::open(
        &live.options,
        &live.args.samples,
        frame,
        &live.commands,
        live.args.n_samples,
    )?;
    live.begin_recording(&setup, identity)?;
    let mut samples = Samples::new(setup);
    if bus.is_some() {
        samples.begin();
    }
    let ended = live.stream(session, identity, &mut samples, &mut sink);
    live.finish(ended, samples, sink)
}

/// A stream and all that lives as long as it does.
struct Live {
    args: LiveArgs,
    options: Options,
    device: Endpoint,
    commands: Vec<Command>,
    mode: Mode,
    ending: Rc<Ending>,
    tee: Rc<RefCell<Tee>>,
    /// The unit's speed, once it is known.
    baud: Option<u32>,
    outages: u64,
    /// Counts of the sessions that have ended.
    past: FramerCounts,
}

impl Live {
    /// Opens the port and finds the unit, waiting for both.
    fn first_session(&self) -> Result<Session, SessionError> {
        let start = Instant::now();
        let wait = self.args.line.wait;
        let mut backoff = Backoff::new(Duration::from_millis(50), Duration::from_millis(500));
        loop {
            let left = wait.saturating_sub(start.elapsed());
            match self.open(self.args.line.baud, left.max(Duration::from_millis(1))) {
                // A port that is not there yet may come; one that is refused will not.
                Err(SessionError::Link(error)) if left.is_zero() || !may_come(&error) => {
                    return Err(error.into());
                }
                Err(SessionError::Link(_)) => self.ending.sleep(backoff.wait()),
                other => return other,
            }
            if self.ending.reached() {
                return Err(SessionError::Interrupted);
            }
        }
    }

    fn open(&self, baud: Option<u32>, wait: Duration) -> Result<Session, SessionError> {
        let bauds: Vec<u32> = baud.into_iter().collect();
        let tee = Rc::clone(&self.tee);
        tee.borrow_mut().new_session();
        let tap = move |bytes: &[u8], at: HostInstant| tee.borrow_mut().chunk(bytes, at);
        let tap: Tap = Box::new(tap);
        let line = Line {
            port: &self.device,
            bauds: &bauds,
            bus_address: self.args.line.rs485_address,
        };
        let interrupted = || self.ending.reached();
        Session::open(&line, &self.commands, Some(tap), wait, &interrupted)
    }

    /// Asks the unit who it is and what its numbers mean.
    fn get_to_know(&mut self, session: &mut Session) -> Result<(Identity, Setup), SessionError> {
        let interrupted = || self.ending.reached();
        let identity = session.identity(&interrupted)?;
        let gains = match self.args.samples.gains {
            Some(gains) => gains,
            None => session.gains(&interrupted)?,
        };
        let setup = Setup {
            commands: self.commands.clone(),
            mode: self.mode,
            gains,
            tick: session.tick(&interrupted)?,
            baud: session.baud(),
            accel_sign: self.args.samples.accel_sign,
            quaternion: self.args.samples.quaternion.0,
        };
        self.baud = Some(session.baud());
        self.say_setup(session, identity, &setup);
        Ok((identity, setup))
    }

    fn say_setup(&self, session: &Session, identity: Identity, setup: &Setup) {
        let place = session.place();
        if self.options.verbose > 0 {
            eprintln!(
                "{NAME}: {place}: 3DM-GX1 number {}, firmware {}, {} Bd, tick {} ms, gains {} {} {}",
                identity.serial,
                super::firmware(identity),
                setup.baud,
                setup.tick.tick_s() * 1e3,
                setup.gains.accel,
                setup.gains.rate,
                setup.gains.mag,
            );
        }
        let leading = self.commands.first().copied().unwrap_or(Command::Null);
        let cycle_s = match self.mode {
            Mode::Continuous => f64::from(cycle_ticks(leading, true)) * setup.tick.tick_s(),
            Mode::Polled(hz) => 1.0 / hz,
        };
        let bytes: usize = self.commands.iter().map(|c| c.reply_length()).sum();
        let wire_s = wire_time_s(bytes, setup.baud);
        if wire_s > cycle_s && !self.options.quiet {
            eprintln!(
                "{NAME}: {place}: {bytes} bytes take {:.1} ms at {} Bd, more than the {:.1} ms of a \
                 cycle: at most {:.0} samples a second will come; raise the speed (cell 44) or ask \
                 for less",
                wire_s * 1e3,
                setup.baud,
                cycle_s * 1e3,
                samples::most_per_second(&self.commands, setup.baud),
            );
        }
    }

    fn begin_recording(&self, setup: &Setup, identity: Identity) -> anyhow::Result<()> {
        let Some(path) = &self.args.recording.tee else {
            return Ok(());
        };
        let mut unit = UnitFile::new(identity, setup.baud, setup.gains, setup.tick);
        unit.commands = self.commands.iter().map(|command| command.byte()).collect();
        if let Mode::Polled(hz) = self.mode {
            unit.poll_hz = Some(hz);
        }
        unit.bus_address = self.args.line.rs485_address;
        let unwritten = |error: RecordingError| Fault::Io(error.to_string());
        self.tee.borrow_mut().open().map_err(unwritten)?;
        unit.save_beside(path).map_err(unwritten)?;
        Ok(())
    }

    /// Streams over as many sessions as it takes, until the end is reached.
    fn stream(
        &mut self,
        session: Session,
        identity: Identity,
        samples: &mut Samples,
        sink: &mut Sink,
    ) -> anyhow::Result<()> {
        let mut session = session;
        loop {
            let ended = self.session(&mut session, samples, sink);
            let count = session.counts();
            self.past.skipped += count.skipped + session.pending();
            self.past.bad_sums += count.bad_sums;
            let cause = match ended {
                Ok(()) => {
                    // What the unit says while it is stopped is no part of the stream.
                    session.end_tap();
                    self.leave(session);
                    return Ok(());
                }
                Err(error) => match error.downcast::<SessionError>() {
                    Ok(cause) => cause,
                    Err(error) => {
                        self.leave(session);
                        return Err(error);
                    }
                },
            };
            drop(session);
            sink.flush()?;
            match self.find_again(&cause, identity)? {
                Some(again) => session = again,
                None => {
                    self.remark("the unit is away and could not be told to stop");
                    return Ok(());
                }
            }
        }
    }

    /// Streams over one session until the end is reached; an error is the end of the session.
    fn session(
        &self,
        session: &mut Session,
        samples: &mut Samples,
        sink: &mut Sink,
    ) -> anyhow::Result<()> {
        let interrupted = || self.ending.reached();
        if self.mode == Mode::Continuous {
            match session.start(samples.leading(), &interrupted) {
                Err(SessionError::Interrupted) => return Ok(()),
                other => other?,
            }
        }
        if let Some(span) = self.args.for_time {
            self.ending.due_in(span);
        }
        let mut polling = Polling::new(self.mode, &self.commands);
        // The last sign of life, and how many replies had repeated by then.
        let (mut last_sign, mut repeated) = (Instant::now(), samples.counts().repeated);
        loop {
            let mut led = false;
            let before = samples.counts();
            while let Some(arrived) = session.next() {
                let command = arrived.packet.command();
                led |= command == samples.leading();
                polling.answered(command);
                samples.push(&arrived);
            }
            // A reply that repeats is no sign of life.
            let alive = |counts: SampleCounts| counts.replies - counts.repeated;
            let now = samples.counts();
            if alive(now) > alive(before) {
                (last_sign, repeated) = (Instant::now(), now.repeated);
            }
            let writing = Instant::now();
            sink.drain(samples)?;
            if sink.done() || self.ending.reached() {
                return Ok(());
            }
            sink.flush()?;
            // A consumer that is slow is no silence of the unit.
            last_sign += writing.elapsed();
            polling.ask(session, led)?;
            let longest = longest_silence(samples.period_s());
            if last_sign.elapsed() > longest {
                let place = session.place().to_owned();
                let waited_s = longest.as_secs_f64();
                let error = if now.repeated > repeated {
                    SessionError::Hangs { place, waited_s }
                } else {
                    SessionError::Silent { place, waited_s }
                };
                return Err(error.into());
            }
            session.read(polling.wait(SLICE))?;
        }
    }

    /// Looks for the unit until it is back; none where the end is reached before.
    fn find_again(
        &mut self,
        cause: &SessionError,
        identity: Identity,
    ) -> anyhow::Result<Option<Session>> {
        let away = Instant::now();
        self.outages += 1;
        self.remark(&format!("{cause}; looking for the unit until it is back"));
        while !self.ending.reached() {
            let mut session = match self.open(self.baud, RETRY_WAIT) {
                Ok(session) => session,
                Err(SessionError::Interrupted) => return Ok(None),
                Err(_) => {
                    self.ending.sleep(SLICE * 2);
                    continue;
                }
            };
            match session.identity(&|| self.ending.reached()) {
                Ok(now) if now.serial != identity.serial => {
                    let text = format!(
                        "{}: number {} answers in place of {}: another unit, whose gains are \
                         others; start anew with it",
                        session.place(),
                        now.serial,
                        identity.serial
                    );
                    return Err(Fault::Unavailable(text).into());
                }
                Ok(_) => {
                    let away_s = away.elapsed().as_secs_f64();
                    let place = session.place();
                    self.remark(&format!("{place}: back after {away_s:.2} s"));
                    return Ok(Some(session));
                }
                Err(SessionError::Interrupted) => {
                    session.stop();
                    return Ok(None);
                }
                Err(_) => {}
            }
        }
        Ok(None)
    }

    /// Leaves the unit as it should be left.
    fn leave(&self, mut session: Session) {
        if self.args.recording.leave_streaming || session.streaming().is_none() {
            return;
        }
        if !session.stop() {
            let place = session.place();
            self.remark(&format!(
                "{place}: the unit did not confirm that it stopped"
            ));
        }
    }

    fn finish(
        &mut self,
        ended: anyhow::Result<()>,
        mut samples: Samples,
        mut sink: Sink,
    ) -> anyhow::Result<Outcome> {
        let recorded = self.tee.borrow_mut().finish(None);
        ended?;
        samples.finish();
        sink.drain(&mut samples)?;
        let written = sink.finish()?;
        // A full disk of the recording does not cost the records.
        recorded.map_err(|error| Fault::Io(error.to_string()))?;
        let counts = samples.counts();
        if self.options.verbose > 0 {
            eprintln!(
                "{NAME}: {} samples, {} replies lost by the ticks, {} repeated, {} late, {} implausible, {} \
                 bytes skipped, {} bad sums, {} reconnections",
                written,
                counts.lost,
                counts.repeated,
                counts.late,
                counts.implausible,
                self.past.skipped,
                self.past.bad_sums,
                self.outages,
            );
        }
        self.ending.check(written)?;
        let lost = counts.lost + counts.implausible + counts.restarts + self.outages;
        if lost > 0 {
            self.remark(&format!(
                "{} samples written, {} lost, {} outages",
                written, counts.lost, self.outages
            ));
            return Ok(Outcome::Degraded);
        }
        Ok(Outcome::Done)
    }

    /// The end of a start that failed: a signal, or no unit.
    fn failed_start(&self, error: SessionError) -> anyhow::Result<Outcome> {
        if matches!(error, SessionError::Interrupted) {
            self.ending.check(0)?;
            return Ok(Outcome::Done);
        }
        let text = match &error {
            SessionError::Link(LinkError::Open { .. }) => {
                format!("{error}; 'imu-read list' shows the ports there are")
            }
            SessionError::NoAnswer { .. } if self.args.samples.gains.is_none() => {
                format!("{error}; the unit's gains must be known: --gains states them")
            }
            _ => error.to_string(),
        };
        Err(Fault::Unavailable(text).into())
    }

    fn remark(&self, text: &str) {
        if !self.options.quiet {
            eprintln!("{NAME}: {text}");
        }
    }
}

/// For how long a unit with this usual time between its replies may be silent before it is taken to
/// be away.
fn longest_silence(period_s: Option<f64>) -> Duration {
    period_s.map_or(2 * SILENCE, |period_s| {
        SILENCE.max(Duration::from_secs_f64(
            (period_s * SILENT_PERIODS).min(60.0),
        ))
    })
}

/// Whether an error may go away by itself: a port that is not there yet.
fn may_come(error: &LinkError) -> bool {
    match error {
        LinkError::Open { reason, .. } => !reason.contains("denied") && !reason.contains("ninth"),
        _ => true,
    }
}

/// Warns where an adapter holds bytes back for long.
fn warn_of_timer(device: &Endpoint, options: &Options) {
    let Endpoint::Serial(path) = device else {
        return;
    };
    if let Some(timer) = latency_timer(path)
        && timer.ms > 1
        && !options.quiet
    {
        let file = timer.file.display();
        eprintln!(
            "{NAME}: {}: the adapter holds bytes back for up to {} ms, which costs accuracy of time \
             (0.5 ms instead of 0.02 ms); set it to 1 ms: echo 1 | sudo tee {file}",
            path.display(),
            timer.ms
        );
    }
}

/// Refuses to write the records and the raw bytes into one file.
fn refuse_one_file(tee: &Path, rotation: Rotation, options: &Options) -> anyhow::Result<()> {
    let Some(output) = &options.output else {
        return Ok(());
    };
    let absolute = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let (tee, output) = (absolute(tee), absolute(output));
    let partial = PathBuf::from(format!("{}.partial", output.display()));
    let both = [&output, &partial];
    let one = both.into_iter().any(|path| {
        crate::link::would_write(&tee, rotation, path) || *path == unit_file::beside(&tee)
    });
    if one {
        let text = format!(
            "{}: --tee and -o would write the same file",
            output.display()
        );
        return Err(Fault::Usage(text).into());
    }
    Ok(())
}
