//! Delays by correlation and by the derivative, as they are commonly found.

use super::{DelayError, DelaySettings, LEAST, Measured, axes, median, travel_m};
use crate::motion::Motion;

/// The axis along which the motion goes farthest, of those that are used.
pub(super) fn main_axis(
    motion: &dyn Motion,
    settings: &DelaySettings,
) -> Result<usize, DelayError> {
    let travel_m = travel_m(motion);
    let longest = axes(motion, settings.axes)?
        .into_iter()
        .max_by(|a, b| travel_m[*a].total_cmp(&travel_m[*b]));
    longest.ok_or(DelayError::Still)
}

/// Median time between two measurements, s.
pub(super) fn interval_s(measured: &[Measured]) -> f64 {
    let mut steps: Vec<f64> = measured
        .windows(2)
        .filter_map(|pair| match pair {
            [a, b] if b.t_s > a.t_s => Some(b.t_s - a.t_s),
            _ => None,
        })
        .collect();
    median(&mut steps)
}

/// Desired and measured on one even grid over the desired motion's duration: the measurement
/// interpolated, and held at its ends.
fn gridded(
    measured: &[Measured],
    motion: &dyn Motion,
    axis: usize,
) -> Result<(f64, Vec<f64>, Vec<f64>), DelayError> {
    let known: Vec<(f64, f64)> = measured
        .iter()
        .map(|m| (m.t_s, m.position_m[axis]))
        .filter(|(_, y)| y.is_finite())
        .collect();
    let step_s = interval_s(measured);
    let (Some(first), Some(last)) = (known.first(), known.last()) else {
        return Err(DelayError::TooFew {
            found: 0,
            needed: LEAST,
        });
    };
    let (from_s, to_s) = (first.0.max(0.0), last.0.min(motion.duration_s()));
    let count = ((to_s - from_s) / step_s).floor();
    if !(count >= LEAST as f64) || count > 1e8 {
        return Err(DelayError::TooFew {
            found: count.max(0.0) as usize,
            needed: LEAST,
        });
    }
    let times = (0..=count as usize).map(|k| from_s + k as f64 * step_s);
    let interpolated = |t: f64| {
        let next = known.partition_point(|(s, _)| *s <= t);
        match (
            next.checked_sub(1).and_then(|k| known.get(k)),
            known.get(next),
        ) {
            (Some((s0, y0)), Some((s1, y1))) => y0 + (y1 - y0) * (t - s0) / (s1 - s0),
            (Some((_, y)), None) | (None, Some((_, y))) => *y,
            (None, None) => f64::NAN,
        }
    };
    let desired = times.clone().map(|t| motion.at(t).position_m[axis]);
    Ok((step_s, desired.collect(), times.map(interpolated).collect()))
}

/// Plain cross-correlation, as the dissertation has it (section 5.2): means removed, the full
/// correlation, its highest whole step. The overlap shrinks with the lag, which draws the result to
/// zero where the platform dwells at the ends of its way.
///
/// # Errors
/// [`DelayError`] where there is nothing to correlate.
pub fn plain(
    measured: &[Measured],
    motion: &dyn Motion,
    settings: &DelaySettings,
) -> Result<f64, DelayError> {
    let axis = main_axis(motion, settings)?;
    let (step_s, desired, measured) = gridded(measured, motion, axis)?;
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let (mean_d, mean_m) = (mean(&desired), mean(&measured));
    let most = (settings.most_s / step_s).ceil() as i64;
    let product = |lag: i64| -> f64 {
        let (skip_m, skip_d) = (lag.max(0) as usize, (-lag).max(0) as usize);
        let pairs = measured
            .iter()
            .skip(skip_m)
            .zip(desired.iter().skip(skip_d));
        pairs.map(|(m, d)| (m - mean_m) * (d - mean_d)).sum()
    };
    let best = (-most..=most).max_by(|a, b| product(*a).total_cmp(&product(*b)));
    Ok(best.unwrap_or(0) as f64 * step_s)
}

/// How far the measurement is off the desired motion delayed by `delay_s`, with gain and offset of
/// each axis at their best: sum over the axes of n ln(squares left), and how many samples took part.
fn misfit(
    measured: &[Measured],
    motion: &dyn Motion,
    axes: &[usize],
    delay_s: f64,
) -> (f64, usize) {
    let mut sums = [[0.0f64; 6]; 3];
    for m in measured {
        let t_s = m.t_s - delay_s;
        if !(0.0..=motion.duration_s()).contains(&t_s) {
            continue;
        }
        let desired_m = motion.at(t_s).position_m;
        for axis in axes {
            let (d, y) = (desired_m[*axis], m.position_m[*axis]);
            if let Some(sums) = sums.get_mut(*axis)
                && y.is_finite()
            {
                let terms = [1.0, d, y, d * d, d * y, y * y];
                sums.iter_mut()
                    .zip(terms)
                    .for_each(|(sum, term)| *sum += term);
            }
        }
    }
    let (mut total, mut used) = (0.0, 0);
    for axis in axes {
        let [n, d, y, dd, dy, yy] = sums.get(*axis).copied().unwrap_or_default();
        if n < LEAST as f64 {
            return (f64::INFINITY, n as usize);
        }
        let (dd, dy, yy) = (dd - d * d / n, dy - d * y / n, yy - y * y / n);
        // Moving the other way is no correlation.
        let explained = if dd > 0.0 && dy > 0.0 {
            dy * dy / dd
        } else {
            0.0
        };
        total += ((yy - explained).max(1e-18 * n) / n).ln();
        used = used.max(n as usize);
    }
    (total, used)
}

