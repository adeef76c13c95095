//! Any bytes in any chunks: the framer neither panics nor loses a byte, and a telegram that it
//! gives out has the right XOR.
#![no_main]

use cablepose::sick::cola::{Dialect, Event, Framer, xor};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: (u8, &[u8])| {
    let (chunk, stream) = input;
    let mut framer = Framer::new();
    let mut accounted = 0;
    let mut take = |framer: &mut Framer| {
        while let Some(event) = framer.next() {
            accounted += match event {
                Event::Skipped(skipped) => skipped.bytes,
                Event::Telegram(telegram) => {
                    let begin = telegram.offset as usize;
                    if telegram.dialect == Dialect::Binary {
                        let end = begin + 8 + telegram.body.len();
                        assert_eq!(stream[begin + 8..end], *telegram.body);
                        assert_eq!(stream[end], xor(telegram.body));
                        telegram.body.len() as u64 + 9
                    } else {
                        telegram.body.len() as u64 + 2
                    }
                }
            };
        }
    };
    for chunk in stream.chunks(usize::from(chunk) + 1) {
        framer.feed(chunk);
        take(&mut framer);
    }
    framer.end();
    take(&mut framer);
    let line_ends = stream.iter().filter(|byte| matches!(**byte, b'\r' | b'\n')).count() as u64;
    assert!(accounted <= stream.len() as u64 && accounted + line_ends >= stream.len() as u64);
});
