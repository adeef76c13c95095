//! What flows through the pipes: scans, IMU samples, reflector lines, poses, trajectories, line
//! segments and clock exchanges, with their units and their idea of a missing value.
//!
//! Each record says once, in its [`Record::visit`], which columns it has. CSV headers and rows, the
//! `cablepose_msgs` message definitions and their bytes are all made from that one list, so that
//! the two encodings cannot drift apart. Nothing here knows how records are written: see
//! [`crate::stream`].
//!
//! Units are SI, angles are radians. A missing number is NaN in memory and an empty field in CSV.

mod beam_fate;
mod beams;
mod clock;
mod columns;
mod delay;
mod imu;
mod lines;
mod pose;
mod scan;
mod segment;
mod status;
pub mod text;
mod time;
mod trajectory;

pub use beam_fate::BeamFate;
pub use beams::{BeamTable, ScanMotion};
pub use clock::ClockExchange;
pub use columns::{Presence, Record, Value, ValueError, Visit, VisitMut};
pub use delay::DelayPoint;
pub use imu::{Axes, ImuSample};
pub use lines::{
    Corner, Edge, EdgeBasis, EdgeKind, Face, FittedLine, LINE_STATE, NormalLine, ReflectorLines,
};
pub use pose::{POSE_STATE, Pose};
pub use scan::{Encoder, Ranges, Scan, ScanInfo};
pub(crate) use scan::{FURTHER_RANGES, FURTHER_REMISSIONS};
pub use segment::Segment;
pub use status::Status;
pub use time::Stamp;
pub use trajectory::TrajectoryPoint;
pub(crate) use trajectory::{POSE_COLUMNS, VELOCITY_COLUMNS};

/// Index into the upper triangle, stored row by row, of a symmetric `n` by `n` matrix.
///
/// Covariances travel in this order: `(0,0), (0,1), .. (0,n-1), (1,1), ..`.
pub const fn upper_index(n: usize, row: usize, col: usize) -> usize {
    let (i, j) = if row <= col { (row, col) } else { (col, row) };
    i * n - i * (i + 1) / 2 + j
}

#[cfg(test)]
mod tests {
    use super::upper_index;

    #[test]
    fn upper_triangle_is_row_by_row() {
        let mut k = 0;
        for i in 0..6 {
            for j in i..6 {
                assert_eq!(upper_index(6, i, j), k);
                assert_eq!(upper_index(6, j, i), k);
                k += 1;
            }
        }
    }
}
