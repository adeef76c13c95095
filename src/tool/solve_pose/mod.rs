//! solve-pose: reflector lines with strip edges in, poses with covariance out.

use crate::frame::Frame;
use crate::frame::edit;
use crate::pose::alignment::{self, Aligner, Alignment, Observation};
use crate::pose::joint;
use crate::pose::pitch::{self, Attitude, Lookup, Pitch, Settings};
use crate::pose::vote;
use crate::record::{Face, ImuSample, Pose, ReflectorLines, Stamp};
use crate::stream::{self, Emit, Fault, Outcome, SideInput, Stage};
use crate::tool::common::{CommonArgs, FrameArg, parse_duration};
use anyhow::Context;
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

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
    align: AlignArgs,
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
    /// Standard deviation of the IMU's pitch [default: the samples' own, 0.5 where they have none]
    #[arg(long, value_name = "DEG", value_parser = not_negative, conflicts_with = "pitch_deg")]
    imu_pitch_sigma_deg: Option<f64>,
    /// How long a live IMU is waited for
    #[arg(long, value_name = "TIME", default_value = "20ms", value_parser = parse_duration, requires = "imu", conflicts_with = "pitch_deg")]
    imu_wait: Duration,
    /// A sample further than this from the scan is stale
    #[arg(long, value_name = "TIME", default_value = "50ms", value_parser = parse_duration, conflicts_with = "pitch_deg")]
    imu_max_age: Duration,
    /// Samples further apart than this many usual periods are not blended
    #[arg(long, value_name = "PERIODS", default_value_t = 3.0, value_parser = not_negative, conflicts_with = "pitch_deg")]
    imu_max_gap: f64,
    /// A constant pitch in place of an IMU [default without an IMU: 0, sigma 1 deg, status no-imu]
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pitch_deg: Option<f64>,
    /// Standard deviation of --pitch-deg
    #[arg(long, value_name = "DEG", default_value_t = 0.0, value_parser = not_negative, requires = "pitch_deg", conflicts_with = "imu")]
    pitch_sigma_deg: f64,
}

/// Where the IMU sits on the platform.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Alignment")]
struct AlignArgs {
    /// Find how the IMU sits on the platform and write the frame file with that imu.rotation_deg;
    /// roll from every scan, pitch where strips on the walls show it
    #[arg(long, value_name = "FILE", conflicts_with = "pitch_deg")]
    align_imu: Option<PathBuf>,
    /// The platform kept its x while its height changed: this shows the IMU's pitch too
    #[arg(long, requires = "align_imu")]
    align_x_constant: bool,
}

const EXAMPLES: &str = "\
EXAMPLES
  All in one MCAP stream, the IMU's samples too:
    extract-lines -f frame.toml run.mcap | solve-pose -f frame.toml -o poses.mcap
  Pitch from an IMU beside the scans:
    extract-lines -f frame.toml scans.csv | solve-pose -f frame.toml --imu imu.csv > poses.csv
  The same with pitch known to be level:
    extract-lines -f frame.toml scans.csv | solve-pose -f frame.toml --pitch-deg 0 > poses.csv
  How the IMU sits on the platform, from a run in the plane x = 0:
    solve-pose -f frame.toml --imu imu.csv --align-imu aligned.toml --align-x-constant lines.csv \\
      > poses.csv
  The published method, to be compared with the default one:
    solve-pose -f frame.toml --method vote --imu imu.csv lines.csv -o vote.csv";

/// Runs the tool.
pub fn run(args: Args) -> anyhow::Result<Outcome> {
    let mut options = args.common.options("solve-pose")?;
    if args.align.align_imu.is_some() && args.method != Method::Joint {
        let why = "--align-imu needs --method joint: the vote has no covariances";
        return Err(Fault::Usage(why.to_owned()).into());
    }
    let (frame, text) = args.frame.read()?;
    options.configuration = Some(text.clone());
    let source = match (&args.pitch.imu, args.pitch.pitch_deg) {
        (Some(path), _) => Source::Side {
            samples: Box::new(SideInput::open(path, &options)?),
            wait: args.pitch.imu_wait,
        },
        (None, Some(deg)) => Source::Constant(Pitch {
            rad: deg.to_radians(),
            sigma_rad: args.pitch.pitch_sigma_deg.to_radians(),
            stale: false,
        }),
        (None, None) => Source::Stream(VecDeque::new()),
    };
    let lookup = Lookup::new(Settings {
        sigma_rad: args.pitch.imu_pitch_sigma_deg.map(f64::to_radians),
        max_age_s: args.pitch.imu_max_age.as_secs_f64(),
        max_gap_periods: args.pitch.imu_max_gap,
    });
    let align = args.align.align_imu.map(|path| Align {
        path,
        text,
        x_constant: args.align.align_x_constant,
        aligner: Aligner::default(),
        quiet: options.quiet,
    });
    let mut stage = Solve {
        frame,
        method: args.method,
        source,
        lookup,
        instants: Vec::new(),
        changes_rad: Vec::new(),
        align,
        solved: 0,
        unsolved: 0,
    };
    stream::filter(&options, args.input.as_deref(), &mut stage)
}

