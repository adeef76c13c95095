//! Which strip an edge belongs to.
//!
//! y, z and roll are known from the lines; x and yaw are searched coarsely (Kurniawan 2017 knows
//! them by counting, which fails as soon as one edge is missing), then refined by least squares on
//! the middles of the intervals while the tolerance shrinks. Pitch is not known here: on the
//! ceiling it acts as a shift of x; with strips on the side walls it is refined too.

use super::Found;
use super::footprint::{Slant, Spot};
use crate::frame::{Frame, ScannerPose, Strip};
use crate::record::{EdgeKind, Face, ReflectorLines};
use nalgebra::{Matrix3, Vector3};

/// Search range and steps.
const X_MAX_M: f64 = 0.5;
const X_STEP_M: f64 = 0.05;
const YAW_MAX_RAD: f64 = 6.0 * std::f64::consts::PI / 180.0;
const YAW_STEP_RAD: f64 = 0.5 * std::f64::consts::PI / 180.0;
const PITCH_STEP_RAD: f64 = 1.2 * std::f64::consts::PI / 180.0;
/// How many peaks of the vote are refined.
const CANDIDATES: usize = 6;
/// Tolerance of the vote, m.
const VOTE_M: f64 = 0.09;
/// Tolerances of the association as the estimate improves, m.
const TOLERANCES_M: [f64; 4] = [0.12, 0.06, 0.03, 0.02];
/// The pose lies on the lines when a step moves no edge by more; edges are about so far away, m.
const ON_LINES_M: f64 = 2e-4;
const REACH_M: f64 = 5.0;
/// What an edge that is met exactly is worth: three sigma squared.
const WORTH: f64 = 9.0;
/// The scan before needs no second opinion if this share of all edges is explained, and of so many
/// at least.
const SURE: f64 = 0.6;
const SURE_EDGES: usize = 6;
/// Prior standard deviations of x, yaw and pitch.
const PRIOR: [f64; 3] = [0.3, 0.14, 0.035];

/// One boundary line of a strip.
#[derive(Clone, Copy, Debug)]
struct Boundary {
    face: Face,
    strip: usize,
    kind: EdgeKind,
    /// Offset of the boundary at x = 0, m.
    offset_m: f64,
    slope: f64,
}

#[derive(Clone, Debug)]
pub(super) struct Association {
    boundaries: Vec<Boundary>,
    spot: Spot,
    /// Whether strips on the sides make pitch observable.
    with_pitch: bool,
    /// The scanner on a platform, to be moved.
    mounted: ScannerPose,
    /// y, z and roll of the pose that was looked at last.
    on_lines: [f64; 3],
    /// x, yaw, pitch of the scan before.
    last: Option<[f64; 3]>,
    middles: Vec<Middle>,
    taken: Vec<Option<(usize, f64)>>,
}

/// The middle of an edge's interval, seen from an assumed pose.
#[derive(Clone, Copy, Debug)]
struct Middle {
    /// Coordinates on the face: x, and y or z, m.
    x_m: f64,
    v_m: f64,
    /// Half the interval along v, m.
    half_m: f64,
    /// Derivatives of x and v to x, yaw, pitch of the platform.
    d_x: [f64; 3],
    d_v: [f64; 3],
}

impl Association {
    pub(super) fn new(frame: &Frame) -> Association {
        let boundaries = frame
            .strips
            .iter()
            .enumerate()
            .flat_map(|(i, strip)| boundaries(i, strip));
        Association {
            boundaries: boundaries.collect(),
            spot: Spot::new(frame),
            with_pitch: frame.strips.iter().any(|strip| strip.face != Face::Upper),
            mounted: ScannerPose::new(frame, [0.0; 3], [0.0; 3]),
            on_lines: [0.0, frame.bounds.dz_m / 2.0, 0.0],
            last: None,
            middles: Vec::new(),
            taken: Vec::new(),
        }
    }

