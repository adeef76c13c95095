//! A session with a scanner over an open line.

use super::commands::{self, DeviceStatus};
use super::error::ClientError;
use super::request::{Refusal, Reply, Request};
use super::{HOST_PORT, TEXT_PORT};
use crate::link::{Connection, Endpoint, HostInstant, Interrupted, Tap};
use crate::sick::cola::{Dialect, Event, Framer, Skipped, Telegram};
use crate::sick::scandata::{self, Calendar, FieldError};
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Bytes read at a time.
const CHUNK: usize = 1 << 16;
/// The longest wait between two looks at whether to stop.
const GLANCE: Duration = Duration::from_millis(100);
/// Telegrams kept while a reply is waited for; more than a device sends in any answer time.
const MOST_HELD: usize = 4096;
/// Arrivals of chunks remembered for the time of a reply's first byte.
const CHUNKS_REMEMBERED: usize = 64;

/// How a session is opened.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Speed of a serial line, baud.
    pub baud: u32,
    /// How long a connection may take.
    pub connect: Duration,
    /// How long an answer may take; a serial line gets the time its bytes need in addition.
    pub answer: Duration,
    /// The dialect, if it is not to be found out.
    pub dialect: Option<Dialect>,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            baud: 57_600,
            connect: Duration::from_secs(3),
            answer: Duration::from_secs(2),
            dialect: None,
        }
    }
}

/// What a device sent without being asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Incoming<'a> {
    /// A telegram: an event, or a scan.
    Telegram {
        /// The telegram.
        telegram: Telegram<'a>,
        /// The host's time when its last byte was there.
        at: HostInstant,
    },
    /// Bytes that belong to no telegram.
    Skipped(Skipped),
}

/// A telegram that came while a reply was waited for.
#[derive(Debug)]
enum Held {
    Telegram {
        dialect: Dialect,
        offset: u64,
        body: Vec<u8>,
        at: HostInstant,
    },
    Skipped(Skipped),
}

impl Held {
    fn lend(&self) -> Incoming<'_> {
        match self {
            Held::Skipped(skipped) => Incoming::Skipped(*skipped),
            Held::Telegram {
                dialect,
                offset,
                body,
                at,
            } => Incoming::Telegram {
                telegram: Telegram {
                    dialect: *dialect,
                    offset: *offset,
                    body,
                },
                at: *at,
            },
        }
    }
}

/// A scanner that answers.
///
/// Requests wait for their answer with a time limit. What the device sends on its own is kept in
/// order: take it with [`Client::next`] until there is none, then [`Client::wait`] for more bytes.
pub struct Client {
    line: Connection,
    dialect: Dialect,
    answer: Duration,
    framer: Framer,
    chunk: Vec<u8>,
    /// Arrival of the last chunk.
    at: HostInstant,
    /// Where in the stream each of the last chunks ended, and when it came.
    chunks: VecDeque<(u64, HostInstant)>,
    held: VecDeque<Held>,
    lent: Option<Held>,
    tap: Option<Tap>,
    interrupted: Option<Interrupted>,
    /// For so long after a request the answer is looked for without sleeping.
    spin: Duration,
    out: Vec<u8>,
}

impl Client {
    /// Connects and finds out the dialect. A TCP host's port is 2112 unless the place names one.
    pub fn connect(
        endpoint: &Endpoint,
        settings: &Settings,
        tap: Option<Tap>,
        interrupted: Option<Interrupted>,
    ) -> Result<Client, ClientError> {
        let line = Connection::open(endpoint, HOST_PORT, settings.baud, settings.connect)?;
        let text_only = matches!(
            endpoint,
            Endpoint::Tcp {
                port: Some(TEXT_PORT),
                ..
            }
        );
        let dialect = settings.dialect.or(text_only.then_some(Dialect::Text));
        let settings = Settings {
            dialect,
            ..*settings
        };
        Client::start(line, &settings, tap, interrupted)
    }

