//! Whole scans against closed forms that know nothing of rays and planes, and the effects'
//! statistics.

use super::*;
use crate::frame::{Frame, ScannerModel};
use crate::motion::{Pose, Straight};
use crate::record::Stamp;
use nalgebra::Vector3;
use std::f64::consts::{FRAC_PI_2, TAU};

const START: Stamp = Stamp::from_ns(1_767_225_600_000_000_000);

fn frame() -> Frame {
    staged::frame(&[])
}

fn setup(frame: Frame, course: Course, effects: &str) -> Setup {
    Setup {
        effects: effects.parse().unwrap(),
        seed: Seed(11),
        start: START,
        ..Setup::new(frame, course)
    }
}

fn steps(setup: Setup) -> Vec<Step> {
    Simulator::new(setup).all()
}

fn at_rest(poses: Vec<Pose>) -> Course {
    Course::Stations {
        poses: poses.into(),
        scans_each: 1,
    }
}

fn scattered(count: u64) -> Vec<Pose> {
    Scatter::workspace([0.5, 3.5]).poses(Seed(5), count)
}

/// Range of a beam by the formulas of the estimator's beam model, in scalars.
fn closed_form(frame: &Frame, pose: &Pose, angle_rad: f64) -> f64 {
    let (x, y, z) = (pose.position_m.x, pose.position_m.y, pose.position_m.z);
    let (roll, pitch, yaw) = (
        pose.rotation_rad.x,
        pose.rotation_rad.y,
        pose.rotation_rad.z,
    );
    let a = angle_rad + roll;
    let u_x = yaw.cos() * a.sin() * pitch.sin() - yaw.sin() * a.cos();
    let u_y = yaw.sin() * a.sin() * pitch.sin() + yaw.cos() * a.cos();
    let u_z = a.sin() * pitch.cos();
    let b = &frame.bounds;
    // Nearest of walls and ceiling, moved out by `gap`; the floor too, for the background.
    let nearest = |gap: f64| {
        let wall = (u_y.signum() * (b.dy_m / 2.0 + gap) - y) / u_y;
        let ceiling = (b.dz_m + gap - z) / u_z;
        let floor = (-gap - z) / u_z;
        let mut best = (f64::INFINITY, 'n');
        for (range, name) in [(wall, 'w'), (ceiling, 'c'), (floor, 'f')] {
            if range > 0.0 && range < best.0 {
                best = (range, name);
            }
        }
        best
    };
    let (range, surface) = nearest(0.0);
    let (hx, hy, hz) = (x + range * u_x, y + range * u_y, z + range * u_z);
    let hit = match surface {
        'w' => hx.abs() <= 0.25 && (0.2..=5.2).contains(&hz),
        'c' => [(3.9, 1.0), (1.3, -1.0), (-1.3, 1.0), (-3.9, -1.0)]
            .iter()
            .any(|(p, s)| (hy - p - s * hx * 30f64.to_radians().tan()).abs() <= 0.4),
        _ => false,
    };
    if hit { range } else { nearest(0.7).0 }
}

#[test]
fn exact_ranges_at_rest_are_the_closed_forms() {
    let frame = frame();
    let poses = scattered(40);
    for (step, pose) in steps(setup(frame.clone(), at_rest(poses.clone()), "none"))
        .iter()
        .zip(&poses)
    {
        assert!(step.scan.remissions.is_empty());
        assert_eq!(step.scan.beams(), 761);
        for i in 0..761 {
            let expected = closed_form(&frame, pose, step.scan.angle_rad(i));
            assert!(
                (step.scan.ranges_m[i] - expected).abs() < 1e-6,
                "beam {i} {pose:?}"
            );
        }
    }
}