    /// Sets `strip` and the threshold's derivative of each edge.
    /// Returns the pose that explains them, which is good enough to say how the edges are slanted;
    /// none where it does not.
    pub(super) fn assign(
        &mut self,
        frame: &Frame,
        lines: &ReflectorLines,
        edges: &mut [Found],
    ) -> Option<ScannerPose> {
        if edges.is_empty() {
            return None;
        }
        let start = self.last.take();
        let mut at = start.unwrap_or_default();
        let mut best = f64::NEG_INFINITY;
        // Enough edges that fit leave no room for another explanation; a few do.
        let sure = SURE * WORTH * edges.len().max(SURE_EDGES) as f64;
        if start.is_some() {
            best = self.refine(lines, edges, &mut at, TOLERANCES_M.len() - 1);
            // Poses that jump need more than one step to have all edges in reach.
            if best < sure || self.taken.iter().flatten().count() < edges.len() {
                best = self.refine(lines, edges, &mut at, 1);
            }
        }
        if best < sure {
            // Several peaks of the vote may look alike; the one that explains the edges best counts.
            for candidate in self.vote(lines, edges) {
                let mut refined = candidate;
                let explained = self.refine(lines, edges, &mut refined, 0);
                if explained > best {
                    (best, at) = (explained, refined);
                }
            }
            // Once more from a wider tolerance: the passes so far may have left edges out that the
            // pose they led to explains.
            self.refine(lines, edges, &mut at, 1);
        }
        let matched = self.taken.iter().flatten().count();
        self.last = (matched >= 3).then_some(at);
        let pose = pose_on_lines(&self.mounted, lines, at, &mut self.on_lines);
        for Found { edge, .. } in edges.iter_mut() {
            let slope = usize::try_from(edge.strip)
                .ok()
                .and_then(|strip| frame.strips.get(strip))
                .map_or(0.0, Strip::slope);
            // Hits begin further out on both sides of a strip.
            let outward = if edge.kind == EdgeKind::On { -1.0 } else { 1.0 };
            let slant = Slant::new(&self.spot, &pose, lines, edge, slope);
            edge.d_threshold = outward / slant.spots_per_rad;
        }
        self.last.map(|_| pose)
    }

    /// Coarse search: the poses (x, yaw, pitch) from which the edges lie nearest to boundaries of
    /// their kind, best first, at some distance from each other.
    fn vote(&mut self, lines: &ReflectorLines, edges: &[Found]) -> Vec<[f64; 3]> {
        let mut scored: Vec<(f64, [f64; 3])> = Vec::new();
        let yaw_steps = (YAW_MAX_RAD / YAW_STEP_RAD).round() as i32;
        let x_steps = (X_MAX_M / X_STEP_M).round() as i32;
        let pitches = if self.with_pitch { -1..=1 } else { 0..=0 };
        for (pitch_step, yaw_step) in
            pitches.flat_map(|p| (-yaw_steps..=yaw_steps).map(move |y| (p, y)))
        {
            let yaw = f64::from(yaw_step) * YAW_STEP_RAD;
            let pitch = f64::from(pitch_step) * PITCH_STEP_RAD;
            self.see(lines, edges, [0.0, yaw, pitch]);
            for x_step in -x_steps..=x_steps {
                let x_m = f64::from(x_step) * X_STEP_M;
                // A small penalty prefers the middle where the count does not decide.
                let far = f64::from(x_step.abs() + yaw_step.abs());
                scored.push((self.score(edges, x_m) - 0.02 * far, [x_m, yaw, pitch]));
            }
        }
        scored.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut best: Vec<[f64; 3]> = Vec::new();
        for (_, at) in scored {
            let near = |b: &[f64; 3]| {
                (b[0] - at[0]).abs() < 2.5 * X_STEP_M && (b[1] - at[1]).abs() < 2.5 * YAW_STEP_RAD
            };
            if !best.iter().any(near) {
                best.push(at);
            }
            if best.len() == CANDIDATES {
                break;
            }
        }
        best
    }

    /// How well the edges, seen from x = 0, fit boundaries when x is `x_m`. The better centred the
    /// more: a wide tolerance alone is met by chance too.
    fn score(&self, edges: &[Found], x_m: f64) -> f64 {
        let fit = |(Found { edge, .. }, middle): (&Found, &Middle)| {
            let reach_m = VOTE_M + middle.half_m;
            self.boundaries
                .iter()
                .filter(|b| b.kind == edge.kind && b.face == edge.face)
                .map(|b| (b.gap_m(middle) - b.slope * x_m) / reach_m)
                .filter(|off| off.abs() < 1.0)
                .map(|off| 1.0 - off * off)
                .fold(0.0, f64::max)
        };
        edges.iter().zip(&self.middles).map(fit).sum()
    }

