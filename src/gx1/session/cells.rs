//! What a unit says of itself: who it is, what its EEPROM cells hold.

use super::{ANSWER_WAIT, Interrupted, SLICE, Session, SessionError, TIMES};
use crate::gx1::command::{Command, Word};
use crate::gx1::eeprom;
use crate::gx1::scale::Gains;
use crate::gx1::ticks::TickFactors;
use std::time::{Duration, Instant};

/// Who a unit says it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Identity {
    /// The firmware's number; none on RS-485, where it cannot be asked.
    pub firmware: Option<u16>,
    /// The serial number.
    pub serial: u16,
}

/// Silence after which what comes is no late answer to another question.
const QUIET: Duration = Duration::from_millis(20);

/// The command that writes a cell, and its free bytes: with checksum on RS-232, bare on RS-485.
///
/// # Errors
/// [`SessionError::FarCell`] on RS-485, where an address is one byte.
pub fn write_request(
    address: u16,
    value: u16,
    on_bus: bool,
) -> Result<(Command, Vec<u8>), SessionError> {
    let value = value.to_be_bytes();
    if on_bus {
        let free = [&[near(address)?][..], &value].concat();
        return Ok((Command::WriteEeprom, free));
    }
    let free = [address.to_be_bytes(), value].concat();
    Ok((Command::WriteEepromChecked, free))
}

/// An address as the one byte that RS-485 has for it.
fn near(address: u16) -> Result<u8, SessionError> {
    u8::try_from(address).map_err(|_| SessionError::FarCell(address))
}

impl Session {
    /// A number that the unit answers with: firmware, serial number, a cell.
    fn number(
        &mut self,
        command: Command,
        free: &[u8],
        interrupted: Interrupted<'_>,
    ) -> Result<u16, SessionError> {
        let packet = self.ask(command, free, interrupted)?;
        Ok(packet.word(Word::Value(0)).unwrap_or(0))
    }

    /// Who the unit is.
    ///
    /// # Errors
    /// [`SessionError::NoAnswer`].
    pub fn identity(&mut self, interrupted: Interrupted<'_>) -> Result<Identity, SessionError> {
        if self.bus.is_some() {
            // The questions for it have no room there; the predecessor's cell stands for one.
            return Ok(Identity {
                firmware: None,
                serial: self.cell(eeprom::SERIAL_CELL, interrupted)?,
            });
        }
        Ok(Identity {
            firmware: Some(self.number(Command::Firmware, &[], interrupted)?),
            serial: self.number(Command::SerialNumber, &[], interrupted)?,
        })
    }

    /// Reads a cell, with checksum.
    ///
    /// # Errors
    /// [`SessionError::NoAnswer`]; [`SessionError::FarCell`].
    pub fn cell(
        &mut self,
        address: u16,
        interrupted: Interrupted<'_>,
    ) -> Result<u16, SessionError> {
        if self.bus.is_some() {
            return self.bare_cell(near(address)?, interrupted);
        }
        let free = address.to_be_bytes();
        self.number(Command::ReadEepromChecked, &free, interrupted)
    }

    /// Reads a cell as it is done on RS-485: two bytes without header and sum, so that it is read
    /// until two answers agree.
    fn bare_cell(
        &mut self,
        address: u8,
        interrupted: Interrupted<'_>,
    ) -> Result<u16, SessionError> {
        let start = Instant::now();
        let mut before = None;
        for _ in 0..2 * TIMES {
            let quiet_by = Instant::now() + ANSWER_WAIT;
            while self.read(QUIET)? && Instant::now() < quiet_by {}
            while let Some(arrived) = self.framer.next() {
                self.queue.push_back(arrived);
            }
            self.send(Command::ReadEeprom, &[address])?;
            let due = Instant::now() + ANSWER_WAIT;
            let mut answer = Vec::new();
            while answer.len() < 2 && Instant::now() < due {
                if interrupted() {
                    return Err(SessionError::Interrupted);
                }
                let left = due.saturating_duration_since(Instant::now());
                let received = self.receive(left.min(SLICE))?;
                let count = received.map_or(0, |received| received.bytes);
                answer.extend_from_slice(self.buffer.get(..count).unwrap_or_default());
            }
            if let [high, low] = answer[..] {
                let value = u16::from_be_bytes([high, low]);
                if before.replace(value) == Some(value) {
                    return Ok(value);
                }
            }
        }
        Err(self.no_answer(Command::ReadEeprom, start, 2 * TIMES))
    }

    /// Writes a cell and reads it back. What must not be written is the caller's to know
    /// ([`eeprom::guard`]).
    ///
    /// # Errors
    /// [`SessionError::NotWritten`] where it reads otherwise; [`SessionError::FarCell`].
    pub fn write_cell(
        &mut self,
        address: u16,
        value: u16,
        interrupted: Interrupted<'_>,
    ) -> Result<(), SessionError> {
        let on_bus = self.bus.is_some();
        let (command, free) = write_request(address, value, on_bus)?;
        if on_bus {
            // Its bare answer is the value, which reading it back tells as well.
            self.send(command, &free)?;
        } else {
            self.ask(command, &free, interrupted)?;
        }
        let got = self.cell(address, interrupted)?;
        if got == value {
            return Ok(());
        }
        Err(SessionError::NotWritten {
            place: self.place().to_owned(),
            address,
            wanted: value,
            got,
        })
    }

    /// The unit's gains. There is no falling back on those of the factory.
    ///
    /// # Errors
    /// [`SessionError::Gains`] where they make no sense.
    pub fn gains(&mut self, interrupted: Interrupted<'_>) -> Result<Gains, SessionError> {
        let [accel, rate, mag] = eeprom::GAIN_CELLS;
        let gains = Gains {
            accel: self.cell(accel, interrupted)?,
            rate: self.cell(rate, interrupted)?,
            mag: self.cell(mag, interrupted)?,
        };
        gains.check().map_err(|reason| SessionError::Gains {
            place: self.place().to_owned(),
            reason,
        })
    }

    /// What the cells of the tick hold, whatever it is.
    ///
    /// # Errors
    /// [`SessionError::NoAnswer`].
    pub fn tick_factors(
        &mut self,
        interrupted: Interrupted<'_>,
    ) -> Result<TickFactors, SessionError> {
        let mut factors = [0; 4];
        for (factor, address) in factors.iter_mut().zip(eeprom::TICK_CELLS) {
            *factor = self.cell(address, interrupted)?;
        }
        Ok(TickFactors(factors))
    }

    /// The unit's tick.
    ///
    /// # Errors
    /// [`SessionError::Tick`] where it makes no sense.
    pub fn tick(&mut self, interrupted: Interrupted<'_>) -> Result<TickFactors, SessionError> {
        let tick = self.tick_factors(interrupted)?;
        tick.check().map_err(|reason| SessionError::Tick {
            place: self.place().to_owned(),
            reason,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cell_is_written_by_the_command_that_the_line_has() {
        let (command, free) = write_request(230, 7000, false).unwrap();
        let bytes = command.request(&free).unwrap();
        assert_eq!(bytes, [0x29, 0x71, 0, 230, 0x1B, 0x58, 0xAA]);
        let (command, free) = write_request(230, 7000, true).unwrap();
        let bytes = command.request(&free).unwrap();
        assert_eq!(bytes, [0x09, 0x71, 230, 0x1B, 0x58, 0xAA]);
        // 300 in one byte would be the cell of the speed.
        assert!(matches!(
            write_request(300, 21, true),
            Err(SessionError::FarCell(300))
        ));
    }
}
