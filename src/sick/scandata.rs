//! LMDscandata, the telegram that carries a scan, every field as the device sent it.
//!
//! One description serves both dialects and both ways to ask (`sRA`, the reply to a poll, and
//! `sSN`, the event). Source: SICK telegram listing 8014631, checked against recorded telegrams of
//! LMS511, LMS5xx, LMS111.

use super::cola::{Dialect, Telegram};
use super::fields::{BinaryFields, Fields, TextFields};
use crate::record::{Encoder, Stamp};

pub use super::fields::Width;

/// Channels that one telegram may announce; five echoes with remissions need ten.
const MAX_CHANNELS: u16 = 32;
/// Encoders that one telegram may announce.
const MAX_ENCODERS: u16 = 3;
/// Events that one telegram may announce.
const MAX_EVENTS: u16 = 16;

/// Why a telegram that is framed well is not a scan.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{field}: {problem}")]
pub struct FieldError {
    /// The field, in the listing's words.
    pub field: &'static str,
    /// What is wrong with it.
    pub problem: Problem,
}

/// What can be wrong with a field.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Problem {
    /// The telegram ends before it.
    #[error("the telegram ends before it")]
    Missing,
    /// Not a number.
    #[error("not a number")]
    NotANumber,
    /// A number that the field cannot hold.
    #[error("too large")]
    TooLarge,
    /// A string whose announced length is wrong.
    #[error("the announced length is wrong")]
    WrongLength,
    /// A count or flag beyond what the telegram can have.
    #[error("{0} cannot be")]
    Unlikely(u32),
}

/// One channel: the distances or remissions of an echo.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Channel {
    /// `DIST1` .. `DIST5`, `RSSI1` .. `RSSI5` or another family's.
    pub name: [u8; 5],
    /// Width on the wire in CoLa B.
    pub width: Width,
    /// A value is raw * scale + offset: mm for a distance.
    pub scale: f32,
    /// See `scale`.
    pub offset: f32,
    /// Angle of the first value, 1e-4 deg, rounded.
    pub start_angle: i32,
    /// Angle from value to value, 1e-4 deg, rounded.
    pub angular_step: u16,
    /// Raw values.
    pub values: Vec<u16>,
}

/// The position block.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Position {
    /// x, y, z and the rotations about x, y, z.
    pub coordinates: [f32; 6],
    /// How the rotations are meant.
    pub rotation_type: u8,
}

/// The device's calendar time, which no time zone goes with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Calendar {
    /// Year, in full.
    pub year: u16,
    /// 1 to 12.
    pub month: u8,
    /// 1 to 31.
    pub day: u8,
    /// 0 to 23.
    pub hour: u8,
    /// 0 to 59.
    pub minute: u8,
    /// 0 to 59.
    pub second: u8,
    /// Microseconds; recorded devices count whole milliseconds.
    pub microsecond: u32,
}

impl Calendar {
    /// The instant, taking the device's clock for UTC; none for a date that is not in the calendar.
    pub fn stamp(&self) -> Option<Stamp> {
        const DAYS: [u8; 12] = [31, 29, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31];
        let days = *DAYS.get(usize::from(self.month).checked_sub(1)?)?;
        let sane = (1970..=2261).contains(&self.year)
            && (1..=days).contains(&self.day)
            && self.hour < 24
            && self.minute < 60
            && self.second < 61
            && self.microsecond < 1_000_000;
        if !sane {
            return None;
        }
        // Days since 1970 of the proleptic Gregorian calendar, years counted from March.
        let (year, month) = (i64::from(self.year), i64::from(self.month));
        let (year, month) = if month > 2 {
            (year, month - 3)
        } else {
            (year - 1, month + 9)
        };
        let day_of_year = (153 * month + 2) / 5 + i64::from(self.day) - 1;
        let days = 365 * year + year / 4 - year / 100 + year / 400 + day_of_year - 719_468;
        let seconds = (days * 24 + i64::from(self.hour)) * 3600
            + i64::from(self.minute) * 60
            + i64::from(self.second);
        Some(Stamp::from_ns(
            seconds * 1_000_000_000 + i64::from(self.microsecond) * 1000,
        ))
    }

