//! What one scan says of its pose and of the parameters, linearised.

use super::super::joint::{self, LINE_ROWS};
use super::parameters::{BIAS, DY, DZ, FOOTPRINT, Layout, SCALE, THRESHOLD, TURN, X_CONSTANT};
use super::{Observation, Options};
use crate::frame::{Crossing, Frame, ScannerPose};
use crate::record::{Edge, EdgeKind, Face};
use nalgebra::{DMatrix, DVector};

/// A scan's own unknowns: x, y, z, roll, pitch, yaw, range bias, threshold, footprint scale.
pub(super) const OWN: usize = 9;
pub(super) const X: usize = 0;
const ROLL: usize = 3;
const PITCH: usize = 4;
const YAW: usize = 5;
const OWN_BIAS: usize = 6;
const OWN_THRESHOLD: usize = 7;
const OWN_FOOTPRINT: usize = 8;
/// Own unknowns.
pub(super) type Own = [f64; OWN];

/// Prior of x, m, and of yaw, rad, of a scan: none, or many scans together would show what none does.
const X_SIGMA_M: f64 = 100.0;
const YAW_SIGMA_RAD: f64 = 100.0;
/// The same of a pitch that nobody measured, rad.
const PITCH_SIGMA_RAD: f64 = 100.0;
/// An attitude is not known better than this, rad.
const ATTITUDE_FLOOR_RAD: f64 = 0.002 * std::f64::consts::PI / 180.0;
/// Threshold and footprint of a scan differ from the run's by this, spot radii and 1.
const THRESHOLD_SPREAD: f64 = 0.06;
const FOOTPRINT_SPREAD: f64 = 0.005;
/// Blur of the bounds of an interval: this, m, and this share of the spot's radius on the face.
const SOFT_M: f64 = 0.0005;
const SOFT_SPOT: f64 = 0.05;
/// Edges with a larger spot on the face (grazing incidence) are left out, m.
const SPOT_LIMIT_M: f64 = 0.1;

/// An edge: `low <= row . deviation <= high`, blurred; for a measured one both bounds are the same
/// and the blur is its standard deviation.
#[derive(Clone, Debug)]
pub(super) struct Form {
    pub(super) row: DVector<f64>,
    pub(super) low: f64,
    pub(super) high: f64,
    pub(super) softness: f64,
    pub(super) measured: bool,
}

impl Form {
    /// Variance of its middle, if it is taken as a measurement.
    pub(super) fn variance(&self) -> f64 {
        let width = self.high - self.low;
        width * width / 12.0 + self.softness * self.softness
    }
}

/// A scan linearised: information and vector of everything Gaussian but the edges, in the deviations
/// of own unknowns and parameters from where they stand, and the edges.
pub(super) struct System {
    pub(super) information: DMatrix<f64>,
    pub(super) vector: DVector<f64>,
    pub(super) forms: Vec<Form>,
}

impl System {
    /// Adds one equation `row . deviation = value` of this standard deviation; `row` lists what is
    /// not zero.
    fn add(&mut self, row: &[(usize, f64)], value: f64, sigma: f64) {
        let weight = 1.0 / (sigma * sigma);
        for (i, a) in row {
            for (j, b) in row {
                self.information[(*i, *j)] += weight * a * b;
            }
            self.vector[*i] += weight * a * value;
        }
    }
}

/// Linearises a scan where its unknowns are `own` and the parameters `by`, which are in `frame`.
/// None where its lines cannot be used.
pub(super) fn linearise(
    observation: &Observation,
    frame: &Frame,
    by: &DVector<f64>,
    own: &Own,
    options: &Options,
) -> Option<System> {
    let layout = Layout {
        strips: frame.strips.len(),
    };
    let n = OWN + layout.count();
    let at = |which: usize| OWN + layout.other(which);
    let value = |which: usize| by[layout.other(which)];
    let mut system = System {
        information: DMatrix::zeros(n, n),
        vector: DVector::zeros(n),
        forms: Vec::with_capacity(observation.lines.edges.len()),
    };
    let pose = ScannerPose::new(frame, [own[0], own[1], own[2]], [own[3], own[4], own[5]]);
    add_lines(&mut system, observation, frame, own, value(SCALE), layout)?;

    system.add(
        &[(OWN_BIAS, 1.0), (at(BIAS), -1.0)],
        value(BIAS) - own[OWN_BIAS],
        options.bias_spread_m,
    );
    system.add(
        &[(OWN_THRESHOLD, 1.0), (at(THRESHOLD), -1.0)],
        options.threshold + value(THRESHOLD) - own[OWN_THRESHOLD],
        THRESHOLD_SPREAD,
    );
    system.add(
        &[(OWN_FOOTPRINT, 1.0), (at(FOOTPRINT), -1.0)],
        options.footprint_scale + value(FOOTPRINT) - own[OWN_FOOTPRINT],
        FOOTPRINT_SPREAD,
    );
    system.add(&[(YAW, 1.0)], -own[YAW], YAW_SIGMA_RAD);
    match options.x_constant_sigma_m {
        Some(sigma_m) => system.add(
            &[(X, 1.0), (at(X_CONSTANT), -1.0)],
            value(X_CONSTANT) - own[X],
            sigma_m,
        ),
        None => system.add(&[(X, 1.0)], -own[X], X_SIGMA_M),
    }
    // Attitude, of an instrument that is turned by a small angle against the scanner:
    // roll = measured - turn_x - turn_z pitch, pitch = measured - turn_y + turn_z roll.
    let turn = TURN.map(value);
    match observation.pitch {
        Some(pitch) => {
            let sigma = pitch.sigma_rad.max(ATTITUDE_FLOOR_RAD);
            let roll_rad = observation.roll_rad.unwrap_or(own[ROLL]);
            let predicted = pitch.rad - turn[1] + turn[2] * roll_rad;
            let row = [(PITCH, 1.0), (at(TURN[1]), 1.0), (at(TURN[2]), -roll_rad)];
            system.add(&row, predicted - own[PITCH], sigma);
            if let Some(roll_rad) = observation.roll_rad {
                let predicted = roll_rad - turn[0] - turn[2] * pitch.rad;
                let row = [(ROLL, 1.0), (at(TURN[0]), 1.0), (at(TURN[2]), pitch.rad)];
                system.add(&row, predicted - own[ROLL], sigma);
            }
        }
        None => system.add(&[(PITCH, 1.0)], -own[PITCH], PITCH_SIGMA_RAD),
    }
    add_edges(
        &mut system,
        observation,
        frame,
        own,
        &pose,
        options.footprint_scale,
        layout,
    );
    Some(system)
}

