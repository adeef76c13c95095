//! The commands, and what their replies hold.

use std::fmt;

/// The meaning of one 16 bit word of a reply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Word {
    /// Raw sensor bits: 0 to 65535 are 0 to 5 V.
    RawMag(u8),
    /// Raw sensor bits.
    RawAccel(u8),
    /// Raw sensor bits.
    RawRate(u8),
    /// Magnetic field along an axis (0 x, 1 y, 2 z), scaled by MagGainScale.
    Mag(u8),
    /// Acceleration along an axis, scaled by AccelGainScale.
    Accel(u8),
    /// Angular rate about an axis, scaled by GyroGainScale.
    Rate(u8),
    /// Quaternion component 0 (the scalar) to 3, times 8192.
    Quaternion(u8),
    /// Element of the orientation matrix, row and column from 1, times 8192.
    Matrix(u8, u8),
    /// Angle, 360/65536 deg.
    Roll,
    /// Angle, 360/65536 deg.
    Pitch,
    /// Angle, 360/65536 deg.
    Yaw,
    /// Temperature: 0 to 65535 are 0 to 5 V, 0.5 V at 0 degC and 10 mV a degree.
    Temperature,
    /// Smallest field seen during the hard-iron calibration, scaled by MagGainScale.
    MagMin(u8),
    /// Largest field seen.
    MagMax(u8),
    /// Hard-iron offset found, scaled by MagGainScale.
    MagOffset(u8),
    /// A number: an EEPROM cell, the firmware, the serial number, an acknowledged command.
    Value(u8),
    /// The tick counter at the start of the calculation cycle, unsigned, wraps at 65536.
    Ticks,
}

impl Word {
    /// Short name with the axis, as in a column.
    pub fn name(self) -> String {
        const AXES: [&str; 3] = ["x", "y", "z"];
        let axis = |i: u8| AXES.get(usize::from(i)).copied().unwrap_or("?");
        match self {
            Word::RawMag(i) => format!("raw_mag_{}", axis(i)),
            Word::RawAccel(i) => format!("raw_accel_{}", axis(i)),
            Word::RawRate(i) => format!("raw_rate_{}", axis(i)),
            Word::Mag(i) => format!("mag_{}", axis(i)),
            Word::Accel(i) => format!("accel_{}", axis(i)),
            Word::Rate(i) => format!("rate_{}", axis(i)),
            Word::Quaternion(i) => format!("q{i}"),
            Word::Matrix(row, column) => format!("m{row}{column}"),
            Word::Roll => "roll".into(),
            Word::Pitch => "pitch".into(),
            Word::Yaw => "yaw".into(),
            Word::Temperature => "temperature".into(),
            Word::MagMin(i) => format!("mag_min_{}", axis(i)),
            Word::MagMax(i) => format!("mag_max_{}", axis(i)),
            Word::MagOffset(i) => format!("mag_offset_{}", axis(i)),
            Word::Value(i) => format!("value_{i}"),
            Word::Ticks => "ticks".into(),
        }
    }
}

/// One byte after the command byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Argument {
    /// A guard byte that never changes; the unit takes no notice of a command without it.
    Fixed(u8),
    /// A byte of the caller's.
    Free,
}

macro_rules! commands {
    ($($name:ident = $byte:literal, $text:literal, $title:literal, [$($argument:expr),*], $reply:expr, $doc:literal;)*) => {
        /// What the unit can be asked.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        #[repr(u8)]
        pub enum Command {
            $(#[doc = $doc] $name = $byte,)*
        }

        impl Command {
            /// Every command, by its byte.
            pub const ALL: &'static [Command] = &[$(Command::$name),*];

            /// The command of this byte.
            pub const fn from_byte(byte: u8) -> Option<Command> {
                match byte {
                    $($byte => Some(Command::$name),)*
                    _ => None,
                }
            }

            /// One word for the command line.
            pub const fn name(self) -> &'static str {
                match self {
                    $(Command::$name => $text,)*
                }
            }

            /// What it is, in words.
            pub const fn title(self) -> &'static str {
                match self {
                    $(Command::$name => $title,)*
                }
            }

            /// The bytes after the command byte.
            pub const fn arguments(self) -> &'static [Argument] {
                use Argument::{Fixed, Free};
                // Commands without arguments use neither.
                const _: (Argument, Argument) = (Fixed(0), Free);
                match self {
                    $(Command::$name => &[$($argument),*],)*
                }
            }

            /// What the reply is made of.
            const fn reply(self) -> Reply {
                match self {
                    $(Command::$name => $reply,)*
                }
            }
        }
    };
}

