//! The mean of one component over a standstill, and what it is worth.
//!
//! The mean of n poses is not n^1/2 times as good as one of them. Its uncertainty has two parts:
//!
//! - what averages out: the scatter about the mean over the number of independent poses, which the
//!   autocorrelation gives ([`effective_number`]), with Student's factor for few of them;
//! - what does not: the part of the poses' covariance that the scatter does not show. A standing
//!   platform sees the same beams miss the same edges, and the same wrong pitch, for as long as it
//!   stands.
//!
//! A scatter of n poses is itself uncertain by (2/n)^1/2 of its square, far more than the 1/n of it
//! that the mean is uncertain by: taken from one standstill alone, a part that stays would be found in
//! pure noise too, and twice the size of what averages out. Whether anything stays is therefore asked
//! of all standstills of a run together ([`tell_what_stays`]).

use super::{Sample, mean};
use crate::report::consistency::effective_number;
use crate::report::statistics::wrap_angle;

/// The mean of one component over a standstill, m or rad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Component {
    /// The mean; NaN where no pose has the component.
    pub mean: f64,
    /// Its standard deviation: both parts together.
    pub sigma: f64,
    /// The part that more poses would make smaller.
    pub averaging: f64,
    /// The part that stays however long the platform stands.
    pub fixed: f64,
    /// Standard deviation of a single pose about the mean.
    pub scatter: f64,
    /// Number of independent poses.
    pub effective_n: f64,
    /// Slope over time, m/s or rad/s.
    pub drift: f64,
    /// Its standard deviation.
    pub drift_sigma: f64,
    /// Variance of a single pose by the poses' own covariance; NaN where they have none.
    stated: f64,
}

impl Component {
    /// Of component `k` of the poses of a standstill. What stays is not known yet.
    pub(super) fn of(samples: &[&Sample], k: usize) -> Component {
        let known: Vec<&&Sample> = samples.iter().filter(|s| s.value[k].is_finite()).collect();
        let values: Vec<f64> = known.iter().map(|s| s.value[k]).collect();
        let n = values.len() as f64;
        let middle = mean(values.iter().copied());
        let squares: f64 = values.iter().map(|v| (v - middle).powi(2)).sum();
        let effective_n = effective_number(&values);
        // The mean follows correlated values, so that their squares about it are too small.
        let variance = squares / (n * (1.0 - 1.0 / effective_n)).max(1.0);
        let freedom = effective_n - 1.0;
        let student = if freedom > 3.0 {
            freedom / (freedom - 2.0)
        } else {
            3.0
        };
        let averaging = (student * variance / effective_n).sqrt();
        let stated = known.iter().map(|s| s.variance[k]);
        let [drift, drift_sigma] = drift(&known, k, middle);
        Component {
            mean: if k < 3 { middle } else { wrap_angle(middle) },
            sigma: averaging,
            averaging,
            fixed: 0.0,
            scatter: variance.sqrt(),
            effective_n,
            drift,
            drift_sigma,
            stated: mean(stated.filter(|v| v.is_finite() && *v > 0.0)),
        }
    }

    /// Independent poses that its scatter is from, beyond the one that the mean takes.
    fn freedom(&self) -> f64 {
        (self.effective_n - 1.0).max(1.0)
    }

    /// The part of the stated variance that the scatter does not show, if there is one. The scatter's
    /// square is uncertain, and the part cannot be negative: this is about the mean of what it can be
    /// (a hyperbola close to the mean of the positive part of a normal number).
    fn unseen_variance(&self) -> f64 {
        let seen = self.scatter * self.scatter;
        let difference = self.stated - seen;
        // Twice the density of the normal distribution in its middle.
        let width = 0.797_885 * seen * (2.0 / self.freedom()).sqrt();
        0.5 * (difference + difference.hypot(width))
    }
}

/// Tells what stays from what averages out, of one component over all standstills of a run: the part
/// that each one's scatter does not show, times the probability that anything stays at all.
pub(super) fn tell_what_stays<'a>(components: impl Iterator<Item = &'a mut Component>) {
    let mut known: Vec<&mut Component> = components.filter(|c| c.stated.is_finite()).collect();
    let weight: f64 = known.iter().map(|c| c.freedom()).sum();
    let unseen = |c: &&mut Component| c.freedom() * (1.0 - c.scatter * c.scatter / c.stated);
    let share = known.iter().map(unseen).sum::<f64>() / weight;
    let probability = staying(share, (2.0 / weight).sqrt());
    for component in &mut known {
        component.fixed = (probability * component.unseen_variance()).sqrt();
        component.sigma = component.averaging.hypot(component.fixed);
    }
}

/// How likely it is, before anything is looked at, that a part of the variance stays: with a third the
/// sigmas of pure noise are 1.2 to 1.5 times too large over six standstills, and parts that are too
/// small to be seen are still covered three times in four.
const STAYS: f64 = 1.0 / 3.0;

/// The probability that a part of the stated variance stays, any share of it alike, where the scatter
/// leaves `share` of it unexplained with an uncertainty of `sigma` if nothing stays.
fn staying(share: f64, sigma: f64) -> f64 {
    // A scatter beyond what is stated tells of poses that are too sure, not of anything that stays.
    let share = share.clamp(0.0, 1.0);
    let density = |z: f64| (-0.5 * z * z).exp() / std::f64::consts::TAU.sqrt();
    let below = |z: f64| 0.5 * libm::erfc(-z * std::f64::consts::FRAC_1_SQRT_2);
    // The less of the variance scatters, the less uncertain is how much of it does.
    let left = (sigma * (1.0 - share)).max(1e-9);
    let something = STAYS * (below(share / left) - below((share - 1.0) / left));
    let nothing = (1.0 - STAYS) * density(share / sigma) / sigma;
    something / (something + nothing)
}

/// Slope of a component over time and its standard deviation, from what is left without the slope.
fn drift(known: &[&&Sample], k: usize, middle: f64) -> [f64; 2] {
    let n = known.len() as f64;
    let mean_s = mean(known.iter().map(|s| s.t_s));
    let times: f64 = known.iter().map(|s| (s.t_s - mean_s).powi(2)).sum();
    let products = known
        .iter()
        .map(|s| (s.t_s - mean_s) * (s.value[k] - middle));
    let slope = products.sum::<f64>() / times;
    let rest: Vec<f64> = known
        .iter()
        .map(|s| s.value[k] - middle - slope * (s.t_s - mean_s))
        .collect();
    let effective_n = effective_number(&rest);
    let squares: f64 = rest.iter().map(|r| r * r).sum();
    let variance = squares / (n * (1.0 - 2.0 / effective_n)).max(1.0);
    [slope, (variance * n / (effective_n * times)).sqrt()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_stays_is_believed_as_far_as_it_is_seen() {
        for sigma in [0.3, 0.1, 0.01] {
            assert!(
                staying(0.0, sigma) < 0.3 && staying(-5.0, sigma) < 0.3,
                "{sigma}"
            );
            assert!(staying(4.0 * sigma, sigma) > 0.9, "{sigma}");
            assert!(staying(1.0, sigma) > 0.97, "{sigma}");
        }
        let rising: Vec<f64> = (0..=100)
            .map(|i| staying(f64::from(i) / 100.0, 0.1))
            .collect();
        assert!(rising.is_sorted() && rising.iter().all(|p| (0.0..=1.0).contains(p)));
        // The more is known, the surer is nothing.
        assert!(staying(0.0, 0.01) < staying(0.0, 0.1));
    }
}
