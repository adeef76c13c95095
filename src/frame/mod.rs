//! The frame that the platform hangs in: its box, plates and strips, the mountings of scanner and
//! IMU, read from `frame.toml` and checked; the one place that states the geometry's conventions.
//!
//! Frames of reference, all right-handed:
//!
//! - **B** robot frame: x depth, y along the frame, z up; origin on the floor at the middle of
//!   width and depth.
//! - **P** platform. Its rotation in B is R = Rz(yaw) Ry(pitch) Rx(roll) (Kurniawan 2017,
//!   eq. 3.3 to 3.6).
//! - **S** scanner, fixed on P. Its origin in B is r_P + R r_PS; its beam at angle `delta` points
//!   along `[0, cos delta, sin delta]` in S (eq. 3.14 to 3.16). So a scan starts near +y, passes
//!   over the ceiling (+z) and ends near -y.
//!
//! "Right" is the wall y = +dy/2, "left" the wall y = -dy/2, "upper" the ceiling z = dz.
//!
//! The box is |x| <= dx/2, |y| <= dy/2, 0 <= z <= dz. On the ceiling a strip is bounded by the two
//! edges y = offset +- width/2 + x tan(inclination) (eq. 3.30 to 3.40); on a side wall z stands in
//! place of y. The simulator and the solver each have their own arithmetic for beams and surfaces,
//! on purpose: what they share is only the numbers here.

mod attitude;
mod config;
mod crossing;
mod disc;
pub mod edit;
mod imu_axes;
mod scanner_model;
pub(crate) mod toml_file;

pub use attitude::{euler_to_fixed_axes, fixed_axes_to_euler};
pub use config::{Calibration, Frame, FrameBox, Imu, Plate, Scanner, Strip};
pub use crossing::{Crossing, FaceLine, ScannerPose};
pub use disc::{disc_centre, disc_share};
pub use imu_axes::ImuAxes;
pub use scanner_model::{Optics, ScanMode, ScannerModel};
pub use toml_file::ConfigError;
