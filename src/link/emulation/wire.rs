//! A serial line's wire: when which byte has come over.

use super::time::nanoseconds;
use crate::link::Connection;
use std::time::Duration;

/// The most that is written to a pseudo terminal at a time on a paced line, s.
const PACED_S: f64 = 0.002;

/// A serial line.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Serial {
    /// Its speed (8N1: ten bits a byte); none: as fast as can be.
    pub baud: Option<u32>,
    /// An adapter collects what comes and hands it over every so often (FTDI's latency timer: 16 ms);
    /// zero: a plain port.
    pub adapter: Duration,
    /// Whoever listens at another speed hears garbage and is not heard.
    pub strict: bool,
}

/// The wire behind a pseudo terminal: when which byte has come over.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wire {
    pub(super) serial: Serial,
    bytes_per_s: f64,
    /// When the first waiting byte began to go out, ns; none: nothing waits.
    pub(super) begun_ns: Option<i64>,
    /// State of the garbage.
    noise: u64,
}

impl Wire {
    /// The wire of a line whose speed is known.
    pub(super) fn new(serial: Serial) -> Option<Wire> {
        let mut wire = Wire {
            serial,
            bytes_per_s: 0.0,
            begun_ns: None,
            noise: 0x9E37_79B9_7F4A_7C15,
        };
        wire.set_baud(serial.baud?);
        Some(wire)
    }

    /// Goes on at another speed; the slowest is 1 baud.
    pub(super) fn set_baud(&mut self, baud: u32) {
        self.serial.baud = Some(baud);
        self.bytes_per_s = f64::from(baud.max(1)) / 10.0;
    }

    fn duration_ns(&self, bytes: usize) -> i64 {
        (bytes as f64 / self.bytes_per_s * 1e9).ceil() as i64
    }

    /// Bytes that are handed over in one piece without an adapter.
    fn piece(&self, waiting: usize) -> usize {
        waiting.min((self.bytes_per_s * PACED_S).ceil() as usize)
    }

    /// How many of `waiting` bytes may be handed over now.
    pub(super) fn ready(&mut self, waiting: usize, now_ns: i64) -> usize {
        let begun_ns = *self.begun_ns.get_or_insert(now_ns);
        let adapter_ns = nanoseconds(self.serial.adapter);
        let at_ns = if adapter_ns > 0 {
            now_ns.div_euclid(adapter_ns) * adapter_ns
        } else {
            now_ns
        };
        let gone = ((at_ns - begun_ns) as f64 * 1e-9 * self.bytes_per_s + 1e-6).floor();
        let gone = (gone.max(0.0) as usize).min(waiting);
        if adapter_ns > 0 || gone >= self.piece(waiting) {
            gone
        } else {
            0
        }
    }

    /// When to look again, with `waiting` bytes on the way.
    pub(super) fn due_ns(&self, waiting: usize) -> Option<i64> {
        let begun_ns = self.begun_ns.filter(|_| waiting > 0)?;
        let adapter_ns = nanoseconds(self.serial.adapter);
        if adapter_ns > 0 {
            let first_ns = begun_ns + self.duration_ns(1);
            return Some((first_ns + adapter_ns - 1).div_euclid(adapter_ns) * adapter_ns);
        }
        Some(begun_ns + self.duration_ns(self.piece(waiting)))
    }

    /// So many bytes were handed over, and so many still wait.
    pub(super) fn handed_over(&mut self, bytes: usize, waiting: usize) {
        let duration_ns = bytes as f64 / self.bytes_per_s * 1e9;
        self.begun_ns = self
            .begun_ns
            .filter(|_| waiting > 0)
            .map(|begun_ns| begun_ns + duration_ns.round() as i64);
    }

    /// What a listener at the wrong speed hears of `count` bytes.
    pub(super) fn garbage(&mut self, count: usize) -> Vec<u8> {
        let mut heard = vec![0; count];
        for byte in &mut heard {
            self.noise ^= self.noise << 13;
            self.noise ^= self.noise >> 7;
            self.noise ^= self.noise << 17;
            *byte = (self.noise >> 32) as u8;
        }
        heard
    }
}

/// Whether the client's end of a strict serial line runs at another speed.
pub(super) fn is_deaf(wire: Option<&Wire>, connection: &Connection) -> bool {
    wire.filter(|wire| wire.serial.strict).is_some_and(|wire| {
        let theirs = connection.peer_baud();
        theirs.is_some() && theirs != wire.serial.baud
    })
}
