//! The joint estimator: x, y, z, roll, pitch, yaw, range bias and hit threshold in one state.
//!
//! The reflector lines, as seven numbers with their joint covariance, bind y, z, roll and the bias
//! (the two walls are the frame's width apart, which no single line knows). Pitch has its prior.
//! Every strip edge then bounds one linear form of the state between the last beam before it and
//! the first beam behind it. The bounds are formed from the beams themselves, so no corner and no
//! fitted width is needed, and each edge counts for itself: three are as good as their geometry,
//! eight are not required.

use super::interval::{BoxFactor, Gaussian, propagate};
use super::pitch::{self, Pitch};
use crate::frame::{Frame, ScannerPose};
use crate::record::{Edge, EdgeKind, Face, Pose, ReflectorLines, Status, upper_index};
use nalgebra::{SMatrix, SVector};

/// State: x, y, z, roll, pitch, yaw, range bias, hit threshold.
const N: usize = 8;
const X: usize = 0;
const YAW: usize = 5;
const BIAS: usize = 6;
const THRESHOLD: usize = 7;

pub(super) type State = SVector<f64, N>;
type Square = SMatrix<f64, N, N>;

/// Prior widths and limits of the joint estimator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Prior standard deviation of x around the frame's middle, m.
    pub x_sigma_m: f64,
    /// Prior standard deviation of yaw, rad.
    pub yaw_sigma_rad: f64,
    /// Prior standard deviation of the threshold: by how many spot radii the spot's centre may be
    /// off a strip for a hit.
    pub threshold_sigma: f64,
    /// Yaw is reported as not observable beyond this standard deviation, rad.
    pub yaw_limit_rad: f64,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            x_sigma_m: 0.5,
            yaw_sigma_rad: 8f64.to_radians(),
            threshold_sigma: 0.06,
            yaw_limit_rad: 2f64.to_radians(),
        }
    }
}

/// Standard deviation of a pitch that nobody gave, rad.
const UNKNOWN_PITCH_RAD: f64 = std::f64::consts::PI / 180.0;
/// Blur of an interval's bounds: this much, m, and this share of the spot's radius.
const SOFT_M: f64 = 0.0002;
const SOFT_SPOT: f64 = 0.02;
/// An edge that misses its interval by more than this, m, and two standard deviations of the
/// estimate, contradicts the others.
const VIOLATION_M: f64 = 0.0015;
/// Squared misfit of the seven line parameters in the metric of their covariance beyond which they
/// are not those of one pose (chi-square with seven degrees of freedom: one in 1e9 is 58).
const MISFIT_LIMIT: f64 = 60.0;
/// Relinearisations of lines and edges.
const ROUNDS: usize = 3;
const SWEEPS: usize = 12;

/// An edge's constraint, linearised.
#[derive(Clone, Copy, Debug)]
struct EdgeBox {
    factor: BoxFactor<N>,
    /// Which edge of the record.
    index: usize,
}

/// Solves one scan.
///
/// With no `pitch` the platform is taken as level with a standard deviation of one degree (with
/// strips on the walls, pitch is estimated), and the status says so. The pose is in B at the lines'
/// reference instant; where neither the upper line nor a wall was seen it has no numbers.
pub fn solve(
    lines: &ReflectorLines,
    frame: &Frame,
    pitch: Option<Pitch>,
    options: &Options,
) -> Pose {
    solve_pitching(lines, frame, pitch, &[], options)
}

/// Solves one scan of a platform that pitches while it is scanned: `pitch_changes_rad` says, edge by
/// edge, by how much its pitch differed when the edge was passed from that at the lines' reference
/// instant. x enters an edge as x + h tan(pitch) with the pitch of that beam (Kurniawan 2017 holds
/// it for the scan): at 12 deg/s, 8 ms and 3 m that is 5 mm. Empty is no change.
pub fn solve_pitching(
    lines: &ReflectorLines,
    frame: &Frame,
    pitch: Option<Pitch>,
    pitch_changes_rad: &[f64],
    options: &Options,
) -> Pose {
    let solve_with = |lines: &ReflectorLines, frame: &Frame, pitch, options: &Options| {
        solve_with(lines, frame, pitch, pitch_changes_rad, options)
    };
    match pitch {
        Some(pitch) => solve_with(lines, frame, pitch, options),
        None if frame.strips.iter().any(|strip| strip.face != Face::Upper) => {
            // Strips on the walls tell the pitch.
            let wide = Pitch {
                rad: 0.0,
                sigma_rad: UNKNOWN_PITCH_RAD,
                stale: false,
            };
            let pose = solve_with(lines, frame, wide, options);
            Pose {
                status: pose.status | Status::NO_IMU,
                ..pose
            }
        }
        None => solve_level(lines, frame, options),
    }
}

