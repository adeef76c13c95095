//! One command and its answer, in either dialect.

use crate::link::HostInstant;
use crate::sick::cola::{self, Dialect, Telegram};
use crate::sick::fields::{BinaryFields, Fields, TextFields};
use crate::sick::scandata::FieldError;
use std::fmt;

/// What is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verb {
    /// `sRN`: a variable's value.
    Read,
    /// `sWN`: a variable is to be set.
    Write,
    /// `sMN`: a method is to be called.
    Method,
    /// `sEN`: an event is to be sent from now on, or no more.
    Event,
}

impl Verb {
    /// The verb of the request.
    pub fn request(self) -> &'static str {
        match self {
            Verb::Read => "sRN",
            Verb::Write => "sWN",
            Verb::Method => "sMN",
            Verb::Event => "sEN",
        }
    }

    /// The verb of the answer.
    pub fn answer(self) -> &'static str {
        match self {
            Verb::Read => "sRA",
            Verb::Write => "sWA",
            Verb::Method => "sAN",
            Verb::Event => "sEA",
        }
    }
}

/// An argument with its type on the wire.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// One byte.
    U8(u8),
    /// One byte that CoLa A writes with two digits, as the listing does.
    Byte(u8),
    /// Two bytes.
    U16(u16),
    /// Four bytes.
    U32(u32),
    /// Four bytes that CoLa A writes with eight digits: a password's hash.
    Hash(u32),
    /// Two bytes with a sign.
    I16(i16),
    /// Four bytes with a sign.
    I32(i32),
    /// One byte, 0 or 1.
    Bool(bool),
}

impl Value {
    /// In CoLa A a token; a sign makes it decimal, none means hexadecimal.
    fn write_text(&self, out: &mut String) {
        use fmt::Write;
        // Writing to a string does not fail.
        let _ = match self {
            Value::U8(value) => write!(out, "{value:X}"),
            Value::Byte(value) => write!(out, "{value:02X}"),
            Value::U16(value) => write!(out, "{value:X}"),
            Value::U32(value) => write!(out, "{value:X}"),
            Value::Hash(value) => write!(out, "{value:08X}"),
            Value::I16(value) => write!(out, "{value:+}"),
            Value::I32(value) => write!(out, "{value:+}"),
            Value::Bool(value) => write!(out, "{}", u8::from(*value)),
        };
    }

    /// In CoLa B packed, big-endian.
    fn write_binary(&self, out: &mut Vec<u8>) {
        match self {
            Value::U8(value) | Value::Byte(value) => out.push(*value),
            Value::U16(value) => out.extend_from_slice(&value.to_be_bytes()),
            Value::U32(value) | Value::Hash(value) => out.extend_from_slice(&value.to_be_bytes()),
            Value::I16(value) => out.extend_from_slice(&value.to_be_bytes()),
            Value::I32(value) => out.extend_from_slice(&value.to_be_bytes()),
            Value::Bool(value) => out.push(u8::from(*value)),
        }
    }
}

/// A command to a device.
#[derive(Clone, Debug, PartialEq)]
pub struct Request {
    verb: Verb,
    name: String,
    arguments: Vec<Value>,
}

impl Request {
    fn new(verb: Verb, name: &str, arguments: Vec<Value>) -> Request {
        Request {
            verb,
            name: name.to_owned(),
            arguments,
        }
    }

    /// Reads a variable.
    pub fn read(name: &str) -> Request {
        Request::new(Verb::Read, name, Vec::new())
    }

    /// Sets a variable.
    pub fn write(name: &str, arguments: Vec<Value>) -> Request {
        Request::new(Verb::Write, name, arguments)
    }

    /// Calls a method.
    pub fn method(name: &str, arguments: Vec<Value>) -> Request {
        Request::new(Verb::Method, name, arguments)
    }

    /// Switches an event on or off.
    pub fn event(name: &str, on: bool) -> Request {
        Request::new(Verb::Event, name, vec![Value::Bool(on)])
    }

    /// The verb.
    pub fn verb(&self) -> Verb {
        self.verb
    }

