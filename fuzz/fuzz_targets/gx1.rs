//! Any bytes in any pieces at any times: replies, then samples. Nothing panics, every byte is in a
//! reply, skipped or waiting, and what is found is what stands there.
#![no_main]

use cablepose::gx1::attitude::Sense;
use cablepose::gx1::unit_file::UnitFile;
use cablepose::gx1::{Command, Framer, Gains, Mode, Samples, Setup, TickFactors};
use cablepose::link::HostInstant;
use cablepose::record::Stamp;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    if let Ok(text) = std::str::from_utf8(data) {
        let _ = UnitFile::parse(text);
    }
    let Some(([mode, rest_of_head @ ..], bytes)) = data.split_first_chunk::<4>() else {
        return;
    };
    let commands = [
        Command::StabilisedEulerAccelRate,
        Command::InstantVectors,
        Command::StabilisedQuaternionVectors,
        Command::StabilisedMatrix,
    ];
    let commands = commands[usize::from(mode % 4)..].to_vec();
    let mut framer = Framer::new(38_400);
    framer.expect(&commands);
    framer.expect_also(Command::SetContinuous);
    let [cut, wait, tick] = *rest_of_head;
    let mut samples = Samples::new(Setup {
        commands,
        mode: if mode & 4 == 0 { Mode::Continuous } else { Mode::Polled(50.0) },
        gains: Gains::FACTORY,
        tick: TickFactors([u16::from(tick), 10, 250, 2]),
        baud: 38_400,
        accel_sign: 1.0,
        quaternion: Sense::Attitude,
    });
    samples.begin();
    let mut raw_ns = 0i64;
    let mut taken = 0;
    for (k, piece) in bytes.chunks(usize::from(cut) + 1).enumerate() {
        raw_ns = raw_ns.saturating_add(i64::from(wait) * 300_000 * (k as i64 % 7));
        let at = HostInstant { utc: Stamp::from_ns(raw_ns), raw_ns };
        framer.feed(piece, at);
        while let Some(arrived) = framer.next() {
            let place = arrived.offset as usize;
            let length = arrived.packet.command().reply_length();
            taken += length;
            assert_eq!(&bytes[place..place + length], arrived.packet.bytes());
            samples.push(&arrived);
            while samples.next_sample().is_some() {}
            while samples.next_remark().is_some() {}
        }
    }
    samples.finish();
    let counts = framer.counts();
    assert_eq!(taken as u64 + counts.skipped + framer.pending() as u64, bytes.len() as u64);
});
