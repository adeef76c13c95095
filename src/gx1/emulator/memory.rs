//! The emulated EEPROM.

use super::Behaviour;
use crate::gx1::scale::Gains;
use crate::gx1::{TickFactors, eeprom};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// Words at even addresses, as far as one byte reaches.
const WORDS: usize = eeprom::LAST_ADDRESS as usize / 2 + 1;

/// The three cells of the hard-iron offset.
const HARD_IRON: [u16; 3] = [172, 174, 176];

/// The cells.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Memory([u16; WORDS]);

impl Memory {
    /// As it left the factory, then set as `behaviour` says. What the calibration cells hold is
    /// drawn; nothing reads it but people.
    pub(super) fn new(behaviour: &Behaviour) -> Memory {
        let mut random = ChaCha8Rng::seed_from_u64(behaviour.seed);
        random.set_stream(0xEE);
        let mut memory = Memory([0; WORDS]);
        for (first, last) in eeprom::CALIBRATION {
            for address in (first..=last).step_by(2) {
                memory.set(address, random.next_u32() as u16);
            }
        }
        for cell in eeprom::CELLS {
            memory.set(cell.address, cell.default.unwrap_or(0));
        }
        memory.set(eeprom::SERIAL_CELL, behaviour.serial);
        memory.set(eeprom::MODEL_CELL, 3);
        if let Some(code) = eeprom::baud_code(behaviour.baud) {
            memory.set(eeprom::BAUD_CELL, code);
        }
        let power_up = behaviour.power_up.map_or(0, |c| u16::from(c.byte()));
        memory.set(eeprom::POWER_UP_CELL, power_up);
        for (address, factor) in eeprom::TICK_CELLS.into_iter().zip(behaviour.tick.0) {
            memory.set(address, factor);
        }
        memory
    }

    /// A cell; 0 where there is none.
    pub(super) fn get(&self, address: u16) -> u16 {
        self.0.get(usize::from(address / 2)).copied().unwrap_or(0)
    }

    /// Writes a cell. The unit itself refuses nothing: that is its driver's business.
    pub(super) fn set(&mut self, address: u16, value: u16) {
        if let Some(cell) = self.0.get_mut(usize::from(address / 2)) {
            *cell = value;
        }
    }

    pub(super) fn gains(&self) -> Gains {
        let [accel, rate, mag] = eeprom::GAIN_CELLS.map(|address| self.get(address));
        Gains { accel, rate, mag }
    }

    pub(super) fn tick(&self) -> TickFactors {
        TickFactors(eeprom::TICK_CELLS.map(|address| self.get(address)))
    }

    /// The offset that is taken off the field, gauss.
    pub(super) fn hard_iron_gauss(&self) -> [f64; 3] {
        let gains = self.gains();
        HARD_IRON.map(|address| gains.mag_gauss(self.get(address)))
    }

    /// Adds to the offset, gauss.
    pub(super) fn set_hard_iron(&mut self, more_gauss: [f64; 3]) {
        let (gains, old) = (self.gains(), self.hard_iron_gauss());
        for ((address, old), more) in HARD_IRON.into_iter().zip(old).zip(more_gauss) {
            self.set(address, gains.mag_word(old + more));
        }
    }
}
