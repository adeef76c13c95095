//! Runs summed up, case by case: all that the outputs show, of a size that does not depend on a
//! run's length.

use super::align::{Align, Alignment};
use super::association::{Matching, Reference};
use super::consistency::Consistency;
use super::disorder::Disorder;
use super::gate::Verdict;
use super::inertial::Inertial;
use super::lag::{Delay, DelayChoice};
use super::number;
use super::orientation::{Attitudes, Orientation};
use super::quality::{LineTally, Quality};
use super::relative::{Delta, Pairs, Relative};
use super::scans::Scans;
use super::stability::Stability;
use super::statistics::Statistics;
use super::trace::{Histogram, Trace};
use super::workspace::Cells;
use super::zone::Zone;
use crate::record::{Pose, Stamp};

/// A run as it was read.
#[derive(Clone, Debug, Default)]
pub struct Run {
    /// What people call it.
    pub name: String,
    /// Where it came from: a file's name without its folder, or `standard input`.
    pub source: String,
    /// One pose a scan, in any order.
    pub poses: Vec<Pose>,
    /// Command lines of the stages that made it, if the stream says so.
    pub stages: Vec<String>,
}

/// What to sum up.
#[derive(Clone, Debug, Default)]
pub struct Settings {
    /// Zones to score apart; none is the whole workspace.
    pub zones: Vec<Zone>,
    /// Size of the workspace's cells, m; chosen from the data if none.
    pub cell_m: Option<f64>,
    /// Poses below which a cell says nothing; chosen from the data if none.
    pub min_count: Option<u32>,
    /// Whether and how poses are brought into the reference's frame.
    pub align: Align,
    /// What is done about a delay.
    pub delay: DelayChoice,
    /// Distances between the poses of relative errors.
    pub relative: Vec<Delta>,
    /// Which pairs of poses those take.
    pub pairs: Pairs,
    /// An IMU's record to compare orientations with, in the platform's axes.
    pub imu: Option<Attitudes>,
    /// The lines that the poses came from.
    pub lines: Option<LineTally>,
}

/// One component's errors.
#[derive(Clone, Debug, PartialEq)]
pub struct AxisResult {
    /// Statistics, m or rad.
    pub statistics: Statistics,
    /// e^2 over its variance; not for the position's distance.
    pub consistency: Consistency,
    /// Share of the errors within 1, 2 and 3 of the solver's sigmas; NaN where none are known.
    pub within: [f64; 3],
    /// Over time.
    pub trace: Trace,
    /// By size.
    pub histogram: Histogram,
}

/// The position's error along the way and across it.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    /// Along the reference's velocity, m; positive: ahead of it.
    pub along: AxisResult,
    /// Distance from the path, m.
    pub cross: AxisResult,
}

/// One run in one zone, summed up: all that the outputs show.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// The run's name.
    pub run: String,
    /// The zone's name; none is the whole workspace.
    pub zone: Option<String>,
    /// The run's source.
    pub source: String,
    /// The run's stages.
    pub stages: Vec<String>,
    /// First and last stamp of the run.
    pub span: Option<(Stamp, Stamp)>,
    /// How the solved poses found their reference.
    pub matching: Matching,
    /// What became of the scans.
    pub scans: Scans,
    /// What was wrong with its rows.
    pub input: Disorder,
    /// How its poses were brought into the reference's frame.
    pub alignment: Alignment,
    /// The run's delay; none where it cannot be told, or was not looked for.
    pub delay: Option<Delay>,
    /// In the order of [`super::AXES`].
    pub axes: Vec<AxisResult>,
    /// Relative errors, one for each distance asked for.
    pub relative: Vec<Relative>,
    /// The position's error along the reference's velocity and across it; none where it stands.
    pub track: Option<Track>,
    /// Orientation against an IMU's; none without one.
    pub orientation: Option<Orientation>,
    /// What the poses rest on.
    pub quality: Quality,
    /// How still a standing run is; none for one that moves.
    pub stability: Option<Stability>,
    /// In the order of [`super::GROUPS`].
    pub groups: Vec<Consistency>,
    /// By place; none without a matched pose.
    pub cells: Option<Cells>,
    /// What a reader should know, in plain sentences.
    pub notes: Vec<String>,
}

