//! The joint estimator: x, y, z, roll, pitch, yaw, range bias, hit threshold and footprint in one
//! state.
//!
//! The reflector lines, as seven numbers with their joint covariance, bind y, z, roll and the bias
//! (the two walls are the frame's width apart, which no single line knows). Pitch has its prior.
//! An edge whose angle was measured finer than the beams is a Gaussian measurement of one linear
//! form of the state; any other one bounds its form between the last beam before it and the first
//! beam behind it. Both are formed from the beams themselves, so no corner and no fitted width is
//! needed, and each edge counts for itself: three are as good as their geometry, eight are not
//! required.
//!
//! What is known before the scan is a Gaussian over the state, and so is what is known after it:
//! [`Estimator::estimate`] takes the one into the other. [`Estimator::prior`] is the prior of a scan
//! on its own.

mod edges;
mod lines;
mod state;

pub(super) use edges::Boundary;
pub use edges::{PointFactor, interval, point};
pub(super) use lines::WhiteLines;
pub use state::{BIAS, FOOTPRINT, PITCH, ROLL, STATE, THRESHOLD, Vector, X, Y, YAW, Z};
pub(super) use state::{hit_share, threshold_mean};

use super::gaussian::Gaussian;
use super::interval::{BoxFactor, Site, propagate};
use super::pitch::{self, Pitch};
use crate::frame::{Frame, ScannerPose};
use crate::record::{Pose, ReflectorLines, Status, upper_index};
use edges::decorrelate;
use lines::{seen_status, start};
use state::bounded;

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
    /// Prior standard deviation of the footprint's scale.
    pub footprint_sigma: f64,
    /// Yaw is reported as not observable beyond this standard deviation, rad.
    pub yaw_limit_rad: f64,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            x_sigma_m: 0.5,
            yaw_sigma_rad: 8f64.to_radians(),
            threshold_sigma: 0.08,
            footprint_sigma: 0.15,
            yaw_limit_rad: 2f64.to_radians(),
        }
    }
}

/// A pitch that the strips leave less certain than this was not told by them, rad.
const TOLD_PITCH_RAD: f64 = 0.3 * std::f64::consts::PI / 180.0;
/// An edge that misses its interval by more than this, m, and two standard deviations of the
/// estimate, contradicts the others.
const VIOLATION_M: f64 = 0.0015;
/// A sub-beam edge that misses the estimate by more standard deviations contradicts the others.
const POINT_LIMIT: f64 = 4.5;
/// Squared misfit of the seven line parameters in the metric of their covariance beyond which they
/// are not those of one pose (chi-square with seven degrees of freedom: one in 1e9 is 58).
const MISFIT_LIMIT: f64 = 60.0;
/// A yaw known this well, rad, is a linearisation point.
const NEAR_RAD: f64 = 0.2 * std::f64::consts::PI / 180.0;
/// States no further apart than this, m and rad, share a linearisation.
const NEAR_M: f64 = 0.02;
const SAME_RAD: f64 = 0.001;
const SWEEPS: usize = 12;

/// What an edge of the record is used as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Use {
    /// Its sub-beam angle.
    Point,
    /// Its interval.
    Interval,
    /// Nothing: it contradicts the others, or belongs to no strip.
    Nothing,
}

/// Where a measurement comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Measured {
    /// The reflector lines.
    Lines,
    /// A strip edge between the beams.
    Edge,
}

/// What a scan says of the state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The state under prior, lines and edges; none where it was not solved, and the status says why.
    pub posterior: Option<Gaussian<STATE>>,
    /// Remarks on the scan and its edges.
    pub status: Status,
    /// Strip edges used.
    pub edges: u32,
}

/// Solves scan after scan of one frame.
#[derive(Clone, Debug)]
pub struct Estimator {
    frame: Frame,
    options: Options,
    /// The scanner on the platform, anywhere.
    scanner: ScannerPose,
    /// Mean of the threshold's prior.
    threshold: f64,
    uses: Vec<Use>,
    points: Vec<PointFactor>,
    boxes: Vec<BoxFactor<STATE>>,
    /// Which edge of the record each point, and each box, is.
    point_edges: Vec<usize>,
    box_edges: Vec<usize>,
    sites: Vec<Site>,
}

