//! What extracted lines are worth: segments against the true ones of the same scans.
//!
//! The figures are those of Nguyen, Martinelli, Tomatis, Siegwart (IROS 2005; Kurniawan 2017, eq.
//! 4.1 and table 4.1): the share of true lines that were found, the share of found lines that are
//! none, and how exact the found ones are. A found and a true line of one scan may belong together
//! where
//!
//! - their difference in (d, alpha) passes a chi-square gate. Its covariance is the same for every
//!   extractor: a straight line fitted to the true line's points with a point noise of `point_sigma_m`,
//!   and a floor for what a surveyed truth is worth, both stated at the segment's centre and carried
//!   to the scanner;
//! - along the true line they overlap by a share of the shorter one.
//!
//! Pairs are taken one to one, the nearest first. A true line that is too short to be looked for is
//! no loss where it is missed and no false line where it is found.

mod outputs;

pub use outputs::{json, table};
pub(super) use outputs::{statistic, statistic_exists};

use super::statistics::{percentile, wrap_angle};
use crate::record::{Segment, Stamp};
use std::collections::BTreeMap;
use std::f64::consts::{FRAC_PI_2, PI};

/// When a found line is a true one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Matching {
    /// Noise of a point, m.
    pub point_sigma_m: f64,
    /// Probability that a found line passes the gate.
    pub probability: f64,
    /// Floor of the offset at the centre, standard deviation, m.
    pub floor_m: f64,
    /// Floor of the direction, standard deviation, rad.
    pub floor_rad: f64,
    /// Least overlap, as a share of the shorter line.
    pub overlap: f64,
    /// Fewest beams of a line that counts.
    pub min_points: u32,
    /// Shortest line that counts, m.
    pub min_length_m: f64,
}

impl Default for Matching {
    fn default() -> Self {
        Matching {
            point_sigma_m: 0.02,
            probability: 0.99,
            floor_m: 0.01,
            floor_rad: 0.5f64.to_radians(),
            overlap: 0.5,
            min_points: 9,
            min_length_m: 0.5,
        }
    }
}

/// Mean, spread and middle of one error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// Mean.
    pub mean: f64,
    /// Standard deviation (n - 1).
    pub std: f64,
    /// Median of the absolute values.
    pub median_abs: f64,
}

impl Spread {
    fn of(values: &[f64]) -> Spread {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let squares: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
        Spread {
            mean,
            std: (squares / (n - 1.0)).sqrt(),
            median_abs: median(values.iter().map(|v| v.abs())),
        }
    }
}

/// The score of one extractor. Statistics without enough values are NaN.
#[derive(Clone, Debug, PartialEq)]
pub struct Score {
    /// The run's name.
    pub name: String,
    /// Where its segments came from.
    pub source: String,
    /// True lines that count.
    pub true_lines: usize,
    /// Found lines that count.
    pub lines: usize,
    /// Found lines that are true ones.
    pub matches: usize,
    /// Error of d, m.
    pub d_m: Spread,
    /// Error of alpha, rad.
    pub alpha_rad: Spread,
    /// Offset at the true segment's centre, m. Unlike d it is no extrapolation to the foot point.
    pub centre_m: Spread,
    /// Mean and median of e' P^-1 e with each line's own covariance; 2 and 1.386 where it is honest.
    pub nees: [f64; 2],
    /// Median of found over true length.
    pub length_ratio: f64,
}

impl Score {
    /// Share of the true lines that were found, eq. 4.1, %.
    pub fn true_positive_pct(&self) -> f64 {
        100.0 * self.matches as f64 / self.true_lines as f64
    }

    /// Share of the found lines that are no true ones, eq. 4.1, %; 0 where nothing was found.
    pub fn false_positive_pct(&self) -> f64 {
        100.0 * (self.lines - self.matches) as f64 / self.lines.max(1) as f64
    }
}

/// The errors of the matched lines.
#[derive(Default)]
struct Errors {
    d_m: Vec<f64>,
    alpha_rad: Vec<f64>,
    centre_m: Vec<f64>,
    nees: Vec<f64>,
    length_ratio: Vec<f64>,
}

/// A possible pair.
struct Pair {
    /// Squared distance; for sorting, pairs with lines that count come first.
    order: f64,
    truth: usize,
    found: usize,
    difference: Difference,
}

/// Scores segments against the true ones of the same stamps.
pub fn score(
    name: &str,
    source: &str,
    truth: &[Segment],
    segments: &[Segment],
    matching: &Matching,
) -> Score {
    let counts =
        |s: &Segment| s.points >= matching.min_points && length_m(s) >= matching.min_length_m;
    let mut scans: BTreeMap<Stamp, [Vec<&Segment>; 2]> = BTreeMap::new();
    for line in truth {
        scans.entry(line.stamp).or_default()[0].push(line);
    }
    for line in segments.iter().filter(|line| counts(line)) {
        scans.entry(line.stamp).or_default()[1].push(line);
    }
    let mut errors = Errors::default();
    let mut spared = 0;
    for [truth, found] in scans.values() {
        for pair in pairs(truth, found, counts, matching) {
            let (t, f) = (truth[pair.truth], found[pair.found]);
            if counts(t) {
                errors.add(t, f, &pair.difference);
            } else {
                spared += 1;
            }
        }
    }
    let matched = errors.d_m.len();
    let nees = errors.nees.len() as f64;
    Score {
        name: name.to_owned(),
        source: source.to_owned(),
        true_lines: truth.iter().filter(|line| counts(line)).count(),
        lines: scans.values().map(|[_, found]| found.len()).sum::<usize>() - spared,
        matches: matched,
        d_m: Spread::of(&errors.d_m),
        alpha_rad: Spread::of(&errors.alpha_rad),
        centre_m: Spread::of(&errors.centre_m),
        nees: [
            errors.nees.iter().sum::<f64>() / nees,
            median(errors.nees.iter().copied()),
        ],
        length_ratio: median(errors.length_ratio.iter().copied()),
    }
}

