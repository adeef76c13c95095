//! `simulate --dilution`: how well single scans can tell the pose over the workspace, predicted from
//! the information in them; no scan is simulated.

use super::args::{self, Args};
use super::course::CourseArgs;
use crate::frame::Frame;
use crate::pose::information::{self, Assumptions, EdgeModel, Fan, Remissions};
use crate::record::text::push_f64;
use crate::report::{AXES, Axis, Cells, Layout, dilution};
use crate::simulate::parameters::Remission;
use crate::simulate::scanner::{self, Scanner};
use crate::simulate::{Effect, Parameters};
use crate::stream::{Fault, Outcome, Stop, WholeFile};
use crate::tool::values::not_negative;
use std::io::Write;
use std::path::Path;

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
}

/// The most places of a map.
const MOST_PLACES: f64 = 1e6;

/// Runs the tool with `--dilution`.
pub(super) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let (mut frame, _) = args.read_frame()?;
    let options = args.common.options("simulate")?;
    let assumed = assumptions(args, &args::parameters(args, &frame)?);
    let fan = fan(args, &mut frame)?;
    let positions = positions(&args.course)?;
    let stop = Stop::install()?;
    let file = options
        .output
        .as_deref()
        .filter(|path| *path != Path::new("-"));
    let html = args.dilution.dilution_html.as_deref();
    if file.is_none() && html == Some(Path::new("-")) {
        let text = "--dilution-html -: the rows go to stdout too; give them a file with -o";
        return Err(Fault::Usage(text.into()).into());
    }
    let file = file.map(|path| WholeFile::open(Some(path))).transpose()?;
    let html = html.map(|path| WholeFile::open(Some(path))).transpose()?;
    let mut map = Map::new(&positions, args.course.step_m);
    let (all, mut done) = (positions.len() as u64, 0);
    for at in positions {
        if file.is_none() {
            // Whoever reads them has each row as soon as it is known.
            let mut stdout = std::io::stdout().lock();
            stdout.write_all(&map.text)?;
            stdout.flush()?;
            map.text.clear();
        }
        if stop.requested() {
            break;
        }
        map.add(at, &place(args, &frame, &fan, at, &assumed));
        done += 1;
    }
    if done < all {
        // A part of a map has neither its file nor its mean.
        eprintln!("simulate: interrupted after {done} of {all} places");
        stop.check(if file.is_some() { 0 } else { done })?;
        return Ok(Outcome::Done);
    }
    match file {
        Some(file) => file.finish(&map.text)?,
        None => std::io::stdout().write_all(&map.text)?,
    }
    if !options.quiet {
        eprint!("{}", summary(&map, &assumed));
    }
    if let (Some(html), Some(cells)) = (html, &map.cells) {
        let title = format!("What one scan can tell in {}", frame.name);
        let page = dilution::page(&title, &conditions(&assumed), cells);
        html.finish(&page)?;
    }
    Ok(Outcome::Done)
}

/// The beams asked for; the frame gets the model that they belong to.
fn fan(args: &Args, frame: &mut Frame) -> anyhow::Result<Fan> {
    let usage = |error: scanner::ModeError| Fault::Usage(error.to_string());
    let model = scanner::model(frame, args.model.as_deref()).map_err(usage)?;
    let mode = scanner::mode(model, args.frequency_hz, args.resolution_deg).map_err(usage)?;
    let beams = Scanner::new(frame, model, mode);
    frame.scanner.model = model.name.to_owned();
    Ok(Fan {
        angle_min_rad: beams.angle_min_rad(),
        step_rad: mode.step_rad(),
        count: beams.count(),
    })
}

/// The map's places (y, z), m: row after row from the bottom.
fn positions(course: &CourseArgs) -> anyhow::Result<Vec<[f64; 2]>> {
    let step_m = course.step_m;
    // Both ends are included where they fit.
    let count = |[from, to]: [f64; 2]| ((to - from) / step_m + 1e-9).floor() + 1.0;
    let (columns, rows) = (count(course.y_range), count(course.z_range));
    if !(columns * rows <= MOST_PLACES) {
        let text = format!(
            "--step-m {step_m}: {columns:e} by {rows:e} places are more than {MOST_PLACES}"
        );
        return Err(Fault::Usage(text).into());
    }
    let (columns, rows) = (columns as usize, rows as usize);
    let along = |[from, _]: [f64; 2], k: usize| from + k as f64 * step_m;
    let row =
        |z: usize| (0..columns).map(move |y| [along(course.y_range, y), along(course.z_range, z)]);
    Ok((0..rows).flat_map(row).collect())
}

/// What is written: a row a place, and what all places have in common.
struct Map {
    text: Vec<u8>,
    cells: Option<Cells>,
    /// y and z, m, of the first place and the last.
    corners_m: [[f64; 2]; 2],
    tried: u32,
    told: u32,
    /// Sums over the area: of the variances of each component, and of their weights.
    variances: [f64; 6],
    weight: f64,
    /// Largest standard deviation of each component in any place.
    worst: [f64; 6],
}

