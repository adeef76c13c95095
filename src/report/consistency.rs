//! Whether the solver's covariances are honest: the normalised estimation error squared (NEES).
//!
//! e^T P^-1 e has the mean d for d components if P is the covariance of e. It is given divided by
//! d, so that 1 is consistent, above 1 too confident and below 1 too modest. Errors of one run are
//! correlated in time, so that n of them tell less than n independent ones would: the band in which
//! the mean should lie is made with an effective number.

use crate::record::Pose;
use nalgebra::{SMatrix, SVector};

/// The groups of components whose joint NEES is reported: name and indices into the state.
pub const GROUPS: [(&str, &[usize]); 3] = [
    ("x_yaw", &[0, 5]),
    ("position", &[0, 1, 2]),
    ("pose", &[0, 1, 2, 3, 4, 5]),
];

/// Consistency of one component or group.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Consistency {
    /// Components.
    pub dof: usize,
    /// Poses with a covariance.
    pub n: usize,
    /// Measured poses whose covariance is missing, or not positive (definite).
    pub left_out: usize,
    /// Number of independent poses that would tell as much: see [`effective_number`].
    pub effective_n: f64,
    /// Mean NEES divided by `dof`.
    pub nees: f64,
    /// Lower end of the 95 % band of `nees` for an honest covariance.
    pub low: f64,
    /// Upper end of it.
    pub high: f64,
}

impl Consistency {
    /// From the NEES (not divided) of a run's poses in order of time.
    pub fn of(nees: &[f64], dof: usize) -> Consistency {
        let n = nees.len();
        let effective_n = effective_number(nees);
        let band = |z: f64| {
            let k = effective_n * dof as f64;
            chi_squared_quantile(k, z) / k
        };
        Consistency {
            dof,
            n,
            left_out: 0,
            effective_n,
            nees: nees.iter().sum::<f64>() / (n * dof) as f64,
            low: band(-1.959_964),
            high: band(1.959_964),
        }
    }

    /// Whether the mean lies in its band; none without poses.
    pub fn is_honest(&self) -> Option<bool> {
        (self.n > 0).then(|| (self.low..=self.high).contains(&self.nees))
    }
}

/// The quantile of chi-squared with `k` degrees of freedom that a normal number is below with the same
/// probability as `z` standard deviations: Wilson and Hilferty's cube, good to 1 % from 2 degrees on.
pub(super) fn chi_squared_quantile(k: f64, z: f64) -> f64 {
    let v = 2.0 / (9.0 * k);
    k * (1.0 - v + z * v.sqrt()).max(0.0).powi(3)
}

/// NEES of a group of components; none where the covariance is missing or not positive definite.
pub(super) fn nees(pose: &Pose, error: &[f64; 6], group: usize) -> Option<f64> {
    match group {
        0 => quadratic(pose, error, [0, 5]),
        1 => quadratic(pose, error, [0, 1, 2]),
        _ => quadratic(pose, error, [0, 1, 2, 3, 4, 5]),
    }
}

/// e^T P^-1 e over the named components.
fn quadratic<const N: usize>(pose: &Pose, error: &[f64; 6], state: [usize; N]) -> Option<f64> {
    let covariance = SMatrix::<f64, N, N>::from_fn(|i, j| pose.cov(state[i], state[j]));
    let e = SVector::<f64, N>::from_fn(|i, _| error[state[i]]);
    if !covariance.iter().chain(e.iter()).all(|v| v.is_finite()) {
        return None;
    }
    let root = covariance.cholesky()?;
    let whitened = root.l().solve_lower_triangular(&e)?;
    Some(whitened.norm_squared())
}

/// Lags looked at before the series is halved.
const LAGS: usize = 64;

/// How many independent values would fix the mean as well as these correlated ones do:
/// n / (1 + 2 sum of autocorrelations), summed by pairs of lags as long as a pair is positive
/// (Geyer's initial positive sequence).
///
/// Where the correlation outlasts `LAGS` lags, neighbours are averaged and the sum is made on the
/// shorter series: the variance of the mean does not change by that, and the cost stays linear.
pub fn effective_number(values: &[f64]) -> f64 {
    let n = values.len();
    let mut series = centred(values);
    let variance = autocovariance(&series, 0);
    if n < 4 || variance <= 0.0 || !variance.is_finite() {
        return n as f64;
    }
    loop {
        let own = autocovariance(&series, 0);
        let (sum, ended) = positive_sum(&series);
        if ended || series.len() < 4 * LAGS {
            let of_mean = (own + 2.0 * sum) / series.len() as f64;
            return (variance / of_mean).clamp(1.0, n as f64);
        }
        let halved: Vec<f64> = series
            .chunks_exact(2)
            .map(|p| 0.5 * (p[0] + p[1]))
            .collect();
        series = centred(&halved);
    }
}

/// The values without their mean.
fn centred(values: &[f64]) -> Vec<f64> {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    values.iter().map(|v| v - mean).collect()
}

/// Sum of the autocovariances from lag 1 on, and whether it ended by itself.
fn positive_sum(series: &[f64]) -> (f64, bool) {
    let mut sum = 0.0;
    let last = LAGS.min(series.len() / 2);
    for lag in (1..last).step_by(2) {
        let pair = autocovariance(series, lag) + autocovariance(series, lag + 1);
        if pair <= 0.0 {
            return (sum, true);
        }
        sum += pair;
    }
    (sum, false)
}

