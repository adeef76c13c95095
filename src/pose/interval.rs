//! Gaussian states under interval constraints.
//!
//! An edge between two beams says: a linear form of the state lies between two bounds, with nothing
//! to prefer inside. Expectation propagation (Minka 2001) keeps, for each such box, the Gaussian
//! factor that gives the state the same mean and variance along the form as the box itself would,
//! and repeats until all agree. With few boxes it is within a per cent of the exact posterior, and
//! its covariance is that of the posterior, not of a fit to mid-points.

use super::gaussian::Gaussian;
use nalgebra::SVector;

/// A softened box: `low <= row . state <= high`, each bound blurred by a Gaussian of `softness`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoxFactor<const N: usize> {
    /// The linear form.
    pub row: SVector<f64, N>,
    /// Lower bound.
    pub low: f64,
    /// Upper bound.
    pub high: f64,
    /// Standard deviation of the blur.
    pub softness: f64,
    /// Probability that the form lies outside after all: then it does by no more than the box is
    /// wide.
    pub doubt: f64,
}

/// The Gaussian factor along a box's form that stands for the box: precision, and precision times
/// mean.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Site {
    /// Precision.
    pub tau: f64,
    /// Precision times mean.
    pub nu: f64,
}

impl Site {
    /// What the factor should be: the one that gives the form the moments that `bounded` makes of its
    /// mean and variance without any factor. `mean` and `variance` are the form's with the present
    /// one. None where hardly anything but the present factor holds the form.
    pub(super) fn wanted(
        &self,
        mean: f64,
        variance: f64,
        bounded: impl FnOnce(f64, f64) -> (f64, f64),
    ) -> Option<Site> {
        let free = 1.0 - variance * self.tau;
        if !(free > 1e-9 && variance > 0.0) {
            return None;
        }
        let cavity_variance = variance / free;
        let cavity_mean = (mean - variance * self.nu) / free;
        let (new_mean, new_variance) = bounded(cavity_mean, cavity_variance);
        let tau = (1.0 / new_variance - 1.0 / cavity_variance).max(0.0);
        let nu = if tau > 0.0 {
            new_mean / new_variance - cavity_mean / cavity_variance
        } else {
            0.0
        };
        Some(Site { tau, nu })
    }
}

/// Part of a site's change that is taken over in one sweep, after the first.
const DAMPING: f64 = 0.8;
/// Sites that move the state by less than this share of its standard deviation have settled.
const SETTLED: f64 = 1e-2;

/// Puts `state` under all boxes, in at most `sweeps` passes over them. The sites are overwritten.
pub fn propagate<const N: usize>(
    state: &mut Gaussian<N>,
    boxes: &[BoxFactor<N>],
    sites: &mut Vec<Site>,
    sweeps: usize,
) {
    sites.clear();
    sites.resize(boxes.len(), Site::default());
    let mut share = 1.0;
    for _ in 0..sweeps {
        let mut change = 0.0f64;
        for (factor, site) in boxes.iter().zip(sites.iter_mut()) {
            change = change.max(revise(state, factor, site, 1.0, share));
        }
        share = DAMPING;
        if change < SETTLED {
            break;
        }
    }
}

/// Brings one box's factor nearer to what it should be against all else that the state knows, by this
/// share of the way. The state holds the factor `copies` times, for as many boxes that are alike but
/// independent. Returns by how much that changed the state, in standard deviations.
pub fn revise<const N: usize>(
    state: &mut Gaussian<N>,
    factor: &BoxFactor<N>,
    site: &mut Site,
    copies: f64,
    share: f64,
) -> f64 {
    let gain = state.along(&factor.row);
    let variance = factor.row.dot(&gain);
    let mean = factor.row.dot(&state.mean);
    let Some(wanted) = site.wanted(mean, variance, |m, v| box_moments(m, v, factor)) else {
        return 0.0;
    };
    let d_tau = share / copies * (wanted.tau - site.tau);
    let d_nu = share / copies * (wanted.nu - site.nu);
    site.tau += d_tau;
    site.nu += d_nu;
    let (d_tau, d_nu) = (copies * d_tau, copies * d_nu);
    let pull = d_nu - d_tau * mean;
    state.tighten(&gain, variance, d_tau, pull);
    (pull.abs() * variance.sqrt()).max((d_tau * variance).abs())
}

