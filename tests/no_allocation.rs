//! From bytes to records nothing is allocated once the buffers have grown: neither by the framer,
//! nor by the decoder, nor by the record and its stamp. Nor is anything for a write to the controller.

use cablepose::link::HostInstant;
use cablepose::link::emulation::Conditions;
use cablepose::record::Pose;
use cablepose::sick::cola::{Dialect, Event, Framer};
use cablepose::sick::encode::encode;
use cablepose::sick::replay::{Replay, Settings};
use cablepose::sick::scandata::{Calendar, Channel, LmdScandata, Width, is_scan};
use cablepose::twincat::emulator::{Plc, Service, SharedPlc};
use cablepose::twincat::fields::{Sample, USUAL, parse_fields};
use cablepose::twincat::image::{Image, Missing, Variable, Wanted};
use cablepose::twincat::variables::{self, Handles};
use cablepose::twincat::{Client, LocalAddress};
use std::time::Duration;

/// Somewhat longer than the clock's map remembers (60 s).
const WARM_UP: usize = 4000;
const SCANS: usize = 2000;

/// Five echoes with remissions, a name and the calendar: everything that has a buffer.
fn stream(dialect: Dialect, first: usize, scans: usize) -> Vec<u8> {
    let channel = |name: &[u8; 4], echo: u8, width, number: usize| Channel {
        name: [name[0], name[1], name[2], name[3], b'1' + echo],
        width,
        scale: 1.0,
        start_angle: -50_000,
        angular_step: 5000,
        values: (0..61)
            .map(|beam| (90 + beam + number % 60) as u16 & 0xFF)
            .collect(),
        ..Channel::default()
    };
    let mut out = Vec::new();
    for number in first..first + scans {
        let tick_us = 20_000 * number as u32;
        let mut scan = LmdScandata {
            serial_number: 7,
            telegram_counter: number as u16,
            scan_counter: number as u16,
            scan_tick_us: tick_us,
            transmit_tick_us: tick_us + 22_000,
            scan_frequency: 5000,
            device_name: "SN 18110550".into(),
            time: Some(Calendar {
                year: 2026,
                month: 11,
                day: 22,
                ..Calendar::default()
            }),
            ..LmdScandata::default()
        };
        for echo in 0..5 {
            scan.channels
                .push(channel(b"DIST", echo, Width::Bits16, number));
        }
        for echo in 0..5 {
            scan.channels
                .push(channel(b"RSSI", echo, Width::Bits8, number));
        }
        encode(&scan, dialect, &mut out);
    }
    out
}

struct Decoder {
    framer: Framer,
    telegram: LmdScandata,
    replay: Replay,
    scans: usize,
}

impl Decoder {
    fn feed(&mut self, stream: &[u8], chunk: usize) {
        for chunk in stream.chunks(chunk) {
            self.framer.feed(chunk);
            while let Some(event) = self.framer.next() {
                if let Event::Telegram(found) = event
                    && is_scan(&found)
                    && self.telegram.parse(&found).is_ok()
                {
                    // Arrivals scatter over 1 ms, as over a real line.
                    let late_us = (self.scans * 7919 % 1000) as i64;
                    let arrival_us = 5_000_000 + 20_000 * self.scans as i64 + late_us;
                    let arrival = HostInstant::from_one_clock(arrival_us * 1000);
                    let scan = self.replay.push(&self.telegram, Some(arrival));
                    self.scans += usize::from(scan.is_ok_and(|scan| scan.is_some()));
                }
            }
        }
    }
}

#[test]
fn nothing_is_allocated_in_steady_state() {
    for dialect in [Dialect::Binary, Dialect::Text] {
        for chunk in [1, 1448, 1 << 16] {
            let mut decoder = Decoder {
                framer: Framer::new(),
                telegram: LmdScandata::default(),
                replay: Replay::new(Settings::default()),
                scans: 0,
            };
            decoder.feed(&stream(dialect, 0, WARM_UP), chunk);
            let steady = stream(dialect, WARM_UP, SCANS);
            let measured = allocation_counter::measure(|| decoder.feed(&steady, chunk));
            assert_eq!(decoder.scans, WARM_UP + SCANS);
            let case = format!("{dialect:?} in chunks of {chunk}: {measured:?}");
            assert_eq!(measured.count_total, 0, "{case}");
        }
    }
}

/// A pose on its way to the controller: into the variable's bytes, the request, and back.
#[test]
fn nothing_is_allocated_for_a_push() {
    const LIMIT: Duration = Duration::from_secs(60);
    let mut plc = Plc::with_sick_value();
    assert!(plc.declare("MAIN.fX", "LREAL") && plc.declare("MAIN.n", "UDINT"));
    let plc = SharedPlc::new(plc);
    let address = ([127, 0, 0, 1], 0).into();
    let service = Service::start(&plc, address, Conditions::default()).unwrap();
    let target = service.target(&plc).parse().unwrap();
    let usual = parse_fields(USUAL).unwrap();
    for wanted in [&["MAIN.SickValue"][..], &["MAIN.fX=x:mm", "MAIN.n=counter"]] {
        let mut client = Client::connect(&target, LocalAddress::Usual, LIMIT).unwrap();
        let wanted: Vec<Wanted> = wanted.iter().map(|w| w.parse().unwrap()).collect();
        let found: Vec<Variable> = wanted
            .iter()
            .map(|w| {
                variables::find(&mut client, &w.name, None, LIMIT)
                    .unwrap()
                    .1
            })
            .collect();
        let mut image = Image::plan(&wanted, &found, None, &usual, Missing::Hold).unwrap();
        let mut handles = Handles::get(&mut client, &image, LIMIT).unwrap();
        let (mut bytes, pose) = (Vec::new(), Pose::default());
        let mut push = |first: u64, count: u64| {
            for counter in first..first + count {
                let sample = Sample {
                    pose: &pose,
                    bits: 0,
                    counter,
                    now: HostInstant::now().utc,
                };
                image.fill(&sample, &mut bytes);
                handles.write(&mut client, &bytes, LIMIT).unwrap();
            }
        };
        push(0, 100);
        let measured = allocation_counter::measure(|| push(100, 2000));
        assert_eq!(measured.count_total, 0, "{measured:?}");
    }
}

#[test]
fn the_count_counts() {
    let measured = allocation_counter::measure(|| {
        std::hint::black_box(vec![1u8; 100]);
    });
    assert_eq!(measured.count_total, 1);
}
