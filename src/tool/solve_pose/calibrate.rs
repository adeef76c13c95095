//! solve-pose --calibrate: what the whole run tells of the frame and the devices, as a frame file.

use super::arguments::{Args, Method, Turn};
use crate::frame::{Frame, edit};
use crate::pose::calibration::{Calibration, Calibrator, Entry, Settings, Survey, Turned};
use crate::pose::pitch::{Attitude, Pitch};
use crate::record::{Pose, ReflectorLines};
use crate::stream::{Fault, WholeFile};
use anyhow::Context;
use std::path::PathBuf;

/// The calibration that is asked for.
pub(super) struct Calibrate {
    path: PathBuf,
    file: WholeFile,
    /// The frame file's text.
    text: String,
    settings: Settings,
    /// The IMU or the scanner, as asked.
    turned: Option<Turned>,
    imu_seen: bool,
    calibrator: Calibrator,
    quiet: bool,
}

impl Calibrate {
    /// As the arguments say.
    pub(super) fn asked(
        args: &Args,
        frame: &Frame,
        text: &str,
        quiet: bool,
    ) -> anyhow::Result<Option<Calibrate>> {
        let asked = &args.calibrate;
        let Some(path) = asked.calibrate.clone() else {
            return Ok(None);
        };
        if args.method != Method::Joint {
            let why = "--calibrate needs --method joint: the vote has no covariances";
            return Err(Fault::Usage(why.to_owned()).into());
        }
        if frame.strips.is_empty() {
            let why = "--calibrate needs strips: the frame file has none";
            return Err(Fault::Usage(why.to_owned()).into());
        }
        let survey = Survey {
            length_sigma_m: asked.survey_sigma_mm * 1e-3,
            angle_sigma_rad: asked.survey_sigma_deg.to_radians(),
            turn_sigma_rad: asked.survey_sigma_deg.to_radians(),
            ..Survey::default()
        };
        let x_sigma_m = asked.calibrate_x_sigma_mm * 1e-3;
        Ok(Some(Calibrate {
            file: WholeFile::open(Some(&path))?,
            path,
            text: text.to_owned(),
            settings: Settings {
                survey,
                x_constant_sigma_m: asked.calibrate_x_constant.then_some(x_sigma_m),
                turned: Turned::default(),
            },
            turned: asked.calibrate_turn.map(|turn| match turn {
                Turn::Imu => Turned::Imu,
                Turn::Scanner => Turned::Scanner,
            }),
            imu_seen: false,
            calibrator: Calibrator::default(),
            quiet,
        }))
    }

    /// Takes one scan with its pose and what is known of its attitude.
    pub(super) fn add(
        &mut self,
        lines: &ReflectorLines,
        pose: &Pose,
        pitch: Option<Pitch>,
        attitude: Option<&Attitude>,
        changes_rad: &[f64],
    ) {
        self.imu_seen |= attitude.is_some();
        self.calibrator
            .add(lines, pose, pitch, attitude, changes_rad);
    }

    /// Writes the frame file with what was found; false where nothing was, and says so.
    pub(super) fn write(self, frame: &Frame) -> anyhow::Result<bool> {
        let without_imu = if self.imu_seen {
            Turned::Imu
        } else {
            Turned::Scanner
        };
        let settings = Settings {
            turned: self.turned.unwrap_or(without_imu),
            ..self.settings
        };
        let found = match self.calibrator.solve(frame, &settings) {
            Ok(found) => found,
            Err(error) => {
                eprintln!("solve-pose: no calibration: {error}");
                return Ok(false);
            }
        };
        let text = edited(&self.text, frame, &found, settings.turned)?;
        // What is written must be a frame file: strips that now overlap would not be one.
        Frame::parse(&text, &self.path).context("the calibrated frame is not possible")?;
        self.file.finish(&text)?;
        if !self.quiet {
            eprint!("{}", table(&found));
            eprintln!("solve-pose: {} has what the run shows", self.path.display());
        }
        Ok(true)
    }
}

