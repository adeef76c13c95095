//! CSV: RFC 4180, a header row, columns found by name.
//!
//! The columns are those that a record shows its visitors. A reader takes them in any order, passes
//! over columns it does not know, and refuses a header without a required one. A list is one field
//! with single spaces between its items. Every row ends with a line feed; one that does not has been
//! cut off. Lines that start with `#` are remarks; those above the header go on to the output of a
//! filter, and may say where the records come from.

use super::check::{BadField, Checks, ListLengths, StreamRecord};
use super::exit::Fault;
use super::kinds;
use super::trajectory_text::Layout;
use crate::record::{Presence, Record, Value, Visit, VisitMut};
use csv::ByteRecord;
use std::cell::{Cell, RefCell};
use std::convert::Infallible;
use std::io::{self, BufRead, BufReader, Cursor, Read, Write};
use std::rc::Rc;

/// A read takes what a pipe holds at once.
const BUFFER: usize = 1 << 16;

/// What is wrong with a row that the end of the input ends.
const CUT_OFF: &str = "the row is cut off: no line feed ends it";

/// Why a row gave no record.
#[derive(Debug)]
pub(super) enum RowError {
    /// The row is bad; the next one may not be.
    Bad(Fault),
    /// Nothing more can be read.
    Fatal(anyhow::Error),
}

/// Lines without their line feeds.
type Remarks = Vec<Vec<u8>>;

/// Remarks above the header that are kept, bytes; the rest is passed over.
const MOST_REMARKS: u64 = 1 << 20;

/// Takes the remarks off the beginning of a text: the lines that start with `#`, without their line
/// feeds, and the text that is left.
pub(super) fn take_remarks(text: Box<dyn Read>) -> io::Result<(Remarks, Box<dyn Read>)> {
    let mut text = BufReader::new(text);
    let mut remarks = Vec::new();
    let mut room = MOST_REMARKS;
    while text.fill_buf()?.first() == Some(&b'#') {
        let mut line = Vec::new();
        let length = (&mut text).take(room).read_until(b'\n', &mut line)?;
        room -= length as u64;
        if line.pop_if(|last| *last == b'\n').is_none() {
            // Too long, or the end of the input: what is left of the line is a remark still.
            return Ok((remarks, Box::new(Cursor::new(b"#").chain(text))));
        }
        remarks.push(line);
    }
    Ok((remarks, Box::new(text)))
}

/// How the lines of a text that is read as CSV stand to those of the file.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Lines {
    /// Lines of the file that have been taken off its beginning.
    pub(super) taken_off: u64,
    /// The layout that the text was made from: its first line, the header, is not the file's.
    pub(super) layout: Option<Layout>,
}

impl Lines {
    fn of_file(self, line: u64) -> u64 {
        (line + self.taken_off).saturating_sub(u64::from(self.layout.is_some()))
    }
}

/// Reads one kind of record.
pub(super) struct CsvReader<R> {
    reader: csv::Reader<Box<dyn Read>>,
    name: String,
    row: ByteRecord,
    header_fields: usize,
    /// Where each of the record's columns stands in a row.
    fields: Vec<Option<usize>>,
    record: R,
    checks: Checks,
    /// Whether the input has ended.
    at_end: Rc<Cell<bool>>,
    lines: Lines,
    /// Columns of the header that the record does not have.
    unknown: Vec<String>,
}

/// Notes when its reader meets the end of the input. A row that ends with a line feed is given out
/// before the end is looked for, so a row given out after it has been cut off.
struct NoteEnd {
    input: Box<dyn Read>,
    at_end: Rc<Cell<bool>>,
}

impl Read for NoteEnd {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let length = self.input.read(buffer)?;
        if length == 0 && !buffer.is_empty() {
            self.at_end.set(true);
        }
        Ok(length)
    }
}

impl<R: StreamRecord> CsvReader<R> {
    /// Reads the header row; `name` is the file's in messages.
    pub(super) fn new(input: Box<dyn Read>, name: &str, lines: Lines) -> anyhow::Result<Self> {
        let at_end = Rc::new(Cell::new(false));
        let input: Box<dyn Read> = Box::new(NoteEnd {
            input,
            at_end: Rc::clone(&at_end),
        });
        let mut reader = csv::ReaderBuilder::new()
            .has_headers(false)
            .flexible(true)
            .comment(Some(b'#'))
            .buffer_capacity(BUFFER)
            .from_reader(input);
        let mut header = ByteRecord::new();
        if !reader.read_byte_record(&mut header)? {
            return Err(Fault::BadData(format!(
                "{name}: empty: {} records start with a header row",
                R::KIND
            ))
            .into());
        }
        Ok(CsvReader {
            fields: find_columns::<R>(&header).map_err(|why| {
                let line = lines.of_file(header.position().map_or(1, csv::Position::line));
                Fault::BadData(format!("{name}:{line}: {why}"))
            })?,
            header_fields: header.len(),
            unknown: unknown_columns::<R>(&header),
            name: name.to_owned(),
            reader,
            row: header,
            record: R::default(),
            checks: Checks::default(),
            at_end,
            lines,
        })
    }

