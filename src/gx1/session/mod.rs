//! The talk with a unit: finding its speed, stopping and starting its stream, questions and answers.
//!
//! A unit may be streaming anything when the line is opened, may have half a command in its input,
//! and may be at any of three speeds. So nothing rests on flushing buffers: the stream is stopped
//! and the unit's own confirmation awaited, and a question that was not answered in time is only
//! asked again after another one has been answered, so that no late answer is taken for a new one.

mod cells;

pub use cells::{Identity, write_request};

use super::command::{Command, LONGEST_REPLY, Word};
use super::framer::{Arrived, Framer, FramerCounts};
use super::packet::Packet;
use super::scale::GainsError;
use super::ticks::TickError;
use super::{BAUD_RATES, wire_time_s};
use crate::link::{Connection, Endpoint, HostInstant, LinkError, Received};
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Why a talk ended.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// The line.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// No unit was found on the line.
    #[error(
        "{place}: no 3DM-GX1 answered at {rates} Bd within {waited_s:.1} s ({heard}); check its power \
         and cable, and that it is set to RS-232"
    )]
    NoUnit {
        /// The port.
        place: String,
        /// The speeds tried.
        rates: String,
        /// How long was asked, s.
        waited_s: f64,
        /// What came instead.
        heard: String,
    },
    /// A question was not answered.
    #[error("{place}: no answer to {asked} within {waited_s:.1} s, asked {times} times")]
    NoAnswer {
        /// The port.
        place: String,
        /// The command.
        asked: String,
        /// For how long in all, s.
        waited_s: f64,
        /// How often.
        times: u32,
    },
    /// A unit that streamed falls silent.
    #[error("{place}: nothing came for {waited_s:.1} s")]
    Silent {
        /// The port.
        place: String,
        /// For how long, s.
        waited_s: f64,
    },
    /// A unit, or its adapter, says the same over and over.
    #[error("{place}: nothing but the same reply came for {waited_s:.1} s")]
    Hangs {
        /// The port.
        place: String,
        /// For how long, s.
        waited_s: f64,
    },
    /// The gains make no sense.
    #[error("{place}: {reason}")]
    Gains {
        /// The port.
        place: String,
        /// Why.
        reason: GainsError,
    },
    /// The tick makes no sense.
    #[error("{place}: {reason}")]
    Tick {
        /// The port.
        place: String,
        /// Why.
        reason: TickError,
    },
    /// A cell holds something else after it was written.
    #[error("{place}: cell {address} was to hold {wanted} and reads {got}: not written")]
    NotWritten {
        /// The port.
        place: String,
        /// The cell.
        address: u16,
        /// What was written.
        wanted: u16,
        /// What is in it.
        got: u16,
    },
    /// A command that has no room on RS-485.
    #[error("{0} cannot be asked on RS-485: only commands up to 0x0F can")]
    NotOnBus(Command),
    /// A cell whose address does not fit into a command of RS-485.
    #[error("cell {0} cannot be reached on RS-485: only those up to 254 can")]
    FarCell(u16),
    /// The caller wants to end.
    #[error("interrupted")]
    Interrupted,
}

/// The line that a unit is at.
#[derive(Clone, Copy, Debug)]
pub struct Line<'a> {
    /// The port.
    pub port: &'a Endpoint,
    /// The speeds at which the unit is looked for, Bd; all three, if empty.
    pub bauds: &'a [u32],
    /// The unit's address on RS-485, where it only answers questions; none on RS-232.
    pub bus_address: Option<u8>,
}

/// Asked often while something is waited for: whether the caller wants to end.
pub type Interrupted<'a> = &'a dyn Fn() -> bool;

/// What takes every piece of bytes as it comes, with its time.
pub type Tap = Box<dyn FnMut(&[u8], HostInstant)>;

/// For how long the unit's confirmation of a stop is awaited at one speed: a cycle of 3 ticks of
/// 10 ms, a reply at 19.2 kBd and an adapter's timer have room in it.
const STOP_WAIT: Duration = Duration::from_millis(150);

/// For how long an answer is awaited. The slowest cycle (3 ticks of 100 ms) has room in it.
const ANSWER_WAIT: Duration = Duration::from_millis(700);

/// How often a question is asked.
const TIMES: u32 = 4;

/// How long a write to the line may take.
const WRITE_WAIT: Duration = Duration::from_millis(500);

/// The longest that a read waits, so that the caller's wish to end is seen.
const SLICE: Duration = Duration::from_millis(50);

/// An open line with a unit at its end.
pub struct Session {
    connection: Connection,
    framer: Framer,
    baud: u32,
    tap: Option<Tap>,
    queue: VecDeque<Arrived>,
    buffer: Vec<u8>,
    streaming: Option<Command>,
    /// Address of the unit on RS-485.
    bus: Option<u8>,
}

