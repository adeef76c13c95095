//! What a record of an IMU at rest says of its noise: mean and spread of every quantity, the Allan
//! deviation of rates and accelerations, beside the figures of the 3DM-GX1's data sheet.

pub mod allan;
pub(super) mod outputs;

use crate::record::{Axes, ImuSample, Stamp};
use allan::{Noise, Point};

/// Standard gravity, m/s^2.
const GRAVITY_M_S2: f64 = 9.806_65;

/// A quantity of the record with the unit people read it in.
#[derive(Clone, Copy, Debug)]
pub struct Channel {
    /// Name, as in `gyro_x`.
    pub name: &'static str,
    /// What it is.
    pub kind: Kind,
    /// Where it is in a sample.
    value: fn(&ImuSample) -> f64,
}

/// Kinds of quantities.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Angles, rad.
    Angle,
    /// Angular rates, rad/s.
    Rate,
    /// Specific forces, m/s^2.
    Force,
}

/// The channels, in the record's order.
pub const CHANNELS: [Channel; 9] = {
    const fn channel(name: &'static str, kind: Kind, value: fn(&ImuSample) -> f64) -> Channel {
        Channel { name, kind, value }
    }
    [
        channel("roll", Kind::Angle, |s| s.roll_rad),
        channel("pitch", Kind::Angle, |s| s.pitch_rad),
        channel("yaw", Kind::Angle, |s| s.yaw_rad),
        channel("gyro_x", Kind::Rate, |s| s.gyro_x_rad_s),
        channel("gyro_y", Kind::Rate, |s| s.gyro_y_rad_s),
        channel("gyro_z", Kind::Rate, |s| s.gyro_z_rad_s),
        channel("accel_x", Kind::Force, |s| s.accel_x_m_s2),
        channel("accel_y", Kind::Force, |s| s.accel_y_m_s2),
        channel("accel_z", Kind::Force, |s| s.accel_z_m_s2),
    ]
};

/// The 3DM-GX1's figures, as public code quotes its data sheet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sheet {
    /// Angle or velocity random walk, in [`Kind::walk_unit`].
    pub walk: f64,
    /// Constant error, in [`Kind::unit`].
    pub bias: f64,
    /// In-run stability, in [`Kind::instability_unit`].
    pub instability: f64,
}

impl Kind {
    /// The unit that mean and spread are shown in.
    pub fn unit(self) -> &'static str {
        match self {
            Kind::Angle => "deg",
            Kind::Rate => "deg/s",
            Kind::Force => "m/s^2",
        }
    }

    /// How many of [`Kind::unit`] make one of the record's unit.
    fn factor(self) -> f64 {
        match self {
            Kind::Angle | Kind::Rate => 180.0 / std::f64::consts::PI,
            Kind::Force => 1.0,
        }
    }

    /// The unit of the random walk.
    pub fn walk_unit(self) -> &'static str {
        match self {
            Kind::Angle => "",
            Kind::Rate => "deg/sqrt(h)",
            Kind::Force => "m/s/sqrt(h)",
        }
    }

    /// The unit of the bias instability.
    pub fn instability_unit(self) -> &'static str {
        match self {
            Kind::Angle | Kind::Rate => "deg/s",
            Kind::Force => "mg",
        }
    }

    /// How many of [`Kind::instability_unit`] make one of the record's unit.
    fn instability_factor(self) -> f64 {
        match self {
            Kind::Angle | Kind::Rate => 180.0 / std::f64::consts::PI,
            Kind::Force => 1e3 / GRAVITY_M_S2,
        }
    }

    /// The data sheet's figures; none for angles.
    pub fn sheet(self) -> Option<Sheet> {
        match self {
            Kind::Angle => None,
            Kind::Rate => Some(Sheet {
                walk: 3.5,
                bias: 0.7,
                instability: 0.02,
            }),
            Kind::Force => Some(Sheet {
                walk: 0.4,
                bias: 10e-3 * GRAVITY_M_S2,
                instability: 0.2,
            }),
        }
    }
}

/// What one channel is like; numbers in the units of its [`Kind`].
#[derive(Clone, Debug)]
pub struct Measured {
    /// Which.
    pub channel: Channel,
    /// Mean.
    pub mean: f64,
    /// Standard deviation about it.
    pub std: f64,
    /// Allan deviations in [`Kind::unit`]; empty for angles.
    pub curve: Vec<Point>,
    /// Angle or velocity random walk, in [`Kind::walk_unit`]; NaN where there is no curve.
    pub walk: f64,
    /// Bias instability, in [`Kind::instability_unit`].
    pub instability: f64,
    /// The averaging time at which the curve is lowest, s.
    pub instability_tau_s: f64,
    /// Whether the curve has a floor; without, `instability` is an upper limit.
    pub has_floor: bool,
}

