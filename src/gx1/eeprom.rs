//! The EEPROM: what its cells mean, what the factory leaves in them, and which must be let alone.
//!
//! Cells are 16 bit words at even addresses. The factory's calibration lies among them, and cannot
//! be made again in the field: it is never written.

/// What stands between a cell and a writer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Guard {
    /// May be written.
    Free,
    /// May be written by one who insists: the text says what is at stake.
    Forced(&'static str),
    /// Is never written: the text says why.
    Refused(&'static str),
}

/// A cell whose meaning is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cell {
    /// Its address, even.
    pub address: u16,
    /// One word for the command line.
    pub name: &'static str,
    /// What it means.
    pub meaning: &'static str,
    /// What the factory leaves in it, where that is known.
    pub default: Option<u16>,
}

/// The cells that are known. Confirmed by two GX1 sources: 130, 230 to 246; the others stand in the
/// predecessor's documents or in one driver.
pub const CELLS: &[Cell] = &[
    cell(
        26,
        "bias-samples",
        "samples of a capture of the gyros' bias, 1 to 10000",
        Some(500),
    ),
    cell(30, "oversampling", "oversampling, 1 to 15", Some(4)),
    cell(
        44,
        "baud",
        "speed: 129 = 19200, 64 = 38400, 21 = 115200 Bd",
        Some(64),
    ),
    cell(46, "interface", "1 = RS-232, 0 = RS-485", Some(1)),
    cell(64, "node-address", "address on RS-485", Some(1)),
    cell(
        122,
        "gyro-stabilisation",
        "gyro stabilisation, 1 = on",
        Some(1),
    ),
    cell(
        124,
        "accel-error-gain",
        "gain of the accelerometers' correction",
        Some(500),
    ),
    cell(
        126,
        "mag-error-gain",
        "gain of the magnetometers' correction",
        Some(500),
    ),
    cell(128, "bias-gain", "gain of the bias tracking", Some(50)),
    cell(
        130,
        "gyro-gain-scale",
        "full scale of the rates, thousandths of rad/s",
        Some(10_000),
    ),
    cell(
        132,
        "power-up-command",
        "command that is streamed after power-up, 0 = none",
        Some(0),
    ),
    cell(134, "serial-number", "serial number", None),
    cell(172, "hard-iron-x", "hard-iron offset of x, counts", None),
    cell(174, "hard-iron-y", "hard-iron offset of y, counts", None),
    cell(176, "hard-iron-z", "hard-iron offset of z, counts", None),
    cell(
        230,
        "accel-gain-scale",
        "full scale of the accelerations, thousandths of g",
        Some(8500),
    ),
    cell(
        232,
        "mag-gain-scale",
        "full scale of the field, thousandths of gauss",
        Some(2000),
    ),
    cell(234, "model-number", "model number", None),
    cell(238, "tick-factor-1", "factor of the tick", Some(16)),
    cell(240, "tick-factor-2", "factor of the tick", Some(16)),
    cell(242, "tick-factor-3", "factor of the tick", Some(256)),
    cell(246, "tick-factor-4", "factor of the tick", Some(1)),
];

/// Addresses of the factory's calibration, first and last cell of each range.
pub const CALIBRATION: [(u16, u16); 4] = [(2, 24), (32, 42), (48, 60), (66, 118)];

/// The addresses of the three gains: acceleration, rate, field.
pub const GAIN_CELLS: [u16; 3] = [230, 130, 232];

/// The addresses of the four factors of the tick.
pub const TICK_CELLS: [u16; 4] = [238, 240, 242, 246];

/// Samples of a capture of the gyros' bias.
pub const BIAS_SAMPLES_CELL: u16 = 26;
/// Speed of the line.
pub const BAUD_CELL: u16 = 44;
/// RS-232 or RS-485.
pub const INTERFACE_CELL: u16 = 46;
/// Address on RS-485.
pub const NODE_CELL: u16 = 64;
/// Gyro stabilisation.
pub const STABILISATION_CELL: u16 = 122;
/// Command streamed after power-up.
pub const POWER_UP_CELL: u16 = 132;
/// Serial number of the predecessor; a GX1 answers 0xF1.
pub const SERIAL_CELL: u16 = 134;
/// Model number.
pub const MODEL_CELL: u16 = 234;

/// The last address that the one-byte commands reach.
pub const LAST_ADDRESS: u16 = 254;

const fn cell(
    address: u16,
    name: &'static str,
    meaning: &'static str,
    default: Option<u16>,
) -> Cell {
    Cell {
        address,
        name,
        meaning,
        default,
    }
}

/// The cell at an address, if its meaning is known.
pub fn at(address: u16) -> Option<&'static Cell> {
    CELLS.iter().find(|cell| cell.address == address)
}

