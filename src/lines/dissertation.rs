//! The dissertation's way to the three reflector lines and the strips' ends (Kurniawan 2017, section
//! 4.4), so that its results can be redone:
//!
//! 1. the modified Hough transform finds right, upper and left line near those of the scan before;
//! 2. where they meet, in the corner points, the beams are told apart (eq. 4.22 and 4.23);
//! 3. beams too far from their line are left out: RANSAC with that line as its only sample;
//! 4. least squares give the lines, of y or z, whichever varies less along the line;
//! 5. the corner points are computed again from these lines;
//! 6. the beams on the upper line, put onto it, are cut where two are further apart than neighbours
//!    would be (eq. 4.19 to 4.21); the first and last beam of each segment bound a strip's edges.
//!
//! Steps 1 to 4 with another estimator are the modified Hough transform for three reflectors.

use super::fit::{self, Axis, BeamSlice, Beams, Estimator, Loss};
use super::hough::{ReflectorTransform, WindowSize};
use super::reflectors::cold_start::ColdStart;
use crate::frame::Frame;
use crate::record::{
    BeamTable, Edge, EdgeKind, Face, FittedLine, NormalLine, ReflectorLines, Scan,
};
use std::f64::consts::FRAC_PI_2;
use std::ops::Range;

/// Settings of the strategy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StrategyOptions {
    /// The windows of the transform.
    pub window: WindowSize,
    /// A beam further from its line is an outlier, m: the threshold distance of section 4.2.
    pub threshold_m: f64,
    /// Standard deviation of a range before residuals are known, m.
    pub sigma_m: f64,
    /// Fewest votes and beams that make a line.
    pub min_points: u32,
    /// What the lines are fitted by.
    pub estimator: Estimator,
    /// Two beams on the upper line are of one strip up to this many times the distance of
    /// neighbours.
    pub apart: f64,
    /// Whether to stop after step 1: the transform's best cells are the lines, as on the PC/104 that
    /// was too slow for the rest (Fig. 5.14).
    pub coarse: bool,
}

impl Default for StrategyOptions {
    fn default() -> Self {
        StrategyOptions {
            window: WindowSize::default(),
            threshold_m: 0.03,
            sigma_m: 0.0065,
            min_points: 8,
            estimator: Estimator::OrdinaryLeastSquares(Axis::Auto),
            apart: 1.5,
            coarse: false,
        }
    }
}

/// A strip of the upper face, by its middle.
#[derive(Clone, Copy, Debug)]
struct StripPlace {
    index: usize,
    middle_m: f64,
}

/// The strategy: its settings and buffers, and the lines of the scan before.
#[derive(Clone, Debug)]
pub struct Strategy {
    options: StrategyOptions,
    dy_m: f64,
    gap_m: Option<f64>,
    strips: Vec<StripPlace>,
    transform: ReflectorTransform,
    cold: ColdStart,
    table: BeamTable,
    y_m: Vec<f32>,
    z_m: Vec<f32>,
    previous: Option<[NormalLine; 3]>,
    /// Beams on the line at hand, and which they are.
    near: Beams,
    /// Beams on the upper line.
    upper: Vec<usize>,
}

impl Strategy {
    /// The strategy for scans taken in `frame`.
    pub fn new(frame: &Frame, options: StrategyOptions) -> Strategy {
        let strips = frame.strips_on(Face::Upper);
        Strategy {
            options,
            dy_m: frame.bounds.dy_m,
            gap_m: frame.bounds.background_gap_m,
            strips: strips
                .map(|(index, strip)| StripPlace {
                    index,
                    middle_m: strip.offset_m,
                })
                .collect(),
            transform: ReflectorTransform::default(),
            cold: ColdStart::default(),
            table: BeamTable::default(),
            y_m: Vec::new(),
            z_m: Vec::new(),
            previous: None,
            near: Beams::default(),
            upper: Vec::new(),
        }
    }

    /// Says where the lines are before the first scan: the home position of section 4.1.
    pub fn predict(&mut self, lines: [NormalLine; 3]) {
        self.previous = Some(lines);
    }

    /// Cells and votes of the transform of the scan before.
    pub fn work(&self) -> (usize, u64) {
        (self.transform.cells, self.transform.votes_cast)
    }

