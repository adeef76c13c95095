//! One straight line through beams: maximum likelihood in the ranges, with its covariance.
//!
//! A scanner's error is in the range, not across the line, so the residual is
//! `r - d / cos(theta - alpha)` (normal parametrisation `y cos(alpha) + z sin(alpha) = d`). Its
//! least squares are found in two steps: `1/r = A cos(theta) + B sin(theta)` with
//! `A = cos(alpha) / d`, `B = sin(alpha) / d` is linear in A and B and, with weights
//! `r^4 / sigma^2`, the same problem to first order ([`InverseRangeSums`], six sums, so that prefix
//! sums give the fit and the cost of any run of beams in O(1)); Gauss-Newton steps then take out
//! the small bias of weights made from noisy ranges.
//!
//! Two fits that take no notice of where the noise comes from are there for comparison:
//! orthogonal distances and one coordinate regressed on the other ([`Estimator`]).
//!
//! The covariance is the inverse information with the Jacobian
//! `(1 / cos(phi), -d sin(phi) / cos^2(phi))`, `phi = theta - alpha`. For a wall seen off its foot
//! point d and alpha are strongly correlated: use the whole matrix.

mod cartesian;
mod loss;
mod range;
mod sums;
#[cfg(test)]
mod tests;

pub use cartesian::Axis;
pub use loss::Loss;
pub use range::fit_from;
pub use sums::{InverseLine, InverseRangeSums, PrefixSums};

use crate::record::FittedLine;

/// Beams to fit, as parallel arrays; the points are in the scan plane of S.
#[derive(Clone, Debug, Default)]
pub struct Beams {
    range_m: Vec<f64>,
    y_m: Vec<f64>,
    z_m: Vec<f64>,
}

impl Beams {
    /// Forgets all beams.
    pub fn clear(&mut self) {
        self.range_m.clear();
        self.y_m.clear();
        self.z_m.clear();
    }

    /// Adds a beam by its angle (rad) and range (m, positive and finite).
    pub fn push(&mut self, angle_rad: f64, range_m: f64) {
        let (sin, cos) = angle_rad.sin_cos();
        self.push_point(range_m, range_m * cos, range_m * sin);
    }

    /// Adds a beam by its range and the point it hit.
    pub fn push_point(&mut self, range_m: f64, y_m: f64, z_m: f64) {
        self.range_m.push(range_m);
        self.y_m.push(y_m);
        self.z_m.push(z_m);
    }

    /// Adds a run of beams.
    pub fn extend(&mut self, beams: BeamSlice<'_>) {
        self.range_m.extend_from_slice(beams.range_m);
        self.y_m.extend_from_slice(beams.y_m);
        self.z_m.extend_from_slice(beams.z_m);
    }

    /// All beams.
    pub fn all(&self) -> BeamSlice<'_> {
        BeamSlice {
            range_m: &self.range_m,
            y_m: &self.y_m,
            z_m: &self.z_m,
        }
    }
}

impl FromIterator<(f64, f64)> for Beams {
    /// Collects pairs of angle (rad) and range (m).
    fn from_iter<I: IntoIterator<Item = (f64, f64)>>(beams: I) -> Beams {
        let mut all = Beams::default();
        for (angle_rad, range_m) in beams {
            all.push(angle_rad, range_m);
        }
        all
    }
}

/// A borrowed run of beams: range and hit point of each.
#[derive(Clone, Copy, Debug)]
pub struct BeamSlice<'a> {
    /// Ranges, m.
    pub range_m: &'a [f64],
    /// First coordinates of the points, m.
    pub y_m: &'a [f64],
    /// Second coordinates of the points, m.
    pub z_m: &'a [f64],
}

impl<'a> BeamSlice<'a> {
    /// Number of beams.
    pub fn len(&self) -> usize {
        self.range_m.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.range_m.is_empty()
    }

    /// Range and point of every beam.
    pub fn iter(&self) -> impl Iterator<Item = (f64, f64, f64)> + use<'a> {
        let points = self.y_m.iter().zip(self.z_m);
        self.range_m
            .iter()
            .zip(points)
            .map(|(range_m, (y_m, z_m))| (*range_m, *y_m, *z_m))
    }

    /// Beams `from..to`; cut off at the end.
    pub fn run(&self, from: usize, to: usize) -> BeamSlice<'a> {
        let to = to.min(self.len());
        let from = from.min(to);
        BeamSlice {
            range_m: &self.range_m[from..to],
            y_m: &self.y_m[from..to],
            z_m: &self.z_m[from..to],
        }
    }
}

/// Squared sine of the angle between two directions below which they count as one.
pub(super) const DEGENERATE: f64 = 1e-13;

/// What a line is fitted by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Estimator {
    /// Maximum likelihood in the ranges; reaches the Cramer-Rao bound.
    #[default]
    MaximumLikelihood,
    /// Total least squares: the distances to the line, all alike.
    TotalLeastSquares,
    /// Ordinary least squares: one coordinate regressed on the other (the dissertation's
    /// y = m x + c).
    OrdinaryLeastSquares(Axis),
}

/// Fits a line to beams with range noise `sigma_m`; none where they do not define one.
///
/// `points` and `rms_m` of the result are those of the beams that count: all of them, or with a
/// robust loss those within its limit (three sigmas for Huber's).
pub fn fit(beams: BeamSlice<'_>, sigma_m: f64, loss: Loss) -> Option<FittedLine> {
    let start = beams.iter().collect::<InverseRangeSums>().line()?;
    match loss {
        Loss::Squares => fit_from(start, beams, sigma_m),
        robust => range::fit_robust(start, beams, sigma_m, robust),
    }
}

/// Fits a line near `start` (such as a closed form's) by any estimator; see [`fit`].
///
/// The covariance is that of the estimator for noise in the ranges, not the one which it would have
/// under the noise that it assumes.
pub fn fit_near(
    start: InverseLine,
    beams: BeamSlice<'_>,
    sigma_m: f64,
    estimator: Estimator,
    loss: Loss,
) -> Option<FittedLine> {
    match (estimator, loss) {
        (Estimator::MaximumLikelihood, Loss::Squares) => fit_from(start, beams, sigma_m),
        (Estimator::MaximumLikelihood, _) => range::fit_robust(start, beams, sigma_m, loss),
        (Estimator::TotalLeastSquares, _) => {
            cartesian::fit(start, beams, sigma_m, cartesian::Residual::Orthogonal, loss)
        }
        (Estimator::OrdinaryLeastSquares(axis), _) => {
            let residual = axis.residual(beams);
            cartesian::fit(start, beams, sigma_m, residual, loss)
        }
    }
}
