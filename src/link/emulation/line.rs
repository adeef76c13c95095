//! One client's line: what waits for it, at what speed it goes, what is lost.

use super::device::{LineId, Message};
use crate::link::faults::Damage;
use crate::link::{Connection, LinkError};
use std::collections::VecDeque;

/// A line to one client.
pub(super) struct Line {
    pub(super) id: LineId,
    pub(super) connection: Connection,
    pub(super) damage: Damage,
    /// Bytes that wait, and how many of them have gone.
    pub(super) queue: Vec<u8>,
    pub(super) gone: usize,
    /// Where in `queue` whole messages with data end.
    pub(super) ends: VecDeque<usize>,
    /// A serial port's speed, bytes a second.
    pub(super) bytes_per_s: Option<f64>,
    /// When the serial port has sent what it was given, ns.
    pub(super) busy_until_ns: i64,
    /// Messages lost to a full queue.
    pub(super) crowded_out: u64,
    /// Nothing more is said; the line closes once the queue is empty.
    pub(super) closing: bool,
    /// A pseudo terminal outlives its clients.
    pub(super) lasting: bool,
}

/// Data waits up to this many bytes; one message always may.
const ROOM: usize = 256 << 10;
/// The same on a serial line.
const SERIAL_ROOM: usize = 8 << 10;
/// The most that is written to a pseudo terminal at a time on a paced line, s.
const PACED_S: f64 = 0.002;

impl Line {
    pub(super) fn waiting(&self) -> usize {
        self.queue.len() - self.gone
    }

    fn room(&self) -> usize {
        if self.bytes_per_s.is_some() || self.lasting {
            SERIAL_ROOM
        } else {
            ROOM
        }
    }

    pub(super) fn enqueue(&mut self, bytes: &[u8], what: Message) {
        if self.closing {
            return;
        }
        if what == Message::Reply {
            self.queue.extend_from_slice(bytes);
            return;
        }
        let may_lose = what == Message::Data && self.waiting() > 0;
        if may_lose && self.waiting() + bytes.len() > self.room() {
            self.crowded_out += 1;
            return;
        }
        if self.damage.message(bytes, &mut self.queue) {
            self.ends.push_back(self.queue.len());
        }
    }

    /// Whole messages with data that have not all gone are lost: counted as left out on purpose.
    pub(super) fn lose_queue(&mut self) {
        let lost = self.ends.iter().filter(|end| **end > self.gone).count();
        self.damage.lose(lost as u64);
        self.queue.clear();
        self.ends.clear();
        self.gone = 0;
    }

    /// Sends what the line takes now.
    pub(super) fn send(&mut self, now_ns: i64) -> Result<(), LinkError> {
        while self.waiting() > 0 {
            let mut piece = self.damage.piece(self.waiting());
            if let Some(bytes_per_s) = self.bytes_per_s {
                if self.busy_until_ns > now_ns {
                    break;
                }
                piece = piece.min((bytes_per_s * PACED_S).ceil() as usize);
            }
            let bytes = self.queue.get(self.gone..self.gone + piece);
            let sent = self.connection.write_some(bytes.unwrap_or_default())?;
            if sent == 0 {
                break;
            }
            self.gone += sent;
            if let Some(bytes_per_s) = self.bytes_per_s {
                let begun_ns = self.busy_until_ns.max(now_ns - 5_000_000);
                self.busy_until_ns = begun_ns + (sent as f64 / bytes_per_s * 1e9) as i64;
            }
        }
        while self.ends.front().is_some_and(|end| *end <= self.gone) {
            self.ends.pop_front();
        }
        if self.waiting() == 0 {
            self.queue.clear();
            self.gone = 0;
        } else if self.gone > ROOM {
            self.queue.drain(..self.gone);
            for end in &mut self.ends {
                *end -= self.gone;
            }
            self.gone = 0;
        }
        Ok(())
    }
}
