//! The published estimator: a vote over x and yaw (Kurniawan 2017, sections 3.4, 3.5 and 4.6).
//!
//! Kept as it was published, as the baseline that [`super::joint`] is measured against:
//!
//! - y, z and roll from the three lines (eq. 4.25, here in the exact closed form);
//! - an interval of yaw from the width of the strips (eq. 3.51 to 3.74): a strip's seen width lies
//!   between the distance of its outermost hits and that of the first misses beside them (eq. 3.42
//!   to 3.50), and is `c / cos(inclination - yaw)` for a strip of perpendicular width c, which
//!   stands here for the cosine-rule cascade of eq. 3.53 to 3.69;
//! - an interval of the ceiling corner's x from the first edge (eq. 3.75 to 3.95);
//! - for every cell of a grid of 1 mm by 0.02 degrees over both, one vote an edge whose ideal
//!   crossing lies between the crossings of the neighbouring beams (eq. 3.96 to 3.101); the
//!   mean of the cells with the most votes is the result (eq. 3.102, 3.103).
//!
//! It needs all eight transitions of the four strips, gives no covariance and takes the lines and
//! intervals as exact. For one yaw the cells that an edge votes for are consecutive, so that the
//! votes of a whole column are counted from the ends of eight intervals; the result is that of
//! visiting every cell.

use crate::frame::{Frame, Strip};
use crate::record::{Edge, EdgeKind, Face, FittedLine, Pose, ReflectorLines, Status};
use nalgebra::{Rotation3, Vector3};
use std::f64::consts::FRAC_PI_2;

/// The grid's step in x, m.
const X_STEP_M: f64 = 0.001;
/// The grid's step in yaw, rad (0.02 degrees).
const YAW_STEP_RAD: f64 = 0.02 * std::f64::consts::PI / 180.0;
/// Yaw beyond this is not looked for, rad: the side reflectors are long out of sight (eq. 3.104).
const YAW_LIMIT_RAD: f64 = 20.0 * std::f64::consts::PI / 180.0;
/// Most cells in a column: a wider x interval is not a measurement.
const X_LIMIT_M: f64 = 20.0;

/// A pose by vote.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VotePose {
    /// Platform origin in B, m.
    pub position_m: [f64; 3],
    /// Roll, pitch (as given), yaw, rad.
    pub rotation_rad: [f64; 3],
    /// Votes of the winning cells, at most one an edge.
    pub votes: u32,
    /// Edges that could vote.
    pub edges: u32,
}

/// Why there is no pose by vote.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum VoteFailure {
    /// One of the three lines was not seen.
    #[error("the {} line was not seen", .0.name())]
    NoLine(Face),
    /// Not exactly one transition onto and one off every strip.
    #[error("{found} of the {needed} transitions of the strips were seen; the vote needs all")]
    Transitions {
        /// Transitions seen exactly once.
        found: u32,
        /// Two a strip on the ceiling.
        needed: u32,
    },
    /// The frame has no inclined strip on the ceiling, on which x and yaw rest.
    #[error("the frame has no inclined strip on the ceiling")]
    NoStrips,
    /// The strips' widths leave no yaw, or the first edge no x.
    #[error("the widths of the strips contradict each other")]
    Contradiction,
}

impl VoteFailure {
    /// What a pose record says of it, besides that there is no pose.
    pub fn status(self) -> Status {
        match self {
            VoteFailure::NoLine(Face::Upper) => Status::NO_UPPER,
            VoteFailure::NoLine(_) => Status::ONE_WALL,
            VoteFailure::Transitions { found: 0, .. } | VoteFailure::NoStrips => Status::NO_EDGES,
            VoteFailure::Transitions { .. } => Status::FEW_EDGES,
            VoteFailure::Contradiction => Status::DISAGREE,
        }
    }
}

