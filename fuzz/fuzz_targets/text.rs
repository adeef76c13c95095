//! Any text where a person or another file gives one: addresses, layouts, gates, faults, durations,
//! tables of arrival times. Nothing panics, and what has a canonical spelling reads back from it.
#![no_main]

use cablepose::link::faults::Faults;
use cablepose::link::{Arrivals, Endpoint, parse_seconds_ns};
use cablepose::report::{Gate, Zone};
use cablepose::sick::angle_jitter::AngleJitter;
use cablepose::simulate::Effects;
use cablepose::tool::values::{parse_duration, parse_rotation, parse_signed_duration};
use cablepose::twincat::fields::parse_fields;
use cablepose::twincat::layout::Layout;
use cablepose::twincat::route::Credentials;
use cablepose::twincat::{NetId, Target};
use cablepose_fuzz::bounded;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let Ok(text) = std::str::from_utf8(data) else {
        return;
    };
    bounded((4 << 20) + 1024 * text.len() as u64, || {
        if let Ok(net_id) = text.parse::<NetId>() {
            assert_eq!(net_id.to_string().parse(), Ok(net_id));
        }
        let _ = text.parse::<Target>();
        if let Ok(endpoint) = text.parse::<Endpoint>() {
            assert_eq!(endpoint.to_string().parse(), Ok(endpoint));
        }
        let _ = text.parse::<Faults>();
        let _ = text.parse::<Gate>();
        let _ = text.parse::<Zone>();
        let _ = text.parse::<Effects>();
        let _ = text.parse::<Layout>();
        let _ = parse_fields(text);
        let _ = Credentials::parse(text);
        let _ = parse_duration(text);
        let _ = parse_signed_duration(text);
        let _ = parse_rotation(text);
        let _ = parse_seconds_ns(text);
        if let Ok(model) = AngleJitter::from_toml(text) {
            let again = AngleJitter::from_toml(&model.to_toml());
            assert_eq!(again.unwrap().to_toml(), model.to_toml());
        }
        if let Ok(arrivals) = Arrivals::read(text.as_bytes()) {
            for offset in (0..64).map(|bit| 1 << bit).chain([0, u64::MAX]) {
                if let Some((at, end)) = arrivals.piece(offset) {
                    assert_eq!(arrivals.at(offset), Some(at));
                    assert!(end > offset || end == u64::MAX, "{offset} in a piece that ends at {end}");
                }
                assert!(arrivals.next_session(offset).is_none_or(|next| next > offset));
            }
            let _ = arrivals.continues(&arrivals);
        }
    });
});
