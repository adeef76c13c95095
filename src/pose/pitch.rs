//! The pitch that a pose is solved with.
//!
//! Pitch is the one component that the scanner cannot tell from x with strips on the ceiling only:
//! x enters as x + h tan(pitch), h the height below the strips (Kurniawan 2017 takes it from the
//! IMU as exact). It comes from the IMU's samples around the reference instant, in the platform's
//! axes whatever axes the samples have, or as a number.

use crate::frame::{Frame, ImuAxes};
use crate::record::{Axes, Face, ImuSample, Stamp, Status};
use std::collections::VecDeque;

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

impl Pitch {
    /// Of a platform whose pitch nobody gave and no strip tells: level, give or take a degree.
    pub const LEVEL: Pitch = Pitch::within(0.0, std::f64::consts::PI / 180.0);
    /// Where strips on the walls tell the pitch: so wide that it says nothing.
    pub const OPEN: Pitch = Pitch::within(0.0, 3.0 * std::f64::consts::PI / 180.0);

    /// Of this standard deviation, rad.
    pub const fn within(rad: f64, sigma_rad: f64) -> Pitch {
        Pitch {
            rad,
            sigma_rad,
            stale: false,
        }
    }

    /// Known.
    pub const fn exact(rad: f64) -> Pitch {
        Pitch::within(rad, 0.0)
    }
}

/// Whether a scan shows the pitch by itself: strips on the walls do.
pub fn is_shown(frame: &Frame) -> bool {
    frame.strips.iter().any(|strip| strip.face != Face::Upper)
}

/// Roll, pitch, yaw of the platform in B from a sample in any axes, rad, by [`ImuAxes`]. A missing
/// yaw counts as 0: some commands of the IMU give none, and pitch does not depend on it.
pub fn platform_attitude(sample: &ImuSample, frame: &Frame) -> [f64; 3] {
    if sample.axes == Axes::Platform {
        return [sample.roll_rad, sample.pitch_rad, sample.yaw_rad];
    }
    let mut measured = *sample;
    if !measured.yaw_rad.is_finite() {
        measured.yaw_rad = 0.0;
    }
    let platform = ImuAxes::new(&frame.imu).turned(&measured, Axes::Platform);
    [platform.roll_rad, platform.pitch_rad, platform.yaw_rad]
}

/// How samples become an attitude.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Standard deviation of the IMU's pitch, rad; none: what the samples say of themselves, or
    /// [`Settings::UNSTATED_RAD`] where they say nothing.
    pub sigma_rad: Option<f64>,
    /// A sample further from the instant than this is stale, s.
    pub max_age_s: f64,
    /// Two samples further apart than this many of their usual periods are not blended.
    pub max_gap_periods: f64,
}

impl Settings {
    /// Standard deviation of roll and pitch that nobody states, rad: 0.5 deg, the order of the
    /// 3DM-GX1's static accuracy.
    pub const UNSTATED_RAD: f64 = 0.5 * std::f64::consts::PI / 180.0;
}

/// The platform's roll and pitch at an instant, as the IMU has them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Attitude {
    /// Roll, rad.
    pub roll_rad: f64,
    /// Pitch, rad.
    pub pitch_rad: f64,
    /// Standard deviation of the pitch, rad.
    pub pitch_sigma_rad: f64,
    /// Whether there was no sample near enough: too old, or a gap in the stream.
    pub stale: bool,
}

impl Attitude {
    /// What a pose is solved with.
    pub fn pitch(&self) -> Pitch {
        Pitch {
            rad: self.pitch_rad,
            sigma_rad: self.pitch_sigma_rad,
            stale: self.stale,
        }
    }
}

/// Spacings kept for the usual period.
const SPACINGS: usize = 15;
/// So many must be known before one of them can be called a gap.
const ENOUGH_SPACINGS: usize = 5;

/// Looks up the attitude between samples and knows how far apart they usually are.
#[derive(Clone, Debug)]
pub struct Lookup {
    settings: Settings,
    /// The last spacings between neighbours, s, oldest first.
    spacings_s: VecDeque<f64>,
    last: Option<Stamp>,
    /// Gaps since the last usual spacing.
    gaps: usize,
}

impl Lookup {
    /// Without any sample seen.
    pub fn new(settings: Settings) -> Lookup {
        Lookup {
            settings,
            spacings_s: VecDeque::with_capacity(SPACINGS),
            last: None,
            gaps: 0,
        }
    }

    /// The median of the last spacings, s; none before there are enough of them.
    fn usual_period_s(&self) -> Option<f64> {
        let n = self.spacings_s.len();
        let mut sorted = [0.0; SPACINGS];
        for (place, spacing) in sorted.iter_mut().zip(&self.spacings_s) {
            *place = *spacing;
        }
        let known = sorted.get_mut(..n)?;
        known.sort_unstable_by(f64::total_cmp);
        known.get(n / 2).copied().filter(|_| n >= ENOUGH_SPACINGS)
    }

