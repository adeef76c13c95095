//! Motion inside the scan: the options, and where the motion comes from.

use super::first_given;
use crate::frame::Frame;
use crate::lines::reflectors::{JointLines, ReflectorFit};
use crate::motion::{self, Guide, Gyro, KnownMotion, LineFit, Relation, SelfMotion};
use crate::record::{ImuSample, ReflectorLines, Scan, ScanMotion, Stamp, TrajectoryPoint};
use crate::stream::{Fault, Input, Options, Role, SideInput};
use crate::tool::values::parse_duration;
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// How motion inside the scan is treated.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Motion inside the scan")]
pub(super) struct DeskewArgs {
    /// Where the motion comes from [default: motion with --motion, otherwise self]
    #[arg(long, value_enum, value_name = "SOURCE")]
    deskew: Option<Source>,
    /// Trajectory of the platform, file or FIFO, CSV or MCAP (its /desired, else its /truth)
    #[arg(long, value_name = "FILE")]
    motion: Option<PathBuf>,
    /// How long a live --motion is waited for
    #[arg(long, value_name = "TIME", default_value = "20ms", value_parser = parse_duration, requires = "motion")]
    motion_wait: Duration,
    /// self: IMU samples, file or FIFO, CSV or MCAP, whose gyros tell the turn in the scan plane
    #[arg(long, value_name = "FILE")]
    imu: Option<PathBuf>,
    /// How long a live --imu is waited for
    #[arg(long, value_name = "TIME", default_value = "20ms", value_parser = parse_duration, requires = "imu")]
    imu_wait: Duration,
    /// What is done with the motion
    #[arg(long, value_enum, value_name = "METHOD", default_value_t = Correction::Points)]
    deskew_method: Correction,
    /// self: the motion in hindsight, from the scans behind too; reads SCANS, a file, twice
    #[arg(long)]
    smooth: bool,
}

/// Where the motion comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Source {
    /// Every scan is taken as at rest
    None,
    /// From the lines of this scan and those before
    #[value(name = "self")]
    Own,
    /// From the trajectory of --motion
    Motion,
}

/// What is done with the motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Correction {
    /// Each beam starts and points where the scanner was: exact
    Points,
    /// Beam lengths are corrected, as published (Kurniawan 2017, eq. 3.22 to 3.29): right for lines,
    /// but it moves edges wrongly, along the reflector; for comparison
    BeamLength,
}

/// Points of a trajectory further from a scan than this tell nothing of it, s.
const REACH_S: f64 = 0.1;

impl DeskewArgs {
    /// The first option that is given.
    pub(super) fn given(&self) -> Option<&'static str> {
        first_given(&[
            (self.deskew.is_some(), "--deskew"),
            (self.motion.is_some(), "--motion"),
            (self.imu.is_some(), "--imu"),
            (self.deskew_method != Correction::Points, "--deskew-method"),
            (self.smooth, "--smooth"),
        ])
    }

    /// What the options ask for, as far as that can be said without reading the scans.
    fn source(&self) -> Result<Source, Fault> {
        let usage = |text: &str| Err(Fault::Usage(text.to_owned()));
        let source = match (self.deskew, &self.motion) {
            (Some(source), _) => source,
            (None, Some(_)) => Source::Motion,
            (None, None) => Source::Own,
        };
        match source {
            Source::Motion if self.motion.is_none() => {
                usage("--deskew motion needs the trajectory: --motion FILE")
            }
            Source::None | Source::Own if self.motion.is_some() => {
                usage("--motion belongs to --deskew motion")
            }
            Source::None | Source::Motion if self.imu.is_some() => {
                usage("--imu belongs to --deskew self")
            }
            Source::None | Source::Motion if self.smooth => {
                usage("--smooth belongs to --deskew self")
            }
            Source::None if self.deskew_method != Correction::Points => {
                usage("--deskew-method needs a motion: --deskew self or motion")
            }
            _ => Ok(source),
        }
    }

    fn gyro(&self, frame: &Frame, options: &Options) -> anyhow::Result<Option<Box<Turns>>> {
        let Some(path) = &self.imu else {
            return Ok(None);
        };
        Ok(Some(Box::new(Turns {
            samples: SideInput::open(path, options)?,
            wait: self.imu_wait,
            gyro: Gyro::new(frame),
        })))
    }

    /// Makes it ready; with --smooth, reads the scans a first time with `fit`.
    pub(super) fn open(
        &self,
        frame: &Frame,
        fit: &ReflectorFit,
        input: Option<&Path>,
        options: &Options,
    ) -> anyhow::Result<Deskew> {
        let own = || SelfMotion::new(frame.bounds.dy_m);
        let gyro = self.gyro(frame, options)?;
        let knowledge = match (self.source()?, &self.motion) {
            (Source::Own, _) if self.smooth => {
                Knowledge::Hindsight(hindsight(frame, fit.clone(), gyro, input, options)?)
            }
            (Source::Own, _) => Knowledge::Own(Box::new(own()), gyro),
            (Source::Motion, Some(path)) => Knowledge::Given {
                points: Box::new(SideInput::open_trajectory(path, Role::Desired, options)?),
                wait: self.motion_wait,
                guide: Guide::default(),
                frame: Box::new(frame.clone()),
            },
            _ => Knowledge::Rest,
        };
        Ok(Deskew {
            knowledge,
            correction: self.deskew_method,
            unknown: 0,
        })
    }
}