/// The shape of a reply.
#[derive(Clone, Copy)]
enum Reply {
    /// There is none.
    None,
    /// Two bytes without header or sum.
    Bare,
    /// Header, these words, sum.
    Words(&'static [Word]),
}

use Word::{
    Accel, Mag, MagMax, MagMin, MagOffset, Matrix, Pitch, Quaternion, Rate, RawAccel, RawMag,
    RawRate, Roll, Temperature, Ticks, Value, Yaw,
};

/// A reply of words, in the order sent; `Mag xyz` are the three of a vector.
macro_rules! reply {
    (@ [$($done:expr,)*]) => {
        Reply::Words(&[$($done),*])
    };
    (@ [$($done:expr,)*] $vector:ident xyz $(, $($rest:tt)*)?) => {
        reply!(@ [$($done,)* $vector(0), $vector(1), $vector(2),] $($($rest)*)?)
    };
    (@ [$($done:expr,)*] $word:expr $(, $($rest:tt)*)?) => {
        reply!(@ [$($done,)* $word,] $($($rest)*)?)
    };
    ($($words:tt)+) => {
        reply!(@ [] $($words)+)
    };
}

const RAW: Reply = reply![RawMag xyz, RawAccel xyz, RawRate xyz, Ticks];
const VECTORS: Reply = reply![Mag xyz, Accel xyz, Rate xyz, Ticks];
const QUATERNION: Reply = reply![
    Quaternion(0),
    Quaternion(1),
    Quaternion(2),
    Quaternion(3),
    Ticks
];
const QUATERNION_VECTORS: Reply = reply![
    Quaternion(0), Quaternion(1), Quaternion(2), Quaternion(3),
    Mag xyz, Accel xyz, Rate xyz, Ticks
];
/// Column by column.
const MATRIX: Reply = reply![
    Matrix(1, 1),
    Matrix(2, 1),
    Matrix(3, 1),
    Matrix(1, 2),
    Matrix(2, 2),
    Matrix(3, 2),
    Matrix(1, 3),
    Matrix(2, 3),
    Matrix(3, 3),
    Ticks
];
const EULER: Reply = reply![Roll, Pitch, Yaw, Ticks];
const EULER_ACCEL_RATE: Reply = reply![Roll, Pitch, Yaw, Accel xyz, Rate xyz, Ticks];
const TICKS: Reply = reply![Ticks];
const VALUE: Reply = reply![Value(0), Ticks];
const NUMBER: Reply = reply![Value(0)];

commands! {
    Null = 0x00, "null", "null command", [], Reply::None,
        "Does nothing and is not answered.";
    RawSensorBits = 0x01, "raw", "raw sensor bits", [], RAW,
        "The sensors' bits as converted.";
    StabilisedVectors = 0x02, "vectors", "gyro-stabilised vectors", [], VECTORS,
        "Gyro-stabilised magnetic field and acceleration, compensated rate.";
    InstantVectors = 0x03, "instant-vectors", "instantaneous vectors", [], VECTORS,
        "Instantaneous magnetic field, acceleration and rate.";
    InstantQuaternion = 0x04, "instant-quaternion", "instantaneous quaternion", [], QUATERNION,
        "Attitude from the instantaneous vectors.";
    StabilisedQuaternion = 0x05, "quaternion", "gyro-stabilised quaternion", [], QUATERNION,
        "Gyro-stabilised attitude.";
    CaptureGyroBias = 0x06, "bias", "capture gyro bias", [], TICKS,
        "Takes the mean rate of the next samples for the gyros' bias: keep the unit still. It is not the tare.";
    Temperature = 0x07, "temperature", "temperature", [], reply![Temperature, Ticks],
        "The temperature inside.";
    ReadEeprom = 0x08, "read-eeprom", "read EEPROM", [Free], Reply::Bare,
        "Reads a cell; the answer has neither header nor sum.";
    WriteEeprom = 0x09, "write-eeprom", "write EEPROM",
        [Fixed(0x71), Free, Free, Free, Fixed(0xAA)], Reply::Bare,
        "Writes a cell (address, value MSB, LSB); the answer has neither header nor sum.";
    InstantMatrix = 0x0A, "instant-matrix", "instantaneous orientation matrix", [], MATRIX,
        "Attitude as a matrix, column by column.";
    StabilisedMatrix = 0x0B, "matrix", "gyro-stabilised orientation matrix", [], MATRIX,
        "Gyro-stabilised attitude as a matrix, column by column.";
    StabilisedQuaternionVectors = 0x0C, "quaternion-vectors",
        "gyro-stabilised quaternion and vectors", [], QUATERNION_VECTORS,
        "Gyro-stabilised attitude with the stabilised vectors.";
    InstantEuler = 0x0D, "instant-euler", "instantaneous Euler angles", [], EULER,
        "Roll, pitch and yaw from the instantaneous vectors.";
    StabilisedEuler = 0x0E, "euler", "gyro-stabilised Euler angles", [], EULER,
        "Gyro-stabilised roll, pitch and yaw.";
    Tare = 0x0F, "tare", "tare coordinate system",
        [Fixed(0xC1), Fixed(0xC3), Fixed(0xC5)], TICKS,
        "Makes the present attitude the zero of the stabilised ones; takes seconds.";
    SetContinuous = 0x10, "continuous", "set continuous mode", [Fixed(0x00), Free], VALUE,
        "Sends the reply of a command at the end of every cycle; command 0 ends it.";
    RemoveTare = 0x11, "remove-tare", "remove tare",
        [Fixed(0xC1), Fixed(0xC3), Fixed(0xC5)], TICKS,
        "Forgets the tare.";
    StabilisedQuaternionInstantVectors = 0x12, "quaternion-instant-vectors",
        "gyro-stabilised quaternion and instantaneous vectors", [], QUATERNION_VECTORS,
        "Gyro-stabilised attitude with the instantaneous vectors.";
    WriteGains = 0x24, "write-gains", "write system gains", [], TICKS,
        "Unconfirmed: its arguments are not known, its reply has five bytes.";
    ReadGains = 0x25, "read-gains", "read system gains", [],
        reply![Value(0), Value(1), Value(2), Ticks],
        "Unconfirmed: three words whose meaning is not known.";
    SelfTest = 0x27, "self-test", "self test", [], NUMBER,
        "Unconfirmed: its reply has five bytes.";
    ReadEepromChecked = 0x28, "read-eeprom-checked", "read EEPROM with checksum",
        [Free, Free], VALUE,
        "Reads a cell (address MSB, LSB) with header, ticks and sum.";
    WriteEepromChecked = 0x29, "write-eeprom-checked", "write EEPROM with checksum",
        [Fixed(0x71), Free, Free, Free, Free, Fixed(0xAA)], VALUE,
        "Writes a cell (address MSB, LSB, value MSB, LSB) with header, ticks and sum.";
    StabilisedEulerAccelRate = 0x31, "euler-accel-rate",
        "gyro-stabilised Euler angles, acceleration and rate", [], EULER_ACCEL_RATE,
        "Gyro-stabilised roll, pitch and yaw, acceleration, compensated rate.";
    StartHardIron = 0x40, "start-hard-iron", "start hard-iron calibration",
        [Fixed(0x71), Fixed(0x3E)], TICKS,
        "Begins a hard-iron calibration.";
    CollectHardIron = 0x41, "collect-hard-iron", "collect hard-iron data", [],
        reply![Mag xyz, MagMin xyz, MagMax xyz, Ticks],
        "One reading of the field while the unit is turned.";
    ComputeHardIron = 0x42, "compute-hard-iron", "compute hard-iron offsets",
        [Fixed(0x71), Fixed(0x3E), Free, Free, Free],
        reply![MagOffset xyz, Ticks],
        "Ends a hard-iron calibration (type 0 = 3D or 1 = 2D, magnitude of z MSB, LSB).";
    Firmware = 0xF0, "firmware", "firmware version", [], NUMBER,
        "The firmware's number, see [`firmware_version`].";
    SerialNumber = 0xF1, "serial-number", "serial number", [], NUMBER,
        "The serial number.";
}

/// The longest reply of any command, bytes.
pub const LONGEST_REPLY: usize = 31;

impl Command {
    /// The command byte.
    pub const fn byte(self) -> u8 {
        self as u8
    }

