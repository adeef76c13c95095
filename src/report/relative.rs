//! Relative pose error: how wrong the way from one pose to a later one is, which an alignment does
//! not change and a slow drift hardly shows.
//!
//! E = (Q_i^-1 Q_j)^-1 (P_i^-1 P_j) with Q the reference's and P the measured poses (Sturm et al.
//! 2012, eq. 1). Its translation is given along the axes of the platform at j and as a length, its
//! rotation as roll, pitch, yaw and as an angle.

use super::align::Placed;
use super::axis::AXES;
use super::statistics::Statistics;
use crate::record::Stamp;

/// How far apart the two poses of a pair are.
#[derive(Clone, Debug, PartialEq)]
pub struct Delta {
    /// As given: `1s`, `500mm`, `10f`.
    pub text: String,
    /// In numbers.
    pub span: Span,
}

/// A distance between two poses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Span {
    /// In time, s.
    Time(f64),
    /// Along the reference's way, m.
    Distance(f64),
    /// In compared poses.
    Frames(usize),
}

/// Which pairs are taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Pairs {
    /// Each begins where the one before ended.
    #[default]
    Consecutive,
    /// One begins at every pose.
    All,
}

/// Why a text is no [`Delta`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("a time (1s, 500ms), a distance (1m, 500mm) or a number of poses (10f) is wanted")]
pub struct DeltaError;

impl std::str::FromStr for Delta {
    type Err = DeltaError;

    fn from_str(text: &str) -> Result<Delta, DeltaError> {
        let number = |digits: &str| -> Result<f64, DeltaError> {
            let value: f64 = digits.trim_end().parse().map_err(|_| DeltaError)?;
            let sensible = value > 0.0 && value < 1e9;
            sensible.then_some(value).ok_or(DeltaError)
        };
        // The longer units first: "ms" ends with "s", "mm" with "m".
        let span = if let Some(digits) = text.strip_suffix("ms") {
            Span::Time(number(digits)? * 1e-3)
        } else if let Some(digits) = text.strip_suffix('s') {
            Span::Time(number(digits)?)
        } else if let Some(digits) = text.strip_suffix("mm") {
            Span::Distance(number(digits)? * 1e-3)
        } else if let Some(digits) = text.strip_suffix("cm") {
            Span::Distance(number(digits)? * 1e-2)
        } else if let Some(digits) = text.strip_suffix('m') {
            Span::Distance(number(digits)?)
        } else if let Some(digits) = text.strip_suffix('f') {
            let frames: usize = digits.parse().map_err(|_| DeltaError)?;
            Span::Frames(Some(frames).filter(|n| *n > 0).ok_or(DeltaError)?)
        } else {
            return Err(DeltaError);
        };
        Ok(Delta {
            text: text.to_owned(),
            span,
        })
    }
}

/// The relative errors of one distance.
#[derive(Clone, Debug, PartialEq)]
pub struct Relative {
    /// How far apart the poses of a pair are.
    pub delta: Delta,
    /// Pairs.
    pub pairs: usize,
    /// In the order of [`AXES`], m and rad.
    pub axes: Vec<Statistics>,
}

/// A reference pose at an instant, and what the measured one is off it; all six numbers are known.
#[derive(Clone, Copy, Debug)]
pub(super) struct Step<'a> {
    pub stamp: Stamp,
    pub reference: &'a [f64; 6],
    pub error: &'a [f64; 6],
}

impl Step<'_> {
    fn measured(&self) -> [f64; 6] {
        [0, 1, 2, 3, 4, 5].map(|i| self.reference[i] + self.error[i])
    }
}

/// What a time or a way may differ from the one wanted, as a share of it (of all pairs; evo's
/// `--delta_tol`).
const TOLERANCE: f64 = 0.1;

