//! The part of `simulate`'s command line that is about where the platform goes.

use crate::motion::{Limits, Motion, Pose, Quintic, SCurve, Sampled, Shuttle, Straight, Wobble};
use crate::record::TrajectoryPoint;
use crate::simulate::{Course, Grid, Places, Scatter, Seed, SharedMotion};
use crate::stream::{Fault, Options, read_all};
use crate::tool::values::{not_negative, parse_duration, positive};
use anyhow::Context;
use nalgebra::Vector3;
use std::path::Path;
use std::time::Duration;

/// Where the platform goes.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Trajectory")]
pub(super) struct CourseArgs {
    /// grid, random (at rest: extract-lines --deskew none); line, loop (moving); or a trajectory file
    /// (CSV or MCAP)
    #[arg(long, value_name = "WHICH", default_value = "line")]
    pub(super) trajectory: String,
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
    #[arg(long, value_name = "DEG", default_value_t = 1.0, value_parser = not_negative)]
    pub(super) tilt_deg: f64,
    /// grid, --dilution: from pose to pose
    #[arg(long, value_name = "M", default_value_t = 0.2, value_parser = positive)]
    pub(super) step_m: f64,
    /// grid: x, roll, pitch and yaw of all poses (m and deg)
    #[arg(long, value_name = "M,DEG,DEG,DEG", default_value = "0,0,0,0", value_parser = parse_numbers::<4>, allow_hyphen_values = true)]
    grid_pose: [f64; 4],
    /// grid, random: scans in each pose
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..))]
    pub(super) scans_per_pose: u64,
    /// line, loop: x, y, z at the start (m), optionally roll, pitch, yaw (deg)
    #[arg(long, value_name = "POSE", default_value = "0,-4,0.465", value_parser = parse_pose, allow_hyphen_values = true)]
    from_pose: Pose,
    /// line, loop: the other end
    #[arg(long, value_name = "POSE", default_value = "0,4,3.5", value_parser = parse_pose, allow_hyphen_values = true)]
    to_pose: Pose,
    /// line: the speed; loop: the highest
    #[arg(long, value_name = "M/S", default_value_t = 1.0, value_parser = positive)]
    speed_m_s: f64,
    /// loop: highest acceleration
    #[arg(long, value_name = "M/S2", default_value_t = 5.0, value_parser = positive)]
    acceleration_m_s2: f64,
    /// loop: highest jerk of the s-curve
    #[arg(long, value_name = "M/S3", default_value_t = 50.0, value_parser = positive)]
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
    #[arg(long, value_name = "HZ", default_value_t = 2.0, value_parser = not_negative)]
    wobble_hz: f64,
    /// moving: the truth follows the desired trajectory this much later
    #[arg(long, value_name = "TIME", default_value = "0ms", value_parser = parse_duration)]
    lag: Duration,
}

impl CourseArgs {
    /// The course; `options` are those with which a trajectory file is read.
    pub(super) fn course(
        &self,
        n_scans: Option<u64>,
        seed: Seed,
        options: &Options,
    ) -> anyhow::Result<Course> {
        let stations = |poses| Course::Stations {
            poses,
            scans_each: self.scans_per_pose,
        };
        match self.trajectory.as_str() {
            "grid" => {
                let [x_m, roll, pitch, yaw] = self.grid_pose;
                let grid = Grid {
                    pose: pose([x_m, 0.0, 0.0], [roll, pitch, yaw]),
                    y_m: self.y_range,
                    z_m: self.z_range,
                    step_m: self.step_m,
                };
                Ok(stations(Places::Grid(grid)))
            }
            "random" => {
                let tilt_rad = self.tilt_deg.to_radians();
                let scatter = Scatter {
                    position_m: [self.x_range, self.y_range, self.z_range],
                    rotation_rad: [[-tilt_rad, tilt_rad]; 3],
                };
                let scans = n_scans.unwrap_or(self.scans_per_pose.saturating_mul(1000));
                Ok(stations(Places::Scattered {
                    scatter,
                    seed,
                    count: scans.div_ceil(self.scans_per_pose),
                }))
            }
            "line" => Ok(moving(
                self,
                Straight {
                    from: self.from_pose,
                    to: self.to_pose,
                    speed_m_s: self.speed_m_s,
                },
            )),
            "loop" => Ok(shuttle(self)),
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
                Ok(moving(self, sampled))
            }
        }
    }
}

fn shuttle(args: &CourseArgs) -> Course {
    let limits = Limits {
        speed_m_s: args.speed_m_s,
        acceleration_m_s2: args.acceleration_m_s2,
        jerk_m_s3: args.jerk_m_s3,
    };
    let distance_m = args.from_pose.distance_m(&args.to_pose);
    if args.profile == "quintic" {
        moving(args, there_and_back(args, Quintic::new(distance_m, limits)))
    } else {
        moving(args, there_and_back(args, SCurve::new(distance_m, limits)))
    }
}

fn there_and_back<P>(args: &CourseArgs, profile: P) -> Shuttle<P> {
    Shuttle {
        from: args.from_pose,
        to: args.to_pose,
        profile,
        dwell_s: args.dwell.as_secs_f64(),
        loops: args.loops,
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
