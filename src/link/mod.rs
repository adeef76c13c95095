//! How bytes reach a device and come back: sockets, serial ports and pseudo terminals, with time
//! limits and the host's time of arrival.
//!
//! The only place that opens a socket or a port. A device's room turns bytes into meaning and knows
//! nothing of where they come from.
//!
//! - [`Endpoint`] where a device is: `lms.local:2112`, `/dev/ttyUSB0`
//! - [`Connection`] an open line, read and written with time limits; [`Tap`] sees what comes
//! - [`HostInstant`] an instant on both of the host's clocks
//! - [`Datagrams`] a question and its answer over UDP; [`waker()`] ends another thread's wait
//! - [`Pty`] a pseudo terminal that stands in for a serial port
//! - [`Backoff`] how long to wait before the next attempt
//! - [`Pacing`] when a simulated device is due to speak
//! - [`emulation`] the lines of an emulated device: sockets and ptys, their clients, their faults
//! - [`Recorder`] raw bytes kept with their times of arrival; [`Arrivals`] those times read back
//! - [`ports()`] the host's serial ports; [`baud`] what a line can carry and a clock can make
//! - [`latency_timer()`] for how long a USB adapter holds bytes back
//! - [`faults`] what shall go wrong on an emulated device's lines
//!
//! What only Unix has is in `unix`: pseudo terminals, the ninth bit, the pair of sockets behind a
//! waker, the two clocks. `elsewhere` has the same names for other systems.

mod adapter;
mod arrivals;
mod backoff;
pub mod baud;
mod connection;
mod datagrams;
pub mod emulation;
mod endpoint;
pub mod faults;
mod host_clock;
mod pacing;
mod ports;
mod recording;
mod waker;

#[cfg(not(unix))]
#[path = "elsewhere.rs"]
mod system;
#[cfg(unix)]
#[path = "unix/mod.rs"]
mod system;

pub use adapter::{LatencyTimer, latency_timer};
pub use arrivals::{Arrivals, ArrivalsError, parse_seconds_ns};
pub use backoff::Backoff;
pub use connection::{Connection, Interrupted, LinkError, Received, Tap};
pub use datagrams::Datagrams;
pub use endpoint::{Endpoint, EndpointError};
pub use host_clock::HostInstant;
pub use pacing::Pacing;
pub use ports::{Adapter, Port, ports};
pub use recording::{Recorder, RecordingError, Rotation, times_beside, would_write};
pub use system::Pty;
pub use waker::{Waiter, Waker, waker};
