//! The host's side of a session with a SCIP 2.0 device.

use super::scip::{self, Event, Framer, Measurement, Parameters, Reply, ReplyError, Skipped};
use super::{BAUD, PORT};
use crate::link::{Connection, Endpoint, HostInstant, LinkError};
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Bytes read at a time.
const CHUNK: usize = 1 << 14;
/// The longest wait between two looks at whether to go on.
const GLANCE: Duration = Duration::from_millis(100);
/// How long a request may take to be written.
const WRITE: Duration = Duration::from_secs(2);
/// How often the device's time is asked for.
const READINGS: usize = 24;

/// Sees the raw bytes as they come.
pub type Tap = Box<dyn FnMut(&[u8], HostInstant)>;
/// Whether a wait is to be given up.
pub type Interrupted = Box<dyn Fn() -> bool>;

/// Why a session failed.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// The line.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// No answer in time.
    #[error("{place}: no answer to {request} within {waited_s} s")]
    Silent {
        /// Host and port, or the serial port.
        place: String,
        /// What was asked.
        request: String,
        /// How long was waited, s.
        waited_s: f64,
    },
    /// The device says no.
    #[error("{place}: {request} was refused with status {status}: {words}")]
    Refused {
        /// Host and port, or the serial port.
        place: String,
        /// What was asked.
        request: String,
        /// The status as sent.
        status: String,
        /// What it means.
        words: &'static str,
    },
    /// An answer that makes no sense.
    #[error("{place}: the answer to {request} makes no sense: {error}")]
    Answer {
        /// Host and port, or the serial port.
        place: String,
        /// What was asked.
        request: &'static str,
        /// What is wrong with it.
        error: ReplyError,
    },
    /// The wait was given up.
    #[error("interrupted")]
    Interrupted,
}

/// What came while nothing was asked.
#[derive(Debug)]
pub enum Incoming<'a> {
    /// A reply, and when its last byte had arrived.
    Reply {
        /// The reply.
        reply: Reply<'a>,
        /// When it had arrived.
        at: HostInstant,
    },
    /// Bytes that are none.
    Skipped(Skipped),
}

/// How a session begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Speed of a serial port.
    pub baud: u32,
    /// How long a connection may take.
    pub connect: Duration,
    /// How long an answer may take.
    pub answer: Duration,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            baud: BAUD,
            connect: Duration::from_secs(3),
            answer: Duration::from_secs(2),
        }
    }
}

/// An open session.
pub struct Client {
    connection: Connection,
    framer: Framer,
    buffer: Vec<u8>,
    /// Where each chunk ended in the stream and when it had come; the oldest first.
    chunks: VecDeque<(u64, HostInstant)>,
    tap: Option<Tap>,
    interrupted: Option<Interrupted>,
    answer: Duration,
}

impl Client {
    /// Opens the line and lets the device stop whatever it was doing.
    pub fn connect(
        endpoint: &Endpoint,
        settings: &Settings,
        tap: Option<Tap>,
        interrupted: Option<Interrupted>,
    ) -> Result<Client, ClientError> {
        let connection = Connection::open(endpoint, PORT, settings.baud, settings.connect)?;
        let mut client = Client {
            connection,
            framer: Framer::new(),
            buffer: vec![0; CHUNK],
            chunks: VecDeque::new(),
            tap,
            interrupted,
            answer: settings.answer,
        };
        client.quiet()?;
        Ok(client)
    }

    /// Host and port, or the serial port.
    pub fn place(&self) -> &str {
        self.connection.place()
    }

    /// Ends half a line that somebody else may have left, measuring, and the adjustment of the time.
    fn quiet(&mut self) -> Result<(), ClientError> {
        self.connection.write_all(b"\n", WRITE)?;
        match self.command("QT") {
            Err(ClientError::Refused { status, .. }) if status == "0E" => {
                self.command("TM2")?;
                self.command("QT")
            }
            other => other,
        }
    }

    /// What the device is.
    pub fn parameters(&mut self) -> Result<Parameters, ClientError> {
        let parsed = self.ask("PP", Parameters::parse)?;
        parsed.map_err(|error| self.nonsense("PP", error))
    }

    /// The lines of VV or II, key and value.
    pub fn fields(&mut self, request: &'static str) -> Result<Vec<(String, String)>, ClientError> {
        let parsed: Result<Vec<(String, String)>, _> = self.ask(request, |reply| {
            let owned = |(key, value): (&str, &str)| (key.to_owned(), value.to_owned());
            scip::fields(reply).map(|field| field.map(owned)).collect()
        })?;
        parsed.map_err(|error| self.nonsense(request, error))
    }