impl Session {
    /// Opens a port, finds the unit's speed, waiting for the unit as long as `wait`, and stops
    /// whatever it streams. `keep` are the commands whose replies shall not be passed over; `tap`
    /// sees every byte.
    ///
    /// # Errors
    /// [`SessionError::Link`] where the port cannot be opened or, for RS-485, cannot send a ninth
    /// bit; [`SessionError::NoUnit`] where no unit answers.
    pub fn open(
        line: &Line<'_>,
        keep: &[Command],
        tap: Option<Tap>,
        wait: Duration,
        interrupted: Interrupted<'_>,
    ) -> Result<Session, SessionError> {
        let bauds = match line.bauds {
            [] => &BAUD_RATES,
            given => given,
        };
        let baud = bauds.first().copied().unwrap_or(38_400);
        let connection = match line.bus_address {
            None => Connection::open(line.port, 0, baud, Duration::from_secs(2))?,
            Some(_) => Connection::open_addressed(line.port, baud)?,
        };
        let mut framer = Framer::of_session(baud, keep);
        if line.bus_address.is_some() {
            framer.expect_also(Command::Temperature);
        }
        let mut session = Session {
            connection,
            framer,
            baud,
            tap,
            queue: VecDeque::new(),
            buffer: vec![0; 4096],
            streaming: None,
            bus: line.bus_address,
        };
        session.find_speed(bauds, wait, interrupted)?;
        Ok(session)
    }

    fn find_speed(
        &mut self,
        bauds: &[u32],
        wait: Duration,
        interrupted: Interrupted<'_>,
    ) -> Result<(), SessionError> {
        let start = Instant::now();
        loop {
            for baud in bauds {
                self.connection.set_baud(*baud)?;
                self.framer.set_baud(*baud);
                self.baud = *baud;
                // The first may be taken for the rest of a command that was cut off.
                for _ in 0..2 {
                    let stopped = self.bus.is_some() || self.try_stop(STOP_WAIT, interrupted)?;
                    if stopped && self.is_there(interrupted)? {
                        return Ok(());
                    }
                }
            }
            if start.elapsed() >= wait {
                let rates: Vec<String> = bauds.iter().map(u32::to_string).collect();
                let heard = match self.framer.counts().bytes {
                    0 => "not a byte came".to_owned(),
                    bytes => format!("{bytes} bytes came that are no answer: another device?"),
                };
                return Err(SessionError::NoUnit {
                    place: self.connection.place().to_owned(),
                    rates: rates.join(", "),
                    waited_s: start.elapsed().as_secs_f64(),
                    heard,
                });
            }
        }
    }

    /// Whether somebody answers a question that changes nothing.
    fn is_there(&mut self, interrupted: Interrupted<'_>) -> Result<bool, SessionError> {
        let question = match self.bus {
            None => Command::Firmware,
            Some(_) => Command::Temperature,
        };
        self.send(question, &[])?;
        let due = Instant::now() + ANSWER_WAIT;
        let found = self.await_reply(due, interrupted, |packet| packet.command() == question)?;
        Ok(found.is_some())
    }

    /// Asks for the stream's end and waits for the confirmation.
    fn try_stop(
        &mut self,
        wait: Duration,
        interrupted: Interrupted<'_>,
    ) -> Result<bool, SessionError> {
        self.send(Command::SetContinuous, &[0])?;
        let due = Instant::now() + wait;
        let stopped = self.await_reply(due, interrupted, |packet| confirms(packet, 0))?;
        if stopped.is_some() {
            self.streaming = None;
        }
        Ok(stopped.is_some())
    }

    /// The speed found, Bd.
    pub fn baud(&self) -> u32 {
        self.baud
    }

    /// The port, for messages.
    pub fn place(&self) -> &str {
        self.connection.place()
    }

    /// What came over the line.
    pub fn counts(&self) -> FramerCounts {
        self.framer.counts()
    }

    /// Bytes that wait for the rest of their reply.
    pub fn pending(&self) -> u64 {
        self.framer.pending() as u64
    }

    /// From now on nobody sees the bytes.
    pub fn end_tap(&mut self) {
        self.tap = None;
    }

    /// What the unit streams.
    pub fn streaming(&self) -> Option<Command> {
        self.streaming
    }

    /// Sends a command with its arguments and does not wait.
    ///
    /// # Errors
    /// [`SessionError::Link`].
    pub fn send(&mut self, command: Command, free: &[u8]) -> Result<(), SessionError> {
        let bytes = command.request(free).unwrap_or_default();
        let Some(address) = self.bus else {
            self.connection.write_all(&bytes, WRITE_WAIT)?;
            return Ok(());
        };
        let first = command
            .bus_byte(address)
            .ok_or(SessionError::NotOnBus(command))?;
        let rest = bytes.get(1..).unwrap_or_default();
        self.connection.write_addressed(first, rest, WRITE_WAIT)?;
        Ok(())
    }

