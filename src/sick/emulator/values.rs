//! Values of commands in either dialect: read from a request, written into a reply.

use crate::sick::cola::Dialect;
use crate::sick::encode::{BinarySink, Sink, TextSink};

/// Why the device refuses (`sFA`): the codes of the telegram listing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u16)]
pub enum Refusal {
    /// The user level does not allow this method.
    UserLevel = 0x1,
    /// No such method.
    UnknownMethod = 0x2,
    /// No such variable.
    UnknownVariable = 0x3,
    /// A value out of its range, or not now.
    Condition = 0x4,
    /// More than was expected.
    InvalidData = 0x5,
    /// Less than was expected.
    Underflow = 0x8,
    /// The user level does not allow writing.
    WriteAccess = 0xA,
    /// No command of the protocol.
    UnknownCommand = 0xC,
    /// No such event.
    UnknownEvent = 0xF,
    /// CoLa A: a number that its type cannot hold.
    TextOverflow = 0x10,
    /// CoLa A: a character that cannot be.
    TextCharacter = 0x11,
}

/// A parameter's type and range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// An unsigned number of so many bytes, from and to.
    Unsigned(usize, u32, u32),
    /// A signed number of so many bytes, from and to.
    Signed(usize, i32, i32),
    /// IEEE 754, 4 bytes; not below 0.
    Real,
    /// A string of at most so many characters.
    Text(usize),
}

/// A parameter's value.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// See [`Kind::Unsigned`].
    Unsigned(usize, u32),
    /// See [`Kind::Signed`].
    Signed(usize, i32),
    /// See [`Kind::Real`].
    Real(f32),
    /// See [`Kind::Text`].
    Text(String),
}

impl Value {
    /// One byte.
    pub fn byte(value: u8) -> Value {
        Value::Unsigned(1, value.into())
    }

    /// The number; 0 for a text.
    pub fn number(&self) -> i64 {
        match self {
            Value::Unsigned(_, value) => i64::from(*value),
            Value::Signed(_, value) => i64::from(*value),
            Value::Real(value) => *value as i64,
            Value::Text(_) => 0,
        }
    }
}

/// Reads a request's parameters one after the other.
pub struct Request<'a> {
    dialect: Dialect,
    rest: &'a [u8],
}

impl<'a> Request<'a> {
    /// The parameters after a command's name.
    pub fn new(dialect: Dialect, arguments: &'a [u8]) -> Request<'a> {
        Request {
            dialect,
            rest: arguments,
        }
    }

    /// The next value.
    pub fn value(&mut self, kind: Kind) -> Result<Value, Refusal> {
        match kind {
            Kind::Unsigned(bytes, from, to) => {
                let value = self.unsigned(bytes)?;
                let fits = (from..=to).contains(&value);
                fits.then_some(Value::Unsigned(bytes, value))
                    .ok_or(Refusal::Condition)
            }
            Kind::Signed(bytes, from, to) => {
                let value = self.signed(bytes)?;
                let fits = (from..=to).contains(&value);
                fits.then_some(Value::Signed(bytes, value))
                    .ok_or(Refusal::Condition)
            }
            Kind::Real => {
                let value = f32::from_bits(self.real_bits()?);
                let fits = value.is_finite() && value >= 0.0;
                fits.then_some(Value::Real(value)).ok_or(Refusal::Condition)
            }
            Kind::Text(most) => {
                let text = self.text()?;
                let fits = text.len() <= most;
                fits.then_some(Value::Text(text)).ok_or(Refusal::Condition)
            }
        }
    }

    /// The next unsigned number of so many bytes.
    pub fn unsigned(&mut self, bytes: usize) -> Result<u32, Refusal> {
        match self.dialect {
            Dialect::Binary => self.packed(bytes),
            Dialect::Text => {
                let largest = i64::from(u32::MAX >> (32 - 8 * bytes as u32));
                let value = self.token_number()?;
                let fits = (0..=largest).contains(&value);
                let value = u32::try_from(value).ok().filter(|_| fits);
                value.ok_or(Refusal::TextOverflow)
            }
        }
    }

    /// The next signed number of so many bytes.
    pub fn signed(&mut self, bytes: usize) -> Result<i32, Refusal> {
        let unused = 32 - 8 * bytes as u32;
        match self.dialect {
            Dialect::Binary => {
                let raw = self.packed(bytes)?;
                Ok((raw << unused).cast_signed() >> unused)
            }
            Dialect::Text => {
                let decimal = matches!(self.peek(), Some(b'+' | b'-'));
                let value = self.token_number()?;
                if decimal {
                    let least = i64::from(i32::MIN >> unused);
                    let fits = (least..=-1 - least).contains(&value);
                    let value = i32::try_from(value).ok().filter(|_| fits);
                    return value.ok_or(Refusal::TextOverflow);
                }
                let raw = u32::try_from(value).map_err(|_| Refusal::TextOverflow)?;
                // A short number is sent with the digits of its own width.
                if unused > 0 && raw >> (32 - unused) != 0 {
                    return Err(Refusal::TextOverflow);
                }
                Ok((raw << unused).cast_signed() >> unused)
            }
        }
    }

    fn real_bits(&mut self) -> Result<u32, Refusal> {
        match self.dialect {
            Dialect::Binary => self.packed(4),
            Dialect::Text => match self.peek() {
                Some(b'+' | b'-') => {
                    let token = self.token()?;
                    let text = str::from_utf8(token).map_err(|_| Refusal::TextCharacter)?;
                    let value: f32 = text.parse().map_err(|_| Refusal::TextCharacter)?;
                    Ok(value.to_bits())
                }
                _ => self.unsigned(4),
            },
        }
    }

    fn text(&mut self) -> Result<String, Refusal> {
        let length = self.unsigned(2)? as usize;
        if self.dialect == Dialect::Text && length > 0 {
            self.rest = self.rest.strip_prefix(b" ").ok_or(Refusal::Underflow)?;
        }
        let (text, rest) = self
            .rest
            .split_at_checked(length)
            .ok_or(Refusal::Underflow)?;
        self.rest = rest;
        Ok(text.iter().map(|byte| char::from(*byte)).collect())
    }

    /// Nothing more may follow.
    pub fn end(&self) -> Result<(), Refusal> {
        if self.rest.iter().all(|byte| *byte == b' ') {
            Ok(())
        } else {
            Err(Refusal::InvalidData)
        }
    }

    fn packed(&mut self, bytes: usize) -> Result<u32, Refusal> {
        let (value, rest) = self
            .rest
            .split_at_checked(bytes)
            .ok_or(Refusal::Underflow)?;
        self.rest = rest;
        Ok(value
            .iter()
            .fold(0, |sum, byte| sum << 8 | u32::from(*byte)))
    }

    fn peek(&self) -> Option<u8> {
        self.rest.iter().copied().find(|byte| *byte != b' ')
    }

    fn token(&mut self) -> Result<&'a [u8], Refusal> {
        let start = self.rest.iter().take_while(|byte| **byte == b' ').count();
        let token = self.rest.get(start..).unwrap_or_default();
        let end = token.iter().take_while(|byte| **byte != b' ').count();
        let (token, rest) = token.split_at_checked(end).unwrap_or_default();
        self.rest = rest;
        if token.is_empty() {
            return Err(Refusal::Underflow);
        }
        Ok(token)
    }

