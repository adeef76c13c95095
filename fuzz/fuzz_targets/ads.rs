//! Any bytes in any chunks: neither the framer of AMS nor anything that is made of its frames
//! panics, and what is a request comes back as the same bytes.
#![no_main]

use cablepose::link::emulation::{Device, Outbox};
use cablepose::twincat::ams::{self, Framer, Header, Request};
use cablepose::twincat::emulator::{Plc, SharedPlc};
use cablepose::twincat::layout::Layout;
use cablepose::twincat::route::{Credentials, answer};
use cablepose::twincat::symbols::{DataType, Symbol};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: (u8, &[u8])| {
    let (chunk, stream) = input;
    let mut framer = Framer::default();
    let mut plc = SharedPlc::new(Plc::with_sick_value());
    let mut out = Outbox::default();
    for (turn, bytes) in stream.chunks(usize::from(chunk) + 1).enumerate() {
        plc.input(1, bytes, turn as i64, &mut out);
        plc.advance(turn as i64, &mut out);
        framer.feed(bytes);
        while let Ok(Some(frame)) = framer.next() {
            let Some((header, payload)) = Header::parse(frame.body) else {
                continue;
            };
            let _ = ams::samples(payload, |_, _, _| {});
            if let Some(request) = Request::parse(header.command, payload) {
                let mut again = Vec::new();
                request.frame(&mut again, header.target, header.source, header.invoke_id);
                let mut second = Framer::default();
                second.feed(&again);
                let frame = second.next().ok().flatten().map(|frame| frame.body.to_vec());
                let parsed = frame.as_deref().and_then(Header::parse);
                let back = parsed.and_then(|(h, payload)| Request::parse(h.command, payload));
                assert_eq!(back, Some(request));
            }
        }
    }
    out.take();
    if let Some((symbol, _)) = Symbol::parse(stream) {
        let nothing = |_: &str| Err(cablepose::twincat::layout::LayoutError(String::new()));
        let _ = Layout::of_symbol(&symbol, nothing);
    }
    if let Some((data_type, _)) = DataType::parse(stream) {
        let symbol = Symbol {
            size: data_type.size,
            base: 65,
            ..Symbol::default()
        };
        let same = |_: &str| Ok::<_, cablepose::twincat::layout::LayoutError>(data_type.clone());
        let _ = Layout::of_symbol(&symbol, same);
    }
    let who = Credentials {
        user: String::new(),
        password: String::new(),
    };
    let _ = answer(stream, &who);
});
