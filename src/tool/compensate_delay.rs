//! compensate-delay: poses in, the same poses out at the time they are used.

use crate::frame::Frame;
use crate::link::HostInstant;
use crate::motion::{Carrier, CarryMethod, CarryOptions, Inertia};
use crate::record::{ImuSample, Pose, Stamp, Status, TrajectoryPoint};
use crate::stream::{self, Emit, Fault, Outcome, Role, SideInput, Stage, StreamRecord};
use crate::tool::arguments::CommonArgs;
use crate::tool::values::{not_negative, parse_duration, parse_signed_duration, positive};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// The command line.
#[derive(Debug, clap::Parser)]
#[command(
    name = "compensate-delay",
    version,
    about = "Carry poses to the time they are used",
    long_about = "Carry poses to the time they are used: stamp and pose move together, scan_stamp_ns \
        stays.\n\n\
        A pose is measured at one instant and used at a later one; at 3 m/s every millisecond in \
        between is 3 mm. The motion in between comes from a desired motion, from an IMU, or from \
        the poses before. The attitude is carried by a rotation. The covariance grows by what is \
        not known of the motion and of the delay. A pose without numbers passes with its status; \
        one that is not later than the pose before it passes too, and teaches nothing about the \
        motion.",
    after_long_help = EXAMPLES,
    mut_arg("to", |to| to
        .help("Leave out records after TIME; now: carry to the host's time at which a pose is written")
        .value_parser(parse_to))
)]
pub struct Args {
    /// Poses, CSV or MCAP [default: stdin]
    #[arg(value_name = "POSES")]
    pub input: Option<PathBuf>,
    #[command(flatten)]
    delay: DelayArgs,
    #[command(flatten)]
    motion: MotionArgs,
    #[command(flatten)]
    common: CommonArgs,
}

/// How far poses are carried.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Delay")]
struct DelayArgs {
    /// From measurement to use, positive when the measurement lags; with --to now, from writing to use
    #[arg(long, value_name = "TIME", value_parser = parse_signed_duration, allow_hyphen_values = true)]
    delay: Option<f64>,
    /// The delay and its sigma from a result of timesync delay (JSON: delay_s, sigma_s)
    #[arg(long, value_name = "FILE", conflicts_with = "delay")]
    delay_from: Option<PathBuf>,
    /// Standard deviation of the delay [default: 0, or the result's]
    #[arg(long, value_name = "TIME", value_parser = parse_duration)]
    delay_sigma: Option<Duration>,
    /// What the poses' stamps say [default: measured; used with --delay-from, whose delay is how
    /// late the stamps are]
    #[arg(long, value_enum, value_name = "WHICH")]
    stamps: Option<Stamps>,
    /// A pose that would be carried further is emptied, status extrapolated-too-far
    #[arg(long, value_name = "TIME", default_value = "500ms", value_parser = parse_duration)]
    max_horizon: Duration,
}

/// What a pose's stamp says.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Stamps {
    /// When it was measured: stamp and pose move on by the delay
    Measured,
    /// When it is used, which is the delay too late: the pose moves on, the stamp stays
    Used,
}

/// Where the motion is known from.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Motion")]
struct MotionArgs {
    /// Where the motion is known from [default: desired with --motion, imu with --imu, otherwise
    /// constant-acceleration]
    #[arg(long, value_enum, value_name = "METHOD")]
    method: Option<Method>,
    /// desired: the desired trajectory, a file or a FIFO, CSV or MCAP
    #[arg(long, value_name = "FILE")]
    motion: Option<PathBuf>,
    /// desired: how its motion over the delay is found
    #[arg(long, value_enum, value_name = "HOW", default_value_t = Integration::Exact)]
    integration: Integration,
    /// desired: standard deviation of the true velocity about the desired one
    #[arg(long, value_name = "M/S", default_value_t = 0.0, value_parser = not_negative, requires = "motion")]
    following_sigma_m_s: f64,
    /// imu: its samples, a file or a FIFO, CSV or MCAP [default: those in an MCAP input]
    #[arg(long, value_name = "FILE")]
    imu: Option<PathBuf>,
    /// imu: frame file with the IMU's mounting, for samples in the device's axes
    #[arg(short, long, value_name = "FILE")]
    frame: Option<PathBuf>,
    /// How long a live --motion is waited for
    #[arg(long, value_name = "TIME", default_value = "20ms", value_parser = parse_duration, requires = "motion")]
    motion_wait: Duration,
    /// How long a live --imu is waited for
    #[arg(long, value_name = "TIME", default_value = "20ms", value_parser = parse_duration, requires = "imu")]
    imu_wait: Duration,
    /// Points of --motion and samples of --imu further away than this tell nothing
    #[arg(long, value_name = "TIME", default_value = "100ms", value_parser = parse_duration)]
    motion_max_age: Duration,
    /// Standard deviation of a position that comes without a covariance
    #[arg(long, value_name = "MM", default_value_t = 2.0, value_parser = positive)]
    sigma_mm: f64,
    /// Standard deviation of an angle that comes without a covariance
    #[arg(long, value_name = "DEG", default_value_t = 0.1, value_parser = positive)]
    sigma_deg: f64,
}

