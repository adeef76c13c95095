//! The beams that no line has taken yet: what methods that find one line at a time draw from.
//!
//! Such a method (a Hough transform, random samples, expectation maximisation) comes with a line
//! that many beams agree with, of which nobody knows where it ends. [`Pool::take`] looks along it,
//! finds the longest row of beams that follow each other on it, fits that row, looks again, and
//! hands the row over as a segment. A row goes on behind what stands in front of the line, and ends
//! where a gap is too wide or where beams pass through.

use super::assembly::Assembly;
use super::extractor::ExtractorOptions;
use super::fit::{InverseLine, InverseRangeSums};
use super::segmentation::Returns;
use crate::record::Segment;
use std::ops::Range;

/// The free beams of a scan; keeps its buffers from scan to scan.
#[derive(Clone, Debug, Default)]
pub struct Pool {
    free: Vec<bool>,
    runs: Vec<Range<usize>>,
    row: Vec<Range<usize>>,
    /// Sums over the row's beams before each beam.
    prefix: Vec<InverseRangeSums>,
}

/// Fewest beams that count as a run on a line: the beams that cross it elsewhere come in ones and
/// twos.
const RUN: usize = 3;
/// Beams that pass through a line between two runs which tell that they are not one row.
const THROUGH: usize = 2;
/// Two lines in place of one must lower chi-square by this much.
const KINK_CHI2: f64 = 25.0;
/// Fewest beams on either side of a kink.
const KINK_BEAMS: usize = 5;
/// Looks along a line.
const LOOKS: usize = 4;

impl Pool {
    /// Frees all beams.
    pub fn begin(&mut self, returns: &Returns) {
        self.free.clear();
        self.free.resize(returns.beams().len(), true);
    }

    /// Whether no line has taken a beam.
    #[inline]
    pub fn is_free(&self, beam: usize) -> bool {
        self.free[beam]
    }

    /// How many of these beams are free.
    pub fn count(&self, beams: Range<usize>) -> usize {
        self.free[beams].iter().filter(|free| **free).count()
    }

    /// Takes the beams of the longest row on a line that lies within `reach_m` of `line`, and adds
    /// its segment. Tells whether there was one.
    pub fn take(
        &mut self,
        returns: &Returns,
        line: InverseLine,
        reach_m: f64,
        options: &ExtractorOptions,
        assembly: &mut Assembly,
        out: &mut Vec<Segment>,
    ) -> bool {
        let fine_m = options.trim_sigmas * options.segmentation.sigma_m;
        let beams = returns.beams();
        let mut line = line;
        let mut across_m = reach_m + fine_m;
        let mut found = 0;
        for look in 0..LOOKS {
            self.find_row(returns, line, across_m, look == 0, options);
            let count: usize = self.row.iter().map(ExactSizeIterator::len).sum();
            if count < options.min_points {
                return false;
            }
            if look > 1 && count == found {
                break;
            }
            found = count;
            let mut sums = InverseRangeSums::default();
            for k in self.row.iter().cloned().flatten() {
                sums.add(beams.range_m[k], beams.y_m[k], beams.z_m[k], 1.0);
            }
            let Some(better) = sums.line() else {
                return false;
            };
            line = better;
            across_m = fine_m;
        }
        if let Some(better) = self.cut_at_kinks(returns, options) {
            line = better;
        }
        let before = out.len();
        assembly.add(returns, self.row.iter().cloned(), Some(line), options, out);
        if out.len() == before {
            return false;
        }
        for k in self.row.drain(..).flatten() {
            self.free[k] = false;
        }
        true
    }

