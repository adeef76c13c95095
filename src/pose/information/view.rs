//! What a scan from one pose sees: its lines, its edges and the remissions along its strips, as
//! information on the state.

use super::{Fan, Remissions};
use crate::frame::{Crossing, Frame, Optics, ScannerPose, Strip, disc_share};
use crate::pose::joint::{self, STATE, Vector};
use crate::record::{Edge, EdgeKind, Face};
use nalgebra::{SMatrix, SVector};

/// Fewest beams that make a line.
const FEW: u32 = 8;
/// Beams beside an edge's spot whose remission counts (they tell the levels).
const BESIDE: f64 = 4.0;
/// The state, and a strip's level and background.
const LEVELS: usize = STATE + 2;

/// A scan from one pose.
pub(super) struct View<'a> {
    frame: &'a Frame,
    fan: &'a Fan,
    optics: Optics,
    pub(super) pose: ScannerPose,
    /// The pose as a state.
    pub(super) at: Vector,
}

impl<'a> View<'a> {
    pub(super) fn new(
        frame: &'a Frame,
        fan: &'a Fan,
        position_m: [f64; 3],
        rotation_rad: [f64; 3],
    ) -> View<'a> {
        let mut at = Vector::zeros();
        for k in 0..3 {
            at[k] = position_m[k];
            at[3 + k] = rotation_rad[k];
        }
        at[joint::FOOTPRINT] = frame.calibration.footprint_scale;
        View {
            frame,
            fan,
            optics: frame.scanner_model().optics,
            pose: ScannerPose::new(frame, position_m, rotation_rad),
            at,
        }
    }

    fn angle_rad(&self, beam: usize) -> f64 {
        self.fan.angle_min_rad + beam as f64 * self.fan.step_rad
    }

    /// The face that a beam meets first, and where.
    fn first(&self, angle_rad: f64) -> Option<(Face, Crossing)> {
        let crossings =
            Face::ALL.map(|face| self.pose.crossing(angle_rad, face).map(|c| (face, c)));
        crossings
            .into_iter()
            .flatten()
            .min_by(|a, b| a.1.range_m.total_cmp(&b.1.range_m))
    }

    /// Whether a point of a face is on a plate or a strip.
    fn is_hit(&self, face: Face, p: &[f64; 3]) -> bool {
        let within = |v: f64, [from, to]: [f64; 2]| v >= from && v <= to;
        let plate = |plate: &crate::frame::Plate| {
            plate.face == face && within(p[0], plate.x_m) && within(p[2], plate.z_m)
        };
        let v = p[along(face)];
        let strip = |(_, strip): (usize, &Strip)| {
            let off = v - strip.offset_m - p[0] * strip.slope();
            within(p[0], strip.x_span_m(&self.frame.bounds)) && off.abs() <= 0.5 * strip.width_m
        };
        self.frame.plates.iter().any(plate) || self.frame.strips_on(face).any(strip)
    }

    /// Information of the ranges, with a variance each: range = d / cos(angle - alpha) + bias.
    pub(super) fn lines(&self, variance: f64) -> Option<SMatrix<f64, STATE, STATE>> {
        let lines = Face::ALL.map(|face| self.pose.line(face));
        let mut sums = [SMatrix::<f64, 3, 3>::zeros(); 3];
        let mut points = [0u32; 3];
        for beam in 0..self.fan.count {
            let angle = self.angle_rad(beam);
            let Some((face, crossing)) = self.first(angle) else {
                continue;
            };
            if !self.is_hit(face, &crossing.point_m) {
                continue;
            }
            let k = face as usize;
            let (sin, cos) = (angle - lines[k].normal.alpha_rad).sin_cos();
            let row =
                SVector::<f64, 3>::new(1.0 / cos, -lines[k].normal.d_m * sin / (cos * cos), 1.0);
            sums[k] += row * row.transpose();
            points[k] += 1;
        }
        if points[1] < FEW || points[0].max(points[2]) < FEW {
            return None;
        }
        let mut information = SMatrix::zeros();
        for k in (0..3).filter(|k| points[*k] >= FEW) {
            let mut rows = SMatrix::<f64, 3, STATE>::zeros();
            for j in 0..6 {
                rows[(0, j)] = lines[k].d_d[j];
                rows[(1, j)] = lines[k].d_alpha[j];
            }
            rows[(2, joint::BIAS)] = 1.0;
            information += rows.transpose() * sums[k] * rows / variance;
        }
        Some(information)
    }

    /// The edges as ranges show them: between which two beams.
    pub(super) fn edges(&self) -> impl Iterator<Item = Edge> + '_ {
        self.frame
            .strips
            .iter()
            .enumerate()
            .flat_map(move |(index, strip)| {
                [EdgeKind::On, EdgeKind::Off]
                    .into_iter()
                    .filter_map(move |kind| self.edge(index, strip, kind))
            })
    }

    /// One edge; none where it is not seen or lies outside the strip's extent in x.
    fn edge(&self, index: usize, strip: &Strip, kind: EdgeKind) -> Option<Edge> {
        let mut edge = Edge {
            face: strip.face,
            strip: index as i32,
            kind,
            ..Edge::default()
        };
        let angle_rad = self.edge_rad(&edge)?;
        let beam = (angle_rad - self.fan.angle_min_rad) / self.fan.step_rad;
        if !(beam >= 0.0 && beam + 1.0 < self.fan.count as f64) {
            return None;
        }
        let before = beam.floor() as usize;
        edge.from_rad = self.angle_rad(before);
        edge.to_rad = self.angle_rad(before + 1);
        // Between both beams nothing else may be met first.
        for angle in [edge.from_rad, edge.to_rad] {
            self.first(angle).filter(|(face, _)| *face == strip.face)?;
        }
        let reach_rad = self.reach(&edge, strip, angle_rad)?.1;
        edge.d_threshold = if kind == EdgeKind::On {
            -reach_rad
        } else {
            reach_rad
        };
        Some(edge)
    }

    /// The angle of the beam that meets the edge (root of g).
    fn edge_rad(&self, edge: &Edge) -> Option<f64> {
        let boundary = joint::Boundary::of(edge, self.frame)?;
        let strip = self.frame.strips.get(edge.strip as usize)?;
        let mut angle = match edge.face {
            Face::Right => 0.0,
            Face::Upper => std::f64::consts::FRAC_PI_2,
            Face::Left => std::f64::consts::PI,
        };
        for _ in 0..30 {
            let crossing = self.pose.crossing(angle, edge.face)?;
            let rate = boundary.d_g(&crossing.d_angle);
            let step = (boundary.g_m(&crossing) / rate).clamp(-0.2, 0.2);
            angle -= step;
            if step.abs() < 1e-12 {
                let x = self.pose.crossing(angle, edge.face)?.point_m[0];
                let [from, to] = strip.x_span_m(&self.frame.bounds);
                return (x >= from && x <= to).then_some(angle);
            }
        }
        None
    }

    /// One spot radius across the edge at a beam: along v on the face, m, and as an angle, rad.
    fn reach(&self, edge: &Edge, strip: &Strip, angle_rad: f64) -> Option<(f64, f64)> {
        let crossing = self.pose.crossing(angle_rad, edge.face)?;
        let boundary = joint::Boundary::of(edge, self.frame)?;
        let radius_m =
            0.5 * self.optics.diameter_m(crossing.range_m) * self.frame.calibration.footprint_scale;
        let reach_m = radius_m * stretch(crossing.direction, strip.slope(), along(strip.face));
        Some((reach_m, reach_m / boundary.d_g(&crossing.d_angle).abs()))
    }

    /// An edge of a strip with the beams beside it, if it is seen.
    fn passage(&self, index: usize, strip: &Strip, kind: EdgeKind) -> Option<Passage> {
        let edge = self.edge(index, strip, kind)?;
        let angle_rad = self.edge_rad(&edge)?;
        let (_, reach_rad) = self.reach(&edge, strip, angle_rad)?;
        Some(Passage {
            boundary: joint::Boundary::of(&edge, self.frame)?,
            edge,
            angle_rad,
            beside_rad: reach_rad + BESIDE * self.fan.step_rad,
        })
    }

    /// Information of the remissions along a strip: level and background are eliminated.
    pub(super) fn strip(
        &self,
        index: usize,
        strip: &Strip,
        remissions: &Remissions,
    ) -> SMatrix<f64, STATE, STATE> {
        let kinds = [EdgeKind::On, EdgeKind::Off].into_iter();
        let passages: Vec<Passage> = kinds
            .filter_map(|kind| self.passage(index, strip, kind))
            .collect();
        let (first, last) = passages.iter().fold((f64::MAX, f64::MIN), |span, p| {
            (
                span.0.min(p.angle_rad - p.beside_rad),
                span.1.max(p.angle_rad + p.beside_rad),
            )
        });
        let mut total = SMatrix::<f64, LEVELS, LEVELS>::zeros();
        let from = ((first - self.fan.angle_min_rad) / self.fan.step_rad).max(0.0) as usize;
        for beam in from..self.fan.count {
            let angle = self.angle_rad(beam);
            if angle > last {
                break;
            }
            let near = |p: &Passage| (angle - p.angle_rad).abs() <= p.beside_rad;
            let Some((face, crossing)) = self.first(angle) else {
                continue;
            };
            if face != strip.face || !passages.iter().any(near) {
                continue;
            }
            let (share, mut row) = self.share(strip, &passages, angle, &crossing);
            let level = remissions.contrast + (1.0 - remissions.contrast) * share;
            row *= 1.0 - remissions.contrast;
            row[STATE] = share;
            row[STATE + 1] = 1.0 - share;
            total += row * row.transpose() / remissions.variance(level);
        }
        // The levels: nothing is known of them (a weak prior keeps the inverse).
        let levels = total.fixed_view::<2, 2>(STATE, STATE) + SMatrix::identity() * 1e-6;
        let cross = total.fixed_view::<STATE, 2>(0, STATE);
        let own = total.fixed_view::<STATE, STATE>(0, 0);
        match levels.try_inverse() {
            Some(inverse) => own - cross * inverse * cross.transpose(),
            None => SMatrix::zeros(),
        }
    }

    /// Share of a beam's spot that is on a strip, F(on) - F(off) (an edge that is not seen is far
    /// away), and its derivatives to the state. The threshold has no part in it.
    fn share(
        &self,
        strip: &Strip,
        passages: &[Passage],
        angle_rad: f64,
        crossing: &Crossing,
    ) -> (f64, SVector<f64, LEVELS>) {
        let mut share = 1.0;
        let mut row = SVector::zeros();
        for Passage { edge, boundary, .. } in passages {
            let Some((reach_m, _)) = self.reach(edge, strip, angle_rad) else {
                continue;
            };
            // g falls while the beams pass: behind the edge q is positive.
            let q = -boundary.g_m(crossing) / reach_m;
            let (passed, slope) = disc_share(q);
            let slope = match edge.kind {
                EdgeKind::On => {
                    share -= 1.0 - passed;
                    slope
                }
                EdgeKind::Off => {
                    share -= passed;
                    -slope
                }
            };
            for (k, d) in crossing.d_point.iter().enumerate() {
                row[k] -= slope * boundary.d_g(d) / reach_m;
            }
            row[joint::FOOTPRINT] -= slope * q / self.frame.calibration.footprint_scale;
        }
        (share.clamp(0.0, 1.0), row)
    }
}