/// Ways to know the motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Method {
    /// The desired motion of --motion
    Desired,
    /// The poses before, with a velocity
    ConstantVelocity,
    /// The poses before, with velocity and acceleration; after a jerk of tens of m/s^3 it is further
    /// off than its covariance says
    ConstantAcceleration,
    /// Rates and accelerations of --imu, with the velocity of the poses before
    Imu,
    /// Not at all: only the stamp moves, as a baseline
    None,
}

/// Ways to integrate a desired motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Integration {
    /// The difference of the desired poses
    Exact,
    /// The mean of the velocities at both ends times the delay, as published (Kurniawan 2017, eq. 4.27)
    Trapezoid,
}

const EXAMPLES: &str = "\
EXAMPLES
  By the poses' own motion, 62 ms on:
    compensate-delay --delay 62ms poses.csv > used.csv
  By the motion that was asked for, here the /desired of a recorded run:
    compensate-delay --delay 62ms --motion run.mcap poses.csv > used.csv
  By the IMU, in the chain:
    extract-lines -f frame.toml scans.csv | solve-pose -f frame.toml --imu imu.csv \\
      | compensate-delay --delay 62ms --imu imu.csv > used.csv
  Live, to the moment at which each pose is written, with 2 ms more on the way to its user:
    simulate -f frame.toml --n-scans 35 --real-time | extract-lines -f frame.toml \\
      | solve-pose -f frame.toml | compensate-delay --to now --delay 2ms > used.csv
  As if nothing moved, to see what the delay costs:
    compensate-delay --delay 62ms --method none poses.csv > late.csv";

/// `--to now`: a stream's window does not end before the present.
const NOW: stream::Instant = stream::Instant::After(f64::INFINITY);

/// Runs the tool.
pub fn run(args: Args) -> anyhow::Result<Outcome> {
    let mut options = args.common.options("compensate-delay")?;
    let to_now = args.common.to == Some(NOW);
    let (delay_s, sigma_s) = args.delay.read(to_now)?;
    let motion = &args.motion;
    let method = motion.method()?;
    let mut mounting = [0.0; 3];
    if let Some(path) = &motion.frame {
        let (frame, text) = Frame::read_with_text(path)?;
        mounting = frame.imu.rotation_deg.map(f64::to_radians);
        options.configuration = Some(text);
    }
    let guide = match &motion.motion {
        Some(path) => Some(SideInput::open_trajectory(path, Role::Desired, &options)?),
        None => None,
    };
    let imu = match &motion.imu {
        Some(path) => Some(SideInput::open(path, &options)?),
        None => None,
    };
    let carry = CarryOptions {
        method,
        max_horizon_s: args.delay.max_horizon.as_secs_f64(),
        delay_sigma_s: sigma_s,
        reach_s: motion.motion_max_age.as_secs_f64(),
        following_sigma_m_s: motion.following_sigma_m_s,
        position_sigma_m: motion.sigma_mm * 1e-3,
        angle_sigma_rad: motion.sigma_deg.to_radians(),
    };
    let mut stage = Compensate {
        carrier: Carrier::new(carry, Inertia::mounted(mounting)),
        guide: guide.map(|side| (side, motion.motion_wait)),
        imu: imu.map(|side| (side, motion.imu_wait)),
        stream_imu: method == CarryMethod::Imu && motion.imu.is_none(),
        delay_s,
        use_at: match (to_now, args.delay.stamps()) {
            (true, _) => UseAt::Writing,
            (false, Stamps::Measured) => UseAt::Later,
            (false, Stamps::Used) => UseAt::Stamp,
        },
        counts: Counts::default(),
        quiet: options.quiet,
    };
    stream::filter(&options, args.input.as_deref(), &mut stage)
}

