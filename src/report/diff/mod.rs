//! Where two files of records differ: golden files, runs of two versions, round trips.
//!
//! A field is equal to another if their texts are, or, where a [`Tolerance`] is given for its column,
//! if their numbers are close enough. A [`Comparison`] is shown fields row by row by whoever reads
//! them ([`table`] for CSV, [`tree`] for JSON, records for everything else) and sums up how many
//! differ, where the first and the largest difference is, column by column.

pub mod table;
pub mod tree;

use crate::record::{Presence, Record, Value, Visit};
use std::collections::BTreeSet;
use std::convert::Infallible;
use std::fmt::Write;

/// Columns by name: `x_m`, `*_m` for all that end so, `cov_*`, `*` for all.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pattern(String);

impl Pattern {
    /// The pattern of this text.
    pub fn new(text: &str) -> Pattern {
        Pattern(text.to_owned())
    }

    /// Whether a column is meant: by its whole name or, in JSON, by the last part of its path.
    pub fn is_of(&self, name: &str) -> bool {
        let last = name.rsplit('.').next().unwrap_or(name);
        glob(&self.0, name) || glob(&self.0, last)
    }
}

/// Whether a pattern with `*` for any characters fits a name.
fn glob(pattern: &str, name: &str) -> bool {
    let mut parts = pattern.split('*');
    let first = parts.next().unwrap_or_default();
    let Some(mut rest) = name.strip_prefix(first) else {
        return false;
    };
    let mut parts = parts.peekable();
    if parts.peek().is_none() {
        return rest.is_empty();
    }
    while let Some(part) = parts.next() {
        if parts.peek().is_none() {
            return rest.ends_with(part);
        }
        match rest.find(part) {
            Some(at) => rest = rest.get(at + part.len()..).unwrap_or_default(),
            None => return false,
        }
    }
    true
}

/// How far numbers of some columns may be apart: `x_m=1e-6` (in the column's unit), `cov_*=0.1%` (of
/// the larger of the two).
#[derive(Clone, Debug, PartialEq)]
pub struct Tolerance {
    columns: Pattern,
    limit: Limit,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Limit {
    Absolute(f64),
    Relative(f64),
}

impl Limit {
    /// Whether two numbers may be so `far` apart, the larger of which has the size `larger`.
    fn allows(self, far: f64, larger: f64) -> bool {
        match self {
            Limit::Absolute(most) => far <= most,
            Limit::Relative(share) => far <= share * larger,
        }
    }
}

/// Why a text is no tolerance.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("'{0}' is no tolerance; one is like x_m=1e-6, '*_rad=1e-9' or 'cov_*=0.1%'")]
pub struct ToleranceError(String);

impl std::str::FromStr for Tolerance {
    type Err = ToleranceError;

    fn from_str(text: &str) -> Result<Tolerance, ToleranceError> {
        let fail = || ToleranceError(text.to_owned());
        let (columns, limit) = text.rsplit_once('=').ok_or_else(fail)?;
        let number = |text: &str| {
            let value: Option<f64> = text.trim().parse().ok();
            value
                .filter(|v| *v >= 0.0 && v.is_finite())
                .ok_or_else(fail)
        };
        let limit = match limit.strip_suffix('%') {
            Some(percent) => Limit::Relative(number(percent)? / 100.0),
            None => Limit::Absolute(number(limit)?),
        };
        if columns.trim().is_empty() {
            return Err(fail());
        }
        Ok(Tolerance {
            columns: Pattern::new(columns.trim()),
            limit,
        })
    }
}

/// What may differ.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Rules {
    /// Of several for a column the last one holds.
    pub tolerances: Vec<Tolerance>,
    /// Columns that are passed over.
    pub ignored: Vec<Pattern>,
}

impl Rules {
    /// Whether bytes that are in no field count too: the order of columns, quotes, line ends.
    pub fn are_exact(&self) -> bool {
        self.tolerances.is_empty() && self.ignored.is_empty()
    }

    /// Whether a column is passed over.
    pub fn ignores(&self, column: &str) -> bool {
        self.ignored.iter().any(|pattern| pattern.is_of(column))
    }

