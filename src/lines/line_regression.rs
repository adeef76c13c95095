//! Line regression (after Arras & Siegwart 1997): a line through every window of neighbouring
//! beams; where the lines of neighbouring windows agree, they are one.
//!
//! Two windows that touch are compared by the Mahalanobis distance of their lines. For maximum
//! likelihood lines that is the chi-square which a common line costs more, and prefix sums give it
//! in O(1). Beams of windows that agree make a run; runs that overlap at a corner are parted where
//! both sides fit best.

use super::cutting::{Cutter, Cutting};
use super::extractor::ExtractorOptions;
use super::fit::{BeamSlice, PrefixSums};
use super::runs::{MergeRule, Runs};
use crate::record::Scan;

/// Settings of the extractor. The defaults suit an LMS500.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LineRegressionOptions {
    /// What all extractors share.
    pub common: ExtractorOptions,
    /// Beams of a window.
    pub window: usize,
    /// Squared Mahalanobis distance up to which two windows' lines agree.
    pub agree_chi2: f64,
    /// Chi-square by which a common line may be worse than two, for runs to be joined.
    pub merge_chi2: f64,
}

impl Default for LineRegressionOptions {
    fn default() -> Self {
        LineRegressionOptions {
            common: ExtractorOptions::default(),
            window: 5,
            agree_chi2: 13.8,
            merge_chi2: 13.8,
        }
    }
}

/// The extractor.
pub type LineRegression = Cutting<Windows>;

/// Makes runs of the windows of a group that agree.
#[derive(Clone, Debug, Default)]
pub struct Windows {
    options: LineRegressionOptions,
    prefix: PrefixSums,
    /// Runs of the group at hand.
    found: Vec<(usize, usize)>,
}

impl Cutter for Windows {
    type Options = LineRegressionOptions;

    fn new(options: LineRegressionOptions) -> Windows {
        Windows {
            options,
            ..Windows::default()
        }
    }

    fn common(&self) -> &ExtractorOptions {
        &self.options.common
    }

    fn merge_rule(&self, scan: &Scan) -> MergeRule {
        MergeRule::new(self.options.merge_chi2, &self.options.common, scan)
    }

    fn cut(&mut self, group: BeamSlice<'_>, offset: usize, runs: &mut Runs) {
        let n = group.len();
        let window = self.options.window.max(2);
        if n < 2 * window {
            return;
        }
        self.prefix.read(group);
        let prefix = &self.prefix;
        let variance_m2 = self.options.common.segmentation.sigma_m.powi(2);
        let limit_m2 = self.options.agree_chi2 * variance_m2;
        // A window on a corner or on clutter is no line at all, whatever its neighbours say.
        let straight_m2 = variance_m2 * straight_chi2((window - 2) as f64);
        let agrees = |k: usize| {
            let (middle, end) = (k + window, k + 2 * window);
            let (left_m2, right_m2) = (prefix.cost_m2(k, middle), prefix.cost_m2(middle, end));
            left_m2 <= straight_m2
                && right_m2 <= straight_m2
                && prefix.cost_m2(k, end) - left_m2 - right_m2 <= limit_m2
        };
        self.found.clear();
        let mut from = None;
        for k in 0..=n - 2 * window + 1 {
            let here = k <= n - 2 * window && agrees(k);
            match from {
                None if here => from = Some(k),
                Some(first) if !here => {
                    self.found.push((first, k - 1 + 2 * window));
                    from = None;
                }
                _ => {}
            }
        }
        for i in 1..self.found.len() {
            let ((a, end), (start, b)) = (self.found[i - 1], self.found[i]);
            if start < end {
                let cost_m2 = |k: &usize| prefix.cost_m2(a, *k) + prefix.cost_m2(*k, b);
                let border = (start.max(a + 1)..=end.min(b - 1))
                    .min_by(|x, y| cost_m2(x).total_cmp(&cost_m2(y)))
                    .unwrap_or(start);
                (self.found[i - 1].1, self.found[i].0) = (border, border);
            }
        }
        for (from, to) in &self.found {
            if from < to {
                let sums = prefix.between(*from, *to);
                runs.push(offset + from, offset + to, sums);
            }
        }
    }
}

/// Chi-square that a straight window exceeds once in some thousand times (Wilson & Hilferty).
fn straight_chi2(degrees: f64) -> f64 {
    let spread = 2.0 / (9.0 * degrees.max(1.0));
    degrees.max(1.0) * (1.0 - spread + 3.3 * spread.sqrt()).powi(3)
}
