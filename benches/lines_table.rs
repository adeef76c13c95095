//! `make lines-table`: the dissertation's table of line extractors (Kurniawan 2017, table 4.1, after
//! Nguyen et al. 2005) with ours beside each row, and its modified Hough transform against the whole
//! one. The scans of the published comparison are not to be had: ours are 100 scans of 722 beams in
//! a simulated office of the same size.
//!
//! Times are the best of some passes over all scans, in the thread's own time, without reading or
//! writing.

mod timing;

use cablepose::frame::Frame;
use cablepose::lines::dissertation::{Strategy, StrategyOptions};
use cablepose::lines::extractor::ExtractorOptions;
use cablepose::lines::fit::Estimator;
use cablepose::lines::hough::{Accumulator, Columns, ReflectorTransform, Window, WindowSize};
use cablepose::lines::methods::extractor;
use cablepose::lines::segmentation::Cut;
use cablepose::motion::{Limits, Pose, SCurve, Shuttle};
use cablepose::record::{NormalLine, ReflectorLines, Scan, Segment, Stamp};
use cablepose::report::lines::{Matching, score};
use cablepose::simulate::office::{Errors, Office, Setup as OfficeSetup, View};
use cablepose::simulate::{Course, Effects, Seed, Setup, Simulator};
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::hint::black_box;
use std::path::Path;
use timing::thread_s;

const PASSES: usize = 5;
const SIGMA_M: f64 = 0.015;

/// A row of the published table: scans/s, lines, TruePos %, FalsePos %, sigma of r (cm) and of alpha
/// (deg).
type Published = Option<[f64; 6]>;

/// Name, whether clustered, and the published row.
const ROWS: [(&str, bool, Published); 17] = [
    (
        "split-and-merge",
        true,
        Some([1470.0, 641.0, 86.0, 8.9, 1.95, 0.74]),
    ),
    ("split-and-merge", false, None),
    (
        "incremental",
        false,
        Some([344.0, 561.0, 77.8, 5.9, 2.04, 0.72]),
    ),
    (
        "incremental",
        true,
        Some([617.0, 567.0, 79.2, 5.1, 2.04, 0.76]),
    ),
    (
        "line-regression",
        false,
        Some([364.0, 577.0, 76.4, 10.1, 1.99, 0.80]),
    ),
    (
        "line-regression",
        true,
        Some([384.0, 562.0, 75.8, 8.4, 1.97, 0.79]),
    ),
    ("ransac", false, Some([29.0, 749.0, 75.6, 31.5, 1.68, 0.77])),
    ("ransac", true, Some([93.0, 547.0, 70.7, 12.2, 1.37, 0.70])),
    ("hough", false, Some([8.0, 825.0, 82.0, 32.5, 1.63, 0.76])),
    ("hough", true, Some([9.0, 600.0, 79.5, 10.0, 1.51, 0.67])),
    ("em", false, Some([0.6, 1153.0, 78.6, 53.7, 2.09, 0.97])),
    ("em", true, Some([0.76, 709.0, 80.3, 23.1, 1.58, 0.73])),
    ("fast-hough", false, None),
    ("fast-hough", true, None),
    ("modified-hough", true, None),
    ("iepf", true, None),
    ("ml", true, None),
];

fn main() -> anyhow::Result<()> {
    comparison();
    println!();
    transforms()
}

