//! CDR, the wire form of ROS 2 messages: a 4-byte header that says little-endian, then fields
//! aligned to their size counted from behind that header.
//!
//! The encoding is `cdr-encoding`'s. Only sequences of float32 are moved by hand, because a scan
//! holds 1500 of them and a call through serde for each takes longer than everything else.

use super::check::{BadField, ListLengths};
use crate::record::{Presence, Record, Value, Visit, VisitMut};
use byteorder::LittleEndian;
use cdr_encoding::{CdrDeserializer, CdrSerializer};
use serde::{Deserialize, Serialize};

/// Says "plain CDR, little-endian" before every message.
const HEADER: [u8; 4] = [0, 1, 0, 0];

/// Whether a column is part of a message.
pub(super) type Keep = fn(&str) -> bool;

/// Appends a message to `out`.
pub(super) fn encode(out: &mut Vec<u8>, message: &impl Serialize) -> Result<(), BadField> {
    out.extend_from_slice(&HEADER);
    cdr_encoding::to_writer::<_, LittleEndian, _>(&mut *out, message)
        .map_err(|error| BadField::row(error.to_string()))
}

/// Appends a sequence of float32 to a message that starts at `start` of `out`.
pub(super) fn push_f32s(
    out: &mut Vec<u8>,
    start: usize,
    values: impl ExactSizeIterator<Item = f32>,
) {
    let used = out.len() - start - HEADER.len();
    out.resize(out.len() + used.next_multiple_of(4) - used, 0);
    out.extend_from_slice(&(values.len() as u32).to_le_bytes());
    let from = out.len();
    out.resize(from + 4 * values.len(), 0);
    for (bytes, value) in out[from..].chunks_exact_mut(4).zip(values) {
        bytes.copy_from_slice(&value.to_le_bytes());
    }
}

/// Appends the columns of a record that `keep` chooses, as a message.
pub(super) fn encode_columns<R: Record>(
    out: &mut Vec<u8>,
    record: &R,
    keep: Keep,
) -> Result<(), BadField> {
    struct Encode<'a> {
        output: CdrSerializer<&'a mut Vec<u8>, LittleEndian>,
        keep: Keep,
    }
    impl Visit for Encode<'_> {
        type Error = BadField;
        fn column<T: Value>(
            &mut self,
            name: &'static str,
            _: Presence,
            value: &T,
        ) -> Result<(), BadField> {
            if !(self.keep)(name) {
                return Ok(());
            }
            let result = value.to_wire().serialize(&mut self.output);
            result.map_err(|error| BadField::new(name, error.to_string()))
        }
    }
    out.extend_from_slice(&HEADER);
    record.visit(&mut Encode {
        output: CdrSerializer::new(out),
        keep,
    })
}

/// A message's bytes behind the header.
fn body(bytes: &[u8]) -> Result<&[u8], BadField> {
    match bytes.split_at_checked(HEADER.len()) {
        // The last two bytes are options, which plain CDR passes over.
        Some(([0, 1, _, _], body)) => Ok(body),
        Some(_) => Err(BadField::row("not plain little-endian CDR")),
        None => Err(BadField::row("shorter than a CDR header")),
    }
}

/// Reads a message, or its beginning; the rest is a [`Tail`].
pub(super) fn decode<'a, T: Deserialize<'a>>(bytes: &'a [u8]) -> Result<(T, Tail<'a>), BadField> {
    let body = body(bytes)?;
    let mut input = CdrDeserializer::<LittleEndian>::new(body);
    let message = T::deserialize(&mut input).map_err(|error| BadField::row(error.to_string()))?;
    let used = input.bytes_consumed();
    Ok((message, Tail { body, used }))
}

/// What follows the part of a message that has been read.
pub(super) struct Tail<'a> {
    body: &'a [u8],
    used: usize,
}

impl<'a> Tail<'a> {
    /// Reads a sequence of float32.
    pub(super) fn f32s(
        &mut self,
    ) -> Result<impl ExactSizeIterator<Item = f32> + Clone + use<'a>, BadField> {
        let short = || BadField::row("unexpected end of input");
        let rest = self.body.get(self.used.next_multiple_of(4)..);
        let (count, rest) = rest.and_then(<[u8]>::split_first_chunk).ok_or_else(short)?;
        let bytes = usize::try_from(u32::from_le_bytes(*count))
            .ok()
            .and_then(|count| rest.get(..count.checked_mul(4)?))
            .ok_or_else(short)?;
        self.used = self.used.next_multiple_of(4) + 4 + bytes.len();
        let value = |b: &[u8]| f32::from_le_bytes([b[0], b[1], b[2], b[3]]);
        Ok(bytes.chunks_exact(4).map(value))
    }
}

/// Fills the columns of a record that `keep` chooses from a message. List columns that start with
/// `parallel` must be equally long. A message of an older version may end before its last
/// [`Presence::Extra`] columns.
pub(super) fn decode_columns<R: Record>(
    bytes: &[u8],
    record: &mut R,
    keep: Keep,
    parallel: Option<&'static str>,
) -> Result<(), BadField> {
    struct Decode<'a> {
        input: CdrDeserializer<'a, LittleEndian>,
        /// Bytes that there are.
        length: usize,
        keep: Keep,
        lists: ListLengths,
    }
    impl VisitMut for Decode<'_> {
        type Error = BadField;
        fn column<T: Value>(
            &mut self,
            name: &'static str,
            presence: Presence,
            value: &mut T,
        ) -> Result<(), BadField> {
            if !(self.keep)(name) {
                return Ok(());
            }
            if presence == Presence::Extra && self.input.bytes_consumed() >= self.length {
                // The value that an empty field stands for: the default of a number is 0.
                return value
                    .parse_text(b"")
                    .map_err(|error| BadField::new(name, error.to_string()));
            }
            let wire = T::Wire::deserialize(&mut self.input)
                .map_err(|error| BadField::new(name, error.to_string()))?;
            *value = T::from_wire(wire);
            self.lists.see(name, presence, value)
        }
    }
    let body = body(bytes)?;
    record.visit_mut(&mut Decode {
        input: CdrDeserializer::new(body),
        length: body.len(),
        keep,
        lists: ListLengths::new(parallel),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::{ImuSample, Pose};
    use crate::stream::samples;

    #[test]
    fn columns_that_an_older_version_did_not_have_are_missing() {
        let mut bytes = Vec::new();
        let exact = ImuSample {
            pitch_sigma_rad: 0.004,
            ..samples::imu()
        };
        encode_columns(&mut bytes, &exact, |_| true).unwrap();
        // Five standard deviations of eight bytes each stand at the end.
        bytes.truncate(bytes.len() - 5 * 8);
        // A record that is used again must not keep what the message before had.
        let mut read = exact;
        decode_columns(&bytes, &mut read, |_| true, None).unwrap();
        assert!(read.pitch_sigma_rad.is_nan() && read.accel_sigma_m_s2.is_nan());
        assert_eq!(read.pitch_rad, exact.pitch_rad);

        let without: fn(&str) -> bool = |column| column != "pushed_ns";
        let mut shorter = Vec::new();
        encode_columns(&mut shorter, &samples::pose(), without).unwrap();
        let mut read = samples::pose();
        decode_columns(&shorter, &mut read, |_| true, None).unwrap();
        let wanted = Pose {
            pushed: None,
            ..samples::pose()
        };
        assert_eq!(read, wanted);
        // Half of a column is no missing one.
        shorter.pop();
        assert!(decode_columns(&shorter, &mut read, |_| true, None).is_err());
    }
}
