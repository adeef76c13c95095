//! `--angle-jitter`: the model of a SICK's motor jitter, read from a file and learned from a
//! recording.

use super::NAME;
use super::args::Args;
use super::replay::each_scan;
use crate::sick::angle_jitter::{AngleJitter, Learner};
use crate::sick::cola::Framer;
use crate::sick::replay::{Replay, Settings};
use crate::stream::{Fault, Outcome, WholeFile};
use crate::tool::recording::Times;
use anyhow::Context;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Reads a model.
pub(super) fn read(path: &Path) -> anyhow::Result<AngleJitter> {
    let name = path.display();
    let text = std::fs::read_to_string(path)
        .map_err(|error| Fault::NoInput(format!("{name}: {error}")))?;
    let model = AngleJitter::from_toml(&text);
    Ok(model.map_err(|error| Fault::Configuration(format!("{name}: {error}")))?)
}

/// Learns a model from recordings, which may be the parts of one, and writes it.
pub(super) fn learn(args: &Args, settings: Settings) -> anyhow::Result<Outcome> {
    // Stamps do not matter here; what makes no sense of recordings does not either way.
    Times::new(&args.replay, args.times.as_deref(), args.no_times)?;
    let output = WholeFile::open(args.common.output.as_deref())?;
    let mut learner = Learner::default();
    let mut replay = Replay::new(settings);
    let mut framer = Framer::new();
    for recording in &args.replay {
        let name = recording.display();
        let bytes: Box<dyn Read> = if recording == Path::new("-") {
            Box::new(std::io::stdin())
        } else {
            let file = File::open(recording);
            Box::new(file.map_err(|error| Fault::NoInput(format!("{name}: {error}")))?)
        };
        each_scan(bytes, &mut framer, &mut replay, |scan| {
            learner.push(scan);
            !learner.is_full()
        })
        .with_context(|| name.to_string())?;
    }
    let model = learner
        .learn()
        .map_err(|error| Fault::BadData(format!("no angle jitter learned: {error}")))?;
    let text = model.to_toml();
    output.finish(&text)?;
    if !args.common.quiet {
        eprintln!(
            "{NAME}: {} scans: {:.4} deg of angle jitter, of which {:.4} deg stay (noise {:.4} deg)",
            model.scans, model.jitter_deg, model.left_at_once_deg, model.noise_deg
        );
    }
    Ok(Outcome::Done)
}