fn comparison() {
    let (scans, truth) = office();
    println!("Line extractors: published (Nguyen et al. 2005, 722 points, office of 80 m by 50 m,");
    println!("its own scans and gate) | ours (100 simulated scans of 722 beams, 15 mm of noise)\n");
    println!(
        "{:22}{:>7}{:>7}{:>7}{:>7}{:>6}{:>6} |{:>9}{:>7}{:>7}{:>7}{:>6}{:>6}{:>9}",
        "",
        "scans/s",
        "lines",
        "True%",
        "False%",
        "r cm",
        "a deg",
        "scans/s",
        "lines",
        "True%",
        "False%",
        "r cm",
        "a deg",
        "faster"
    );
    for (name, cluster, published) in ROWS {
        let mut common = ExtractorOptions::default();
        common.segmentation.sigma_m = SIGMA_M;
        if !cluster {
            common.segmentation.cut = Cut::Nowhere;
        }
        let Some(mut method) = extractor(name, common) else {
            continue;
        };
        let mut segments = Vec::new();
        let mut all: Vec<Segment> = Vec::new();
        for scan in &scans {
            method.extract(scan, &mut segments);
            all.extend_from_slice(&segments);
        }
        let seconds = best(|| {
            for scan in &scans {
                method.extract(black_box(scan), &mut segments);
            }
        });
        let hz = scans.len() as f64 / seconds;
        let score = score(name, "", &truth, &all, &Matching::default());
        let label = format!("{name}{}", if cluster { " +clust" } else { "" });
        print!("{label:22}");
        match published {
            Some([hz, lines, found, wrong, r, alpha]) => {
                print!("{hz:>7}{lines:>7}{found:>7.1}{wrong:>7.1}{r:>6.2}{alpha:>6.2} |");
            }
            None => print!("{:>40} |", "-"),
        }
        print!(
            "{hz:>9.0}{:>7}{:>7.1}{:>7.1}{:>6.2}{:>6.2}",
            score.lines,
            score.true_positive_pct(),
            score.false_positive_pct(),
            100.0 * score.d_m.std,
            score.alpha_rad.std.to_degrees(),
        );
        match published {
            Some([published_hz, ..]) => println!("{:>8.0}x", hz / published_hz),
            None => println!("{:>9}", "-"),
        }
    }
}

/// 100 scans all round and all true lines.
fn office() -> (Vec<Scan>, Vec<Segment>) {
    let mut office = Office::new(OfficeSetup {
        view: View::AllRound,
        errors: Errors::of(View::AllRound),
        seed: Seed(2005),
        start: Stamp::from_ns(0),
        scans: 100,
        scans_per_place: 1,
    });
    let (mut scans, mut truth) = (Vec::new(), Vec::new());
    while let Some((scan, lines)) = office.advance() {
        scans.push(scan.clone());
        truth.extend_from_slice(lines);
    }
    (scans, truth)
}