/// An edge of a strip as the beams pass it.
struct Passage {
    edge: Edge,
    boundary: joint::Boundary,
    angle_rad: f64,
    /// Beams no further off tell of it, rad.
    beside_rad: f64,
}

/// The axis of a face along which a strip's width is measured.
fn along(face: Face) -> usize {
    if face == Face::Upper { 1 } else { 2 }
}

/// Length along v on the face of one unit across the beam, measured from an edge of this slope:
/// sqrt(h^2 + D^2) / (h cos gamma) on the ceiling, D the distance from the foot point to the edge.
fn stretch(u: [f64; 3], slope: f64, v: usize) -> f64 {
    let mut e = [1.0, 0.0, 0.0];
    e[v] = slope;
    let normal = [
        u[1] * e[2] - u[2] * e[1],
        u[2] * e[0] - u[0] * e[2],
        u[0] * e[1] - u[1] * e[0],
    ];
    let length = normal.iter().map(|n| n * n).sum::<f64>().sqrt();
    length / normal[v].abs().max(1e-9)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stretch_is_the_closed_form_of_the_ceiling() {
        let gamma = 30f64.to_radians();
        for (y, h) in [(0.0, 2.0), (3.0, 2.0), (-1.5, 4.0)] {
            let norm = f64::hypot(y, h);
            let distance = y * gamma.cos();
            let expected = f64::hypot(h, distance) / (h * gamma.cos());
            let found = stretch([0.0, y / norm, h / norm], gamma.tan(), 1);
            assert!((found - expected).abs() < 1e-12);
        }
    }
}