    /// A sign makes a number decimal; without one it is hexadecimal.
    fn token_number(&mut self) -> Result<i64, Refusal> {
        let token = self.token()?;
        let (digits, radix) = match token {
            [b'+', digits @ ..] => (digits, 10),
            [b'-', digits @ ..] => (digits, 10),
            digits => (digits, 16),
        };
        if digits.is_empty() {
            return Err(Refusal::TextCharacter);
        }
        let mut value = 0i64;
        for digit in digits {
            let digit = char::from(*digit)
                .to_digit(radix)
                .ok_or(Refusal::TextCharacter)?;
            value = value * i64::from(radix) + i64::from(digit);
            if value > i64::from(u32::MAX) {
                return Err(Refusal::TextOverflow);
            }
        }
        Ok(if token.starts_with(b"-") {
            -value
        } else {
            value
        })
    }
}

/// Builds a reply's or an event's body: verb and name first, then the values.
pub struct Reply {
    dialect: Dialect,
    body: Vec<u8>,
}

impl Reply {
    /// `head` is verb, blank and name. In CoLa B a blank follows it even where nothing else does.
    pub fn new(dialect: Dialect, head: &str) -> Reply {
        let mut body = head.as_bytes().to_vec();
        if dialect == Dialect::Binary {
            body.push(b' ');
        }
        Reply { dialect, body }
    }

    /// An `sFA`: in CoLa B without a blank before the code.
    pub fn refusal(dialect: Dialect, refusal: Refusal) -> Reply {
        let reply = Reply {
            dialect,
            body: b"sFA".to_vec(),
        };
        let bytes = if dialect == Dialect::Binary { 2 } else { 1 };
        reply.unsigned(refusal as u32, bytes)
    }

    /// Appends an unsigned number of so many bytes.
    #[must_use]
    pub fn unsigned(mut self, value: u32, bytes: usize) -> Reply {
        match self.dialect {
            Dialect::Text => TextSink(&mut self.body).number(value, bytes),
            Dialect::Binary => BinarySink(&mut self.body).number(value, bytes),
        }
        self
    }

    /// Appends a string: its length, then its characters.
    #[must_use]
    pub fn text(self, text: &str) -> Reply {
        let bytes: Vec<u8> = text.chars().map(|char| char as u8).collect();
        let mut reply = self.unsigned(bytes.len() as u32, 2);
        match reply.dialect {
            Dialect::Text => TextSink(&mut reply.body).chars(&bytes),
            Dialect::Binary => BinarySink(&mut reply.body).chars(&bytes),
        }
        reply
    }

