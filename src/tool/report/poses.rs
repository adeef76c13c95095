//! `report`: poses against a true or desired trajectory.

use super::evaluation::{EvaluationArgs, ImuRecord};
use super::forms::FormArgs;
use super::inputs::Inputs;
use super::pictures::{PictureArgs, parse_maps};
use super::{inputs, outputs};
use crate::report::{
    Association, Case, Gate, Inertial, Limits, MapStyle, Reference, Report, evaluate, merge,
    origin, page, terminal,
};
use crate::stream::{Fault, Options, Outcome, Role};
use crate::tool::arguments::CommonArgs;
use crate::tool::values::parse_duration;
use std::io::IsTerminal;
use std::path::PathBuf;
use std::time::Duration;

pub(super) const EXAMPLES: &str = "\
EXAMPLES
  A simulated run, to the table:
    simulate -f frame.toml --truth truth.csv | extract-lines -f frame.toml | tee lines.csv \\
      | solve-pose -f frame.toml | tee poses.csv | report --truth truth.csv
  With a page:
    report --truth truth.csv --html report.html poses.csv
  Its figures as files, the maps as contours:
    report --truth truth.csv --svg figures --png figures --maps contours poses.csv
  Two methods side by side:
    report --truth truth.csv joint=poses.csv \\
      vote=<(solve-pose -f frame.toml --method vote lines.csv)
  A run that was split up, put together again:
    report --truth truth.csv --merge <(sed 101q poses.csv) <(sed 2,101d poses.csv)
  Parts of the workspace apart, as tables for a paper; the poses for other kits:
    report --truth truth.csv --zone 'low=z<=2' --zone 'high=z>2' --latex --export tum out/ poses.csv
  In a script, with gates:
    report --truth truth.csv --json poses.csv --fail-if 'x.rms_mm>50' \\
      --fail-if 'scans.solved_pct<50'
  With the delay, relative errors and what the poses rest on:
    report --truth truth.csv --rpe 1s --rpe 1m --imu imu.csv --lines lines.csv poses.csv
  Without the delay, and moved onto the truth:
    report --truth truth.csv --delay estimate --align se2 poses.csv
  The noise of an IMU at rest, as a page and in numbers:
    report --imu imu.csv --html imu.html --json > imu.json