    /// The words of the reply in the order sent, without header and sum. Empty for
    /// [`Command::Null`] and for the two whose reply is bare.
    pub const fn words(self) -> &'static [Word] {
        match self.reply() {
            Reply::None | Reply::Bare => &[],
            Reply::Words(words) => words,
        }
    }

    /// Whether the reply is two bytes without header and sum.
    pub const fn is_bare(self) -> bool {
        matches!(self.reply(), Reply::Bare)
    }

    /// Bytes of the reply, from header to sum; 0 where there is none.
    pub const fn reply_length(self) -> usize {
        match self.reply() {
            Reply::None => 0,
            Reply::Bare => 2,
            Reply::Words(words) => 1 + 2 * words.len() + 2,
        }
    }

    /// Bytes of the request with its arguments.
    pub const fn request_length(self) -> usize {
        1 + self.arguments().len()
    }

    /// The request: the command byte, its guard bytes, and `free` in the places in between. None
    /// unless `free` holds exactly as many bytes as the command takes.
    pub fn request(self, free: &[u8]) -> Option<Vec<u8>> {
        let mut free = free.iter();
        let mut bytes = vec![self.byte()];
        for argument in self.arguments() {
            bytes.push(match argument {
                Argument::Fixed(byte) => *byte,
                Argument::Free => *free.next()?,
            });
        }
        free.next().is_none().then_some(bytes)
    }

