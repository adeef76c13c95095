//! Where solve-pose has the platform's attitude from: an IMU beside the scans, one in the same
//! stream, or a number.

use super::arguments::PitchArgs;
use crate::frame::Frame;
use crate::pose::pitch::{Attitude, Lookup, Pitch, Settings};
use crate::record::{ImuSample, ReflectorLines, Stamp};
use crate::stream::{Options, SideInput};
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Where each scan's pitch comes from.
enum Source {
    Side {
        samples: Box<SideInput<ImuSample>>,
        wait: Duration,
    },
    Constant(Pitch),
    /// The samples that travel in the same MCAP stream, if it has any.
    Stream(VecDeque<ImuSample>),
}

/// How many samples of the stream are kept: a second of a fast IMU.
const KEPT: usize = 1000;

/// Looks up the attitude of every scan.
pub(super) struct AttitudeSource {
    source: Source,
    lookup: Lookup,
    /// The instants at which a scan needs the attitude, in order of time: its reference instant
    /// (no index) and its edges.
    instants: Vec<(Stamp, Option<usize>)>,
    /// By how much the pitch at each edge of the last scan differs from that at its reference
    /// instant, rad.
    pub(super) changes_rad: Vec<f64>,
}

impl AttitudeSource {
    /// Opens what the arguments name.
    pub(super) fn open(args: &PitchArgs, options: &Options) -> anyhow::Result<AttitudeSource> {
        let source = match (&args.imu, args.pitch_deg) {
            (Some(path), _) => Source::Side {
                samples: Box::new(SideInput::open(path, options)?),
                wait: args.imu_wait,
            },
            (None, Some(deg)) => Source::Constant(Pitch::within(
                deg.to_radians(),
                args.pitch_sigma_deg.to_radians(),
            )),
            (None, None) => Source::Stream(VecDeque::new()),
        };
        let lookup = Lookup::new(Settings {
            sigma_rad: args.imu_pitch_sigma_deg.map(f64::to_radians),
            max_age_s: args.imu_max_age.as_secs_f64(),
            max_gap_periods: args.imu_max_gap,
        });
        Ok(AttitudeSource {
            source,
            lookup,
            instants: Vec::new(),
            changes_rad: Vec::new(),
        })
    }

    /// The pitch to solve with, `attitude` being what [`AttitudeSource::attitude`] found.
    pub(super) fn pitch(&self, attitude: Option<&Attitude>) -> Option<Pitch> {
        match self.source {
            Source::Constant(pitch) => Some(pitch),
            _ => attitude.map(Attitude::pitch),
        }
    }

    /// Whether the samples of the stream are wanted.
    pub(super) fn wants_imu(&self) -> bool {
        matches!(self.source, Source::Stream(_))
    }

    /// Takes a sample of the stream.
    pub(super) fn push(&mut self, sample: &ImuSample) {
        if let Source::Stream(samples) = &mut self.source {
            if samples.len() == KEPT {
                samples.pop_front();
            }
            samples.push_back(*sample);
        }
    }

    /// The IMU's attitude at the lines' reference instant; the changes of pitch at the edges are
    /// put into `changes_rad`.
    pub(super) fn attitude(
        &mut self,
        lines: &ReflectorLines,
        frame: &Frame,
    ) -> anyhow::Result<Option<Attitude>> {
        self.changes_rad.clear();
        self.changes_rad.resize(lines.edges.len(), 0.0);
        self.instants.clear();
        self.instants.push((lines.stamp, None));
        for (i, edge) in lines.edges.iter().enumerate() {
            self.instants
                .push((lines.stamp.plus_s(edge.time_s), Some(i)));
        }
        // A side input is read forwards only.
        self.instants.sort_by_key(|(stamp, _)| *stamp);
        let begun = Instant::now();
        let mut at_reference = None;
        for (stamp, edge) in &self.instants {
            let around = match &mut self.source {
                Source::Constant(_) => return Ok(None),
                Source::Stream(samples) => {
                    let after = samples.partition_point(|s| s.stamp <= *stamp);
                    let before = after.checked_sub(1).and_then(|i| samples.get(i));
                    (before, samples.get(after))
                }
                Source::Side { samples, wait } => {
                    let left = wait.saturating_sub(begun.elapsed());
                    samples.around(*stamp, left)?
                }
            };
            let found = self.lookup.at(*stamp, around, frame);
            match edge.and_then(|i| self.changes_rad.get_mut(i)) {
                None => at_reference = found,
                Some(change) => {
                    *change = found.filter(|a| !a.stale).map_or(f64::NAN, |a| a.pitch_rad)
                }
            }
        }
        // The reference beam is in the middle of the sweep. Samples that come no faster say nothing
        // of what happens within it.
        let sweep_s = 2.0 * lines.stamp.since_s(lines.scan_stamp);
        let fresh_rad = at_reference
            .filter(|a: &Attitude| !a.stale && self.lookup.resolves(sweep_s))
            .map(|a| a.pitch_rad);
        for change in &mut self.changes_rad {
            let difference = fresh_rad.map_or(0.0, |reference_rad| *change - reference_rad);
            *change = if difference.is_finite() {
                difference
            } else {
                0.0
            };
        }
        Ok(at_reference)
    }
}
