//! The talk with a unit: finding its speed, stopping and starting its stream, questions and answers.
//!
//! A unit may be streaming anything when the line is opened, may have half a command in its input,
//! and may be at any of three speeds. So nothing rests on flushing buffers: the stream is stopped
//! and the unit's own confirmation awaited, and a question that was not answered in time is only
//! asked again after another one has been answered, so that no late answer is taken for a new one.

use super::command::{Command, Word};
use super::eeprom;
use super::framer::{Arrived, Framer, FramerCounts};
use super::packet::Packet;
use super::scale::{Gains, GainsError};
use super::ticks::TickFactors;
use super::{BAUD_RATES, wire_time_s};
use crate::link::{Connection, Endpoint, HostInstant, LinkError};
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
    /// The gains make no sense.
    #[error("{place}: {reason}")]
    Gains {
        /// The port.
        place: String,
        /// Why.
        reason: GainsError,
    },
    /// The tick factors make no sense.
    #[error("{place}: one of the tick factors in cells 238, 240, 242 and 246 is 0")]
    NoTick {
        /// The port.
        place: String,
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
    /// The caller wants to end.
    #[error("interrupted")]
    Interrupted,
}

/// Who a unit says it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Identity {
    /// The firmware's number.
    pub firmware: u16,
    /// The serial number.
    pub serial: u16,
}

