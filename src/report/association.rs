//! Which reference pose belongs to a measured one.
//!
//! A reference point at exactly the pose's stamp is used as it is. Otherwise the reference is
//! interpolated between its two neighbours, but never across a gap and never across a jump: a
//! simulated grid stands still at one place during a scan and at another during the next, and
//! nothing was ever in between.

use super::statistics::wrap_angle;
use crate::record::{Stamp, TrajectoryPoint};

/// How a reference pose is found for an instant that has none of its own.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Association {
    /// Cubic (Hermite) in the position where velocities are known, else linear; linear in the
    /// angles, the short way round.
    #[default]
    Interpolated,
    /// The nearest point in time.
    Nearest,
}

/// Limits of the association.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Limits {
    /// Interpolated or nearest.
    pub association: Association,
    /// Longest time between the two points interpolated between (default: three times the
    /// reference's median spacing), or to the nearest point (default: 10 ms). Seconds.
    pub max_diff_s: Option<f64>,
}

/// How a pose found its reference.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Match {
    /// A reference point at the same nanosecond.
    Exact,
    /// Between two points.
    Interpolated,
    /// The nearest point.
    Nearest,
}

/// Why a pose has no reference.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unmatched {
    /// Before the first or after the last reference point.
    Outside,
    /// The reference has no points close enough in time.
    Gap,
    /// The reference jumps between its two points.
    Jump,
}

/// Counts of how the poses of a run were matched.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Matching {
    /// Matched at the same nanosecond.
    pub exact: usize,
    /// Matched by interpolation.
    pub interpolated: usize,
    /// Matched to the nearest point.
    pub nearest: usize,
    /// Not matched: outside the reference's time.
    pub outside: usize,
    /// Not matched: a gap in the reference.
    pub gap: usize,
    /// Not matched: a jump in the reference.
    pub jump: usize,
}

impl Matching {
    /// Counts one result.
    pub fn add<T>(&mut self, result: &Result<(T, Match), Unmatched>) {
        *match result {
            Ok((_, Match::Exact)) => &mut self.exact,
            Ok((_, Match::Interpolated)) => &mut self.interpolated,
            Ok((_, Match::Nearest)) => &mut self.nearest,
            Err(Unmatched::Outside) => &mut self.outside,
            Err(Unmatched::Gap) => &mut self.gap,
            Err(Unmatched::Jump) => &mut self.jump,
        } += 1;
    }

    /// Poses with a reference.
    pub fn matched(&self) -> usize {
        self.exact + self.interpolated + self.nearest
    }

    /// Poses without one.
    pub fn unmatched(&self) -> usize {
        self.outside + self.gap + self.jump
    }
}

/// Nearest association's default limit, s.
const NEAREST_S: f64 = 0.010;
/// Default limit of a gap, in median spacings.
const GAP_SPACINGS: f64 = 3.0;
/// Beyond this speed a trajectory without velocities is taken to jump, m/s: the robot does 3.
const JUMP_M_S: f64 = 6.0;
/// Beyond this rate a trajectory is taken to jump in angle, rad/s.
const JUMP_RAD_S: f64 = 3.0;
/// What a smooth trajectory may differ from its own velocities between two points: this, m,
const SMOOTH_M: f64 = 0.002;
/// and this share of the way between them.
const SMOOTH_SHARE: f64 = 0.25;

/// A true or desired trajectory, in order of time.
#[derive(Clone, Debug, Default)]
pub struct Reference {
    points: Vec<TrajectoryPoint>,
    limits: Limits,
    gap_ns: i64,
    /// Points whose pose is not all numbers; left out.
    pub incomplete: usize,
    /// Points at another point's stamp; the first is kept.
    pub repeated: usize,
    /// Points that came before an earlier one; sorted in.
    pub unsorted: usize,
}

impl Reference {
    /// Puts `points` in order and leaves out what cannot be used.
    pub fn new(mut points: Vec<TrajectoryPoint>, limits: Limits) -> Reference {
        let all = points.len();
        points.retain(|p| components(p).iter().all(|v| v.is_finite()));
        let incomplete = all - points.len();
        let unsorted = points
            .windows(2)
            .filter(|w| matches!(w, [a, b] if b.stamp < a.stamp))
            .count();
        if unsorted > 0 {
            points.sort_by_key(|p| p.stamp);
        }
        let complete = points.len();
        points.dedup_by_key(|p| p.stamp);
        let repeated = complete - points.len();
        let limit_s = limits.max_diff_s.unwrap_or(match limits.association {
            Association::Nearest => NEAREST_S,
            Association::Interpolated => GAP_SPACINGS * median_spacing_s(&points),
        });
        Reference {
            points,
            limits,
            gap_ns: (limit_s * 1e9).round() as i64,
            incomplete,
            repeated,
            unsorted,
        }
    }

