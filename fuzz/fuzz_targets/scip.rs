//! Any bytes in any chunks: the framer of SCIP 2.0 neither panics nor loses a byte, and neither
//! measurements nor parameters nor scans made of its replies panic.
#![no_main]

use cablepose::hokuyo::scans::{Scans, Settings};
use cablepose::hokuyo::scip::{Event, Framer, Measurement, Parameters, status_words, time_ms};
use cablepose::link::HostInstant;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: (u8, i64, &[u8])| {
    let (chunk, mut arrival_ns, stream) = input;
    let mut framer = Framer::new();
    let mut measurement = Measurement::default();
    let mut scans = Scans::new(Parameters::utm_30lx(), Settings::default());
    let mut accounted = 0;
    let mut take = |framer: &mut Framer| {
        while let Some(event) = framer.next() {
            let reply = match event {
                Event::Skipped(skipped) => {
                    accounted += skipped.bytes;
                    continue;
                }
                Event::Reply(reply) => reply,
            };
            accounted += reply.body.len() as u64 + 2;
            status_words(reply.echo(), reply.status());
            let _ = time_ms(&reply);
            if let Ok(parameters) = Parameters::parse(&reply) {
                scans = Scans::new(parameters, Settings::default());
            }
            if Measurement::is_one(&reply) && measurement.parse(&reply).is_ok() {
                let arrival = HostInstant::from_one_clock(arrival_ns);
                scans.push(&measurement, Some(arrival));
                arrival_ns = arrival_ns.wrapping_add(25_000_000);
            }
        }
    };
    for chunk in stream.chunks(usize::from(chunk) + 1) {
        framer.feed(chunk);
        take(&mut framer);
    }
    framer.end();
    take(&mut framer);
    let line_ends = stream.iter().filter(|byte| **byte == b'\n').count() as u64;
    assert!(accounted <= stream.len() as u64 && accounted + line_ends >= stream.len() as u64);
});
