//! The three reflector lines of the frame, fitted jointly with the range bias.
//!
//! Every beam on a reflector has the range `d / cos(delta - alpha) + bias`; the seven parameters (d
//! and alpha of right, upper and left line, and the bias common to all beams) are fitted to the
//! ranges themselves, which is the maximum likelihood fit for range noise. The frame's width is not
//! used in the fit: the pose solver puts it in, together with yaw, and loses nothing, because the
//! joint covariance travels with the lines.
//!
//! A first scan is found without a prediction: the scan is turned step by step, and at the right
//! roll the points pile up on the two walls a frame's width apart and on the ceiling. The surface
//! behind the ceiling returns more beams than the strips do, so the strip plane is where points
//! pile up in that plane *and* one background gap behind it. Later scans start from the one before.

pub(super) mod cold_start;

use crate::frame::Frame;
use crate::record::{
    BeamTable, FittedLine, NormalLine, ReflectorLines, Scan, ScanMotion, upper_index,
};
use cold_start::ColdStart;
use nalgebra::{SMatrix, SVector};
use std::f64::consts::{FRAC_PI_2, PI};
use std::ops::Range;

/// How the lines are fitted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Standard deviation of one range, m; none: taken from the residuals of each scan.
    pub sigma_m: Option<f64>,
    /// Prior standard deviation of the range bias, m.
    pub bias_sigma_m: f64,
    /// Fewest beams that make a line.
    pub min_points: u32,
    /// Whether the scan before is used as a prediction.
    pub track: bool,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            sigma_m: None,
            bias_sigma_m: 0.015,
            min_points: 8,
            track: true,
        }
    }
}

/// Gates around a coarse prediction, then none: the fit's own, m.
const COLD_GATES_M: [f64; 8] = [0.20, 0.20, 0.15, 0.15, 0.10, 0.10, 0.06, 0.04];
const TRACK_GATES_M: [f64; 2] = [0.08, 0.04];
/// Passes with the final gate and Huber weights.
const FINAL_PASSES: usize = 3;
/// Residuals beyond this many sigma are weighted down, and beyond four left out.
const HUBER: f64 = 2.5;
/// Sigma is never taken smaller than this (quantisation of the ranges), m.
const SIGMA_FLOOR_M: f64 = 0.0005;
/// Sigma before residuals are known, m.
const SIGMA_START_M: f64 = 0.0065;

/// Number of fitted parameters: d and alpha of three lines, and the bias.
const N: usize = 7;

/// Fits the three lines, scan after scan.
#[derive(Clone, Debug)]
pub struct ReflectorFit {
    options: Options,
    dy_m: f64,
    gap_m: Option<f64>,
    range_bias_m: f64,
    range_scale: f64,
    beams: BeamTable,
    ranges_m: Vec<f64>,
    cold: ColdStart,
    previous: Option<Previous>,
}

/// The scan before, as a prediction.
#[derive(Clone, Copy, Debug)]
struct Previous {
    lines: [NormalLine; 3],
    bias_m: f64,
    sigma_m: f64,
    points: [u32; 3],
}

/// The result of a fit.
#[derive(Clone, Copy, Debug)]
pub struct JointLines {
    /// Right, upper, left line; where one was not seen, where it would be.
    pub lines: [NormalLine; 3],
    /// Range bias common to all beams, m.
    pub bias_m: f64,
    /// Covariance in the order of [`crate::record::LINE_STATE`].
    pub covariance: SMatrix<f64, N, N>,
    /// Beams on each line.
    pub points: [u32; 3],
    /// Root mean square of each line's range residuals, m.
    pub rms_m: [f64; 3],
    /// Standard deviation of one range, given or from the residuals, m.
    pub sigma_m: f64,
}

impl JointLines {
    /// Which of right, upper, left was seen.
    pub fn seen(&self, options: &Options) -> [bool; 3] {
        self.points.map(|points| points >= options.min_points)
    }
}

