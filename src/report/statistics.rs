//! Error statistics of one component.

use std::f64::consts::PI;

/// Statistics of a series of errors e, in the errors' own unit. NaN where there is no value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Statistics {
    /// Number of errors.
    pub n: usize,
    /// Mean of e.
    pub bias: f64,
    /// Standard deviation of e about the bias, with n - 1.
    pub std: f64,
    /// sqrt(mean of e^2).
    pub rms: f64,
    /// Median of e.
    pub median: f64,
    /// Median of |e - median|, not scaled to a sigma.
    pub mad: f64,
    /// 95th percentile of |e|; see [`percentile`].
    pub p95: f64,
    /// 99th percentile of |e|.
    pub p99: f64,
    /// Largest |e|.
    pub max: f64,
    /// Smallest |e|.
    pub min: f64,
    /// Sum of e^2.
    pub sse: f64,
}

impl Statistics {
    /// Statistics of `errors`, whose order it does not keep. All errors must be numbers.
    pub fn of(errors: &mut [f64]) -> Statistics {
        let n = errors.len();
        let count = n as f64;
        let bias = errors.iter().sum::<f64>() / count;
        let sse = errors.iter().map(|e| e * e).sum::<f64>();
        let about_bias = errors.iter().map(|e| (e - bias).powi(2)).sum::<f64>();
        let median = percentile_of(errors, 50.0);
        let mut about_median: Vec<f64> = errors.iter().map(|e| (e - median).abs()).collect();
        let mad = percentile_of(&mut about_median, 50.0);
        drop(about_median);
        errors.iter_mut().for_each(|e| *e = e.abs());
        let extreme = |pick: fn(f64, f64) -> f64| errors.iter().copied().reduce(pick);
        let (min, max) = (extreme(f64::min), extreme(f64::max));
        Statistics {
            n,
            bias,
            std: if n > 1 {
                (about_bias / (count - 1.0)).sqrt()
            } else {
                f64::NAN
            },
            rms: (sse / count).sqrt(),
            median,
            mad,
            p95: percentile_of(errors, 95.0),
            p99: percentile_of(errors, 99.0),
            max: max.unwrap_or(f64::NAN),
            min: min.unwrap_or(f64::NAN),
            sse: if n > 0 { sse } else { f64::NAN },
        }
    }

    /// The same statistics in another unit, `factor` of which make one of this.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Statistics {
        Statistics {
            n: self.n,
            bias: self.bias * factor,
            std: self.std * factor,
            rms: self.rms * factor,
            median: self.median * factor,
            mad: self.mad * factor,
            p95: self.p95 * factor,
            p99: self.p99 * factor,
            max: self.max * factor,
            min: self.min * factor,
            sse: self.sse * factor * factor,
        }
    }
}

/// The [`percentile`] of values in any order, which it changes: only the two order statistics that
/// matter are looked for.
pub(super) fn percentile_of(values: &mut [f64], percent: f64) -> f64 {
    let Some(last) = values.len().checked_sub(1) else {
        return f64::NAN;
    };
    let place = (percent / 100.0).clamp(0.0, 1.0) * last as f64;
    let below = place.floor() as usize;
    let (_, a, above) = values.select_nth_unstable_by(below, f64::total_cmp);
    match above.iter().copied().reduce(f64::min) {
        Some(b) => *a + (b - *a) * (place - below as f64),
        None => *a,
    }
}

/// The `percent`th percentile of `sorted` values: linear between the two neighbouring order
/// statistics, with the smallest value at 0 and the largest at 100 (Hyndman and Fan's type 7, the
/// default of numpy and R). NaN for no values.
pub fn percentile(sorted: &[f64], percent: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else {
        return f64::NAN;
    };
    let place = (percent / 100.0).clamp(0.0, 1.0) * last as f64;
    let below = place.floor() as usize;
    match (sorted.get(below), sorted.get(below + 1)) {
        (Some(a), Some(b)) => a + (b - a) * (place - below as f64),
        (Some(a), None) => *a,
        _ => f64::NAN,
    }
}

