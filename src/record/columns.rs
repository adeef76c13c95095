//! A record as a list of named, typed columns, and what a column's value can do.

use super::text;
use super::time::Stamp;
use serde::{Serialize, de::DeserializeOwned};

/// Whether a column must be there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Presence {
    /// A reader refuses a header without it.
    Required,
    /// Always written; a header without it reads as missing values.
    Optional,
    /// Written only where the stream's first record has a value for it.
    Extra,
}

/// Why a field's text is not a value.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ValueError {
    /// An empty field in a column that cannot miss its value.
    #[error("empty")]
    Empty,
    /// Text that is not of the expected kind; the payload names the kind.
    #[error("not {0}")]
    Not(&'static str),
}

/// A column's value: its CSV text, its ROS 2 field type and its wire form in CDR.
pub trait Value: Clone + Default {
    /// The ROS 2 field type in a message definition.
    const ROS_TYPE: &'static str;
    /// What serde makes of CDR.
    type Wire: DeserializeOwned;

    /// Whether the value is absent (an empty CSV field).
    fn is_missing(&self) -> bool;
    /// Appends the CSV text; nothing for a missing value.
    fn push_text(&self, out: &mut Vec<u8>);
    /// Reads the CSV text; an empty one is the missing value, or [`ValueError::Empty`].
    fn parse_text(&mut self, text: &[u8]) -> Result<(), ValueError>;
    /// What serde makes CDR of, in the form of [`Value::Wire`].
    fn to_wire(&self) -> impl Serialize;
    /// Back from the CDR form.
    fn from_wire(wire: Self::Wire) -> Self;
    /// How many items a list has; none for a single value.
    fn items(&self) -> Option<usize> {
        None
    }
}

/// Sees each column of a record that is being written.
pub trait Visit {
    /// What can go wrong.
    type Error;
    /// One column.
    fn column<T: Value>(
        &mut self,
        name: &'static str,
        presence: Presence,
        value: &T,
    ) -> Result<(), Self::Error>;
}

/// Fills each column of a record that is being read.
pub trait VisitMut {
    /// What can go wrong.
    type Error;
    /// One column.
    fn column<T: Value>(
        &mut self,
        name: &'static str,
        presence: Presence,
        value: &mut T,
    ) -> Result<(), Self::Error>;
}

/// Something that flows through a pipe: one row of CSV, or its messages in MCAP.
///
/// `visit` and `visit_mut` go through the same columns in the same order.
pub trait Record: Clone + Default {
    /// The record's name in messages to people ("scan", "pose").
    const KIND: &'static str;
    /// The instant the record belongs to.
    fn stamp(&self) -> Stamp;
    /// Shows every column.
    fn visit<V: Visit>(&self, visitor: &mut V) -> Result<(), V::Error>;
    /// Lets every column be filled.
    fn visit_mut<V: VisitMut>(&mut self, visitor: &mut V) -> Result<(), V::Error>;
}

/// Implements [`Record`] from one list of columns. What stands behind `=>` is a field, or a part of
/// one: `stamp`, `normal.d_m`, `rms_m[0]`.
macro_rules! columns {
    ($type:ty, kind = $kind:literal, stamp = $stamp:ident, {
        $($presence:ident $name:literal
            => $field:ident $(.$part:ident)* $([$index:literal])*;)*
    }) => {
        impl $crate::record::Record for $type {
            const KIND: &'static str = $kind;
            fn stamp(&self) -> $crate::record::Stamp {
                self.$stamp
            }
            fn visit<V: $crate::record::Visit>(&self, visitor: &mut V) -> Result<(), V::Error> {
                $(visitor.column(
                    $name,
                    $crate::record::Presence::$presence,
                    &self.$field $(.$part)* $([$index])*,
                )?;)*
                Ok(())
            }
            fn visit_mut<V: $crate::record::VisitMut>(
                &mut self,
                visitor: &mut V,
            ) -> Result<(), V::Error> {
                $(visitor.column(
                    $name,
                    $crate::record::Presence::$presence,
                    &mut self.$field $(.$part)* $([$index])*,
                )?;)*
                Ok(())
            }
        }
    };
}
pub(crate) use columns;

impl Value for f64 {
    const ROS_TYPE: &'static str = "float64";
    type Wire = f64;
    fn is_missing(&self) -> bool {
        self.is_nan()
    }
    fn push_text(&self, out: &mut Vec<u8>) {
        if !self.is_nan() {
            text::push_f64(out, *self);
        }
    }
    fn parse_text(&mut self, text: &[u8]) -> Result<(), ValueError> {
        *self = if text.is_empty() {
            f64::NAN
        } else {
            // Missing is the empty field; a written-out NaN is a fault upstream.
            text::parse_f64(text)
                .filter(|v| !v.is_nan())
                .ok_or(ValueError::Not("a number"))?
        };
        Ok(())
    }
    fn to_wire(&self) -> impl Serialize {
        *self
    }
    fn from_wire(wire: f64) -> f64 {
        wire
    }
}

