//! Poses over many scans: the causal filter and the smoother.

use crate::frame::Frame;
use crate::pose::filter::{Filter, Options, Smoother};
use crate::pose::joint;
use crate::pose::pitch::Pitch;
use crate::record::{Pose, ReflectorLines};
use crate::tool::values::not_negative;

/// Which of the two.
pub(super) enum ManyScans {
    Filter(Filter),
    Smoother(Smoother),
}

impl ManyScans {
    /// What the arguments ask for, if they do.
    pub(super) fn new(args: &FilterArgs, frame: &Frame) -> Option<ManyScans> {
        let joint = joint::Options::default();
        let mut options = Options::default();
        options.nuisances.range_bias_walk = args.range_bias_walk_mm.map(|mm| mm / 1000.0);
        if args.smooth {
            let smoother = Smoother::new(frame, joint, options);
            return Some(ManyScans::Smoother(smoother));
        }
        args.filter
            .then(|| ManyScans::Filter(Filter::new(frame, joint, options)))
    }

    /// Takes a scan; `emit` gets the poses that are ready.
    pub(super) fn take(
        &mut self,
        lines: &ReflectorLines,
        pitch: Option<Pitch>,
        pitch_changes_rad: &[f64],
        mut emit: impl FnMut(Pose),
    ) {
        match self {
            ManyScans::Filter(filter) => emit(filter.take(lines, pitch, pitch_changes_rad)),
            ManyScans::Smoother(smoother) => {
                smoother.take(lines, pitch, pitch_changes_rad, emit);
            }
        }
    }

    /// The end of the stream.
    pub(super) fn finish(&mut self, emit: impl FnMut(Pose)) {
        if let ManyScans::Smoother(smoother) = self {
            smoother.finish(emit);
        }
    }

    /// What the user should know of the run.
    pub(super) fn remarks(&self) -> Option<String> {
        let refused = match self {
            ManyScans::Filter(filter) => filter.refused(),
            ManyScans::Smoother(smoother) => smoother.refused(),
        };
        (refused > 0).then(|| {
            format!(
                "{refused} scans were not later than the one before: they were solved on their own"
            )
        })
    }
}

/// Poses over many scans.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Many scans")]
pub(super) struct FilterArgs {
    /// Filter the poses over the scans so far; each comes out with its scan
    #[arg(long, group = "many", conflicts_with_all = ["align_imu", "calibrate"])]
    pub(super) filter: bool,
    /// Smooth the poses over all scans before and after; they come out at the end of the input, and
    /// 12 kB a scan are held until then
    #[arg(long, group = "many", conflicts_with_all = ["filter", "align_imu", "calibrate"])]
    pub(super) smooth: bool,
    /// The range bias wanders by this much in a second, in place of another one for each scan
    #[arg(long, value_name = "MM", requires = "many", value_parser = not_negative)]
    pub(super) range_bias_walk_mm: Option<f64>,
}
