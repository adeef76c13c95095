//! The normal equations of one line in one pass over its beams, and their joint solution with the
//! range bias.
//!
//! One division a beam and one branch that is seldom mispredicted: 2 to 3 us for 761 beams. Passes
//! without branches, for vector registers, were tried and took half as long again.

use crate::record::{NormalLine, ScanMotion};
use nalgebra::SMatrix;

/// Number of fitted parameters: d and alpha of three lines, and the bias.
pub(super) const N: usize = 7;

/// Tukey's biweight vanishes at this many sigma. On normal errors an estimate scatters by 1.4 %
/// more than least squares; small outliers (bolt heads, cables, dirt) lose most of their weight.
pub(super) const TUKEY: f64 = 5.5;
/// Mean of w u^2 over mean of w for standard normal u: what weighting takes off the spread.
pub(super) const WEIGHTED_SQUARE: f64 = 0.872_896;
/// Covariance of the estimate over the inverse of the weighted information:
/// E\[psi^2\] E\[w\] / E\[psi'\]^2 with psi = w u.
const COVARIANCE_FACTOR: f64 = 0.962_955;

/// The rays of one sector with the ranges along them.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sector<'a> {
    /// Cosine and sine of each beam's direction.
    pub rays: &'a [(f64, f64)],
    /// The range along each, m.
    pub ranges_m: &'a [f64],
    /// When the first one fires, s after the reference instant.
    pub first_s: f64,
    /// From beam to beam, s.
    pub step_s: f64,
}

/// Which beams count, and how much.
#[derive(Clone, Copy, Debug)]
pub(super) struct Weighting {
    /// Residuals beyond this do not, m.
    pub gate_m: f64,
    /// Where Tukey's biweight vanishes, m; of the last passes only, before them all beams within
    /// the gate count alike.
    pub tukey_m: f64,
    /// How far behind the line the next surface is, m; infinite where there is none.
    pub gap_m: f64,
}

/// A surface half as far beside a line is counted by `beside`, m.
const BESIDE_M: f64 = 0.15;
/// And one gap in front of it by `in_front`, m.
const IN_FRONT_M: f64 = 0.06;

/// Weighted sums of one line's normal equations: Jacobian entries d, a, 1 and residual e.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct LineSums {
    pub dd: f64,
    pub da: f64,
    pub aa: f64,
    pub d1: f64,
    pub a1: f64,
    pub w: f64,
    pub de: f64,
    pub ae: f64,
    pub we: f64,
    pub ee: f64,
    /// Beams within the gate.
    pub points: f64,
    /// Beams within 15 cm of the line (last pass only).
    pub beside: f64,
    /// Beams within 6 cm of a line one background gap in front (last pass only).
    pub in_front: f64,
    /// Products of d, a, 1 with the change of the range by a velocity along the normal, and by a
    /// roll rate (last pass only).
    pub motion: [f64; 6],
}

