//! extract-lines: scans in; reflector lines with strip edges, or the lines of any scene, out.

mod deskew;
mod general;
mod reflectors;
mod strategy;

use self::general::GeneralArgs;
use self::reflectors::ReflectorArgs;
use crate::frame::Frame;
use crate::stream::{Fault, Outcome};
use crate::tool::arguments::CommonArgs;
use clap::ValueEnum;
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
        lines of any scene; one segment record a line.\n\n\
        Everything in a lines record is for its stamp_ns, the instant at which the beam at 90 deg \
        fires. The motion of the scanner before and after it, within the scan, is taken out: by \
        default it is found from the scans themselves, and the record says what it was \
        (motion_vy_m_s, motion_vz_m_s, motion_roll_rad_s). The first scan, and one after a pause \
        of a second, waits for the next, which tells its motion. A platform that stands still in \
        each scan but elsewhere in the next, by less than 8 m/s, needs --deskew none.",
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
    windows: strategy::WindowArgs,
    #[command(flatten)]
    common: CommonArgs,
}

/// Ways to find lines.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Method {
    /// The frame's three reflector lines and the strip edges
    Reflectors,
    /// Groups are split at corners, then what lies on one line is merged
    SplitAndMerge,
    /// Iterative end point fit: groups are split at the point farthest from the chord
    Iepf,
    /// Line tracking: a line grows beam by beam until one is off
    Incremental,
    /// Lines through sliding windows, clustered
    LineRegression,
    /// The partition of each group into lines that is most likely
    Ml,
    /// Random pairs of points, and the line that most points agree with
    Ransac,
    /// Hough transform (Duda and Hart)
    Hough,
    /// Hierarchical Hough transform (Li, Lavin and Le Master)
    FastHough,
    /// Hough transform in windows around the lines predicted (Kurniawan 2017, eq. 4.5 to 4.10)
    ModifiedHough,
    /// Expectation maximisation
    Em,
    /// Kurniawan's whole strategy: modified Hough, corner points, RANSAC, least squares
    Dissertation,
}

impl Method {
    /// Its name on the command line.
    fn name(self) -> String {
        let value = self.to_possible_value();
        value.map_or_else(String::new, |value| value.get_name().to_owned())
    }
}

const EXAMPLES: &str = "\
EXAMPLES
  Reflector lines and strip edges, for solve-pose:
    simulate -f frame.toml | extract-lines -f frame.toml > lines.csv
  The walls of a room, from a scanner's recorded bytes:
    scan-capture --replay run.cola | extract-lines --method split-and-merge > segments.csv
  A recorded run, the motion within each scan in hindsight:
    extract-lines -f frame.toml --smooth scans.csv > lines.csv
  A scanner with 15 mm of noise, only lines of a metre or more:
    extract-lines --sigma-mm 15 --min-length-m 1 scans.csv > segments.csv
  The most likely lines, whatever it takes:
    extract-lines --method ml scans.csv > segments.csv
  Why a wall is not found: how many beams met which fate:
    extract-lines --explain scans.csv | cut -d, -f6 | sort | uniq -c
  MCAP in, MCAP out, scans and segments together:
    extract-lines --method split-and-merge run.mcap -o segments.mcap";

/// Runs the tool.
pub fn run(args: Args) -> anyhow::Result<Outcome> {
    let mut options = args.common.options("extract-lines")?;
    let frame = match &args.frame {
        Some(path) => {
            let (frame, text) = Frame::read_with_text(path)?;
            options.configuration = Some(text);
            Some(frame)
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
        Method::Reflectors => {
            reflectors::run(frame, &args.reflectors, args.input.as_deref(), &options)
        }
        Method::Dissertation => {
            strategy::run(frame, true, &args.windows, args.input.as_deref(), &options)
        }
        Method::ModifiedHough if frame.is_some() => {
            strategy::run(frame, false, &args.windows, args.input.as_deref(), &options)
        }
        method => general::run(
            method,
            &args.general,
            &args.windows,
            args.input.as_deref(),
            &options,
        ),
    }
}

/// Refuses an option of another kind of method, which would have no effect.
fn refuse_foreign(method: Method, args: &Args) -> Result<(), Fault> {
    let windowed = matches!(method, Method::ModifiedHough | Method::Dissertation);
    let is_frame = method == Method::Reflectors || (windowed && args.frame.is_some());
    let owners = [
        (is_frame, args.general.given(), "the methods for any scene"),
        (
            method != Method::Reflectors,
            args.reflectors.given(),
            "--method reflectors",
        ),
        (
            !windowed,
            args.windows.given(),
            "--method modified-hough and dissertation",
        ),
    ];
    let foreign = owners
        .into_iter()
        .find_map(|(refused, given, owner)| Some((given.filter(|_| refused)?, owner)));
    foreign.map_or(Ok(()), |(option, owner)| {
        let used = method.name();
        let text = format!("{option} belongs to {owner}; the method is {used}");
        Err(Fault::Usage(text))
    })
}

/// The first of some options that is given, by its name.
fn first_given(options: &[(bool, &'static str)]) -> Option<&'static str> {
    let given = options.iter().find(|(given, _)| *given);
    given.map(|(_, name)| *name)
}

/// How many scans came, and in how many of them the frame was not found.
#[derive(Default)]
struct Tally {
    scans: u64,
    without: u64,
}

impl Tally {
    /// Says what was not found; the outcome of a run whose scans were counted so.
    fn outcome(&self) -> Outcome {
        let Tally { scans, without } = self;
        if *without > 0 {
            eprintln!("extract-lines: no reflectors in {without} of {scans} scans");
        }
        if *scans > 0 && without == scans {
            Outcome::Degraded
        } else {
            Outcome::Done
        }
    }
}
