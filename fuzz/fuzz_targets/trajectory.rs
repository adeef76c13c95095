//! Any bytes as TUM's or EuRoC's text, named or sniffed, for poses and trajectories: nothing
//! panics, and the pieces that the bytes come in make no difference.
#![no_main]

use cablepose::stream::{Encoding, Role};
use cablepose_fuzz::{Reading, bounded};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let Some(([head, piece], bytes)) = data.split_first_chunk::<2>() else {
        return;
    };
    let encoding = [Some(Encoding::Tum), Some(Encoding::Euroc), None];
    let reading = Reading {
        kind: 3 + (head & 1),
        encoding: encoding[usize::from(head >> 1) % 3],
        skip_bad: head & 16 != 0,
        role: Role::Desired,
        write: false,
    };
    let limit = (4 << 20) + 256 * bytes.len() as u64;
    let whole = bounded(limit, || Reading { write: true, ..reading }.read(bytes, 1 << 16));
    // The first piece is what the encoding is told from.
    if reading.encoding.is_some() {
        assert_eq!(whole, reading.read(bytes, usize::from(*piece)));
    }
});