/// The angle in [-pi, pi) that differs from `angle_rad` by whole turns; small angles unchanged.
pub fn wrap_angle(angle_rad: f64) -> f64 {
    if (-PI..PI).contains(&angle_rad) {
        return angle_rad;
    }
    (angle_rad + PI).rem_euclid(2.0 * PI) - PI
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn closed_form_of_one_to_five() {
        let s = Statistics::of(&mut [3.0, 1.0, 5.0, 2.0, 4.0]);
        assert_eq!((s.n, s.bias, s.median, s.mad), (5, 3.0, 3.0, 1.0));
        assert!((s.std - 2.5f64.sqrt()).abs() < 1e-15);
        assert!((s.rms - 11f64.sqrt()).abs() < 1e-15);
        assert_eq!((s.max, s.min, s.sse), (5.0, 1.0, 55.0));
        assert!((s.p95 - 4.8).abs() < 1e-12 && (s.p99 - 4.96).abs() < 1e-12);
    }

    #[test]
    fn signs_count_in_bias_and_not_in_size() {
        let s = Statistics::of(&mut [-2.0, 2.0, -2.0, 2.0]);
        assert_eq!((s.bias, s.rms, s.max, s.min), (0.0, 2.0, 2.0, 2.0));
        assert_eq!((s.median, s.mad), (0.0, 2.0));
    }

    #[test]
    fn a_sine_has_its_known_figures() {
        let n = 3600;
        let mut errors: Vec<f64> = (0..n)
            .map(|i| (2.0 * PI * f64::from(i) / f64::from(n)).sin())
            .collect();
        let s = Statistics::of(&mut errors);
        assert!(s.bias.abs() < 1e-12);
        assert!((s.rms - 0.5f64.sqrt()).abs() < 1e-12);
        // |sin| is below sin(0.95 pi/2) for 95 % of a turn.
        assert!((s.p95 - (0.95 * PI / 2.0).sin()).abs() < 1e-3);
        assert!((s.mad - 0.5f64.sqrt()).abs() < 1e-3);
    }

    #[test]
    fn none_and_one() {
        let none = Statistics::of(&mut []);
        assert_eq!(none.n, 0);
        assert!(none.bias.is_nan() && none.rms.is_nan() && none.max.is_nan() && none.sse.is_nan());
        let one = Statistics::of(&mut [-0.5]);
        assert_eq!((one.bias, one.rms, one.p99, one.mad), (-0.5, 0.5, 0.5, 0.0));
        assert!(one.std.is_nan());
    }

    #[test]
    fn angles_wrap() {
        assert_eq!(wrap_angle(0.1), 0.1);
        assert!((wrap_angle(2.0 * PI - 0.001) + 0.001).abs() < 1e-12);
        assert!((wrap_angle(-2.0 * PI + 0.001) - 0.001).abs() < 1e-12);
        assert!((wrap_angle(7.0 * PI) + PI).abs() < 1e-12);
        assert_eq!(wrap_angle(PI), -PI);
        assert!(wrap_angle(f64::NAN).is_nan());
    }

    proptest! {
        #[test]
        fn a_percentile_needs_no_order(
            values in prop::collection::vec(-1e3f64..1e3, 1..60), percent in 0.0f64..100.0
        ) {
            let mut sorted = values.clone();
            sorted.sort_unstable_by(f64::total_cmp);
            for percent in [percent, 0.0, 50.0, 100.0] {
                let found = percentile_of(&mut values.clone(), percent);
                prop_assert_eq!(found, percentile(&sorted, percent));
            }
        }

        #[test]
        fn rms_is_bias_and_spread(mut errors in prop::collection::vec(-1e3f64..1e3, 2..200)) {
            let s = Statistics::of(&mut errors);
            let n = s.n as f64;
            let both = s.bias.powi(2) + s.std.powi(2) * (n - 1.0) / n;
            prop_assert!((s.rms.powi(2) - both).abs() <= 1e-9 * both.max(1.0));
            prop_assert!(s.min <= s.p95 && s.p95 <= s.p99 && s.p99 <= s.max);
            prop_assert!(s.rms <= s.max * (1.0 + 1e-12));
        }

        #[test]
        fn wrapping_keeps_the_direction(angle in -1e3f64..1e3) {
            let wrapped = wrap_angle(angle);
            prop_assert!((-PI..=PI).contains(&wrapped));
            prop_assert!((wrapped.sin() - angle.sin()).abs() < 1e-9);
            prop_assert!((wrapped.cos() - angle.cos()).abs() < 1e-9);
        }
    }
}
