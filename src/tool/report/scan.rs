//! `report scan`: scans drawn, with what was found in them.

use super::inputs::{is_bad_data, is_pipe, joined, refuse_twice};
use super::outputs;
use super::pictures::PictureArgs;
use crate::frame::Frame;
use crate::record::{Pose, ReflectorLines, Scan};
use crate::report::scan::{View, figures, json, page, table, view};
use crate::report::{Figure, origin};
use crate::stream::{Encoding, Input, Options, Outcome, Role, StreamCopy, copies, read_all};
use crate::tool::arguments::CommonArgs;
use std::path::{Path, PathBuf};
use std::thread;

const EXAMPLES: &str = "\
EXAMPLES
  The first scan of a recording and what extract-lines found in it, as a page:
    extract-lines -f frame.toml scans.csv > found.csv
    report scan --lines found.csv --html scan.html scans.csv
  Scan 12 alone, with the frame as the solved pose has it, as pictures:
    report scan --lines found.csv --poses poses.csv -f frame.toml --seq 12 --png pictures scans.csv
  Five scans to step through, from one MCAP file that has scans and lines:
    extract-lines -f frame.toml run.mcap -o both.mcap
    report scan -n 5 --html steps.html both.mcap

EXIT STATUS
  0 done; 2 usage; 3 no such scan, or no lines came for one; 65 bad data; 66 no such input; 74 I/O
  error; 78 the frame makes no sense";

/// Draws scans: beams, reflectors, lines, edges, residuals
#[derive(Clone, Debug, clap::Args)]
#[command(
    long_about = "Draws scans to scale with what was found in them: the beams on reflectors and the others, \
                  the fitted lines, the strip edges with their intervals and estimates; below, the \
                  residual and the remission of every beam.",
    after_long_help = EXAMPLES,
    mut_arg("format", |arg| arg.hide(true))
)]
pub struct ScanArgs {
    /// Scans: a file, a FIFO or - for stdin (the default)
    #[arg(value_name = "SCANS")]
    scans: Option<PathBuf>,
    /// What extract-lines found in them [default: /lines of the same stream, if that is MCAP]
    #[arg(long, value_name = "FILE")]
    lines: Option<PathBuf>,
    /// Frame file: draw its reflectors too, as the poses of --poses have them
    #[arg(short, long, value_name = "FILE", requires = "poses")]
    frame: Option<PathBuf>,
    /// Poses of the scans
    #[arg(long, value_name = "FILE", requires = "frame")]
    poses: Option<PathBuf>,
    /// Scans to draw, from the first on; a page grows by about 60 kB with each
    #[arg(short, long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=100))]
    n: u32,
    /// Begin with the scan of this sequence number
    #[arg(long, value_name = "NUMBER")]
    seq: Option<u32>,
    /// Print JSON in place of the text
    #[arg(long)]
    json: bool,
    /// Write a page
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
    /// Title of the page
    #[arg(long, value_name = "TEXT")]
    title: Option<String>,
    #[command(flatten)]
    pictures: PictureArgs,
    /// ASCII only [default: where the locale is not UTF-8]
    #[arg(long)]
    ascii: bool,
    #[command(flatten)]
    common: CommonArgs,
}

/// Runs the subcommand.
pub(super) fn run(args: &ScanArgs) -> anyhow::Result<Outcome> {
    let options = args.common.options("report")?;
    let frame = args.frame.as_deref().map(Frame::read).transpose()?;
    let (html, output) = outputs::open(args.html.as_deref(), args.common.output.as_deref())?;
    let path = args.scans.clone().unwrap_or_else(|| PathBuf::from("-"));
    let (scans, lines, poses) = read(args, &path, &options)?;
    let views: Vec<View> = scans
        .iter()
        .map(|scan| {
            let found = lines.iter().find(|l| l.scan_stamp == scan.stamp);
            let pose = poses
                .iter()
                .find(|p| p.scan_stamp == scan.stamp && p.is_solved());
            let truth = frame.as_ref().zip(pose);
            view(
                scan,
                found,
                truth.map(|(f, p)| (f, p.position_m, p.rotation_rad)),
            )
        })
        .collect();
    let name = origin::input_name(&path);
    let command = origin::own_command_line();
    if let Some(html) = html {
        html.finish(page(args.title.as_deref(), &name, &views, &command))?;
    }
    if args.pictures.wanted() {
        let several = views.len() > 1;
        let of_view = |v: &View| -> Vec<Figure> {
            let prefix = if several {
                v.seq.to_string()
            } else {
                String::new()
            };
            figures(v, false, &prefix)
        };
        args.pictures
            .write(&views.iter().flat_map(of_view).collect::<Vec<_>>())?;
    }
    let text = if args.json {
        json(&name, &views)?
    } else {
        table(&views, args.ascii || !outputs::is_utf8())
    };
    output.finish(&text)?;
    Ok(outcome(args, &views, !lines.is_empty()))
}

