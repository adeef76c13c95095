//! The line to a scanner of whatever kind: where it goes, who sees its bytes, what ends a wait on it,
//! and how long things may take.

use super::NAME;
use super::live::LineFault;
use crate::link::{Endpoint, Interrupted, Tap};
use crate::stream::{Fault, Options};
use crate::tool::ending::Ending;
use crate::tool::tee::Tee;
use std::cell::RefCell;
use std::rc::Rc;
use std::time::Duration;

/// How long a first connection may take, and one after an outage.
const CONNECT: [Duration; 2] = [Duration::from_secs(3), Duration::from_secs(1)];
/// How long an answer may take, at first and after an outage.
const ANSWER: [Duration; 2] = [Duration::from_secs(2), Duration::from_secs(1)];
/// A line counts as down after so many periods without a scan.
const PERIODS: f64 = 3.0;
/// It never does before this: a busy host and a repeated packet are no outage.
const LEAST_PATIENCE: Duration = Duration::from_millis(500);

/// How long a device may take to say that it sends no more.
pub(super) const FAREWELL: Duration = Duration::from_secs(1);

/// What is kept of the line between connections.
pub(super) struct Line {
    place: Endpoint,
    quiet: bool,
    ending: Rc<Ending>,
    tee: Rc<RefCell<Tee>>,
    answered: bool,
}

impl Line {
    pub(super) fn new(
        place: Endpoint,
        options: &Options,
        ending: &Rc<Ending>,
        tee: &Rc<RefCell<Tee>>,
    ) -> Line {
        Line {
            place,
            quiet: options.quiet,
            ending: Rc::clone(ending),
            tee: Rc::clone(tee),
            answered: false,
        }
    }

    /// Where the device is.
    pub(super) fn place(&self) -> &Endpoint {
        &self.place
    }

    /// What ends the capture from outside.
    pub(super) fn ending(&self) -> &Ending {
        &self.ending
    }

    /// How long the next connection may take.
    pub(super) fn connect_limit(&self) -> Duration {
        CONNECT[usize::from(self.answered)]
    }

    /// How long an answer on it may take.
    pub(super) fn answer_limit(&self) -> Duration {
        ANSWER[usize::from(self.answered)]
    }

    /// What sees the bytes of the next connection, which begins now.
    pub(super) fn tap(&self) -> Tap {
        self.tee.borrow_mut().new_session();
        let tee = Rc::clone(&self.tee);
        Box::new(move |bytes, at| tee.borrow_mut().chunk(bytes, at))
    }

    /// What ends a wait on the next connection.
    pub(super) fn interrupted(&self) -> Interrupted {
        let ending = Rc::clone(&self.ending);
        Box::new(move || ending.reached())
    }

    /// The device has answered, so that the recording may begin; whether that is the first time.
    pub(super) fn note_answer(&mut self) -> Result<bool, LineFault> {
        let first = !std::mem::replace(&mut self.answered, true);
        let opened = self.tee.borrow_mut().open();
        opened.map_err(|error| LineFault::Hopeless(Fault::Io(error.to_string()).into()))?;
        Ok(first)
    }

    /// Whether the device has answered at all, now or before.
    pub(super) fn has_answered(&self) -> bool {
        self.answered
    }

    /// Says something of the device, unless nothing is to be said.
    pub(super) fn remark(&self, text: &str) {
        if !self.quiet {
            eprintln!("{NAME}: {}: {text}", self.place);
        }
    }
}

/// How long a line on which a scan takes `scan_s` may be silent before it counts as down.
pub(super) fn patience(scan_s: f64) -> Duration {
    Duration::from_secs_f64(PERIODS * scan_s).max(LEAST_PATIENCE)
}
