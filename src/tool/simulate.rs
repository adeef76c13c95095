//! `simulate`: makes scans, IMU samples and the truth of a run through a virtual frame, or is the
//! scanner itself. Or scans of a scene that is no frame.

mod args;
mod cola;
mod course;
pub(in crate::tool) mod dilution;
mod foreign;
mod jobs;
mod office;
mod robot;
mod serve;
mod serve_args;
mod serve_hokuyo;
mod source;
mod unit;

pub use args::Args;

use crate::simulate::Step;
use crate::stream::{Encoding, Options, Outcome, Output, Role, Stop};
use crate::tool::arguments::Format;
use clap::CommandFactory;
use std::path::Path;
use std::time::{Duration, Instant};

/// Runs the tool.
pub fn run(args: Args) -> anyhow::Result<Outcome> {
    // The derived arguments do not tell what was written from what is a default.
    if let Ok(written) = Args::command().try_get_matches_from(std::env::args_os()) {
        foreign::refuse(&args, &written)?;
    }
    if args.dilution.dilution {
        return dilution::run(&args);
    }
    if args.scene.scene.is_some() {
        return office::run(&args);
    }
    if args.serve.is_asked() {
        return serve::run(&args);
    }
    if args.unit.imu_pty.is_some() {
        return unit::alone(&args);
    }
    if args.common.format == Some(Format::Cola) {
        return cola::run(&args);
    }
    let (frame, text) = args.read_frame()?;
    let mut options = args.common.options("simulate")?;
    options.seed = Some(args.seed);
    options.configuration = Some(text);
    let setup = args::setup(&args, frame, &options)?;
    let start = setup.start;
    let mut simulator = args::simulator(setup)?;
    if let Some(path) = &args.unit.imu_record {
        unit::record(&args, &options, path)?;
    }
    args.jobs.restrict(&mut simulator);
    let stop = Stop::install()?;
    let mut outputs = Outputs::open(&args, &options)?;
    if args.real_time {
        let clock = Instant::now();
        jobs::one_by_one(&mut simulator, &stop, &mut |step| {
            outputs.main.flush()?;
            let due_s = step.complete.since_s(start).max(0.0);
            sleep_until(clock + Duration::from_secs_f64(due_s), &stop);
            outputs.write(step)
        })?;
    } else {
        let mut write = |step: &Step| outputs.write(step);
        args.jobs.run(&mut simulator, &stop, &mut write)?;
    }
    let records = outputs.main.records();
    outputs.finish()?;
    stop.check(records)?;
    Ok(Outcome::Done)
}

/// The main stream and the files beside it.
struct Outputs {
    main: Output,
    sides: Sides,
}

impl Outputs {
    fn open(args: &Args, options: &Options) -> anyhow::Result<Outputs> {
        Ok(Outputs {
            sides: Sides::open(args, options)?,
            main: Output::open(options)?,
        })
    }

    fn write(&mut self, step: &Step) -> anyhow::Result<()> {
        // A reader of scans may wait for the samples beside them.
        self.sides.write(step)?;
        if self.main.encoding() == Encoding::Mcap {
            let main = &mut self.main;
            step.imu.iter().try_for_each(|sample| main.write(sample))?;
            main.write_trajectory(Role::Truth, &step.truth)?;
            main.write_trajectory(Role::Desired, &step.desired)?;
        }
        self.main.write(&step.scan)
    }

    fn finish(self) -> anyhow::Result<()> {
        self.sides.finish()?;
        self.main.finish()
    }
}

/// The files beside the scans.
struct Sides {
    truth: Option<Output>,
    desired: Option<Output>,
    imu: Option<Output>,
}

impl Sides {
    fn open(args: &Args, options: &Options) -> anyhow::Result<Sides> {
        Ok(Sides {
            truth: side_output(args.truth.as_deref(), options)?,
            desired: side_output(args.desired.as_deref(), options)?,
            imu: side_output(args.imu.as_deref(), options)?,
        })
    }

    fn write(&mut self, step: &Step) -> anyhow::Result<()> {
        if let Some(output) = &mut self.imu {
            step.imu
                .iter()
                .try_for_each(|sample| output.write(sample))?;
        }
        if let Some(output) = &mut self.truth {
            output.write_trajectory(Role::Truth, &step.truth)?;
        }
        if let Some(output) = &mut self.desired {
            output.write_trajectory(Role::Desired, &step.desired)?;
        }
        for output in [&mut self.imu, &mut self.truth, &mut self.desired]
            .into_iter()
            .flatten()
        {
            if output.encoding() == Encoding::Csv {
                output.flush()?;
            }
        }
        Ok(())
    }

    fn finish(self) -> anyhow::Result<()> {
        let sides = [self.imu, self.truth, self.desired];
        sides.into_iter().flatten().try_for_each(Output::finish)
    }
}

/// A file beside the scans: MCAP if its name says so.
fn side_output(path: Option<&Path>, options: &Options) -> anyhow::Result<Option<Output>> {
    let create = |path: &Path| {
        let is_mcap = path.extension().is_some_and(|e| e == "mcap");
        let encoding = if is_mcap {
            Encoding::Mcap
        } else {
            Encoding::Csv
        };
        Output::create(path, encoding, options)
    };
    path.map(create).transpose()
}

/// Sleeps to an absolute instant, in pieces short enough to notice a signal.
fn sleep_until(due: Instant, stop: &Stop) {
    while !stop.requested() {
        let left = due.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return;
        }
        std::thread::sleep(left.min(Duration::from_millis(20)));
    }
}
