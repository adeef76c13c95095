//! The wiring of the nine tools: what each takes on its command line (`Args`) and how it joins
//! streams to rooms (`run`). No mathematics and no bytes here.

pub mod ads_push;
pub mod compensate_delay;
pub mod imu_read;
pub mod timesync;

use crate::stream::Outcome;

/// A tool that is not built yet: `plan` is what it will do.
fn not_built(plan: &str) -> anyhow::Result<Outcome> {
    anyhow::bail!("not built yet. {plan}")
}

/// Parses the command line, runs the tool and maps how it ended to the exit status.
pub fn main<A: clap::Parser>(
    name: &'static str,
    run: fn(A) -> anyhow::Result<Outcome>,
) -> std::process::ExitCode {
    match run(A::parse()) {
        Ok(_) => std::process::ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{name}: {error:#}");
            std::process::ExitCode::from(69)
        }
    }
}