    /// Cuts the row where two lines explain its beams much better than one, as at a door that lies a
    /// little deeper than the wall, and keeps the part with more beams; its line, if there was
    /// something to cut.
    fn cut_at_kinks(
        &mut self,
        returns: &Returns,
        options: &ExtractorOptions,
    ) -> Option<InverseLine> {
        let beams = returns.beams();
        self.prefix.clear();
        let mut sums = InverseRangeSums::default();
        self.prefix.push(sums);
        for k in self.row.iter().cloned().flatten() {
            sums.add(beams.range_m[k], beams.y_m[k], beams.z_m[k], 1.0);
            self.prefix.push(sums);
        }
        let enough_m2 = KINK_CHI2 * options.segmentation.sigma_m.powi(2);
        let sums = |a: usize, b: usize| self.prefix[b].minus(&self.prefix[a]);
        let count = self.prefix.len() - 1;
        let (mut from, mut to) = (0, count);
        while to - from >= 2 * KINK_BEAMS {
            let parts_m2 = |k: usize| sums(from, k).cost_m2() + sums(k, to).cost_m2();
            let (kink, cost_m2) = (from + KINK_BEAMS..=to - KINK_BEAMS)
                .map(|k| (k, parts_m2(k)))
                .min_by(|a, b| a.1.total_cmp(&b.1))?;
            if sums(from, to).cost_m2() - cost_m2 <= enough_m2 {
                break;
            }
            if kink - from >= to - kink {
                to = kink;
            } else {
                from = kink;
            }
        }
        if to - from == count {
            return None;
        }
        let line = sums(from, to).line();
        let mut passed = 0;
        for run in &mut self.row {
            let (first, length) = (passed, run.len());
            passed += length;
            let start = run.start + from.saturating_sub(first).min(length);
            run.end = run.start + to.saturating_sub(first).min(length);
            run.start = start.min(run.end);
        }
        self.row.retain(|run| !run.is_empty());
        line
    }

    /// The row with the most beams on a line. A beam is on it where it is within `limit_m`: of the
    /// line, if `across`, else in range.
    fn find_row(
        &mut self,
        returns: &Returns,
        line: InverseLine,
        limit_m: f64,
        across: bool,
        options: &ExtractorOptions,
    ) {
        let beams = returns.beams();
        let d_m = line.d_m();
        self.runs.clear();
        let mut from = None;
        for k in 0..=beams.len() {
            let on = k < beams.len() && self.free[k] && {
                let (r, y, z) = (beams.range_m[k], beams.y_m[k], beams.z_m[k]);
                let off = line.a * y + line.b * z - 1.0;
                off.abs() * if across { d_m } else { r } <= limit_m
            };
            match (on, from) {
                (true, None) => from = Some(k),
                (false, Some(first)) => {
                    if k - first >= RUN {
                        self.runs.push(first..k);
                    }
                    from = None;
                }
                _ => {}
            }
        }
        self.begin_at_a_break(returns, line, limit_m, options);
        let (mut best, mut most) = (0..0, 0);
        let (mut first, mut count) = (0, 0);
        for i in 0..self.runs.len() {
            if i > 0 && !self.goes_on(returns, line, [i - 1, i], limit_m, options) {
                (first, count) = (i, 0);
            }
            count += self.runs[i].len();
            if count > most {
                (best, most) = (first..i + 1, count);
            }
        }
        self.row.clear();
        self.row.extend_from_slice(&self.runs[best]);
    }

    /// Where a scanner sees all round and a row goes on behind the last beam, lets the runs begin
    /// elsewhere.
    fn begin_at_a_break(
        &mut self,
        returns: &Returns,
        line: InverseLine,
        limit_m: f64,
        options: &ExtractorOptions,
    ) {
        let last = self.runs.len().saturating_sub(1);
        if last == 0
            || !returns.is_all_round()
            || !self.goes_on(returns, line, [last, 0], limit_m, options)
        {
            return;
        }
        let at_break = |i: &usize| !self.goes_on(returns, line, [i - 1, *i], limit_m, options);
        if let Some(first) = (1..=last).find(at_break) {
            self.runs.rotate_left(first);
        } else {
            // One row: it begins behind its widest gap.
            let gap = |i: &usize| self.runs[*i].start - self.runs[i - 1].end;
            let first = (1..=last).max_by_key(gap).unwrap_or(0);
            self.runs.rotate_left(first);
        }
    }

    /// Whether two runs that follow each other are of one row.
    fn goes_on(
        &self,
        returns: &Returns,
        line: InverseLine,
        [before, after]: [usize; 2],
        limit_m: f64,
        options: &ExtractorOptions,
    ) -> bool {
        let beams = returns.beams();
        let (end, start) = (self.runs[before].end - 1, self.runs[after].start);
        let gap_m = (beams.y_m[start] - beams.y_m[end]).hypot(beams.z_m[start] - beams.z_m[end]);
        if gap_m > options.segmentation.max_gap_m {
            return false;
        }
        let passes = |k: &usize| {
            let (r, y, z) = (beams.range_m[*k], beams.y_m[*k], beams.z_m[*k]);
            line.residual_m(r, y, z) > limit_m.max(0.1)
        };
        let through = if start > end {
            (end + 1..start).filter(passes).count()
        } else {
            (end + 1..beams.len())
                .chain(0..start)
                .filter(passes)
                .count()
        };
        through < THROUGH
    }
}
