//! A pseudo terminal that stands in for a serial port.

use rustix::fs::OFlags;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};
use std::fs::{self, File, OpenOptions};
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::fs::{OpenOptionsExt, symlink};
use std::path::{Path, PathBuf};

/// The device's end of a pseudo terminal in raw mode; whoever opens [`Pty::path`] has the other.
///
/// The other end is held open here as well, so that its users may come and go. Dropping it is
/// pulling the cable: the other side reads an error.
#[derive(Debug)]
pub struct Pty {
    device: OwnedFd,
    path: PathBuf,
    link: Option<PathBuf>,
    _held: File,
}

impl Pty {
    /// A new pseudo terminal.
    pub fn open() -> io::Result<Pty> {
        let device = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
        grantpt(&device)?;
        unlockpt(&device)?;
        let name = ptsname(&device, Vec::new())?;
        let path = PathBuf::from(name.to_string_lossy().into_owned());
        let flags = OFlags::NOCTTY.bits().cast_signed();
        let held = OpenOptions::new()
            .read(true)
            .write(true)
            .custom_flags(flags)
            .open(&path)?;
        let mut terminal = tcgetattr(&held)?;
        terminal.make_raw();
        tcsetattr(&held, OptionalActions::Now, &terminal)?;
        rustix::io::ioctl_fionbio(&device, true)?;
        Ok(Pty {
            device,
            path,
            link: None,
            _held: held,
        })
    }

    /// A new pseudo terminal that `link` points to as long as it lives. A symbolic link that is
    /// already there is replaced, anything else is refused.
    pub fn open_as(link: &Path) -> io::Result<Pty> {
        let mut pty = Pty::open()?;
        if fs::symlink_metadata(link).is_ok_and(|found| found.is_symlink()) {
            fs::remove_file(link)?;
        }
        symlink(&pty.path, link)?;
        pty.link = Some(link.to_owned());
        Ok(pty)
    }

    /// The speed that the other end is set to; a pseudo terminal carries bytes at any.
    pub fn baud(&self) -> Option<u32> {
        tcgetattr(&self._held).ok().map(|t| t.output_speed())
    }

    /// What to open at the other end.
    pub fn path(&self) -> &Path {
        &self.path
    }

    pub(in crate::link) fn read(&self, buffer: &mut [u8]) -> io::Result<usize> {
        rustix::io::read(&self.device, buffer).map_err(io::Error::from)
    }

    pub(in crate::link) fn write(&self, bytes: &[u8]) -> io::Result<usize> {
        rustix::io::write(&self.device, bytes).map_err(io::Error::from)
    }
}

impl AsFd for Pty {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.device.as_fd()
    }
}

impl Drop for Pty {
    fn drop(&mut self) {
        if let Some(link) = &self.link
            && fs::read_link(link).is_ok_and(|target| target == self.path)
        {
            // Whoever looks for it finds nothing, which is the truth.
            let _ = fs::remove_file(link);
        }
    }
}
