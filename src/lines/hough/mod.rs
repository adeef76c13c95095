//! The Hough transform and its faster kin.
//!
//! A point (y, z) votes for every line through it: `d = y cos(alpha) + z sin(alpha)`, a curve in the
//! space of (d, alpha). Points of one line meet in one cell (Duda and Hart 1972; Kurniawan 2017, eq.
//! 4.2 to 4.4).
//!
//! - [`Hough`]: the transform over the whole space, one line after the other
//! - [`FastHough`]: the space is halved again and again, and only parts with enough votes are looked
//!   into (Li, Lavin and Le Master 1986)
//! - [`ModifiedHough`]: votes only in windows around the lines predicted (Kurniawan 2017, eq. 4.5 to
//!   4.10)
//! - [`Window`], [`Accumulator`]: one such window and its cells
//! - [`ReflectorTransform`]: a window for each of the three reflectors of a frame
//!
//! Cells count in 16 bits, of which a cache holds more, and no further. A peak is refined by
//! [`super::pool`] and the common fit.

mod columns;
mod fast;
mod full;
mod modified;
mod reflectors;
mod window;

pub use columns::{Columns, Peak};
pub use fast::{FastHough, FastHoughOptions, Hypercubes};
pub use full::{Hough, HoughOptions, WholeSpace};
pub use modified::{ExpectedWindows, ModifiedHough, ModifiedHoughOptions};
pub use reflectors::{ReflectorTransform, WindowSize};
pub use window::{Accumulator, Window};

use super::fit::InverseLine;

/// The line y cos(alpha) + z sin(alpha) = d.
fn inverse_line(d_m: f64, alpha_rad: f64) -> InverseLine {
    // A line through the scanner has no inverse; no beam can lie on one.
    let d_m = if d_m.abs() < 1e-6 { 1e-6 } else { d_m };
    let (sin, cos) = alpha_rad.sin_cos();
    InverseLine {
        a: cos / d_m,
        b: sin / d_m,
    }
}

/// Adding this to a number below 2^22 rounds it to an integer, which is then in its low bits: unlike
/// a cast it goes through vector registers.
const ROUND: f32 = 12_582_912.0;

/// The row of a distance given in rows, modulo 2^16.
#[inline]
fn row_of(distance_rows: f32) -> u32 {
    (distance_rows + ROUND).to_bits() & 0xffff
}

#[cfg(test)]
mod tests;
