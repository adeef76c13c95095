//! What a calibration found: values, what was known before and after, and what the run did not show.

use super::bundle::Solution;
use super::parameters::{self, Layout, TURN, Turned, X_CONSTANT};
use super::{Settings, parameters::rigid_patterns};
use crate::frame::Frame;
use nalgebra::{DMatrix, DVector};

/// A parameter of which the run leaves more than this share of the prior's standard deviation stays
/// as it was.
const SHOWN: f64 = 0.8;

/// One parameter, in the unit that `unit` names.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// The key in the frame file, as `strip[2].offset_m`.
    pub key: String,
    /// mm, deg, ppm, or nothing.
    pub unit: &'static str,
    /// Change against the frame file; 0 where it stays.
    pub change: f64,
    /// Standard deviation before the run.
    pub prior: f64,
    /// And after it.
    pub posterior: f64,
    /// Whether the run shows it.
    pub shown: bool,
    /// What takes it up, where that is known.
    pub remark: &'static str,
}

/// A common movement of the strips.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pattern {
    /// What it is.
    pub name: &'static str,
    /// Standard deviation of its amplitude after the run over that before: 1 is not shown at all.
    pub left: f64,
}

/// What was found.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    /// The frame with what the run shows put in.
    pub frame: Frame,
    /// Parameter by parameter.
    pub entries: Vec<Entry>,
    /// Movements of the frame as a whole.
    pub patterns: Vec<Pattern>,
    /// Directions in the space of the parameters of which the run leaves more than 80 % of the prior,
    /// and all.
    pub hidden: [usize; 2],
    /// Largest over smallest information of a direction, in the measure of the prior: the condition
    /// number of the normal equations.
    pub condition: f64,
    /// Scans used.
    pub scans: usize,
    /// Edges used, those of them with a sub-beam measurement, and those refused.
    pub edges: [usize; 3],
    /// Standard deviation of the scans' range biases around the common one, m.
    pub bias_spread_m: f64,
}

/// Makes the result.
pub(super) fn conclude(
    solution: &Solution,
    frame: &Frame,
    prior_sigmas: &DVector<f64>,
    settings: &Settings,
    bias_spread_m: f64,
) -> Calibration {
    let layout = Layout {
        strips: frame.strips.len(),
    };
    // Where nothing was measured with a footprint, the run has no say in it.
    let left = |k: usize| solution.covariance[(k, k)].sqrt() / prior_sigmas[k];
    let single = 3 * layout.strips..layout.count();
    let constant = layout.other(X_CONSTANT);
    let mut held: Vec<usize> = single
        .filter(|k| *k != constant && left(*k) > SHOWN)
        .collect();
    held.extend(
        (0..layout.strips)
            .map(|s| layout.inclination(s))
            .filter(|k| left(*k) > SHOWN),
    );
    for strip in 0..layout.strips {
        let ends = [layout.edge(strip, true), layout.edge(strip, false)];
        if ends.iter().all(|k| left(*k) > SHOWN) {
            held.extend(ends);
        }
    }
    let mean = conditioned(solution, &held);
    let values = |which: &DVector<f64>| combined(which, layout);
    let after: Vec<f64> = deviations(&solution.covariance, layout);
    let prior = DMatrix::from_diagonal(&prior_sigmas.map(|s| s * s));
    let before: Vec<f64> = deviations(&prior, layout);
    let changes = values(&mean);
    let mut entries = Vec::new();
    for (k, (key, factor, unit, remark)) in keys(layout, settings.turned).into_iter().enumerate() {
        let entry = Entry {
            key,
            unit,
            change: changes[k] * factor,
            prior: before[k] * factor,
            posterior: after[k] * factor,
            shown: after[k] <= SHOWN * before[k],
            remark,
        };
        entries.push(entry);
    }
    let patterns = rigid_patterns(frame)
        .into_iter()
        .zip(["common shift along x", "common turn about the vertical"])
        .map(|(direction, name)| Pattern {
            name,
            left: pattern_left(&direction, &solution.covariance, prior_sigmas),
        });
    let patterns = patterns.collect();
    let whitened = DMatrix::from_fn(layout.count(), layout.count(), |i, j| {
        solution.covariance[(i, j)] / (prior_sigmas[i] * prior_sigmas[j])
    });
    let shares = whitened.symmetric_eigenvalues();
    let hidden = shares.iter().filter(|s| **s > SHOWN * SHOWN).count();
    Calibration {
        frame: parameters::parted(parameters::applied(frame, &mean, settings.turned)),
        entries,
        patterns,
        hidden: [hidden, layout.count()],
        condition: shares.max() / shares.min().max(1e-300),
        scans: solution.scans,
        edges: [
            solution.edges - solution.refused,
            solution.measured,
            solution.refused,
        ],
        bias_spread_m,
    }
}

