//! How late the poses are against their reference, and what of the error that makes.
//!
//! A delay of 37 ms at 1.2 m/s looks like an error of 44 mm. The delay is found by
//! [`crate::clock::delay`], with gain and offset of each axis free, so that neither a wrong scale nor a
//! wrong origin is taken for one; its standard error is widened by the correlation of the errors over
//! time. A platform that lags behind its command looks the same as a measurement that comes late.

use super::association::Reference;
use super::consistency::effective_number;
use super::number::fixed;
use crate::clock::delay::{DelayFit, DelaySettings, Measured, fit};
use crate::motion::{Motion, State};
use crate::record::Stamp;
use nalgebra::Vector3;
use std::cell::Cell;

/// What is done about a delay.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum DelayChoice {
    /// It is estimated and stated; the statistics are of the errors as measured.
    #[default]
    Show,
    /// It is not looked for.
    None,
    /// It is estimated and taken out of the statistics.
    Estimate,
    /// This one is taken out of the statistics, s.
    Given(f64),
}

/// The poses' delay.
#[derive(Clone, Debug, PartialEq)]
pub struct Delay {
    /// Positive: the poses are late, s.
    pub delay_s: f64,
    /// Its standard error, s; NaN where it was given.
    pub sigma_s: f64,
    /// The 95 % interval, s.
    pub interval_s: [f64; 2],
    /// Whether the statistics are without it.
    pub removed: bool,
    /// Poses that it was estimated from,
    pub samples: usize,
    /// and how many independent ones would tell as much.
    pub effective_n: f64,
    /// Rms of the position's error as measured, m,
    pub rms_before_m: f64,
    /// and without the delay.
    pub rms_after_m: f64,
    /// That rms (m) against the delay that is assumed (s).
    pub curve: Vec<(f64, f64)>,
}

/// Poses that an estimate is made from, evenly chosen of more.
const ENOUGH: usize = 10_000;
/// Poses that the curve is made from.
const CURVE_POSES: usize = 2_500;
/// Points of the curve.
const CURVE_POINTS: usize = 60;
/// The curve goes beyond zero and beyond the delay by their distance, but at least by this, s.
const CURVE_BEYOND_S: f64 = 0.01;
/// Slower than this (rms) nothing moves, m/s.
const LEAST_M_S: f64 = 0.01;
/// An estimate less certain than this is none, s.
const MOST_SIGMA_S: f64 = 0.02;
/// Half the width of a 95 % interval, in standard errors.
const WIDE: f64 = 1.959_964;

/// A measured position at an instant, with the reference's velocity there.
#[derive(Clone, Copy, Debug)]
pub(super) struct Passed {
    pub stamp: Stamp,
    /// m; NaN where not known.
    pub position_m: [f64; 3],
    /// m/s; NaN where the reference does not move on.
    pub velocity_m_s: [f64; 3],
}

/// An estimate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Estimate {
    pub delay_s: f64,
    pub sigma_s: f64,
    pub samples: usize,
    pub effective_n: f64,
}

