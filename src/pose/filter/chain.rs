//! Scans as a chain: a Kalman filter forwards, a Rauch-Tung-Striebel smoother backwards, and strip
//! edges as boxes on the way.
//!
//! A box is no Gaussian, and two scans that see an edge between the same two beams are not two
//! measurements. Three rules keep the covariance honest:
//!
//! - Every box has the Gaussian factor that expectation propagation (Minka 2001) gives it against all
//!   that the other scans say, forwards and backwards. Scan after scan of a moving platform, the boxes
//!   intersect as they would on a grid.
//! - Of a run of scans that see an edge between the same two beams only the first and the last count.
//!   What moves steadily and was inside at both has been inside in between.
//! - While the platform stands, its boxes are one set: the state that they bound is the same. A box
//!   that holds another one says nothing; equal ones count once. Only where an edge is seen now here,
//!   now there, the scans have thresholds of their own, and what several of them say is worth more.

use super::gaits::CRUISING;
use super::state::{N, Nuisances, Square, State, Step, VELOCITY};
use crate::motion::Gait;
use crate::pose::gaussian::Gaussian;
use crate::pose::interval::{BoxFactor, Site, revise};
use crate::pose::joint::THRESHOLD;
use crate::record::{EdgeKind, Face};
use std::collections::VecDeque;

/// A linear measurement `row . state = value`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Point {
    pub row: State,
    pub value: f64,
    pub variance: f64,
    /// Whether it is a sub-beam edge, part of whose error stays while the platform stands.
    pub is_edge: bool,
}

/// Which edge of the frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct EdgeName {
    pub face: Face,
    pub strip: i32,
    pub kind: EdgeKind,
}

/// An edge between two beams.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct EdgeBox {
    pub name: EdgeName,
    /// Angles of the two beams, rad.
    pub beams_rad: [f64; 2],
    pub factor: BoxFactor<N>,
    site: Site,
    /// Whether it is the first of its run.
    first: bool,
    /// Whether it counts, or the run's first and last stand for it.
    counts: bool,
    /// In how many scans it was seen, and for how many it stands.
    seen: f64,
    copies: f64,
}

/// Beams nearer to each other than this are the same, rad. Half a step is 2e-3; what deskewing makes
/// of a beam at rest is far less.
const SAME_BEAM_RAD: f64 = 4e-4;

impl EdgeBox {
    pub(super) fn new(name: EdgeName, beams_rad: [f64; 2], factor: BoxFactor<N>) -> EdgeBox {
        EdgeBox {
            name,
            beams_rad,
            factor,
            site: Site::default(),
            first: true,
            counts: true,
            seen: 1.0,
            copies: 1.0,
        }
    }

    /// Whether the two cannot both be true of one edge and one threshold.
    fn excludes(&self, other: &EdgeBox) -> bool {
        let ([from, to], [other_from, other_to]) = (self.beams_rad, other.beams_rad);
        self.name == other.name
            && (to <= other_from + SAME_BEAM_RAD || other_to <= from + SAME_BEAM_RAD)
    }

    fn is_same(&self, other: &EdgeBox) -> bool {
        self.holds(other) && other.holds(self)
    }

    /// Whether this one is true wherever the other one is.
    fn holds(&self, other: &EdgeBox) -> bool {
        let ([from, to], [other_from, other_to]) = (self.beams_rad, other.beams_rad);
        self.name == other.name
            && from <= other_from + SAME_BEAM_RAD
            && to >= other_to - SAME_BEAM_RAD
    }

    /// The box as one of several scans: the scan's own threshold becomes a blur.
    fn kept(mut self, nuisances: &Nuisances) -> EdgeBox {
        let own = self.factor.row[THRESHOLD] * nuisances.threshold_scan_sigma;
        self.factor.softness = self.factor.softness.hypot(own);
        self.factor.row[THRESHOLD] = 0.0;
        self
    }

    /// By how much a state misses the box beyond its softness, in standard deviations of the state.
    pub(super) fn violation(&self, state: &Gaussian<N>) -> f64 {
        let f = &self.factor;
        let at = f.row.dot(&state.mean);
        let variance = f.row.dot(&state.along(&f.row));
        let miss = (f.low - at).max(at - f.high);
        miss / (variance + f.softness * f.softness).sqrt()
    }
}

/// A scan in the chain.
#[derive(Clone, Debug)]
pub(super) struct Node {
    /// How the state got here from the scan before.
    pub step: Step,
    pub points: Vec<Point>,
    pub boxes: Vec<EdgeBox>,
    /// Scans that the platform has stood here, this one included.
    stood: f64,
    /// Which components cruised on the way here.
    cruises: [bool; 6],
    predicted: Gaussian<N>,
    filtered: Gaussian<N>,
    smoothed: Gaussian<N>,
}