    /// The variable, method or event.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Appends the request in its frame.
    pub fn encode(&self, dialect: Dialect, out: &mut Vec<u8>) {
        let body = match dialect {
            Dialect::Text => self.text(|value, text| value.write_text(text)).into_bytes(),
            Dialect::Binary => {
                let mut body = format!("{} {}", self.verb.request(), self.name).into_bytes();
                if !self.arguments.is_empty() {
                    body.push(b' ');
                }
                for argument in &self.arguments {
                    argument.write_binary(&mut body);
                }
                body
            }
        };
        cola::frame(dialect, &body, out);
    }

    /// As CoLa A has it, without the frame; `write` says how an argument is written.
    fn text(&self, write: impl Fn(&Value, &mut String)) -> String {
        let mut text = format!("{} {}", self.verb.request(), self.name);
        for argument in &self.arguments {
            text.push(' ');
            write(argument, &mut text);
        }
        text
    }

    /// Whether `telegram` is the answer to this request; a refusal names no request and is none.
    pub fn is_answered_by(&self, telegram: &Telegram) -> bool {
        telegram.verb() == self.verb.answer().as_bytes() && telegram.name() == self.name.as_bytes()
    }
}

/// For people: as CoLa A writes it, without the frame and without a password's hash.
impl fmt::Display for Request {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text(|value, text| match value {
            Value::Hash(_) => text.push_str("(hash of the password)"),
            value => value.write_text(text),
        }))
    }
}

/// The answer to a request, and when it went to and fro.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reply {
    /// Its dialect.
    pub dialect: Dialect,
    /// Offset of its first byte in the connection's stream.
    pub offset: u64,
    /// What its frame holds, from the verb on.
    pub body: Vec<u8>,
    /// The host's time before the request was written.
    pub sent: HostInstant,
    /// The host's time when the answer's first byte was there.
    pub first: HostInstant,
    /// The host's time when its last byte was there.
    pub received: HostInstant,
}

impl Reply {
    /// The reply as a telegram.
    pub fn telegram(&self) -> Telegram<'_> {
        Telegram {
            dialect: self.dialect,
            offset: self.offset,
            body: &self.body,
        }
    }

    /// The values after the name.
    pub fn values(&self) -> Values<'_> {
        Values::of(&self.telegram())
    }
}

/// The values of an answer, one after the other. Each method names the field, for the error.
#[derive(Clone, Copy, Debug)]
pub struct Values<'a>(Which<'a>);