/// Estimates the delay of `poses`, in order of time.
///
/// # Errors
/// Why there is none, as the end of a sentence.
pub(super) fn estimate(
    poses: impl Iterator<Item = Passed> + Clone,
    reference: &Reference,
) -> Result<Estimate, String> {
    let (start, _) = reference.span().ok_or("the reference has no points")?;
    let placed = poses.filter(|p| p.position_m.iter().all(|v| v.is_finite()));
    let moving = |p: &Passed| p.velocity_m_s.iter().all(|v| v.is_finite());
    let all = placed.clone().count();
    let (count, squares) = placed.clone().filter(moving).fold((0, 0.0), |(n, sum), p| {
        let v2: f64 = p.velocity_m_s.iter().map(|v| v * v).sum();
        (n + 1, sum + v2)
    });
    if 2 * count < all || count == 0 {
        return Err("the reference is no continuous motion".to_owned());
    }
    if (squares / count as f64).sqrt() < LEAST_M_S {
        return Err("the platform stands still".to_owned());
    }
    let measured: Vec<Measured> = placed
        .filter(moving)
        .step_by(count.div_ceil(ENOUGH))
        .map(|p| Measured {
            t_s: p.stamp.since_s(start),
            position_m: p.position_m.into(),
        })
        .collect();
    let motion = Followed::new(reference, start);
    let found = fit(&measured, &motion, &DelaySettings::default()).map_err(|e| e.to_string())?;
    let pull = scores(&found, &measured, &motion);
    let effective_n = effective_number(&pull);
    let sigma_s = found.sigma_s * (pull.len() as f64 / effective_n).max(1.0).sqrt();
    // Not a number is not certain either.
    if !(sigma_s < MOST_SIGMA_S) {
        return Err("the poses do not tell it".to_owned());
    }
    Ok(Estimate {
        delay_s: found.delay_s,
        sigma_s,
        samples: measured.len(),
        effective_n,
    })
}

/// What each pose pulls at the delay with: its residual times the velocity, over the variance. Their
/// correlation over time is what the standard error of independent poses does not know.
fn scores(found: &DelayFit, measured: &[Measured], motion: &dyn Motion) -> Vec<f64> {
    let pull = |m: &Measured| {
        let state = motion.at(m.t_s - found.delay_s);
        let axes = found.axes.iter().filter_map(|axis| {
            let desired = state.position_m.get(axis.axis)?;
            let v = state.velocity_m_s.get(axis.axis)?;
            let residual = m.position_m.get(axis.axis)? - axis.gain * desired - axis.offset_m;
            Some(residual * v / (axis.noise_m.powi(2) + (axis.jitter_s * v).powi(2)))
        });
        axes.sum()
    };
    measured.iter().map(pull).collect()
}

impl Delay {
    /// The delay `found` of `poses`, with the errors that are left for it and for others.
    pub(super) fn of(
        found: Estimate,
        poses: impl Iterator<Item = Passed> + Clone,
        reference: &Reference,
    ) -> Delay {
        let Estimate {
            delay_s, sigma_s, ..
        } = found;
        let every = poses.clone().count().div_ceil(CURVE_POSES).max(1);
        let some: Vec<Passed> = poses.clone().step_by(every).collect();
        let beyond_s = delay_s.abs().max(CURVE_BEYOND_S);
        let (from_s, to_s) = (delay_s.min(0.0) - beyond_s, delay_s.max(0.0) + beyond_s);
        let step_s = (to_s - from_s) / (CURVE_POINTS - 1) as f64;
        let mut delays_s: Vec<f64> = (0..CURVE_POINTS)
            .map(|k| from_s + k as f64 * step_s)
            .collect();
        // The two that matter are on the curve.
        delays_s.extend([0.0, delay_s]);
        delays_s.sort_unstable_by(f64::total_cmp);
        delays_s.dedup();
        let curve = delays_s.into_iter().map(|assumed_s| {
            let some = some.iter().copied();
            (assumed_s, position_rms_m(some, reference, assumed_s))
        });
        Delay {
            delay_s,
            sigma_s,
            interval_s: [delay_s - WIDE * sigma_s, delay_s + WIDE * sigma_s],
            removed: false,
            samples: found.samples,
            effective_n: found.effective_n,
            rms_before_m: position_rms_m(poses.clone(), reference, 0.0),
            rms_after_m: position_rms_m(poses.clone(), reference, delay_s),
            curve: curve.collect(),
        }
    }

    /// What of the rms the delay makes, m: sqrt(before^2 - after^2); 0 where it makes it smaller.
    pub fn share_m(&self) -> f64 {
        let squares = self.rms_before_m.powi(2) - self.rms_after_m.powi(2);
        // Not f64::max, which would make a number of NaN.
        if squares < 0.0 { 0.0 } else { squares.sqrt() }
    }