impl LineSums {
    /// Sums over the beams of a sector for a line of the reference instant. `LAST` adds what is
    /// wanted of the last pass only.
    pub(super) fn over<const LAST: bool>(
        line: &NormalLine,
        bias_m: f64,
        motion: ScanMotion,
        sector: Sector<'_>,
        weighting: Weighting,
    ) -> LineSums {
        let (sin_alpha, cos_alpha) = line.alpha_rad.sin_cos();
        let d_m = line.d_m;
        // Velocity along the line's normal and along the line.
        let normal_m_s = motion.vy_m_s * cos_alpha + motion.vz_m_s * sin_alpha;
        let along_m_s = motion.vz_m_s * cos_alpha - motion.vy_m_s * sin_alpha;
        let Weighting {
            gate_m,
            tukey_m,
            gap_m,
        } = weighting;
        let flatness = 1.0 / (tukey_m * tukey_m);
        let mut s = LineSums::default();
        let [mut points, mut beside, mut in_front] = [0u32; 3];
        let rays = sector.rays.iter().zip(sector.ranges_m);
        for (k, ((cos, sin), range_m)) in (0i32..).zip(rays) {
            let tau_s = sector.first_s + f64::from(k) * sector.step_s;
            // phi = delta - alpha; range = (d - origin along the normal) / cos(phi).
            let cos_phi = cos * cos_alpha + sin * sin_alpha;
            let inverse = 1.0 / cos_phi;
            let predicted_m = (d_m - normal_m_s * tau_s) * inverse;
            let e = range_m - bias_m - predicted_m;
            if LAST {
                let across_m = e * cos_phi;
                beside += u32::from(across_m.abs() < BESIDE_M);
                in_front += u32::from((across_m + gap_m).abs() < IN_FRONT_M);
            }
            // No return (infinite or NaN) is never within the gate.
            if !(e.abs() < gate_m) {
                continue;
            }
            let sin_phi = sin * cos_alpha - cos * sin_alpha;
            let a = -(predicted_m * sin_phi + along_m_s * tau_s) * inverse;
            // Before the last passes all beams within the gate count alike.
            let w = if LAST {
                let taper = 1.0 - e * e * flatness;
                taper * taper
            } else {
                1.0
            };
            let (wd, wa, we) = (w * inverse, w * a, w * e);
            s.dd += wd * inverse;
            s.da += wd * a;
            s.aa += wa * a;
            s.d1 += wd;
            s.a1 += wa;
            s.w += w;
            s.de += wd * e;
            s.ae += wa * e;
            s.we += we;
            s.ee += we * e;
            points += 1;
            if LAST {
                // The range changes by -1 / cos(phi) with a velocity along the normal, times the
                // time, and by -a with a roll rate.
                let (v, roll) = (wd * tau_s, wa * tau_s);
                s.motion[0] -= v * inverse;
                s.motion[1] -= v * a;
                s.motion[2] -= v;
                s.motion[4] -= roll * a;
                s.motion[5] -= roll;
            }
        }
        // Of d with the roll rate as much as of a with the velocity.
        s.motion[3] = s.motion[1];
        s.points = f64::from(points);
        s.beside = f64::from(beside);
        s.in_front = f64::from(in_front);
        s
    }

    /// Root mean square of the residuals, as it would be without the weights, m.
    pub(super) fn rms_m(&self) -> f64 {
        if self.w > 0.0 {
            (self.ee / self.w / WEIGHTED_SQUARE).sqrt()
        } else {
            f64::NAN
        }
    }
}

/// The joint solution of three lines and the bias. The information is three blocks of two by two
/// with one common border, so it is inverted block by block.
#[derive(Clone, Copy, Debug)]
pub(super) struct Solution {
    /// The Gauss-Newton step in the order of [`crate::record::LINE_STATE`].
    pub step: [f64; N],
    /// Its squared length in units of the estimate's own uncertainty.
    pub length2: f64,
    /// Inverse of each line's own block (dd, da, aa); none for a line that was not seen.
    blocks: [Option<[f64; 3]>; 3],
    /// Change of each line's d and alpha with the bias.
    by_bias: [[f64; 2]; 3],
    bias_variance: f64,
    variance: f64,
}

/// Squared sine of the angle between d and alpha below which a line's beams tell only one of them.
const DEGENERATE: f64 = 1e-13;

