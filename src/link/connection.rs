//! An open line to a device (or, for an emulated device, to its user).

use super::system::{NinthBit, is_unplugged};
use super::{Endpoint, HostInstant, Pty, Waiter};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fd::{AsFd, BorrowedFd};
use rustix::io::Errno;
use serialport::SerialPort;
use std::io::{self, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpStream, ToSocketAddrs};
use std::time::{Duration, Instant};

/// Why a line is of no use (any more).
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// It cannot be opened.
    #[error("{place}: {reason}")]
    Open {
        /// Host and port, or the serial port.
        place: String,
        /// Why, and what to do.
        reason: String,
    },
    /// The other side closed it, or the port is gone.
    #[error("{place}: the connection was closed")]
    Closed {
        /// Host and port, or the serial port.
        place: String,
    },
    /// Nothing could be written for as long as was waited.
    #[error("{place}: nothing taken for {waited_s} s")]
    Stuck {
        /// Host and port, or the serial port.
        place: String,
        /// How long was waited, s.
        waited_s: f64,
    },
    /// Any other fault.
    #[error("{place}: {reason}")]
    Io {
        /// Host and port, or the serial port.
        place: String,
        /// What the system says.
        reason: String,
    },
}

/// Bytes that came, and when.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Received {
    /// How many.
    pub bytes: usize,
    /// The host's time at which the line became readable.
    pub at: HostInstant,
}

/// Sees every chunk of bytes as it comes from a device, with its time of arrival.
pub type Tap = Box<dyn FnMut(&[u8], HostInstant)>;
/// Says whether waiting for a device is to end.
pub type Interrupted = Box<dyn Fn() -> bool>;

enum Transport {
    Tcp(TcpStream),
    Serial(Box<dyn SerialPort>),
    Pty(Pty),
}

/// An open line, read and written with time limits.
pub struct Connection {
    transport: Transport,
    place: String,
    ninth_bit: Option<NinthBit>,
}

impl Connection {
    /// Opens a device's place: a TCP host with `default_port` unless it names one, or a serial port
    /// at `baud` (8N1, no flow control). A host that does not answer is given up after `timeout`.
    ///
    /// # Errors
    /// [`LinkError::Open`] with the reason.
    pub fn open(
        endpoint: &Endpoint,
        default_port: u16,
        baud: u32,
        timeout: Duration,
    ) -> Result<Connection, LinkError> {
        match endpoint {
            Endpoint::Tcp { host, port } => {
                Connection::tcp(host, port.unwrap_or(default_port), timeout)
            }
            Endpoint::Serial(path) => Connection::serial(&path.to_string_lossy(), baud),
        }
    }

    fn tcp(host: &str, port: u16, timeout: Duration) -> Result<Connection, LinkError> {
        let place = Endpoint::Tcp {
            host: host.to_owned(),
            port: Some(port),
        }
        .to_string();
        let open_error = |error: io::Error| LinkError::Open {
            place: place.clone(),
            reason: plain(&error),
        };
        let addresses = (host, port).to_socket_addrs().map_err(open_error)?;
        let mut last = io::Error::new(io::ErrorKind::NotFound, "the name has no address");
        for address in addresses {
            match TcpStream::connect_timeout(&address, timeout) {
                Ok(stream) => return Connection::from_stream(stream).map_err(open_error),
                Err(error) => last = error,
            }
        }
        Err(open_error(last))
    }

    fn serial(path: &str, baud: u32) -> Result<Connection, LinkError> {
        let port = serialport::new(path, baud)
            .timeout(Duration::from_millis(100))
            .open()
            .map_err(|error| LinkError::Open {
                place: path.to_owned(),
                reason: error.to_string(),
            })?;
        Ok(Connection {
            transport: Transport::Serial(port),
            place: path.to_owned(),
            ninth_bit: None,
        })
    }