/// Solves one scan's lines and edges, with the platform's pitch (rad) from elsewhere.
pub fn solve(
    lines: &ReflectorLines,
    frame: &Frame,
    pitch_rad: f64,
) -> Result<VotePose, VoteFailure> {
    for (line, face) in lines.lines().into_iter().zip(Face::ALL) {
        if !line.is_seen() {
            return Err(VoteFailure::NoLine(face));
        }
    }
    let corner_m = corner_m(&lines.upper, &lines.right);
    let crossings = crossings(lines, frame, corner_m)?;
    let yaw_rad = yaw_interval(&crossings).ok_or(VoteFailure::Contradiction)?;
    let winners = count(&crossings, yaw_rad).ok_or(VoteFailure::Contradiction)?;

    let mounting = mounting(frame);
    let roll = FRAC_PI_2 - lines.upper.normal.alpha_rad;
    let pitch = scanner_pitch_rad(roll, pitch_rad, &mounting);
    let yaw = winners.yaw_rad;
    let scanner = Rotation3::from_euler_angles(roll, pitch, yaw);
    // The scan plane's normal. A line's distance in it is longer than that from the wall itself.
    let normal = scanner * Vector3::x();
    let height = lines.upper.normal.d_m * (1.0 - normal.z * normal.z).sqrt();
    let width = lines.left.normal.d_m - lines.right.normal.d_m;
    // The foot of the scanner's perpendicular on the scan line at the ceiling lies ahead by
    // height * tan(pitch); the corner lies beside it by `corner_m`.
    let x = winners.corner_x_m - height * pitch.tan() * yaw.cos() + corner_m * yaw.sin();
    let origin = Vector3::new(
        x,
        0.5 * width * (1.0 - normal.y * normal.y).sqrt(),
        frame.bounds.dz_m - height,
    );
    let platform = scanner * mounting.inverse();
    let position = origin - platform * Vector3::from(frame.scanner.position_m);
    let (roll, _, yaw) = platform.euler_angles();
    Ok(VotePose {
        position_m: position.into(),
        rotation_rad: [roll, pitch_rad, yaw],
        votes: winners.votes,
        edges: crossings.len() as u32,
    })
}

/// The same as a record: NaN covariance (the method has none), or no pose and a status.
pub fn pose(lines: &ReflectorLines, frame: &Frame, pitch_rad: f64) -> Pose {
    let pose = Pose {
        stamp: lines.stamp,
        scan_stamp: lines.scan_stamp,
        seq: lines.seq,
        ..Pose::default()
    };
    match solve(lines, frame, pitch_rad) {
        Ok(solved) => Pose {
            position_m: solved.position_m,
            rotation_rad: solved.rotation_rad,
            edges: solved.edges,
            votes: Some(solved.votes),
            ..pose
        },
        Err(failure) => Pose {
            status: Status::NO_POSE | failure.status(),
            ..pose
        },
    }
}

/// S in P.
fn mounting(frame: &Frame) -> Rotation3<f64> {
    let [roll, pitch, yaw] = frame.scanner.rotation_deg.map(f64::to_radians);
    Rotation3::from_euler_angles(roll, pitch, yaw)
}

/// Pitch of S in B when the platform's is given; its small yaw is left out of account.
fn scanner_pitch_rad(roll_rad: f64, pitch_rad: f64, mounting: &Rotation3<f64>) -> f64 {
    let (mounting_roll, _, _) = mounting.euler_angles();
    let platform = Rotation3::from_euler_angles(roll_rad - mounting_roll, pitch_rad, 0.0);
    (platform * mounting).euler_angles().1
}

/// Where a beam meets the upper line: distance along it from the foot of the scanner's
/// perpendicular, towards the right wall, m.
fn along_m(upper: &FittedLine, angle_rad: f64) -> f64 {
    upper.normal.d_m * (upper.normal.alpha_rad - angle_rad).tan()
}

/// Where the upper and the right line meet, in the same coordinate.
fn corner_m(upper: &FittedLine, right: &FittedLine) -> f64 {
    // On the upper line at distance t: d_u cos(alpha_u - alpha_r) + t sin(alpha_u - alpha_r) = d_r.
    let (sin, cos) = (upper.normal.alpha_rad - right.normal.alpha_rad).sin_cos();
    (right.normal.d_m - upper.normal.d_m * cos) / sin
}

/// One transition: its edge in the frame, and the interval of distances from the right corner
/// along the scan line in which it was crossed.
#[derive(Clone, Copy, Debug)]
struct Crossing {
    strip: Strip,
    kind: EdgeKind,
    /// Distance of the edge at x = 0 from the right wall, m.
    from_wall_m: f64,
    /// tan(inclination).
    slope: f64,
    near_m: f64,
    far_m: f64,
}

