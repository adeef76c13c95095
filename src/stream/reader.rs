//! Whether anybody still reads stdout.

#[cfg(unix)]
use rustix::event::{PollFd, PollFlags, Timespec, poll};
#[cfg(unix)]
use std::io;

/// Whether the reader of stdout has left. A write would tell as well, but a source that has nothing
/// to write would never know.
#[cfg(unix)]
pub fn reader_left() -> bool {
    let stdout = io::stdout();
    let mut wanted = [PollFd::new(&stdout, PollFlags::empty())];
    let now = Timespec {
        tv_sec: 0,
        tv_nsec: 0,
    };
    let gone = PollFlags::ERR | PollFlags::HUP | PollFlags::NVAL;
    poll(&mut wanted, Some(&now)).is_ok_and(|count| count > 0)
        && wanted
            .first()
            .is_some_and(|stdout| stdout.revents().intersects(gone))
}

/// Only a write tells on this system.
#[cfg(not(unix))]
pub fn reader_left() -> bool {
    false
}

/// Writes to a pipe wait as long as its reader makes them on this system.
#[cfg(not(unix))]
pub(crate) fn leave_stuck_writes(_stop: &super::Stop) {}