/// Of a series without its mean. Four sums at a time: one would wait for each addition to end.
fn autocovariance(series: &[f64], lag: usize) -> f64 {
    let later = series.get(lag..).unwrap_or_default();
    let (fours, later_fours) = (series.chunks_exact(4), later.chunks_exact(4));
    let mut sums = [0.0f64; 4];
    let rest = later_fours.remainder();
    let done = later.len() - rest.len();
    for (a, b) in fours.zip(later_fours) {
        for (sum, (a, b)) in sums.iter_mut().zip(a.iter().zip(b)) {
            *sum += a * b;
        }
    }
    let behind = series.iter().skip(done).zip(rest);
    let sum = sums.iter().sum::<f64>() + behind.map(|(a, b)| a * b).sum::<f64>();
    sum / series.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    fn noise(n: usize, memory: f64, seed: u64) -> Vec<f64> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut state = 0.0;
        let drive = (1.0 - memory * memory).sqrt();
        (0..n)
            .map(|_| {
                let white: f64 = StandardNormal.sample(&mut random);
                state = memory * state + drive * white;
                state
            })
            .collect()
    }

    #[test]
    fn effective_number_of_a_first_order_process() {
        // Closed form: n (1 - a) / (1 + a).
        for (memory, n) in [
            (0.0, 20_000),
            (0.5, 20_000),
            (0.95, 50_000),
            (0.999, 400_000),
        ] {
            let want = n as f64 * (1.0 - memory) / (1.0 + memory);
            let got = effective_number(&noise(n, memory, 7));
            assert!(
                (got / want - 1.0).abs() < 0.25,
                "{memory}: {got} for {want}"
            );
        }
        assert_eq!(effective_number(&[1.0; 50]), 50.0);
        assert_eq!(effective_number(&[]), 0.0);
    }

    #[test]
    fn honest_errors_have_a_mean_in_the_band() {
        let mut honest = 0;
        for seed in 0..100 {
            let nees: Vec<f64> = noise(400, 0.0, seed).iter().map(|e| e * e).collect();
            honest += usize::from(Consistency::of(&nees, 1).is_honest() == Some(true));
        }
        assert!(
            (88..=99).contains(&honest),
            "{honest} of 100 in a 95 % band"
        );
        let wild = Consistency::of(&[4.0, 3.9, 4.1, 4.2, 3.8, 4.05, 4.0, 4.0].repeat(20), 1);
        assert_eq!(wild.is_honest(), Some(false));
        assert_eq!(Consistency::of(&[], 1).is_honest(), None);
    }

    #[test]
    fn honest_errors_that_are_correlated_have_a_mean_in_the_band_too() {
        // NEES of d correlated Gaussian errors (first order, memory a); their squares have memory a^2,
        // so that n of them fix the mean as well as n (1 - a^2) / (1 + a^2) independent ones.
        for (memory, dof) in [(0.0f64, 3), (0.6, 2), (0.9, 1), (0.97, 6)] {
            let (n, runs) = (4000, 120);
            let (mut honest, mut effective, mut bare) = (0, 0.0, 0);
            for seed in 0..runs {
                let mut nees = vec![0.0; n];
                for k in 0..dof {
                    let errors = noise(n, memory, 1000 * seed + k);
                    nees.iter_mut()
                        .zip(errors)
                        .for_each(|(sum, e)| *sum += e * e);
                }
                let found = Consistency::of(&nees, dof as usize);
                honest += usize::from(found.is_honest() == Some(true));
                effective += found.effective_n / runs as f64;
                let as_if_independent = 1.96 * (2.0 / (n as f64 * dof as f64)).sqrt();
                bare += usize::from((found.nees - 1.0).abs() <= as_if_independent);
            }
            let want = n as f64 * (1.0 - memory * memory) / (1.0 + memory * memory);
            assert!(
                (effective / want - 1.0).abs() < 0.15,
                "{memory}: {effective} for {want}"
            );
            assert!(
                (104..=120).contains(&honest),
                "{memory}: {honest} of 120 in a 95 % band"
            );
            // Without the effective number the band would be far too tight.
            assert!(memory < 0.9 || bare < 80, "{memory}: {bare} of 120");
        }
    }

    #[test]
    fn the_band_is_chi_squared() {
        // 95 % of chi-squared with 10 degrees of freedom: 3.247 to 20.483.
        let ten = Consistency {
            ..Consistency::of(&[1.0, 3.0, 1.0, 0.0, 2.0], 2)
        };
        assert_eq!(ten.effective_n, 5.0);
        assert!((ten.low * 10.0 - 3.247).abs() < 0.04, "{}", ten.low);
        assert!((ten.high * 10.0 - 20.483).abs() < 0.04, "{}", ten.high);
    }

    #[test]
    fn a_correlated_covariance_is_undone() {
        let mut pose = Pose::default();
        // P of (x, yaw) = [[4, 1.8], [1.8, 1]]; e = (2, 1): e' P^-1 e by hand is 4 * 1 - 2 * 2 * 1.8
        // + 1 * 4 over the determinant 0.76.
        pose.covariance[crate::record::upper_index(6, 0, 0)] = 4.0;
        pose.covariance[crate::record::upper_index(6, 0, 5)] = 1.8;
        pose.covariance[crate::record::upper_index(6, 5, 5)] = 1.0;
        let error = [2.0, 0.0, 0.0, 0.0, 0.0, 1.0];
        let got = nees(&pose, &error, 0).unwrap();
        assert!((got - 0.8 / 0.76).abs() < 1e-12, "{got}");
        assert_eq!(nees(&pose, &error, 2), None, "the rest is missing");
        pose.covariance[crate::record::upper_index(6, 5, 5)] = 0.5;
        assert_eq!(nees(&pose, &error, 0), None, "not positive definite");
    }
}
