//! `report frame`: a frame file drawn and checked, and what scans in it could tell.

use super::outputs;
use super::pictures::PictureArgs;
use crate::frame::Frame;
use crate::pose::information::{self, Assumptions, EdgeModel, Fan};
use crate::report::frame::{self, Beams, Place, Survey};
use crate::report::{Gate, GateError, Layout, origin};
use crate::simulate::scanner::{self, Scanner};
use crate::stream::{Fault, Outcome, Stop};
use crate::tool::simulate::dilution::by_remission;
use crate::tool::values::not_negative;
use std::path::PathBuf;

const EXAMPLES: &str = "\
EXAMPLES
  Is the frame file sound, and what would the robot get from it?
    report frame frame.toml
  The same as a page with drawings and maps:
    report frame --html frame.html frame.toml
  In a script, with gates on what is predicted:
    report frame --poses 4 --json frame.toml --fail-if 'x.sigma_mm>3' --fail-if 'edges.least<4'

PREDICTION
  Over the workspace, poses with x, roll, pitch and yaw spread over --x-range and --tilt-deg are looked
  at one by one: which strip edges and walls a scan shows, and the least standard deviation that any
  estimator can reach from it (Cramer-Rao; for ranges alone the exact posterior of the intervals). No
  scan is simulated. Names for --fail-if: x.sigma_mm (root of the mean variance), x.worst_mm (at the
  worst place), the same for y, z and, in deg, roll, pitch, yaw; told_pct, edges.least, edges.mean,
  walls.both_pct, walls.one_pct, yaw_range.both_deg, yaw_range.one_deg, gap.least_mm.

EXIT STATUS
  0 done; 2 usage; 4 a --fail-if condition holds, or its statistic has no value; 66 no such file;
  74 I/O error; 78 the frame makes no sense, and the message names the key";

/// Draws and checks a frame file, and predicts what scans in it can tell
#[derive(Clone, Debug, clap::Args)]
#[command(
    long_about = "Draws a frame to scale, checks its reflectors, and predicts how well single scans can \
                  tell the pose over the workspace, before anything is built.",
    after_long_help = EXAMPLES
)]
pub struct FrameArgs {
    /// Frame file
    #[arg(value_name = "FILE")]
    frame: PathBuf,
    /// Workspace: y from and to [default: the middle 77 % of the width]
    #[arg(long, value_name = "M,M", value_parser = parse_span, allow_hyphen_values = true)]
    y_range: Option<[f64; 2]>,
    /// Workspace: z from and to [default: 9 to 73 % of the height]
    #[arg(long, value_name = "M,M", value_parser = parse_span, allow_hyphen_values = true)]
    z_range: Option<[f64; 2]>,
    /// x of the poses, from and to
    #[arg(long, value_name = "M,M", default_value = "-0.05,0.05", value_parser = parse_span, allow_hyphen_values = true)]
    x_range: [f64; 2],
    /// Largest roll, pitch and yaw of the poses, to both sides
    #[arg(long, value_name = "DEG", default_value_t = 1.0, value_parser = not_negative)]
    tilt_deg: f64,
    /// Places along y and z
    #[arg(long, value_name = "N,N", default_value = "16,8", value_parser = parse_places)]
    places: [usize; 2],
    /// Poses a place
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    poses: u32,
    /// What the edges rest on: remission, ranges
    #[arg(long, value_name = "WHAT", default_value = "remission", value_parser = ["remission", "ranges"])]
    edges: String,
    /// Standard deviation of a range
    #[arg(long, value_name = "MM", default_value_t = 6.5, value_parser = not_negative)]
    sigma_mm: f64,
    /// Standard deviation of the pitch before the scan; 0 is known
    #[arg(long, value_name = "DEG", default_value_t = 0.0, value_parser = not_negative)]
    pitch_sigma_deg: f64,
    /// Scan frequency, Hz [default: the model's]
    #[arg(long, value_name = "HZ")]
    frequency_hz: Option<f64>,
    /// Angular resolution, deg [default: the model's]
    #[arg(long, value_name = "DEG")]
    resolution_deg: Option<f64>,
    /// End with status 4 if the condition holds, as 'x.sigma_mm>3'; several allowed
    #[arg(long = "fail-if", value_name = "CONDITION", value_parser = parse_gate)]
    fail_if: Vec<Gate>,
    /// Print JSON in place of the text
    #[arg(long)]
    json: bool,
    /// Write a page with drawings and maps
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
    /// Title of the page
    #[arg(long, value_name = "TEXT")]
    title: Option<String>,
    #[command(flatten)]
    pictures: PictureArgs,
    /// Write the text to FILE instead of stdout
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// ASCII only [default: where the locale is not UTF-8]
    #[arg(long)]
    ascii: bool,
}

fn parse_gate(text: &str) -> Result<Gate, GateError> {
    Gate::for_frame(text)
}

fn parse_span(text: &str) -> Result<[f64; 2], String> {
    let wanted = || "two lengths in m, the smaller first, are wanted: -4,4".to_owned();
    let (from, to) = text.split_once(',').ok_or_else(wanted)?;
    match (from.trim().parse::<f64>(), to.trim().parse::<f64>()) {
        (Ok(from), Ok(to)) if from.is_finite() && to.is_finite() && from <= to => Ok([from, to]),
        _ => Err(wanted()),
    }
}

fn parse_places(text: &str) -> Result<[usize; 2], String> {
    let wanted = || "two numbers from 1 to 100 are wanted: 16,8".to_owned();
    let (y, z) = text.split_once(',').ok_or_else(wanted)?;
    match (y.trim().parse::<usize>(), z.trim().parse::<usize>()) {
        (Ok(y), Ok(z)) if (1..=100).contains(&y) && (1..=100).contains(&z) => Ok([y, z]),
        _ => Err(wanted()),
    }
}

