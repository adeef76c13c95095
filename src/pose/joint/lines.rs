//! What the reflector lines say of the state.

use super::edges::PointFactor;
use super::state::{BIAS, STATE, Vector, YAW};
use crate::frame::ScannerPose;
use crate::pose::gaussian::Gaussian;
use crate::record::{Face, ReflectorLines, Status};
use nalgebra::{SMatrix, SVector};

/// Standard deviation of a bias that was not estimated and is held at zero, m.
const HELD_BIAS_M: f64 = 1e-6;

/// The seven line parameters of a scan, whitened: independent measurements of unit variance.
#[derive(Clone, Copy, Debug)]
pub(in crate::pose) struct WhiteLines {
    /// Inverse of the covariance's Cholesky factor.
    pub(in crate::pose) whitener: SMatrix<f64, 7, 7>,
    pub(in crate::pose) known: [bool; 7],
}

impl WhiteLines {
    /// None where the covariance is none.
    pub(in crate::pose) fn new(lines: &ReflectorLines) -> Option<WhiteLines> {
        let joint = lines.joint_cov.len() == 28;
        let mut known = [false, false, false, false, false, false, true];
        let mut covariance = SMatrix::<f64, 7, 7>::identity();
        for (k, line) in lines.lines().into_iter().enumerate() {
            if !line.is_seen() {
                continue;
            }
            known[2 * k] = true;
            known[2 * k + 1] = true;
            if !joint {
                covariance[(2 * k, 2 * k)] = line.cov_dd;
                covariance[(2 * k, 2 * k + 1)] = line.cov_da;
                covariance[(2 * k + 1, 2 * k)] = line.cov_da;
                covariance[(2 * k + 1, 2 * k + 1)] = line.cov_aa;
            }
        }
        if joint {
            for i in (0..7).filter(|i| known[*i]) {
                for j in (0..7).filter(|j| known[*j]) {
                    covariance[(i, j)] = lines.joint(i, j);
                }
            }
        } else {
            covariance[(6, 6)] = HELD_BIAS_M * HELD_BIAS_M;
        }
        let factor = covariance.cholesky()?.unpack();
        let whitener = factor.solve_lower_triangular(&SMatrix::identity())?;
        let whitener = whitener.iter().all(|v| v.is_finite()).then_some(whitener)?;
        Some(WhiteLines { whitener, known })
    }

    /// Rows and residuals (measured less predicted) at a state, of unit variance.
    pub(in crate::pose) fn equations(
        &self,
        lines: &ReflectorLines,
        pose: &ScannerPose,
        at: &Vector,
    ) -> (SMatrix<f64, 7, STATE>, SVector<f64, 7>) {
        let mut rows = SMatrix::<f64, 7, STATE>::zeros();
        let mut residuals = SVector::<f64, 7>::zeros();
        for (k, (line, face)) in lines.lines().into_iter().zip(Face::ALL).enumerate() {
            if !self.known[2 * k] {
                continue;
            }
            let predicted = pose.line(face);
            residuals[2 * k] = line.normal.d_m - predicted.normal.d_m;
            residuals[2 * k + 1] = line.normal.alpha_rad - predicted.normal.alpha_rad;
            for j in 0..6 {
                rows[(2 * k, j)] = predicted.d_d[j];
                rows[(2 * k + 1, j)] = predicted.d_alpha[j];
            }
        }
        // Lines from elsewhere: the bias was not estimated, and is held at zero.
        let joint = lines.joint_cov.len() == 28;
        let bias_m = if joint { lines.range_bias_m } else { 0.0 };
        residuals[6] = bias_m - at[BIAS];
        rows[(6, BIAS)] = 1.0;
        (self.whitener * rows, self.whitener * residuals)
    }

    /// Puts the lines, linearised at `at`, into `state`. Where the sign of the yaw is not known, the
    /// lines must not tell it: the walls' distance grows with |yaw|.
    pub(super) fn observe(
        &self,
        lines: &ReflectorLines,
        pose: &ScannerPose,
        at: &Vector,
        knows_yaw: bool,
        state: &mut Gaussian<STATE>,
    ) {
        let (mut rows, residuals) = self.equations(lines, pose, at);
        if !knows_yaw {
            rows.fill_column(YAW, 0.0);
        }
        for (k, residual) in residuals.iter().enumerate() {
            if self.known[k] {
                let row = rows.row(k).transpose();
                state.observe(&row, residual + row.dot(at), 1.0);
            }
        }
    }

    /// The lines, linearised at a state, as independent measurements.
    pub(super) fn factors(
        &self,
        lines: &ReflectorLines,
        pose: &ScannerPose,
        at: &Vector,
    ) -> impl Iterator<Item = PointFactor> {
        let (rows, residuals) = self.equations(lines, pose, at);
        let at = *at;
        let known = self.known;
        (0..7).filter(move |k| known[*k]).map(move |k| {
            let row = rows.row(k).transpose();
            PointFactor {
                value: residuals[k] + row.dot(&at),
                row,
                variance: 1.0,
            }
        })
    }

    /// Squared misfit of the lines at a state in the metric of their covariance.
    pub(super) fn misfit(&self, lines: &ReflectorLines, pose: &ScannerPose, at: &Vector) -> f64 {
        self.equations(lines, pose, at).1.norm_squared()
    }
}

/// Remarks on lines that were not seen.
pub(super) fn seen_status(lines: &ReflectorLines) -> Status {
    let mut status = Status::OK;
    if !lines.upper.is_seen() {
        status |= Status::NO_UPPER;
    }
    status
        | match (lines.right.is_seen(), lines.left.is_seen()) {
            (true, true) => Status::OK,
            (false, false) => Status::NO_WALLS,
            _ => Status::ONE_WALL,
        }
}

/// A first linearisation point: y, z, roll and bias of a level platform from the lines alone, the
/// rest as the prior has it.
pub(super) fn start(
    lines: &ReflectorLines,
    bounds: &crate::frame::FrameBox,
    prior: &Vector,
) -> Vector {
    let half_m = bounds.dy_m / 2.0;
    let y = match (lines.right.is_seen(), lines.left.is_seen()) {
        (true, true) => 0.5 * (lines.left.normal.d_m - lines.right.normal.d_m),
        (true, false) => half_m - lines.right.normal.d_m,
        _ => lines.left.normal.d_m - half_m,
    };
    let mut state = *prior;
    state[super::Y] = y;
    state[super::Z] = bounds.dz_m - lines.upper.normal.d_m;
    state[super::ROLL] = std::f64::consts::FRAC_PI_2 - lines.upper.normal.alpha_rad;
    state[BIAS] = if lines.range_bias_m.is_finite() {
        lines.range_bias_m
    } else {
        0.0
    };
    state
}
