//! Calibration from a run: where the strips really are, how scanner and IMU sit, what the ranges and
//! edges have in common, from many scans at once (bundle adjustment).
//!
//! Every scan has its own pose, bias, threshold and footprint; all scans share the parameters. A
//! scan's lines, edges and attitude are equations in both; its own unknowns are eliminated (Schur
//! complement), so that the memory is that of the scans' records and the parameters' matrix. What the
//! survey knew is the prior. What a run does not show keeps its prior: such parameters stay as they
//! were surveyed, and are named.
//!
//! Two patterns no run shows, because they move the frame as a whole: a common shift of all strips
//! along x, and a common turn about the vertical. The frame's width is taken up by the range bias,
//! its height goes one to one into z, the scanner's lever arm into the position. Scanner and IMU show
//! only the turn between them, and of that the pitch only where strips on the walls or a platform
//! that kept its x while its height changed show it.

mod bundle;
mod equations;
mod parameters;
mod result;

pub use parameters::Turned;
pub use result::{Calibration, Entry, Pattern};

use super::joint;
use super::pitch::{Attitude, Pitch};
use super::thinned::Thinned;
use crate::frame::Frame;
use crate::record::{Pose, ReflectorLines};
use parameters::Layout;

/// What was known before the run: standard deviations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Survey {
    /// Of every strip edge's place and of the box's width and height, m.
    pub length_sigma_m: f64,
    /// Of every strip's inclination, rad.
    pub angle_sigma_rad: f64,
    /// Of the turn between scanner and IMU about each axis, rad.
    pub turn_sigma_rad: f64,
    /// Of the range bias that all scans have in common, m.
    pub bias_sigma_m: f64,
    /// Of the range scale.
    pub scale_sigma: f64,
    /// Of the hit threshold that all scans have in common, spot radii.
    pub threshold_sigma: f64,
    /// Of the footprint scale.
    pub footprint_sigma: f64,
}

impl Default for Survey {
    fn default() -> Self {
        Survey {
            length_sigma_m: 0.002,
            angle_sigma_rad: 0.5f64.to_radians(),
            turn_sigma_rad: 0.5f64.to_radians(),
            bias_sigma_m: 0.025,
            scale_sigma: 0.001,
            threshold_sigma: 0.15,
            footprint_sigma: 0.15,
        }
    }
}

/// What is calibrated, and how.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Settings {
    /// What was known before.
    pub survey: Survey,
    /// The platform kept its x within this standard deviation, m.
    pub x_constant_sigma_m: Option<f64>,
    /// What is turned where scanner and IMU disagree.
    pub turned: Turned,
}

/// Settings with what the equations need of the frame and the run.
#[derive(Clone, Copy, Debug)]
struct Options {
    x_constant_sigma_m: Option<f64>,
    /// Spread of the scans' biases around the common one, m.
    bias_spread_m: f64,
    /// The frame file's threshold, spot radii, and footprint scale.
    threshold: f64,
    footprint_scale: f64,
}

/// One scan of the run.
#[derive(Clone, Debug)]
struct Observation {
    lines: ReflectorLines,
    pitch: Option<Pitch>,
    /// The IMU's roll.
    roll_rad: Option<f64>,
    pitch_changes_rad: Vec<f64>,
    /// Where the bundle starts: the scan's own solution; threshold and footprint are those of
    /// [`Options`].
    start: equations::Own,
}

/// Why there is no calibration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CalibrationError {
    /// Not enough scans.
    #[error(
        "{0} scans at different places gave a pose with x and yaw; at least {FEWEST} are needed"
    )]
    TooFew(usize),
    /// The equations have no solution.
    #[error("the scans contradict each other: is the frame file the one of this run?")]
    NoSolution,
}

/// Fewest scans.
pub const FEWEST: usize = 16;
/// Most scans kept.
pub const KEPT: usize = 4000;
/// A scan counts as another one where the platform has moved by this much since the last one that
/// was taken, m and rad: standing, the same beams meet the same edges, and their intervals say
/// nothing new.
const MOVED_M: f64 = 0.010;
const MOVED_RAD: f64 = 0.002;

/// Collects a run.
#[derive(Clone, Debug, Default)]
pub struct Calibrator {
    observations: Thinned<Observation, KEPT>,
    last: Option<Pose>,
}

impl Calibrator {
    /// Takes one scan: its lines, its pose, what its pitch was solved with, the IMU's attitude if there
    /// is one, and by how much the pitch at each edge differs from that at the reference instant.
    pub fn add(
        &mut self,
        lines: &ReflectorLines,
        pose: &Pose,
        pitch: Option<Pitch>,
        attitude: Option<&Attitude>,
        pitch_changes_rad: &[f64],
    ) {
        let components = pose.components();
        let usable = components.iter().all(|c| c.is_finite())
            && pose.range_bias_m.is_finite()
            && lines.joint_cov.len() == 28
            && pitch.is_none_or(|p| !p.stale);
        let moved = |last: &Pose| {
            let by = |k: usize| (components[k] - last.components()[k]).abs();
            (0..3).any(|k| by(k) > MOVED_M) || (3..6).any(|k| by(k) > MOVED_RAD)
        };
        if !usable || !self.last.as_ref().is_none_or(moved) {
            return;
        }
        self.last = Some(pose.clone());
        self.observations.add(|| {
            let mut start = [0.0; equations::OWN];
            start[..6].copy_from_slice(&components);
            start[joint::BIAS] = pose.range_bias_m;
            Observation {
                lines: lines.clone(),
                pitch,
                roll_rad: attitude.map(|a| a.roll_rad),
                pitch_changes_rad: pitch_changes_rad.to_vec(),
                start,
            }
        });
    }

    /// The calibration of `frame`, with which the run's lines were extracted.
    ///
    /// # Errors
    /// [`CalibrationError`].
    pub fn solve(
        &self,
        frame: &Frame,
        settings: &Settings,
    ) -> Result<Calibration, CalibrationError> {
        let n = self.observations.kept().len();
        if n < FEWEST {
            return Err(CalibrationError::TooFew(n));
        }
        let layout = Layout {
            strips: frame.strips.len(),
        };
        let threshold = joint::threshold_mean(frame.calibration.hit_threshold);
        let footprint_scale = frame.calibration.footprint_scale;
        let observations = self.observations.kept();
        let options = Options {
            x_constant_sigma_m: settings.x_constant_sigma_m,
            bias_spread_m: spread(observations.iter().map(|o| o.start[joint::BIAS])),
            threshold,
            footprint_scale,
        };
        let prior_sigmas = layout.prior_sigmas(&settings.survey);
        let solution = bundle::adjust(observations, frame, &prior_sigmas, &options)
            .ok_or(CalibrationError::NoSolution)?;
        Ok(result::conclude(
            &solution,
            frame,
            &prior_sigmas,
            settings,
            options.bias_spread_m,
        ))
    }
}

/// Standard deviation, at least half a millimetre.
fn spread(values: impl Iterator<Item = f64> + Clone) -> f64 {
    let n = values.clone().count().max(2) as f64;
    let mean = values.clone().sum::<f64>() / n;
    let squares: f64 = values.map(|v| (v - mean) * (v - mean)).sum();
    (squares / (n - 1.0)).sqrt().max(0.0005)
}

#[cfg(test)]
mod tests;
