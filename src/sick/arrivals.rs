//! Arrival times kept beside a recorded byte stream: `NAME.times.csv` for `NAME.cola`.
//!
//! One row a telegram with the columns `t_s` (host time when it had arrived, s), `offset` (of its
//! first byte in the recording) and, where the table also lists what the host sent, `dir` (`d2h`
//! for what came from the device).

use std::io::Read;

/// Arrival times by the offset of a telegram.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Arrivals {
    /// Offset and time, by offset.
    rows: Vec<(u64, i64)>,
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
    pub fn read(table: impl Read) -> Result<Arrivals, ArrivalsError> {
        let mut reader = csv::Reader::from_reader(table);
        let header = reader.headers()?.clone();
        let find = |name| header.iter().position(|column| column == name);
        let time = find("t_s").ok_or(ArrivalsError::Column("t_s"))?;
        let offset = find("offset").ok_or(ArrivalsError::Column("offset"))?;
        let direction = find("dir");
        let mut rows = Vec::new();
        for record in reader.records() {
            let record = record?;
            if direction.is_some_and(|column| record.get(column) != Some("d2h")) {
                continue;
            }
            let field = |index| record.get(index).unwrap_or_default();
            let not_a_number = |column, text: &str| ArrivalsError::Number {
                line: record.position().map_or(0, csv::Position::line),
                column,
                text: text.to_owned(),
            };
            let time = field(time);
            let offset = field(offset);
            rows.push((
                offset.parse().map_err(|_| not_a_number("offset", offset))?,
                parse_seconds_ns(time).ok_or_else(|| not_a_number("t_s", time))?,
            ));
        }
        rows.sort_unstable();
        Ok(Arrivals { rows })
    }

    /// When the telegram that begins at `offset` had arrived, ns on the table's clock.
    pub fn at(&self, offset: u64) -> Option<i64> {
        let row = self.rows.binary_search_by_key(&offset, |row| row.0).ok()?;
        self.rows.get(row).map(|row| row.1)
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
        assert_eq!(arrivals.at(0), Some(750_000_000));
        assert_eq!(arrivals.at(28), Some(1_000_000_000));
        assert_eq!(arrivals.at(9), None);
        assert!(Arrivals::read(&b"offset\n0\n"[..]).is_err());
        let bad = Arrivals::read(&b"t_s,offset\n1,2\nx,3\n"[..]).unwrap_err();
        assert!(bad.to_string().contains("line 3, column t_s"), "{bad}");
    }
}
