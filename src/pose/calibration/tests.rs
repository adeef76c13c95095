use super::equations::{OWN, Own, linearise};
use super::parameters::{X_CONSTANT, geometry};
use super::*;
use crate::pose::staged::{all_lines, known, truth};
use crate::record::Face;
use crate::simulate::staged;
use nalgebra::DVector;

fn options() -> Options {
    Options {
        x_constant_sigma_m: Some(0.002),
        bias_spread_m: 0.01,
        threshold: 0.0,
        footprint_scale: 1.0,
    }
}

fn inclined() -> Frame {
    let text = include_str!("../../../testdata/inclined.toml");
    Frame::parse(text, std::path::Path::new("frame.toml")).unwrap()
}

/// Every row against what a step of its unknown really does, with a lever arm and a turned scanner,
/// strips on all three faces, intervals and edges measured between the beams.
#[test]
fn rows_are_the_finite_differences() {
    let mut frame = inclined();
    frame.scanner.position_m = [0.05, -0.03, 0.20];
    frame.scanner.rotation_deg = [0.4, -0.3, 0.7];
    let steps = staged::scattered(&frame, "none", 4, [0.8, 3.0], 5);
    let layout = Layout { strips: 12 };
    for (step, mut lines) in steps.iter().zip(all_lines(&frame, &steps)) {
        for (k, edge) in lines.edges.iter_mut().enumerate() {
            if k % 2 == 1 {
                edge.edge_rad = 0.4 * edge.from_rad + 0.6 * edge.to_rad;
                edge.sigma_rad = 1e-4;
                edge.d_footprint = 1e-3;
            }
        }
        let mut own: Own = [0.0; OWN];
        own[..6].copy_from_slice(&truth(step));
        (own[6], own[7], own[8]) = (lines.range_bias_m, 0.05, 1.03);
        let observation = Observation {
            lines,
            pitch: Some(Pitch::within(own[4], 0.001)),
            roll_rad: Some(own[3]),
            pitch_changes_rad: vec![0.001; 40],
            start: own,
        };
        let zero = DVector::zeros(layout.count());
        let at = |own: &Own, by: &DVector<f64>| {
            linearise(&observation, &geometry(&frame, by), by, own, &options()).unwrap()
        };
        let here = at(&own, &zero);
        assert!(here.forms.iter().any(|f| f.measured) && here.forms.iter().any(|f| !f.measured));
        for k in 0..OWN + layout.count() {
            let moved = |h: f64| {
                let (mut own, mut by) = (own, zero.clone());
                match k {
                    k if k < OWN => own[k] += h,
                    k => by[k - OWN] += h,
                }
                at(&own, &by)
            };
            let h = 1e-5;
            let (low, high) = (moved(-h), moved(h));
            for (i, form) in here.forms.iter().enumerate() {
                let middle = |s: &equations::System| 0.5 * (s.forms[i].low + s.forms[i].high);
                let slope = (middle(&low) - middle(&high)) / (2.0 * h);
                let off = (slope - form.row[k]).abs();
                assert!(
                    off < 2e-3 * (1.0 + form.row[k].abs()),
                    "{i} {k}: {slope} {}",
                    form.row[k]
                );
            }
            // What is Gaussian: the vector falls by the information times the step.
            for j in 0..OWN + layout.count() {
                let slope = (low.vector[j] - high.vector[j]) / (2.0 * h);
                let scale = (here.information[(k, k)] * here.information[(j, j)]).sqrt();
                let off = (slope - here.information[(j, k)]).abs();
                assert!(
                    off <= 2e-2 * scale + 1e-6,
                    "{j} {k}: {slope} {}",
                    here.information[(j, k)]
                );
            }
        }
        let constant = OWN + layout.other(X_CONSTANT);
        assert!(here.information[(0, constant)] < 0.0);
    }
}