#[test]
fn lines_at_rest_have_their_distances() {
    let frame = frame();
    for pose in scattered(40) {
        let step = &steps(setup(frame.clone(), at_rest(vec![pose]), "none"))[0];
        let (pitch, yaw) = (pose.rotation_rad.y, pose.rotation_rad.z);
        let n = (yaw.cos().powi(2) + (yaw.sin() * pitch.sin()).powi(2)).sqrt();
        let (y, z) = (pose.position_m.y, pose.position_m.z);
        // Distance of the line through two beams' ends in the scan plane.
        let distance = |from_deg: f64, to_deg: f64, expected: f64| {
            let index = |deg: f64| ((deg + 5.0) * 4.0) as usize;
            let points: Vec<(f64, f64)> = (index(from_deg)..index(to_deg))
                .map(|i| (step.scan.angle_rad(i), step.scan.ranges_m[i]))
                .map(|(a, r)| (r * a.cos(), r * a.sin()))
                .filter(|p| {
                    // On the frame and not on the background behind it, nor on a wall.
                    let upper = from_deg == 30.0;
                    let d = if upper { p.1 } else { p.0.abs() };
                    (d - expected).abs() < 0.3 && !(upper && (y + p.0).abs() > 4.9)
                })
                .collect();
            let (p, q) = (points[0], points[points.len() - 1]);
            assert!(points.len() > 20);
            let length = ((q.0 - p.0).powi(2) + (q.1 - p.1).powi(2)).sqrt();
            (p.0 * q.1 - p.1 * q.0).abs() / length
        };
        let (right, left) = ((5.225 - y) / n, (5.225 + y) / n);
        assert!((distance(0.0, 10.0, right) - right).abs() < 1e-5);
        assert!((distance(170.0, 180.0, left) - left).abs() < 1e-5);
        let upper = (5.5 - z) / pitch.cos();
        assert!((distance(30.0, 150.0, upper) - upper).abs() < 1e-5);
    }
}

#[test]
fn mounting_turns_and_moves_the_scanner() {
    // Rz Ry Rx written out, applied twice.
    fn turn(angles: [f64; 3], v: [f64; 3]) -> [f64; 3] {
        let [(sr, cr), (sp, cp), (sy, cy)] = angles.map(f64::sin_cos);
        let rows = [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ];
        rows.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
    }
    let mut frame = frame();
    frame.scanner.position_m = [0.02, -0.3, 0.25];
    frame.scanner.rotation_deg = [0.4, -0.6, 0.3];
    let pose = Pose {
        position_m: Vector3::new(0.01, 1.2, 2.1),
        rotation_rad: Vector3::new(0.02, 0.01, -0.015),
    };
    let step = &steps(setup(frame.clone(), at_rest(vec![pose]), "none"))[0];
    let attitude = pose.rotation_rad.into();
    let mounting = frame.scanner.rotation_deg.map(f64::to_radians);
    let lever = turn(attitude, frame.scanner.position_m);
    let origin = [0, 1, 2].map(|k| pose.position_m[k] + lever[k]);
    let (mut plates, mut strips) = (0, 0);
    for i in 0..761 {
        let a = step.scan.angle_rad(i);
        let u = turn(attitude, turn(mounting, [0.0, a.cos(), a.sin()]));
        let r = step.scan.ranges_m[i];
        let end = [0, 1, 2].map(|k| origin[k] + r * u[k]);
        // Every end lies on the frame or on the background's box.
        let [y, z] = [end[1].abs(), end[2]];
        let on = |v: f64, plane: f64| (v - plane).abs() < 2e-6;
        plates += u32::from(on(y, 5.225));
        strips += u32::from(on(z, 5.5));
        assert!(
            on(y, 5.225) || on(y, 5.925) || on(z, 5.5) || on(z, 6.2) || on(z, -0.7),
            "{end:?}"
        );
    }
    assert!(plates > 100 && strips > 100);
}

