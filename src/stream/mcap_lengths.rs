//! The lengths that stand in an MCAP record, looked at before it is parsed.
//!
//! The parser takes memory by what a length says and only then finds that the bytes are not there:
//! a damaged file of a few bytes would cost gigabytes.

use mcap::records::op;

/// Whether everything that a record says of its lengths fits into its bytes.
pub(super) fn fit(opcode: u8, record: &[u8]) -> bool {
    let parts = Parts(record);
    let whole = match opcode {
        // Id; name, encoding, definition.
        op::SCHEMA => parts.skip(2).and_then(|parts| parts.blocks(3)),
        // Id and schema's id; topic, encoding, entries.
        op::CHANNEL => parts
            .skip(4)
            .and_then(|parts| parts.blocks(2))
            .and_then(Parts::entries),
        // Name, entries.
        op::METADATA => parts.blocks(1).and_then(Parts::entries),
        _ => Some(parts),
    };
    whole.is_some()
}

/// What is left of a record.
struct Parts<'a>(&'a [u8]);

impl<'a> Parts<'a> {
    fn skip(self, bytes: usize) -> Option<Parts<'a>> {
        self.0.get(bytes..).map(Parts)
    }

    /// A length of four bytes, and as many bytes behind it.
    fn block(self) -> Option<(&'a [u8], Parts<'a>)> {
        let (length, rest) = self.0.split_first_chunk::<4>()?;
        let length = usize::try_from(u32::from_le_bytes(*length)).ok()?;
        let (block, rest) = rest.split_at_checked(length)?;
        Some((block, Parts(rest)))
    }

    fn blocks(self, count: usize) -> Option<Parts<'a>> {
        (0..count).try_fold(self, |parts, _| parts.block().map(|(_, rest)| rest))
    }

    /// A block that is made of pairs of blocks.
    fn entries(self) -> Option<Parts<'a>> {
        let (block, rest) = self.block()?;
        let mut entries = Parts(block);
        while !entries.0.is_empty() {
            entries = entries.blocks(2)?;
        }
        Some(rest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn block(bytes: &[u8]) -> Vec<u8> {
        let length = u32::try_from(bytes.len()).unwrap();
        [&length.to_le_bytes()[..], bytes].concat()
    }

    #[test]
    fn a_length_beyond_the_record_is_seen() {
        let entries = block(&[block(b"key"), block(b"value")].concat());
        let schema = [
            &[1, 0][..],
            &block(b"a/b"),
            &block(b"ros2msg"),
            &block(b"int8 x"),
        ]
        .concat();
        let channel = [&[1, 0, 1, 0][..], &block(b"/x"), &block(b"cdr"), &entries].concat();
        let metadata = [block(b"provenance"), entries].concat();
        for (opcode, record, lengths) in [
            (op::SCHEMA, schema, [2, 9, 20]),
            (op::CHANNEL, channel, [4, 10, 17]),
            (op::METADATA, metadata, [0, 14, 18]),
        ] {
            assert!(fit(opcode, &record));
            for less in 1..record.len() {
                assert!(
                    !fit(opcode, &record[..record.len() - less]),
                    "{opcode} {less}"
                );
            }
            for at in lengths {
                let mut huge = record.clone();
                huge[at + 3] = 0x66;
                assert!(!fit(opcode, &huge), "{opcode} at {at}");
            }
        }
        assert!(fit(op::MESSAGE, &[]));
    }
}
