//! Any bytes as the CSV of any record: nothing panics, the pieces that the bytes come in make no
//! difference, memory does not grow beyond them, and what was read is the same once written.
#![no_main]

use cablepose::stream::{Encoding, Role};
use cablepose_fuzz::{Reading, bounded};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let Some(([head, piece], bytes)) = data.split_first_chunk::<2>() else {
        return;
    };
    let reading = Reading {
        kind: head & 15,
        encoding: Some(Encoding::Csv),
        skip_bad: head & 16 != 0,
        role: Role::Desired,
        write: false,
    };
    let limit = (4 << 20) + 256 * bytes.len() as u64;
    let whole = bounded(limit, || Reading { write: true, ..reading }.read(bytes, 1 << 16));
    assert_eq!(whole, reading.read(bytes, usize::from(*piece)));
});
