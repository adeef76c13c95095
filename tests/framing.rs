//! 100 000 scans through every kind of chunk and damage: nothing is lost that came whole, and what
//! did not is counted to the scan.

use cablepose::link::faults::{Damage, Faults};
use cablepose::sick::cola::{Dialect, Event, Framer};
use cablepose::sick::encode::encode;
use cablepose::sick::replay::{Replay, Settings};
use cablepose::sick::scandata::{Channel, LmdScandata, Width, is_scan};

const SCANS: u32 = 100_000;

/// Scan `number` of a device at 100 Hz with remissions, a few beams wide; its values are derived
/// from the number, so that a scan made of pieces of two shows.
fn telegram(scan: &mut LmdScandata, number: u32, beams: u16) {
    let channel = |name, width| Channel {
        name,
        width,
        scale: 1.0,
        start_angle: -50_000,
        angular_step: 5000,
        ..Channel::default()
    };
    scan.serial_number = 18_110_550;
    scan.telegram_counter = number as u16;
    scan.scan_counter = (number as u16).wrapping_add(54_000);
    // The device's microseconds wrap after 50 s.
    scan.scan_tick_us = number.wrapping_mul(10_000).wrapping_sub(50_000_000);
    scan.transmit_tick_us = scan.scan_tick_us.wrapping_add(12_500);
    scan.scan_frequency = 10_000;
    scan.measurement_frequency = 720;
    if scan.channels.is_empty() {
        scan.channels = vec![
            channel(*b"DIST1", Width::Bits16),
            channel(*b"RSSI1", Width::Bits8),
        ];
    }
    for channel in &mut scan.channels {
        channel.values.clear();
        let mask = if channel.width == Width::Bits8 {
            0xFF
        } else {
            0xFFFF
        };
        // Start marks of the protocol among the values.
        let value = |beam: u16| match beam % 5 {
            0 => 0x0202,
            _ => (number.wrapping_mul(2_654_435_761) >> (beam % 13)) as u16,
        };
        channel
            .values
            .extend((0..beams).map(|beam| value(beam) & mask));
    }
}

/// What comes out of a stream.
#[derive(Default)]
struct Out {
    seqs: Vec<u32>,
    bad: u64,
    missing: u64,
    repeated: u64,
    wrong: u64,
}

struct Receiver {
    framer: Framer,
    replay: Replay,
    found: LmdScandata,
    sent: LmdScandata,
    beams: u16,
    out: Out,
}

impl Receiver {
    fn new(beams: u16) -> Receiver {
        Receiver {
            framer: Framer::new(),
            replay: Replay::new(Settings::default()),
            found: LmdScandata::default(),
            sent: LmdScandata::default(),
            beams,
            out: Out::default(),
        }
    }

    fn feed(&mut self, chunk: &[u8]) {
        self.framer.feed(chunk);
        self.drain();
    }

    fn drain(&mut self) {
        while let Some(event) = self.framer.next() {
            let Event::Telegram(frame) = event else {
                continue;
            };
            if !is_scan(&frame) || self.found.parse(&frame).is_err() {
                self.out.bad += 1;
                continue;
            }
            if let Ok(Some(scan)) = self.replay.push(&self.found, None) {
                self.out.seqs.push(scan.seq);
                // Every field is as it was sent.
                telegram(&mut self.sent, scan.seq, self.beams);
                self.out.wrong += u64::from(self.found != self.sent);
            }
        }
    }

    fn end(mut self) -> Out {
        self.framer.end();
        self.drain();
        let counts = self.replay.counts();
        self.out.missing = counts.missing;
        self.out.repeated = counts.repeated;
        assert_eq!(
            (counts.restarts, counts.counter_restarts, counts.late),
            (0, 0, 0)
        );
        self.out
    }
}

/// Sends all scans through `damage` in its pieces; gives what arrived and, for each scan, whether
/// it was sent whole.
fn send(dialect: Dialect, faults: &str, seed: u64, beams: u16) -> (Out, Vec<bool>, Damage) {
    let faults: Faults = faults.parse().unwrap();
    let mut damage = Damage::new(&faults, seed, 0);
    let mut receiver = Receiver::new(beams);
    let (mut scan, mut frame, mut line) = (LmdScandata::default(), Vec::new(), Vec::new());
    let mut whole = Vec::with_capacity(SCANS as usize);
    for number in 0..SCANS {
        telegram(&mut scan, number, beams);
        frame.clear();
        encode(&scan, dialect, &mut frame);
        if number == 0 || number + 1 == SCANS {
            // A loss before the first scan or after the last shows in no counter.
            line.extend_from_slice(&frame);
            whole.push(true);
        } else {
            let lost = damage.losses().lost();
            damage.message(&frame, &mut line);
            whole.push(damage.losses().lost() == lost);
        }
        while line.len() > 1 << 17 {
            deliver(&mut receiver, &mut damage, &mut line);
        }
    }
    while !line.is_empty() {
        deliver(&mut receiver, &mut damage, &mut line);
    }
    (receiver.end(), whole, damage)
}

/// Hands over what waits in pieces; the last may wait for more.
fn deliver(receiver: &mut Receiver, damage: &mut Damage, line: &mut Vec<u8>) {
    let mut at = 0;
    while at < line.len() {
        let piece = damage.piece(line.len() - at);
        receiver.feed(&line[at..at + piece]);
        at += piece;
    }
    line.clear();
}

/// Nothing but what was lost on purpose is missing, and just that is.
fn check(dialect: Dialect, faults: &str, seed: u64, beams: u16) {
    let (out, whole, damage) = send(dialect, faults, seed, beams);
    let case = format!("{dialect:?}, {faults}, {beams} beams: {}", damage.losses());
    let numbers = whole.iter().zip(0u32..);
    let expected: Vec<u32> = numbers.filter(|(w, _)| **w).map(|(_, n)| n).collect();
    let lost = damage.losses().lost();
    assert_eq!(out.seqs.len() as u64, u64::from(SCANS) - lost, "{case}");
    assert!(
        out.seqs == expected,
        "{case}: other scans than were sent whole"
    );
    assert_eq!(out.missing, lost, "{case}");
    assert_eq!(out.repeated, damage.losses().repeated, "{case}");
    assert_eq!(out.wrong, 0, "{case}");
}

#[test]
fn nothing_is_lost_in_chunks_of_any_size_with_garbage_between() {
    for (dialect, chunk, beams) in [
        (Dialect::Binary, "1", 11),
        (Dialect::Binary, "1..64", 40),
        (Dialect::Binary, "1..1448", 40),
        (Dialect::Binary, "1..65536", 40),
        (Dialect::Text, "1", 11),
        (Dialect::Text, "1..65536", 11),
    ] {
        check(dialect, &format!("garbage=0.3,chunk={chunk}"), 1, beams);
    }
}

#[test]
fn every_loss_on_purpose_is_counted_exactly() {
    for seed in 0..4 {
        let faults = "drop=0.01,flip=0.02,cut=0.02,repeat=0.01,garbage=0.02,chunk=1..65536";
        check(Dialect::Binary, faults, seed, 40);
    }
    // CoLa A has no check, so that a wrong bit cannot be told.
    let faults = "drop=0.02,cut=0.02,repeat=0.01,chunk=1..1448";
    check(Dialect::Text, faults, 5, 11);
}

#[test]
fn telegrams_of_full_size_survive_the_same() {
    // A tenth of the stream's scans of 381 beams would take as long; the seed differs.
    let faults = "drop=0.01,flip=0.01,cut=0.01,repeat=0.01,garbage=0.01,chunk=1..1448";
    check(Dialect::Binary, faults, 77, 381);
}
