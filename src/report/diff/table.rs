//! CSV against CSV: any file with a header row.

use super::{ColumnId, Comparison, DiffError, Rules};
use csv::ByteRecord;
use std::collections::HashMap;
use std::io::Read;
use std::sync::mpsc::{Receiver, Sender, channel};

/// Names listed of many.
const SHOWN: usize = 5;

/// Compares two texts. Rows are met by their place or, with `key`, by the value of that column.
/// Columns are met by name.
///
/// # Errors
/// A text without a header, a row of another length than its header, no column in common, a key that
/// is not there or not unique, a rule for a column that neither text has.
pub fn compare(
    a: impl Read,
    b: impl Read,
    names: [&str; 2],
    key: Option<&str>,
    rules: &Rules,
) -> Result<Comparison, DiffError> {
    let mut comparison = Comparison::new(names, rules);
    let [name_a, name_b] = names;
    let mut left = Table::new(a, name_a)?;
    let mut right = Table::new(b, name_b)?;
    let pairs = common_columns(&mut comparison, &left, &right)?;
    comparison.check_rules()?;
    match key {
        None => by_place(&mut comparison, &mut left, &mut right, &pairs)?,
        Some(key) => by_key(&mut comparison, &mut left, &mut right, &pairs, key)?,
    }
    if rules.are_exact()
        && key.is_none()
        && comparison.is_equal()
        && left.digest() != right.digest()
    {
        comparison.remark(
            "the fields are equal, the bytes are not: the order of columns, quotes, line ends or \
             lines that start with #"
                .to_owned(),
        );
    }
    Ok(comparison)
}

/// A text that is read row by row.
struct Table<R: Read> {
    reader: csv::Reader<Digested<R>>,
    digests: Receiver<u64>,
    name: String,
    header: Vec<String>,
    row: ByteRecord,
}

/// Tells the digest of all bytes that have gone through, once they have.
struct Digested<R> {
    inner: R,
    digest: u64,
    to: Sender<u64>,
}

impl<R: Read> Read for Digested<R> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let length = self.inner.read(buffer)?;
        // Fowler, Noll and Vo's FNV-1a.
        for byte in buffer.iter().take(length) {
            self.digest = (self.digest ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
        }
        if length == 0 {
            // Nobody may want it.
            let _ = self.to.send(self.digest);
        }
        Ok(length)
    }
}

impl<R: Read> Table<R> {
    fn new(input: R, name: &str) -> Result<Table<R>, DiffError> {
        let (to, digests) = channel();
        let input = Digested {
            inner: input,
            digest: 0xcbf2_9ce4_8422_2325,
            to,
        };
        let mut reader = csv::ReaderBuilder::new()
            .has_headers(false)
            .flexible(true)
            .comment(Some(b'#'))
            .from_reader(input);
        let mut row = ByteRecord::new();
        if !read(&mut reader, &mut row, name)? {
            return Err(DiffError::Bad(format!(
                "{name}: empty: a header row is wanted"
            )));
        }
        let header: Vec<String> = row
            .iter()
            .map(|column| String::from_utf8_lossy(column).into_owned())
            .collect();
        for (i, column) in header.iter().enumerate() {
            if header.iter().take(i).any(|other| other == column) {
                return Err(DiffError::Bad(format!(
                    "{name}: column {column} is there twice"
                )));
            }
        }
        Ok(Table {
            reader,
            digests,
            name: name.to_owned(),
            header,
            row,
        })
    }

    fn next(&mut self) -> Result<bool, DiffError> {
        if !read(&mut self.reader, &mut self.row, &self.name)? {
            return Ok(false);
        }
        let (found, wanted) = (self.row.len(), self.header.len());
        if found != wanted {
            return Err(DiffError::Bad(format!(
                "{}:{}: {found} fields where the header has {wanted}",
                self.name,
                self.line()
            )));
        }
        Ok(true)
    }

    fn line(&self) -> u64 {
        self.row.position().map_or(0, csv::Position::line)
    }

    /// Of the whole text, when it has been read to its end.
    fn digest(&self) -> Option<u64> {
        self.digests.try_iter().last()
    }

    fn place_of(&self, column: &str) -> Option<usize> {
        self.header.iter().position(|name| name == column)
    }
}

fn read<R: Read>(
    reader: &mut csv::Reader<R>,
    row: &mut ByteRecord,
    name: &str,
) -> Result<bool, DiffError> {
    reader.read_byte_record(row).map_err(|error| {
        let text = error.to_string();
        match error.into_kind() {
            csv::ErrorKind::Io(io) => DiffError::Io(io),
            _ => DiffError::Bad(format!("{name}: {text}")),
        }
    })
}

/// A column, and where it is in both texts.
type Pair = (ColumnId, usize, usize);

