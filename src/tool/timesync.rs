//! Wiring of `timesync`. Not built yet: it says what it will do and ends with status 69.

use crate::stream::{Fault, Outcome};
use std::ffi::OsString;

const PLAN: &str = "\
It will set the scanner's clock over the network, log exchanges of time with the device as clock
records, fit offset and drift to them with an honest uncertainty, map device time to host time in a
stream of scans or IMU samples, and find the delay between a desired and a measured trajectory.";

/// What `timesync` takes on its command line: anything, for now.
#[derive(Debug, clap::Parser)]
#[command(
    name = "timesync",
    version,
    about = "Sets the scanner's clock and maps device time to host time (not built yet)",
    long_about = format!("This tool is not built yet: it prints this and ends with status 69.\n\n{PLAN}"),
    override_usage = "timesync [ARGUMENT]..."
)]
pub struct Args {
    /// Taken, and not looked at.
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, hide = true)]
    _arguments: Vec<OsString>,
}

/// Says what the tool will do.
///
/// # Errors
/// Always: the tool is unavailable (status 69).
pub fn run(_args: Args) -> anyhow::Result<Outcome> {
    Err(Fault::Unavailable(format!("not built yet. {PLAN}")).into())
}
