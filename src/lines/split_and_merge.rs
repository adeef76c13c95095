//! Split-and-merge: all straight lines of any scene.
//!
//! Groups of connected beams (see [`super::segmentation`]) are split where a beam lies too far off
//! the group's line, then where two lines explain the beams better than one; borders are moved to
//! where both sides fit best; runs that one line explains as well are merged, also across whatever
//! stands in front of the wall. Prefix sums make the cost of any run O(1), so that a scan takes
//! microseconds. Each line is then freed of outliers and fitted by maximum likelihood in the ranges
//! ([`super::fit`]).

use super::cutting::{Cutter, Cutting, halve};
use super::extractor::ExtractorOptions;
use super::fit::{BeamSlice, PrefixSums};
use super::runs::{MergeRule, Runs};
use crate::record::Scan;

/// Settings of the extractor. The defaults suit an LMS500.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SplitAndMergeOptions {
    /// What all extractors share.
    pub common: ExtractorOptions,
    /// A run is split at a beam that is this many sigmas off its line.
    pub split_sigmas: f64,
    /// A run is split where two lines lower chi-square by this much, and runs are merged whose
    /// common line does not raise it by `merge_chi2`.
    pub split_chi2: f64,
    /// 99.9 % quantile of chi-square with two degrees of freedom: two runs on one line differ by
    /// less.
    pub merge_chi2: f64,
}

impl Default for SplitAndMergeOptions {
    fn default() -> Self {
        SplitAndMergeOptions {
            common: ExtractorOptions::default(),
            split_sigmas: 4.5,
            split_chi2: 22.0,
            merge_chi2: 13.8,
        }
    }
}

/// The extractor.
pub type SplitAndMerge = Cutting<Splitting>;

/// Splits a group where a beam is too far off, or where two lines are much better than one.
#[derive(Clone, Debug, Default)]
pub struct Splitting {
    options: SplitAndMergeOptions,
    prefix: PrefixSums,
    pending: Vec<(usize, usize)>,
}

impl Cutter for Splitting {
    type Options = SplitAndMergeOptions;

    fn new(options: SplitAndMergeOptions) -> Splitting {
        Splitting {
            options,
            ..Splitting::default()
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
        let first_run = runs.len();
        let mut pending = std::mem::take(&mut self.pending);
        let border = |a: usize, b: usize| {
            self.farthest_beam(group, a, b)
                .or_else(|| self.better_as_two(a, b))
        };
        halve(&mut pending, group.len(), border, |a, b| {
            runs.push(offset + a, offset + b, self.prefix.between(a, b));
        });
        self.pending = pending;
        runs.settle_borders(first_run, offset, &self.prefix);
    }
}

impl Splitting {
    /// Where to split `a..b` because a beam is too far off its line: at the beam farthest from the
    /// chord between the ends, which is a corner where the run has one.
    fn farthest_beam(&self, group: BeamSlice<'_>, a: usize, b: usize) -> Option<usize> {
        if b - a < 3 {
            return None;
        }
        let line = self.prefix.between(a, b).line()?;
        let run = group.run(a, b);
        let limit_m = self.options.split_sigmas * self.options.common.segmentation.sigma_m;
        if line.is_within(limit_m, run) {
            return None;
        }
        let corner = a + farthest_from_chord(run);
        Some(corner.clamp(a + 1, b - 1))
    }