/// Columns of both texts. What only one has is a difference.
fn common_columns<A: Read, B: Read>(
    comparison: &mut Comparison,
    left: &Table<A>,
    right: &Table<B>,
) -> Result<Vec<Pair>, DiffError> {
    let both = |name: &&String| right.place_of(name).is_some();
    if !left.header.iter().any(|name| both(&name)) {
        return Err(DiffError::Bad(format!(
            "{} and {} cannot be compared: no column in common",
            left.name, right.name
        )));
    }
    let mut pairs = Vec::new();
    for (i, name) in left.header.iter().enumerate() {
        if let (Some(j), Some(id)) = (right.place_of(name), comparison.column(name)) {
            pairs.push((id, i, j));
        }
    }
    let only = |mine: &[String], theirs: &[String]| -> Vec<String> {
        let rest = mine.iter().filter(|name| !theirs.contains(name));
        rest.cloned().collect()
    };
    let sides = [
        only(&left.header, &right.header),
        only(&right.header, &left.header),
    ];
    for (file, mut names) in sides.into_iter().enumerate() {
        names.retain(|name| comparison.column(name).is_some());
        if !names.is_empty() {
            let s = if names.len() == 1 { "" } else { "s" };
            comparison.only_in(file, &format!("column{s} {}", names.join(", ")));
        }
    }
    Ok(pairs)
}

fn by_place<A: Read, B: Read>(
    comparison: &mut Comparison,
    left: &mut Table<A>,
    right: &mut Table<B>,
    pairs: &[Pair],
) -> Result<(), DiffError> {
    let mut rows = 0u64;
    loop {
        match (left.next()?, right.next()?) {
            (true, true) => {
                rows += 1;
                compare_rows(comparison, &left.row, &right.row, pairs, &|| {
                    place(rows, left.line(), right.line())
                });
            }
            (false, false) => return Ok(()),
            (more, _) => {
                let mut surplus = 1u64;
                while if more { left.next()? } else { right.next()? } {
                    surplus += 1;
                }
                let rows = match surplus {
                    1 => format!("row {}, the last one", rows + 1),
                    n => format!("{n} rows at the end, from row {} on", rows + 1),
                };
                comparison.only_in(usize::from(!more), &rows);
                return Ok(());
            }
        }
    }
}

fn place(row: u64, a: u64, b: u64) -> String {
    if a == b {
        format!("row {row} (line {a})")
    } else {
        format!("row {row} (lines {a} and {b})")
    }
}

fn by_key<A: Read, B: Read>(
    comparison: &mut Comparison,
    left: &mut Table<A>,
    right: &mut Table<B>,
    pairs: &[Pair],
    key: &str,
) -> Result<(), DiffError> {
    let missing = |name: &str| DiffError::Bad(format!("{name}: there is no column {key}"));
    let (at_left, at_right) = match (left.place_of(key), right.place_of(key)) {
        (Some(at_left), Some(at_right)) => (at_left, at_right),
        (None, Some(_)) => return Err(missing(&left.name)),
        (Some(_), None) => return Err(missing(&right.name)),
        (None, None) => {
            return Err(DiffError::Unknown(format!(
                "neither {} nor {} has a column {key} to be the key; there are {}",
                left.name,
                right.name,
                left.header.join(", ")
            )));
        }
    };
    let mut rows: HashMap<Vec<u8>, ByteRecord> = HashMap::new();
    let mut order = Vec::new();
    while right.next()? {
        let value = right.row.get(at_right).unwrap_or_default().to_vec();
        if rows.insert(value.clone(), right.row.clone()).is_some() {
            return Err(twice(&right.name, right.line(), key, &value));
        }
        order.push(value);
    }
    let mut seen: HashMap<Vec<u8>, ()> = HashMap::new();
    let mut only_left = Vec::new();
    while left.next()? {
        let value = left.row.get(at_left).unwrap_or_default().to_vec();
        if seen.insert(value.clone(), ()).is_some() {
            return Err(twice(&left.name, left.line(), key, &value));
        }
        match rows.get(&value) {
            Some(other) => {
                let text = String::from_utf8_lossy(&value);
                compare_rows(comparison, &left.row, other, pairs, &|| {
                    format!("the row with {key} {text}")
                });
            }
            None => only_left.push(value),
        }
    }
    let only_right: Vec<Vec<u8>> = order
        .into_iter()
        .filter(|value| !seen.contains_key(value))
        .collect();
    for (file, values) in [only_left, only_right].into_iter().enumerate() {
        if !values.is_empty() {
            let shown = values.iter().take(SHOWN);
            let shown: Vec<_> = shown.map(|v| String::from_utf8_lossy(v)).collect();
            let more = match values.len().saturating_sub(SHOWN) {
                0 => String::new(),
                more => format!(" and {more} more"),
            };
            let s = if values.len() == 1 { "" } else { "s" };
            let what = format!("row{s} with {key} {}{more}", shown.join(", "));
            comparison.only_in(file, &what);
        }
    }
    Ok(())
}

fn twice(name: &str, line: u64, key: &str, value: &[u8]) -> DiffError {
    let value = String::from_utf8_lossy(value);
    DiffError::Bad(format!(
        "{name}:{line}: {key} {value} is there twice: it is no key"
    ))
}

fn compare_rows(
    comparison: &mut Comparison,
    a: &ByteRecord,
    b: &ByteRecord,
    pairs: &[Pair],
    place: &dyn Fn() -> String,
) {
    comparison.begin_row();
    for (column, i, j) in pairs {
        let (a, b) = (a.get(*i), b.get(*j));
        comparison.field(*column, place, a.unwrap_or_default(), b.unwrap_or_default());
    }
}
