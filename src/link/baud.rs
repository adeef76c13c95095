//! Serial speeds: what a converter's clock makes of a wanted one, and what a line can carry.

/// Bits on the line for one byte: start, eight data bits, stop.
const BITS_A_BYTE: f64 = 10.0;
/// The clock of a UART is divided by this before anything else.
const PRESCALER: f64 = 32.0;

/// The largest error of a realised speed with which both ends still understand each other, 2 %.
pub const MAX_ERROR: f64 = 0.02;

/// A speed that a clock divided by a whole number gives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Realised {
    /// The divider.
    pub divider: f64,
    /// The speed, baud.
    pub baud: f64,
    /// Its distance from the wanted one as a share of that.
    pub error: f64,
}

impl Realised {
    /// What a crystal of `crystal_hz` gives for a wanted speed: crystal / 32 over the nearest whole
    /// divider (Kurniawan 2017, eq. 2.1 and 2.2); none where that divider is 0.
    pub fn new(crystal_hz: f64, wanted_baud: u32) -> Option<Realised> {
        let wanted = f64::from(wanted_baud);
        let base = crystal_hz / PRESCALER;
        let divider = (base / wanted).round();
        if !(divider >= 1.0 && divider.is_finite()) {
            return None;
        }
        let baud = base / divider;
        Some(Realised {
            divider,
            baud,
            error: (baud - wanted).abs() / wanted,
        })
    }

    /// Whether the error is within the 2 % that practice allows.
    pub fn fits(&self) -> bool {
        self.error <= MAX_ERROR
    }
}

/// How many telegrams of `bytes` a line of `baud` (8N1) carries a second.
pub fn telegrams_a_second(baud: u32, bytes: usize) -> f64 {
    f64::from(baud) / BITS_A_BYTE / bytes as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The dissertation's own example: 38 400 baud from 40 MHz are 37 879, 1.3573 % off.
    #[test]
    fn the_dissertations_example() {
        let realised = Realised::new(40e6, 38_400).unwrap();
        assert_eq!(realised.baud.round(), 37_879.0);
        assert!((realised.error - 0.013_573).abs() < 1e-6 && realised.fits());
        // Its standard clock misses 500 kBaud; the replaced one hits it.
        assert!(!Realised::new(40e6, 500_000).unwrap().fits());
        let exact = Realised::new(16e6, 500_000).unwrap();
        assert_eq!(
            (exact.divider, exact.baud, exact.error),
            (1.0, 500_000.0, 0.0)
        );
        assert_eq!(Realised::new(16e6, 2_000_000), None);
        assert_eq!(Realised::new(0.0, 9600), None);
    }

    #[test]
    fn a_line_carries_what_it_can() {
        assert!((telegrams_a_second(500_000, 3553) - 14.1).abs() < 0.05);
        assert!((telegrams_a_second(500_000, 871) - 57.4).abs() < 0.05);
    }
}
