//! How a program ends: the exit statuses, and which fault has which.
//!
//! | status | meaning |
//! | --- | --- |
//! | 0 | done; also when the consumer of stdout left |
//! | 2 | usage |
//! | 3 | done, but records were lost or skipped |
//! | 4 | a `--fail-if` gate failed |
//! | 65 | bad data |
//! | 66 | no such input |
//! | 69 | device or server not available |
//! | 74 | I/O error, a full disk included |
//! | 78 | bad configuration |
//! | 129, 130, 143 | ended by SIGHUP, SIGINT or SIGTERM before anything had come |
//!
//! A library error says its class with [`Fault`]; [`status`] finds it, or the I/O error that `csv`
//! and `mcap` hide in their own, along the chain of causes.

use crate::frame::ConfigError;
use crate::stream::Outcome;
use std::error::Error;
use std::io;
use std::sync::atomic::{AtomicBool, Ordering};

/// A fault whose class decides the exit status. The text names what (file, line, column) and why.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Fault {
    /// The command line asks for something impossible: 2.
    #[error("{0}")]
    Usage(String),
    /// A record or file that cannot be understood: 65.
    #[error("{0}")]
    BadData(String),
    /// An input that cannot be opened: 66.
    #[error("{0}")]
    NoInput(String),
    /// A device or server that does not answer: 69.
    #[error("{0}")]
    Unavailable(String),
    /// Reading or writing failed: 74.
    #[error("{0}")]
    Io(String),
    /// A configuration that makes no sense: 78.
    #[error("{0}")]
    Configuration(String),
    /// A signal came before any record had: 128 and its number; no message.
    #[error("ended by signal {0} before anything had come")]
    Interrupted(i32),
}

impl Fault {
    /// The exit status of the fault's class.
    pub fn status(&self) -> u8 {
        match self {
            Fault::Usage(_) => 2,
            Fault::BadData(_) => 65,
            Fault::NoInput(_) => 66,
            Fault::Unavailable(_) => 69,
            Fault::Io(_) => 74,
            Fault::Configuration(_) => 78,
            Fault::Interrupted(signal) => 128u8.saturating_add(u8::try_from(*signal).unwrap_or(0)),
        }
    }
}

/// Status for an error that says no class: a fault of the program, not of its surroundings.
const UNCLASSIFIED: u8 = 1;

impl Outcome {
    /// The exit status of a program that ended without an error.
    pub fn status(self) -> u8 {
        match self {
            Outcome::Done => 0,
            Outcome::Degraded => 3,
            Outcome::GateFailed => 4,
        }
    }

    /// The worse of two outcomes.
    #[must_use]
    pub fn and(self, other: Outcome) -> Outcome {
        if self.status() >= other.status() {
            self
        } else {
            other
        }
    }
}

/// The exit status that an error asks for; 0 for a consumer of stdout that left.
pub fn status(error: &anyhow::Error) -> u8 {
    if let Some(fault) = error.downcast_ref::<Fault>() {
        return fault.status();
    }
    for cause in error.chain() {
        if let Some(fault) = cause.downcast_ref::<Fault>() {
            return fault.status();
        }
        match cause.downcast_ref() {
            Some(ConfigError::Read { .. }) => return 66,
            Some(ConfigError::Syntax { .. } | ConfigError::Value { .. }) => return 78,
            None => {}
        }
        if let Some(io) = io_error(cause) {
            return if io.kind() == io::ErrorKind::BrokenPipe {
                0
            } else {
                74
            };
        }
        if cause.is::<csv::Error>() || cause.is::<mcap::McapError>() {
            return 65;
        }
    }
    UNCLASSIFIED
}

/// The I/O error that `error` is or hides.
pub(super) fn io_error<'a>(error: &'a (dyn Error + 'static)) -> Option<&'a io::Error> {
    if let Some(io) = error.downcast_ref::<io::Error>() {
        return Some(io);
    }
    if let Some(csv) = error.downcast_ref::<csv::Error>()
        && let csv::ErrorKind::Io(io) = csv.kind()
    {
        return Some(io);
    }
    if let Some(mcap) = error.downcast_ref::<mcap::McapError>() {
        return mcap.source().and_then(io_error);
    }
    None
}

/// Records were skipped somewhere in this process, on the main stream or in a side input.
static LOST: AtomicBool = AtomicBool::new(false);

/// Notes that records were lost, so that the program cannot end with status 0.
pub(super) fn note_lost() {
    LOST.store(true, Ordering::Relaxed);
}

/// `outcome`, or worse where records were lost.
pub fn with_losses(outcome: Outcome) -> Outcome {
    if LOST.load(Ordering::Relaxed) {
        outcome.and(Outcome::Degraded)
    } else {
        outcome
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyhow::Context;
    use std::path::Path;

    #[test]
    fn every_class_has_its_status() {
        let text = || "x".to_owned();
        for (fault, expected) in [
            (Fault::Usage(text()), 2),
            (Fault::BadData(text()), 65),
            (Fault::NoInput(text()), 66),
            (Fault::Unavailable(text()), 69),
            (Fault::Io(text()), 74),
            (Fault::Configuration(text()), 78),
            (Fault::Interrupted(2), 130),
            (Fault::Interrupted(15), 143),
        ] {
            assert_eq!(status(&fault.clone().into()), expected);
            // As the cause of a context, and as the context of a cause.
            let error = Err::<(), _>(fault.clone()).context("while trying");
            assert_eq!(status(&error.unwrap_err()), expected);
            let error = Err::<(), _>(io::Error::other("cause")).context(fault);
            assert_eq!(status(&error.unwrap_err()), expected);
        }
        assert_eq!(status(&anyhow::anyhow!("no class")), UNCLASSIFIED);
    }

    #[test]
    fn hidden_io_errors_are_found() {
        let io = |kind| io::Error::new(kind, "gone");
        let broken = io::ErrorKind::BrokenPipe;
        let full = io::ErrorKind::StorageFull;
        assert_eq!(status(&io(broken).into()), 0);
        assert_eq!(status(&csv::Error::from(io(broken)).into()), 0);
        assert_eq!(status(&csv::Error::from(io(full)).into()), 74);
        assert_eq!(status(&mcap::McapError::from(io(broken)).into()), 0);
        assert_eq!(status(&mcap::McapError::from(io(full)).into()), 74);
        assert_eq!(status(&mcap::McapError::BadMagic.into()), 65);
    }

    #[test]
    fn a_bad_frame_file_is_bad_configuration() {
        let error = crate::frame::Frame::parse("name = 1", Path::new("f.toml")).unwrap_err();
        assert_eq!(status(&error.into()), 78);
        let error = crate::frame::Frame::read(Path::new("no/such.toml")).unwrap_err();
        assert_eq!(status(&error.into()), 66);
    }

    #[test]
    fn the_worse_outcome_wins() {
        assert_eq!(Outcome::Done.and(Outcome::Degraded), Outcome::Degraded);
        assert_eq!(
            Outcome::GateFailed.and(Outcome::Degraded),
            Outcome::GateFailed
        );
    }
}
