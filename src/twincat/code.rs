//! What an ADS error number means, and what to do.

use std::fmt;

/// A return code of ADS or of an AMS router.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Code(pub u32);

impl Code {
    /// No error.
    pub const OK: Code = Code(0);
    /// No server has that AMS port: the runtime is not started.
    pub const NO_PORT: Code = Code(0x6);
    /// No route to that NetId.
    pub const NO_MACHINE: Code = Code(0x7);
    /// Some error of the device.
    pub const DEVICE: Code = Code(0x700);
    /// The server does not know the request.
    pub const NO_SERVICE: Code = Code(0x701);
    /// It does not know the index group.
    pub const NO_GROUP: Code = Code(0x702);
    /// Nor the index offset: a handle that is no more, for example.
    pub const NO_OFFSET: Code = Code(0x703);
    /// Not permitted.
    pub const DENIED: Code = Code(0x704);
    /// Another size than the variable's.
    pub const SIZE: Code = Code(0x705);
    /// Not ready yet.
    pub const NOT_READY: Code = Code(0x707);
    /// Busy.
    pub const BUSY: Code = Code(0x708);
    /// No variable of that name.
    pub const NO_SYMBOL: Code = Code(0x710);
    /// The handle is of an older program.
    pub const OLD_SYMBOL: Code = Code(0x711);
    /// The notification is not known.
    pub const NO_NOTIFICATION: Code = Code(0x714);
    /// The user name or the password is wrong.
    pub const NO_ACCESS: Code = Code(0x723);

    /// Whether there was no error.
    pub fn is_ok(self) -> bool {
        self == Code::OK
    }

    /// Whether a handle has gone stale: it is to be fetched again.
    pub fn is_stale_handle(self) -> bool {
        [Code::NO_OFFSET, Code::NO_SYMBOL, Code::OLD_SYMBOL].contains(&self)
    }

    /// Whether who should answer is not there: the runtime, or the machine behind the router.
    pub fn is_absence(self) -> bool {
        [Code::NO_PORT, Code::NO_MACHINE].contains(&self)
    }

    /// Whether the controller does not do that kind of request at all.
    pub fn is_unsupported(self) -> bool {
        [Code::NO_SERVICE, Code::NO_GROUP, Code::DEVICE].contains(&self)
    }

    /// Whether it may go away by waiting: the runtime starts, a program is being loaded.
    pub fn may_pass(self) -> bool {
        matches!(self.0, 0x6 | 0x12 | 0x707 | 0x708 | 0x712 | 0x718 | 0x722)
    }

    fn text(self) -> Option<&'static str> {
        Some(match self.0 {
            0x1 => "internal error of the router",
            0x6 => {
                "no server has that AMS port: the PLC runtime is not started, or its port is not \
                 this one (TwinCAT 3: 851, 852, ..; TwinCAT 2: 801)"
            }
            0x7 => {
                "the target machine is not known: the NetId is wrong, or a route is missing on one \
                 of the two sides"
            }
            0x8 | 0xb => "the command is not known",
            0xd => "the port is not connected",
            0xf => "the NetId is not valid",
            0x12 => "the port is disabled: the TwinCAT system service is not started",
            0x18 => "the AMS port is not valid",
            0x19 | 0x70a => "out of memory",
            0x1e => "secure ADS is wanted there, which is not spoken here",
            0x700 => "an error of the device",
            0x701 => "the server does not do this request",
            0x702 => "the index group is not known",
            0x703 => "the index offset is not valid (a handle that is no more)",
            0x704 => "reading or writing is not permitted (a constant or read-only variable?)",
            0x705 => "the size is not the variable's",
            0x706 | 0x70b => "a value is not valid",
            0x707 => "the device is not ready",
            0x708 => "the device is busy",
            0x70c => "not found",
            0x70e => "the objects do not match",
            0x710 => "there is no such symbol",
            0x711 => "the symbol's version is not valid: the program was changed",
            0x712 => "the server is in an invalid state",
            0x713 => "the transmission mode is not supported",
            0x714 => "the notification is not known",
            0x716 => "no more notifications are to be had",
            0x717 => "the notification is too large",
            0x718 => "the device is not initialised",
            0x719 => "the device has timed out",
            0x722 => "the symbol is not active",
            0x723 => "access is denied: the user name or the password is wrong",
            0x745 => "no answer in time: is there a route?",
            _ => return None,
        })
    }
}

impl fmt::Display for Code {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.text() {
            Some(text) => write!(f, "{text} (ADS error {:#x}, {})", self.0, self.0),
            None => write!(f, "ADS error {:#x} ({})", self.0, self.0),
        }
    }
}
