//! Wiring of `imu-read`. Not built yet: it says what it will do and ends with status 69.

use crate::stream::{Fault, Outcome};
use std::ffi::OsString;

const PLAN: &str = "\
It will stream imu records from a MicroStrain 3DM-GX1 on a serial port, continuous or polled,
with both its instantaneous and its gyro-stabilised quantities, every sample stamped on the host's
clock and every lost byte or sample counted. It will show, check and set the device's calibration
cells, keep the raw bytes beside the records, and replay them to identical records.";

/// What `imu-read` takes on its command line: anything, for now.
#[derive(Debug, clap::Parser)]
#[command(
    name = "imu-read",
    version,
    about = "Streams the IMU's samples (not built yet)",
    long_about = format!("This tool is not built yet: it prints this and ends with status 69.\n\n{PLAN}"),
    override_usage = "imu-read [ARGUMENT]..."
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
