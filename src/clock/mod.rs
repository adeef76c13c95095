//! Device ticks and the maps from a device's time to the host's.
//!
//! - [`TickUnwrapper`] makes a 32 bit microsecond counter one that does not wrap
//! - [`Counter`] does the same for counters of any width
//! - [`LowerEnvelope`] finds the offset between two clocks from arrival times, causally
//! - [`OneWayHull`] finds offset and drift, causally and in pieces
//! - [`LowerHull`] and its lines are what the estimators are built on

mod counter;
mod envelope;
mod hull;
mod one_way;
mod ticks;

pub use counter::Counter;
pub use envelope::LowerEnvelope;
pub use hull::{Line, LowerHull, Point};
pub use one_way::{Mapped, OneWayHull, OneWaySettings};
pub use ticks::{Tick, TickUnwrapper};