    /// Whether zero is outside its interval; a given one is.
    pub fn is_seen(&self) -> bool {
        let [low, high] = self.interval_s;
        !(low <= 0.0 && high >= 0.0)
    }

    /// It in a sentence.
    pub fn sentence(&self) -> String {
        let mm = |m: f64| significant(m * 1e3);
        let ms = fixed(self.delay_s * 1e3, 1);
        let before = mm(self.rms_before_m);
        if !self.is_seen() {
            return format!("{before} mm of rms; no delay is seen in it");
        }
        if self.rms_after_m > self.rms_before_m {
            let after = mm(self.rms_after_m);
            return format!(
                "{before} mm of rms, which a delay of {ms} ms does not explain ({after} mm without it)"
            );
        }
        format!(
            "{before} mm of rms, of which the delay of {ms} ms made {}; without it {} mm",
            mm(self.share_m()),
            mm(self.rms_after_m)
        )
    }

    /// It in numbers, with its uncertainty where that is known.
    pub fn figure(&self) -> String {
        let [low, high] = self.interval_s.map(|s| fixed(s * 1e3, 3));
        let delay = fixed(self.delay_s * 1e3, 3);
        if self.sigma_s.is_finite() {
            let sigma = fixed(self.sigma_s * 1e3, 3);
            format!("{delay} ms, sigma {sigma} ms (95 %: {low} to {high} ms)")
        } else {
            format!("{delay} ms, as given")
        }
    }
}

/// Three digits that count: 43.7, 4.12, 0.41.
fn significant(value: f64) -> String {
    let decimals = match value.abs() {
        v if v >= 100.0 => 0,
        v if v >= 10.0 => 1,
        _ => 2,
    };
    fixed(value, decimals)
}

/// Rms distance of the positions from the reference `delay_s` before them, m, over those that have
/// one; NaN for none.
fn position_rms_m(poses: impl Iterator<Item = Passed>, reference: &Reference, delay_s: f64) -> f64 {
    let (mut place, mut squares, mut count) = (0, 0.0, 0usize);
    for pose in poses {
        let Ok((truth, _)) = reference.at_next(&mut place, earlier(pose.stamp, delay_s)) else {
            continue;
        };
        let off = pose.position_m.iter().zip(&truth);
        let off2: f64 = off.map(|(p, t)| (p - t).powi(2)).sum();
        if off2.is_finite() {
            squares += off2;
            count += 1;
        }
    }
    (squares / count as f64).sqrt()
}

/// The instant `delay_s` before a stamp: when what it is stamped for was so.
pub(super) fn earlier(stamp: Stamp, delay_s: f64) -> Stamp {
    stamp.plus_s(-delay_s)
}

/// The reference as a motion: its positions by cubics with its velocities, or with those that the
/// points' neighbours give. Rotations are not used.
struct Followed<'a> {
    reference: &'a Reference,
    start: Stamp,
    /// Where the last instant was: the next one is mostly near.
    place: Cell<usize>,
}

impl<'a> Followed<'a> {
    fn new(reference: &'a Reference, start: Stamp) -> Self {
        Followed {
            reference,
            start,
            place: Cell::new(0),
        }
    }

    /// The velocity at a point, m/s.
    fn velocity_m_s(&self, index: usize) -> Vector3<f64> {
        let points = self.reference.points();
        let own = points.get(index).map(|p| Vector3::from(p.velocity_m_s));
        if let Some(own) = own.filter(|v| v.iter().all(|v| v.is_finite())) {
            return own;
        }
        let chord = |a: usize, b: usize| {
            let (a, b) = (points.get(a)?, points.get(b)?);
            let dt = b.stamp.since_s(a.stamp);
            Some((
                (Vector3::from(b.position_m) - Vector3::from(a.position_m)) / dt,
                dt,
            ))
        };
        // The slope of the parabola through the point and its neighbours.
        match (
            index.checked_sub(1).and_then(|a| chord(a, index)),
            chord(index, index + 1),
        ) {
            (Some((s0, h0)), Some((s1, h1))) => (s0 * h1 + s1 * h0) / (h0 + h1),
            (Some((s, _)), None) | (None, Some((s, _))) => s,
            (None, None) => Vector3::zeros(),
        }
    }
}