    /// Reads what there is, waiting for it at most `timeout`; whether anything came. Replies are
    /// then in [`Session::next`].
    ///
    /// # Errors
    /// [`LinkError::Closed`] once the port is gone.
    pub fn read(&mut self, timeout: Duration) -> Result<bool, SessionError> {
        let Some(received) = self.receive(timeout)? else {
            self.framer.tell_time(HostInstant::now());
            return Ok(false);
        };
        let bytes = self.buffer.get(..received.bytes).unwrap_or_default();
        self.framer.feed(bytes, received.at);
        Ok(true)
    }

    /// Reads bytes into the buffer and shows them to the tap.
    fn receive(&mut self, timeout: Duration) -> Result<Option<Received>, SessionError> {
        let received = self.connection.read(&mut self.buffer, timeout)?;
        if let (Some(received), Some(tap)) = (received, &mut self.tap) {
            let bytes = self.buffer.get(..received.bytes).unwrap_or_default();
            tap(bytes, received.at);
        }
        Ok(received)
    }

    /// The next reply.
    #[allow(clippy::should_implement_trait)]
    pub fn next(&mut self) -> Option<Arrived> {
        self.queue.pop_front().or_else(|| self.framer.next())
    }

    /// Waits for a reply. Others that come before it stay in the queue, in order, and so does it:
    /// whoever reads the stream sees everything.
    fn await_reply(
        &mut self,
        due: Instant,
        interrupted: Interrupted<'_>,
        wanted: impl Fn(&Packet) -> bool,
    ) -> Result<Option<Packet>, SessionError> {
        loop {
            while let Some(arrived) = self.framer.next() {
                self.queue.push_back(arrived);
                if wanted(&arrived.packet) {
                    return Ok(Some(arrived.packet));
                }
            }
            if interrupted() {
                return Err(SessionError::Interrupted);
            }
            let left = due.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok(None);
            }
            self.read(left.min(SLICE))?;
        }
    }

    /// Asks and waits for the answer, up to four times.
    ///
    /// # Errors
    /// [`SessionError::NoAnswer`].
    pub fn ask(
        &mut self,
        command: Command,
        free: &[u8],
        interrupted: Interrupted<'_>,
    ) -> Result<Packet, SessionError> {
        self.ask_within(command, free, ANSWER_WAIT, TIMES, interrupted)
    }

    /// Asks and waits for the answer as long as `wait`, `times` times.
    ///
    /// # Errors
    /// [`SessionError::NoAnswer`].
    pub fn ask_within(
        &mut self,
        command: Command,
        free: &[u8],
        wait: Duration,
        times: u32,
        interrupted: Interrupted<'_>,
    ) -> Result<Packet, SessionError> {
        let start = Instant::now();
        self.framer.expect_also(command);
        let wait = wait + Duration::from_secs_f64(2.0 * wire_time_s(LONGEST_REPLY, self.baud));
        for turn in 0..times {
            if turn > 0 && self.bus.is_none() && command != Command::Firmware {
                // Answers come in the order of the questions: behind this one none is late.
                self.is_there(interrupted)?;
            }
            self.send(command, free)?;
            let due = Instant::now() + wait;
            let answer = self.await_reply(due, interrupted, |p| p.command() == command)?;
            if let Some(packet) = answer {
                return Ok(packet);
            }
        }
        Err(self.no_answer(command, start, times))
    }

    /// The error of a question that was asked so often since `start`.
    fn no_answer(&self, asked: Command, start: Instant, times: u32) -> SessionError {
        SessionError::NoAnswer {
            place: self.place().to_owned(),
            asked: asked.to_string(),
            waited_s: start.elapsed().as_secs_f64(),
            times,
        }
    }

    /// Has the unit send `command`'s reply at the end of every cycle.
    ///
    /// # Errors
    /// [`SessionError::NoAnswer`] where it does not confirm.
    pub fn start(
        &mut self,
        command: Command,
        interrupted: Interrupted<'_>,
    ) -> Result<(), SessionError> {
        let start = Instant::now();
        self.framer.expect_also(command);
        for _ in 0..TIMES {
            self.send(Command::SetContinuous, &[command.byte()])?;
            let due = Instant::now() + ANSWER_WAIT;
            let code = command.byte();
            let confirmed = self.await_reply(due, interrupted, |packet| confirms(packet, code))?;
            if confirmed.is_some() {
                self.streaming = Some(command);
                return Ok(());
            }
        }
        Err(self.no_answer(Command::SetContinuous, start, TIMES))
    }

    /// Ends the stream; whether the unit confirmed. Takes about a second, whatever the unit does,
    /// and is not to be interrupted: it is what is done on the way out.
    pub fn stop(&mut self) -> bool {
        const WAIT: Duration = Duration::from_millis(300);
        (0..3).any(|_| matches!(self.try_stop(WAIT, &|| false), Ok(true)))
    }
}

/// Whether the packet says that `code` is streamed now.
fn confirms(packet: &Packet, code: u8) -> bool {
    packet.command() == Command::SetContinuous
        && packet.word(Word::Value(0)) == Some(u16::from(code))
}