impl ReflectorFit {
    /// A fit for scans taken in `frame`.
    pub fn new(frame: &Frame, options: Options) -> ReflectorFit {
        ReflectorFit {
            options,
            dy_m: frame.bounds.dy_m,
            gap_m: frame.bounds.background_gap_m,
            range_bias_m: frame.calibration.range_bias_m,
            range_scale: frame.calibration.range_scale,
            beams: BeamTable::default(),
            ranges_m: Vec::new(),
            cold: ColdStart::default(),
            previous: None,
        }
    }

    /// The options it was made with.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// Forgets the scan before.
    pub fn reset(&mut self) {
        self.previous = None;
    }

    /// Fits the three lines to a scan taken at rest; none where no reflector is to be found.
    pub fn fit(&mut self, scan: &Scan) -> Option<JointLines> {
        self.fit_moving(scan, ScanMotion::REST)
    }

    /// Fits the three lines of the reference instant to a scan taken in a known motion.
    pub fn fit_moving(&mut self, scan: &Scan, motion: ScanMotion) -> Option<JointLines> {
        if scan.beams() < 2 || !(scan.angle_increment_rad > 0.0) || !scan.angle_min_rad.is_finite()
        {
            return None;
        }
        self.beams.fit_moving(scan, motion);
        self.ranges_m.clear();
        let (bias_m, scale) = (self.range_bias_m, 1.0 / self.range_scale);
        self.ranges_m
            .extend(scan.ranges_m.iter().map(|r| (r - bias_m) * scale));
        let tracked = self
            .previous
            .filter(|_| self.options.track)
            .and_then(|previous| {
                let start = Start {
                    lines: previous.lines,
                    bias_m: previous.bias_m,
                    sigma_m: previous.sigma_m,
                };
                let fit = self.refine(start, &TRACK_GATES_M)?;
                self.is_plausible(&fit, Some(&previous)).then_some(fit)
            });
        let fit = tracked.or_else(|| {
            let lines = self
                .cold
                .find(&self.beams, &self.ranges_m, self.dy_m, self.gap_m)?;
            let sigma_m = self.options.sigma_m.unwrap_or(SIGMA_START_M);
            let fit = self.refine(
                Start {
                    lines,
                    bias_m: 0.0,
                    sigma_m,
                },
                &COLD_GATES_M,
            )?;
            self.is_plausible(&fit, None).then_some(fit)
        });
        let fit = fit.map(|fit| self.with_hidden_wall(fit));
        self.previous = fit.as_ref().map(|fit| Previous {
            lines: fit.lines,
            bias_m: fit.bias_m,
            sigma_m: fit.sigma_m,
            points: fit.points,
        });
        fit
    }

    /// Puts a wall that was not seen where the other one says it is.
    fn with_hidden_wall(&self, mut fit: JointLines) -> JointLines {
        let [right, _, left] = fit.seen(&self.options);
        let opposite = |wall: NormalLine, turn: f64| {
            NormalLine::new((self.dy_m - wall.d_m).max(0.05), wall.alpha_rad + turn)
        };
        if right && !left {
            fit.lines[2] = opposite(fit.lines[0], PI);
        } else if left && !right {
            fit.lines[0] = opposite(fit.lines[2], -PI);
        }
        fit
    }

