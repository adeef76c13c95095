//! Where a run of poses stands still, the mean pose of each standstill, and what it is worth.
//!
//! Whether the platform stands at an instant is decided from the poses about it alone: over a window
//! the medians of the first and the second half are compared, component by component, with what the
//! poses' own covariances leave open and with the speed that still counts as standing. Medians, so
//! that a few wrong poses do not matter; a chi-square limit that a standing platform goes beyond once
//! in ten thousand windows. Windows that pass make intervals, the ends of which are cut back where
//! motion begins.
//!
//! What the mean of a standstill is worth is said by a [`Component`]; what the poses' covariances
//! themselves leave out (a frame surveyed wrongly) is not in it.

mod component;
mod outputs;
#[cfg(test)]
mod tests;

pub use component::Component;
pub use outputs::{csv, json, table};
pub(super) use outputs::{statistic, statistic_exists};

use super::association::Reference;
use super::consistency::chi_squared_quantile;
use super::measured::{lacking, measured};
use super::statistics::{percentile, wrap_angle};
use crate::record::{Pose, Stamp};

/// When a platform stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Criteria {
    /// Shortest standstill, s.
    pub least_s: f64,
    /// Slower than this counts as standing, however exactly the poses could tell, m/s.
    pub still_m_s: f64,
    /// The same for the angles, rad/s.
    pub still_rad_s: f64,
}

impl Default for Criteria {
    fn default() -> Self {
        Criteria {
            least_s: 0.5,
            still_m_s: 1e-3,
            still_rad_s: 0.05f64.to_radians(),
        }
    }
}

/// One standstill.
#[derive(Clone, Debug, PartialEq)]
pub struct Standing {
    /// Its first pose.
    pub first: Stamp,
    /// Its last pose.
    pub last: Stamp,
    /// Poses in the mean.
    pub poses: usize,
    /// Poses between first and last that contradict the others by more than six of their scatters.
    pub left_out: usize,
    /// x, y, z, roll, pitch, yaw.
    pub components: [Component; 6],
    /// Desired minus mean, m and rad; none where nothing is desired, NaN where a component is not.
    pub correction: Option<[f64; 6]>,
}

impl Standing {
    /// How long it lasts, s.
    pub fn duration_s(&self) -> f64 {
        self.last.since_s(self.first)
    }

    /// The correction's length, m.
    pub fn distance_m(&self) -> Option<f64> {
        let [x, y, z, ..] = self.correction?;
        Some((x * x + y * y + z * z).sqrt())
    }
}

/// What a correction is made to.
#[derive(Clone, Debug)]
pub enum Desired {
    /// One pose for all standstills, m and rad; NaN for what is not desired.
    Home([f64; 6]),
    /// A desired trajectory.
    Trajectory(Reference),
}

/// The standstills of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// In order of time.
    pub standing: Vec<Standing>,
    /// Intervals that passed window by window but creep as a whole.
    pub creeping: usize,
    /// Poses with numbers, and all.
    pub poses: [usize; 2],
    /// First pose of the run.
    pub start: Stamp,
    /// Whether the poses came without covariances, so that the fixed part is not known.
    pub without_covariance: bool,
}

/// What a pose measured, in numbers; angles near the run's first.
struct Sample {
    stamp: Stamp,
    t_s: f64,
    /// NaN where not measured.
    value: [f64; 6],
    variance: [f64; 6],
}

/// The quantile of the normal distribution that one of 10 000 is beyond.
const RARE: f64 = 3.719;
/// Fewest poses of a window.
const FEW: usize = 8;
/// Scatters from the median at which an end is cut back, and at which a pose is left out.
const END: f64 = 3.5;
const OUTLIER: f64 = 6.0;
/// 1.4826 MAD is the standard deviation of normal numbers.
const MAD_TO_SIGMA: f64 = 1.4826;