impl Value for Stamp {
    const ROS_TYPE: &'static str = "int64";
    type Wire = i64;
    fn is_missing(&self) -> bool {
        false
    }
    fn push_text(&self, out: &mut Vec<u8>) {
        text::push_int(out, self.ns());
    }
    fn parse_text(&mut self, text: &[u8]) -> Result<(), ValueError> {
        *self = Stamp::from_ns(parse_int(text)?);
        Ok(())
    }
    fn to_wire(&self) -> impl Serialize {
        self.ns()
    }
    fn from_wire(wire: i64) -> Stamp {
        Stamp::from_ns(wire)
    }
}

/// The smallest int64 stands for a missing stamp in a message, which has no empty field.
impl Value for Option<Stamp> {
    const ROS_TYPE: &'static str = "int64";
    type Wire = i64;
    fn is_missing(&self) -> bool {
        self.is_none()
    }
    fn push_text(&self, out: &mut Vec<u8>) {
        if let Some(stamp) = self {
            stamp.push_text(out);
        }
    }
    fn parse_text(&mut self, text: &[u8]) -> Result<(), ValueError> {
        *self = if text.is_empty() {
            None
        } else {
            Some(Stamp::from_ns(parse_int(text)?))
        };
        Ok(())
    }
    fn to_wire(&self) -> impl Serialize {
        self.map_or(i64::MIN, Stamp::ns)
    }
    fn from_wire(wire: i64) -> Option<Stamp> {
        (wire != i64::MIN).then_some(Stamp::from_ns(wire))
    }
}

impl Value for u32 {
    const ROS_TYPE: &'static str = "uint32";
    type Wire = u32;
    fn is_missing(&self) -> bool {
        false
    }
    fn push_text(&self, out: &mut Vec<u8>) {
        text::push_int(out, *self);
    }
    fn parse_text(&mut self, text: &[u8]) -> Result<(), ValueError> {
        *self = u32::try_from(parse_int(text)?).map_err(|_| ValueError::Not("a 32 bit count"))?;
        Ok(())
    }
    fn to_wire(&self) -> impl Serialize {
        *self
    }
    fn from_wire(wire: u32) -> u32 {
        wire
    }
}

/// -1 stands for a missing value in a message.
impl Value for Option<u32> {
    const ROS_TYPE: &'static str = "int64";
    type Wire = i64;
    fn is_missing(&self) -> bool {
        self.is_none()
    }
    fn push_text(&self, out: &mut Vec<u8>) {
        if let Some(value) = self {
            value.push_text(out);
        }
    }
    fn parse_text(&mut self, text: &[u8]) -> Result<(), ValueError> {
        *self = if text.is_empty() {
            None
        } else {
            let mut value = 0u32;
            value.parse_text(text)?;
            Some(value)
        };
        Ok(())
    }
    fn to_wire(&self) -> impl Serialize {
        self.map_or(-1, i64::from)
    }
    fn from_wire(wire: i64) -> Option<u32> {
        u32::try_from(wire).ok()
    }
}

impl Value for Vec<f64> {
    const ROS_TYPE: &'static str = "float64[]";
    type Wire = Vec<f64>;
    fn is_missing(&self) -> bool {
        self.is_empty()
    }
    fn push_text(&self, out: &mut Vec<u8>) {
        push_list(out, self, |out, v| text::push_f64(out, *v));
    }
    fn parse_text(&mut self, text: &[u8]) -> Result<(), ValueError> {
        parse_list(self, text, |t| {
            text::parse_f64(t).ok_or(ValueError::Not("a list of numbers"))
        })
    }
    fn to_wire(&self) -> impl Serialize {
        self
    }
    fn from_wire(wire: Vec<f64>) -> Vec<f64> {
        wire
    }
    fn items(&self) -> Option<usize> {
        Some(self.len())
    }
}

impl Value for Vec<f32> {
    const ROS_TYPE: &'static str = "float32[]";
    type Wire = Vec<f32>;
    fn is_missing(&self) -> bool {
        self.is_empty()
    }
    fn push_text(&self, out: &mut Vec<u8>) {
        push_list(out, self, |out, v| {
            // Remissions are mostly whole digits, for which the float printer is the slow way.
            let whole = *v as u32;
            if whole < 100_000 && whole as f32 == *v {
                text::push_five_digits(out, whole);
            } else {
                text::push_f32(out, *v);
            }
        });
    }
    fn parse_text(&mut self, text: &[u8]) -> Result<(), ValueError> {
        let whole = |number| number as f32;
        parse_mostly_whole(self, text, whole, |t| {
            let value = std::str::from_utf8(t)
                .ok()
                .and_then(|t| t.parse::<f32>().ok());
            value.ok_or(ValueError::Not("a list of numbers"))
        })
    }
    fn to_wire(&self) -> impl Serialize {
        self
    }
    fn from_wire(wire: Vec<f32>) -> Vec<f32> {
        wire
    }
    fn items(&self) -> Option<usize> {
        Some(self.len())
    }
}

