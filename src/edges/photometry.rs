//! Where between two beams a strip's edge lies, from how bright the beams about it are.
//!
//! A beam whose spot lies on the strip with the share f has the remission L (B + (A - B) f): A and
//! B are the strip's and the background's remission, L is the law by which both fall with the angle
//! of incidence, cos^p. The share is that of a uniform disc cut by the edge,
//! `F(q) = 1/2 + (q sqrt(1 - q^2) + asin q)/pi` with q the edge's distance from the beam's axis,
//! across the beam and in spot radii. Both edges of a strip, A, B and p are fitted together, so that
//! the edges' covariances hold what the levels leave open. Where the device sends the echoes of
//! strip and background apart, the ratio of the two gives f without a level.
//!
//! Everything is in beam angles: an edge and the scanner's origin span a plane, which the scan plane
//! cuts at the edge's angle, and a beam's distance from that plane is a sine.

use crate::frame::disc_share;
use nalgebra::{SMatrix, SVector};

/// Fitted: angles of both edges, A, B, p.
const N: usize = 5;
const FIRST: usize = 0;
const SECOND: usize = 1;
const STRIP: usize = 2;
const BEHIND: usize = 3;
const EXPONENT: usize = 4;

const ITERATIONS: usize = 8;
/// Residuals beyond this many sigma are weighted down, and beyond the other left out.
const HUBER: f64 = 2.5;
const CUT: f64 = 6.0;
/// Iterations in which beams near an edge keep their weight, because the edge may still be off.
const LENIENT: usize = 2;
/// An edge has been found when a step is below this share of a spot radius, and is good enough at
/// the end with the other; sigma is some hundredths of a radius.
const CONVERGED: f64 = 0.01;
const SETTLED: f64 = 0.05;
/// Prior standard deviation of an edge, in lengths within which it is.
const EDGE_PRIOR: f64 = 3.0;
/// From this iteration on steps are halved.
const SWINGING: usize = 5;
/// An edge goes no further in one step, spot radii.
const STEP_MAX: f64 = 0.7;
/// Standard deviation of the rounding to whole digits, digits.
const ROUNDING: f64 = 0.289;
/// Shares are kept from 0 and 1 by this where a logarithm is taken.
const SHARE_MIN: f64 = 0.01;

/// What of a beam's light was measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Light {
    /// All of it, as one echo.
    Whole,
    /// The echo of the strip.
    Strip,
    /// The echo of the background.
    Behind,
    /// Both echoes: the logarithm of strip over background.
    Ratio,
}

/// A beam about a strip.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sample {
    /// Angle of the beam, seen from the reference instant, rad.
    pub angle_rad: f64,
    /// Spot radii across the beam that a radian makes at the edges.
    pub spots_per_rad: f64,
    /// What was measured.
    pub light: Light,
    /// The remission, corrected for range; the logarithm of a ratio.
    pub value: f64,
    /// Standard deviation of the value from rounding, in its unit.
    pub rounding: f64,
    /// Logarithm of the cosine of incidence of the surface that the value belongs to; the
    /// difference of two for a ratio.
    pub ln_cos: f64,
}

impl Sample {
    /// Rounding error of a remission of `digits` that was corrected to `value`.
    pub fn rounding(value: f64, digits: f64) -> f64 {
        ROUNDING * value / digits.max(1.0)
    }
}

/// Where a fit starts and what is known before it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Start {
    /// Angles of the first and second edge in beam order, rad; none where it is out of sight.
    pub edges_rad: [Option<f64>; 2],
    /// Within about what angle of that each is, rad.
    pub reach_rad: [f64; 2],
    /// A and B.
    pub levels: [f64; 2],
    /// p and its standard deviation.
    pub exponent: (f64, f64),
    /// Relative noise of a remission, and of the ratio of two echoes.
    pub noise: [f64; 2],
}

