//! `--angle-jitter`: the model of a SICK's motor jitter, read from a file and learned from a
//! recording.

use super::NAME;
use super::args::Args;
use crate::sick::angle_jitter::{AngleJitter, Learner, MOST_SCANS};
use crate::sick::cola::{Event, Framer};
use crate::sick::replay::{Replay, Settings};
use crate::sick::scandata::{self, LmdScandata};
use crate::stream::{Fault, Outcome, WholeFile};
use anyhow::Context;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Bytes read at a time.
const CHUNK: usize = 1 << 16;

/// Reads a model.
pub(super) fn read(path: &Path) -> anyhow::Result<AngleJitter> {
    let name = path.display();
    let text = std::fs::read_to_string(path)
        .map_err(|error| Fault::NoInput(format!("{name}: {}", plain(&error))))?;
    let model = AngleJitter::from_toml(&text);
    Ok(model.map_err(|error| Fault::Configuration(format!("{name}: {error}")))?)
}

/// Learns a model from recordings and writes it.
pub(super) fn learn(args: &Args, settings: Settings) -> anyhow::Result<Outcome> {
    let output = WholeFile::open(args.common.output.as_deref())?;
    let mut learner = Learner::default();
    let mut replay = Replay::new(settings);
    let mut telegram = LmdScandata::default();
    for recording in &args.replay {
        let name = recording.display();
        let mut bytes: Box<dyn Read> = if recording == Path::new("-") {
            Box::new(std::io::stdin())
        } else {
            let file = File::open(recording);
            Box::new(file.map_err(|error| Fault::NoInput(format!("{name}: {}", plain(&error))))?)
        };
        let mut framer = Framer::new();
        let mut chunk = vec![0; CHUNK];
        let mut scans = 0;
        loop {
            let length = bytes.read(&mut chunk).with_context(|| name.to_string())?;
            framer.feed(chunk.get(..length).unwrap_or_default());
            if length == 0 {
                framer.end();
            }
            while let Some(event) = framer.next() {
                if let Event::Telegram(found) = event
                    && scandata::is_scan(&found)
                    && telegram.parse(&found).is_ok()
                    && let Ok(Some(scan)) = replay.push(&telegram, None)
                {
                    learner.push(scan);
                    scans += 1;
                }
            }
            if length == 0 || scans > MOST_SCANS {
                break;
            }
        }
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

fn plain(error: &std::io::Error) -> String {
    let text = error.to_string();
    text.split(" (os error")
        .next()
        .unwrap_or_default()
        .to_owned()
}