    /// Asks for the device's time: milliseconds, and the host's monotonic time before and after, ns.
    /// Nothing is measured meanwhile.
    pub fn read_time(&mut self) -> Result<Vec<(u32, i64, i64)>, ClientError> {
        self.command("TM0")?;
        let mut readings = Vec::with_capacity(READINGS);
        for _ in 0..READINGS {
            let before = HostInstant::now();
            let (reading, at) = self.ask_at("TM1", scip::time_ms)?;
            let ms = reading.map_err(|error| self.nonsense("TM1", error))?;
            readings.push((ms, before.raw_ns, at.raw_ns));
        }
        self.command("TM2")?;
        Ok(readings)
    }

    /// Lets the device send scans of the whole aperture until [`Client::stop`], with intensities
    /// where it knows ME, and of every turn or every n-th (1 to 10).
    pub fn start(
        &mut self,
        parameters: &Parameters,
        intensities: bool,
        every: u32,
    ) -> Result<(), ClientError> {
        let [first, last] = parameters.steps;
        let skipped = every.clamp(1, 10) - 1;
        let request = |command: &str| format!("{command}{first:04}{last:04}01{skipped}00");
        if intensities {
            match self.command(&request("ME")) {
                Err(ClientError::Refused { status, .. }) if status.starts_with("0E") => {}
                other => return other,
            }
        }
        self.command(&request("MD"))
    }

    /// Lets the device send no more and switches its laser off.
    pub fn stop(&mut self, patience: Duration) -> Result<(), ClientError> {
        self.answer = patience;
        self.interrupted = None;
        self.command("QT")
    }

    /// Waits for bytes at most `timeout`.
    pub fn wait(&mut self, timeout: Duration) -> Result<bool, ClientError> {
        let Some(received) = self.connection.read(&mut self.buffer, timeout)? else {
            return Ok(false);
        };
        let bytes = self.buffer.get(..received.bytes).unwrap_or_default();
        if let Some(tap) = &mut self.tap {
            tap(bytes, received.at);
        }
        self.framer.feed(bytes);
        self.chunks.push_back((self.framer.bytes(), received.at));
        Ok(true)
    }

    /// The next thing that has come; none until [`Client::wait`] has more.
    #[allow(clippy::should_implement_trait)] // it lends from the buffer
    pub fn next(&mut self) -> Option<Incoming<'_>> {
        match self.framer.next() {
            None => {
                // All that came has been looked at; the last chunk may hold the next reply's start.
                let keep = self.chunks.len().min(1);
                self.chunks.drain(..self.chunks.len() - keep);
                None
            }
            Some(Event::Skipped(skipped)) => Some(Incoming::Skipped(skipped)),
            Some(Event::Reply(reply)) => {
                let last = reply.last_offset();
                while self.chunks.len() > 1 && self.chunks.front().is_some_and(|c| c.0 <= last) {
                    self.chunks.pop_front();
                }
                let at = self.chunks.front().map(|chunk| chunk.1).unwrap_or_default();
                Some(Incoming::Reply { reply, at })
            }
        }
    }

    /// Sends a request that is answered with nothing but a status.
    fn command(&mut self, request: &str) -> Result<(), ClientError> {
        self.ask(request, |_| ())
    }

    fn ask<T>(&mut self, request: &str, read: impl Fn(&Reply) -> T) -> Result<T, ClientError> {
        self.ask_at(request, read).map(|(answer, _)| answer)
    }

    /// Sends a request and reads its answer; scans that still come before it are left out.
    fn ask_at<T>(
        &mut self,
        request: &str,
        read: impl Fn(&Reply) -> T,
    ) -> Result<(T, HostInstant), ClientError> {
        let line = format!("{request}\n");
        self.connection.write_all(line.as_bytes(), WRITE)?;
        let due = Instant::now() + self.answer;
        loop {
            while let Some(incoming) = self.next() {
                let Incoming::Reply { reply, at } = incoming else {
                    continue;
                };
                if reply.echo() != request.as_bytes() || Measurement::is_one(&reply) {
                    continue;
                }
                let status = reply.status();
                // BM and QT of a laser that is on or off already, TM2 of a time that runs already.
                let fine = matches!(
                    (request, &status),
                    (_, b"00") | ("BM", b"02") | ("TM0", b"02") | ("TM2", b"03")
                );
                if fine {
                    let answer = read(&reply);
                    return Ok((answer, at));
                }
                return Err(ClientError::Refused {
                    place: self.connection.place().to_owned(),
                    request: request.to_owned(),
                    status: status.escape_ascii().to_string(),
                    words: scip::status_words(request.as_bytes(), status),
                });
            }
            if self
                .interrupted
                .as_ref()
                .is_some_and(|interrupted| interrupted())
            {
                return Err(ClientError::Interrupted);
            }
            let left = due.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Err(ClientError::Silent {
                    place: self.connection.place().to_owned(),
                    request: request.to_owned(),
                    waited_s: self.answer.as_secs_f64(),
                });
            }
            self.wait(left.min(GLANCE))?;
        }
    }

    fn nonsense(&self, request: &'static str, error: ReplyError) -> ClientError {
        ClientError::Answer {
            place: self.connection.place().to_owned(),
            request,
            error,
        }
    }
}