/// Mean and variance of a Gaussian restricted to a softened box that is not beyond doubt.
fn box_moments<const N: usize>(mean: f64, variance: f64, factor: &BoxFactor<N>) -> (f64, f64) {
    let soft = factor.softness * factor.softness;
    let s = (variance + soft).sqrt();
    let moments = |low: f64, high: f64| {
        let (low, high) = ((low - mean) / s, (high - mean) / s);
        let (at_low, at_high) = (Normal::at(low), Normal::at(high));
        let mass = Normal::between((low, at_low), (high, at_high));
        let (n_low, n_high) = (at_low.density, at_high.density);
        let first = (n_low - n_high) / mass;
        let second = (tail(low, n_low) - tail(high, n_high)) / mass;
        let within = variance + variance * variance / (s * s) * (second - first * first);
        (mass, variance * first / s, within)
    };
    let (mut mass, mut step, mut within) = moments(factor.low, factor.high);
    if factor.doubt > 0.0 && mass < DOUBTED {
        let width = factor.high - factor.low;
        let (wide_mass, wide_step, wide_within) = moments(factor.low - width, factor.high + width);
        let (sure, doubted) = ((1.0 - factor.doubt) * mass, factor.doubt * wide_mass);
        if sure + doubted > LEAST_MASS && wide_mass > LEAST_MASS {
            let share = doubted / (sure + doubted);
            if mass > LEAST_MASS {
                let apart = wide_step - step;
                within += share * (wide_within - within) + share * (1.0 - share) * apart * apart;
                step += share * apart;
            } else {
                (step, within) = (wide_step, wide_within);
            }
            mass = sure + doubted;
        }
    }
    if mass < LEAST_MASS {
        // The box is far out in the tail: all of it is at the nearer bound.
        let bound = if mean > factor.high {
            factor.high
        } else {
            factor.low
        };
        return (bound, variance * soft / (variance + soft));
    }
    (mean + step, within.clamp(variance * 1e-9, variance))
}

/// Mean and variance of a Gaussian restricted to an interval whose bounds are blurred by a Gaussian
/// of standard deviation `softness`.
pub(super) fn truncated(
    mean: f64,
    variance: f64,
    [low, high]: [f64; 2],
    softness: f64,
) -> (f64, f64) {
    let factor = BoxFactor::<1> {
        row: SVector::zeros(),
        low,
        high,
        softness,
        doubt: 0.0,
    };
    box_moments(mean, variance, &factor)
}

/// A box that holds this share of the Gaussian is not doubted.
const DOUBTED: f64 = 0.3;
/// A smaller share of the Gaussian is lost in rounding.
const LEAST_MASS: f64 = 1e-12;

/// x N(x), which goes to zero at infinity.
fn tail(x: f64, density: f64) -> f64 {
    if density == 0.0 { 0.0 } else { x * density }
}

/// Density of a standard normal number at a place, and the probability beyond it, away from zero.
#[derive(Clone, Copy)]
struct Normal {
    density: f64,
    beyond: f64,
}