STATISTICS
  of e = measured - reference, for x, y, z, position (mm), roll, pitch, yaw (deg): n, bias (mean), std
  (n - 1), rms, median, mad (median of |e - median|), p95, p99, max, min (of |e|; percentiles linear
  between order statistics, as numpy's), sse; rotation is the angle between the orientations. Names are
  paths in --json: x.rms_mm, yaw.p95_deg, x.nees, nees.x_yaw.nees, scans.solved_pct,
  scans.words.no-edges, refused.no-edges, rpe.1s.position.rms_mm, along.bias_mm, delay.delay_ms,
  orientation.yaw.drift_deg_h, quality.residual.upper.rms_mm, input.jumps.

DELAY
  Positive: the poses are late. It is estimated where the reference moves, with gain and offset of each
  axis free; the interval of 95 % knows of the correlation of the errors over time. delay.rms_before_mm,
  rms_after_mm and share_mm say what it makes of the position's error, whatever --delay is.

EXIT STATUS
  0 done; 2 usage; 3 nothing to compare in some run, or rows skipped (and said so); 4 a --fail-if
  condition holds, or its statistic has no value; 65 bad data; 66 no such input; 74 I/O error";

/// Poses, what they are compared with and how.
#[derive(Clone, Debug, clap::Args)]
pub struct PoseArgs {
    /// Poses: a file, a FIFO or - for stdin (the default), with a name for the run in front if wanted;
    /// a file name with = in it is given as ./NAME
    #[arg(value_name = "[NAME=]POSES")]
    pub poses: Vec<String>,
    /// True trajectory; several files are parts of one [default: /truth in the first run's stream, if
    /// that is MCAP]
    #[arg(long, value_name = "FILE", conflicts_with = "desired")]
    pub truth: Vec<PathBuf>,
    /// Desired trajectory, to compare with in place of the truth; several files are parts of one
    #[arg(long, value_name = "FILE")]
    pub desired: Vec<PathBuf>,
    /// Files with the same NAME= in front, and those without one, are parts of one run, as those of
    /// simulate --shard: together they are what the whole run would have been
    #[arg(long)]
    pub merge: bool,
    /// Reference between two of its points: interpolated, or the nearest point
    #[arg(long, value_name = "HOW", default_value = "interpolated", value_parser = parse_association)]
    pub association: Association,
    /// Longest time between points interpolated between [default: three spacings], or to the nearest
    /// [default: 10ms]
    #[arg(long, value_name = "TIME", value_parser = parse_duration)]
    pub max_diff: Option<Duration>,
    /// Evaluation.
    #[command(flatten)]
    pub evaluation: EvaluationArgs,
    /// End with status 4 if the condition holds, as 'x.rms_mm>4.1' or 'joint:yaw.p95_deg>0.2'; several
    /// allowed
    #[arg(long = "fail-if", value_name = "[RUN:]CONDITION")]
    pub fail_if: Vec<Gate>,
    /// Forms.
    #[command(flatten)]
    pub forms: FormArgs,
    /// Write a page with figures
    #[arg(long, value_name = "FILE")]
    pub html: Option<PathBuf>,
    /// Pictures.
    #[command(flatten)]
    pub pictures: PictureArgs,
    /// Maps of the workspace as cells, contours or both, in pictures and page
    #[arg(long, value_name = "HOW", default_value = "cells", value_parser = parse_maps)]
    pub maps: MapStyle,
    /// Title of the page
    #[arg(long, value_name = "TEXT")]
    pub title: Option<String>,
    /// Print the workspace's cells as numbers, of y, z, roll and pitch too, instead of as maps
    #[arg(long)]
    pub cells: bool,
    /// ASCII only [default: where the locale is not UTF-8]
    #[arg(long)]
    pub ascii: bool,
    /// Streams.
    #[command(flatten)]
    pub common: CommonArgs,
}

fn parse_association(text: &str) -> Result<Association, String> {
    match text {
        "interpolated" => Ok(Association::Interpolated),
        "nearest" => Ok(Association::Nearest),
        _ => Err("interpolated or nearest is wanted".to_owned()),
    }
}

/// Runs the tool without a subcommand.
pub(super) fn run(args: &PoseArgs) -> anyhow::Result<Outcome> {
    let options = args.common.options("report")?;
    let (html, table) = outputs::open(args.html.as_deref(), args.common.output.as_deref())?;
    let report = make(args, &options)?;
    if let Some(html) = html {
        html.finish(page::write(&report, args.maps))?;
    }
    if args.pictures.wanted() {
        args.pictures.write(&page::figures(&report, args.maps))?;
    }
    let text = args.forms.text(&report, style(args), &options)?;
    table.finish(&text)?;
    Ok(outcome(&report))
}

/// Reads everything and sums it up.
fn make(args: &PoseArgs, options: &Options) -> anyhow::Result<Report> {
    let align = args.evaluation.align()?;
    let beside = args.evaluation.beside()?;
    let alone = args.poses.is_empty() && args.truth.is_empty() && args.desired.is_empty();
    if let Some((path, axes)) = beside.imu.as_ref().filter(|_| alone) {
        if beside.lines.is_some() {
            let text = "--lines belongs to poses: name them, or leave it out";
            return Err(Fault::Usage(text.into()).into());
        }
        let record = ImuRecord::read(path, axes, options)?;
        return imu_alone(args, record.rest.noise(&[]));
    }
    let sources = if args.merge {
        origin::parts(&args.poses)
    } else {
        origin::sources(&args.poses)
    };
    let own: Vec<PathBuf> = sources.iter().map(|s| s.path.clone()).collect();
    let (paths, role) = match (&args.truth[..], &args.desired[..]) {
        ([], []) if args.merge => (&own[..], Role::Truth),
        ([], []) => (own.get(..1).unwrap_or_default(), Role::Truth),
        ([], paths) => (paths, Role::Desired),
        (paths, _) => (paths, Role::Truth),
    };
    let wanted = inputs::Wanted {
        paths,
        role,
        given: !args.truth.is_empty() || !args.desired.is_empty(),
    };
    let mut read = inputs::read(&sources, wanted, &beside, options)?;
    if args.merge {
        read.runs = merge(read.runs);
    }
    let exports = args.forms.exports(&read)?;
    let points = if exports.is_empty() {
        Vec::new()
    } else {
        read.points.clone()
    };
    let Inputs {
        runs,
        points: all,
        stages,
        imu,
        lines,
    } = read;
    let (attitudes, rest) = imu.map(|imu| (imu.attitudes, imu.rest)).unzip();
    let settings = args.evaluation.settings(align, attitudes, lines);
    let limits = Limits {
        association: args.association,
        max_diff_s: args.max_diff.map(|d| d.as_secs_f64()),
    };
    let reference = Reference::new(all, limits);
    let names: Vec<&str> = runs.iter().map(|run| run.name.as_str()).collect();
    let title = args.title.clone();
    let title = title.unwrap_or_else(|| format!("Pose report: {}", names.join(", ")));
    let cases = evaluate(runs, &reference, &settings);
    for export in exports {
        export.write(&cases, &points, role, options)?;
    }
    let inertial = rest.and_then(|rest| rest.noise(&cases));
    let judge = |gate: &Gate| {
        let cases: Vec<&Case> = cases.iter().filter(|c| gate.is_for(c)).collect();
        if cases.is_empty() {
            return Err(Fault::Usage(format!(
                "--fail-if '{}' names no run",
                gate.text
            )));
        }
        Ok(cases.into_iter().map(|c| gate.judge(c)).collect::<Vec<_>>())
    };
    let verdicts: Vec<Vec<_>> = args.fail_if.iter().map(judge).collect::<Result<_, _>>()?;
    Ok(Report {
        title,
        role: if role == Role::Truth {
            "truth"
        } else {
            "desired"
        },
        reference_stages: stages,
        reference_source: origin::input_names(paths.iter().map(|path| origin::input_name(path))),
        reference,
        cases,
        inertial,
        verdicts: verdicts.into_iter().flatten().collect(),
        command: origin::own_command_line(),
        date: date(),
    })
}

/// The report of an IMU at rest, without poses.
fn imu_alone(args: &PoseArgs, inertial: Option<Inertial>) -> anyhow::Result<Report> {
    if let Some(gate) = args.fail_if.first() {
        let why = format!(
            "--fail-if '{}' is about poses, and there are none",
            gate.text
        );
        return Err(Fault::Usage(why).into());
    }
    let source = inertial
        .as_ref()
        .map_or(String::new(), |i| i.source.clone());
    let title = args.title.clone();
    Ok(Report {
        title: title.unwrap_or_else(|| format!("IMU report: {source}")),
        role: "truth",
        reference_source: String::new(),
        reference_stages: Vec::new(),
        reference: Reference::new(Vec::new(), Limits::default()),
        cases: Vec::new(),
        inertial,
        verdicts: Vec::new(),
        command: origin::own_command_line(),
        date: date(),
    })
}

fn date() -> Option<String> {
    let seconds = std::env::var("SOURCE_DATE_EPOCH").ok()?;
    origin::date(&seconds)
}

fn style(args: &PoseArgs) -> terminal::Style {
    let set = |name: &str| std::env::var(name).ok().filter(|v| !v.is_empty());
    let terminal = std::io::stdout().is_terminal() && args.common.output.is_none();
    let bold = terminal && set("NO_COLOR").is_none() && set("TERM").is_none_or(|t| t != "dumb");
    let ascii = args.ascii || !outputs::is_utf8();
    let wide = set("COLORTERM").is_some_and(|c| c == "truecolor" || c == "24bit");
    terminal::Style {
        bold,
        colour: bold && wide && !ascii,
        ascii,
        all_cells: args.cells,
    }
}

/// Says on stderr what a reader of the outputs must not miss, and which status that is.
fn outcome(report: &Report) -> Outcome {
    let mut outcome = Outcome::Done;
    for loss in report.losses() {
        outcome = Outcome::Degraded;
        eprintln!("report: {loss}");
    }
    outcome.and(outputs::judged(report.verdicts.iter().cloned()))
}