impl DelayArgs {
    fn stamps(&self) -> Stamps {
        self.stamps.unwrap_or(match self.delay_from {
            Some(_) => Stamps::Used,
            None => Stamps::Measured,
        })
    }

    /// The delay and its standard deviation, s.
    fn read(&self, to_now: bool) -> anyhow::Result<(f64, f64)> {
        if to_now && self.stamps() == Stamps::Used {
            let why =
                "--to now moves the stamps, --stamps used (which --delay-from means) keeps them";
            return Err(Fault::Usage(why.into()).into());
        }
        let given_s = self.delay_sigma.map(|sigma| sigma.as_secs_f64());
        match (&self.delay_from, self.delay) {
            (Some(path), _) => {
                let (delay_s, sigma_s) = read_result(path)?;
                Ok((delay_s, given_s.or(sigma_s).unwrap_or(0.0)))
            }
            (None, Some(delay_s)) => Ok((delay_s, given_s.unwrap_or(0.0))),
            (None, None) if to_now => Ok((0.0, given_s.unwrap_or(0.0))),
            (None, None) => {
                let why = "how far? Give --delay TIME, --delay-from FILE or --to now";
                Err(Fault::Usage(why.into()).into())
            }
        }
    }
}

impl MotionArgs {
    /// The method, with what it needs.
    fn method(&self) -> anyhow::Result<CarryMethod> {
        let method = self.method.unwrap_or(match (&self.motion, &self.imu) {
            (Some(_), Some(_)) => {
                let why = "--motion and --imu: say with --method which of them is to be used";
                return Err(Fault::Usage(why.into()).into());
            }
            (Some(_), None) => Method::Desired,
            (None, Some(_)) => Method::Imu,
            (None, None) => Method::ConstantAcceleration,
        });
        let usage = |why: &str| Err(Fault::Usage(why.into()).into());
        match method {
            Method::Desired if self.motion.is_none() => {
                return usage("--method desired needs the desired trajectory: --motion FILE");
            }
            Method::Desired => {}
            _ if self.motion.is_some() => return usage("--motion belongs to --method desired"),
            _ if self.integration != Integration::Exact => {
                return usage("--integration belongs to --method desired");
            }
            _ => {}
        }
        if method != Method::Imu && self.imu.is_some() {
            return usage("--imu belongs to --method imu");
        }
        if method != Method::Imu && self.frame.is_some() {
            return usage("--frame has the IMU's mounting, and belongs to --method imu");
        }
        Ok(match (method, self.integration) {
            (Method::Desired, Integration::Exact) => CarryMethod::DesiredExact,
            (Method::Desired, Integration::Trapezoid) => CarryMethod::DesiredTrapezoid,
            (Method::ConstantVelocity, _) => CarryMethod::ConstantVelocity,
            (Method::ConstantAcceleration, _) => CarryMethod::ConstantAcceleration,
            (Method::Imu, _) => CarryMethod::Imu,
            (Method::None, _) => CarryMethod::None,
        })
    }
}

/// A result of `timesync delay`: the delay and, where it is given, its standard deviation, s.
fn read_result(path: &Path) -> anyhow::Result<(f64, Option<f64>)> {
    #[derive(serde::Deserialize)]
    struct Result {
        delay_s: f64,
        sigma_s: Option<f64>,
    }
    let name = path.display();
    let text = std::fs::read_to_string(path).map_err(|error| {
        let text = error.to_string();
        let text = text.split(" (os error").next().unwrap_or(&text);
        Fault::NoInput(format!("{name}: {text}"))
    })?;
    let bad = |why: String| {
        let wanted = "the JSON of timesync delay is wanted, with delay_s and sigma_s";
        Fault::BadData(format!("{name}: {why}; {wanted}"))
    };
    let result: Result = serde_json::from_str(&text).map_err(|error| bad(error.to_string()))?;
    match result.sigma_s {
        Some(sigma_s) if !(sigma_s >= 0.0) => Err(bad("sigma_s: negative".to_owned()).into()),
        sigma_s => Ok((result.delay_s, sigma_s)),
    }
}

/// When a pose is used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum UseAt {
    /// The delay after its stamp.
    Later,
    /// At its stamp; it was measured the delay before.
    Stamp,
    /// The delay after it is written.
    Writing,
}

