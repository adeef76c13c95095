//! The overlapping Allan deviation of a noisy rate, and what its curve says of the noise.
//!
//! With x the integral of the rate y at steps of tau0 and tau = m tau0 (IEEE Std 952, annex C):
//! sigma^2(tau) = sum over k of (x[k+2m] - 2 x[k+m] + x[k])^2 / (2 tau^2 count). White noise of
//! density N gives N/sqrt(tau), bias instability B the floor B sqrt(2 ln 2 / pi), a random walk of
//! density K gives K sqrt(tau/3), quantisation Q gives sqrt(3) Q/tau.

/// Averaging times a decade.
const PER_DECADE: f64 = 10.0;

/// One averaging time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Averaging time, s.
    pub tau_s: f64,
    /// Allan deviation, in the unit of the rate.
    pub deviation: f64,
    /// Its relative standard error.
    pub error: f64,
}

/// The floor of the curve over the bias instability: sqrt(2 ln 2 / pi).
pub const FLOOR: f64 = 0.664_282_534;

/// The curve of a record in pieces: `pieces` are runs of samples without a gap, `period_s` apart.
/// Second differences are pooled over the pieces. Averaging times go up to a third of the longest
/// piece, where a handful of independent differences is left.
pub fn curve(pieces: &[&[f64]], period_s: f64) -> Vec<Point> {
    let longest = pieces.iter().map(|p| p.len()).max().unwrap_or(0);
    let integrals: Vec<Vec<f64>> = pieces.iter().map(|p| integral(p, period_s)).collect();
    let mut points: Vec<Point> = Vec::new();
    let mut last = 0;
    for k in 0.. {
        let m = 10f64.powf(f64::from(k) / PER_DECADE).round() as usize;
        if m * 3 > longest {
            break;
        }
        if m != last {
            points.extend(at(&integrals, m, period_s));
        }
        last = m;
    }
    points
}

/// x, one value more than the samples; the mean is taken out first, which the second differences
/// do not see, so that long records keep their digits.
fn integral(samples: &[f64], period_s: f64) -> Vec<f64> {
    let mean = samples.iter().sum::<f64>() / samples.len().max(1) as f64;
    let mut x = 0.0;
    let steps = samples.iter().map(|y| {
        x += (y - mean) * period_s;
        x
    });
    let mut integral = vec![0.0];
    integral.extend(steps);
    integral
}

fn at(integrals: &[Vec<f64>], m: usize, period_s: f64) -> Option<Point> {
    let tau_s = m as f64 * period_s;
    let (mut sum, mut count, mut samples) = (0.0, 0usize, 0usize);
    for x in integrals {
        let (middle, end) = (x.iter().skip(m), x.iter().skip(2 * m));
        for ((a, b), c) in x.iter().zip(middle).zip(end) {
            let second = c - 2.0 * b + a;
            sum += second * second;
            count += 1;
        }
        if x.len() > 2 * m {
            samples += x.len() - 1;
        }
    }
    if count == 0 {
        return None;
    }
    let variance = sum / (2.0 * tau_s * tau_s * count as f64);
    // Degrees of freedom of the overlapping estimate under white noise (Riley, NIST SP 1065, 5.4).
    let (n, m) = (samples as f64, m as f64);
    let white = 3.0 * (n - 1.0) / (2.0 * m) - 2.0 * (n - 2.0) / n;
    let freedom = (white * 4.0 * m * m / (4.0 * m * m + 5.0)).max(1.0);
    Some(Point {
        tau_s,
        deviation: variance.sqrt(),
        error: 1.0 / (2.0 * freedom).sqrt(),
    })
}

/// What a curve is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// Density N of the white noise, unit of the rate times sqrt(s); 0 where the curve has none.
    pub white: f64,
    /// Bias instability: the curve's lowest value over [`FLOOR`]. An upper limit where the curve
    /// still falls at its end.
    pub instability: f64,
    /// Averaging time of the lowest value, s.
    pub instability_tau_s: f64,
    /// Whether the curve had stopped falling before its end.
    pub has_floor: bool,
}

