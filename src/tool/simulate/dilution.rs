//! `simulate --dilution`: how well single scans can tell the pose over the workspace, predicted from
//! the information in them; no scan is simulated.

use super::args::{self, Args};
use crate::frame::Frame;
use crate::pose::information::{self, Assumptions, EdgeModel, Fan};
use crate::record::text::push_f64;
use crate::report::{AXES, Cells, Layout, dilution};
use crate::simulate::parameters::Remission;
use crate::simulate::scanner::{self, Scanner};
use crate::simulate::{Effect, Parameters};
use crate::stream::{Fault, Outcome, Stop, WholeFile};
use crate::tool::values::not_negative;
use std::io::Write;

/// The command line's part.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Dilution")]
pub(super) struct DilutionArgs {
    /// In place of scans, a map over y and z (--y-range, --z-range, --step-m) of the least standard
    /// deviation of each component that a single scan allows, as CSV; poses of a cell are spread over
    /// --x-range and --tilt-deg; edges by remission where --effects has it, else by ranges
    #[arg(long, conflicts_with_all = ["trajectory", "scene", "serving", "real_time", "n_scans", "truth", "desired", "imu", "start_ns", "format"])]
    pub(super) dilution: bool,
    /// Standard deviation of the pitch before the scan; 0 is known
    #[arg(long, value_name = "DEG", default_value_t = 0.0, value_parser = not_negative, requires = "dilution")]
    dilution_pitch_sigma_deg: f64,
    /// Poses a cell
    #[arg(long, value_name = "N", default_value_t = 32, value_parser = clap::value_parser!(u32).range(1..=100_000), requires = "dilution")]
    dilution_poses: u32,
    /// Draw the map as a page
    #[arg(long, value_name = "FILE", requires = "dilution")]
    dilution_html: Option<std::path::PathBuf>,
}

/// Sums of one place: poses tried, poses that a scan can tell, and their variances.
#[derive(Clone, Copy, Default)]
struct Place {
    tried: u32,
    told: u32,
    variances: [f64; 6],
}

impl Place {
    /// Root of the mean variance of a component; NaN where no pose is told.
    fn sigma(&self, k: usize) -> f64 {
        (self.variances[k] / f64::from(self.told)).sqrt()
    }

    fn add(&mut self, other: &Place) {
        self.tried += other.tried;
        self.told += other.told;
        for (sum, more) in self.variances.iter_mut().zip(other.variances) {
            *sum += more;
        }
    }
}

/// Runs the tool with `--dilution`.
pub(super) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let (frame, _) = args.read_frame()?;
    let options = args.common.options("simulate")?;
    let parameters = args::parameters(args)?;
    let usage = |error: scanner::ModeError| Fault::Usage(error.to_string());
    let model = scanner::model(&frame, args.model.as_deref()).map_err(usage)?;
    let mode = scanner::mode(model, args.frequency_hz, args.resolution_deg).map_err(usage)?;
    let beams = Scanner::new(&frame, model, mode);
    let fan = Fan {
        angle_min_rad: beams.angle_min_rad(),
        step_rad: beams.angle_rad(1) - beams.angle_rad(0),
        count: beams.count(),
    };
    let mut frame = frame;
    frame.scanner.model = model.name.to_owned();
    let assumed = assumptions(args, &parameters);
    let course = &args.course;
    if !(course.step_m > 0.0) {
        return Err(Fault::Usage("--step-m must be above 0".into()).into());
    }
    let (ys, zs) = (
        places(course.y_range, course.step_m),
        places(course.z_range, course.step_m),
    );
    let stop = Stop::install()?;
    let mut out = dilution_output(options.output.as_deref())?;
    let html = args.dilution.dilution_html.as_deref();
    let html = html.map(|path| WholeFile::open(Some(path))).transpose()?;
    let mut text = Vec::new();
    let names = AXES.iter().take(6).map(|axis| match axis.unit {
        "mm" => format!("{}_sigma_m", axis.name),
        _ => format!("{}_sigma_rad", axis.name),
    });
    let names: Vec<String> = names.collect();
    writeln!(text, "y_m,z_m,poses,told,{}", names.join(","))?;
    let positions: Vec<[f64; 2]> = zs
        .iter()
        .flat_map(|z| ys.iter().map(|y| [*y, *z]))
        .collect();
    let layout = Layout::for_positions(&positions, Some(course.step_m));
    let mut cells = layout.map(Cells::new);
    let mut all = Place::default();
    let mut worst = [0.0f64; 6];
    for [y_m, z_m] in positions {
        if stop.requested() {
            break;
        }
        let place = place(args, &frame, &fan, [y_m, z_m], &assumed);
        push_f64(&mut text, y_m);
        text.push(b',');
        push_f64(&mut text, z_m);
        write!(text, ",{},{}", place.tried, place.told)?;
        let sigmas: [f64; 6] = std::array::from_fn(|k| place.sigma(k));
        for sigma in sigmas {
            text.push(b',');
            if sigma.is_finite() {
                push_f64(&mut text, sigma);
            }
        }
        text.push(b'\n');
        out.write_all(&text)?;
        text.clear();
        if let Some(cells) = &mut cells {
            cells.add([y_m, z_m], &sigmas, 0, None);
        }
        for (worst, sigma) in worst.iter_mut().zip(sigmas) {
            *worst = worst.max(sigma);
        }
        all.add(&place);
    }
    out.finish()?;
    if !options.quiet {
        eprint!("{}", summary(&all, &worst, &assumed));
    }
    if let (Some(html), Some(cells)) = (html, &cells) {
        let title = format!("What one scan can tell in {}", frame.name);
        let page = dilution::page(&title, &conditions(&assumed), cells);
        html.finish(&page)?;
    }
    Ok(Outcome::Done)
}

