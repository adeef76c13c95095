//! `report static`: where a run stands still, and the mean pose of each standstill.

use super::{inputs, outputs};
use crate::report::standing::{self, Criteria, Desired, csv, find, json, table};
use crate::report::{Gate, GateError, Limits, Reference, origin};
use crate::stream::{Fault, Outcome, WholeFile};
use crate::tool::arguments::CommonArgs;
use crate::tool::values::{not_negative, parse_duration};
use std::path::{Path, PathBuf};
use std::time::Duration;

const EXAMPLES: &str = "\
EXAMPLES
  Where a run stands, and the mean pose of each standstill:
    simulate -f frame.toml --trajectory random --n-scans 140 --scans-per-pose 70 \\
      | extract-lines -f frame.toml | solve-pose -f frame.toml > stops.csv; report static stops.csv
  The way home, to a pose given in m and deg:
    report static --home 0,0.5,2,0,0,0 stops.csv
  In a script, with a gate:
    report static --json stops.csv --fail-if 'y.sigma_mm>2'

STANDSTILLS
  The platform stands where the poses of a window of --least tell no motion beyond --still-mm-s and
  --still-deg-s: the medians of its two halves differ by no more than the poses' covariances allow. The
  sigma of a mean has two parts: averaging falls with the number of independent poses (from their
  autocorrelation), fixed does not: it is the part of the poses' own covariance that their scatter
  does not show, as where all beams miss an edge in the same way, as far as all standstills of the
  run together bear it out. Errors of the frame file are in neither. Poses of single scans are
  wanted: a filter's poses share their past.
  Names for --fail-if: standing, creeping, and over all standstills the largest x.sigma_mm,
  x.averaging_mm, x.fixed_mm, x.scatter_mm, x.correction_mm (y, z; roll, pitch, yaw in deg),
  position.correction_mm.

EXIT STATUS
  0 done; 2 usage; 3 the run stands nowhere, or a standstill has no desired pose; 4 a --fail-if
  condition holds, or its statistic has no value; 65 bad data; 66 no such input; 74 I/O error";

/// Standstills of a run: the mean pose of each, its uncertainty, the way home
#[derive(Clone, Debug, clap::Args)]
#[command(
    long_about = "Finds where the platform stands, without being told: the mean pose of each standstill, \
                  what that mean is worth, and the correction to a desired (home) pose.",
    after_long_help = EXAMPLES,
    mut_arg("format", |arg| arg.hide(true))
)]
pub struct StandingArgs {
    /// Poses: a file, a FIFO or - for stdin (the default)
    #[arg(value_name = "POSES")]
    poses: Option<PathBuf>,
    /// Correct to this pose: x, y, z in m, and roll, pitch, yaw in deg if wanted
    #[arg(long, value_name = "M,M,M[,DEG,DEG,DEG]", value_parser = parse_home, allow_hyphen_values = true, conflicts_with = "desired")]
    home: Option<Home>,
    /// Correct to where this trajectory is at the time
    #[arg(long, value_name = "FILE")]
    desired: Option<PathBuf>,
    /// Shortest standstill
    #[arg(long, value_name = "TIME", default_value = "0.5s", value_parser = parse_duration)]
    least: Duration,
    /// Slower than this is standing, however exactly the poses could tell
    #[arg(long, value_name = "MM/S", default_value_t = 1.0, value_parser = not_negative)]
    still_mm_s: f64,
    /// The same for the angles
    #[arg(long, value_name = "DEG/S", default_value_t = 0.05, value_parser = not_negative)]
    still_deg_s: f64,
    /// End with status 4 if the condition holds, as 'x.sigma_mm>1' or 'standing<11'; several allowed
    #[arg(long = "fail-if", value_name = "CONDITION", value_parser = parse_gate)]
    fail_if: Vec<Gate>,
    /// Print JSON in place of the table
    #[arg(long)]
    json: bool,
    /// Print CSV in place of the table, a row a standstill
    #[arg(long, conflicts_with = "json")]
    csv: bool,
    /// ASCII only [default: where the locale is not UTF-8]
    #[arg(long)]
    ascii: bool,
    #[command(flatten)]
    common: CommonArgs,
}

/// A pose in m and rad; NaN for angles that are not given.
#[derive(Clone, Copy, Debug)]
struct Home([f64; 6]);

fn parse_home(text: &str) -> Result<Home, String> {
    let wanted = || "three lengths in m are wanted, and three angles in deg if wanted".to_owned();
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|n| n.trim().parse()).collect();
    let numbers: Vec<f64> = numbers.map_err(|_| wanted())?;
    if !numbers.iter().all(|n| n.is_finite()) {
        return Err(wanted());
    }
    match numbers[..] {
        [x, y, z] => Ok(Home([x, y, z, f64::NAN, f64::NAN, f64::NAN])),
        [x, y, z, roll, pitch, yaw] => {
            let [roll, pitch, yaw] = [roll, pitch, yaw].map(f64::to_radians);
            Ok(Home([x, y, z, roll, pitch, yaw]))
        }
        _ => Err(wanted()),
    }
}

fn parse_gate(text: &str) -> Result<Gate, GateError> {
    Gate::for_standing(text)
}

/// Runs the subcommand.
pub(super) fn run(args: &StandingArgs) -> anyhow::Result<Outcome> {
    let options = args.common.options("report")?;
    if args.least.is_zero() {
        return Err(Fault::Usage("--least must be above 0".into()).into());
    }
    let path = args.poses.as_deref().unwrap_or(Path::new("-"));
    let output = WholeFile::open(args.common.output.as_deref())?;
    let (poses, points) = inputs::read_with_desired(path, args.desired.as_deref(), &options)?;
    let along = |points| Desired::Trajectory(Reference::new(points, Limits::default()));
    let home = args.home.as_ref().map(|Home(pose)| Desired::Home(*pose));
    let desired = home.or(points.map(along));
    let criteria = Criteria {
        least_s: args.least.as_secs_f64(),
        still_m_s: args.still_mm_s * 1e-3,
        still_rad_s: args.still_deg_s.to_radians(),
    };
    let found = find(&poses, &criteria, desired.as_ref());
    let name = origin::input_name(path);
    let text = if args.json {
        json(&name, &found, &criteria)?
    } else if args.csv {
        csv(&found)
    } else {
        table(&name, &found, &criteria, args.ascii || !outputs::is_utf8())
    };
    output.finish(&text)?;
    Ok(outcome(args, &found, desired.is_some()))
}

/// Says on stderr what a reader must not miss, and which status that is.
fn outcome(args: &StandingArgs, found: &standing::Found, wanted: bool) -> Outcome {
    let mut outcome = Outcome::Done;
    if found.standing.is_empty() {
        outcome = Outcome::Degraded;
        eprintln!("report: the platform stands nowhere");
    }
    let without = found
        .standing
        .iter()
        .filter(|s| s.correction.is_none())
        .count();
    if wanted && without > 0 {
        outcome = Outcome::Degraded;
        eprintln!("report: {without} standstills have no desired pose at their time");
    }
    let verdicts = args.fail_if.iter().map(|gate| gate.judge_standing(found));
    outcome.and(outputs::judged(verdicts))
}
