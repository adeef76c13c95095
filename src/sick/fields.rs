//! The values of a telegram one after the other, the same for both dialects.

use super::scandata::{FieldError, Problem};

/// Width of a channel's values in CoLa B. In CoLa A a value is hexadecimal text of any length.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Width {
    /// One byte a value.
    Bits8,
    /// Two bytes a value.
    #[default]
    Bits16,
}

/// Reads the values of a telegram in their order. Each method names the field, for the error.
pub trait Fields<'a> {
    fn u8(&mut self, field: &'static str) -> Result<u8, FieldError>;
    fn u16(&mut self, field: &'static str) -> Result<u16, FieldError>;
    fn u32(&mut self, field: &'static str) -> Result<u32, FieldError>;
    fn i32(&mut self, field: &'static str) -> Result<i32, FieldError>;
    fn real(&mut self, field: &'static str) -> Result<f32, FieldError>;
    /// Exactly `count` characters.
    fn chars(&mut self, count: usize, field: &'static str) -> Result<&'a [u8], FieldError>;
    /// `count` values; `out` is emptied first.
    fn values(
        &mut self,
        width: Width,
        count: u16,
        field: &'static str,
        out: &mut Vec<u16>,
    ) -> Result<(), FieldError>;
    /// Bytes not yet read.
    fn remaining(&self) -> usize;
}

fn fault(field: &'static str, problem: Problem) -> FieldError {
    FieldError { field, problem }
}

/// CoLa B: packed, big-endian.
#[derive(Clone, Copy, Debug)]
pub struct BinaryFields<'a>(pub &'a [u8]);

impl<'a> BinaryFields<'a> {
    fn take<const N: usize>(&mut self, field: &'static str) -> Result<[u8; N], FieldError> {
        let (bytes, rest) = self
            .0
            .split_first_chunk::<N>()
            .ok_or(fault(field, Problem::Missing))?;
        self.0 = rest;
        Ok(*bytes)
    }

    fn take_slice(&mut self, count: usize, field: &'static str) -> Result<&'a [u8], FieldError> {
        let (bytes, rest) = self
            .0
            .split_at_checked(count)
            .ok_or(fault(field, Problem::Missing))?;
        self.0 = rest;
        Ok(bytes)
    }
}

impl<'a> Fields<'a> for BinaryFields<'a> {
    fn u8(&mut self, field: &'static str) -> Result<u8, FieldError> {
        self.take(field).map(u8::from_be_bytes)
    }
    fn u16(&mut self, field: &'static str) -> Result<u16, FieldError> {
        self.take(field).map(u16::from_be_bytes)
    }
    fn u32(&mut self, field: &'static str) -> Result<u32, FieldError> {
        self.take(field).map(u32::from_be_bytes)
    }
    fn i32(&mut self, field: &'static str) -> Result<i32, FieldError> {
        self.take(field).map(i32::from_be_bytes)
    }
    fn real(&mut self, field: &'static str) -> Result<f32, FieldError> {
        self.take(field).map(f32::from_be_bytes)
    }
    fn chars(&mut self, count: usize, field: &'static str) -> Result<&'a [u8], FieldError> {
        self.take_slice(count, field)
    }
    fn values(
        &mut self,
        width: Width,
        count: u16,
        field: &'static str,
        out: &mut Vec<u16>,
    ) -> Result<(), FieldError> {
        out.clear();
        let count = usize::from(count);
        match width {
            Width::Bits8 => {
                let bytes = self.take_slice(count, field)?;
                out.extend(bytes.iter().map(|byte| u16::from(*byte)));
            }
            Width::Bits16 => {
                let (pairs, _) = self.take_slice(2 * count, field)?.as_chunks::<2>();
                out.extend(pairs.iter().map(|pair| u16::from_be_bytes(*pair)));
            }
        }
        Ok(())
    }
    fn remaining(&self) -> usize {
        self.0.len()
    }
}

/// CoLa A: hexadecimal tokens, each after a blank. A sign makes a token decimal.
#[derive(Clone, Copy, Debug)]
pub struct TextFields<'a>(pub &'a [u8]);

/// A hexadecimal digit's value; anything else is 16 or more.
const HEX: [u8; 256] = {
    let mut table = [0xFF; 256];
    let digits = b"0123456789ABCDEF";
    let mut value = 0;
    while value < digits.len() {
        table[digits[value] as usize] = value as u8;
        table[digits[value].to_ascii_lowercase() as usize] = value as u8;
        value += 1;
    }
    table
};

impl<'a> TextFields<'a> {
    /// The next token; whole tokens only, so not for strings, which may hold blanks.
    fn token(&mut self, field: &'static str) -> Result<&'a [u8], FieldError> {
        let start = self.0.iter().take_while(|byte| **byte == b' ').count();
        let rest = self.0.get(start..).unwrap_or_default();
        if start == 0 || rest.is_empty() {
            return Err(fault(field, Problem::Missing));
        }
        let length = rest.iter().take_while(|byte| **byte != b' ').count();
        let (token, rest) = rest.split_at(length);
        self.0 = rest;
        Ok(token)
    }

    fn number(&mut self, max: u32, field: &'static str) -> Result<u32, FieldError> {
        let token = self.token(field)?;
        let value = match token {
            [b'+', digits @ ..] => decimal(digits),
            _ => hexadecimal(token),
        };
        let value = value.ok_or(fault(field, Problem::NotANumber))?;
        if value > max {
            return Err(fault(field, Problem::TooLarge));
        }
        Ok(value)
    }
}

fn decimal(digits: &[u8]) -> Option<u32> {
    let are_digits = digits.iter().all(u8::is_ascii_digit);
    let text = std::str::from_utf8(digits).ok().filter(|_| are_digits)?;
    text.parse().ok()
}

fn hexadecimal(digits: &[u8]) -> Option<u32> {
    if digits.is_empty() || digits.len() > 8 {
        return None;
    }
    digits.iter().try_fold(0u32, |value, digit| {
        let digit = HEX[usize::from(*digit)];
        (digit < 16).then_some(value << 4 | u32::from(digit))
    })
}

impl<'a> Fields<'a> for TextFields<'a> {
    fn u8(&mut self, field: &'static str) -> Result<u8, FieldError> {
        Ok(self.number(u8::MAX.into(), field)? as u8)
    }
    fn u16(&mut self, field: &'static str) -> Result<u16, FieldError> {
        Ok(self.number(u16::MAX.into(), field)? as u16)
    }
    fn u32(&mut self, field: &'static str) -> Result<u32, FieldError> {
        self.number(u32::MAX, field)
    }
    /// Two's complement of 32 bits, or decimal with its sign.
    fn i32(&mut self, field: &'static str) -> Result<i32, FieldError> {
        let mut ahead = *self;
        let value = match ahead.token(field)? {
            [b'-', digits @ ..] => decimal(digits).map(|value| -i64::from(value)),
            [b'+', digits @ ..] => decimal(digits).map(i64::from),
            _ => return Ok(self.number(u32::MAX, field)?.cast_signed()),
        };
        *self = ahead;
        let value = value.ok_or(fault(field, Problem::NotANumber))?;
        i32::try_from(value).map_err(|_| fault(field, Problem::TooLarge))
    }
    fn real(&mut self, field: &'static str) -> Result<f32, FieldError> {
        Ok(f32::from_bits(self.number(u32::MAX, field)?))
    }
    fn chars(&mut self, count: usize, field: &'static str) -> Result<&'a [u8], FieldError> {
        let missing = fault(field, Problem::Missing);
        if count == 0 {
            return Ok(&[]);
        }
        let rest = self.0.strip_prefix(b" ").ok_or(missing)?;
        let (chars, rest) = rest.split_at_checked(count).ok_or(missing)?;
        if !matches!(rest, [] | [b' ', ..]) {
            return Err(fault(field, Problem::WrongLength));
        }
        self.0 = rest;
        Ok(chars)
    }
    /// One pass over the digits: this is where decoding CoLa A spends its time.
    fn values(
        &mut self,
        _width: Width,
        count: u16,
        field: &'static str,
        out: &mut Vec<u16>,
    ) -> Result<(), FieldError> {
        out.clear();
        let mut rest = self.0;
        for _ in 0..count {
            let [b' ', first, after @ ..] = rest else {
                return Err(fault(field, Problem::Missing));
            };
            let mut value = u32::from(HEX[usize::from(*first)]);
            if value > 15 {
                return Err(fault(field, Problem::NotANumber));
            }
            rest = after;
            while let [digit, after @ ..] = rest
                && *digit != b' '
            {
                let digit = HEX[usize::from(*digit)];
                if digit > 15 {
                    return Err(fault(field, Problem::NotANumber));
                }
                value = value << 4 | u32::from(digit);
                if value > u32::from(u16::MAX) {
                    return Err(fault(field, Problem::TooLarge));
                }
                rest = after;
            }
            out.push(value as u16);
        }
        self.0 = rest;
        Ok(())
    }
    fn remaining(&self) -> usize {
        self.0.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_numbers() {
        let mut fields = TextFields(b" 0 FF FFFF3CB0 -50000 +1667 3F800000 1FF");
        assert_eq!(fields.u8("a"), Ok(0));
        assert_eq!(fields.u8("b"), Ok(255));
        assert_eq!(fields.i32("c"), Ok(-50_000));
        assert_eq!(fields.i32("d"), Ok(-50_000));
        assert_eq!(fields.u16("e"), Ok(1667));
        assert_eq!(fields.real("f"), Ok(1.0));
        assert_eq!(fields.u8("g"), Err(fault("g", Problem::TooLarge)));
        assert_eq!(fields.u8("h"), Err(fault("h", Problem::Missing)));
        let signed = |text: &'static [u8]| TextFields(text).i32("s");
        assert_eq!(signed(b" -2147483648"), Ok(i32::MIN));
        assert_eq!(signed(b" +2147483647"), Ok(i32::MAX));
        let too_large = Err(fault("s", Problem::TooLarge));
        assert_eq!(signed(b" +3000000000"), too_large);
        let no_number = Err(fault("s", Problem::NotANumber));
        assert_eq!(signed(b" ++5"), no_number);
        assert_eq!(signed(b" -+5"), no_number);
        assert_eq!(
            TextFields(b" 1G").u32("i"),
            Err(fault("i", Problem::NotANumber))
        );
        assert_eq!(
            TextFields(b" 123456789").u32("j"),
            Err(fault("j", Problem::NotANumber))
        );
    }

    #[test]
    fn text_strings_hold_blanks() {
        let mut fields = TextFields(b" B SN 18220118 0 0  7");
        assert_eq!(fields.u16("length"), Ok(11));
        assert_eq!(fields.chars(11, "name"), Ok(&b"SN 18220118"[..]));
        assert_eq!(fields.u16("next"), Ok(0));
        assert_eq!(fields.u16("length"), Ok(0));
        assert_eq!(fields.chars(0, "empty"), Ok(&b""[..]));
        assert_eq!(fields.u16("after an empty string"), Ok(7));
        assert_eq!(
            TextFields(b" SN18").chars(2, "cut"),
            Err(fault("cut", Problem::WrongLength))
        );
    }

    #[test]
    fn values_of_both_dialects() {
        let mut out = vec![9];
        let mut text = TextFields(b" 0 FDE8 ff 1");
        assert_eq!(text.values(Width::Bits16, 3, "v", &mut out), Ok(()));
        assert_eq!(out, [0, 65_000, 255]);
        assert_eq!(text.remaining(), 2);
        assert!(text.values(Width::Bits16, 2, "v", &mut out).is_err());
        assert!(
            TextFields(b" 1FFFF")
                .values(Width::Bits16, 1, "v", &mut out)
                .is_err()
        );

        let mut binary = BinaryFields(&[0xFD, 0xE8, 0, 1, 7, 8]);
        assert_eq!(binary.values(Width::Bits16, 2, "v", &mut out), Ok(()));
        assert_eq!(out, [65_000, 1]);
        assert_eq!(binary.values(Width::Bits8, 2, "v", &mut out), Ok(()));
        assert_eq!(out, [7, 8]);
        assert_eq!(
            binary.values(Width::Bits8, 1, "v", &mut out),
            Err(fault("v", Problem::Missing))
        );
    }
}