#[derive(Default)]
struct Counts {
    poses: u64,
    too_far: u64,
    stale: u64,
}

/// Poses in, carried poses out.
struct Compensate {
    carrier: Carrier,
    guide: Option<(SideInput<TrajectoryPoint>, Duration)>,
    imu: Option<(SideInput<ImuSample>, Duration)>,
    stream_imu: bool,
    delay_s: f64,
    use_at: UseAt,
    counts: Counts,
    quiet: bool,
}

impl Compensate {
    /// Reads the side inputs: up to `needed`, for which a live one is waited for, and up to
    /// `wanted` what is there.
    fn read_motion(&mut self, needed: Stamp, wanted: Stamp) -> anyhow::Result<()> {
        if let Some((side, wait)) = &mut self.guide {
            let guide = self.carrier.guide();
            read_side(side, *wait, needed, wanted, |point| guide.push(point))?;
        }
        if let Some((side, wait)) = &mut self.imu {
            let inertia = self.carrier.inertia();
            read_side(side, *wait, needed, wanted, |sample| inertia.push(sample))?;
        }
        Ok(())
    }

    fn now(&self) -> Stamp {
        HostInstant::now().utc.plus_s(self.delay_s)
    }
}

fn read_side<R: StreamRecord>(
    side: &mut SideInput<R>,
    wait: Duration,
    needed: Stamp,
    wanted: Stamp,
    mut take: impl FnMut(&R),
) -> anyhow::Result<()> {
    let deadline = Instant::now().checked_add(wait);
    while let Some(record) = side.next_until(needed, deadline)? {
        take(&record);
    }
    while let Some(record) = side.next_until(wanted, Some(Instant::now()))? {
        take(&record);
    }
    Ok(())
}

impl Stage for Compensate {
    type In = Pose;
    type Out = Pose;

    fn push(&mut self, pose: &Pose, emit: &mut Emit<'_, Pose>) -> anyhow::Result<()> {
        let (measured, used) = match self.use_at {
            UseAt::Later => (pose.stamp, pose.stamp.plus_s(self.delay_s)),
            UseAt::Stamp => (pose.stamp.plus_s(-self.delay_s), pose.stamp),
            // Waiting for what comes after the measurement would only make now later.
            UseAt::Writing => (pose.stamp, self.now()),
        };
        let needed = match self.use_at {
            UseAt::Writing => measured,
            UseAt::Later | UseAt::Stamp => measured.max(used),
        };
        self.read_motion(needed, needed.max(used))?;
        self.carrier.measure(pose, measured);
        let used = match self.use_at {
            UseAt::Writing => self.now(),
            UseAt::Later | UseAt::Stamp => used,
        };
        let carried = self.carrier.carried(pose, measured, used);
        self.counts.poses += 1;
        if carried.status.has(Status::TOO_FAR) {
            self.counts.too_far += 1;
        }
        let stale = Status::STALE_MOTION | Status::STALE_IMU | Status::NO_IMU;
        if (carried.status.bits() & !pose.status.bits()) & stale.bits() != 0 {
            self.counts.stale += 1;
        }
        emit.write(&carried)
    }

    fn wants_imu(&self) -> bool {
        self.stream_imu
    }

    fn imu(&mut self, sample: &ImuSample) {
        self.carrier.inertia().push(sample);
    }

    fn finish(&mut self, _emit: &mut Emit<'_, Pose>) -> anyhow::Result<Outcome> {
        let Counts {
            poses,
            too_far,
            stale,
        } = self.counts;
        if too_far > 0 {
            eprintln!(
                "compensate-delay: {too_far} of {poses} poses were further than --max-horizon from \
                 their use and are empty; see their status"
            );
        }
        if stale > 0 && !self.quiet {
            eprintln!(
                "compensate-delay: {stale} of {poses} poses found no motion around them and were \
                 carried by the poses' own; see their status"
            );
        }
        let nothing = too_far > 0 && too_far == poses;
        Ok(if nothing {
            Outcome::Degraded
        } else {
            Outcome::Done
        })
    }
}

/// `--to`: a time as every tool takes it, or now.
fn parse_to(text: &str) -> Result<stream::Instant, String> {
    if text == "now" {
        return Ok(NOW);
    }
    crate::tool::values::parse_instant(text).map_err(|why| format!("{why}, or now"))
}
