//! Wiring of `compensate-delay`. Not built yet: it says what it will do and ends with status 69.

use crate::stream::{Fault, Outcome};
use std::ffi::OsString;

const PLAN: &str = "\
It will read poses and write them carried forward to the time at which they are used, stamp and
pose together: by a delay that is given, found by timesync, or up to the host's present. The motion
in between comes from a desired trajectory, from the poses themselves at constant velocity or
acceleration, or from the IMU's rates, and the covariance grows with it.";

/// What `compensate-delay` takes on its command line: anything, for now.
#[derive(Debug, clap::Parser)]
#[command(
    name = "compensate-delay",
    version,
    about = "Carries poses to the time they are used (not built yet)",
    long_about = format!("This tool is not built yet: it prints this and ends with status 69.\n\n{PLAN}"),
    override_usage = "compensate-delay [ARGUMENT]..."
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