    /// Opens a serial port at `baud` for an RS-485 line whose bytes have a ninth bit
    /// ([`Connection::write_addressed`]).
    ///
    /// # Errors
    /// [`LinkError::Open`] with the reason; also where the port cannot send a ninth bit.
    pub fn open_addressed(endpoint: &Endpoint, baud: u32) -> Result<Connection, LinkError> {
        let place = endpoint.to_string();
        let fault = |reason: String| LinkError::Open {
            place: place.clone(),
            reason,
        };
        let Endpoint::Serial(path) = endpoint else {
            return Err(fault("an RS-485 line is a serial port".to_owned()));
        };
        let ninth_bit = NinthBit::open(path).map_err(|error| fault(plain(&error)))?;
        let mut connection = Connection::serial(&path.to_string_lossy(), baud)?;
        if !ninth_bit.set(false).map_err(|error| fault(plain(&error)))? {
            let reason = "this port cannot send a ninth bit (mark and space parity), which \
                          addresses on RS-485 need; use one whose driver can, or RS-232";
            return Err(fault(reason.to_owned()));
        }
        connection.ninth_bit = Some(ninth_bit);
        Ok(connection)
    }

    /// Writes `first` with its ninth bit set and `rest` without, on a line opened by
    /// [`Connection::open_addressed`].
    pub fn write_addressed(
        &mut self,
        first: u8,
        rest: &[u8],
        timeout: Duration,
    ) -> Result<(), LinkError> {
        self.mark(true)?;
        self.write_all(&[first], timeout)?;
        self.mark(false)?;
        self.write_all(rest, timeout)
    }

    fn mark(&self, mark: bool) -> Result<(), LinkError> {
        let set = match &self.ninth_bit {
            Some(ninth_bit) => ninth_bit.set(mark).map_err(|error| self.fault(error))?,
            None => false,
        };
        if set {
            return Ok(());
        }
        Err(LinkError::Io {
            place: self.place.clone(),
            reason: "the line has no ninth bit".to_owned(),
        })
    }

    /// A line over an accepted or connected socket.
    pub fn from_stream(stream: TcpStream) -> io::Result<Connection> {
        stream.set_nodelay(true)?;
        stream.set_nonblocking(true)?;
        let keepalive = socket2::TcpKeepalive::new()
            .with_time(Duration::from_secs(5))
            .with_interval(Duration::from_secs(1));
        socket2::SockRef::from(&stream).set_tcp_keepalive(&keepalive)?;
        let place = stream.peer_addr()?.to_string();
        Ok(Connection {
            transport: Transport::Tcp(stream),
            place,
            ninth_bit: None,
        })
    }

    /// The device's end of a pseudo terminal.
    pub fn from_pty(pty: Pty) -> Connection {
        Connection {
            place: pty.path().display().to_string(),
            transport: Transport::Pty(pty),
            ninth_bit: None,
        }
    }

    /// The speed that whoever has the other end of a pseudo terminal has set; none for other lines.
    pub fn peer_baud(&self) -> Option<u32> {
        match &self.transport {
            Transport::Pty(pty) => pty.baud(),
            _ => None,
        }
    }

    /// Host and port, or the serial port, for messages.
    pub fn place(&self) -> &str {
        &self.place
    }

    /// Whether this is a socket.
    pub fn is_tcp(&self) -> bool {
        matches!(self.transport, Transport::Tcp(_))
    }

    /// This host's and the other side's address of a socket.
    pub fn addresses(&self) -> Option<(SocketAddr, SocketAddr)> {
        match &self.transport {
            Transport::Tcp(stream) => Some((stream.local_addr().ok()?, stream.peer_addr().ok()?)),
            _ => None,
        }
    }