/// The pairs of one scan, one to one, the nearest first.
fn pairs(
    truth: &[&Segment],
    found: &[&Segment],
    counts: impl Fn(&Segment) -> bool,
    matching: &Matching,
) -> Vec<Pair> {
    // The quantile of chi-square with two degrees of freedom in closed form.
    let gate = -2.0 * (1.0 - matching.probability).ln();
    let mut possible = Vec::new();
    for (i, t) in truth.iter().enumerate() {
        let covariance = gate_covariance(t, matching);
        for (k, f) in found.iter().enumerate() {
            let difference = Difference::of(t, f);
            let Some(distance) = difference.distance(covariance) else {
                continue;
            };
            if distance <= gate && overlap(t, f) >= matching.overlap {
                // A short neighbour must not take a line from the one that counts.
                let later = if counts(t) { 0.0 } else { 1e3 };
                possible.push(Pair {
                    order: distance + later,
                    truth: i,
                    found: k,
                    difference,
                });
            }
        }
    }
    possible.sort_by(|a, b| a.order.total_cmp(&b.order));
    let (mut truth_taken, mut found_taken) = (vec![false; truth.len()], vec![false; found.len()]);
    possible.retain(|pair| {
        let free = !truth_taken[pair.truth] && !found_taken[pair.found];
        if free {
            truth_taken[pair.truth] = true;
            found_taken[pair.found] = true;
        }
        free
    });
    possible
}

impl Errors {
    fn add(&mut self, truth: &Segment, found: &Segment, difference: &Difference) {
        self.d_m.push(difference.d_m);
        self.alpha_rad.push(difference.alpha_rad);
        self.centre_m.push(difference.centre_m);
        let [dd, da, aa] = found.covariance;
        if dd > 0.0 && aa > 0.0 {
            self.nees.extend(difference.distance([dd, da, aa]));
        }
        self.length_ratio.push(length_m(found) / length_m(truth));
    }
}

/// Found minus true.
#[derive(Clone, Copy, Debug)]
struct Difference {
    d_m: f64,
    alpha_rad: f64,
    /// Offset at the true segment's centre, m.
    centre_m: f64,
}

impl Difference {
    fn of(truth: &Segment, found: &Segment) -> Difference {
        let mut alpha_rad = wrap_angle(found.normal.alpha_rad - truth.normal.alpha_rad);
        let mut d_m = found.normal.d_m;
        // A line near the scanner may be seen with the opposite normal.
        if alpha_rad.abs() > FRAC_PI_2 {
            alpha_rad = wrap_angle(alpha_rad + PI);
            d_m = -d_m;
        }
        let [y, z] = centre_m(truth);
        let (sin, cos) = (truth.normal.alpha_rad + alpha_rad).sin_cos();
        Difference {
            d_m: d_m - truth.normal.d_m,
            alpha_rad,
            centre_m: d_m - (y * cos + z * sin),
        }
    }

    /// e' P^-1 e for P as variance of d, covariance, variance of alpha; none where P is singular.
    fn distance(&self, [dd, da, aa]: [f64; 3]) -> Option<f64> {
        let det = dd * aa - da * da;
        let (x, y) = (self.d_m, self.alpha_rad);
        (det > 0.0).then(|| (aa * x * x - 2.0 * da * x * y + dd * y * y) / det)
    }
}

/// The gate's covariance of (d, alpha): a fit to the true line's points and the floor.
fn gate_covariance(truth: &Segment, matching: &Matching) -> [f64; 3] {
    let points = f64::from(truth.points).max(2.0);
    let length_m = length_m(truth).max(1e-3);
    let noise_m2 = matching.point_sigma_m.powi(2);
    let offset_m2 = noise_m2 / points + matching.floor_m.powi(2);
    let angle_rad2 = 12.0 * noise_m2 / (points * length_m * length_m) + matching.floor_rad.powi(2);
    // The foot point lies this far from the centre: d = offset + along * alpha.
    let along_m = along(truth, centre_m(truth));
    [
        offset_m2 + along_m * along_m * angle_rad2,
        along_m * angle_rad2,
        angle_rad2,
    ]
}

/// Overlap along the true line as a share of the shorter one.
fn overlap(truth: &Segment, found: &Segment) -> f64 {
    let span = |segment: &Segment| {
        let [a, b] = segment.ends_m.map(|end| along(truth, end));
        [a.min(b), a.max(b)]
    };
    let ([a0, a1], [b0, b1]) = (span(truth), span(found));
    (a1.min(b1) - a0.max(b0)).max(0.0) / (a1 - a0).min(b1 - b0).max(1e-6)
}

/// Position of a point along a segment's line, m from the foot point.
fn along(segment: &Segment, [y, z]: [f64; 2]) -> f64 {
    let (sin, cos) = segment.normal.alpha_rad.sin_cos();
    z * cos - y * sin
}

fn centre_m(segment: &Segment) -> [f64; 2] {
    let [[y0, z0], [y1, z1]] = segment.ends_m;
    [(y0 + y1) / 2.0, (z0 + z1) / 2.0]
}

fn length_m(segment: &Segment) -> f64 {
    let [[y0, z0], [y1, z1]] = segment.ends_m;
    (y1 - y0).hypot(z1 - z0)
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    percentile(&values, 50.0)
}

#[cfg(test)]
mod tests;
