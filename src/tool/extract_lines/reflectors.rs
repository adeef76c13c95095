//! Reflector lines and strip edges: the options and the stage.

use super::positive;
use crate::edges::EdgeMeter;
use crate::frame::Frame;
use crate::lines::reflectors::{self, ReflectorFit};
use crate::record::{ReflectorLines, Scan};
use crate::stream::{self, Emit, Fault, Options, Outcome, Stage};
use std::path::Path;

/// Settings of the reflector fit.
#[derive(Clone, Copy, Debug, clap::Args)]
#[command(next_help_heading = "Reflector lines")]
pub(super) struct ReflectorArgs {
    /// Standard deviation of a range [default: from each scan's own residuals]
    #[arg(long, value_name = "MM", value_parser = positive)]
    range_sigma_mm: Option<f64>,
    /// Prior standard deviation of the range bias common to all beams [default: 15]
    #[arg(long, value_name = "MM", value_parser = positive)]
    bias_sigma_mm: Option<f64>,
    /// Look for the reflectors anew in every scan, without the scan before as a prediction
    #[arg(long)]
    cold: bool,
}

impl ReflectorArgs {
    /// The first option that is given.
    pub(super) fn given(&self) -> Option<&'static str> {
        let options = [
            (self.range_sigma_mm.is_some(), "--range-sigma-mm"),
            (self.bias_sigma_mm.is_some(), "--bias-sigma-mm"),
            (self.cold, "--cold"),
        ];
        options
            .iter()
            .find(|(given, _)| *given)
            .map(|(_, name)| *name)
    }

    fn options(&self) -> reflectors::Options {
        reflectors::Options {
            sigma_m: self.range_sigma_mm.map(|mm| mm / 1000.0),
            bias_sigma_m: self.bias_sigma_mm.unwrap_or(15.0) / 1000.0,
            track: !self.cold,
            ..reflectors::Options::default()
        }
    }
}

/// Reads scans and writes the reflector lines and strip edges of each.
pub(super) fn run(
    frame: Option<Frame>,
    settings: &ReflectorArgs,
    input: Option<&Path>,
    options: &Options,
) -> anyhow::Result<Outcome> {
    let Some(frame) = frame else {
        let text = "--method reflectors needs the frame: -f FILE";
        return Err(Fault::Usage(text.to_owned()).into());
    };
    let mut stage = Reflectors {
        fit: ReflectorFit::new(&frame, settings.options()),
        edges: EdgeMeter::new(&frame),
        lines: ReflectorLines::default(),
        without: 0,
        scans: 0,
    };
    stream::filter(options, input, &mut stage)
}

/// Scans in, the reflector lines and strip edges of each out.
struct Reflectors {
    fit: ReflectorFit,
    edges: EdgeMeter,
    lines: ReflectorLines,
    scans: u64,
    without: u64,
}

impl Stage for Reflectors {
    type In = Scan;
    type Out = ReflectorLines;

    fn push(&mut self, scan: &Scan, emit: &mut Emit<'_, ReflectorLines>) -> anyhow::Result<()> {
        self.scans += 1;
        self.lines.begin(scan);
        match self.fit.fit(scan) {
            Some(fit) => {
                self.fit.record(&fit, &mut self.lines);
                self.edges.measure(scan, &mut self.lines);
            }
            None => self.without += 1,
        }
        emit.write(&self.lines)
    }

    fn finish(&mut self, _emit: &mut Emit<'_, ReflectorLines>) -> anyhow::Result<Outcome> {
        if self.without > 0 {
            eprintln!(
                "extract-lines: no reflectors in {} of {} scans",
                self.without, self.scans
            );
        }
        let nothing = self.without == self.scans && self.scans > 0;
        Ok(if nothing {
            Outcome::Degraded
        } else {
            Outcome::Done
        })
    }
}
