//! An emulated PLC with `MAIN.SickValue` and a moving `GVL.stDesired`, to try `ads-push` on:
//! `cargo run --example plc 127.0.0.1:48898`, then `ads-push 127.0.0.1.1.1 --local-net-id 127.0.0.2.1.1 ..`.
//! It ends with its stdin and prints the bytes that `MAIN.SickValue` was left with, in hexadecimal, a word each LREAL.

use cablepose::link::emulation::Conditions;
use cablepose::twincat::emulator::{Plc, Service, SharedPlc};
use std::io::{Read, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let address = std::env::args().nth(1).unwrap_or("127.0.0.1:0".into());
    let mut plc = Plc::with_sick_value();
    plc.declare_struct(
        "ST_Desired",
        &[("x", "LREAL"), ("y", "LREAL"), ("z", "LREAL")],
    );
    plc.declare("GVL.stDesired", "ST_Desired");
    let plc = SharedPlc::new(plc);
    let service = Service::start(&plc, address.parse()?, Conditions::default())?;
    println!("{}", service.target(&plc));
    std::io::stdout().flush()?;
    let over = Arc::new(AtomicBool::new(false));
    let ended = Arc::clone(&over);
    std::thread::spawn(move || {
        // An unreadable stdin has ended as well.
        let _ = std::io::stdin().read_to_end(&mut Vec::new());
        ended.store(true, Ordering::Relaxed);
    });
    let start = Instant::now();
    while !over.load(Ordering::Relaxed) {
        let y = (start.elapsed().as_secs_f64() / 4.0).sin();
        let point: Vec<u8> = [0.0, y, 1.5f64]
            .iter()
            .flat_map(|v| v.to_le_bytes())
            .collect();
        plc.lock().set("GVL.stDesired", &point);
        std::thread::sleep(Duration::from_millis(2));
    }
    drop(service);
    let plc = plc.lock();
    let value = plc.find("MAIN.SickValue").map(|held| held.value.clone());
    let words = value.unwrap_or_default();
    let words: Vec<String> = words.chunks(8).map(hex).collect();
    println!("{}", words.join(" "));
    Ok(())
}

fn hex(word: &[u8]) -> String {
    word.iter().map(|byte| format!("{byte:02x}")).collect()
}
