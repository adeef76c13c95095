//! scan-capture: scans from a laser scanner, or from a recorded byte stream of one.
//!
//! - `args` the command line
//! - `live` what every scanner's capture has in common: time limits, outages, signals, the end; a
//!   `live::Scanner` speaks to one kind of device
//! - `line` what every scanner's line has: its recording, time limits, remarks
//! - `sick` the scanner that is a SICK, `hokuyo` the one that is a Hokuyo
//! - `configure` what it is to be set to; `info` what it tells of itself, and the serial ports
//! - `replay` recordings
//! - `angle_jitter` the model of a motor's jitter, read and learned

mod angle_jitter;
mod args;
mod configure;
mod hokuyo;
mod info;
mod line;
mod live;
mod replay;
mod sick;

pub use args::Args;

use crate::frame::Frame;
use crate::hokuyo::scans;
use crate::sick::replay::Settings;
use crate::stream::{Fault, Outcome, Stop};
use crate::tool::ending::Ending;
use crate::tool::tee::Tee;
use args::AngleJitterArg;
use line::Line;
use std::path::Path;

/// The tool's name.
const NAME: &str = "scan-capture";

/// Runs the tool.
pub fn run(args: Args) -> anyhow::Result<Outcome> {
    match &args.command {
        Some(args::Command::Info(args)) => return info::info(args),
        Some(args::Command::List(args)) => return info::list(args),
        None => {}
    }
    args.check()?;
    let plan = args.configure.plan()?;
    if let Some(plan) = plan.as_ref().filter(|_| args.configure.dry_run) {
        return plan.print();
    }
    let mut options = args.common.options(NAME)?;
    let mut settings = Settings {
        epoch: args.epoch,
        ..Settings::default()
    };
    if let Some(path) = &args.frame {
        options.configuration = Some(apply_frame(path, &mut settings)?);
    }
    match &args.angle_jitter {
        AngleJitterArg::Off => {}
        AngleJitterArg::Learn => return angle_jitter::learn(&args, settings),
        AngleJitterArg::Model(path) => settings.angle_jitter = Some(angle_jitter::read(path)?),
    }
    if !args.replay.is_empty() {
        return replay::run(&args, options, settings);
    }
    let Some(device) = args.device.clone() else {
        return Err(Fault::Usage("DEVICE is missing".into()).into());
    };
    let ending = Ending::new(Stop::install()?, &options);
    let rotation = args.tee_rotate.unwrap_or_default();
    let tee = Tee::new(NAME, args.tee.as_deref(), rotation);
    let line = Line::new(device.clone(), &options, &ending, &tee);
    let capture = live::Settings::new(device, &args);
    match args.live.kind {
        args::DeviceKind::Sick => {
            let scanner = sick::Sick::new(line, &args.live, plan, settings);
            live::run(scanner, &capture, options, &ending, &tee)
        }
        args::DeviceKind::Hokuyo => {
            let settings = scans::Settings {
                index_to_first_beam_s: settings.index_to_first_beam_s,
                range_min_m: settings.range_min_m,
            };
            let scanner = hokuyo::Hokuyo::new(line, &args.live, settings);
            live::run(scanner, &capture, options, &ending, &tee)
        }
    }
}

/// Takes over what the frame file says of the scanner; gives its text.
fn apply_frame(path: &Path, settings: &mut Settings) -> anyhow::Result<String> {
    let (frame, text) = Frame::read_with_text(path)?;
    let model = frame.scanner_model();
    settings.index_to_first_beam_s = frame.scanner.index_to_first_beam_s;
    settings.aperture_start_rad = model.aperture_deg[0].to_radians();
    settings.range_min_m = Some(model.range_m[0]);
    Ok(text)
}