    /// Puts a scan's three lines into `out`, which has begun with the scan; false where one of them
    /// was not found. Without a prediction, or where it was too far off, the lines are looked for
    /// everywhere.
    pub fn find_lines(&mut self, scan: &Scan, out: &mut ReflectorLines) -> bool {
        let lines = self.find(scan);
        self.previous = lines.map(|lines| lines.map(|line| line.normal));
        let Some(lines) = lines else { return false };
        [out.right, out.upper, out.left] = lines;
        // None was taken out.
        out.range_bias_m = 0.0;
        true
    }

    fn find(&mut self, scan: &Scan) -> Option<[FittedLine; 3]> {
        if scan.beams() < 2 || !(scan.angle_increment_rad > 0.0) || !scan.angle_min_rad.is_finite()
        {
            return None;
        }
        self.table.fit(scan);
        self.y_m.clear();
        self.z_m.clear();
        for ((cos, sin), range_m) in self.table.cos_sin.iter().zip(scan.ranges_m.iter()) {
            self.y_m.push((range_m * cos) as f32);
            self.z_m.push((range_m * sin) as f32);
        }
        let tracked = self.previous.and_then(|lines| self.find_near(scan, &lines));
        tracked.or_else(|| {
            let ranges_m = &scan.ranges_m;
            let lines = self
                .cold
                .find(&self.table, ranges_m, self.dy_m, self.gap_m)?;
            self.find_near(scan, &lines)
        })
    }

    /// Steps 1 to 4 about a prediction; none where that was too far off.
    fn find_near(&mut self, scan: &Scan, predicted: &[NormalLine; 3]) -> Option<[FittedLine; 3]> {
        let points = [&self.y_m[..], &self.z_m[..]];
        let window = &self.options.window;
        let found = self
            .transform
            .find(points, predicted, window, scan.scan_time_s);
        let mut lines = *predicted;
        for (line, found) in lines.iter_mut().zip(found) {
            let ([d_m, alpha_rad], votes) = found?;
            if votes < self.options.min_points {
                return None;
            }
            *line = NormalLine::new(d_m, alpha_rad);
        }
        // Two walls that are not a frame's width apart: one of them is what stands behind it.
        if (lines[0].d_m + lines[2].d_m - self.dy_m).abs() > WIDTH_M {
            return None;
        }
        if self.options.coarse {
            return Some(found.map(|cell| self.cell(cell)));
        }
        let sectors = self.sectors(&lines)?;
        let mut fitted = [FittedLine::default(); 3];
        for (k, sector) in sectors.into_iter().enumerate() {
            self.gather(scan, lines[k], sector, k == 1);
            fitted[k] = self.fit(lines[k])?;
        }
        Some(fitted)
    }

    /// A cell of the transform as a line, known to within the cell.
    fn cell(&self, cell: Option<([f64; 2], u32)>) -> FittedLine {
        let Some(([d_m, alpha_rad], votes)) = cell else {
            return FittedLine::default();
        };
        let window = &self.options.window;
        FittedLine {
            normal: NormalLine::new(d_m, alpha_rad),
            cov_dd: window.row_m.powi(2) / 12.0,
            cov_da: 0.0,
            cov_aa: window.column_rad.powi(2) / 12.0,
            points: votes,
            rms_m: f64::NAN,
        }
    }

    /// Beams of the right, upper and left line, eq. 4.23: up to the corner points.
    fn sectors(&self, [right, upper, left]: &[NormalLine; 3]) -> Option<[Range<usize>; 3]> {
        let first = right.corner(upper)?.angle_rad;
        let second = upper.corner(left)?.angle_rad;
        let table = &self.table;
        Some([
            table.index_range(-FRAC_PI_2, first),
            table.index_range(first, second),
            table.index_range(second, 3.0 * FRAC_PI_2),
        ])
    }

    /// Keeps the beams within the threshold of a line, eq. 4.10 and 4.17.
    fn gather(&mut self, scan: &Scan, line: NormalLine, sector: Range<usize>, is_upper: bool) {
        let (sin, cos) = line.alpha_rad.sin_cos();
        self.near.clear();
        if is_upper {
            self.upper.clear();
        }
        for i in sector {
            let ((c, s), range_m) = (self.table.cos_sin[i], scan.ranges_m[i]);
            let (y, z) = (range_m * c, range_m * s);
            if (y * cos + z * sin - line.d_m).abs() <= self.options.threshold_m {
                self.near.push_point(range_m, y, z);
                if is_upper {
                    self.upper.push(i);
                }
            }
        }
    }