/// The three lines with the range bias.
fn add_lines(
    system: &mut System,
    observation: &Observation,
    frame: &Frame,
    own: &Own,
    scale: f64,
    layout: Layout,
) -> Option<()> {
    let state = joint::State::from_fn(|k, _| own.get(k).copied().unwrap_or(0.0));
    let (rows, mut residuals, weights) = joint::line_equations(&observation.lines, frame, &state)?;
    let n = OWN + layout.count();
    let mut full = DMatrix::zeros(LINE_ROWS, n);
    for row in 0..LINE_ROWS {
        for k in 0..=OWN_BIAS {
            full[(row, k)] = rows[(row, k)];
        }
    }
    for (k, line) in observation.lines.lines().into_iter().enumerate() {
        if !line.is_seen() {
            continue;
        }
        let row = 2 * k;
        let d_m = line.normal.d_m - residuals[row];
        residuals[row] -= scale * d_m;
        full[(row, OWN + layout.other(SCALE))] = d_m;
        // A wall that stands further out is a platform that is further from it.
        let (size, along, share) = [(DY, 1, -0.5), (DZ, 2, -1.0), (DY, 1, 0.5)][k];
        full[(row, OWN + layout.other(size))] = share * rows[(row, along)];
        for k in 0..6 {
            full[(row, k)] *= 1.0 + scale;
        }
    }
    let weights = DMatrix::from_fn(LINE_ROWS, LINE_ROWS, |i, j| weights[(i, j)]);
    let residuals = DVector::from_fn(LINE_ROWS, |i, _| residuals[i]);
    let weighted = full.transpose() * weights;
    system.information += &weighted * &full;
    system.vector += weighted * residuals;
    Some(())
}

/// The edges. g is the signed distance of a beam's crossing from the strip's boundary, along y on the
/// ceiling and z on a wall, positive before the edge (spec of [`joint`]).
fn add_edges(
    system: &mut System,
    observation: &Observation,
    frame: &Frame,
    own: &Own,
    pose: &ScannerPose,
    footprint_scale: f64,
    layout: Layout,
) {
    let mut before: Option<(usize, f64, f64)> = None;
    for (index, edge) in observation.lines.edges.iter().enumerate() {
        let change = observation.pitch_changes_rad.get(index).copied();
        let pitched = change.filter(|c| *c != 0.0).map(|change| {
            let rotation_rad = [own[3], own[4] + change, own[5]];
            ScannerPose::new(frame, [own[0], own[1], own[2]], rotation_rad)
        });
        let pose = pitched.as_ref().unwrap_or(pose);
        let Some(mut form) = form(edge, frame, pose, own, footprint_scale, layout) else {
            before = None;
            continue;
        };
        // Two edges of a strip share its level: what the first one tells of the second's error is
        // taken out.
        if form.measured
            && let Some((other, covariance, rate)) = before.take()
            && let Some(first) = system.forms.get(other)
        {
            let shared = covariance * rate * rate_of(edge, frame, pose).unwrap_or(0.0);
            let variance = first.softness * first.softness;
            let gain = shared / variance;
            let rest = form.softness * form.softness - gain * shared;
            if gain.is_finite() && rest > 0.1 * form.softness * form.softness {
                form.row -= gain * &first.row;
                form.low -= gain * first.low;
                form.high -= gain * first.high;
                form.softness = rest.sqrt();
            }
        }
        before = (form.measured && edge.cov_next_rad2 != 0.0)
            .then(|| {
                rate_of(edge, frame, pose).map(|r| (system.forms.len(), edge.cov_next_rad2, r))
            })
            .flatten();
        system.forms.push(form);
    }
}

