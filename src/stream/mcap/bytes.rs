//! From the bytes of an MCAP to its records, with every length looked at before it is believed.
//!
//! The reader and the parser of the `mcap` crate take a length at its word. The parser takes memory
//! by it and only then finds that the bytes are not there: a damaged file of a few bytes would cost
//! gigabytes. And the reader takes it for granted that the records of a chunk that is not compressed
//! end where the chunk does.

use crate::stream::exit::Fault;
use mcap::McapError;
use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::{LinearReader, LinearReaderOptions};
use std::io::{self, Read};

/// A read takes what a pipe holds at once.
const BUFFER: usize = 1 << 16;

/// Messages above this are taken for damage.
const MESSAGE_LIMIT: usize = 1 << 28;

/// What is wrong with the bytes.
#[derive(Debug, thiserror::Error)]
pub(in crate::stream) enum Damage {
    /// They end before the file does.
    #[error("ends in the middle")]
    CutOff,
    /// A record says that it holds more than there is of it.
    #[error("a length in record {0:02x} goes beyond it")]
    InRecord(u8),
    /// A record of a chunk says that it is longer than what is left of the chunk.
    #[error("a record goes beyond its chunk")]
    BeyondChunk,
    /// Anything else.
    #[error(transparent)]
    Other(McapError),
}

impl From<McapError> for Damage {
    fn from(error: McapError) -> Damage {
        match error {
            McapError::UnexpectedEof | McapError::UnexpectedEoc => Damage::CutOff,
            error => Damage::Other(error),
        }
    }
}

impl Damage {
    /// As an error of the file `name`; `place` says how far it could be read.
    pub(in crate::stream) fn fault(&self, name: &str, place: &str) -> Fault {
        Fault::BadData(match self {
            Damage::CutOff => format!("{name}: ends in the middle: it was cut off{place}"),
            damage => format!("{name}: not a whole MCAP{place}: {damage}"),
        })
    }
}

/// A reader of records, to be fed by a [`Feed`].
pub(in crate::stream) fn linear_reader() -> LinearReader {
    LinearReader::new_with_options(
        LinearReaderOptions::default()
            .with_record_length_limit(MESSAGE_LIMIT)
            .with_validate_chunk_crcs(true),
    )
}

/// Parses a record that the reader has given out.
pub(in crate::stream) fn parse(opcode: u8, record: &[u8]) -> Result<Record<'_>, Damage> {
    if !fit(opcode, record) {
        return Err(Damage::InRecord(opcode));
    }
    mcap::parse_record(opcode, record).map_err(Damage::from)
}

/// What feeds a [`linear_reader`] with the bytes of an input.
pub(in crate::stream) struct Feed<I> {
    input: I,
    walk: Walk,
}

impl<I: Read> Feed<I> {
    pub(in crate::stream) fn new(input: I) -> Feed<I> {
        Feed {
            input,
            walk: Walk::default(),
        }
    }

    /// Gives the reader what the input has. Bytes behind a record that goes beyond its chunk are
    /// kept from it: once it has given out what came before, this is an error.
    pub(in crate::stream) fn give(
        &mut self,
        reader: &mut LinearReader,
    ) -> io::Result<Result<(), Damage>> {
        if self.walk.is_lost() {
            return Ok(Err(Damage::BeyondChunk));
        }
        let space = reader.insert(BUFFER);
        let length = self.input.read(space)?;
        let sound = self.walk.sound(space.get(..length).unwrap_or_default());
        if sound == 0 && length > 0 {
            return Ok(Err(Damage::BeyondChunk));
        }
        // None at all is the end of the input.
        reader.notify_read(sound);
        Ok(Ok(()))
    }
}

/// A walk over the bytes, from the head of one record to the next.
#[derive(Debug)]
struct Walk {
    place: Place,
    /// Bytes that are passed over before the next head.
    skip: u64,
    /// What has come of the head at hand.
    head: Vec<u8>,
}

#[derive(Clone, Copy, Debug)]
enum Place {
    /// The head of a record of the file: its kind and its length.
    Record,
    /// The head of a chunk of this length, as far as the length of its compression's name.
    Chunk { length: u64 },
    /// The length of a chunk's records, with this much of the chunk left from there on.
    ChunkRecords { left: u64, compressed: bool },
    /// The head of a record in a chunk, with this much of its records left, and what follows them.
    InChunk { left: u64, behind: u64 },
    /// The lengths contradict each other in a way that the reader sees itself.
    Unsound,
    /// A record goes beyond its chunk.
    Lost,
}

