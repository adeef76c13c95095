//! What one scan says of its pose and of the parameters, linearised.

use super::super::joint::{self, Boundary, WhiteLines};
use super::parameters::{BIAS, DY, DZ, FOOTPRINT, Layout, SCALE, THRESHOLD, TURN, X_CONSTANT};
use super::{Observation, Options};
use crate::frame::{Crossing, Frame, ScannerPose};
use crate::record::{Edge, EdgeKind, Face};
use nalgebra::{DMatrix, DVector};

/// Line parameters and the bias.
const LINE_ROWS: usize = 7;
/// A scan's own unknowns: x, y, z, roll, pitch, yaw, range bias, threshold, footprint scale.
pub(super) const OWN: usize = joint::STATE;
pub(super) const X: usize = joint::X;
const ROLL: usize = joint::ROLL;
const PITCH: usize = joint::PITCH;
const YAW: usize = joint::YAW;
const OWN_BIAS: usize = joint::BIAS;
const OWN_THRESHOLD: usize = joint::THRESHOLD;
const OWN_FOOTPRINT: usize = joint::FOOTPRINT;
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
    add_lines(&mut system, observation, &pose, own, value(SCALE), layout)?;

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
    pose: &ScannerPose,
    own: &Own,
    scale: f64,
    layout: Layout,
) -> Option<()> {
    let lines = &observation.lines;
    let white = WhiteLines::new(lines)?;
    let (rows, mut residuals) = white.equations(lines, pose, &joint::Vector::from(*own));
    // In the parameters: the frame's size and the range scale move distances.
    let mut shared = DMatrix::zeros(LINE_ROWS, layout.count());
    for (k, face) in Face::ALL.into_iter().enumerate() {
        if !white.known[2 * k] {
            continue;
        }
        let line = pose.line(face);
        let (size, along, share) = size_of(face);
        shared[(2 * k, layout.other(size))] = share * line.d_d[along];
        shared[(2 * k, layout.other(SCALE))] = line.normal.d_m;
    }
    let scaled = shared.column(layout.other(SCALE)) * scale;
    residuals -= white.whitener * nalgebra::SVector::<f64, LINE_ROWS>::from_fn(|k, _| scaled[k]);
    let shared = DMatrix::from_fn(LINE_ROWS, LINE_ROWS, |i, j| white.whitener[(i, j)]) * shared;
    let n = OWN + layout.count();
    for k in (0..LINE_ROWS).filter(|k| white.known[*k]) {
        let row = DVector::from_fn(n, |j, _| match j {
            j if j < OWN => rows[(k, j)],
            j => shared[(k, j - OWN)],
        });
        system.information.ger(1.0, &row, &row, 1.0);
        system.vector.axpy(residuals[k], &row, 1.0);
    }
    Some(())
}

/// Which size of the box a face's place depends on, the axis of the platform's place to which that
/// is opposite, and the share: a face further out is a platform that is further from it.
fn size_of(face: Face) -> (usize, usize, f64) {
    match face {
        Face::Right => (DY, 1, -0.5),
        Face::Upper => (DZ, 2, -1.0),
        Face::Left => (DY, 1, 0.5),
    }
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
    let crossing = pose.crossing(edge.edge_rad, edge.face)?;
    Some(Boundary::of(edge, frame)?.d_g(&crossing.d_angle))
}

/// Derivatives of g to own unknowns and parameters at a crossing.
fn row(
    boundary: &Boundary,
    edge: &Edge,
    strip: usize,
    c: &Crossing,
    layout: Layout,
) -> DVector<f64> {
    let mut row = DVector::zeros(OWN + layout.count());
    for (k, d) in c.d_point.iter().enumerate() {
        row[k] = boundary.d_g(d);
    }
    let upper = (edge.kind == EdgeKind::On) == (edge.face != Face::Right);
    row[OWN + layout.edge(strip, upper)] = -boundary.sign;
    let secant_sq = 1.0 + boundary.slope * boundary.slope;
    row[OWN + layout.inclination(strip)] = -boundary.sign * secant_sq * c.point_m[0];
    // A face further out is met further along the beam, as by a platform further from it.
    let (size, axis, share) = size_of(edge.face);
    row[OWN + layout.other(size)] = share * row[axis];
    row
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
    let strip = usize::try_from(edge.strip).ok()?;
    let row = |c: &Crossing| row(&boundary, edge, strip, c, layout);
    let from = pose.crossing(edge.from_rad, edge.face)?;
    let to = pose.crossing(edge.to_rad, edge.face)?;
    let (g_from, g_to) = (boundary.g_m(&from), boundary.g_m(&to));
    let rate = (g_to - g_from) / (edge.to_rad - edge.from_rad);
    let spot_m = (rate * edge.d_threshold).abs();
    if !(g_from > g_to && spot_m < SPOT_LIMIT_M) {
        return None;
    }
    let finite = |form: Form| form.row.iter().all(|r| r.is_finite()).then_some(form);
    if edge.edge_rad.is_finite() && edge.sigma_rad > 0.0 {
        let at = pose.crossing(edge.edge_rad, edge.face)?;
        let rate = boundary.d_g(&at.d_angle);
        let mut row = row(&at);
        // The estimate holds for the frame file's footprint; with another it lies elsewhere.
        let d_footprint = rate * edge.d_footprint;
        row[OWN_FOOTPRINT] = d_footprint;
        let value = -boundary.g_m(&at) - d_footprint * (own[OWN_FOOTPRINT] - footprint_scale);
        return finite(Form {
            row,
            low: value,
            high: value,
            softness: (rate * edge.sigma_rad).abs(),
            measured: true,
        });
    }
    let mut row = 0.5 * (row(&from) + row(&to));
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
