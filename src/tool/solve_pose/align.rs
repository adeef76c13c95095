//! solve-pose --align-imu: how the IMU sits on the platform, from the run that is solved.

use crate::frame::{Frame, edit};
use crate::pose::alignment::{self, Aligner, Alignment, Observation};
use crate::pose::pitch::{self, Attitude, Pitch};
use crate::record::Pose;
use crate::stream::WholeFile;
use std::path::PathBuf;

/// The search for the IMU's mounting.
pub(super) struct Align {
    path: PathBuf,
    file: WholeFile,
    /// The frame file's text.
    text: String,
    x_constant: bool,
    aligner: Aligner,
    quiet: bool,
}

/// Prior with which x is taken to depend on the pitch alone, rad: so narrow that the edges do not
/// move it.
const NARROW_RAD: f64 = 0.05 * std::f64::consts::PI / 180.0;

impl Align {
    /// To be written to `path`, the frame file's `text` with the mounting found.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub(super) fn new(
        path: PathBuf,
        text: String,
        x_constant: bool,
        quiet: bool,
    ) -> anyhow::Result<Align> {
        Ok(Align {
            file: WholeFile::open(Some(&path))?,
            path,
            text,
            x_constant,
            aligner: Aligner::default(),
            quiet,
        })
    }

    /// Takes one scan: its pose, the IMU's attitude, and a way to solve it again with another prior
    /// of the pitch.
    pub(super) fn add(
        &mut self,
        pose: &Pose,
        attitude: &Attitude,
        frame: &Frame,
        mut solve: impl FnMut(Option<Pitch>) -> Pose,
    ) {
        let sigma = |pose: &Pose, k: usize| pose.cov(k, k).sqrt();
        let roll_rad = [pose.rotation_rad[0], sigma(pose, 3)];
        if !(roll_rad[0].is_finite() && roll_rad[1] > 0.0) {
            return;
        }
        let mut with_prior = |sigma_rad| {
            solve(Some(Pitch {
                sigma_rad,
                ..attitude.pitch()
            }))
        };
        let mut pitch_rad = None;
        if pitch::is_shown(frame) {
            let wide_rad = Pitch::OPEN.sigma_rad;
            let own = with_prior(wide_rad);
            let posterior = [own.rotation_rad[1], sigma(&own, 4)];
            pitch_rad = alignment::without_prior(posterior, [attitude.pitch_rad, wide_rad]);
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
    pub(super) fn write(self, frame: &Frame) -> anyhow::Result<bool> {
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
        self.file.finish(&text)?;
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
