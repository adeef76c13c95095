//! Reflector lines and strip edges: the options and the stage.

use super::deskew::{Deskew, DeskewArgs, Fitted};
use super::{Tally, first_given};
use crate::edges::EdgeMeter;
use crate::frame::Frame;
use crate::lines::reflectors::{self, ReflectorFit};
use crate::motion::KnownMotion;
use crate::record::{ReflectorLines, Scan};
use crate::stream::{self, Emit, Fault, Options, Outcome, Stage};
use crate::tool::values::positive;
use std::path::Path;

/// Settings of the reflector fit.
#[derive(Clone, Debug, clap::Args)]
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
    #[command(flatten)]
    deskew: DeskewArgs,
}

impl ReflectorArgs {
    /// The first option that is given.
    pub(super) fn given(&self) -> Option<&'static str> {
        first_given(&[
            (self.range_sigma_mm.is_some(), "--range-sigma-mm"),
            (self.bias_sigma_mm.is_some(), "--bias-sigma-mm"),
            (self.cold, "--cold"),
        ])
        .or_else(|| self.deskew.given())
    }

    fn options(&self) -> reflectors::Options {
        let default = reflectors::Options::default();
        let bias_sigma_m = self.bias_sigma_mm.map(|mm| mm / 1000.0);
        reflectors::Options {
            sigma_m: self.range_sigma_mm.map(|mm| mm / 1000.0),
            bias_sigma_m: bias_sigma_m.unwrap_or(default.bias_sigma_m),
            track: !self.cold,
            ..default
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
    let fit = ReflectorFit::new(&frame, settings.options());
    let mut stage = Reflectors {
        deskew: settings.deskew.open(&frame, &fit, input, options)?,
        fit,
        waiting: None,
        edges: EdgeMeter::new(&frame),
        lines: ReflectorLines::default(),
        tally: Tally::default(),
    };
    stream::filter(options, input, &mut stage)
}

/// Scans in, the reflector lines and strip edges of each out.
struct Reflectors {
    fit: ReflectorFit,
    deskew: Deskew,
    /// A scan whose motion the next one will tell, with its lines as far as they are known.
    waiting: Option<Box<(Scan, ReflectorLines)>>,
    edges: EdgeMeter,
    lines: ReflectorLines,
    tally: Tally,
}

impl Reflectors {
    /// Writes the lines of the scan that has waited, with what is known of its motion now.
    fn let_go(
        &mut self,
        known: Option<&KnownMotion>,
        emit: &mut Emit<'_, ReflectorLines>,
    ) -> anyhow::Result<()> {
        let Some(waiting) = self.waiting.take() else {
            return Ok(());
        };
        let (scan, mut lines) = *waiting;
        if let Some(known) = known {
            let mut again = ReflectorLines::default();
            again.begin(&scan);
            let fitted = self
                .deskew
                .fit_again(&mut self.fit, &scan, known, &mut again);
            if let Some(fitted) = fitted {
                measure(&mut self.edges, &scan, &fitted, &mut again);
                lines = again;
            }
        }
        emit.write(&lines)
    }
}

/// Measures the edges and says which motion was taken out.
fn measure(edges: &mut EdgeMeter, scan: &Scan, fitted: &Fitted, lines: &mut ReflectorLines) {
    edges.measure(fitted.corrected.as_ref().unwrap_or(scan), lines);
    lines.set_motion(fitted.motion);
}

impl Stage for Reflectors {
    type In = Scan;
    type Out = ReflectorLines;

    fn push(&mut self, scan: &Scan, emit: &mut Emit<'_, ReflectorLines>) -> anyhow::Result<()> {
        self.tally.scans += 1;
        self.lines.begin(scan);
        let fitted = self.deskew.fit(&mut self.fit, scan, &mut self.lines)?;
        let before = fitted.as_ref().and_then(|fitted| fitted.before);
        self.let_go(before.as_ref(), emit)?;
        let Some(fitted) = fitted else {
            self.tally.without += 1;
            return emit.write(&self.lines);
        };
        measure(&mut self.edges, scan, &fitted, &mut self.lines);
        if fitted.wait {
            self.waiting = Some(Box::new((scan.clone(), self.lines.clone())));
            return Ok(());
        }
        emit.write(&self.lines)
    }

    fn finish(&mut self, emit: &mut Emit<'_, ReflectorLines>) -> anyhow::Result<Outcome> {
        self.let_go(None, emit)?;
        let outcome = self.tally.outcome();
        if self.deskew.unknown > 0 {
            eprintln!(
                "extract-lines: --motion does not say how {} of {} scans moved; they were taken as \
                 at rest",
                self.deskew.unknown, self.tally.scans
            );
        }
        Ok(outcome)
    }
}
