//! What a device is to its lines: bytes and the time in, orders out.

use std::time::Duration;

/// One client's line, by number; a number is never used twice.
pub type LineId = u64;

/// A device without its lines. All times are nanoseconds of true time since the emulation's start.
pub trait Device {
    /// A client came to the service of this number (in the order in which they were added).
    fn connected(&mut self, _line: LineId, _service: usize, _now_ns: i64) {}
    /// It left.
    fn disconnected(&mut self, _line: LineId) {}
    /// Bytes came.
    fn input(&mut self, line: LineId, bytes: &[u8], now_ns: i64, out: &mut Outbox);
    /// Does what is due by now.
    fn advance(&mut self, now_ns: i64, out: &mut Outbox);
    /// When [`Device::advance`] is to be called next; none: not before something else happens.
    fn due_ns(&self) -> Option<i64>;
    /// Time to work ahead, so that what is due next is ready then.
    fn prepare(&mut self) {}
    /// The device restarts now and needs so long for it; its lines are gone.
    fn restart(&mut self, _now_ns: i64, _boot: Duration) {}
    /// The speed at which it talks on a serial line now; none: that which the line was opened with.
    fn baud(&self) -> Option<u32> {
        None
    }
    /// Whether the time until what is due next may be passed over when time is as fast as can be.
    fn hurries(&self) -> bool {
        true
    }
    /// Nothing will come any more.
    fn ended(&self) -> bool {
        false
    }
}

/// What a device wants done.
#[derive(Debug, Default)]
pub struct Outbox {
    pub(super) bytes: Vec<u8>,
    pub(super) orders: Vec<Order>,
}

/// One thing to be done.
#[derive(Clone, Copy, Debug)]
pub(super) enum Order {
    Send {
        line: LineId,
        what: Message,
        end: usize,
    },
    Close(LineId),
    Restart(Duration),
}

/// What is sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Message {
    /// An answer.
    Reply,
    /// Data that was asked for.
    Polled,
    /// Data that comes by itself.
    Data,
}

impl Outbox {
    /// Sends an answer: never damaged, never lost to a full buffer.
    pub fn reply(&mut self, line: LineId, bytes: &[u8]) {
        self.send(line, bytes, Message::Reply);
    }

    /// Sends data (a scan, a sample) that comes by itself: the faults damage it, slow clients lose it.
    pub fn data(&mut self, line: LineId, bytes: &[u8]) {
        self.send(line, bytes, Message::Data);
    }

    /// Sends data that a client asked for: the faults damage it, but it is never lost to a full
    /// buffer.
    pub fn polled(&mut self, line: LineId, bytes: &[u8]) {
        self.send(line, bytes, Message::Polled);
    }

    /// Closes a line once what was said before has gone.
    pub fn close(&mut self, line: LineId) {
        self.orders.push(Order::Close(line));
    }

    /// The device restarts, once what was said before has gone.
    pub fn restart(&mut self, boot: Duration) {
        self.orders.push(Order::Restart(boot));
    }

    /// What has been sent to whom, for whoever runs a device without lines.
    pub fn take(&mut self) -> Vec<(LineId, Message, Vec<u8>)> {
        let mut sent = Vec::new();
        let mut start = 0;
        for order in self.orders.drain(..) {
            if let Order::Send { line, what, end } = order {
                let bytes = self.bytes.get(start..end).unwrap_or_default();
                sent.push((line, what, bytes.to_vec()));
                start = end;
            }
        }
        self.bytes.clear();
        sent
    }

    fn send(&mut self, line: LineId, bytes: &[u8], what: Message) {
        self.bytes.extend_from_slice(bytes);
        let end = self.bytes.len();
        self.orders.push(Order::Send { line, what, end });
    }
}
