//! How one thread wakes another that waits for a line.

use super::connection::{LinkError, plain, ready};
use super::system::{Socket, socket_pair};
use rustix::event::PollFlags;
use rustix::fd::{AsFd, BorrowedFd};
use std::io::{self, Read, Write};
use std::time::Duration;

/// The waiting thread's end: see [`Connection::wait`](super::Connection::wait).
#[derive(Debug)]
pub struct Waiter(Socket);

/// The other threads' end.
#[derive(Debug)]
pub struct Waker(Socket);

/// A waker and who it wakes.
///
/// # Errors
/// [`LinkError::Io`] where the system has no more descriptors.
pub fn waker() -> Result<(Waker, Waiter), LinkError> {
    let pair = || -> io::Result<(Waker, Waiter)> {
        let (here, there) = socket_pair()?;
        here.set_nonblocking(true)?;
        there.set_nonblocking(true)?;
        Ok((Waker(here), Waiter(there)))
    };
    pair().map_err(|error| LinkError::Io {
        place: "waking a thread".into(),
        reason: plain(&error),
    })
}

impl Waker {
    /// Ends the other thread's wait, or its next one. Many calls before that count as one.
    pub fn wake(&self) {
        // A full buffer wakes as well as one more byte.
        let _ = (&self.0).write(&[1]);
    }
}

impl Waiter {
    /// Waits until it is woken, at most `timeout`.
    pub fn wait(&self, timeout: Duration) {
        // An interrupted wait is a short one.
        if ready(&self.0, PollFlags::IN, timeout).unwrap_or(false) {
            self.taken();
        }
    }

    /// Forgets the calls so far.
    pub(super) fn taken(&self) {
        let mut bytes = [0; 64];
        while matches!((&self.0).read(&mut bytes), Ok(64)) {}
    }

    pub(super) fn as_waitable(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Instant;

    #[test]
    fn a_call_before_the_wait_counts() {
        let (waker, waiter) = waker().unwrap();
        for _ in 0..1000 {
            waker.wake();
        }
        let start = Instant::now();
        waiter.wait(Duration::from_secs(60));
        assert!(start.elapsed() < Duration::from_secs(30));
        // All of them were one.
        waiter.wait(Duration::from_millis(5));
        let woken = std::thread::spawn(move || waiter.wait(Duration::from_secs(60)));
        waker.wake();
        woken.join().unwrap();
        assert!(start.elapsed() < Duration::from_secs(30));
    }
}