    fn limit(&self, column: &str) -> Option<Limit> {
        let mut latest = self.tolerances.iter().rev();
        latest.find(|t| t.columns.is_of(column)).map(|t| t.limit)
    }
}

/// Why two files cannot be compared.
#[derive(Debug, thiserror::Error)]
pub enum DiffError {
    /// A file is not what it should be, or the two have nothing in common.
    #[error("{0}")]
    Bad(String),
    /// A column is asked for that neither file has.
    #[error("{0}")]
    Unknown(String),
    /// Reading failed.
    #[error(transparent)]
    Io(#[from] std::io::Error),
}

/// Columns that are listed.
const LINES: usize = 50;
/// Names that are listed of those there are.
const NAMES: usize = 60;

/// A column of both files.
#[derive(Clone, Debug)]
struct Column {
    name: String,
    limit: Option<Limit>,
    /// Fields that differ.
    different: u64,
    /// The first of them: where, and both values.
    first: Option<(String, String, String)>,
    /// The largest difference of two numbers, allowed or not, and where it is.
    largest: Option<(f64, String)>,
}

/// Two files, as far as they have been compared.
#[derive(Clone, Debug)]
pub struct Comparison {
    names: [String; 2],
    rules: Rules,
    columns: Vec<Column>,
    /// Columns and topics that are passed over.
    passed_over: BTreeSet<String>,
    rows: u64,
    different_rows: u64,
    /// Whether the row at hand differs.
    differs_here: bool,
    fields: u64,
    different_fields: u64,
    /// What only one file has, in sentences.
    remarks: Vec<String>,
    scratch: [Vec<u8>; 2],
}

/// A column of a [`Comparison`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ColumnId(usize);

impl Comparison {
    /// Of two files with these names.
    pub fn new(names: [&str; 2], rules: &Rules) -> Comparison {
        Comparison {
            names: names.map(str::to_owned),
            rules: rules.clone(),
            columns: Vec::new(),
            passed_over: BTreeSet::new(),
            rows: 0,
            different_rows: 0,
            differs_here: false,
            fields: 0,
            different_fields: 0,
            remarks: Vec::new(),
            scratch: [Vec::new(), Vec::new()],
        }
    }

    /// Whether a column or topic is passed over.
    pub fn passes_over(&mut self, name: &str) -> bool {
        let ignored = self.rules.ignores(name);
        if ignored {
            self.passed_over.insert(name.to_owned());
        }
        ignored
    }

    /// A new column; none for one that is passed over.
    pub fn column(&mut self, name: &str) -> Option<ColumnId> {
        (!self.passes_over(name)).then(|| self.new_column(name))
    }

    /// New columns for a kind of record, in its order, named `prefix.x_m` where there is a prefix.
    pub fn columns_of<R: Record>(&mut self, prefix: &str) -> Vec<Option<ColumnId>> {
        let names = texts(&R::default(), &mut Vec::new());
        let names = names.into_iter().map(|(name, _)| match prefix {
            "" => name.to_owned(),
            prefix => format!("{prefix}.{name}"),
        });
        names.map(|name| self.column(&name)).collect()
    }

    /// Refuses rules for columns that neither file has: a name that is misspelt would change
    /// nothing, and nobody would know. Call it when all columns are known.
    ///
    /// # Errors
    /// [`DiffError::Unknown`], with the names that there are.
    pub fn check_rules(&self) -> Result<(), DiffError> {
        let columns = self.columns.iter().map(|column| column.name.as_str());
        let there: Vec<&str> = columns
            .chain(self.passed_over.iter().map(String::as_str))
            .collect();
        let tolerated = self.rules.tolerances.iter().map(|t| &t.columns);
        let mut wanted = tolerated.chain(&self.rules.ignored);
        let met = |pattern: &&Pattern| there.iter().any(|name| pattern.is_of(name));
        let Some(unmet) = wanted.find(|pattern| !met(pattern)) else {
            return Ok(());
        };
        // Without records nothing is known of columns.
        if there.is_empty() {
            return Ok(());
        }
        let more = match there.len().saturating_sub(NAMES) {
            0 => String::new(),
            more => format!(" and {more} more"),
        };
        let names = there.into_iter().take(NAMES).collect::<Vec<_>>().join(", ");
        let [a, b] = &self.names;
        Err(DiffError::Unknown(format!(
            "neither {a} nor {b} has a column {}; there are {names}{more}",
            unmet.0
        )))
    }

