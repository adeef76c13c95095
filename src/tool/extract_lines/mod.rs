//! extract-lines: scans in; reflector lines with strip edges, or the lines of any scene, out.

use crate::edges::EdgeMeter;
use crate::frame::Frame;
use crate::lines::reflectors::{self, ReflectorFit};
use crate::lines::split_and_merge::{SplitAndMerge, SplitAndMergeOptions};
use crate::record::{ReflectorLines, Scan, Segment};
use crate::stream::{self, Emit, Fault, Options, Outcome, Stage};
use crate::tool::common::CommonArgs;
use std::path::PathBuf;

/// The command line.
#[derive(Debug, clap::Parser)]
#[command(
    name = "extract-lines",
    version,
    about = "Find straight lines in scans",
    long_about = "Find straight lines in scans.\n\n\
        With a frame file: the frame's three reflector lines, fitted jointly with the range bias, \
        and the edges of its strips; one lines record a scan, for solve-pose. Without one: all \
        lines of any scene; one segment record a line.",
    after_long_help = EXAMPLES
)]
pub struct Args {
    /// Scans, CSV or MCAP [default: stdin]
    #[arg(value_name = "SCANS")]
    pub input: Option<PathBuf>,
    /// Frame file: the box, its reflectors and the mountings
    #[arg(short, long, value_name = "FILE")]
    pub frame: Option<PathBuf>,
    /// How lines are found [default: reflectors with a frame file, else split-and-merge]
    #[arg(long, value_enum, value_name = "METHOD")]
    pub method: Option<Method>,
    #[command(flatten)]
    reflectors: ReflectorArgs,
    #[command(flatten)]
    general: GeneralArgs,
    #[command(flatten)]
    common: CommonArgs,
}

/// Ways to find lines.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Method {
    /// The frame's three reflector lines and the strip edges
    Reflectors,
    /// All lines of any scene
    SplitAndMerge,
}

/// Settings of the reflector fit.
#[derive(Clone, Copy, Debug, clap::Args)]
#[command(next_help_heading = "Reflector lines")]
struct ReflectorArgs {
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
    fn given(&self) -> Option<&'static str> {
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

/// Settings of the extractors for any scene.
#[derive(Clone, Copy, Debug, clap::Args)]
#[command(next_help_heading = "Lines of any scene")]
struct GeneralArgs {
    /// Standard deviation of a range; rather too large than too small [default: 6.5]
    #[arg(long, value_name = "MM", value_parser = positive)]
    sigma_mm: Option<f64>,
    /// Fewest beams on a line [default: 9]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..))]
    min_points: Option<u32>,
    /// Shortest line [default: 0.5]
    #[arg(long, value_name = "M", value_parser = positive)]
    min_length_m: Option<f64>,
    /// Widest gap within a line [default: 0.5]
    #[arg(long, value_name = "M", value_parser = positive)]
    max_gap_m: Option<f64>,
}

impl GeneralArgs {
    /// The first option that is given.
    fn given(&self) -> Option<&'static str> {
        let options = [
            (self.sigma_mm.is_some(), "--sigma-mm"),
            (self.min_points.is_some(), "--min-points"),
            (self.min_length_m.is_some(), "--min-length-m"),
            (self.max_gap_m.is_some(), "--max-gap-m"),
        ];
        options
            .iter()
            .find(|(given, _)| *given)
            .map(|(_, name)| *name)
    }

    fn options(&self) -> SplitAndMergeOptions {
        let mut options = SplitAndMergeOptions::default();
        options.segmentation.sigma_m = self.sigma_mm.unwrap_or(6.5) / 1000.0;
        options.segmentation.max_gap_m = self.max_gap_m.unwrap_or(0.5);
        options.min_points = self.min_points.unwrap_or(9) as usize;
        options.min_length_m = self.min_length_m.unwrap_or(0.5);
        options
    }
}

const EXAMPLES: &str = "\
EXAMPLES
  Reflector lines and strip edges, for solve-pose:
    simulate -f frame.toml | extract-lines -f frame.toml > lines.csv
  The walls of a room, from a scanner's recorded bytes:
    scan-capture --replay run.cola | extract-lines --method split-and-merge > segments.csv
  A scanner with 15 mm of noise, only lines of a metre or more:
    extract-lines --sigma-mm 15 --min-length-m 1 scans.csv > segments.csv
  MCAP in, MCAP out, scans and segments together:
    extract-lines --method split-and-merge run.mcap -o segments.mcap";

/// Runs the tool.
pub fn run(args: Args) -> anyhow::Result<Outcome> {
    let mut options = args.common.options("extract-lines")?;
    let frame = match &args.frame {
        Some(path) => {
            options.configuration = std::fs::read_to_string(path).ok();
            Some(Frame::read(path)?)
        }
        None => None,
    };
    let default = match frame {
        Some(_) => Method::Reflectors,
        None => Method::SplitAndMerge,
    };
    let method = args.method.unwrap_or(default);
    refuse_foreign(method, &args)?;
    match method {
        Method::Reflectors => reflector_lines(frame, &args, &options),
        Method::SplitAndMerge => {
            let mut stage = General {
                extractor: SplitAndMerge::new(args.general.options()),
                segments: Vec::new(),
            };
            stream::filter(&options, args.input.as_deref(), &mut stage)
        }
    }
}

/// Refuses an option of the other method, which would have no effect.
fn refuse_foreign(method: Method, args: &Args) -> Result<(), Fault> {
    let (foreign, owner, used) = match method {
        Method::Reflectors => (args.general.given(), "split-and-merge", "reflectors"),
        Method::SplitAndMerge => (args.reflectors.given(), "reflectors", "split-and-merge"),
    };
    foreign.map_or(Ok(()), |option| {
        let text = format!("{option} belongs to --method {owner}; the method is {used}");
        Err(Fault::Usage(text))
    })
}

fn reflector_lines(
    frame: Option<Frame>,
    args: &Args,
    options: &Options,
) -> anyhow::Result<Outcome> {
    let Some(frame) = frame else {
        let text = "--method reflectors needs the frame: -f FILE";
        return Err(Fault::Usage(text.to_owned()).into());
    };
    let mut stage = Reflectors {
        fit: ReflectorFit::new(&frame, args.reflectors.options()),
        edges: EdgeMeter::new(&frame),
        lines: ReflectorLines::default(),
        without: 0,
        scans: 0,
    };
    stream::filter(options, args.input.as_deref(), &mut stage)
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

/// Scans in, the segments of each out.
struct General {
    extractor: SplitAndMerge,
    segments: Vec<Segment>,
}

impl Stage for General {
    type In = Scan;
    type Out = Segment;

    fn push(&mut self, scan: &Scan, emit: &mut Emit<'_, Segment>) -> anyhow::Result<()> {
        self.extractor.extract(scan, &mut self.segments);
        for segment in &self.segments {
            emit.write(segment)?;
        }
        Ok(())
    }

    fn finish(&mut self, _emit: &mut Emit<'_, Segment>) -> anyhow::Result<Outcome> {
        Ok(Outcome::Done)
    }
}

fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value > 0.0 && value.is_finite() => Ok(value),
        _ => Err("a positive number is wanted".to_owned()),
    }
}
