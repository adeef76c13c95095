//! Poses over many scans: a causal filter, and a smoother for recorded runs.
//!
//! The state is that of the joint estimator with velocities and with what is slow: the footprint's
//! scale, the constant part of the hit threshold, the error of the pitch that was given (it does not
//! average out). The range bias is drawn anew for every scan unless the user knows better. What a scan
//! says is taken from [`crate::pose::joint`] as it stands: lines and sub-beam edges as Gaussian
//! measurements, other edges as boxes. See `chain` for what keeps the covariance honest, `gaits`
//! for how lively a platform the filter expects.
//!
//! A scan that cannot come from where the platform was is a new start, and its status says so.

mod chain;
mod gaits;
mod state;

pub use state::Nuisances;

use crate::frame::Frame;
use crate::motion::Gait;
use crate::pose::gaussian::Gaussian;
use crate::pose::joint::{self, Estimator, Measured, PITCH, Y, Z};
use crate::pose::pitch::{self, Pitch};
use crate::record::{Pose, ReflectorLines, Stamp, Status, upper_index};
use chain::{Chain, EdgeBox, EdgeName, Node, Point};
use gaits::Gaits;
use state::{LEAST_RAD, N, PITCH_ERROR, State, Step, widened};

/// What the filter assumes and how much it remembers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// What is slow, and what is drawn for every scan.
    pub nuisances: Nuisances,
    /// Scans whose boxes are still gone over when a new one comes.
    pub window: usize,
    /// How often, for each new scan.
    pub passes: usize,
    /// After a gap as long as this the filter starts anew, s.
    pub longest_gap_s: f64,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            nuisances: Nuisances::default(),
            window: 8,
            passes: 1,
            longest_gap_s: 2.0,
        }
    }
}

/// Squared distance of a scan on its own from where the platform was going, over its variance, beyond
/// which the platform is elsewhere.
const JUMP: f64 = 60.0;
/// Accelerations that are not expected to be exceeded, as a standard deviation, m/s^2 and rad/s^2.
const ACCELERATION: [f64; 6] = [10.0, 20.0, 20.0, 10.0, 10.0, 10.0];
/// A measurement this many standard deviations from the prediction is left out, if most others are
/// not.
const OUTLIER: f64 = 5.0;
/// A box at rest that is missed by this many standard deviations contradicts the others.
const CONTRADICTION: f64 = 4.0;

/// What became of a scan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fate {
    /// It is the chain's newest.
    Joined,
    /// It is the first of a new chain.
    Started,
    /// It is not in the chain.
    Apart,
}

/// Scans into a chain.
#[derive(Clone, Debug)]
struct Tracker {
    estimator: Estimator,
    options: Options,
    /// Whether strips on the walls tell the pitch.
    tells_pitch: bool,
    chain: Option<Chain>,
    gaits: Gaits,
    last: Option<Stamp>,
    /// Standard deviation of the constant part of the given pitches' error, as the chain began, rad.
    constant_pitch_sigma_rad: f64,
    starts: u64,
    refused: u64,
}

impl Tracker {
    fn new(frame: &Frame, joint: joint::Options, options: Options) -> Tracker {
        Tracker {
            estimator: Estimator::new(frame, joint),
            options,
            tells_pitch: pitch::is_shown(frame),
            chain: None,
            gaits: Gaits::new(false),
            last: None,
            constant_pitch_sigma_rad: 0.0,
            starts: 0,
            refused: 0,
        }
    }