#[test]
fn in_motion_every_beam_leaves_from_its_own_place() {
    let frame = frame();
    let line = Straight {
        from: Pose {
            position_m: Vector3::new(0.0, -2.0, 1.0),
            rotation_rad: Vector3::new(0.01, 0.0, -0.01),
        },
        to: Pose {
            position_m: Vector3::new(0.02, 2.0, 2.5),
            rotation_rad: Vector3::new(-0.01, 0.01, 0.01),
        },
        speed_m_s: 3.0,
    };
    let course = || Course::Moving {
        truth: Box::new(line),
        desired: Box::new(line),
        lag_s: 0.0,
    };
    let length_m = (0.02f64 * 0.02 + 16.0 + 2.25).sqrt();
    let at = |seconds: f64| {
        let share = seconds * 3.0 / length_m;
        Pose {
            position_m: line.from.position_m.lerp(&line.to.position_m, share),
            rotation_rad: line.from.rotation_rad.lerp(&line.to.rotation_rad, share),
        }
    };
    let moving = steps(setup(frame.clone(), course(), "motion"));
    let frozen = steps(setup(frame.clone(), course(), "none"));
    assert_eq!(moving.len(), ((length_m / 3.0 - 0.015) * 35.0) as usize + 1);
    for (k, (moving, frozen)) in moving.iter().zip(&frozen).enumerate() {
        let fired_s = k as f64 / 35.0;
        // The beam at 90 deg is 95 deg of mirror after the first.
        let reference_s = fired_s + 95.0 / 360.0 / 35.0;
        assert!((moving.truth.stamp.since_s(START) - reference_s).abs() < 2e-9);
        let truth = Vector3::from(moving.truth.position_m);
        assert!((truth - at(reference_s).position_m).norm() < 1e-7);
        assert!((Vector3::from(moving.truth.velocity_m_s).norm() - 3.0).abs() < 1e-12);
        for i in (0..761).step_by(7) {
            let angle = moving.scan.angle_rad(i);
            let beam_s = reference_s + (angle - FRAC_PI_2) / (TAU * 35.0);
            let expected = closed_form(&frame, &at(beam_s), angle);
            assert!(
                (moving.scan.ranges_m[i] - expected).abs() < 1e-6,
                "scan {k} beam {i}"
            );
            let expected = closed_form(&frame, &at(reference_s), angle);
            assert!(
                (frozen.scan.ranges_m[i] - expected).abs() < 1e-6,
                "scan {k} beam {i}"
            );
        }
    }
}

/// Differences of two runs' ranges beam by beam where both are finite.
fn differences(a: &Step, b: &Step) -> Vec<f64> {
    let pairs = a.scan.ranges_m.iter().zip(b.scan.ranges_m.iter());
    pairs.map(|(a, b)| a - b).collect()
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
}

#[test]
fn the_reference_set_up_has_its_statistics() {
    let exact = steps(setup(frame(), at_rest(scattered(400)), "none"));
    let noisy = steps(setup(frame(), at_rest(scattered(400)), "reference"));
    let (mut means, mut within) = (Vec::new(), Vec::new());
    for (exact, noisy) in exact.iter().zip(&noisy) {
        // Beams whose spot falls on the other side of an edge than their axis differ by much.
        let errors: Vec<f64> = differences(noisy, exact)
            .into_iter()
            .filter(|e| e.abs() < 0.08)
            .collect();
        assert!(errors.len() > 740);
        let mean = errors.iter().sum::<f64>() / errors.len() as f64;
        means.push(mean);
        within.extend(errors.iter().map(|e| e - mean));
        assert!(
            noisy
                .scan
                .ranges_m
                .iter()
                .all(|r| (r * 1e3 - (r * 1e3).round()).abs() < 1e-9)
        );
    }
    // 6.5 mm and a digit's 1/sqrt(12) mm; 25/sqrt(3) mm.
    assert!(
        (rms(&within) * 1e3 - (6.5f64 * 6.5 + 1.0 / 12.0).sqrt()).abs() < 0.04,
        "{}",
        rms(&within)
    );
    assert!((rms(&means) * 1e3 - 14.43).abs() < 1.0, "{}", rms(&means));
    assert!(means.iter().all(|m| m.abs() < 0.0265));
}

#[test]
fn effects_do_not_disturb_each_other() {
    let run = |effects: &str| steps(setup(frame(), at_rest(scattered(5)), effects));
    let (exact, noise) = (run("none"), run("noise"));
    let all = run("noise,footprint,mixed,remission,outliers,dropouts,cables,cargo");
    for ((exact, noise), all) in exact.iter().zip(&noise).zip(&all) {
        let same = differences(noise, exact)
            .into_iter()
            .zip(differences(all, exact))
            .filter(|(a, b)| (a - b).abs() < 2e-6)
            .count();
        // Cargo, cables, wild and lost beams take at most a tenth.
        assert!(same > 650, "{same}");
        assert_eq!(noise.truth, all.truth);
    }
    // A run that is cut short has the same scans.
    let mut short = setup(frame(), at_rest(scattered(5)), "all");
    short.scans = Some(3);
    assert_eq!(
        steps(short).last().unwrap().scan.ranges_m,
        run("all")[2].scan.ranges_m
    );
}

