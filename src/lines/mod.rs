//! Straight lines from a scan.
//!
//! [`reflectors`] fits the frame's three reflector lines jointly with the range bias.

pub mod reflectors;
