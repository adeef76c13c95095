//! The measured orientation against an IMU's: constant differences, drift, what is left, and the
//! rates against the gyros'.
//!
//! Both are taken in the platform's axes. The difference is pose minus IMU; a line over time is fitted
//! to it, so that an IMU whose yaw has another zero and wanders is told from noise. Where solve-pose
//! took its pitch from the same IMU, pitch says nothing of either.

use super::statistics::{Statistics, wrap_angle};
use super::trace::Trace;
use crate::record::{ImuSample, Stamp};
use nalgebra::{Rotation3, Vector3};

/// Attitudes and rates of a record, in the platform's axes and in order of time.
#[derive(Clone, Debug, Default)]
pub struct Attitudes {
    source: String,
    samples: Vec<Attitude>,
}

#[derive(Clone, Copy, Debug)]
struct Attitude {
    stamp: Stamp,
    /// Roll, pitch, yaw, rad.
    angles_rad: [f64; 3],
    /// Integral of the angular rate about the body's axes since the first sample, rad.
    turned_rad: [f64; 3],
}

/// A pose's orientation at an instant; components that are not known are NaN.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    pub stamp: Stamp,
    /// Roll, pitch, yaw, rad.
    pub angles_rad: [f64; 3],
}

/// The comparison.
#[derive(Clone, Debug, PartialEq)]
pub struct Orientation {
    /// Where the IMU's record came from.
    pub source: String,
    /// Roll, pitch, yaw.
    pub angles: Vec<AngleResult>,
    /// About x, y, z of the platform; without gyros, and without whole orientations, all are empty.
    pub rates: Vec<RateResult>,
}

/// One angle: pose minus IMU.
#[derive(Clone, Debug, PartialEq)]
pub struct AngleResult {
    /// The fitted line's value in the middle of the comparison, rad.
    pub offset_rad: f64,
    /// Its slope, rad/s; NaN where the record is too short to tell it, and the line is level.
    pub drift_rad_s: f64,
    /// What is left, rad.
    pub residual: Statistics,
    /// The difference less the offset, over time, rad.
    pub trace: Trace,
}

/// One rate: that of the poses against the gyro's mean over the same short windows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RateResult {
    /// Windows.
    pub n: usize,
    /// Rms of the difference, rad/s.
    pub rms_rad_s: f64,
    /// Mean of the difference, rad/s: the gyro's constant error with the opposite sign.
    pub bias_rad_s: f64,
    /// The poses' rate over the gyro's, by least squares about their means: NaN where nothing turns
    /// by more than the difference's own scatter.
    pub scale: f64,
}

/// Rates are compared over windows of this length, s: short enough to see the motion, long enough for
/// the poses' noise.
pub const WINDOW_S: f64 = 0.2;
/// Samples further apart than this many usual spacings are not interpolated between.
const GAP: f64 = 5.0;
/// A shorter comparison tells no drift, s.
const DRIFTS_S: f64 = 10.0;
/// Fewer instants in common are no comparison.
const FEWEST: usize = 10;

impl Attitudes {
    /// Takes a sample in the platform's axes; they may come in any order.
    pub fn push(&mut self, sample: &ImuSample) {
        self.samples.push(Attitude {
            stamp: sample.stamp,
            angles_rad: [sample.roll_rad, sample.pitch_rad, sample.yaw_rad],
            // The rate, until all samples are there.
            turned_rad: [
                sample.gyro_x_rad_s,
                sample.gyro_y_rad_s,
                sample.gyro_z_rad_s,
            ],
        });
    }

    /// Sums the rates up, in order of time.
    #[must_use]
    pub fn finish(mut self, source: String) -> Attitudes {
        self.source = source;
        self.samples.sort_by_key(|s| s.stamp);
        self.samples.dedup_by_key(|s| s.stamp);
        let mut turned = Vector3::zeros();
        let mut before: Option<(Stamp, Vector3<f64>)> = None;
        for sample in &mut self.samples {
            let rate = Vector3::from(sample.turned_rad);
            if let Some((stamp, last)) = before {
                turned += (last + rate) * (0.5 * sample.stamp.since_s(stamp));
            }
            before = Some((sample.stamp, rate));
            sample.turned_rad = turned.into();
        }
        self
    }

    fn usual_s(&self) -> f64 {
        let pairs = self.samples.iter().zip(self.samples.iter().skip(1));
        let mut spacings: Vec<f64> = pairs.map(|(a, b)| b.stamp.since_s(a.stamp)).collect();
        super::statistics::percentile_of(&mut spacings, 50.0)
    }

