//! From beams on one line to a segment: what every extractor for general scenes ends with.
//!
//! Beams that lie too far off are left out, the rest is cut where the gap between neighbours is too
//! wide, and every piece that is long enough is fitted.

use super::extractor::{ExtractorOptions, Fate};
use super::fit::{self, BeamSlice, Beams, InverseLine, InverseRangeSums};
use super::runs::Runs;
use super::segmentation::{Cut, Returns};
use crate::record::{Scan, Segment, Stamp};
use std::ops::Range;

/// Makes a scan's segments; keeps its buffers from scan to scan.
///
/// [`Assembly::begin`] with the scan's returns, [`Assembly::add`] once a line, [`Assembly::end`];
/// or [`Assembly::add_all`] where there are [`Runs`].
#[derive(Clone, Debug, Default)]
pub struct Assembly {
    /// The beams of the line at hand, and where they are among the returns.
    kept: Beams,
    kept_at: Vec<u32>,
    fates: Vec<Fate>,
    /// Where the line with the given number went when lines were put in order.
    order: Vec<u32>,
    stamp: Stamp,
    seq: u32,
}

impl Assembly {
    /// Makes the segments of a scan from its chains of runs, in place of what `out` held.
    pub fn add_all(
        &mut self,
        scan: &Scan,
        returns: &Returns,
        runs: &Runs,
        options: &ExtractorOptions,
        out: &mut Vec<Segment>,
    ) {
        out.clear();
        self.begin(scan, returns, options);
        for (line, chain) in runs.chains() {
            self.add(returns, chain, line, options, out);
        }
        self.end(out);
    }

    /// Begins a scan whose returns have been read; forgets the one before.
    pub fn begin(&mut self, scan: &Scan, returns: &Returns, options: &ExtractorOptions) {
        self.stamp = scan.stamp;
        self.seq = scan.seq;
        self.fates.clear();
        if options.explain {
            self.fates.resize(scan.beams(), Fate::NoReturn);
            for beam in returns.spikes() {
                self.fates[*beam as usize] = Fate::Spike;
            }
            for k in 0..returns.beams().len() {
                self.fates[returns.beam(k) as usize] = Fate::Unused;
            }
        }
    }

    /// Adds the line through the returns of `runs`, which follow each other along it; or its
    /// pieces where the beams left are too far apart, or nothing where they are too few or too
    /// short. `start` is the extractor's own idea of the line, by default the best one through all
    /// of its beams.
    pub fn add(
        &mut self,
        returns: &Returns,
        runs: impl Iterator<Item = Range<usize>> + Clone,
        start: Option<InverseLine>,
        options: &ExtractorOptions,
        out: &mut Vec<Segment>,
    ) {
        if start.is_some_and(|line| self.add_whole(returns, runs.clone(), line, options, out)) {
            return;
        }
        self.collect(returns, runs.clone());
        let start = start.or_else(|| self.kept.all().iter().collect::<InverseRangeSums>().line());
        let Some(line) = start.and_then(|line| self.keep_inliers(returns, runs, line, options))
        else {
            return;
        };
        let kept = std::mem::take(&mut self.kept);
        let beams = kept.all();
        let max_gap_m = options.segmentation.max_gap_m;
        let mut from = 0;
        if widest_gap_m(beams, line) > max_gap_m {
            for k in 1..beams.len() {
                if widest_gap_m(beams.run(k - 1, k + 1), line) > max_gap_m {
                    self.add_piece(returns, beams, from..k, line, options, out);
                    from = k;
                }
            }
        }
        self.add_piece(returns, beams, from..beams.len(), line, options, out);
        self.kept = kept;
    }