    /// Begins a session on an open line and finds out the dialect.
    ///
    /// Nothing is written that changes the device: both framings of `sRN SCdevicestate` are sent,
    /// and the dialect of the answer is the device's.
    pub fn start(
        line: Connection,
        settings: &Settings,
        tap: Option<Tap>,
        interrupted: Option<Interrupted>,
    ) -> Result<Client, ClientError> {
        let mut answer = settings.answer;
        if !line.is_tcp() {
            // The longest answers but scans, ten bits a byte.
            answer += Duration::from_secs_f64(20_000.0 / f64::from(settings.baud.max(1)));
        }
        let mut client = Client {
            line,
            dialect: settings.dialect.unwrap_or(Dialect::Binary),
            answer,
            framer: Framer::new(),
            chunk: vec![0; CHUNK],
            at: HostInstant::default(),
            chunks: VecDeque::with_capacity(CHUNKS_REMEMBERED),
            held: VecDeque::new(),
            lent: None,
            tap,
            interrupted,
            spin: Duration::ZERO,
            out: Vec::new(),
        };
        client.probe(settings.dialect)?;
        Ok(client)
    }

    /// Finds out the dialect, and lets what the wrong framing provoked pass by.
    fn probe(&mut self, only: Option<Dialect>) -> Result<(), ClientError> {
        let request = Request::read("SCdevicestate");
        let mut bytes = Vec::new();
        for dialect in [Dialect::Binary, Dialect::Text] {
            if only.is_none_or(|only| only == dialect) {
                request.encode(dialect, &mut bytes);
            }
        }
        self.line.write_all(&bytes, self.answer)?;
        let due = Instant::now() + self.answer;
        let mut refused = None;
        let found = self.collect(due, |telegram| {
            if request.is_answered_by(telegram) {
                return Some(telegram.dialect);
            }
            // A device that does not know the variable still answers in its dialect; one that
            // complains of the characters complains of the other.
            if Refusal::of(telegram).is_some_and(|refusal| refusal.is_unknown_command()) {
                refused = Some(telegram.dialect);
            }
            None
        })?;
        self.dialect = match found.map(|(dialect, ..)| dialect).or(refused) {
            Some(dialect) => dialect,
            None => return Err(self.no_dialect(only)),
        };
        if only.is_none() {
            // The device answers in order: after the answer to this one nothing is left that the
            // probe provoked.
            let after = Request::read("DeviceIdent");
            self.send(&after)?;
            let due = Instant::now() + self.answer.min(Duration::from_millis(500));
            self.collect(due, |telegram| after.is_answered_by(telegram).then_some(()))?;
        }
        Ok(())
    }

    fn no_dialect(&mut self, only: Option<Dialect>) -> ClientError {
        let events = self.held.len();
        let heard = match (self.framer.bytes(), events) {
            (0, _) => "nothing came at all".to_owned(),
            (bytes, 0) => format!("{bytes} bytes came that are no telegram"),
            (bytes, _) => format!("{bytes} bytes came, but no answer among them"),
        };
        let advice = match (self.line.is_tcp(), only) {
            (true, Some(_)) => "Is it a SICK scanner? Port 2111 speaks CoLa A, port 2112 either",
            (true, None) => {
                "Is it a SICK scanner, and is no other program connected to this port? Try port 2111"
            }
            (false, _) => {
                "Check --baud, the wiring (RS-422 or RS-232) and that the port is the scanner's"
            }
        };
        ClientError::NoDialect {
            place: self.line.place().to_owned(),
            waited_s: self.answer.as_secs_f64(),
            heard,
            advice,
        }
    }

    /// The device's dialect.
    pub fn dialect(&self) -> Dialect {
        self.dialect
    }

    /// Host and port, or the serial port.
    pub fn place(&self) -> &str {
        self.line.place()
    }

    /// The line itself.
    pub fn line(&mut self) -> &mut Connection {
        &mut self.line
    }

    /// How long the device may take for an answer.
    pub fn patience(&self) -> Duration {
        self.answer
    }

    /// Gives the device this long for each of its answers.
    pub fn set_patience(&mut self, answer: Duration) {
        self.answer = answer;
    }

    /// For so long after each request the answer is looked for without sleeping: a CPU that sleeps
    /// wakes up late, and by an amount that varies.
    pub fn set_spin(&mut self, spin: Duration) {
        self.spin = spin;
    }

