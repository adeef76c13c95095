//! The three-reflector fit against the Cramer-Rao bound, on scans that are made here: clean, with
//! outliers near and far, from one scan to the next.

use cablepose::frame::Frame;
use cablepose::lines::reflectors::{JointLines, Options, ReflectorFit};
use cablepose::record::{NormalLine, Scan};
use nalgebra::{SMatrix, SVector};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, Normal, Uniform};
use std::f64::consts::{FRAC_PI_2, PI};
use std::path::Path;

const SIGMA_M: f64 = 0.0065;
const BIAS_SIGMA_M: f64 = 0.015;
const BEAMS: usize = 761;
const SCANS: usize = 800;

/// The frame with nothing behind its faces.
fn frame() -> Frame {
    let text = include_str!("../testdata/cablar.toml");
    let gap = "background_gap_m = 0.70";
    assert!(text.contains(gap));
    Frame::parse(&text.replace(gap, ""), Path::new("frame.toml")).unwrap()
}

fn truth() -> [NormalLine; 3] {
    let (y, z, roll) = (0.7, 2.3, 0.004);
    [
        NormalLine::new(10.45 / 2.0 - y, -roll),
        NormalLine::new(5.5 - z, FRAC_PI_2 - roll),
        NormalLine::new(10.45 / 2.0 + y, PI - roll),
    ]
}

fn angle_rad(i: usize) -> f64 {
    -5f64.to_radians() + i as f64 * 0.25f64.to_radians()
}

/// Which line a beam meets, and where.
fn met(i: usize) -> (usize, f64) {
    let ranges = truth().map(|line| 1.0 / (line.range_m(angle_rad(i)).recip()).max(1e-9));
    (0..3)
        .map(|k| (k, ranges[k]))
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .unwrap()
}

/// What no bias moves, so that it is not the bias' prior that is tested: the difference of the
/// walls, the ceiling against their mean, and the three directions.
fn rows() -> SMatrix<f64, 5, 7> {
    SMatrix::from_row_slice(&[
        -0.5, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0, //
        -0.5, 0.0, 1.0, 0.0, -0.5, 0.0, 0.0, //
        0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, //
        0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, //
        0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0,
    ])
}

/// Standard deviations that no unbiased estimate can beat, from numerical derivatives.
fn bound() -> SVector<f64, 5> {
    let mut information = SMatrix::<f64, 7, 7>::zeros();
    for i in 0..BEAMS {
        let (k, range_m) = met(i);
        let line = truth()[k];
        let step = 1e-7;
        let mut row = SVector::<f64, 7>::zeros();
        let moved = |d: f64, a: f64| {
            (NormalLine::new(line.d_m + d, line.alpha_rad + a).range_m(angle_rad(i)) - range_m)
                / step
        };
        row[2 * k] = moved(step, 0.0);
        row[2 * k + 1] = moved(0.0, step);
        row[6] = 1.0;
        information += row * row.transpose() / (SIGMA_M * SIGMA_M);
    }
    information[(6, 6)] += 1.0 / (BIAS_SIGMA_M * BIAS_SIGMA_M);
    let covariance = rows() * information.cholesky().unwrap().inverse() * rows().transpose();
    covariance.diagonal().map(f64::sqrt)
}

fn error(found: &JointLines) -> SVector<f64, 5> {
    let mut off = SVector::<f64, 7>::zeros();
    for (k, (line, truth)) in found.lines.iter().zip(truth()).enumerate() {
        off[2 * k] = line.d_m - truth.d_m;
        off[2 * k + 1] = line.alpha_rad - truth.alpha_rad;
    }
    rows() * off
}

/// Root mean square over the bound, mean of the five, and mean NEES, of a tracking fit. `spoil`
/// gives what is added to some ranges, m.
fn score(share: f64, spoil: Uniform<f64>) -> (f64, f64) {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let noise = Normal::new(0.0, SIGMA_M).unwrap();
    let bias = Normal::new(0.0, BIAS_SIGMA_M).unwrap();
    let unit = Uniform::new(0.0, 1.0).unwrap();
    let mut fit = ReflectorFit::new(&frame(), Options::default());
    let (mut squares, mut nees) = (SVector::<f64, 5>::zeros(), 0.0);
    let mut scan = Scan {
        angle_min_rad: angle_rad(0),
        angle_increment_rad: 0.25f64.to_radians(),
        time_increment_s: 1.0 / 35.0 / 1440.0,
        ..Scan::default()
    };
    for _ in 0..SCANS {
        let bias_m = bias.sample(&mut rng);
        let ranges: Vec<f64> = (0..BEAMS)
            .map(|i| {
                let mut range_m = met(i).1 + bias_m + noise.sample(&mut rng);
                if unit.sample(&mut rng) < share {
                    range_m += spoil.sample(&mut rng);
                }
                range_m
            })
            .collect();
        scan.ranges_m = ranges.into();
        let found = fit.fit(&scan).expect("lines");
        let off = error(&found);
        squares += off.component_mul(&off);
        let covariance = rows() * found.covariance * rows().transpose();
        nees += off.dot(&(covariance.cholesky().unwrap().inverse() * off)) / 5.0;
    }
    let rms = (squares / SCANS as f64).map(f64::sqrt);
    (rms.component_div(&bound()).mean(), nees / SCANS as f64)
}

#[test]
fn clean_scans_reach_the_bound() {
    // The mean of five rms of 800 scatters by 0.012.
    let (ratio, nees) = score(0.0, Uniform::new(0.0, 1.0).unwrap());
    assert!(ratio > 0.96 && ratio < 1.045, "{ratio}");
    assert!((nees - 1.0).abs() < 0.1, "{nees}");
}

#[test]
fn gross_outliers_cost_little() {
    // A tenth of the beams end 5 to 150 cm in front.
    let (ratio, nees) = score(0.1, Uniform::new(-1.5, -0.05).unwrap());
    assert!(ratio < 1.15, "{ratio}");
    assert!((0.8..1.3).contains(&nees), "{nees}");
}

#[test]
fn small_outliers_cost_some() {
    // And 2 to 5 cm in front: bolt heads, cables, dirt. In part they pass for noise.
    let (ratio, nees) = score(0.1, Uniform::new(-0.05, -0.02).unwrap());
    assert!(ratio < 1.45, "{ratio}");
    assert!((0.7..1.3).contains(&nees), "{nees}");
}