    /// The date and time of an instant in the proleptic Gregorian calendar, cut to microseconds;
    /// none before 1970.
    pub fn at(stamp: Stamp) -> Option<Calendar> {
        let us = stamp.ns().div_euclid(1000);
        let (seconds, microsecond) = (us.div_euclid(1_000_000), us.rem_euclid(1_000_000));
        let (days, second) = (seconds.div_euclid(86_400), seconds.rem_euclid(86_400));
        // Days since 0000-03-01, so that a leap day is the last of its year; 400 years are 146 097
        // days.
        let days = days + 719_468;
        let (era, day) = (days.div_euclid(146_097), days.rem_euclid(146_097));
        let year = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
        let day = day - (365 * year + year / 4 - year / 100);
        let month = (5 * day + 2) / 153;
        let day = day - (153 * month + 2) / 5 + 1;
        let (month, carry) = if month < 10 {
            (month + 3, 0)
        } else {
            (month - 9, 1)
        };
        let year = u16::try_from(era * 400 + year + carry).ok();
        Some(Calendar {
            year: year.filter(|year| *year >= 1970)?,
            month: month as u8,
            day: day as u8,
            hour: (second / 3600) as u8,
            minute: (second / 60 % 60) as u8,
            second: (second % 60) as u8,
            microsecond: microsecond as u32,
        })
    }

    /// Whether somebody has set the clock: an unset one starts at 1970-01-01.
    pub fn is_set(&self) -> bool {
        self.year >= 2000
    }
}

/// An encoder event (LMS5xx from firmware V1.20).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct EncoderEvent {
    /// Encoder position, ticks.
    pub position: u32,
    /// Time, us.
    pub time_us: u32,
    /// Angle, 1e-4 deg.
    pub angle: i32,
}

/// A scan's telegram. Its buffers are kept from telegram to telegram by [`LmdScandata::parse`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LmdScandata {
    /// Whether it is the reply to a poll (`sRA`), not an event (`sSN`).
    pub polled: bool,
    /// Version of the layout: 0 on LMS5xx, 1 on LMS1xx and TiM.
    pub version: u16,
    /// Device number.
    pub device_number: u16,
    /// Serial number.
    pub serial_number: u32,
    /// Device status, low byte first.
    pub device_status: [u8; 2],
    /// Telegrams given to the interface; wraps.
    pub telegram_counter: u16,
    /// Scans made; wraps.
    pub scan_counter: u16,
    /// Time since start-up at the zero index before the measurement, us; wraps every 71.58 min.
    pub scan_tick_us: u32,
    /// Time since start-up when the complete scan went to the output buffer, us; wraps.
    pub transmit_tick_us: u32,
    /// Digital inputs, low byte first.
    pub inputs: [u8; 2],
    /// Digital outputs, low byte first.
    pub outputs: [u8; 2],
    /// Layer angle (multi-layer devices) or reserved.
    pub layer: u16,
    /// Scan frequency, 1/100 Hz.
    pub scan_frequency: u32,
    /// Measurement frequency, 100 Hz.
    pub measurement_frequency: u32,
    /// Encoders.
    pub encoders: Vec<Encoder>,
    /// The 16 bit channels, then the 8 bit ones.
    pub channels: Vec<Channel>,
    /// Position block.
    pub position: Option<Position>,
    /// The device's name, one char a byte.
    pub device_name: String,
    /// The comment, one char a byte.
    pub comment: String,
    /// The device's calendar time at transmission.
    pub time: Option<Calendar>,
    /// Encoder events.
    pub events: Vec<EncoderEvent>,
    /// Bytes after the last known field.
    pub surplus: usize,
}

/// Whether a telegram carries a scan.
pub fn is_scan(telegram: &Telegram) -> bool {
    telegram.name() == b"LMDscandata" && matches!(telegram.verb(), b"sRA" | b"sSN")
}

