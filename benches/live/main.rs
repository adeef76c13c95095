//! The live path on this machine: how late records come, and what is lost. `make bench-live` prints
//! both beside the goals and fails where the accounts of losses do not agree.
//!
//! Latency: an emulated scanner (761 beams, 100 Hz) sends through a relay to scan-capture, whose
//! stdout is read here. A scan's way begins just before the relay hands over its telegram in one
//! piece and ends when the last byte of its record has been read from the pipe. `received_ns` of the
//! record parts it: before that lies the way into scan-capture (the loopback and the waking of its
//! process), after that its own work, the pipe and the waking of the reader. The first line is a
//! thread in the place of scan-capture that only passes bytes on: what the machine itself takes.
//!
//! Loss: scans as fast as can be, in pieces of given sizes with garbage between. What was sent must
//! be what was received and what was lost on purpose, and the gaps that scan-capture counts must be
//! those in the numbers of its records.
//!
//! Push: the same scans through scan-capture, extract-lines, solve-pose and ads-push to an emulated
//! PLC, until the write is acknowledged; then with compensate-delay before ads-push.
//!
//! Arguments: `latency`, `loss` or `push` for one of them, a number for the scans of each latency.

mod capture;
mod latency;
mod loss;
mod push;
mod relay;
mod scanner;

use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let asks = |name: &str| arguments.iter().any(|argument| argument == name);
    let scans = arguments.iter().filter_map(|a| a.parse().ok()).next();
    let all = !["latency", "loss", "push"].into_iter().any(asks);
    let mut result = Ok(());
    if all || asks("latency") {
        result = latency::table(scans.unwrap_or(3000));
    }
    if result.is_ok() && (all || asks("push")) {
        result = push::table(scans.unwrap_or(3000));
    }
    if result.is_ok() && (all || asks("loss")) {
        result = loss::table();
    }
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("bench-live: {error}");
            ExitCode::FAILURE
        }
    }
}

/// What went wrong, in words.
type Failure = String;

/// An error with what was being done.
fn during<E: std::fmt::Display>(what: &str) -> impl FnOnce(E) -> Failure {
    move |error| format!("{what}: {error}")
}
