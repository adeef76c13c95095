//! When a capture ends: a signal, a time limit, a reader that left.

use crate::stream::{Options, Stop, leave_stuck_writes, reader_left};
use std::cell::Cell;
use std::path::Path;
use std::rc::Rc;
use std::time::{Duration, Instant};

/// The longest sleep between two looks.
const NAP: Duration = Duration::from_millis(50);

/// Everything that ends a capture from outside. It is looked at wherever something is waited for.
pub(super) struct Ending {
    stop: Stop,
    due: Cell<Option<Instant>>,
    to_stdout: bool,
    /// From then on nothing ends a wait but its own limit: the device is being told to stop.
    over: Cell<bool>,
}

impl Ending {
    pub(super) fn new(stop: Stop, options: &Options) -> Rc<Ending> {
        leave_stuck_writes(&stop);
        let output = options.output.as_deref();
        Rc::new(Ending {
            stop,
            due: Cell::new(None),
            to_stdout: output.is_none_or(|path| path == Path::new("-")),
            over: Cell::new(false),
        })
    }

    /// Whether the capture is to end now.
    pub(super) fn reached(&self) -> bool {
        !self.over.get()
            && (self.stop.requested()
                || self.due.get().is_some_and(|due| Instant::now() >= due)
                || self.reader_left())
    }

    /// Whether nobody reads stdout any more.
    pub(super) fn reader_left(&self) -> bool {
        self.to_stdout && reader_left()
    }

    /// Sets the time limit, if it is not set yet.
    pub(super) fn due_in(&self, span: Duration) {
        if self.due.get().is_none() {
            self.due.set(Instant::now().checked_add(span));
        }
    }

    /// `wait`, or what is left until the time limit.
    pub(super) fn shortened(&self, wait: Duration) -> Duration {
        match self.due.get() {
            Some(due) => wait.min(due.saturating_duration_since(Instant::now())),
            None => wait,
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
            std::thread::sleep(self.shortened(left.min(NAP)));
        }
    }

    /// Lets what comes now, the farewell to the device, have its time.
    pub(super) fn set_over(&self) {
        self.over.set(true);
    }

    /// The signal's exit status, where one came before any record had.
    pub(super) fn check(&self, records: u64) -> anyhow::Result<()> {
        self.stop.check(records)
    }
}
