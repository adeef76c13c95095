//! The host's side of the protocol: requests, their answers, and a session with a scanner.
//!
//! - [`Request`], [`Value`], [`Reply`] one command and its answer, in either dialect; [`Refusal`] an
//!   `sFA` in words
//! - [`commands`] the commands that this project uses, with typed arguments and answers
//! - [`Client`] a session over a [`Connection`](crate::link::Connection): finds out the dialect, asks
//!   and waits for the answer, and keeps the events that come in between
//! - [`configure`] sets a device in the order that works and reads it back; [`modes`] the pairs of
//!   frequency and resolution that there are; [`load`] whether a serial line carries them
//! - [`facts`] everything that a device tells of itself
//!
//! A device answers in the order it is asked, but events (`sSN`) come at any time, also between a
//! request and its reply. They are told apart by verb and name and none is lost.
//!
//! Sources: SICK telegram listing 8014631 and the recorded session of an LMS511.

pub mod commands;
pub mod configure;
mod error;
mod facts;
pub mod load;
pub mod modes;
mod request;
mod session;
#[cfg(test)]
mod session_tests;

pub use error::ClientError;
pub use facts::{Fact, fact, facts};
pub use request::{Refusal, Reply, Request, Value, Values, Verb};
pub use session::{Client, Incoming, Settings};

/// The port whose dialect the device's setting `EIHstCola` decides.
pub const HOST_PORT: u16 = 2112;
/// The port that always speaks CoLa A.
pub const TEXT_PORT: u16 = 2111;
