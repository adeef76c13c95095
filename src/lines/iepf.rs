//! Iterative end point fit (Ramer 1972, Douglas & Peucker 1973): a group is split at the point
//! farthest from the chord between its ends, again and again, until no point is far.
//!
//! Collinear neighbours are joined afterwards ([`super::runs`]), which makes it the split-and-merge
//! of the comparison by Nguyen et al. (2005); Kurniawan 2017, section 4.3.1.

use super::cutting::{Cutter, Cutting, halve};
use super::extractor::ExtractorOptions;
use super::fit::{BeamSlice, PrefixSums};
use super::runs::{MergeRule, Runs};
use super::split_and_merge::farthest_from_chord;
use crate::record::Scan;

/// Settings of the extractor. The defaults suit an LMS500.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IepfOptions {
    /// What all extractors share.
    pub common: ExtractorOptions,
    /// A run is split at a point that is this many sigmas off its chord.
    pub split_sigmas: f64,
    /// Chi-square by which a common line may be worse than two, for runs to be joined.
    pub merge_chi2: f64,
}

impl Default for IepfOptions {
    fn default() -> Self {
        IepfOptions {
            common: ExtractorOptions::default(),
            split_sigmas: 4.5,
            merge_chi2: 13.8,
        }
    }
}

/// The extractor.
pub type Iepf = Cutting<EndPoints>;

/// Cuts a group at the point farthest from its chord, again and again.
#[derive(Clone, Debug, Default)]
pub struct EndPoints {
    options: IepfOptions,
    prefix: PrefixSums,
    pending: Vec<(usize, usize)>,
}

impl Cutter for EndPoints {
    type Options = IepfOptions;

    fn new(options: IepfOptions) -> EndPoints {
        EndPoints {
            options,
            ..EndPoints::default()
        }
    }

    fn common(&self) -> &ExtractorOptions {
        &self.options.common
    }

    fn merge_rule(&self, scan: &Scan) -> MergeRule {
        MergeRule::new(self.options.merge_chi2, &self.options.common, scan)
    }

    fn cut(&mut self, group: BeamSlice<'_>, offset: usize, runs: &mut Runs) {
        self.prefix.read(group);
        let prefix = &self.prefix;
        let limit_m = self.options.split_sigmas * self.options.common.segmentation.sigma_m;
        let corner = |a: usize, b: usize| {
            let run = group.run(a, b);
            let farthest = farthest_from_chord(run);
            let is_corner = run.len() > 2 && from_chord_m(run, farthest) > limit_m;
            is_corner.then(|| (a + farthest).clamp(a + 1, b - 1))
        };
        halve(&mut self.pending, group.len(), corner, |a, b| {
            runs.push(offset + a, offset + b, prefix.between(a, b));
        });
    }
}

/// Distance of beam `k` from the chord between the run's ends, m.
fn from_chord_m(run: BeamSlice<'_>, k: usize) -> f64 {
    let last = run.len() - 1;
    let (y0, z0) = (run.y_m[0], run.z_m[0]);
    let (dy, dz) = (run.y_m[last] - y0, run.z_m[last] - z0);
    let (y, z) = (run.y_m[k] - y0, run.z_m[k] - z0);
    let chord_m = dy.hypot(dz);
    if chord_m > 0.0 {
        (y * dz - z * dy).abs() / chord_m
    } else {
        y.hypot(z)
    }
}
