//! Lines by random samples (Fischler and Bolles 1981; Kurniawan 2017, section 4.2).
//!
//! Two beams drawn at random make a line; the line that most beams agree with wins. How many trials
//! are needed is not known before: each better line lowers the number, Algorithm 4.1 and eq. 4.12.
//! Then the line's beams are taken and the next line is looked for. The draws begin anew with every
//! scan, so that the same scan gives the same lines.

use super::extractor::ExtractorOptions;
use super::fit::InverseLine;
use super::taking::{Scene, Taker, Taking};
use crate::record::Scan;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use std::ops::Range;

/// Settings of the extractor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RansacOptions {
    /// What all extractors have; `seed` among it.
    pub common: ExtractorOptions,
    /// A beam this many sigmas off a line in range agrees with it.
    pub inlier_sigmas: f64,
    /// Probability that one of the trials was without an outlier.
    pub confidence: f64,
    /// Most trials for one line (the published comparison: 1000).
    pub max_trials: u32,
    /// The second beam of a pair is at most this many free beams from the first: far ones are seldom
    /// of one wall.
    pub reach: usize,
}

impl Default for RansacOptions {
    fn default() -> Self {
        RansacOptions {
            common: ExtractorOptions::default(),
            inlier_sigmas: 3.0,
            confidence: 0.99,
            max_trials: 1000,
            reach: 60,
        }
    }
}

/// The extractor.
pub type Ransac = Taking<RandomPairs>;

/// Draws pairs of free beams, and takes the lines that most beams agree with.
#[derive(Clone, Debug)]
pub struct RandomPairs {
    options: RansacOptions,
    rng: ChaCha8Rng,
    /// The beams that are drawn from: numbers, and what their residuals are made of.
    ids: Vec<u32>,
    r: Vec<f32>,
    y: Vec<f32>,
    z: Vec<f32>,
}

/// Trials after which a sample without outliers was among them with probability `confidence`, where
/// `share` of the points are inliers and a sample is two points, eq. 4.12. At least 1.
fn trials_needed(share: f64, confidence: f64) -> u32 {
    let clean = share * share;
    if clean >= 1.0 {
        return 1;
    }
    let trials = (1.0 - confidence).ln() / (-clean).ln_1p();
    // Infinite or beyond counting: as many as one likes.
    trials.ceil().clamp(1.0, f64::from(u32::MAX)) as u32
}

impl Taker for RandomPairs {
    type Options = RansacOptions;

    fn new(options: RansacOptions) -> RandomPairs {
        RandomPairs {
            options,
            rng: ChaCha8Rng::seed_from_u64(options.common.seed),
            ids: Vec::new(),
            r: Vec::new(),
            y: Vec::new(),
            z: Vec::new(),
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
        let sigma_m = common.segmentation.sigma_m;
        let limit_m = (self.options.inlier_sigmas * sigma_m) as f32;
        self.gather(group, scene);
        while self.ids.len() >= common.min_points {
            let Some((line, votes)) = self.best_line(limit_m) else {
                break;
            };
            if votes < common.min_points {
                break;
            }
            if scene.take(line, sigma_m) {
                self.keep(|id, _| scene.is_free(id));
            } else {
                // Beams of no wall: they are not drawn again.
                let (a, b) = (line.a as f32, line.b as f32);
                let before = self.ids.len();
                self.keep(|_, [r, y, z]| (r * (a * y + b * z - 1.0)).abs() > limit_m);
                if self.ids.len() == before {
                    break;
                }
            }
        }
    }
}

impl RandomPairs {
    fn gather(&mut self, group: Range<usize>, scene: &Scene<'_>) {
        let beams = scene.beams();
        self.ids.clear();
        for list in [&mut self.r, &mut self.y, &mut self.z] {
            list.clear();
        }
        for k in scene.free(group) {
            self.ids.push(k as u32);
            self.r.push(beams.range_m[k] as f32);
            self.y.push(beams.y_m[k] as f32);
            self.z.push(beams.z_m[k] as f32);
        }
    }

    /// Keeps the beams that `stays` says, by their number or by range and point.
    fn keep(&mut self, mut stays: impl FnMut(usize, [f32; 3]) -> bool) {
        let mut kept = 0;
        for k in 0..self.ids.len() {
            let (id, [r, y, z]) = (self.ids[k], [self.r[k], self.y[k], self.z[k]]);
            (self.ids[kept], self.r[kept]) = (id, r);
            (self.y[kept], self.z[kept]) = (y, z);
            kept += usize::from(stays(id as usize, [r, y, z]));
        }
        self.ids.truncate(kept);
        for list in [&mut self.r, &mut self.y, &mut self.z] {
            list.truncate(kept);
        }
    }

    /// Algorithm 4.1: trials until there were enough for the best share of inliers so far.
    fn best_line(&mut self, limit_m: f32) -> Option<(InverseLine, usize)> {
        let n = self.ids.len();
        let mut best: Option<(InverseLine, usize)> = None;
        let mut needed = self.options.max_trials;
        let mut trial = 0;
        while trial < needed {
            trial += 1;
            let Some(line) = self.draw() else { continue };
            let votes = self.votes(line, limit_m);
            if best.is_none_or(|(_, most)| votes > most) {
                best = Some((line, votes));
                let share = votes as f64 / n as f64;
                let enough = trials_needed(share, self.options.confidence);
                needed = enough.min(self.options.max_trials);
            }
        }
        best
    }

    /// The line through two beams drawn at random.
    fn draw(&mut self) -> Option<InverseLine> {
        let n = self.ids.len();
        let i = below(&mut self.rng, n);
        let from = i.saturating_sub(self.options.reach);
        let to = (i + self.options.reach + 1).min(n);
        let k = from + below(&mut self.rng, to - from);
        let (y0, z0) = (f64::from(self.y[i]), f64::from(self.z[i]));
        let (y1, z1) = (f64::from(self.y[k]), f64::from(self.z[k]));
        // a y + b z = 1 at both.
        let det = y0 * z1 - y1 * z0;
        (det.abs() > 1e-9).then(|| InverseLine {
            a: (z1 - z0) / det,
            b: (y0 - y1) / det,
        })
    }

    /// Beams that agree with a line.
    fn votes(&self, line: InverseLine, limit_m: f32) -> usize {
        let (a, b) = (line.a as f32, line.b as f32);
        let points = self.r.iter().zip(&self.y).zip(&self.z);
        let count: u32 = points
            .map(|((r, y), z)| u32::from((r * (a * y + b * z - 1.0)).abs() <= limit_m))
            .sum();
        count as usize
    }
}

/// A number below `n`, which is not 0. The bias of the plain product is below 1e-6 here.
pub(super) fn below(rng: &mut ChaCha8Rng, n: usize) -> usize {
    ((u64::from(rng.next_u32()) * n as u64) >> 32) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Eq. 4.12 by hand: half inliers, 99 %: log 0.01 / log 0.75 = 16.008.
    #[test]
    fn fewer_trials_for_more_inliers() {
        assert_eq!(trials_needed(0.5, 0.99), 17);
        assert_eq!(trials_needed(0.1, 0.99), 459);
        assert_eq!(trials_needed(1.0, 0.99), 1);
        assert_eq!(trials_needed(0.999_999, 0.5), 1);
        assert_eq!(trials_needed(0.0, 0.99), u32::MAX);
    }

    #[test]
    fn draws_reach_every_beam() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut seen = [0; 5];
        for _ in 0..5000 {
            seen[below(&mut rng, 5)] += 1;
        }
        assert!(seen.iter().all(|n| (800..1200).contains(n)), "{seen:?}");
    }
}
