//! Gaussian states and what a linear measurement does to them.

use nalgebra::{SMatrix, SVector};

/// A Gaussian over N components.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gaussian<const N: usize> {
    /// Mean, in the units of the components.
    pub mean: SVector<f64, N>,
    /// Covariance.
    pub covariance: SMatrix<f64, N, N>,
}

impl<const N: usize> Gaussian<N> {
    /// Independent components with these means and standard deviations.
    pub fn independent(mean: [f64; N], sigma: [f64; N]) -> Gaussian<N> {
        Gaussian {
            mean: mean.into(),
            covariance: SMatrix::from_diagonal(&SVector::from(sigma.map(|s| s * s))),
        }
    }

    /// Standard deviation of a component; NaN for one that there is not.
    pub fn sigma(&self, component: usize) -> f64 {
        let variance = self.covariance.get((component, component));
        variance.map_or(f64::NAN, |v| v.sqrt())
    }

    /// Covariance of the components with a linear form of them.
    #[inline]
    pub fn along(&self, row: &SVector<f64, N>) -> SVector<f64, N> {
        let mut gain = [0.0; N];
        for (column, weight) in self.covariance.data.0.iter().zip(row.iter()) {
            for (gain, c) in gain.iter_mut().zip(column) {
                *gain += weight * c;
            }
        }
        gain.into()
    }

    /// Adds `weight * gain * gain^T` to the covariance.
    #[inline]
    fn add_square(&mut self, gain: &SVector<f64, N>, weight: f64) {
        let gain = &gain.data.0[0];
        for (column, by) in self.covariance.data.0.iter_mut().zip(gain) {
            let by = weight * by;
            for (c, gain) in column.iter_mut().zip(gain) {
                *c += by * gain;
            }
        }
    }

    /// Adds `precision` to the inverse variance of a linear form, whose covariance with the
    /// components is `gain` and whose variance is `variance`, and moves the mean so that the form
    /// is drawn with `pull` (precision times the distance wanted). A negative precision takes back.
    #[inline]
    pub fn tighten(&mut self, gain: &SVector<f64, N>, variance: f64, precision: f64, pull: f64) {
        let scale = 1.0 / (1.0 + precision * variance);
        self.mean.axpy(pull * scale, gain, 1.0);
        self.add_square(gain, -precision * scale);
    }

    /// Takes in the measurement `row . state = value` with `variance`.
    #[inline]
    pub fn observe(&mut self, row: &SVector<f64, N>, value: f64, variance: f64) {
        let gain = self.along(row);
        let spread = row.dot(&gain) + variance;
        let step = (value - row.dot(&self.mean)) / spread;
        self.mean.axpy(step, &gain, 1.0);
        self.add_square(&gain, -1.0 / spread);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn measurements_one_by_one_are_the_normal_equations() {
        let prior = Gaussian::independent([1.0, -2.0, 0.5], [0.5, 2.0, 1.0]);
        let rows = [
            SVector::<f64, 3>::new(1.0, 0.2, -0.4),
            SVector::<f64, 3>::new(-0.3, 1.0, 0.7),
        ];
        let (values, variances) = ([0.3, -1.0], [0.01, 0.2]);
        let mut state = prior;
        let mut information = prior.covariance.try_inverse().unwrap();
        let mut vector = information * prior.mean;
        for ((row, value), variance) in rows.iter().zip(values).zip(variances) {
            state.observe(row, value, variance);
            information += row * row.transpose() / variance;
            vector += row * (value / variance);
        }
        let covariance = information.try_inverse().unwrap();
        assert!((state.covariance - covariance).norm() < 1e-12);
        assert!((state.mean - covariance * vector).norm() < 1e-12);
        // The same by precision.
        let mut tightened = prior;
        for ((row, value), variance) in rows.iter().zip(values).zip(variances) {
            let gain = tightened.along(row);
            let off = value - row.dot(&tightened.mean);
            tightened.tighten(&gain, row.dot(&gain), 1.0 / variance, off / variance);
        }
        assert!((tightened.covariance - covariance).norm() < 1e-12);
        assert!((tightened.mean - state.mean).norm() < 1e-12);
    }
}
