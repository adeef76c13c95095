use super::super::association::Limits;
use super::super::axis::{AXES, POSITION};
use super::super::evaluate;
use super::*;
use crate::record::{Status, TrajectoryPoint, upper_index};

pub const MS: i64 = 1_000_000;

/// The trajectory of [`runs`]: a loop through the workspace.
pub fn truth(n: i64) -> Reference {
    let points = (0..n).map(|i| {
        let t = i as f64 * 0.02;
        TrajectoryPoint {
            stamp: Stamp::from_ns(i * 20 * MS),
            position_m: [0.0, 4.0 * (0.13 * t).sin(), 2.0 + 1.5 * (0.17 * t).cos()],
            rotation_rad: [0.0, 0.0, 0.02 * (0.3 * t).sin()],
            velocity_m_s: [0.0, 0.52 * (0.13 * t).cos(), -0.255 * (0.17 * t).sin()],
        }
    });
    Reference::new(points.collect(), Limits::default())
}

/// A run with errors of known statistics: alternating +-a about a bias, and honest sigmas.
pub fn run(name: &str, reference: &Reference, n: i64, scale: f64) -> Run {
    let amplitude = [0.004, 0.0003, 0.0005, 1e-4, 2e-4, 1e-3];
    let poses = (0..n).map(|i| {
        let stamp = Stamp::from_ns(i * 20 * MS);
        let (truth, _) = reference.at(stamp).unwrap();
        let sign = if i % 2 == 0 { 1.0 } else { -1.0 };
        let mut pose = Pose {
            stamp,
            scan_stamp: stamp,
            seq: i as u32,
            edges: 8,
            ..Pose::default()
        };
        let value = |k: usize| truth[k] + scale * amplitude[k] * (sign + 0.25);
        pose.position_m = [0, 1, 2].map(value);
        pose.rotation_rad = [3, 4, 5].map(value);
        pose.covariance = [0.0; 21];
        for (k, sigma) in amplitude.iter().enumerate() {
            pose.covariance[upper_index(6, k, k)] = sigma.powi(2);
        }
        if i % 50 == 49 {
            pose = Pose {
                stamp,
                seq: i as u32,
                status: Status::NO_POSE | Status::NO_EDGES,
                ..Pose::default()
            };
        }
        pose
    });
    Run {
        name: name.to_owned(),
        source: format!("{name}.csv"),
        poses: poses.collect(),
        stages: Vec::new(),
    }
}

#[test]
fn closed_form_of_a_known_run() {
    let reference = truth(2000);
    let cases = evaluate(
        vec![run("a", &reference, 2000, 1.0)],
        &reference,
        &Settings::default(),
    );
    let case = &cases[0];
    assert_eq!(
        (case.scans.rows, case.scans.solved, case.scans.lost),
        (2000, 1960, 0)
    );
    assert_eq!((case.matching.exact, case.matching.unmatched()), (1960, 0));
    let x = &case.axes[0].statistics;
    // 1000 errors of +1.25 a and 960 of -0.75 a.
    let mean = 0.004 * (1000.0 * 1.25 - 960.0 * 0.75) / 1960.0;
    assert!((x.bias - mean).abs() < 1e-12);
    let square = (1000.0 * 1.25f64.powi(2) + 960.0 * 0.75f64.powi(2)) / 1960.0;
    assert!((x.rms - 0.004 * square.sqrt()).abs() < 1e-12);
    assert!((x.max - 0.005).abs() < 1e-12 && (x.min - 0.003).abs() < 1e-12);
    assert!((case.axes[5].consistency.nees - square).abs() < 1e-9);
    assert!((case.groups[2].nees - square).abs() < 1e-9);
    let within = case.axes[0].within;
    assert!((within[0] - 960.0 / 1960.0).abs() < 1e-12 && within[1] == 1.0);
    assert!(case.axes[POSITION].within[0].is_nan());
    assert_eq!(
        case.cells
            .as_ref()
            .unwrap()
            .cells
            .iter()
            .map(|c| c.n)
            .sum::<u32>(),
        1960
    );
    assert!(case.notes.is_empty(), "{:?}", case.notes);
}

#[test]
fn zones_split_a_run() {
    let reference = truth(2000);
    let zones = vec!["z<=2".parse().unwrap(), "high=z>2".parse().unwrap()];
    let settings = Settings {
        zones,
        ..Settings::default()
    };
    let cases = evaluate(vec![run("a", &reference, 2000, 1.0)], &reference, &settings);
    assert_eq!(cases.len(), 2);
    assert_eq!(
        (cases[0].name(), cases[1].name()),
        ("a in z<=2".into(), "a in high".into())
    );
    assert_eq!(cases[0].scans.rows + cases[1].scans.rows, 2000);
    assert_eq!(cases[0].scans.solved + cases[1].scans.solved, 1960);
    assert_eq!(cases[0].scans.lost + cases[1].scans.lost, 0);
    let n: usize = cases.iter().map(|c| c.axes[0].statistics.n).sum();
    assert_eq!(n, 1960);
}