impl Value for Vec<i64> {
    const ROS_TYPE: &'static str = "int64[]";
    type Wire = Vec<i64>;
    fn is_missing(&self) -> bool {
        self.is_empty()
    }
    fn push_text(&self, out: &mut Vec<u8>) {
        push_list(out, self, |out, v| text::push_int(out, *v));
    }
    fn parse_text(&mut self, text: &[u8]) -> Result<(), ValueError> {
        parse_list(self, text, parse_int)
    }
    fn to_wire(&self) -> impl Serialize {
        self
    }
    fn from_wire(wire: Vec<i64>) -> Vec<i64> {
        wire
    }
    fn items(&self) -> Option<usize> {
        Some(self.len())
    }
}

impl Value for String {
    const ROS_TYPE: &'static str = "string";
    type Wire = String;
    fn is_missing(&self) -> bool {
        self.is_empty()
    }
    fn push_text(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(self.as_bytes());
    }
    fn parse_text(&mut self, text: &[u8]) -> Result<(), ValueError> {
        *self = std::str::from_utf8(text)
            .map_err(|_| ValueError::Not("UTF-8 text"))?
            .to_owned();
        Ok(())
    }
    fn to_wire(&self) -> impl Serialize {
        self
    }
    fn from_wire(wire: String) -> String {
        wire
    }
}

pub(super) fn parse_int(text: &[u8]) -> Result<i64, ValueError> {
    if text.is_empty() {
        return Err(ValueError::Empty);
    }
    let value = std::str::from_utf8(text).ok().and_then(|t| t.parse().ok());
    value.ok_or(ValueError::Not("a whole number"))
}

pub(super) fn push_list<T>(out: &mut Vec<u8>, list: &[T], mut push: impl FnMut(&mut Vec<u8>, &T)) {
    for (i, item) in list.iter().enumerate() {
        if i > 0 {
            out.push(b' ');
        }
        push(out, item);
    }
}

/// Like [`parse_list`] for numbers that are mostly whole, as ranges and remissions are: those of up
/// to nine digits are read digit by digit on the way, and only others are cut out and parsed.
pub(super) fn parse_mostly_whole<T>(
    list: &mut Vec<T>,
    text: &[u8],
    whole: impl Fn(u32) -> T,
    mut parse: impl FnMut(&[u8]) -> Result<T, ValueError>,
) -> Result<(), ValueError> {
    list.clear();
    let mut rest = text;
    while !rest.is_empty() {
        let (number, digits) = text::leading_whole(rest);
        let length = match rest.get(digits) {
            None | Some(b' ') if digits > 0 => {
                list.push(whole(number));
                digits
            }
            _ => {
                let length = rest.iter().position(|b| *b == b' ').unwrap_or(rest.len());
                list.push(parse(&rest[..length])?);
                length
            }
        };
        match rest.get(length + 1..) {
            // A space at the end has an item behind it that is not there.
            Some([]) => return parse(&[]).map(|item| list.push(item)),
            Some(behind) => rest = behind,
            None => return Ok(()),
        }
    }
    Ok(())
}

pub(super) fn parse_list<T>(
    list: &mut Vec<T>,
    text: &[u8],
    mut parse: impl FnMut(&[u8]) -> Result<T, ValueError>,
) -> Result<(), ValueError> {
    list.clear();
    if text.is_empty() {
        return Ok(());
    }
    for item in text.split(|b| *b == b' ') {
        list.push(parse(item)?);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_numbers_are_read_like_others() {
        let texts = [
            "",
            "7",
            "7 8",
            "7 8 ",
            " 7",
            "7  8",
            "7 x",
            "7x 8",
            "1.5 2 -3",
            "2 inf 3",
            "nan 4 5",
            "999999999 1234567890 12345678901234",
            "0007 8",
            "+7 8",
            "1e3 4",
            "-0 5",
            "\u{e9} 1",
        ];
        for text in texts {
            let (mut fast, mut slow) = (Vec::new(), Vec::new());
            let number = |t: &[u8]| {
                let value = std::str::from_utf8(t)
                    .ok()
                    .and_then(|t| t.parse::<f64>().ok());
                value.ok_or(ValueError::Not("a number"))
            };
            let found = parse_mostly_whole(&mut fast, text.as_bytes(), f64::from, number);
            let wanted = parse_list(&mut slow, text.as_bytes(), number);
            assert_eq!(found, wanted, "{text:?}");
            if found.is_ok() {
                assert_eq!(format!("{fast:?}"), format!("{slow:?}"), "{text:?}");
            }
        }
    }
}
