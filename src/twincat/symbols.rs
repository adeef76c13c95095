//! What a PLC says of its variables and types.
//!
//! Entries as TwinCAT 3 has them: a symbol's begins with its length, group, offset, size, type
//! number, flags and the lengths of name, type and comment; a data type's with its length, version,
//! hashes, size, offset, type number, flags, those lengths, its dimensions and members.

use super::ams::index;
use super::bytes::{Bytes, latin_1, length_u32, zero_ended};
use super::client::{Client, ClientError};
use super::code::Code;
use std::time::Duration;

/// The longest entry that is asked for, bytes.
const MOST_ENTRY: u32 = 1 << 20;
/// The longest symbol table, bytes.
const MOST_TABLE: u32 = 15 << 20;

/// A variable.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Symbol {
    /// Its whole name.
    pub name: String,
    /// Where it lies.
    pub group: u32,
    /// Where it lies.
    pub offset: u32,
    /// Bytes.
    pub size: u32,
    /// Number of its (element's) type: 5 is LREAL, 65 a structure.
    pub base: u32,
    /// Flags; 0x20 is read-only.
    pub flags: u32,
    /// Its type's name; empty where the controller does not tell.
    pub type_name: String,
    /// What the programmer wrote beside it.
    pub comment: String,
}

/// A data type, or a member of one.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct DataType {
    /// Its name.
    pub name: String,
    /// The name of what it is made of (a member: its type's).
    pub type_name: String,
    /// Bytes.
    pub size: u32,
    /// Where a member lies in its structure, bytes.
    pub offset: u32,
    /// Number of its (element's) type.
    pub base: u32,
    /// Lower bound and length of each dimension.
    pub dimensions: Vec<(i32, u32)>,
    /// A structure's members.
    pub members: Vec<DataType>,
}

impl Symbol {
    /// Reads an entry from the front of `bytes`; and what is behind it.
    pub fn parse(bytes: &[u8]) -> Option<(Symbol, &[u8])> {
        let (mut entry, rest) = entry(bytes)?;
        let (group, offset, size) = (entry.u32()?, entry.u32()?, entry.u32()?);
        let (base, flags) = (entry.u32()?, entry.u32()?);
        let lengths = (entry.u16()?, entry.u16()?, entry.u16()?);
        let symbol = Symbol {
            name: entry.text(lengths.0)?,
            group,
            offset,
            size,
            base,
            flags,
            type_name: entry.text(lengths.1)?,
            // Not every server puts a zero behind the last text.
            comment: latin_1(entry.take(lengths.2.into())?),
        };
        Some((symbol, rest))
    }

    /// Appends the entry.
    pub fn push(&self, out: &mut Vec<u8>) {
        with_length(out, |out| {
            for number in [self.group, self.offset, self.size, self.base, self.flags] {
                out.extend_from_slice(&number.to_le_bytes());
            }
            push_texts(out, [&self.name, &self.type_name, &self.comment], &[]);
        });
    }

    /// Whether the controller refuses writing to it.
    pub fn is_read_only(&self) -> bool {
        self.flags & 0x20 != 0
    }
}

impl DataType {
    /// Reads an entry from the front of `bytes`; and what is behind it.
    pub fn parse(bytes: &[u8]) -> Option<(DataType, &[u8])> {
        DataType::parse_nested(bytes, 0)
    }

    fn parse_nested(bytes: &[u8], depth: u32) -> Option<(DataType, &[u8])> {
        let (mut entry, rest) = entry(bytes)?;
        // Version and two hashes.
        entry.take(12)?;
        let (size, offset, base) = (entry.u32()?, entry.u32()?, entry.u32()?);
        entry.u32()?;
        let lengths = (entry.u16()?, entry.u16()?, entry.u16()?);
        let (dimensions, members) = (entry.u16()?, entry.u16()?);
        let mut data_type = DataType {
            name: entry.text(lengths.0)?,
            type_name: entry.text(lengths.1)?,
            size,
            offset,
            base,
            ..DataType::default()
        };
        entry.text(lengths.2)?;
        for _ in 0..dimensions {
            let lower = i32::from_le_bytes(entry.array()?);
            data_type.dimensions.push((lower, entry.u32()?));
        }
        for _ in 0..members {
            // Members have none of their own in practice.
            if depth > 8 {
                return None;
            }
            let (member, behind) = DataType::parse_nested(entry.0, depth + 1)?;
            entry.0 = behind;
            data_type.members.push(member);
        }
        Some((data_type, rest))
    }

