//! What large residuals count for.

/// What large residuals count for.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Loss {
    /// Least squares: for beams known to be on the line.
    #[default]
    Squares,
    /// Huber's, linear beyond the given number of sigmas (1.345 usual). Outliers keep a bias.
    Huber(f64),
    /// Tukey's biweight, nothing beyond the given number of sigmas (4.685 usual), started from
    /// Huber's.
    Tukey(f64),
    /// Hard rejection beyond the given number of sigmas, started from Huber's.
    Trimmed(f64),
}

impl Loss {
    /// Huber's loss with 95 % efficiency on normal errors.
    pub const HUBER: Loss = Loss::Huber(1.345);

    /// Tukey's biweight with 95 % efficiency on normal errors.
    pub const TUKEY: Loss = Loss::Tukey(4.685);

    /// Weight of a residual given in sigmas.
    pub(super) fn weight(self, u: f64) -> f64 {
        match self {
            Loss::Squares => 1.0,
            Loss::Huber(k) => (k / u.abs()).min(1.0),
            Loss::Tukey(c) if u.abs() < c => (1.0 - (u / c).powi(2)).powi(2),
            Loss::Trimmed(k) if u.abs() <= k => 1.0,
            Loss::Tukey(_) | Loss::Trimmed(_) => 0.0,
        }
    }

    /// Residuals beyond this are no part of the line, m; Huber's and least squares take three
    /// sigmas.
    pub(super) fn limit_m(self, sigma_m: f64) -> f64 {
        sigma_m
            * match self {
                Loss::Tukey(c) | Loss::Trimmed(c) => c,
                Loss::Huber(_) | Loss::Squares => 3.0,
            }
    }

    /// Variance of the estimate over that of least squares, on normal errors.
    pub(super) fn variance_factor(self) -> f64 {
        match self {
            Loss::Squares | Loss::Trimmed(_) => 1.0,
            Loss::Huber(_) | Loss::Tukey(_) => 1.0 / 0.95,
        }
    }
}