    /// Number of usable points.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether there is no usable point.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// First and last instant.
    pub fn span(&self) -> Option<(Stamp, Stamp)> {
        Some((self.points.first()?.stamp, self.points.last()?.stamp))
    }

    /// The points, in order of time.
    pub(super) fn points(&self) -> &[TrajectoryPoint] {
        &self.points
    }

    /// How instants between two points are met.
    pub fn association(&self) -> Association {
        self.limits.association
    }

    /// The limit in force, s: see [`Limits::max_diff_s`].
    pub fn max_diff_s(&self) -> f64 {
        self.gap_ns as f64 * 1e-9
    }

    /// The reference's x, y, z (m), roll, pitch, yaw (rad) at `stamp`.
    ///
    /// # Errors
    /// [`Unmatched`] where the reference does not say where the platform was.
    pub fn at(&self, stamp: Stamp) -> Result<([f64; 6], Match), Unmatched> {
        self.at_next(&mut 0, stamp)
    }

    /// As [`Reference::at`], for stamps that mostly grow: the search begins where the last one ended.
    pub(super) fn at_next(
        &self,
        place: &mut usize,
        stamp: Stamp,
    ) -> Result<([f64; 6], Match), Unmatched> {
        let next = self.next(place, stamp);
        let after = self.points.get(next);
        if let Some(point) = after.filter(|p| p.stamp == stamp) {
            return Ok((components(point), Match::Exact));
        }
        let before = next.checked_sub(1).and_then(|i| self.points.get(i));
        match self.limits.association {
            Association::Nearest => self.nearest(stamp, before, after),
            Association::Interpolated => match (before, after) {
                (Some(a), Some(b)) => self.between(stamp, a, b),
                _ => Err(Unmatched::Outside),
            },
        }
    }

    /// Index of the first point that is not before `stamp`: sought from `place` on, in steps that
    /// double, so that it is cheap where the next instant is near the last one.
    pub(super) fn next(&self, place: &mut usize, stamp: Stamp) -> usize {
        let before = |i: usize| self.points.get(i).is_some_and(|p| p.stamp < stamp);
        // Everything up to `low` is before the stamp, nothing from `high` on.
        let (mut low, mut high) = (0, self.points.len());
        let (mut at, mut step) = (*place, 1);
        if at > 0 && !before(at - 1) {
            while at > 0 && !before(at - 1) {
                high = at - 1;
                at = at.saturating_sub(step);
                step *= 2;
            }
            low = at;
        } else {
            while before(at) {
                low = at + 1;
                at += step;
                step *= 2;
            }
            high = high.min(at);
        }
        let between = self.points.get(low..high).unwrap_or_default();
        let next = low + between.partition_point(|p| p.stamp < stamp);
        *place = next;
        next
    }

    /// The reference's velocity at `stamp`, m/s, as the trajectory says it or as its points move on;
    /// NaN where they do not: at a gap, a jump and outside.
    pub(super) fn velocity_m_s(&self, place: &mut usize, stamp: Stamp) -> [f64; 3] {
        let next = self.next(place, stamp);
        let joined = |i: usize| {
            let (a, b) = (self.points.get(i)?, self.points.get(i + 1)?);
            (b.stamp - a.stamp <= self.gap_ns && !jumps(a, b)).then_some((a, b))
        };
        let chord = |(a, b): (&TrajectoryPoint, &TrajectoryPoint)| {
            let dt = b.stamp.since_s(a.stamp);
            [0, 1, 2].map(|i| (b.position_m[i] - a.position_m[i]) / dt)
        };
        let behind = next.checked_sub(1).and_then(joined);
        if self.points.get(next).is_none_or(|p| p.stamp != stamp) {
            let Some((a, b)) = behind else {
                return [f64::NAN; 3];
            };
            if !known_velocities(a, b) {
                return chord((a, b));
            }
            let dt = b.stamp.since_s(a.stamp);
            let s = stamp.since_s(a.stamp) / dt;
            return [0, 1, 2].map(|i| {
                let (u, v) = (a.velocity_m_s[i], b.velocity_m_s[i]);
                let way = (b.position_m[i] - a.position_m[i]) / dt;
                // The derivative of Hermite's cubic.
                u + s * (2.0 * (3.0 * way - 2.0 * u - v) + 3.0 * s * (u + v - 2.0 * way))
            });
        }
        // At a point: its own velocity, if the platform moves on to one of its neighbours.
        match (behind, joined(next)) {
            (None, None) => [f64::NAN; 3],
            (Some((_, point)), _) | (None, Some((point, _)))
                if point.velocity_m_s.iter().all(|v| v.is_finite()) =>
            {
                point.velocity_m_s
            }
            (Some(one), Some(other)) => {
                let (one, other) = (chord(one), chord(other));
                [0, 1, 2].map(|i| 0.5 * (one[i] + other[i]))
            }
            (Some(only), None) | (None, Some(only)) => chord(only),
        }
    }

