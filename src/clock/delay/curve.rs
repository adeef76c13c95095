//! The error that is left when a delay is assumed.

use super::Measured;
use crate::motion::Motion;
use crate::record::{DelayPoint, Stamp};

/// For each assumed delay the rms and the largest distance, along each axis, between the measurement
/// and the desired motion delayed so. `start` is the desired motion's start.
pub fn curve(
    measured: &[Measured],
    motion: &dyn Motion,
    start: Stamp,
    delays_s: impl IntoIterator<Item = f64>,
) -> Vec<DelayPoint> {
    let point = |delay_s: f64| {
        let (mut squares, mut most, mut count) = ([0.0; 3], [0.0f64; 3], [0u32; 3]);
        for m in measured {
            let t_s = m.t_s - delay_s;
            if !(0.0..=motion.duration_s()).contains(&t_s) {
                continue;
            }
            let off_m = m.position_m - motion.at(t_s).position_m;
            for axis in 0..3 {
                let off = off_m[axis].abs();
                if off.is_finite() {
                    squares[axis] += off * off;
                    most[axis] = most[axis].max(off);
                    count[axis] += 1;
                }
            }
        }
        let some = |axis: usize, value: f64| if count[axis] > 0 { value } else { f64::NAN };
        let rms = |axis: usize| some(axis, (squares[axis] / f64::from(count[axis])).sqrt());
        DelayPoint {
            stamp: start,
            delay_s,
            samples: count.into_iter().max().unwrap_or(0),
            rms_m: [rms(0), rms(1), rms(2)],
            max_m: [some(0, most[0]), some(1, most[1]), some(2, most[2])],
        }
    };
    delays_s.into_iter().map(point).collect()
}
