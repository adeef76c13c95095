//! Whether anybody still reads stdout.

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::io;

/// Whether the reader of stdout has left. A write would tell as well, but a source that has nothing
/// to write would never know.
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
