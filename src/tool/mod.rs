//! The wiring of the nine tools: what each takes on its command line (`Args`) and how it joins
//! streams to rooms (`run`). No mathematics and no bytes here.

pub mod ads_push;
pub mod arguments;
pub mod compensate_delay;
mod ending;
pub mod extract_lines;
pub mod imu_read;
mod password;
mod ports;
mod recording;
pub mod report;
pub mod scan_capture;
pub mod simulate;
pub mod solve_pose;
mod tee;
pub mod timesync;
pub mod values;

use crate::stream::{Fault, Outcome, exit, outlive_file_limit};
use std::process::ExitCode;

/// Runs a tool: reads its command line, prints what went wrong as `name: message: cause` on stderr,
/// and turns the outcome or the error into an exit status (see [`exit`]).
pub fn main<A: clap::Parser>(
    name: &'static str,
    run: fn(A) -> anyhow::Result<Outcome>,
) -> ExitCode {
    let args = match A::try_parse() {
        Ok(args) => args,
        Err(usage) => {
            // Help goes to stdout, whose reader may have left.
            let _ = usage.print();
            return ExitCode::from(u8::try_from(usage.exit_code()).unwrap_or(2));
        }
    };
    outlive_file_limit();
    match run(args) {
        Ok(outcome) => exit::with_losses(outcome).status().into(),
        Err(error) => {
            let status = exit::status(&error);
            let interrupted = matches!(error.downcast_ref(), Some(Fault::Interrupted(_)));
            if status != 0 && !interrupted {
                eprintln!("{name}: {}", without_numbers(&format!("{error:#}")));
            }
            status.into()
        }
    }
}

/// A message without the system's numbers for its errors, which say nothing to people.
fn without_numbers(message: &str) -> String {
    let mut parts = message.split(" (os error ");
    let mut text = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        text.push_str(part.split_once(')').map_or("", |(_, rest)| rest));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_have_no_numbers_of_errors() {
        let full = "a.csv: No space left on device (os error 28): gone (os error 5)";
        assert_eq!(
            without_numbers(full),
            "a.csv: No space left on device: gone"
        );
        assert_eq!(without_numbers("a (b): c"), "a (b): c");
    }
}
