//! What is asked of the unit besides what it streams, and when.

use crate::gx1::{Command, Mode, Session, SessionError};
use std::time::{Duration, Instant};

/// For how long the answer to a poll is awaited before it is asked again.
const ANSWER_WAIT: Duration = Duration::from_millis(500);

/// The shortest wait for bytes between two looks at the clock.
const LEAST_WAIT: Duration = Duration::from_micros(200);

/// Which commands are polled, and which of them are not answered yet.
pub(super) struct Polling {
    mode: Mode,
    /// When all are due again, where they are asked by the clock.
    due: Instant,
    commands: Vec<Polled>,
}

struct Polled {
    command: Command,
    /// Since when its answer is awaited.
    asked: Option<Instant>,
}

impl Polling {
    /// Of these commands all but the streamed one are polled.
    pub(super) fn new(mode: Mode, commands: &[Command]) -> Polling {
        let polled = match mode {
            Mode::Continuous => commands.get(1..).unwrap_or_default(),
            Mode::Polled(_) => commands,
        };
        let waiting = |command: &Command| Polled {
            command: *command,
            asked: None,
        };
        Polling {
            mode,
            due: Instant::now(),
            commands: polled.iter().map(waiting).collect(),
        }
    }

    /// A reply of this command has come.
    pub(super) fn answered(&mut self, command: Command) {
        for polled in &mut self.commands {
            if polled.command == command {
                polled.asked = None;
            }
        }
    }

    /// Asks for what is due: by the clock, or when the streamed reply has just come (`led`).
    pub(super) fn ask(&mut self, session: &mut Session, led: bool) -> Result<(), SessionError> {
        let now = Instant::now();
        match self.mode {
            Mode::Continuous if !led => return Ok(()),
            Mode::Continuous => {}
            Mode::Polled(_) if now < self.due => return Ok(()),
            Mode::Polled(hz) => {
                self.due = (self.due + Duration::from_secs_f64(1.0 / hz)).max(now);
            }
        }
        for polled in &mut self.commands {
            // What has not been answered yet is in the unit's queue.
            let in_queue = |asked: Instant| now.duration_since(asked) <= ANSWER_WAIT;
            if !polled.asked.is_some_and(in_queue) {
                session.send(polled.command, &[])?;
                polled.asked = Some(now);
            }
        }
        Ok(())
    }

    /// For how long to wait for bytes, at most `longest`.
    pub(super) fn wait(&self, longest: Duration) -> Duration {
        match self.mode {
            Mode::Continuous => longest,
            Mode::Polled(_) => {
                let left = self.due.saturating_duration_since(Instant::now());
                left.clamp(LEAST_WAIT, longest)
            }
        }
    }
}
