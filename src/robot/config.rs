//! `robot.toml`: the cables of a robot, read and checked.

use super::Pose;
use crate::frame::ConfigError;
use crate::frame::toml_file::{self, Unsound};
use nalgebra::Vector3;
use serde::Deserialize;
use std::path::Path;

/// A robot file, checked.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Robot {
    /// What people call it.
    #[serde(default)]
    pub name: String,
    /// Radius of the pulleys up to the cable's middle, m; 0 are eyelets.
    pub pulley_radius_m: f64,
    /// Where the platform is locked while the winches are prepared; without it the controller knows
    /// the cables' whole lengths.
    pub home: Option<Home>,
    /// The cables.
    #[serde(rename = "cable")]
    pub cables: Vec<Cable>,
}

/// The pose in which the platform is locked while the winches are prepared.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Home {
    /// Platform origin in B, m.
    pub position_m: [f64; 3],
    /// Roll, pitch, yaw, deg.
    #[serde(default)]
    pub rotation_deg: [f64; 3],
}

impl Home {
    /// The pose.
    pub fn pose(&self) -> Pose {
        let ([x, y, z], angles) = (self.position_m, self.rotation_deg.map(f64::to_radians));
        Pose::new(x, y, z, angles[0], angles[1], angles[2])
    }
}

/// A cable and its pulley.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cable {
    /// What people call it.
    #[serde(default)]
    pub name: String,
    /// Cables whose pulleys sit on one beam, and may be wrong together: "upper".
    #[serde(default)]
    pub group: String,
    /// Where the cable runs onto the pulley, in B, m.
    pub pulley_m: [f64; 3],
    /// Along which direction it does, in B (of any length); the pulley swivels about it.
    pub axis: [f64; 3],
    /// Where it is fixed on the platform, in P, m.
    pub anchor_m: [f64; 3],
}

/// Fewest cables that hold a platform in all six directions.
const LEAST_CABLES: usize = 6;

impl Robot {
    /// Reads and checks a robot file.
    ///
    /// # Errors
    /// A file that cannot be read, is no TOML, or has a key that makes no sense.
    pub fn read(path: &Path) -> Result<Robot, ConfigError> {
        Ok(Robot::read_with_text(path)?.0)
    }

    /// Reads and checks a robot file; gives its text too.
    ///
    /// # Errors
    /// As [`Robot::read`].
    pub fn read_with_text(path: &Path) -> Result<(Robot, String), ConfigError> {
        let text = toml_file::read(path)?;
        Ok((Robot::parse(&text, path)?, text))
    }

    /// Parses and checks a robot file's text; `path` only names it in messages.
    ///
    /// # Errors
    /// As [`Robot::read`].
    pub fn parse(text: &str, path: &Path) -> Result<Robot, ConfigError> {
        toml_file::parse(text, path, Robot::check)
    }

    /// The groups of cables, in the file's order, each once.
    pub fn groups(&self) -> Vec<&str> {
        let mut groups: Vec<&str> = Vec::new();
        for cable in &self.cables {
            if !cable.group.is_empty() && !groups.contains(&cable.group.as_str()) {
                groups.push(&cable.group);
            }
        }
        groups
    }

    fn check(&self) -> Result<(), Unsound> {
        let fault = |key: String, why: String| Err((key, why));
        if !(self.pulley_radius_m >= 0.0 && self.pulley_radius_m < 10.0) {
            let why = format!("{} is no radius in metres", self.pulley_radius_m);
            return fault("pulley_radius_m".into(), why);
        }
        if self.cables.len() < LEAST_CABLES {
            let why = format!(
                "{} cables do not hold a platform; at least {LEAST_CABLES} are needed",
                self.cables.len()
            );
            return fault("cable".into(), why);
        }
        let number = |key: String, values: &[f64]| {
            if values.iter().all(|v| v.is_finite()) {
                Ok(())
            } else {
                Err((key, format!("{values:?} has an entry that is not a number")))
            }
        };
        for (i, cable) in self.cables.iter().enumerate() {
            number(format!("cable[{i}].pulley_m"), &cable.pulley_m)?;
            number(format!("cable[{i}].axis"), &cable.axis)?;
            number(format!("cable[{i}].anchor_m"), &cable.anchor_m)?;
            if !(Vector3::from(cable.axis).norm() > 1e-6) {
                let why =
                    "a direction is wanted, such as [0, 0, 1] for a cable that comes from below";
                return fault(format!("cable[{i}].axis"), why.into());
            }
        }
        if let Some(home) = &self.home {
            number("home.position_m".into(), &home.position_m)?;
            number("home.rotation_deg".into(), &home.rotation_deg)?;
            // A home that the cables do not reach would show only when something moves.
            if let Err(error) = self.check_pose(&home.pose()) {
                return fault("home".into(), error.to_string());
            }
        }
        Ok(())
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use proptest::prelude::*;

    pub(in super::super) const TEXT: &str = include_str!("../../testdata/robot.toml");

    /// The reconstruction of CABLAR's cables.
    pub(in super::super) fn cablar() -> Robot {
        Robot::parse(TEXT, Path::new("robot.toml")).unwrap()
    }

    fn fault(text: &str) -> String {
        let found = Robot::parse(text, Path::new("robot.toml"));
        found.unwrap_err().to_string()
    }

    #[test]
    fn the_reconstruction_is_valid() {
        let robot = cablar();
        assert_eq!(robot.cables.len(), 8);
        assert_eq!(robot.groups(), ["upper", "lower"]);
        assert!(robot.home.is_some());
    }

    #[test]
    fn a_fault_names_its_key() {
        let radius = TEXT.replace("pulley_radius_m = 0.06", "pulley_radius_m = -1");
        assert!(fault(&radius).contains("pulley_radius_m"));
        let unknown = TEXT.replace("anchor_m", "hook_m");
        assert!(fault(&unknown).contains("hook_m"), "{}", fault(&unknown));
        let axis = TEXT.replacen("axis = [0, 0, 1]", "axis = [0, 0, 0]", 1);
        assert!(fault(&axis).contains("cable[0].axis"), "{}", fault(&axis));
        let home = TEXT.replacen("position_m = [", "position_m = [nan, #", 1);
        assert!(fault(&home).contains("home"), "{}", fault(&home));
        // A home exactly where a pulley is.
        let inside = TEXT.replacen(
            "pulley_m = [0.7, 5.0, 5.3]",
            "pulley_m = [0.37, 0.5, 0.17]",
            1,
        );
        assert!(fault(&inside).contains("home"), "{}", fault(&inside));
    }

    proptest! {
        #[test]
        fn any_text_is_read_or_refused(text in ".{0,200}", cut in 0usize..2000) {
            let _ = Robot::parse(&text, Path::new("x"));
            let cut = TEXT.char_indices().map(|(i, _)| i).take_while(|i| *i <= cut).last();
            let _ = Robot::parse(&TEXT[..cut.unwrap_or(0)], Path::new("x"));
        }
    }
}