#[test]
fn mixed_pixels_have_their_share() {
    // Beams with two echoes are those with 0.1 to 0.9 of their spot on a reflector.
    let echoes = steps(setup(frame(), at_rest(scattered(300)), "footprint,echoes"));
    let mixed = steps(setup(frame(), at_rest(scattered(300)), "footprint,mixed"));
    let (mut between, mut concerned) = (0u32, 0u32);
    for (echoes, mixed) in echoes.iter().zip(&mixed) {
        for i in 0..761 {
            let near = echoes.scan.ranges_m[i];
            let far = echoes.scan.further_ranges_m[0][i];
            let range = mixed.scan.ranges_m[i];
            let is_between = far.is_finite() && range > near + 0.05 && range < far - 0.05;
            concerned += u32::from(far.is_finite());
            between += u32::from(is_between);
            let on_a_surface = (range - near).abs() < 2e-6 || (range - far).abs() < 2e-6;
            assert!(is_between || on_a_surface, "beam {i}: {near} {range} {far}");
        }
    }
    assert!(concerned > 1500, "{concerned}");
    let share = f64::from(between) / f64::from(concerned);
    assert!((share - 0.3).abs() < 0.04, "{share} of {concerned}");
    // Nothing happens without a background to mix with.
    let mut bare = frame();
    bare.bounds.background_gap_m = None;
    let step = &steps(setup(bare, at_rest(scattered(1)), "footprint,mixed"))[0];
    assert!(step.scan.ranges_m.contains(&f64::INFINITY));
}

#[test]
fn shares_of_wild_and_lost_beams() {
    let mut spoiled = setup(frame(), at_rest(scattered(100)), "outliers,dropouts");
    spoiled.parameters.outliers.share = 0.02;
    spoiled.parameters.dropouts.share = 0.05;
    let exact = steps(setup(frame(), at_rest(scattered(100)), "none"));
    let (mut wild, mut lost) = (0.0, 0.0);
    for (spoiled, exact) in steps(spoiled).iter().zip(&exact) {
        for (a, b) in spoiled.scan.ranges_m.iter().zip(exact.scan.ranges_m.iter()) {
            if *a == f64::INFINITY {
                lost += 1.0;
            } else if (a - b).abs() > 1e-3 {
                wild += 1.0;
            }
        }
    }
    let beams = 76_100.0;
    assert!((lost / beams - 0.05f64).abs() < 0.004);
    assert!((wild / beams - 0.02 * 0.95f64).abs() < 0.003);
}

#[test]
fn remissions_follow_the_law() {
    let mut quiet = setup(frame(), at_rest(scattered(30)), "footprint,remission");
    quiet.parameters.remission.noise = 0.0;
    let quiet = steps(quiet);
    let noisy = steps(setup(
        frame(),
        at_rest(scattered(30)),
        "footprint,remission",
    ));
    let mut relative = Vec::new();
    for (quiet, noisy) in quiet.iter().zip(&noisy) {
        // The beam nearest to level meets the right plate squarely: (3/r)^0.5.
        let (i, r) = (20, quiet.scan.ranges_m[20]);
        let expected = 150.0 * (3.0 / r).sqrt();
        assert!((f64::from(quiet.scan.remissions[i]) - expected).abs() < 1.0);
        for (a, b) in noisy.scan.remissions.iter().zip(&quiet.scan.remissions) {
            if *b > 100.0 {
                relative.push(f64::from(a / b - 1.0));
            }
        }
    }
    assert!((rms(&relative) - 0.04).abs() < 0.001, "{}", rms(&relative));
}

#[test]
fn echoes_show_both_surfaces_at_an_edge() {
    let step = &steps(setup(
        frame(),
        at_rest(scattered(1)),
        "footprint,echoes,remission",
    ))[0];
    assert_eq!(step.scan.further_ranges_m.len(), 4);
    let mut pairs = 0;
    for (first, second) in step
        .scan
        .ranges_m
        .iter()
        .zip(step.scan.further_ranges_m[0].iter())
    {
        if second.is_finite() {
            assert!(second > first);
            pairs += 1;
        }
    }
    // Eight strip edges and four plate ends, each at two or three beams at most.
    assert!((4..=40).contains(&pairs), "{pairs}");
}