/// Where each scan's pitch comes from.
enum Source {
    Side {
        samples: Box<SideInput<ImuSample>>,
        wait: Duration,
    },
    Constant(Pitch),
    /// The samples that travel in the same MCAP stream, if it has any.
    Stream(VecDeque<ImuSample>),
}

/// How many samples of the stream are kept: a second of a fast IMU.
const KEPT: usize = 1000;

/// Lines in, one pose each out.
struct Solve {
    frame: Frame,
    method: Method,
    source: Source,
    lookup: Lookup,
    /// The instants at which a scan needs the attitude, in order of time: its reference instant
    /// (no index) and its edges.
    instants: Vec<(Stamp, Option<usize>)>,
    /// By how much the pitch at each edge differs from that at the reference instant, rad.
    changes_rad: Vec<f64>,
    align: Option<Align>,
    solved: u64,
    unsolved: u64,
}

impl Solve {
    /// The IMU's attitude at the lines' reference instant; the changes of pitch at the edges are
    /// put into `changes_rad`.
    fn attitude(&mut self, lines: &ReflectorLines) -> anyhow::Result<Option<Attitude>> {
        self.changes_rad.clear();
        self.changes_rad.resize(lines.edges.len(), 0.0);
        self.instants.clear();
        self.instants.push((lines.stamp, None));
        for (i, edge) in lines.edges.iter().enumerate() {
            self.instants
                .push((lines.stamp.plus_s(edge.time_s), Some(i)));
        }
        // A side input is read forwards only.
        self.instants.sort_by_key(|(stamp, _)| *stamp);
        let begun = Instant::now();
        let mut at_reference = None;
        for (stamp, edge) in &self.instants {
            let around = match &mut self.source {
                Source::Constant(_) => return Ok(None),
                Source::Stream(samples) => {
                    let after = samples.partition_point(|s| s.stamp <= *stamp);
                    let before = after.checked_sub(1).and_then(|i| samples.get(i));
                    (before, samples.get(after))
                }
                Source::Side { samples, wait } => {
                    let left = wait.saturating_sub(begun.elapsed());
                    samples.around(*stamp, left)?
                }
            };
            let found = self.lookup.at(*stamp, around, &self.frame);
            match edge.and_then(|i| self.changes_rad.get_mut(i)) {
                None => at_reference = found,
                Some(change) => {
                    *change = found.filter(|a| !a.stale).map_or(f64::NAN, |a| a.pitch_rad)
                }
            }
        }
        // The reference beam is in the middle of the sweep. Samples that come no faster say nothing
        // of what happens within it.
        let sweep_s = 2.0 * lines.stamp.since_s(lines.scan_stamp);
        let fresh_rad = at_reference
            .filter(|a: &Attitude| !a.stale && self.lookup.resolves(sweep_s))
            .map(|a| a.pitch_rad);
        for change in &mut self.changes_rad {
            let difference = fresh_rad.map_or(0.0, |reference_rad| *change - reference_rad);
            *change = if difference.is_finite() {
                difference
            } else {
                0.0
            };
        }
        Ok(at_reference)
    }
}

impl Stage for Solve {
    type In = ReflectorLines;
    type Out = Pose;

    fn push(&mut self, lines: &ReflectorLines, emit: &mut Emit<'_, Pose>) -> anyhow::Result<()> {
        let attitude = self.attitude(lines)?;
        let pitch = match self.source {
            Source::Constant(pitch) => Some(pitch),
            _ => attitude.map(|a| a.pitch()),
        };
        let solve = |pitch| {
            let options = joint::Options::default();
            joint::solve_pitching(lines, &self.frame, pitch, &self.changes_rad, &options)
        };
        let pose = match self.method {
            Method::Joint => solve(pitch),
            Method::Vote => {
                let pose = vote::pose(lines, &self.frame, pitch.map_or(0.0, |p| p.rad));
                Pose {
                    status: pose.status | pitch::status(pitch),
                    ..pose
                }
            }
        };
        if let (Some(align), Some(attitude)) = (&mut self.align, attitude.filter(|a| !a.stale)) {
            align.add(&pose, &attitude, &self.frame, solve);
        }
        if pose.is_solved() {
            self.solved += 1;
        } else {
            self.unsolved += 1;
        }
        emit.write(&pose)
    }