/// Finds the standstills of a run of poses in order of time.
pub fn find(poses: &[Pose], criteria: &Criteria, desired: Option<&Desired>) -> Found {
    let samples = samples(poses);
    let mut found = Found {
        standing: Vec::new(),
        creeping: 0,
        poses: [samples.len(), poses.len()],
        start: samples.first().map_or(Stamp::default(), |s| s.stamp),
        without_covariance: samples.iter().all(|s| !s.variance.iter().any(|v| *v > 0.0)),
    };
    let noise = noise(&samples);
    let mut kept: Vec<Vec<&Sample>> = Vec::new();
    for piece in unbroken(&samples, criteria) {
        for interval in still_intervals(piece, criteria, &noise) {
            let inside = without_outliers(interval);
            match kept.last_mut() {
                Some(last) if one_place(last, &inside, criteria) => {
                    // Intervals may share poses; each counts once.
                    let end = last.last().map(|sample| sample.stamp);
                    last.extend(inside.into_iter().filter(|s| Some(s.stamp) > end));
                }
                _ => kept.push(inside),
            }
        }
    }
    for inside in kept {
        let (Some(first), Some(last)) = (inside.first(), inside.last()) else {
            continue;
        };
        if last.t_s - first.t_s < criteria.least_s * (1.0 - 1e-9) || inside.len() < FEW {
            continue;
        }
        let within = samples
            .iter()
            .filter(|s| s.stamp >= first.stamp && s.stamp <= last.stamp);
        let components = std::array::from_fn(|k| Component::of(&inside, k));
        if creeps(&components, criteria) {
            found.creeping += 1;
            continue;
        }
        found.standing.push(Standing {
            first: first.stamp,
            last: last.stamp,
            poses: inside.len(),
            left_out: within.count().saturating_sub(inside.len()),
            components,
            correction: desired.and_then(|d| correction(d, &inside, &components)),
        });
    }
    for k in 0..6 {
        let components = found.standing.iter_mut().map(|s| &mut s.components[k]);
        component::tell_what_stays(components);
    }
    found
}

fn samples(poses: &[Pose]) -> Vec<Sample> {
    let mut start = None;
    let mut about: [Option<f64>; 6] = [None; 6];
    let solved = poses.iter().filter(|pose| lacking(pose).is_some());
    let mut samples: Vec<Sample> = solved
        .map(|pose| {
            let mut value = measured(pose);
            // About the first one, so that no angle is torn by the seam.
            for (angle, about) in value.iter_mut().zip(&mut about).skip(3) {
                if angle.is_finite() {
                    let about = *about.get_or_insert(*angle);
                    *angle = about + wrap_angle(*angle - about);
                }
            }
            Sample {
                stamp: pose.stamp,
                t_s: pose.stamp.since_s(*start.get_or_insert(pose.stamp)),
                value,
                variance: std::array::from_fn(|k| pose.cov(k, k)),
            }
        })
        .collect();
    samples.sort_by_key(|s| s.stamp);
    samples.dedup_by_key(|s| s.stamp);
    samples
}

/// Standard deviation of each component from pose to pose, for poses without covariance: from
/// second differences, which steady motion leaves alone.
fn noise(samples: &[Sample]) -> [f64; 6] {
    std::array::from_fn(|k| {
        let second = samples
            .windows(3)
            .map(|w| (w[0].value[k] - 2.0 * w[1].value[k] + w[2].value[k]).abs());
        MAD_TO_SIGMA * median(second) / 6f64.sqrt()
    })
}

/// The run in pieces without a gap in time.
fn unbroken<'s>(samples: &'s [Sample], criteria: &Criteria) -> Vec<&'s [Sample]> {
    let spacing_s = median(samples.windows(2).map(|w| w[1].t_s - w[0].t_s));
    let longest_s = (0.5 * criteria.least_s).max(5.0 * spacing_s);
    let gap = |a: &Sample, b: &Sample| b.t_s - a.t_s <= longest_s;
    samples.chunk_by(gap).collect()
}