    fn new_column(&mut self, name: &str) -> ColumnId {
        self.columns.push(Column {
            name: name.to_owned(),
            limit: self.rules.limit(name),
            different: 0,
            first: None,
            largest: None,
        });
        ColumnId(self.columns.len() - 1)
    }

    /// Something that only one of the files has, or a layout that is not the same: a difference.
    pub fn remark(&mut self, what: String) {
        self.remarks.push(what);
    }

    /// The next row begins.
    pub fn begin_row(&mut self) {
        self.end_row();
        self.rows += 1;
    }

    fn end_row(&mut self) {
        self.different_rows += u64::from(self.differs_here);
        self.differs_here = false;
    }

    /// Compares two fields of a column; `place` says where they are.
    pub fn field(&mut self, column: ColumnId, place: &dyn Fn() -> String, a: &[u8], b: &[u8]) {
        self.fields += 1;
        let Some(column) = self.columns.get_mut(column.0) else {
            return;
        };
        if a == b {
            return;
        }
        let found = distance(a, b);
        if let Some(far) = found
            && column.largest.as_ref().is_none_or(|(most, _)| far > *most)
        {
            column.largest = Some((far, place()));
        }
        let equal = match (column.limit, found) {
            (Some(limit), Some(_)) => items(a)
                .zip(items(b))
                .all(|(a, b)| a == b || close(a, b, limit)),
            _ => false,
        };
        if equal {
            return;
        }
        column.different += 1;
        if column.first.is_none() {
            column.first = Some((place(), shown(a), shown(b)));
        }
        self.differs_here = true;
        self.different_fields += 1;
    }

    /// Compares two records column by column; `columns` are those of their kind.
    pub fn records<R: Record>(
        &mut self,
        columns: &[Option<ColumnId>],
        place: &dyn Fn() -> String,
        a: &R,
        b: &R,
    ) {
        self.begin_row();
        let [mut text_a, mut text_b] = std::mem::take(&mut self.scratch);
        let ends_a = texts(a, &mut text_a);
        let ends_b = texts(b, &mut text_b);
        let mut at = [0, 0];
        for (column, (end_a, end_b)) in columns.iter().zip(ends_a.iter().zip(&ends_b)) {
            let field_a = text_a.get(at[0]..end_a.1).unwrap_or_default();
            let field_b = text_b.get(at[1]..end_b.1).unwrap_or_default();
            at = [end_a.1, end_b.1];
            if let Some(column) = column {
                self.field(*column, place, field_a, field_b);
            }
        }
        self.scratch = [text_a, text_b];
    }

    /// Rows at one place in one file that the other does not have.
    pub fn only_in(&mut self, file: usize, what: &str) {
        let name = self.names.get(file).map_or("", String::as_str);
        self.remarks.push(format!("only in {name}: {what}"));
    }

    /// Whether nothing differs.
    pub fn is_equal(&self) -> bool {
        self.different_fields == 0 && self.remarks.is_empty()
    }

    /// What differs, in lines; of two equal files, how far numbers are apart that may be.
    pub fn text(&mut self) -> String {
        self.end_row();
        let mut out = String::new();
        let [a, b] = &self.names;
        if self.is_equal() {
            let _ = writeln!(out, "{a} and {b} are equal: {}", self.size());
        } else if self.different_fields > 0 {
            let rows = plural(self.different_rows, "row");
            let _ = writeln!(
                out,
                "{a} and {b} differ in {rows} of {}, {}",
                self.rows,
                plural(self.different_fields, "field")
            );
        } else {
            let _ = writeln!(
                out,
                "{a} and {b} differ; what both have is equal: {}",
                self.size()
            );
        }
        for remark in &self.remarks {
            let _ = writeln!(out, "  {remark}");
        }
        let lines = self.columns.iter().filter_map(|column| self.line(column));
        for line in lines.clone().take(LINES) {
            let _ = writeln!(out, "  {line}");
        }
        match lines.count().saturating_sub(LINES) {
            0 => {}
            more => {
                let _ = writeln!(out, "  and {more} more");
            }
        }
        out
    }