/// Where the map goes: stdout, or a file that is there whole or not at all.
fn dilution_output(path: Option<&std::path::Path>) -> anyhow::Result<TextOutput> {
    let io = |path: &std::path::Path, error: std::io::Error| {
        anyhow::anyhow!("{}: {error}", path.display())
    };
    Ok(match path.filter(|p| p.as_os_str() != "-") {
        None => TextOutput::Stdout(std::io::BufWriter::new(std::io::stdout())),
        Some(path) => {
            let mut partial = path.as_os_str().to_owned();
            partial.push(".partial");
            let partial = std::path::PathBuf::from(partial);
            let file = std::fs::File::create(&partial).map_err(|e| io(&partial, e))?;
            TextOutput::File(std::io::BufWriter::new(file), partial, path.to_owned())
        }
    })
}

enum TextOutput {
    Stdout(std::io::BufWriter<std::io::Stdout>),
    File(
        std::io::BufWriter<std::fs::File>,
        std::path::PathBuf,
        std::path::PathBuf,
    ),
}

impl TextOutput {
    fn write_all(&mut self, text: &[u8]) -> std::io::Result<()> {
        match self {
            TextOutput::Stdout(out) => out.write_all(text),
            TextOutput::File(out, ..) => out.write_all(text),
        }
    }

    fn finish(self) -> std::io::Result<()> {
        match self {
            TextOutput::Stdout(mut out) => out.flush(),
            TextOutput::File(mut out, partial, path) => {
                out.flush()?;
                std::fs::rename(partial, path)
            }
        }
    }
}

fn assumptions(args: &Args, parameters: &Parameters) -> Assumptions {
    let has = |effect| args.effects.has(effect);
    let sigma_mm = match (has(Effect::Noise), parameters.noise.sigma_mm) {
        (false, _) => 0.01,
        (true, Some(sigma_mm)) => sigma_mm,
        (true, None) => 6.5,
    };
    let remission = &parameters.remission;
    Assumptions {
        range_sigma_m: sigma_mm * 1e-3,
        bias_sigma_m: if has(Effect::Bias) { 0.015 } else { 1e-5 },
        pitch_sigma_rad: args.dilution.dilution_pitch_sigma_deg.to_radians(),
        edges: if has(Effect::Remission) {
            by_remission(remission)
        } else {
            EdgeModel::Ranges
        },
        ..Assumptions::default()
    }
}

/// Edges by remission, as the simulator has it.
pub(in crate::tool) fn by_remission(remission: &Remission) -> EdgeModel {
    EdgeModel::Remission {
        noise: remission.noise,
        contrast: remission.contrast,
        floor: 1.0 / remission.digits / 12f64.sqrt(),
    }
}

/// Evenly spaced coordinates of a range, both ends included where they fit.
fn places([from, to]: [f64; 2], step: f64) -> Vec<f64> {
    let count = ((to - from) / step + 1e-9).floor().clamp(0.0, 1e5) as usize;
    (0..=count).map(|k| from + k as f64 * step).collect()
}

/// The poses of one place: their x, roll, pitch and yaw over the ranges asked for, and y and z over
/// the cell.
fn place(
    args: &Args,
    frame: &Frame,
    fan: &Fan,
    [y_m, z_m]: [f64; 2],
    assumed: &Assumptions,
) -> Place {
    let course = &args.course;
    let tilt_rad = course.tilt_deg.to_radians();
    let within = |u: f64, [low, high]: [f64; 2]| low + u * (high - low);
    let tilt = |u: f64| within(u, [-tilt_rad, tilt_rad]);
    // Beams fall on edges in another way every few centimetres.
    let beside = |u: f64| within(u, [-0.02, 0.02]);
    let mut place = Place::default();
    for [a, b, c, d] in information::spread(args.dilution.dilution_poses as usize) {
        let position_m = [
            within(a, course.x_range),
            y_m + beside((7.0 * a).fract()),
            z_m,
        ];
        let rotation_rad = [tilt(b), tilt(c), tilt(d)];
        place.tried += 1;
        let found = information::of_scan(frame, fan, position_m, rotation_rad, assumed);
        if let Some(variances) = found {
            place.told += 1;
            for (k, sum) in place.variances.iter_mut().enumerate() {
                *sum += variances[k];
            }
        }
    }
    place
}

fn conditions(assumed: &Assumptions) -> String {
    let edges = match assumed.edges {
        EdgeModel::Ranges => "edges by ranges, sharp".to_owned(),
        EdgeModel::Remission {
            noise, contrast, ..
        } => format!(
            "edges by remission, noise {:.1} %, contrast {contrast}",
            noise * 100.0
        ),
    };
    let pitch = match assumed.pitch_sigma_rad {
        0.0 => "pitch known".to_owned(),
        sigma => format!("pitch within {:.3} deg", sigma.to_degrees()),
    };
    format!(
        "ranges within {:.2} mm, {edges}, {pitch}",
        assumed.range_sigma_m * 1e3
    )
}

fn summary(all: &Place, worst: &[f64; 6], assumed: &Assumptions) -> String {
    let mut text = format!(
        "simulate: least standard deviations of one scan: {}; {} of {} poses can be told\n",
        conditions(assumed),
        all.told,
        all.tried
    );
    for (k, axis) in AXES.iter().take(6).enumerate() {
        text += &format!(
            "simulate: {:<5} rms {:>9.4} {}, worst place {:>9.4}\n",
            axis.name,
            all.sigma(k) * axis.factor,
            axis.unit,
            worst[k] * axis.factor
        );
    }
    text
}
