//! CSV: RFC 4180, a header row, columns found by name.
//!
//! The columns are those that a record shows its visitors. A reader takes them in any order, passes
//! over columns it does not know, and refuses a header without a required one. A list is one field
//! with single spaces between its items. Every row ends with a line feed; one that does not has been
//! cut off. Lines that start with `#` are passed over.

use super::check::{BadField, Checks, ListLengths, StreamRecord};
use super::exit::Fault;
use super::kinds;
use crate::record::{Presence, Record, Value, Visit, VisitMut};
use csv::ByteRecord;
use std::cell::Cell;
use std::convert::Infallible;
use std::io::{self, Read, Write};
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
    /// Lines that are not the file's own, before its first one.
    lines_added: u64,
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
    /// Reads the header row; `name` is the file's in messages, `lines_added` how many lines of the
    /// input come before the file's first one.
    pub(super) fn new(input: Box<dyn Read>, name: &str, lines_added: u64) -> anyhow::Result<Self> {
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
                let line = header.position().map_or(1, csv::Position::line);
                Fault::BadData(format!("{name}:{line}: {why}"))
            })?,
            header_fields: header.len(),
            name: name.to_owned(),
            reader,
            row: header,
            record: R::default(),
            checks: Checks::default(),
            at_end,
            lines_added,
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
        let line = line.saturating_sub(self.lines_added);
        let fault = Fault::BadData(format!("{}:{line}: {why}", self.name));
        Err(RowError::Bad(fault))
    }

    /// The record of the last row read.
    pub(super) fn record(&self) -> &R {
        &self.record
    }

    fn fill(&mut self) -> Result<(), BadField> {
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
    writer: csv::Writer<W>,
    /// Whether each of the record's columns is in the header; empty before the first record.
    present: Vec<bool>,
    kind: Option<&'static str>,
    text: Vec<u8>,
}

impl<W: Write> CsvWriter<W> {
    pub(super) fn new(output: W) -> Self {
        CsvWriter {
            writer: csv::WriterBuilder::new()
                .buffer_capacity(BUFFER)
                .flexible(true)
                .from_writer(output),
            present: Vec::new(),
            kind: None,
            text: Vec::new(),
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
    writer: &'a mut csv::Writer<W>,
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
