//! The filter's state and how it goes on from scan to scan.

use crate::motion::Gait;
use crate::pose::gaussian::Gaussian;
use crate::pose::joint::{self, BIAS, FOOTPRINT, THRESHOLD};
use nalgebra::{SMatrix, SVector};

/// Components of the state: those of [`joint::Vector`], what is slow besides, and six velocities.
pub(super) const N: usize = 17;
/// Constant error of the pitch that was given, rad.
pub(super) const PITCH_ERROR: usize = 9;
/// The part of the hit threshold that is the same in all scans, spot radii. The joint state's is the
/// scan's own deviation from it.
pub(super) const COMMON_THRESHOLD: usize = 10;
/// Velocities of x, y, z (m/s), rates of roll, pitch and yaw (rad/s).
pub(super) const VELOCITY: usize = 11;

/// A state, or a row that multiplies one.
pub(super) type State = SVector<f64, N>;
pub(super) type Square = SMatrix<f64, N, N>;

/// A row of the joint estimator as a row of the filter.
pub(super) fn widened(row: &joint::Vector) -> State {
    let mut wide = State::zeros();
    wide.fixed_rows_mut::<{ joint::STATE }>(0).copy_from(row);
    wide[COMMON_THRESHOLD] = row[THRESHOLD];
    wide
}

/// What changes slowly, and what is drawn anew for every scan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nuisances {
    /// Standard deviation of the hit threshold's change from scan to scan, spot radii.
    pub threshold_scan_sigma: f64,
    /// Standard deviation of its constant part, spot radii.
    pub threshold_sigma: f64,
    /// Standard deviation of the footprint's scale.
    pub footprint_sigma: f64,
    /// Wandering of the range bias, m/sqrt(s); none where every scan has its own.
    pub range_bias_walk: Option<f64>,
    /// Wandering of the given pitch's error, rad/sqrt(s).
    pub pitch_error_walk: f64,
}

impl Default for Nuisances {
    fn default() -> Self {
        Nuisances {
            threshold_scan_sigma: 0.08,
            threshold_sigma: 0.04,
            footprint_sigma: 0.15,
            range_bias_walk: None,
            pitch_error_walk: 1e-5,
        }
    }
}

/// Standard deviation of a range bias that nothing is known of, m.
const ANY_BIAS_M: f64 = 1.0;
/// Wandering of threshold and footprint, 1/sqrt(s).
const SLOW_WALK: f64 = 1e-3;
/// Wandering of a component at rest, m/sqrt(s) and rad/sqrt(s).
const REST_WALK: [f64; 6] = [1e-5, 1e-5, 1e-5, 3e-6, 3e-6, 3e-6];
/// Standard deviation of a velocity that nothing is known of, m/s and rad/s.
pub(super) const ANY_VELOCITY: [f64; 6] = [0.1, 1.5, 1.5, 0.3, 0.3, 0.1];

/// How the state got from one scan to the next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Step {
    /// Time in between, s.
    pub span_s: f64,
    /// How each component of the pose moved.
    pub gaits: [Gait; 6],
}

impl Step {
    /// Whether the whole platform stood.
    pub(super) fn is_rest(&self) -> bool {
        self.gaits.iter().all(|gait| *gait == Gait::Rest)
    }

    /// The state after the step.
    pub(super) fn predict(&self, state: &Gaussian<N>, nuisances: &Nuisances) -> Gaussian<N> {
        let half = self.carry(&state.covariance, nuisances);
        let mut covariance = self.carry(&half.transpose(), nuisances);
        self.add_noise(&mut covariance, nuisances);
        covariance = 0.5 * (covariance + covariance.transpose());
        Gaussian {
            mean: self.carry(&state.mean, nuisances),
            covariance,
        }
    }