    /// Where to split `a..b` because two lines lower chi-square enough: for steps and kinks too
    /// small for a single beam to show.
    fn better_as_two(&self, a: usize, b: usize) -> Option<usize> {
        let side = self.options.common.min_points.max(2);
        if b - a < 2 * side {
            return None;
        }
        let variance_m2 = self.options.common.segmentation.sigma_m.powi(2);
        let whole_m2 = self.prefix.cost_m2(a, b);
        let bound_m2 = whole_m2 - self.options.split_chi2 * variance_m2;
        if bound_m2 <= 0.0 {
            return None;
        }
        let borders = (a + side..=b - side).step_by(COARSE_STEP);
        if !self.prefix.may_be_two(a, b, borders.clone(), bound_m2) {
            return None;
        }
        let halves_m2 = |k: usize| self.prefix.cost_m2(a, k) + self.prefix.cost_m2(k, b);
        let (border, cost_m2) = borders
            .map(|k| (k, halves_m2(k)))
            .min_by(|x, y| x.1.total_cmp(&y.1))?;
        (cost_m2 < bound_m2).then_some(border)
    }
}

/// Coarseness of the search for a better border, beams; the border is settled afterwards.
const COARSE_STEP: usize = 4;

/// Beams looked at together.
const BLOCK: usize = 8;

/// Index of the beam farthest from the chord between the run's first and last point; the first one
/// of several.
pub(super) fn farthest_from_chord(run: BeamSlice<'_>) -> usize {
    let last = run.len().saturating_sub(1);
    let (y0, z0) = (run.y_m[0], run.z_m[0]);
    let (dy, dz) = (run.y_m[last] - y0, run.z_m[last] - z0);
    let off = |y: f64, z: f64| ((y - y0) * dz - (z - z0) * dy).abs();
    // The block with the farthest beam first: blocks go through vector registers.
    let (mut farthest, mut block) = (-1.0f64, 0);
    for (i, (y, z)) in run.y_m.chunks(BLOCK).zip(run.z_m.chunks(BLOCK)).enumerate() {
        let largest = match (<&[f64; BLOCK]>::try_from(y), <&[f64; BLOCK]>::try_from(z)) {
            (Ok(y), Ok(z)) => largest_of(std::array::from_fn(|lane| off(y[lane], z[lane]))),
            _ => y
                .iter()
                .zip(z)
                .fold(0.0f64, |all, (y, z)| all.max(off(*y, *z))),
        };
        if largest > farthest {
            (farthest, block) = (largest, i);
        }
    }
    let from = block * BLOCK;
    let points = run.y_m.iter().zip(run.z_m).skip(from);
    from + points
        .map(|(y, z)| off(*y, *z))
        .position(|off| off == farthest)
        .unwrap_or(0)
}

/// The largest of some numbers, in halves, so that each step goes through vector registers.
#[inline]
fn largest_of(mut values: [f64; BLOCK]) -> f64 {
    let mut width = BLOCK / 2;
    while width > 0 {
        for i in 0..width {
            let other = values[i + width];
            values[i] = if other > values[i] { other } else { values[i] };
        }
        width /= 2;
    }
    values[0]
}

#[cfg(test)]
mod tests {
    use super::super::extractor::Extractor;
    use super::*;
    use crate::record::{Scan, Segment};
    use proptest::prelude::*;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;
    use rand_distr::{Distribution, Normal};
    use std::f64::consts::{FRAC_PI_2, PI, TAU};

    /// Straight walls as pairs of end points, m, seen from the origin.
    type Walls = Vec<[[f64; 2]; 2]>;

    /// A room 6 m by 4 m with the scanner off its middle, turned by `turn_rad`.
    fn room(turn_rad: f64) -> Walls {
        let corners = [[2.5, -1.2], [2.5, 2.8], [-3.5, 2.8], [-3.5, -1.2]];
        let corners = corners.map(|corner| turned(corner, turn_rad));
        (0..4).map(|i| [corners[i], corners[(i + 1) % 4]]).collect()
    }

    fn turned([y, z]: [f64; 2], by_rad: f64) -> [f64; 2] {
        let (sin, cos) = by_rad.sin_cos();
        [y * cos - z * sin, y * sin + z * cos]
    }

    /// Range to the nearest wall along a direction; infinite where there is none.
    fn cast(walls: &Walls, angle_rad: f64) -> f64 {
        let (sin, cos) = angle_rad.sin_cos();
        let hits = walls.iter().filter_map(|[a, b]| {
            let (ey, ez) = (b[0] - a[0], b[1] - a[1]);
            let det = sin * ey - cos * ez;
            let range_m = (a[1] * ey - a[0] * ez) / det;
            let share = (a[1] * cos - a[0] * sin) / det;
            (range_m > 0.0 && (0.0..=1.0).contains(&share)).then_some(range_m)
        });
        hits.fold(f64::INFINITY, f64::min)
    }

    const STEP_RAD: f64 = TAU / 720.0;

    /// An all-round scan in steps of half a degree.
    fn scan(walls: &Walls) -> Scan {
        // Half a step off, so that no beam meets a corner exactly.
        let angle_min_rad = -PI + 0.5 * STEP_RAD;
        Scan {
            angle_min_rad,
            angle_increment_rad: STEP_RAD,
            ranges_m: (0..720)
                .map(|i| cast(walls, angle_min_rad + f64::from(i) * STEP_RAD))
                .collect(),
            ..Scan::default()
        }
    }

