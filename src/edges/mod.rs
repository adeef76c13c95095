//! Strip edges from a scan and its reflector lines.
//!
//! On a face that carries strips every beam is a hit (it returned from the face's line), a gap (it
//! went on to the surface behind), or neither. Between the last sure beam of one kind and the first
//! of the other lies an edge: its interval. Mixed pixels, cables and cargo only make an interval
//! longer, never wrong. Each edge is then given the strip that it belongs to.

mod association;

use crate::frame::Frame;
use crate::record::{BeamTable, Edge, EdgeKind, Face, NormalLine, ReflectorLines, Scan};
use association::Association;

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

/// A gap beam shares its depth behind the face with one of so many beams on either side, to within
/// this share of the gap.
const SUPPORT_BEAMS: usize = 4;
const SUPPORT_SHARE: f64 = 0.15;

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

/// Measures the strip edges, scan after scan.
#[derive(Clone, Debug)]
pub struct EdgeMeter {
    frame: Frame,
    beams: BeamTable,
    states: Vec<Beam>,
    /// How far behind the face's line a beam went, and the surface behind is, m.
    behind_m: Vec<(f64, f64)>,
    found: Vec<Edge>,
    /// Angles of the first and last mixed pixel within each found edge's interval, rad.
    mixed: Vec<Option<(f64, f64)>>,
    association: Association,
}

impl EdgeMeter {
    /// A meter for scans taken in `frame`.
    pub fn new(frame: &Frame) -> EdgeMeter {
        EdgeMeter {
            frame: frame.clone(),
            beams: BeamTable::default(),
            states: Vec::new(),
            behind_m: Vec::new(),
            found: Vec::new(),
            mixed: Vec::new(),
            association: Association::new(frame),
        }
    }

    /// Finds the edges of `scan` on the faces whose lines are known and puts them into `lines`.
    pub fn measure(&mut self, scan: &Scan, lines: &mut ReflectorLines) {
        self.beams.fit_moving(scan, lines.motion());
        self.found.clear();
        self.mixed.clear();
        let faces = [Face::Right, Face::Upper, Face::Left];
        for (k, face) in faces.into_iter().enumerate() {
            if lines.lines()[k].is_seen() && self.frame.strips_on(face).next().is_some() {
                self.classify(scan, lines, k);
                self.transitions(face, &lines.lines()[k].normal);
            }
        }
        self.association.assign(&self.frame, lines, &mut self.found);
        self.tighten();
        lines.edges.clear();
        lines.edges.extend_from_slice(&self.found);
    }

