//! The beams of a scan that returned something, cut into groups at the jumps between surfaces.
//!
//! A jump is where the next point lies further off than a surface seen at the flattest accepted
//! angle lambda would put it: `r sin(dphi) / sin(lambda - dphi) + 3 sigma` (Borges & Aldon 2004).
//! A range of 0, NaN, infinite or beyond the limit is no return and never an error; it counts as
//! if the beam were not there.

use super::fit::{BeamSlice, InverseLine};
use crate::record::{BeamTable, NormalLine, Scan};
use std::f64::consts::TAU;

/// What counts as a jump from one surface to another.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Cut {
    /// Nothing: the whole scan is one group.
    Nowhere,
    /// A distance between neighbouring points of more than [`SegmentationOptions::max_gap_m`].
    Jump,
    /// Successive edge following: a difference between neighbouring ranges of more than
    /// [`SegmentationOptions::edge_m`] (Kurniawan 2017, eq. 4.18).
    Sef,
    /// A point further off than a surface seen at the flattest accepted angle would put it (Borges
    /// & Aldon 2004).
    #[default]
    Adaptive,
    /// A point further off than the line expected there would put it (Kurniawan 2017, eq. 4.19 to
    /// 4.21).
    Reflector,
}

/// Where a scan is cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SegmentationOptions {
    /// What counts as a jump.
    pub cut: Cut,
    /// Standard deviation of a range, m.
    pub sigma_m: f64,
    /// Flattest angle between beam and surface at which neighbours still count as connected, rad.
    pub breakpoint_angle_rad: f64,
    /// Points further apart than this are never connected, m.
    pub max_gap_m: f64,
    /// Range difference that ends a segment in successive edge following, m.
    pub edge_m: f64,
    /// A single beam that is this many sigmas off the line through its two neighbours, while these
    /// are connected, is left out.
    pub spike_sigmas: f64,
    /// Ranges beyond this are no return, m (besides the scan's own limits).
    pub max_range_m: f64,
    /// Whether a surface that a scanner sees with its last and its first beams, all round, is cut
    /// there in two.
    pub cut_at_seam: bool,
}

impl Default for SegmentationOptions {
    fn default() -> Self {
        SegmentationOptions {
            cut: Cut::default(),
            sigma_m: 0.0065,
            breakpoint_angle_rad: 5f64.to_radians(),
            max_gap_m: 0.5,
            edge_m: 0.3,
            spike_sigmas: 12.0,
            max_range_m: f64::INFINITY,
            cut_at_seam: false,
        }
    }
}

/// Beams with a return, as parallel arrays in beam order, and the groups they fall into. Kept from
/// scan to scan, so that nothing is allocated once the buffers have grown.
///
/// The scan of a scanner that sees all round has no natural first beam: it is turned so that it
/// starts behind its widest jump (or, without one, at its nearest point).
#[derive(Clone, Debug, Default)]
pub struct Returns {
    directions: BeamTable,
    beam: Vec<u32>,
    range_m: Vec<f64>,
    y_m: Vec<f64>,
    z_m: Vec<f64>,
    /// Entries to be taken out.
    remove: Vec<u32>,
    /// Beams left out as spikes.
    dropped: Vec<u32>,
    /// Lines that surfaces are expected to run along.
    expected: Vec<InverseLine>,
    /// First beam of each group, and the end of the last.
    starts: Vec<u32>,
    all_round: bool,
}

impl Returns {
    /// Takes in a scan.
    pub fn read(&mut self, scan: &Scan, options: &SegmentationOptions) {
        self.directions.fit(scan);
        self.all_round = sees_all_round(scan) && !options.cut_at_seam;
        self.collect(scan, options);
        let rule = BreakRule::new(scan, options);
        self.drop_spikes(&rule, options);
        self.cut(&rule);
    }

    /// Tells which lines to expect from now on; only [`Cut::Reflector`] asks. Without any, it cuts
    /// like [`Cut::Adaptive`].
    pub fn expect(&mut self, lines: &[NormalLine]) {
        self.expected.clear();
        self.expected.extend(
            lines
                .iter()
                .filter(|line| line.d_m > 0.0 && line.alpha_rad.is_finite())
                .map(|line| InverseLine::from(*line)),
        );
    }

    /// Indices in the scan of the beams that were left out as spikes.
    pub fn spikes(&self) -> &[u32] {
        &self.dropped
    }