/// The mean of the parameters where those in `held` are as the frame file says.
fn conditioned(solution: &Solution, held: &[usize]) -> DVector<f64> {
    let c = &solution.covariance;
    let part = DMatrix::from_fn(held.len(), held.len(), |i, j| c[(held[i], held[j])]);
    let off = DVector::from_fn(held.len(), |i, _| solution.mean[held[i]]);
    let Some(weights) = part.cholesky().map(|p| p.solve(&off)) else {
        return solution.mean.clone();
    };
    let mut mean = DVector::from_fn(solution.mean.len(), |k, _| {
        let towards: f64 = held
            .iter()
            .zip(weights.iter())
            .map(|(h, w)| c[(k, *h)] * w)
            .sum();
        solution.mean[k] - towards
    });
    for h in held {
        mean[*h] = 0.0;
    }
    mean
}

/// The parameters as people have them: of each strip offset, width and inclination, then the others.
fn combined(mean: &DVector<f64>, layout: Layout) -> Vec<f64> {
    let mut values = Vec::new();
    for strip in 0..layout.strips {
        let (upper, lower) = (
            mean[layout.edge(strip, true)],
            mean[layout.edge(strip, false)],
        );
        let inclination = mean[layout.inclination(strip)];
        values.extend([0.5 * (upper + lower), upper - lower, inclination]);
    }
    let others = (0..X_CONSTANT).map(|k| mean[layout.other(k)]);
    values.extend(others);
    values
}

/// Their standard deviations.
fn deviations(covariance: &DMatrix<f64>, layout: Layout) -> Vec<f64> {
    let c = |i: usize, j: usize| covariance[(i, j)];
    let mut values = Vec::new();
    for strip in 0..layout.strips {
        let (u, l) = (layout.edge(strip, true), layout.edge(strip, false));
        let (sum, both) = (c(u, u) + c(l, l), 2.0 * c(u, l));
        let inclination = layout.inclination(strip);
        let variances = [0.25 * (sum + both), sum - both, c(inclination, inclination)];
        values.extend(variances.map(f64::sqrt));
    }
    values.extend((0..X_CONSTANT).map(|k| c(layout.other(k), layout.other(k)).sqrt()));
    values
}

type Key = (String, f64, &'static str, &'static str);

/// Key, factor from SI to the unit, unit and remark of each of [`combined`].
fn keys(layout: Layout, turned: Turned) -> Vec<Key> {
    let degrees = 1f64.to_degrees();
    let mut keys: Vec<Key> = Vec::new();
    for strip in 0..layout.strips {
        let key = |name: &str| format!("strip[{strip}].{name}");
        keys.push((key("offset_m"), 1e3, "mm", ""));
        keys.push((key("width_m"), 1e3, "mm", ""));
        keys.push((key("inclination_deg"), degrees, "deg", ""));
    }
    let device = match turned {
        Turned::Imu => "imu",
        Turned::Scanner => "scanner",
    };
    let turn = |axis: &str| format!("{device}.rotation_deg {axis}");
    keys.extend([
        (
            "box.dy_m".to_owned(),
            1e3,
            "mm",
            "the range bias takes it up",
        ),
        ("box.dz_m".to_owned(), 1e3, "mm", "goes 1:1 into z"),
        ("calibration.range_bias_m".to_owned(), 1e3, "mm", ""),
        ("calibration.range_scale".to_owned(), 1e6, "ppm", ""),
        (
            "calibration.hit_threshold".to_owned(),
            1.0,
            "spot radii",
            "",
        ),
        ("calibration.footprint_scale".to_owned(), 1.0, "", ""),
        (turn("roll"), degrees, "deg", ""),
        (turn("pitch"), degrees, "deg", ""),
        (
            turn("yaw"),
            degrees,
            "deg",
            "the platform's yaw takes it up",
        ),
    ]);
    debug_assert_eq!(keys.len(), 3 * layout.strips + TURN[2] + 1);
    keys
}

/// How much of the prior of the amplitude of a movement is left.
fn pattern_left(
    direction: &DVector<f64>,
    covariance: &DMatrix<f64>,
    prior_sigmas: &DVector<f64>,
) -> f64 {
    // The amplitude is w . parameters, with the weights that the prior gives.
    let scaled = direction.zip_map(prior_sigmas, |d, s| d / (s * s));
    let prior = 1.0 / direction.dot(&scaled);
    let weights = scaled * prior;
    (weights.dot(&(covariance * &weights)) / prior).sqrt()
}