    /// Draws an interval that holds mixed pixels closer around them.
    fn tighten(&mut self) {
        for (edge, mixed) in self.found.iter_mut().zip(&self.mixed) {
            let Some((first_rad, last_rad)) = *mixed else {
                continue;
            };
            let reach_rad = MIXED_REACH * edge.d_threshold.abs();
            if edge.strip < 0 || !(reach_rad > 0.0) {
                continue;
            }
            let from_rad = edge.from_rad.max(last_rad - reach_rad);
            let to_rad = edge.to_rad.min(first_rad + reach_rad);
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
        self.states.clear();
        self.behind_m.clear();
        let rays = self.beams.cos_sin.iter().zip(scan.ranges_m.iter());
        for (i, ((cos, sin), range_m)) in rays.enumerate() {
            let (y_m, z_m) = self.beams.origin_m(i);
            let mut nearest = f64::NEG_INFINITY;
            let mut nearest_behind = f64::NEG_INFINITY;
            let mut own = f64::NEG_INFINITY;
            for (j, normal) in normals.iter().enumerate() {
                let Some((y, z, d_m)) = normal else { continue };
                let along = cos * y + sin * z;
                // A moving scanner's beam starts nearer to the line or further from it.
                let d_m = d_m - (y_m * y + z_m * z);
                let inverse = along / d_m;
                nearest = nearest.max(inverse);
                if j == k {
                    own = inverse;
                }
                nearest_behind = nearest_behind.max(along / (d_m + gap_m.unwrap_or(0.0)));
            }
            if own < nearest || own <= 0.0 {
                self.states.push(Beam::Unknown);
                self.behind_m.push((f64::NAN, f64::NAN));
                continue;
            }
            let face_m = 1.0 / own;
            let e = (range_m - bias_m) * scale - face_m;
            let depth_m = 1.0 / nearest_behind - face_m;
            self.behind_m.push((e, depth_m));
            self.states.push(match gap_m {
                _ if e.abs() <= tolerance_m => Beam::Hit,
                _ if range_m.is_nan() || e < 0.0 => Beam::Unknown,
                Some(_) if *range_m == f64::INFINITY => Beam::Unknown,
                None => Beam::Gap,
                Some(_) if e >= GAP_SHARE * depth_m => Beam::Gap,
                Some(_) => Beam::Mixed,
            });
        }
        self.drop_unsupported();
        self.drop_contradictions();
        if gap_m.is_some() {
            self.mark_short(fitted[k].rms_m);
        }
    }

    /// Finds mixed pixels that reach almost to the surface behind. Where that surface really is,
    /// the gap beams further from the hit tell (it need not be exactly the frame file's gap away).
    fn mark_short(&mut self, sigma_m: f64) {
        let n = self.states.len();
        let tolerance_m = (SHORT_SIGMA * sigma_m).max(SHORT_MIN_M);
        for i in 0..n {
            if self.states[i] != Beam::Gap {
                continue;
            }
            for inward in [1isize, -1] {
                let at = |k: isize| i.checked_add_signed(k * inward).filter(|j| *j < n);
                let hit_near = [-1, -2]
                    .into_iter()
                    .any(|k| at(k).is_some_and(|j| self.states[j] == Beam::Hit));
                if !hit_near {
                    continue;
                }
                let mut count = 0.0;
                let mut sum = 0.0;
                for j in (2..6)
                    .filter_map(at)
                    .take_while(|j| self.states[*j] == Beam::Gap)
                {
                    sum += self.behind_m[j].0 / self.behind_m[j].1;
                    count += 1.0;
                }
                let (e, depth_m) = self.behind_m[i];
                if count >= 2.0 && e < sum / count * depth_m - tolerance_m {
                    self.states[i] = Beam::Mixed;
                }
            }
        }
    }

    /// A gap beam whose depth none of its gap neighbours shares did not meet the surface behind: a
    /// wild range that stands for a hit as well as for a gap.
    fn drop_unsupported(&mut self) {
        let ratio = |i: usize| self.behind_m[i].0 / self.behind_m[i].1;
        for i in 0..self.states.len() {
            if self.states[i] != Beam::Gap {
                continue;
            }
            let around =
                i.saturating_sub(SUPPORT_BEAMS)..self.states.len().min(i + SUPPORT_BEAMS + 1);
            let (mut others, mut supported) = (0, false);
            for j in around.filter(|j| *j != i && self.states[*j] == Beam::Gap) {
                others += 1;
                supported |= (ratio(i) - ratio(j)).abs() < SUPPORT_SHARE;
            }
            if others >= 2 && !supported {
                self.states[i] = Beam::Unknown;
            }
        }
    }

    /// A beam that three of its four neighbours contradict and none supports is not trusted.
    fn drop_contradictions(&mut self) {
        let n = self.states.len();
        let opposite = |a: Beam, b: Beam| {
            (a == Beam::Hit && b == Beam::Gap) || (a == Beam::Gap && b == Beam::Hit)
        };
        // Neighbours are judged as they were found: two beams back and one back before any change.
        let (mut back2, mut back1) = (Beam::Unknown, Beam::Unknown);
        for i in 0..n {
            let here = self.states[i];
            if matches!(here, Beam::Hit | Beam::Gap) {
                let ahead = |k: usize| self.states.get(i + k).copied().unwrap_or(Beam::Unknown);
                let around = [back2, back1, ahead(1), ahead(2)];
                let against = around.iter().filter(|b| opposite(here, **b)).count();
                if against >= 3 && !around.contains(&here) {
                    self.states[i] = Beam::Unknown;
                }
            }
            (back2, back1) = (back1, here);
        }
    }

    /// An edge wherever the last sure state changes.
    fn transitions(&mut self, face: Face, normal: &NormalLine) {
        let line = components(normal);
        let (beams, found, all_mixed) = (&self.beams, &mut self.found, &mut self.mixed);
        // Angles are those under which the scanner at the reference instant sees the face's points.
        let seen_rad = |i: usize| beams.seen_rad(i, range_on(beams, i, line));
        let mut last: Option<(usize, Beam)> = None;
        let mut mixed: Option<(usize, usize)> = None;
        for (i, state) in self.states.iter().enumerate() {
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
                found.push(Edge {
                    face,
                    kind: if *state == Beam::Hit {
                        EdgeKind::On
                    } else {
                        EdgeKind::Off
                    },
                    from_rad: seen_rad(before),
                    to_rad: seen_rad(i),
                    time_s: beams.time_at_s(0.5 * (beams.angle_rad(before) + beams.angle_rad(i))),
                    ..Edge::default()
                });
                all_mixed.push(mixed.map(|(first, last)| (seen_rad(first), seen_rad(last))));
            }
            last = Some((i, *state));
            mixed = None;
        }
    }
}

/// cos(alpha), sin(alpha), d of a line.
fn components(normal: &NormalLine) -> (f64, f64, f64) {
    let (sin, cos) = normal.alpha_rad.sin_cos();
    (cos, sin, normal.d_m)
}

/// Range at which beam `i` meets a line given by its components, m.
fn range_on(beams: &BeamTable, i: usize, (cos, sin, d_m): (f64, f64, f64)) -> f64 {
    let ((y_m, z_m), (u, v)) = (beams.origin_m(i), beams.cos_sin[i]);
    (d_m - (y_m * cos + z_m * sin)) / (u * cos + v * sin)
}

#[cfg(test)]
mod tests;
