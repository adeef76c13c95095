//! Lines by expectation maximisation (Nguyen et al. 2005; Pfister et al. 2003 for the weights).
//!
//! A line is started from beams drawn at random. Expectation: how likely each free beam is of the
//! line, against a small even chance that it is of anything else. Maximisation: the line that fits
//! the beams best with these probabilities as weights. Both in turn until nothing changes; the noise
//! is taken large at first and shrinks. The best of some starts is taken, and the next line is
//! looked for among the beams left.

use super::extractor::ExtractorOptions;
use super::fit::{BeamSlice, InverseLine, InverseRangeSums};
use super::ransac::below;
use super::taking::{Scene, Taker, Taking};
use crate::record::Scan;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use std::ops::Range;

/// Settings of the extractor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EmOptions {
    /// What all extractors have; `seed` among it.
    pub common: ExtractorOptions,
    /// Starts for one line (the published comparison: 50).
    pub trials: u32,
    /// Most turns of expectation and maximisation (the published comparison: 200).
    pub max_turns: u32,
    /// Density of beams that are of no line, 1/m: one sigma wide interval of the line's own density
    /// against it decides.
    pub background_per_m: f64,
    /// The noise at the start, in sigmas.
    pub wide_sigmas: f64,
    /// Beams that a start is made of, next to each other.
    pub seed_beams: usize,
}

impl Default for EmOptions {
    fn default() -> Self {
        EmOptions {
            common: ExtractorOptions::default(),
            trials: 50,
            max_turns: 200,
            background_per_m: 0.5,
            wide_sigmas: 4.0,
            seed_beams: 9,
        }
    }
}

/// The extractor.
pub type Em = Taking<Expectations>;

/// Starts lines from beams drawn at random, and takes those that most beams are likely to be of.
#[derive(Clone, Debug)]
pub struct Expectations {
    options: EmOptions,
    rng: ChaCha8Rng,
    /// The beams that may be of the next line.
    ids: Vec<usize>,
}

impl Taker for Expectations {
    type Options = EmOptions;

    fn new(options: EmOptions) -> Expectations {
        Expectations {
            options,
            rng: ChaCha8Rng::seed_from_u64(options.common.seed),
            ids: Vec::new(),
        }
    }

    fn common(&self) -> &ExtractorOptions {
        &self.options.common
    }

    fn begin(&mut self, _: &Scan, _: &mut Scene<'_>) {
        self.rng = ChaCha8Rng::seed_from_u64(self.options.common.seed);
    }

    fn take(&mut self, group: Range<usize>, scene: &mut Scene<'_>) {
        let common = self.options.common;
        let beams = scene.beams();
        self.ids.clear();
        self.ids.extend(scene.free(group));
        let mut misses = 0;
        while self.ids.len() >= common.min_points && misses < self.options.trials {
            let best = self.best_line(beams);
            let Some((line, _)) = best.filter(|(_, weight)| *weight >= common.min_points as f64)
            else {
                break;
            };
            let sigma_m = common.segmentation.sigma_m;
            if scene.take(line, sigma_m) {
                self.ids.retain(|k| scene.is_free(*k));
            } else {
                misses += 1;
                let limit_m = common.trim_sigmas * sigma_m;
                self.ids.retain(|k| {
                    let (r, y, z) = (beams.range_m[*k], beams.y_m[*k], beams.z_m[*k]);
                    line.residual_m(r, y, z).abs() > limit_m
                });
            }
        }
    }
}

impl Expectations {
    /// The best of some starts: its line and the sum of its probabilities.
    fn best_line(&mut self, beams: BeamSlice<'_>) -> Option<(InverseLine, f64)> {
        let mut best: Option<(InverseLine, f64)> = None;
        // A line that explains half of the beams left is not bettered by much.
        let enough = 0.5 * self.ids.len() as f64;
        for _ in 0..self.options.trials {
            let found = self.maximise(beams);
            if let Some((line, weight)) = found
                && best.is_none_or(|(_, most)| weight > most)
            {
                best = Some((line, weight));
            }
            if best.is_some_and(|(_, weight)| weight > enough) {
                break;
            }
        }
        best
    }

    /// One start, turned until it stands still: the line and the sum of its probabilities.
    fn maximise(&mut self, beams: BeamSlice<'_>) -> Option<(InverseLine, f64)> {
        let n = self.ids.len();
        let length = self.options.seed_beams.clamp(2, n);
        let first = below(&mut self.rng, n - length + 1);
        let mut sums = InverseRangeSums::default();
        for k in &self.ids[first..first + length] {
            sums.add(beams.range_m[*k], beams.y_m[*k], beams.z_m[*k], 1.0);
        }
        let mut line = sums.line()?;
        let sigma_m = self.options.common.segmentation.sigma_m;
        let mut wide = self.options.wide_sigmas.max(1.0);
        let mut weight = 0.0;
        for _ in 0..self.options.max_turns {
            let noise_m = wide * sigma_m;
            let peak_per_m = 1.0 / (noise_m * (2.0 * std::f64::consts::PI).sqrt());
            let floor = self.options.background_per_m / peak_per_m;
            let scale = -0.5 / (noise_m * noise_m);
            let mut sums = InverseRangeSums::default();
            let mut total = 0.0;
            for k in &self.ids {
                let (r, y, z) = (beams.range_m[*k], beams.y_m[*k], beams.z_m[*k]);
                let e = line.residual_m(r, y, z);
                let exponent = scale * e * e;
                if exponent < FAR {
                    continue;
                }
                let density = exponent.exp();
                let probability = density / (density + floor);
                sums.add(r, y, z, probability);
                total += probability;
            }
            let next = sums.line()?;
            let change = (next.a - line.a).hypot(next.b - line.b);
            let still = change < 1e-4 * line.a.hypot(line.b) && (total - weight).abs() < 0.1;
            (line, weight) = (next, total);
            if still && wide <= 1.0 {
                break;
            }
            wide = (wide * SHRINK).max(1.0);
        }
        Some((line, weight))
    }
}

/// Exponents below this are of beams that have no say.
const FAR: f64 = -18.0;
/// The noise shrinks by this from turn to turn.
const SHRINK: f64 = 0.7;
