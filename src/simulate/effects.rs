//! Which effects of a real device are on.

use std::fmt;
use std::str::FromStr;

/// One effect that can be switched by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Effect {
    /// Gaussian noise of the ranges.
    Noise,
    /// Systematic range errors: common to a scan, of a surface, by remission.
    Bias,
    /// Ranges in whole millimetres.
    Quantisation,
    /// The beam's spot has an extent.
    Footprint,
    /// Some partly hit beams return a range between strip and background.
    Mixed,
    /// Several echoes a beam.
    Echoes,
    /// Remissions.
    Remission,
    /// Each beam leaves at its own time; without it the platform is frozen at the reference
    /// instant.
    Motion,
    /// The whole scan is turned a little, in step with the unsteady scan period.
    AngleJitter,
    /// Wild ranges.
    Outliers,
    /// Beams without return.
    Dropouts,
    /// Thin cables in front of the scanner.
    Cables,
    /// A block of cargo in front of the scanner.
    Cargo,
    /// A strip is not there.
    MissingStrip,
    /// Device clock, stamps and telegram times.
    Clocks,
    /// Errors of the IMU.
    Imu,
}

impl Effect {
    /// All of them.
    pub const ALL: [Effect; 16] = [
        Effect::Noise,
        Effect::Bias,
        Effect::Quantisation,
        Effect::Footprint,
        Effect::Mixed,
        Effect::Echoes,
        Effect::Remission,
        Effect::Motion,
        Effect::AngleJitter,
        Effect::Outliers,
        Effect::Dropouts,
        Effect::Cables,
        Effect::Cargo,
        Effect::MissingStrip,
        Effect::Clocks,
        Effect::Imu,
    ];

    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Effect::Noise => "noise",
            Effect::Bias => "bias",
            Effect::Quantisation => "quantisation",
            Effect::Footprint => "footprint",
            Effect::Mixed => "mixed",
            Effect::Echoes => "echoes",
            Effect::Remission => "remission",
            Effect::Motion => "motion",
            Effect::AngleJitter => "angle-jitter",
            Effect::Outliers => "outliers",
            Effect::Dropouts => "dropouts",
            Effect::Cables => "cables",
            Effect::Cargo => "cargo",
            Effect::MissingStrip => "missing-strip",
            Effect::Clocks => "clocks",
            Effect::Imu => "imu",
        }
    }
}

/// A set of effects.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Effects {
    on: u32,
    reference: bool,
}

impl Effects {
    /// No effects: exact ranges of pencil beams.
    pub const NONE: Effects = Effects {
        on: 0,
        reference: false,
    };

    /// The set-up in which the estimators' figures are stated: noise, bias, quantisation, footprint
    /// and remission, and a noise of 6.5 mm at every range.
    pub fn reference() -> Effects {
        let mut effects = Effects::NONE;
        for effect in [
            Effect::Noise,
            Effect::Bias,
            Effect::Quantisation,
            Effect::Footprint,
            Effect::Remission,
        ] {
            effects.insert(effect);
        }
        effects.reference = true;
        effects
    }

    /// Every effect.
    pub fn all() -> Effects {
        let mut effects = Effects::NONE;
        Effect::ALL.iter().for_each(|e| effects.insert(*e));
        effects
    }

    /// Whether an effect is on.
    #[inline]
    pub fn has(&self, effect: Effect) -> bool {
        self.on & (1 << effect as u8) != 0
    }

    /// Whether the reference set-up was named: its noise holds instead of the data sheet's.
    pub fn is_reference(&self) -> bool {
        self.reference
    }

    /// Switches an effect on.
    pub fn insert(&mut self, effect: Effect) {
        self.on |= 1 << effect as u8;
    }

    /// Switches an effect off.
    pub fn remove(&mut self, effect: Effect) {
        self.on &= !(1 << effect as u8);
    }
}

/// A name in a list of effects that is not known.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("\"{0}\" is not an effect; known are none, all, reference, {known}", known = known())]
pub struct UnknownEffect(String);

fn known() -> String {
    Effect::ALL.map(Effect::name).join(", ")
}

impl FromStr for Effects {
    type Err = UnknownEffect;

    /// A list such as `reference,mixed` or `all,-cargo`, read from left to right.
    fn from_str(text: &str) -> Result<Effects, UnknownEffect> {
        let mut effects = Effects::NONE;
        for item in text.split(',').map(str::trim) {
            let (name, add) = match item.strip_prefix('-') {
                Some(name) => (name, false),
                None => (item, true),
            };
            match (name, add) {
                ("none", true) => effects = Effects::NONE,
                ("all", true) => effects.on |= Effects::all().on,
                ("reference", true) => {
                    effects.on |= Effects::reference().on;
                    effects.reference = true;
                }
                _ => {
                    let effect = Effect::ALL
                        .into_iter()
                        .find(|effect| effect.name() == name)
                        .ok_or_else(|| UnknownEffect(item.to_owned()))?;
                    if add {
                        effects.insert(effect);
                    } else {
                        effects.remove(effect);
                    }
                }
            }
        }
        Ok(effects)
    }
}

impl fmt::Display for Effects {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let on: Vec<&str> = Effect::ALL
            .into_iter()
            .filter(|effect| self.has(*effect))
            .map(Effect::name)
            .collect();
        f.write_str(if on.is_empty() { "none" } else { "" })?;
        f.write_str(&on.join(","))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_add_and_take_away() {
        let effects: Effects = "reference,mixed,-remission".parse().unwrap();
        assert!(effects.has(Effect::Mixed) && effects.has(Effect::Noise));
        assert!(!effects.has(Effect::Remission) && !effects.has(Effect::Motion));
        assert!(effects.is_reference());
        let effects: Effects = "all,-cargo".parse().unwrap();
        let expected = Effect::ALL.into_iter().filter(|e| *e != Effect::Cargo);
        assert!(expected.into_iter().all(|e| effects.has(e)));
        assert!(!effects.has(Effect::Cargo) && !effects.is_reference());
        assert_eq!("none".parse::<Effects>().unwrap(), Effects::NONE);
        assert_eq!(Effects::NONE.to_string(), "none");
        assert_eq!(
            "noise, angle-jitter"
                .parse::<Effects>()
                .unwrap()
                .to_string(),
            "noise,angle-jitter"
        );
    }

    #[test]
    fn an_unknown_name_is_named() {
        let error = "noise,fog".parse::<Effects>().unwrap_err().to_string();
        assert!(
            error.contains("\"fog\"") && error.contains("missing-strip"),
            "{error}"
        );
        assert!("".parse::<Effects>().is_err());
        assert!("-all".parse::<Effects>().is_err());
    }
}
