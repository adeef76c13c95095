//! From the words of a reply to SI units.

use super::command::Word;
use super::packet::Packet;
use std::f64::consts::TAU;

/// The unit of acceleration in which the device counts, m/s^2: the maker's own definition.
pub const G_M_S2: f64 = 9.81;

/// What the three gain cells are multiples of.
pub const GAIN_UNIT: f64 = 32_768_000.0;

/// What quaternions and matrices are multiplied by.
pub const UNIT_SCALE: f64 = 8192.0;

/// The gain cells of a unit: full scale of its vectors, in thousandths.
///
/// They differ from unit to unit and are read from the EEPROM; there is no default on purpose (see
/// [`Gains::FACTORY`] for what the maker's documents print).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Gains {
    /// AccelGainScale, cell 230: full scale in thousandths of g.
    pub accel: u16,
    /// GyroGainScale, cell 130: full scale in thousandths of rad/s.
    pub rate: u16,
    /// MagGainScale, cell 232: full scale in thousandths of gauss.
    pub mag: u16,
}

/// Gains that no 3DM-GX1 has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum GainsError {
    /// A gain of zero makes every reading zero.
    #[error("cell {0} (a gain) holds 0: this is no 3DM-GX1, or its EEPROM is blank")]
    Zero(u16),
    /// The predecessor answers with the same shapes but other scales.
    #[error(
        "cell 130 (GyroGainScale) holds 64: this is the predecessor 3DM-G, whose scales are others; \
         it is not read"
    )]
    Predecessor,
}

impl Gains {
    /// What leaves the factory.
    pub const FACTORY: Gains = Gains {
        accel: 8500,
        rate: 10_000,
        mag: 2000,
    };

    /// Says what is wrong with them, if anything is.
    ///
    /// # Errors
    /// [`GainsError`].
    pub fn check(self) -> Result<Gains, GainsError> {
        for (cell, gain) in [(230, self.accel), (130, self.rate), (232, self.mag)] {
            if gain == 0 {
                return Err(GainsError::Zero(cell));
            }
        }
        if self.rate == 64 {
            return Err(GainsError::Predecessor);
        }
        Ok(self)
    }

    /// Acceleration of a word, m/s^2.
    pub fn accel_m_s2(self, word: u16) -> f64 {
        f64::from(word.cast_signed()) * f64::from(self.accel) / GAIN_UNIT * G_M_S2
    }

    /// Angular rate of a word, rad/s.
    pub fn rate_rad_s(self, word: u16) -> f64 {
        f64::from(word.cast_signed()) * f64::from(self.rate) / GAIN_UNIT
    }

    /// Magnetic field of a word, gauss.
    pub fn mag_gauss(self, word: u16) -> f64 {
        f64::from(word.cast_signed()) * f64::from(self.mag) / GAIN_UNIT
    }

    /// The word that stands for an acceleration, saturated.
    pub fn accel_word(self, m_s2: f64) -> u16 {
        saturated(m_s2 / G_M_S2 * GAIN_UNIT / f64::from(self.accel))
    }

    /// The word that stands for an angular rate, saturated.
    pub fn rate_word(self, rad_s: f64) -> u16 {
        saturated(rad_s * GAIN_UNIT / f64::from(self.rate))
    }

    /// The word that stands for a magnetic field, saturated.
    pub fn mag_word(self, gauss: f64) -> u16 {
        saturated(gauss * GAIN_UNIT / f64::from(self.mag))
    }

    /// The value of any word in the unit of [`unit()`].
    pub fn value(self, word: Word, bits: u16) -> f64 {
        match word {
            Word::Mag(_) | Word::MagMin(_) | Word::MagMax(_) | Word::MagOffset(_) => {
                self.mag_gauss(bits)
            }
            Word::Accel(_) => self.accel_m_s2(bits),
            Word::Rate(_) => self.rate_rad_s(bits),
            Word::Quaternion(_) | Word::Matrix(..) => unit_value(bits),
            Word::Roll | Word::Pitch | Word::Yaw => angle_rad(bits),
            Word::Temperature => temperature_deg_c(bits),
            Word::RawMag(_)
            | Word::RawAccel(_)
            | Word::RawRate(_)
            | Word::Value(_)
            | Word::Ticks => f64::from(bits),
        }
    }

    /// Three components of a vector, where the packet has them.
    pub fn vector(self, packet: &Packet, axis: fn(u8) -> Word) -> Option<[f64; 3]> {
        let component = |i| {
            let word = axis(i);
            packet.word(word).map(|bits| self.value(word, bits))
        };
        Some([component(0)?, component(1)?, component(2)?])
    }
}

