//! One reply with header and checksum.

use super::command::{Command, Word};

/// Why bytes are no reply.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PacketError {
    /// No command has this byte, or its reply has no header.
    #[error("no reply begins with 0x{0:02X}")]
    Header(u8),
    /// The reply is longer or shorter.
    #[error("{got} bytes, the reply has {wanted}")]
    Length {
        /// What the command's reply has.
        wanted: usize,
        /// What there is.
        got: usize,
    },
    /// The sum is another.
    #[error("the sum is 0x{wanted:04X}, the packet says 0x{got:04X}")]
    Checksum {
        /// Sum of header and words.
        wanted: u16,
        /// The packet's last word.
        got: u16,
    },
}

/// A reply, word by word.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Packet {
    command: Command,
    words: [u16; MOST_WORDS],
}

/// The most words that a reply holds before its sum.
const MOST_WORDS: usize = 14;

/// The sum that ends a packet: the header as a word (never sign-extended) and all words, modulo
/// 65536.
pub fn checksum(header: u8, words: &[u16]) -> u16 {
    words
        .iter()
        .fold(u16::from(header), |sum, word| sum.wrapping_add(*word))
}

/// The bytes of a reply: header, `words`, sum. None unless there are as many words as the
/// command's reply has. The two commands with bare replies take one word and give its two bytes.
pub fn encode(command: Command, words: &[u16]) -> Option<Vec<u8>> {
    if command.is_bare() {
        return match words {
            [value] => Some(value.to_be_bytes().to_vec()),
            _ => None,
        };
    }
    if words.len() != command.words().len() {
        return None;
    }
    let mut bytes = Vec::with_capacity(command.reply_length());
    if command.reply_length() > 0 {
        bytes.push(command.byte());
        for word in words {
            bytes.extend(word.to_be_bytes());
        }
        bytes.extend(checksum(command.byte(), words).to_be_bytes());
    }
    Some(bytes)
}

impl Packet {
    /// Reads a whole reply, header to sum.
    ///
    /// # Errors
    /// What [`PacketError`] lists.
    pub fn decode(bytes: &[u8]) -> Result<Packet, PacketError> {
        let (header, rest) = bytes
            .split_first()
            .ok_or(PacketError::Length { wanted: 1, got: 0 })?;
        let command = Command::from_byte(*header)
            .filter(|command| !command.words().is_empty())
            .ok_or(PacketError::Header(*header))?;
        if bytes.len() != command.reply_length() {
            return Err(PacketError::Length {
                wanted: command.reply_length(),
                got: bytes.len(),
            });
        }
        let mut words = [0; MOST_WORDS];
        let (pairs, _) = rest.as_chunks::<2>();
        let count = command.words().len();
        for (word, pair) in words.iter_mut().zip(pairs.iter().take(count)) {
            *word = u16::from_be_bytes(*pair);
        }
        let wanted = checksum(*header, &words);
        let got = pairs.last().map_or(0, |pair| u16::from_be_bytes(*pair));
        if got != wanted {
            return Err(PacketError::Checksum { wanted, got });
        }
        Ok(Packet { command, words })
    }

    /// A packet of these words; none unless there are as many as the command's reply has.
    pub fn new(command: Command, words: &[u16]) -> Option<Packet> {
        if words.is_empty() || words.len() != command.words().len() {
            return None;
        }
        let mut all = [0; MOST_WORDS];
        for (to, from) in all.iter_mut().zip(words) {
            *to = *from;
        }
        Some(Packet {
            command,
            words: all,
        })
    }

    /// Whose reply it is.
    pub fn command(&self) -> Command {
        self.command
    }

    /// The words in the order sent, without the sum.
    pub fn words(&self) -> &[u16] {
        self.words
            .get(..self.command.words().len())
            .unwrap_or_default()
    }