fn outcome(args: &ScanArgs, views: &[View], lines: bool) -> Outcome {
    let mut outcome = Outcome::Done;
    if views.is_empty() {
        outcome = Outcome::Degraded;
        match args.seq {
            Some(seq) => eprintln!("report: there is no scan {seq}"),
            None => eprintln!("report: there is no scan"),
        }
    }
    let without = views.iter().filter(|v| v.lines.is_none()).count();
    if without > 0 && (lines || args.lines.is_some()) {
        outcome = Outcome::Degraded;
        eprintln!("report: {without} scans have no lines of their stamp");
    }
    outcome
}

type Read = (Vec<Scan>, Vec<ReflectorLines>, Vec<Pose>);

/// Reads all inputs at the same time: they may be branches of one pipeline.
fn read(args: &ScanArgs, path: &Path, options: &Options) -> anyhow::Result<Read> {
    let beside = args.lines.iter().chain(&args.poses).map(PathBuf::as_path);
    refuse_twice([path].into_iter().chain(beside))?;
    let mut halves: [Option<StreamCopy>; 2] = [None, None];
    if args.lines.is_none() && is_pipe(path) {
        halves = copies(Some(path))?.map(Some);
    }
    let [of_scans, of_lines] = halves;
    thread::scope(|scope| {
        let lines = scope.spawn(move || match &args.lines {
            Some(path) => read_all(Some(path), options),
            None => lines_beside(path, of_lines, options),
        });
        let poses = scope.spawn(move || match &args.poses {
            Some(path) => read_all(Some(path), options),
            None => Ok(Vec::new()),
        });
        let scans = scans(args, path, of_scans, options);
        let lines = joined(lines);
        let poses = joined(poses);
        Ok((scans?, lines?, poses?))
    })
}

fn scans(
    args: &ScanArgs,
    path: &Path,
    half: Option<StreamCopy>,
    options: &Options,
) -> anyhow::Result<Vec<Scan>> {
    let mut input: Input<Scan> = match half {
        Some(bytes) => Input::from_reader(bytes, &origin::input_name(path), Role::Truth, options)?,
        None => Input::open(Some(path), options)?,
    };
    let mut scans: Vec<Scan> = Vec::new();
    while scans.len() < args.n as usize {
        let Some(scan) = input.next()? else { break };
        if !scans.is_empty() || args.seq.is_none_or(|seq| scan.seq == seq) {
            scans.push(scan.clone());
        }
    }
    // A branch of a pipeline is read to its end, so that the others go on.
    if is_pipe(path) {
        while input.next()?.is_some() {}
    }
    Ok(scans)
}

/// The lines of the stream that the scans are in; none where it is not MCAP or has none.
fn lines_beside(
    path: &Path,
    half: Option<StreamCopy>,
    options: &Options,
) -> anyhow::Result<Vec<ReflectorLines>> {
    let quiet = Options {
        quiet: true,
        ..options.clone()
    };
    let mut input: Input<ReflectorLines> = match half {
        Some(bytes) => {
            match Input::from_reader(bytes, &origin::input_name(path), Role::Truth, &quiet) {
                Ok(input) => input,
                Err(error) if is_bad_data(&error) => return Ok(Vec::new()),
                Err(error) => return Err(error),
            }
        }
        None => match Input::open(Some(path), &quiet) {
            Ok(input) => input,
            Err(error) if is_bad_data(&error) => return Ok(Vec::new()),
            Err(error) => return Err(error),
        },
    };
    if input.encoding() != Encoding::Mcap {
        return Ok(Vec::new());
    }
    let mut lines = Vec::new();
    loop {
        match input.next() {
            Ok(Some(record)) => lines.push(record.clone()),
            Ok(None) => return Ok(lines),
            Err(error) if lines.is_empty() && is_bad_data(&error) => return Ok(lines),
            Err(error) => return Err(error),
        }
    }
}
