//! `simulate --robot`: the platform goes where a cable robot's winches put it.

use crate::motion::{Motion, Sampled};
use crate::record::{Stamp, TrajectoryPoint};
use crate::robot::{Pose, Robot, Winches};
use crate::simulate::Course;
use crate::stream::Fault;
use std::path::PathBuf;

/// The robot that moves the platform.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Cable robot")]
pub(super) struct RobotArgs {
    /// moving: the truth is where the cables of this robot put the platform when its controller, which
    /// knows it by this file, wants it on the desired trajectory
    #[arg(long, value_name = "FILE")]
    robot: Option<PathBuf>,
    /// The robot as it is, where that is not what its controller believes [default: --robot's]
    #[arg(long, value_name = "FILE", requires = "robot")]
    robot_real: Option<PathBuf>,
}

/// Time between two points of the desired trajectory that are taken through the kinematics, s. The
/// truth between them is a cubic, which is good to a micrometre where the jerk changes by 200 m/s^3.
const STEP_S: f64 = 0.005;

/// The course with its truth taken through the robot, if there is one.
pub(super) fn through(args: &RobotArgs, course: Course) -> anyhow::Result<Course> {
    let Some(path) = &args.robot else {
        return Ok(course);
    };
    let belief = Robot::read(path)?;
    let real = match &args.robot_real {
        Some(path) => Robot::read(path)?,
        None => belief.clone(),
    };
    match course {
        Course::Stations { .. } => {
            let text = "--robot needs a platform that moves: --trajectory line, loop or a file";
            Err(Fault::Usage(text.into()).into())
        }
        Course::Moving {
            truth,
            desired,
            lag_s,
        } => Ok(Course::Moving {
            truth: Box::new(held(&Winches { belief, real }, &*truth)?),
            desired,
            lag_s,
        }),
    }
}

/// The motion that winches make of a desired one.
fn held(winches: &Winches, desired: &dyn Motion) -> anyhow::Result<Sampled> {
    let steps = (desired.duration_s() / STEP_S).ceil().max(1.0) as usize;
    let mut points = Vec::with_capacity(steps + 1);
    for k in 0..=steps {
        let t_s = (k as f64 * STEP_S).min(desired.duration_s().max(STEP_S));
        let state = desired.at(t_s);
        let ([x, y, z], [roll, pitch, yaw]) = (
            <[f64; 3]>::from(state.position_m),
            <[f64; 3]>::from(state.rotation_rad),
        );
        let wanted = Pose::new(x, y, z, roll, pitch, yaw);
        let found = winches.goes(&wanted).map_err(|error| {
            let text = format!("--robot: {t_s:.3} s into the trajectory: {error}");
            Fault::Configuration(text)
        })?;
        let p = found.pose;
        points.push(TrajectoryPoint {
            stamp: Stamp::from_ns(0).plus_s(t_s),
            position_m: [p[0], p[1], p[2]],
            rotation_rad: [p[3], p[4], p[5]],
            velocity_m_s: [f64::NAN; 3],
        });
    }
    // The last step may end where the one before does.
    points.dedup_by_key(|point| point.stamp);
    Sampled::new(&points).map_err(|error| Fault::Configuration(error.to_string()).into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::{Limits, Pose as Place, Quintic, Shuttle};
    use std::path::Path;

    fn cablar() -> Robot {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/testdata/robot.toml");
        Robot::read(Path::new(path)).unwrap()
    }

    fn there_and_back() -> impl Motion {
        let limits = Limits {
            speed_m_s: 2.0,
            acceleration_m_s2: 2.0,
            jerk_m_s3: 20.0,
        };
        Shuttle {
            from: Place::level(0.0, -2.0, 1.0),
            to: Place::level(0.0, 2.0, 2.0),
            profile: Quintic::new(17f64.sqrt(), limits),
            dwell_s: 0.5,
            loops: 1,
        }
    }

    #[test]
    fn a_robot_that_is_as_believed_goes_where_it_is_wanted() {
        let winches = Winches {
            belief: cablar(),
            real: cablar(),
        };
        let desired = there_and_back();
        let truth = held(&winches, &desired).unwrap();
        for k in 0..600 {
            let t = f64::from(k) * 0.0073;
            let (a, b) = (truth.at(t), desired.at(t));
            assert!((a.position_m - b.position_m).norm() < 1e-6, "{t}");
            assert!((a.rotation_rad - b.rotation_rad).norm() < 1e-6);
        }
    }

    #[test]
    fn a_robot_that_is_not_goes_elsewhere_smoothly() {
        let mut real = cablar();
        for cable in real.cables.iter_mut().filter(|c| c.group == "upper") {
            cable.pulley_m[2] += 0.06;
        }
        let belief = cablar();
        let desired = there_and_back();
        let winches = Winches { belief, real };
        let truth = held(&winches, &desired).unwrap();
        let at = desired.at(1.0);
        let wanted = Pose::new(
            at.position_m.x,
            at.position_m.y,
            at.position_m.z,
            0.0,
            0.0,
            0.0,
        );
        let goes = winches.goes(&wanted).unwrap().pose;
        let state = truth.at(1.0);
        assert!((state.position_m.z - goes[2]).abs() < 1e-9);
        assert!((state.position_m.z - wanted[2]).abs() > 1e-3);
    }
}
