use super::*;
use crate::frame::ScannerPose;
use crate::record::{Face, TrajectoryPoint};
use crate::simulate::staged::{frame, scattered};

const FACES: [Face; 3] = [Face::Right, Face::Upper, Face::Left];

fn true_lines(frame: &Frame, truth: &TrajectoryPoint) -> [NormalLine; 3] {
    let pose = ScannerPose::new(frame, truth.position_m, truth.rotation_rad);
    FACES.map(|face| pose.line(face).normal)
}

#[test]
fn exact_ranges_give_the_lines_back_from_a_cold_start() {
    let frame = frame(&[]);
    let steps = scattered(&frame, "none", 60, [0.5, 4.0], 1);
    let options = Options {
        track: false,
        ..Options::default()
    };
    let mut fit = ReflectorFit::new(&frame, options);
    for step in &steps {
        let found = fit.fit(&step.scan).expect("lines");
        for (line, truth) in found.lines.iter().zip(true_lines(&frame, &step.truth)) {
            // Ranges are carried to 1 um; the bias is free within its prior.
            assert!((line.d_m - truth.d_m).abs() < 3e-4, "{line:?} {truth:?}");
            assert!(
                (line.alpha_rad - truth.alpha_rad).abs() < 3e-5,
                "{line:?} {truth:?}"
            );
        }
    }
}

#[test]
fn seven_parameters_scatter_as_their_covariance_says() {
    // One pose, many draws of noise and bias: the squared error in the metric of the joint
    // covariance is chi-square with seven degrees of freedom.
    let frame = frame(&[]);
    let steps = scattered(&frame, "reference", 400, [0.5, 3.5], 2);
    let mut fit = ReflectorFit::new(
        &frame,
        Options {
            track: false,
            ..Options::default()
        },
    );
    let (mut nees, mut sigma) = (0.0, 0.0);
    for step in &steps {
        let found = fit.fit(&step.scan).expect("lines");
        let truth = true_lines(&frame, &step.truth);
        // The lines alone, bias marginalised: six degrees of freedom.
        let mut e = SVector::<f64, 6>::zeros();
        for k in 0..3 {
            e[2 * k] = found.lines[k].d_m - truth[k].d_m;
            e[2 * k + 1] = found.lines[k].alpha_rad - truth[k].alpha_rad;
        }
        let covariance: SMatrix<f64, 6, 6> = found.covariance.fixed_view::<6, 6>(0, 0).into();
        let information = covariance.cholesky().expect("positive").inverse();
        nees += e.dot(&(information * e));
        sigma += found.sigma_m;
    }
    let (nees, sigma) = (nees / 400.0, sigma / 400.0);
    // Standard error of the mean: sqrt(2 * 6 / 400) = 0.17.
    assert!((nees - 6.0).abs() < 0.6, "{nees}");
    assert!((sigma - 0.0065).abs() < 0.0003, "{sigma}");
}

#[test]
fn the_background_is_not_taken_for_the_strips() {
    // Low down the ceiling 0.7 m behind the strips returns twice as many beams as they do.
    // A line alone knows its distance only as well as the bias, to about 10 mm.
    let frame = frame(&[]);
    let effects = "reference,mixed,outliers,dropouts";
    for step in &scattered(&frame, effects, 80, [0.5, 1.0], 3) {
        let mut fit = ReflectorFit::new(&frame, Options::default());
        let found = fit.fit(&step.scan).expect("lines");
        let off_m = found.lines[1].d_m - true_lines(&frame, &step.truth)[1].d_m;
        assert!(off_m.abs() < 0.05, "{off_m}");
    }
}

#[test]
fn without_a_background_the_nearest_plane_counts() {
    let frame = frame(&[("background_gap_m = 0.70", "# background_gap_m = 0.70")]);
    for step in &scattered(&frame, "reference", 40, [0.5, 3.5], 4) {
        let mut fit = ReflectorFit::new(&frame, Options::default());
        let found = fit.fit(&step.scan).expect("lines");
        let truth = true_lines(&frame, &step.truth);
        assert!((found.lines[1].d_m - truth[1].d_m).abs() < 0.05);
    }
}

#[test]
fn tracking_gives_what_a_cold_start_gives_and_survives_a_jump() {
    let frame = frame(&[]);
    // Scattered poses jump by metres, so every prediction is wrong and must be refused.
    let steps = scattered(&frame, "reference", 100, [0.5, 4.0], 5);
    let mut tracked = ReflectorFit::new(&frame, Options::default());
    let mut cold = ReflectorFit::new(
        &frame,
        Options {
            track: false,
            ..Options::default()
        },
    );
    for step in &steps {
        let truth = true_lines(&frame, &step.truth);
        // The second look at the same scan is a tracked one.
        let first = tracked.fit(&step.scan).expect("lines");
        let again = tracked.fit(&step.scan).expect("lines");
        let fresh = cold.fit(&step.scan).expect("lines");
        for k in 0..3 {
            assert!((first.lines[k].d_m - truth[k].d_m).abs() < 0.05);
            assert!((again.lines[k].d_m - fresh.lines[k].d_m).abs() < 1e-3);
        }
    }
}

#[test]
fn a_hidden_wall_is_missing_and_nothing_else() {
    let frame = frame(&[]);
    let steps = scattered(&frame, "reference", 10, [1.0, 3.0], 6);
    for step in &steps {
        let mut scan = step.scan.clone();
        // Everything to the right is covered: no echo.
        let [_, y, z] = step.truth.position_m;
        let corner_rad = (5.5 - z).atan2(10.45 / 2.0 - y);
        for i in 0..scan.beams() {
            if scan.angle_rad(i) < corner_rad {
                scan.ranges_m[i] = f64::INFINITY;
            }
        }
        let mut fit = ReflectorFit::new(&frame, Options::default());
        let Some(found) = fit.fit(&scan) else {
            continue;
        };
        let mut record = ReflectorLines::default();
        fit.record(&found, &mut record);
        assert!(!record.right.is_seen());
        assert!(record.joint(0, 0).is_nan() && record.joint(2, 2) > 0.0);
        assert!(record.upper.is_seen() && record.left.is_seen());
    }
}

#[test]
fn nonsense_is_no_lines() {
    let frame = frame(&[]);
    let mut fit = ReflectorFit::new(&frame, Options::default());
    let mut scan = Scan::default();
    assert!(fit.fit(&scan).is_none());
    scan.angle_min_rad = 0.0;
    scan.angle_increment_rad = 0.01;
    for value in [f64::INFINITY, f64::NAN, f64::NEG_INFINITY, 0.0, -1.0, 1e300] {
        scan.ranges_m = vec![value; 300].into();
        assert!(fit.fit(&scan).is_none(), "{value}");
    }
}