/// A strip's edges and what they were found with.
#[derive(Clone, Copy, Debug)]
pub(super) struct StripFit {
    /// Angles, rad.
    pub edges_rad: [f64; 2],
    /// Their covariance, rad^2; infinite variance where there is no edge.
    pub covariance: [[f64; 2]; 2],
    /// Change of the angles with the footprint scale, rad for a scale of 1.
    pub d_footprint: [f64; 2],
    /// A and B.
    pub levels: [f64; 2],
    /// Standard deviation of A - B.
    pub contrast_sigma: f64,
    /// p as this strip alone tells it, and its information (1 / variance).
    pub exponent: (f64, f64),
    /// Sum of squared relative residuals and the degrees of freedom: of remissions, of ratios.
    pub scatter: [(f64, f64); 2],
    /// Mean squared normalised residual of the beams that each edge cuts.
    pub near_chi2: [f64; 2],
    /// Beams that each edge cuts.
    pub near: [u32; 2],
    /// Angle from each edge to the next beam on its strip and on its background, rad.
    pub closest_rad: [[f64; 2]; 2],
}

/// What the model says of one beam: the value, its derivatives, and the variance.
struct Prediction {
    value: f64,
    row: [f64; N],
    d_footprint: f64,
    variance: f64,
    /// Which edges cut the spot.
    cuts: [bool; 2],
}

/// Sums of the normal equations over beams.
#[derive(Clone, Copy, Default)]
struct Sums {
    /// Filled from its upper triangle when all beams are in.
    normal: SMatrix<f64, N, N>,
    gradient: SVector<f64, N>,
    footprint: SVector<f64, N>,
}

impl Sums {
    /// Adds a beam.
    fn add(&mut self, weight: f64, residual: f64, prediction: &Prediction) {
        let row = &prediction.row;
        for (i, own) in row.iter().enumerate() {
            let w = weight * own;
            for (j, other) in row.iter().enumerate().skip(i) {
                self.normal[(i, j)] += w * other;
            }
            self.gradient[i] += w * residual;
            self.footprint[i] += w * prediction.d_footprint;
        }
    }

    /// Adds what the beams tell that lie on one surface alone.
    fn add_level(&mut self, level: usize, sums: &LevelSums) {
        self.normal[(level, level)] += sums.level2;
        self.normal[(level, EXPONENT)] += sums.level_exponent;
        self.normal[(EXPONENT, EXPONENT)] += sums.exponent2;
        self.gradient[level] += sums.level_residual;
        self.gradient[EXPONENT] += sums.exponent_residual;
    }
}

/// Sums over the beams that lie on one surface alone, which are most of them: each tells of that
/// surface's level and of p, and of nothing else.
#[derive(Clone, Copy, Default)]
struct LevelSums {
    level2: f64,
    level_exponent: f64,
    exponent2: f64,
    level_residual: f64,
    exponent_residual: f64,
    /// Weighted squares of the relative residuals, and their number.
    scatter: (f64, f64),
}

impl LevelSums {
    /// Adds a beam on a surface of remission `level`.
    fn add(&mut self, sample: &Sample, level: f64, exponent: f64, noise: f64) {
        let by_level = small_exp(exponent * sample.ln_cos);
        let value = by_level * level;
        let (value2, rounding2) = (value * value, sample.rounding * sample.rounding);
        let residual = sample.value - value;
        let residual2 = residual * residual;
        let variance = noise * noise * value2 + rounding2;
        // One division for the inverse of the variance and that of the squared value.
        let inverse = 1.0 / (variance * value2);
        let information = value2 * inverse;
        let square = residual2 * information;
        let weight = huber(square);
        if weight == 0.0 || !square.is_finite() {
            return;
        }
        // What rounding adds is taken off, so that the rest is the noise.
        self.scatter.0 += weight * (residual2 - rounding2) * variance * inverse;
        self.scatter.1 += 1.0;
        let by_exponent = value * sample.ln_cos;
        let w = weight * information;
        let (w_level, w_exponent) = (w * by_level, w * by_exponent);
        self.level2 += w_level * by_level;
        self.level_exponent += w_level * by_exponent;
        self.exponent2 += w_exponent * by_exponent;
        self.level_residual += w_level * residual;
        self.exponent_residual += w_exponent * residual;
    }
}