    /// The caller's bytes of a whole request (command byte included); none where its length or one
    /// of its guard bytes is wrong. The device's side of [`Command::request`].
    pub fn free_arguments(self, request: &[u8]) -> Option<Vec<u8>> {
        let (byte, rest) = request.split_first()?;
        if *byte != self.byte() || rest.len() != self.arguments().len() {
            return None;
        }
        let mut free = Vec::new();
        for (argument, byte) in self.arguments().iter().zip(rest) {
            match argument {
                Argument::Fixed(wanted) if wanted != byte => return None,
                Argument::Fixed(_) => {}
                Argument::Free => free.push(*byte),
            }
        }
        Some(free)
    }

    /// The first byte of the request on RS-485: the command above the unit's address. Only commands
    /// up to 0x0F and addresses up to 15 have room in it.
    pub const fn bus_byte(self, address: u8) -> Option<u8> {
        if self.byte() < 0x10 && address < 0x10 {
            Some(self.byte() << 4 | address)
        } else {
            None
        }
    }

    /// Whether its reply is a measurement, which the continuous mode can send.
    pub fn is_measurement(self) -> bool {
        self.words().iter().any(|word| {
            matches!(
                word,
                Roll | Quaternion(_) | Matrix(..) | Accel(_) | RawAccel(_) | Temperature
            )
        })
    }
}

impl fmt::Display for Command {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "0x{:02X} ({})", self.byte(), self.title())
    }
}

