//! The robot's controller, a Beckhoff TwinCAT 3 PLC, reached over ADS.
//!
//! - [`address`] AMS NetIds and where they are reached
//! - [`ams`] frames, requests and replies: bytes in, meaning out, and back
//! - [`code`] what an ADS error number means and what to do
//! - [`client`] one connection: requests with deadlines, replies by their number, notifications
//! - [`symbols`] what a PLC says of its variables and types
//! - [`layout`] which scalar lies where in a variable
//! - [`fields`] what is written or read: quantities and their units
//! - [`image`] the bytes of a pose, the record in bytes
//! - [`variables`] a variable found by name, checked, written and read
//! - [`route`] asking a controller for a route to this host (UDP)
//! - [`emulator`] a PLC in its place, with faults
//!
//! # Why an own client
//! The crate `ads` (0.4.4) was to be taken unless one of the faults that have to be survived could
//! not be with it. The answer that comes after its deadline cannot: every later call then reads the
//! answer of the call before, for ever, although the values arrive. Dropping the connection would
//! cure it, at the price of a new connection and new handles for each late answer, which real PLCs
//! give now and then. It also asks no local router for a port, and a frame's length field makes it
//! allocate up to 4 GiB. Here a reply is matched by its invoke id, one that nobody waits for is
//! counted and dropped, and no frame longer than was asked for is taken.
//!
//! Facts about the wire: Beckhoff Information System, TwinCAT 3 "ADS specification" (AMS/TCP header,
//! AMS header, ADS commands, index groups). All numbers are little-endian.

pub mod address;
pub mod ams;
mod bytes;
pub mod client;
pub mod code;
pub mod emulator;
pub mod fields;
pub mod image;
pub mod layout;
pub mod route;
pub mod symbols;
pub mod variables;

pub use address::{AmsAddress, NetId, Target};
pub use client::{Client, ClientError, LocalAddress};
pub use code::Code;
