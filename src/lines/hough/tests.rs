use super::*;
use crate::lines::extractor::{Extractor, ExtractorOptions};
use crate::record::{NormalLine, Scan, Segment};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use std::f64::consts::PI;

/// A number in [0, 1).
fn unit(rng: &mut ChaCha8Rng) -> f64 {
    f64::from(rng.next_u32()) / f64::from(u32::MAX)
}

/// Points on a line with some noise, and points anywhere.
fn points(seed: u64, d_m: f64, alpha_rad: f64) -> Vec<[f64; 2]> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let (sin, cos) = alpha_rad.sin_cos();
    let mut points = Vec::new();
    for _ in 0..80 {
        let along = 4.0 * unit(&mut rng) - 2.0;
        let off = d_m + 0.01 * (unit(&mut rng) - 0.5);
        points.push([off * cos - along * sin, off * sin + along * cos]);
    }
    for _ in 0..60 {
        points.push([8.0 * unit(&mut rng) - 4.0, 8.0 * unit(&mut rng) - 4.0]);
    }
    points
}

#[test]
fn rounding_by_addition_is_rounding() {
    for value in [-30_000.4f32, -3.6, -0.5, -0.4, 0.0, 0.4, 2.6, 19_999.7] {
        let expected = value.round_ties_even() as i32 as u16;
        assert_eq!(row_of(value), u32::from(expected), "{value}");
    }
}

/// Every cell's count against the definition, in double precision.
#[test]
fn cells_hold_the_votes_of_their_points() {
    let points = points(1, 2.0, 0.7);
    let window = Window::around([2.02, 0.71], [0.15, 0.05], 0.01, 0.002);
    let mut accumulator = Accumulator::default();
    for [y, z] in &points {
        accumulator.add(*y, *z);
    }
    accumulator.vote(&window);
    let mut compared = 0;
    for column in 0..window.columns {
        for row in 0..window.rows {
            let [d_m, alpha_rad] = window.at(row as f64, column as f64);
            let (sin, cos) = alpha_rad.sin_cos();
            let off = |[y, z]: &[f64; 2]| ((y * cos + z * sin - d_m) / window.row_m).abs();
            // Single precision may put a point that lies on the border to either side.
            let sure = points.iter().filter(|p| off(p) < 0.499).count() as u32;
            let perhaps = points.iter().filter(|p| off(p) < 0.501).count() as u32;
            let votes = accumulator.votes(&window, row, column);
            assert!(
                (sure..=perhaps).contains(&votes),
                "{votes} {sure} {perhaps}"
            );
            compared += u32::from(votes > 0);
        }
    }
    assert!(compared > 500, "{compared}");
}

#[test]
fn a_window_finds_its_line_to_a_fraction_of_a_cell() {
    for seed in 0..20 {
        let (d_m, alpha_rad) = (1.0 + 0.1 * seed as f64, 0.3 * seed as f64);
        let mut accumulator = Accumulator::default();
        for [y, z] in points(seed, d_m, alpha_rad) {
            accumulator.add(y, z);
        }
        let around = [d_m + 0.06, alpha_rad - 0.02];
        let window = Window::around(around, [0.17, 0.04], 0.01, 0.002);
        accumulator.vote(&window);
        let ([found_m, found_rad], votes) = accumulator.peak(&window).unwrap();
        assert!((found_m - d_m).abs() < 0.006, "{found_m} {d_m}");
        assert!(
            (found_rad - alpha_rad).abs() < 0.006,
            "{found_rad} {alpha_rad}"
        );
        assert!(votes >= 40, "{votes}");
    }
}

#[test]
fn nothing_votes_for_nothing() {
    let window = Window::around([2.0, 0.0], [0.1, 0.1], 0.01, 0.01);
    let mut accumulator = Accumulator::default();
    accumulator.vote(&window);
    assert_eq!(accumulator.peak(&window), None);
    accumulator.add(f64::INFINITY, 1.0);
    accumulator.add(f64::NAN, f64::NAN);
    accumulator.add(500.0, 500.0);
    accumulator.vote(&window);
    assert_eq!(accumulator.peak(&window), None);
}