    /// Waits at most `timeout` until there is something to read here or `waiter` is woken; whether
    /// there is something to read, the line's end included. A serial port is not waited for.
    ///
    /// # Errors
    /// [`LinkError::Io`] where the host itself fails.
    pub fn wait(&self, waiter: &Waiter, timeout: Duration) -> Result<bool, LinkError> {
        let timeout = timespec(timeout);
        let woken = PollFd::from_borrowed_fd(waiter.as_waitable(), PollFlags::IN);
        let line = self.waitable();
        // In place of a serial port the waiter stands a second time, waiting for nothing.
        let line = line.map_or_else(
            || PollFd::from_borrowed_fd(waiter.as_waitable(), PollFlags::empty()),
            |line| PollFd::from_borrowed_fd(line, PollFlags::IN),
        );
        let mut waited = [woken, line];
        match poll(&mut waited, Some(&timeout)) {
            Ok(_) => {}
            Err(Errno::INTR) => return Ok(false),
            Err(error) => return Err(self.fault(error.into())),
        }
        if !waited[0].revents().is_empty() {
            waiter.taken();
        }
        Ok(!waited[1].revents().is_empty())
    }

    /// Changes the speed of a serial port; no effect on anything else.
    pub fn set_baud(&mut self, baud: u32) -> Result<(), LinkError> {
        if let Transport::Serial(port) = &mut self.transport {
            let fault = |error: serialport::Error| LinkError::Io {
                place: self.place.clone(),
                reason: error.to_string(),
            };
            port.set_baud_rate(baud).map_err(fault)?;
        }
        Ok(())
    }

    /// Ends a socket in both directions.
    pub fn shut_down(&self) {
        if let Transport::Tcp(stream) = &self.transport {
            // One that is down already needs no shutting.
            let _ = stream.shutdown(Shutdown::Both);
        }
    }

    /// Breaks a socket off: the other side reads an error, and what was not yet sent is lost.
    pub fn reset(self) {
        if let Transport::Tcp(stream) = &self.transport {
            // Without it the end is an ordinary one.
            let _ = socket2::SockRef::from(stream).set_linger(Some(Duration::ZERO));
        }
    }

    /// Ends a socket in order: what was sent still arrives, and so does the end. What the other
    /// side has sent and nobody read is thrown away, as it would turn the end into a reset.
    pub(super) fn end(self) {
        if let Transport::Tcp(stream) = &self.transport {
            // One that is down already needs no shutting.
            let _ = stream.shutdown(Shutdown::Write);
            let mut unread = [0; 4096];
            while matches!((&*stream).read(&mut unread), Ok(1..)) {}
        }
    }