    /// Least squares through the beams kept; the covariance is for the noise that their residuals
    /// show.
    fn fit(&self, start: NormalLine) -> Option<FittedLine> {
        let beams: BeamSlice<'_> = self.near.all();
        if (beams.len() as u64) < u64::from(self.options.min_points.max(3)) {
            return None;
        }
        let (sigma_m, estimator) = (self.options.sigma_m, self.options.estimator);
        let mut line = fit::fit_near(start.into(), beams, sigma_m, estimator, Loss::Squares)?;
        let n = beams.len() as f64;
        let noise_m = (line.rms_m * (n / (n - 2.0)).sqrt()).max(SIGMA_FLOOR_M);
        let scale = (noise_m / sigma_m).powi(2);
        line.cov_dd *= scale;
        line.cov_da *= scale;
        line.cov_aa *= scale;
        Some(line)
    }

    /// Puts the ends of the strips on the upper line into `out`, whose lines were just found in `scan`:
    /// steps 5 and 6.
    pub fn find_strips(&self, scan: &Scan, out: &mut ReflectorLines) {
        let upper = out.upper.normal;
        let lines = [out.right.normal, upper, out.left.normal];
        let Some([_, sector, _]) = self.sectors(&lines) else {
            return;
        };
        let inside = self.upper.iter().copied();
        let inside: Vec<usize> = inside.filter(|i| sector.contains(i)).collect();
        let is_one = |a: &usize, b: &usize| self.are_neighbours(upper, *a, *b);
        // For yaw and pitch near zero; strips are much further apart than that can be wrong.
        let y_m = 0.5 * (out.left.normal.d_m - out.right.normal.d_m);
        for segment in inside.chunk_by(is_one) {
            let (first, last) = (segment[0], segment[segment.len() - 1]);
            let middle = 0.5 * (self.along_m(upper, first) + self.along_m(upper, last));
            let strip = self.strip_at(y_m - middle);
            for (kind, [from, to]) in [
                (EdgeKind::On, [first as f64 - 1.0, first as f64]),
                (EdgeKind::Off, [last as f64, last as f64 + 1.0]),
            ] {
                let angle_rad =
                    |beam: f64| self.table.angle_rad(0) + beam * self.table.increment_rad();
                let (from_rad, to_rad) = (angle_rad(from), angle_rad(to));
                out.edges.push(Edge {
                    face: Face::Upper,
                    strip,
                    kind,
                    from_rad,
                    to_rad,
                    time_s: Strategy::time_at_s(scan, 0.5 * (from_rad + to_rad)),
                    ..Edge::default()
                });
            }
        }
    }

    /// When a stated angle is passed, s after the reference instant; 0 where the scan does not say
    /// when its beams fire.
    fn time_at_s(scan: &Scan, angle_rad: f64) -> f64 {
        let beams = (angle_rad - FRAC_PI_2) / scan.angle_increment_rad;
        let time_s = beams * scan.time_increment_s;
        if time_s.is_finite() { time_s } else { 0.0 }
    }

    /// Whether two beams on the line are of one segment, eq. 4.19: no further apart than neighbours
    /// would be there, eq. 4.20 and 4.21, times a factor.
    fn are_neighbours(&self, line: NormalLine, a: usize, b: usize) -> bool {
        let expected_m = self.along_m(line, b) - self.along_m(line, b.saturating_sub(1));
        self.along_m(line, b) - self.along_m(line, a) <= self.options.apart * expected_m
    }

    /// Where a beam meets a line, m along it from the foot point.
    fn along_m(&self, line: NormalLine, beam: usize) -> f64 {
        line.d_m * (self.table.angle_rad(beam) - line.alpha_rad).tan()
    }

    /// The strip whose middle is nearest to a place across the frame, if it is nearer than half of
    /// the way to the next; -1 where none is.
    fn strip_at(&self, y_m: f64) -> i32 {
        let off = |place: &&StripPlace| (place.middle_m - y_m).abs();
        let mut places: Vec<&StripPlace> = self.strips.iter().collect();
        places.sort_by(|a, b| off(a).total_cmp(&off(b)));
        match places.first() {
            Some(best) if places.get(1).is_none_or(|next| off(best) < 0.7 * off(next)) => {
                i32::try_from(best.index).unwrap_or(-1)
            }
            _ => -1,
        }
    }
}

/// Noise is never taken smaller than this (quantisation of the ranges), m.
const SIGMA_FLOOR_M: f64 = 0.0005;

/// The walls' distances add up to the frame's width to within this, m: range bias and yaw.
const WIDTH_M: f64 = 0.15;
