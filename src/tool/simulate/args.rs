//! The command line of `simulate` and the run that it describes.

use super::dilution::DilutionArgs;
use super::jobs::JobArgs;
use super::office::{self, SceneArgs};
use super::robot::{self, RobotArgs};
use super::serve_args::{self, IMU_OPTIONS, ImuArgs, ServeArgs};
use crate::frame::Frame;
use crate::motion::{Limits, Motion, Pose, Quintic, SCurve, Sampled, Shuttle, Straight, Wobble};
use crate::record::{Axes, Stamp, TrajectoryPoint};
use crate::simulate::scanner;
use crate::simulate::{
    Course, Effect, Effects, Grid, Parameters, Places, Scatter, Seed, Setup, SharedMotion,
};
use crate::stream::{Fault, Options, read_all};
use crate::tool::arguments::{CommonArgs, Format, FrameArg};
use crate::tool::values::parse_duration;
use anyhow::Context;
use nalgebra::Vector3;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

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
    #[arg(long, value_name = "N")]
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
    #[arg(long, value_name = "HZ")]
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

    pub(super) fn scans_per_pose(&self) -> u64 {
        self.course.scans_per_pose
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

/// Where the platform goes.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Trajectory")]
pub(super) struct CourseArgs {
    /// grid, random (at rest: extract-lines --deskew none); line, loop (moving); or a trajectory file
    /// (CSV or MCAP)
    #[arg(long, value_name = "WHICH", default_value = "line")]
    trajectory: String,
    /// grid, random, --dilution: y from and to
    #[arg(long, value_name = "M,M", default_value = "-4,4", value_parser = parse_span, allow_hyphen_values = true)]
    pub(super) y_range: [f64; 2],
    /// grid, random, --dilution: z from and to
    #[arg(long, value_name = "M,M", default_value = "0.5,3.5", value_parser = parse_span, allow_hyphen_values = true)]
    pub(super) z_range: [f64; 2],
    /// random, --dilution: x from and to
    #[arg(long, value_name = "M,M", default_value = "-0.05,0.05", value_parser = parse_span, allow_hyphen_values = true)]
    pub(super) x_range: [f64; 2],
    /// random, --dilution: largest roll, pitch and yaw, to both sides
    #[arg(long, value_name = "DEG", default_value_t = 1.0)]
    pub(super) tilt_deg: f64,
    /// grid, --dilution: from pose to pose
    #[arg(long, value_name = "M", default_value_t = 0.2)]
    pub(super) step_m: f64,
    /// grid: x, roll, pitch and yaw of all poses (m and deg)
    #[arg(long, value_name = "M,DEG,DEG,DEG", default_value = "0,0,0,0", value_parser = parse_numbers::<4>, allow_hyphen_values = true)]
    grid_pose: [f64; 4],
    /// grid, random: scans in each pose
    #[arg(long, value_name = "N", default_value_t = 1)]
    scans_per_pose: u64,
    /// line, loop: x, y, z at the start (m), optionally roll, pitch, yaw (deg)
    #[arg(long, value_name = "POSE", default_value = "0,-4,0.465", value_parser = parse_pose, allow_hyphen_values = true)]
    from_pose: Pose,
    /// line, loop: the other end
    #[arg(long, value_name = "POSE", default_value = "0,4,3.5", value_parser = parse_pose, allow_hyphen_values = true)]
    to_pose: Pose,
    /// line: the speed; loop: the highest
    #[arg(long, value_name = "M/S", default_value_t = 1.0)]
    speed_m_s: f64,
    /// loop: highest acceleration
    #[arg(long, value_name = "M/S2", default_value_t = 5.0)]
    acceleration_m_s2: f64,
    /// loop: highest jerk of the s-curve
    #[arg(long, value_name = "M/S3", default_value_t = 50.0)]
    jerk_m_s3: f64,
    /// loop: s-curve or quintic
    #[arg(long, value_name = "WHICH", default_value = "s-curve", value_parser = ["s-curve", "quintic"])]
    profile: String,
    /// loop: how often there and back
    #[arg(long, value_name = "N", default_value_t = 1)]
    loops: u32,
    /// loop: rest at each end
    #[arg(long, value_name = "TIME", default_value = "500ms", value_parser = parse_duration)]
    dwell: Duration,
    /// moving: amplitudes of a roll, pitch and yaw that are not desired
    #[arg(long, value_name = "DEG,DEG,DEG", value_parser = parse_numbers::<3>, allow_hyphen_values = true)]
    wobble_deg: Option<[f64; 3]>,
    /// moving: their frequency
    #[arg(long, value_name = "HZ", default_value_t = 2.0)]
    wobble_hz: f64,
    /// moving: the truth follows the desired trajectory this much later
    #[arg(long, value_name = "TIME", default_value = "0ms", value_parser = parse_duration)]
    lag: Duration,
}

/// The trajectories (a file is "moving") and the options that each of them takes.
const COURSE_OPTIONS: [(&str, &[&str]); 16] = [
    ("y_range", &["grid", "random", "--dilution"]),
    ("z_range", &["grid", "random", "--dilution"]),
    ("x_range", &["random", "--dilution"]),
    ("tilt_deg", &["random", "--dilution"]),
    ("step_m", &["grid", "--dilution"]),
    ("grid_pose", &["grid"]),
    ("scans_per_pose", &["grid", "random"]),
    ("from_pose", &["line", "loop"]),
    ("to_pose", &["line", "loop"]),
    ("speed_m_s", &["line", "loop"]),
    ("acceleration_m_s2", &["loop"]),
    ("jerk_m_s3", &["loop"]),
    ("profile", &["loop"]),
    ("loops", &["loop"]),
    ("dwell", &["loop"]),
    ("wobble_deg", &["line", "loop", "a file"]),
];
/// Options of every moving trajectory beside the wobble.
const MOVING_OPTIONS: [&str; 2] = ["wobble_hz", "lag"];

/// Options of a simulation that a recording has no use for, beside the trajectory's.
const SIMULATION_OPTIONS: [&str; 20] = [
    "robot",
    "robot_real",
    "trajectory",
    "effects",
    "effects_file",
    "sigma_mm",
    "bias_mm",
    "hit_threshold",
    "remission_noise",
    "outlier_share",
    "dropout_share",
    "model",
    "frequency_hz",
    "resolution_deg",
    "n_scans",
    "start_ns",
    "truth",
    "desired",
    "imu",
    "imu_rate_hz",
];

/// Refuses an option that was written but belongs to another trajectory, or to none.
pub(super) fn refuse_foreign(args: &Args, written: &clap::ArgMatches) -> Result<(), Fault> {
    if args.scene.scene.is_some() {
        return office::refuse_foreign(written);
    }
    // Clap's own rule is silent where the scene is ruled out by the frame.
    if written.value_source("view") == Some(clap::parser::ValueSource::CommandLine) {
        return Err(Fault::Usage("--view belongs to --scene".into()));
    }
    let cola = args.common.format == Some(Format::Cola);
    let unit = args.unit.imu_pty.is_some();
    serve_args::refuse_foreign(&args.serve, written, cola, unit)?;
    if args.serve.replay.is_some() {
        let courses = COURSE_OPTIONS.iter().map(|(option, _)| *option);
        let all = courses.chain(MOVING_OPTIONS).chain(SIMULATION_OPTIONS);
        let is_written = |option: &&str| {
            written.value_source(option) == Some(clap::parser::ValueSource::CommandLine)
        };
        if let Some(option) = all.into_iter().find(is_written) {
            let option = option.replace('_', "-");
            let text = format!("--{option} is for a simulation, and --replay plays a recording");
            return Err(Fault::Usage(text));
        }
    }
    let kind = match args.course.trajectory.as_str() {
        _ if args.dilution.dilution => "--dilution",
        known @ ("grid" | "random" | "line" | "loop") => known,
        _ => "a file",
    };
    let moving: &[&str] = &["line", "loop", "a file"];
    let others = MOVING_OPTIONS.into_iter().map(|option| (option, moving));
    let commanded =
        |option: &str| written.value_source(option) == Some(clap::parser::ValueSource::CommandLine);
    if args.unit.imu_pty.is_none() && args.unit.imu_record.is_none() {
        if let Some(option) = IMU_OPTIONS.into_iter().find(|o| commanded(o)) {
            let text = format!(
                "--{} needs --imu-pty or --imu-record",
                option.replace('_', "-")
            );
            return Err(Fault::Usage(text));
        }
        if args.serve.hold && !args.serve.is_asked() {
            return Err(Fault::Usage(
                "--hold needs --serve, --serve-pty or --imu-pty".into(),
            ));
        }
    }
    for (option, owners) in COURSE_OPTIONS.into_iter().chain(others) {
        let source = written.value_source(option);
        if source == Some(clap::parser::ValueSource::CommandLine) && !owners.contains(&kind) {
            let (option, owners) = (option.replace('_', "-"), owners.join(", "));
            let text = format!("--{option} belongs to --trajectory {owners}, not to {kind}");
            return Err(Fault::Usage(text));
        }
    }
    Ok(())
}

/// What the arguments describe.
pub(super) fn setup(args: &Args, frame: Frame, options: &Options) -> anyhow::Result<Setup> {
    let usage = |error: scanner::ModeError| Fault::Usage(error.to_string());
    let model = scanner::model(&frame, args.model.as_deref()).map_err(usage)?;
    let mode = scanner::mode(model, args.frequency_hz, args.resolution_deg).map_err(usage)?;
    if args
        .imu_rate_hz
        .is_some_and(|hz| !(hz > 0.0 && hz.is_finite()))
    {
        return Err(Fault::Usage("--imu-rate-hz must be above 0".into()).into());
    }
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
            course(&args.course, args.n_scans, Seed(args.seed), options)?,
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

/// The effects' sizes.
pub(super) fn parameters(args: &Args, frame: &Frame) -> anyhow::Result<Parameters> {
    let mut parameters = match &args.effects_file {
        None => Parameters::default(),
        Some(path) => {
            let text = std::fs::read_to_string(path)
                .map_err(|error| Fault::NoInput(format!("{}: {error}", path.display())))?;
            toml::from_str(&text)
                .map_err(|error| Fault::Configuration(format!("{}: {error}", path.display())))?
        }
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
        .map_err(|error| Fault::Configuration(error.to_string()))?;
    Ok(parameters)
}

fn course(
    args: &CourseArgs,
    n_scans: Option<u64>,
    seed: Seed,
    options: &Options,
) -> anyhow::Result<Course> {
    let positive = [
        args.step_m,
        args.speed_m_s,
        args.acceleration_m_s2,
        args.jerk_m_s3,
    ];
    if !positive.iter().all(|v| *v > 0.0 && v.is_finite()) || args.scans_per_pose == 0 {
        let message = "step, speed, acceleration, jerk and scans per pose must be above 0";
        return Err(Fault::Usage(message.into()).into());
    }
    if !(args.tilt_deg >= 0.0 && args.tilt_deg.is_finite() && args.wobble_hz.is_finite()) {
        let message = "--tilt-deg must not be negative, and --wobble-hz a number";
        return Err(Fault::Usage(message.into()).into());
    }
    let stations = |poses| Course::Stations {
        poses,
        scans_each: args.scans_per_pose,
    };
    match args.trajectory.as_str() {
        "grid" => {
            let [x_m, roll, pitch, yaw] = args.grid_pose;
            let grid = Grid {
                pose: pose([x_m, 0.0, 0.0], [roll, pitch, yaw]),
                y_m: args.y_range,
                z_m: args.z_range,
                step_m: args.step_m,
            };
            Ok(stations(Places::Grid(grid)))
        }
        "random" => {
            let tilt_rad = args.tilt_deg.to_radians();
            let scatter = Scatter {
                position_m: [args.x_range, args.y_range, args.z_range],
                rotation_rad: [[-tilt_rad, tilt_rad]; 3],
            };
            let scans = n_scans.unwrap_or(1000 * args.scans_per_pose);
            Ok(stations(Places::Scattered {
                scatter,
                seed,
                count: scans.div_ceil(args.scans_per_pose),
            }))
        }
        "line" => Ok(moving(
            args,
            Straight {
                from: args.from_pose,
                to: args.to_pose,
                speed_m_s: args.speed_m_s,
            },
        )),
        "loop" => Ok(shuttle(args)),
        path => {
            let role_options = Options {
                window: Default::default(),
                ..options.clone()
            };
            let points: Vec<TrajectoryPoint> = read_all(Some(Path::new(path)), &role_options)
                .context(
                    "--trajectory is neither grid, random, line, loop nor a file that can be read",
                )?;
            let sampled = Sampled::new(&points)
                .map_err(|error| Fault::BadData(format!("{path}: {error}")))?;
            Ok(moving(args, sampled))
        }
    }
}

fn shuttle(args: &CourseArgs) -> Course {
    let limits = Limits {
        speed_m_s: args.speed_m_s,
        acceleration_m_s2: args.acceleration_m_s2,
        jerk_m_s3: args.jerk_m_s3,
    };
    let (from, to) = (args.from_pose, args.to_pose);
    let distance_m = from.distance_m(&to);
    let (dwell_s, loops) = (args.dwell.as_secs_f64(), args.loops);
    if args.profile == "quintic" {
        let profile = Quintic::new(distance_m, limits);
        moving(
            args,
            Shuttle {
                from,
                to,
                profile,
                dwell_s,
                loops,
            },
        )
    } else {
        let profile = SCurve::new(distance_m, limits);
        moving(
            args,
            Shuttle {
                from,
                to,
                profile,
                dwell_s,
                loops,
            },
        )
    }
}

fn moving(args: &CourseArgs, desired: impl Motion + Clone + Send + Sync + 'static) -> Course {
    let truth: SharedMotion = match args.wobble_deg {
        Some(amplitude_deg) => Box::new(Wobble {
            motion: desired.clone(),
            amplitude_rad: amplitude_deg.map(f64::to_radians).into(),
            frequency_hz: args.wobble_hz,
        }),
        None => Box::new(desired.clone()),
    };
    Course::Moving {
        truth,
        desired: Box::new(desired),
        lag_s: args.lag.as_secs_f64(),
    }
}

fn pose(position_m: [f64; 3], rotation_deg: [f64; 3]) -> Pose {
    Pose {
        position_m: Vector3::from(position_m),
        rotation_rad: Vector3::from(rotation_deg.map(f64::to_radians)),
    }
}

fn numbers(text: &str) -> Result<Vec<f64>, String> {
    text.split(',')
        .map(|item| match item.trim().parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(value),
            _ => Err(format!("\"{item}\" is not a number")),
        })
        .collect()
}

fn parse_numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let count = |values: Vec<f64>| format!("{N} numbers are wanted, not {}", values.len());
    <[f64; N]>::try_from(numbers(text)?).map_err(count)
}

fn parse_span(text: &str) -> Result<[f64; 2], String> {
    let [from, to] = parse_numbers::<2>(text)?;
    if from > to {
        return Err(format!("{from} lies above {to}"));
    }
    Ok([from, to])
}

fn parse_pose(text: &str) -> Result<Pose, String> {
    match numbers(text)?.as_slice() {
        [x, y, z] => Ok(pose([*x, *y, *z], [0.0; 3])),
        [x, y, z, roll, pitch, yaw] => Ok(pose([*x, *y, *z], [*roll, *pitch, *yaw])),
        other => Err(format!("3 or 6 numbers are wanted, not {}", other.len())),
    }
}

fn parse_axes(text: &str) -> Result<Axes, String> {
    match text {
        "platform" => Ok(Axes::Platform),
        "ned" => Ok(Axes::Ned),
        _ => Err("platform or ned is wanted".to_owned()),
    }
}