impl Crossing {
    /// The corner's x for which the scan line at `yaw_rad` crosses the edge inside the interval:
    /// eq. 3.96 to 3.101 solved for x. None where the edge rules the yaw out.
    fn corner_x_m(&self, (sin, cos): (f64, f64)) -> Option<(f64, f64)> {
        // The scan line leaves the corner (x, dy/2) along (sin(yaw), -cos(yaw)).
        let rate = cos + self.slope * sin;
        let ends = [self.near_m, self.far_m].map(|t| self.from_wall_m - t * rate);
        if self.slope.abs() < 1e-6 {
            // An edge along x says nothing of x.
            let met = ends[0].min(ends[1]) <= 0.0 && ends[0].max(ends[1]) >= 0.0;
            return met.then_some((f64::NEG_INFINITY, f64::INFINITY));
        }
        let [a, b] = ends.map(|end| end / self.slope);
        Some((a.min(b), a.max(b)))
    }
}

/// The transitions of all strips on the ceiling, from the right corner on: two a strip.
fn crossings(
    lines: &ReflectorLines,
    frame: &Frame,
    corner_m: f64,
) -> Result<Vec<Crossing>, VoteFailure> {
    let mut all = Vec::with_capacity(8);
    let (mut found, mut needed, mut inclined) = (0, 0, false);
    for (index, strip) in frame.strips_on(Face::Upper) {
        inclined |= strip.slope().abs() > 1e-6;
        for (kind, side) in [(EdgeKind::On, 0.5), (EdgeKind::Off, -0.5)] {
            needed += 1;
            let Some(edge) = only_edge(&lines.edges, index, kind) else {
                continue;
            };
            found += 1;
            all.push(Crossing {
                strip: *strip,
                kind,
                from_wall_m: frame.bounds.dy_m / 2.0 - strip.offset_m - side * strip.width_m,
                slope: strip.slope(),
                near_m: corner_m - along_m(&lines.upper, edge.from_rad),
                far_m: corner_m - along_m(&lines.upper, edge.to_rad),
            });
        }
    }
    if !inclined {
        return Err(VoteFailure::NoStrips);
    }
    if found < needed {
        return Err(VoteFailure::Transitions { found, needed });
    }
    // NaN fails too.
    if !all.iter().all(|crossing| crossing.near_m <= crossing.far_m) {
        return Err(VoteFailure::Contradiction);
    }
    all.sort_by(|a, b| a.near_m.total_cmp(&b.near_m));
    Ok(all)
}

/// The strip's transition of one kind, if there is exactly one.
fn only_edge(edges: &[Edge], strip: usize, kind: EdgeKind) -> Option<&Edge> {
    let is_it = |edge: &&Edge| {
        edge.face == Face::Upper && usize::try_from(edge.strip) == Ok(strip) && edge.kind == kind
    };
    let mut matching = edges.iter().filter(is_it);
    matching.next().filter(|_| matching.next().is_none())
}

/// Yaw from the seen widths of the strips: of each sign of inclination the strip whose lower bound
/// is largest (eq. 3.71), of these two intervals the shorter (eq. 3.74).
fn yaw_interval(crossings: &[Crossing]) -> Option<(f64, f64)> {
    let mut widest: [Option<(f64, (f64, f64))>; 2] = [None, None];
    for on in crossings.iter().filter(|c| c.kind == EdgeKind::On) {
        let is_off = |c: &&Crossing| c.kind == EdgeKind::Off && c.strip == on.strip;
        let Some(off) = crossings.iter().find(is_off) else {
            continue;
        };
        if on.slope.abs() < 1e-6 {
            continue;
        }
        let least_m = off.near_m - on.far_m;
        let most_m = off.far_m - on.near_m;
        let best = &mut widest[usize::from(on.slope > 0.0)];
        if best.is_none_or(|(before_m, _)| least_m > before_m) {
            *best = Some((least_m, yaw_of_widths(&on.strip, least_m, most_m)));
        }
    }
    let intervals = widest.into_iter().flatten().map(|(_, interval)| interval);
    let shortest = intervals.min_by(|a, b| (a.1 - a.0).total_cmp(&(b.1 - b.0)))?;
    let (low, high) = (
        shortest.0.max(-YAW_LIMIT_RAD),
        shortest.1.min(YAW_LIMIT_RAD),
    );
    (low <= high).then_some((low, high))
}