impl Estimator {
    /// An estimator for scans taken in `frame`.
    pub fn new(frame: &Frame, options: Options) -> Estimator {
        Estimator {
            frame: frame.clone(),
            options,
            scanner: ScannerPose::new(frame, [0.0; 3], [0.0; 3]),
            threshold: threshold_mean(frame.calibration.hit_threshold),
            uses: Vec::new(),
            points: Vec::new(),
            boxes: Vec::new(),
            point_edges: Vec::new(),
            box_edges: Vec::new(),
            sites: Vec::new(),
        }
    }

    /// What is known of the state before a scan when there is no scan before it, in the order and
    /// the units of [`Vector`].
    pub fn prior(&self, pitch: &Pitch) -> Gaussian<STATE> {
        state::prior(&self.frame, self.threshold, pitch, &self.options)
    }

    /// Takes one scan into what is known of the state.
    ///
    /// `pitch_changes_rad` says, edge by edge, by how much the platform's pitch differed when the
    /// edge was passed from that at the lines' reference instant; empty is no change. (x enters an
    /// edge as x + h tan(pitch) with the pitch of that beam; Kurniawan 2017 holds it for the scan: at
    /// 12 deg/s, 8 ms and 3 m that is 5 mm.)
    pub fn estimate(
        &mut self,
        lines: &ReflectorLines,
        prior: &Gaussian<STATE>,
        pitch_changes_rad: &[f64],
    ) -> Estimate {
        let mut status = seen_status(lines);
        if status.has(Status::NO_UPPER) || status.has(Status::NO_WALLS) {
            return Estimate {
                posterior: None,
                status: status | Status::NO_POSE,
                edges: 0,
            };
        }
        let Some(white) = WhiteLines::new(lines) else {
            return Estimate {
                posterior: None,
                status: status | Status::NO_POSE | Status::DISAGREE,
                edges: 0,
            };
        };
        self.uses.clear();
        self.uses.resize(lines.edges.len(), Use::Point);
        let mut at = start(lines, &self.frame.bounds, &prior.mean);
        // The walls' distance grows with |yaw|, whatever its sign: edges must decide that first.
        let mut knows_yaw = prior.sigma(YAW) < NEAR_RAD;
        // Coarse first: least squares on the middles brings the linearisation near.
        let mut near = None;
        for round in 0..2 {
            if round == 0 && knows_yaw {
                continue;
            }
            let linearise = |me: &mut Estimator| {
                me.linearise(lines, &white, prior, pitch_changes_rad, &at, knows_yaw)
            };
            let mut base = linearise(self);
            let mut coarse = self.middle_fit(lines, &base);
            if round == 1 {
                while let Some(edge) = self.worst_violation(&coarse) {
                    self.demote(edge);
                    base = linearise(self);
                    coarse = self.middle_fit(lines, &base);
                }
            }
            let knew_yaw = knows_yaw;
            knows_yaw = coarse.sigma(YAW) < self.options.yaw_limit_rad;
            let serves = round == 1 && knew_yaw == knows_yaw && is_near(&coarse.mean, &at);
            near = serves.then_some(base);
            at = bounded(coarse.mean);
        }
        let base = match near {
            Some(base) => base,
            None => self.linearise(lines, &white, prior, pitch_changes_rad, &at, knows_yaw),
        };
        let mut posterior = self.with_points(lines, &base);
        propagate(&mut posterior, &self.boxes, &mut self.sites, SWEEPS);
        let used = self.points.len() + self.boxes.len();
        if self.uses.iter().any(|used| *used != Use::Point) {
            status |= Status::EDGE_OUTLIER;
        }
        let misfit = white.misfit(lines, &self.pose_at(&posterior.mean), &posterior.mean);
        if !(misfit <= MISFIT_LIMIT) || used * 2 < lines.edges.len() {
            // The lines miss the estimate by far more than their covariance allows, or most of the
            // edges found belong to no strip seen from there.
            status |= Status::DISAGREE;
        }
        if !posterior.mean.iter().all(|v| v.is_finite()) {
            return Estimate {
                posterior: None,
                status: status | Status::NO_POSE | Status::DISAGREE,
                edges: 0,
            };
        }
        Estimate {
            posterior: Some(posterior),
            status: status | edge_status(&posterior, used, &self.options),
            edges: used as u32,
        }
    }

    /// The intervals that the last estimate used, linearised at it, each with the index of its edge
    /// in the record.
    pub fn intervals(&self) -> impl Iterator<Item = (usize, &BoxFactor<STATE>)> {
        self.box_edges.iter().copied().zip(&self.boxes)
    }

