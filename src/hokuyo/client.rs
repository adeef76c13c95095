//! The host's side of a session with a SCIP 2.0 device.

use super::scans::TimeReading;
use super::scip::{self, Event, Framer, Measurement, Parameters, Reply, ReplyError, Skipped};
use super::{BAUD, PORT};
use crate::link::{Connection, Endpoint, HostInstant, Interrupted, LinkError, Tap};
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

    /// Asks for the device's time, many times. Nothing is measured meanwhile.
    pub fn read_time(&mut self) -> Result<Vec<TimeReading>, ClientError> {
        self.command("TM0")?;
        let readings: Result<Vec<TimeReading>, ClientError> =
            (0..READINGS).map(|_| self.read_time_once()).collect();
        // Whatever became of the questions: until it is told this, the device refuses to measure.
        let told = self.command("TM2");
        let readings = readings?;
        told?;
        Ok(readings)
    }

    fn read_time_once(&mut self) -> Result<TimeReading, ClientError> {
        let before = HostInstant::now();
        let (stamp_ms, after) = self.ask_at("TM1", scip::time_ms)?;
        Ok(TimeReading {
            stamp_ms: stamp_ms.map_err(|error| self.nonsense("TM1", error))?,
            before_raw_ns: before.raw_ns,
            after_raw_ns: after.raw_ns,
        })
    }

    /// Lets the device send every scan of its whole aperture until [`Client::stop`], with intensities
    /// where it knows ME.
    pub fn start(&mut self, parameters: &Parameters) -> Result<(), ClientError> {
        let [first, last] = parameters.steps;
        // Steps that are put together (1), turns left out (0), scans (00: without end).
        let request = |command: &str| format!("{command}{first:04}{last:04}01000");
        match self.command(&request("ME")) {
            Err(ClientError::Refused { status, .. }) if status == "0E" => {
                self.command(&request("MD"))
            }
            other => other,
        }
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

#[cfg(test)]
mod tests {
    use super::super::scip::Writer;
    use super::*;
    use std::io::{Read, Write};
    use std::net::TcpListener;
    use std::thread::JoinHandle;

    /// A device that answers each line by `answer` and ends with the connection, at the latest after
    /// 20 s; the lines that came.
    fn device(
        answer: impl Fn(&str) -> Vec<u8> + Send + 'static,
    ) -> (Endpoint, JoinHandle<Vec<String>>) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let endpoint = listener.local_addr().unwrap().to_string().parse().unwrap();
        let lines = std::thread::spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            let limit = Some(Duration::from_secs(20));
            stream.set_read_timeout(limit).unwrap();
            let (mut lines, mut line) = (Vec::new(), Vec::new());
            let mut byte = [0];
            while let Ok(1) = stream.read(&mut byte) {
                if byte != *b"\n" {
                    line.push(byte[0]);
                    continue;
                }
                let text = String::from_utf8(std::mem::take(&mut line)).unwrap();
                if !text.is_empty() {
                    let _ = stream.write_all(&answer(&text));
                    lines.push(text);
                }
            }
            lines
        });
        (endpoint, lines)
    }

    fn reply(echo: &str, status: &[u8; 2], line: Option<&[u8]>) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut writer = Writer::begin(&mut bytes, echo.as_bytes(), *status);
        if let Some(line) = line {
            writer.line(line);
        }
        writer.end();
        bytes
    }

    #[test]
    fn a_time_that_cannot_be_read_leaves_the_device_free_to_measure() {
        for answers_time in [
            |echo: &str| reply(echo, b"0E", None),
            |echo: &str| reply(echo, b"00", Some(b"much more than four")),
        ] {
            let (endpoint, lines) = device(move |line| match line {
                "TM1" => answers_time(line),
                _ => reply(line, b"00", None),
            });
            let settings = Settings {
                answer: Duration::from_secs(10),
                ..Settings::default()
            };
            let mut client = Client::connect(&endpoint, &settings, None, None).unwrap();
            let error = client.read_time().unwrap_err();
            assert!(
                matches!(
                    error,
                    ClientError::Refused { .. } | ClientError::Answer { .. }
                ),
                "{error}"
            );
            client.start(&Parameters::utm_30lx()).unwrap();
            drop(client);
            let started = ["QT", "TM0", "TM1", "TM2", "ME0000108001000"];
            assert_eq!(lines.join().unwrap(), started);
        }
    }
}