    /// Angles and integrals at `stamp`, between two samples.
    fn at(&self, stamp: Stamp, longest_s: f64) -> Option<Attitude> {
        let next = self.samples.partition_point(|s| s.stamp < stamp);
        let b = self.samples.get(next)?;
        if b.stamp == stamp {
            return Some(*b);
        }
        let a = self.samples.get(next.checked_sub(1)?)?;
        let dt = b.stamp.since_s(a.stamp);
        if dt > longest_s {
            return None;
        }
        let share = stamp.since_s(a.stamp) / dt;
        let angle = |i: usize| {
            let turn = wrap_angle(b.angles_rad[i] - a.angles_rad[i]);
            a.angles_rad[i] + share * turn
        };
        let turned = |i: usize| a.turned_rad[i] + share * (b.turned_rad[i] - a.turned_rad[i]);
        Some(Attitude {
            stamp,
            angles_rad: [0, 1, 2].map(angle),
            turned_rad: [0, 1, 2].map(turned),
        })
    }

    /// Compares `poses`, in order of time, over a trace of `time`; none for too few in common.
    pub(super) fn compare(&self, poses: &[Seen], time: (Stamp, Stamp)) -> Option<Orientation> {
        let longest_s = GAP * self.usual_s();
        let pairs: Vec<(Seen, Attitude)> = poses
            .iter()
            .filter_map(|seen| Some((*seen, self.at(seen.stamp, longest_s)?)))
            .collect();
        if pairs.len() < FEWEST {
            return None;
        }
        Some(Orientation {
            source: self.source.clone(),
            angles: (0..3).map(|i| angle(&pairs, i, time)).collect(),
            rates: rates(&pairs),
        })
    }
}

fn angle(pairs: &[(Seen, Attitude)], i: usize, time: (Stamp, Stamp)) -> AngleResult {
    let start = pairs
        .first()
        .map_or(Stamp::default(), |(seen, _)| seen.stamp);
    // About the first difference, so that none is torn by the seam.
    let mut first = None;
    let off: Vec<(Stamp, f64, f64)> = pairs
        .iter()
        .filter_map(|(seen, imu)| {
            let difference = seen.angles_rad[i] - imu.angles_rad[i];
            if !difference.is_finite() {
                return None;
            }
            let about = *first.get_or_insert(difference);
            let turned = wrap_angle(difference - about);
            Some((seen.stamp, seen.stamp.since_s(start), turned))
        })
        .collect();
    let n = off.len() as f64;
    let mean = |value: fn(&(Stamp, f64, f64)) -> f64| off.iter().map(value).sum::<f64>() / n;
    let (mean_t, mean_d) = (mean(|o| o.1), mean(|o| o.2));
    let (mut tt, mut td) = (0.0, 0.0);
    for (_, t, d) in &off {
        tt += (t - mean_t).powi(2);
        td += (t - mean_t) * (d - mean_d);
    }
    let length_s = match (off.first(), off.last()) {
        (Some(a), Some(b)) => b.1 - a.1,
        _ => 0.0,
    };
    let slope = if length_s >= DRIFTS_S {
        td / tt
    } else {
        f64::NAN
    };
    let middle = match (off.first(), off.last()) {
        (Some(a), Some(b)) => 0.5 * (a.1 + b.1),
        _ => f64::NAN,
    };
    let at = |t: f64| {
        mean_d
            + if slope.is_finite() {
                slope * (t - mean_t)
            } else {
                0.0
            }
    };
    let offset = at(middle);
    let mut trace = Trace::new(time.0, time.1);
    for (stamp, _, d) in &off {
        trace.add(*stamp, d - offset, f64::NAN);
    }
    let mut rest: Vec<f64> = off.iter().map(|(_, t, d)| d - at(*t)).collect();
    AngleResult {
        offset_rad: wrap_angle(offset + first.unwrap_or(f64::NAN)),
        drift_rad_s: slope,
        residual: Statistics::of(&mut rest),
        trace,
    }
}

/// Windows follow each other without overlapping.
fn rates(pairs: &[(Seen, Attitude)]) -> Vec<RateResult> {
    let mut both: Vec<(Vector3<f64>, Vector3<f64>)> = Vec::new();
    let mut begin: Option<&(Seen, Attitude)> = None;
    let whole = |p: &&(Seen, Attitude)| p.0.angles_rad.iter().all(|v| v.is_finite());
    for pair in pairs.iter().filter(whole) {
        let Some(from) = begin else {
            begin = Some(pair);
            continue;
        };
        let dt = pair.0.stamp.since_s(from.0.stamp);
        if dt < WINDOW_S {
            continue;
        }
        begin = Some(pair);
        if dt > 2.0 * WINDOW_S {
            continue;
        }
        let rotation =
            |[roll, pitch, yaw]: [f64; 3]| Rotation3::from_euler_angles(roll, pitch, yaw);
        let turn = rotation(from.0.angles_rad).inverse() * rotation(pair.0.angles_rad);
        let gyro = Vector3::from(pair.1.turned_rad) - Vector3::from(from.1.turned_rad);
        both.push((turn.scaled_axis() / dt, gyro / dt));
    }
    (0..3).map(|i| rate(&both, i)).collect()
}