    /// The sub-beam edges that the last estimate used, linearised at it, each with the index of its
    /// edge in the record.
    pub fn points(&self) -> impl Iterator<Item = (usize, &PointFactor)> {
        self.point_edges.iter().copied().zip(&self.points)
    }

    fn pose_at(&self, at: &Vector) -> ScannerPose {
        self.scanner
            .moved_to([at[X], at[Y], at[Z]], [at[ROLL], at[PITCH], at[YAW]])
    }

    /// Forms the edges' factors at the state `at`; returns the prior under the lines.
    fn linearise(
        &mut self,
        lines: &ReflectorLines,
        white: &WhiteLines,
        prior: &Gaussian<STATE>,
        pitch_changes_rad: &[f64],
        at: &Vector,
        knows_yaw: bool,
    ) -> Gaussian<STATE> {
        let at_reference = self.pose_at(at);
        let mut base = *prior;
        white.observe(lines, &at_reference, at, knows_yaw, &mut base);
        self.points.clear();
        self.boxes.clear();
        self.point_edges.clear();
        self.box_edges.clear();
        for (index, edge) in lines.edges.iter().enumerate() {
            let pose = match pitch_changes_rad.get(index) {
                Some(change_rad) if *change_rad != 0.0 => {
                    let mut pitched = *at;
                    pitched[PITCH] += change_rad;
                    self.pose_at(&pitched)
                }
                _ => at_reference,
            };
            if self.uses[index] == Use::Point
                && let Some(factor) = point(edge, &self.frame, &pose, at)
            {
                self.points.push(factor);
                self.point_edges.push(index);
                continue;
            }
            if self.uses[index] != Use::Nothing
                && let Some(factor) = interval(edge, &self.frame, &pose, at)
            {
                self.boxes.push(factor);
                self.box_edges.push(index);
            }
        }
        base
    }

    /// `base` under the sub-beam edges, each freed of what it shares with the one before.
    fn with_points(&self, lines: &ReflectorLines, base: &Gaussian<STATE>) -> Gaussian<STATE> {
        let mut state = *base;
        for factor in self.independent_points(lines) {
            state.observe(&factor.row, factor.value, factor.variance);
        }
        state
    }

    /// The sub-beam edges, each freed of what it shares with the one before.
    fn independent_points(&self, lines: &ReflectorLines) -> impl Iterator<Item = PointFactor> {
        let mut last: Option<(usize, PointFactor)> = None;
        let points = self.point_edges.iter().zip(&self.points);
        points.map(move |(index, factor)| {
            let mut own = *factor;
            if let Some((before, first)) = &last
                && before + 1 == *index
            {
                own = decorrelate(first, factor, lines.edges[*before].cov_next_rad2);
            }
            last = Some((*index, own));
            own
        })
    }

    /// What the last estimate took from lines and sub-beam edges, as independent measurements: the
    /// lines linearised at `at`, the edges where the estimate had them. `lines` are those of the
    /// estimate; its intervals are [`Estimator::intervals`].
    pub fn measurements(
        &self,
        lines: &ReflectorLines,
        at: &Vector,
    ) -> Vec<(Measured, PointFactor)> {
        let pose = self.pose_at(at);
        let white = WhiteLines::new(lines);
        let of_lines = white
            .iter()
            .flat_map(|white| white.factors(lines, &pose, at));
        let of_edges = self.independent_points(lines);
        of_lines
            .map(|factor| (Measured::Lines, factor))
            .chain(of_edges.map(|factor| (Measured::Edge, factor)))
            .collect()
    }

    /// `base` under the sub-beam edges and the middles of the intervals, with the variance of an even
    /// distribution.
    fn middle_fit(&self, lines: &ReflectorLines, base: &Gaussian<STATE>) -> Gaussian<STATE> {
        let mut state = self.with_points(lines, base);
        for factor in &self.boxes {
            let width = factor.high - factor.low;
            let noise = width * width / 12.0 + factor.softness * factor.softness;
            state.observe(&factor.row, 0.5 * (factor.high + factor.low), noise);
        }
        state
    }

    /// The edge that contradicts the state most, if any does beyond doubt.
    fn worst_violation(&self, state: &Gaussian<STATE>) -> Option<usize> {
        let variance = |row: &Vector| row.dot(&state.along(row));
        let of_points = self.points().map(|(index, f)| {
            let off = (f.value - f.row.dot(&state.mean)).abs();
            let limit = POINT_LIMIT * (variance(&f.row) + f.variance).sqrt();
            (index, off / limit)
        });
        let of_boxes = self.intervals().map(|(index, f)| {
            let at = f.row.dot(&state.mean);
            let off = (f.low - at).max(at - f.high);
            let spread = (variance(&f.row) + f.softness * f.softness).sqrt();
            (index, off / (VIOLATION_M + 2.0 * spread))
        });
        of_points
            .chain(of_boxes)
            .filter(|(_, excess)| *excess > 1.0)
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .map(|(index, _)| index)
    }