/// Stretches of a piece in which the platform stands, by windows.
fn still_intervals<'s>(
    piece: &'s [Sample],
    criteria: &Criteria,
    noise: &[f64; 6],
) -> Vec<&'s [Sample]> {
    let spacing_s = median(piece.windows(2).map(|w| w[1].t_s - w[0].t_s));
    let window_s = criteria.least_s.max(FEW as f64 * spacing_s);
    let (Some(begin), Some(end)) = (piece.first(), piece.last()) else {
        return Vec::new();
    };
    // Windows that would reach beyond the piece are pushed back into it.
    let latest_s = (end.t_s - window_s).max(begin.t_s);
    let mut from = 0;
    let mut still = vec![false; piece.len()];
    for (at, still) in piece.iter().zip(&mut still) {
        let start_s = (at.t_s - 0.5 * window_s).clamp(begin.t_s, latest_s);
        while piece.get(from).is_some_and(|s| s.t_s < start_s - 1e-9) {
            from += 1;
        }
        let rest = piece.get(from..).unwrap_or_default();
        let count = rest.partition_point(|s| s.t_s <= start_s + window_s + 1e-9);
        *still = stands(rest.get(..count).unwrap_or_default(), criteria, noise);
    }
    let runs = runs(&still);
    let mut intervals = Vec::new();
    for (i, run) in runs.iter().enumerate() {
        let time = |index: usize| piece.get(index).map_or(f64::NAN, |s| s.t_s);
        // All poses of a window that passed stand, but half way to the next run that is its own.
        let before = i.checked_sub(1).and_then(|j| runs.get(j));
        let after = runs.get(i + 1);
        let quarter_s = 0.25 * window_s;
        let from_s = match before {
            Some(other) => {
                (time(run.start) - quarter_s).max(0.5 * (time(other.end - 1) + time(run.start)))
            }
            None if run.start == 0 => begin.t_s,
            None => time(run.start) - quarter_s,
        };
        let to_s = match after {
            Some(other) => {
                (time(run.end - 1) + quarter_s).min(0.5 * (time(run.end - 1) + time(other.start)))
            }
            None if run.end == piece.len() => end.t_s,
            None => time(run.end - 1) + quarter_s,
        };
        let first = piece.partition_point(|s| s.t_s < from_s);
        let last = piece.partition_point(|s| s.t_s <= to_s);
        intervals.extend(piece.get(first..last));
    }
    intervals
}

/// The stretches of true.
fn runs(still: &[bool]) -> Vec<std::ops::Range<usize>> {
    let mut at = 0;
    let mut runs = Vec::new();
    for run in still.chunk_by(|a, b| a == b) {
        if run.first() == Some(&true) {
            runs.push(at..at + run.len());
        }
        at += run.len();
    }
    runs
}

/// Whether the poses of a window tell no motion.
fn stands(window: &[Sample], criteria: &Criteria, noise: &[f64; 6]) -> bool {
    if window.len() < FEW {
        return false;
    }
    let (first, second) = window.split_at(window.len() / 2);
    let mean_s = |half: &[Sample]| half.iter().map(|s| s.t_s).sum::<f64>() / half.len() as f64;
    let apart_s = mean_s(second) - mean_s(first);
    let (mut chi_squared, mut dof) = (0.0, 0.0);
    for (k, noise) in noise.iter().enumerate() {
        let known = |half: &[Sample]| half.iter().filter(|s| s.value[k].is_finite()).count();
        let n = [known(first), known(second)];
        if n[0] < 2 || n[1] < 2 {
            continue;
        }
        let middle = |half: &[Sample]| median(half.iter().map(|s| s.value[k]));
        let moved = middle(second) - middle(first);
        let variances = window.iter().map(|s| s.variance[k]);
        let variance = mean(variances.filter(|v| v.is_finite() && *v > 0.0));
        let variance = if variance > 0.0 {
            variance
        } else {
            noise * noise
        };
        // The median of n normal numbers has pi / 2 times the variance of their mean.
        let of_medians =
            std::f64::consts::FRAC_PI_2 * variance * (1.0 / n[0] as f64 + 1.0 / n[1] as f64);
        let floor = if k < 3 {
            criteria.still_m_s
        } else {
            criteria.still_rad_s
        } * apart_s;
        chi_squared += moved * moved / (of_medians + floor * floor).max(1e-18);
        dof += 1.0;
    }
    if dof == 0.0 {
        return false;
    }
    chi_squared <= chi_squared_quantile(dof, RARE)
}

