//! Straight lines of a general scene, one record a line.

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

impl super::Record for Segment {
    const KIND: &'static str = "segment";
    fn stamp(&self) -> Stamp {
        self.stamp
    }
    fn visit<V: super::Visit>(&self, v: &mut V) -> Result<(), V::Error> {
        use super::Presence::Required;
        v.column("stamp_ns", Required, &self.stamp)?;
        v.column("seq", Required, &self.seq)?;
        v.column("line", Required, &self.line)?;
        v.column("d_m", Required, &self.normal.d_m)?;
        v.column("alpha_rad", Required, &self.normal.alpha_rad)?;
        for (name, value) in END_COLUMNS.iter().zip(self.ends_m.iter().flatten()) {
            v.column(name, Required, value)?;
        }
        v.column("points", Required, &self.points)?;
        for (name, value) in COVARIANCE_COLUMNS.iter().zip(&self.covariance) {
            v.column(name, Required, value)?;
        }
        v.column("rms_m", Required, &self.rms_m)
    }
    fn visit_mut<V: super::VisitMut>(&mut self, v: &mut V) -> Result<(), V::Error> {
        use super::Presence::Required;
        v.column("stamp_ns", Required, &mut self.stamp)?;
        v.column("seq", Required, &mut self.seq)?;
        v.column("line", Required, &mut self.line)?;
        v.column("d_m", Required, &mut self.normal.d_m)?;
        v.column("alpha_rad", Required, &mut self.normal.alpha_rad)?;
        for (name, value) in END_COLUMNS.iter().zip(self.ends_m.iter_mut().flatten()) {
            v.column(name, Required, value)?;
        }
        v.column("points", Required, &mut self.points)?;
        for (name, value) in COVARIANCE_COLUMNS.iter().zip(&mut self.covariance) {
            v.column(name, Required, value)?;
        }
        v.column("rms_m", Required, &mut self.rms_m)
    }
}

const END_COLUMNS: [&str; 4] = ["x0_m", "y0_m", "x1_m", "y1_m"];
const COVARIANCE_COLUMNS: [&str; 3] = ["cov_dd", "cov_da", "cov_aa"];
