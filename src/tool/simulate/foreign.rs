//! Options that were written but belong to something else than what is asked for: each would be without
//! effect, and is refused.

use super::serve_args::{self, IMU_OPTIONS};
use super::{Args, office};
use crate::stream::Fault;
use crate::tool::arguments::Format;
use clap::ArgMatches;
use clap::parser::ValueSource;

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
pub(super) fn refuse(args: &Args, written: &ArgMatches) -> Result<(), Fault> {
    if args.scene.scene.is_some() {
        return office::refuse_foreign(written);
    }
    // Clap's own rule is silent where the scene is ruled out by the frame.
    if is_written(written, "view") {
        return Err(Fault::Usage("--view belongs to --scene".into()));
    }
    let cola = args.common.format == Some(Format::Cola);
    let unit = args.unit.imu_pty.is_some();
    serve_args::refuse_foreign(&args.serve, written, cola, unit)?;
    let text = of_a_simulation(args, written)
        .or_else(|| of_an_imu(args, written))
        .or_else(|| of_another_course(args, written));
    text.map_or(Ok(()), |text| Err(Fault::Usage(text)))
}

fn is_written(written: &ArgMatches, option: &str) -> bool {
    written.value_source(option) == Some(ValueSource::CommandLine)
}

/// The option as it is written.
fn dashed(option: &str) -> String {
    option.replace('_', "-")
}

/// What is wrong with an option of a simulation where a recording is played.
fn of_a_simulation(args: &Args, written: &ArgMatches) -> Option<String> {
    args.serve.replay.as_ref()?;
    let courses = COURSE_OPTIONS.iter().map(|(option, _)| *option);
    let mut all = courses.chain(MOVING_OPTIONS).chain(SIMULATION_OPTIONS);
    let option = dashed(all.find(|option| is_written(written, option))?);
    Some(format!(
        "--{option} is for a simulation, and --replay plays a recording"
    ))
}

/// What is wrong with an option of an emulated device where there is none.
fn of_an_imu(args: &Args, written: &ArgMatches) -> Option<String> {
    if args.unit.imu_pty.is_some() || args.unit.imu_record.is_some() {
        return None;
    }
    if let Some(option) = IMU_OPTIONS.into_iter().find(|o| is_written(written, o)) {
        let option = dashed(option);
        return Some(format!("--{option} needs --imu-pty or --imu-record"));
    }
    let idle = args.serve.hold && !args.serve.is_asked();
    idle.then(|| "--hold needs --serve, --serve-pty or --imu-pty".to_owned())
}

/// What is wrong with an option of another trajectory.
fn of_another_course(args: &Args, written: &ArgMatches) -> Option<String> {
    let kind = match args.course.trajectory.as_str() {
        _ if args.dilution.dilution => "--dilution",
        known @ ("grid" | "random" | "line" | "loop") => known,
        _ => "a file",
    };
    let moving: &[&str] = &["line", "loop", "a file"];
    let others = MOVING_OPTIONS.into_iter().map(|option| (option, moving));
    let mut all = COURSE_OPTIONS.into_iter().chain(others);
    let (option, owners) =
        all.find(|(option, owners)| is_written(written, option) && !owners.contains(&kind))?;
    let (option, owners) = (dashed(option), owners.join(", "));
    Some(format!(
        "--{option} belongs to --trajectory {owners}, not to {kind}"
    ))
}
