//! How fast the scan plane turns, from the IMU's gyros.

use crate::frame::{Frame, ImuAxes};
use crate::record::{Axes, ImuSample, Stamp};
use nalgebra::{Rotation3, Vector3};

/// Samples further from an instant than this say nothing of it, s.
const REACH_S: f64 = 0.05;
/// Standard deviation of a rate whose sample does not give one, rad/s: the constant error of a
/// 3DM-GX1's gyros, 0.7 deg/s.
const SIGMA_RAD_S: f64 = 0.0122;

/// Gives the in-plane turn rate of the scanner, about its x axis.
#[derive(Clone, Debug)]
pub struct Gyro {
    axes: ImuAxes,
    into_scanner: Rotation3<f64>,
}

impl Gyro {
    /// For the mountings of IMU and scanner in a frame file.
    pub fn new(frame: &Frame) -> Gyro {
        let [roll, pitch, yaw] = frame.scanner.rotation_deg.map(f64::to_radians);
        Gyro {
            axes: ImuAxes::new(&frame.imu),
            into_scanner: Rotation3::from_euler_angles(roll, pitch, yaw).inverse(),
        }
    }

    /// The rate at `stamp` between two samples, and its standard deviation, rad/s; none where
    /// there is no rate near enough.
    pub fn turn(
        &self,
        stamp: Stamp,
        (before, after): (Option<&ImuSample>, Option<&ImuSample>),
    ) -> Option<(f64, f64)> {
        let near = |sample: &&ImuSample| sample.stamp.since_s(stamp).abs() <= REACH_S;
        let rates = [before, after].map(|sample| {
            let sample = sample.filter(near)?;
            let rate = self.rate(sample);
            rate.is_finite().then_some((sample, rate))
        });
        let (rate, sample) = match rates {
            [Some((before, low)), Some((after, high))] => {
                let span_s = after.stamp.since_s(before.stamp);
                let share = if span_s > 0.0 {
                    stamp.since_s(before.stamp) / span_s
                } else {
                    0.5
                };
                (low + share * (high - low), before)
            }
            [Some((sample, rate)), None] | [None, Some((sample, rate))] => (rate, sample),
            [None, None] => return None,
        };
        let sigma = Some(sample.gyro_sigma_rad_s).filter(|sigma| *sigma > 0.0);
        Some((rate, sigma.unwrap_or(SIGMA_RAD_S)))
    }

    fn rate(&self, sample: &ImuSample) -> f64 {
        let platform = self.axes.turned(sample, Axes::Platform);
        let rate = Vector3::new(
            platform.gyro_x_rad_s,
            platform.gyro_y_rad_s,
            platform.gyro_z_rad_s,
        );
        (self.into_scanner * rate).x
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn frame(scanner_yaw_deg: f64) -> Frame {
        let text = include_str!("../../testdata/cablar.toml").replacen(
            "rotation_deg = [0.0, 0.0, 0.0]",
            &format!("rotation_deg = [0.0, 0.0, {scanner_yaw_deg:.1}]"),
            1,
        );
        Frame::parse(&text, Path::new("frame.toml")).unwrap()
    }

    fn sample(ns: i64, rate: [f64; 3]) -> ImuSample {
        ImuSample {
            stamp: Stamp::from_ns(ns),
            axes: Axes::Platform,
            gyro_x_rad_s: rate[0],
            gyro_y_rad_s: rate[1],
            gyro_z_rad_s: rate[2],
            ..ImuSample::default()
        }
    }

    #[test]
    fn rates_are_blended_and_turned_into_the_scanner() {
        let (a, b) = (
            sample(0, [0.1, 0.5, 0.0]),
            sample(10_000_000, [0.3, 0.5, 0.0]),
        );
        let level = Gyro::new(&frame(0.0));
        let (rate, sigma) = level
            .turn(Stamp::from_ns(2_500_000), (Some(&a), Some(&b)))
            .unwrap();
        assert!((rate - 0.15).abs() < 1e-12 && sigma == SIGMA_RAD_S);
        // A scanner that looks along y of the platform turns with its pitch.
        let across = Gyro::new(&frame(90.0));
        let (rate, _) = across
            .turn(Stamp::from_ns(0), (Some(&a), Some(&b)))
            .unwrap();
        assert!((rate - 0.5).abs() < 1e-12, "{rate}");
        // The device's own axes: x as the platform's, z down.
        let mut ned = a;
        ned.axes = Axes::Ned;
        let (rate, _) = level.turn(Stamp::from_ns(0), (Some(&ned), None)).unwrap();
        assert!((rate - 0.1).abs() < 1e-12, "{rate}");
        assert!(level.turn(Stamp::from_ns(0), (None, None)).is_none());
        let late = Stamp::from_ns(100_000_000);
        assert!(level.turn(late, (Some(&b), None)).is_none());
    }
}
