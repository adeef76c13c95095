//! What became of each beam when lines were looked for: `extract-lines --explain`.

use super::columns::columns;
use super::time::Stamp;

/// One beam of a scan, and why it is on a line or on none.
#[derive(Clone, Debug, PartialEq)]
pub struct BeamFate {
    /// Stamp of the scan.
    pub stamp: Stamp,
    /// Sequence number of the scan.
    pub seq: u32,
    /// Which beam, counted from 0.
    pub beam: u32,
    /// Angle of the beam, rad.
    pub angle_rad: f64,
    /// Its range, m; infinite or NaN as in the scan.
    pub range_m: f64,
    /// What became of it, in a word: line, no-return, spike, off-line, few-beams, too-short,
    /// unused.
    pub fate: String,
    /// The line that it is on, counted from 0 in beam order.
    pub line: Option<u32>,
}

impl Default for BeamFate {
    fn default() -> Self {
        BeamFate {
            stamp: Stamp::default(),
            seq: 0,
            beam: 0,
            angle_rad: f64::NAN,
            range_m: f64::NAN,
            fate: String::new(),
            line: None,
        }
    }
}

columns!(BeamFate, kind = "beam", stamp = stamp, {
    Required "stamp_ns" => stamp;
    Required "seq" => seq;
    Required "beam" => beam;
    Required "angle_rad" => angle_rad;
    Required "range_m" => range_m;
    Required "fate" => fate;
    Optional "line" => line;
});