/// The frame file's text with the values that the run shows.
fn edited(
    text: &str,
    before: &Frame,
    found: &Calibration,
    turned: Turned,
) -> Result<String, edit::EditError> {
    let mut text = text.to_owned();
    for (k, (strip, old)) in found.frame.strips.iter().zip(&before.strips).enumerate() {
        if let Some([from, to]) = strip.x_m.filter(|_| strip.x_m != old.x_m) {
            let value = format!("[{from:.4}, {to:.4}]");
            let remark = "cut where it would overlap the next";
            text = edit::set(&text, &format!("strip[{k}]"), "x_m", &value, Some(remark))?;
        }
    }
    let frame = &found.frame;
    let entry = |key: &str| found.entries.iter().find(|e| e.key == key);
    let mut set = |table: &str, key: &str, value: f64, decimals: usize| {
        let full = format!("{table}.{key}");
        let Some(entry) = entry(&full).filter(|e| e.change != 0.0) else {
            return Ok(());
        };
        let value = format!("{value:.decimals$}");
        text = edit::set(&text, table, key, &value, Some(&in_words(entry)))?;
        Ok(())
    };
    for (k, strip) in frame.strips.iter().enumerate() {
        let table = format!("strip[{k}]");
        set(&table, "offset_m", strip.offset_m, 5)?;
        set(&table, "width_m", strip.width_m, 5)?;
        set(&table, "inclination_deg", strip.inclination_deg, 4)?;
    }
    let c = &frame.calibration;
    set("calibration", "range_bias_m", c.range_bias_m, 5)?;
    set("calibration", "range_scale", c.range_scale, 6)?;
    set("calibration", "hit_threshold", c.hit_threshold, 4)?;
    set("calibration", "footprint_scale", c.footprint_scale, 4)?;
    let (table, rotation_deg) = match turned {
        Turned::Imu => ("imu", frame.imu.rotation_deg),
        Turned::Scanner => ("scanner", frame.scanner.rotation_deg),
    };
    let turns = ["roll", "pitch", "yaw"].map(|axis| entry(&format!("{table}.rotation_deg {axis}")));
    let changed: Vec<String> = turns
        .into_iter()
        .flatten()
        .filter(|e| e.change != 0.0)
        .map(|e| format!("{} {}", e.key.rsplit(' ').next().unwrap_or(""), in_words(e)))
        .collect();
    if !changed.is_empty() {
        let [roll, pitch, yaw] = rotation_deg;
        let value = format!("[{roll:.4}, {pitch:.4}, {yaw:.4}]");
        let remark = changed.join(", ");
        text = edit::set(&text, table, "rotation_deg", &value, Some(&remark))?;
    }
    Ok(text)
}

fn in_words(entry: &Entry) -> String {
    let decimals = decimals(entry);
    let (change, sigma, unit) = (entry.change, entry.posterior, entry.unit);
    let space = if unit.is_empty() { "" } else { " " };
    format!("calibrated by {change:+.decimals$} +- {sigma:.decimals$}{space}{unit}")
}

fn decimals(entry: &Entry) -> usize {
    match entry.unit {
        "mm" => 2,
        "ppm" => 0,
        _ => 3,
    }
}

/// What was found, as text for people.
fn table(found: &Calibration) -> String {
    let [edges, measured, refused] = found.edges;
    let mut text = format!(
        "solve-pose: calibration from {} scans with {edges} edges ({measured} of them measured \
         between the beams), {refused} refused\n",
        found.scans
    );
    text += &format!(
        "{:<32} {:>10} {:>9} {:>9} {:>6}\n",
        "parameter", "change", "before", "after", "left"
    );
    for entry in &found.entries {
        let decimals = decimals(entry);
        let share = entry.posterior / entry.prior * 100.0;
        let remark = match (entry.shown, entry.remark) {
            (true, _) => String::new(),
            (false, "") => "  not shown by this run: stays".to_owned(),
            (false, remark) => format!("  not shown by this run: {remark}"),
        };
        text += &format!(
            "{:<32} {:>+10.decimals$} {:>9.decimals$} {:>9.decimals$} {share:>4.0} %  {}{remark}\n",
            entry.key,
            entry.change,
            entry.prior,
            entry.posterior,
            if entry.unit.is_empty() {
                "1"
            } else {
                entry.unit
            },
        );
    }
    for pattern in &found.patterns {
        let left = pattern.left * 100.0;
        text += &format!("strips, {:<24} {left:>37.0} %\n", pattern.name);
    }
    text += &format!(
        "scanner.position_m: not shown by any run: the platform's position takes it up\n\
         {} of {} directions are not shown; condition number {:.1e}; the range bias spreads by \
         {:.1} mm from scan to scan\n",
        found.hidden[0],
        found.hidden[1],
        found.condition,
        found.bias_spread_m * 1e3
    );
    text
}