    /// Reads the next row; false at the end.
    pub(super) fn advance(&mut self) -> Result<bool, RowError> {
        match self.reader.read_byte_record(&mut self.row) {
            Ok(true) => {}
            Ok(false) => return Ok(false),
            Err(error) => return Err(RowError::Fatal(error.into())),
        }
        // The last number of a row that was cut off looks like a whole one.
        let why = match (self.fill(), self.at_end.get()) {
            (Ok(()), false) => return Ok(true),
            (Ok(()), true) => CUT_OFF.to_owned(),
            (Err(bad), false) => bad.to_string(),
            (Err(bad), true) => format!("{bad}; {CUT_OFF}"),
        };
        let line = self.row.position().map_or(0, csv::Position::line);
        let line = self.lines.of_file(line);
        let fault = Fault::BadData(format!("{}:{line}: {why}", self.name));
        Err(RowError::Bad(fault))
    }

    /// Columns of the header that the record does not have.
    pub(super) fn unknown_columns(&self) -> &[String] {
        &self.unknown
    }

    /// The record of the last row read.
    pub(super) fn record(&self) -> &R {
        &self.record
    }

    fn fill(&mut self) -> Result<(), BadField> {
        if let (Some(layout), 1, Some(count)) = (self.lines.layout, self.row.len(), self.row.get(0))
        {
            let count = String::from_utf8_lossy(count);
            return Err(BadField::row(format!(
                "{count} fields where {}",
                layout.line()
            )));
        }
        if self.row.len() != self.header_fields {
            return Err(BadField::row(format!(
                "{} fields where the header has {}",
                self.row.len(),
                self.header_fields
            )));
        }
        let mut fill = FillRow {
            row: &self.row,
            fields: self.fields.iter(),
            lists: ListLengths::new(R::PARALLEL_LISTS),
        };
        self.record.visit_mut(&mut fill)?;
        self.checks.check(&self.record)
    }
}

/// Puts a row's fields into a record. A column that the header lacks keeps its default.
struct FillRow<'a> {
    row: &'a ByteRecord,
    fields: std::slice::Iter<'a, Option<usize>>,
    lists: ListLengths,
}

impl VisitMut for FillRow<'_> {
    type Error = BadField;

    fn column<T: Value>(
        &mut self,
        name: &'static str,
        presence: Presence,
        value: &mut T,
    ) -> Result<(), BadField> {
        let Some(&Some(field)) = self.fields.next() else {
            return Ok(());
        };
        let text = self.row.get(field).unwrap_or_default();
        value
            .parse_text(text)
            .map_err(|error| BadField::text(name, &error, text))?;
        self.lists.see(name, presence, value)
    }
}

/// What a header has that a record has no place for.
fn unknown_columns<R: Record>(header: &ByteRecord) -> Vec<String> {
    let known = kinds::columns::<R>();
    let unknown = header
        .iter()
        .filter(|name| !known.iter().any(|(known, _)| known.as_bytes() == *name));
    unknown
        .map(|name| String::from_utf8_lossy(name).into_owned())
        .collect()
}

/// Where each column of a record stands in the header.
fn find_columns<R: Record>(header: &ByteRecord) -> Result<Vec<Option<usize>>, String> {
    let mut fields = Vec::new();
    let mut missing = Vec::new();
    for (name, presence) in kinds::columns::<R>() {
        let mut places = (0..header.len()).filter(|i| header.get(*i) == Some(name.as_bytes()));
        let place = places.next();
        if places.next().is_some() {
            return Err(format!("column {name} is there twice"));
        }
        if place.is_none() && presence == Presence::Required {
            missing.push(name);
        }
        fields.push(place);
    }
    if missing.is_empty() {
        return Ok(fields);
    }
    let names: Vec<String> = header
        .iter()
        .map(|name| String::from_utf8_lossy(name).into_owned())
        .collect();
    let columns = if missing.len() == 1 {
        format!("column {} missing", missing[0])
    } else {
        format!("columns {} missing", missing.join(", "))
    };
    Err(match kinds::of_header(&names, R::KIND) {
        Some(kind) => format!(
            "these are {kind} records, {} records are wanted: {columns}",
            R::KIND
        ),
        None => format!("{columns} ({} records are wanted)", R::KIND),
    })
}