/// The cell of this name.
pub fn named(name: &str) -> Option<&'static Cell> {
    CELLS.iter().find(|cell| cell.name == name)
}

/// What stands between the cell at `address` and who wants to write `value` into it.
pub fn guard(address: u16, value: u16) -> Guard {
    if !address.is_multiple_of(2) {
        return Guard::Refused("cells are words at even addresses: an odd one would hit two");
    }
    if CALIBRATION
        .iter()
        .any(|(first, last)| (*first..=*last).contains(&address))
    {
        return Guard::Refused("it holds the factory's calibration, which cannot be made again");
    }
    match address {
        SERIAL_CELL | MODEL_CELL => Guard::Refused("it says which unit this is"),
        BAUD_CELL if !matches!(value, 129 | 64 | 21) => {
            Guard::Refused("the speeds are 129 (19200), 64 (38400) and 21 (115200 Bd)")
        }
        BAUD_CELL => Guard::Forced("the unit will answer at another speed"),
        INTERFACE_CELL if value > 1 => Guard::Refused("it is 1 (RS-232) or 0 (RS-485)"),
        INTERFACE_CELL if value == 0 => {
            Guard::Forced("0 cuts the RS-232 link: the unit then answers on RS-485 only")
        }
        INTERFACE_CELL => Guard::Forced("a wrong value cuts the link"),
        NODE_CELL => Guard::Forced("the unit will answer at another address on RS-485"),
        gain if GAIN_CELLS.contains(&gain) => Guard::Forced("every vector is scaled by it"),
        factor if TICK_CELLS.contains(&factor) && value == 0 => {
            Guard::Refused("a factor of 0 stops the unit's clock")
        }
        _ if at(address).is_some() => Guard::Free,
        _ => Guard::Forced("what it means is not known"),
    }
}

/// The value of the baud cell for a speed.
pub fn baud_code(baud: u32) -> Option<u16> {
    match baud {
        19_200 => Some(129),
        38_400 => Some(64),
        115_200 => Some(21),
        _ => None,
    }
}

/// The speed that a value of the baud cell stands for.
pub fn baud_of(code: u16) -> Option<u32> {
    super::BAUD_RATES
        .into_iter()
        .find(|baud| baud_code(*baud) == Some(code))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gx1::{Gains, TickFactors};

    #[test]
    fn the_calibration_is_refused_cell_by_cell() {
        for address in (0..=LAST_ADDRESS).step_by(2) {
            let calibration = (2..=24).contains(&address)
                || (32..=42).contains(&address)
                || (48..=60).contains(&address)
                || (66..=118).contains(&address);
            if calibration {
                for value in [0, 1, 64, u16::MAX] {
                    assert!(
                        matches!(guard(address, value), Guard::Refused(_)),
                        "{address}"
                    );
                }
                assert_eq!(at(address), None);
            } else {
                // A neighbour of the calibration is none.
                let refused = matches!(guard(address, 1), Guard::Refused(_));
                assert_eq!(refused, [44, 134, 234].contains(&address), "{address}");
            }
            assert!(matches!(guard(address + 1, 1), Guard::Refused(_)));
        }
    }

    #[test]
    fn what_cuts_the_link_needs_force() {
        for (address, value) in [(44, 129), (44, 21), (46, 0), (46, 1), (64, 3)] {
            assert!(
                matches!(guard(address, value), Guard::Forced(_)),
                "{address}"
            );
        }
        assert_eq!(guard(246, 10), Guard::Free);
        assert!(matches!(guard(246, 0), Guard::Refused(_)));
        assert!(matches!(guard(300, 0), Guard::Forced(_)));
    }

    #[test]
    fn defaults_are_the_factorys() {
        let defaults = |cells: &[u16]| -> Vec<Option<u16>> {
            cells
                .iter()
                .map(|cell| at(*cell).unwrap().default)
                .collect()
        };
        let Gains { accel, rate, mag } = Gains::FACTORY;
        assert_eq!(defaults(&GAIN_CELLS), [accel, rate, mag].map(Some));
        assert_eq!(defaults(&TICK_CELLS), TickFactors::FACTORY.0.map(Some));
    }

    #[test]
    fn speeds_have_codes() {
        for (baud, code) in [(19_200, 129), (38_400, 64), (115_200, 21)] {
            assert_eq!(baud_code(baud), Some(code));
            assert_eq!(baud_of(code), Some(baud));
        }
        assert_eq!(baud_code(9600), None);
        assert_eq!(baud_of(0), None);
    }

    #[test]
    fn cells_are_named_once() {
        for (i, cell) in CELLS.iter().enumerate() {
            assert_eq!(named(cell.name), Some(cell));
            assert_eq!(at(cell.address), Some(cell));
            assert!(
                CELLS
                    .iter()
                    .skip(i + 1)
                    .all(|other| other.address > cell.address)
            );
        }
    }
}