    /// Gauss-Newton with shrinking gates, then with the fit's own gate and Huber weights.
    fn refine(&self, start: Start, gates_m: &[f64]) -> Option<JointLines> {
        let Start {
            mut lines,
            mut bias_m,
            mut sigma_m,
        } = start;
        let mut sums = [LineSums::default(); 3];
        let mut covariance = SMatrix::<f64, N, N>::zeros();
        for pass in 0..gates_m.len() + FINAL_PASSES {
            let coarse = gates_m.get(pass).copied();
            let gate_m = coarse.unwrap_or_else(|| (4.0 * sigma_m).max(0.012));
            let huber_m = if coarse.is_some() {
                f64::INFINITY
            } else {
                HUBER * sigma_m
            };
            let sectors = sectors(&lines, &self.beams);
            for k in 0..3 {
                let s = sectors[k].clone();
                sums[k] = LineSums::over(
                    &lines[k],
                    bias_m,
                    &self.beams,
                    &self.ranges_m,
                    s,
                    [gate_m, huber_m],
                );
            }
            let (step, cov) = self.solve(&sums, bias_m, sigma_m)?;
            covariance = cov;
            for k in 0..3 {
                // Steps are bounded: a wild first gate must not turn a line over.
                let d_m = lines[k].d_m + step[2 * k].clamp(-0.3, 0.3);
                let alpha_rad = lines[k].alpha_rad + step[2 * k + 1].clamp(-0.05, 0.05);
                lines[k] = NormalLine::new(d_m, alpha_rad);
            }
            bias_m = (bias_m + step[6]).clamp(-0.2, 0.2);
            if coarse.is_none() || pass + 1 == gates_m.len() {
                sigma_m = self
                    .options
                    .sigma_m
                    .unwrap_or_else(|| residual_sigma(&sums));
            }
        }
        let points = [0, 1, 2].map(|k| sums[k].points);
        if points
            .iter()
            .all(|points| *points < self.options.min_points)
        {
            return None;
        }
        let rms_m = [0, 1, 2].map(|k| sums[k].rms_m());
        Some(JointLines {
            lines,
            bias_m,
            covariance,
            points,
            rms_m,
            sigma_m,
        })
    }

    /// One Gauss-Newton step and the inverse information.
    fn solve(
        &self,
        sums: &[LineSums; 3],
        bias_m: f64,
        sigma_m: f64,
    ) -> Option<(SVector<f64, N>, SMatrix<f64, N, N>)> {
        let mut information = SMatrix::<f64, N, N>::zeros();
        let mut gradient = SVector::<f64, N>::zeros();
        let weight = 1.0 / (sigma_m * sigma_m);
        for (k, s) in sums.iter().enumerate() {
            let (d, a) = (2 * k, 2 * k + 1);
            if s.points < self.options.min_points {
                // Not seen: held where it is by a weak prior, which never reaches the stream.
                information[(d, d)] = 1.0;
                information[(a, a)] = 1.0;
                continue;
            }
            information[(d, d)] = s.dd * weight;
            information[(d, a)] = s.da * weight;
            information[(a, d)] = s.da * weight;
            information[(a, a)] = s.aa * weight;
            information[(d, 6)] = s.d1 * weight;
            information[(6, d)] = s.d1 * weight;
            information[(a, 6)] = s.a1 * weight;
            information[(6, a)] = s.a1 * weight;
            information[(6, 6)] += s.w * weight;
            gradient[d] = s.de * weight;
            gradient[a] = s.ae * weight;
            gradient[6] += s.we * weight;
        }
        let prior = 1.0 / (self.options.bias_sigma_m * self.options.bias_sigma_m);
        information[(6, 6)] += prior;
        gradient[6] -= prior * bias_m;
        let covariance = information.cholesky()?.inverse();
        Some((covariance * gradient, covariance))
    }