impl Normal {
    /// By rational approximations of the error function (Cody, Mathematics of Computation 23, 1969,
    /// p. 631), which share their exponential with the density.
    #[inline]
    #[allow(clippy::excessive_precision)] // the constants are those of the paper
    fn at(x: f64) -> Normal {
        const NORM: f64 = 0.398_942_280_401_432_7;
        const SMALL: [[f64; 5]; 2] = [
            [
                3.209_377_589_138_469_4e3,
                3.774_852_376_853_020_2e2,
                1.138_641_541_510_501_6e2,
                3.161_123_743_870_565_6,
                1.857_777_061_846_031_5e-1,
            ],
            [
                2.844_236_833_439_171e3,
                1.282_616_526_077_372_3e3,
                2.440_246_379_344_441_7e2,
                2.360_129_095_234_412_2e1,
                1.0,
            ],
        ];
        const MIDDLE: [[f64; 9]; 2] = [
            [
                1.230_339_354_797_997_2e3,
                2.051_078_377_826_071_6e3,
                1.712_047_612_634_070_7e3,
                8.819_522_212_417_690_9e2,
                2.986_351_381_974_001e2,
                6.611_919_063_714_163e1,
                8.883_149_794_388_376,
                5.641_884_969_886_700_9e-1,
                2.153_115_354_744_038_3e-8,
            ],
            [
                1.230_339_354_803_749_4e3,
                3.439_367_674_143_721_6e3,
                4.362_619_090_143_247e3,
                3.290_799_235_733_459_6e3,
                1.621_389_574_566_690_3e3,
                5.371_811_018_620_098_6e2,
                1.176_939_508_913_125e2,
                1.574_492_611_070_983_5e1,
                1.0,
            ],
        ];
        const LARGE: [[f64; 6]; 2] = [
            [
                6.587_491_615_298_378e-4,
                1.608_378_514_874_227_5e-2,
                1.257_817_261_112_292_6e-1,
                3.603_448_999_498_044_4e-1,
                3.053_266_349_612_323_6e-1,
                1.631_538_713_730_209_7e-2,
            ],
            [
                2.335_204_976_268_691_8e-3,
                6.051_834_131_244_132e-2,
                5.279_051_029_514_285e-1,
                1.872_952_849_923_460_4,
                2.568_520_192_289_822,
                1.0,
            ],
        ];
        let y = x.abs() * std::f64::consts::FRAC_1_SQRT_2;
        let bell = (-0.5 * x * x).exp();
        let beyond = if y < 0.468_75 {
            0.5 - 0.5 * y * ratio(&SMALL, y * y)
        } else if y < 4.0 {
            0.5 * bell * ratio(&MIDDLE, y)
        } else {
            let z = 1.0 / (y * y);
            let most = 0.5 * std::f64::consts::FRAC_2_SQRT_PI;
            0.5 * bell * (most - z * ratio(&LARGE, z)) / y
        };
        Normal {
            density: NORM * bell,
            beyond,
        }
    }

    /// Probability between two places, each with what is known there, on the side where it does not
    /// cancel.
    #[inline]
    fn between((low, at_low): (f64, Normal), (high, at_high): (f64, Normal)) -> f64 {
        if low > 0.0 {
            at_low.beyond - at_high.beyond
        } else if high < 0.0 {
            at_high.beyond - at_low.beyond
        } else {
            1.0 - at_low.beyond - at_high.beyond
        }
    }
}

