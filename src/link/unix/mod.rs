//! What a line and a clock need of a Unix system; `elsewhere` is what other systems have instead.

mod ninth_bit;
mod pty;

pub(super) use ninth_bit::NinthBit;
pub use pty::Pty;

use rustix::io::Errno;
use rustix::time::{ClockId, Timespec, clock_gettime};
use std::io;
use std::os::unix::net::UnixStream;

/// One end of [`socket_pair`].
pub(super) type Socket = UnixStream;

/// Two sockets of this process that are each other's other end.
pub(super) fn socket_pair() -> io::Result<(Socket, Socket)> {
    UnixStream::pair()
}

/// Whether an error says that the other end of a pseudo terminal, or an adapter, is gone.
pub(super) fn is_unplugged(error: &io::Error) -> bool {
    error.raw_os_error() == Some(Errno::IO.raw_os_error())
}

/// `CLOCK_MONOTONIC_RAW`, ns.
pub(super) fn monotonic_ns() -> i64 {
    nanoseconds(clock_gettime(ClockId::MonotonicRaw))
}

/// `CLOCK_REALTIME`, ns.
pub(super) fn utc_ns() -> i64 {
    nanoseconds(clock_gettime(ClockId::Realtime))
}

fn nanoseconds(time: Timespec) -> i64 {
    time.tv_sec * 1_000_000_000 + time.tv_nsec
}