    /// Appends a value.
    #[must_use]
    pub fn value(mut self, value: &Value) -> Reply {
        match value {
            Value::Unsigned(bytes, value) => self.unsigned(*value, *bytes),
            Value::Signed(bytes, value) => {
                let unused = 32 - 8 * *bytes as u32;
                let raw = value.cast_unsigned() << unused >> unused;
                self.unsigned(raw, *bytes)
            }
            Value::Real(value) => {
                match self.dialect {
                    Dialect::Text => TextSink(&mut self.body).real(*value),
                    Dialect::Binary => BinarySink(&mut self.body).real(*value),
                }
                self
            }
            Value::Text(text) => self.text(text),
        }
    }

    /// Appends values.
    #[must_use]
    pub fn values<'a>(self, values: impl IntoIterator<Item = &'a Value>) -> Reply {
        values.into_iter().fold(self, Reply::value)
    }

    /// What goes into the frame.
    pub fn body(&self) -> &[u8] {
        &self.body
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_in_text() {
        let mut request = Request::new(
            Dialect::Text,
            b" +2500 +1 683 -50000 FFFF3CB0 B SN 20439907",
        );
        assert_eq!(request.unsigned(4), Ok(2500));
        assert_eq!(request.signed(2), Ok(1));
        assert_eq!(request.unsigned(4), Ok(0x683));
        assert_eq!(request.signed(4), Ok(-50_000));
        assert_eq!(request.signed(4), Ok(-50_000));
        assert_eq!(
            request.value(Kind::Text(16)),
            Ok(Value::Text("SN 20439907".into()))
        );
        assert_eq!(request.end(), Ok(()));
        assert_eq!(request.unsigned(1), Err(Refusal::Underflow));
        let refused = |text: &[u8], bytes| Request::new(Dialect::Text, text).unsigned(bytes);
        assert_eq!(refused(b" 100", 1), Err(Refusal::TextOverflow));
        assert_eq!(refused(b" FFFFFFFFFF", 4), Err(Refusal::TextOverflow));
        assert_eq!(refused(b" -1", 1), Err(Refusal::TextOverflow));
        assert_eq!(refused(b" x", 1), Err(Refusal::TextCharacter));
        assert_eq!(refused(b" +", 1), Err(Refusal::TextCharacter));
        assert_eq!(refused(b" ", 1), Err(Refusal::Underflow));
        let signed = |text: &[u8]| Request::new(Dialect::Text, text).signed(2);
        assert_eq!(signed(b" FFFF"), Ok(-1));
        assert_eq!(signed(b" 10000"), Err(Refusal::TextOverflow));
        assert_eq!(signed(b" +32768"), Err(Refusal::TextOverflow));
        assert_eq!(signed(b" -32768"), Ok(-32_768));
        let real = |text: &[u8]| Request::new(Dialect::Text, text).value(Kind::Real);
        assert_eq!(real(b" 3F800000"), Ok(Value::Real(1.0)));
        assert_eq!(real(b" +0.5"), Ok(Value::Real(0.5)));
        assert_eq!(real(b" 7FC00000"), Err(Refusal::Condition));
    }

    #[test]
    fn requests_packed() {
        let bytes = b"\x00\x00\x09\xc4\x00\x01\xff\xff\x3c\xb0\x00\x02ab\x01";
        let mut request = Request::new(Dialect::Binary, bytes);
        assert_eq!(request.unsigned(4), Ok(2500));
        assert_eq!(request.signed(2), Ok(1));
        assert_eq!(request.signed(4), Ok(-50_000));
        assert_eq!(request.value(Kind::Text(2)), Ok(Value::Text("ab".into())));
        assert_eq!(request.end(), Err(Refusal::InvalidData));
        assert_eq!(
            request.value(Kind::Unsigned(1, 0, 0)),
            Err(Refusal::Condition)
        );
        assert_eq!(request.unsigned(1), Err(Refusal::Underflow));
    }

    #[test]
    fn replies() {
        let values = [
            Value::byte(0),
            Value::Unsigned(4, 2500),
            Value::Signed(2, -1),
            Value::Signed(4, -50_000),
            Value::Real(1.0),
            Value::Text("SN 1".into()),
        ];
        let text = Reply::new(Dialect::Text, "sAN mX").values(&values);
        assert_eq!(text.body(), b"sAN mX 0 9C4 FFFF FFFF3CB0 3F800000 4 SN 1");
        let packed = Reply::new(Dialect::Binary, "sAN mX").values(&values);
        let due =
            b"sAN mX \x00\x00\x00\x09\xc4\xff\xff\xff\xff\x3c\xb0\x3f\x80\x00\x00\x00\x04SN 1";
        assert_eq!(packed.body(), due);
        assert_eq!(Reply::new(Dialect::Text, "sWA X").body(), b"sWA X");
        let refusal = |dialect| Reply::refusal(dialect, Refusal::WriteAccess);
        assert_eq!(refusal(Dialect::Text).body(), b"sFA A");
        assert_eq!(refusal(Dialect::Binary).body(), b"sFA\x00\x0a");
    }
}