    /// Whether the lines can be this frame's: right angles between them, the walls a width apart,
    /// nothing like a second ceiling in front, and about as many beams as before.
    fn is_plausible(&self, fit: &JointLines, previous: Option<&Previous>) -> bool {
        let seen = fit.seen(&self.options);
        let [right, upper, left] = fit.lines;
        // A tracked fit that is refused costs a cold start and no more, so it is judged sharply;
        // lines leave the right angle only by yaw times pitch.
        let (skew_rad, bias_sigmas) = if previous.is_some() {
            (0.012, 3.5)
        } else {
            (0.05, 6.0)
        };
        let off = |angle: f64, nominal: f64| (angle - nominal).abs() > skew_rad;
        if fit.bias_m.abs() > bias_sigmas * self.options.bias_sigma_m {
            return false;
        }
        if seen[0] && seen[1] && off(upper.alpha_rad - right.alpha_rad, FRAC_PI_2)
            || seen[1] && seen[2] && off(left.alpha_rad - upper.alpha_rad, FRAC_PI_2)
            || seen[0] && seen[2] && (right.d_m + left.d_m - self.dy_m).abs() > 0.15
        {
            return false;
        }
        if (fit.lines.iter().zip(seen)).any(|(line, seen)| seen && !(line.d_m > 0.05)) {
            return false;
        }
        let Some(previous) = previous else {
            return true;
        };
        let kept = |k: usize| f64::from(fit.points[k]) >= 0.6 * f64::from(previous.points[k]);
        if !(kept(0) && kept(1) && kept(2)) {
            return false;
        }
        // A line that was drawn through half of a reflector's points has the other half beside it.
        let beside = |k: usize| self.count_near(fit, k, 0.0, 0.15) * 4 > fit.points[k] as usize * 5;
        if beside(0) || beside(1) || beside(2) {
            return false;
        }
        // Tracking may have slipped onto the surface behind the strips: then the strips themselves
        // stand one gap in front of the line.
        let Some(gap_m) = self.gap_m else { return true };
        let in_front = self.count_near(fit, 1, -gap_m, 0.06);
        in_front * 5 < fit.points[1].max(1) as usize
    }

    /// Beams of a sector within `reach_m` of the line moved outward by `offset_m`.
    fn count_near(&self, fit: &JointLines, k: usize, offset_m: f64, reach_m: f64) -> usize {
        let line = fit.lines[k];
        let (sin, cos) = line.alpha_rad.sin_cos();
        let sector = sectors(&fit.lines, &self.beams)[k].clone();
        sector
            .filter(|i| {
                let ((c, s), (y_m, z_m)) = (self.beams.cos_sin[*i], self.beams.origin_m(*i));
                let range_m = self.ranges_m[*i] - fit.bias_m;
                let along_m = range_m * (c * cos + s * sin) + (y_m * cos + z_m * sin);
                (along_m - line.d_m - offset_m).abs() < reach_m
            })
            .count()
    }

    /// Writes a fit into a lines record.
    pub fn record(&self, fit: &JointLines, out: &mut ReflectorLines) {
        let seen = fit.seen(&self.options);
        let at = |row: usize, col: usize| {
            let (i, j) = (row / 2, col / 2);
            if (i < 3 && !seen[i]) || (j < 3 && !seen[j]) {
                f64::NAN
            } else {
                fit.covariance[(row, col)]
            }
        };
        let line = |k: usize| {
            if !seen[k] {
                return FittedLine::default();
            }
            FittedLine {
                normal: fit.lines[k],
                cov_dd: at(2 * k, 2 * k),
                cov_da: at(2 * k, 2 * k + 1),
                cov_aa: at(2 * k + 1, 2 * k + 1),
                points: fit.points[k],
                rms_m: fit.rms_m[k],
            }
        };
        out.right = line(0);
        out.upper = line(1);
        out.left = line(2);
        out.range_bias_m = fit.bias_m;
        out.set_motion(self.beams.motion());
        out.joint_cov.clear();
        out.joint_cov.resize(N * (N + 1) / 2, 0.0);
        for row in 0..N {
            for col in row..N {
                out.joint_cov[upper_index(N, row, col)] = at(row, col);
            }
        }
    }
}

/// Where a refinement starts.
#[derive(Clone, Copy, Debug)]
struct Start {
    lines: [NormalLine; 3],
    bias_m: f64,
    sigma_m: f64,
}

/// Weighted sums of one line's normal equations: Jacobian entries d, a, 1 and residual e.
#[derive(Clone, Copy, Debug, Default)]
struct LineSums {
    dd: f64,
    da: f64,
    aa: f64,
    d1: f64,
    a1: f64,
    w: f64,
    de: f64,
    ae: f64,
    we: f64,
    ee: f64,
    points: u32,
}

