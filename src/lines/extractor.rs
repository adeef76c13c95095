//! What all extractors for general scenes have in common: scan in, segments out.
//!
//! An extractor decides which beams lie on one line; [`super::assembly`] makes segments of its
//! decisions, the same way for all of them, and keeps account of what became of each beam.

use super::fit::{Estimator, Loss};
use super::segmentation::SegmentationOptions;
use crate::record::{NormalLine, Scan, Segment};

/// Finds the straight lines of scans. Implementations keep their buffers from scan to scan, but no
/// knowledge: the same scan gives the same lines, whatever came before it, unless
/// [`Extractor::expect`] was called.
pub trait Extractor {
    /// Finds the lines of `scan`, in the order of their first beams, in place of what `out` held.
    fn extract(&mut self, scan: &Scan, out: &mut Vec<Segment>);

    /// What became of each beam of the scan extracted last; empty unless
    /// [`ExtractorOptions::explain`] is set.
    fn fates(&self) -> &[Fate];

    /// Tells which lines are to be expected in the scans that follow: for methods that look around
    /// a prediction only, and for the segmentation that needs to know how surfaces run. Others
    /// take no notice.
    fn expect(&mut self, _lines: &[NormalLine]) {}
}

/// Settings of all extractors for general scenes. The defaults suit an LMS500.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExtractorOptions {
    /// What returns are, and where a scan is cut. Its `sigma_m` is the noise for everything.
    pub segmentation: SegmentationOptions,
    /// How a line is fitted to its beams.
    pub estimator: Estimator,
    /// What large residuals count for in the final fit.
    pub loss: Loss,
    /// Beams this many sigmas off the final line are left out.
    pub trim_sigmas: f64,
    /// Fewest beams on a line.
    pub min_points: usize,
    /// Shortest line, m.
    pub min_length_m: f64,
    /// Seed of the methods that draw at random.
    pub seed: u64,
    /// Whether to keep account of every beam.
    pub explain: bool,
}

impl Default for ExtractorOptions {
    fn default() -> Self {
        ExtractorOptions {
            segmentation: SegmentationOptions::default(),
            estimator: Estimator::default(),
            loss: Loss::default(),
            trim_sigmas: 3.5,
            min_points: 9,
            min_length_m: 0.5,
            seed: 1,
            explain: false,
        }
    }
}

/// What became of a beam.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Fate {
    /// It returned nothing, or a range outside the limits.
    #[default]
    NoReturn,
    /// It stands alone in front of or behind both its neighbours.
    Spike,
    /// No line was found where it is.
    Unused,
    /// It belongs to a run, but lies too far off the run's line.
    OffLine,
    /// Its run has too few beams.
    FewBeams,
    /// Its run is too short.
    TooShort,
    /// It lies on this line of the scan.
    OnLine(u32),
}

impl Fate {
    /// The word in a column.
    pub fn name(self) -> &'static str {
        match self {
            Fate::NoReturn => "no-return",
            Fate::Spike => "spike",
            Fate::Unused => "unused",
            Fate::OffLine => "off-line",
            Fate::FewBeams => "few-beams",
            Fate::TooShort => "too-short",
            Fate::OnLine(_) => "line",
        }
    }

    /// The line that the beam lies on.
    pub fn line(self) -> Option<u32> {
        match self {
            Fate::OnLine(line) => Some(line),
            _ => None,
        }
    }
}