/// Runs the subcommand.
pub(super) fn run(args: &FrameArgs) -> anyhow::Result<Outcome> {
    let frame = Frame::read(&args.frame)?;
    frame::check(&frame).map_err(|(key, why)| {
        Fault::Configuration(format!("{}: {key}: {why}", args.frame.display()))
    })?;
    let (html, output) = outputs::open(args.html.as_deref(), args.output.as_deref())?;
    let survey = survey(args, frame)?;
    if let Some(html) = html {
        html.finish(frame::page(args.title.as_deref(), &survey))?;
    }
    if args.pictures.wanted() {
        args.pictures.write(&frame::figures(&survey))?;
    }
    let text = if args.json {
        frame::json(&survey)?
    } else {
        frame::table(&survey, args.ascii || !outputs::is_utf8())
    };
    output.finish(&text)?;
    let verdicts = args.fail_if.iter().map(|gate| gate.judge_frame(&survey));
    Ok(outputs::judged(verdicts))
}

/// The share of the box that the reference robot's workspace has.
const Y_SHARE: f64 = 0.766;
const Z_SHARES: [f64; 2] = [0.085, 0.7273];

fn survey(args: &FrameArgs, frame: Frame) -> anyhow::Result<Survey> {
    let b = frame.bounds;
    let centimetres = |v: f64| (v * 100.0).round() / 100.0;
    let half = centimetres(0.5 * Y_SHARE * b.dy_m);
    let ys = args.y_range.unwrap_or([-half, half]);
    let zs = args
        .z_range
        .unwrap_or(Z_SHARES.map(|share| centimetres(share * b.dz_m)));
    for (name, [from, to], [low, high]) in [
        ("--y-range", ys, [-0.5 * b.dy_m, 0.5 * b.dy_m]),
        ("--z-range", zs, [0.0, b.dz_m]),
    ] {
        if !(from < to && from > low && to < high) {
            let text = format!(
                "{name} {from},{to}: the box is from {low} to {high} m, and the workspace inside it"
            );
            return Err(Fault::Usage(text).into());
        }
    }
    let usage = |error: scanner::ModeError| Fault::Usage(error.to_string());
    let model = scanner::model(&frame, None).map_err(usage)?;
    let mode = scanner::mode(model, args.frequency_hz, args.resolution_deg).map_err(usage)?;
    let scanner = Scanner::new(&frame, model, mode);
    let beams = Beams {
        angle_min_rad: scanner.angle_min_rad(),
        step_rad: scanner.angle_rad(1) - scanner.angle_rad(0),
        count: scanner.count(),
    };
    let [ny, nz] = args.places;
    let layout = Layout {
        origin_m: [ys[0], zs[0]],
        size_m: [(ys[1] - ys[0]) / ny as f64, (zs[1] - zs[0]) / nz as f64],
        count: [ny, nz],
        few: 1,
    };
    let (assumed, conditions) = assumptions(args);
    let stop = Stop::install()?;
    let mut places = Vec::with_capacity(ny * nz);
    for index in 0..ny * nz {
        if stop.requested() {
            return Err(Fault::Interrupted(2).into());
        }
        places.push(place(args, &frame, &beams, layout, index, &assumed));
    }
    Ok(Survey {
        source: origin::input_name(&args.frame),
        gaps: frame::gaps(&frame),
        frame,
        mode: mode.to_string(),
        workspace_m: [ys, zs],
        layout,
        places,
        conditions,
        command: origin::own_command_line(),
    })
}

fn place(
    args: &FrameArgs,
    frame: &Frame,
    beams: &Beams,
    layout: Layout,
    index: usize,
    assumed: &Assumptions,
) -> Place {
    let fan = Fan {
        angle_min_rad: beams.angle_min_rad,
        step_rad: beams.step_rad,
        count: beams.count,
    };
    let [y_m, z_m] = layout.centre_m(index);
    let mut place = Place::at([y_m, z_m]);
    let (tilt_rad, count) = (args.tilt_deg.to_radians(), args.poses as usize);
    let poses = information::poses_at([y_m, z_m], args.x_range, tilt_rad, count);
    for [position_m, rotation_rad] in poses {
        let seen = frame::seen(frame, beams, position_m, rotation_rad);
        let variances = information::of_scan(frame, &fan, position_m, rotation_rad, assumed);
        place.add(&seen, variances);
    }
    place
}

/// What is assumed of the scanner, and how to say so: remissions as the simulator's reference has
/// them.
fn assumptions(args: &FrameArgs) -> (Assumptions, String) {
    let remission = crate::simulate::Parameters::default().remission;
    let with_remission = args.edges == "remission";
    let assumed = Assumptions {
        range_sigma_m: args.sigma_mm.max(0.01) * 1e-3,
        pitch_sigma_rad: args.pitch_sigma_deg.to_radians(),
        edges: if with_remission {
            by_remission(&remission)
        } else {
            EdgeModel::Ranges
        },
        ..Assumptions::default()
    };
    let edges = if with_remission {
        let noise = remission.noise * 100.0;
        format!(
            "edges by remission, noise {noise:.1} %, contrast {}",
            remission.contrast
        )
    } else {
        "edges by ranges, sharp".to_owned()
    };
    let pitch = if args.pitch_sigma_deg == 0.0 {
        "pitch known".to_owned()
    } else {
        format!("pitch within {} deg", args.pitch_sigma_deg)
    };
    let conditions = format!("ranges within {} mm, {edges}, {pitch}", args.sigma_mm);
    (assumed, conditions)
}