/// Correlation normalised on each overlap (least squares with gain and offset free), refined by a
/// parabola through its highest point and the two beside it. Sums over all axes used.
///
/// # Errors
/// [`DelayError`] where there is too little to correlate.
pub fn parabolic(
    measured: &[Measured],
    motion: &dyn Motion,
    settings: &DelaySettings,
) -> Result<f64, DelayError> {
    let axes = axes(motion, settings.axes)?;
    let step_s = interval_s(measured);
    parabolic_of(measured, motion, settings, &axes, step_s)
}

/// Measurements that a first estimate is made from,
const ENOUGH: usize = 2000;
/// and steps to either side, at least.
const LEAST_STEPS: f64 = 25.0;

/// The estimate that the fit begins with: [`parabolic`] of no more measurements than it takes to find
/// the right place, evenly chosen, in steps of the interval between all of them or smaller ones.
pub(super) fn seed(
    measured: &[Measured],
    motion: &dyn Motion,
    settings: &DelaySettings,
) -> Result<f64, DelayError> {
    let axes = axes(motion, settings.axes)?;
    let step_s = interval_s(measured).min(settings.most_s / LEAST_STEPS);
    let every = measured.len().div_ceil(ENOUGH).max(1);
    let chosen: Vec<Measured> = measured.iter().step_by(every).copied().collect();
    parabolic_of(&chosen, motion, settings, &axes, step_s)
}

fn parabolic_of(
    measured: &[Measured],
    motion: &dyn Motion,
    settings: &DelaySettings,
    axes: &[usize],
    step_s: f64,
) -> Result<f64, DelayError> {
    let too_few = |found| DelayError::TooFew {
        found,
        needed: LEAST,
    };
    if !(step_s > 0.0) {
        return Err(too_few(measured.len()));
    }
    let most = (settings.most_s / step_s).ceil().min(1e6) as i64;
    let all: Vec<(f64, usize)> = (-most..=most)
        .map(|lag| misfit(measured, motion, axes, lag as f64 * step_s))
        .collect();
    let best = (0..all.len())
        .filter(|k| all.get(*k).is_some_and(|(m, _)| m.is_finite()))
        .min_by(|a, b| {
            let at = |k: &usize| all.get(*k).map_or(f64::INFINITY, |(misfit, _)| *misfit);
            at(a).total_cmp(&at(b))
        });
    let Some(best) = best else {
        return Err(too_few(all.iter().map(|(_, n)| *n).max().unwrap_or(0)));
    };
    let coefficient = |k: usize| all.get(k).map(|(misfit, _)| -misfit.exp());
    let lag_s = (best as i64 - most) as f64 * step_s;
    let beside = best
        .checked_sub(1)
        .and_then(coefficient)
        .zip(coefficient(best + 1));
    Ok(match (beside, coefficient(best)) {
        (Some((before, after)), Some(peak)) => {
            let bend = before - 2.0 * peak + after;
            let off = if bend < 0.0 {
                (before - after) / (2.0 * bend)
            } else {
                0.0
            };
            lag_s + off.clamp(-0.5, 0.5) * step_s
        }
        _ => lag_s,
    })
}

/// One linear step: sum (desired - measured) v / sum v^2 with v the desired velocity. For small
/// delays only.
///
/// # Errors
/// [`DelayError::Still`] where nothing moves.
pub fn derivative(
    measured: &[Measured],
    motion: &dyn Motion,
    settings: &DelaySettings,
) -> Result<f64, DelayError> {
    let axes = axes(motion, settings.axes)?;
    let (mut numerator, mut denominator) = (0.0, 0.0);
    for m in measured {
        if !(0.0..=motion.duration_s()).contains(&m.t_s) {
            continue;
        }
        let state = motion.at(m.t_s);
        for axis in &axes {
            let (off_m, v) = (
                state.position_m[*axis] - m.position_m[*axis],
                state.velocity_m_s[*axis],
            );
            if off_m.is_finite() {
                numerator += off_m * v;
                denominator += v * v;
            }
        }
    }
    if denominator > 0.0 {
        Ok(numerator / denominator)
    } else {
        Err(DelayError::Still)
    }
}
