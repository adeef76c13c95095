//! The command line of solve-pose.

use super::filter::FilterArgs;
use crate::tool::arguments::{CommonArgs, FrameArg};
use crate::tool::values::{not_negative, parse_duration, positive};
use std::path::PathBuf;
use std::time::Duration;

/// The command line.
#[derive(Debug, clap::Parser)]
#[command(
    name = "solve-pose",
    version,
    about = "Solve the platform's pose from reflector lines and strip edges",
    long_about = "Solve the platform's pose from the lines and edges that extract-lines found.\n\n\
        y, z and roll come from the three reflector lines, x and yaw from the strip edges, pitch \
        from an IMU: with strips on the ceiling only, a pitch error of 0.5 deg moves x by 30 mm, \
        and its variance is carried into the pose's covariance. Every scan gives a row; its status \
        says what is not to be trusted, and a scan without a pose has empty numbers.",
    after_long_help = EXAMPLES
)]
pub struct Args {
    /// Reflector lines, CSV or MCAP [default: stdin]
    #[arg(value_name = "LINES")]
    pub input: Option<PathBuf>,
    #[command(flatten)]
    pub(super) frame: FrameArg,
    /// How the pose is solved
    #[arg(long, value_enum, value_name = "METHOD", default_value_t = Method::Joint)]
    pub(super) method: Method,
    #[command(flatten)]
    pub(super) pitch: PitchArgs,
    #[command(flatten)]
    pub(super) align: AlignArgs,
    #[command(flatten)]
    pub(super) calibrate: CalibrateArgs,
    #[command(flatten)]
    pub(super) filter: FilterArgs,
    #[command(flatten)]
    pub(super) common: CommonArgs,
}

/// Ways to solve.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Method {
    /// One state for all components, edges as intervals, full covariance
    Joint,
    /// The published vote over x and yaw (Kurniawan 2017), the baseline; needs all eight edges
    Vote,
}

/// Where pitch comes from.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Pitch")]
pub(super) struct PitchArgs {
    /// IMU samples, a file or a FIFO, CSV or MCAP [default: those in an MCAP input]
    #[arg(long, value_name = "FILE", conflicts_with = "pitch_deg")]
    pub(super) imu: Option<PathBuf>,
    /// Standard deviation of the IMU's pitch [default: the samples' own, 0.5 where they have none]
    #[arg(long, value_name = "DEG", value_parser = not_negative, conflicts_with = "pitch_deg")]
    pub(super) imu_pitch_sigma_deg: Option<f64>,
    /// How long a live IMU is waited for
    #[arg(long, value_name = "TIME", default_value = "20ms", value_parser = parse_duration, requires = "imu", conflicts_with = "pitch_deg")]
    pub(super) imu_wait: Duration,
    /// A sample further than this from the scan is stale
    #[arg(long, value_name = "TIME", default_value = "50ms", value_parser = parse_duration, conflicts_with = "pitch_deg")]
    pub(super) imu_max_age: Duration,
    /// Samples further apart than this many usual periods are not blended
    #[arg(long, value_name = "PERIODS", default_value_t = 3.0, value_parser = not_negative, conflicts_with = "pitch_deg")]
    pub(super) imu_max_gap: f64,
    /// A constant pitch in place of an IMU [default without an IMU: 0, sigma 1 deg, status no-imu]
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub(super) pitch_deg: Option<f64>,
    /// Standard deviation of --pitch-deg
    #[arg(long, value_name = "DEG", default_value_t = 0.0, value_parser = not_negative, requires = "pitch_deg", conflicts_with = "imu")]
    pub(super) pitch_sigma_deg: f64,
}

/// Where the IMU sits on the platform.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Alignment")]
pub(super) struct AlignArgs {
    /// Find how the IMU sits on the platform and write the frame file with that imu.rotation_deg;
    /// roll from every scan, pitch where strips on the walls show it
    #[arg(long, value_name = "FILE", conflicts_with = "pitch_deg")]
    pub(super) align_imu: Option<PathBuf>,
    /// The platform kept its x while its height changed: this shows the IMU's pitch too
    #[arg(long, requires = "align_imu")]
    pub(super) align_x_constant: bool,
}

