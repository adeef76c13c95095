//! Strip edges from a scan and its reflector lines.
//!
//! On a face that carries strips every beam is a hit (it returned from the face's line), a gap (it
//! went on to the surface behind), or neither. Between the last sure beam of one kind and the first
//! of the other lies an edge: its interval. Mixed pixels, cables and cargo only make an interval
//! longer, never wrong. Each edge is then given the strip that it belongs to.

mod association;
mod photometer;
mod photometry;

use crate::frame::Frame;
use crate::record::{BeamTable, Edge, EdgeKind, Face, NormalLine, ReflectorLines, Scan};
use association::Association;
use photometer::{Photometer, View};
use std::f64::consts::FRAC_PI_2;

/// A hit lies within this many sigma of the line.
const HIT_SIGMA: f64 = 4.0;
/// And within at least this, m.
const HIT_MIN_M: f64 = 0.020;
/// A gap is at least this share of the way to the surface behind.
const GAP_SHARE: f64 = 0.85;

/// A gap beam beside a hit is a mixed pixel if it falls short of where its neighbours further in
/// put the surface behind by more than this many sigma, and at least this, m.
const SHORT_SIGMA: f64 = 4.0;
const SHORT_MIN_M: f64 = 0.030;
/// A mixed pixel's range is pulled out of both tolerances only if its spot covers both surfaces by
/// some per cent; then its centre is within this many spot radii of the edge.
const MIXED_REACH: f64 = 0.85;

/// What a beam met.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Beam {
    /// The face's line.
    Hit,
    /// The surface behind, or nothing where nothing is behind.
    Gap,
    /// Something in between: a mixed pixel.
    Mixed,
    /// No echo, or something in front.
    Unknown,
}

/// An edge with the beams that it was found at.
#[derive(Clone, Copy, Debug)]
struct Found {
    edge: Edge,
    /// The last sure beam before it and the first behind it.
    beams: (usize, usize),
    /// First and last mixed pixel between the two.
    mixed: Option<(usize, usize)>,
}

/// Measures the strip edges, scan after scan.
#[derive(Clone, Debug)]
pub struct EdgeMeter {
    frame: Frame,
    beams: BeamTable,
    /// What the beams met on each face.
    states: [Vec<Beam>; 3],
    /// How far behind the face's line a beam went, and the surface behind is, m.
    behind_m: Vec<(f64, f64)>,
    found: Vec<Found>,
    association: Association,
    photometer: Photometer,
}

impl EdgeMeter {
    /// A meter for scans taken in `frame`.
    pub fn new(frame: &Frame) -> EdgeMeter {
        EdgeMeter {
            frame: frame.clone(),
            beams: BeamTable::default(),
            states: Default::default(),
            behind_m: Vec::new(),
            found: Vec::new(),
            association: Association::new(frame),
            photometer: Photometer::new(frame),
        }
    }

    /// Finds the edges of `scan` on the faces whose lines are known and puts them into `lines`.
    pub fn measure(&mut self, scan: &Scan, lines: &mut ReflectorLines) {
        self.beams.fit(scan);
        self.found.clear();
        let faces = [Face::Right, Face::Upper, Face::Left];
        for (k, face) in faces.into_iter().enumerate() {
            if lines.lines()[k].is_seen() && self.frame.strips_on(face).next().is_some() {
                self.classify(scan, lines, k);
                self.transitions(k, face);
            }
        }
        let reference = (FRAC_PI_2 - scan.angle_min_rad) / scan.angle_increment_rad;
        for Found { edge, .. } in &mut self.found {
            let index = (0.5 * (edge.from_rad + edge.to_rad) - scan.angle_min_rad)
                / scan.angle_increment_rad;
            edge.time_s = (index - reference) * scan.time_increment_s;
        }
        let pose = self.association.assign(&self.frame, lines, &mut self.found);
        self.tighten(scan);
        if let Some(pose) = pose {
            let view = View {
                scan,
                beams: &self.beams,
                lines,
                states: &self.states,
                pose: &pose,
            };
            self.photometer.measure(&self.frame, &view, &mut self.found);
        }
        lines.edges.clear();
        lines
            .edges
            .extend(self.found.iter().map(|found| found.edge));
    }

    /// Draws an interval that holds mixed pixels closer around them.
    fn tighten(&mut self, scan: &Scan) {
        for Found { edge, mixed, .. } in &mut self.found {
            let Some((first, last)) = *mixed else {
                continue;
            };
            let reach_rad = MIXED_REACH * edge.d_threshold.abs();
            if edge.strip < 0 || !(reach_rad > 0.0) {
                continue;
            }
            let from_rad = edge.from_rad.max(scan.angle_rad(last) - reach_rad);
            let to_rad = edge.to_rad.min(scan.angle_rad(first) + reach_rad);
            if from_rad < to_rad {
                (edge.from_rad, edge.to_rad) = (from_rad, to_rad);
            }
        }
    }