impl Node {
    pub(super) fn new(step: Step, points: Vec<Point>, boxes: Vec<EdgeBox>) -> Node {
        let nothing = Gaussian {
            mean: State::zeros(),
            covariance: Square::zeros(),
        };
        Node {
            step,
            points,
            boxes,
            stood: 1.0,
            cruises: std::array::from_fn(
                |k| matches!(step.gaits[k], Gait::Moving { psd } if psd <= CRUISING[k]),
            ),
            predicted: nothing,
            filtered: nothing,
            smoothed: nothing,
        }
    }

    /// The state under all scans.
    pub(super) fn smoothed(&self) -> &Gaussian<N> {
        &self.smoothed
    }

    /// The platform has stood for so many scans before this one. A share of an edge's variance, being
    /// the same in all n of them, leaves its mean 1/n + share of the variance of one: each scan is
    /// given the weight that makes it so.
    fn stand_on(&mut self, scans: f64) {
        self.stood = scans + 1.0;
        let less = (1.0 + COMMON_SHARE * scans) * (1.0 + COMMON_SHARE * self.stood);
        for point in self.points.iter_mut().filter(|p| p.is_edge) {
            point.variance *= less / (1.0 + COMMON_SHARE);
        }
    }

    /// Puts the scan into what the scans before predict, its boxes by their present factors.
    fn update(&mut self) {
        let mut state = self.predicted;
        for point in &self.points {
            state.observe(&point.row, point.value, point.variance);
        }
        for held in self.boxes.iter().filter(|b| b.counts) {
            let gain = state.along(&held.factor.row);
            let variance = held.factor.row.dot(&gain);
            let copies = held.copies;
            let (tau, nu) = (copies * held.site.tau, copies * held.site.nu);
            let pull = nu - tau * held.factor.row.dot(&state.mean);
            state.tighten(&gain, variance, tau, pull);
        }
        self.filtered = state;
    }
}

/// Goes over the boxes until their factors agree with the state; returns the largest change, in
/// standard deviations.
fn refine(state: &mut Gaussian<N>, boxes: &mut [EdgeBox], sweeps: usize, share: f64) -> f64 {
    let mut first = None;
    for _ in 0..sweeps {
        let mut change = 0.0f64;
        for held in boxes.iter_mut().filter(|b| b.counts) {
            let copies = held.copies;
            let moved = revise(state, &held.factor, &mut held.site, copies, share);
            change = change.max(moved);
        }
        first.get_or_insert(change);
        if change < SETTLED {
            break;
        }
    }
    first.unwrap_or(0.0)
}

/// Share of a sub-beam edge's variance that is the same in all scans of a platform that stands: what
/// the model of the beam leaves over.
const COMMON_SHARE: f64 = 0.015;
/// By how much a scan counts that sees again what was seen, where scans have thresholds of their own:
/// all edges of a scan share its threshold, and bounds that mixed pixels draw have none. Found with
/// platforms that stand for 70 scans, whose covariance it leaves honest.
const REPEATED: f64 = 0.2;

/// Fewer steps than this teach nothing of the motion.
const LEARNING: f64 = 20.0;
/// So many scans before a motion shows it may have begun.
const ROUSED: usize = 4;
/// Passes over one scan's boxes.
const SWEEPS: usize = 12;
/// Part of a factor's change that is taken over.
const SHARE: f64 = 0.8;
/// Factors that change the state by less of its standard deviation have settled.
const SETTLED: f64 = 1e-3;

/// What a scan knows of the one behind it when the chain is gone over backwards.
struct Behind {
    smoothed: Gaussian<N>,
    predicted: Gaussian<N>,
    /// From the scan to the one behind it, and which components cruised on it.
    step: Step,
    cruises: [bool; 6],
}

impl Behind {
    /// What hindsight of the scan behind is worth to a scan; none where rounding has spoilt the
    /// prediction.
    fn gain(&self, filtered: &Gaussian<N>, nuisances: &Nuisances) -> Option<Square> {
        let carried = self.step.carry(&filtered.covariance, nuisances);
        let factor = self.predicted.covariance.cholesky()?;
        Some(factor.solve(&carried).transpose())
    }

