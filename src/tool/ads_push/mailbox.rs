//! Where poses wait between the thread that reads them and the one that writes them: there is room
//! for one.

use crate::link::Waker;
use crate::record::{Pose, Stamp};
use crate::stream::Outcome;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

/// What a reader says at its end.
pub(super) type Ended = anyhow::Result<Outcome>;

/// The place for one pose.
pub(super) struct Mailbox {
    state: Mutex<State>,
    changed: Condvar,
    waker: Waker,
}

#[derive(Default)]
struct State {
    pose: Option<Pose>,
    posted: u64,
    /// Poses that a newer one replaced before they were taken.
    passed_over: u64,
    /// Poses of which it is known what became of them, and when the last one was acknowledged.
    settled: u64,
    acknowledged: Option<Stamp>,
    /// Nobody takes poses any more.
    closed: bool,
    ended: Option<Ended>,
}

impl Mailbox {
    pub(super) fn new(waker: Waker) -> Mailbox {
        Mailbox {
            state: Mutex::default(),
            changed: Condvar::new(),
            waker,
        }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn until(&self, mut done: impl FnMut(&State) -> bool) -> MutexGuard<'_, State> {
        let waiting = |state: &mut State| !state.closed && !done(state);
        let guard = self.changed.wait_while(self.lock(), waiting);
        guard.unwrap_or_else(PoisonError::into_inner)
    }

    /// Puts a pose there, in place of one that still waits. False once nobody takes any.
    pub(super) fn post(&self, pose: &Pose) -> bool {
        let mut state = self.lock();
        if state.pose.replace(pose.clone()).is_some() {
            state.passed_over += 1;
        }
        state.posted += 1;
        let open = !state.closed;
        drop(state);
        self.waker.wake();
        open
    }

    /// Puts a pose there once there is room. False once nobody takes any.
    pub(super) fn post_in_turn(&self, pose: &Pose) -> bool {
        drop(self.until(|state| state.pose.is_none()));
        self.post(pose)
    }

    /// Puts a pose there and waits for what becomes of it: when it was acknowledged, or none.
    pub(super) fn post_and_wait(&self, pose: &Pose) -> Option<Stamp> {
        let number = {
            let state = self.until(|state| state.pose.is_none());
            state.posted + 1
        };
        self.post(pose);
        let state = self.until(|state| state.settled >= number);
        state.acknowledged.filter(|_| state.settled >= number)
    }

    /// The pose that waits.
    pub(super) fn take(&self) -> Option<Pose> {
        let pose = self.lock().pose.take();
        if pose.is_some() {
            self.changed.notify_all();
        }
        pose
    }

    /// Says what became of everything posted so far.
    pub(super) fn settle(&self, acknowledged: Option<Stamp>) {
        let mut state = self.lock();
        state.settled = state.posted - u64::from(state.pose.is_some());
        state.acknowledged = acknowledged;
        drop(state);
        self.changed.notify_all();
    }

    /// How many poses a newer one replaced.
    pub(super) fn passed_over(&self) -> u64 {
        self.lock().passed_over
    }

    /// The end of the reader.
    pub(super) fn end(&self, ended: Ended) {
        self.lock().ended = Some(ended);
        self.waker.wake();
    }

    /// What the reader said at its end; none while it reads, or while a pose still waits.
    pub(super) fn ended(&self) -> Option<Ended> {
        let mut state = self.lock();
        if state.pose.is_some() {
            return None;
        }
        state.ended.take()
    }

    /// Nobody takes poses any more.
    pub(super) fn close(&self) {
        self.lock().closed = true;
        self.changed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::waker;
    use std::sync::Arc;

    fn numbered(seq: u32) -> Pose {
        Pose {
            seq,
            ..Pose::default()
        }
    }

    #[test]
    fn the_newest_pose_waits() {
        let (waker, _waiter) = waker().unwrap();
        let mailbox = Mailbox::new(waker);
        assert!(mailbox.take().is_none());
        for seq in 0..5 {
            assert!(mailbox.post(&numbered(seq)));
        }
        mailbox.end(Ok(Outcome::Done));
        assert!(mailbox.ended().is_none());
        assert_eq!(mailbox.take().unwrap().seq, 4);
        assert_eq!(mailbox.passed_over(), 4);
        assert!(mailbox.ended().is_some());
        mailbox.close();
        assert!(!mailbox.post(&numbered(9)));
    }

    #[test]
    fn poses_in_turn_are_all_taken() {
        let (waker, waiter) = waker().unwrap();
        let mailbox = Arc::new(Mailbox::new(waker));
        let other = Arc::clone(&mailbox);
        let poster = std::thread::spawn(move || {
            for seq in 0..200 {
                assert!(other.post_in_turn(&numbered(seq)));
            }
            let stamp = other.post_and_wait(&numbered(200));
            other.end(Ok(Outcome::Done));
            stamp
        });
        let mut next = 0;
        loop {
            if let Some(pose) = mailbox.take() {
                assert_eq!(pose.seq, next);
                next += 1;
                mailbox.settle(Some(Stamp::from_ns(i64::from(pose.seq))));
            } else if mailbox.ended().is_some() {
                break;
            } else {
                waiter.wait(std::time::Duration::from_secs(1));
            }
        }
        assert_eq!((next, mailbox.passed_over()), (201, 0));
        assert_eq!(poster.join().unwrap(), Some(Stamp::from_ns(200)));
    }
}
