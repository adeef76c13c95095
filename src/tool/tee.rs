//! The raw bytes of a live capture, kept on the side.

use crate::link::{HostInstant, Recorder, RecordingError, Rotation};
use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::rc::Rc;

/// What is kept in memory before the recording is opened, bytes: the answers to the first requests.
const MOST_EARLY: usize = 1 << 20;

/// A recording that is opened once the device has answered, so that a failed start leaves an older
/// one of that name alone.
///
/// The newest chunk is held back until the next one comes, so that a capture that ends in the middle
/// of it can cut the recording there: a replay then gives the records of the capture, no more.
pub(super) struct Tee {
    /// The tool, for messages.
    tool: &'static str,
    path: Option<PathBuf>,
    rotation: Rotation,
    recorder: Option<Recorder>,
    /// Chunks that came before the recording was opened, the newest chunk being the last.
    held: Vec<(Vec<u8>, HostInstant)>,
    /// Buffers to use again.
    spare: Vec<Vec<u8>>,
    /// Where in this connection's stream the newest chunk begins.
    begin: u64,
    error: Option<RecordingError>,
}

impl Tee {
    pub(super) fn new(
        tool: &'static str,
        path: Option<&Path>,
        rotation: Rotation,
    ) -> Rc<RefCell<Tee>> {
        Rc::new(RefCell::new(Tee {
            tool,
            path: path.map(Path::to_owned),
            rotation,
            recorder: None,
            held: Vec::new(),
            spare: Vec::new(),
            begin: 0,
            error: None,
        }))
    }

    fn is_on(&self) -> bool {
        self.path.is_some() && self.error.is_none()
    }

    /// Takes a chunk as it comes.
    pub(super) fn chunk(&mut self, bytes: &[u8], at: HostInstant) {
        if !self.is_on() {
            return;
        }
        self.begin += self.held.last().map_or(0, |(last, _)| last.len() as u64);
        if self.recorder.is_some() {
            self.write_held();
        } else if self.held.iter().map(|(held, _)| held.len()).sum::<usize>() > MOST_EARLY {
            self.held.clear();
        }
        let mut buffer = self.spare.pop().unwrap_or_default();
        buffer.clear();
        buffer.extend_from_slice(bytes);
        self.held.push((buffer, at));
    }

    /// The device has answered: the recording begins, or goes on.
    ///
    /// # Errors
    /// Where it cannot be created.
    pub(super) fn open(&mut self) -> Result<(), RecordingError> {
        if let (Some(path), None) = (&self.path, &self.recorder)
            && self.error.is_none()
        {
            self.recorder = Some(Recorder::create(path, self.rotation)?);
        }
        Ok(())
    }

    /// A new connection is about to be made.
    pub(super) fn new_session(&mut self) {
        if let Some(recorder) = &mut self.recorder {
            for (bytes, at) in self.held.drain(..) {
                if let Err(error) = recorder.chunk(&bytes, at) {
                    self.error.get_or_insert(error);
                }
            }
            recorder.new_session();
        } else {
            self.held.clear();
        }
        self.begin = 0;
        self.say();
    }

    fn write_held(&mut self) {
        let Some(recorder) = &mut self.recorder else {
            return;
        };
        for (bytes, at) in self.held.drain(..) {
            if let Err(error) = recorder.chunk(&bytes, at) {
                self.error.get_or_insert(error);
            }
            if self.spare.is_empty() {
                self.spare.push(bytes);
            }
        }
        self.say();
    }

    /// Ends the recording, where the capture ended in mid-chunk behind the byte `last` of this
    /// connection.
    pub(super) fn finish(&mut self, last: Option<u64>) -> Result<(), RecordingError> {
        if let (Some(last), Some((newest, _))) = (last, self.held.last_mut()) {
            let keep = (last + 1).saturating_sub(self.begin);
            newest.truncate(usize::try_from(keep).unwrap_or(usize::MAX));
        }
        self.write_held();
        if let Some(recorder) = self.recorder.take()
            && self.error.is_none()
        {
            recorder.finish()?;
        }
        self.path = None;
        match self.error.take() {
            Some(error) => Err(error),
            None => Ok(()),
        }
    }

    /// Says once that the recording has failed, and gives it up.
    fn say(&mut self) {
        if let Some(error) = &self.error
            && self.recorder.take().is_some()
        {
            let tool = self.tool;
            eprintln!("{tool}: {error}: the recording ends here, the records go on");
            self.held.clear();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stream::scratch::Scratch;

    #[test]
    fn opens_late_and_is_cut_at_the_end() {
        let dir = Scratch::new("tee");
        let path = dir.file("run.cola");
        std::fs::write(&path, "old").unwrap();
        let tee = Tee::new("test", Some(&path), Rotation::default());
        let mut tee = tee.borrow_mut();
        let at = HostInstant::now();
        tee.new_session();
        tee.chunk(b"lost", at);
        tee.new_session();
        tee.chunk(b"abc", at);
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        tee.open().unwrap();
        tee.chunk(b"def", at);
        tee.new_session();
        tee.chunk(b"ghi", at);
        tee.chunk(b"jklm", at);
        tee.finish(Some(4)).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"abcdefghijk");
    }
}