    /// Expected square of the change of a component's velocity on the step.
    fn squared_change(&self, smoothed: &Gaussian<N>, gain: &Square, component: usize) -> f64 {
        let v = VELOCITY + component;
        let shared = gain.row(v).dot(&self.smoothed.covariance.row(v));
        let change = self.smoothed.mean[v] - smoothed.mean[v];
        let squared =
            change * change + self.smoothed.covariance[(v, v)] + smoothed.covariance[(v, v)]
                - 2.0 * shared;
        squared.max(0.0)
    }
}

/// How a component's velocity changed while it cruised.
#[derive(Clone, Copy, Debug, Default)]
struct Cruise {
    /// Sum of the squared changes, each over what was expected of it.
    found: f64,
    /// Their number.
    expected: f64,
}

/// Scans one after the other.
#[derive(Clone, Debug)]
pub(super) struct Chain {
    /// The state before the first scan.
    prior: Gaussian<N>,
    nuisances: Nuisances,
    nodes: VecDeque<Node>,
    /// Whether older steps have changed since the last pass.
    roused: bool,
    /// Of each component, from the last pass backwards.
    cruises: [Cruise; 6],
}

impl Chain {
    pub(super) fn new(prior: Gaussian<N>, nuisances: Nuisances) -> Chain {
        Chain {
            prior,
            nuisances,
            nodes: VecDeque::new(),
            roused: false,
            cruises: [Cruise::default(); 6],
        }
    }

    pub(super) fn nodes(&self) -> impl ExactSizeIterator<Item = &Node> {
        self.nodes.iter()
    }

    /// The state at the newest scan under all scans so far.
    pub(super) fn newest(&self) -> &Gaussian<N> {
        self.nodes.back().map_or(&self.prior, |node| &node.filtered)
    }

    /// The state that a step leads to, from the newest scan.
    pub(super) fn predict(&self, step: &Step) -> Gaussian<N> {
        if self.nodes.is_empty() {
            return self.prior;
        }
        step.predict(self.newest(), &self.nuisances)
    }

    /// How the newest state was reached.
    pub(super) fn newest_step(&self) -> Option<&Step> {
        self.nodes.back().map(|node| &node.step)
    }

    /// The boxes that bound the newest state.
    pub(super) fn newest_boxes(&self) -> &[EdgeBox] {
        self.nodes.back().map_or(&[], |node| &node.boxes)
    }

    /// Takes the next scan in.
    pub(super) fn push(&mut self, mut node: Node) {
        if let Some(last) = self.nodes.back_mut() {
            if node.step.is_rest() {
                node.stand_on(last.stood);
                keep_boxes(last, &mut node, &self.nuisances);
            } else {
                join_runs(last, &mut node);
            }
            last.update();
        }
        node.predicted = self.predict(&node.step);
        node.update();
        refine(&mut node.filtered, &mut node.boxes, SWEEPS, SHARE);
        self.nodes.push_back(node);
    }

    /// A component has left its rest: it may have done so some scans ago.
    pub(super) fn rouse(&mut self, component: usize, gait: Gait) {
        for node in self.nodes.iter_mut().rev().take(ROUSED) {
            if node.step.gaits[component] != Gait::Rest {
                return;
            }
            node.step.gaits[component] = gait;
        }
        self.roused = true;
    }

    /// Passes backwards and forwards, at most `passes` of each, until the boxes' factors agree.
    pub(super) fn settle(&mut self, passes: usize) {
        if self.roused {
            self.forward();
        }
        for _ in 0..passes {
            let change = self.backward(SHARE);
            self.forward();
            if change < SETTLED {
                break;
            }
        }
    }

    /// Whether another pass could teach the newest state anything.
    pub(super) fn is_unsettled(&self) -> bool {
        if self.roused {
            return true;
        }
        let older = self.nodes.len().saturating_sub(1);
        let mut older = self.nodes.iter().take(older);
        older.any(|node| node.boxes.iter().any(|b| b.counts))
    }

    /// The same for a whole run, and finds on the way how much each component's velocity changes
    /// while it cruises (expectation maximisation: Shumway and Stoffer 1982). In a run, that is shown
    /// by the scans; it need not be assumed.
    pub(super) fn settle_and_learn(&mut self, passes: usize) {
        let mut scale = [1.0f64; 6];
        for _ in 0..passes {
            let mut change = self.backward(SHARE);
            for (component, scale) in scale.iter_mut().enumerate() {
                let Cruise { found, expected } = self.cruises[component];
                if expected < LEARNING {
                    continue;
                }
                let before = *scale;
                // Its steps are short, but never too long: twice one is still on the way.
                *scale = (before * (found / expected).powi(2)).clamp(1e-4, 1e3);
                let factor = *scale / before;
                change = change.max(0.1 * factor.ln().abs());
                for node in &mut self.nodes {
                    if let (true, Gait::Moving { psd }) =
                        (node.cruises[component], &mut node.step.gaits[component])
                    {
                        *psd *= factor;
                    }
                }
            }
            self.forward();
            if change < SETTLED {
                break;
            }
        }
    }

