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
}

impl Default for SegmentationOptions {
    fn default() -> Self {
        SegmentationOptions {
            cut: Cut::default(),
            sigma_m: 0.0065,
            breakpoint_angle_rad: 10f64.to_radians(),
            max_gap_m: 0.5,
            edge_m: 0.3,
            spike_sigmas: 6.0,
            max_range_m: f64::INFINITY,
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
    spikes: Vec<bool>,
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
        self.all_round = sees_all_round(scan);
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
                .map(|line| InverseLine {
                    a: line.alpha_rad.cos() / line.d_m,
                    b: line.alpha_rad.sin() / line.d_m,
                }),
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

    fn collect(&mut self, scan: &Scan, options: &SegmentationOptions) {
        let beams = scan.beams();
        for list in [&mut self.range_m, &mut self.y_m, &mut self.z_m] {
            list.resize(beams, 0.0);
        }
        self.beam.resize(beams, 0);
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
        let mut k = 0;
        // Every beam is written where the next valid one belongs, which spares a branch a beam.
        let beams = scan.ranges_m.iter().zip(&self.directions.cos_sin);
        for (i, (range_m, (cos, sin))) in beams.enumerate() {
            self.beam[k] = i as u32;
            self.range_m[k] = *range_m;
            self.y_m[k] = range_m * cos;
            self.z_m[k] = range_m * sin;
            k += usize::from((min_m..=max_m).contains(range_m));
        }
        self.truncate(k);
    }

    fn truncate(&mut self, len: usize) {
        self.beam.truncate(len);
        self.range_m.truncate(len);
        self.y_m.truncate(len);
        self.z_m.truncate(len);
    }

    /// A line through both neighbours (at equal angles) predicts
    /// `1 / r = (1 / r1 + 1 / r2) / (2 cos(dphi))`.
    fn drop_spikes(&mut self, rule: &BreakRule, options: &SegmentationOptions) {
        self.dropped.clear();
        let n = self.range_m.len();
        if n < 3 {
            return;
        }
        // The prediction's own noise is half a variance of one range.
        let limit_m = options.spike_sigmas * options.sigma_m * 1.5f64.sqrt();
        self.spikes.clear();
        self.spikes.resize(n, false);
        let mut any = false;
        let triples = self.range_m.windows(3).zip(self.beam.windows(3));
        for (spike, (r, beam)) in self.spikes[1..].iter_mut().zip(triples) {
            let neighbours = beam[2] - beam[0] == 2;
            let sum = r[0] + r[2];
            let off = (r[1] * sum - 2.0 * rule.cos_step * r[0] * r[2]).abs() > limit_m * sum;
            *spike = neighbours && off;
            any |= *spike;
        }
        if self.all_round {
            for k in [0, n - 1] {
                let (before, after) = ((k + n - 1) % n, (k + 1) % n);
                let (r1, r, r2) = (self.range_m[before], self.range_m[k], self.range_m[after]);
                let sum = r1 + r2;
                let off = (r * sum - 2.0 * rule.cos_step * r1 * r2).abs() > limit_m * sum;
                let single = self.steps(before, k, rule) == 1 && self.steps(k, after, rule) == 1;
                self.spikes[k] = single && off;
                any |= self.spikes[k];
            }
        }
        if !any {
            return;
        }
        for k in 0..n {
            if self.spikes[k] {
                let (before, after) = ((k + n - 1) % n, (k + 1) % n);
                self.spikes[k] = !self.is_far(before, after, rule);
                if self.spikes[k] {
                    self.dropped.push(self.beam[k]);
                }
            }
        }
        let mut kept = 0;
        for k in 0..n {
            self.beam[kept] = self.beam[k];
            self.range_m[kept] = self.range_m[k];
            self.y_m[kept] = self.y_m[k];
            self.z_m[kept] = self.z_m[k];
            kept += usize::from(!self.spikes[k]);
        }
        self.truncate(kept);
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
        for k in 1..n {
            if self.is_break(k - 1, k, rule) {
                self.starts.push(k as u32);
            }
        }
        if self.all_round {
            self.turn();
        }
        self.starts.push(n as u32);
    }

    /// Turns an all-round scan so that it starts behind its widest jump.
    fn turn(&mut self) {
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
                let nearest = ranges.min_by(|a, b| a.1.total_cmp(b.1));
                nearest.map_or(0, |(k, _)| k)
            }
        };
        self.beam.rotate_left(first);
        self.range_m.rotate_left(first);
        self.y_m.rotate_left(first);
        self.z_m.rotate_left(first);
    }
}

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
    /// Factor on the nearer range for neighbouring beams.
    factor: f64,
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
            factor: 0.0,
            lambda_rad: options.breakpoint_angle_rad,
            offset_m: 3.0 * options.sigma_m,
            max_gap_m: options.max_gap_m,
            steps_round: (TAU / step_rad).round() as u32,
        };
        rule.factor = rule.factor_over(1);
        rule
    }

    #[inline]
    fn limit_m(&self, near_m: f64, steps: u32) -> f64 {
        let factor = if steps == 1 {
            self.factor
        } else {
            self.factor_over(steps)
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