#[derive(Clone, Copy, Debug)]
enum Which<'a> {
    Text(TextFields<'a>),
    Binary(BinaryFields<'a>),
}

macro_rules! number {
    ($(#[$meta:meta] $name:ident: $type:ty;)*) => {$(
        #[$meta]
        pub fn $name(&mut self, field: &'static str) -> Result<$type, FieldError> {
            match &mut self.0 {
                Which::Text(fields) => fields.$name(field),
                Which::Binary(fields) => fields.$name(field),
            }
        }
    )*};
}

impl<'a> Values<'a> {
    /// The values that follow a telegram's name.
    pub fn of(telegram: &Telegram<'a>) -> Values<'a> {
        Values(match telegram.dialect {
            Dialect::Text => Which::Text(TextFields(telegram.arguments())),
            Dialect::Binary => Which::Binary(BinaryFields(telegram.arguments())),
        })
    }

    number! {
        /// One byte.
        u8: u8;
        /// Two bytes.
        u16: u16;
        /// Four bytes.
        u32: u32;
        /// Four bytes with a sign.
        i32: i32;
        /// IEEE 754.
        real: f32;
    }

    /// Two bytes with a sign.
    pub fn i16(&mut self, field: &'static str) -> Result<i16, FieldError> {
        match &mut self.0 {
            Which::Text(fields) => Ok(fields.i32(field)? as i16),
            Which::Binary(fields) => Ok(fields.u16(field)?.cast_signed()),
        }
    }

    /// One byte, of which 0 is no.
    pub fn bool(&mut self, field: &'static str) -> Result<bool, FieldError> {
        Ok(self.u8(field)? != 0)
    }

    /// A length and that many characters, one char a byte, freed of blanks at its ends.
    pub fn text(&mut self, field: &'static str) -> Result<String, FieldError> {
        let length = self.u16(field)?.into();
        let chars = match &mut self.0 {
            Which::Text(fields) => fields.chars(length, field),
            Which::Binary(fields) => fields.chars(length, field),
        }?;
        let text: String = chars.iter().map(|byte| char::from(*byte)).collect();
        Ok(text.trim().to_owned())
    }

    /// Bytes (CoLa B) or characters with their blanks (CoLa A) not yet read.
    pub fn remaining(&self) -> usize {
        match &self.0 {
            Which::Text(fields) => fields.remaining(),
            Which::Binary(fields) => fields.remaining(),
        }
    }

    /// How many values are left: tokens in CoLa A, bytes in CoLa B.
    pub(super) fn left(&self) -> usize {
        match &self.0 {
            Which::Text(fields) => {
                let tokens = fields.0.split(|byte| *byte == b' ');
                tokens.filter(|token| !token.is_empty()).count()
            }
            Which::Binary(fields) => fields.remaining(),
        }
    }
}

/// Why a device refused a request: the code of an `sFA`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Refusal(pub u16);

impl Refusal {
    /// The device knows no such command, variable, method or event.
    pub fn is_unknown_command(self) -> bool {
        matches!(self.0, 2 | 3 | 0xB | 0xC | 0xF)
    }

    /// Reads the code after `sFA`; none for anything else.
    pub fn of(telegram: &Telegram) -> Option<Refusal> {
        if telegram.verb() != b"sFA" {
            return None;
        }
        let rest = telegram.body.get(3..).unwrap_or_default();
        let code = match (telegram.dialect, rest) {
            // The listing's example has a blank, recorded devices have none.
            (Dialect::Binary, [high, low] | [b' ', high, low]) => u16::from_be_bytes([*high, *low]),
            (Dialect::Binary, _) => 6,
            (Dialect::Text, _) => Values::of(telegram).u16("code").unwrap_or(6),
        };
        Some(Refusal(code))
    }

    /// What the code means and what can be done.
    fn words(self) -> (&'static str, &'static str) {
        const LOGIN: &str = "log in with a higher level: --configure does, check the password";
        const FIRMWARE: &str = "this firmware does not know it: leave that option out";
        const RANGE: &str = "a value is not allowed in the present state or out of range";
        const OURS: &str = "the telegram does not fit this firmware: please report it";
        match self.0 {
            0x1 => ("wrong user level for this method", LOGIN),
            0x2 => ("unknown method", FIRMWARE),
            0x3 => ("unknown variable", FIRMWARE),
            0x4 => ("local condition failed", RANGE),
            0x5 => ("invalid data", RANGE),
            0x6 => ("unknown error", "try again, then restart the device"),
            0x7 => ("buffer overflow: the answer is too long", "ask for less"),
            0x8 => ("buffer underflow: more data expected", OURS),
            0x9 => ("unknown type", OURS),
            0xA => ("write access denied", LOGIN),
            0xB => ("unknown command for the name server", FIRMWARE),
            0xC => ("unknown command", FIRMWARE),
            0xD => (
                "busy",
                "another program talks to the device: end it, or wait",
            ),
            0xE => ("array out of bounds", OURS),
            0xF => ("unknown event", FIRMWARE),
            0x10 => ("value too large for its type", OURS),
            0x11 => (
                "invalid character",
                "the device speaks the other dialect of CoLa on this port",
            ),
            0x12 | 0x13 => ("no message or no answer inside the device", "restart it"),
            0x14 => ("internal error of the device", "restart it"),
            0x15..=0x18 => ("hub address", "talk to the device directly"),
            0x19 => ("asynchronous methods are suppressed", "wait and try again"),
            0x1A | 0x20 => ("complex arrays are not supported", FIRMWARE),
            _ => ("no documented code", "look it up in the telegram listing"),
        }
    }
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (what, advice) = self.words();
        write!(f, "refused with sFA {:X}, {what} ({advice})", self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sick::cola::{Event, Framer};

    fn encoded(request: &Request, dialect: Dialect) -> Vec<u8> {
        let mut out = Vec::new();
        request.encode(dialect, &mut out);
        out
    }

    fn reply(dialect: Dialect, body: &[u8]) -> Reply {
        Reply {
            dialect,
            offset: 0,
            body: body.to_vec(),
            sent: HostInstant::default(),
            first: HostInstant::default(),
            received: HostInstant::default(),
        }
    }

    /// As a recorded host sent them to an LMS511.
    #[test]
    fn requests_of_a_recorded_session_to_the_byte() {
        use Value::*;
        let login = Request::method("SetAccessMode", vec![Byte(3), Hash(0xF472_4744)]);
        assert_eq!(
            encoded(&login, Dialect::Binary),
            b"\x02\x02\x02\x02\0\0\0\x17sMN SetAccessMode \x03\xf4\x72\x47\x44\xb3"
        );
        assert_eq!(
            encoded(&login, Dialect::Text),
            b"\x02sMN SetAccessMode 03 F4724744\x03"
        );
        assert_eq!(
            login.to_string(),
            "sMN SetAccessMode 03 (hash of the password)"
        );
        let firmware = Request::read("FirmwareVersion");
        assert_eq!(
            encoded(&firmware, Dialect::Binary),
            b"\x02\x02\x02\x02\0\0\0\x13sRN FirmwareVersion\x24"
        );
        let range = vec![I16(1), U32(1667), I32(-50_000), I32(1_850_000)];
        let range = Request::write("LMPoutputRange", range);
        assert_eq!(
            encoded(&range, Dialect::Binary),
            b"\x02\x02\x02\x02\0\0\0\x21sWN LMPoutputRange \0\x01\0\0\x06\x83\xff\xff\x3c\xb0\0\x1c\x3a\x90\xc5"
        );
        assert_eq!(
            range.to_string(),
            "sWN LMPoutputRange +1 683 -50000 +1850000"
        );
    }

    #[test]
    fn values_come_back_in_both_dialects() {
        let text = reply(
            Dialect::Text,
            b"sRA X 7 FFFF3CB0 B SN 18220118 3F800000 1 FFFF",
        );
        let mut values = text.values();
        assert_eq!(values.u16("a"), Ok(7));
        assert_eq!(values.i32("b"), Ok(-50_000));
        assert_eq!(values.text("c").unwrap(), "SN 18220118");
        assert_eq!(values.real("d"), Ok(1.0));
        assert_eq!(values.left(), 2);
        assert_eq!(values.bool("e"), Ok(true));
        assert_eq!(values.i16("f"), Ok(-1));
        assert!(values.u8("g").is_err());

        let binary = reply(Dialect::Binary, b"sRA X \x07\0\x09V1.80    \xff\xfe");
        let mut values = binary.values();
        assert_eq!(values.u8("a"), Ok(7));
        assert_eq!(values.text("b").unwrap(), "V1.80");
        assert_eq!(values.i16("c"), Ok(-2));
        assert_eq!(values.remaining(), 0);
    }

    #[test]
    fn refusals_have_words() {
        let code = |stream: &[u8]| {
            let mut framer = Framer::new();
            framer.feed(stream);
            framer.end();
            let Some(Event::Telegram(telegram)) = framer.next() else {
                panic!("no telegram");
            };
            Refusal::of(&telegram)
        };
        assert_eq!(code(b"\x02sFA A\x03"), Some(Refusal(10)));
        assert_eq!(code(b"\x02sFA 1A\x03"), Some(Refusal(26)));
        let mut framed = Vec::new();
        cola::frame(Dialect::Binary, b"sFA\x00\x0A", &mut framed);
        assert_eq!(code(&framed), Some(Refusal(10)));
        assert_eq!(code(b"\x02sRA X\x03"), None);
        for refusal in (0..=0x20).map(Refusal) {
            let text = refusal.to_string();
            assert!(text.contains("sFA"), "{text}");
        }
        assert!(Refusal(3).is_unknown_command() && !Refusal(10).is_unknown_command());
    }
}