/// How long to wait, and when to give up.
pub struct Patience<'a> {
    /// For a unit on the line.
    pub wait: Duration,
    /// Asked often: whether the caller wants to end.
    pub interrupted: &'a dyn Fn() -> bool,
}

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
    /// Opens a port, finds the unit's speed among `bauds` (all three, if empty), and stops whatever
    /// it streams. `keep` are the commands whose replies shall not be passed over; `tap` sees every
    /// byte.
    ///
    /// # Errors
    /// [`SessionError::Link`] where the port cannot be opened, [`SessionError::NoUnit`] where no unit
    /// answers.
    pub fn open(
        endpoint: &Endpoint,
        bauds: &[u32],
        keep: &[Command],
        tap: Option<Tap>,
        patience: &Patience<'_>,
    ) -> Result<Session, SessionError> {
        let bauds = if bauds.is_empty() { &BAUD_RATES } else { bauds };
        let first = bauds.first().copied().unwrap_or(38_400);
        let connection = Connection::open(endpoint, 0, first, Duration::from_secs(2))?;
        let mut session = Session::new(connection, first, keep, tap, None);
        session.find_speed(bauds, patience)?;
        Ok(session)
    }

    /// Opens a port to the unit with `address` on RS-485, where it only answers questions.
    ///
    /// # Errors
    /// As [`Session::open`]; also where the port cannot send a ninth bit.
    pub fn open_on_bus(
        endpoint: &Endpoint,
        address: u8,
        bauds: &[u32],
        keep: &[Command],
        tap: Option<Tap>,
        patience: &Patience<'_>,
    ) -> Result<Session, SessionError> {
        let bauds = if bauds.is_empty() { &BAUD_RATES } else { bauds };
        let first = bauds.first().copied().unwrap_or(38_400);
        let connection = Connection::open_addressed(endpoint, first)?;
        let mut session = Session::new(connection, first, keep, tap, Some(address));
        session.framer.expect_also(Command::Temperature);
        session.find_speed(bauds, patience)?;
        Ok(session)
    }

    fn new(
        connection: Connection,
        baud: u32,
        keep: &[Command],
        tap: Option<Tap>,
        bus: Option<u8>,
    ) -> Session {
        let mut framer = Framer::new(baud);
        framer.expect(&[
            Command::SetContinuous,
            Command::Firmware,
            Command::SerialNumber,
            Command::ReadEepromChecked,
            Command::WriteEepromChecked,
        ]);
        keep.iter().for_each(|command| framer.expect_also(*command));
        Session {
            connection,
            framer,
            baud,
            tap,
            queue: VecDeque::new(),
            buffer: vec![0; 4096],
            streaming: None,
            bus,
        }
    }

    fn find_speed(&mut self, bauds: &[u32], patience: &Patience<'_>) -> Result<(), SessionError> {
        let start = Instant::now();
        loop {
            for baud in bauds {
                self.connection.set_baud(*baud)?;
                self.framer.set_baud(*baud);
                self.baud = *baud;
                // The first may be taken for the rest of a command that was cut off.
                for _ in 0..2 {
                    if self.bus.is_some() {
                        if self.is_there(patience)? {
                            return Ok(());
                        }
                    } else if self.try_stop(STOP_WAIT, patience)? && self.is_there(patience)? {
                        return Ok(());
                    }
                }
            }
            if start.elapsed() >= patience.wait {
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
    fn is_there(&mut self, patience: &Patience<'_>) -> Result<bool, SessionError> {
        let question = match self.bus {
            None => Command::Firmware,
            Some(_) => Command::Temperature,
        };
        self.send(question, &[])?;
        let due = Instant::now() + ANSWER_WAIT;
        let found = self.await_reply(due, patience, |packet| packet.command() == question)?;
        Ok(found.is_some())
    }

    /// Asks for the stream's end and waits for the confirmation.
    fn try_stop(&mut self, wait: Duration, patience: &Patience<'_>) -> Result<bool, SessionError> {
        self.send(Command::SetContinuous, &[0])?;
        let due = Instant::now() + wait;
        let stopped = self.await_reply(due, patience, |packet| confirms(packet, 0))?;
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
        let received = self.connection.read(&mut self.buffer, timeout)?;
        let Some(received) = received else {
            self.framer.tell_time(HostInstant::now());
            return Ok(false);
        };
        let bytes = self.buffer.get(..received.bytes).unwrap_or_default();
        if let Some(tap) = &mut self.tap {
            tap(bytes, received.at);
        }
        self.framer.feed(bytes, received.at);
        Ok(true)
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
        patience: &Patience<'_>,
        wanted: impl Fn(&Packet) -> bool,
    ) -> Result<Option<Packet>, SessionError> {
        loop {
            while let Some(arrived) = self.framer.next() {
                self.queue.push_back(arrived);
                if wanted(&arrived.packet) {
                    return Ok(Some(arrived.packet));
                }
            }
            if (patience.interrupted)() {
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
        patience: &Patience<'_>,
    ) -> Result<Packet, SessionError> {
        self.ask_within(command, free, ANSWER_WAIT, TIMES, patience)
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
        patience: &Patience<'_>,
    ) -> Result<Packet, SessionError> {
        let start = Instant::now();
        self.framer.expect_also(command);
        let wait = wait + Duration::from_secs_f64(2.0 * wire_time_s(31, self.baud));
        for turn in 0..times {
            if turn > 0 && self.bus.is_none() && command != Command::Firmware {
                // Answers come in the order of the questions: behind this one none is late.
                self.is_there(patience)?;
            }
            self.send(command, free)?;
            let due = Instant::now() + wait;
            let answer = self.await_reply(due, patience, |p| p.command() == command)?;
            if let Some(packet) = answer {
                return Ok(packet);
            }
        }
        Err(SessionError::NoAnswer {
            place: self.place().to_owned(),
            asked: command.to_string(),
            waited_s: start.elapsed().as_secs_f64(),
            times,
        })
    }

    /// A number that the unit answers with: firmware, serial number, a cell.
    fn number(
        &mut self,
        command: Command,
        free: &[u8],
        patience: &Patience<'_>,
    ) -> Result<u16, SessionError> {
        let packet = self.ask(command, free, patience)?;
        Ok(packet.word(Word::Value(0)).unwrap_or(0))
    }

    /// Who the unit is.
    ///
    /// # Errors
    /// [`SessionError::NoAnswer`].
    pub fn identity(&mut self, patience: &Patience<'_>) -> Result<Identity, SessionError> {
        if self.bus.is_some() {
            // The questions for it have no room there; the predecessor's cell stands for one.
            return Ok(Identity {
                firmware: 0,
                serial: self.cell(eeprom::SERIAL_CELL, patience)?,
            });
        }
        Ok(Identity {
            firmware: self.number(Command::Firmware, &[], patience)?,
            serial: self.number(Command::SerialNumber, &[], patience)?,
        })
    }

    /// Reads a cell, with checksum.
    ///
    /// # Errors
    /// [`SessionError::NoAnswer`].
    pub fn cell(&mut self, address: u16, patience: &Patience<'_>) -> Result<u16, SessionError> {
        if self.bus.is_some() {
            return self.bare_cell(address, patience);
        }
        let free = address.to_be_bytes();
        self.number(Command::ReadEepromChecked, &free, patience)
    }

    /// Reads a cell as it is done on RS-485: two bytes without header and sum, so that it is read
    /// until two answers agree.
    fn bare_cell(&mut self, address: u16, patience: &Patience<'_>) -> Result<u16, SessionError> {
        let start = Instant::now();
        let free = [u8::try_from(address).unwrap_or(u8::MAX)];
        let mut before = None;
        for _ in 0..2 * TIMES {
            // What comes late belongs to another question.
            while self.read(Duration::from_millis(20))? && start.elapsed() < ANSWER_WAIT * TIMES {}
            while let Some(arrived) = self.framer.next() {
                self.queue.push_back(arrived);
            }
            self.send(Command::ReadEeprom, &free)?;
            let due = Instant::now() + ANSWER_WAIT;
            let mut answer = Vec::new();
            while answer.len() < 2 && Instant::now() < due {
                if (patience.interrupted)() {
                    return Err(SessionError::Interrupted);
                }
                let left = due.saturating_duration_since(Instant::now());
                let received = self
                    .connection
                    .read(&mut self.buffer, left.min(SLICE))?
                    .map_or(0, |received| received.bytes);
                answer.extend_from_slice(self.buffer.get(..received).unwrap_or_default());
            }
            if let [high, low] = answer[..] {
                let value = u16::from_be_bytes([high, low]);
                if before.replace(value) == Some(value) {
                    return Ok(value);
                }
            }
        }
        Err(SessionError::NoAnswer {
            place: self.place().to_owned(),
            asked: Command::ReadEeprom.to_string(),
            waited_s: start.elapsed().as_secs_f64(),
            times: 2 * TIMES,
        })
    }

    /// Writes a cell and reads it back. What must not be written is the caller's to know
    /// ([`eeprom::guard`]).
    ///
    /// # Errors
    /// [`SessionError::NotWritten`] where it reads otherwise.
    pub fn write_cell(
        &mut self,
        address: u16,
        value: u16,
        patience: &Patience<'_>,
    ) -> Result<(), SessionError> {
        let free = [address.to_be_bytes(), value.to_be_bytes()].concat();
        match self.bus {
            None => {
                self.ask(Command::WriteEepromChecked, &free, patience)?;
            }
            // Its bare answer is the value, which reading it back tells as well.
            Some(_) => self.send(Command::WriteEeprom, free.get(1..).unwrap_or_default())?,
        }
        let got = self.cell(address, patience)?;
        if got == value {
            return Ok(());
        }
        Err(SessionError::NotWritten {
            place: self.place().to_owned(),
            address,
            wanted: value,
            got,
        })
    }

    /// The unit's gains. There is no falling back on those of the factory.
    ///
    /// # Errors
    /// [`SessionError::Gains`] where they make no sense.
    pub fn gains(&mut self, patience: &Patience<'_>) -> Result<Gains, SessionError> {
        let [accel, rate, mag] = eeprom::GAIN_CELLS;
        let gains = Gains {
            accel: self.cell(accel, patience)?,
            rate: self.cell(rate, patience)?,
            mag: self.cell(mag, patience)?,
        };
        gains.check().map_err(|reason| SessionError::Gains {
            place: self.place().to_owned(),
            reason,
        })
    }

    /// The unit's tick.
    ///
    /// # Errors
    /// [`SessionError::NoTick`] where it makes no sense.
    pub fn tick(&mut self, patience: &Patience<'_>) -> Result<TickFactors, SessionError> {
        let mut factors = [0; 4];
        for (factor, address) in factors.iter_mut().zip(eeprom::TICK_CELLS) {
            *factor = self.cell(address, patience)?;
        }
        if factors.contains(&0) {
            return Err(SessionError::NoTick {
                place: self.place().to_owned(),
            });
        }
        Ok(TickFactors(factors))
    }

    /// Has the unit send `command`'s reply at the end of every cycle.
    ///
    /// # Errors
    /// [`SessionError::NoAnswer`] where it does not confirm.
    pub fn start(&mut self, command: Command, patience: &Patience<'_>) -> Result<(), SessionError> {
        let start = Instant::now();
        self.framer.expect_also(command);
        for _ in 0..TIMES {
            self.send(Command::SetContinuous, &[command.byte()])?;
            let due = Instant::now() + ANSWER_WAIT;
            let code = command.byte();
            let confirmed = self.await_reply(due, patience, |packet| confirms(packet, code))?;
            if confirmed.is_some() {
                self.streaming = Some(command);
                return Ok(());
            }
        }
        Err(SessionError::NoAnswer {
            place: self.place().to_owned(),
            asked: Command::SetContinuous.to_string(),
            waited_s: start.elapsed().as_secs_f64(),
            times: TIMES,
        })
    }

    /// Ends the stream; whether the unit confirmed. Takes no longer than a second, whatever the
    /// unit does, and is not to be interrupted: it is what is done on the way out.
    pub fn stop(&mut self) -> bool {
        let patience = Patience {
            wait: Duration::ZERO,
            interrupted: &|| false,
        };
        (0..3).any(|_| {
            matches!(
                self.try_stop(Duration::from_millis(300), &patience),
                Ok(true)
            )
        })
    }
}

/// Whether the packet says that `code` is streamed now.
fn confirms(packet: &Packet, code: u8) -> bool {
    packet.command() == Command::SetContinuous
        && packet.word(Word::Value(0)) == Some(u16::from(code))
}