impl LineSums {
    /// Sums over the beams within the gate. No return (infinite or NaN) is never within it.
    fn over(
        line: &NormalLine,
        bias_m: f64,
        beams: &BeamTable,
        ranges_m: &[f64],
        sector: Range<usize>,
        [gate_m, huber_m]: [f64; 2],
    ) -> LineSums {
        let (sin_alpha, cos_alpha) = line.alpha_rad.sin_cos();
        let mut s = LineSums::default();
        let first = sector.start;
        let rays = beams.cos_sin[sector.clone()].iter().zip(&ranges_m[sector]);
        for (i, ((cos, sin), range_m)) in rays.enumerate() {
            // phi = delta - alpha; range = (d - origin along the normal) / cos(phi).
            let (y_m, z_m) = beams.origin_m(first + i);
            let cos_phi = cos * cos_alpha + sin * sin_alpha;
            let inverse = 1.0 / cos_phi;
            let predicted_m = (line.d_m - (y_m * cos_alpha + z_m * sin_alpha)) * inverse;
            let e = range_m - bias_m - predicted_m;
            let magnitude = e.abs();
            if !(magnitude < gate_m) {
                continue;
            }
            let sin_phi = sin * cos_alpha - cos * sin_alpha;
            let w = if magnitude > huber_m {
                huber_m / magnitude
            } else {
                1.0
            };
            let d = inverse;
            let a = -(predicted_m * sin_phi + (z_m * cos_alpha - y_m * sin_alpha)) * inverse;
            let (wd, wa) = (w * d, w * a);
            s.dd += wd * d;
            s.da += wd * a;
            s.aa += wa * a;
            s.d1 += wd;
            s.a1 += wa;
            s.w += w;
            s.de += wd * e;
            s.ae += wa * e;
            s.we += w * e;
            s.ee += w * e * e;
            s.points += 1;
        }
        s
    }

    fn rms_m(&self) -> f64 {
        if self.w > 0.0 {
            (self.ee / self.w).sqrt()
        } else {
            f64::NAN
        }
    }
}

/// Standard deviation of one range from the residuals of all lines.
fn residual_sigma(sums: &[LineSums; 3]) -> f64 {
    let (ee, w) = sums
        .iter()
        .fold((0.0, 0.0), |(ee, w), s| (ee + s.ee, w + s.w));
    let freedom = w - N as f64;
    if freedom > 10.0 {
        // Down-weighting takes a few per cent off the spread of Gaussian residuals.
        ((ee / freedom).sqrt() * 1.008).clamp(SIGMA_FLOOR_M, 0.05)
    } else {
        SIGMA_START_M
    }
}

/// Beam indices of right, upper and left line, bounded by the corners where two lines meet, less
/// one beam on each side (its spot covers both).
fn sectors(lines: &[NormalLine; 3], beams: &BeamTable) -> [Range<usize>; 3] {
    let margin = beams.increment_rad();
    let beam_at = |(angle_rad, distance_m)| beams.angle_towards(angle_rad, distance_m);
    let first = beam_at(corner(&lines[0], &lines[1]));
    let second = beam_at(corner(&lines[1], &lines[2]));
    [
        beams.index_range(-FRAC_PI_2, first - margin),
        beams.index_range(first + margin, second - margin),
        beams.index_range(second + margin, 3.0 * FRAC_PI_2),
    ]
}

/// Where two lines meet: direction, rad, in (-pi/2, 3 pi/2], and distance, m.
fn corner(a: &NormalLine, b: &NormalLine) -> (f64, f64) {
    let ((sa, ca), (sb, cb)) = (a.alpha_rad.sin_cos(), b.alpha_rad.sin_cos());
    let y = a.d_m * sb - b.d_m * sa;
    let z = b.d_m * ca - a.d_m * cb;
    // For normals a quarter turn apart the determinant is positive.
    let determinant = ca * sb - sa * cb;
    let angle = z.atan2(y);
    let angle = if angle <= -FRAC_PI_2 {
        angle + 2.0 * PI
    } else {
        angle
    };
    (angle, y.hypot(z) / determinant.abs().max(1e-9))
}

#[cfg(test)]
mod tests;
