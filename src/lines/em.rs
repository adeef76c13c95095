//! Lines by expectation maximisation (Nguyen et al. 2005; Pfister et al. 2003 for the weights).
//!
//! A line is started from beams drawn at random. Expectation: how likely each free beam is of the
//! line, against a small even chance that it is of anything else. Maximisation: the line that fits
//! the beams best with these probabilities as weights. Both in turn until nothing changes; the noise
//! is taken large at first and shrinks. The best of some starts is taken, and the next line is
//! looked for among the beams left.

use super::assembly::Assembly;
use super::extractor::{Extractor, ExtractorOptions, Fate};
use super::fit::{InverseLine, InverseRangeSums};
use super::pool::Pool;
use super::segmentation::Returns;
use crate::record::{NormalLine, Scan, Segment};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
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

/// The extractor: its settings and buffers.
#[derive(Clone, Debug, Default)]
pub struct Em {
    /// The settings; may be changed between scans.
    pub options: EmOptions,
    returns: Returns,
    pool: Pool,
    assembly: Assembly,
    ids: Vec<usize>,
}

impl Em {
    /// An extractor with the given settings.
    pub fn new(options: EmOptions) -> Em {
        Em {
            options,
            ..Em::default()
        }
    }

    fn search(&mut self, group: Range<usize>, rng: &mut ChaCha8Rng, out: &mut Vec<Segment>) {
        let common = self.options.common;
        self.ids.clear();
        self.ids.extend(group.filter(|k| self.pool.is_free(*k)));
        let mut misses = 0;
        while self.ids.len() >= common.min_points && misses < self.options.trials {
            let mut best: Option<(InverseLine, f64)> = None;
            // A line that explains half of the beams left is not bettered by much.
            for _ in 0..self.options.trials {
                let found = self.maximise(rng);
                if let Some((line, weight)) = found
                    && best.is_none_or(|(_, most)| weight > most)
                {
                    best = Some((line, weight));
                }
                if best.is_some_and(|(_, weight)| weight > 0.5 * self.ids.len() as f64) {
                    break;
                }
            }
            let Some((line, _)) = best.filter(|(_, weight)| *weight >= common.min_points as f64)
            else {
                break;
            };
            let sigma_m = common.segmentation.sigma_m;
            let assembly = &mut self.assembly;
            if self
                .pool
                .take(&self.returns, line, sigma_m, &common, assembly, out)
            {
                self.ids.retain(|k| self.pool.is_free(*k));
            } else {
                misses += 1;
                let beams = self.returns.beams();
                let limit_m = common.trim_sigmas * sigma_m;
                self.ids.retain(|k| {
                    let (r, y, z) = (beams.range_m[*k], beams.y_m[*k], beams.z_m[*k]);
                    line.residual_m(r, y, z).abs() > limit_m
                });
            }
        }
    }

    /// One start, turned until it stands still: the line and the sum of its probabilities.
    fn maximise(&self, rng: &mut ChaCha8Rng) -> Option<(InverseLine, f64)> {
        let beams = self.returns.beams();
        let n = self.ids.len();
        let length = self.options.seed_beams.clamp(2, n);
        let first = ((u64::from(rng.next_u32()) * (n - length + 1) as u64) >> 32) as usize;
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

impl Extractor for Em {
    fn extract(&mut self, scan: &Scan, out: &mut Vec<Segment>) {
        out.clear();
        let common = self.options.common;
        let mut rng = ChaCha8Rng::seed_from_u64(common.seed);
        self.returns.read(scan, &common.segmentation);
        self.assembly.begin(scan, &self.returns, &common);
        self.pool.begin(&self.returns);
        let groups: Vec<(usize, usize)> = self.returns.groups().collect();
        for (from, to) in groups {
            // Beams that were left aside may be of a line that lacked them.
            let mut before = usize::MAX;
            while out.len() != before {
                before = out.len();
                self.search(from..to, &mut rng, out);
            }
        }
        self.assembly.end(out);
    }

    fn fates(&self) -> &[Fate] {
        self.assembly.fates()
    }

    fn expect(&mut self, lines: &[NormalLine]) {
        self.returns.expect(lines);
    }
}