#[test]
fn components_that_a_status_disowns_are_not_scored() {
    let reference = truth(2000);
    let mut odd = run("a", &reference, 2000, 1.0);
    for (i, pose) in odd.poses.iter_mut().enumerate() {
        match i % 50 {
            // Without edges nothing says where x is; a number that stands there is no measurement.
            0 => {
                pose.status = Status::NO_EDGES | Status::NO_YAW;
                pose.position_m[0] = f64::NAN;
                pose.rotation_rad[2] = 1.0;
            }
            1 => {
                pose.status = Status::NO_YAW;
                pose.rotation_rad[2] = f64::NAN;
            }
            2 => {
                pose.status = Status::NO_POSE;
                pose.position_m[1] = 100.0;
            }
            _ => {}
        }
    }
    let case = &evaluate(vec![odd], &reference, &Settings::default())[0];
    let n = |i: usize| case.axes[i].statistics.n;
    let n: Vec<usize> = (0..AXES.len()).map(n).collect();
    // Of 2000: 40 refused by the run itself, 40 by the loop above.
    assert_eq!(AXES[POSITION].name, "position");
    assert_eq!(n[..6], [1880, 1920, 1920, 1920, 1920, 1840]);
    assert_eq!(n[POSITION], 1880);
    assert!(case.axes.iter().all(|a| a.statistics.max < 0.006));
    assert_eq!([0, 1, 2].map(|k| case.groups[k].n), [1840, 1880, 1840]);
    let scans = &case.scans;
    assert_eq!(
        (scans.solved, scans.partial, scans.refused()),
        (1920, 80, 80)
    );
    assert_eq!(case.matching.matched(), 1920);
    let note = "80 of 1920 solved poses lack a component and do not count for it (only for the \
                others): x 40, yaw 80";
    assert!(case.notes.iter().any(|n| n == note), "{:?}", case.notes);
}

#[test]
fn variances_that_cannot_be_used_are_counted() {
    let reference = truth(2000);
    let mut odd = run("a", &reference, 2000, 1.0);
    odd.poses[0].covariance[upper_index(6, 0, 0)] = -1e-6;
    odd.poses[1].covariance[upper_index(6, 0, 0)] = f64::NAN;
    odd.poses[2].covariance[upper_index(6, 5, 5)] = 0.0;
    // Each variance is sound, but x and yaw would be correlated by more than 1.
    odd.poses[3].covariance[upper_index(6, 0, 5)] = 1e-5;
    let case = &evaluate(vec![odd], &reference, &Settings::default())[0];
    let consistency = |i: usize| {
        (
            case.axes[i].consistency.n,
            case.axes[i].consistency.left_out,
        )
    };
    assert_eq!(consistency(0), (1958, 2));
    assert_eq!(consistency(1), (1960, 0));
    assert_eq!(consistency(5), (1959, 1));
    assert_eq!(consistency(POSITION), (0, 0));
    let groups = [0, 1, 2].map(|k| (case.groups[k].n, case.groups[k].left_out));
    assert_eq!(groups, [(1956, 4), (1958, 2), (1956, 4)]);
    let note = "poses whose variance is missing or not positive are left out of the NEES: \
                x 2, yaw 1, x_yaw 4, position 2, pose 4";
    assert_eq!(case.notes, [note]);
    assert_eq!(case.axes[0].statistics.n, 1960, "the errors count");
}

#[test]
fn yaw_is_wrapped() {
    let point = TrajectoryPoint {
        position_m: [0.0; 3],
        rotation_rad: [0.0, 0.0, 3.1],
        ..TrajectoryPoint::default()
    };
    let pose = Pose {
        position_m: [0.0; 3],
        rotation_rad: [0.0, 0.0, -3.1],
        ..Pose::default()
    };
    let reference = Reference::new(vec![point], Limits::default());
    let run = Run {
        poses: vec![pose],
        ..Run::default()
    };
    let cases = evaluate(vec![run], &reference, &Settings::default());
    let want = 2.0 * (std::f64::consts::PI - 3.1);
    assert!((cases[0].axes[5].statistics.bias - want).abs() < 1e-12);
}

#[test]
fn disorder_is_counted() {
    let reference = truth(100);
    let mut run = run("a", &reference, 40, 1.0);
    run.poses.swap(3, 4);
    run.poses.push(run.poses[10].clone());
    run.poses.remove(20);
    run.poses.push(Pose {
        stamp: Stamp::from_ns(10_000 * MS),
        position_m: [0.0; 3],
        rotation_rad: [0.0; 3],
        seq: 40,
        ..Pose::default()
    });
    let case = &evaluate(vec![run], &reference, &Settings::default())[0];
    assert_eq!(
        (case.input.unsorted, case.input.repeated, case.scans.lost),
        (2, 1, 1)
    );
    assert_eq!((case.matching.outside, case.scans.rows), (1, 40));
    assert_eq!((case.input.gaps, case.input.jumps), (1, 1));
    assert_eq!(case.notes.len(), 6, "{:?}", case.notes);
}

#[test]
fn nothing_to_compare_is_said() {
    let reference = truth(10);
    let at = |ns: i64, x: f64| Run {
        poses: vec![Pose {
            stamp: Stamp::from_ns(ns),
            position_m: [x; 3],
            ..Pose::default()
        }],
        ..Run::default()
    };
    for (run, reference, words) in [
        (Run::default(), &reference, "there are no poses"),
        (at(0, f64::NAN), &reference, "no scan has a pose"),
        (at(1 << 60, 0.0), &reference, "do not overlap in time"),
        (
            at(0, 0.0),
            &Reference::default(),
            "the reference has no points",
        ),
    ] {
        let case = &evaluate(vec![run], reference, &Settings::default())[0];
        assert!(case.is_empty());
        assert!(
            case.notes.iter().any(|n| n.contains(words)),
            "{:?}",
            case.notes
        );
    }
}