/// Kind and length.
const RECORD_HEAD: usize = 9;
/// Times of the first and last message, uncompressed size and sum, length of the compression's name.
const CHUNK_HEAD: usize = 32;
/// A length.
const LENGTH: usize = 8;
/// What a file begins with.
const MAGIC: u64 = 8;

impl Default for Walk {
    fn default() -> Walk {
        Walk {
            place: Place::Record,
            skip: MAGIC,
            head: Vec::new(),
        }
    }
}

impl Walk {
    fn is_lost(&self) -> bool {
        matches!(self.place, Place::Lost)
    }

    /// How many of the next bytes the reader may have: all, but for those from a record on that goes
    /// beyond its chunk.
    fn sound(&mut self, bytes: &[u8]) -> usize {
        let mut at = 0;
        while at < bytes.len() {
            if self.skip > 0 {
                let step = usize::try_from(self.skip).unwrap_or(usize::MAX);
                let step = step.min(bytes.len() - at);
                at += step;
                self.skip -= step as u64;
                continue;
            }
            let wanted = match self.place {
                Place::Record | Place::InChunk { .. } => RECORD_HEAD,
                Place::Chunk { .. } => CHUNK_HEAD,
                Place::ChunkRecords { .. } => LENGTH,
                Place::Unsound => return bytes.len(),
                Place::Lost => return 0,
            };
            if let Place::InChunk { left: 0, behind } = self.place {
                (self.place, self.skip) = (Place::Record, behind);
                continue;
            }
            let begin = at;
            let step = (wanted - self.head.len()).min(bytes.len() - at);
            self.head.extend(bytes.iter().skip(at).take(step));
            at += step;
            if self.head.len() < wanted {
                break;
            }
            let head = std::mem::take(&mut self.head);
            (self.place, self.skip) = after(self.place, &head);
            if self.is_lost() {
                return begin;
            }
        }
        at
    }
}

/// What follows the head at a place, and how far behind it.
fn after(place: Place, head: &[u8]) -> (Place, u64) {
    let number = |from: usize| -> u64 {
        let bytes = head.get(from..).and_then(|rest| rest.first_chunk::<8>());
        bytes.map_or(u64::MAX, |bytes| u64::from_le_bytes(*bytes))
    };
    match place {
        Place::Record => match (head.first(), number(1)) {
            (Some(&op::CHUNK), length) => (Place::Chunk { length }, 0),
            (_, length) => (Place::Record, length),
        },
        Place::Chunk { length } => {
            let name = head
                .last_chunk::<4>()
                .map_or(0, |bytes| u32::from_le_bytes(*bytes));
            let head = CHUNK_HEAD as u64 + u64::from(name);
            match length.checked_sub(head) {
                Some(left) => {
                    let compressed = name > 0;
                    (Place::ChunkRecords { left, compressed }, u64::from(name))
                }
                None => (Place::Unsound, 0),
            }
        }
        Place::ChunkRecords { left, compressed } => {
            let records = number(0);
            match left.checked_sub(LENGTH as u64) {
                Some(left) if compressed => (Place::Record, left),
                Some(left) if records <= left => {
                    let behind = left - records;
                    (
                        Place::InChunk {
                            left: records,
                            behind,
                        },
                        0,
                    )
                }
                _ => (Place::Unsound, 0),
            }
        }
        Place::InChunk { left, behind } => {
            let length = number(1);
            let left = left
                .checked_sub(RECORD_HEAD as u64)
                .and_then(|left| left.checked_sub(length));
            match left {
                Some(left) => (Place::InChunk { left, behind }, length),
                None => (Place::Lost, 0),
            }
        }
        place => (place, 0),
    }
}

