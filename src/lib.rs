//! cablepose measures where a cable robot's platform is.
//!
//! A 2D laser scanner on the platform sees the frame's left wall, ceiling and right wall as three
//! straight lines, and the edges of inclined reflector strips on the ceiling. The lines give y, z
//! and roll, the edges x and yaw, an IMU (or inclined strips on the walls) pitch. Nine programs
//! pass records through pipes; each is a few lines in `src/bin`, wired in [`tool`].
//!
//! The rooms, in the order the data flows:
//!
//! - [`record`] what flows: scans, IMU samples, lines, poses, trajectories; names and units
//! - [`stream`] how it flows: CSV and MCAP, side inputs, flushing, exit statuses
//! - [`frame`] the frame's box, reflectors and mountings, read from `frame.toml`
//! - [`link`] sockets, serial ports and pseudo terminals
//! - [`sick`] the SICK LMS500's telegrams
//! - [`hokuyo`] Hokuyo's scanners: SCIP 2.0, a client, an emulated UTM-30LX
//! - [`gx1`] the MicroStrain 3DM-GX1's replies, and a session with the unit
//! - [`twincat`] the robot's controller: ADS, a client, an emulated PLC
//! - [`clock`] device ticks and time maps
//! - [`lines`] straight lines from a scan
//! - [`edges`] strip edges from a scan and its lines
//! - [`pose`] the pose from lines and edges
//! - [`motion`] trajectories
//! - [`robot`] cables, pulleys, and where the lengths that a controller winds put the platform
//! - [`simulate`] a virtual frame, scanner and IMU
//! - [`report`] error statistics, figures and the page
//!
//! Start reading at [`record`], then [`frame`] for the geometry's conventions, then [`pose`].

pub mod clock;
pub mod edges;
pub mod frame;
pub mod gx1;
pub mod hokuyo;
pub mod lines;
pub mod link;
pub mod motion;
pub mod pose;
pub mod record;
pub mod report;
pub mod robot;
pub mod sick;
pub mod simulate;
pub mod stream;
pub mod tool;
pub mod twincat;