    /// Appends the entry.
    pub fn push(&self, out: &mut Vec<u8>) {
        with_length(out, |out| {
            for number in [1, 0, 0, self.size, self.offset, self.base, 0x1] {
                out.extend_from_slice(&u32::to_le_bytes(number));
            }
            let counts = [self.dimensions.len(), self.members.len()];
            push_texts(out, [&self.name, &self.type_name, ""], &counts);
            for (lower, length) in &self.dimensions {
                out.extend_from_slice(&lower.to_le_bytes());
                out.extend_from_slice(&length.to_le_bytes());
            }
            for member in &self.members {
                member.push(out);
            }
        });
    }
}

fn entry(bytes: &[u8]) -> Option<(Bytes<'_>, &[u8])> {
    let mut front = Bytes(bytes);
    let length = front.u32()?;
    let body = front.take((length as usize).checked_sub(4)?)?;
    Some((Bytes(body), front.0))
}

fn with_length(out: &mut Vec<u8>, fill: impl FnOnce(&mut Vec<u8>)) {
    let start = out.len();
    out.extend_from_slice(&[0; 4]);
    fill(out);
    let length = length_u32(out.len() - start).to_le_bytes();
    if let Some(place) = out.get_mut(start..start + 4) {
        place.copy_from_slice(&length);
    }
}

/// The lengths of three texts and further counts, then the texts, each with a zero behind it.
fn push_texts(out: &mut Vec<u8>, texts: [&str; 3], counts: &[usize]) {
    let lengths = texts.iter().map(|text| text.len());
    for length in lengths.chain(counts.iter().copied()) {
        out.extend_from_slice(&u16::try_from(length).unwrap_or(u16::MAX).to_le_bytes());
    }
    for text in texts {
        out.extend_from_slice(text.as_bytes());
        out.push(0);
    }
}

/// Asks for a variable. A controller that tells only the size gives a symbol without a type.
///
/// # Errors
/// [`ClientError`]; [`Code::NO_SYMBOL`] where there is none of that name.
pub fn find(client: &mut Client, name: &str, timeout: Duration) -> Result<Symbol, ClientError> {
    let asked = zero_ended(name);
    let whole = client.read_write(index::INFO_BY_NAME_EX, 0, MOST_ENTRY, &asked, timeout);
    match whole {
        Ok(entry) => Symbol::parse(&entry)
            .map(|(symbol, _)| symbol)
            .ok_or(ClientError::Reply("the question for a symbol")),
        Err(ClientError::Refused(code)) if code.is_unsupported() => {
            let short = client.read_write(index::INFO_BY_NAME, 0, 12, &asked, timeout)?;
            let mut bytes = Bytes(&short);
            match (bytes.u32(), bytes.u32(), bytes.u32()) {
                (Some(group), Some(offset), Some(size)) => Ok(Symbol {
                    name: name.to_owned(),
                    group,
                    offset,
                    size,
                    ..Symbol::default()
                }),
                _ => Err(ClientError::Reply("the question for a symbol")),
            }
        }
        Err(error) => Err(error),
    }
}

/// Asks for a data type.
///
/// # Errors
/// [`ClientError`].
pub fn data_type(
    client: &mut Client,
    name: &str,
    timeout: Duration,
) -> Result<DataType, ClientError> {
    let asked = zero_ended(name);
    let entry = client.read_write(index::DATA_TYPE_BY_NAME, 0, MOST_ENTRY, &asked, timeout)?;
    DataType::parse(&entry)
        .map(|(data_type, _)| data_type)
        .ok_or(ClientError::Reply("the question for a data type"))
}

