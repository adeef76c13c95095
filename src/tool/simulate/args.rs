//! The command line of `simulate` and the run that it describes.

use super::course::CourseArgs;
use super::dilution::DilutionArgs;
use super::jobs::JobArgs;
use super::office::SceneArgs;
use super::robot::{self, RobotArgs};
use super::serve_args::{ImuArgs, ServeArgs};
use crate::frame::Frame;
use crate::record::{Axes, Stamp};
use crate::simulate::scanner;
use crate::simulate::{Effect, Effects, Parameters, Seed, Setup, Simulator};
use crate::stream::{Fault, Options};
use crate::tool::arguments::{CommonArgs, FrameArg};
use crate::tool::values::positive;
use std::path::PathBuf;
use std::time::{SystemTime, UNIX_EPOCH};

/// The first scan of a run that is told no other time: 2026-01-01 00:00:00 UTC.
pub(super) const START_NS: i64 = 1_767_225_600_000_000_000;

const EXAMPLES: &str = "\
EFFECTS
  A list, comma-separated, read from left to right; -NAME takes one away:
    noise bias quantisation footprint mixed echoes remission motion angle-jitter outliers dropouts
    cables cargo missing-strip clocks imu
    reference = noise (6.5 mm), bias (+-25 mm common to a scan), quantisation (1 mm), footprint,
                remission (4 % noise, 150 digits are a reflector met squarely at 3 m)
    all       = every one of them, with the data sheet's noise; none = exact ranges of pencil beams

SERVING
  With --serve or --serve-pty there is no stream of scans: the program is the scanner, an LMS511
  that clients log in to, configure and start, in real time. It says on stderr where it is, for
  example: simulate: serving lms511 at 127.0.0.1:2112. A port answers in the dialect that it is
  spoken to in; without a port it is 2111 (CoLa A) and 2112. When the trajectory ends, it waits for
  the clients to leave (--linger), ends the connections in order and ends with status 0, as it does
  on SIGINT and SIGTERM. -v accounts for every scan.
  A driver connects several times before it listens. For it the course waits and lasts:
    simulate -f frame.toml --hold --trajectory loop --loops 1000 --serve 127.0.0.1:2112
    simulate --replay run.cola --repeat 0 --serve 127.0.0.1:2112
  With --imu-pty it is (also) the IMU, a 3DM-GX1 on a serial line that moves with the same platform at
  the same time; alone it ends with the trajectory. --hold waits for the first client that wants
  scans, or, without a scanner, samples.
  Faults: drop, flip (one bit), cut, repeat, garbage =SHARE of the scans; chunk=N..M bytes a piece;
  stall=TIME@TIME, reset@TIME, blackhole=TIME@TIME, reboot=TIME@TIME from the start on. --imu-faults has
  unplug=TIME@TIME too: the port is gone for so long.
  With --model utm-30lx it is a Hokuyo UTM-30LX (SCIP 2.0), at port 10940 unless told otherwise.
  With --format cola the scanner's telegrams are the output; -o FILE then keeps them as a capture
  does, with the arrival times beside them.

EXAMPLES
  Exact scans of a 0.2 m grid, and where the platform truly was:
    simulate -f frame.toml --effects none --trajectory grid --truth truth.csv > scans.csv
  The set-up in which the estimators' figures are stated, with mixed pixels, 200 poses:
    simulate -f frame.toml --effects reference,mixed --trajectory random --n-scans 200 > scans.csv
  Three loops at 3 m/s with a roll of 1 deg at 2 Hz, everything in one MCAP file:
    simulate -f frame.toml --trajectory loop --speed-m-s 3 --loops 3 --wobble-deg 1,0,0 \\
      --wobble-hz 2 --imu-rate-hz 100 --format mcap -o loops.mcap
  Into the chain, with the IMU as a side stream:
    mkfifo imu.fifo; simulate -f frame.toml --imu imu.fifo --truth truth.csv \\
      | extract-lines -f frame.toml | solve-pose -f frame.toml --imu imu.fifo > poses.csv
  A robot on two loops whose upper pulleys are not where its controller believes them to be:
    simulate -f frame.toml --trajectory loop --robot robot.toml --robot-real real.toml --loops 2 \\
      --truth truth.csv --desired desired.csv > scans.csv
  An office and its true lines, for extract-lines and report lines:
    simulate --scene office --view lms500 --n-scans 20 --truth true.csv > office.csv
  The scanner itself for one second, at a port that is free:
    simulate -f frame.toml --n-scans 35 --serve 127.0.0.1:0
  The second of four parts of a run, for another machine; together they are the whole run:
    simulate -f frame.toml --trajectory grid --shard 2/4 --truth truth-2.csv > scans-2.csv
  What a single scan can tell of the pose at all, place by place, with ranges only:
    simulate -f frame.toml --dilution --effects reference,-remission --step-m 1 > dilution.csv
  As a live source, one second of it:
    simulate -f frame.toml --n-scans 35 --real-time | extract-lines -f frame.toml | tail -n 1