/// The weight of a residual by its square in units of its variance.
fn huber(square: f64) -> f64 {
    if square > CUT * CUT {
        0.0
    } else if square > HUBER * HUBER {
        HUBER / square.sqrt()
    } else {
        1.0
    }
}

/// The level of the surface that a beam's whole spot lies on, [`STRIP`] or [`BEHIND`]; none where an
/// edge may cut it.
fn surface(p: &SVector<f64, N>, sample: &Sample, there: [bool; 2]) -> Option<usize> {
    let inwards_rad = [sample.angle_rad - p[FIRST], p[SECOND] - sample.angle_rad];
    let inside = |k: usize| {
        if there[k] {
            inwards_rad[k] * sample.spots_per_rad
        } else {
            f64::INFINITY
        }
    };
    let (less, more) = (inside(0).min(inside(1)), inside(0).max(inside(1)));
    let alone = sample.light == Light::Whole && less.abs() >= 1.0 && more >= 1.0;
    alone.then_some(if less > 0.0 { STRIP } else { BEHIND })
}

/// e^x, for the small powers of a cosine that occur within a window.
fn small_exp(x: f64) -> f64 {
    if x.abs() > 0.25 {
        return x.exp();
    }
    // The series to x^6 in pairs of terms, which need not wait for each other.
    const C: [f64; 5] = [1.0 / 2.0, 1.0 / 6.0, 1.0 / 24.0, 1.0 / 120.0, 1.0 / 720.0];
    let x2 = x * x;
    (1.0 + x) + x2 * ((C[0] + C[1] * x) + x2 * ((C[2] + C[3] * x) + C[4] * x2))
}

fn predict(p: &SVector<f64, N>, sample: &Sample, there: [bool; 2], noise: [f64; 2]) -> Prediction {
    let per_rad = sample.spots_per_rad;
    // Near an edge the sine is the angle to a part in a thousand of what counts; far away only its
    // sign does.
    let q = [
        (sample.angle_rad - p[FIRST]) * per_rad,
        (p[SECOND] - sample.angle_rad) * per_rad,
    ];
    let one = |k: usize| {
        if there[k] {
            disc_share(q[k])
        } else {
            (1.0, 0.0)
        }
    };
    let ((f1, d1), (f2, d2)) = (one(0), one(1));
    let f = (f1 + f2 - 1.0).clamp(0.0, 1.0);
    // Derivatives of f to the two edges and to the footprint scale (q goes with 1/scale).
    let df = [-d1 * per_rad, d2 * per_rad];
    let df_scale = -(d1 * q[0] + d2 * q[1]);
    let cuts = [d1 > 0.0, d2 > 0.0];
    let (a, b) = (p[STRIP], p[BEHIND]);
    let rounding = sample.rounding * sample.rounding;
    if sample.light == Light::Ratio {
        let f = f.clamp(SHARE_MIN, 1.0 - SHARE_MIN);
        let slope = 1.0 / (f * (1.0 - f));
        return Prediction {
            value: (a * f / (b * (1.0 - f))).ln() + p[EXPONENT] * sample.ln_cos,
            row: [
                slope * df[0],
                slope * df[1],
                1.0 / a,
                -1.0 / b,
                sample.ln_cos,
            ],
            d_footprint: slope * df_scale,
            variance: noise[1] * noise[1] + rounding,
            cuts,
        };
    }
    let level = small_exp(p[EXPONENT] * sample.ln_cos);
    let (inner, outer, contrast) = match sample.light {
        Light::Strip => (f, 0.0, a),
        Light::Behind => (0.0, 1.0 - f, -b),
        _ => (f, 1.0 - f, a - b),
    };
    let value = level * (a * inner + b * outer);
    let slope = level * contrast;
    let sigma = noise[0] * value;
    Prediction {
        value,
        row: [
            slope * df[0],
            slope * df[1],
            level * inner,
            level * outer,
            value * sample.ln_cos,
        ],
        d_footprint: slope * df_scale,
        variance: sigma * sigma + rounding,
        cuts,
    }
}