/// The unit of a word's value; empty for bare numbers.
pub fn unit(word: Word) -> &'static str {
    match word {
        Word::Mag(_) | Word::MagMin(_) | Word::MagMax(_) | Word::MagOffset(_) => "gauss",
        Word::Accel(_) => "m_s2",
        Word::Rate(_) => "rad_s",
        Word::Roll | Word::Pitch | Word::Yaw => "rad",
        Word::Temperature => "degC",
        _ => "",
    }
}

/// An angle, rad in [-pi, pi).
pub fn angle_rad(word: u16) -> f64 {
    f64::from(word.cast_signed()) * TAU / 65_536.0
}

/// The word of an angle; whole turns are taken off.
pub fn angle_word(rad: f64) -> u16 {
    let turns = (rad / TAU * 65_536.0).round().rem_euclid(65_536.0);
    // A value below 65536; NaN becomes 0.
    turns as u16
}

/// A component of a quaternion or matrix.
pub fn unit_value(word: u16) -> f64 {
    f64::from(word.cast_signed()) / UNIT_SCALE
}

/// The word of a component of a quaternion or matrix.
pub fn unit_word(value: f64) -> u16 {
    saturated(value * UNIT_SCALE)
}

/// Temperature, degC: 0 to 65535 are 0 to 5 V, 0.5 V at 0 degC, 10 mV a degree.
pub fn temperature_deg_c(word: u16) -> f64 {
    (f64::from(word) * 5.0 / 65_536.0 - 0.5) * 100.0
}

/// The word of a temperature.
pub fn temperature_word(deg_c: f64) -> u16 {
    ((deg_c / 100.0 + 0.5) * 65_536.0 / 5.0).round() as u16
}

/// Rounded and held in the range of a signed word.
fn saturated(value: f64) -> u16 {
    (value.round() as i16).cast_unsigned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gx1::{Command, packet};
    use proptest::prelude::*;

    fn close(got: f64, wanted: f64, tolerance: f64) {
        assert!((got - wanted).abs() <= tolerance, "{got} is not {wanted}");
    }

    #[test]
    fn values_that_another_driver_printed() {
        for (word, deg) in [(1000i16, 5.4932), (-2000, -10.9863), (30_000, 164.7949)] {
            close(angle_rad(word.cast_unsigned()).to_degrees(), deg, 5e-5);
        }
        close(Gains::FACTORY.accel_m_s2(3855), 9.80985, 5e-5);
        // 3276.8 counts per rad/s, 16384 per gauss.
        close(Gains::FACTORY.rate_rad_s(32_767), 9.9997, 1e-4);
        close(Gains::FACTORY.mag_gauss(16_384), 1.0, 1e-12);
        close(temperature_deg_c(9830), 25.0, 4e-3);
        assert_eq!(unit_value(8192), 1.0);
    }

    #[test]
    fn senseless_gains_are_refused() {
        assert!(Gains::FACTORY.check().is_ok());
        let with = |rate, mag| {
            Gains {
                rate,
                mag,
                ..Gains::FACTORY
            }
            .check()
        };
        assert_eq!(with(64, 2000), Err(GainsError::Predecessor));
        assert_eq!(with(10_000, 0), Err(GainsError::Zero(232)));
    }

    #[test]
    fn vectors_come_from_their_own_words() {
        let words = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10];
        let bytes = packet::encode(Command::InstantVectors, &words).unwrap();
        let packet = Packet::decode(&bytes).unwrap();
        let gains = Gains {
            accel: 1000,
            rate: 2000,
            mag: 4000,
        };
        let per_g = 32_768.0;
        let accel = gains.vector(&packet, Word::Accel).unwrap();
        close(accel[2], 6.0 / per_g * 9.81, 1e-15);
        let rate = gains.vector(&packet, Word::Rate).unwrap();
        close(rate[0], 7.0 * 2.0 / per_g, 1e-15);
        let mag = gains.vector(&packet, Word::Mag).unwrap();
        close(mag[1], 2.0 * 4.0 / per_g, 1e-15);
        assert_eq!(gains.vector(&packet, Word::MagMin), None);
    }

    proptest! {
        #[test]
        fn words_survive(word in any::<u16>(), gain in 1u16..20_000) {
            let gains = Gains { accel: gain, rate: gain, mag: gain };
            prop_assert_eq!(angle_word(angle_rad(word)), word);
            prop_assert_eq!(unit_word(unit_value(word)), word);
            prop_assert_eq!(gains.accel_word(gains.accel_m_s2(word)), word);
            prop_assert_eq!(gains.rate_word(gains.rate_rad_s(word)), word);
            prop_assert_eq!(gains.mag_word(gains.mag_gauss(word)), word);
            prop_assert_eq!(temperature_word(temperature_deg_c(word)), word);
        }
    }
}