/// The turn in the scan plane, from an IMU's samples.
struct Turns {
    samples: SideInput<ImuSample>,
    wait: Duration,
    gyro: Gyro,
}

/// The rate of turn at an instant and its standard deviation, rad/s.
fn turn_at(turns: &mut Option<Box<Turns>>, stamp: Stamp) -> anyhow::Result<Option<(f64, f64)>> {
    let Some(turns) = turns else {
        return Ok(None);
    };
    let around = turns.samples.around(stamp, turns.wait)?;
    Ok(turns.gyro.turn(stamp, around))
}

/// What is known of the motion.
enum Knowledge {
    Rest,
    Own(Box<SelfMotion>, Option<Box<Turns>>),
    /// One entry a scan.
    Hindsight(VecDeque<Option<KnownMotion>>),
    Given {
        points: Box<SideInput<TrajectoryPoint>>,
        wait: Duration,
        guide: Guide,
        frame: Box<Frame>,
    },
}

/// Takes the motion out of scans.
pub(super) struct Deskew {
    knowledge: Knowledge,
    correction: Correction,
    /// Scans whose motion --motion does not say.
    pub(super) unknown: u64,
}

/// A scan whose lines were found.
#[derive(Default)]
pub(super) struct Fitted {
    /// What was taken out.
    pub(super) motion: ScanMotion,
    /// The scan with corrected ranges, to be taken as at rest, where edges are measured in that.
    pub(super) corrected: Option<Scan>,
    /// The motion is hardly known before the next scan: this one is to wait for it.
    pub(super) wait: bool,
    /// What this scan tells of the motion in the one before, if that has been waiting.
    pub(super) before: Option<KnownMotion>,
}

/// The lines' reference instant on the clock that tells best how far apart scans are: the device's
/// own, where it has one, because a live stamp is only known to the jitter of its way here.
fn on_own_clock(scan: &Scan, lines: &ReflectorLines) -> Stamp {
    let begun = scan.device.unwrap_or(scan.stamp);
    begun + (lines.stamp - lines.scan_stamp)
}