    fn forward(&mut self) {
        let mut before: Option<Gaussian<N>> = None;
        for node in &mut self.nodes {
            node.predicted = match &before {
                Some(state) => node.step.predict(state, &self.nuisances),
                None => self.prior,
            };
            node.update();
            before = Some(node.filtered);
        }
        self.roused = false;
    }

    /// The state of every scan under all of them, and the boxes' factors against it. Returns the
    /// largest change.
    pub(super) fn backward(&mut self, share: f64) -> f64 {
        let mut change = 0.0f64;
        let mut after: Option<Behind> = None;
        self.cruises = [Cruise::default(); 6];
        for node in self.nodes.iter_mut().rev() {
            node.smoothed = node.filtered;
            // Where rounding has spoilt the covariance, the scan learns nothing from later ones.
            if let Some(behind) = &after
                && let Some(gain) = behind.gain(&node.filtered, &self.nuisances)
            {
                let less = behind.smoothed.covariance - behind.predicted.covariance;
                let covariance = node.filtered.covariance + gain * less * gain.transpose();
                node.smoothed.covariance = 0.5 * (covariance + covariance.transpose());
                node.smoothed.mean += gain * (behind.smoothed.mean - behind.predicted.mean);
                for k in (0..6).filter(|k| behind.cruises[*k]) {
                    if let Gait::Moving { psd } = behind.step.gaits[k] {
                        let squared = behind.squared_change(&node.smoothed, &gain, k);
                        self.cruises[k].found += squared / (psd * behind.step.span_s.abs());
                        self.cruises[k].expected += 1.0;
                    }
                }
            }
            change = change.max(refine(&mut node.smoothed, &mut node.boxes, 1, share));
            after = Some(Behind {
                smoothed: node.smoothed,
                predicted: node.predicted,
                step: node.step,
                cruises: node.cruises,
            });
        }
        change
    }

    /// Forgets the oldest scans beyond `most`; what they say is in the prior of the others.
    pub(super) fn trim(&mut self, most: usize) {
        while self.nodes.len() > most {
            let Some(mut oldest) = self.nodes.pop_front() else {
                return;
            };
            let Some(next) = self.nodes.front_mut() else {
                return;
            };
            // A run that goes on begins with the next scan instead: only what has ended is forgotten.
            for held in oldest.boxes.iter_mut().filter(|b| b.counts) {
                if let Some(goes_on) = next.boxes.iter_mut().find(|b| b.is_same(held)) {
                    held.counts = false;
                    goes_on.first = true;
                    if !goes_on.counts {
                        goes_on.counts = true;
                        goes_on.site = Site::default();
                    }
                }
            }
            oldest.predicted = self.prior;
            oldest.update();
            self.prior = next.step.predict(&oldest.filtered, &self.nuisances);
            next.predicted = self.prior;
        }
    }
}

/// At rest all boxes bound one state: they go on to the newest scan, each statement once.
fn keep_boxes(last: &mut Node, node: &mut Node, nuisances: &Nuisances) {
    let mut kept: Vec<EdgeBox> = Vec::with_capacity(last.boxes.len() + node.boxes.len());
    for held in last.boxes.drain(..) {
        kept.push(held.kept(nuisances));
    }
    for new in node.boxes.drain(..) {
        if let Some(old) = kept.iter_mut().find(|old| new.is_same(old)) {
            old.seen += 1.0;
            continue;
        }
        if kept.iter().any(|old| new.holds(old)) {
            continue;
        }
        kept.retain(|old| !old.holds(&new));
        kept.push(new);
    }
    let dithers = kept.iter().any(|a| kept.iter().any(|b| a.excludes(b)));
    for held in &mut kept {
        held.copies = if dithers {
            1.0 + REPEATED * (held.seen - 1.0)
        } else {
            1.0
        };
        held.counts = true;
        held.first = true;
    }
    node.boxes = kept;
}

/// Marks which boxes of a run count.
fn join_runs(last: &mut Node, node: &mut Node) {
    for new in &mut node.boxes {
        if let Some(before) = last.boxes.iter_mut().find(|b| b.is_same(new)) {
            new.first = false;
            if !before.first {
                before.counts = false;
            }
        }
    }
}