    /// A sub-beam edge that contradicts the others still has its interval; an interval that does has
    /// nothing left.
    fn demote(&mut self, index: usize) {
        let is_point = self.point_edges.contains(&index);
        if let Some(used) = self.uses.get_mut(index) {
            *used = if is_point {
                Use::Interval
            } else {
                Use::Nothing
            };
        }
    }

    /// Solves one scan on its own.
    ///
    /// With no `pitch` the platform is taken as level with a standard deviation of one degree, and
    /// the status says so; where strips on the walls tell the pitch, it is estimated. The pose is in
    /// B at the lines' reference instant; where neither the upper line nor a wall was seen it has no
    /// numbers. For `pitch_changes_rad` see [`Estimator::estimate`].
    pub fn solve(
        &mut self,
        lines: &ReflectorLines,
        pitch: Option<Pitch>,
        pitch_changes_rad: &[f64],
    ) -> Pose {
        if let Some(pitch) = pitch {
            let prior = self.prior(&pitch);
            let mut pose = self.solve_with(lines, &prior, pitch_changes_rad);
            pose.status |= pitch::status(Some(pitch));
            return pose;
        }
        if !pitch::is_shown(&self.frame) {
            return self.solve_level(lines);
        }
        let prior = self.prior(&Pitch::OPEN);
        let mut pose = self.solve_with(lines, &prior, &[]);
        if !(pose.cov(PITCH, PITCH).sqrt() < TOLD_PITCH_RAD) {
            pose.status |= Status::NO_IMU;
        }
        pose
    }

    fn solve_with(
        &mut self,
        lines: &ReflectorLines,
        prior: &Gaussian<STATE>,
        pitch_changes_rad: &[f64],
    ) -> Pose {
        let estimate = self.estimate(lines, prior, pitch_changes_rad);
        self.pose(lines, &estimate)
    }

    /// The pose of a platform taken as level. The pitch is not estimated, because ceiling strips do
    /// not tell it from x; what an unknown pitch does to the pose is added to the covariance.
    fn solve_level(&mut self, lines: &ReflectorLines) -> Pose {
        let mut at = |rad: f64| {
            let prior = self.prior(&Pitch::exact(rad));
            self.solve_with(lines, &prior, &[])
        };
        let (mut level, tilted) = (at(0.0), at(Pitch::LEVEL.sigma_rad));
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

    /// An estimate as a pose. What was not measured, where only the prior's width is left, stays
    /// empty: a number there would be no measurement.
    pub fn pose(&self, lines: &ReflectorLines, estimate: &Estimate) -> Pose {
        let mut pose = Pose {
            stamp: lines.stamp,
            scan_stamp: lines.scan_stamp,
            seq: lines.seq,
            edges: estimate.edges,
            status: estimate.status,
            ..Pose::default()
        };
        let Some(posterior) = &estimate.posterior else {
            return pose;
        };
        let m = &posterior.mean;
        let mut components = [m[X], m[Y], m[Z], m[ROLL], m[PITCH], m[YAW]];
        let mut known = [true; 6];
        known[X] = pose.edges > 0 && posterior.sigma(X) < 0.5 * self.options.x_sigma_m;
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
        pose
    }
}

/// Whether a linearisation at one state serves for the other: what it leaves out between the two is
/// some micrometres.
fn is_near(a: &Vector, b: &Vector) -> bool {
    (X..=Z).all(|k| (a[k] - b[k]).abs() < NEAR_M)
        && (ROLL..=YAW).all(|k| (a[k] - b[k]).abs() < SAME_RAD)
}

/// Remarks on x and yaw.
fn edge_status(posterior: &Gaussian<STATE>, used: usize, options: &Options) -> Status {
    let mut status = match used {
        0 => Status::NO_EDGES,
        1..4 => Status::FEW_EDGES,
        _ => Status::OK,
    };
    if posterior.sigma(YAW) > options.yaw_limit_rad {
        status |= Status::NO_YAW;
    }
    status
}

#[cfg(test)]
mod tests;
