//! Device ticks and the maps from a device's time to the host's.
//!
//! - [`TickUnwrapper`] makes a 32 bit microsecond counter one that does not wrap
//! - [`LowerEnvelope`] finds the offset between two clocks from arrival times, causally

mod envelope;
mod ticks;

pub use envelope::LowerEnvelope;
pub use ticks::{Tick, TickUnwrapper};
