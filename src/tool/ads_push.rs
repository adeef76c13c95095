//! Wiring of `ads-push`. Not built yet: it says what it will do and ends with status 69.

use crate::stream::{Fault, Outcome};
use std::ffi::OsString;

const PLAN: &str = "\
It will write poses to a TwinCAT 3 controller over ADS and pass them on to stdout: as one array or
field by field, after the variable's size and type were checked, with a status word and a counter
so that the controller sees a sensor that has fallen silent. When the link is slower than the
poses, the newest one goes and the older ones are counted. It will also stream the controller's
desired motion as a trajectory.";

/// What `ads-push` takes on its command line: anything, for now.
#[derive(Debug, clap::Parser)]
#[command(
    name = "ads-push",
    version,
    about = "Writes poses to TwinCAT variables (not built yet)",
    long_about = format!("This tool is not built yet: it prints this and ends with status 69.\n\n{PLAN}"),
    override_usage = "ads-push [ARGUMENT]..."
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