    /// Gives every beam its state for face `k`; beams that meet another face first stay outside
    /// by being unknown at the run's ends.
    fn classify(&mut self, scan: &Scan, lines: &ReflectorLines, k: usize) {
        let fitted = lines.lines();
        let normals: [Option<(f64, f64, f64)>; 3] =
            [0, 1, 2].map(|j| fitted[j].is_seen().then(|| components(&fitted[j].normal)));
        let gap_m = self.frame.bounds.background_gap_m;
        let tolerance_m = (HIT_SIGMA * fitted[k].rms_m).clamp(HIT_MIN_M, 0.06);
        let (bias_m, scale) = (
            self.frame.calibration.range_bias_m,
            1.0 / self.frame.calibration.range_scale,
        );
        let bias_m = bias_m + lines.range_bias_m * self.frame.calibration.range_scale;
        let states = &mut self.states[k];
        states.clear();
        self.behind_m.clear();
        for ((cos, sin), range_m) in self.beams.cos_sin.iter().zip(scan.ranges_m.iter()) {
            let mut nearest = f64::NEG_INFINITY;
            let mut nearest_behind = f64::NEG_INFINITY;
            let mut own = f64::NEG_INFINITY;
            for (j, normal) in normals.iter().enumerate() {
                let Some((y, z, d_m)) = normal else { continue };
                let along = cos * y + sin * z;
                let inverse = along / d_m;
                nearest = nearest.max(inverse);
                if j == k {
                    own = inverse;
                }
                nearest_behind = nearest_behind.max(along / (d_m + gap_m.unwrap_or(0.0)));
            }
            if own < nearest || own <= 0.0 {
                states.push(Beam::Unknown);
                self.behind_m.push((f64::NAN, f64::NAN));
                continue;
            }
            let face_m = 1.0 / own;
            let e = (range_m - bias_m) * scale - face_m;
            let depth_m = 1.0 / nearest_behind - face_m;
            self.behind_m.push((e, depth_m));
            states.push(match gap_m {
                _ if e.abs() <= tolerance_m => Beam::Hit,
                _ if range_m.is_nan() || e < 0.0 => Beam::Unknown,
                Some(_) if *range_m == f64::INFINITY => Beam::Unknown,
                None => Beam::Gap,
                Some(_) if e >= GAP_SHARE * depth_m => Beam::Gap,
                Some(_) => Beam::Mixed,
            });
        }
        drop_contradictions(states);
        if gap_m.is_some() {
            mark_short(states, &self.behind_m, fitted[k].rms_m);
        }
    }

    /// An edge wherever the last sure state changes.
    fn transitions(&mut self, k: usize, face: Face) {
        let mut last: Option<(usize, Beam)> = None;
        let mut mixed: Option<(usize, usize)> = None;
        for (i, state) in self.states[k].iter().enumerate() {
            match state {
                Beam::Hit | Beam::Gap => {}
                Beam::Mixed => {
                    mixed = Some((mixed.map_or(i, |(first, _)| first), i));
                    continue;
                }
                Beam::Unknown => continue,
            }
            if let Some((before, kind)) = last
                && kind != *state
            {
                let kind = if *state == Beam::Hit {
                    EdgeKind::On
                } else {
                    EdgeKind::Off
                };
                self.found.push(Found {
                    edge: Edge {
                        face,
                        kind,
                        from_rad: self.beams.angle_rad(before),
                        to_rad: self.beams.angle_rad(i),
                        ..Edge::default()
                    },
                    beams: (before, i),
                    mixed,
                });
            }
            last = Some((i, *state));
            mixed = None;
        }
    }
}

/// Finds mixed pixels that reach almost to the surface behind. Where that surface really is,
/// the gap beams further from the hit tell (it need not be exactly the frame file's gap away).
fn mark_short(states: &mut [Beam], behind_m: &[(f64, f64)], sigma_m: f64) {
    let n = states.len();
    let tolerance_m = (SHORT_SIGMA * sigma_m).max(SHORT_MIN_M);
    for i in 0..n {
        if states[i] != Beam::Gap {
            continue;
        }
        for inward in [1isize, -1] {
            let at = |k: isize| i.checked_add_signed(k * inward).filter(|j| *j < n);
            let hit_near = [-1, -2]
                .into_iter()
                .any(|k| at(k).is_some_and(|j| states[j] == Beam::Hit));
            if !hit_near {
                continue;
            }
            let mut count = 0.0;
            let mut sum = 0.0;
            for j in (2..6)
                .filter_map(at)
                .take_while(|j| states[*j] == Beam::Gap)
            {
                sum += behind_m[j].0 / behind_m[j].1;
                count += 1.0;
            }
            let (e, depth_m) = behind_m[i];
            if count >= 2.0 && e < sum / count * depth_m - tolerance_m {
                states[i] = Beam::Mixed;
            }
        }
    }
}

/// A beam that three of its four neighbours contradict and none supports is not trusted.
fn drop_contradictions(states: &mut [Beam]) {
    let n = states.len();
    let opposite =
        |a: Beam, b: Beam| (a == Beam::Hit && b == Beam::Gap) || (a == Beam::Gap && b == Beam::Hit);
    // Neighbours are judged as they were found: two beams back and one back before any change.
    let (mut back2, mut back1) = (Beam::Unknown, Beam::Unknown);
    for i in 0..n {
        let here = states[i];
        if matches!(here, Beam::Hit | Beam::Gap) {
            let ahead = |k: usize| states.get(i + k).copied().unwrap_or(Beam::Unknown);
            let around = [back2, back1, ahead(1), ahead(2)];
            let against = around.iter().filter(|b| opposite(here, **b)).count();
            if against >= 3 && !around.contains(&here) {
                states[i] = Beam::Unknown;
            }
        }
        (back2, back1) = (back1, here);
    }
}

/// cos(alpha), sin(alpha), d of a line.
fn components(normal: &NormalLine) -> (f64, f64, f64) {
    let (sin, cos) = normal.alpha_rad.sin_cos();
    (cos, sin, normal.d_m)
}

#[cfg(test)]
mod tests;