/// Whether everything that a record says of its lengths fits into its bytes.
fn fit(opcode: u8, record: &[u8]) -> bool {
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
    use mcap::sans_io::linear_reader::LinearReadEvent;
    use proptest::prelude::*;

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

    /// A file with a schema, a channel and messages of growing size, in chunks.
    fn file(compression: Option<mcap::Compression>, chunk: u64) -> Vec<u8> {
        let mut bytes = std::io::Cursor::new(Vec::new());
        let options = mcap::WriteOptions::new()
            .compression(compression)
            .chunk_size(Some(chunk));
        let mut writer = options.create(&mut bytes).unwrap();
        let schema = writer.add_schema("a/b", "ros2msg", b"int8 x").unwrap();
        let channel = writer
            .add_channel(schema, "/x", "cdr", &Default::default())
            .unwrap();
        for size in 0..40u32 {
            let header = mcap::records::MessageHeader {
                channel_id: channel,
                sequence: size,
                log_time: u64::from(size),
                publish_time: u64::from(size),
            };
            let body = vec![7; size as usize];
            writer.write_to_known_channel(&header, &body).unwrap();
        }
        writer.finish().unwrap();
        drop(writer);
        bytes.into_inner()
    }

    /// An input that gives a few bytes at a time.
    struct Pieces<'a>(&'a [u8], usize);

    impl Read for Pieces<'_> {
        fn read(&mut self, space: &mut [u8]) -> io::Result<usize> {
            let length = space.len().min(self.1).min(self.0.len());
            let (now, later) = self.0.split_at(length);
            space[..length].copy_from_slice(now);
            self.0 = later;
            Ok(length)
        }
    }

    /// How many messages come, and how it ends.
    fn messages(bytes: &[u8], piece: usize) -> (usize, Option<Damage>) {
        let mut feed = Feed::new(Pieces(bytes, piece));
        let mut reader = linear_reader();
        let mut count = 0;
        while let Some(event) = reader.next_event() {
            match event {
                Err(error) => return (count, Some(error.into())),
                Ok(LinearReadEvent::ReadRequest(_)) => {
                    if let Err(damage) = feed.give(&mut reader).unwrap() {
                        return (count, Some(damage));
                    }
                }
                Ok(LinearReadEvent::Record { data, opcode }) => {
                    count += usize::from(opcode == op::MESSAGE);
                    if let Err(damage) = parse(opcode, data) {
                        return (count, Some(damage));
                    }
                }
            }
        }
        (count, None)
    }

    #[test]
    fn whole_files_are_read_whatever_their_chunks() {
        let zstd = Some(mcap::Compression::Zstd);
        for (compression, chunk) in [(None, 1), (None, 300), (None, 1 << 20), (zstd, 300)] {
            let bytes = file(compression, chunk);
            for piece in [1, 7, 64, 1 << 16] {
                let (count, damage) = messages(&bytes, piece);
                assert!(count == 40 && damage.is_none(), "{count} {damage:?}");
            }
        }
    }

    /// The crate's reader would take more off what is left of the chunk than there is.
    #[test]
    fn a_record_beyond_its_chunk_ends_the_reading_before_it() {
        let whole = file(None, 1 << 20);
        // The heads of the messages in the one chunk: kind 5, 22 bytes of header and the body.
        let head = |size: u8| [[5, 22 + size, 0, 0, 0, 0, 0, 0, 0, 1].as_slice(), &[0]].concat();
        for size in [0, 17, 39] {
            let head = head(size);
            let at = whole.windows(head.len()).position(|w| w == head).unwrap();
            for (byte, value) in [(2, 0x10), (4, 1), (8, 0x7f), (8, 0xff)] {
                let mut damaged = whole.clone();
                damaged[at + byte] = value;
                for piece in [1, 7, 1 << 16] {
                    let (count, damage) = messages(&damaged, piece);
                    assert!(matches!(damage, Some(Damage::BeyondChunk)), "{damage:?}");
                    assert_eq!(count, usize::from(size));
                }
            }
        }
    }

    proptest! {
        /// No bytes make it panic, and the pieces that they come in make no difference.
        #[test]
        fn damaged_files_end_alike(
            changes in prop::collection::vec((0usize..4000, any::<u8>()), 0..6),
            cut in 0usize..4000,
            piece in 1usize..200,
            chunk in 1u64..2000,
        ) {
            let mut bytes = file(None, chunk);
            for (at, value) in changes {
                let length = bytes.len();
                bytes[at % length] = value;
            }
            bytes.truncate(bytes.len() - cut.min(bytes.len()) % 500);
            let (count, damage) = messages(&bytes, piece);
            let (all_count, all_damage) = messages(&bytes, bytes.len().max(1));
            prop_assert_eq!(count, all_count);
            let kind = |damage: Option<Damage>| damage.map(|damage| std::mem::discriminant(&damage));
            prop_assert_eq!(kind(damage), kind(all_damage));
        }
    }
}