/// Two polynomials, lowest power first, divided.
#[inline]
fn ratio<const N: usize>([above, below]: &[[f64; N]; 2], x: f64) -> f64 {
    let value = |c: &[f64; N]| c.iter().rev().fold(0.0, |sum, c| sum * x + c);
    value(above) / value(below)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::SMatrix;

    fn normal_between(low: f64, high: f64) -> f64 {
        let below = |x: f64| 0.5 * libm::erfc(-x * std::f64::consts::FRAC_1_SQRT_2);
        below(high) - below(low)
    }

    #[test]
    fn tails_are_those_of_the_error_function() {
        for i in -4000..=4000 {
            let x = f64::from(i) * 0.009;
            let tail = 0.5 * libm::erfc(x.abs() * std::f64::consts::FRAC_1_SQRT_2);
            let found = Normal::at(x);
            assert!((found.beyond / tail - 1.0).abs() < 1e-12, "{x}");
            let density = (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt();
            assert!((found.density / density - 1.0).abs() < 1e-14, "{x}");
        }
        for (low, high) in [
            (-2.0, -1.9),
            (-0.1, 3.0),
            (0.2, 0.3),
            (-9.0, 9.0),
            (1.0, 5.0),
        ] {
            let found = Normal::between((low, Normal::at(low)), (high, Normal::at(high)));
            assert!((found - normal_between(low, high)).abs() < 1e-14);
        }
        let far = Normal::at(f64::INFINITY);
        assert_eq!([far.density, far.beyond], [0.0; 2]);
    }

    /// Moments of N(m, v) times the doubted, softened box, by summing over a fine grid.
    fn moments_by_sum(m: f64, v: f64, low: f64, high: f64, soft: f64, doubt: f64) -> (f64, f64) {
        let (mut w, mut wx, mut wxx) = (0.0, 0.0, 0.0);
        let reach = 8.0 * v.sqrt();
        let n = 200_000;
        for i in 0..=n {
            let x = m - reach + 2.0 * reach * f64::from(i) / f64::from(n);
            let width = high - low;
            let sure = normal_between((low - x) / soft, (high - x) / soft);
            let doubted = normal_between((low - width - x) / soft, (high + width - x) / soft);
            let p = (-0.5 * (x - m) * (x - m) / v).exp() * ((1.0 - doubt) * sure + doubt * doubted);
            w += p;
            wx += p * x;
            wxx += p * x * x;
        }
        (wx / w, wxx / w - (wx / w) * (wx / w))
    }

    #[test]
    fn box_moments_match_a_plain_sum() {
        for (m, v, low, high, soft, doubt) in [
            (0.0, 1.0, -0.5, 2.0, 0.1, 0.0),
            (1.0, 4.0, -3.0, -2.0, 0.3, 0.0),
            (0.0, 1.0, 2.5, 3.0, 0.05, 0.0),
            (0.0, 1.0, 0.8, 1.6, 0.05, 0.05),
            (0.0, 1.0, 2.5, 4.0, 0.05, 0.2),
            (0.0, 1.0, 9.0, 17.2, 0.05, 0.2),
        ] {
            let factor = BoxFactor {
                row: SVector::<f64, 1>::new(1.0),
                low,
                high,
                softness: soft,
                doubt,
            };
            let (mean, variance) = box_moments(m, v, &factor);
            let (mean_sum, variance_sum) = moments_by_sum(m, v, low, high, soft, doubt);
            assert!((mean - mean_sum).abs() < 1e-5, "{mean} {mean_sum}");
            assert!(
                (variance - variance_sum).abs() < 1e-5,
                "{variance} {variance_sum}"
            );
        }
    }

    #[test]
    fn polygon_posterior_is_met() {
        // Three boxes in the plane under a wide prior: the posterior is uniform on a polygon,
        // whose moments a plain sum over a grid gives.
        let prior = Gaussian {
            mean: SVector::<f64, 2>::zeros(),
            covariance: SMatrix::<f64, 2, 2>::identity() * 100.0,
        };
        let row = |a: f64, b: f64| SVector::<f64, 2>::new(a, b);
        let boxes = [
            BoxFactor {
                row: row(1.0, 0.0),
                low: -1.0,
                high: 0.5,
                softness: 1e-3,
                doubt: 0.0,
            },
            BoxFactor {
                row: row(0.3, 1.0),
                low: -0.2,
                high: 1.0,
                softness: 1e-3,
                doubt: 0.0,
            },
            BoxFactor {
                row: row(-0.6, 1.0),
                low: -0.5,
                high: 0.9,
                softness: 1e-3,
                doubt: 0.0,
            },
        ];
        let mut state = prior;
        propagate(&mut state, &boxes, &mut Vec::new(), 30);
        let (mut w, mut m, mut c) = (0.0, [0.0; 2], [0.0; 3]);
        for i in 0..2000 {
            for j in 0..2000 {
                let p = [
                    -2.0 + 4.0 * f64::from(i) / 2000.0,
                    -2.0 + 4.0 * f64::from(j) / 2000.0,
                ];
                let inside = boxes.iter().all(|b| {
                    let g = b.row[0] * p[0] + b.row[1] * p[1];
                    g >= b.low && g <= b.high
                });
                if inside {
                    w += 1.0;
                    m = [m[0] + p[0], m[1] + p[1]];
                    c = [c[0] + p[0] * p[0], c[1] + p[0] * p[1], c[2] + p[1] * p[1]];
                }
            }
        }
        m = m.map(|v| v / w);
        let sd = [
            (c[0] / w - m[0] * m[0]).sqrt(),
            (c[2] / w - m[1] * m[1]).sqrt(),
        ];
        for k in 0..2 {
            assert!(
                (state.mean[k] - m[k]).abs() < 0.05 * sd[k],
                "{} {}",
                state.mean[k],
                m[k]
            );
            let ratio = state.covariance[(k, k)].sqrt() / sd[k];
            assert!((ratio - 1.0).abs() < 0.05, "{ratio}");
        }
    }

    #[test]
    fn no_boxes_leave_the_prior() {
        let prior = Gaussian {
            mean: SVector::<f64, 2>::new(1.0, -2.0),
            covariance: SMatrix::<f64, 2, 2>::identity(),
        };
        let mut state = prior;
        propagate(&mut state, &[], &mut Vec::new(), 5);
        assert_eq!(state.mean, prior.mean);
        assert_eq!(state.covariance, prior.covariance);
    }
}
