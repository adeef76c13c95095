//! The ninth bit of RS-485 lines with addresses: it marks the byte that is an address or command.
//!
//! A UART has no ninth data bit, but can send its parity bit as a mark (1) or a space (0). The port
//! library knows no such parity, so that it is set on a second handle of the same port. Linux has it
//! where the driver has; a pseudo terminal has not.

use rustix::fs::OFlags;
use std::fs::File;
use std::io;
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;

/// A second handle of a port, on which the ninth bit is set.
#[derive(Debug)]
pub(in crate::link) struct NinthBit {
    port: File,
}

impl NinthBit {
    /// Opens the handle; to be done before the port is opened for its exclusive use.
    pub(in crate::link) fn open(path: &Path) -> io::Result<NinthBit> {
        let flags = (OFlags::NOCTTY | OFlags::NONBLOCK).bits().cast_signed();
        let port = File::options()
            .read(true)
            .write(true)
            .custom_flags(flags)
            .open(path)?;
        Ok(NinthBit { port })
    }

    /// Waits until everything written is out, then sets the ninth bit of what follows. False where
    /// the port cannot do it.
    #[cfg(target_os = "linux")]
    pub(in crate::link) fn set(&self, mark: bool) -> io::Result<bool> {
        use rustix::termios::{ControlModes, InputModes, OptionalActions, tcgetattr, tcsetattr};
        let wanted = ControlModes::PARENB | ControlModes::CMSPAR;
        let mut termios = tcgetattr(&self.port)?;
        termios.control_modes |= wanted;
        termios.control_modes.set(ControlModes::PARODD, mark);
        // Bytes that come have it as well; nothing is checked.
        termios.input_modes.remove(InputModes::INPCK);
        tcsetattr(&self.port, OptionalActions::Drain, &termios)?;
        let now = tcgetattr(&self.port)?.control_modes;
        Ok(now.contains(wanted) && now.contains(ControlModes::PARODD) == mark)
    }

    /// There is no such parity on this system.
    #[cfg(not(target_os = "linux"))]
    pub(in crate::link) fn set(&self, _mark: bool) -> io::Result<bool> {
        Ok(false)
    }
}