impl LmdScandata {
    /// Reads a telegram for which [`is_scan`] holds, reusing this one's buffers.
    ///
    /// After an error the fields are partly those of the bad telegram.
    pub fn parse(&mut self, telegram: &Telegram) -> Result<(), FieldError> {
        self.polled = telegram.verb() == b"sRA";
        match telegram.dialect {
            Dialect::Text => self.read(TextFields(telegram.arguments())),
            Dialect::Binary => self.read(BinaryFields(telegram.arguments())),
        }
    }

    /// The channel of that name.
    pub fn channel(&self, name: &[u8; 5]) -> Option<&Channel> {
        self.channels.iter().find(|channel| channel.name == *name)
    }

    fn read<'a>(&mut self, mut fields: impl Fields<'a> + Copy) -> Result<(), FieldError> {
        self.read_head(&mut fields)?;
        let wide = self.channels_from(0, Width::Bits16, &mut fields)?;
        let all = self.channels_from(wide, Width::Bits8, &mut fields)?;
        self.channels.truncate(all);
        // The documents leave two lengths open that no recording settles: whether the position
        // block ends in one byte more, and whether the comment's length is u8 or u16. Where the
        // usual reading does not come out even, the others are tried.
        let readings = [Tail::USUAL].into_iter().chain(Tail::OTHERS);
        for tail in readings {
            if self.read_tail(fields, tail) == Ok(0) {
                self.surplus = 0;
                return Ok(());
            }
        }
        self.surplus = self.read_tail(fields, Tail::USUAL)?;
        Ok(())
    }

    fn read_head<'a>(&mut self, fields: &mut impl Fields<'a>) -> Result<(), FieldError> {
        self.version = fields.u16("version")?;
        self.device_number = fields.u16("device number")?;
        self.serial_number = fields.u32("serial number")?;
        self.device_status = pair(fields, "device status")?;
        self.telegram_counter = fields.u16("telegram counter")?;
        self.scan_counter = fields.u16("scan counter")?;
        self.scan_tick_us = fields.u32("time since start-up")?;
        self.transmit_tick_us = fields.u32("time of transmission")?;
        self.inputs = pair(fields, "digital inputs")?;
        self.outputs = pair(fields, "digital outputs")?;
        self.layer = fields.u16("layer angle")?;
        self.scan_frequency = fields.u32("scan frequency")?;
        self.measurement_frequency = fields.u32("measurement frequency")?;
        self.encoders.clear();
        for _ in 0..count(fields, MAX_ENCODERS, "number of encoders")? {
            self.encoders.push(Encoder {
                position: fields.u32("encoder position")?,
                speed: fields.u16("encoder speed")?,
            });
        }
        Ok(())
    }

    /// Reads the channels of one width into `channels[first..]`; gives where they end. Channels
    /// beyond that are kept, for their buffers.
    fn channels_from<'a>(
        &mut self,
        first: usize,
        width: Width,
        fields: &mut impl Fields<'a>,
    ) -> Result<usize, FieldError> {
        let announced = match width {
            Width::Bits16 => count(fields, MAX_CHANNELS, "number of 16 bit channels")?,
            Width::Bits8 => count(fields, MAX_CHANNELS, "number of 8 bit channels")?,
        };
        let end = first + usize::from(announced);
        if self.channels.len() < end {
            self.channels.resize_with(end, Channel::default);
        }
        for channel in self.channels.iter_mut().skip(first).take(announced.into()) {
            channel.read(width, fields)?;
        }
        Ok(end)
    }

    /// Reads what follows the channels; gives the number of bytes left over.
    fn read_tail<'a>(
        &mut self,
        mut fields: impl Fields<'a>,
        tail: Tail,
    ) -> Result<usize, FieldError> {
        let fields = &mut fields;
        self.position = None;
        if flag(fields, "position flag")? {
            let mut position = Position::default();
            for coordinate in &mut position.coordinates {
                *coordinate = fields.real("position")?;
            }
            position.rotation_type = fields.u8("rotation type")?;
            if tail.long_position {
                fields.u8("byte after the rotation type")?;
            }
            self.position = Some(position);
        }
        self.device_name.clear();
        if flag(fields, "name flag")? {
            let length = fields.u16("length of the device name")?;
            let name = fields.chars(length.into(), "device name")?;
            push_bytes(&mut self.device_name, name);
        }
        self.comment.clear();
        if flag(fields, "comment flag")? {
            let length = match tail.short_comment {
                true => fields.u8("length of the comment")?.into(),
                false => fields.u16("length of the comment")?,
            };
            push_bytes(&mut self.comment, fields.chars(length.into(), "comment")?);
        }
        self.time = match flag(fields, "time flag")? {
            true => Some(Calendar {
                year: fields.u16("year")?,
                month: fields.u8("month")?,
                day: fields.u8("day")?,
                hour: fields.u8("hour")?,
                minute: fields.u8("minute")?,
                second: fields.u8("second")?,
                microsecond: fields.u32("microsecond")?,
            }),
            false => None,
        };
        self.events.clear();
        for _ in 0..count(fields, MAX_EVENTS, "event flag")? {
            fields.chars(4, "event name")?;
            self.events.push(EncoderEvent {
                position: fields.u32("event's encoder position")?,
                time_us: fields.u32("event time")?,
                angle: fields.i32("event angle")?,
            });
        }
        Ok(fields.remaining())
    }
}