/// Reads a curve: the white part from a least-squares fit of quantisation, white noise, floor and
/// random walk, all not negative, to the variances; none without points.
pub fn noise(points: &[Point]) -> Option<Noise> {
    let lowest = points
        .iter()
        .min_by(|a, b| a.deviation.total_cmp(&b.deviation))?;
    let end_s = points.last().map_or(0.0, |p| p.tau_s);
    // Lowest by chance at the end is no floor: one must be left behind by its own error.
    let risen = points
        .iter()
        .filter(|p| p.tau_s > lowest.tau_s)
        .any(|p| p.deviation * (1.0 - p.error) > lowest.deviation);
    Some(Noise {
        white: white(points),
        instability: lowest.deviation / FLOOR,
        instability_tau_s: lowest.tau_s,
        has_floor: risen && lowest.tau_s < end_s,
    })
}

/// Terms of the model: variance at `tau_s` for coefficient 1.
fn terms(tau_s: f64) -> [f64; 4] {
    [
        3.0 / (tau_s * tau_s),
        1.0 / tau_s,
        FLOOR * FLOOR,
        tau_s / 3.0,
    ]
}

/// The best fit with every set of terms, the others zero; of those without a negative coefficient
/// the one with the smallest misfit is the least-squares fit under the constraint.
fn white(points: &[Point]) -> f64 {
    let mut best = (f64::INFINITY, 0.0);
    for set in 1u32..16 {
        let used: Vec<usize> = (0..4).filter(|k| set & (1 << k) != 0).collect();
        let Some((misfit, coefficients)) = fit(points, &used) else {
            continue;
        };
        if misfit < best.0 && coefficients.iter().all(|c| *c >= 0.0) {
            let white = used.iter().position(|k| *k == 1);
            let n2 = white.and_then(|i| coefficients.get(i)).copied();
            best = (misfit, n2.unwrap_or(0.0));
        }
    }
    best.1.sqrt()
}