impl Motion for Followed<'_> {
    fn at(&self, t_s: f64) -> State {
        let points = self.reference.points();
        let mut place = self.place.get();
        let next = self.reference.next(&mut place, self.start.plus_s(t_s));
        self.place.set(place);
        let mut state = State {
            position_m: Vector3::zeros(),
            rotation_rad: Vector3::zeros(),
            velocity_m_s: Vector3::zeros(),
            rotation_rate_rad_s: Vector3::zeros(),
            acceleration_m_s2: Vector3::zeros(),
        };
        let before = next.checked_sub(1);
        match (before.and_then(|i| points.get(i)), points.get(next)) {
            (Some(a), Some(b)) => {
                let h = b.stamp.since_s(a.stamp);
                let u = (t_s - a.stamp.since_s(self.start)) / h;
                let (p, q) = (Vector3::from(a.position_m), Vector3::from(b.position_m));
                let from = self.velocity_m_s(next - 1) * h;
                let to = self.velocity_m_s(next) * h;
                let (c2, c3) = ((q - p) * 3.0 - from * 2.0 - to, (p - q) * 2.0 + from + to);
                state.position_m = p + (from + (c2 + c3 * u) * u) * u;
                state.velocity_m_s = (from + (c2 * 2.0 + c3 * (3.0 * u)) * u) / h;
                state.acceleration_m_s2 = (c2 * 2.0 + c3 * (6.0 * u)) / (h * h);
            }
            (Some(point), None) | (None, Some(point)) => state.position_m = point.position_m.into(),
            (None, None) => {}
        }
        state
    }

    fn duration_s(&self) -> f64 {
        let span = self.reference.span();
        span.map_or(0.0, |(_, last)| last.since_s(self.start))
    }
}

#[cfg(test)]
mod tests {
    use super::super::association::Limits;
    use super::*;
    use crate::motion::Sampled;
    use crate::record::TrajectoryPoint;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    fn place(t: f64) -> [f64; 3] {
        [
            0.02 * (0.2 * t).sin(),
            3.2 * (0.45 * t).sin(),
            2.2 + 1.2 * (0.63 * t).cos(),
        ]
    }

    fn points(n: i64) -> Vec<TrajectoryPoint> {
        (0..n)
            .map(|i| TrajectoryPoint {
                stamp: Stamp::from_ns(i * 10_000_000),
                position_m: place(i as f64 * 0.01),
                rotation_rad: [0.0; 3],
                ..TrajectoryPoint::default()
            })
            .collect()
    }