    /// Adds the line through a single run of which no beam lies too far off: most lines, and nothing
    /// has to be copied. Tells whether that was so.
    fn add_whole(
        &mut self,
        returns: &Returns,
        mut runs: impl Iterator<Item = Range<usize>>,
        line: InverseLine,
        options: &ExtractorOptions,
        out: &mut Vec<Segment>,
    ) -> bool {
        let (Some(run), None) = (runs.next(), runs.next()) else {
            return false;
        };
        let beams = returns.beams().run(run.start, run.end);
        let limit_m = options.trim_sigmas * options.segmentation.sigma_m;
        // These cuts leave no gap inside a group.
        let close = matches!(options.segmentation.cut, Cut::Adaptive | Cut::Jump);
        if beams.len() < options.min_points
            || !line.is_within(limit_m, beams)
            || !(close || widest_gap_m(beams, line) <= options.segmentation.max_gap_m)
        {
            return false;
        }
        let first = run.start as u32;
        let fate = match self.segment(beams, line, options) {
            Some(segment) => {
                out.push(Segment {
                    line: first,
                    ..segment
                });
                Fate::OnLine(first)
            }
            None => Fate::TooShort,
        };
        self.judge(returns, run, fate);
        true
    }

    /// Lines up the beams of `runs`.
    fn collect(&mut self, returns: &Returns, runs: impl Iterator<Item = Range<usize>>) {
        let beams = returns.beams();
        self.kept.clear();
        self.kept_at.clear();
        for run in runs {
            self.kept.extend(beams.run(run.start, run.end));
            self.kept_at.extend(run.start as u32..run.end as u32);
        }
    }

    /// Ends the scan: numbers the lines in the order of their first beams.
    pub fn end(&mut self, out: &mut [Segment]) {
        // Until here `line` is the first beam's index among the returns.
        out.sort_unstable_by_key(|segment| segment.line);
        if !self.fates.is_empty() {
            self.order.clear();
            self.order.extend(out.iter().map(|segment| segment.line));
            for fate in &mut self.fates {
                if let Fate::OnLine(line) = fate {
                    *line = self.order.partition_point(|first| first < line) as u32;
                }
            }
        }
        for (line, segment) in out.iter_mut().enumerate() {
            segment.line = line as u32;
        }
    }

    /// What became of each beam; empty unless asked for.
    pub fn fates(&self) -> &[Fate] {
        &self.fates
    }

    /// Keeps the beams that lie within the trim limit of their line, which moves with them.
    fn keep_inliers(
        &mut self,
        returns: &Returns,
        runs: impl Iterator<Item = Range<usize>> + Clone,
        start: InverseLine,
        options: &ExtractorOptions,
    ) -> Option<InverseLine> {
        let limit_m = options.trim_sigmas * options.segmentation.sigma_m;
        let enough = |beams: usize| beams >= options.min_points;
        // Most lines lose nothing.
        if start.is_within(limit_m, self.kept.all()) {
            if enough(self.kept_at.len()) {
                return Some(start);
            }
            self.judge(returns, runs.flatten(), Fate::FewBeams);
            return None;
        }
        let beams = returns.beams();
        let mut line = start;
        let mut before = 0;
        for _ in 0..TRIM_ROUNDS {
            self.kept.clear();
            self.kept_at.clear();
            let mut sums = InverseRangeSums::default();
            for k in runs.clone().flatten() {
                let (r, y, z) = (beams.range_m[k], beams.y_m[k], beams.z_m[k]);
                if line.residual_m(r, y, z).abs() <= limit_m {
                    self.kept.push_point(r, y, z);
                    self.kept_at.push(k as u32);
                    sums.add(r, y, z, 1.0);
                }
            }
            if !enough(self.kept_at.len()) {
                self.judge(returns, runs.flatten(), Fate::FewBeams);
                return None;
            }
            line = sums.line()?;
            if self.kept_at.len() == before {
                break;
            }
            before = self.kept_at.len();
        }
        self.judge(returns, runs.flatten(), Fate::OffLine);
        Some(line)
    }

