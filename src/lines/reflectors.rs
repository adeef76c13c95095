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
mod sums;

use crate::frame::Frame;
use crate::record::{
    BeamTable, FittedLine, NormalLine, ReflectorLines, Scan, ScanMotion, Stamp, upper_index,
};
use cold_start::ColdStart;
use nalgebra::{SMatrix, SVector};
use std::f64::consts::{FRAC_PI_2, PI};
use std::ops::Range;
use sums::{LineSums, N, Sector, Solution, TUKEY, WEIGHTED_SQUARE, Weighting};

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
const TRACK_GATES_M: [f64; 1] = [0.08];
/// So many sigma wide a coarse gate of a cold start is taken to be.
const GATE_SIGMAS: f64 = 3.0;
/// A scan that is later than this is not where the motion of the one before leads, s.
const LONGEST_STEP_S: f64 = 0.2;
/// Passes with the fit's own weights: until one moves the estimate by less than this, squared and
/// in units of its own uncertainty (reweighting converges by a factor of ten a pass, so that a
/// twentieth of the uncertainty is left, which costs an eighth of a per cent of it) ...
const SMALL_STEP2: f64 = 0.25;
/// ... but as many at most.
const FINAL_PASSES: usize = 5;
/// Sigma is never taken smaller than this (quantisation of the ranges), m.
const SIGMA_FLOOR_M: f64 = 0.0005;
/// Nor larger, m.
const SIGMA_CEILING_M: f64 = 0.05;
/// Weights never vanish nearer than this, m.
const TUKEY_MIN_M: f64 = 0.012;
/// Sigma before residuals are known, m.
const SIGMA_START_M: f64 = 0.0065;

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
    stamp: Stamp,
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
    /// Change of the parameters with the motion taken out of the scan: a column each for the
    /// velocity along y and z (per m/s) and the roll rate (per rad/s).
    pub sensitivity: SMatrix<f64, N, 3>,
    /// Beams on each line.
    pub points: [u32; 3],
    /// Root mean square of each line's range residuals, m.
    pub rms_m: [f64; 3],
    /// Standard deviation of one range, given or from the residuals, m.
    pub sigma_m: f64,
    /// Beams beside each line, and one background gap in front of it.
    around: [[f64; 2]; 3],
}

impl Previous {
    /// Where the lines are when the next scan is taken, if the scanner moves as it does.
    fn moved(&self, stamp: Stamp, motion: ScanMotion) -> [NormalLine; 3] {
        let span_s = stamp.since_s(self.stamp);
        if motion.is_rest() || !(span_s > 0.0 && span_s < LONGEST_STEP_S) {
            return self.lines;
        }
        self.lines.map(|line| {
            let (sin, cos) = line.alpha_rad.sin_cos();
            let nearer_m = (motion.vy_m_s * cos + motion.vz_m_s * sin) * span_s;
            NormalLine::new(
                line.d_m - nearer_m,
                line.alpha_rad - motion.roll_rad_s * span_s,
            )
        })
    }
}

