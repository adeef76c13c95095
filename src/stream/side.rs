//! A side input: a second stream that is looked up by time.

use super::check::StreamRecord;
use super::exit::Fault;
use super::flow;
use super::input::Input;
use super::{Options, Role, Window};
use crate::record::{Stamp, TrajectoryPoint};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread;
use std::time::{Duration, Instant};

/// How many records of a live input are read before they are asked for.
const READ_AHEAD: usize = 16;

/// IMU samples, a motion or a trajectory beside the main stream: a file or a FIFO, in either
/// encoding, read as far ahead as the main stream's time needs.
pub struct SideInput<R: StreamRecord> {
    feed: Feed<R>,
    before: Option<R>,
    after: Option<R>,
    ended: bool,
}

enum Feed<R: StreamRecord> {
    /// A regular file never keeps a reader waiting.
    File(Box<Input<R>>),
    /// Anything else is read by a thread of its own, which may wait forever.
    Live(Receiver<anyhow::Result<R>>),
}

impl<R: StreamRecord> SideInput<R> {
    /// Opens a file or FIFO. The writer of a FIFO is not waited for.
    pub fn open(path: &Path, options: &Options) -> anyhow::Result<SideInput<R>> {
        let whole = |path: &Path, options: &Options| {
            let options = Options {
                window: Window::default(),
                ..options.clone()
            };
            Input::open(Some(path), &options)
        };
        SideInput::open_with(path, options, whole)
    }

    fn open_with(
        path: &Path,
        options: &Options,
        open: fn(&Path, &Options) -> anyhow::Result<Input<R>>,
    ) -> anyhow::Result<SideInput<R>> {
        let options = Options {
            quiet: true,
            ..options.clone()
        };
        let found = if path == Path::new("-") {
            None
        } else {
            let found = fs::metadata(path).map_err(|error| {
                let name = path.display().to_string();
                Fault::NoInput(flow::named(&name, error).to_string())
            })?;
            Some(found)
        };
        let feed = if found.is_some_and(|found| found.is_file()) {
            Feed::File(Box::new(open(path, &options)?))
        } else {
            let (sender, receiver) = sync_channel(READ_AHEAD);
            let path = path.to_owned();
            thread::spawn(move || read_live(path, options, open, &sender));
            Feed::Live(receiver)
        };
        Ok(SideInput {
            feed,
            before: None,
            after: None,
            ended: false,
        })
    }

    /// The last record at or before `stamp` and the first one after it. `stamp` must not go back
    /// from call to call. For a live input that has not got that far, waits at most `wait`.
    pub fn around(
        &mut self,
        stamp: Stamp,
        wait: Duration,
    ) -> anyhow::Result<(Option<&R>, Option<&R>)> {
        let deadline = Instant::now().checked_add(wait);
        loop {
            if let Some(after) = &self.after {
                if after.stamp() > stamp {
                    break;
                }
                self.before = self.after.take();
            }
            if self.ended {
                break;
            }
            match self.next(deadline)? {
                Next::Record(record) => self.after = Some(record),
                Next::End => self.ended = true,
                Next::NotYet => break,
            }
        }
        let before = self.before.as_ref().filter(|r| r.stamp() <= stamp);
        Ok((before, self.after.as_ref()))
    }

    /// The records one after the other, as far as `until` needs: all up to it and the first one
    /// after it. None where that one has been given, where the input has ended, and where a live
    /// input has nothing before `deadline`. For a user that keeps a stretch of the records, in
    /// place of [`SideInput::around`].
    pub fn next_until(
        &mut self,
        until: Stamp,
        deadline: Option<Instant>,
    ) -> anyhow::Result<Option<R>> {
        if self.ended || self.after.as_ref().is_some_and(|r| r.stamp() > until) {
            return Ok(None);
        }
        match self.next(deadline)? {
            Next::Record(record) => {
                self.after = Some(record.clone());
                Ok(Some(record))
            }
            Next::End => {
                self.ended = true;
                Ok(None)
            }
            Next::NotYet => Ok(None),
        }
    }

    fn next(&mut self, deadline: Option<Instant>) -> anyhow::Result<Next<R>> {
        match &mut self.feed {
            Feed::File(input) => Ok(input
                .next()?
                .map_or(Next::End, |record| Next::Record(R::clone(record)))),
            Feed::Live(receiver) => {
                if let Ok(record) = receiver.try_recv() {
                    return record.map(Next::Record);
                }
                flow::before_wait()?;
                let left = deadline.map_or(Duration::MAX, |deadline| {
                    deadline.saturating_duration_since(Instant::now())
                });
                match receiver.recv_timeout(left) {
                    Ok(record) => record.map(Next::Record),
                    Err(RecvTimeoutError::Timeout) => Ok(Next::NotYet),
                    Err(RecvTimeoutError::Disconnected) => Ok(Next::End),
                }
            }
        }
    }
}

impl SideInput<TrajectoryPoint> {
    /// Opens a trajectory: in MCAP, `role` says which of the two.
    pub fn open_trajectory(
        path: &Path,
        role: Role,
        options: &Options,
    ) -> anyhow::Result<SideInput<TrajectoryPoint>> {
        let open: fn(&Path, &Options) -> _ = match role {
            Role::Truth => |path, options| Input::open_trajectory(Some(path), Role::Truth, options),
            Role::Desired => {
                |path, options| Input::open_trajectory(Some(path), Role::Desired, options)
            }
        };
        SideInput::open_with(path, options, open)
    }
}

enum Next<R> {
    Record(R),
    End,
    NotYet,
}

/// The reading thread's life: until the end of the input, a fault, or nobody listens any more.
fn read_live<R: StreamRecord>(
    path: PathBuf,
    options: Options,
    open: fn(&Path, &Options) -> anyhow::Result<Input<R>>,
    sender: &SyncSender<anyhow::Result<R>>,
) {
    let read = || {
        let mut input = open(&path, &options)?;
        while let Some(record) = input.next()? {
            if sender.send(Ok(R::clone(record))).is_err() {
                break;
            }
        }
        Ok(())
    };
    if let Err(error) = read() {
        // Nobody listens any more: then nobody needs to know.
        let _ = sender.send(Err(error));
    }
}

#[cfg(test)]
#[path = "side_tests.rs"]
mod tests;