/// One reading of the lengths that the documents leave open.
#[derive(Clone, Copy)]
struct Tail {
    long_position: bool,
    short_comment: bool,
}

impl Tail {
    const fn new(long_position: bool, short_comment: bool) -> Tail {
        Tail {
            long_position,
            short_comment,
        }
    }
    const USUAL: Tail = Tail::new(false, false);
    const OTHERS: [Tail; 3] = [
        Tail::new(true, false),
        Tail::new(false, true),
        Tail::new(true, true),
    ];
}

impl Channel {
    fn read<'a>(&mut self, width: Width, fields: &mut impl Fields<'a>) -> Result<(), FieldError> {
        self.width = width;
        let name = fields.chars(5, "channel name")?;
        self.name = *name.first_chunk().ok_or(FieldError {
            field: "channel name",
            problem: Problem::Missing,
        })?;
        self.scale = fields.real("scale factor")?;
        self.offset = fields.real("scale offset")?;
        self.start_angle = fields.i32("start angle")?;
        self.angular_step = fields.u16("angular step")?;
        let count = fields.u16("number of values")?;
        fields.values(width, count, "values", &mut self.values)
    }

    /// The echo, from 1, if the channel's name is `kind` and a digit.
    pub fn echo_of(&self, kind: &[u8; 4]) -> Option<usize> {
        let [a, b, c, d, digit] = self.name;
        let is_kind = [a, b, c, d] == *kind && (b'1'..=b'9').contains(&digit);
        is_kind.then(|| usize::from(digit - b'0'))
    }
}

fn pair<'a>(fields: &mut impl Fields<'a>, field: &'static str) -> Result<[u8; 2], FieldError> {
    Ok([fields.u8(field)?, fields.u8(field)?])
}

fn count<'a>(
    fields: &mut impl Fields<'a>,
    max: u16,
    field: &'static str,
) -> Result<u16, FieldError> {
    let count = fields.u16(field)?;
    if count > max {
        return Err(FieldError {
            field,
            problem: Problem::Unlikely(count.into()),
        });
    }
    Ok(count)
}

fn flag<'a>(fields: &mut impl Fields<'a>, field: &'static str) -> Result<bool, FieldError> {
    Ok(count(fields, 1, field)? == 1)
}

fn push_bytes(text: &mut String, bytes: &[u8]) {
    text.extend(bytes.iter().map(|byte| char::from(*byte)));
}
