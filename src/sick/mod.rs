//! The SICK LMS5xx's telegrams (and those of its relatives LMS1xx and TiM): framing, the scan
//! telegram LMDscandata, and scans from it.
//!
//! - [`cola`] cuts a byte stream into telegrams, in either dialect, whatever the chunks
//! - [`scandata`] reads one LMDscandata telegram, every field as sent; [`encode`] writes one
//! - [`angle_jitter`] takes out the jitter of the motor, learned from a scene at rest
//! - [`angles`] undoes the rounding of angles on the wire
//! - [`scan`] turns one into a [`Scan`](crate::record::Scan) record; [`replay`] does so for a stream,
//!   with unwrapped time, lost and repeated scans
//! - [`emulator`] a device that behaves like an LMS5xx
//! - [`client`] the host's side: requests, answers, a session with a scanner
//!
//! The device counts angles from 0 deg at its right to 90 deg straight ahead, counter-clockwise
//! from above, which is the beam angle in S directly.
//!
//! Sources: SICK telegram listing 8014631 (2012 and 2022), LMS5xx operating instructions 8013796,
//! and recorded streams of an LMS511, an LMS111 and several LMS5xx units.

pub mod angle_jitter;
pub mod angles;
pub mod client;
pub mod cola;
pub mod emulator;
pub mod encode;
mod fields;
pub mod replay;
pub mod scan;
pub mod scandata;
mod succession;