    fn add_piece(
        &mut self,
        returns: &Returns,
        kept: BeamSlice<'_>,
        piece: Range<usize>,
        start: InverseLine,
        options: &ExtractorOptions,
        out: &mut Vec<Segment>,
    ) {
        let beams = kept.run(piece.start, piece.end);
        let first = self.kept_at[piece.start];
        let fate = if beams.len() < options.min_points {
            Fate::FewBeams
        } else {
            match self.segment(beams, start, options) {
                Some(segment) => {
                    out.push(Segment {
                        line: first,
                        ..segment
                    });
                    Fate::OnLine(first)
                }
                None => Fate::TooShort,
            }
        };
        if !self.fates.is_empty() {
            for k in piece {
                self.fates[returns.beam(self.kept_at[k] as usize) as usize] = fate;
            }
        }
    }

    fn segment(
        &self,
        piece: BeamSlice<'_>,
        start: InverseLine,
        options: &ExtractorOptions,
    ) -> Option<Segment> {
        let sigma_m = options.segmentation.sigma_m;
        let line = fit::fit_near(start, piece, sigma_m, options.estimator, options.loss)?;
        let (sin, cos) = line.normal.alpha_rad.sin_cos();
        // Where the beam through a point meets the line.
        let on_line = |y_m: &f64, z_m: &f64| {
            let scale = line.normal.d_m / (y_m * cos + z_m * sin);
            [y_m * scale, z_m * scale]
        };
        let ends_m = [
            on_line(piece.y_m.first()?, piece.z_m.first()?),
            on_line(piece.y_m.last()?, piece.z_m.last()?),
        ];
        let length_m = (ends_m[1][0] - ends_m[0][0]).hypot(ends_m[1][1] - ends_m[0][1]);
        (length_m >= options.min_length_m).then_some(Segment {
            stamp: self.stamp,
            seq: self.seq,
            line: 0,
            normal: line.normal,
            ends_m,
            points: line.points,
            covariance: [line.cov_dd, line.cov_da, line.cov_aa],
            rms_m: line.rms_m,
        })
    }

    fn judge(&mut self, returns: &Returns, beams: impl Iterator<Item = usize>, fate: Fate) {
        if !self.fates.is_empty() {
            for k in beams {
                self.fates[returns.beam(k) as usize] = fate;
            }
        }
    }
}

const TRIM_ROUNDS: usize = 4;

/// Widest gap between neighbours along the line, m.
fn widest_gap_m(beams: BeamSlice<'_>, line: InverseLine) -> f64 {
    let Some(last) = beams.len().checked_sub(1) else {
        return 0.0;
    };
    let (before, after) = (beams.run(0, last), beams.run(1, last + 1));
    let mut widest = [0.0f64; LANES];
    let ((y0, y0_rest), (y1, y1_rest)) = (before.y_m.as_chunks(), after.y_m.as_chunks());
    let ((z0, z0_rest), (z1, z1_rest)) = (before.z_m.as_chunks(), after.z_m.as_chunks());
    let gap = |y0: f64, y1: f64, z0: f64, z1: f64| (line.a * (z1 - z0) - line.b * (y1 - y0)).abs();
    for ((y0, y1), (z0, z1)) in y0.iter().zip(y1).zip(z0.iter().zip(z1)) {
        let (y0, y1, z0, z1): (&[f64; LANES], &[f64; LANES], &[f64; LANES], &[f64; LANES]) =
            (y0, y1, z0, z1);
        for lane in 0..LANES {
            let gap = gap(y0[lane], y1[lane], z0[lane], z1[lane]);
            widest[lane] = if gap > widest[lane] {
                gap
            } else {
                widest[lane]
            };
        }
    }
    let rest = y0_rest.iter().zip(y1_rest).zip(z0_rest.iter().zip(z1_rest));
    for ((y0, y1), (z0, z1)) in rest {
        widest[0] = widest[0].max(gap(*y0, *y1, *z0, *z1));
    }
    widest.iter().fold(0.0f64, |a, b| a.max(*b)) / line.a.hypot(line.b)
}

const LANES: usize = 4;