    /// Alternates association and least squares; returns how well the edges are explained: up to
    /// [`WORTH`] for each, less what the state is away from the middle.
    fn refine(
        &mut self,
        lines: &ReflectorLines,
        edges: &mut [Found],
        at: &mut [f64; 3],
        from: usize,
    ) -> f64 {
        let mut explained = f64::NEG_INFINITY;
        for tolerance_m in &TOLERANCES_M[from..] {
            self.see(lines, edges, *at);
            self.nearest(edges, *tolerance_m);
            explained = 0.0;
            let mut information = Matrix3::zeros();
            let mut gradient = Vector3::zeros();
            for k in 0..3 {
                let sigma = if k == 2 && !self.with_pitch {
                    1e-6
                } else {
                    PRIOR[k]
                };
                information[(k, k)] = 1.0 / (sigma * sigma);
                gradient[k] = -at[k] / (sigma * sigma);
                explained -= (at[k] / sigma).powi(2);
            }
            for (boundary, taken) in self.boundaries.iter().zip(&self.taken) {
                let Some((e, gap_m)) = *taken else { continue };
                let middle = &self.middles[e];
                let row = Vector3::from_fn(|k, _| middle.d_v[k] - boundary.slope * middle.d_x[k]);
                let weight = 1.0 / (middle.half_m * middle.half_m / 3.0 + 4e-6);
                explained += (WORTH - weight * gap_m * gap_m).max(0.0);
                information += weight * row * row.transpose();
                gradient -= weight * gap_m * row;
            }
            if let Some(step) = information.cholesky().map(|c| c.solve(&gradient)) {
                at[0] = (at[0] + step[0]).clamp(-1.5, 1.5);
                at[1] = (at[1] + step[1]).clamp(-0.3, 0.3);
                at[2] = (at[2] + step[2]).clamp(-0.2, 0.2);
            }
        }
        explained
    }

    /// Gives every boundary the nearest edge of its kind within the tolerance, and the edges their
    /// strips.
    fn nearest(&mut self, edges: &mut [Found], tolerance_m: f64) {
        self.taken.clear();
        self.taken.resize(self.boundaries.len(), None);
        for (e, (Found { edge, .. }, middle)) in edges.iter_mut().zip(&self.middles).enumerate() {
            edge.strip = -1;
            let mut best: Option<(usize, f64)> = None;
            for (b, boundary) in self.boundaries.iter().enumerate() {
                if boundary.kind != edge.kind || boundary.face != edge.face {
                    continue;
                }
                let gap_m = boundary.gap_m(middle);
                if gap_m.abs() <= tolerance_m + middle.half_m
                    && best.is_none_or(|(_, least)| gap_m.abs() < least.abs())
                {
                    best = Some((b, gap_m));
                }
            }
            if let Some((b, gap_m)) = best
                && self.taken[b].is_none_or(|(_, other)| gap_m.abs() < other.abs())
            {
                self.taken[b] = Some((e, gap_m));
            }
        }
        for (boundary, taken) in self.boundaries.iter().zip(&self.taken) {
            if let Some((e, _)) = taken {
                edges[*e].edge.strip = boundary.strip as i32;
            }
        }
    }

    /// Where the middles of the intervals lie on their faces, seen from `at`.
    fn see(&mut self, lines: &ReflectorLines, edges: &[Found], at: [f64; 3]) {
        let pose = pose_on_lines(&self.mounted, lines, at, &mut self.on_lines);
        self.middles.clear();
        self.middles.extend(edges.iter().map(|Found { edge, .. }| {
            let v = v_axis(edge.face);
            let [from, to] = [edge.from_rad, edge.to_rad].map(|a| pose.crossing(a, edge.face));
            let (Some(from), Some(to)) = (from, to) else {
                return Middle::NOWHERE;
            };
            let mean = |f: &dyn Fn(&crate::frame::Crossing) -> f64| 0.5 * (f(&from) + f(&to));
            Middle {
                x_m: mean(&|c| c.point_m[0]),
                v_m: mean(&|c| c.point_m[v]),
                half_m: 0.5 * (from.point_m[v] - to.point_m[v]).abs(),
                d_x: [0, 5, 4].map(|k| mean(&|c| c.d_point[k][0])),
                d_v: [0, 5, 4].map(|k| mean(&|c| c.d_point[k][v])),
            }
        }));
    }
}

