//! The MicroStrain 3DM-GX1: commands, replies, EEPROM, ticks, and a session with the unit.
//!
//! - [`Command`] what can be asked and how long each reply is, with every word's meaning
//! - [`Packet`] a reply with header and checksum, word by word; [`packet::encode`] writes one
//! - [`scale`] from words to radians, m/s^2, rad/s and gauss, with the unit's own [`Gains`]
//! - [`eeprom`] the cells, their defaults, and which of them must not be written
//! - [`ticks`] the length of a tick and of a calculation cycle
//! - [`framer`] replies from a byte stream, whatever was lost; [`pace`] what the ticks tell of it
//! - [`timing`] when a sample was taken; [`attitude`] the three forms of an attitude; [`samples`]
//!   records from replies
//! - [`conventions`] which of the disputed signs a unit follows
//! - [`session`] the talk with a unit: speed, start, stop, questions, cells; [`unit_file`] what a
//!   recording needs beside it
//!
//! The device speaks big-endian 16 bit words. A reply begins with the command's byte and ends with
//! the sum of everything before; there is no other mark, so that a reply is only known as one
//! where it is expected.
//!
//! Sources: MicroStrain's data communication protocol of the predecessor 3DM-G (rev 2.11, 2003) and
//! its manual, the maker's sample code for the GX1 (2010), and eight public drivers that were run
//! with a GX1. Where only one of them says so, or none, the text says "unconfirmed".

pub mod attitude;
pub mod command;
pub mod conventions;
pub mod eeprom;
pub mod emulator;
pub mod framer;
pub mod pace;
pub mod packet;
pub mod samples;
pub mod scale;
pub mod session;
pub mod ticks;
pub mod timing;
pub mod unit_file;

pub use command::{Argument, Command, Word};
pub use framer::{Arrived, Framer};
pub use packet::{Packet, PacketError};
pub use samples::{Mode, Samples, Setup};
pub use scale::Gains;
pub use session::{Session, SessionError};
pub use ticks::TickFactors;

/// The speeds of the line that the unit can be set to, most likely first, Bd.
pub const BAUD_RATES: [u32; 3] = [38_400, 115_200, 19_200];

/// Time that `bytes` take on the line at `baud` (8N1: ten bits a byte), s.
pub fn wire_time_s(bytes: usize, baud: u32) -> f64 {
    bytes as f64 * 10.0 / f64::from(baud.max(1))
}