impl Deskew {
    /// Fits the lines of a scan with its motion taken out and puts them into `lines`; none where
    /// there are no lines.
    pub(super) fn fit(
        &mut self,
        fit: &mut ReflectorFit,
        scan: &Scan,
        lines: &mut ReflectorLines,
    ) -> anyhow::Result<Option<Fitted>> {
        let mut fitted = Fitted::default();
        let (joint, motion) = match &mut self.knowledge {
            Knowledge::Rest => (fit.fit(scan), ScanMotion::REST),
            Knowledge::Own(own, turns) => {
                let mut found = None;
                own.tell_turn(turn_at(turns, lines.stamp)?);
                let deskewed = own.take(on_own_clock(scan, lines), |motion| {
                    let joint = fit.fit_moving(scan, motion)?;
                    found = Some(joint);
                    Some(line_fit(fit, &joint))
                });
                let (Some(deskewed), Some(mut joint)) = (deskewed, found) else {
                    return Ok(None);
                };
                joint.adjust(&deskewed.step, deskewed.covariance);
                (fitted.wait, fitted.before) = match deskewed.relation {
                    Relation::Begins => (true, None),
                    Relation::Elsewhere => (false, Some(motion::AT_REST)),
                    Relation::GoesOn(before) => (false, before),
                };
                (Some(joint), deskewed.motion)
            }
            Knowledge::Hindsight(motions) => match motions.pop_front().flatten() {
                Some(known) => (fit_known(fit, scan, &known), known.0),
                None => (fit.fit(scan), ScanMotion::REST),
            },
            Knowledge::Given {
                points,
                wait,
                guide,
                frame,
            } => {
                let until = lines.stamp.plus_s(REACH_S);
                let deadline = Instant::now().checked_add(*wait);
                while let Some(point) = points.next_until(until, deadline)? {
                    guide.push(&point);
                }
                guide.forget_before(lines.stamp.plus_s(-REACH_S));
                let motion = motion::guided(guide, frame, lines.stamp, REACH_S);
                self.unknown += u64::from(motion.is_none());
                let motion = motion.unwrap_or_default();
                (fit.fit_moving(scan, motion), motion)
            }
        };
        fitted.motion = motion;
        let found = joint.is_some_and(|joint| self.put(fit, scan, &joint, &mut fitted, lines));
        Ok(found.then_some(fitted))
    }

    /// The same for a scan that has waited, with what is known of its motion now.
    pub(super) fn fit_again(
        &self,
        fit: &mut ReflectorFit,
        scan: &Scan,
        known: &KnownMotion,
        lines: &mut ReflectorLines,
    ) -> Option<Fitted> {
        let mut fitted = Fitted {
            motion: known.0,
            ..Fitted::default()
        };
        let joint = fit_known(fit, scan, known)?;
        self.put(fit, scan, &joint, &mut fitted, lines)
            .then_some(fitted)
    }

    /// Puts lines into their record; false where the correction leaves none.
    fn put(
        &self,
        fit: &mut ReflectorFit,
        scan: &Scan,
        joint: &JointLines,
        fitted: &mut Fitted,
        lines: &mut ReflectorLines,
    ) -> bool {
        if self.correction == Correction::Points {
            fit.record(joint, lines);
            lines.set_motion(fitted.motion);
            return true;
        }
        let corrected = fit.by_beam_length(scan, joint, fitted.motion);
        let Some(joint) = fit.fit(&corrected) else {
            return false;
        };
        // The corrected scan counts as one at rest.
        fit.record(&joint, lines);
        fitted.corrected = Some(corrected);
        true
    }
}

/// The lines with a motion taken out that is known from elsewhere than this scan alone.
fn fit_known(
    fit: &mut ReflectorFit,
    scan: &Scan,
    (motion, covariance): &KnownMotion,
) -> Option<JointLines> {
    let mut joint = fit.fit_moving(scan, *motion)?;
    joint.covariance = line_fit(fit, &joint).with_motion(covariance);
    Some(joint)
}

fn line_fit(fit: &ReflectorFit, joint: &JointLines) -> LineFit {
    LineFit {
        lines: joint.lines,
        seen: joint.seen(fit.options()),
        covariance: joint.covariance,
        sensitivity: joint.sensitivity,
    }
}

/// The motion of every scan, from a first reading of all of them.
fn hindsight(
    frame: &Frame,
    mut fit: ReflectorFit,
    mut turns: Option<Box<Turns>>,
    input: Option<&Path>,
    options: &Options,
) -> anyhow::Result<VecDeque<Option<KnownMotion>>> {
    let regular = |path: &&Path| path.metadata().is_ok_and(|found| found.is_file());
    let Some(path) = input.filter(regular) else {
        let text = "--smooth reads the scans twice: give a file in place of a pipe";
        return Err(Fault::Usage(text.to_owned()).into());
    };
    let quiet = Options {
        quiet: true,
        ..options.clone()
    };
    let mut own = SelfMotion::remembering(frame.bounds.dy_m);
    let mut scans = Input::<Scan>::open(Some(path), &quiet)?;
    let mut lines = ReflectorLines::default();
    while let Some(scan) = scans.next()? {
        lines.begin(scan);
        own.tell_turn(turn_at(&mut turns, lines.stamp)?);
        own.take(on_own_clock(scan, &lines), |motion| {
            let joint = fit.fit_moving(scan, motion)?;
            Some(line_fit(&fit, &joint))
        });
    }
    Ok(own.smoothed().into())
}