";

/// A virtual frame, scanner, IMU and trajectory
#[derive(Debug, clap::Parser)]
#[command(
    name = "simulate",
    version,
    about = "A virtual frame, scanner, IMU and trajectory",
    long_about = "Makes the scans that a 2D laser scanner on the platform would see, the IMU samples \
                  and the truth. Scans go to stdout; with --format mcap truth, desired trajectory and \
                  IMU samples are in the same stream. The same arguments give the same bytes.",
    after_long_help = EXAMPLES
)]
pub struct Args {
    /// Frame file: the box, its reflectors and the mountings
    #[arg(short, long, value_name = "FILE", required_unless_present_any = ["replay", "scene"])]
    frame: Option<PathBuf>,
    /// What is simulated: none, all, reference, or a list (see EFFECTS)
    #[arg(
        long,
        value_name = "LIST",
        default_value = "reference,motion",
        allow_hyphen_values = true
    )]
    pub(super) effects: Effects,
    /// TOML file with the effects' sizes, one table an effect
    #[arg(long, value_name = "FILE")]
    effects_file: Option<PathBuf>,
    #[command(flatten)]
    sizes: SizeArgs,
    #[command(flatten)]
    pub(super) course: CourseArgs,
    /// Scanner model, in place of the frame file's
    #[arg(long, value_name = "NAME")]
    pub(super) model: Option<String>,
    /// Scan frequency [default: the model's first mode]
    #[arg(long, value_name = "HZ")]
    pub(super) frequency_hz: Option<f64>,
    /// Angle from beam to beam [default: the first the frequency goes with]
    #[arg(long, value_name = "DEG")]
    pub(super) resolution_deg: Option<f64>,
    /// Number of scans [default: as many as fit into the trajectory; 1000 random poses]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    n_scans: Option<u64>,
    /// Stamp of the first scan [default: 2026-01-01 UTC, or now with --real-time]
    #[arg(long, value_name = "NS", allow_hyphen_values = true)]
    start_ns: Option<i64>,
    /// Seed of all random numbers
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub(super) seed: u64,
    /// Write the true trajectory at the scans' reference instants, or a scene's true lines (CSV, or
    /// MCAP by .mcap)
    #[arg(long, value_name = "FILE")]
    pub(super) truth: Option<PathBuf>,
    /// Write the desired trajectory at the same instants
    #[arg(long, value_name = "FILE")]
    pub(super) desired: Option<PathBuf>,
    /// Write the IMU samples
    #[arg(long, value_name = "FILE")]
    pub(super) imu: Option<PathBuf>,
    /// IMU samples a second [default: one at each scan's reference instant]
    #[arg(long, value_name = "HZ", value_parser = positive)]
    imu_rate_hz: Option<f64>,
    /// Axes of the IMU samples: platform, or ned as the device sends them
    #[arg(long, value_name = "AXES", default_value = "platform", value_parser = parse_axes)]
    imu_axes: Axes,
    /// Give out each scan when it would be complete
    #[arg(long, conflicts_with = "serving")]
    pub(super) real_time: bool,
    #[command(flatten)]
    pub(super) jobs: JobArgs,
    #[command(flatten)]
    robot: RobotArgs,
    #[command(flatten)]
    pub(super) dilution: DilutionArgs,
    #[command(flatten)]
    pub(super) scene: SceneArgs,
    #[command(flatten)]
    pub(super) serve: ServeArgs,
    #[command(flatten)]
    pub(super) unit: ImuArgs,
    #[command(flatten)]
    pub(super) common: CommonArgs,
}

impl Args {
    /// The checked frame and the file's text.
    pub(super) fn read_frame(&self) -> anyhow::Result<(Frame, String)> {
        let frame = self.frame.clone();
        let frame = frame.ok_or_else(|| Fault::Usage("-f FILE is missing".into()))?;
        FrameArg { frame }.read()
    }

    pub(super) fn sizes(&self) -> &SizeArgs {
        &self.sizes
    }

