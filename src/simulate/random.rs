//! Random numbers: one stream for each purpose, and in it one for each scan.
//!
//! So switching one effect on does not change the draws of the others, and scan 1000 is the same
//! whether or not the scans before it were made. The generator is ChaCha8 keyed by the seed and the
//! purpose; the scan's number is its nonce.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use rand_distr::{Distribution, Exp1, StandardNormal};

/// What a stream of random numbers is for. The numbers are part of the output's reproducibility.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// Poses of a random course.
    Course = 1,
    /// Range noise.
    Noise = 2,
    /// Common range bias.
    Bias = 3,
    /// Range bias of the faces.
    FaceBias = 4,
    /// The hit threshold of a scan.
    Threshold = 5,
    /// Which beams are mixed.
    Mixed = 6,
    /// Remission noise.
    Remission = 7,
    /// Scan periods and the turn of scans.
    AngleJitter = 8,
    /// Wild ranges.
    Outliers = 9,
    /// Lost beams.
    Dropouts = 10,
    /// Places of cables.
    Cables = 11,
    /// Place of the cargo.
    Cargo = 12,
    /// Which strip is missing.
    MissingStrip = 13,
    /// Stamps and telegrams.
    Clocks = 14,
    /// The IMU's noise.
    Imu = 15,
    /// The IMU's constant errors.
    ImuBias = 16,
    /// The plan of an office.
    OfficePlan = 32,
    /// Places in an office.
    OfficePlace = 33,
    /// Errors of the ranges in an office.
    OfficeRanges = 34,
}

/// The seed of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Seed(pub u64);

impl Seed {
    /// The stream for one purpose in one scan (or sample, or run: any number).
    pub fn draws(self, purpose: Purpose, number: u64) -> Draws {
        let mut key = [0; 32];
        key[..8].copy_from_slice(&self.0.to_le_bytes());
        key[8..16].copy_from_slice(&(purpose as u64).to_le_bytes());
        let mut generator = ChaCha8Rng::from_seed(key);
        generator.set_stream(number);
        Draws(generator)
    }
}

/// A stream of random numbers.
#[derive(Clone, Debug)]
pub struct Draws(ChaCha8Rng);

impl Draws {
    /// Standard normal.
    #[inline]
    pub fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }

    /// Exponential with mean 1.
    #[inline]
    pub fn exponential(&mut self) -> f64 {
        Exp1.sample(&mut self.0)
    }

    /// Uniform in [0, 1).
    #[inline]
    pub fn unit(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Uniform between two numbers.
    pub fn between(&mut self, [low, high]: [f64; 2]) -> f64 {
        low + (high - low) * self.unit()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_differ_and_repeat() {
        let seed = Seed(7);
        let first = |purpose, number| seed.draws(purpose, number).unit();
        assert_eq!(first(Purpose::Noise, 0), first(Purpose::Noise, 0));
        assert_ne!(first(Purpose::Noise, 0), first(Purpose::Noise, 1));
        assert_ne!(first(Purpose::Noise, 0), first(Purpose::Bias, 0));
        assert_ne!(
            first(Purpose::Noise, 0),
            Seed(8).draws(Purpose::Noise, 0).unit()
        );
    }

    #[test]
    fn moments() {
        let mut draws = Seed(1).draws(Purpose::Noise, 3);
        let n = 20_000;
        let (mut sum, mut squares, mut uniform, mut waits) = (0.0, 0.0, 0.0, 0.0);
        for _ in 0..n {
            let x = draws.normal();
            sum += x;
            squares += x * x;
            uniform += draws.between([-2.0, 4.0]);
            waits += draws.exponential();
        }
        let n = f64::from(n);
        assert!((sum / n).abs() < 0.03);
        assert!((squares / n - 1.0).abs() < 0.04);
        assert!((uniform / n - 1.0).abs() < 0.05);
        assert!((waits / n - 1.0).abs() < 0.03);
    }
}
