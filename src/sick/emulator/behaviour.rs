//! Who an emulated device is and how it behaves.

use crate::frame::{ScanMode, ScannerModel};
use crate::sick::cola::Dialect;
use std::time::Duration;

/// Which dialects a port answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Speech {
    /// The dialect that it is spoken to in.
    Both,
    /// CoLa A; to CoLa B it answers `sFA 11`.
    Text,
    /// The dialect that `EIHstCola` had when the client came. Set to CoLa B it is silent to CoLa A.
    Host,
}

/// When the time of transmission is taken (the listing leaves it open for a polled scan).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TransmitStamp {
    /// When the telegram is sent.
    Send,
    /// When the scan is complete.
    ScanEnd,
}

/// What the device says of itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Identity {
    /// Type and variant of `DeviceIdent`, 16 characters each.
    pub ident: [String; 2],
    /// `FirmwareVersion`.
    pub firmware: String,
    /// Serial number.
    pub serial: u32,
    /// Order number, `DIornr`.
    pub order_number: String,
    /// Operating hours, 0.1 h.
    pub operating_tenths_h: u32,
    /// Power-on count.
    pub power_ons: u32,
    /// The comment that a telegram can carry.
    pub comment: String,
}

impl Default for Identity {
    fn default() -> Identity {
        Identity {
            ident: ["LMS511-10100 PRO".into(), "V1.80 (emulated)".into()],
            firmware: "V1.80    ".into(),
            serial: 18_110_550,
            order_number: "1046135".into(),
            operating_tenths_h: 1195,
            power_ons: 99,
            comment: "emulated".into(),
        }
    }
}

/// How the device behaves.
#[derive(Clone, Debug)]
pub struct Behaviour {
    /// Who it is.
    pub identity: Identity,
    /// Its data sheet.
    pub model: &'static ScannerModel,
    /// Its first mode.
    pub mode: ScanMode,
    /// The dialects of its services, in their order.
    pub speech: Vec<Speech>,
    /// What `EIHstCola` is at the start.
    pub host_dialect: Dialect,
    /// How long it needs before it measures, from its start on.
    pub boot: Duration,
    /// The same after a reboot that a client asks for.
    pub reboot: Duration,
    /// How long nothing comes after a change of the mode.
    pub settle: Duration,
    /// What it sees begins when the first client asks for scans, and not at once.
    pub hold: bool,
    /// How long it stays after what it sees has ended, for clients to leave.
    pub linger: Duration,
    /// Its clock's error, ppm.
    pub clock_ppm: f64,
    /// The calendar at the start, ns since 1970; none where nobody has set it.
    pub calendar_ns: Option<i64>,
    /// The counter at the start.
    pub uptime: Duration,
    /// When the time of transmission is taken.
    pub transmit_stamp: TransmitStamp,
}