/// The pose of a platform taken as level. The pitch is not estimated, because ceiling strips do not
/// tell it from x; what an unknown pitch does to the pose is added to the covariance.
fn solve_level(lines: &ReflectorLines, frame: &Frame, options: &Options) -> Pose {
    let at = |rad: f64| {
        solve_with(
            lines,
            frame,
            Pitch {
                rad,
                sigma_rad: 0.0,
                stale: false,
            },
            &[],
            options,
        )
    };
    let (mut level, tilted) = (at(0.0), at(UNKNOWN_PITCH_RAD));
    level.status |= Status::NO_IMU;
    let moved: [f64; 6] = std::array::from_fn(|k| {
        let moved = tilted.components()[k] - level.components()[k];
        if moved.is_finite() { moved } else { 0.0 }
    });
    for row in 0..6 {
        for col in row..6 {
            level.covariance[upper_index(6, row, col)] += moved[row] * moved[col];
        }
    }
    level
}

fn solve_with(
    lines: &ReflectorLines,
    frame: &Frame,
    pitch: Pitch,
    pitch_changes_rad: &[f64],
    options: &Options,
) -> Pose {
    let mut pose = Pose {
        stamp: lines.stamp,
        scan_stamp: lines.scan_stamp,
        seq: lines.seq,
        ..Pose::default()
    };
    let mut status = seen_status(lines) | pitch::status(Some(pitch));
    if status.has(Status::NO_UPPER) || status.has(Status::NO_WALLS) {
        pose.status = status | Status::NO_POSE;
        return pose;
    }
    let mut estimate = start(lines, frame, pitch);
    let mut rejected = vec![false; lines.edges.len()];
    let mut used = 0;
    let mut posterior = None;
    // The walls' distance grows with |yaw|, whatever its sign: edges must decide that first.
    let mut known_yaw = false;
    for round in 0..ROUNDS {
        let Some(prior) = line_posterior(lines, frame, pitch, options, &estimate, known_yaw) else {
            break;
        };
        let boxes = edge_boxes(lines, frame, &estimate, pitch_changes_rad, &rejected);
        if round == 0 {
            // Coarse first: least squares on the middles brings the linearisation near.
            let mut coarse = middle_fit(&prior, &boxes);
            while let Some(worst) = worst_violation(&coarse, &boxes, &rejected) {
                rejected[worst] = true;
                let kept: Vec<EdgeBox> = boxes
                    .iter()
                    .filter(|b| !rejected[b.index])
                    .copied()
                    .collect();
                coarse = middle_fit(&prior, &kept);
            }
            estimate = bounded(coarse.mean);
            known_yaw = coarse.covariance[(YAW, YAW)].sqrt() < options.yaw_limit_rad;
            continue;
        }
        let factors: Vec<BoxFactor<N>> = boxes.iter().map(|b| b.factor).collect();
        let state = propagate(&prior, &factors, SWEEPS);
        estimate = bounded(state.mean);
        used = boxes.len();
        posterior = Some(state);
    }
    let Some(posterior) = posterior else {
        pose.status = status | Status::NO_POSE | Status::DISAGREE;
        return pose;
    };
    if rejected.iter().any(|r| *r) {
        status |= Status::EDGE_OUTLIER;
    }
    if contradicts(lines, frame, &estimate, used) {
        status |= Status::DISAGREE;
    }
    pose.edges = used as u32;
    pose.status = status | edge_status(&posterior, used, options);
    fill(&mut pose, &posterior, options);
    pose
}

/// Remarks on x and yaw.
fn edge_status(posterior: &Gaussian<N>, used: usize, options: &Options) -> Status {
    let mut status = match used {
        0 => Status::NO_EDGES,
        1..4 => Status::FEW_EDGES,
        _ => Status::OK,
    };
    if sigma(posterior, YAW) > options.yaw_limit_rad {
        status |= Status::NO_YAW;
    }
    status
}

