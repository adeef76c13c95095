//! The lines of an emulated device: sockets and pseudo terminals, their clients, their faults.
//!
//! A [`Device`] is pure: bytes and the time go in, bytes come out. [`Emulation`] owns the lines and
//! the time and runs one device in one thread: it accepts clients, hands over what they send, sends
//! what the device says, at a serial port's speed where asked, and does the damage of
//! [`faults`](super::faults). No client can hold up another or make memory grow: a slow one loses
//! whole messages with data, and one that does not read its replies is not read from.

mod device;
mod line;
mod time;
mod wire;

pub use device::{Device, LineId, Message, Outbox};
pub use time::nanoseconds;
pub use wire::Serial;

use super::connection::{plain, timespec};
use super::faults::{Damage, Faults, Losses, Mishap, TimedFault};
use super::{Connection, HostInstant, LinkError, Pty};
use device::Order;
use line::Line;
use rustix::event::{PollFd, PollFlags, poll};
use rustix::fd::{AsFd, BorrowedFd};
use std::collections::VecDeque;
use std::fmt;
use std::io;
use std::net::{SocketAddr, TcpListener};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use time::Time;
use wire::{Wire, is_deaf};

/// With more than this waiting, a client is not read from.
const UNREAD: usize = 64 << 10;
/// The longest wait between two looks at whether to stop.
const NAP: Duration = Duration::from_millis(20);
/// How long clients are given to take what was said last.
const FAREWELL: Duration = Duration::from_secs(2);
/// Clients at a time; further ones are turned away.
const MOST_LINES: usize = 64;

/// Where clients come in.
enum Door {
    Tcp(TcpListener),
    /// A pseudo terminal has one line, which is always open.
    Pty,
}

/// What there is to do.
struct Ready {
    /// Whether each line can be read.
    lines: Vec<bool>,
    /// Whether somebody may be at a door. Asking every door each time would cost a request for
    /// nothing, in the middle of an answer.
    doors: bool,
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

/// What an emulation has done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Account {
    /// Clients that came.
    pub clients: u64,
    /// What became of the messages with data.
    pub losses: Losses,
    /// Messages with data that slow clients lost.
    pub crowded_out: u64,
    /// Messages with data that clients had not taken when they left.
    pub untaken: u64,
}

impl fmt::Display for Account {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} messages to {} clients: {}; {} lost by slow clients, {} not taken by clients that left",
            self.losses.messages + self.crowded_out,
            self.clients,
            self.losses,
            self.crowded_out,
            self.untaken
        )
    }
}

impl Account {
    /// Adds what became of a line that is gone.
    fn add(&mut self, line: &Line) {
        self.losses.add(&line.damage.losses());
        self.crowded_out += line.crowded_out;
        self.untaken += line.untaken();
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
    /// No lines yet; time begins now.
    pub fn new(conditions: Conditions) -> Emulation {
        Emulation {
            time: Time::new(conditions.speed),
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

    /// When true time began.
    pub fn start(&self) -> HostInstant {
        self.time.start
    }

    /// Takes clients at an address; the port taken, where 0 was asked.
    pub fn listen(&mut self, address: SocketAddr) -> Result<SocketAddr, LinkError> {
        let open = |error: io::Error| LinkError::Open {
            place: address.to_string(),
            reason: plain(&error),
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
            reason: plain(&error),
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
            hung_up: false,
            given_up: 0,
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
            if ready.doors {
                self.accept(device);
            }
            self.receive(device, &ready.lines, &mut buffer, &mut out);
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

    /// Waits until there is something to do.
    fn wait(&mut self, device: &impl Device) -> Result<Ready, LinkError> {
        let now_ns = self.time.now_ns();
        let due_ns = device.due_ns();
        let mut wait = NAP;
        if let Some(due_ns) = due_ns {
            let drained = self.lines.iter().all(|line| line.waiting() == 0);
            if self.time.is_free() && drained && device.hurries() {
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
            return Ok(Ready {
                lines: vec![false; self.lines.len()],
                doors: true,
            });
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
        match poll(&mut waited, Some(&timespec(wait))) {
            Ok(_) | Err(rustix::io::Errno::INTR) => {}
            Err(error) => {
                return Err(LinkError::Io {
                    place: "waiting for clients".into(),
                    reason: plain(&error.into()),
                });
            }
        }
        let readable = PollFlags::IN | PollFlags::HUP | PollFlags::ERR;
        let readable = |waited: &PollFd| waited.revents().intersects(readable);
        Ok(Ready {
            lines: waited.iter().take(self.lines.len()).map(readable).collect(),
            doors: waited.iter().skip(self.lines.len()).any(readable),
        })
    }

    fn accept(&mut self, device: &mut impl Device) {
        let now_ns = self.time.now_ns();
        if self.is_dark(now_ns) {
            return;
        }
        for service in 0..self.doors.len() {
            while let Some(Door::Tcp(listener)) = self.doors.get(service) {
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
            self.account.add(&self.lines.remove(place));
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
            if failed && !line.closing && line.lasting.is_none() {
                // Who closes without reading everything is still heard to its last word: reading
                // comes to the end, and that removes the line.
                line.hang_up();
            } else if failed || (line.closing && line.waiting() == 0) {
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
        wires.flatten().for_each(|wire| wire.set_baud(baud));
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
            self.account.add(&line);
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
            self.account.add(&line);
            line.connection.end();
        }
        for away in std::mem::take(&mut self.unplugged) {
            self.account.losses.add(&away.damage.losses());
            self.account.crowded_out += away.crowded_out;
        }
    }
}

#[cfg(test)]
mod tests;
