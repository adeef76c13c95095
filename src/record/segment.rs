//! Straight lines of a general scene, one record a line.

use super::columns::columns;
use super::lines::NormalLine;
use super::time::Stamp;

/// A run of beams on one straight line, in the scan plane of S.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// Stamp of the scan.
    pub stamp: Stamp,
    /// Sequence number of the scan.
    pub seq: u32,
    /// Which line of the scan, counted from 0 in beam order.
    pub line: u32,
    /// The line in normal parametrisation.
    pub normal: NormalLine,
    /// End points (y, z) in the scan plane, first beam first, m.
    pub ends_m: [[f64; 2]; 2],
    /// Beams on the line.
    pub points: u32,
    /// Variance of d, m^2; covariance of d and alpha, m rad; variance of alpha, rad^2.
    pub covariance: [f64; 3],
    /// Root mean square of the range residuals, m.
    pub rms_m: f64,
}

impl Default for Segment {
    fn default() -> Self {
        Segment {
            stamp: Stamp::default(),
            seq: 0,
            line: 0,
            normal: NormalLine::MISSING,
            ends_m: [[f64::NAN; 2]; 2],
            points: 0,
            covariance: [f64::NAN; 3],
            rms_m: f64::NAN,
        }
    }
}

columns!(Segment, kind = "segment", stamp = stamp, {
    Required "stamp_ns" => stamp;
    Required "seq" => seq;
    Required "line" => line;
    Required "d_m" => normal.d_m;
    Required "alpha_rad" => normal.alpha_rad;
    Required "x0_m" => ends_m[0][0];
    Required "y0_m" => ends_m[0][1];
    Required "x1_m" => ends_m[1][0];
    Required "y1_m" => ends_m[1][1];
    Required "points" => points;
    Required "cov_dd" => covariance[0];
    Required "cov_da" => covariance[1];
    Required "cov_aa" => covariance[2];
    Required "rms_m" => rms_m;
});