impl Solution {
    /// Solves for a step. `sigma_m` is the standard deviation of a range; lines with fewer than
    /// `min_points` beams are held.
    pub(super) fn new(
        sums: &[LineSums; 3],
        bias_m: f64,
        sigma_m: f64,
        bias_sigma_m: f64,
        min_points: u32,
    ) -> Option<Solution> {
        let variance = sigma_m * sigma_m;
        let prior = variance / (bias_sigma_m * bias_sigma_m);
        let mut blocks = [None; 3];
        let mut by_bias = [[0.0; 2]; 3];
        let mut own = [[0.0; 2]; 3];
        let (mut information, mut gradient) = (prior, -prior * bias_m);
        for (k, s) in sums.iter().enumerate() {
            if s.points < f64::from(min_points) {
                continue;
            }
            let determinant = s.dd * s.aa - s.da * s.da;
            if !(determinant > DEGENERATE * s.dd * s.aa) {
                return None;
            }
            let [dd, da, aa] = [s.aa, -s.da, s.dd].map(|m| m / determinant);
            blocks[k] = Some([dd, da, aa]);
            own[k] = [dd * s.de + da * s.ae, da * s.de + aa * s.ae];
            by_bias[k] = [-(dd * s.d1 + da * s.a1), -(da * s.d1 + aa * s.a1)];
            information += s.w + by_bias[k][0] * s.d1 + by_bias[k][1] * s.a1;
            gradient += s.we + by_bias[k][0] * s.de + by_bias[k][1] * s.ae;
        }
        if !(information > 0.0 && information.is_finite()) {
            return None;
        }
        let bias = gradient / information;
        let mut step = [0.0; N];
        step[6] = bias;
        let mut length2 = (-prior * bias_m) * bias;
        for (k, s) in sums.iter().enumerate() {
            if blocks[k].is_some() {
                step[2 * k] = own[k][0] + by_bias[k][0] * bias;
                step[2 * k + 1] = own[k][1] + by_bias[k][1] * bias;
                length2 += step[2 * k] * s.de + step[2 * k + 1] * s.ae + bias * s.we;
            }
        }
        Some(Solution {
            step,
            length2: length2 / variance,
            blocks,
            by_bias,
            bias_variance: 1.0 / information,
            variance,
        })
    }

    /// Covariance of the parameters. A line that was not seen has a unit block, which never
    /// reaches the stream.
    pub(super) fn covariance(&self) -> SMatrix<f64, N, N> {
        let by_bias = |i: usize| match i {
            6 => 1.0,
            _ => self.by_bias[i / 2][i % 2],
        };
        let mut covariance =
            SMatrix::<f64, N, N>::from_fn(|i, j| by_bias(i) * by_bias(j) * self.bias_variance);
        for (k, block) in self.blocks.iter().enumerate() {
            let (d, a) = (2 * k, 2 * k + 1);
            match block {
                Some([dd, da, aa]) => {
                    covariance[(d, d)] += dd;
                    covariance[(d, a)] += da;
                    covariance[(a, d)] += da;
                    covariance[(a, a)] += aa;
                }
                None => {
                    let unit = 1.0 / (self.variance * COVARIANCE_FACTOR);
                    covariance[(d, d)] = unit;
                    covariance[(a, a)] = unit;
                }
            }
        }
        covariance * (self.variance * COVARIANCE_FACTOR)
    }

    /// Change of the parameters with the motion that is taken out of the scan: velocity along y
    /// and z (per m/s), roll rate (per rad/s).
    pub(super) fn sensitivity(
        &self,
        sums: &[LineSums; 3],
        lines: &[NormalLine; 3],
    ) -> SMatrix<f64, N, 3> {
        let mut own = SMatrix::<f64, N, 3>::zeros();
        let mut border = [0.0; 3];
        for (k, s) in sums.iter().enumerate() {
            let Some([dd, da, aa]) = self.blocks[k] else {
                continue;
            };
            let (sin, cos) = lines[k].alpha_rad.sin_cos();
            // A velocity counts by its part along the normal.
            let [dv, av, v, dr, ar, r] = s.motion;
            for (m, (d, a, one)) in [
                (dv * cos, av * cos, v * cos),
                (dv * sin, av * sin, v * sin),
                (dr, ar, r),
            ]
            .into_iter()
            .enumerate()
            {
                own[(2 * k, m)] = -(dd * d + da * a);
                own[(2 * k + 1, m)] = -(da * d + aa * a);
                border[m] -= one + self.by_bias[k][0] * d + self.by_bias[k][1] * a;
            }
        }
        for m in 0..3 {
            let bias = border[m] * self.bias_variance;
            own[(6, m)] = bias;
            for k in 0..3 {
                own[(2 * k, m)] += self.by_bias[k][0] * bias;
                own[(2 * k + 1, m)] += self.by_bias[k][1] * bias;
            }
        }
        own
    }
}