/// The poses of an interval that agree with it, its ends cut back to where they do.
fn without_outliers(interval: &[Sample]) -> Vec<&Sample> {
    let middle: [f64; 6] = std::array::from_fn(|k| median(interval.iter().map(|s| s.value[k])));
    let scatter: [f64; 6] = std::array::from_fn(|k| {
        let off = interval.iter().map(|s| (s.value[k] - middle[k]).abs());
        (MAD_TO_SIGMA * median(off)).max(1e-7)
    });
    let off = |s: &Sample| {
        let off = (0..6).map(|k| (s.value[k] - middle[k]).abs() / scatter[k]);
        off.filter(|v| v.is_finite()).fold(0.0, f64::max)
    };
    let agrees = |s: &&Sample| off(s) <= END;
    let first = interval.iter().position(|s| agrees(&s)).unwrap_or(0);
    let last = interval
        .iter()
        .rposition(|s| agrees(&s))
        .map_or(0, |i| i + 1);
    let inside = interval.get(first..last).unwrap_or_default();
    inside.iter().filter(|s| off(s) <= OUTLIER).collect()
}

/// Whether two neighbouring stretches are one standstill, parted by a window that failed by chance.
fn one_place(before: &[&Sample], after: &[&Sample], criteria: &Criteria) -> bool {
    let (Some(end), Some(begin)) = (before.last(), after.first()) else {
        return after.is_empty();
    };
    if begin.t_s - end.t_s > criteria.least_s {
        return false;
    }
    (0..6).all(|k| {
        let [a, b] = [before, after].map(|samples| Component::of(samples, k));
        let apart = (a.mean - b.mean).abs();
        // What does not average out is the same for both.
        !(apart > 4.0 * a.averaging.hypot(b.averaging) + 1e-6)
    })
}

/// Whether an interval as a whole moves surely faster than what counts as standing.
fn creeps(components: &[Component; 6], criteria: &Criteria) -> bool {
    components.iter().enumerate().any(|(k, c)| {
        let still = if k < 3 {
            criteria.still_m_s
        } else {
            criteria.still_rad_s
        };
        c.drift.abs() - 3.0 * c.drift_sigma > still
    })
}

/// Desired minus mean; none where nothing is desired at that time.
fn correction(
    desired: &Desired,
    inside: &[&Sample],
    components: &[Component; 6],
) -> Option<[f64; 6]> {
    let wanted: [f64; 6] = match desired {
        Desired::Home(pose) => *pose,
        Desired::Trajectory(reference) => {
            let poses: Vec<[f64; 6]> = inside
                .iter()
                .filter_map(|s| reference.at(s.stamp).ok())
                .map(|(pose, _)| pose)
                .collect();
            let first = poses.first()?;
            std::array::from_fn(|k| {
                let near = |v: f64| {
                    if k < 3 {
                        v
                    } else {
                        first[k] + wrap_angle(v - first[k])
                    }
                };
                // A jump of the trajectory may be near an end.
                median(poses.iter().map(|p| near(p[k])))
            })
        }
    };
    Some(std::array::from_fn(|k| {
        let difference = wanted[k] - components[k].mean;
        if k < 3 {
            difference
        } else {
            wrap_angle(difference)
        }
    }))
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut n) = (0.0, 0.0);
    for value in values {
        sum += value;
        n += 1.0;
    }
    sum / n
}

/// The median of the numbers among `values`; NaN where there is none.
fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.filter(|v| v.is_finite()).collect();
    values.sort_unstable_by(f64::total_cmp);
    percentile(&values, 50.0)
}