fn sigma(state: &Gaussian<N>, k: usize) -> f64 {
    state.covariance[(k, k)].sqrt()
}

/// Whether lines and edges cannot be those of one pose: the lines miss it by far more than their
/// covariance allows, or most of the edges found belong to no strip seen from there.
fn contradicts(lines: &ReflectorLines, frame: &Frame, at: &State, used: usize) -> bool {
    let misfit = line_equations(lines, frame, at).map_or(0.0, |(_, residuals, weights)| {
        residuals.dot(&(weights * residuals))
    });
    misfit > MISFIT_LIMIT || used * 2 < lines.edges.len()
}

/// Puts the state's components into the pose. What was not measured, where only the prior's width
/// is left, stays empty: a number there would be no measurement.
fn fill(pose: &mut Pose, posterior: &Gaussian<N>, options: &Options) {
    let m = &posterior.mean;
    let mut components = [m[0], m[1], m[2], m[3], m[4], m[5]];
    let mut known = [true; 6];
    known[X] = pose.edges > 0 && sigma(posterior, X) < 0.5 * options.x_sigma_m;
    known[YAW] = !pose.status.has(Status::NO_YAW);
    for row in 0..6 {
        if !known[row] {
            components[row] = f64::NAN;
        }
        for col in row..6 {
            let both = known[row] && known[col];
            let value = if both {
                posterior.covariance[(row, col)]
            } else {
                f64::NAN
            };
            pose.covariance[upper_index(6, row, col)] = value;
        }
    }
    let [x, y, z, roll, pitch, yaw] = components;
    pose.position_m = [x, y, z];
    pose.rotation_rad = [roll, pitch, yaw];
    pose.range_bias_m = m[BIAS];
}

