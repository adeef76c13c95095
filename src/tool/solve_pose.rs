//! solve-pose: reflector lines with strip edges in, poses with covariance out.

use crate::frame::Frame;
use crate::pose::joint;
use crate::pose::pitch::{self, Pitch};
use crate::pose::vote;
use crate::record::{ImuSample, Pose, ReflectorLines};
use crate::stream::{self, Emit, Outcome, SideInput, Stage};
use crate::tool::common::{CommonArgs, FrameArg, parse_duration};
use std::collections::VecDeque;
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
    frame: FrameArg,
    /// How the pose is solved
    #[arg(long, value_enum, value_name = "METHOD", default_value_t = Method::Joint)]
    method: Method,
    #[command(flatten)]
    pitch: PitchArgs,
    #[command(flatten)]
    common: CommonArgs,
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
struct PitchArgs {
    /// IMU samples, a file or a FIFO, CSV or MCAP [default: those in an MCAP input]
    #[arg(long, value_name = "FILE", conflicts_with = "pitch_deg")]
    imu: Option<PathBuf>,
    /// Standard deviation of the IMU's pitch
    #[arg(long, value_name = "DEG", default_value_t = 0.5, value_parser = not_negative)]
    imu_pitch_sigma_deg: f64,
    /// How long a live IMU is waited for
    #[arg(long, value_name = "TIME", default_value = "20ms", value_parser = parse_duration)]
    imu_wait: Duration,
    /// A sample further than this from the scan is stale
    #[arg(long, value_name = "TIME", default_value = "50ms", value_parser = parse_duration)]
    imu_max_age: Duration,
    /// A constant pitch in place of an IMU [default without an IMU: 0, sigma 1 deg, status no-imu]
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pitch_deg: Option<f64>,
    /// Standard deviation of --pitch-deg
    #[arg(long, value_name = "DEG", default_value_t = 0.0, value_parser = not_negative)]
    pitch_sigma_deg: f64,
}

const EXAMPLES: &str = "\
EXAMPLES
  All in one MCAP stream, the IMU's samples too:
    extract-lines -f frame.toml run.mcap | solve-pose -f frame.toml -o poses.mcap
  Pitch from an IMU beside the scans:
    extract-lines -f frame.toml scans.csv | solve-pose -f frame.toml --imu imu.csv > poses.csv
  The same with pitch known to be level:
    extract-lines -f frame.toml scans.csv | solve-pose -f frame.toml --pitch-deg 0 > poses.csv
  The published method, to be compared with the default one:
    solve-pose -f frame.toml --method vote --imu imu.csv lines.csv -o vote.csv";

/// Runs the tool.
pub fn run(args: Args) -> anyhow::Result<Outcome> {
    let mut options = args.common.options("solve-pose")?;
    let (frame, text) = args.frame.read()?;
    options.configuration = Some(text);
    let source = match (&args.pitch.imu, args.pitch.pitch_deg) {
        (Some(path), _) => Source::Imu {
            samples: Box::new(SideInput::open(path, &options)?),
            sigma_rad: args.pitch.imu_pitch_sigma_deg.to_radians(),
            wait: args.pitch.imu_wait,
            max_age_s: args.pitch.imu_max_age.as_secs_f64(),
        },
        (None, Some(deg)) => Source::Constant(Pitch {
            rad: deg.to_radians(),
            sigma_rad: args.pitch.pitch_sigma_deg.to_radians(),
            stale: false,
        }),
        (None, None) => Source::Stream {
            samples: VecDeque::new(),
            sigma_rad: args.pitch.imu_pitch_sigma_deg.to_radians(),
            max_age_s: args.pitch.imu_max_age.as_secs_f64(),
        },
    };
    let mut stage = Solve {
        frame,
        method: args.method,
        source,
        solved: 0,
        unsolved: 0,
    };
    stream::filter(&options, args.input.as_deref(), &mut stage)
}

/// Where each scan's pitch comes from.
enum Source {
    Imu {
        samples: Box<SideInput<ImuSample>>,
        sigma_rad: f64,
        wait: Duration,
        max_age_s: f64,
    },
    Constant(Pitch),
    /// The samples that travel in the same MCAP stream, if it has any.
    Stream {
        samples: VecDeque<ImuSample>,
        sigma_rad: f64,
        max_age_s: f64,
    },
}

/// How many samples of the stream are kept: a second of a fast IMU.
const KEPT: usize = 1000;

/// Lines in, one pose each out.
struct Solve {
    frame: Frame,
    method: Method,
    source: Source,
    solved: u64,
    unsolved: u64,
}

impl Solve {
    fn pitch(&mut self, lines: &ReflectorLines) -> anyhow::Result<Option<Pitch>> {
        match &mut self.source {
            Source::Stream {
                samples,
                sigma_rad,
                max_age_s,
            } => {
                let after = samples.partition_point(|s| s.stamp <= lines.stamp);
                let before = after.checked_sub(1).and_then(|i| samples.get(i));
                let around = (before, samples.get(after));
                Ok(pitch::at(
                    lines.stamp,
                    around,
                    &self.frame,
                    *sigma_rad,
                    *max_age_s,
                ))
            }
            Source::Constant(pitch) => Ok(Some(*pitch)),
            Source::Imu {
                samples,
                sigma_rad,
                wait,
                max_age_s,
            } => {
                let around = samples.around(lines.stamp, *wait)?;
                Ok(pitch::at(
                    lines.stamp,
                    around,
                    &self.frame,
                    *sigma_rad,
                    *max_age_s,
                ))
            }
        }
    }
}

impl Stage for Solve {
    type In = ReflectorLines;
    type Out = Pose;

    fn push(&mut self, lines: &ReflectorLines, emit: &mut Emit<'_, Pose>) -> anyhow::Result<()> {
        let pitch = self.pitch(lines)?;
        let pose = match self.method {
            Method::Joint => joint::solve(lines, &self.frame, pitch, &joint::Options::default()),
            Method::Vote => {
                let pose = vote::pose(lines, &self.frame, pitch.map_or(0.0, |p| p.rad));
                Pose {
                    status: pose.status | pitch::status(pitch),
                    ..pose
                }
            }
        };
        if pose.is_solved() {
            self.solved += 1;
        } else {
            self.unsolved += 1;
        }
        emit.write(&pose)
    }

    fn wants_imu(&self) -> bool {
        matches!(self.source, Source::Stream { .. })
    }

    fn imu(&mut self, sample: &ImuSample) {
        if let Source::Stream { samples, .. } = &mut self.source {
            if samples.len() == KEPT {
                samples.pop_front();
            }
            samples.push_back(*sample);
        }
    }

    fn finish(&mut self, _emit: &mut Emit<'_, Pose>) -> anyhow::Result<Outcome> {
        if self.unsolved > 0 {
            let all = self.solved + self.unsolved;
            eprintln!(
                "solve-pose: {} of {all} scans gave no pose; see their status",
                self.unsolved
            );
        }
        let nothing = self.solved == 0 && self.unsolved > 0;
        Ok(if nothing {
            Outcome::Degraded
        } else {
            Outcome::Done
        })
    }
}

fn not_negative(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value >= 0.0 && value.is_finite() => Ok(value),
        _ => Err("a number that is not negative is wanted".to_owned()),
    }
}
