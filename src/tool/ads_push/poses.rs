//! The thread that reads poses from stdin, hands them to the push and passes them on.

use super::mailbox::Mailbox;
use crate::record::Pose;
use crate::stream::{self, Emit, Options, Outcome, Stage};
use std::sync::Arc;
use std::thread;

/// How poses are handed over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Handing {
    /// The newest one waits.
    Newest,
    /// Every one waits for its turn.
    Every,
    /// Every one waits until it is acknowledged, and says when that was.
    Stamped,
}

/// Starts the thread. It says its end to the mailbox.
pub(super) fn read(options: Options, handing: Handing, mailbox: &Arc<Mailbox>) {
    let mailbox = Arc::clone(mailbox);
    // It is never waited for: reading stdin may take for ever.
    thread::spawn(move || {
        let ended = if handing != Handing::Stamped && stream::passes_unchanged(&options) {
            let each = |pose: &Pose| {
                hand(&mailbox, handing, pose);
                Ok(())
            };
            stream::pass_unchanged(&options, each).map(|_| Outcome::Done)
        } else {
            let mut pushing = Pushing {
                mailbox: &mailbox,
                handing,
            };
            stream::filter(&options, None, &mut pushing)
        };
        mailbox.end(ended);
    });
}

/// Once nobody takes poses any more they are only passed on.
fn hand(mailbox: &Mailbox, handing: Handing, pose: &Pose) {
    match handing {
        Handing::Newest => mailbox.post(pose),
        Handing::Every | Handing::Stamped => mailbox.post_in_turn(pose),
    };
}

/// Where the stream is written anew: another encoding, a window of time, a further column.
struct Pushing<'a> {
    mailbox: &'a Mailbox,
    handing: Handing,
}

impl Stage for Pushing<'_> {
    type In = Pose;
    type Out = Pose;

    fn push(&mut self, pose: &Pose, emit: &mut Emit<'_, Pose>) -> anyhow::Result<()> {
        if self.handing == Handing::Stamped {
            let pushed = self.mailbox.post_and_wait(pose);
            // The column is there even if the first pose was not acknowledged.
            emit.columns_like(&Pose {
                pushed: Some(pose.stamp),
                ..pose.clone()
            })?;
            return emit.write(&Pose {
                pushed,
                ..pose.clone()
            });
        }
        hand(self.mailbox, self.handing, pose);
        emit.write(pose)
    }

    fn finish(&mut self, _: &mut Emit<'_, Pose>) -> anyhow::Result<Outcome> {
        Ok(Outcome::Done)
    }
}