impl Relative {
    /// The errors over `steps`, in order of time.
    pub(super) fn of(delta: &Delta, kind: Pairs, steps: &[Step<'_>]) -> Relative {
        let pairs = match delta.span {
            Span::Frames(count) => by_frames(steps.len(), count, kind),
            Span::Time(span_s) => by_time(steps, span_s, kind),
            Span::Distance(span_m) => by_distance(steps, span_m, kind),
        };
        let errors: Vec<[f64; 8]> = pairs
            .iter()
            .filter_map(|(i, j)| Some(error(steps.get(*i)?, steps.get(*j)?)))
            .collect();
        let mut column = Vec::with_capacity(errors.len());
        let axes = (0..AXES.len()).map(|axis| {
            column.clear();
            column.extend(errors.iter().filter_map(|e| e.get(axis)));
            Statistics::of(&mut column)
        });
        Relative {
            delta: delta.clone(),
            axes: axes.collect(),
            pairs: pairs.len(),
        }
    }
}

/// The relative error of one pair in the order of [`AXES`].
fn error(i: &Step<'_>, j: &Step<'_>) -> [f64; 8] {
    let way = |from: &[f64; 6], to: &[f64; 6]| {
        let (from, to) = (Placed::new(from), Placed::new(to));
        let back = from.rotation.inverse();
        Placed {
            position_m: back * (to.position_m - from.position_m),
            rotation: back * to.rotation,
        }
    };
    let (wanted, measured) = (
        way(i.reference, j.reference),
        way(&i.measured(), &j.measured()),
    );
    let back = wanted.rotation.inverse();
    let off = back * (measured.position_m - wanted.position_m);
    let turned = back * measured.rotation;
    let (roll, pitch, yaw) = turned.euler_angles();
    [
        off.x,
        off.y,
        off.z,
        roll,
        pitch,
        yaw,
        off.norm(),
        turned.angle(),
    ]
}

fn by_frames(n: usize, count: usize, kind: Pairs) -> Vec<(usize, usize)> {
    let step = match kind {
        Pairs::Consecutive => count,
        Pairs::All => 1,
    };
    let starts = (0..n).step_by(step.max(1));
    starts
        .map(|i| (i, i + count))
        .take_while(|(_, j)| *j < n)
        .collect()
}

/// Pairs that lie `span_s` apart. Stamps that jitter by less than half a spacing count as even; where
/// poses are missing so that the next one is later by more than the tolerance, there is no pair.
fn by_time(steps: &[Step<'_>], span_s: f64, kind: Pairs) -> Vec<(usize, usize)> {
    let mut spacings: Vec<f64> = steps
        .windows(2)
        .filter_map(|w| match w {
            [a, b] => Some(b.stamp.since_s(a.stamp)),
            _ => None,
        })
        .collect();
    let spacing_s = super::statistics::percentile_of(&mut spacings, 50.0);
    let least_s = span_s - 0.5 * spacing_s.min(span_s);
    let most_s = span_s + (TOLERANCE * span_s).max(0.5 * spacing_s);
    let (mut pairs, mut i, mut j) = (Vec::new(), 0, 0);
    while let Some(from) = steps.get(i) {
        let since_s = |j: usize| steps.get(j).map(|to| to.stamp.since_s(from.stamp));
        while since_s(j).is_some_and(|s| s < least_s) {
            j += 1;
        }
        let Some(s) = since_s(j) else {
            break;
        };
        let is_pair = j > i && s <= most_s;
        if is_pair {
            pairs.push((i, j));
        }
        i = match kind {
            Pairs::Consecutive => j.max(i + 1),
            Pairs::All => i + 1,
        };
    }
    pairs
}

/// Pairs that lie `span_m` of the reference's way apart: consecutive ones as soon as it is reached;
/// of all pairs the nearest to it, within the tolerance.
fn by_distance(steps: &[Step<'_>], span_m: f64, kind: Pairs) -> Vec<(usize, usize)> {
    let mut way_m = vec![0.0];
    let ways = steps.windows(2).filter_map(|w| match w {
        [a, b] => {
            let a = Placed::new(a.reference).position_m;
            Some((Placed::new(b.reference).position_m - a).norm())
        }
        _ => None,
    });
    let mut pairs = Vec::new();
    if kind == Pairs::Consecutive {
        let (mut since_m, mut from) = (0.0, 0);
        for (i, step_m) in ways.enumerate() {
            since_m += step_m;
            if since_m >= span_m {
                pairs.push((from, i + 1));
                (since_m, from) = (0.0, i + 1);
            }
        }
        return pairs;
    }
    for step_m in ways {
        way_m.push(way_m.last().copied().unwrap_or(0.0) + step_m);
    }
    for (i, from_m) in way_m.iter().enumerate().take(steps.len()) {
        let later = way_m.get(i + 1..).unwrap_or_default();
        let after = later.partition_point(|m| *m - from_m < span_m);
        let off = |k: usize| later.get(k).map(|m| (m - from_m - span_m).abs());
        // The first of those that are equally near.
        let before = after.checked_sub(1).and_then(|k| {
            let m = *later.get(k)?;
            Some(later.partition_point(|other| *other < m))
        });
        let nearest = match (before, before.and_then(off), off(after)) {
            (Some(k), Some(a), Some(b)) if a <= b => Some((k, a)),
            (Some(k), Some(a), None) => Some((k, a)),
            (_, _, Some(b)) => Some((after, b)),
            _ => None,
        };
        if let Some((k, off_m)) = nearest
            && off_m <= TOLERANCE * span_m
        {
            pairs.push((i, i + 1 + k));
        }
    }
    pairs
}

#[cfg(test)]
mod tests {
    use super::*;

    fn step(ms: i64, y: f64, measured_y: f64, yaw: f64) -> Step<'static> {
        Step {
            stamp: Stamp::from_ns(ms * 1_000_000),
            reference: Box::leak(Box::new([0.0, y, 0.0, 0.0, 0.0, 0.0])),
            error: Box::leak(Box::new([0.0, measured_y - y, 0.0, 0.0, 0.0, yaw])),
        }
    }

    #[test]
    fn texts() {
        for (text, span) in [
            ("1s", Span::Time(1.0)),
            ("250ms", Span::Time(0.25)),
            ("1m", Span::Distance(1.0)),
            ("500mm", Span::Distance(0.5)),
            ("20cm", Span::Distance(0.2)),
            ("10f", Span::Frames(10)),
        ] {
            assert_eq!(text.parse::<Delta>().unwrap().span, span);
        }
        for bad in [
            "", "1", "0s", "-1m", "1.5f", "0f", "nans", "infm", "s", "1 min",
        ] {
            assert_eq!(bad.parse::<Delta>(), Err(DeltaError), "{bad}");
        }
    }

    #[test]
    fn a_scale_error_and_a_drift_are_seen() {
        // 2 % too long, and the platform turns by 1 mrad per 10 ms as measured.
        let steps: Vec<Step<'_>> = (0..1000)
            .map(|i| step(i * 10, 0.01 * i as f64, 0.0102 * i as f64, 0.0))
            .collect();
        for (text, kind, pairs, want) in [
            ("100f", Pairs::Consecutive, 9, 0.02),
            ("100f", Pairs::All, 900, 0.02),
            ("1s", Pairs::Consecutive, 9, 0.02),
            ("1s", Pairs::All, 900, 0.02),
            ("999mm", Pairs::Consecutive, 9, 0.02),
            ("2m", Pairs::All, 800, 0.04),
        ] {
            let found = Relative::of(&text.parse().unwrap(), kind, &steps);
            // Sums of hundredths may just miss a whole metre: one pose more or less.
            assert!(
                found.pairs.abs_diff(pairs) <= 20,
                "{text} {kind:?}: {}",
                found.pairs
            );
            let rms = found.axes[6].rms;
            assert!((rms / want - 1.0).abs() < 0.02, "{text} {kind:?}: {rms}");
            assert!((found.axes[1].bias - rms).abs() < 1e-4 && found.axes[7].rms < 1e-12);
        }
        let turning: Vec<Step<'_>> = (0..500)
            .map(|i| step(i * 10, 0.0, 0.0, 0.001 * i as f64))
            .collect();
        let found = Relative::of(&"20f".parse().unwrap(), Pairs::All, &turning);
        assert!(
            (found.axes[7].rms - 0.02).abs() < 1e-12 && (found.axes[5].bias - 0.02).abs() < 1e-12
        );
    }

    #[test]
    fn gaps_and_jitter_in_time() {
        let jitter = |i: i64| if i % 2 == 0 { 0 } else { 3 };
        let mut steps: Vec<Step<'_>> = (0..400)
            .map(|i| step(i * 10 + jitter(i), 0.0, 0.0, 0.0))
            .collect();
        let all = Relative::of(&"1s".parse().unwrap(), Pairs::All, &steps);
        assert_eq!(all.pairs, 300);
        steps.drain(100..290);
        let all = Relative::of(&"1s".parse().unwrap(), Pairs::All, &steps);
        // Only those within the last 1.1 s have a partner, and none across the hole.
        assert_eq!(all.pairs, 10);
        for text in ["1s", "1m", "10f"] {
            for kind in [Pairs::All, Pairs::Consecutive] {
                assert_eq!(Relative::of(&text.parse().unwrap(), kind, &[]).pairs, 0);
            }
        }
    }
}