/// A run through the frame as it is, solved with one whose strip edges are elsewhere.
fn calibrated(errors_m: [[f64; 2]; 4], seed: u64) -> (Frame, Frame, Calibration) {
    let there = staged::frame(&[]);
    let mut surveyed = there.clone();
    for (strip, [upper, lower]) in surveyed.strips.iter_mut().zip(errors_m) {
        strip.offset_m += 0.5 * (upper + lower);
        strip.width_m += upper - lower;
    }
    let steps = staged::scattered(&there, "reference,-remission", 200, [0.5, 4.0], seed);
    let mut solver = joint::Estimator::new(&surveyed, joint::Options::default());
    let mut calibrator = Calibrator::default();
    for (step, lines) in steps.iter().zip(all_lines(&surveyed, &steps)) {
        let pitch = known(step);
        let pose = solver.solve(&lines, pitch, &[]);
        calibrator.add(&lines, &pose, pitch, None, &[]);
    }
    let found = calibrator.solve(&surveyed, &Settings::default()).unwrap();
    (there, surveyed, found)
}

/// Distances between strips along y, which no movement of the frame as a whole changes: the middles
/// of strips of the same inclination, m, and all widths.
fn shapes(frame: &Frame) -> Vec<f64> {
    let s = &frame.strips;
    let mut shapes: Vec<f64> = s.iter().map(|s| s.width_m).collect();
    // Opposite slopes at opposite places: a shift moves both pairs' sums by nothing.
    shapes.push(s[0].offset_m + s[1].offset_m + s[2].offset_m + s[3].offset_m);
    shapes
}

#[test]
fn strips_are_found_and_what_no_run_shows_is_named() {
    let errors_m = [[2e-3, -2e-3], [-1e-3, 3e-3], [-3e-3, -1e-3], [1e-3, 2.5e-3]];
    let (there, surveyed, found) = calibrated(errors_m, 3);
    let off = |frame: &Frame| {
        let pairs = shapes(frame).into_iter().zip(shapes(&there));
        let squares: Vec<f64> = pairs.map(|(a, b)| (a - b) * (a - b)).collect();
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    };
    let (before, after) = (off(&surveyed), off(&found.frame));
    assert!(before > 2.5e-3 && after < 1.2e-3, "{before} {after}");
    // Every change is within a few standard deviations of the error it answers.
    for (k, (strip, right)) in surveyed.strips.iter().zip(&there.strips).enumerate() {
        let entry = |name: &str| {
            let key = format!("strip[{k}].{name}");
            found.entries.iter().find(|e| e.key == key).unwrap()
        };
        for (entry, error_m) in [
            (entry("offset_m"), right.offset_m - strip.offset_m),
            (entry("width_m"), right.width_m - strip.width_m),
        ] {
            let off = (entry.change - error_m * 1e3) / entry.posterior;
            assert!(
                off.abs() < 4.0 && entry.posterior < entry.prior,
                "{entry:?} {error_m}"
            );
        }
    }
    assert!(found.patterns[0].left > 0.99, "{:?}", found.patterns);
    assert!(found.patterns[1].left > 0.9, "{:?}", found.patterns);
    for key in [
        "box.dz_m",
        "imu.rotation_deg roll",
        "calibration.footprint_scale",
    ] {
        let entry = found.entries.iter().find(|e| e.key == key).unwrap();
        assert!(!entry.shown && entry.change == 0.0, "{entry:?}");
    }
    assert_eq!(found.frame.bounds, surveyed.bounds);
    assert!(found.hidden[0] >= 4 && found.hidden[0] < found.hidden[1]);
    assert!(found.condition > 1.0 && found.condition.is_finite());
    assert_eq!(found.frame.strips_on(Face::Upper).count(), 4);
}

#[test]
fn a_platform_that_stands_is_one_scan() {
    let frame = staged::frame(&[]);
    let steps = staged::scattered(&frame, "reference", 1, [2.0, 2.0], 1);
    let lines = &all_lines(&frame, &steps)[0];
    let pose = joint::Estimator::new(&frame, joint::Options::default()).solve(lines, None, &[]);
    let mut calibrator = Calibrator::default();
    for _ in 0..100 {
        calibrator.add(lines, &pose, None, None, &[]);
    }
    let refused = calibrator.solve(&frame, &Settings::default());
    assert_eq!(refused, Err(CalibrationError::TooFew(1)));
}