/// The modified transform against the whole one, on the scans of a platform that moves at 3 m/s.
fn transforms() -> anyhow::Result<()> {
    let frame = Frame::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/cablar.toml"))?;
    let scans = moving_scans(&frame);
    let points: Vec<[Vec<f32>; 2]> = scans.iter().map(cartesian).collect();
    let options = StrategyOptions {
        estimator: Estimator::MaximumLikelihood,
        ..StrategyOptions::default()
    };
    // The lines of every scan are the prediction for the next.
    let mut strategy = Strategy::new(&frame, options);
    let mut lines = ReflectorLines::default();
    let mut predicted: Vec<[NormalLine; 3]> = Vec::new();
    let mut lost = 0;
    for scan in &scans {
        lines.begin(scan);
        lost += u32::from(!strategy.find_lines(scan, &mut lines));
        predicted.push(lines.lines().map(|line| line.normal));
    }
    let n = scans.len() as f64;
    let size = WindowSize::default();
    println!(
        "Hough transforms: {} scans of {} beams, three reflectors, platform at up to 3 m/s; cells of \
         {} mm by {:.1} deg; {lost} scans lost\n",
        scans.len(),
        scans[0].beams(),
        1000.0 * size.row_m,
        size.column_rad.to_degrees()
    );
    println!(
        "{:34}{:>12}{:>14}{:>12}{:>11}",
        "", "cells", "votes a scan", "us a scan", "scans/s"
    );
    let row = |name: &str, cells: usize, votes: f64, seconds: f64| {
        println!(
            "{name:34}{cells:>12}{votes:>14.0}{:>12.1}{:>11.0}",
            1e6 * seconds / n,
            n / seconds
        );
    };
    // Eq. 4.5: all distances up to the farthest point, directions all round.
    let reach_m = 9.0;
    let whole = Window {
        d_from_m: 0.0,
        row_m: size.row_m,
        rows: (reach_m / size.row_m) as usize,
        alpha_from_rad: -FRAC_PI_2,
        column_rad: size.column_rad,
        columns: (TAU / size.column_rad).round() as usize,
    };
    let mut accumulator = Accumulator::default();
    let few = 20.min(points.len());
    let mut votes = 0;
    let whole_s = n / few as f64
        * best(|| {
            votes = 0;
            for [y, z] in &points[..few] {
                accumulator.clear();
                for (y, z) in y.iter().zip(z) {
                    accumulator.add(f64::from(*y), f64::from(*z));
                }
                accumulator.vote(&whole);
                votes += accumulator.points() * whole.columns;
                black_box(accumulator.peak(&whole));
            }
        });
    let whole_votes = votes as f64 / few as f64;
    row("whole space (eq. 4.5)", whole.cells(), whole_votes, whole_s);
    let mut columns = Columns::default();
    let half = (PI / size.column_rad).round() as usize;
    let columns_s = best(|| {
        columns.votes_cast = 0;
        for [y, z] in &points {
            columns.begin(half, size.row_m);
            let points = y.iter().zip(z).filter(|(y, z)| (*y + *z).is_finite());
            for (k, (y, z)) in points.enumerate() {
                columns.add(f64::from(*y), f64::from(*z), k);
            }
            black_box(columns.peak());
        }
    });
    row(
        "whole space, column by column",
        half * 2 * whole.rows,
        columns.votes_cast as f64 / n,
        columns_s,
    );
    let mut transform = ReflectorTransform::default();
    let (mut cells, mut cast) = (0, 0);
    let windows_s = best(|| {
        cast = 0;
        for k in 1..scans.len() {
            let [y, z] = &points[k];
            let found = transform.find([y, z], &predicted[k - 1], &size, scans[k].scan_time_s);
            black_box(found);
            cells = transform.cells;
            cast += transform.votes_cast;
        }
    });
    row(
        "three windows (modified)",
        cells,
        cast as f64 / n,
        windows_s,
    );
    println!(
        "three windows / whole space:      {:>11.2}%{:>13.2}%{:>11.2}%   (column by column: {:.2}%)",
        100.0 * cells as f64 / whole.cells() as f64,
        100.0 * cast as f64 / n / whole_votes,
        100.0 * windows_s / whole_s,
        100.0 * windows_s / columns_s,
    );
    println!("published:                                  1%           76%\n");
    for (name, options) in [
        ("modified-hough, fits and all", options),
        ("dissertation, fits and all", StrategyOptions::default()),
    ] {
        let mut strategy = Strategy::new(&frame, options);
        let seconds = best(|| {
            for scan in &scans {
                lines.begin(scan);
                strategy.find_lines(scan, &mut lines);
                black_box(&lines);
            }
        });
        row(name, strategy.work().0, strategy.work().1 as f64, seconds);
    }
    Ok(())
}

/// A scan's points, m.
fn cartesian(scan: &Scan) -> [Vec<f32>; 2] {
    let of = |part: fn(f64) -> f64| {
        let ranges = scan.ranges_m.iter().enumerate();
        ranges
            .map(|(i, r)| (r * part(scan.angle_rad(i))) as f32)
            .collect()
    };
    [of(f64::cos), of(f64::sin)]
}

fn moving_scans(frame: &Frame) -> Vec<Scan> {
    let (from, to) = (Pose::level(0.0, -3.5, 0.6), Pose::level(0.0, 3.5, 3.5));
    let limits = Limits {
        speed_m_s: 3.0,
        acceleration_m_s2: 5.0,
        jerk_m_s3: 50.0,
    };
    let motion = Shuttle {
        from,
        to,
        profile: SCurve::new(from.distance_m(&to), limits),
        dwell_s: 0.2,
        loops: 2,
    };
    let mut simulator = Simulator::new(Setup {
        effects: Effects::reference(),
        seed: Seed(7),
        ..Setup::new(frame.clone(), Course::along(motion))
    });
    let mut scans = Vec::new();
    while let Some(step) = simulator.advance() {
        scans.push(step.scan.clone());
    }
    scans
}

/// The best time of some passes, s: of this thread's own, so that what else runs on the machine counts
/// for little.
fn best(mut work: impl FnMut()) -> f64 {
    let passes = (0..PASSES).map(|_| {
        let start_s = thread_s();
        work();
        thread_s() - start_s
    });
    passes.fold(f64::INFINITY, f64::min)
}