impl JointLines {
    /// Changes the parameters by a small step, and says how well they are known now.
    pub fn adjust(&mut self, step: &SVector<f64, N>, covariance: SMatrix<f64, N, N>) {
        for (k, line) in self.lines.iter_mut().enumerate() {
            if self.points[k] > 0 {
                *line = NormalLine::new(line.d_m + step[2 * k], line.alpha_rad + step[2 * k + 1]);
            }
        }
        self.bias_m += step[6];
        self.covariance = covariance;
    }

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
                    lines: previous.moved(scan.stamp, motion),
                    bias_m: previous.bias_m,
                    sigma_m: previous.sigma_m,
                };
                let fit = self.refine(start, &TRACK_GATES_M, false)?;
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
                true,
            )?;
            self.is_plausible(&fit, None).then_some(fit)
        });
        let fit = fit.map(|fit| self.with_hidden_wall(fit));
        self.previous = fit.as_ref().map(|fit| Previous {
            stamp: scan.stamp,
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

    /// Gauss-Newton with shrinking gates, then with the fit's own weights.
    fn refine(&self, start: Start, gates_m: &[f64], cold: bool) -> Option<JointLines> {
        let Start {
            mut lines,
            mut bias_m,
            mut sigma_m,
        } = start;
        let options = &self.options;
        let mut pass = 0;
        let (sums, solution, at) = loop {
            let coarse = gates_m.get(pass).copied();
            let tukey_m = (TUKEY * sigma_m).max(TUKEY_MIN_M);
            let weighting = Weighting {
                gate_m: coarse.unwrap_or(tukey_m),
                tukey_m,
                gap_m: self.gap_m.unwrap_or(f64::INFINITY),
            };
            let sectors = sectors(&lines, &self.beams)?;
            let motion = self.beams.motion();
            let mut sums = [LineSums::default(); 3];
            for ((sums, line), sector) in sums.iter_mut().zip(&lines).zip(sectors) {
                let sector = self.sector(sector);
                *sums = match coarse {
                    Some(_) => LineSums::over::<false>(line, bias_m, motion, sector, weighting),
                    None => LineSums::over::<true>(line, bias_m, motion, sector, weighting),
                };
            }
            // Within a coarse gate wild ranges weigh as much as right ones. They must not pass for
            // a bias, which has the lines run after it out of the gate.
            let noise_m = match coarse {
                Some(gate_m) if cold => sigma_m.max(gate_m / GATE_SIGMAS),
                _ => sigma_m,
            };
            let solution = Solution::new(
                &sums,
                bias_m,
                noise_m,
                options.bias_sigma_m,
                options.min_points,
            )?;
            let at = lines;
            for (k, line) in lines.iter_mut().enumerate() {
                // Steps are bounded: a wild first gate must not turn a line over.
                let d_m = line.d_m + solution.step[2 * k].clamp(-0.3, 0.3);
                let alpha_rad = line.alpha_rad + solution.step[2 * k + 1].clamp(-0.05, 0.05);
                *line = NormalLine::new(d_m, alpha_rad);
            }
            bias_m = (bias_m + solution.step[6]).clamp(-0.2, 0.2);
            pass += 1;
            let settled = coarse.is_none() && solution.length2 < SMALL_STEP2;
            if settled || pass == gates_m.len() + FINAL_PASSES {
                break (sums, solution, at);
            }
            // The scan before knows the noise better than residuals within a coarse gate do.
            if coarse.is_none() || (cold && pass == gates_m.len()) {
                sigma_m = options
                    .sigma_m
                    .unwrap_or_else(|| residual_sigma(&sums, coarse.is_none()));
            }
        };
        let points = sums.map(|s| s.points as u32);
        if points.iter().all(|points| *points < options.min_points) {
            return None;
        }
        Some(JointLines {
            lines,
            bias_m,
            covariance: solution.covariance(),
            sensitivity: solution.sensitivity(&sums, &at),
            points,
            rms_m: sums.map(|s| s.rms_m()),
            sigma_m: options
                .sigma_m
                .unwrap_or_else(|| residual_sigma(&sums, true)),
            around: sums.map(|s| [s.beside, s.in_front]),
        })
    }

    /// The rays and ranges of a run of beams.
    fn sector(&self, run: Range<usize>) -> Sector<'_> {
        let first_s = self.beams.time_s(run.start);
        Sector {
            rays: &self.beams.cos_sin[run.clone()],
            ranges_m: &self.ranges_m[run.clone()],
            first_s,
            step_s: self.beams.time_s(run.start + 1) - first_s,
        }
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
        let beside = |k: usize| fit.around[k][0] * 4.0 > f64::from(fit.points[k]) * 5.0;
        if beside(0) || beside(1) || beside(2) {
            return false;
        }
        // Tracking may have slipped onto the surface behind the strips: then the strips themselves
        // stand one gap in front of the line.
        fit.around[1][1] * 5.0 < f64::from(fit.points[1].max(1))
    }

    /// The scan as it would have been at rest, by the published correction of beam lengths
    /// (Kurniawan 2017, eq. 3.22 to 3.29): every range becomes that from the reference origin
    /// along the same angle to the same reflector. Lines come out right. Points do not: along the
    /// reflector each stays off by the way that the scanner went, so edges are moved.
    pub fn by_beam_length(&self, scan: &Scan, fit: &JointLines, motion: ScanMotion) -> Scan {
        let mut corrected = scan.clone();
        let mut at_rest = BeamTable::default();
        at_rest.fit(scan);
        let origins = ScanMotion {
            roll_rad_s: 0.0,
            ..motion
        };
        // Which reflector a beam met is known from where it really was.
        let runs = sectors(&fit.lines, &self.beams).into_iter().flatten();
        for (line, run) in fit.lines.iter().zip(runs) {
            let (sin, cos) = line.alpha_rad.sin_cos();
            let normal_m_s = origins.vy_m_s * cos + origins.vz_m_s * sin;
            for i in run {
                let (u, v) = at_rest.cos_sin[i];
                let longer_m = normal_m_s * at_rest.time_s(i) / (u * cos + v * sin);
                if longer_m.is_finite() {
                    corrected.ranges_m[i] += longer_m;
                }
            }
        }
        corrected
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

/// Standard deviation of one range from the residuals of all lines, weighted or not.
fn residual_sigma(sums: &[LineSums; 3], weighted: bool) -> f64 {
    let (ee, w) = sums
        .iter()
        .fold((0.0, 0.0), |(ee, w), s| (ee + s.ee, w + s.w));
    let freedom = w - N as f64;
    if freedom > 10.0 {
        let taken = if weighted { WEIGHTED_SQUARE } else { 1.0 };
        (ee / freedom / taken)
            .sqrt()
            .clamp(SIGMA_FLOOR_M, SIGMA_CEILING_M)
    } else {
        SIGMA_START_M
    }
}

/// Beam indices of right, upper and left line, bounded by the corners where two lines meet, less
/// one beam on each side (its spot covers both); none where two lines are parallel.
fn sectors(lines: &[NormalLine; 3], beams: &BeamTable) -> Option<[Range<usize>; 3]> {
    let margin = beams.increment_rad();
    let corner = |a: &NormalLine, b: &NormalLine| {
        let corner = a.corner(b)?;
        Some(beams.angle_towards(corner.angle_rad, corner.distance_m))
    };
    let [right, upper, left] = lines;
    let (first, second) = (corner(right, upper)?, corner(upper, left)?);
    Some([
        beams.index_range(-FRAC_PI_2, first - margin),
        beams.index_range(first + margin, second - margin),
        beams.index_range(second + margin, 3.0 * FRAC_PI_2),
    ])
}

#[cfg(test)]
mod tests;