    /// Ranges and points.
    pub fn beams(&self) -> BeamSlice<'_> {
        BeamSlice {
            range_m: &self.range_m,
            y_m: &self.y_m,
            z_m: &self.z_m,
        }
    }

    /// Index in the scan of the k-th return.
    pub fn beam(&self, k: usize) -> u32 {
        self.beam.get(k).copied().unwrap_or(0)
    }

    /// The groups as (from, to) into [`Returns::beams`].
    pub fn groups(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        self.starts
            .windows(2)
            .map(|pair| (pair[0] as usize, pair[1] as usize))
    }

    /// Whether the last return is the first one's neighbour.
    pub fn is_all_round(&self) -> bool {
        self.all_round
    }

    /// Every loop over all beams below takes them in chunks without a branch, which goes through
    /// vector registers; what is rare is then looked at one by one.
    fn collect(&mut self, scan: &Scan, options: &SegmentationOptions) {
        let beams = scan.beams();
        for list in [&mut self.range_m, &mut self.y_m, &mut self.z_m] {
            list.resize(beams, 0.0);
        }
        self.beam.clear();
        self.beam.extend(0..beams as u32);
        self.range_m.copy_from_slice(&scan.ranges_m);
        let points = self.y_m.iter_mut().zip(&mut self.z_m);
        let beams = scan.ranges_m.iter().zip(&self.directions.cos_sin);
        for ((y_m, z_m), (range_m, (cos, sin))) in points.zip(beams) {
            *y_m = range_m * cos;
            *z_m = range_m * sin;
        }
        let max_m = if scan.range_max_m > 0.0 {
            options.max_range_m.min(scan.range_max_m)
        } else {
            options.max_range_m
        }
        .min(f64::MAX);
        let min_m = if scan.range_min_m > 0.0 {
            scan.range_min_m
        } else {
            f64::MIN_POSITIVE
        };
        let limits = min_m..=max_m;
        self.remove.clear();
        for (first, chunk) in self.range_m.chunks(CHUNK).enumerate() {
            if chunk.iter().fold(true, |all, r| all & limits.contains(r)) {
                continue;
            }
            for (k, range_m) in chunk.iter().enumerate() {
                if !limits.contains(range_m) {
                    self.remove.push((first * CHUNK + k) as u32);
                }
            }
        }
        self.close_up();
    }

    /// Takes out the entries at the ascending indices in `remove`.
    fn close_up(&mut self) {
        let n = self.range_m.len();
        let Some(first) = self.remove.first() else {
            return;
        };
        let mut to = *first as usize;
        for (i, removed) in self.remove.iter().enumerate() {
            let from = *removed as usize + 1;
            let end = self.remove.get(i + 1).map_or(n, |next| *next as usize);
            self.beam.copy_within(from..end, to);
            self.range_m.copy_within(from..end, to);
            self.y_m.copy_within(from..end, to);
            self.z_m.copy_within(from..end, to);
            to += end - from;
        }
        self.beam.truncate(to);
        self.range_m.truncate(to);
        self.y_m.truncate(to);
        self.z_m.truncate(to);
    }

    /// A line through both neighbours (at equal angles) predicts
    /// `1 / r = (1 / r1 + 1 / r2) / (2 cos(dphi))`.
    fn drop_spikes(&mut self, rule: &BreakRule, options: &SegmentationOptions) {
        self.dropped.clear();
        let mut remove = std::mem::take(&mut self.remove);
        remove.clear();
        self.find_spikes(rule, options, &mut remove);
        self.dropped
            .extend(remove.iter().map(|k| self.beam[*k as usize]));
        self.remove = remove;
        self.close_up();
    }

    fn find_spikes(&self, rule: &BreakRule, options: &SegmentationOptions, spikes: &mut Vec<u32>) {
        let n = self.range_m.len();
        if n < 3 {
            return;
        }
        // The prediction's own noise is half a variance of one range.
        let limit_m = options.spike_sigmas * options.sigma_m * 1.5f64.sqrt();
        let twice = 2.0 * rule.cos_step;
        let off = |before: f64, r: f64, after: f64| {
            let sum = before + after;
            (r * sum - twice * before * after).abs() > limit_m * sum
        };
        let single =
            |before, k, after| self.steps(before, k, rule) == 1 && self.steps(k, after, rule) == 1;
        let is_spike = |before: usize, k: usize, after: usize| {
            off(self.range_m[before], self.range_m[k], self.range_m[after])
                && single(before, k, after)
                && !self.is_far(before, after, rule)
        };
        if self.all_round && is_spike(n - 1, 0, 1) {
            spikes.push(0);
        }
        let befores = self.range_m[..n - 2].chunks(CHUNK);
        let ranges = self.range_m[1..n - 1].chunks(CHUNK);
        let afters = self.range_m[2..].chunks(CHUNK);
        for (chunk, ((before, r), after)) in befores.zip(ranges).zip(afters).enumerate() {
            let triples = before.iter().zip(r).zip(after);
            if triples.fold(false, |any, ((b, r), a)| any | off(*b, *r, *a)) {
                let first = 1 + chunk * CHUNK;
                for k in first..first + r.len() {
                    if is_spike(k - 1, k, k + 1) {
                        spikes.push(k as u32);
                    }
                }
            }
        }
        if self.all_round && is_spike(n - 2, n - 1, 0) {
            spikes.push(n as u32 - 1);
        }
    }

    /// Beam steps from return `k` to return `next`.
    #[inline]
    fn steps(&self, k: usize, next: usize, rule: &BreakRule) -> u32 {
        let (from, to) = (self.beam[k], self.beam[next]);
        if to > from {
            to - from
        } else {
            // Round the seam.
            rule.steps_round.saturating_add(to).saturating_sub(from)
        }
    }

    #[inline]
    fn distance2_m2(&self, k: usize, next: usize) -> f64 {
        let (dy, dz) = (self.y_m[next] - self.y_m[k], self.z_m[next] - self.z_m[k]);
        dy * dy + dz * dz
    }

    #[inline]
    fn is_break(&self, k: usize, next: usize, rule: &BreakRule) -> bool {
        match rule.cut {
            Cut::Nowhere => false,
            Cut::Jump => self.distance2_m2(k, next) > rule.max_gap_m * rule.max_gap_m,
            Cut::Sef => (self.range_m[next] - self.range_m[k]).abs() > rule.edge_m,
            Cut::Adaptive => self.is_far(k, next, rule),
            Cut::Reflector => self.is_off_expected(k, next, rule),
        }
    }

    /// Whether `next` is further off than a surface along the line expected there would put it.
    fn is_off_expected(&self, k: usize, next: usize, rule: &BreakRule) -> bool {
        let (r, y, z) = (self.range_m[next], self.y_m[next], self.z_m[next]);
        let nearest = self
            .expected
            .iter()
            .map(|line| (line, line.residual_m(r, y, z).abs()))
            .min_by(|a, b| a.1.total_cmp(&b.1));
        let Some((line, _)) = nearest.filter(|(_, off_m)| *off_m <= rule.max_gap_m) else {
            return self.is_far(k, next, rule);
        };
        // The surface through `next` along that line, met by the beam of `k`: eq. 4.20 and 4.21.
        let along_next = line.a * y + line.b * z;
        let along_k = line.a * self.y_m[k] + line.b * self.z_m[k];
        if !(along_k > 0.0) {
            return self.is_far(k, next, rule);
        }
        let scale = along_next / along_k;
        let (dy_m, dz_m) = (y - scale * self.y_m[k], z - scale * self.z_m[k]);
        let limit_m = dy_m.hypot(dz_m) + std::f64::consts::SQRT_2 * rule.offset_m;
        let limit_m = limit_m.min(rule.max_gap_m);
        self.distance2_m2(k, next) > limit_m * limit_m
    }

    #[inline]
    fn is_far(&self, k: usize, next: usize, rule: &BreakRule) -> bool {
        let near_m = self.range_m[k].min(self.range_m[next]);
        let limit_m = rule.limit_m(near_m, self.steps(k, next, rule));
        self.distance2_m2(k, next) > limit_m * limit_m
    }

    /// Finds the groups' first beams.
    fn cut(&mut self, rule: &BreakRule) {
        let n = self.range_m.len();
        self.starts.clear();
        if n == 0 {
            return;
        }
        if !self.all_round || self.is_break(n - 1, 0, rule) {
            self.starts.push(0);
        }
        if rule.cut == Cut::Adaptive {
            self.cut_adaptively(rule);
        } else {
            for k in 1..n {
                if self.is_break(k - 1, k, rule) {
                    self.starts.push(k as u32);
                }
            }
        }
        if self.all_round {
            self.turn(rule.cut);
        }
        self.starts.push(n as u32);
    }

    /// The limit between neighbouring beams is the strictest: it is tried first.
    fn cut_adaptively(&mut self, rule: &BreakRule) {
        let lists = chunks(&self.range_m)
            .zip(chunks(&self.y_m))
            .zip(chunks(&self.z_m));
        let mut starts = std::mem::take(&mut self.starts);
        for (chunk, (((r0, r1), (y0, y1)), (z0, z1))) in lists.enumerate() {
            let mut any = false;
            let points = y0.iter().zip(y1).zip(z0.iter().zip(z1));
            for ((r0, r1), ((y0, y1), (z0, z1))) in r0.iter().zip(r1).zip(points) {
                let near_m = if r0 < r1 { *r0 } else { *r1 };
                let limit_m = near_m * rule.factors[0] + rule.offset_m;
                let limit_m = if limit_m < rule.max_gap_m {
                    limit_m
                } else {
                    rule.max_gap_m
                };
                let (dy_m, dz_m) = (y1 - y0, z1 - z0);
                any |= dy_m * dy_m + dz_m * dz_m > limit_m * limit_m;
            }
            if any {
                let first = 1 + chunk * CHUNK;
                for k in first..first + r0.len() {
                    if self.is_far(k - 1, k, rule) {
                        starts.push(k as u32);
                    }
                }
            }
        }
        self.starts = starts;
    }

    /// Turns an all-round scan so that it starts behind its widest jump.
    fn turn(&mut self, cut: Cut) {
        let n = self.range_m.len();
        let width2_m2 = |k: usize| self.distance2_m2((k + n - 1) % n, k);
        let widest = (0..self.starts.len()).max_by(|a, b| {
            let (a, b) = (self.starts[*a] as usize, self.starts[*b] as usize);
            width2_m2(a).total_cmp(&width2_m2(b))
        });
        let first = match widest {
            Some(widest) => {
                let first = self.starts[widest];
                self.starts.rotate_left(widest);
                for start in &mut self.starts {
                    *start = (*start + n as u32 - first) % n as u32;
                }
                first as usize
            }
            // The nearest point is no corner of a room: the cut wall is merged again, whereas a
            // corner's beams on the wrong side of the cut would stay there.
            None => {
                self.starts.push(0);
                let ranges = self.range_m.iter().enumerate();
                let first = if cut == Cut::Nowhere {
                    // Nothing is merged then: better a beam of a corner lost than a wall halved.
                    ranges.max_by(|a, b| a.1.total_cmp(b.1))
                } else {
                    ranges.min_by(|a, b| a.1.total_cmp(b.1))
                };
                first.map_or(0, |(k, _)| k)
            }
        };
        self.beam.rotate_left(first);
        self.range_m.rotate_left(first);
        self.y_m.rotate_left(first);
        self.z_m.rotate_left(first);
    }
}

