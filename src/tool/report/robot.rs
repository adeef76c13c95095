//! `report robot`: what poses measured at standing places tell of the robot's pulleys.

use super::{inputs, outputs};
use crate::frame::edit;
use crate::report::origin;
use crate::report::robot::Findings;
use crate::robot::{CalibrationError, Robot, Standing, Unknown, calibrate, places};
use crate::stream::{Fault, Outcome, WholeFile};
use crate::tool::arguments::CommonArgs;
use crate::tool::values::{not_negative, parse_duration};
use std::path::{Path, PathBuf};
use std::time::Duration;

const EXAMPLES: &str = "\
EXAMPLES
  A robot whose upper pulleys are not where its controller believes them to be, going to and fro, and
  what the scanner tells of it:
    simulate -f frame.toml --trajectory loop --loops 3 --dwell 1s --robot robot.toml \\
      --robot-real real.toml --desired desired.csv --imu imu.csv | extract-lines -f frame.toml \\
      | solve-pose -f frame.toml --imu imu.csv | tee run.csv \\
      | report robot --robot robot.toml --desired desired.csv
  The same as JSON, and a robot file that is right:
    report robot --robot robot.toml --desired desired.csv --corrected corrected.toml --json run.csv
  Both heights:
    report robot --robot robot.toml --desired desired.csv --find upper.z --find lower.z run.csv

ROBOT FILE
  TOML: pulley_radius_m; [home] position_m, rotation_deg (deg); for each cable [[cable]] name, group,
  pulley_m (where the cable runs onto its pulley), axis (along which direction), anchor_m (on the
  platform). The length of a cable is what is wound around its pulley and the straight rest; eight
  lengths that no pose has put the platform where cables of equal stiffness would. The controller
  winds cables from the home pose on; without [home] it knows their whole lengths.

EXIT STATUS
  0 done; 2 usage; 3 rows skipped (and said so); 65 bad data, or places that do not show what is
  looked for; 66 no such input; 74 I/O error; 78 a robot file that makes no sense";

/// Finds where a robot's pulleys are, from poses measured where it stood
#[derive(Clone, Debug, clap::Args)]
#[command(
    long_about = "Finds how far the pulleys of a cable robot are from where its controller believes them \
                  to be, from poses measured where the desired trajectory stands still: least squares over \
                  the poses' six components by their covariances, through the robot's kinematics, with a \
                  standard deviation. Prints measured minus desired at each place, and what is left of it.",
    after_long_help = EXAMPLES,
    mut_arg("format", |arg| arg.hide(true))
)]
pub struct RobotArgs {
    /// Measured poses, CSV or MCAP [default: stdin]
    poses: Option<PathBuf>,
    /// Robot file: what the controller believes
    #[arg(long, value_name = "FILE")]
    robot: PathBuf,
    /// The desired trajectory, CSV or MCAP
    #[arg(long, value_name = "FILE")]
    desired: PathBuf,
    /// What is looked for: a group of cables and an axis along which all its pulleys are shifted;
    /// several allowed
    #[arg(long, value_name = "GROUP.AXIS", default_value = "upper.z")]
    find: Vec<Unknown>,
    /// Write the robot file with the pulleys where they were found
    #[arg(long, value_name = "FILE")]
    corrected: Option<PathBuf>,
    /// Shortest rest that is a place
    #[arg(long, value_name = "TIME", default_value = "500ms", value_parser = parse_duration)]
    least: Duration,
    /// Poses this close to a rest's begin and end do not count
    #[arg(long, value_name = "TIME", default_value = "200ms", value_parser = parse_duration)]
    settle: Duration,
    /// Standard deviation of a position that comes without a covariance
    #[arg(long, value_name = "MM", default_value_t = 2.0, value_parser = not_negative)]
    sigma_mm: f64,
    /// Standard deviation of an angle that comes without a covariance
    #[arg(long, value_name = "DEG", default_value_t = 0.1, value_parser = not_negative)]
    sigma_deg: f64,
    /// How well the rest of the robot is known, where positions show it (standard deviation)
    #[arg(long, value_name = "MM", default_value_t = 1.0, value_parser = not_negative)]
    model_sigma_mm: f64,
    /// The same for angles
    #[arg(long, value_name = "DEG", default_value_t = 0.05, value_parser = not_negative)]
    model_sigma_deg: f64,
    /// Print JSON in place of the tables
    #[arg(long)]
    json: bool,
    /// ASCII only [default: where the locale is not UTF-8]
    #[arg(long)]
    ascii: bool,
    #[command(flatten)]
    common: CommonArgs,
}

/// Two points of a desired trajectory closer than this are the same place: a controller's rest is
/// exact, and half a cell of a slow motion is none.
const TOLERANCE_M: f64 = 1e-4;
const TOLERANCE_RAD: f64 = 1e-4;

impl RobotArgs {
    fn standing(&self) -> Standing {
        Standing {
            tolerance_m: TOLERANCE_M,
            tolerance_rad: TOLERANCE_RAD,
            least_s: self.least.as_secs_f64(),
            settle_s: self.settle.as_secs_f64(),
            sigma_m: self.sigma_mm / 1e3,
            sigma_rad: self.sigma_deg.to_radians(),
            model_sigma_m: self.model_sigma_mm / 1e3,
            model_sigma_rad: self.model_sigma_deg.to_radians(),
        }
    }
}

/// Runs the subcommand.
pub(super) fn run(args: &RobotArgs) -> anyhow::Result<Outcome> {
    let options = args.common.options("report")?;
    let path = args.poses.as_deref().unwrap_or(Path::new("-"));
    let (belief, text) = Robot::read_with_text(&args.robot)?;
    let corrected = args.corrected.as_deref();
    let corrected = corrected.map(|path| WholeFile::open(Some(path)));
    let corrected = corrected.transpose()?;
    let output = WholeFile::open(args.common.output.as_deref())?;
    let (poses, desired) = inputs::read_with_desired(path, Some(&args.desired), &options)?;
    let places = places(&desired.unwrap_or_default(), &poses, &args.standing());
    let calibrated = calibrate(&belief, &places, &args.find).map_err(|error| match error {
        CalibrationError::Group(_) => Fault::Usage(format!("--find: {error}")),
        _ => Fault::BadData(error.to_string()),
    })?;
    let source = origin::input_name(path);
    let findings = Findings {
        source: &source,
        robot: &belief.name,
        places: &places,
        calibrated: &calibrated,
    };
    if let Some(corrected) = corrected {
        let mut text = text;
        for (i, (old, new)) in belief
            .cables
            .iter()
            .zip(&calibrated.corrected.cables)
            .enumerate()
        {
            if old.pulley_m != new.pulley_m {
                let [x, y, z] = new.pulley_m.map(|v| (v * 1e5).round() / 1e5);
                let value = format!("[{x:?}, {y:?}, {z:?}]");
                text = edit::set(&text, &format!("cable[{i}]"), "pulley_m", &value, None)
                    .map_err(|error| Fault::Configuration(error.to_string()))?;
            }
        }
        corrected.finish(&text)?;
    }
    let text = if args.json {
        findings.json()?
    } else {
        findings.table(args.ascii || !outputs::is_utf8())
    };
    output.finish(&text)?;
    Ok(Outcome::Done)
}
