//! What a line and a clock need of a system that is no Unix: there are no pseudo terminals and no
//! ninth bit, and asking for one says so.

use std::io;
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::os::windows::io::{AsSocket, BorrowedSocket};
use std::path::Path;
use std::sync::LazyLock;
use std::time::{Instant, SystemTime, UNIX_EPOCH};

/// A pseudo terminal, of which this system has none.
#[derive(Debug)]
pub enum Pty {}

impl Pty {
    /// There is none to be had.
    ///
    /// # Errors
    /// [`io::ErrorKind::Unsupported`], always.
    pub fn open_as(_link: &Path) -> io::Result<Pty> {
        Err(missing(
            "this system has no pseudo terminals; serve on a TCP address, or use a Unix system",
        ))
    }

    /// The speed that the other end is set to.
    pub fn baud(&self) -> Option<u32> {
        match *self {}
    }

    /// What to open at the other end.
    pub fn path(&self) -> &Path {
        match *self {}
    }

    pub(super) fn read(&self, _buffer: &mut [u8]) -> io::Result<usize> {
        match *self {}
    }

    pub(super) fn write(&self, _bytes: &[u8]) -> io::Result<usize> {
        match *self {}
    }
}

impl AsSocket for Pty {
    fn as_socket(&self) -> BorrowedSocket<'_> {
        match *self {}
    }
}

/// The ninth bit of an RS-485 line, which no port of this system sends.
#[derive(Debug)]
pub(super) enum NinthBit {}

impl NinthBit {
    pub(super) fn open(_path: &Path) -> io::Result<NinthBit> {
        Err(missing(
            "the ninth bit that addresses on RS-485 need is sent on Linux only; use RS-232",
        ))
    }

    pub(super) fn set(&self, _mark: bool) -> io::Result<bool> {
        match *self {}
    }
}

fn missing(text: &str) -> io::Error {
    io::Error::new(io::ErrorKind::Unsupported, text)
}

/// One end of [`socket_pair`].
pub(super) type Socket = TcpStream;

/// Two sockets of this process that are each other's other end, over the loopback.
pub(super) fn socket_pair() -> io::Result<(Socket, Socket)> {
    let door = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?;
    let here = TcpStream::connect(door.local_addr()?)?;
    here.set_nodelay(true)?;
    let own = here.local_addr()?;
    loop {
        // Anybody on this host may knock; ours is the one that comes from our own port. It waits
        // already, as connecting has succeeded.
        let (there, from) = door.accept()?;
        if from == own {
            return Ok((here, there));
        }
    }
}

/// Whether an error says that an adapter is gone. This system has many for that, and none is sure.
pub(super) fn is_unplugged(_error: &io::Error) -> bool {
    false
}

/// Time that runs evenly, ns since this was first asked.
pub(super) fn monotonic_ns() -> i64 {
    static START: LazyLock<Instant> = LazyLock::new(Instant::now);
    i64::try_from(START.elapsed().as_nanos()).unwrap_or(i64::MAX)
}

/// Real time, ns since 1970.
pub(super) fn utc_ns() -> i64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    since.map_or(0, |since| {
        i64::try_from(since.as_nanos()).unwrap_or(i64::MAX)
    })
}