    /// The words with their meanings.
    pub fn fields(&self) -> impl Iterator<Item = (Word, u16)> + '_ {
        let words = self.words().iter().copied();
        self.command.words().iter().copied().zip(words)
    }

    /// One word.
    pub fn word(&self, wanted: Word) -> Option<u16> {
        self.fields()
            .find(|(word, _)| *word == wanted)
            .map(|(_, value)| value)
    }

    /// The tick counter at the start of the cycle, where the reply has it.
    pub fn ticks(&self) -> Option<u16> {
        self.word(Word::Ticks)
    }

    /// The bytes, header to sum.
    pub fn bytes(&self) -> Vec<u8> {
        encode(self.command, self.words()).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn known_bytes() {
        // 0x0E: 1000, -2000, 30000, ticks 5.
        let bytes = [
            0x0E, 0x03, 0xE8, 0xF8, 0x30, 0x75, 0x30, 0x00, 0x05, 0x71, 0x5B,
        ];
        let packet = Packet::decode(&bytes).unwrap();
        assert_eq!(packet.command(), Command::StabilisedEuler);
        assert_eq!(packet.words(), [1000, 63_536, 30_000, 5]);
        assert_eq!(packet.word(Word::Pitch), Some(63_536));
        assert_eq!(packet.ticks(), Some(5));
        assert_eq!(packet.bytes(), bytes);
    }

    #[test]
    fn a_high_header_is_not_sign_extended() {
        // A driver that starts its sum from a signed byte refuses these two.
        for (header, number) in [(0xF0u8, 3201u16), (0xF1, 4021)] {
            let sum = u16::from(header) + number;
            let mut bytes = vec![header];
            bytes.extend(number.to_be_bytes());
            bytes.extend(sum.to_be_bytes());
            let packet = Packet::decode(&bytes).unwrap();
            assert_eq!(packet.word(Word::Value(0)), Some(number));
            assert_eq!(packet.ticks(), None);
        }
    }

    #[test]
    fn ticks_are_not_read_from_the_sum() {
        let bytes = encode(Command::SetContinuous, &[0x0031, 0x1234]).unwrap();
        assert_eq!(bytes, [0x10, 0x00, 0x31, 0x12, 0x34, 0x12, 0x75]);
        let packet = Packet::decode(&bytes).unwrap();
        assert_eq!(packet.ticks(), Some(0x1234));
        assert_eq!(packet.word(Word::Value(0)), Some(0x31));
    }

    #[test]
    fn every_byte_of_a_packet_is_used_once() {
        // One driver used the low byte of gyro z twice. Here each word has bytes of its own.
        for command in Command::ALL {
            let words: Vec<u16> = (0..command.words().len())
                .map(|i| u16::from_be_bytes([2 * i as u8 + 1, 2 * i as u8 + 2]))
                .collect();
            let bytes = encode(*command, &words);
            if command.is_bare() || words.is_empty() {
                continue;
            }
            let packet = Packet::decode(&bytes.unwrap()).unwrap();
            assert_eq!(packet.words(), words);
            assert_eq!(Packet::new(*command, &words), Some(packet));
            for ((word, value), wanted) in packet.fields().zip(&words) {
                assert_eq!(value, *wanted, "{word:?}");
            }
        }
    }

    #[test]
    fn bare_replies_have_neither_header_nor_sum() {
        assert_eq!(
            encode(Command::ReadEeprom, &[0x2134]),
            Some(vec![0x21, 0x34])
        );
        assert_eq!(encode(Command::ReadEeprom, &[]), None);
        assert_eq!(encode(Command::Null, &[]), Some(vec![]));
        assert_eq!(
            Packet::decode(&[0x08, 0, 0, 0, 8]),
            Err(PacketError::Header(8))
        );
    }

    proptest! {
        #[test]
        fn any_bytes_are_a_packet_or_an_error(bytes in prop::collection::vec(any::<u8>(), 0..40)) {
            if let Ok(packet) = Packet::decode(&bytes) {
                prop_assert_eq!(packet.bytes(), bytes);
            }
        }

        #[test]
        fn packets_survive(which in 0usize..30, words in prop::collection::vec(any::<u16>(), 14)) {
            let command = Command::ALL[which];
            prop_assume!(!command.words().is_empty());
            let words = &words[..command.words().len()];
            let mut bytes = encode(command, words).unwrap();
            let packet = Packet::decode(&bytes).unwrap();
            prop_assert_eq!(packet.words(), words);
            // One changed byte is always seen.
            bytes[2] ^= 0x10;
            let changed = matches!(Packet::decode(&bytes), Err(PacketError::Checksum { .. }));
            prop_assert!(changed);
        }
    }
}
