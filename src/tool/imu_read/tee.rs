//! The raw bytes of a live stream, kept on the side with what is needed to read them again.

use super::NAME;
use crate::gx1::unit_file::{self, UnitFile};
use crate::link::{HostInstant, Recorder, Rotation};
use crate::stream::Fault;
use std::path::{Path, PathBuf};

/// What is kept in memory before the recording is opened, bytes: the answers to the first questions.
const MOST_EARLY: usize = 1 << 20;

/// A recording that is opened once the unit has answered, so that a failed start leaves an older one
/// of that name alone.
pub(super) struct Tee {
    path: PathBuf,
    rotation: Rotation,
    recorder: Option<Recorder>,
    early: Vec<(Vec<u8>, HostInstant)>,
    early_bytes: usize,
    fault: Option<String>,
}

impl Tee {
    pub(super) fn new(path: &Path, rotation: Rotation) -> Tee {
        Tee {
            path: path.to_owned(),
            rotation,
            recorder: None,
            early: Vec::new(),
            early_bytes: 0,
            fault: None,
        }
    }

    /// Takes a piece as it comes.
    pub(super) fn chunk(&mut self, bytes: &[u8], at: HostInstant) {
        if self.fault.is_some() {
            return;
        }
        let Some(recorder) = &mut self.recorder else {
            self.early_bytes += bytes.len();
            if self.early_bytes <= MOST_EARLY {
                self.early.push((bytes.to_owned(), at));
            }
            return;
        };
        if let Err(error) = recorder.chunk(bytes, at) {
            eprintln!("{NAME}: {error}: the recording ends here, the records go on");
            self.fault = Some(error.to_string());
            self.recorder = None;
        }
    }

    /// Says that what comes next is of another connection.
    pub(super) fn new_session(&mut self) {
        match &mut self.recorder {
            Some(recorder) => recorder.new_session(),
            None => {
                self.early.clear();
                self.early_bytes = 0;
            }
        }
    }

    /// Creates the files: the unit has answered.
    pub(super) fn begin(&mut self, unit: &UnitFile) -> anyhow::Result<()> {
        let io = |error: crate::link::RecordingError| Fault::Io(error.to_string());
        self.recorder = Some(Recorder::create(&self.path, self.rotation).map_err(io)?);
        let beside = unit_file::beside(&self.path);
        std::fs::write(&beside, unit.text())
            .map_err(|error| Fault::Io(format!("{}: {}", beside.display(), plain(&error))))?;
        for (bytes, at) in std::mem::take(&mut self.early) {
            self.chunk(&bytes, at);
        }
        Ok(())
    }

    /// Ends the recording.
    pub(super) fn finish(mut self) -> anyhow::Result<()> {
        if let Some(recorder) = self.recorder.take() {
            let finished = recorder.finish();
            finished.map_err(|error| Fault::Io(error.to_string()))?;
        }
        match self.fault {
            Some(fault) => Err(Fault::Io(fault).into()),
            None => Ok(()),
        }
    }
}

fn plain(error: &std::io::Error) -> String {
    let text = error.to_string();
    text.split(" (os error")
        .next()
        .unwrap_or_default()
        .to_owned()
}