    fn with_noise(mut scan: Scan, seed: u64) -> Scan {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let noise = Normal::new(0.0, 0.0065).unwrap();
        for range_m in scan.ranges_m.iter_mut() {
            *range_m += noise.sample(&mut rng);
        }
        scan
    }

    fn lines(scan: &Scan) -> Vec<Segment> {
        let mut out = Vec::new();
        SplitAndMerge::default().extract(scan, &mut out);
        out
    }

    fn off_rad(a: f64, b: f64) -> f64 {
        let off = (a - b).rem_euclid(TAU);
        off.min(TAU - off)
    }

    fn assert_has(segments: &[Segment], d_m: f64, alpha_rad: f64, tolerance: f64) {
        let found = segments.iter().any(|s| {
            (s.normal.d_m - d_m).abs() < tolerance
                && off_rad(s.normal.alpha_rad, alpha_rad) < tolerance
        });
        assert!(found, "d {d_m} alpha {alpha_rad} not in {segments:#?}");
    }

    #[test]
    fn four_walls_at_every_azimuth() {
        for degrees in (0..360).step_by(15) {
            let turn_rad = f64::from(degrees).to_radians();
            let segments = lines(&scan(&room(turn_rad)));
            assert_eq!(segments.len(), 4, "{degrees}: {segments:#?}");
            for (d_m, alpha_rad) in [(2.5, 0.0), (2.8, FRAC_PI_2), (3.5, PI), (1.2, -FRAC_PI_2)] {
                assert_has(&segments, d_m, alpha_rad + turn_rad, 1e-9);
            }
            assert!(segments.iter().all(|s| s.rms_m < 1e-9));
        }
    }

    #[test]
    fn one_wall_alone() {
        for degrees in [0.0f64, 33.0, 90.0, 179.9, 180.0, 270.0] {
            let turn_rad = degrees.to_radians();
            let wall = [turned([3.0, -0.7], turn_rad), turned([3.0, 0.4], turn_rad)];
            let segments = lines(&scan(&vec![wall]));
            assert_eq!(segments.len(), 1, "{degrees}: {segments:#?}");
            assert_has(&segments, 3.0, turn_rad, 1e-9);
            let [[y0, z0], [y1, z1]] = segments[0].ends_m;
            // Not longer than the wall, and short of it by less than a beam at either end.
            let length_m = (y1 - y0).hypot(z1 - z0);
            assert!(length_m <= 1.1 && length_m > 1.1 - 0.06, "{length_m}");
            assert_eq!(segments[0].line, 0);
        }
    }

    #[test]
    fn end_points_come_in_beam_order() {
        let segments = lines(&scan(&room(0.3)));
        for segment in &segments {
            let [a, b] = segment.ends_m;
            assert!(a[0] * b[1] - a[1] * b[0] > 0.0, "{segment:?}");
        }
        let order: Vec<u32> = segments.iter().map(|s| s.line).collect();
        assert_eq!(order, [0, 1, 2, 3]);
    }

    #[test]
    fn a_wall_behind_a_column_is_one_line() {
        let mut walls = room(0.0);
        walls.push([[1.0, -0.06], [1.0, 0.06]]);
        let segments = lines(&with_noise(scan(&walls), 5));
        assert_eq!(segments.len(), 4, "{segments:#?}");
        assert_has(&segments, 2.5, 0.0, 0.005);
    }

    #[test]
    fn a_step_of_three_centimetres_is_two_lines() {
        let mut walls = room(0.0);
        walls[0] = [[2.5, -1.2], [2.5, 1.0]];
        walls.push([[2.53, 0.9], [2.53, 2.8]]);
        let segments = lines(&with_noise(scan(&walls), 5));
        assert_eq!(segments.len(), 5, "{segments:#?}");
        assert_has(&segments, 2.5, 0.0, 0.005);
        assert_has(&segments, 2.53, 0.0, 0.02);
    }