/// Chunks of a list beside the chunks one further on.
fn chunks(list: &[f64]) -> impl Iterator<Item = (&[f64], &[f64])> {
    let last = list.len() - 1;
    list[..last].chunks(CHUNK).zip(list[1..].chunks(CHUNK))
}

/// Beams looked at together.
const CHUNK: usize = 8;

/// Whether the beam after the last one would be the first again (or nearly so).
fn sees_all_round(scan: &Scan) -> bool {
    let step_rad = scan.angle_increment_rad.abs();
    let missing_rad = TAU - step_rad * scan.beams().saturating_sub(1) as f64;
    step_rad > 0.0 && missing_rad.abs() <= 1.5 * step_rad
}

struct BreakRule {
    cut: Cut,
    edge_m: f64,
    step_rad: f64,
    cos_step: f64,
    /// Factor on the nearer range for neighbouring beams, and for those one further on.
    factors: [f64; 2],
    lambda_rad: f64,
    offset_m: f64,
    max_gap_m: f64,
    /// Beam steps of a full turn.
    steps_round: u32,
}

impl BreakRule {
    fn new(scan: &Scan, options: &SegmentationOptions) -> BreakRule {
        let step_rad = scan.angle_increment_rad.abs();
        let mut rule = BreakRule {
            cut: options.cut,
            edge_m: options.edge_m,
            step_rad,
            cos_step: step_rad.cos(),
            factors: [0.0; 2],
            lambda_rad: options.breakpoint_angle_rad,
            offset_m: 3.0 * options.sigma_m,
            max_gap_m: options.max_gap_m,
            steps_round: (TAU / step_rad).round() as u32,
        };
        rule.factors = [rule.factor_over(1), rule.factor_over(2)];
        rule
    }

    #[inline]
    fn limit_m(&self, near_m: f64, steps: u32) -> f64 {
        let factor = match steps {
            1 => self.factors[0],
            2 => self.factors[1],
            _ => self.factor_over(steps),
        };
        (near_m * factor + self.offset_m).min(self.max_gap_m)
    }

    fn factor_over(&self, steps: u32) -> f64 {
        let angle_rad = self.step_rad * f64::from(steps);
        if angle_rad < 0.9 * self.lambda_rad {
            angle_rad.sin() / (self.lambda_rad - angle_rad).sin()
        } else {
            // So many beams are missing that nothing but the gap itself says whether this is one
            // surface.
            f64::INFINITY
        }
    }
}
