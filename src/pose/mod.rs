//! The platform's pose from reflector lines and strip edges.
//!
//! [`joint`] is the kit's estimator: everything that a scan says, in one Gaussian state, with each
//! edge treated as the interval that it is. [`vote`] is the published method (Kurniawan 2017,
//! section 3.5), the baseline. [`pitch`] is where the IMU comes in, [`alignment`] how it sits on the
//! platform, [`calibration`] what many scans together say of the frame and the devices;
//! [`filter`] goes over many scans.

pub mod alignment;
pub mod calibration;
pub mod filter;
pub mod gaussian;
pub mod information;
pub mod interval;
pub mod joint;
mod mounting;
pub mod pitch;
#[cfg(test)]
mod staged;
mod thinned;
pub mod vote;