impl Case {
    /// `run`, or `run in zone`.
    pub fn name(&self) -> String {
        match &self.zone {
            Some(zone) => format!("{} in {zone}", self.run),
            None => self.run.clone(),
        }
    }

    /// Whether there is nothing that could be compared.
    pub fn is_empty(&self) -> bool {
        self.axes.iter().all(|axis| axis.statistics.n == 0)
    }

    /// Seconds from the first to the last stamp.
    pub fn duration_s(&self) -> f64 {
        self.span
            .map_or(f64::NAN, |(first, last)| last.since_s(first))
    }

    /// What was wrong with the rows, in plain sentences.
    fn disorder(&self) -> Vec<String> {
        let input = &self.input;
        let counts = [
            (
                input.nan,
                "rows with a number missing and no status that says why",
                "",
            ),
            (input.unsorted, "rows out of order in time", " sorted in"),
            (input.repeated, "rows at the stamp of another", " left out"),
            (input.jumps, "jumps of the clock", ""),
        ];
        let counts = counts.iter().filter(|(count, ..)| *count > 0);
        counts
            .map(|(count, what, done)| {
                let count = number::count(*count);
                format!("{}: {what}: {count}{done}", self.run)
            })
            .collect()
    }

    /// Rows per second; NaN for less than two.
    pub fn rate_hz(&self) -> f64 {
        if self.scans.rows < 2 {
            return f64::NAN;
        }
        (self.scans.rows - 1) as f64 / self.duration_s()
    }
}

/// Everything the outputs need.
#[derive(Clone, Debug)]
pub struct Report {
    /// Title of the page.
    pub title: String,
    /// What the poses are compared with: `truth` or `desired`.
    pub role: &'static str,
    /// Where the reference came from, without its folder.
    pub reference_source: String,
    /// Command lines of the stages that made the reference, if its stream says so.
    pub reference_stages: Vec<String>,
    /// The reference, for its counts and limits.
    pub reference: Reference,
    /// Runs and zones, side by side.
    pub cases: Vec<Case>,
    /// A record of the IMU at rest, if there is one.
    pub inertial: Option<Inertial>,
    /// The gates' verdicts.
    pub verdicts: Vec<Verdict>,
    /// The report's own command line, file names without folders.
    pub command: String,
    /// A date to show, if one was asked for.
    pub date: Option<String>,
}

impl Report {
    /// What was left out or could not be compared, in plain sentences; empty if all is well.
    pub fn losses(&self) -> Vec<String> {
        let mut losses = Vec::new();
        for (count, what) in [
            (self.reference.incomplete, "without all six numbers"),
            (self.reference.repeated, "at the stamp of another"),
        ] {
            if count > 0 {
                let (source, count) = (&self.reference_source, number::count(count));
                losses.push(format!("{source}: points {what}: {count} left out"));
            }
        }
        let mut told: Vec<&str> = Vec::new();
        for case in &self.cases {
            // The zones of a run have the same rows.
            if !told.contains(&case.run.as_str()) {
                losses.extend(case.disorder());
                told.push(&case.run);
            }
        }
        if let Some(inertial) = self.inertial.as_ref().filter(|i| i.channels.is_empty()) {
            let why = inertial.notes.first().cloned().unwrap_or_default();
            losses.push(format!("{}: {why}", inertial.source));
        }
        for case in self.cases.iter().filter(|c| c.is_empty()) {
            let why = case.notes.last().cloned().unwrap_or_default();
            losses.push(format!("{}: {why}", case.name()));
        }
        losses
    }
}

#[cfg(test)]
#[path = "case_tests.rs"]
pub(super) mod tests;