    /// Solves a scan on its own and takes it into the chain, or starts a new one (which `finished`
    /// gets to see first).
    fn take(
        &mut self,
        lines: &ReflectorLines,
        given: Option<Pitch>,
        pitch_changes_rad: &[f64],
        finished: &mut dyn FnMut(&mut Chain),
    ) -> (Pose, Fate) {
        // A pitch that nobody gave is measured as level where no strip tells it.
        let measured = given.or((!self.tells_pitch).then_some(Pitch::LEVEL));
        let alone = self.estimator.prior(&measured.unwrap_or(Pitch::OPEN));
        let estimate = self.estimator.estimate(lines, &alone, pitch_changes_rad);
        let mut pose = self.estimator.pose(lines, &estimate);
        pose.status |= match (given, self.tells_pitch) {
            (Some(pitch), _) => pitch::status(Some(pitch)),
            (None, false) => Status::NO_IMU,
            (None, true) => Status::OK,
        };
        let Some(posterior) = &estimate.posterior else {
            return (pose, Fate::Apart);
        };
        if pose.status.has(Status::DISAGREE) {
            return (pose, Fate::Apart);
        }
        let span_s = self.last.map(|last| lines.stamp.since_s(last));
        if let Some(span_s) = span_s
            && span_s <= 0.0
            && span_s > -self.options.longest_gap_s
        {
            self.refused += 1;
            return (pose, Fate::Apart);
        }
        self.last = Some(lines.stamp);
        let near = span_s.filter(|s| *s > 0.0 && *s <= self.options.longest_gap_s);
        let goes_on = |chain: &Chain| near.filter(|span_s| !jumps(chain, *span_s, &pose));
        let span_s = self.chain.as_ref().and_then(goes_on);
        if span_s.is_none() {
            if let Some(chain) = &mut self.chain {
                finished(chain);
            }
            self.begin(&alone, measured, given.is_some(), &mut pose);
        }
        let points = self.points(lines, posterior, measured);
        let boxes = self.boxes(lines);
        match span_s {
            Some(span_s) => {
                self.join(span_s, points, boxes, &mut pose);
                (pose, Fate::Joined)
            }
            None => {
                self.gaits.see(0.0, &pose);
                let step = Step {
                    span_s: 0.0,
                    gaits: self.gaits.now(),
                };
                if let Some(chain) = &mut self.chain {
                    chain.push(Node::new(step, points, boxes));
                }
                (pose, Fate::Started)
            }
        }
    }

    /// A new chain, before its first scan.
    fn begin(
        &mut self,
        alone: &Gaussian<{ joint::STATE }>,
        measured: Option<Pitch>,
        has_imu: bool,
        pose: &mut Pose,
    ) {
        if self.starts > 0 {
            pose.status |= Status::RE_ACQUIRED;
        }
        self.starts += 1;
        // An IMU that is heard only later is as wrong as one that does not say how wrong it is.
        self.constant_pitch_sigma_rad =
            measured.map_or(pitch::Settings::UNSTATED_RAD, |p| p.sigma_rad);
        self.gaits = Gaits::new(has_imu);
        let nuisances = self.options.nuisances;
        let constant = self.constant_pitch_sigma_rad;
        let prior = state::prior(alone, measured.is_some(), constant, &nuisances);
        self.chain = Some(Chain::new(prior, nuisances));
    }

    /// Takes a scan, `span_s` after the last one, into the chain.
    fn join(
        &mut self,
        span_s: f64,
        mut points: Vec<Point>,
        mut boxes: Vec<EdgeBox>,
        pose: &mut Pose,
    ) {
        let Some(chain) = &mut self.chain else {
            return;
        };
        self.gaits.see(span_s, pose);
        let mut step = Step {
            span_s,
            gaits: self.gaits.now(),
        };
        let mut predicted = chain.predict(&step);
        let (off, variance) = differences(&predicted, pose);
        if self.gaits.compare(span_s, &off, &variance) {
            step.gaits = self.gaits.now();
            predicted = chain.predict(&step);
        }
        let before = chain.newest_step().map(|step| step.gaits);
        for (k, gait) in step.gaits.iter().enumerate() {
            if *gait != Gait::Rest && before.is_some_and(|gaits| gaits[k] == Gait::Rest) {
                chain.rouse(k, *gait);
            }
        }
        if leave_out(&predicted, &mut points, &mut boxes) {
            pose.status |= Status::EDGE_OUTLIER;
        }
        chain.push(Node::new(step, points, boxes));
        let newest = chain.newest();
        let contradicted = |b: &EdgeBox| b.violation(newest) > CONTRADICTION;
        if step.is_rest() && chain.newest_boxes().iter().any(contradicted) {
            self.gaits.disturb();
        }
    }

    /// The scan's Gaussian measurements.
    fn points(
        &self,
        lines: &ReflectorLines,
        at: &Gaussian<{ joint::STATE }>,
        pitch: Option<Pitch>,
    ) -> Vec<Point> {
        let measured = self.estimator.measurements(lines, &at.mean);
        let mut points: Vec<Point> = measured
            .iter()
            .map(|(kind, factor)| Point {
                row: widened(&factor.row),
                value: factor.value,
                variance: factor.variance,
                is_edge: *kind == Measured::Edge,
            })
            .collect();
        if let Some(pitch) = pitch {
            // Its error is a constant; what a single sample is worse than the first one is its own.
            let constant = self.constant_pitch_sigma_rad;
            let own = (pitch.sigma_rad * pitch.sigma_rad - constant * constant).max(0.0);
            let mut row = State::zeros();
            row[PITCH] = 1.0;
            row[PITCH_ERROR] = 1.0;
            points.push(Point {
                row,
                value: pitch.rad,
                variance: own + LEAST_RAD * LEAST_RAD,
                is_edge: false,
            });
        }
        points
    }

