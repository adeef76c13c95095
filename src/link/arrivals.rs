//! Arrival times kept beside a recorded byte stream: `NAME.times.csv` for `NAME.cola`.
//!
//! One row a piece of the stream, in its order: `t_s` (UTC when it had arrived, s since 1970),
//! `raw_s` (the same on the host's monotonic clock, s), `offset` (of its first byte in the file),
//! `length` (bytes) and `session_s` (arrival of the connection's first bytes: another value means
//! another connection). Tables of other programs, which may have a row a telegram, need `t_s` and
//! `offset` only; where a table also lists what the host sent, `dir` is `d2h` for what came from
//! the device.

use super::HostInstant;
use crate::record::Stamp;
use std::io::Read;

/// Arrival times by the place in the recording.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Arrivals {
    rows: Vec<Row>,
    /// Where a connection began, and which.
    sessions: Vec<(u64, i64)>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Row {
    offset: u64,
    at: HostInstant,
    /// Bytes; none where the table does not say: up to the next row.
    length: Option<u32>,
}

/// Why a table of arrival times cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ArrivalsError {
    /// The file cannot be read or is not CSV.
    #[error(transparent)]
    Csv(#[from] csv::Error),
    /// A column is missing.
    #[error("no column {0}")]
    Column(&'static str),
    /// A field does not parse.
    #[error("line {line}, column {column}: {text:?} is not a number")]
    Number {
        /// Line, from 1.
        line: u64,
        /// The column's name.
        column: &'static str,
        /// What stands there.
        text: String,
    },
}

impl Arrivals {
    /// Reads the table.
    ///
    /// A row that a program that was killed has left without its end is passed over.
    pub fn read(mut table: impl Read) -> Result<Arrivals, ArrivalsError> {
        let mut bytes = Vec::new();
        table.read_to_end(&mut bytes).map_err(csv::Error::from)?;
        // Only what this project writes ends every row; other programs may leave the last one open.
        let line_end = |byte: &u8| *byte == b'\n';
        let header = bytes.split(line_end).next().unwrap_or_default();
        if header.windows(9).any(|name| name == b"session_s") {
            let whole = bytes.iter().rposition(line_end).map_or(0, |at| at + 1);
            bytes.truncate(whole);
        }
        let mut reader = csv::Reader::from_reader(&bytes[..]);
        let header = reader.headers()?.clone();
        let find = |name| header.iter().position(|column| column == name);
        let time = find("t_s").ok_or(ArrivalsError::Column("t_s"))?;
        let offset = find("offset").ok_or(ArrivalsError::Column("offset"))?;
        let (raw, length, session) = (find("raw_s"), find("length"), find("session_s"));
        let direction = find("dir");
        let mut arrivals = Arrivals::default();
        let mut record = csv::StringRecord::new();
        while reader.read_record(&mut record)? {
            if direction.is_some_and(|column| record.get(column) != Some("d2h")) {
                continue;
            }
            let not_a_number = |column, index: usize| ArrivalsError::Number {
                line: record.position().map_or(0, csv::Position::line),
                column,
                text: record.get(index).unwrap_or_default().to_owned(),
            };
            let seconds = |column, index| {
                let text = record.get(index).unwrap_or_default();
                parse_seconds_ns(text).ok_or_else(|| not_a_number(column, index))
            };
            let utc_ns = seconds("t_s", time)?;
            let raw_ns = raw.map_or(Ok(utc_ns), |raw| seconds("raw_s", raw))?;
            let text = record.get(offset).unwrap_or_default();
            let first = text.parse().map_err(|_| not_a_number("offset", offset))?;
            let bytes = |index| {
                let text = record.get(index).unwrap_or_default();
                text.parse().map_err(|_| not_a_number("length", index))
            };
            let length = length.map(bytes).transpose()?;
            if let Some(index) = session {
                let session = seconds("session_s", index)?;
                if arrivals.sessions.last().map(|(_, last)| *last) != Some(session) {
                    arrivals.sessions.push((first, session));
                }
            }
            arrivals.rows.push(Row {
                offset: first,
                at: HostInstant {
                    utc: Stamp::from_ns(utc_ns),
                    raw_ns,
                },
                length,
            });
        }
        arrivals.rows.sort_by_key(|row| row.offset);
        arrivals.sessions.sort_unstable();
        Ok(arrivals)
    }

    /// When the byte at `offset` had arrived: the time of the row that holds it. A telegram is there
    /// with its last byte. Where the table has no monotonic clock, UTC stands for it.
    pub fn at(&self, offset: u64) -> Option<HostInstant> {
        self.piece(offset).map(|(at, _)| at)
    }

    /// The piece that holds the byte at `offset`: when it had arrived, and the place behind its last
    /// byte.
    pub fn piece(&self, offset: u64) -> Option<(HostInstant, u64)> {
        let after = self.rows.partition_point(|row| row.offset <= offset);
        let row = self.rows.get(after.checked_sub(1)?)?;
        let end = match (row.length, self.rows.get(after)) {
            (Some(length), _) => row.offset.saturating_add(length.into()),
            (None, Some(next)) => next.offset,
            (None, None) => u64::MAX,
        };
        (offset < end).then_some((row.at, end))
    }

    /// Where the next connection after the byte at `offset` begins.
    pub fn next_session(&self, offset: u64) -> Option<u64> {
        let after = self.sessions.partition_point(|(begin, _)| *begin <= offset);
        self.sessions.get(after).map(|(begin, _)| *begin)
    }

    /// Whether the recording goes on with the connection with which `before` ended.
    pub fn continues(&self, before: &Arrivals) -> bool {
        match (before.sessions.last(), self.sessions.first()) {
            (Some((_, last)), Some((_, first))) => last == first,
            _ => false,
        }
    }
}

/// Seconds as decimal text to whole nanoseconds, exactly, so that times since 1970 keep their last
/// digits; none for text that is not a decimal number. Digits beyond the ninth are cut off.
pub fn parse_seconds_ns(text: &str) -> Option<i64> {
    let (sign, digits) = match text.strip_prefix('-') {
        Some(digits) => (-1, digits),
        None => (1, text),
    };
    let (whole, fraction) = digits.split_once('.').unwrap_or((digits, ""));
    let are_digits = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
    if whole.is_empty() || !are_digits(whole) || !are_digits(fraction) {
        return None;
    }
    let nanoseconds = fraction
        .bytes()
        .chain(std::iter::repeat(b'0'))
        .take(9)
        .fold(0, |sum, digit| sum * 10 + i64::from(digit - b'0'));
    let whole: i64 = whole.parse().ok()?;
    let total = whole.checked_mul(1_000_000_000)?.checked_add(nanoseconds)?;
    Some(sign * total)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn utc(arrivals: &Arrivals, offset: u64) -> Option<i64> {
        arrivals.at(offset).map(|at| at.utc.ns())
    }

    #[test]
    fn seconds_are_exact() {
        assert_eq!(parse_seconds_ns("1.727405071"), Some(1_727_405_071));
        assert_eq!(
            parse_seconds_ns("1614680100.123456789123"),
            Some(1_614_680_100_123_456_789)
        );
        assert_eq!(parse_seconds_ns("-0.5"), Some(-500_000_000));
        assert_eq!(parse_seconds_ns("7"), Some(7_000_000_000));
        for text in ["", ".", "x", "1e3", "--1", "1.2.3", "99999999999999"] {
            assert_eq!(parse_seconds_ns(text), None, "{text}");
        }
    }

    #[test]
    fn only_what_the_device_sent_counts() {
        let table = "t_s,dir,offset,length\n0.5,h2d,0,9\n0.75,d2h,0,28\n1,d2h,28,10\n";
        let arrivals = Arrivals::read(table.as_bytes()).unwrap();
        assert_eq!(utc(&arrivals, 0), Some(750_000_000));
        assert_eq!(utc(&arrivals, 27), Some(750_000_000));
        assert_eq!(utc(&arrivals, 37), Some(1_000_000_000));
        assert_eq!(utc(&arrivals, 38), None);
        assert!(Arrivals::read(&b"offset\n0\n"[..]).is_err());
        let bad = Arrivals::read(&b"t_s,offset\n1,2\nx,3\n"[..]).unwrap_err();
        assert!(bad.to_string().contains("line 3, column t_s"), "{bad}");
    }

    #[test]
    fn without_lengths_a_row_reaches_to_the_next() {
        let arrivals = Arrivals::read(&b"t_s,offset\n2,100\n1,0\n"[..]).unwrap();
        assert_eq!(utc(&arrivals, 99), Some(1_000_000_000));
        assert_eq!(utc(&arrivals, 5000), Some(2_000_000_000));
        assert_eq!(arrivals.at(99).unwrap().raw_ns, 1_000_000_000);
        // Cut off in its last row: that one is not there.
        let whole = "t_s,raw_s,offset,length,session_s\n1,1,0,10,1\n";
        for cut in ["2", "2,2,10", "2,2,10,5,1", "2,2,10,5,1.5"] {
            let cut = Arrivals::read(format!("{whole}{cut}").as_bytes()).unwrap();
            assert_eq!(cut, Arrivals::read(whole.as_bytes()).unwrap());
        }
        let late = Arrivals::read(&b"t_s,offset\n1,10\n"[..]).unwrap();
        assert_eq!(late.at(9), None);
    }

    #[test]
    fn connections_have_their_bounds() {
        let table = "t_s,raw_s,offset,length,session_s\n\
                     10,1,0,5,10\n10.5,1.5,5,5,10\n20,9,10,1,20\n";
        let arrivals = Arrivals::read(table.as_bytes()).unwrap();
        assert_eq!(arrivals.at(5).unwrap().raw_ns, 1_500_000_000);
        assert_eq!(arrivals.next_session(0), Some(10));
        assert_eq!(arrivals.next_session(10), None);
        let further = "t_s,raw_s,offset,length,session_s\n21,10,0,5,20\n";
        let further = Arrivals::read(further.as_bytes()).unwrap();
        assert!(further.continues(&arrivals) && !arrivals.continues(&further));
        assert!(!Arrivals::default().continues(&Arrivals::default()));
    }
}