fn rate(both: &[(Vector3<f64>, Vector3<f64>)], i: usize) -> RateResult {
    let known = || {
        both.iter()
            .map(|(p, g)| (p[i], g[i]))
            .filter(|(_, g)| g.is_finite())
    };
    let n = known().count();
    let count = n as f64;
    let (sum_p, sum_g) = known().fold((0.0, 0.0), |(a, b), (p, g)| (a + p, b + g));
    let (mean_p, mean_g) = (sum_p / count, sum_g / count);
    let (mut squares, mut gg, mut pg, mut off2) = (0.0, 0.0, 0.0, 0.0);
    for (p, g) in known() {
        squares += (p - g).powi(2);
        off2 += (p - g - mean_p + mean_g).powi(2);
        gg += (g - mean_g).powi(2);
        pg += (p - mean_p) * (g - mean_g);
    }
    RateResult {
        n,
        rms_rad_s: (squares / count).sqrt(),
        bias_rad_s: mean_p - mean_g,
        scale: if gg > off2 { pg / gg } else { f64::NAN },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stamp(t: f64) -> Stamp {
        Stamp::default().plus_s(t)
    }

    /// Attitude at t: all three angles move, yaw through the seam.
    fn angles(t: f64) -> [f64; 3] {
        [
            0.05 * (0.9 * t).sin(),
            0.03 * (0.7 * t).cos(),
            3.1 + 0.2 * (0.8 * t).sin(),
        ]
    }

    fn body_rate(t: f64) -> Vector3<f64> {
        let rotation = |[r, p, y]: [f64; 3]| Rotation3::from_euler_angles(r, p, y);
        let h = 1e-4;
        (rotation(angles(t - h)).inverse() * rotation(angles(t + h))).scaled_axis() / (2.0 * h)
    }

    fn record(seconds: f64, drift: f64) -> Attitudes {
        let samples = (0..(seconds * 100.0) as usize).map(|k| {
            let t = k as f64 * 0.01;
            let [roll, pitch, yaw] = angles(t);
            let rate = body_rate(t);
            ImuSample {
                stamp: stamp(t),
                roll_rad: roll + 0.01,
                pitch_rad: pitch - 0.02,
                yaw_rad: wrap_angle(yaw + 2.0 + drift * (t - 0.5 * seconds)),
                gyro_x_rad_s: rate.x * 1.02 + 0.003,
                gyro_y_rad_s: rate.y,
                gyro_z_rad_s: rate.z,
                ..ImuSample::default()
            }
        });
        let mut attitudes = Attitudes::default();
        samples.for_each(|sample| attitudes.push(&sample));
        attitudes.finish("imu.csv".to_owned())
    }

    #[test]
    fn offsets_drift_and_scale_are_told_apart() {
        let seconds = 120.0;
        let imu = record(seconds, 1e-4);
        let poses: Vec<Seen> = (0..(seconds * 35.0) as usize)
            .map(|k| {
                let t = k as f64 / 35.0;
                let noise = if k % 2 == 0 { 1e-3 } else { -1e-3 };
                let [roll, pitch, yaw] = angles(t);
                Seen {
                    stamp: stamp(t),
                    angles_rad: [roll + noise, pitch, wrap_angle(yaw)],
                }
            })
            .collect();
        let time = (stamp(0.0), stamp(seconds));
        let found = imu.compare(&poses, time).unwrap();
        let [roll, pitch, yaw] = &found.angles[..] else {
            panic!()
        };
        assert!((roll.offset_rad + 0.01).abs() < 1e-5 && (pitch.offset_rad - 0.02).abs() < 1e-5);
        assert!((yaw.offset_rad + 2.0).abs() < 1e-4, "{}", yaw.offset_rad);
        assert!((yaw.drift_rad_s + 1e-4).abs() < 1e-8 && roll.drift_rad_s.abs() < 1e-7);
        assert!((roll.residual.rms - 1e-3).abs() < 1e-5 && yaw.residual.rms < 1e-4);
        let [x, y, z] = &found.rates[..] else {
            panic!()
        };
        assert!(
            (x.scale - 1.0 / 1.02).abs() < 0.01 && (x.bias_rad_s + 0.003).abs() < 5e-4,
            "{x:?}"
        );
        assert!((z.scale - 1.0).abs() < 0.01 && z.rms_rad_s < 2e-3, "{z:?}");
        assert!(y.n > 500);
        let later: Vec<Seen> = poses
            .iter()
            .map(|p| Seen {
                stamp: p.stamp.plus_s(1e4),
                ..*p
            })
            .collect();
        assert!(imu.compare(&later, time).is_none());
        assert!(Attitudes::default().compare(&poses, time).is_none());
    }
}