    /// Poses `delay_s` late with noise of 2 mm and the given memory.
    fn late(reference: &Reference, n: i64, delay_s: f64, memory: f64, seed: u64) -> Vec<Passed> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let (mut state, mut place_hint) = ([0.0; 3], 0);
        (0..n)
            .map(|i| {
                let t = i as f64 * 0.01;
                let stamp = Stamp::from_ns(i * 10_000_000);
                let mut position_m = place(t - delay_s);
                for (p, state) in position_m.iter_mut().zip(&mut state) {
                    let white: f64 = StandardNormal.sample(&mut random);
                    *state = memory * *state + (1.0 - memory * memory).sqrt() * white;
                    *p += 0.002 * *state;
                }
                let velocity_m_s = reference.velocity_m_s(&mut place_hint, stamp);
                Passed {
                    stamp,
                    position_m,
                    velocity_m_s,
                }
            })
            .collect()
    }

    #[test]
    fn the_followed_reference_is_the_sampled_motion() {
        let points = points(300);
        let reference = Reference::new(points.clone(), Limits::default());
        let sampled = Sampled::new(&points).unwrap();
        let followed = Followed::new(&reference, points[0].stamp);
        for k in 0..700 {
            let t_s = -0.1 + f64::from(k) * 0.004_567;
            let (a, b) = (followed.at(t_s), sampled.at(t_s));
            assert!((a.position_m - b.position_m).norm() < 1e-9, "{t_s}");
            assert!(
                (a.velocity_m_s - b.velocity_m_s).norm() < 1e-6,
                "{t_s}: {a:?} {b:?}"
            );
        }
        assert_eq!(followed.duration_s(), sampled.duration_s());
    }

    #[test]
    fn correlated_errors_widen_the_interval_until_it_is_honest() {
        let reference = Reference::new(points(4000), Limits::default());
        for memory in [0.0, 0.95] {
            let (mut covered, mut squares) = (0, 0.0);
            let runs = 60;
            for seed in 0..runs {
                let poses = late(&reference, 4000, 0.037, memory, seed);
                let found = estimate(poses.iter().copied(), &reference).unwrap();
                let off = (found.delay_s - 0.037) / found.sigma_s;
                covered += i32::from(off.abs() <= WIDE);
                squares += off * off / runs as f64;
            }
            assert!(
                (51..=60).contains(&covered),
                "{memory}: {covered} of {runs}"
            );
            assert!((0.5..1.8).contains(&squares), "{memory}: {squares}");
        }
    }

    #[test]
    fn the_sentence_says_what_the_delay_made() {
        let reference = Reference::new(points(6000), Limits::default());
        let poses = late(&reference, 6000, 0.037, 0.0, 7);
        let found = estimate(poses.iter().copied(), &reference).unwrap();
        let delay = Delay::of(found, poses.iter().copied(), &reference);
        assert!(
            delay.is_seen() && (delay.delay_s - 0.037).abs() < 1e-4,
            "{delay:?}"
        );
        assert!((delay.rms_after_m / (0.002 * 3f64.sqrt()) - 1.0).abs() < 0.03);
        let lowest = delay
            .curve
            .iter()
            .min_by(|a, b| a.1.total_cmp(&b.1))
            .unwrap();
        assert!((lowest.0 - delay.delay_s).abs() < 3e-3, "{lowest:?}");
        assert!(delay.curve.iter().any(|p| p.0 == 0.0) && delay.curve.len() <= 62);
        let text = delay.sentence();
        assert!(
            text.contains("of which the delay of 37.0 ms made ") && text.contains("without it 3.4"),
            "{text}"
        );
        let on_time = late(&reference, 6000, 0.0, 0.0, 8);
        let found = estimate(on_time.iter().copied(), &reference).unwrap();
        let none = Delay {
            interval_s: [-1e-3, 1e-3],
            ..Delay::of(found, on_time.iter().copied(), &reference)
        };
        assert!(
            none.sentence().ends_with("no delay is seen in it"),
            "{}",
            none.sentence()
        );
    }

    #[test]
    fn what_does_not_move_has_no_delay() {
        let mut standing = points(1000);
        standing.iter_mut().for_each(|p| p.position_m = [1.0; 3]);
        let reference = Reference::new(standing, Limits::default());
        let poses = late(&reference, 1000, 0.0, 0.0, 1);
        assert!(
            estimate(poses.iter().copied(), &reference)
                .unwrap_err()
                .contains("stands still")
        );
        let mut grid = points(1000);
        grid.iter_mut()
            .enumerate()
            .for_each(|(i, p)| p.position_m = [0.2 * i as f64, 0.0, 0.0]);
        let reference = Reference::new(grid, Limits::default());
        let poses = late(&reference, 1000, 0.0, 0.0, 1);
        assert!(
            estimate(poses.iter().copied(), &reference)
                .unwrap_err()
                .contains("no continuous")
        );
        assert!(estimate(std::iter::empty(), &Reference::default()).is_err());
    }
}