    fn nearest(
        &self,
        stamp: Stamp,
        before: Option<&TrajectoryPoint>,
        after: Option<&TrajectoryPoint>,
    ) -> Result<([f64; 6], Match), Unmatched> {
        let distance = |p: &&TrajectoryPoint| (p.stamp - stamp).saturating_abs();
        let nearest = before
            .into_iter()
            .chain(after)
            .min_by_key(distance)
            .ok_or(Unmatched::Outside)?;
        if distance(&nearest) <= self.gap_ns {
            Ok((components(nearest), Match::Nearest))
        } else if before.is_some() && after.is_some() {
            Err(Unmatched::Gap)
        } else {
            Err(Unmatched::Outside)
        }
    }

    fn between(
        &self,
        stamp: Stamp,
        a: &TrajectoryPoint,
        b: &TrajectoryPoint,
    ) -> Result<([f64; 6], Match), Unmatched> {
        if b.stamp - a.stamp > self.gap_ns {
            return Err(Unmatched::Gap);
        }
        if jumps(a, b) {
            return Err(Unmatched::Jump);
        }
        Ok((interpolate(stamp, a, b), Match::Interpolated))
    }
}

/// x, y, z (m), roll, pitch, yaw (rad).
fn components(point: &TrajectoryPoint) -> [f64; 6] {
    let ([x, y, z], [roll, pitch, yaw]) = (point.position_m, point.rotation_rad);
    [x, y, z, roll, pitch, yaw]
}

fn median_spacing_s(points: &[TrajectoryPoint]) -> f64 {
    let mut spacings: Vec<i64> = points
        .windows(2)
        .filter_map(|w| match w {
            [a, b] => Some(b.stamp - a.stamp),
            _ => None,
        })
        .collect();
    let middle = spacings.len() / 2;
    if spacings.is_empty() {
        return 0.0;
    }
    *spacings.select_nth_unstable(middle).1 as f64 * 1e-9
}

fn known_velocities(a: &TrajectoryPoint, b: &TrajectoryPoint) -> bool {
    let mut velocities = a.velocity_m_s.iter().chain(&b.velocity_m_s);
    velocities.all(|v| v.is_finite())
}

/// Whether the platform cannot have moved from `a` to `b`: with velocities, the way between them
/// is not what the velocities say; without, the speed is beyond any the robot has.
fn jumps(a: &TrajectoryPoint, b: &TrajectoryPoint) -> bool {
    let dt = b.stamp.since_s(a.stamp);
    let (mut way2, mut rest2) = (0.0, 0.0);
    for i in 0..3 {
        let way = b.position_m[i] - a.position_m[i];
        let expected = 0.5 * (a.velocity_m_s[i] + b.velocity_m_s[i]) * dt;
        way2 += way * way;
        rest2 += (way - expected).powi(2);
    }
    let far = if known_velocities(a, b) {
        rest2.sqrt() > SMOOTH_M + SMOOTH_SHARE * way2.sqrt()
    } else {
        way2.sqrt() > JUMP_M_S * dt
    };
    let turned = |i: usize| wrap_angle(b.rotation_rad[i] - a.rotation_rad[i]).abs();
    far || (0..3).any(|i| turned(i) > JUMP_RAD_S * dt)
}