/// Taking lines away one after the other, the peak is always that of all cells counted anew.
#[test]
fn the_peak_of_columns_is_that_of_all_cells() {
    let mut all = points(3, 2.0, 0.7);
    all.extend(points(4, 1.2, 2.5));
    let (columns, row_m) = (90, 0.02);
    let mut transform = Columns::default();
    transform.begin(columns, row_m);
    for (id, [y, z]) in all.iter().enumerate() {
        transform.add(*y, *z, id);
    }
    let mut left: Vec<usize> = (0..all.len()).collect();
    for _ in 0..6 {
        let peak = transform.peak().unwrap();
        let mut best = 0;
        for column in 0..columns {
            let (sin, cos) = (PI * column as f64 / columns as f64).sin_cos();
            for row in -400..400 {
                let votes = left.iter().filter(|id| {
                    let [y, z] = all[**id];
                    ((y * cos + z * sin) / row_m - f64::from(row)).abs() < 1.5
                });
                best = best.max(votes.count() as i64);
            }
        }
        assert!((best - i64::from(peak.votes)).abs() <= 1, "{best} {peak:?}");
        let (sin, cos) = peak.alpha_rad.sin_cos();
        let near = |id: usize| {
            let [y, z] = all[id];
            (y * cos + z * sin - peak.d_m).abs() < 2.0 * row_m
        };
        transform.remove(near);
        left.retain(|id| !near(*id));
    }
}

#[test]
fn windows_are_a_hundredth_of_the_space() {
    let size = WindowSize::default();
    let [d_m, alpha_rad] = size.reach(f64::NAN);
    // Eq. 4.6: speed, cycle and scaling factor.
    assert!((d_m - 3.0 / 35.0 * 2.0).abs() < 1e-12);
    let window = Window::around([4.0, 0.0], [d_m, alpha_rad], size.row_m, size.column_rad);
    // Eq. 4.5 for a reach of 9 m, directions all round.
    let whole = (9.0 / size.row_m) * (2.0 * PI / size.column_rad);
    let share = 3.0 * window.cells() as f64 / whole;
    assert!(share < 0.01, "{share}");
    // And the window reaches as far as it must.
    let [low_m, low_rad] = window.at(0.0, 0.0);
    let last = window.at(window.rows as f64 - 1.0, window.columns as f64 - 1.0);
    assert!(low_m <= 4.0 - d_m && last[0] >= 4.0 + d_m);
    assert!(low_rad <= -alpha_rad && last[1] >= alpha_rad);
}

#[test]
fn three_reflectors_are_found_near_where_they_were() {
    let truth = [
        NormalLine::new(4.0, 0.02),
        NormalLine::new(3.0, PI / 2.0 + 0.02),
        NormalLine::new(6.45, PI + 0.02),
    ];
    let (mut y, mut z) = (Vec::new(), Vec::new());
    for i in 0..761 {
        let angle = (-5.0 + 0.25 * f64::from(i)).to_radians();
        let range = truth
            .iter()
            .map(|line| line.d_m / (angle - line.alpha_rad).cos())
            .filter(|range| *range > 0.0)
            .fold(f64::INFINITY, f64::min);
        let range = if i % 50 == 7 { f64::INFINITY } else { range };
        y.push((range * angle.cos()) as f32);
        z.push((range * angle.sin()) as f32);
    }
    let mut transform = ReflectorTransform::default();
    let predicted = truth.map(|line| NormalLine::new(line.d_m - 0.08, line.alpha_rad + 0.008));
    let found = transform.find([&y, &z], &predicted, &WindowSize::default(), 1.0 / 35.0);
    for (line, found) in truth.iter().zip(found) {
        let ([d_m, alpha_rad], votes) = found.unwrap();
        assert!((d_m - line.d_m).abs() < 0.006, "{d_m} {line:?}");
        assert!(
            (alpha_rad - line.alpha_rad).abs() < 0.003,
            "{alpha_rad} {line:?}"
        );
        assert!(votes > 60, "{votes}");
    }
    assert!(transform.cells > 0 && transform.votes_cast > 0);
}