/// All variables.
///
/// # Errors
/// [`ClientError`].
pub fn all(client: &mut Client, timeout: Duration) -> Result<Vec<Symbol>, ClientError> {
    let not_understood = || ClientError::Reply("the question for all symbols");
    let info = match client.read(index::SYMBOL_UPLOAD_INFO_2, 0, 24, timeout) {
        Err(ClientError::Refused(code)) if code.is_unsupported() || code == Code::SIZE => {
            client.read(index::SYMBOL_UPLOAD_INFO, 0, 8, timeout)
        }
        other => other,
    }?;
    let mut bytes = Bytes(&info);
    let (count, size) = match (bytes.u32(), bytes.u32()) {
        (Some(count), Some(size)) if size <= MOST_TABLE => (count, size),
        _ => return Err(not_understood()),
    };
    let table = client.read(index::SYMBOL_UPLOAD, 0, size, timeout)?;
    let (mut symbols, mut rest) = (Vec::new(), table.as_slice());
    while !rest.is_empty() {
        let (symbol, behind) = Symbol::parse(rest).ok_or_else(not_understood)?;
        symbols.push(symbol);
        rest = behind;
    }
    if symbols.len() != count as usize {
        return Err(not_understood());
    }
    Ok(symbols)
}

#[cfg(test)]
impl DataType {
    /// A member, as the tests of symbols and layouts build their structures from.
    pub(super) fn member(
        name: &str,
        type_name: &str,
        size: u32,
        offset: u32,
        base: u32,
    ) -> DataType {
        DataType {
            name: name.into(),
            type_name: type_name.into(),
            size,
            offset,
            base,
            ..DataType::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn a_struct() -> DataType {
        let member = DataType::member;
        DataType {
            name: "ST_Pose".into(),
            size: 24,
            base: 65,
            members: vec![
                member("x", "LREAL", 8, 0, 5),
                DataType {
                    dimensions: vec![(-1, 2)],
                    ..member("angles", "ARRAY [-1..0] OF REAL", 8, 8, 4)
                },
                member("status", "UDINT", 4, 16, 19),
            ],
            ..DataType::default()
        }
    }

    #[test]
    fn entries_come_back() {
        let symbol = Symbol {
            name: "MAIN.SickValue".into(),
            group: 0x4040,
            offset: 0x5_DC40,
            size: 72,
            base: 5,
            flags: 0x8,
            type_name: "ARRAY [0..8] OF LREAL".into(),
            comment: "from cablepose".into(),
        };
        let mut out = Vec::new();
        symbol.push(&mut out);
        symbol.push(&mut out);
        let (first, rest) = Symbol::parse(&out).unwrap();
        assert_eq!(first, symbol);
        assert_eq!(Symbol::parse(rest).unwrap(), (symbol, &[][..]));
        let mut out = Vec::new();
        a_struct().push(&mut out);
        assert_eq!(DataType::parse(&out).unwrap(), (a_struct(), &[][..]));
    }

    /// As TwinCAT sends it: what is behind the comment (a GUID, attributes) is passed over.
    #[test]
    fn what_is_behind_the_texts_is_passed_over() {
        let mut entry = vec![0; 4];
        for number in [0x4040u32, 16, 8, 5, 0x1008] {
            entry.extend_from_slice(&number.to_le_bytes());
        }
        for length in [6u16, 5, 0] {
            entry.extend_from_slice(&length.to_le_bytes());
        }
        entry.extend_from_slice(b"MAIN.x\0LREAL\0\0");
        entry.extend_from_slice(&[0xAA; 16]);
        entry[0] = entry.len() as u8;
        let (symbol, rest) = Symbol::parse(&entry).unwrap();
        assert_eq!((symbol.name.as_str(), symbol.size), ("MAIN.x", 8));
        assert!(rest.is_empty());
    }

    proptest! {
        #[test]
        fn any_bytes_do_no_harm(bytes in proptest::collection::vec(any::<u8>(), 0..120), cut in 0..200usize, at in 0..200usize, to in any::<u8>()) {
            let _ = (Symbol::parse(&bytes), DataType::parse(&bytes));
            let mut out = Vec::new();
            a_struct().push(&mut out);
            if let Some(byte) = out.get_mut(at) {
                *byte = to;
            }
            let _ = DataType::parse(&out[..cut.min(out.len())]);
        }
    }
}