    /// Replaces what ends a wait early.
    pub fn set_interrupted(&mut self, interrupted: Option<Interrupted>) {
        self.interrupted = interrupted;
    }

    /// Asks and waits for the answer; a refusal (`sFA`) is an error.
    pub fn request(&mut self, request: &Request) -> Result<Reply, ClientError> {
        self.request_within(request, self.answer)
    }

    /// The same with a time limit of its own.
    pub fn request_within(
        &mut self,
        request: &Request,
        limit: Duration,
    ) -> Result<Reply, ClientError> {
        let sent = self.send(request)?;
        let due = Instant::now() + limit;
        enum Answer {
            Reply(Dialect, u64, Vec<u8>),
            Refused(Refusal),
        }
        let found = self.collect(due, |telegram| {
            if request.is_answered_by(telegram) {
                let body = telegram.body.to_vec();
                return Some(Answer::Reply(telegram.dialect, telegram.offset, body));
            }
            Refusal::of(telegram).map(Answer::Refused)
        })?;
        match found {
            Some((Answer::Reply(dialect, offset, body), first, received)) => Ok(Reply {
                dialect,
                offset,
                body,
                sent,
                first,
                received,
            }),
            Some((Answer::Refused(refusal), ..)) => Err(ClientError::Refused {
                request: request.to_string(),
                refusal,
            }),
            None => Err(ClientError::Silent {
                place: self.line.place().to_owned(),
                request: request.to_string(),
                waited_s: limit.as_secs_f64(),
            }),
        }
    }

    /// Calls a method that answers `wanted` when it has done its work; `meaning` says what another
    /// answer means.
    pub fn call(
        &mut self,
        request: &Request,
        wanted: u8,
        meaning: &str,
    ) -> Result<Reply, ClientError> {
        let reply = self.request(request)?;
        let status = reply.values().u8("status");
        match status {
            Ok(status) if status == wanted => Ok(reply),
            Ok(status) => Err(ClientError::Failed {
                request: request.to_string(),
                status,
                meaning: meaning.to_owned(),
            }),
            Err(error) => Err(ClientError::answer(request, error)),
        }
    }

    /// Logs in at the level that may configure.
    ///
    /// # Errors
    /// [`ClientError::Failed`] where the password is wrong; the hash is not in the message.
    pub fn log_in(&mut self, hash: u32) -> Result<(), ClientError> {
        let request = commands::log_in(hash);
        let wrong = "login refused: the password has been changed. Give its hash by \
                     --password-file FILE or in CABLEPOSE_PASSWORD";
        self.call(&request, 1, wrong)
            .map(|_| ())
            .map_err(|error| match error {
                ClientError::Failed {
                    status, meaning, ..
                } => ClientError::Failed {
                    request: "sMN SetAccessMode".to_owned(),
                    status,
                    meaning,
                },
                ClientError::Refused { refusal, .. } => ClientError::Refused {
                    request: "sMN SetAccessMode".to_owned(),
                    refusal,
                },
                other => other,
            })
    }

    /// Logs out and makes parameters active.
    pub fn run(&mut self) -> Result<(), ClientError> {
        self.call(
            &commands::run(),
            1,
            "the device did not go back to measuring",
        )
        .map(|_| ())
    }

    /// Sets the device's clock; the reply tells between which two instants that was done.
    pub fn set_date_time(&mut self, time: &Calendar) -> Result<Reply, ClientError> {
        let refused = "the clock was not set: log in first, and switch its NTP client off";
        self.call(&commands::set_date_time(time), 1, refused)
    }

    /// What the device does (`STlms`).
    pub fn status(&mut self) -> Result<DeviceStatus, ClientError> {
        self.ask(&DeviceStatus::request(), DeviceStatus::parse)
    }

    /// Asks for the last scan; its telegram is the reply's.
    pub fn poll(&mut self) -> Result<Reply, ClientError> {
        self.request(&commands::last_scan())
    }

    /// Asks and reads the answer.
    pub fn ask<T>(
        &mut self,
        request: &Request,
        parse: fn(&Reply) -> Result<T, FieldError>,
    ) -> Result<T, ClientError> {
        let reply = self.request(request)?;
        parse(&reply).map_err(|error| ClientError::answer(request, error))
    }

