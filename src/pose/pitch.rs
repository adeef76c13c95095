//! The pitch that a pose is solved with.
//!
//! Pitch is the one component that the scanner cannot tell from x with strips on the ceiling only:
//! x enters as x + h tan(pitch), h the height below the strips (Kurniawan 2017 takes it from the
//! IMU as exact). It comes from the IMU's samples around the reference instant, in the platform's
//! axes whatever axes the samples have, or as a number.

use crate::frame::Frame;
use crate::record::{Axes, ImuSample, Stamp, Status};
use nalgebra::Rotation3;

/// Pitch of the platform with its standard deviation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pitch {
    /// Pitch, rad.
    pub rad: f64,
    /// Standard deviation, rad.
    pub sigma_rad: f64,
    /// Whether the samples are older than they should be.
    pub stale: bool,
}

/// Roll, pitch, yaw of the platform in B from a sample in any axes, rad.
///
/// The IMU's mounting is taken out: at zero `imu.rotation_deg` its x is along P's x and its z along
/// P's -z. ENU here means the device's axes turned upright, with its x still along P's x.
pub fn platform_attitude(sample: &ImuSample, frame: &Frame) -> [f64; 3] {
    // Some sample types have no yaw; pitch does not depend on it.
    let yaw = if sample.yaw_rad.is_finite() {
        sample.yaw_rad
    } else {
        0.0
    };
    let measured = Rotation3::from_euler_angles(sample.roll_rad, sample.pitch_rad, yaw);
    let [roll, pitch, yaw] = frame.imu.rotation_deg.map(f64::to_radians);
    let mounting = Rotation3::from_euler_angles(roll, pitch, yaw);
    let half_turn = Rotation3::from_euler_angles(std::f64::consts::PI, 0.0, 0.0);
    let platform = match sample.axes {
        Axes::Platform => return [sample.roll_rad, sample.pitch_rad, sample.yaw_rad],
        // World and device both have z down: seen from above both are turned over x.
        Axes::Ned => half_turn * measured * half_turn.inverse() * mounting.inverse(),
        Axes::Enu => measured * mounting.inverse(),
    };
    let (roll, pitch, yaw) = platform.euler_angles();
    [roll, pitch, yaw]
}

/// Pitch at `stamp` from the samples around it: interpolated between two, or the nearest one,
/// which is stale if it is further than `max_age_s`. None where there is no usable sample.
pub fn at(
    stamp: Stamp,
    around: (Option<&ImuSample>, Option<&ImuSample>),
    frame: &Frame,
    sigma_rad: f64,
    max_age_s: f64,
) -> Option<Pitch> {
    let pitch = |sample: &ImuSample| platform_attitude(sample, frame)[1];
    let usable = |sample: Option<&ImuSample>| {
        sample
            .filter(|s| s.pitch_rad.is_finite() && s.roll_rad.is_finite())
            .copied()
    };
    let (before, after) = (usable(around.0), usable(around.1));
    let age_s = |sample: &ImuSample| stamp.since_s(sample.stamp).abs();
    match (before, after) {
        (Some(before), Some(after)) if after.stamp > before.stamp => {
            let span_s = after.stamp.since_s(before.stamp);
            let share = stamp.since_s(before.stamp) / span_s;
            let nearest_s = age_s(&before).min(age_s(&after));
            let rad = if nearest_s == 0.0 || span_s > 2.0 * max_age_s {
                // Never blend across a gap.
                pitch(if age_s(&before) <= age_s(&after) {
                    &before
                } else {
                    &after
                })
            } else {
                pitch(&before) + share * (pitch(&after) - pitch(&before))
            };
            Some(Pitch {
                rad,
                sigma_rad,
                stale: nearest_s > max_age_s,
            })
        }
        (Some(only), _) | (None, Some(only)) => Some(Pitch {
            rad: pitch(&only),
            sigma_rad,
            stale: age_s(&only) > max_age_s,
        }),
        (None, None) => None,
    }
}

/// What a pose's status says of its pitch.
pub fn status(pitch: Option<Pitch>) -> Status {
    match pitch {
        None => Status::NO_IMU,
        Some(pitch) if pitch.stale => Status::STALE_IMU,
        Some(_) => Status::OK,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn frame(imu_rotation: &str) -> Frame {
        let text = include_str!("../../testdata/cablar.toml");
        let i = text.rfind("rotation_deg = [0.0, 0.0, 0.0]").unwrap();
        let text = format!("{}rotation_deg = {imu_rotation}\n", &text[..i]);
        Frame::parse(&text, Path::new("frame.toml")).unwrap()
    }

    fn sample(ns: i64, axes: Axes, rpy: [f64; 3]) -> ImuSample {
        ImuSample {
            stamp: Stamp::from_ns(ns),
            axes,
            roll_rad: rpy[0],
            pitch_rad: rpy[1],
            yaw_rad: rpy[2],
            ..ImuSample::default()
        }
    }

    #[test]
    fn ned_pitch_and_yaw_have_the_opposite_sign() {
        let frame = frame("[0.0, 0.0, 0.0]");
        let ned = platform_attitude(&sample(0, Axes::Ned, [0.02, 0.03, 0.4]), &frame);
        for (got, wanted) in ned.iter().zip([0.02, -0.03, -0.4]) {
            assert!((got - wanted).abs() < 1e-12, "{ned:?}");
        }
    }

    #[test]
    fn mounting_is_taken_out() {
        // A level platform whose IMU is pitched by 2 deg on P reads that pitch, NED signed.
        let frame = frame("[0.0, 2.0, 0.0]");
        let reads = sample(0, Axes::Ned, [0.0, -2f64.to_radians(), 0.0]);
        assert!(platform_attitude(&reads, &frame)[1].abs() < 1e-12);
    }

    #[test]
    fn interpolates_only_between_near_samples() {
        let frame = frame("[0.0, 0.0, 0.0]");
        let a = sample(0, Axes::Platform, [0.0, 0.01, 0.0]);
        let b = sample(10_000_000, Axes::Platform, [0.0, 0.03, 0.0]);
        let middle = at(
            Stamp::from_ns(5_000_000),
            (Some(&a), Some(&b)),
            &frame,
            0.0,
            0.05,
        )
        .unwrap();
        assert!((middle.rad - 0.02).abs() < 1e-12 && !middle.stale);
        let exact = at(Stamp::from_ns(0), (Some(&a), Some(&b)), &frame, 0.0, 0.05).unwrap();
        assert_eq!(exact.rad, 0.01);
        let late = at(
            Stamp::from_ns(900_000_000),
            (Some(&b), None),
            &frame,
            0.0,
            0.05,
        )
        .unwrap();
        assert!(late.stale);
        let far = sample(800_000_000, Axes::Platform, [0.0, 0.5, 0.0]);
        let gap = at(
            Stamp::from_ns(20_000_000),
            (Some(&b), Some(&far)),
            &frame,
            0.0,
            0.05,
        )
        .unwrap();
        assert_eq!(gap.rad, 0.03);
        assert!(at(Stamp::from_ns(0), (None, None), &frame, 0.0, 0.05).is_none());
    }
}