    fn wants_imu(&self) -> bool {
        matches!(self.source, Source::Stream(_))
    }

    fn imu(&mut self, sample: &ImuSample) {
        if let Source::Stream(samples) = &mut self.source {
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
        let aligned = match &self.align {
            Some(align) => align.write(&self.frame)?,
            None => true,
        };
        let nothing = self.solved == 0 && self.unsolved > 0;
        Ok(if nothing || !aligned {
            Outcome::Degraded
        } else {
            Outcome::Done
        })
    }
}

/// The search for the IMU's mounting.
struct Align {
    path: PathBuf,
    /// The frame file's text.
    text: String,
    x_constant: bool,
    aligner: Aligner,
    quiet: bool,
}

/// Prior of the pitch where the scan is to show it itself, rad: so wide that it says nothing.
const WIDE_RAD: f64 = 3.0 * std::f64::consts::PI / 180.0;
/// Prior with which x is taken to depend on the pitch alone, rad: so narrow that the edges do not
/// move it.
const NARROW_RAD: f64 = 0.05 * std::f64::consts::PI / 180.0;

impl Align {
    fn add(
        &mut self,
        pose: &Pose,
        attitude: &Attitude,
        frame: &Frame,
        solve: impl Fn(Option<Pitch>) -> Pose,
    ) {
        let sigma = |pose: &Pose, k: usize| pose.cov(k, k).sqrt();
        let roll_rad = [pose.rotation_rad[0], sigma(pose, 3)];
        if !(roll_rad[0].is_finite() && roll_rad[1] > 0.0) {
            return;
        }
        let with_prior = |sigma_rad| {
            solve(Some(Pitch {
                sigma_rad,
                ..attitude.pitch()
            }))
        };
        let mut pitch_rad = None;
        if frame.strips.iter().any(|strip| strip.face != Face::Upper) {
            let own = with_prior(WIDE_RAD);
            let posterior = [own.rotation_rad[1], sigma(&own, 4)];
            pitch_rad = alignment::without_prior(posterior, [attitude.pitch_rad, WIDE_RAD]);
        }
        let mut x_m = None;
        if self.x_constant {
            let tied = with_prior(NARROW_RAD);
            let by_pitch = tied.cov(0, 4) / tied.cov(4, 4);
            let own = (tied.cov(0, 0) - by_pitch * tied.cov(0, 4)).sqrt();
            let x = [tied.position_m[0], own, by_pitch];
            x_m = Some(x).filter(|x| x.iter().all(|v| v.is_finite()));
        }
        self.aligner.add(Observation {
            imu_rad: [attitude.roll_rad, attitude.pitch_rad],
            roll_rad,
            pitch_rad,
            x_m,
        });
    }

    /// Writes the frame file with the mounting found; false where there is none, and says so.
    fn write(&self, frame: &Frame) -> anyhow::Result<bool> {
        let found = match self.aligner.solve(frame) {
            Ok(found) => found,
            Err(error) => {
                eprintln!("solve-pose: the IMU is not aligned: {error}");
                return Ok(false);
            }
        };
        let [roll, pitch, yaw] = found.rotation_deg;
        let value = format!("[{roll:.4}, {pitch:.4}, {yaw:.4}]");
        let found = found_in_words(&found);
        let text = edit::set(&self.text, "imu", "rotation_deg", &value, Some(&found))?;
        write_whole(&self.path, &text)
            .with_context(|| format!("{}: cannot be written", self.path.display()))?;
        if !self.quiet {
            let path = self.path.display();
            eprintln!(
                "solve-pose: the IMU on the platform: {found}; {path} has imu.rotation_deg = {value}"
            );
        }
        Ok(true)
    }
}

fn found_in_words(found: &Alignment) -> String {
    let number = |value_rad: f64, sigma_rad: f64| {
        let (value, sigma) = (value_rad.to_degrees(), sigma_rad.to_degrees());
        format!("{value:+.3} +- {sigma:.3} deg")
    };
    let roll = number(found.roll_rad, found.roll_sigma_rad);
    let pitch = match found.pitch_rad {
        Some(pitch_rad) => number(pitch_rad, found.pitch_sigma_rad),
        None => "not shown by this run".to_owned(),
    };
    format!("roll {roll}, pitch {pitch}, from {} scans", found.scans)
}

/// Writes a file that is there whole or not at all.
fn write_whole(path: &Path, text: &str) -> std::io::Result<()> {
    let mut partial = path.as_os_str().to_owned();
    partial.push(".partial");
    std::fs::write(&partial, text)?;
    std::fs::rename(&partial, path)
}

fn not_negative(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value >= 0.0 && value.is_finite() => Ok(value),
        _ => Err("a number that is not negative is wanted".to_owned()),
    }
}

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
