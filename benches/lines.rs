//! How many scans a second the line room takes on one core. `cargo bench --bench lines` prints
//! figures, and ratios to the first method's, and passes no judgement.
//!
//! The scans are those of a 722 beam all-round scanner in seeded random rooms with boxes; or, where
//! CABLEPOSE_OFFICE names a folder that `gen_office.py` wrote, those offices, with scores.

#[path = "../tests/office/mod.rs"]
mod office;
mod timing;

use cablepose::lines::extractor::{Extractor, ExtractorOptions};
use cablepose::lines::fit::{self, Beams, Loss};
use cablepose::lines::methods::{self, METHODS};
use cablepose::record::Scan;
use office::Office;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, Normal, Uniform};
use std::f64::consts::{PI, TAU};
use std::hint::black_box;
use std::path::Path;
use timing::thread_s;

const BEAMS: usize = 722;
const SIGMA_M: f64 = 0.015;
const ROUNDS: usize = 40;

/// Every method, with the noise of a set.
fn methods(sigma_m: f64) -> Vec<(&'static str, Box<dyn Extractor>)> {
    let mut common = ExtractorOptions::default();
    common.segmentation.sigma_m = sigma_m;
    // The truth of the all-round set has a wall through the seam as two.
    common.segmentation.cut_at_seam = true;
    let named = |name| (name, methods::extractor(name, common).expect("a method"));
    // Those that cut the beams into runs.
    METHODS[..5].iter().copied().map(named).collect()
}

fn main() {
    if let Some(folder) = std::env::var_os("CABLEPOSE_OFFICE") {
        for (set, sigma_m) in OFFICES {
            match office::read(Path::new(&folder), set) {
                Ok(office) => compare(set, &office.scans, Some(&office), sigma_m),
                Err(error) => println!("{set}: {error}"),
            }
        }
    } else {
        compare("random rooms", &scans(100), None, SIGMA_M);
    }
    fits();
}

/// The generator's sets and their noise.
const OFFICES: [(&str, f64); 3] = [
    ("office360_722", 0.015),
    ("office180_722", 0.015),
    ("office190_761_lms500", 0.0065),
];

fn compare(set: &str, scans: &[Scan], office: Option<&Office>, sigma_m: f64) {
    println!("{set}, {} scans", scans.len());
    let mut first = None;
    for (name, mut extractor) in methods(sigma_m) {
        let mut segments = Vec::new();
        let seconds = best(|| {
            for scan in scans {
                extractor.extract(black_box(scan), &mut segments);
            }
        });
        let reference = *first.get_or_insert(seconds);
        let us = 1e6 * seconds / scans.len() as f64;
        let speed = scans.len() as f64 / seconds;
        print!(
            "  {name:16} {speed:8.0} scans/s {us:8.2} us {:8.3}",
            reference / seconds
        );
        if let Some(office) = office {
            let score = office::score(office, extractor.as_mut());
            print!(
                "  {:4} lines  TruePos {:5.1} %  FalsePos {:4.1} %  d {:4.2} cm  alpha {:4.2} deg  \
                 middle {:4.2} cm  NEES {:.1}",
                score.lines,
                score.true_pos_percent,
                score.false_pos_percent,
                score.sd_d_cm,
                score.sd_alpha_deg,
                score.sd_offset_cm,
                score.nees_median
            );
        }
        println!();
    }
}

fn fits() {
    for beams in [76, 152, 411] {
        let wall = wall(beams);
        for (name, loss) in [("least squares", Loss::Squares), ("Tukey", Loss::TUKEY)] {
            let seconds = best(|| {
                for _ in 0..100 {
                    black_box(fit::fit(black_box(wall.all()), SIGMA_M, loss));
                }
            });
            println!("fit {name:13} {:9.2} us   {beams} beams", 1e4 * seconds);
        }
    }
}

/// The best time of some rounds, s.
fn best(mut work: impl FnMut()) -> f64 {
    let rounds = (0..ROUNDS).map(|_| {
        let start_s = thread_s();
        work();
        thread_s() - start_s
    });
    rounds.fold(f64::INFINITY, f64::min)
}

/// A wall 4 m away.
fn wall(beams: usize) -> Beams {
    let noise = Normal::new(0.0, SIGMA_M).expect("a valid sigma");
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    (0..beams)
        .map(|i| {
            let angle = (i as f64 - beams as f64 / 2.0) * (0.25 * PI / 180.0);
            (angle, 4.0 / angle.cos() + noise.sample(&mut rng))
        })
        .collect()
}

fn scans(count: usize) -> Vec<Scan> {
    let mut rng = ChaCha8Rng::seed_from_u64(2005);
    let noise = Normal::new(0.0, SIGMA_M).expect("a valid sigma");
    let uniform = Uniform::new(0.0f64, 1.0).expect("a valid interval");
    (0..count)
        .map(|_| {
            let mut draw = |low: f64, high: f64| low + (high - low) * uniform.sample(&mut rng);
            let turn_rad = draw(0.0, TAU);
            let mut walls = rectangle(
                [draw(-4.0, -1.5), draw(-6.0, -1.5)],
                [draw(1.5, 4.0), draw(1.5, 6.0)],
            );
            for _ in 0..6 {
                let (distance, angle) = (draw(0.9, 4.0), draw(0.0, TAU));
                let (y, z) = (distance * angle.cos(), distance * angle.sin());
                let size = [draw(0.1, 0.8), draw(0.1, 0.8)];
                walls.extend(rectangle([y, z], [y + size[0], z + size[1]]));
            }
            let step_rad = TAU / BEAMS as f64;
            let ranges_m = (0..BEAMS)
                .map(|i| {
                    let range_m = cast(&walls, turn_rad + i as f64 * step_rad);
                    ((range_m + noise.sample(&mut rng)) * 100.0).round() / 100.0
                })
                .collect();
            Scan {
                angle_min_rad: -PI,
                angle_increment_rad: step_rad,
                ranges_m,
                ..Scan::default()
            }
        })
        .collect()
}

fn rectangle([y0, z0]: [f64; 2], [y1, z1]: [f64; 2]) -> Vec<[[f64; 2]; 2]> {
    let corners = [[y0, z0], [y1, z0], [y1, z1], [y0, z1]];
    (0..4).map(|i| [corners[i], corners[(i + 1) % 4]]).collect()
}

fn cast(walls: &[[[f64; 2]; 2]], angle_rad: f64) -> f64 {
    let (sin, cos) = angle_rad.sin_cos();
    let hits = walls.iter().filter_map(|[a, b]| {
        let (ey, ez) = (b[0] - a[0], b[1] - a[1]);
        let det = sin * ey - cos * ez;
        let range_m = (a[1] * ey - a[0] * ez) / det;
        let share = (a[1] * cos - a[0] * sin) / det;
        (range_m > 0.0 && (0.0..=1.0).contains(&share)).then_some(range_m)
    });
    hits.fold(f64::INFINITY, f64::min)
}
