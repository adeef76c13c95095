//! Any bytes as MCAP with any record wanted of it, and through a filter that passes on the rest:
//! nothing panics, the pieces that the bytes come in make no difference to the records, and no length in the file
//! decides how much memory is taken.
#![no_main]

use cablepose::record::Pose;
use cablepose::stream::{Emit, Encoding, Options, Outcome, Role, Stage, filter};
use cablepose_fuzz::{Reading, bounded, memory_file};
use libfuzzer_sys::fuzz_target;
use std::fs;

/// Writes what it reads.
struct Same;

impl Stage for Same {
    type In = Pose;
    type Out = Pose;

    fn push(&mut self, record: &Pose, emit: &mut Emit<'_, Pose>) -> anyhow::Result<()> {
        emit.write(record)
    }

    fn wants_imu(&self) -> bool {
        true
    }

    fn finish(&mut self, _: &mut Emit<'_, Pose>) -> anyhow::Result<Outcome> {
        Ok(Outcome::Done)
    }
}

/// The records, and whether a fault ended them. Which fault depends on the pieces where a compressed chunk
/// is both damaged and cut off: what is met first.
fn told(seen: Vec<String>) -> Vec<String> {
    let fault = |text: String| if text.starts_with("fuzz: ") { "fault".to_owned() } else { text };
    seen.into_iter().map(fault).collect()
}

fuzz_target!(|data: &[u8]| {
    let Some(([head, piece], bytes)) = data.split_first_chunk::<2>() else {
        return;
    };
    let reading = Reading {
        kind: head & 15,
        encoding: Some(Encoding::Mcap),
        skip_bad: head & 16 != 0,
        role: if head & 32 == 0 { Role::Desired } else { Role::Truth },
        write: false,
    };
    // A chunk of a few bytes may unfold to 64 MiB.
    let limit = (256 << 20) + 256 * bytes.len() as u64;
    let whole = bounded(limit, || reading.read(bytes, 1 << 16));
    let pieces = reading.read(bytes, usize::from(*piece));
    assert_eq!(told(whole), told(pieces));
    if head & 64 != 0 {
        let (from, to) = (memory_file(), memory_file().with_extension("out"));
        fs::write(&from, bytes).unwrap();
        let options = Options {
            tool: "fuzz",
            input_format: Some(Encoding::Mcap),
            output: Some(to),
            skip_bad: reading.skip_bad,
            quiet: true,
            ..Options::default()
        };
        let _ = bounded(limit, || filter(&options, Some(&from), &mut Same));
    }
});