/// What the beams say where the parameters have certain values.
struct Pass {
    sums: Sums,
    /// As in [`StripFit`], without the degrees of freedom that the parameters take.
    scatter: [(f64, f64); 2],
    /// Sum of squared normalised residuals of the beams that each edge cuts, and their number.
    near: [(f64, u32); 2],
}

impl Pass {
    /// Goes through the beams. If `lenient`, those that an edge cuts keep their weight.
    fn over(
        samples: &[Sample],
        p: &SVector<f64, N>,
        there: [bool; 2],
        noise: [f64; 2],
        lenient: bool,
    ) -> Pass {
        let mut pass = Pass {
            sums: Sums::default(),
            scatter: [(0.0, 0.0); 2],
            near: [(0.0, 0); 2],
        };
        let mut levels = [LevelSums::default(); 2];
        for sample in samples {
            if let Some(level) = surface(p, sample, there) {
                levels[level - STRIP].add(sample, p[level], p[EXPONENT], noise[0]);
                continue;
            }
            let prediction = predict(p, sample, there, noise);
            let residual = sample.value - prediction.value;
            let information = 1.0 / prediction.variance;
            let square = residual * residual * information;
            let cut = prediction.cuts[0] || prediction.cuts[1];
            let weight = if lenient && cut { 1.0 } else { huber(square) };
            for (near, cuts) in pass.near.iter_mut().zip(prediction.cuts) {
                if cuts {
                    near.0 += square.min(100.0);
                    near.1 += 1;
                }
            }
            if weight == 0.0 || !square.is_finite() {
                continue;
            }
            let of = usize::from(sample.light == Light::Ratio);
            let relative = if of == 1 { 1.0 } else { prediction.value };
            let noise = residual * residual - sample.rounding * sample.rounding;
            pass.scatter[of].0 += weight * noise / (relative * relative);
            pass.scatter[of].1 += 1.0;
            pass.sums.add(weight * information, residual, &prediction);
        }
        for (level, sums) in [STRIP, BEHIND].into_iter().zip(&levels) {
            pass.sums.add_level(level, sums);
            pass.scatter[0].0 += sums.scatter.0;
            pass.scatter[0].1 += sums.scatter.1;
        }
        pass.sums.normal.fill_lower_triangle_with_upper_triangle();
        pass
    }
}

impl Start {
    /// Adds what is known before the fit.
    fn add_to(&self, sums: &mut Sums, p: &SVector<f64, N>) {
        let information = self.exponent_information();
        sums.normal[(EXPONENT, EXPONENT)] += information;
        sums.gradient[EXPONENT] += information * (self.exponent.0 - p[EXPONENT]);
        for k in 0..2 {
            // Weak enough not to matter unless no beam touches the edge.
            let wide = EDGE_PRIOR * self.reach_rad[k];
            let information = 1.0 / (wide * wide);
            match self.edges_rad[k] {
                Some(at) => {
                    sums.normal[(k, k)] += information;
                    sums.gradient[k] += information * (at - p[k]);
                }
                None => sums.normal[(k, k)] += 1.0,
            }
        }
    }

    fn exponent_information(&self) -> f64 {
        1.0 / (self.exponent.1 * self.exponent.1)
    }

    /// What a strip itself says of p, and its information: the posterior without the prior.
    fn own_exponent(&self, exponent: f64, variance: f64) -> (f64, f64) {
        let (prior, posterior) = (self.exponent_information(), 1.0 / variance);
        let own = (posterior - prior).max(0.0);
        if own > 1e-9 {
            ((posterior * exponent - prior * self.exponent.0) / own, own)
        } else {
            (self.exponent.0, own)
        }
    }
}