#[test]
fn imu_samples_bracket_every_reference_instant() {
    let line = Straight {
        from: Pose {
            position_m: Vector3::new(0.0, -1.0, 1.0),
            rotation_rad: Vector3::zeros(),
        },
        to: Pose {
            position_m: Vector3::new(0.0, 1.0, 1.0),
            rotation_rad: Vector3::new(0.0, 0.02, 0.0),
        },
        speed_m_s: 1.0,
    };
    let mut setup = setup(
        frame(),
        Course::Moving {
            truth: Box::new(line),
            desired: Box::new(line),
            lag_s: 0.0,
        },
        "none",
    );
    setup.imu_rate_hz = Some(100.0);
    let mut seen = Vec::new();
    for step in steps(setup) {
        seen.extend(step.imu.iter().copied());
        let reference = step.truth.stamp;
        assert!(seen.iter().any(|s| s.stamp <= reference));
        assert!(seen.last().unwrap().stamp >= reference);
    }
    for (k, sample) in seen.iter().enumerate() {
        assert_eq!(sample.stamp - START, k as i64 * 10_000_000);
        assert!((sample.pitch_rad - 0.01 * sample.stamp.since_s(START)).abs() < 1e-9);
        assert!((sample.gyro_y_rad_s - 0.01).abs() < 1e-12);
    }
}

#[test]
fn every_model_and_mode_runs_with_every_effect() {
    for model in ScannerModel::all() {
        for mode in model.modes {
            let mut setup = setup(frame(), at_rest(scattered(2)), "all");
            (setup.model, setup.mode) = (model, *mode);
            for step in steps(setup) {
                let beams = step.scan.beams();
                assert!(beams > 100);
                assert_eq!(step.scan.remissions.len(), beams);
                assert!(step.scan.ranges_m.iter().all(|r| !r.is_nan()));
                let finite = step.scan.ranges_m.iter().filter(|r| r.is_finite()).count();
                assert!(finite > beams / 2, "{} {mode}", model.name);
            }
        }
    }
}

#[test]
fn what_is_passed_over_changes_nothing_behind_it() {
    let course = || {
        let at = |y| Pose {
            position_m: Vector3::new(0.0, y, 2.0),
            rotation_rad: Vector3::zeros(),
        };
        let motion = Straight {
            from: at(-1.0),
            to: at(1.0),
            speed_m_s: 2.0,
        };
        Course::Moving {
            truth: Box::new(motion),
            desired: Box::new(motion),
            lag_s: 0.0,
        }
    };
    let effects = "reference,motion,angle-jitter";
    let all = steps(setup(frame(), course(), effects));
    let mut simulator = Simulator::new(setup(frame(), course(), effects));
    for (number, due) in all.iter().enumerate() {
        if number % 3 == 1 {
            assert_eq!(simulator.pass(), Some(due.complete));
        } else {
            let step = simulator.advance().unwrap();
            assert_eq!(step.scan, due.scan);
            assert_eq!((step.truth, step.complete), (due.truth, due.complete));
        }
    }
    assert_eq!(simulator.pass(), None);
    assert!(simulator.advance().is_none());
}

#[test]
fn another_mode_goes_on_along_the_course() {
    let mut setup = setup(frame(), at_rest(scattered(1)), "none");
    let at = |y| Pose {
        position_m: Vector3::new(0.0, y, 2.0),
        rotation_rad: Vector3::zeros(),
    };
    let motion = Straight {
        from: at(-1.0),
        to: at(1.0),
        speed_m_s: 1.0,
    };
    setup.course = Course::Moving {
        truth: Box::new(motion),
        desired: Box::new(motion),
        lag_s: 0.0,
    };
    let model = setup.model;
    let mut simulator = Simulator::new(setup);
    // 35 scans of 35 Hz are a second of two.
    for _ in 0..35 {
        simulator.advance().unwrap();
    }
    simulator.set_mode(model.mode(100.0, 1.0).unwrap());
    let step = simulator.advance().unwrap();
    assert_eq!((step.scan.seq, step.scan.beams()), (35, 191));
    let since_s = step.scan.stamp.since_s(START);
    assert!((since_s - 1.0).abs() < 1e-6, "{since_s}");
    assert!((step.scan.scan_time_s - 0.01).abs() < 1e-12);
    // The truth is that of the instant, whatever the mode.
    let truth = step.truth;
    let due_m = truth.stamp.since_s(START) - 1.0;
    assert!((truth.position_m[1] - due_m).abs() < 1e-9);
    let mut left = 1;
    while let Some(step) = simulator.advance() {
        left += 1;
        assert!(step.complete.since_s(START) < 2.0 + 1e-6);
    }
    assert!((98..=101).contains(&left), "{left}");
}
