//! The lines of an emulated device: sockets and pseudo terminals, their clients, their faults.
//!
//! A [`Device`] is pure: bytes and the time go in, bytes come out. [`Emulation`] owns the lines and
//! the time and runs one device in one thread: it accepts clients, hands over what they send, sends
//! what the device says, at a serial port's speed where asked, and does the damage of
//! [`faults`](super::faults). No client can hold up another or make memory grow: a slow one loses
//! whole messages with data, and one that does not read its replies is not read from.

use super::faults::{Damage, Faults, Losses, Mishap, TimedFault};
use super::{Connection, HostInstant, LinkError, Pty};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::collections::VecDeque;
use std::fmt;
use std::io;
use std::net::{SocketAddr, TcpListener};
use std::os::fd::{AsFd, BorrowedFd};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

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
    bytes: Vec<u8>,
    orders: Vec<Order>,
}

#[derive(Clone, Copy, Debug)]
enum Order {
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

/// How time goes.
#[derive(Clone, Copy, Debug)]
struct Time {
    start: HostInstant,
    /// Seconds a second; none: as fast as can be.
    speed: Option<f64>,
    /// Time passed over, ns.
    skipped_ns: i64,
}

impl Time {
    fn now_ns(&self) -> i64 {
        // True time runs evenly: no time server slews this clock.
        let elapsed_ns = HostInstant::now().raw_ns - self.start.raw_ns;
        match self.speed {
            Some(1.0) => elapsed_ns,
            Some(speed) => (elapsed_ns as f64 * speed) as i64,
            None => elapsed_ns + self.skipped_ns,
        }
    }

    /// The host's time until an instant.
    fn until(&self, t_ns: i64) -> Duration {
        let left_ns = t_ns.saturating_sub(self.now_ns()).max(0) as f64;
        Duration::from_secs_f64(left_ns * 1e-9 / self.speed.unwrap_or(1.0))
    }

    fn pass_over_to(&mut self, t_ns: i64) {
        if self.speed.is_none() {
            self.skipped_ns += t_ns.saturating_sub(self.now_ns()).max(0);
        }
    }
}

fn nanoseconds(duration: Duration) -> i64 {
    i64::try_from(duration.as_nanos()).unwrap_or(i64::MAX)
}

/// Where clients come in.
enum Door {
    Tcp(TcpListener),
    /// A pseudo terminal has one line, which is always open.
    Pty,
}

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
struct Wire {
    serial: Serial,
    bytes_per_s: f64,
    /// When the first waiting byte began to go out, ns; none: nothing waits.
    begun_ns: Option<i64>,
    /// State of the garbage.
    noise: u64,
}

impl Wire {
    fn new(serial: Serial) -> Option<Wire> {
        Some(Wire {
            serial,
            bytes_per_s: f64::from(serial.baud?) / 10.0,
            begun_ns: None,
            noise: 0x9E37_79B9_7F4A_7C15,
        })
    }

    fn duration_ns(&self, bytes: usize) -> i64 {
        (bytes as f64 / self.bytes_per_s * 1e9).ceil() as i64
    }

    /// Bytes that are handed over in one piece without an adapter.
    fn piece(&self, waiting: usize) -> usize {
        waiting.min((self.bytes_per_s * PACED_S).ceil() as usize)
    }

