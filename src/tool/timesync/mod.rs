//! timesync: the device's clock and the host's, and the delay of what is measured.

mod delay;
mod fit;
mod live;
mod ntp;
mod poll;
mod set;
mod text;
mod track;
mod watch;

use crate::clock::Method;
use crate::stream::Outcome;

const EXAMPLES: &str = "\
EXAMPLES
  How far a scanner's clock is off, from a log of exchanges with it:
    timesync fit exchanges.csv
  The same by two other methods, to compare:
    timesync fit --method joint exchanges.csv && timesync fit --method mean --json exchanges.csv
  Scans with stamps from the device's clock, as they come:
    simulate -f frame.toml --effects clocks --n-scans 50 | timesync track > tracked.csv
  How late poses are, and the error for every delay that might be:
    timesync delay --desired loop.mcap --curve curve.csv measured.csv
  The result as JSON, for compensate-delay:
    timesync delay --desired loop.mcap --json -o delay.json measured.csv

HOW SURE IT IS
  Half the difference between the shortest way there and the shortest way back cannot be seen by any
  program: it can be as large as half the shortest round trip, which is printed as the bracket.
  What is known of it (--wire, --asymmetry) is taken off. The sigma beside a figure is its scatter
  only.

  A platform that follows late, or with an error proportional to its speed, looks to timesync delay
  exactly like a delay of the measurement. Only clocks compared by timesync poll and fit tell the
  two apart.";

/// The command line.
#[derive(Debug, clap::Parser)]
#[command(
    name = "timesync",
    version,
    about = "Compare the scanner's clock with the host's, and find delays",
    long_about = "Compare the scanner's clock with the host's, and find delays.\n\n\
        At 3 m/s every millisecond is 3 mm. set, poll, watch and ntp talk to a scanner; fit, track \
        and delay work on records. No clock is ever steered while records are made: device time is \
        translated, not changed.",
    after_long_help = EXAMPLES,
    subcommand_required = true,
    arg_required_else_help = true
)]
pub struct Args {
    #[command(subcommand)]
    task: Task,
}

#[derive(Debug, clap::Subcommand)]
enum Task {
    Set(set::Args),
    Poll(poll::Args),
    Fit(fit::Args),
    Watch(watch::Args),
    Track(track::Args),
    Delay(delay::Args),
    Ntp(ntp::Args),
}

/// Does one of the tasks.
///
/// # Errors
/// Those of the task; see [`crate::stream::exit`].
pub fn run(args: Args) -> anyhow::Result<Outcome> {
    match args.task {
        Task::Set(args) => set::run(&args),
        Task::Poll(args) => poll::run(&args),
        Task::Fit(args) => fit::run(&args),
        Task::Watch(args) => watch::run(&args),
        Task::Track(args) => track::run(&args),
        Task::Delay(args) => delay::run(&args),
        Task::Ntp(args) => ntp::run(&args),
    }
}

/// The name in messages and provenance.
const TOOL: &str = "timesync";

/// Estimators by their names on the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Estimator {
    /// Lines under the clouds of requests and of answers, half their difference
    Hull,
    /// The same with one common slope
    Joint,
    /// The line under the answers alone; the shortest delay stays in it
    OneWay,
    /// Least squares through the middles of all exchanges
    Mean,
    /// The exchange with the shortest round trip
    Minrtt,
    /// Least squares through the fastest exchange of each second
    Window,
    /// Least squares weighted by the round trip, as chrony does
    Weighted,
}

impl Estimator {
    fn method(self) -> Method {
        match self {
            Estimator::Hull => Method::Hull,
            Estimator::Joint => Method::Joint,
            Estimator::OneWay => Method::OneWay,
            Estimator::Mean => Method::Mean,
            Estimator::Minrtt => Method::MinRtt,
            Estimator::Window => Method::Window,
            Estimator::Weighted => Method::Weighted,
        }
    }
}
