//! The unit's clock: how long a tick is, and how many a calculation takes.

use super::command::{Command, Word};
use std::ops::RangeInclusive;

/// The four factors of the tick, cells 238, 240, 242 and 246.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TickFactors(pub [u16; 4]);

/// A tick that no unit has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "the tick factors (cells 238, 240, 242 and 246) are {:?}, a tick of {} ms; one of 0.1 to 100 ms \
     makes sense",
    .0.0, .0.tick_s() * 1e3
)]
pub struct TickError(pub TickFactors);

/// The ticks that make sense, ns.
const SENSIBLE_NS: RangeInclusive<u64> = 100_000..=100_000_000;

/// The base of the tick, ns: two settings whose ticks are known agree on 1e-7 s.
const BASE_NS: u64 = 100;

impl TickFactors {
    /// What leaves the factory: 6.5536 ms.
    pub const FACTORY: TickFactors = TickFactors([16, 16, 256, 1]);

    /// Says what is wrong with them, if anything is.
    ///
    /// # Errors
    /// [`TickError`].
    pub fn check(self) -> Result<TickFactors, TickError> {
        if SENSIBLE_NS.contains(&self.tick_ns()) {
            Ok(self)
        } else {
            Err(TickError(self))
        }
    }

    /// Length of a tick by the unit's own clock, ns; 0 where a factor is.
    pub fn tick_ns(self) -> u64 {
        self.0
            .iter()
            .fold(BASE_NS, |ns, factor| ns.saturating_mul(u64::from(*factor)))
    }

    /// Length of a tick, s.
    pub fn tick_s(self) -> f64 {
        self.tick_ns() as f64 * 1e-9
    }

    /// Factors of a tick of `ns`, which is a multiple of 0.1 us from 0.1 ms to 100 ms; none where
    /// no four factors make it. The first three are those of 10 ms settings in the field (4, 10,
    /// 250) wherever they fit.
    pub fn of_tick_ns(ns: u64) -> Option<TickFactors> {
        if !SENSIBLE_NS.contains(&ns) || !ns.is_multiple_of(BASE_NS) {
            return None;
        }
        let product = ns / BASE_NS;
        for first in [
            [4, 10, 250],
            [16, 16, 256],
            [4, 10, 25],
            [1, 1, 1000],
            [1, 1, 1],
        ] {
            let made: u64 = first.iter().map(|factor| u64::from(*factor)).product();
            if product.is_multiple_of(made)
                && let Ok(last) = u16::try_from(product / made)
            {
                let [a, b, c] = first;
                return Some(TickFactors([a, b, c, last]));
            }
        }
        None
    }
}

/// Ticks that one calculation of a reply takes: 2 for vectors, 3 where an attitude is calculated,
/// one less with gyro stabilisation off (3DM-G protocol; a GX1 with other tick factors steps
/// otherwise, so a reader takes the step from what arrives).
pub fn cycle_ticks(command: Command, stabilised: bool) -> u16 {
    let attitude = command
        .words()
        .iter()
        .any(|word| matches!(word, Word::Roll | Word::Quaternion(_) | Word::Matrix(..)));
    let ticks = if attitude { 3 } else { 2 };
    if stabilised { ticks } else { ticks - 1 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_settings_fix_the_base() {
        assert_eq!(TickFactors::FACTORY.tick_ns(), 6_553_600);
        assert_eq!(TickFactors([4, 10, 250, 10]).tick_ns(), 10_000_000);
        assert_eq!(TickFactors([4, 10, 250, 2]).tick_ns(), 2_000_000);
        assert_eq!(TickFactors([0, 10, 250, 2]).tick_ns(), 0);
        assert_eq!(TickFactors([u16::MAX; 4]).tick_ns(), u64::MAX);
    }

    #[test]
    fn senseless_ticks_are_refused() {
        for factors in [[16, 16, 256, 1], [4, 10, 250, 2], [1, 1, 1000, 1]] {
            assert!(TickFactors(factors).check().is_ok(), "{factors:?}");
        }
        for factors in [[0, 10, 250, 2], [1, 1, 1, 1], [u16::MAX; 4]] {
            let wrong = TickFactors(factors).check().unwrap_err();
            assert!(wrong.to_string().contains("0.1 to 100 ms"), "{wrong}");
        }
    }

    #[test]
    fn factors_make_the_tick_asked_for() {
        assert_eq!(
            TickFactors::of_tick_ns(10_000_000),
            Some(TickFactors([4, 10, 250, 10]))
        );
        assert_eq!(
            TickFactors::of_tick_ns(2_000_000),
            Some(TickFactors([4, 10, 250, 2]))
        );
        assert_eq!(
            TickFactors::of_tick_ns(6_553_600),
            Some(TickFactors::FACTORY)
        );
        for ns in (100_000..=100_000_000).step_by(12_300) {
            if let Some(factors) = TickFactors::of_tick_ns(ns) {
                assert_eq!(factors.tick_ns(), ns);
            }
        }
        assert_eq!(TickFactors::of_tick_ns(10_000_050), None);
        assert_eq!(TickFactors::of_tick_ns(50_000), None);
    }

    #[test]
    fn attitudes_take_a_tick_more() {
        assert_eq!(cycle_ticks(Command::InstantVectors, true), 2);
        assert_eq!(cycle_ticks(Command::StabilisedEuler, true), 3);
        assert_eq!(cycle_ticks(Command::StabilisedEulerAccelRate, false), 2);
    }
}