fn seen_status(lines: &ReflectorLines) -> Status {
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

/// A first linearisation point from the lines alone, level and in the middle.
fn start(lines: &ReflectorLines, frame: &Frame, pitch: Pitch) -> State {
    let half_m = frame.bounds.dy_m / 2.0;
    let y = match (lines.right.is_seen(), lines.left.is_seen()) {
        (true, true) => 0.5 * (lines.left.normal.d_m - lines.right.normal.d_m),
        (true, false) => half_m - lines.right.normal.d_m,
        _ => lines.left.normal.d_m - half_m,
    };
    let z = frame.bounds.dz_m - lines.upper.normal.d_m;
    let roll = std::f64::consts::FRAC_PI_2 - lines.upper.normal.alpha_rad;
    let bias = if lines.range_bias_m.is_finite() {
        lines.range_bias_m
    } else {
        0.0
    };
    let mut state = State::zeros();
    for (k, value) in [0.0, y, z, roll, pitch.rad, 0.0, bias]
        .into_iter()
        .enumerate()
    {
        state[k] = value;
    }
    state
}

/// Keeps a linearisation point where the geometry makes sense.
fn bounded(mut state: State) -> State {
    for k in 3..6 {
        state[k] = state[k].clamp(-0.5, 0.5);
    }
    state[X] = state[X].clamp(-2.0, 2.0);
    state
}

/// The state under the priors and the lines, linearised at `at`.
fn line_posterior(
    lines: &ReflectorLines,
    frame: &Frame,
    pitch: Pitch,
    options: &Options,
    at: &State,
    known_yaw: bool,
) -> Option<Gaussian<N>> {
    // In information form; every prior is independent of the others.
    let mut information = Square::zeros();
    let mut vector = State::zeros();
    let wide = |sigma: f64| 1.0 / (sigma * sigma);
    let threshold = threshold_mean(frame.calibration.hit_threshold);
    let priors = [
        (0.0, wide(options.x_sigma_m)),
        (0.0, 1e-6),
        (0.0, 1e-6),
        (0.0, 1e-6),
        (pitch.rad, wide(pitch.sigma_rad.max(1e-7))),
        (0.0, wide(options.yaw_sigma_rad)),
        (0.0, 1e-6),
        (threshold, wide(options.threshold_sigma)),
    ];
    for (k, (mean, weight)) in priors.into_iter().enumerate() {
        information[(k, k)] = weight;
        vector[k] = weight * mean;
    }
    let (mut rows, residuals, weights) = line_equations(lines, frame, at)?;
    if !known_yaw {
        rows.fill_column(YAW, 0.0);
    }
    let weighted = rows.transpose() * weights;
    information += weighted * rows;
    // Residuals are at `at`: measured - predicted + row . at is what the rows should give.
    vector += weighted * (residuals + rows * at);
    let covariance = information.cholesky()?.inverse();
    Some(Gaussian {
        mean: covariance * vector,
        covariance,
    })
}

/// Rows of [`line_equations`]: d and alpha of the three lines, and the bias.
pub(super) const LINE_ROWS: usize = 7;
type LineRows = SMatrix<f64, LINE_ROWS, N>;

/// Rows, residuals and information of the seven line parameters; zero for a line not seen.
pub(super) fn line_equations(
    lines: &ReflectorLines,
    frame: &Frame,
    at: &State,
) -> Option<(LineRows, SVector<f64, 7>, SMatrix<f64, 7, 7>)> {
    let pose = ScannerPose::new(frame, [at[0], at[1], at[2]], [at[3], at[4], at[5]]);
    let mut rows = LineRows::zeros();
    let mut residuals = SVector::<f64, 7>::zeros();
    let mut covariance = SMatrix::<f64, 7, 7>::identity();
    let joint = lines.joint_cov.len() == 28;
    let mut known = [false; 7];
    for (k, (line, face)) in lines
        .lines()
        .into_iter()
        .zip([Face::Right, Face::Upper, Face::Left])
        .enumerate()
    {
        if !line.is_seen() {
            continue;
        }
        let predicted = pose.line(face);
        known[2 * k] = true;
        known[2 * k + 1] = true;
        residuals[2 * k] = line.normal.d_m - predicted.normal.d_m;
        residuals[2 * k + 1] = line.normal.alpha_rad - predicted.normal.alpha_rad;
        for j in 0..6 {
            rows[(2 * k, j)] = predicted.d_d[j];
            rows[(2 * k + 1, j)] = predicted.d_alpha[j];
        }
        if !joint {
            covariance[(2 * k, 2 * k)] = line.cov_dd;
            covariance[(2 * k, 2 * k + 1)] = line.cov_da;
            covariance[(2 * k + 1, 2 * k)] = line.cov_da;
            covariance[(2 * k + 1, 2 * k + 1)] = line.cov_aa;
        }
    }
    if joint {
        known[6] = true;
        residuals[6] = lines.range_bias_m - at[BIAS];
        rows[(6, BIAS)] = 1.0;
        for i in (0..7).filter(|i| known[*i]) {
            for j in (0..7).filter(|j| known[*j]) {
                covariance[(i, j)] = lines.joint(i, j);
            }
        }
    } else {
        // Lines from elsewhere: the bias was not estimated, and is held at zero.
        known[6] = true;
        rows[(6, BIAS)] = 1.0;
        residuals[6] = -at[BIAS];
        covariance[(6, 6)] = 1e-12;
    }
    let mut weights = covariance.cholesky()?.inverse();
    for i in (0..7).filter(|i| !known[*i]) {
        weights[(i, i)] = 0.0;
    }
    Some((rows, residuals, weights))
}

/// By how many spot radii the spot's centre is outside a strip when a share of it is inside:
/// the root of F(-q) = share, F(q) = 1/2 + (q sqrt(1 - q^2) + asin q)/pi.
pub(super) fn threshold_mean(share: f64) -> f64 {
    let inside = |q: f64| hit_share(-q);
    let (mut low, mut high) = (-1.0, 1.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if inside(-middle) > share {
            low = middle
        } else {
            high = middle
        }
    }
    0.5 * (low + high)
}

/// The share of the spot that is inside a strip when its centre is `outside` spot radii off it:
/// F(-outside).
pub(super) fn hit_share(outside: f64) -> f64 {
    let q = (-outside).clamp(-1.0, 1.0);
    0.5 + (q * (1.0 - q * q).sqrt() + q.asin()) / std::f64::consts::PI
}

/// The edges as boxes on the state, linearised at `at`.
fn edge_boxes(
    lines: &ReflectorLines,
    frame: &Frame,
    at: &State,
    pitch_changes_rad: &[f64],
    rejected: &[bool],
) -> Vec<EdgeBox> {
    let pose_pitched_by = |change_rad: f64| {
        let rotation_rad = [at[3], at[4] + change_rad, at[5]];
        ScannerPose::new(frame, [at[0], at[1], at[2]], rotation_rad)
    };
    let at_reference = pose_pitched_by(0.0);
    lines
        .edges
        .iter()
        .enumerate()
        .filter(|(index, _)| !rejected[*index])
        .filter_map(|(index, edge)| {
            let pose = match pitch_changes_rad.get(index) {
                Some(change_rad) if *change_rad != 0.0 => pose_pitched_by(*change_rad),
                _ => at_reference,
            };
            edge_box(edge, frame, &pose, at).map(|factor| EdgeBox { factor, index })
        })
        .collect()
}

/// g is the signed distance of a beam's crossing from the strip's boundary, along y on the ceiling
/// and z on a wall. It changes sign between the two beams around the edge:
/// `0 <= sign g(from)`, `sign g(to) <= 0`, with g(state) = g(at) + row . (state - at).
fn edge_box(edge: &Edge, frame: &Frame, pose: &ScannerPose, at: &State) -> Option<BoxFactor<N>> {
    let strip = frame.strips.get(usize::try_from(edge.strip).ok()?)?;
    if strip.face != edge.face {
        return None;
    }
    let v = if edge.face == Face::Upper { 1 } else { 2 };
    // With growing beam angle v falls on ceiling and left wall and rises on the right wall.
    let sign = if edge.face == Face::Right { -1.0 } else { 1.0 };
    let side = if (edge.kind == EdgeKind::On) == (edge.face != Face::Right) {
        1.0
    } else {
        -1.0
    };
    let slope = strip.slope();
    let offset_m = strip.offset_m + side * strip.width_m / 2.0;
    let from = pose.crossing(edge.from_rad, edge.face)?;
    let to = pose.crossing(edge.to_rad, edge.face)?;
    let g = |c: &crate::frame::Crossing| sign * (c.point_m[v] - offset_m - slope * c.point_m[0]);
    let (g_from, g_to) = (g(&from), g(&to));
    let mut row = State::zeros();
    for k in 0..6 {
        let d = |c: &crate::frame::Crossing| c.d_point[k][v] - slope * c.d_point[k][0];
        row[k] = 0.5 * sign * (d(&from) + d(&to));
    }
    // A threshold moves the edge's angle, which moves g by its slope over the angle.
    let rate = (g_to - g_from) / (edge.to_rad - edge.from_rad);
    row[THRESHOLD] = -rate * edge.d_threshold;
    if !(g_from > g_to && row.iter().all(|r| r.is_finite())) {
        return None;
    }
    let centre = row.dot(at);
    let softness = f64::hypot(SOFT_M, SOFT_SPOT * row[THRESHOLD]);
    Some(BoxFactor {
        row,
        low: centre - g_from,
        high: centre - g_to,
        softness,
    })
}

/// Least squares on the middles of the boxes, with the variance of an even distribution.
fn middle_fit(prior: &Gaussian<N>, boxes: &[EdgeBox]) -> Gaussian<N> {
    let mut state = *prior;
    for EdgeBox { factor, .. } in boxes {
        let width = factor.high - factor.low;
        let noise = width * width / 12.0 + factor.softness * factor.softness;
        let gain = state.covariance * factor.row;
        let spread = factor.row.dot(&gain) + noise;
        let innovation = 0.5 * (factor.high + factor.low) - factor.row.dot(&state.mean);
        state.mean += gain * (innovation / spread);
        state.covariance -= gain * gain.transpose() / spread;
    }
    state
}

/// The edge that contradicts the estimate most, if any does beyond doubt.
fn worst_violation(state: &Gaussian<N>, boxes: &[EdgeBox], rejected: &[bool]) -> Option<usize> {
    let mut worst = None;
    let mut most = 0.0;
    for b in boxes.iter().filter(|b| !rejected[b.index]) {
        let f = &b.factor;
        let at = f.row.dot(&state.mean);
        let miss = (f.low - at).max(at - f.high);
        let spread = (f.row.dot(&(state.covariance * f.row)) + f.softness * f.softness).sqrt();
        let excess = miss - VIOLATION_M - 2.0 * spread;
        if excess > most {
            most = excess;
            worst = Some(b.index);
        }
    }
    worst
}

#[cfg(test)]
mod tests;
