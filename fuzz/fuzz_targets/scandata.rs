//! Any arguments of LMDscandata, in either dialect: parsing and making a scan never panics.
#![no_main]

use cablepose::link::HostInstant;
use cablepose::sick::cola::{Dialect, Telegram};
use cablepose::sick::replay::{Replay, Settings};
use cablepose::sick::scandata::LmdScandata;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: (bool, Vec<(Option<i64>, Vec<u8>)>)| {
    let (is_text, telegrams) = input;
    let (dialect, head) = if is_text {
        (Dialect::Text, &b"sSN LMDscandata"[..])
    } else {
        (Dialect::Binary, &b"sSN LMDscandata "[..])
    };
    let mut scan = LmdScandata::default();
    let mut replay = Replay::new(Settings::default());
    for (arrival_ns, arguments) in telegrams {
        let body = [head, &arguments[..]].concat();
        let telegram = Telegram { dialect, offset: 0, body: &body };
        if scan.parse(&telegram).is_ok() {
            let _ = replay.push(&scan, arrival_ns.map(HostInstant::from_one_clock));
        }
    }
});