/// Change of g over the angle at a measured edge, m/rad.
fn rate_of(edge: &Edge, frame: &Frame, pose: &ScannerPose) -> Option<f64> {
    let boundary = Boundary::of(edge, frame)?;
    let step = 1e-5;
    let [a, b] = [edge.edge_rad - step, edge.edge_rad + step].map(|r| pose.crossing(r, edge.face));
    Some((boundary.g(&b?) - boundary.g(&a?)) / (2.0 * step))
}

/// A strip's boundary as an edge crosses it.
struct Boundary {
    strip: usize,
    upper: bool,
    /// Sign of g: with growing beam angle v falls on ceiling and left wall, rises on the right wall.
    sign: f64,
    /// 1 is y, 2 is z.
    v: usize,
    offset_m: f64,
    slope: f64,
}

impl Boundary {
    fn of(edge: &Edge, frame: &Frame) -> Option<Boundary> {
        let index = usize::try_from(edge.strip).ok()?;
        let strip = frame.strips.get(index).filter(|s| s.face == edge.face)?;
        let upper = (edge.kind == EdgeKind::On) == (edge.face != Face::Right);
        let side = if upper { 0.5 } else { -0.5 };
        Some(Boundary {
            strip: index,
            upper,
            sign: if edge.face == Face::Right { -1.0 } else { 1.0 },
            v: if edge.face == Face::Upper { 1 } else { 2 },
            offset_m: strip.offset_m + side * strip.width_m,
            slope: strip.slope(),
        })
    }

    fn g(&self, c: &Crossing) -> f64 {
        self.sign * (c.point_m[self.v] - self.offset_m - self.slope * c.point_m[0])
    }

    /// Derivatives of g to own unknowns and parameters at a crossing.
    fn row(&self, c: &Crossing, face: Face, layout: Layout) -> DVector<f64> {
        let mut row = DVector::zeros(OWN + layout.count());
        let along = |d: &[f64; 3]| self.sign * (d[self.v] - self.slope * d[0]);
        for (k, d) in c.d_point.iter().enumerate() {
            row[k] = along(d);
        }
        row[OWN + layout.edge(self.strip, self.upper)] = -self.sign;
        let secant_sq = 1.0 + self.slope * self.slope;
        row[OWN + layout.inclination(self.strip)] = -self.sign * secant_sq * c.point_m[0];
        // A face further out is met further along the beam, as by a platform further from it.
        let (size, axis, share) = match face {
            Face::Right => (DY, 1, -0.5),
            Face::Upper => (DZ, 2, -1.0),
            Face::Left => (DY, 1, 0.5),
        };
        row[OWN + layout.other(size)] = share * row[axis];
        row
    }
}

/// An edge as a form; none where it belongs to no strip or says nothing.
fn form(
    edge: &Edge,
    frame: &Frame,
    pose: &ScannerPose,
    own: &Own,
    footprint_scale: f64,
    layout: Layout,
) -> Option<Form> {
    let boundary = Boundary::of(edge, frame)?;
    let from = pose.crossing(edge.from_rad, edge.face)?;
    let to = pose.crossing(edge.to_rad, edge.face)?;
    let (g_from, g_to) = (boundary.g(&from), boundary.g(&to));
    let rate = (g_to - g_from) / (edge.to_rad - edge.from_rad);
    let spot_m = (rate * edge.d_threshold).abs();
    if !(g_from > g_to && spot_m < SPOT_LIMIT_M) {
        return None;
    }
    let finite = |form: Form| form.row.iter().all(|r| r.is_finite()).then_some(form);
    if edge.edge_rad.is_finite() && edge.sigma_rad > 0.0 {
        let at = pose.crossing(edge.edge_rad, edge.face)?;
        let rate = rate_of(edge, frame, pose)?;
        let mut row = boundary.row(&at, edge.face, layout);
        // The estimate holds for the frame file's footprint; with another it lies elsewhere.
        let d_footprint = rate * edge.d_footprint;
        row[OWN_FOOTPRINT] = d_footprint;
        let value = -boundary.g(&at) - d_footprint * (own[OWN_FOOTPRINT] - footprint_scale);
        return finite(Form {
            row,
            low: value,
            high: value,
            softness: (rate * edge.sigma_rad).abs(),
            measured: true,
        });
    }
    let mut row =
        0.5 * (boundary.row(&from, edge.face, layout) + boundary.row(&to, edge.face, layout));
    let d_threshold = -rate * edge.d_threshold;
    row[OWN_THRESHOLD] = d_threshold;
    let shifted = d_threshold * own[OWN_THRESHOLD];
    finite(Form {
        row,
        low: -g_from - shifted,
        high: -g_to - shifted,
        softness: f64::hypot(SOFT_M, SOFT_SPOT * spot_m),
        measured: false,
    })
}