fn interpolate(stamp: Stamp, a: &TrajectoryPoint, b: &TrajectoryPoint) -> [f64; 6] {
    let dt = b.stamp.since_s(a.stamp);
    let s = stamp.since_s(a.stamp) / dt;
    let cubic = known_velocities(a, b);
    let mut out = [0.0; 6];
    for i in 0..3 {
        let (p, q) = (a.position_m[i], b.position_m[i]);
        out[i] = p + (q - p) * s;
        if cubic {
            // Hermite's basis, written as the straight line and what the velocities add to it.
            let (u, v) = (a.velocity_m_s[i] * dt, b.velocity_m_s[i] * dt);
            let bend = (u - (q - p)) * (1.0 - s) - (v - (q - p)) * s;
            out[i] += s * (1.0 - s) * bend;
        }
        let (p, q) = (a.rotation_rad[i], b.rotation_rad[i]);
        out[i + 3] = p + wrap_angle(q - p) * s;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn point(ns: i64, x: f64, vx: f64) -> TrajectoryPoint {
        TrajectoryPoint {
            stamp: Stamp::from_ns(ns),
            position_m: [x, 0.0, 1.0],
            rotation_rad: [0.0; 3],
            velocity_m_s: [vx, 0.0, 0.0],
        }
    }

    fn x_at(reference: &Reference, ns: i64) -> Result<(f64, Match), Unmatched> {
        reference
            .at(Stamp::from_ns(ns))
            .map(|(pose, how)| (pose[0], how))
    }

    const MS: i64 = 1_000_000;

    #[test]
    fn an_equal_stamp_is_used_exactly_even_on_a_jumping_grid() {
        let grid: Vec<_> = (0..50)
            .map(|i| point(i * 28 * MS, 0.2 * i as f64, 0.0))
            .collect();
        let reference = Reference::new(grid.clone(), Limits::default());
        for p in &grid {
            let (pose, how) = reference.at(p.stamp).unwrap();
            assert_eq!((pose[0], how), (p.position_m[0], Match::Exact));
        }
        assert_eq!(x_at(&reference, 14 * MS), Err(Unmatched::Jump));
        // Standing still between two points is no jump.
        let still = Reference::new(
            vec![point(0, 1.0, 0.0), point(28 * MS, 1.0, 0.0)],
            Limits::default(),
        );
        assert_eq!(x_at(&still, 14 * MS), Ok((1.0, Match::Interpolated)));
    }

    #[test]
    fn a_fast_trajectory_without_velocities_jumps() {
        let (mut a, mut b) = (point(0, 0.0, 0.0), point(28 * MS, 0.2, 0.0));
        (a.velocity_m_s, b.velocity_m_s) = ([f64::NAN; 3], [f64::NAN; 3]);
        let reference = Reference::new(vec![a, b], Limits::default());
        assert_eq!(x_at(&reference, MS), Err(Unmatched::Jump));
        b.position_m[0] = 0.028;
        let reference = Reference::new(vec![a, b], Limits::default());
        let (x, how) = x_at(&reference, 14 * MS).unwrap();
        assert!((x - 0.014).abs() < 1e-15 && how == Match::Interpolated);
        b.rotation_rad[2] = 0.5;
        let reference = Reference::new(vec![a, b], Limits::default());
        assert_eq!(x_at(&reference, 14 * MS), Err(Unmatched::Jump));
    }

    #[test]
    fn a_cubic_motion_is_met_exactly() {
        let x = |t: f64| 0.3 + 2.0 * t - 4.0 * t * t + 3.0 * t * t * t;
        let v = |t: f64| 2.0 - 8.0 * t + 9.0 * t * t;
        let points = (0..20).map(|i| point(i * 40 * MS, x(0.04 * i as f64), v(0.04 * i as f64)));
        let reference = Reference::new(points.collect(), Limits::default());
        for ns in [MS, 77 * MS, 501 * MS + 3, 759 * MS] {
            let (got, _) = x_at(&reference, ns).unwrap();
            assert!((got - x(ns as f64 * 1e-9)).abs() < 1e-12, "{ns}: {got}");
        }
    }

    #[test]
    fn velocities_are_those_of_the_motion() {
        let x = |t: f64| 0.3 + 2.0 * t - 4.0 * t * t + 3.0 * t * t * t;
        let v = |t: f64| 2.0 - 8.0 * t + 9.0 * t * t;
        let points: Vec<_> = (0..20)
            .map(|i| point(i * 40 * MS, x(0.04 * i as f64), v(0.04 * i as f64)))
            .collect();
        let reference = Reference::new(points.clone(), Limits::default());
        let mut bare = points.clone();
        bare.iter_mut().for_each(|p| p.velocity_m_s = [f64::NAN; 3]);
        let bare = Reference::new(bare, Limits::default());
        let mut place = 0;
        for ns in [40 * MS, 77 * MS, 501 * MS + 3, 320 * MS, 759 * MS] {
            let t = ns as f64 * 1e-9;
            let [got, ..] = reference.velocity_m_s(&mut place, Stamp::from_ns(ns));
            assert!((got - v(t)).abs() < 1e-9, "{ns}: {got}");
            let [got, ..] = bare.velocity_m_s(&mut 7, Stamp::from_ns(ns));
            assert!((got - v(t)).abs() < 0.25, "{ns}: {got} for {}", v(t));
        }
        let [outside, ..] = reference.velocity_m_s(&mut place, Stamp::from_ns(10_000 * MS));
        assert!(outside.is_nan());
        let grid: Vec<_> = (0..5)
            .map(|i| point(i * 28 * MS, 0.2 * i as f64, 0.0))
            .collect();
        let grid = Reference::new(grid, Limits::default());
        assert!(grid.velocity_m_s(&mut 0, Stamp::from_ns(28 * MS))[0].is_nan());
    }

    #[test]
    fn a_search_that_goes_on_finds_what_one_from_the_start_does() {
        let points: Vec<_> = (0..500)
            .map(|i| point(i * 10 * MS, i as f64 * 0.01, 1.0))
            .collect();
        let reference = Reference::new(points, Limits::default());
        let mut place = 0;
        let ns = (0..900i64)
            .map(|i| i * 7 * MS)
            .chain([MS, 4000 * MS, 3999 * MS, 0, 4990 * MS]);
        for ns in ns {
            let stamp = Stamp::from_ns(ns);
            assert_eq!(
                reference.at_next(&mut place, stamp),
                reference.at(stamp),
                "{ns}"
            );
        }
    }

    #[test]
    fn angles_go_the_short_way_round() {
        let (mut a, mut b) = (point(0, 0.0, 0.0), point(1000 * MS, 0.0, 0.0));
        (a.rotation_rad[2], b.rotation_rad[2]) = (3.1, -3.1);
        let reference = Reference::new(vec![a, b], Limits::default());
        let (pose, _) = reference.at(Stamp::from_ns(500 * MS)).unwrap();
        assert!((wrap_angle(pose[5]).abs() - std::f64::consts::PI).abs() < 1e-12);
    }

    #[test]
    fn gaps_ends_and_the_nearest_point() {
        let mut points: Vec<_> = (0..10).map(|i| point(i * 10 * MS, 0.0, 0.0)).collect();
        points.extend((50..60).map(|i| point(i * 10 * MS, 0.0, 0.0)));
        let reference = Reference::new(points.clone(), Limits::default());
        assert!((reference.max_diff_s() - 0.030).abs() < 1e-12);
        assert_eq!(x_at(&reference, 200 * MS), Err(Unmatched::Gap));
        assert_eq!(x_at(&reference, -1), Err(Unmatched::Outside));
        assert_eq!(x_at(&reference, 591 * MS), Err(Unmatched::Outside));
        let nearest = Limits {
            association: Association::Nearest,
            max_diff_s: Some(0.004),
        };
        let reference = Reference::new(points, nearest);
        assert_eq!(x_at(&reference, 13 * MS), Ok((0.0, Match::Nearest)));
        assert_eq!(x_at(&reference, 15 * MS), Err(Unmatched::Gap));
        assert_eq!(x_at(&reference, 593 * MS), Ok((0.0, Match::Nearest)));
        assert_eq!(x_at(&reference, 595 * MS), Err(Unmatched::Outside));
        assert_eq!(x_at(&Reference::default(), 0), Err(Unmatched::Outside));
    }

    #[test]
    fn disorder_is_counted_and_mended() {
        let mut broken = point(20, 0.0, 0.0);
        broken.rotation_rad[1] = f64::NAN;
        let points = vec![
            point(30, 3.0, 0.0),
            point(10, 1.0, 0.0),
            broken,
            point(10, 9.0, 0.0),
        ];
        let reference = Reference::new(points, Limits::default());
        assert_eq!(
            (reference.incomplete, reference.repeated, reference.unsorted),
            (1, 1, 1)
        );
        assert_eq!(x_at(&reference, 10), Ok((1.0, Match::Exact)));
        assert_eq!(reference.len(), 2);
    }

    proptest! {
        #[test]
        fn every_own_stamp_is_exact(stamps in prop::collection::btree_set(-1000i64..1000, 1..40)) {
            let points: Vec<_> = stamps.iter().map(|ns| point(*ns, *ns as f64, 0.0)).collect();
            let reference = Reference::new(points, Limits::default());
            for ns in stamps {
                prop_assert_eq!(x_at(&reference, ns), Ok((ns as f64, Match::Exact)));
            }
        }
    }
}