/// Yaw at which a strip's seen width lies between two bounds, m.
fn yaw_of_widths(strip: &Strip, least_m: f64, most_m: f64) -> (f64, f64) {
    let gamma = strip.inclination_deg.to_radians();
    let perpendicular_m = strip.width_m * gamma.cos();
    let yaw = |seen_m: f64| {
        // Narrower than the strip at right angles: noise; the nearest that can be is at right angles.
        let off_rad = (perpendicular_m / seen_m.max(perpendicular_m)).acos();
        gamma - gamma.signum() * off_rad
    };
    let (a, b) = (yaw(least_m), yaw(most_m));
    (a.min(b), a.max(b))
}

/// The cells with the most votes: their mean.
struct Winners {
    corner_x_m: f64,
    yaw_rad: f64,
    votes: u32,
}

fn count(crossings: &[Crossing], (low_rad, high_rad): (f64, f64)) -> Option<Winners> {
    let (x_low_m, x_high_m) = first_edge_interval(crossings.first()?, (low_rad, high_rad))?;
    let last_cell = ((x_high_m - x_low_m).min(X_LIMIT_M) / X_STEP_M).floor();
    let columns = ((high_rad - low_rad) / YAW_STEP_RAD).floor() as usize;
    let mut best = Tally::default();
    let mut ends = Vec::with_capacity(2 * crossings.len());
    for column in 0..=columns {
        let yaw_rad = low_rad + column as f64 * YAW_STEP_RAD;
        let sin_cos = yaw_rad.sin_cos();
        ends.clear();
        for crossing in crossings {
            let Some((from_m, to_m)) = crossing.corner_x_m(sin_cos) else {
                continue;
            };
            // First and last cell that this edge votes for.
            let from = ((from_m - x_low_m) / X_STEP_M).ceil().max(0.0);
            let to = ((to_m - x_low_m) / X_STEP_M).floor().min(last_cell);
            if from <= to {
                ends.push((from, 1));
                ends.push((to + 1.0, -1));
            }
        }
        best.add_column(&mut ends, yaw_rad);
    }
    best.winners(x_low_m)
}

/// The corner's x by the first edge alone, over an interval of yaw.
fn first_edge_interval(first: &Crossing, yaw_rad: (f64, f64)) -> Option<(f64, f64)> {
    let (a, b) = (
        first.corner_x_m(yaw_rad.0.sin_cos())?,
        first.corner_x_m(yaw_rad.1.sin_cos())?,
    );
    let (low_m, high_m) = (a.0.min(b.0), a.1.max(b.1));
    (low_m.is_finite() && high_m.is_finite()).then_some((low_m, high_m))
}

/// Sums over the cells with the most votes so far.
#[derive(Default)]
struct Tally {
    votes: i32,
    cells: f64,
    sum_cell: f64,
    sum_yaw: f64,
}

impl Tally {
    /// Takes in a column, given as the cells at which votes begin (+1) and end (-1).
    fn add_column(&mut self, ends: &mut [(f64, i32)], yaw_rad: f64) {
        ends.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let mut votes = 0;
        for (k, (cell, change)) in ends.iter().enumerate() {
            votes += change;
            let Some((next, _)) = ends.get(k + 1) else {
                break;
            };
            let cells = next - cell;
            if cells < 1.0 || votes < self.votes.max(1) {
                continue;
            }
            if votes > self.votes {
                *self = Tally {
                    votes,
                    ..Tally::default()
                };
            }
            self.cells += cells;
            self.sum_cell += cells * 0.5 * (cell + next - 1.0);
            self.sum_yaw += cells * yaw_rad;
        }
    }

    fn winners(&self, x_low_m: f64) -> Option<Winners> {
        (self.cells > 0.0).then(|| Winners {
            corner_x_m: x_low_m + X_STEP_M * self.sum_cell / self.cells,
            yaw_rad: self.sum_yaw / self.cells,
            votes: u32::try_from(self.votes).unwrap_or(0),
        })
    }
}

#[cfg(test)]
mod tests;
