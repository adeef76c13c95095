//! The serial ports of this host, listed for people.

use crate::link::{latency_timer, ports};
use crate::stream::{Fault, Outcome};
use std::io::Write;
use std::path::Path;

/// Prints a line for each port: its path, what it is part of, and for how long its adapter holds bytes
/// back. `tool` is named where there are none.
pub(super) fn list(tool: &str) -> anyhow::Result<Outcome> {
    let ports = ports().map_err(Fault::Unavailable)?;
    let mut out = std::io::stdout().lock();
    for port in &ports {
        let timer = latency_timer(Path::new(&port.path));
        let timer = timer.map_or(String::new(), |timer| {
            format!("\tlatency timer {} ms", timer.ms)
        });
        writeln!(out, "{}\t{}{timer}", port.path, port.adapter)?;
    }
    out.flush()?;
    if ports.is_empty() {
        eprintln!("{tool}: no serial ports");
    }
    Ok(Outcome::Done)
}