/// Writes one kind of record.
pub(super) struct CsvWriter<W: Write> {
    writer: csv::Writer<Led<W>>,
    remarks: Rc<RefCell<Vec<u8>>>,
    /// Whether each of the record's columns is in the header; empty before the first record.
    present: Vec<bool>,
    kind: Option<&'static str>,
    text: Vec<u8>,
}

/// An output that begins with remarks.
pub(super) struct Led<W> {
    inner: W,
    /// What is still to be written before anything else.
    remarks: Rc<RefCell<Vec<u8>>>,
}

impl<W: Write> Write for Led<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let remarks = self.remarks.take();
        self.inner.write_all(&remarks)?;
        self.inner.write(bytes)
    }
    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

impl<W: Write> CsvWriter<W> {
    pub(super) fn new(output: W) -> Self {
        let remarks = Rc::default();
        let output = Led {
            inner: output,
            remarks: Rc::clone(&remarks),
        };
        CsvWriter {
            writer: csv::WriterBuilder::new()
                .buffer_capacity(BUFFER)
                .flexible(true)
                .from_writer(output),
            remarks,
            present: Vec::new(),
            kind: None,
            text: Vec::new(),
        }
    }

    /// Sets what stands above the header, line by line, if that is not written yet.
    pub(super) fn set_remarks(&mut self, lines: &[Vec<u8>]) {
        if self.kind.is_none() {
            let mut text = lines.join(&b'\n');
            if !lines.is_empty() {
                text.push(b'\n');
            }
            self.remarks.replace(text);
        }
    }

    /// Writes a row, and the header before the first one: its [`Presence::Extra`] columns are those
    /// for which the first record has a value.
    pub(super) fn write<R: Record>(&mut self, record: &R) -> anyhow::Result<()> {
        match self.kind {
            None => self.header(record)?,
            Some(kind) if kind == R::KIND => {}
            Some(kind) => {
                return Err(Fault::Usage(format!(
                    "a CSV stream carries one kind of record, this one {kind}: {} needs a file of \
                     its own or --format mcap",
                    R::KIND
                ))
                .into());
            }
        }
        self.text.clear();
        record.visit(&mut WriteRow {
            writer: &mut self.writer,
            present: self.present.iter(),
            text: &mut self.text,
        })?;
        self.writer.write_record(None::<&[u8]>)?;
        Ok(())
    }

    /// Writes the header of a stream that turned out to have no records.
    pub(super) fn write_empty<R: Record>(&mut self) -> anyhow::Result<()> {
        self.columns_like(&R::default())
    }

    /// Writes the header that `like` as the first record would have, if there is none yet.
    pub(super) fn columns_like<R: Record>(&mut self, like: &R) -> anyhow::Result<()> {
        if self.kind.is_none() {
            self.header(like)?;
        }
        Ok(())
    }

    pub(super) fn flush(&mut self) -> std::io::Result<()> {
        self.writer.flush()
    }

    fn header<R: Record>(&mut self, first: &R) -> anyhow::Result<()> {
        struct Choose<'a>(&'a mut Vec<bool>, Vec<&'static str>);
        impl Visit for Choose<'_> {
            type Error = Infallible;
            fn column<T: Value>(
                &mut self,
                name: &'static str,
                presence: Presence,
                value: &T,
            ) -> Result<(), Infallible> {
                let present = presence != Presence::Extra || !value.is_missing();
                self.0.push(present);
                if present {
                    self.1.push(name);
                }
                Ok(())
            }
        }
        let mut choose = Choose(&mut self.present, Vec::new());
        let Ok(()) = first.visit(&mut choose);
        self.writer.write_record(choose.1)?;
        self.kind = Some(R::KIND);
        Ok(())
    }
}

struct WriteRow<'a, W: Write> {
    writer: &'a mut csv::Writer<Led<W>>,
    present: std::slice::Iter<'a, bool>,
    text: &'a mut Vec<u8>,
}

impl<W: Write> Visit for WriteRow<'_, W> {
    type Error = anyhow::Error;

    fn column<T: Value>(
        &mut self,
        name: &'static str,
        _: Presence,
        value: &T,
    ) -> anyhow::Result<()> {
        if self.present.next().copied().unwrap_or(false) {
            self.text.clear();
            value.push_text(self.text);
            self.writer.write_field(&self.text)?;
        } else if !value.is_missing() {
            return Err(Fault::BadData(format!(
                "column {name} has a value here but had none in the first record, which made the \
                 header; MCAP (--format mcap) takes both"
            ))
            .into());
        }
        Ok(())
    }
}

#[cfg(test)]
#[path = "csv_tests.rs"]
mod tests;