    /// The scan's boxes.
    fn boxes(&self, lines: &ReflectorLines) -> Vec<EdgeBox> {
        self.estimator
            .intervals()
            .filter_map(|(index, factor)| {
                let edge = lines.edges.get(index)?;
                let name = EdgeName {
                    face: edge.face,
                    strip: edge.strip,
                    kind: edge.kind,
                };
                let wide = crate::pose::interval::BoxFactor {
                    row: widened(&factor.row),
                    low: factor.low,
                    high: factor.high,
                    softness: factor.softness,
                    doubt: factor.doubt,
                };
                Some(EdgeBox::new(name, [edge.from_rad, edge.to_rad], wide))
            })
            .collect()
    }
}

/// Differences of a scan on its own from its prediction, and their variances.
fn differences(predicted: &Gaussian<N>, pose: &Pose) -> ([f64; 6], [f64; 6]) {
    let components = pose.components();
    (
        std::array::from_fn(|k| components[k] - predicted.mean[k]),
        std::array::from_fn(|k| pose.cov(k, k) + predicted.covariance[(k, k)]),
    )
}

/// Whether a scan on its own is from elsewhere than any motion leads.
fn jumps(chain: &Chain, span_s: f64, pose: &Pose) -> bool {
    // Of the first scan nothing is known but that it stands here or comes through here.
    let resting = chain.newest_step().filter(|_| chain.nodes().len() > 1);
    let resting = resting.map(|step| step.gaits);
    let step = Step {
        span_s,
        gaits: std::array::from_fn(|k| match resting {
            // What stood has no velocity, though a filter that leaves the rest knows none.
            Some(gaits) if gaits[k] == Gait::Rest => Gait::Rest,
            _ => Gait::Moving { psd: 0.0 },
        }),
    };
    let (off, mut variance) = differences(&chain.predict(&step), pose);
    for (variance, acceleration) in variance.iter_mut().zip(ACCELERATION) {
        *variance += (acceleration * span_s * span_s / 2.0).powi(2);
    }
    let squared = off.iter().zip(&variance).enumerate();
    squared
        .filter(|(k, (off, variance))| *k != PITCH && off.is_finite() && **variance > 0.0)
        .map(|(_, (off, variance))| off * off / variance)
        .sum::<f64>()
        > JUMP
}

/// Leaves out what contradicts the prediction, if that is less than half; true if something was.
fn leave_out(predicted: &Gaussian<N>, points: &mut Vec<Point>, boxes: &mut Vec<EdgeBox>) -> bool {
    let off = |point: &Point| {
        let spread = point.row.dot(&predicted.along(&point.row)) + point.variance;
        (point.value - point.row.dot(&predicted.mean)).abs() / spread.sqrt() > OUTLIER
    };
    let all = points.len() + boxes.len();
    let wrong = points.iter().filter(|p| off(p)).count()
        + boxes
            .iter()
            .filter(|b| b.violation(predicted) > OUTLIER)
            .count();
    if wrong == 0 || 2 * wrong > all {
        return false;
    }
    points.retain(|p| !off(p));
    boxes.retain(|b| b.violation(predicted) <= OUTLIER);
    true
}

/// Puts a state into a scan's pose. What one scan cannot tell, many may.
fn fill(pose: &mut Pose, state: &Gaussian<N>) {
    let m = &state.mean;
    pose.position_m = [m[0], m[1], m[2]];
    pose.rotation_rad = [m[3], m[4], m[5]];
    pose.range_bias_m = m[joint::BIAS];
    for row in 0..6 {
        for col in row..6 {
            pose.covariance[upper_index(6, row, col)] = state.covariance[(row, col)];
        }
    }
}

/// Mixes into a pose at rest, with this probability, y and z of the scan on its own: the mean and the
/// covariance of both cases together.
fn mix(pose: &mut Pose, alone: &Pose, started: f64) {
    let off = [Y, Z].map(|k| alone.position_m[k] - pose.position_m[k]);
    if !off.iter().all(|off| off.is_finite()) {
        return;
    }
    for (i, row) in [Y, Z].into_iter().enumerate() {
        let wider = (alone.cov(row, row) - pose.cov(row, row)).max(0.0);
        pose.covariance[upper_index(6, row, row)] += started * wider;
        for (j, col) in [Y, Z].into_iter().enumerate().skip(i) {
            let apart = started * (1.0 - started) * off[i] * off[j];
            pose.covariance[upper_index(6, row, col)] += apart;
        }
    }
    pose.position_m[Y] += started * off[0];
    pose.position_m[Z] += started * off[1];
}