/// A room whose walls are at the given distances to the right, up, left and down.
fn room(walls_m: [f64; 4], turn_rad: f64, shift_m: f64) -> Scan {
    let step_rad = 2.0 * PI / 722.0;
    let range_m = |i: usize| {
        let angle = -PI + (i as f64 + 0.5) * step_rad;
        let walls = walls_m.iter().enumerate().map(|(k, d_m)| {
            let d_m = d_m + if k == 0 { shift_m } else { 0.0 };
            d_m / (angle - turn_rad - PI / 2.0 * k as f64).cos()
        });
        walls.filter(|r| *r > 0.0).fold(f64::INFINITY, f64::min)
    };
    Scan {
        angle_min_rad: -PI + 0.5 * step_rad,
        angle_increment_rad: step_rad,
        scan_time_s: 0.04,
        ranges_m: (0..722).map(range_m).collect(),
        ..Scan::default()
    }
}

#[test]
fn the_modified_transform_follows_and_finds_what_is_new() {
    // So little noise that no beam of the next wall passes for this one's at a corner.
    let mut common = ExtractorOptions::default();
    common.segmentation.sigma_m = 0.0005;
    let whole = HoughOptions {
        common,
        ..HoughOptions::default()
    };
    let mut modified = ModifiedHough::new(ModifiedHoughOptions {
        whole,
        ..ModifiedHoughOptions::default()
    });
    let mut out: Vec<Segment> = Vec::new();
    modified.extract(&room([2.5, 2.8, 3.5, 1.2], 0.1, 0.0), &mut out);
    assert_eq!(out.len(), 4, "{out:#?}");
    // Only two of the four are predicted, one of them ten centimetres off by now.
    modified.expect(&[out[0].normal, out[1].normal]);
    let moved = room([2.5, 2.8, 3.5, 1.2], 0.1, 0.1);
    modified.extract(&moved, &mut out);
    assert_eq!(out.len(), 4, "{out:#?}");
    let mut d_m: Vec<f64> = out.iter().map(|s| s.normal.d_m).collect();
    d_m.sort_by(f64::total_cmp);
    for (found, true_m) in d_m.iter().zip([1.2, 2.6, 2.8, 3.5]) {
        assert!((found - true_m).abs() < 1e-6, "{d_m:?}");
    }
}

#[test]
fn hypercubes_find_what_all_cells_find() {
    let scan = room([2.5, 2.8, 3.5, 1.2], 0.5, 0.0);
    let (mut all, mut fast) = (Vec::new(), Vec::new());
    Hough::default().extract(&scan, &mut all);
    let mut extractor = FastHough::default();
    extractor.extract(&scan, &mut fast);
    assert_eq!(all.len(), 4);
    assert_eq!(fast.len(), 4);
    for (a, b) in all.iter().zip(&fast) {
        assert!((a.normal.d_m - b.normal.d_m).abs() < 1e-6);
    }
    // Halving looks into far fewer parts than there are cells.
    assert!(
        extractor.looked_into() < 20_000,
        "{}",
        extractor.looked_into()
    );
}

/// Cells of 16 bits: more beams than they can count are a great many beams all the same.
#[test]
fn a_cell_that_is_full_stays_full() {
    let beams = 70_000;
    let window = Window::around([2.0, 0.0], [0.1, 0.1], 0.01, 0.01);
    let mut accumulator = Accumulator::default();
    let mut columns = Columns::default();
    columns.begin(8, 0.01);
    for id in 0..beams {
        accumulator.add(2.0, 0.0);
        columns.add(2.0, 0.0, id);
    }
    accumulator.vote(&window);
    let ([d_m, _], votes) = accumulator.peak(&window).unwrap();
    assert!((d_m - 2.0).abs() < 0.02 && votes == 65_535);
    let peak = columns.peak().unwrap();
    assert!(peak.votes >= 65_535, "{peak:?}");
}