    /// The same for something that not every firmware knows: none where it is refused, or answered
    /// in a way that only another firmware understands.
    pub fn ask_if_known<T>(
        &mut self,
        request: &Request,
        parse: fn(&Reply) -> Result<T, FieldError>,
    ) -> Result<Option<T>, ClientError> {
        match self.ask(request, parse) {
            Ok(answer) => Ok(Some(answer)),
            Err(ClientError::Refused { .. } | ClientError::Answer { .. }) => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// The next thing that has come without being asked for; none until [`Client::wait`] has more.
    #[allow(clippy::should_implement_trait)] // it lends
    pub fn next(&mut self) -> Option<Incoming<'_>> {
        if let Some(held) = self.held.pop_front() {
            return Some(self.lent.insert(held).lend());
        }
        self.lent = None;
        let at = self.at;
        self.framer.next().map(|event| match event {
            Event::Telegram(telegram) => Incoming::Telegram { telegram, at },
            Event::Skipped(skipped) => Incoming::Skipped(skipped),
        })
    }

    /// Waits for bytes at most `timeout`; whether some came.
    pub fn wait(&mut self, timeout: Duration) -> Result<bool, ClientError> {
        self.hold_rest();
        self.read(timeout)
    }

    /// Sends a request without waiting for its answer; gives the time before it was written.
    pub fn send(&mut self, request: &Request) -> Result<HostInstant, ClientError> {
        self.hold_rest();
        self.out.clear();
        request.encode(self.dialect, &mut self.out);
        let sent = HostInstant::now();
        self.line.write_all(&self.out, self.answer)?;
        Ok(sent)
    }

    /// Puts aside whatever the last chunk still holds, with that chunk's time.
    fn hold_rest(&mut self) {
        while let Some(event) = self.framer.next() {
            hold(&mut self.held, event, self.at);
        }
    }

    fn read(&mut self, timeout: Duration) -> Result<bool, ClientError> {
        let Some(received) = self.line.read(&mut self.chunk, timeout)? else {
            return Ok(false);
        };
        let bytes = self.chunk.get(..received.bytes).unwrap_or_default();
        self.at = received.at;
        if let Some(tap) = &mut self.tap {
            tap(bytes, received.at);
        }
        self.framer.feed(bytes);
        if self.chunks.len() == CHUNKS_REMEMBERED {
            self.chunks.pop_front();
        }
        self.chunks.push_back((self.framer.bytes(), received.at));
        Ok(true)
    }

    /// Reads until `accept` takes a telegram or the time is over; everything else is put aside.
    /// Gives what was accepted and when its first and last byte came.
    fn collect<T>(
        &mut self,
        due: Instant,
        mut accept: impl FnMut(&Telegram) -> Option<T>,
    ) -> Result<Option<(T, HostInstant, HostInstant)>, ClientError> {
        let started = Instant::now();
        loop {
            let at = self.at;
            while let Some(event) = self.framer.next() {
                if let Event::Telegram(telegram) = &event
                    && let Some(found) = accept(telegram)
                {
                    let begin = telegram.offset;
                    let first = self.chunks.iter().find(|(end, _)| *end > begin);
                    return Ok(Some((found, first.map_or(at, |(_, at)| *at), at)));
                }
                hold(&mut self.held, event, at);
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
                return Ok(None);
            }
            let spin = started.elapsed() < self.spin;
            let wait = if spin {
                Duration::ZERO
            } else {
                left.min(GLANCE)
            };
            self.read(wait)?;
        }
    }
}

/// Keeps what came without being asked for; other replies are too late and of no use.
fn hold(held: &mut VecDeque<Held>, event: Event, at: HostInstant) {
    if held.len() >= MOST_HELD {
        held.pop_front();
    }
    match event {
        Event::Skipped(skipped) => held.push_back(Held::Skipped(skipped)),
        Event::Telegram(telegram) if telegram.verb() == b"sSN" || scandata::is_scan(&telegram) => {
            held.push_back(Held::Telegram {
                dialect: telegram.dialect,
                offset: telegram.offset,
                body: telegram.body.to_vec(),
                at,
            });
        }
        Event::Telegram(_) => {}
    }
}
