//! Writes LMDscandata telegrams: the counterpart of [`scandata`](super::scandata), for emulation
//! and tests.

use super::cola::{self, Dialect};
use super::scandata::{Channel, LmdScandata, Width};

/// Writes the values of a telegram in their order.
trait Sink {
    fn number(&mut self, value: u32, bytes: usize);
    fn real(&mut self, value: f32);
    fn chars(&mut self, chars: &[u8]);
}

struct BinarySink<'a>(&'a mut Vec<u8>);

impl Sink for BinarySink<'_> {
    fn number(&mut self, value: u32, bytes: usize) {
        self.0.extend(value.to_be_bytes().iter().skip(4 - bytes));
    }
    fn real(&mut self, value: f32) {
        self.0.extend_from_slice(&value.to_be_bytes());
    }
    fn chars(&mut self, chars: &[u8]) {
        self.0.extend_from_slice(chars);
    }
}

struct TextSink<'a>(&'a mut Vec<u8>);

impl TextSink<'_> {
    fn digits(&mut self, value: u32, least: u32) {
        self.0.push(b' ');
        let count = (32 - value.leading_zeros()).div_ceil(4).max(least);
        for place in (0..count).rev() {
            let digit = (value >> (4 * place) & 0xF) as u8;
            self.0.push(match digit {
                0..=9 => b'0' + digit,
                _ => b'A' + digit - 10,
            });
        }
    }
}

impl Sink for TextSink<'_> {
    fn number(&mut self, value: u32, _bytes: usize) {
        self.digits(value, 1);
    }
    fn real(&mut self, value: f32) {
        self.digits(value.to_bits(), 8);
    }
    fn chars(&mut self, chars: &[u8]) {
        if !chars.is_empty() {
            self.0.push(b' ');
            self.0.extend_from_slice(chars);
        }
    }
}

/// Appends the telegram in its frame.
///
/// A channel's width decides where it goes: the 16 bit channels come before the 8 bit ones
/// whatever their order in `scan`, and the values of an 8 bit channel lose what is above 255.
pub fn encode(scan: &LmdScandata, dialect: Dialect, out: &mut Vec<u8>) {
    let mut body = if scan.polled {
        b"sRA LMDscandata".to_vec()
    } else {
        b"sSN LMDscandata".to_vec()
    };
    match dialect {
        Dialect::Text => write(scan, &mut TextSink(&mut body)),
        Dialect::Binary => {
            body.push(b' ');
            write(scan, &mut BinarySink(&mut body));
        }
    }
    cola::frame(dialect, &body, out);
}

fn write(scan: &LmdScandata, sink: &mut impl Sink) {
    write_head(scan, sink);
    for width in [Width::Bits16, Width::Bits8] {
        let channels = || scan.channels.iter().filter(|c| c.width == width);
        sink.number(channels().count() as u32, 2);
        channels().for_each(|channel| write_channel(channel, sink));
    }
    write_tail(scan, sink);
}

fn write_head(scan: &LmdScandata, sink: &mut impl Sink) {
    sink.number(scan.version.into(), 2);
    sink.number(scan.device_number.into(), 2);
    sink.number(scan.serial_number, 4);
    scan.device_status
        .iter()
        .for_each(|byte| sink.number((*byte).into(), 1));
    sink.number(scan.telegram_counter.into(), 2);
    sink.number(scan.scan_counter.into(), 2);
    sink.number(scan.scan_tick_us, 4);
    sink.number(scan.transmit_tick_us, 4);
    scan.inputs
        .iter()
        .for_each(|byte| sink.number((*byte).into(), 1));
    scan.outputs
        .iter()
        .for_each(|byte| sink.number((*byte).into(), 1));
    sink.number(scan.layer.into(), 2);
    sink.number(scan.scan_frequency, 4);
    sink.number(scan.measurement_frequency, 4);
    sink.number(scan.encoders.len() as u32, 2);
    for encoder in &scan.encoders {
        sink.number(encoder.position, 4);
        sink.number(encoder.speed.into(), 2);
    }
}

fn write_channel(channel: &Channel, sink: &mut impl Sink) {
    sink.chars(&channel.name);
    sink.real(channel.scale);
    sink.real(channel.offset);
    sink.number(channel.start_angle.cast_unsigned(), 4);
    sink.number(channel.angular_step.into(), 2);
    sink.number(channel.values.len() as u32, 2);
    for value in &channel.values {
        match channel.width {
            Width::Bits8 => sink.number((*value & 0xFF).into(), 1),
            Width::Bits16 => sink.number((*value).into(), 2),
        }
    }
}

fn write_tail(scan: &LmdScandata, sink: &mut impl Sink) {
    sink.number(scan.position.is_some().into(), 2);
    if let Some(position) = &scan.position {
        position
            .coordinates
            .iter()
            .for_each(|value| sink.real(*value));
        sink.number(position.rotation_type.into(), 1);
    }
    for text in [&scan.device_name, &scan.comment] {
        sink.number((!text.is_empty()).into(), 2);
        if !text.is_empty() {
            let bytes: Vec<u8> = text.chars().map(|char| char as u8).collect();
            sink.number(bytes.len() as u32, 2);
            sink.chars(&bytes);
        }
    }
    sink.number(scan.time.is_some().into(), 2);
    if let Some(time) = &scan.time {
        sink.number(time.year.into(), 2);
        for value in [time.month, time.day, time.hour, time.minute, time.second] {
            sink.number(value.into(), 1);
        }
        sink.number(time.microsecond, 4);
    }
    sink.number(scan.events.len() as u32, 2);
    for event in &scan.events {
        sink.chars(b"FDIN");
        sink.number(event.position, 4);
        sink.number(event.time_us, 4);
        sink.number(event.angle.cast_unsigned(), 4);
    }
}