/// The firmware's version from the number that it answers: 3201 is 3.2.01.
pub fn firmware_version(number: u16) -> String {
    format!(
        "{}.{}.{:02}",
        number / 1000,
        number % 1000 / 100,
        number % 100
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The table of lengths as printed: command byte, bytes of the reply.
    const PRINTED: [(u8, usize); 30] = [
        (0x00, 0),
        (0x01, 23),
        (0x02, 23),
        (0x03, 23),
        (0x04, 13),
        (0x05, 13),
        (0x06, 5),
        (0x07, 7),
        (0x08, 2),
        (0x09, 2),
        (0x0A, 23),
        (0x0B, 23),
        (0x0C, 31),
        (0x0D, 11),
        (0x0E, 11),
        (0x0F, 5),
        (0x10, 7),
        (0x11, 5),
        (0x12, 31),
        (0x24, 5),
        (0x25, 11),
        (0x27, 5),
        (0x28, 7),
        (0x29, 7),
        (0x31, 23),
        (0x40, 5),
        (0x41, 23),
        (0x42, 11),
        (0xF0, 5),
        (0xF1, 5),
    ];

    #[test]
    fn replies_are_as_long_as_printed() {
        assert_eq!(Command::ALL.len(), PRINTED.len());
        for (byte, length) in PRINTED {
            let command = Command::from_byte(byte).unwrap();
            assert_eq!(command.byte(), byte);
            assert_eq!(command.reply_length(), length, "{command}");
            assert!(length <= LONGEST_REPLY);
        }
        assert_eq!(Command::from_byte(0xE5), None);
    }

    #[test]
    fn words_come_in_the_printed_order() {
        let names = |command: Command| -> String {
            let names: Vec<String> = command.words().iter().map(|word| word.name()).collect();
            names.join(" ")
        };
        let vectors = "mag_x mag_y mag_z accel_x accel_y accel_z rate_x rate_y rate_z ticks";
        assert_eq!(names(Command::InstantVectors), vectors);
        assert_eq!(
            names(Command::StabilisedQuaternionVectors),
            format!("q0 q1 q2 q3 {vectors}")
        );
        assert_eq!(
            names(Command::StabilisedEulerAccelRate),
            "roll pitch yaw accel_x accel_y accel_z rate_x rate_y rate_z ticks"
        );
        assert_eq!(
            names(Command::StabilisedMatrix),
            "m11 m21 m31 m12 m22 m32 m13 m23 m33 ticks"
        );
        assert_eq!(
            names(Command::CollectHardIron),
            "mag_x mag_y mag_z mag_min_x mag_min_y mag_min_z mag_max_x mag_max_y mag_max_z ticks"
        );
    }

    #[test]
    fn requests_are_as_printed() {
        let request = |command: Command, free: &[u8]| command.request(free).unwrap();
        assert_eq!(request(Command::StabilisedEulerAccelRate, &[]), [0x31]);
        assert_eq!(request(Command::SetContinuous, &[0x31]), [0x10, 0, 0x31]);
        assert_eq!(
            request(Command::ReadEepromChecked, &[0, 230]),
            [0x28, 0, 230]
        );
        assert_eq!(
            request(Command::WriteEepromChecked, &[0, 246, 0, 2]),
            [0x29, 0x71, 0, 246, 0, 2, 0xAA]
        );
        assert_eq!(
            request(Command::WriteEeprom, &[246, 0, 2]),
            [0x09, 0x71, 246, 0, 2, 0xAA]
        );
        assert_eq!(request(Command::Tare, &[]), [0x0F, 0xC1, 0xC3, 0xC5]);
        assert_eq!(request(Command::StartHardIron, &[]), [0x40, 0x71, 0x3E]);
        assert_eq!(
            request(Command::ComputeHardIron, &[0, 1, 2]),
            [0x42, 0x71, 0x3E, 0, 1, 2]
        );
        assert_eq!(Command::SetContinuous.request(&[]), None);
        assert_eq!(Command::Tare.request(&[1]), None);
    }

    #[test]
    fn the_device_reads_what_was_asked() {
        for command in Command::ALL {
            let count = command
                .arguments()
                .iter()
                .filter(|a| **a == Argument::Free)
                .count();
            let free: Vec<u8> = (1..).take(count).collect();
            let request = command.request(&free).unwrap();
            assert_eq!(request.len(), command.request_length());
            assert_eq!(command.free_arguments(&request), Some(free));
        }
        assert_eq!(
            Command::Tare.free_arguments(&[0x0F, 0xC1, 0xC3, 0xC4]),
            None
        );
        assert_eq!(Command::Tare.free_arguments(&[0x0F]), None);
    }

    #[test]
    fn few_commands_fit_on_a_bus() {
        assert_eq!(Command::StabilisedEuler.bus_byte(3), Some(0xE3));
        assert_eq!(Command::StabilisedEuler.bus_byte(16), None);
        assert_eq!(Command::StabilisedEulerAccelRate.bus_byte(1), None);
        assert_eq!(Command::SetContinuous.bus_byte(1), None);
    }

    #[test]
    fn versions_have_three_parts() {
        assert_eq!(firmware_version(3201), "3.2.01");
        assert_eq!(firmware_version(1300), "1.3.00");
    }
}