    pub(super) fn n_scans(&self) -> Option<u64> {
        self.n_scans
    }

    pub(super) fn start_ns(&self) -> Option<i64> {
        self.start_ns
    }
}

/// The most wanted of the effects' sizes.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Sizes of effects (all of them: --effects-file)")]
pub(super) struct SizeArgs {
    /// noise: standard deviation of a range
    #[arg(long, value_name = "MM")]
    pub(super) sigma_mm: Option<f64>,
    /// bias: largest error common to a scan
    #[arg(long, value_name = "MM")]
    bias_mm: Option<f64>,
    /// footprint: share of the spot that must be on a reflector
    #[arg(long, value_name = "SHARE")]
    hit_threshold: Option<f64>,
    /// remission: relative noise
    #[arg(long, value_name = "SHARE")]
    remission_noise: Option<f64>,
    /// outliers: share of the beams
    #[arg(long, value_name = "SHARE")]
    pub(super) outlier_share: Option<f64>,
    /// dropouts: share of the beams
    #[arg(long, value_name = "SHARE")]
    pub(super) dropout_share: Option<f64>,
}

/// What the arguments describe.
pub(super) fn setup(args: &Args, frame: Frame, options: &Options) -> anyhow::Result<Setup> {
    let usage = |error: scanner::ModeError| Fault::Usage(error.to_string());
    let model = scanner::model(&frame, args.model.as_deref()).map_err(usage)?;
    let mode = scanner::mode(model, args.frequency_hz, args.resolution_deg).map_err(usage)?;
    let now_ns = || {
        let since = SystemTime::now().duration_since(UNIX_EPOCH);
        since.map_or(START_NS, |since| since.as_nanos() as i64)
    };
    let start_ns = match args.start_ns {
        Some(start_ns) => start_ns,
        None if args.real_time => now_ns(),
        None => START_NS,
    };
    Ok(Setup {
        parameters: parameters(args, &frame)?,
        course: robot::through(
            &args.robot,
            args.course.course(args.n_scans, Seed(args.seed), options)?,
        )?,
        frame,
        model,
        mode,
        effects: args.effects,
        seed: Seed(args.seed),
        start: Stamp::from_ns(start_ns),
        scans: args.n_scans,
        imu_rate_hz: args.imu_rate_hz,
        imu_axes: args.imu_axes,
    })
}

/// The run, which has at least one scan.
pub(super) fn simulator(setup: Setup) -> Result<Simulator, Fault> {
    if setup.scans() == 0 {
        return Err(Fault::Usage(
            "the trajectory is too short for one scan".into(),
        ));
    }
    Ok(Simulator::new(setup))
}

/// The effects' sizes.
pub(super) fn parameters(args: &Args, frame: &Frame) -> anyhow::Result<Parameters> {
    let mut parameters = match &args.effects_file {
        None => Parameters::default(),
        Some(path) => Parameters::read(path, frame)?,
    };
    let p = &mut parameters;
    let sizes = &args.sizes;
    p.noise.sigma_mm = sizes.sigma_mm.or(p.noise.sigma_mm);
    let given = [
        (sizes.sigma_mm, None, Effect::Noise),
        (sizes.bias_mm, Some(&mut p.bias.common_mm), Effect::Bias),
        (
            sizes.hit_threshold,
            Some(&mut p.footprint.hit_threshold),
            Effect::Footprint,
        ),
        (
            sizes.remission_noise,
            Some(&mut p.remission.noise),
            Effect::Remission,
        ),
        (
            sizes.outlier_share,
            Some(&mut p.outliers.share),
            Effect::Outliers,
        ),
        (
            sizes.dropout_share,
            Some(&mut p.dropouts.share),
            Effect::Dropouts,
        ),
    ];
    for (value, place, effect) in given {
        let Some(value) = value else { continue };
        if !args.effects.has(effect) {
            let message = format!(
                "a size of {0} is given, but --effects has no {0}",
                effect.name()
            );
            return Err(Fault::Usage(message).into());
        }
        if let Some(place) = place {
            *place = value;
        }
    }
    parameters
        .check(frame)
        .map_err(|(key, why)| Fault::Configuration(format!("{key}: {why}")))?;
    Ok(parameters)
}

fn parse_axes(text: &str) -> Result<Axes, String> {
    match text {
        "platform" => Ok(Axes::Platform),
        "ned" => Ok(Axes::Ned),
        _ => Err("platform or ned is wanted".to_owned()),
    }
}
