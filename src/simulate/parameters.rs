//! How large the effects are. Every number has a default; a TOML file with the same names changes
//! them.

use crate::frame::Frame;
use crate::frame::toml_file::{self, ConfigError, Unsound};
use serde::Deserialize;
use std::path::Path;

macro_rules! table {
    ($(#[$meta:meta])* $name:ident { $($(#[$doc:meta])* $field:ident: $type:ty = $value:expr),* $(,)? }) => {
        $(#[$meta])*
        #[derive(Clone, Debug, PartialEq, Deserialize)]
        #[serde(deny_unknown_fields, default)]
        pub struct $name { $($(#[$doc])* pub $field: $type),* }
        impl Default for $name {
            fn default() -> Self {
                $name { $($field: $value),* }
            }
        }
    };
}

table!(
    /// All effects' sizes, one TOML table an effect.
    Parameters {
        /// `[noise]`
        noise: Noise = Noise::default(),
        /// `[bias]`
        bias: Bias = Bias::default(),
        /// `[quantisation]`
        quantisation: Quantisation = Quantisation::default(),
        /// `[footprint]`
        footprint: Footprint = Footprint::default(),
        /// `[mixed]`
        mixed: Mixed = Mixed::default(),
        /// `[echoes]`
        echoes: Echoes = Echoes::default(),
        /// `[remission]`
        remission: Remission = Remission::default(),
        /// `[angle_jitter]`
        angle_jitter: AngleJitter = AngleJitter::default(),
        /// `[outliers]`
        outliers: Outliers = Outliers::default(),
        /// `[dropouts]`
        dropouts: Dropouts = Dropouts::default(),
        /// `[cables]`
        cables: Cables = Cables::default(),
        /// `[cargo]`
        cargo: Cargo = Cargo::default(),
        /// `[missing_strip]`
        missing_strip: MissingStrip = MissingStrip::default(),
        /// `[clocks]`
        clocks: Clocks = Clocks::default(),
        /// `[imu]`
        imu: Imu = Imu::default(),
    }
);

table!(
    /// White noise of the ranges.
    Noise {
        /// Standard deviation at every range, mm; none: the data sheet's by range.
        sigma_mm: Option<f64> = None,
    }
);

/// How long a drawn value stays.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Held {
    /// Drawn anew for every scan.
    #[default]
    Scan,
    /// Drawn once.
    Run,
}

table!(
    /// Systematic range errors.
    Bias {
        /// The error common to all beams is uniform within plus and minus this, mm.
        common_mm: f64 = 25.0,
        /// How long a common error stays.
        held: Held = Held::Scan,
        /// Standard deviation of a constant error of each face (and of the background), mm; drawn
        /// once a run.
        face_mm: f64 = 0.0,
        /// Error by remission, mm for a remission (before quantisation) 1 above the reference 1.
        remission_mm: f64 = 0.0,
        /// Measured range over true range.
        scale: f64 = 1.0,
    }
);

table!(
    /// Digits of the ranges.
    Quantisation {
        /// One digit, mm.
        step_mm: f64 = 1.0,
    }
);

/// How the spot's diameter goes with range (Kurniawan 2017: beam diameter linear in range, or
/// constant).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Diameter {
    /// The model's optics.
    #[default]
    Linear,
    /// `constant_mm` at every range.
    Constant,
}

table!(
    /// The beam's spot.
    Footprint {
        /// A beam returns the reflector's range if more than this share of its spot is on it.
        hit_threshold: f64 = 0.5,
        /// True diameter over the data sheet's.
        scale: f64 = 1.0,
        /// Law of the diameter.
        diameter: Diameter = Diameter::Linear,
        /// The diameter where the law is constant, mm.
        constant_mm: f64 = 30.0,
    }
);

table!(
    /// Mixed pixels.
    Mixed {
        /// The hit threshold is uniform in this interval, drawn for every scan.
        hit_threshold: [f64; 2] = [0.4, 0.6],
        /// This share of the beams concerned returns a mixed range.
        share: f64 = 0.3,
        /// Concerned are beams with a share of their spot on the reflector between these.
        between: [f64; 2] = [0.1, 0.9],
    }
);

table!(
    /// Several echoes. With them a surface counts by its own share of the spot, and the hit threshold
    /// has no say.
    Echoes {
        /// The most echoes.
        count: usize = 5,
        /// A surface gives an echo if it has more than this share of the spot.
        share: f64 = 0.1,
    }
);

/// How a device turns received power into digits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Law {
    /// `digits` times the power.
    #[default]
    Linear,
    /// `digits` at power 1, 0 at `1/span`, logarithmic between and beyond.
    Logarithmic,
}

table!(
    /// Remissions: (reference_range/r)^range_exponent cos(incidence)^incidence_exponent
    /// (contrast + (1 - contrast) share on the reflector) (1 + noise n).
    Remission {
        /// White relative noise of a beam.
        noise: f64 = 0.04,
        /// Background's remission over the reflector's.
        contrast: f64 = 0.35,
        /// Range at which a reflector met at right angles has remission 1, m.
        reference_range_m: f64 = 3.0,
        /// Power of the range law.
        range_exponent: f64 = 0.5,
        /// Power of the cosine of incidence.
        incidence_exponent: f64 = 0.3,
        /// Law from power to digits.
        law: Law = Law::Linear,
        /// Digits of remission 1: it is quantised to 1/digits.
        digits: f64 = 150.0,
        /// Ratio of the powers at `digits` and at 0 digits of the logarithmic law.
        span: f64 = 100.0,
        /// Largest digit (254 for 8 bit, 65534 for 16 bit); none: no ceiling. A reflector far above
        /// the ceiling blooms: beams that touch it with a part of their spot are at the ceiling too.
        ceiling: Option<f64> = None,
    }
);

table!(
    /// Turn of the whole scan, in step with the unsteady scan period. The defaults are what one
    /// recorded LMS511 showed: periods hunt at about 0.3 cycles a scan.
    AngleJitter {
        /// Standard deviation of the period over the period.
        period_jitter: f64 = 127e-6 / 40e-3,
        /// Turn by the relative deviations of this scan's period, the one before and the one before
        /// that, deg per 1.
        period_to_angle_deg: [f64; 3] = [-0.050e-3 * 40e3, 0.094e-3 * 40e3, -0.022e-3 * 40e3],
        /// Standard deviation of the rest, deg.
        residual_deg: f64 = 0.006,
    }
);

table!(
    /// Wild ranges.
    Outliers {
        /// Share of the beams.
        share: f64 = 0.01,
        /// Their ranges are uniform from the smallest the device measures up to this, m.
        range_max_m: f64 = 12.0,
    }
);

table!(
    /// Beams without return.
    Dropouts {
        /// Share of the beams.
        share: f64 = 0.01,
    }
);

table!(
    /// Thin cables across the scan plane, at new places in every scan.
    Cables {
        /// How many.
        count: usize = 3,
        /// Diameter, mm.
        diameter_mm: f64 = 8.0,
        /// Nearest and furthest, m.
        range_m: [f64; 2] = [0.5, 3.0],
        /// A cable gives the range if it has more than this share of the spot.
        share: f64 = 0.2,
        /// Remission over a reflector's.
        remission: f64 = 0.2,
    }
);

table!(
    /// A flat block in front of a part of the beams, at a new place in every scan.
    Cargo {
        /// Narrowest and widest, deg.
        width_deg: [f64; 2] = [5.0, 12.0],
        /// Nearest and furthest, m.
        range_m: [f64; 2] = [0.3, 1.0],
        /// First and last beam angle of its middle, deg.
        between_deg: [f64; 2] = [30.0, 150.0],
        /// Remission over a reflector's.
        remission: f64 = 0.35,
    }
);

table!(
    /// Strips that are not there.
    MissingStrip {
        /// Which, counted as in the frame file from 0; none: `count` of the ceiling's are drawn.
        strips: Vec<usize> = Vec::new(),
        /// How many are drawn once a run.
        count: usize = 1,
    }
);

table!(
    /// Clocks and telegrams. The defaults follow recordings of an LMS511.
    Clocks {
        /// The device's clock at the first scan, s.
        device_start_s: f64 = 1000.0,
        /// The device's clock is fast by this, ppm.
        drift_ppm: f64 = 6.5,
        /// Digit of the device's clock, us.
        device_resolution_us: f64 = 1.0,
        /// White error of the stamps, us.
        stamp_sigma_us: f64 = 30.0,
        /// Digit of the stamps, us.
        stamp_resolution_us: f64 = 1.0,
        /// From the first beam to the telegram's transmission, scan periods.
        transmission_periods: f64 = 0.95,
        /// And more, ms.
        transmission_ms: f64 = 3.0,
        /// From transmission to the last byte, ms, at least.
        latency_ms: f64 = 0.5,
        /// Mean of the exponential time on top, ms.
        latency_jitter_ms: f64 = 0.15,
    }
);

table!(
    /// Errors of the IMU. Biases and misalignment are drawn once a run, Gaussian a component; the
    /// figures are the standard deviations.
    Imu {
        /// Constant error of roll, pitch and yaw, deg.
        attitude_bias_deg: f64 = 0.2,
        /// White noise of the angles, deg.
        attitude_noise_deg: f64 = 0.05,
        /// Random walk of the angles' errors, deg/sqrt(s).
        attitude_walk_deg_sqrt_s: f64 = 0.005,
        /// Constant error of the rates, deg/s.
        gyro_bias_deg_s: f64 = 0.7,
        /// White noise of the rates, deg/sqrt(h).
        gyro_noise_deg_sqrt_h: f64 = 3.5,
        /// Constant error of the accelerations, mg.
        accel_bias_mg: f64 = 10.0,
        /// White noise of the accelerations, m/s^2.
        accel_noise_m_s2: f64 = 0.026,
        /// Turn of the rate and acceleration axes against the attitude's, deg.
        misalignment_deg: f64 = 0.2,
        /// Digit of the angles, deg.
        angle_resolution_deg: f64 = 360.0 / 65536.0,
        /// The device's clock counts these, ms.
        tick_ms: f64 = 6.5536,
    }
);

/// What a value may be, beside finite.
#[derive(Clone, Copy, Debug)]
enum Rule {
    /// Between 0 and 1.
    Share,
    /// Not negative.
    Size,
    /// Above 0.
    Positive,
    /// Above 1.
    Ratio,
    /// Anything.
    Number,
}

impl Rule {
    fn allows(self, value: f64) -> bool {
        value.is_finite()
            && match self {
                Rule::Share => (0.0..=1.0).contains(&value),
                Rule::Size => value >= 0.0,
                Rule::Positive => value > 0.0,
                Rule::Ratio => value > 1.0,
                Rule::Number => true,
            }
    }

    fn wanted(self) -> &'static str {
        match self {
            Rule::Share => "must lie between 0 and 1",
            Rule::Size => "must not be negative",
            Rule::Positive => "must be above 0",
            Rule::Ratio => "must be above 1",
            Rule::Number => "must be a number",
        }
    }
}

/// Key, value and rule of each of the fields named.
macro_rules! ruled {
    ($parameters:expr; $($rule:ident: $($table:ident.$field:ident$([$index:literal])?),+;)+) => {
        [$($((
            concat!(stringify!($table), ".", stringify!($field) $(, "[", $index, "]")?),
            $parameters.$table.$field$([$index])?,
            Rule::$rule,
        )),+),+]
    };
}

/// Key and ends of each of the intervals named.
macro_rules! intervals {
    ($parameters:expr; $($table:ident.$field:ident),+) => {
        [$((concat!(stringify!($table), ".", stringify!($field)), $parameters.$table.$field)),+]
    };
}

impl Parameters {
    /// Reads an effects file for a run in `frame`.
    ///
    /// # Errors
    /// [`ConfigError`].
    pub fn read(path: &Path, frame: &Frame) -> Result<Parameters, ConfigError> {
        let text = toml_file::read(path)?;
        toml_file::parse(&text, path, |parameters: &Parameters| {
            parameters.check(frame)
        })
    }

    /// Checks that shares are shares, sizes are not negative, and what is named is in the frame.
    ///
    /// # Errors
    /// Key and reason of the first value that makes no sense.
    pub(crate) fn check(&self, frame: &Frame) -> Result<(), Unsound> {
        let optional = [
            (
                "noise.sigma_mm",
                self.noise.sigma_mm.unwrap_or(0.0),
                Rule::Size,
            ),
            (
                "remission.ceiling",
                self.remission.ceiling.unwrap_or(0.0),
                Rule::Size,
            ),
        ];
        let given = ruled!(self;
            Share: footprint.hit_threshold, mixed.hit_threshold[0], mixed.hit_threshold[1],
                mixed.share, mixed.between[0], mixed.between[1], echoes.share, outliers.share,
                dropouts.share, cables.share;
            Size: bias.common_mm, bias.face_mm, remission.noise, remission.contrast,
                angle_jitter.period_jitter, angle_jitter.residual_deg, cables.remission,
                cargo.width_deg[0], cargo.width_deg[1], cargo.remission, clocks.stamp_sigma_us,
                clocks.transmission_periods, clocks.transmission_ms, clocks.latency_ms,
                clocks.latency_jitter_ms, imu.attitude_bias_deg, imu.attitude_noise_deg,
                imu.attitude_walk_deg_sqrt_s, imu.gyro_bias_deg_s, imu.gyro_noise_deg_sqrt_h,
                imu.accel_bias_mg, imu.accel_noise_m_s2, imu.misalignment_deg,
                imu.angle_resolution_deg;
            Positive: bias.scale, quantisation.step_mm, footprint.scale, footprint.constant_mm,
                remission.reference_range_m, remission.digits, outliers.range_max_m,
                cables.diameter_mm, cables.range_m[0], cables.range_m[1], cargo.range_m[0],
                cargo.range_m[1], clocks.device_resolution_us, clocks.stamp_resolution_us,
                imu.tick_ms;
            Ratio: remission.span;
            Number: bias.remission_mm, remission.range_exponent, remission.incidence_exponent,
                angle_jitter.period_to_angle_deg[0], angle_jitter.period_to_angle_deg[1],
                angle_jitter.period_to_angle_deg[2], cargo.between_deg[0], cargo.between_deg[1],
                clocks.device_start_s, clocks.drift_ppm;
        );
        let wrong = |(_, value, rule): &&(&str, f64, Rule)| !rule.allows(*value);
        if let Some((key, value, rule)) = optional.iter().chain(&given).find(wrong) {
            return Err((key.to_string(), format!("{value} {}", rule.wanted())));
        }
        let intervals = intervals!(self;
            mixed.hit_threshold, mixed.between, cables.range_m, cargo.width_deg, cargo.range_m,
            cargo.between_deg);
        if let Some((key, [from, to])) = intervals.into_iter().find(|(_, [from, to])| from > to) {
            return Err((key.to_owned(), format!("{from} lies above {to}")));
        }
        let count = frame.strips.len();
        match self.missing_strip.strips.iter().find(|k| **k >= count) {
            Some(strip) => {
                let why =
                    format!("there is no strip {strip}; the frame has {count}, counted from 0");
                Err(("missing_strip.strips".to_owned(), why))
            }
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::staged;

    fn checked(text: &str) -> Result<(), String> {
        let parameters: Parameters = toml::from_str(text).unwrap();
        let checked = parameters.check(&staged::frame(&[]));
        checked.map_err(|(key, why)| format!("{key}: {why}"))
    }

    #[test]
    fn a_file_changes_what_it_names() {
        let text = "[noise]\nsigma_mm = 4.0\n[remission]\nceiling = 254\nlaw = \"logarithmic\"\n";
        let parameters: Parameters = toml::from_str(text).unwrap();
        assert_eq!(parameters.noise.sigma_mm, Some(4.0));
        assert_eq!(parameters.remission.law, Law::Logarithmic);
        assert_eq!(parameters.remission.noise, 0.04);
        assert_eq!(checked(text), Ok(()));
        assert!(toml::from_str::<Parameters>("[noise]\nsigma = 4.0").is_err());
    }

    #[test]
    fn what_makes_no_sense_is_named() {
        for (text, says) in [
            ("[mixed]\nshare = 1.4", "mixed.share: 1.4 must lie between"),
            (
                "[remission]\nspan = 1.0",
                "remission.span: 1 must be above 1",
            ),
            (
                "[remission]\nceiling = -1.0",
                "remission.ceiling: -1 must not be negative",
            ),
            ("[remission]\nceiling = nan", "remission.ceiling: NaN"),
            ("[noise]\nsigma_mm = inf", "noise.sigma_mm: inf"),
            ("[imu]\ngyro_bias_deg_s = nan", "imu.gyro_bias_deg_s: NaN"),
            (
                "[cables]\nrange_m = [-1.0, 2.0]",
                "cables.range_m[0]: -1 must be above 0",
            ),
            (
                "[mixed]\nbetween = [0.9, 0.1]",
                "mixed.between: 0.9 lies above 0.1",
            ),
            (
                "[missing_strip]\nstrips = [0, 4]",
                "no strip 4; the frame has 4",
            ),
        ] {
            let said = checked(text).unwrap_err();
            assert!(said.contains(says), "{text}: {said}");
        }
        assert_eq!(checked("[missing_strip]\nstrips = [0, 3]"), Ok(()));
    }
}
