//! Runs of beams on one line each, joined to chains where one line explains them together.

use super::extractor::ExtractorOptions;
use super::fit::{InverseLine, InverseRangeSums, PrefixSums};
use super::segmentation::Returns;
use crate::record::Scan;
use std::ops::Range;

/// Beams on one line; a chain of runs where something stands in front of it.
#[derive(Clone, Copy, Debug)]
pub struct Run {
    /// First beam, an index among the returns.
    pub from: usize,
    /// Behind the last beam.
    pub to: usize,
    /// Sums over the whole chain.
    pub sums: InverseRangeSums,
    /// Beams of the whole chain.
    beams: usize,
    /// Sum of squared residuals of the whole chain, m^2.
    pub cost_m2: f64,
    /// End of the chain's last run.
    chain_end: usize,
    /// The chain's last run.
    last: usize,
    next: Option<usize>,
    absorbed: bool,
}

impl Run {
    fn new(from: usize, to: usize, sums: InverseRangeSums, index: usize) -> Run {
        Run {
            from,
            to,
            sums,
            beams: to - from,
            cost_m2: sums.cost_m2(),
            chain_end: to,
            last: index,
            next: None,
            absorbed: false,
        }
    }
}

/// What may be joined.
#[derive(Clone, Copy, Debug)]
pub struct MergeRule {
    /// Chi-square by which a common line may be worse than two.
    pub chi2: f64,
    /// Standard deviation of a range, m.
    pub sigma_m: f64,
    /// Widest gap, m.
    pub max_gap_m: f64,
    /// Angle between beams, rad.
    pub step_rad: f64,
}

impl MergeRule {
    /// Joins what chi-square allows at the noise and gap of `options`.
    pub fn new(chi2: f64, options: &ExtractorOptions, scan: &Scan) -> MergeRule {
        MergeRule {
            chi2,
            sigma_m: options.segmentation.sigma_m,
            max_gap_m: options.segmentation.max_gap_m,
            step_rad: scan.angle_increment_rad.abs(),
        }
    }
}

/// A scan's runs in beam order.
#[derive(Clone, Debug, Default)]
pub struct Runs {
    list: Vec<Run>,
}

impl Runs {
    /// Forgets all runs.
    pub fn clear(&mut self) {
        self.list.clear();
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.list.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// The run with the given number.
    pub fn get(&self, index: usize) -> &Run {
        &self.list[index]
    }

    /// Adds a run behind the others.
    pub fn push(&mut self, from: usize, to: usize, sums: InverseRangeSums) {
        let index = self.list.len();
        self.list.push(Run::new(from, to, sums, index));
    }

    /// Changes a run that has not been joined to any.
    pub fn replace(&mut self, index: usize, from: usize, to: usize, sums: InverseRangeSums) {
        self.list[index] = Run::new(from, to, sums, index);
    }

    /// Moves the borders between the runs from `first_run` on, which touch each other and lie in
    /// one group starting at `offset`, to where both sides fit best.
    pub fn settle_borders(&mut self, first_run: usize, offset: usize, prefix: &PrefixSums) {
        for index in first_run + 1..self.list.len() {
            let (before, after) = (self.list[index - 1], self.list[index]);
            let (a, b) = (before.from - offset, after.to - offset);
            let start = after.from - offset;
            let cost_m2 = |k: usize| prefix.cost_m2(a, k) + prefix.cost_m2(k, b);
            let mut border = start;
            let mut best_m2 = before.cost_m2 + after.cost_m2;
            for step in [-1isize, 1] {
                let mut tried = border;
                let mut patience = BORDER_PATIENCE;
                while patience > 0 {
                    tried = tried.wrapping_add_signed(step);
                    if tried <= a || tried >= b {
                        break;
                    }
                    let here_m2 = cost_m2(tried);
                    if here_m2 < best_m2 {
                        best_m2 = here_m2;
                        border = tried;
                        patience = BORDER_PATIENCE;
                    } else {
                        patience -= 1;
                    }
                }
            }
            if border != start {
                let (left, right) = (prefix.between(a, border), prefix.between(border, b));
                self.replace(index - 1, before.from, offset + border, left);
                self.replace(index, offset + border, after.to, right);
            }
        }
    }

    /// The chains: the line of each, and the beams of its runs.
    pub fn chains(
        &self,
    ) -> impl Iterator<
        Item = (
            Option<InverseLine>,
            impl Iterator<Item = Range<usize>> + Clone,
        ),
    > {
        let heads = self
            .list
            .iter()
            .enumerate()
            .filter(|(_, run)| !run.absorbed);
        heads.map(|(index, head)| {
            let chain = std::iter::successors(Some(index), |i| self.list[*i].next);
            let runs = chain.map(|i| self.list[i].from..self.list[i].to);
            (head.sums.line(), runs)
        })
    }

    /// Joins runs that one line explains, also over what stands in front of it.
    pub fn merge(&mut self, returns: &Returns, rule: &MergeRule) {
        let runs = self.list.len();
        let reach = if returns.is_all_round() { runs } else { 0 };
        for head in 0..runs {
            if self.list[head].absorbed {
                continue;
            }
            for other in head + 1..runs + reach {
                let other = if other < runs { other } else { other - runs };
                if other == head || !self.may_continue(head, other, returns, rule) {
                    break;
                }
                if !self.list[other].absorbed && self.is_one_line(head, other, returns, rule) {
                    self.join(head, other);
                }
            }
        }
    }

    /// Whether a run that starts as far round as `other` may still continue `head` within the
    /// largest gap.
    fn may_continue(&self, head: usize, other: usize, returns: &Returns, rule: &MergeRule) -> bool {
        let beams = returns.beams();
        let (end, start) = (self.list[head].chain_end - 1, self.list[other].from);
        let near = rule.max_gap_m / beams.range_m[end];
        if near >= 1.0 || start < end {
            return near >= 1.0 || returns.is_all_round();
        }
        let steps = returns.beam(start).saturating_sub(returns.beam(end));
        // An arc is longer than its sine; a few beams too many only cost time.
        f64::from(steps) * rule.step_rad <= near * std::f64::consts::FRAC_PI_2
    }

    fn is_one_line(&self, head: usize, other: usize, returns: &Returns, rule: &MergeRule) -> bool {
        let (a, b) = (&self.list[head], &self.list[other]);
        if a.beams.max(b.beams) < MERGE_EVIDENCE {
            return false;
        }
        let beams = returns.beams();
        let (end, start) = (a.chain_end - 1, b.from);
        let (dy_m, dz_m) = (
            beams.y_m[start] - beams.y_m[end],
            beams.z_m[start] - beams.z_m[end],
        );
        if dy_m * dy_m + dz_m * dz_m > rule.max_gap_m * rule.max_gap_m {
            return false;
        }
        let more_m2 = a.sums.plus(&b.sums).cost_m2() - a.cost_m2 - b.cost_m2;
        more_m2 < rule.chi2 * rule.sigma_m * rule.sigma_m
    }

    fn join(&mut self, head: usize, other: usize) {
        let tail = self.list[other];
        self.list[other].absorbed = true;
        let last = self.list[head].last;
        self.list[last].next = Some(other);
        let run = &mut self.list[head];
        run.sums = run.sums.plus(&tail.sums);
        run.cost_m2 = run.sums.cost_m2();
        run.beams += tail.beams;
        run.chain_end = tail.chain_end;
        run.last = tail.last;
    }
}

/// Beams without a gain after which a border stays.
const BORDER_PATIENCE: usize = 3;
/// Beams that one of two runs must have before they may be merged.
const MERGE_EVIDENCE: usize = 4;