impl Middle {
    const NOWHERE: Middle = Middle {
        x_m: f64::NAN,
        v_m: f64::NAN,
        half_m: 0.0,
        d_x: [0.0; 3],
        d_v: [0.0; 3],
    };
}

impl Boundary {
    /// Signed distance of a point from the boundary along v, m.
    fn gap_m(&self, middle: &Middle) -> f64 {
        middle.v_m - self.offset_m - self.slope * middle.x_m
    }
}

/// The axis of a face along which a strip's width is measured: y on the ceiling, z on a wall.
fn v_axis(face: Face) -> usize {
    if face == Face::Upper { 1 } else { 2 }
}

/// A strip's two boundaries with the polarity of their edges. With growing beam angle v falls on
/// the ceiling and on the left wall and rises on the right wall.
fn boundaries(strip: usize, s: &Strip) -> [Boundary; 2] {
    let rising = s.face == Face::Right;
    let slope = s.slope();
    let make = |side: f64| Boundary {
        face: s.face,
        strip,
        kind: if (side > 0.0) == rising {
            EdgeKind::Off
        } else {
            EdgeKind::On
        },
        offset_m: s.offset_m + side * s.width_m / 2.0,
        slope,
    };
    [make(1.0), make(-1.0)]
}

/// The platform's pose with y, z and roll such that its lines are the measured ones, for given x,
/// yaw and pitch. `start` is y, z and roll to start from and becomes those of the result.
fn pose_on_lines(
    mounted: &ScannerPose,
    lines: &ReflectorLines,
    [x, yaw, pitch]: [f64; 3],
    start: &mut [f64; 3],
) -> ScannerPose {
    let [mut y, mut z, mut roll] = *start;
    for _ in 0..4 {
        let pose = mounted.moved_to([x, y, z], [roll, pitch, yaw]);
        let (mut sum_y, mut walls, mut sum_roll, mut weight) = (0.0, 0.0, 0.0, 0.0);
        let mut moved = 0.0f64;
        for (line, face) in lines.lines().into_iter().zip(Face::ALL) {
            if !line.is_seen() {
                continue;
            }
            let predicted = pose.normal(face);
            let d_m = line.normal.d_m - predicted.d_m;
            match face {
                Face::Upper => (z, moved) = (z - d_m, d_m.abs()),
                Face::Right => (sum_y, walls) = (sum_y - d_m, walls + 1.0),
                Face::Left => (sum_y, walls) = (sum_y + d_m, walls + 1.0),
            }
            let w = 1.0 / line.cov_aa.max(1e-12);
            sum_roll += w * (predicted.alpha_rad - line.normal.alpha_rad);
            weight += w;
        }
        if walls > 0.0 {
            y += sum_y / walls;
            moved = moved.max((sum_y / walls).abs());
        }
        if weight > 0.0 {
            roll += sum_roll / weight;
            moved = moved.max(REACH_M * (sum_roll / weight).abs());
        }
        if moved < ON_LINES_M {
            break;
        }
    }
    *start = [y, z, roll];
    mounted.moved_to([x, y, z], [roll, pitch, yaw])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polarity_follows_the_beam() {
        let strip = |face| Strip {
            face,
            offset_m: 1.0,
            width_m: 0.4,
            inclination_deg: 0.0,
            x_m: None,
        };
        let kind = |face, side: f64| {
            boundaries(0, &strip(face))
                .into_iter()
                .find(|b| (b.offset_m - 1.0) * side > 0.0)
                .map(|b| b.kind)
        };
        assert_eq!(kind(Face::Upper, 1.0), Some(EdgeKind::On));
        assert_eq!(kind(Face::Left, 1.0), Some(EdgeKind::On));
        assert_eq!(kind(Face::Right, 1.0), Some(EdgeKind::Off));
        assert_eq!(kind(Face::Right, -1.0), Some(EdgeKind::On));
    }
}
