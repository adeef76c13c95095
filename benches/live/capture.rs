//! scan-capture in a process of its own, and the records out of its pipe with their time.

use crate::{Failure, during};
use cablepose::link::HostInstant;
use std::io::{BufRead, BufReader, Read};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread::JoinHandle;

/// More than a pipe holds, so that one read takes all there is.
const BUFFER: usize = 1 << 20;

/// What the records are written as.
#[derive(Clone, Copy)]
pub enum Format {
    Csv,
    Mcap,
}

/// A record that has come out of the pipe.
#[derive(Clone, Copy)]
pub struct Arrival {
    pub seq: u32,
    /// When scan-capture had the telegram, by its own account (real time), ns.
    pub received_ns: i64,
    /// When the record's last byte had been read here.
    pub at: HostInstant,
}

/// The process; it ends with this.
pub struct Capture {
    process: Child,
    records: Option<JoinHandle<Result<Vec<Arrival>, Failure>>>,
    said: Option<JoinHandle<Vec<String>>>,
}

/// What a capture has given.
pub struct Captured {
    pub records: Vec<Arrival>,
    pub said: Vec<String>,
    pub status: ExitStatus,
}

impl Capture {
    /// Captures from `place`. A line that breaks ends the capture, as a signal does.
    pub fn start(place: &str, format: Format, more: &[&str]) -> Result<Capture, Failure> {
        let name = match format {
            Format::Csv => "csv",
            Format::Mcap => "mcap",
        };
        let mut process = Command::new(env!("CARGO_BIN_EXE_scan-capture"))
            .args([place, "-v", "--format", name])
            .args(more)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(during("scan-capture"))?;
        let stdout = process.stdout.take().ok_or("scan-capture has no stdout")?;
        let stderr = process.stderr.take().ok_or("scan-capture has no stderr")?;
        let id = process.id().to_string();
        let said = std::thread::spawn(move || {
            let mut said = Vec::new();
            for line in BufReader::new(stderr).lines().map_while(Result::ok) {
                if line.ends_with("; reconnecting") {
                    let _ = Command::new("kill").args(["-INT", &id]).status();
                }
                said.push(line);
            }
            said
        });
        Ok(Capture {
            process,
            records: Some(std::thread::spawn(move || arrivals(stdout, format))),
            said: Some(said),
        })
    }

    /// Waits for its end.
    pub fn end(mut self) -> Result<Captured, Failure> {
        let fell = |_| "a reader fell over".to_owned();
        let records = self.records.take().ok_or("no reader")?;
        let said = self.said.take().ok_or("no reader")?;
        Ok(Captured {
            records: records.join().map_err(fell)??,
            said: said.join().map_err(fell)?,
            status: self.process.wait().map_err(during("scan-capture"))?,
        })
    }
}

impl Drop for Capture {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Reads records to the end, each with the time of the read that completed it.
pub fn arrivals(mut pipe: impl Read, format: Format) -> Result<Vec<Arrival>, Failure> {
    let mut buffer = vec![0; BUFFER];
    let mut waiting: Vec<u8> = Vec::new();
    let mut arrivals = Vec::with_capacity(1 << 14);
    let mut cutter = Cutter::new(format);
    loop {
        let count = pipe.read(&mut buffer).map_err(during("stdout"))?;
        let at = HostInstant::now();
        if count == 0 {
            return Ok(arrivals);
        }
        waiting.extend_from_slice(buffer.get(..count).unwrap_or_default());
        let mut taken = 0;
        while let Some(length) = cutter.length(waiting.get(taken..).unwrap_or_default()) {
            let piece = waiting.get(taken..taken + length).unwrap_or_default();
            if let Some((seq, received_ns)) = cutter.record(piece)? {
                arrivals.push(Arrival {
                    seq,
                    received_ns,
                    at,
                });
            }
            taken += length;
        }
        waiting.drain(..taken);
    }
}

/// Cuts a stream into rows, or MCAP's records, and looks at as little of them as will do.
enum Cutter {
    /// Where `seq` and `received_ns` stand; none before the header.
    Csv(Option<[usize; 2]>),
    /// The channel of the scans, the last message of each; none before it was announced.
    Mcap { begun: bool, scans: Option<u16> },
}

impl Cutter {
    fn new(format: Format) -> Cutter {
        match format {
            Format::Csv => Cutter::Csv(None),
            Format::Mcap => Cutter::Mcap {
                begun: false,
                scans: None,
            },
        }
    }

    /// How many bytes the first whole piece has.
    fn length(&mut self, bytes: &[u8]) -> Option<usize> {
        let length = match self {
            Cutter::Csv(_) => 1 + bytes.iter().position(|byte| *byte == b'\n')?,
            Cutter::Mcap { begun: false, .. } => 8, // the magic
            // An operation, the length of what follows.
            Cutter::Mcap { .. } => 9 + usize::try_from(u64_at(bytes, 1)?).ok()?,
        };
        (bytes.len() >= length).then_some(length)
    }

    /// Number and time of reception, where the piece is a scan.
    fn record(&mut self, piece: &[u8]) -> Result<Option<(u32, i64)>, Failure> {
        match self {
            Cutter::Csv(places) => {
                let text = std::str::from_utf8(piece).map_err(during("CSV"))?;
                let fields = || text.trim_end().split(',');
                let Some([seq, received]) = *places else {
                    let place = |name| fields().position(|field| field == name);
                    let found = place("seq").zip(place("received_ns"));
                    let (seq, received) = found.ok_or("CSV without seq or received_ns")?;
                    *places = Some([seq, received]);
                    return Ok(None);
                };
                let number = |place| fields().nth(place).and_then(|field| field.parse().ok());
                let found = number(seq).zip(number(received));
                let (seq, received_ns): (i64, i64) = found.ok_or("a row without its numbers")?;
                Ok(Some((seq as u32, received_ns)))
            }
            Cutter::Mcap { begun, .. } if !*begun => {
                *begun = true;
                Ok(None)
            }
            Cutter::Mcap { scans, .. } => {
                match piece.first() {
                    // A channel: number, schema, length and text of its topic.
                    Some(4)
                        if piece
                            .get(13..)
                            .is_some_and(|s| s.starts_with(b"\x05\0\0\0/scan")) =>
                    {
                        *scans = u16_at(piece, 9);
                    }
                    // A message: channel, sequence, time of reception, time of publication.
                    Some(5) if scans.is_some() && u16_at(piece, 9) == *scans => {
                        let bytes = piece.get(11..15).and_then(|b| b.try_into().ok());
                        let found = bytes.map(u32::from_le_bytes).zip(u64_at(piece, 15));
                        let (seq, received_ns) = found.ok_or("a message cut short")?;
                        return Ok(Some((seq, received_ns as i64)));
                    }
                    _ => {}
                }
                Ok(None)
            }
        }
    }
}

fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    let bytes = bytes.get(at..at + 2)?.try_into().ok()?;
    Some(u16::from_le_bytes(bytes))
}

fn u64_at(bytes: &[u8], at: usize) -> Option<u64> {
    let bytes = bytes.get(at..at + 8)?.try_into().ok()?;
    Some(u64::from_le_bytes(bytes))
}
