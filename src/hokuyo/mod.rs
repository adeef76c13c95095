//! Hokuyo's scanners that speak SCIP 2.0, first the UTM-30LX: the protocol, a client, scans, and an
//! emulated device.
//!
//! - [`scip`] lines, check characters, 6 bit characters; requests and replies
//! - [`scans`] a measurement as a [`Scan`](crate::record::Scan), with unwrapped time
//! - [`client`] the host's side of a session
//! - [`emulator`] a device that behaves like a UTM-30LX
//!
//! The protocol in short: the host sends a line; the device repeats it, adds a line with a status of
//! two characters, lines with data, and an empty line. Every line of a reply but the first ends in a
//! check character. A measurement that goes on by itself (MD, MS, ME) sends one such reply a scan.
//!
//! Steps count counter-clockwise seen from above, so that beam angles in S are 90 deg +
//! (step - AFRT) * 360 deg / ARES: -45 to 225 deg for the whole aperture.
//!
//! **Sources.** Framing, statuses, commands and the example of a check character in PP: Hokuyo's
//! "Communication Protocol Specification for SCIP2.0 Standard" (C-42-03320B, 2006 to 2008). ME, and
//! that the check character of VV, PP and II lines leaves out the semicolon before it: Hokuyo's
//! urg_library 1.2 (facts read from its source) and the UXM-30LX-EW specification (C-42-03907).
//! Codes below DMIN of a UTM-30LX: the public ROS driver hokuyo_node, which cites table 4 of the
//! same specification. **Not settled by any of them**: which instant of a scan the time stamp means
//! (taken for its start here: a frame file's `index_to_first_beam_s` corrects it).

pub mod client;
pub mod emulator;
pub mod scans;
pub mod scip;

/// The TCP port of a device on Ethernet.
pub const PORT: u16 = 10_940;
/// The speed that a serial port is opened with; USB takes no notice of it.
pub const BAUD: u32 = 115_200;