    /// What to wait on; none for a serial port.
    pub(super) fn waitable(&self) -> Option<BorrowedFd<'_>> {
        match &self.transport {
            Transport::Tcp(stream) => Some(stream.as_fd()),
            Transport::Pty(pty) => Some(pty.as_fd()),
            Transport::Serial(_) => None,
        }
    }

    /// Writes as much of `bytes` as is taken at once; how much it was.
    ///
    /// # Errors
    /// [`LinkError::Closed`] once the other side has gone.
    pub fn write_some(&mut self, bytes: &[u8]) -> Result<usize, LinkError> {
        match self.write_now(bytes) {
            Err(error) if is_not_now(&error) => Ok(0),
            written => written.map_err(|error| self.fault(error)),
        }
    }

    fn write_now(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match &mut self.transport {
            Transport::Serial(port) => port.write(bytes),
            Transport::Tcp(stream) => (&*stream).write(bytes),
            Transport::Pty(pty) => pty.write(bytes),
        }
    }

    /// Reads what there is into `buffer`, waiting for it at most `timeout`; none where nothing came.
    ///
    /// # Errors
    /// [`LinkError::Closed`] once the other side has gone.
    pub fn read(
        &mut self,
        buffer: &mut [u8],
        timeout: Duration,
    ) -> Result<Option<Received>, LinkError> {
        let due = Instant::now() + timeout;
        loop {
            let left = due.saturating_duration_since(Instant::now());
            let (result, at) = match &mut self.transport {
                Transport::Serial(port) => {
                    // A time-out of 0 waits for ever.
                    let wait = left.max(Duration::from_millis(1));
                    let result = port
                        .set_timeout(wait)
                        .map_err(io::Error::from)
                        .and_then(|()| port.read(buffer));
                    (result, HostInstant::now())
                }
                Transport::Tcp(stream) => {
                    // A socket says by itself that there is nothing, without being asked before.
                    let waits = !left.is_zero();
                    if waits && !ready(stream, PollFlags::IN, left).map_err(|e| self.fault(e))? {
                        return Ok(None);
                    }
                    let at = HostInstant::now();
                    (stream_read(&self.transport, buffer), at)
                }
                Transport::Pty(pty) => {
                    if !ready(&*pty, PollFlags::IN, left).map_err(|e| self.fault(e))? {
                        return Ok(None);
                    }
                    let at = HostInstant::now();
                    (stream_read(&self.transport, buffer), at)
                }
            };
            match result {
                Ok(0) => return Err(self.closed()),
                Ok(bytes) => return Ok(Some(Received { bytes, at })),
                Err(error) => match error.kind() {
                    io::ErrorKind::TimedOut | io::ErrorKind::WouldBlock => {
                        if Instant::now() >= due {
                            return Ok(None);
                        }
                    }
                    io::ErrorKind::Interrupted => {
                        // A signal is the caller's business.
                        return Ok(None);
                    }
                    _ => return Err(self.fault(error)),
                },
            }
        }
    }

    /// Writes all of `bytes`, waiting for room at most `timeout`.
    pub fn write_all(&mut self, bytes: &[u8], timeout: Duration) -> Result<(), LinkError> {
        let due = Instant::now() + timeout;
        if let Transport::Serial(port) = &mut self.transport {
            let set = port.set_timeout(timeout.max(Duration::from_millis(1)));
            set.map_err(|error| self.fault(error.into()))?;
        }
        let mut rest = bytes;
        while !rest.is_empty() {
            match self.write_now(rest) {
                Ok(0) => return Err(self.closed()),
                Ok(count) => rest = rest.get(count..).unwrap_or_default(),
                Err(error) if is_not_now(&error) => self.wait_for_room(due, timeout)?,
                Err(error) => return Err(self.fault(error)),
            }
        }
        Ok(())
    }

    /// Waits until more can be written; `waited` is how long that may take in all, for the message.
    fn wait_for_room(&self, due: Instant, waited: Duration) -> Result<(), LinkError> {
        loop {
            let left = due.saturating_duration_since(Instant::now());
            let room = match self.waitable() {
                Some(line) => ready(line, PollFlags::OUT, left).map_err(|e| self.fault(e))?,
                // A serial port waits by itself while it writes.
                None => !left.is_zero(),
            };
            if room {
                return Ok(());
            }
            // A signal ends a wait early.
            if left.is_zero() {
                return Err(LinkError::Stuck {
                    place: self.place.clone(),
                    waited_s: waited.as_secs_f64(),
                });
            }
        }
    }

    fn closed(&self) -> LinkError {
        LinkError::Closed {
            place: self.place.clone(),
        }
    }

    fn fault(&self, error: io::Error) -> LinkError {
        use io::ErrorKind as Kind;
        match error.kind() {
            Kind::BrokenPipe
            | Kind::ConnectionReset
            | Kind::ConnectionAborted
            | Kind::NotConnected
            | Kind::UnexpectedEof => self.closed(),
            // The other end of a pseudo terminal, or an adapter, is gone.
            _ if is_unplugged(&error) => self.closed(),
            _ => LinkError::Io {
                place: self.place.clone(),
                reason: plain(&error),
            },
        }
    }
}

fn stream_read(transport: &Transport, buffer: &mut [u8]) -> io::Result<usize> {
    match transport {
        Transport::Tcp(stream) => (&*stream).read(buffer),
        Transport::Pty(pty) => pty.read(buffer),
        Transport::Serial(_) => Err(io::ErrorKind::Unsupported.into()),
    }
}

/// Whether an error only says that nothing can be done at this moment.
fn is_not_now(error: &io::Error) -> bool {
    use io::ErrorKind as Kind;
    matches!(
        error.kind(),
        Kind::WouldBlock | Kind::TimedOut | Kind::Interrupted
    )
}

