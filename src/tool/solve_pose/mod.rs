//! solve-pose: reflector lines with strip edges in, poses with covariance out.

mod align;
mod arguments;
mod attitude;
mod calibrate;
mod filter;

pub use arguments::{Args, Method};

use crate::frame::Frame;
use crate::pose::joint::{self, Estimator};
use crate::pose::pitch;
use crate::pose::vote;
use crate::record::{ImuSample, Pose, ReflectorLines};
use crate::stream::{self, Emit, Fault, Outcome, Stage};
use align::Align;
use attitude::AttitudeSource;
use calibrate::Calibrate;
use filter::ManyScans;

/// Runs the tool.
pub fn run(args: Args) -> anyhow::Result<Outcome> {
    let mut options = args.common.options("solve-pose")?;
    if args.align.align_imu.is_some() && args.method != Method::Joint {
        let why = "--align-imu needs --method joint: the vote has no covariances";
        return Err(Fault::Usage(why.to_owned()).into());
    }
    if (args.filter.filter || args.filter.smooth) && args.method != Method::Joint {
        let why = "--filter and --smooth need --method joint: the vote has no covariances";
        return Err(Fault::Usage(why.to_owned()).into());
    }
    let (frame, text) = args.frame.read()?;
    options.configuration = Some(text.clone());
    let calibrate = Calibrate::asked(&args, &frame, &text, options.quiet)?;
    let x_constant = args.align.align_x_constant;
    let align = args
        .align
        .align_imu
        .map(|path| Align::new(path, text, x_constant, options.quiet))
        .transpose()?;
    let mut stage = Solve {
        joint: Estimator::new(&frame, joint::Options::default()),
        many: ManyScans::new(&args.filter, &frame),
        ready: Vec::new(),
        frame,
        method: args.method,
        attitude: AttitudeSource::open(&args.pitch, &options)?,
        align,
        calibrate,
        solved: 0,
        unsolved: 0,
    };
    stream::filter(&options, args.input.as_deref(), &mut stage)
}

/// Lines in, one pose each out.
struct Solve {
    frame: Frame,
    method: Method,
    joint: Estimator,
    attitude: AttitudeSource,
    align: Option<Align>,
    calibrate: Option<Calibrate>,
    /// The filter or smoother, if one is asked for.
    many: Option<ManyScans>,
    /// Poses that it has ready.
    ready: Vec<Pose>,
    solved: u64,
    unsolved: u64,
}

impl Solve {
    /// Writes the poses that are ready.
    fn give_out(&mut self, emit: &mut Emit<'_, Pose>) -> anyhow::Result<()> {
        for pose in self.ready.drain(..) {
            if pose.is_solved() {
                self.solved += 1;
            } else {
                self.unsolved += 1;
            }
            emit.write(&pose)?;
        }
        Ok(())
    }
}

impl Stage for Solve {
    type In = ReflectorLines;
    type Out = Pose;

    fn push(&mut self, lines: &ReflectorLines, emit: &mut Emit<'_, Pose>) -> anyhow::Result<()> {
        let attitude = self.attitude.attitude(lines, &self.frame)?;
        let pitch = self.attitude.pitch(attitude.as_ref());
        let changes_rad = &self.attitude.changes_rad;
        if let Some(many) = &mut self.many {
            let ready = &mut self.ready;
            many.take(lines, pitch, changes_rad, |pose| ready.push(pose));
            return self.give_out(emit);
        }
        let joint = &mut self.joint;
        let mut solve = |pitch| joint.solve(lines, pitch, changes_rad);
        let pose = match self.method {
            Method::Joint => solve(pitch),
            Method::Vote => {
                let pose = vote::pose(lines, &self.frame, pitch.map_or(0.0, |p| p.rad));
                Pose {
                    status: pose.status | pitch::status(pitch),
                    ..pose
                }
            }
        };
        if let (Some(align), Some(attitude)) = (&mut self.align, attitude.filter(|a| !a.stale)) {
            align.add(&pose, &attitude, &self.frame, solve);
        }
        if let Some(calibrate) = &mut self.calibrate {
            calibrate.add(lines, &pose, pitch, attitude.as_ref(), changes_rad);
        }
        self.ready.push(pose);
        self.give_out(emit)
    }

    fn wants_imu(&self) -> bool {
        self.attitude.wants_imu()
    }

    fn imu(&mut self, sample: &ImuSample) {
        self.attitude.push(sample);
    }

    fn finish(&mut self, emit: &mut Emit<'_, Pose>) -> anyhow::Result<Outcome> {
        if let Some(many) = &mut self.many {
            let ready = &mut self.ready;
            many.finish(|pose| ready.push(pose));
            if let Some(remarks) = many.remarks() {
                eprintln!("solve-pose: {remarks}");
            }
        }
        self.give_out(emit)?;
        if self.unsolved > 0 {
            let all = self.solved + self.unsolved;
            eprintln!(
                "solve-pose: {} of {all} scans gave no pose; see their status",
                self.unsolved
            );
        }
        let aligned = match self.align.take() {
            Some(align) => align.write(&self.frame)?,
            None => true,
        };
        let calibrated = match self.calibrate.take() {
            Some(calibrate) => calibrate.write(&self.frame)?,
            None => true,
        };
        let nothing = self.solved == 0 && self.unsolved > 0;
        Ok(if nothing || !aligned || !calibrated {
            Outcome::Degraded
        } else {
            Outcome::Done
        })
    }
}
