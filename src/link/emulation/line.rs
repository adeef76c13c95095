//! One client's line: what waits for it, at what speed it goes, what is lost.

use super::device::{LineId, Message};
use super::wire::{Wire, is_deaf};
use crate::link::faults::Damage;
use crate::link::{Connection, LinkError};
use std::collections::VecDeque;
use std::path::PathBuf;

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
    /// What a serial port's bytes go over.
    pub(super) wire: Option<Wire>,
    /// Messages lost to a full queue.
    pub(super) crowded_out: u64,
    /// The client takes nothing any more; what it said before is still to be read.
    pub(super) hung_up: bool,
    /// Messages with data that were given up then.
    pub(super) given_up: u64,
    /// Nothing more is said; the line closes once the queue is empty.
    pub(super) closing: bool,
    /// A pseudo terminal outlives its clients: the link that points to it.
    pub(super) lasting: Option<PathBuf>,
}

/// Data waits up to this many bytes; one message always may.
const ROOM: usize = 256 << 10;
/// The same on a serial line.
const SERIAL_ROOM: usize = 8 << 10;

impl Line {
    /// Bytes that wait.
    pub(super) fn waiting(&self) -> usize {
        self.queue.len() - self.gone
    }

    fn room(&self) -> usize {
        if self.wire.is_some() || self.lasting.is_some() {
            SERIAL_ROOM
        } else {
            ROOM
        }
    }

    /// Puts a message behind what waits.
    pub(super) fn enqueue(&mut self, bytes: &[u8], what: Message) {
        if self.closing {
            return;
        }
        if self.hung_up {
            if what != Message::Reply {
                self.given_up += u64::from(self.damage.message(bytes, &mut self.queue));
                self.queue.clear();
            }
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

    /// When bytes that wait have come over the wire, ns; none where they may go at once.
    pub(super) fn wire_due_ns(&self) -> Option<i64> {
        self.wire.as_ref()?.due_ns(self.waiting())
    }

    /// Whole messages with data that have not all gone, or will not.
    pub(super) fn untaken(&self) -> u64 {
        self.given_up + self.half_gone()
    }

    fn half_gone(&self) -> u64 {
        self.ends.iter().filter(|end| **end > self.gone).count() as u64
    }

    /// The client takes nothing any more: what waits for it is given up.
    pub(super) fn hang_up(&mut self) {
        self.given_up = self.untaken();
        self.hung_up = true;
        self.empty();
    }

    /// Whole messages with data that have not all gone are lost: counted as left out on purpose.
    pub(super) fn lose_queue(&mut self) {
        self.damage.lose(self.half_gone());
        self.empty();
    }

    fn empty(&mut self) {
        self.queue.clear();
        self.ends.clear();
        self.gone = 0;
        if let Some(wire) = &mut self.wire {
            wire.begun_ns = None;
        }
    }

    /// Sends what the line takes now.
    pub(super) fn send(&mut self, now_ns: i64) -> Result<(), LinkError> {
        while self.waiting() > 0 {
            let waiting = self.waiting();
            let mut piece = self.damage.piece(waiting);
            if let Some(wire) = &mut self.wire {
                piece = piece.min(wire.ready(waiting, now_ns));
                if piece == 0 {
                    break;
                }
            }
            let bytes = self.queue.get(self.gone..self.gone + piece);
            let bytes = bytes.unwrap_or_default();
            let deaf = is_deaf(self.wire.as_ref(), &self.connection);
            let sent = match self.wire.as_mut().filter(|_| deaf) {
                Some(wire) => self.connection.write_some(&wire.garbage(piece))?,
                None => self.connection.write_some(bytes)?,
            };
            if sent == 0 {
                if let Some(wire) = &mut self.wire {
                    // Nobody reads: what follows is paced anew.
                    wire.begun_ns = Some(now_ns);
                }
                break;
            }
            self.gone += sent;
            let left = self.waiting();
            if let Some(wire) = &mut self.wire {
                wire.handed_over(sent, left);
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