/// Waits until a line can be read or written, to the nanosecond: a socket's own read time-out is
/// rounded to the kernel's ticks. An error or a hang-up counts as ready; reading then says which.
pub(super) fn ready(line: impl AsFd, what: PollFlags, timeout: Duration) -> io::Result<bool> {
    let timeout = timespec(timeout);
    let mut lines = [PollFd::new(&line, what)];
    match poll(&mut lines, Some(&timeout)) {
        Ok(count) => Ok(count > 0),
        Err(Errno::INTR) => Ok(false),
        Err(error) => Err(error.into()),
    }
}

/// A span as the system takes it, at most as long as it can say.
pub(super) fn timespec(span: Duration) -> Timespec {
    Timespec::try_from(span).unwrap_or(Timespec {
        tv_sec: i64::MAX,
        tv_nsec: 0,
    })
}

/// What went wrong, without the system's number for it.
pub(super) fn plain(error: &io::Error) -> String {
    let text = error.to_string();
    text.split(" (os error")
        .next()
        .unwrap_or_default()
        .to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::TcpListener;

    const WAIT: Duration = Duration::from_secs(5);

    fn exchange(mut here: Connection, mut there: Connection) {
        let mut buffer = [0; 600];
        assert_eq!(
            here.read(&mut buffer, Duration::from_millis(5)).unwrap(),
            None
        );
        let all: Vec<u8> = (0..=255).collect();
        there.write_all(&all, WAIT).unwrap();
        let mut got = Vec::new();
        while got.len() < all.len() {
            let received = here.read(&mut buffer, WAIT).unwrap().unwrap();
            assert!(received.at.raw_ns <= HostInstant::now().raw_ns);
            got.extend_from_slice(&buffer[..received.bytes]);
        }
        assert_eq!(got, all);
        drop(there);
        assert!(matches!(
            here.read(&mut buffer, WAIT),
            Err(LinkError::Closed { .. })
        ));
    }

    #[test]
    fn sockets_carry_bytes_and_tell_the_end() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let endpoint: Endpoint = address.to_string().parse().unwrap();
        let here = Connection::open(&endpoint, 1, 0, WAIT).unwrap();
        let there = Connection::from_stream(listener.accept().unwrap().0).unwrap();
        exchange(here, there);
        drop(listener);
        let error = Connection::open(&endpoint, 1, 0, WAIT).err().unwrap();
        assert_eq!(error.to_string(), format!("{address}: Connection refused"));
    }

    #[test]
    fn ptys_carry_every_byte_and_tell_the_end() {
        let pty = Pty::open().unwrap();
        let endpoint = Endpoint::Serial(pty.path().to_owned());
        let there = Connection::from_pty(pty);
        let here = Connection::open(&endpoint, 0, 115_200, WAIT).unwrap();
        exchange(here, there);
    }

    #[test]
    fn a_port_without_a_ninth_bit_is_refused() {
        // The kernel drops the parity of pseudo terminals.
        let pty = Pty::open().unwrap();
        let endpoint = Endpoint::Serial(pty.path().to_owned());
        let error = Connection::open_addressed(&endpoint, 38_400).err().unwrap();
        assert!(error.to_string().contains("ninth bit"), "{error}");
        let mut plain = Connection::open(&endpoint, 0, 38_400, WAIT).unwrap();
        assert!(plain.write_addressed(1, &[2], WAIT).is_err());
    }

    #[test]
    fn who_reads_nothing_does_not_hold_the_writer_for_ever() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let endpoint: Endpoint = listener.local_addr().unwrap().to_string().parse().unwrap();
        let mut here = Connection::open(&endpoint, 1, 0, WAIT).unwrap();
        let _there = listener.accept().unwrap();
        let much = vec![0; 64 << 20];
        let error = here.write_all(&much, Duration::from_millis(50));
        assert!(matches!(error, Err(LinkError::Stuck { .. })));
    }
}