fn fit(points: &[Point], used: &[usize]) -> Option<(f64, Vec<f64>)> {
    // In units of the observed variance and its error, so that every decade counts alike.
    let rows = points.iter().filter(|p| p.deviation > 0.0).map(|p| {
        let variance = p.deviation * p.deviation;
        let all = terms(p.tau_s);
        let weight = 1.0 / (2.0 * p.error * variance);
        (
            used.iter().map(|k| all[*k] * weight).collect::<Vec<_>>(),
            variance * weight,
        )
    });
    let (rows, wanted): (Vec<Vec<f64>>, Vec<f64>) = rows.unzip();
    if rows.len() < used.len() {
        return None;
    }
    let a = nalgebra::DMatrix::from_fn(rows.len(), used.len(), |i, j| rows[i][j]);
    let b = nalgebra::DVector::from_vec(wanted);
    // Columns differ by many powers of ten; scaled, the solution is that of a well-posed system.
    let scale: Vec<f64> = a.column_iter().map(|c| c.norm().max(1e-300)).collect();
    let scaled = nalgebra::DMatrix::from_fn(a.nrows(), a.ncols(), |i, j| a[(i, j)] / scale[j]);
    let solution = (scaled.transpose() * &scaled)
        .cholesky()?
        .solve(&(scaled.transpose() * &b));
    let misfit = (&scaled * &solution - b).norm_squared();
    let coefficients = solution.iter().zip(&scale).map(|(c, s)| c / s);
    Some((misfit, coefficients.collect()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    fn normal(seed: u64) -> impl FnMut() -> f64 {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        move || StandardNormal.sample(&mut random)
    }

    /// The definition of the Allan variance in terms of means, without integrals.
    fn by_means(y: &[f64], m: usize) -> f64 {
        let mean = |k: usize| y[k..k + m].iter().sum::<f64>() / m as f64;
        let count = y.len() + 1 - 2 * m;
        let sum: f64 = (0..count).map(|k| (mean(k + m) - mean(k)).powi(2)).sum();
        (sum / (2.0 * count as f64)).sqrt()
    }

    #[test]
    fn the_curve_is_the_definition() {
        let mut z = normal(1);
        let y: Vec<f64> = (0..400).map(|_| 5.0 + z()).collect();
        let points = curve(&[&y], 0.01);
        assert_eq!(points[0].tau_s, 0.01);
        for p in points {
            let m = (p.tau_s / 0.01).round() as usize;
            assert!((p.deviation - by_means(&y, m)).abs() < 1e-12, "{m}");
        }
    }

    #[test]
    fn nist_test_suite() {
        // NIST SP 1065, 12.4: 1000 points of a known generator; overlapping Allan deviations at
        // averaging factors 1 and 10 and 100.
        let mut n = 1_234_567_890u64;
        let y: Vec<f64> = (0..1000)
            .map(|_| {
                let value = n as f64 / 2_147_483_647.0;
                n = (16_807 * n) % 2_147_483_647;
                value
            })
            .collect();
        let points = curve(&[&y], 1.0);
        for (m, wanted) in [
            (1.0, 2.922_319e-1),
            (10.0, 9.159_953e-2),
            (100.0, 3.241_343e-2),
        ] {
            let found = points.iter().find(|p| p.tau_s == m).unwrap();
            assert!(
                (found.deviation / wanted - 1.0).abs() < 1e-6,
                "{m} {found:?}"
            );
        }
    }

    #[test]
    fn white_noise_and_a_walk_are_found() {
        // White noise of density N is N/sqrt(period) a sample; a walk of density K grows by
        // K sqrt(period) each.
        let (period_s, n, k) = (0.01f64, 2e-3, 3e-4);
        let mut ratios = Vec::new();
        for seed in 0..8 {
            let mut z = normal(seed);
            let mut walk = 0.0;
            let y: Vec<f64> = (0..100_000)
                .map(|_| {
                    walk += k * period_s.sqrt() * z();
                    walk + n / period_s.sqrt() * z()
                })
                .collect();
            let found = noise(&curve(&[&y], period_s)).unwrap();
            assert!(found.has_floor);
            // The curve's minimum is where N^2/tau = K^2 tau/3.
            let tau_s = 3f64.sqrt() * n / k;
            assert!(found.instability_tau_s > tau_s / 4.0 && found.instability_tau_s < tau_s * 4.0);
            ratios.push(found.white / n);
        }
        for ratio in &ratios {
            assert!((ratio - 1.0).abs() < 0.02, "{ratios:?}");
        }
    }

    #[test]
    fn a_curve_that_still_falls_has_no_floor() {
        let mut z = normal(3);
        let y: Vec<f64> = (0..3000).map(|_| z()).collect();
        let found = noise(&curve(&[&y], 0.1)).unwrap();
        let end_s = 0.1 * 3000.0 / 3.0;
        assert!(!found.has_floor || found.instability_tau_s > 0.2 * end_s);
        assert!((found.white / 0.1f64.sqrt() - 1.0).abs() < 0.05);
    }

    #[test]
    fn a_gap_does_not_count_as_noise() {
        let mut z = normal(4);
        let mut y: Vec<f64> = (0..20_000).map(|_| z()).collect();
        let whole = curve(&[&y], 0.01);
        // The second half starts from another level, as after a restart.
        y[10_000..].iter_mut().for_each(|v| *v += 50.0);
        let (a, b) = y.split_at(10_000);
        let parted = curve(&[a, b], 0.01);
        for (p, w) in parted.iter().zip(&whole).filter(|(p, _)| p.tau_s < 5.0) {
            assert!((p.deviation / w.deviation - 1.0).abs() < 0.1, "{p:?} {w:?}");
        }
        assert!(curve(&[], 0.01).is_empty() && curve(&[&[1.0, 2.0]], 0.01).is_empty());
        assert!(noise(&[]).is_none());
    }
}
