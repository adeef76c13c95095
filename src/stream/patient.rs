//! Pipes and FIFOs that a source writes without being stuck in them.
//!
//! A reader that has stopped (Ctrl-Z, a debugger, a slower program) makes a write wait, and a write
//! that waits does not see the signal that asks the source to end: its device would go on until
//! somebody reads. So a source that has a device waits for room first, and once it is asked to end
//! it gives a reader that takes nothing [`GRACE`] and no more.

use super::flow::Stop;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::os::fd::AsFd;
use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
use std::path::Path;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

/// How long a reader may take nothing once the source is asked to end.
const GRACE: Duration = Duration::from_secs(2);
/// The longest wait between two looks at whether to end.
const GLANCE: Duration = Duration::from_millis(50);
/// A pipe with any room has room for as much (POSIX: PIPE_BUF is at least 512; on Linux a page).
const PIECE: usize = if cfg!(target_os = "linux") { 4096 } else { 512 };

/// Who asks this process's source to end.
static STOP: OnceLock<Stop> = OnceLock::new();

/// From now on no write to a pipe or a FIFO outlasts `stop` for long.
pub(crate) fn leave_stuck_writes(stop: &Stop) {
    // A process has one source.
    let _ = STOP.set(stop.clone());
}

/// A file that may be a pipe.
pub(super) struct Patient {
    file: File,
    /// Whether a write may wait for a reader.
    waits: bool,
    /// Nobody has read for too long: nothing more goes out.
    given_up: bool,
}

impl Patient {
    pub(super) fn new(file: File) -> Patient {
        let waits = file.metadata().is_ok_and(|found| {
            let kind = found.file_type();
            kind.is_fifo() || kind.is_socket() || kind.is_char_device()
        });
        Patient {
            file,
            waits,
            given_up: false,
        }
    }

    /// Opens a FIFO, and any other file that is there and is no regular one, for writing. Opening a
    /// FIFO waits for its reader.
    pub(super) fn open(path: &Path) -> io::Result<Patient> {
        let Some(stop) = STOP.get() else {
            return File::create(path).map(Patient::new);
        };
        let mut options = OpenOptions::new();
        let nonblocking = rustix::fs::OFlags::NONBLOCK.bits().cast_signed();
        options.write(true).custom_flags(nonblocking);
        loop {
            match options.open(path) {
                Ok(file) => {
                    // The description is this process's own: nobody else sees the change.
                    let flags = rustix::fs::fcntl_getfl(&file)?;
                    rustix::fs::fcntl_setfl(&file, flags - rustix::fs::OFlags::NONBLOCK)?;
                    return Ok(Patient::new(file));
                }
                Err(error) if error.raw_os_error() == Some(Errno::NXIO.raw_os_error()) => {
                    if stop.requested() {
                        return Err(io::Error::other("nobody has opened it for reading"));
                    }
                    std::thread::sleep(GLANCE);
                }
                Err(error) => return Err(error),
            }
        }
    }

    /// Waits until there is room, or for [`GRACE`] after the source was asked to end.
    fn await_room(&mut self, stop: &Stop) -> io::Result<()> {
        let glance = Timespec {
            tv_sec: 0,
            tv_nsec: GLANCE.subsec_nanos().into(),
        };
        let mut asked = None;
        while !self.given_up {
            let mut waited = [PollFd::from_borrowed_fd(self.file.as_fd(), PollFlags::OUT)];
            match poll(&mut waited, Some(&glance)) {
                // A pipe without a reader counts as room too: the write says what is the matter.
                Ok(1..) => return Ok(()),
                Ok(0) | Err(Errno::INTR) => {}
                Err(error) => return Err(error.into()),
            }
            if stop.requested() {
                let since = asked.get_or_insert_with(Instant::now);
                self.given_up = since.elapsed() >= GRACE;
            }
        }
        let text = "nobody reads; the last records are lost";
        Err(io::Error::new(io::ErrorKind::TimedOut, text))
    }
}

impl Write for Patient {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match STOP.get() {
            Some(stop) if self.waits => {
                self.await_room(stop)?;
                self.file.write(bytes.get(..PIECE).unwrap_or(bytes))
            }
            _ => self.file.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}