    /// How many of `waiting` bytes may be handed over now.
    fn ready(&mut self, waiting: usize, now_ns: i64) -> usize {
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
    fn due_ns(&self, waiting: usize) -> Option<i64> {
        let begun_ns = self.begun_ns.filter(|_| waiting > 0)?;
        let adapter_ns = nanoseconds(self.serial.adapter);
        if adapter_ns > 0 {
            let first_ns = begun_ns + self.duration_ns(1);
            return Some((first_ns + adapter_ns - 1).div_euclid(adapter_ns) * adapter_ns);
        }
        Some(begun_ns + self.duration_ns(self.piece(waiting)))
    }

    /// So many bytes were handed over, and so many still wait.
    fn handed_over(&mut self, bytes: usize, waiting: usize) {
        let duration_ns = bytes as f64 / self.bytes_per_s * 1e9;
        self.begun_ns = self
            .begun_ns
            .filter(|_| waiting > 0)
            .map(|begun_ns| begun_ns + duration_ns.round() as i64);
    }

    /// What a listener at the wrong speed hears of `count` bytes.
    fn garbage(&mut self, count: usize) -> Vec<u8> {
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

/// A pseudo terminal that is unplugged, to come back.
struct Unplugged {
    id: LineId,
    link: PathBuf,
    damage: Damage,
    wire: Option<Wire>,
    crowded_out: u64,
    back_ns: i64,
}

struct Line {
    id: LineId,
    connection: Connection,
    damage: Damage,
    /// Bytes that wait, and how many of them have gone.
    queue: Vec<u8>,
    gone: usize,
    /// Where in `queue` whole messages with data end.
    ends: VecDeque<usize>,
    /// What a serial port's bytes go over.
    wire: Option<Wire>,
    /// Messages lost to a full queue.
    crowded_out: u64,
    /// Nothing more is said; the line closes once the queue is empty.
    closing: bool,
    /// A pseudo terminal outlives its clients: the link that points to it.
    lasting: Option<PathBuf>,
}

/// Data waits up to this many bytes; one message always may.
const ROOM: usize = 256 << 10;
/// The same on a serial line.
const SERIAL_ROOM: usize = 8 << 10;
/// With more than this waiting, a client is not read from.
const UNREAD: usize = 64 << 10;
/// The longest wait between two looks at whether to stop.
const NAP: Duration = Duration::from_millis(20);
/// How long clients are given to take what was said last.
const FAREWELL: Duration = Duration::from_secs(2);
/// Clients at a time; further ones are turned away.
const MOST_LINES: usize = 64;
/// The most that is written to a pseudo terminal at a time on a paced line, s.
const PACED_S: f64 = 0.002;

impl Line {
    fn waiting(&self) -> usize {
        self.queue.len() - self.gone
    }

    fn room(&self) -> usize {
        if self.wire.is_some() || self.lasting.is_some() {
            SERIAL_ROOM
        } else {
            ROOM
        }
    }

    fn enqueue(&mut self, bytes: &[u8], what: Message) {
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

    /// When bytes that wait have come over the wire, ns; none where they may go at once.
    fn wire_due_ns(&self) -> Option<i64> {
        self.wire.as_ref()?.due_ns(self.waiting())
    }

    /// Whole messages with data that have not all gone are lost: counted as left out on purpose.
    fn lose_queue(&mut self) {
        let lost = self.ends.iter().filter(|end| **end > self.gone).count();
        self.damage.lose(lost as u64);
        self.queue.clear();
        self.ends.clear();
        self.gone = 0;
        if let Some(wire) = &mut self.wire {
            wire.begun_ns = None;
        }
    }

    /// Sends what the line takes now.
    fn send(&mut self, now_ns: i64) -> Result<(), LinkError> {
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

/// Whether the client's end of a strict serial line runs at another speed.
fn is_deaf(wire: Option<&Wire>, connection: &Connection) -> bool {
    wire.filter(|wire| wire.serial.strict).is_some_and(|wire| {
        let theirs = connection.peer_baud();
        theirs.is_some() && theirs != wire.serial.baud
    })
}

/// What an emulation has done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Account {
    /// Clients that came.
    pub clients: u64,
    /// What became of the messages with data.
    pub losses: Losses,
    /// Messages with data that slow clients lost.
    pub crowded_out: u64,
}

impl fmt::Display for Account {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} messages to {} clients: {}; {} lost by slow clients",
            self.losses.messages + self.crowded_out,
            self.clients,
            self.losses,
            self.crowded_out
        )
    }
}

/// How an emulation runs.
#[derive(Clone, Debug, Default)]
pub struct Conditions {
    /// Seconds a second; none: as fast as can be.
    pub speed: Option<f64>,
    /// What goes wrong.
    pub faults: Faults,
    /// Seed of the faults.
    pub seed: u64,
}

/// The lines of one device.
pub struct Emulation {
    time: Time,
    conditions: Conditions,
    doors: Vec<Door>,
    lines: Vec<Line>,
    unplugged: Vec<Unplugged>,
    next_line: LineId,
    mishaps: VecDeque<TimedFault>,
    stalled_until_ns: i64,
    dark_until_ns: i64,
    /// Clients are turned away until then.
    down_until_ns: i64,
    account: Account,
}

impl Emulation {
    /// When true time began.
    pub fn start(&self) -> HostInstant {
        self.time.start
    }

    /// No lines yet; time begins now.
    pub fn new(conditions: Conditions) -> Emulation {
        Emulation {
            time: Time {
                start: HostInstant::now(),
                speed: conditions.speed,
                skipped_ns: 0,
            },
            mishaps: conditions.faults.timed.iter().copied().collect(),
            conditions,
            doors: Vec::new(),
            lines: Vec::new(),
            unplugged: Vec::new(),
            next_line: 0,
            stalled_until_ns: i64::MIN,
            dark_until_ns: i64::MIN,
            down_until_ns: i64::MIN,
            account: Account::default(),
        }
    }

    /// Takes clients at an address; the port taken, where 0 was asked.
    pub fn listen(&mut self, address: SocketAddr) -> Result<SocketAddr, LinkError> {
        let open = |error: io::Error| LinkError::Open {
            place: address.to_string(),
            reason: super::connection::plain(&error),
        };
        let listener = TcpListener::bind(address).map_err(open)?;
        listener.set_nonblocking(true).map_err(open)?;
        let address = listener.local_addr().map_err(open)?;
        self.doors.push(Door::Tcp(listener));
        Ok(address)
    }

    /// Opens a pseudo terminal that `link` points to, with a serial port's speed, baud (8N1: ten
    /// bits a byte); what to open at the other end.
    pub fn open_pty(
        &mut self,
        device: &mut impl Device,
        link: &Path,
        baud: Option<u32>,
    ) -> Result<PathBuf, LinkError> {
        let serial = Serial {
            baud,
            ..Serial::default()
        };
        self.open_serial(device, link, serial)
    }

    /// The same with everything that a serial line can be.
    pub fn open_serial(
        &mut self,
        device: &mut impl Device,
        link: &Path,
        serial: Serial,
    ) -> Result<PathBuf, LinkError> {
        let pty = Pty::open_as(link).map_err(|error| LinkError::Open {
            place: link.display().to_string(),
            reason: super::connection::plain(&error),
        })?;
        let path = pty.path().to_owned();
        let service = self.doors.len();
        self.doors.push(Door::Pty);
        let connection = Connection::from_pty(pty);
        let id = self.add(connection, Wire::new(serial), Some(link.to_owned()));
        device.connected(id, service, self.time.now_ns());
        Ok(path)
    }

    fn add(
        &mut self,
        connection: Connection,
        wire: Option<Wire>,
        lasting: Option<PathBuf>,
    ) -> LineId {
        let id = self.next_line;
        self.next_line += 1;
        self.account.clients += u64::from(lasting.is_none());
        self.lines.push(Line {
            id,
            connection,
            damage: Damage::new(&self.conditions.faults, self.conditions.seed, id),
            queue: Vec::new(),
            gone: 0,
            ends: VecDeque::new(),
            wire,
            crowded_out: 0,
            closing: false,
            lasting,
        });
        id
    }

    /// Runs until the device has ended or `stop` says so, and lets the clients take what was said
    /// last; what was done.
    ///
    /// # Errors
    /// [`LinkError::Io`] where the host itself fails; a client that fails only leaves.
    pub fn run(
        mut self,
        device: &mut impl Device,
        mut stop: impl FnMut() -> bool,
    ) -> Result<Account, LinkError> {
        let mut out = Outbox::default();
        let mut buffer = vec![0; 4 << 10];
        while !stop() && !device.ended() {
            self.suffer(device);
            let ready = self.wait(device)?;
            self.accept(device);
            self.receive(device, &ready, &mut buffer, &mut out);
            let now_ns = self.time.now_ns();
            if device.due_ns().is_some_and(|due_ns| due_ns <= now_ns) {
                device.advance(now_ns, &mut out);
            }
            self.deliver(device, &mut out);
            self.follow_baud(device);
            self.send(device);
            device.prepare();
        }
        self.say_farewell(device);
        Ok(self.account)
    }

    /// Whether nothing is read, sent or accepted now.
    fn is_dark(&self, now_ns: i64) -> bool {
        now_ns < self.dark_until_ns
    }

    /// Waits until there is something to do; whether each line can be read.
    fn wait(&mut self, device: &impl Device) -> Result<Vec<bool>, LinkError> {
        let now_ns = self.time.now_ns();
        let due_ns = device.due_ns();
        let mut wait = NAP;
        if let Some(due_ns) = due_ns {
            let drained = self.lines.iter().all(|line| line.waiting() == 0);
            if self.time.speed.is_none() && drained && device.hurries() {
                let mishap_ns = self.mishaps.front().map(|fault| nanoseconds(fault.at));
                self.time
                    .pass_over_to(due_ns.min(mishap_ns.unwrap_or(i64::MAX)));
            }
            wait = wait.min(self.time.until(due_ns));
        }
        if let Some(fault) = self.mishaps.front() {
            wait = wait.min(self.time.until(nanoseconds(fault.at)));
        }
        for until_ns in [self.stalled_until_ns, self.dark_until_ns] {
            if until_ns > now_ns {
                wait = wait.min(self.time.until(until_ns));
            }
        }
        for due_ns in self.lines.iter().filter_map(Line::wire_due_ns) {
            wait = wait.min(self.time.until(due_ns));
        }
        for away in &self.unplugged {
            wait = wait.min(self.time.until(away.back_ns));
        }
        if self.is_dark(now_ns) {
            std::thread::sleep(wait);
            return Ok(vec![false; self.lines.len()]);
        }
        let silent = now_ns < self.stalled_until_ns;
        let mut waited: Vec<(BorrowedFd, PollFlags)> = Vec::new();
        for line in &self.lines {
            let mut what = PollFlags::empty();
            what.set(PollFlags::IN, line.waiting() <= UNREAD && !line.closing);
            let may_send = !silent && line.wire_due_ns().is_none_or(|due_ns| due_ns <= now_ns);
            what.set(PollFlags::OUT, line.waiting() > 0 && may_send);
            if let Some(line) = line.connection.waitable() {
                waited.push((line, what));
            }
        }
        for door in &self.doors {
            if let Door::Tcp(listener) = door {
                waited.push((listener.as_fd(), PollFlags::IN));
            }
        }
        let mut waited: Vec<PollFd> = waited
            .into_iter()
            .map(|(line, what)| PollFd::from_borrowed_fd(line, what))
            .collect();
        let wait = Timespec {
            tv_sec: i64::try_from(wait.as_secs()).unwrap_or(i64::MAX),
            tv_nsec: wait.subsec_nanos().into(),
        };
        match poll(&mut waited, Some(&wait)) {
            Ok(_) | Err(rustix::io::Errno::INTR) => {}
            Err(error) => {
                return Err(LinkError::Io {
                    place: "waiting for clients".into(),
                    reason: super::connection::plain(&error.into()),
                });
            }
        }
        let readable = PollFlags::IN | PollFlags::HUP | PollFlags::ERR;
        let lines = waited.iter().take(self.lines.len());
        Ok(lines
            .map(|line| line.revents().intersects(readable))
            .collect())
    }

    fn accept(&mut self, device: &mut impl Device) {
        let now_ns = self.time.now_ns();
        if self.is_dark(now_ns) {
            return;
        }
        for service in 0..self.doors.len() {
            loop {
                let Some(Door::Tcp(listener)) = self.doors.get(service) else {
                    break;
                };
                let Ok((stream, _)) = listener.accept() else {
                    break;
                };
                let Ok(connection) = Connection::from_stream(stream) else {
                    continue;
                };
                if now_ns < self.down_until_ns || self.lines.len() >= MOST_LINES {
                    connection.reset();
                    continue;
                }
                let id = self.add(connection, None, None);
                device.connected(id, service, now_ns);
            }
        }
    }

    fn receive(
        &mut self,
        device: &mut impl Device,
        ready: &[bool],
        buffer: &mut [u8],
        out: &mut Outbox,
    ) {
        let mut left = Vec::new();
        let now_ns = self.time.now_ns();
        for (line, ready) in self.lines.iter_mut().zip(ready) {
            if !ready || line.closing {
                continue;
            }
            match line.connection.read(buffer, Duration::ZERO) {
                Ok(None) => {}
                Ok(Some(received)) => {
                    let bytes = buffer.get(..received.bytes).unwrap_or_default();
                    // A pseudo terminal of a device that is down hears nothing, nor does one that
                    // is spoken to at another speed.
                    let deaf = is_deaf(line.wire.as_ref(), &line.connection);
                    if now_ns >= self.down_until_ns && !deaf {
                        device.input(line.id, bytes, self.time.now_ns(), out);
                    }
                }
                Err(_) => left.push(line.id),
            }
        }
        left.into_iter().for_each(|id| self.remove(device, id));
    }

    fn remove(&mut self, device: &mut impl Device, id: LineId) {
        if let Some(place) = self.lines.iter().position(|line| line.id == id) {
            let line = self.lines.remove(place);
            self.account.losses.add(&line.damage.losses());
            self.account.crowded_out += line.crowded_out;
            device.disconnected(id);
        }
    }

    /// Puts what the device said into the lines' queues.
    fn deliver(&mut self, device: &mut impl Device, out: &mut Outbox) {
        if out.orders.is_empty() {
            return;
        }
        let dark = self.is_dark(self.time.now_ns());
        let mut start = 0;
        let mut restart = None;
        for order in out.orders.drain(..) {
            match order {
                Order::Send { line, what, end } => {
                    let bytes = out.bytes.get(start..end).unwrap_or_default();
                    start = end;
                    let Some(line) = self.lines.iter_mut().find(|l| l.id == line) else {
                        continue;
                    };
                    line.enqueue(bytes, what);
                    if dark {
                        line.lose_queue();
                    }
                }
                Order::Close(line) => {
                    if let Some(line) = self.lines.iter_mut().find(|l| l.id == line) {
                        line.closing = true;
                    }
                }
                Order::Restart(boot) => restart = Some(boot),
            }
        }
        out.bytes.clear();
        if let Some(boot) = restart {
            self.send(device);
            self.restart(device, boot);
        }
    }

    fn send(&mut self, device: &mut impl Device) {
        let now_ns = self.time.now_ns();
        if self.is_dark(now_ns) || now_ns < self.stalled_until_ns {
            return;
        }
        let mut left = Vec::new();
        for line in &mut self.lines {
            let failed = line.send(now_ns).is_err();
            if failed || (line.closing && line.waiting() == 0) {
                left.push(line.id);
            }
        }
        left.into_iter().for_each(|id| self.remove(device, id));
    }

    /// Does what goes wrong at its time.
    fn suffer(&mut self, device: &mut impl Device) {
        let now_ns = self.time.now_ns();
        if self.dark_until_ns != i64::MIN && now_ns >= self.dark_until_ns {
            self.dark_until_ns = i64::MIN;
            self.break_off(device);
        }
        self.plug_in(now_ns);
        while let Some(fault) = self.mishaps.front().copied() {
            if nanoseconds(fault.at) > now_ns {
                return;
            }
            self.mishaps.pop_front();
            match fault.what {
                Mishap::Stall(lasts) => self.stalled_until_ns = now_ns + nanoseconds(lasts),
                Mishap::Reset => self.break_off(device),
                Mishap::Blackhole(lasts) => {
                    self.dark_until_ns = now_ns + nanoseconds(lasts);
                    self.lines.iter_mut().for_each(Line::lose_queue);
                }
                Mishap::Reboot(lasts) => self.restart(device, lasts),
                Mishap::Unplug(lasts) => self.unplug(now_ns + nanoseconds(lasts)),
            }
        }
    }

    /// Pulls every pseudo terminal: its link is gone and whoever has it open reads an error. The device
    /// talks on into nothing.
    fn unplug(&mut self, back_ns: i64) {
        for mut line in std::mem::take(&mut self.lines) {
            let Some(link) = line.lasting.clone() else {
                self.lines.push(line);
                continue;
            };
            line.lose_queue();
            self.unplugged.push(Unplugged {
                id: line.id,
                link,
                damage: line.damage,
                wire: line.wire,
                crowded_out: line.crowded_out,
                back_ns,
            });
        }
    }

    /// Brings back what was unplugged for long enough.
    fn plug_in(&mut self, now_ns: i64) {
        for away in std::mem::take(&mut self.unplugged) {
            let opened = (away.back_ns <= now_ns).then(|| Pty::open_as(&away.link));
            let Some(Ok(pty)) = opened else {
                // Where the link's place is taken, it is tried again.
                self.unplugged.push(away);
                continue;
            };
            let id = self.add(Connection::from_pty(pty), away.wire, Some(away.link));
            if let Some(line) = self.lines.iter_mut().find(|line| line.id == id) {
                line.id = away.id;
                line.damage = away.damage;
                line.crowded_out = away.crowded_out;
            }
        }
    }

    /// Lets the serial lines go at the device's speed.
    fn follow_baud(&mut self, device: &impl Device) {
        let Some(baud) = device.baud() else {
            return;
        };
        let away = self.unplugged.iter_mut().map(|away| &mut away.wire);
        let wires = self.lines.iter_mut().map(|line| &mut line.wire).chain(away);
        for wire in wires
            .flatten()
            .filter(|wire| wire.serial.baud != Some(baud))
        {
            wire.serial.baud = Some(baud);
            wire.bytes_per_s = f64::from(baud) / 10.0;
        }
    }

    /// Resets every socket and empties every pseudo terminal's queue.
    fn break_off(&mut self, device: &mut impl Device) {
        for line in &mut self.lines {
            line.lose_queue();
        }
        let (lasting, gone): (Vec<Line>, Vec<Line>) = self
            .lines
            .drain(..)
            .partition(|line| line.lasting.is_some());
        self.lines = lasting;
        for line in gone {
            self.account.losses.add(&line.damage.losses());
            self.account.crowded_out += line.crowded_out;
            device.disconnected(line.id);
            line.connection.reset();
        }
    }

    /// The device restarts. For the first half of that time it does not take clients.
    fn restart(&mut self, device: &mut impl Device, boot: Duration) {
        let now_ns = self.time.now_ns();
        self.break_off(device);
        self.down_until_ns = now_ns + nanoseconds(boot) / 2;
        device.restart(now_ns, boot);
    }

    /// Sends what waits, ends the sockets in order and adds up.
    fn say_farewell(&mut self, device: &mut impl Device) {
        let due = Instant::now() + FAREWELL;
        self.stalled_until_ns = i64::MIN;
        while Instant::now() < due && self.lines.iter().any(|line| line.waiting() > 0) {
            self.send(device);
            std::thread::sleep(Duration::from_millis(1));
        }
        for line in std::mem::take(&mut self.lines) {
            let unsent = line.ends.iter().filter(|end| **end > line.gone).count();
            self.account.losses.add(&line.damage.losses());
            self.account.crowded_out += line.crowded_out + unsent as u64;
            line.connection.end();
        }
        for away in std::mem::take(&mut self.unplugged) {
            self.account.losses.add(&away.damage.losses());
            self.account.crowded_out += away.crowded_out;
        }
    }
}