    /// The transition, applied from the left. What every scan draws anew keeps nothing.
    pub(super) fn carry<const C: usize>(
        &self,
        matrix: &SMatrix<f64, N, C>,
        nuisances: &Nuisances,
    ) -> SMatrix<f64, N, C> {
        let mut out = *matrix;
        for (k, gait) in self.gaits.iter().enumerate() {
            for c in 0..C {
                match gait {
                    Gait::Rest => out[(VELOCITY + k, c)] = 0.0,
                    Gait::Moving { .. } => out[(k, c)] += self.span_s * matrix[(VELOCITY + k, c)],
                }
            }
        }
        out.fill_row(THRESHOLD, 0.0);
        if nuisances.range_bias_walk.is_none() {
            out.fill_row(BIAS, 0.0);
        }
        out
    }

    fn add_noise(&self, covariance: &mut Square, nuisances: &Nuisances) {
        let t = self.span_s.abs();
        for (k, gait) in self.gaits.iter().enumerate() {
            let v = VELOCITY + k;
            match gait {
                Gait::Rest => {
                    covariance[(k, k)] += REST_WALK[k] * REST_WALK[k] * t;
                    covariance[(v, v)] += ANY_VELOCITY[k] * ANY_VELOCITY[k];
                }
                Gait::Moving { psd } => {
                    covariance[(k, k)] += psd * t * t * t / 3.0;
                    covariance[(k, v)] += psd * t * t / 2.0;
                    covariance[(v, k)] += psd * t * t / 2.0;
                    covariance[(v, v)] += psd * t;
                }
            }
        }
        covariance[(THRESHOLD, THRESHOLD)] += nuisances.threshold_scan_sigma.powi(2);
        covariance[(BIAS, BIAS)] += match nuisances.range_bias_walk {
            Some(walk) => walk * walk * t,
            None => ANY_BIAS_M * ANY_BIAS_M,
        };
        covariance[(FOOTPRINT, FOOTPRINT)] += SLOW_WALK * SLOW_WALK * t;
        covariance[(COMMON_THRESHOLD, COMMON_THRESHOLD)] += SLOW_WALK * SLOW_WALK * t;
        let walk = nuisances.pitch_error_walk;
        covariance[(PITCH_ERROR, PITCH_ERROR)] += walk * walk * t;
    }
}

/// What is known before the first scan. `alone` is what the joint estimator knows before a scan of
/// its own. Its pitch is free where the scan brings a measured one, as another measurement, whose
/// constant error has the standard deviation `constant_pitch_sigma_rad`.
pub(super) fn prior(
    alone: &Gaussian<{ joint::STATE }>,
    pitch_is_measured: bool,
    constant_pitch_sigma_rad: f64,
    nuisances: &Nuisances,
) -> Gaussian<N> {
    let mut mean = State::zeros();
    mean.fixed_rows_mut::<{ joint::STATE }>(0)
        .copy_from(&alone.mean);
    mean[COMMON_THRESHOLD] = mean[THRESHOLD];
    mean[THRESHOLD] = 0.0;
    let mut sigma = [0.0; N];
    for (k, sigma) in sigma.iter_mut().enumerate().take(joint::STATE) {
        *sigma = alone.sigma(k);
    }
    if pitch_is_measured {
        sigma[joint::PITCH] = ANY_TILT_RAD;
    }
    sigma[BIAS] = ANY_BIAS_M;
    sigma[THRESHOLD] = nuisances.threshold_scan_sigma;
    sigma[FOOTPRINT] = nuisances.footprint_sigma;
    sigma[PITCH_ERROR] = constant_pitch_sigma_rad.max(LEAST_RAD);
    sigma[COMMON_THRESHOLD] = nuisances.threshold_sigma;
    sigma[VELOCITY..].copy_from_slice(&ANY_VELOCITY);
    Gaussian::independent(mean.into(), sigma)
}

/// Standard deviation of a pitch that nothing is known of, rad.
const ANY_TILT_RAD: f64 = 0.2;
/// A pitch that is said to be exact is as good as this, rad.
pub(super) const LEAST_RAD: f64 = 1e-5;
