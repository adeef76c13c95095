//! report: what a run is worth, in numbers and figures. Without a subcommand, poses against a true
//! or desired trajectory; each subcommand is a file of its own.

mod convert;
mod diff;
mod evaluation;
mod forms;
mod frame;
mod inputs;
mod lines;
mod outputs;
mod pictures;
mod poses;
mod robot;
mod scan;
mod standing;

use crate::stream::Outcome;

/// Error statistics of poses against a true or desired trajectory
#[derive(Clone, Debug, clap::Parser)]
#[command(
    name = "report",
    version,
    about,
    long_about = "Compares poses with a true or desired trajectory: error statistics per component, over \
                  time and over the workspace, whether the covariances are honest, what became of every \
                  scan; one run, or several side by side. Prints a table, or JSON, and makes a page. \
                  A subcommand reports on something else.",
    after_long_help = poses::EXAMPLES,
    args_conflicts_with_subcommands = true,
    subcommand_negates_reqs = true,
    disable_help_subcommand = true,
    mut_arg("format", |arg| arg.hide(true))
)]
pub struct Args {
    /// What to report on instead of poses
    #[command(subcommand)]
    pub subject: Option<Subject>,
    /// Poses
    #[command(flatten)]
    pub poses: poses::PoseArgs,
}

/// What there are reports on besides poses. A file of poses that has such a name is given as ./NAME.
#[derive(Clone, Debug, clap::Subcommand)]
pub enum Subject {
    /// Scores extracted lines against the true ones
    Lines(lines::LineArgs),
    /// Compares two files of records
    Diff(diff::DiffArgs),
    /// Writes records in another encoding, several files into one, one into several
    Convert(convert::ConvertArgs),
    /// Draws and checks a frame file, and predicts what scans in it can tell
    Frame(frame::FrameArgs),
    /// Draws scans: beams, reflectors, lines, edges, residuals
    Scan(scan::ScanArgs),
    /// Standstills of a run: the mean pose of each, its uncertainty, the way home
    Static(standing::StandingArgs),
    /// Finds where a robot's pulleys are, from poses measured where it stood
    Robot(robot::RobotArgs),
}

/// Runs the tool.
///
/// # Errors
/// As every tool's: what cannot be read or written, or makes no sense.
pub fn run(args: Args) -> anyhow::Result<Outcome> {
    match args.subject {
        None => poses::run(&args.poses),
        Some(Subject::Lines(args)) => lines::run(&args),
        Some(Subject::Diff(args)) => diff::run(&args),
        Some(Subject::Convert(args)) => convert::run(&args),
        Some(Subject::Frame(args)) => frame::run(&args),
        Some(Subject::Scan(args)) => scan::run(&args),
        Some(Subject::Static(args)) => standing::run(&args),
        Some(Subject::Robot(args)) => robot::run(&args),
    }
}