impl Map {
    fn new(positions: &[[f64; 2]], step_m: f64) -> Map {
        let name = |axis: &Axis| match axis.unit {
            "mm" => format!("{}_sigma_m", axis.name),
            _ => format!("{}_sigma_rad", axis.name),
        };
        let names: Vec<String> = AXES.iter().take(6).map(name).collect();
        Map {
            text: format!("y_m,z_m,poses,told,{}\n", names.join(",")).into_bytes(),
            cells: Layout::for_positions(positions, Some(step_m)).map(Cells::new),
            corners_m: [positions.first(), positions.last()].map(|at| *at.unwrap_or(&[0.0; 2])),
            tried: 0,
            told: 0,
            variances: [0.0; 6],
            weight: 0.0,
            worst: [0.0; 6],
        }
    }

    fn add(&mut self, [y_m, z_m]: [f64; 2], place: &Place) {
        let text = &mut self.text;
        push_f64(text, y_m);
        text.push(b',');
        push_f64(text, z_m);
        text.extend_from_slice(format!(",{},{}", place.tried, place.told).as_bytes());
        let sigmas: [f64; 6] = std::array::from_fn(|k| place.sigma(k));
        for (sigma, worst) in sigmas.into_iter().zip(&mut self.worst) {
            text.push(b',');
            if sigma.is_finite() {
                push_f64(text, sigma);
            }
            *worst = worst.max(sigma);
        }
        text.push(b'\n');
        if let Some(cells) = &mut self.cells {
            cells.add([y_m, z_m], &sigmas, 0, None);
        }
        self.tried += place.tried;
        self.told += place.told;
        let weight = f64::from(place.told) * self.share([y_m, z_m]);
        for (sum, sigma) in self.variances.iter_mut().zip(sigmas) {
            if sigma.is_finite() {
                *sum += weight * sigma * sigma;
            }
        }
        self.weight += weight;
    }

    /// Root of the mean variance of a component over the map's area; NaN where no pose is told.
    fn rms(&self, k: usize) -> f64 {
        (self.variances[k] / self.weight).sqrt()
    }

    /// The share of a cell that a place stands for: the rest of one at the map's rim is outside.
    fn share(&self, at_m: [f64; 2]) -> f64 {
        let [first, last] = self.corners_m;
        let along = |k: usize| {
            let rim = at_m[k] == first[k] || at_m[k] == last[k];
            if rim && first[k] != last[k] { 0.5 } else { 1.0 }
        };
        along(0) * along(1)
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
    EdgeModel::Remission(Remissions {
        noise: remission.noise,
        contrast: remission.contrast,
        floor: 1.0 / remission.digits / 12f64.sqrt(),
    })
}

/// What the poses of a place can tell.
fn place(args: &Args, frame: &Frame, fan: &Fan, at_m: [f64; 2], assumed: &Assumptions) -> Place {
    let course = &args.course;
    let count = args.dilution.dilution_poses as usize;
    let mut place = Place::default();
    let poses = information::poses_at(at_m, course.x_range, course.tilt_deg.to_radians(), count);
    for [position_m, rotation_rad] in poses {
        place.tried += 1;
        let found = information::of_scan(frame, fan, position_m, rotation_rad, assumed);
        if let Some(variances) = found {
            place.told += 1;
            for (sum, variance) in place.variances.iter_mut().zip(variances) {
                *sum += variance;
            }
        }
    }
    place
}

fn conditions(assumed: &Assumptions) -> String {
    let edges = match assumed.edges {
        EdgeModel::Ranges => "edges by ranges, sharp".to_owned(),
        EdgeModel::Remission(remissions) => format!(
            "edges by remission, noise {:.1} %, contrast {}",
            remissions.noise * 100.0,
            remissions.contrast
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

fn summary(map: &Map, assumed: &Assumptions) -> String {
    let mut text = format!(
        "simulate: least standard deviations of one scan: {}; {} of {} poses can be told\n",
        conditions(assumed),
        map.told,
        map.tried
    );
    let axes = if map.told == 0 { 0 } else { 6 };
    for (k, axis) in AXES.iter().take(axes).enumerate() {
        text += &format!(
            "simulate: {:<5} rms {:>9.digits$} {}, worst place {:>9.digits$}\n",
            axis.name,
            map.rms(k) * axis.factor,
            axis.unit,
            map.worst[k] * axis.factor,
            digits = if axis.unit == "mm" { 4 } else { 6 },
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_is_that_of_the_area() {
        let place = |variance: f64| Place {
            tried: 2,
            told: 2,
            variances: [2.0 * variance; 6],
        };
        let row = [[0.0, 5.0], [1.0, 5.0], [2.0, 5.0]];
        let mut map = Map::new(&row, 1.0);
        for (at, variance) in row.into_iter().zip([1.0, 4.0, 3.0]) {
            map.add(at, &place(variance));
        }
        assert!((map.rms(0).powi(2) - (0.5 * 1.0 + 4.0 + 0.5 * 3.0) / 2.0).abs() < 1e-12);
        assert!((map.worst[0] - 2.0).abs() < 1e-12);
        // Corners are a quarter.
        let square = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];
        assert_eq!(square.map(|at| Map::new(&square, 1.0).share(at)), [0.25; 4]);
    }
}
