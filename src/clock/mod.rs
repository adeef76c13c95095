//! Device ticks and the maps from a device's time to the host's.
//!
//! - [`TickUnwrapper`] makes a 32 bit microsecond counter one that does not wrap
//! - [`Counter`] does the same for counters of any width
//! - [`OneWayHull`] finds offset and drift from arrival times alone, causally and in pieces
//! - [`Log`] sorts out recorded exchanges: wraps, restarts, steps of the host's clock
//! - [`fit()`] finds offset and drift from exchanges, with their uncertainty
//! - [`delay`] finds the delay between a desired motion and what was measured of it
//! - [`SoftwarePll`] is what others do, for comparison

mod cloud;
mod counter;
pub mod delay;
mod exchange;
mod fit;
mod hull;
mod one_way;
mod software_pll;
mod ticks;

pub use cloud::Method;
pub use counter::Counter;
pub use exchange::{ClockEvent, Exchange, Log, Session, Wire};
pub use fit::{ClockFit, ClockLine, FitError, FitSettings, LEAST_EXCHANGES, Piece, Verdict, fit};
pub use one_way::{Mapped, OneWayHull, OneWaySettings};
pub use software_pll::SoftwarePll;
pub use ticks::{Tick, TickUnwrapper};