/// A record of a unit at rest.
#[derive(Clone, Debug)]
pub struct Inertial {
    /// Its name.
    pub source: String,
    /// The axes of its samples.
    pub axes: Axes,
    /// Samples.
    pub samples: usize,
    /// From the first to the last, s.
    pub duration_s: f64,
    /// From sample to sample, s.
    pub period_s: f64,
    /// Places where samples are missing.
    pub gaps: usize,
    /// The channels that the record has.
    pub channels: Vec<Measured>,
    /// What a reader must know, in sentences.
    pub notes: Vec<String>,
}

/// Collects a record.
#[derive(Clone, Debug, Default)]
pub struct Recording {
    stamps: Vec<Stamp>,
    values: [Vec<f64>; 9],
    axes: Axes,
}

/// A spacing above this many usual ones is a gap.
const GAP: f64 = 1.5;
/// Fewest samples of a curve.
const FEWEST: usize = 10;
/// An angle that drifts further than this from the first to the last tenth of the record, deg, was
/// turned.
const STILL_DEG: f64 = 1.0;

impl Recording {
    /// Takes one sample.
    pub fn push(&mut self, sample: &ImuSample) {
        if self.stamps.is_empty() {
            self.axes = sample.axes;
        }
        self.stamps.push(sample.stamp);
        for (values, channel) in self.values.iter_mut().zip(CHANNELS) {
            values.push((channel.value)(sample));
        }
    }

    /// Sums it up.
    pub fn finish(self, source: String) -> Inertial {
        let spacings: Vec<f64> = self.stamps.windows(2).map(|w| w[1].since_s(w[0])).collect();
        let mut sorted = spacings.clone();
        sorted.sort_unstable_by(f64::total_cmp);
        let usual_s = super::percentile(&sorted, 50.0);
        let is_gap = |s: &f64| !(*s <= GAP * usual_s && *s > 0.0);
        let whole: Vec<f64> = spacings.iter().copied().filter(|s| !is_gap(s)).collect();
        let period_s = whole.iter().sum::<f64>() / whole.len() as f64;
        let cuts: Vec<usize> = spacings
            .iter()
            .enumerate()
            .filter(|(_, s)| is_gap(s))
            .map(|(i, _)| i + 1)
            .collect();
        let samples = self.stamps.len();
        let mut notes = Vec::new();
        if samples < FEWEST {
            notes.push(format!(
                "{samples} samples are too few: at least {FEWEST} are needed"
            ));
        }
        let mut channels = Vec::new();
        for (values, channel) in self.values.iter().zip(CHANNELS) {
            if samples >= FEWEST && values.iter().all(|v| v.is_finite()) {
                channels.push(measure(channel, values, &cuts, period_s));
                notes.extend(unrest(channel, values));
            } else if samples >= FEWEST && values.iter().any(|v| v.is_finite()) {
                notes.push(format!(
                    "{}: missing in some samples, left out",
                    channel.name
                ));
            }
        }
        let duration_s = match (self.stamps.first(), self.stamps.last()) {
            (Some(first), Some(last)) => last.since_s(*first),
            _ => 0.0,
        };
        Inertial {
            source,
            axes: self.axes,
            samples,
            duration_s,
            period_s,
            gaps: cuts.len(),
            channels,
            notes,
        }
    }
}

/// Says if an angle is not that of a unit at rest. Yaw drifts by itself.
fn unrest(channel: Channel, values: &[f64]) -> Option<String> {
    let tenth = values.len() / 10;
    let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
    let (first, last) = (values.get(..tenth)?, values.get(values.len() - tenth..)?);
    let moved_deg = (mean(last) - mean(first)).to_degrees();
    let tilts = channel.kind == Kind::Angle && channel.name != "yaw";
    (tilts && moved_deg.abs() > STILL_DEG).then(|| {
        let name = channel.name;
        format!("{name} changed by {moved_deg:.1} deg over the record: it was not at rest")
    })
}

