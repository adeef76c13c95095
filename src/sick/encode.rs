//! Writes LMDscandata telegrams: the counterpart of [`scandata`](super::scandata), for emulation
//! and tests.

use super::cola::{self, Dialect};
use super::scandata::{Channel, LmdScandata, Width};

/// Writes the values of a telegram in their order.
pub(super) trait Sink {
    fn number(&mut self, value: u32, bytes: usize);
    fn real(&mut self, value: f32);
    fn chars(&mut self, chars: &[u8]);
}

pub(super) struct BinarySink<'a>(pub(super) &'a mut Vec<u8>);

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

pub(super) struct TextSink<'a>(pub(super) &'a mut Vec<u8>);

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::Encoder;
    use crate::sick::cola::{Event, Framer};
    use crate::sick::scandata::{Calendar, EncoderEvent, Position, is_scan};
    use proptest::prelude::*;
    use std::path::Path;

    fn decode(frame: &[u8]) -> Option<LmdScandata> {
        let mut framer = Framer::new();
        framer.feed(frame);
        framer.end();
        let Some(Event::Telegram(telegram)) = framer.next() else {
            return None;
        };
        // Buffers that hold another telegram must not shine through.
        let mut scan = LmdScandata {
            comment: "old".to_owned(),
            encoders: vec![Encoder::default(); 2],
            channels: vec![Channel::default(); 7],
            ..LmdScandata::default()
        };
        (is_scan(&telegram) && scan.parse(&telegram).is_ok()).then_some(scan)
    }

    fn encoded(scan: &LmdScandata, dialect: Dialect) -> Vec<u8> {
        let mut out = Vec::new();
        encode(scan, dialect, &mut out);
        out
    }

    fn channel(width: Width) -> impl Strategy<Value = Channel> {
        let largest: u16 = if width == Width::Bits8 { 255 } else { 65_535 };
        let name = prop_oneof![Just(*b"DIST1"), Just(*b"DIST5"), Just(*b"RSSI1")];
        let head = (name, 0.5f32..3.0, -9.0f32..9.0, any::<i32>(), any::<u16>());
        let values = prop::collection::vec(0..=largest, 0..30);
        (head, values).prop_map(move |(head, values)| Channel {
            name: head.0,
            width,
            scale: head.1,
            offset: head.2,
            start_angle: head.3,
            angular_step: head.4,
            values,
        })
    }

    prop_compose! {
        fn calendar()(
            year in any::<u16>(), month: u8, day: u8, hour: u8, minute: u8, second: u8,
            microsecond: u32,
        ) -> Calendar {
            Calendar { year, month, day, hour, minute, second, microsecond }
        }
    }

    prop_compose! {
        fn tail()(
            position in prop::option::of((any::<[i16; 6]>(), any::<u8>())),
            device_name in "[ -~]{0,16}",
            comment in "[ -~]{0,30}",
            time in prop::option::of(calendar()),
            events in prop::collection::vec(any::<(u32, u32, i32)>(), 0..3),
        ) -> LmdScandata {
            let position = position.map(|(coordinates, rotation_type)| Position {
                coordinates: coordinates.map(f32::from),
                rotation_type,
            });
            let event = |(position, time_us, angle)| EncoderEvent { position, time_us, angle };
            let events = events.into_iter().map(event).collect();
            LmdScandata { position, device_name, comment, time, events, ..LmdScandata::default() }
        }
    }

    prop_compose! {
        fn any_scan()(
            polled: bool,
            words in any::<[u16; 5]>(),
            longs in any::<[u32; 5]>(),
            bytes in any::<[[u8; 2]; 3]>(),
            encoders in prop::collection::vec(any::<(u32, u16)>(), 0..4),
            wide in prop::collection::vec(channel(Width::Bits16), 0..6),
            narrow in prop::collection::vec(channel(Width::Bits8), 0..6),
            tail in tail(),
        ) -> LmdScandata {
            let encoder = |(position, speed)| Encoder { position, speed };
            LmdScandata {
                polled,
                version: words[0],
                device_number: words[1],
                serial_number: longs[0],
                device_status: bytes[0],
                telegram_counter: words[2],
                scan_counter: words[3],
                scan_tick_us: longs[1],
                transmit_tick_us: longs[2],
                inputs: bytes[1],
                outputs: bytes[2],
                layer: words[4],
                scan_frequency: longs[3],
                measurement_frequency: longs[4],
                encoders: encoders.into_iter().map(encoder).collect(),
                channels: wide.into_iter().chain(narrow).collect(),
                ..tail
            }
        }
    }

    fn without_width(mut scan: LmdScandata) -> LmdScandata {
        scan.channels
            .iter_mut()
            .for_each(|c| c.width = Width::Bits16);
        scan
    }

    proptest! {
        #[test]
        fn comes_back_in_both_dialects(scan in any_scan()) {
            for dialect in [Dialect::Text, Dialect::Binary] {
                let back = decode(&encoded(&scan, dialect));
                prop_assert_eq!(back.map(without_width), Some(without_width(scan.clone())));
            }
        }

        #[test]
        fn a_flipped_byte_never_gives_a_scan_in_cola_b(
            scan in any_scan(), at: prop::sample::Index, flip in 1u8..,
        ) {
            let mut frame = encoded(&scan, Dialect::Binary);
            let at = at.index(frame.len());
            frame[at] ^= flip;
            prop_assert_eq!(decode(&frame), None);
        }

        #[test]
        fn no_mutation_makes_it_panic(
            scan in any_scan(),
            binary: bool,
            edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>(), 0u8..3), 1..8),
        ) {
            let dialect = if binary { Dialect::Binary } else { Dialect::Text };
            let frame = encoded(&scan, dialect);
            let head = if binary { 8 } else { 1 };
            let mut body = frame[head..frame.len() - 1].to_vec();
            for (at, byte, edit) in edits {
                let at = at.index(body.len());
                match edit {
                    0 => body[at] = byte,
                    1 => body.insert(at, byte),
                    _ if body.len() > 1 => drop(body.remove(at)),
                    _ => {}
                }
            }
            let mut good = Vec::new();
            cola::frame(dialect, &body, &mut good);
            decode(&good);
        }
    }

    #[test]
    fn a_device_that_cuts_the_telegram_short_is_named() {
        let mut scan = a_scan(0);
        scan.time = Some(Calendar::default());
        let frame = encoded(&scan, Dialect::Text);
        let mut telegram = frame[1..frame.len() - 5].to_vec();
        telegram.retain(|byte| *byte != 3);
        let telegram = cola::Telegram {
            dialect: Dialect::Text,
            offset: 0,
            body: &telegram,
        };
        let error = LmdScandata::default().parse(&telegram).unwrap_err();
        assert!(
            error.to_string().contains("the telegram ends before it"),
            "{error}"
        );
    }

    /// A scan of an LMS511 at 50 Hz and 0.5 deg: a wall 1.5 m ahead and one 2 m to each side.
    fn a_scan(number: u16) -> LmdScandata {
        let distance_mm = |beam: u32| {
            let (sin, cos) = (f64::from(beam) * 0.5 - 5.0).to_radians().sin_cos();
            let ahead = if sin > 1e-9 {
                1500.0 / sin
            } else {
                f64::INFINITY
            };
            ahead.min(2000.0 / cos.abs()).round() as u16
        };
        let channel = |name, width, values| Channel {
            name,
            width,
            scale: 1.0,
            offset: 0.0,
            start_angle: -50_000,
            angular_step: 5000,
            values,
        };
        let distances = (0..381).map(distance_mm).collect();
        let remissions = (0..381).map(|beam| 120 + beam % 80).collect();
        LmdScandata {
            device_number: 1,
            serial_number: 18_110_000,
            telegram_counter: 65_534u16.wrapping_add(number),
            scan_counter: 100 + number,
            // Wraps on the way.
            scan_tick_us: (u32::MAX - 50_000).wrapping_add(20_010 * u32::from(number)),
            transmit_tick_us: (u32::MAX - 27_800).wrapping_add(20_010 * u32::from(number)),
            outputs: [0x3F, 0],
            scan_frequency: 5000,
            measurement_frequency: 360,
            channels: vec![
                channel(*b"DIST1", Width::Bits16, distances),
                channel(*b"RSSI1", Width::Bits8, remissions),
            ],
            ..LmdScandata::default()
        }
    }

    /// testdata/lms511.cola is what [`encode`] writes; UPDATE_TESTDATA=1 rewrites it.
    #[test]
    fn the_recording_in_testdata_is_what_is_encoded() {
        let mut stream = Vec::new();
        cola::frame(Dialect::Binary, b"sEA LMDscandata \x01", &mut stream);
        for number in 0..20 {
            encode(&a_scan(number), Dialect::Binary, &mut stream);
        }
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/lms511.cola");
        if std::env::var_os("UPDATE_TESTDATA").is_some() {
            std::fs::write(&path, &stream).unwrap();
        }
        assert!(std::fs::read(&path).unwrap() == stream);
    }
}