    #[test]
    fn missing_returns_are_as_if_not_there() {
        let whole = with_noise(scan(&room(0.4)), 1);
        let missing = [3usize, 100, 101, 350, 719];
        let with = |value: f64| {
            let mut scan = whole.clone();
            for i in missing {
                scan.ranges_m[i] = value;
            }
            scan.range_max_m = 65.0;
            lines(&scan)
        };
        let reference = with(f64::INFINITY);
        assert_eq!(reference.len(), 4);
        for value in [0.0, -1.0, f64::NAN, f64::NEG_INFINITY, 80.0] {
            assert_eq!(with(value), reference, "{value}");
        }
        // Beams without a return behind the last one change nothing either.
        let mut half = whole;
        half.ranges_m.truncate(400);
        let reference = lines(&half);
        half.ranges_m.extend([f64::INFINITY; 100]);
        assert_eq!(lines(&half), reference);
    }

    #[test]
    fn nothing_comes_of_nothing() {
        assert!(lines(&Scan::default()).is_empty());
        let mut empty = scan(&vec![]);
        assert!(lines(&empty).is_empty());
        empty.ranges_m[10] = 1.0;
        assert!(lines(&empty).is_empty());
        empty.angle_increment_rad = f64::NAN;
        assert!(lines(&empty).is_empty());
        empty.angle_increment_rad = 0.0;
        empty.ranges_m.iter_mut().for_each(|r| *r = 2.0);
        assert!(lines(&empty).is_empty());
    }

    #[test]
    fn scale_and_sigma_scale_together() {
        let once = with_noise(scan(&room(0.2)), 9);
        let mut twice = once.clone();
        twice
            .ranges_m
            .iter_mut()
            .for_each(|range_m| *range_m *= 2.0);
        let mut options = SplitAndMergeOptions::default();
        options.common.segmentation.sigma_m *= 2.0;
        options.common.segmentation.max_gap_m *= 2.0;
        options.common.min_length_m *= 2.0;
        let mut scaled = Vec::new();
        SplitAndMerge::new(options).extract(&twice, &mut scaled);
        let reference = lines(&once);
        assert_eq!(scaled.len(), reference.len());
        for (a, b) in scaled.iter().zip(&reference) {
            assert!((a.normal.d_m - 2.0 * b.normal.d_m).abs() < 1e-9);
            assert!((a.normal.alpha_rad - b.normal.alpha_rad).abs() < 1e-9);
            assert_eq!(a.points, b.points);
        }
    }

    #[test]
    fn a_mirrored_scene_gives_mirrored_lines() {
        let straight = scan(&room(0.7));
        let mut mirrored = straight.clone();
        mirrored.angle_min_rad = -straight.angle_rad(straight.beams() - 1);
        mirrored.ranges_m.reverse();
        let (straight, mirrored) = (lines(&straight), lines(&mirrored));
        assert_eq!(straight.len(), mirrored.len());
        for segment in &straight {
            assert_has(
                &mirrored,
                segment.normal.d_m,
                -segment.normal.alpha_rad,
                1e-9,
            );
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]

        /// Which beam of an all-round scanner is called the first does not matter.
        #[test]
        fn the_first_beam_does_not_matter(by in 1usize..720, seed in 0u64..50) {
            let mut walls = room(0.1);
            // Something to jump at: without it the scan starts at its nearest beam.
            walls.push([[1.0, 0.5], [1.4, 0.5]]);
            let straight = with_noise(scan(&walls), seed);
            let mut rolled = straight.clone();
            rolled.ranges_m.rotate_left(by);
            let (straight, rolled) = (lines(&straight), lines(&rolled));
            prop_assert_eq!(straight.len(), rolled.len());
            let turn_rad = by as f64 * STEP_RAD;
            for segment in &straight {
                assert_has(&rolled, segment.normal.d_m, segment.normal.alpha_rad - turn_rad, 1e-9);
            }
        }

        #[test]
        fn any_ranges_are_taken(
            ranges_m in proptest::collection::vec(proptest::num::f64::ANY, 0..80),
            step_rad in -0.2f64..0.2,
        ) {
            let scan = Scan {
                angle_min_rad: 0.0,
                angle_increment_rad: step_rad,
                ranges_m: ranges_m.into(),
                ..Scan::default()
            };
            for segment in lines(&scan) {
                prop_assert!(segment.normal.d_m.is_finite());
                prop_assert!(segment.points >= 9);
            }
        }
    }
}