/// The causal filter: each pose comes out with its scan.
#[derive(Clone, Debug)]
pub struct Filter {
    tracker: Tracker,
}

impl Filter {
    /// A filter for scans taken in `frame`.
    pub fn new(frame: &Frame, joint: joint::Options, options: Options) -> Filter {
        Filter {
            tracker: Tracker::new(frame, joint, options),
        }
    }

    /// The pose at a scan under all scans so far.
    ///
    /// A scan that is not later than the last one is solved on its own and teaches the filter
    /// nothing; so is one whose measurements contradict each other. For `pitch_changes_rad` see
    /// [`Estimator::estimate`].
    pub fn take(
        &mut self,
        lines: &ReflectorLines,
        pitch: Option<Pitch>,
        pitch_changes_rad: &[f64],
    ) -> Pose {
        let (mut pose, fate) =
            self.tracker
                .take(lines, pitch, pitch_changes_rad, &mut |_: &mut Chain| {});
        let options = self.tracker.options;
        if fate == Fate::Apart {
            return pose;
        }
        if let Some(chain) = &mut self.tracker.chain {
            if chain.is_unsettled() {
                chain.settle(options.passes);
            }
            chain.trim(options.window.max(1));
            let alone = pose.clone();
            fill(&mut pose, chain.newest());
            let started = self.tracker.gaits.may_have_started();
            if fate == Fate::Joined && started > 0.0 {
                mix(&mut pose, &alone, started);
            }
        }
        pose
    }

    /// Scans refused because they were not later than the one before.
    pub fn refused(&self) -> u64 {
        self.tracker.refused
    }

    /// How often it started.
    pub fn starts(&self) -> u64 {
        self.tracker.starts
    }
}

/// The smoother of a recorded run: every pose under all scans, before and after it.
///
/// It holds some 12 kB for each scan until the run, or an unbroken part of it, is over.
#[derive(Clone, Debug)]
pub struct Smoother {
    tracker: Tracker,
    /// Poses of the part that is not over, and whether each is in the chain.
    held: Vec<(Pose, bool)>,
}

/// Passes over a whole run.
const PASSES: usize = 25;

impl Smoother {
    /// A smoother for scans taken in `frame`.
    pub fn new(frame: &Frame, joint: joint::Options, options: Options) -> Smoother {
        Smoother {
            tracker: Tracker::new(frame, joint, options),
            held: Vec::new(),
        }
    }

    /// Takes a scan; `emit` gets the poses of a part of the run that has ended before it.
    pub fn take(
        &mut self,
        lines: &ReflectorLines,
        pitch: Option<Pitch>,
        pitch_changes_rad: &[f64],
        mut emit: impl FnMut(Pose),
    ) {
        let held = &mut self.held;
        let mut over = |chain: &mut Chain| smooth(chain, held, &mut emit);
        let (pose, fate) = self
            .tracker
            .take(lines, pitch, pitch_changes_rad, &mut over);
        self.held.push((pose, fate != Fate::Apart));
    }

    /// The end of the run.
    pub fn finish(&mut self, mut emit: impl FnMut(Pose)) {
        match self.tracker.chain.take() {
            Some(mut chain) => smooth(&mut chain, &mut self.held, &mut emit),
            None => self.held.drain(..).for_each(|(pose, _)| emit(pose)),
        }
    }

    /// Scans refused because they were not later than the one before.
    pub fn refused(&self) -> u64 {
        self.tracker.refused
    }

    /// How many unbroken parts the run has.
    pub fn starts(&self) -> u64 {
        self.tracker.starts
    }
}

fn smooth(chain: &mut Chain, held: &mut Vec<(Pose, bool)>, emit: &mut dyn FnMut(Pose)) {
    chain.settle_and_learn(PASSES);
    chain.backward(0.0);
    let mut nodes = chain.nodes();
    for (mut pose, joined) in held.drain(..) {
        if joined && let Some(node) = nodes.next() {
            fill(&mut pose, node.smoothed());
        }
        emit(pose);
    }
}

#[cfg(test)]
mod tests;