fn measure(channel: Channel, values: &[f64], cuts: &[usize], period_s: f64) -> Measured {
    let kind = channel.kind;
    let n = values.len() as f64;
    // Angles near +-180 deg are taken about the first one.
    let about = if kind == Kind::Angle { values[0] } else { 0.0 };
    let off = |v: f64| {
        if kind == Kind::Angle {
            super::wrap_angle(v - about)
        } else {
            v
        }
    };
    let mean = values.iter().map(|v| off(*v)).sum::<f64>() / n;
    let squares: f64 = values.iter().map(|v| (off(*v) - mean).powi(2)).sum();
    let mut measured = Measured {
        channel,
        mean: (mean + about) * kind.factor(),
        std: (squares / (n - 1.0)).sqrt() * kind.factor(),
        curve: Vec::new(),
        walk: f64::NAN,
        instability: f64::NAN,
        instability_tau_s: f64::NAN,
        has_floor: false,
    };
    if kind == Kind::Angle {
        return measured;
    }
    let mut pieces = Vec::new();
    let mut rest = values;
    let mut from = 0;
    for cut in cuts {
        let (piece, behind) = rest.split_at(cut - from);
        pieces.push(piece);
        (rest, from) = (behind, *cut);
    }
    pieces.push(rest);
    let mut curve = allan::curve(&pieces, period_s);
    if let Some(Noise {
        white,
        instability,
        instability_tau_s,
        has_floor,
    }) = allan::noise(&curve)
    {
        // From one over the root of a second to one over that of an hour.
        measured.walk = white * kind.factor() * 60.0;
        measured.instability = instability * kind.instability_factor();
        measured.instability_tau_s = instability_tau_s;
        measured.has_floor = has_floor;
    }
    for point in &mut curve {
        point.deviation *= kind.factor();
    }
    measured.curve = curve;
    measured
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::frame::Frame;
    use crate::motion::{Pose, State};
    use crate::simulate::{Parameters, Seed, Unit};
    use nalgebra::Vector3;
    use std::path::Path;

    /// The simulated unit at rest, with the data sheet's noise.
    pub(in crate::report) fn still(seconds: i64, seed: u64) -> Recording {
        let text = include_str!("../../../testdata/cablar.toml");
        let frame = Frame::parse(text, Path::new("frame.toml")).unwrap();
        let parameters = Parameters::default();
        let mut unit = Unit::new(&frame, Axes::Ned).with_errors(&parameters.imu, Seed(seed));
        let state = State::resting(Pose {
            position_m: Vector3::zeros(),
            rotation_rad: Vector3::new(0.01, -0.02, 0.3),
        });
        let mut recording = Recording::default();
        for k in 0..100 * seconds {
            recording.push(&unit.sample(&state, Stamp::from_ns(k * 10_000_000)));
        }
        recording
    }

    #[test]
    fn the_simulated_unit_has_the_data_sheets_noise() {
        let found = still(600, 5).finish("still.csv".to_owned());
        assert_eq!((found.samples, found.gaps), (60_000, 0));
        assert!((found.period_s - 0.01).abs() < 1e-12);
        assert!(found.notes.is_empty(), "{:?}", found.notes);
        assert_eq!(found.channels.len(), 9);
        for channel in found
            .channels
            .iter()
            .filter(|c| c.channel.kind == Kind::Rate)
        {
            assert!((channel.walk / 3.5 - 1.0).abs() < 0.05, "{channel:?}");
        }
        for channel in found
            .channels
            .iter()
            .filter(|c| c.channel.kind == Kind::Force)
        {
            // 0.026 m/s^2 a sample at 100 Hz is 0.0026 m/s/sqrt(s), 0.156 m/s/sqrt(h).
            assert!((channel.walk / 0.156 - 1.0).abs() < 0.05, "{channel:?}");
            assert!((channel.std / 0.026 - 1.0).abs() < 0.02);
        }
    }

    #[test]
    fn gaps_are_counted_and_motion_is_said() {
        let mut recording = still(60, 6);
        for stamp in &mut recording.stamps[3000..] {
            *stamp = *stamp + 500_000_000;
        }
        let tilted = recording.values[0].len() / 2;
        recording.values[0][tilted..]
            .iter_mut()
            .for_each(|v| *v += 0.1);
        let found = recording.finish(String::new());
        assert_eq!(found.gaps, 1);
        assert_eq!(found.notes.len(), 1, "{:?}", found.notes);
        assert!(found.notes[0].starts_with("roll changed by"));
        assert!((found.channels[3].walk / 3.5 - 1.0).abs() < 0.1);
        let none = Recording::default().finish(String::new());
        assert!(none.channels.is_empty() && none.notes.len() == 1);
    }
}