/// Angle from each edge to the next beam on its strip and on its background, rad.
fn closest_rad(samples: &[Sample], p: &SVector<f64, N>) -> [[f64; 2]; 2] {
    let mut closest_rad = [[f64::INFINITY; 2]; 2];
    for sample in samples {
        let inwards = [sample.angle_rad - p[FIRST], p[SECOND] - sample.angle_rad];
        for (closest, inward) in closest_rad.iter_mut().zip(inwards) {
            let side = usize::from(inward < 0.0);
            closest[side] = closest[side].min(inward.abs());
        }
    }
    closest_rad
}

/// Fits a strip's edges to the beams about it; none where they do not determine them.
pub(super) fn fit(samples: &[Sample], start: &Start) -> Option<StripFit> {
    let there = start.edges_rad.map(|e| e.is_some());
    let [first, second] = start.edges_rad.map(|e| e.unwrap_or(0.0));
    let [strip, behind] = start.levels;
    if !(strip > 0.0 && behind > 0.0) || samples.is_empty() {
        return None;
    }
    let mut p = SVector::from([first, second, strip, behind, start.exponent.0]);
    let spots_per_rad = samples[samples.len() / 2].spots_per_rad;
    let mut iteration = 0;
    let (mut pass, factors) = loop {
        let mut pass = Pass::over(samples, &p, there, start.noise, iteration < LENIENT);
        start.add_to(&mut pass.sums, &p);
        let factors = pass.sums.normal.cholesky()?;
        let step = factors.solve(&pass.sums.gradient);
        let far = step[FIRST].abs().max(step[SECOND].abs()) * spots_per_rad;
        // A beam at the rim of the spot can make the steps swing; shorter ones settle.
        let most = if iteration < SWINGING {
            STEP_MAX
        } else {
            0.5 * far
        };
        let shorter = if far > most { most / far } else { 1.0 };
        p += step * shorter;
        if !(p[STRIP] > 0.0 && p[BEHIND] > 0.0 && step.iter().all(|s| s.is_finite())) {
            return None;
        }
        iteration += 1;
        if far < CONVERGED && iteration >= LENIENT || iteration == ITERATIONS {
            if !(far < SETTLED) {
                return None;
            }
            break (pass, factors);
        }
    };
    let covariance = factors.inverse();
    let d_footprint = -(covariance * pass.sums.footprint);
    let variance = |k: usize| {
        if there[k] {
            covariance[(k, k)]
        } else {
            f64::INFINITY
        }
    };
    // The parameters take their part of both kinds of residuals.
    let fitted = there.iter().filter(|t| **t).count() as f64 + 2.0;
    let beams = pass.scatter[0].1 + pass.scatter[1].1;
    for (_, freedom) in &mut pass.scatter {
        *freedom -= fitted * *freedom / beams.max(1.0);
    }
    let contrast = covariance[(STRIP, STRIP)] + covariance[(BEHIND, BEHIND)]
        - 2.0 * covariance[(STRIP, BEHIND)];
    Some(StripFit {
        edges_rad: [p[FIRST], p[SECOND]],
        covariance: [
            [variance(0), covariance[(0, 1)]],
            [covariance[(0, 1)], variance(1)],
        ],
        d_footprint: [d_footprint[0], d_footprint[1]],
        levels: [p[STRIP], p[BEHIND]],
        contrast_sigma: contrast.max(0.0).sqrt(),
        exponent: start.own_exponent(p[EXPONENT], covariance[(EXPONENT, EXPONENT)]),
        scatter: pass.scatter,
        near_chi2: pass.near.map(|(sum, beams)| sum / f64::from(beams.max(1))),
        near: pass.near.map(|(_, beams)| beams),
        closest_rad: closest_rad(samples, &p),
    })
}