/// What the run tells of the frame and the devices.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Calibration")]
pub(super) struct CalibrateArgs {
    /// Calibrate from the whole run and write the frame file with what it shows: strips, range bias
    /// and scale, hit threshold, footprint, how scanner and IMU sit; a table on stderr says what
    /// changed and what the run does not show. Every scan at a new place (10 mm, 0.1 deg) counts, the
    /// most 4000, and takes 2 to 6 kB of memory
    #[arg(long, value_name = "FILE", conflicts_with = "align_imu")]
    pub(super) calibrate: Option<PathBuf>,
    /// The platform kept its x while its height changed: this shows the pitch between scanner and IMU
    #[arg(long, requires = "calibrate")]
    pub(super) calibrate_x_constant: bool,
    /// How constant x was (standard deviation)
    #[arg(long, value_name = "MM", default_value_t = 2.0, value_parser = positive, requires = "calibrate_x_constant")]
    pub(super) calibrate_x_sigma_mm: f64,
    /// How well strip edges and box were surveyed (standard deviation)
    #[arg(long, value_name = "MM", default_value_t = 2.0, value_parser = positive, requires = "calibrate")]
    pub(super) survey_sigma_mm: f64,
    /// How well inclinations, and scanner and IMU against each other, were surveyed
    #[arg(long, value_name = "DEG", default_value_t = 0.5, value_parser = positive, requires = "calibrate")]
    pub(super) survey_sigma_deg: f64,
    /// Which is turned where scanner and IMU disagree about roll and pitch: a run shows only the turn
    /// between them [default: imu; without one the scanner, against --pitch-deg]
    #[arg(long, value_enum, value_name = "WHICH", requires = "calibrate")]
    pub(super) calibrate_turn: Option<Turn>,
}

/// Which device is turned on the platform.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Turn {
    /// The scanner sits as the frame file says
    Imu,
    /// The IMU sits as the frame file says
    Scanner,
}

const EXAMPLES: &str = "\
EXAMPLES
  All in one MCAP stream, the IMU's samples too:
    extract-lines -f frame.toml run.mcap | solve-pose -f frame.toml -o poses.mcap
  Pitch from an IMU beside the scans:
    extract-lines -f frame.toml scans.csv | solve-pose -f frame.toml --imu imu.csv > poses.csv
  The same with pitch known to be level:
    extract-lines -f frame.toml scans.csv | solve-pose -f frame.toml --pitch-deg 0 > poses.csv
  Each pose from all scans so far, for a platform that moves or stands:
    extract-lines -f frame.toml scans.csv \\
      | solve-pose -f frame.toml --filter --imu imu.csv > poses.csv
  A recorded run, each pose from all of its scans:
    solve-pose -f frame.toml --smooth --imu imu.csv lines.csv -o smooth.csv
  How the IMU sits on the platform, from a run in the plane x = 0:
    solve-pose -f frame.toml --imu imu.csv --align-imu aligned.toml --align-x-constant lines.csv \\
      > poses.csv
  What a run tells of strips, devices and IMU, the platform having kept its x:
    solve-pose -f frame.toml --imu imu.csv --calibrate calibrated.toml --calibrate-x-constant \\
      lines.csv > poses.csv
  The published method, to be compared with the default one:
    solve-pose -f frame.toml --method vote --imu imu.csv lines.csv -o vote.csv";

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[test]
    fn no_option_about_pitch_is_without_effect() {
        let taken = |options: &str| {
            let words = format!("solve-pose -f frame.toml {options}");
            Args::try_parse_from(words.split_whitespace()).is_ok()
        };
        for options in [
            "--imu imu.csv --imu-wait 1s --imu-max-age 1s --imu-max-gap 4 --imu-pitch-sigma-deg 1",
            "--imu-max-age 1s",
            "--pitch-deg 0 --pitch-sigma-deg 0.1",
        ] {
            assert!(taken(options), "{options}");
        }
        for options in [
            "--pitch-sigma-deg 0.1",
            "--imu imu.csv --pitch-sigma-deg 0.1",
            "--imu-wait 1s",
            "--pitch-deg 0 --imu-pitch-sigma-deg 1",
            "--pitch-deg 0 --imu-max-age 1s",
            "--pitch-deg 0 --imu-max-gap 4",
            "--pitch-deg 0 --imu-wait 1s",
        ] {
            assert!(!taken(options), "{options}");
        }
    }
}
