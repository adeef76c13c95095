//! When a stream ends: a signal, a time limit, a reader that left.

use crate::stream::{Options, Stop};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::cell::Cell;
use std::path::Path;
use std::rc::Rc;
use std::time::{Duration, Instant};

/// The longest sleep between two looks.
const NAP: Duration = Duration::from_millis(20);

/// Everything that ends a stream from outside. It is looked at wherever something is waited for.
pub(super) struct Ending {
    stop: Stop,
    due: Cell<Option<Instant>>,
    to_stdout: bool,
}

impl Ending {
    pub(super) fn new(stop: Stop, options: &Options) -> Rc<Ending> {
        let output = options.output.as_deref();
        Rc::new(Ending {
            stop,
            due: Cell::new(None),
            to_stdout: output.is_none_or(|path| path == Path::new("-")),
        })
    }

    /// Whether the stream is to end now.
    pub(super) fn reached(&self) -> bool {
        self.stop.requested()
            || self.due.get().is_some_and(|due| Instant::now() >= due)
            || (self.to_stdout && reader_left())
    }

    /// Sets the time limit, if it is not set yet.
    pub(super) fn due_in(&self, span: Duration) {
        if self.due.get().is_none() {
            self.due.set(Instant::now().checked_add(span));
        }
    }

    /// Sleeps, unless the end comes first.
    pub(super) fn sleep(&self, span: Duration) {
        let until = Instant::now() + span;
        while !self.reached() {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return;
            }
            std::thread::sleep(left.min(NAP));
        }
    }

    /// The signal's exit status, where one came before any record had.
    pub(super) fn check(&self, records: u64) -> anyhow::Result<()> {
        self.stop.check(records)
    }
}

/// Whether nobody reads stdout any more, which a write would only tell once there is one.
fn reader_left() -> bool {
    let stdout = std::io::stdout();
    let mut polled = [PollFd::new(&stdout, PollFlags::empty())];
    let now = Timespec {
        tv_sec: 0,
        tv_nsec: 0,
    };
    poll(&mut polled, Some(&now)).is_ok()
        && polled
            .iter()
            .any(|fd| fd.revents().contains(PollFlags::ERR))
}