    /// Whether samples usually come closer together than `span_s`: coarser ones do not show how the
    /// platform turned within it.
    pub fn resolves(&self, span_s: f64) -> bool {
        self.usual_period_s()
            .is_some_and(|usual_s| usual_s < span_s)
    }

    /// Whether the samples around an instant are too far apart to be blended. A spacing is learnt
    /// once, and a gap is not, because it would make the next one usual; but gaps and nothing else
    /// for a while are another rate.
    fn is_gap(&mut self, before: Stamp, after: Stamp) -> bool {
        let span_s = after.since_s(before);
        let gap = span_s > 2.0 * self.settings.max_age_s
            || self
                .usual_period_s()
                .is_some_and(|usual_s| span_s > self.settings.max_gap_periods * usual_s);
        if self.last == Some(after) {
            return gap;
        }
        self.last = Some(after);
        if gap {
            self.gaps += 1;
            if self.gaps >= SPACINGS {
                self.spacings_s.clear();
            }
        } else {
            self.gaps = 0;
            if self.spacings_s.len() == SPACINGS {
                self.spacings_s.pop_front();
            }
            self.spacings_s.push_back(span_s);
        }
        gap
    }

    /// The attitude at `stamp` from the last sample before it and the first one behind it:
    /// interpolated, or the nearer one's across a gap or at an end of the samples. None where there
    /// is no usable sample.
    pub fn at(
        &mut self,
        stamp: Stamp,
        around: (Option<&ImuSample>, Option<&ImuSample>),
        frame: &Frame,
    ) -> Option<Attitude> {
        let usable = |sample: Option<&ImuSample>| {
            sample
                .filter(|s| s.pitch_rad.is_finite() && s.roll_rad.is_finite())
                .copied()
        };
        let age_s = |sample: &ImuSample| stamp.since_s(sample.stamp).abs();
        let max_age_s = self.settings.max_age_s;
        let (near, blend, old_s) = match (usable(around.0), usable(around.1)) {
            (Some(before), Some(after)) if after.stamp > before.stamp => {
                let gap = self.is_gap(before.stamp, after.stamp);
                let nearer = if age_s(&before) <= age_s(&after) {
                    before
                } else {
                    after
                };
                if gap {
                    // In a gap even a sample that is not old says nothing of what happened since,
                    // unless it is as near as its neighbours usually are.
                    let usual_s = self.usual_period_s().unwrap_or(max_age_s);
                    (nearer, None, max_age_s.min(usual_s))
                } else if age_s(&nearer) == 0.0 {
                    (nearer, None, max_age_s)
                } else {
                    let share = age_s(&before) / after.stamp.since_s(before.stamp);
                    (nearer, Some((before, after, share)), max_age_s)
                }
            }
            (Some(only), _) | (None, Some(only)) => (only, None, max_age_s),
            (None, None) => return None,
        };
        let [roll_rad, pitch_rad, _] = match &blend {
            None => platform_attitude(&near, frame),
            Some((before, after, share)) => {
                let from = platform_attitude(before, frame);
                let to = platform_attitude(after, frame);
                std::array::from_fn(|k| from[k] + share * (to[k] - from[k]))
            }
        };
        let sigma_rad = self.settings.sigma_rad;
        Some(Attitude {
            roll_rad,
            pitch_rad,
            pitch_sigma_rad: sigma_rad.unwrap_or_else(|| stated_pitch_sigma_rad(&near, frame)),
            stale: age_s(&near) > old_s,
        })
    }
}

