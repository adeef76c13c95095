//! Incremental, or line tracking: a line grows beam by beam until one does not fit.
//!
//! The test is whether chi-square grows by more than the square of a number of sigmas, which is the
//! residual of the new beam in units of its own and the line's uncertainty together, so that a line
//! through two beams is not held to its extrapolation (Kurniawan 2017, section 4.3.2, compares the
//! distance alone). Running sums make it one pass at a constant cost a beam.

use super::cutting::{Cutter, Cutting};
use super::extractor::ExtractorOptions;
use super::fit::{BeamSlice, PrefixSums};
use super::runs::{MergeRule, Runs};
use crate::record::Scan;

/// Settings of the extractor. The defaults suit an LMS500.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IncrementalOptions {
    /// What all extractors share.
    pub common: ExtractorOptions,
    /// A beam this many sigmas off the line so far begins the next one.
    pub end_sigmas: f64,
    /// Chi-square by which a common line may be worse than two, for runs to be joined.
    pub merge_chi2: f64,
}

impl Default for IncrementalOptions {
    fn default() -> Self {
        IncrementalOptions {
            common: ExtractorOptions::default(),
            end_sigmas: 3.5,
            merge_chi2: 13.8,
        }
    }
}

/// The extractor.
pub type Incremental = Cutting<Tracking>;

/// Cuts a group where a line that grows beam by beam ends.
#[derive(Clone, Debug, Default)]
pub struct Tracking {
    options: IncrementalOptions,
    prefix: PrefixSums,
}

impl Cutter for Tracking {
    type Options = IncrementalOptions;

    fn new(options: IncrementalOptions) -> Tracking {
        Tracking {
            options,
            ..Tracking::default()
        }
    }

    fn common(&self) -> &ExtractorOptions {
        &self.options.common
    }

    fn merge_rule(&self, scan: &Scan) -> MergeRule {
        MergeRule::new(self.options.merge_chi2, &self.options.common, scan)
    }

    fn cut(&mut self, group: BeamSlice<'_>, offset: usize, runs: &mut Runs) {
        let first_run = runs.len();
        self.prefix.read(group);
        let limit_m = self.options.end_sigmas * self.options.common.segmentation.sigma_m;
        let mut from = 0;
        let mut cost_m2 = 0.0;
        for to in 1..=group.len() {
            let next_m2 = self.prefix.cost_m2(from, to);
            if next_m2 - cost_m2 > limit_m * limit_m {
                let sums = self.prefix.between(from, to - 1);
                runs.push(offset + from, offset + to - 1, sums);
                from = to - 1;
                cost_m2 = 0.0;
            } else {
                cost_m2 = next_m2;
            }
        }
        let sums = self.prefix.between(from, group.len());
        runs.push(offset + from, offset + group.len(), sums);
        // Behind a corner the line goes on for as long as it takes to notice.
        runs.settle_borders(first_run, offset, &self.prefix);
    }
}