    /// What is to be said of a column, if anything.
    fn line(&self, column: &Column) -> Option<String> {
        let within = |place: &str| match place {
            "" => String::new(),
            place => format!(" in {place}"),
        };
        let name = &column.name;
        let largest = column.largest.as_ref();
        let largest = largest.map(|(far, place)| format!("{far:e}{}", within(place)));
        let Some((place, a, b)) = &column.first else {
            let largest = largest.filter(|_| self.is_equal())?;
            return Some(format!("{name}: within its tolerance, at most {largest}"));
        };
        let mut line = match place.as_str() {
            "" => format!("{name}: {a} and {b}"),
            place => {
                let count = plural(column.different, "difference");
                format!("{name}: {count}, the first in {place}: {a} and {b}")
            }
        };
        if let Some(largest) = largest {
            let _ = write!(line, "; the largest {largest}");
        }
        Some(line)
    }

    fn size(&self) -> String {
        format!(
            "{}, {}",
            plural(self.rows, "row"),
            plural(self.fields, "field")
        )
    }
}

fn plural(n: u64, what: &str) -> String {
    let s = if n == 1 { "" } else { "s" };
    format!("{n} {what}{s}")
}

/// A record's fields as text, one after the other, and where each ends.
fn texts<R: Record>(record: &R, text: &mut Vec<u8>) -> Vec<(&'static str, usize)> {
    struct Texts<'a>(&'a mut Vec<u8>, Vec<(&'static str, usize)>);
    impl Visit for Texts<'_> {
        type Error = Infallible;
        fn column<T: Value>(
            &mut self,
            name: &'static str,
            _: Presence,
            value: &T,
        ) -> Result<(), Infallible> {
            value.push_text(self.0);
            self.1.push((name, self.0.len()));
            Ok(())
        }
    }
    text.clear();
    let mut texts = Texts(text, Vec::new());
    let Ok(()) = record.visit(&mut texts);
    texts.1
}

/// A field's items: of a list, what stands between blanks.
fn items(field: &[u8]) -> impl Iterator<Item = &[u8]> {
    field.split(|b| *b == b' ')
}

fn number(text: &[u8]) -> Option<f64> {
    let value: f64 = std::str::from_utf8(text).ok()?.parse().ok()?;
    value.is_finite().then_some(value)
}

/// The difference of two whole numbers or of two decimals; stamps lose nothing.
fn apart(a: &[u8], b: &[u8]) -> Option<f64> {
    let whole = |text: &[u8]| std::str::from_utf8(text).ok()?.parse::<i64>().ok();
    if let (Some(a), Some(b)) = (whole(a), whole(b)) {
        return Some(a.abs_diff(b) as f64);
    }
    Some((number(a)? - number(b)?).abs())
}

fn close(a: &[u8], b: &[u8], limit: Limit) -> bool {
    match (apart(a, b), number(a), number(b)) {
        (Some(far), Some(x), Some(y)) => limit.allows(far, x.abs().max(y.abs())),
        _ => false,
    }
}

/// The largest difference of two fields' numbers; none where they have not the same number of items,
/// or differ in one that is no number.
fn distance(a: &[u8], b: &[u8]) -> Option<f64> {
    let mut largest: f64 = 0.0;
    let (mut left, mut right) = (items(a), items(b));
    loop {
        match (left.next(), right.next()) {
            (None, None) => return Some(largest),
            (Some(a), Some(b)) if a == b => {}
            (Some(a), Some(b)) => largest = largest.max(apart(a, b)?),
            _ => return None,
        }
    }
}

/// A field for people: short, and visible if it is empty.
fn shown(field: &[u8]) -> String {
    const SHOWN: usize = 40;
    if field.is_empty() {
        return "nothing".to_owned();
    }
    let text = String::from_utf8_lossy(field);
    let short: String = text.chars().take(SHOWN).collect();
    let more = if text.chars().count() > SHOWN {
        ".."
    } else {
        ""
    };
    if number(field).is_some() {
        format!("{short}{more}")
    } else {
        format!("\"{}{more}\"", short.escape_debug())
    }
}

#[cfg(test)]
mod tests;