/// The platform's pitch sigma from those that the sample states of its own angles, rad.
fn stated_pitch_sigma_rad(sample: &ImuSample, frame: &Frame) -> f64 {
    /// Far below any sigma, far above rounding.
    const STEP_RAD: f64 = 1e-6;
    if !(sample.pitch_sigma_rad > 0.0) {
        return Settings::UNSTATED_RAD;
    }
    let at = platform_attitude(sample, frame)[1];
    let moved = |change: fn(&mut ImuSample)| {
        let mut sample = *sample;
        change(&mut sample);
        (platform_attitude(&sample, frame)[1] - at) / STEP_RAD
    };
    let or_pitch = |sigma: f64| {
        if sigma > 0.0 {
            sigma
        } else {
            sample.pitch_sigma_rad
        }
    };
    // A mounting turned about the vertical makes the platform's pitch of the device's roll.
    let by_roll = moved(|s| s.roll_rad += STEP_RAD) * or_pitch(sample.roll_sigma_rad);
    let by_pitch = moved(|s| s.pitch_rad += STEP_RAD) * sample.pitch_sigma_rad;
    f64::hypot(by_roll, by_pitch)
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
    fn samples_as_coarse_as_the_span_do_not_resolve_it() {
        let frame = frame("[0.0, 0.0, 0.0]");
        let mut lookup = Lookup::new(Settings {
            sigma_rad: None,
            max_age_s: 0.05,
            max_gap_periods: 3.0,
        });
        assert!(!lookup.resolves(1.0));
        for k in 0..8i64 {
            let at = |k: i64| sample(k * 10_000_000, Axes::Platform, [0.0; 3]);
            let stamp = Stamp::from_ns(k * 10_000_000 + 1);
            lookup.at(stamp, (Some(&at(k)), Some(&at(k + 1))), &frame);
        }
        assert!(lookup.resolves(0.015));
        assert!(!lookup.resolves(0.009));
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

    const SETTINGS: Settings = Settings {
        sigma_rad: Some(0.0),
        max_age_s: 0.05,
        max_gap_periods: 3.0,
    };

    fn ms(ms: i64) -> Stamp {
        Stamp::from_ns(ms * 1_000_000)
    }

    fn level(at_ms: i64, pitch_rad: f64) -> ImuSample {
        sample(at_ms * 1_000_000, Axes::Platform, [0.0, pitch_rad, 0.0])
    }

    #[test]
    fn interpolates_only_between_near_samples() {
        let frame = frame("[0.0, 0.0, 0.0]");
        let at = |stamp, around| Lookup::new(SETTINGS).at(stamp, around, &frame);
        let (a, b) = (level(0, 0.01), level(10, 0.03));
        let middle = at(ms(5), (Some(&a), Some(&b))).unwrap();
        assert!((middle.pitch_rad - 0.02).abs() < 1e-12 && !middle.stale);
        let exact = at(ms(0), (Some(&a), Some(&b))).unwrap();
        assert_eq!(exact.pitch_rad, 0.01);
        let late = at(ms(900), (Some(&b), None)).unwrap();
        assert!(late.stale && late.pitch_rad == 0.03);
        let far = level(800, 0.5);
        let gap = at(ms(20), (Some(&b), Some(&far))).unwrap();
        assert_eq!(gap.pitch_rad, 0.03);
        assert!(at(ms(0), (None, None)).is_none());
    }

    #[test]
    fn a_gap_of_several_periods_is_not_bridged_and_said() {
        let frame = frame("[0.0, 0.0, 0.0]");
        let mut lookup = Lookup::new(SETTINGS);
        let samples: Vec<ImuSample> = (0..10).map(|k| level(10 * k, 0.01)).collect();
        for pair in samples.windows(2) {
            let stamp = pair[0].stamp + 5_000_000;
            let found = lookup.at(stamp, (Some(&pair[0]), Some(&pair[1])), &frame);
            assert!(!found.unwrap().stale);
        }
        // Three samples lost: 40 ms, well within the age limit, and four periods.
        let (before, after) = (level(90, 0.01), level(130, 0.09));
        let around = (Some(&before), Some(&after));
        let inside = lookup.at(ms(108), around, &frame).unwrap();
        assert!(inside.stale && inside.pitch_rad == 0.01);
        let beside = lookup.at(ms(122), around, &frame).unwrap();
        assert!(!beside.stale && beside.pitch_rad == 0.09);
        // One lost is bridged.
        let (before, after) = (level(130, 0.09), level(150, 0.01));
        let bridged = lookup.at(ms(140), (Some(&before), Some(&after)), &frame);
        let bridged = bridged.unwrap();
        assert!(!bridged.stale && (bridged.pitch_rad - 0.05).abs() < 1e-12);
    }

    #[test]
    fn sigma_is_the_given_one_or_the_samples_own() {
        let turned = frame("[0.0, 0.0, 90.0]");
        let upright = frame("[0.0, 0.0, 0.0]");
        let stated = ImuSample {
            roll_sigma_rad: 0.002,
            pitch_sigma_rad: 0.005,
            ..sample(0, Axes::Ned, [0.01, 0.02, 0.0])
        };
        let own = Settings {
            sigma_rad: None,
            ..SETTINGS
        };
        let sigma = |settings, sample: &ImuSample, frame: &Frame| {
            let found = Lookup::new(settings).at(ms(0), (Some(sample), None), frame);
            found.unwrap().pitch_sigma_rad
        };
        assert_eq!(sigma(SETTINGS, &stated, &upright), 0.0);
        assert!((sigma(own, &stated, &upright) - 0.005).abs() < 1e-6);
        // Turned by 90 deg, the device rolls where the platform pitches.
        assert!((sigma(own, &stated, &turned) - 0.002).abs() < 1e-4);
        assert_eq!(sigma(own, &level(0, 0.0), &upright), Settings::UNSTATED_RAD);
    }
}
