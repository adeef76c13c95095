use super::*;
use crate::record::NormalLine;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, Uniform};
use std::path::Path;

fn cablar() -> Frame {
    let text = include_str!("../../../testdata/cablar.toml");
    Frame::parse(text, Path::new("cablar.toml")).unwrap()
}

/// What an ideal scanner (0.25 degrees, no noise, no spot) sees from a pose, by planes, rays
/// and rotation matrices: independent of the closed forms under test.
fn ideal(frame: &Frame, position_m: [f64; 3], rotation_rad: [f64; 3]) -> ReflectorLines {
    let [roll, pitch, yaw] = rotation_rad;
    let rotation = Rotation3::from_euler_angles(roll, pitch, yaw);
    let origin = Vector3::from(position_m) + rotation * Vector3::from(frame.scanner.position_m);
    let b = &frame.bounds;
    let line = |normal: Vector3<f64>, offset_m: f64| {
        // The plane normal . p = offset cut with the scan plane, in S.
        let n = rotation.inverse() * normal;
        let in_plane = n.y.hypot(n.z);
        FittedLine {
            normal: NormalLine::new((offset_m - normal.dot(&origin)) / in_plane, n.z.atan2(n.y)),
            points: 100,
            ..FittedLine::default()
        }
    };
    let on_strip = |angle_rad: f64| {
        let ray = rotation * Vector3::new(0.0, angle_rad.cos(), angle_rad.sin());
        if ray.z <= 0.0 {
            return None;
        }
        let p = origin + ray * ((b.dz_m - origin.z) / ray.z);
        if p.y.abs() > b.dy_m / 2.0 {
            return None;
        }
        frame
            .strips_on(Face::Upper)
            .map(|(index, _)| index)
            .find(|index| {
                let strip = &frame.strips[*index];
                let centre = strip.offset_m + strip.inclination_deg.to_radians().tan() * p.x;
                (p.y - centre).abs() <= strip.width_m / 2.0 && p.x.abs() <= b.dx_m / 2.0
            })
    };
    let mut edges = Vec::new();
    let angle = |i: i32| (-5.0 + 0.25 * f64::from(i)).to_radians();
    for i in 1..761 {
        let (before, after) = (on_strip(angle(i - 1)), on_strip(angle(i)));
        let (strip, kind) = match (before, after) {
            (None, Some(strip)) => (strip, EdgeKind::On),
            (Some(strip), None) => (strip, EdgeKind::Off),
            _ => continue,
        };
        edges.push(Edge {
            strip: strip as i32,
            kind,
            from_rad: angle(i - 1),
            to_rad: angle(i),
            ..Edge::default()
        });
    }
    ReflectorLines {
        right: line(Vector3::y(), b.dy_m / 2.0),
        upper: line(Vector3::z(), b.dz_m),
        left: line(-Vector3::y(), b.dy_m / 2.0),
        edges,
        ..ReflectorLines::default()
    }
}

/// Poses as the bench of the estimators has them: x +-50 mm, y +-4 m, z 0.5 to 3.5 m, +-1 deg.
fn poses(count: usize, seed: u64) -> Vec<([f64; 3], [f64; 3])> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let unit = Uniform::new(-1.0f64, 1.0).unwrap();
    let mut draw = |scale: f64| scale * unit.sample(&mut rng);
    let degree = 1f64.to_radians();
    (0..count)
        .map(|_| {
            (
                [draw(0.05), draw(4.0), 2.0 + draw(1.5)],
                [draw(degree), draw(degree), draw(degree)],
            )
        })
        .collect()
}

#[test]
fn the_true_pose_is_in_the_winning_cells() {
    let frame = cablar();
    for (position_m, rotation_rad) in poses(40, 1) {
        let lines = ideal(&frame, position_m, rotation_rad);
        assert_eq!(lines.edges.len(), 8);
        let corner_m = corner_m(&lines.upper, &lines.right);
        let crossings = crossings(&lines, &frame, corner_m).unwrap();
        let yaw = rotation_rad[2];
        let (low, high) = yaw_interval(&crossings).unwrap();
        assert!(
            (low - 1e-9..=high + 1e-9).contains(&yaw),
            "{low} {yaw} {high}"
        );
        // All eight edges hold at the truth.
        let x = position_m[0] + (5.5 - position_m[2]) * rotation_rad[1].tan() * yaw.cos()
            - corner_m * yaw.sin();
        for crossing in &crossings {
            let (low, high) = crossing.corner_x_m(yaw.sin_cos()).unwrap();
            assert!((low - 1e-9..=high + 1e-9).contains(&x), "{low} {x} {high}");
        }
    }
}

#[test]
fn y_z_and_roll_are_exact() {
    let mut frame = cablar();
    frame.scanner.position_m = [0.1, -0.05, 0.2];
    for (position_m, rotation_rad) in poses(40, 2) {
        let lines = ideal(&frame, position_m, rotation_rad);
        let pose = solve(&lines, &frame, rotation_rad[1]).unwrap();
        assert!((pose.rotation_rad[0] - rotation_rad[0]).abs() < 1e-9);
        // y depends on yaw, whose error is a tenth of a degree, in second order, and on the
        // lever arm in first.
        assert!(
            (pose.position_m[1] - position_m[1]).abs() < 2e-3,
            "{pose:?}"
        );
        assert!(
            (pose.position_m[2] - position_m[2]).abs() < 1e-9,
            "{pose:?}"
        );
    }
}

#[test]
fn a_mounting_is_taken_out() {
    let mut frame = cablar();
    frame.scanner.rotation_deg = [0.3, -0.4, 0.5];
    let straight = cablar();
    for (position_m, rotation_rad) in poses(20, 3) {
        let [roll, pitch, yaw] = rotation_rad;
        let scanner = Rotation3::from_euler_angles(roll, pitch, yaw) * mounting(&frame);
        let (r, p, w) = scanner.euler_angles();
        let lines = ideal(&straight, position_m, [r, p, w]);
        let (Ok(pose), Ok(plain)) = (solve(&lines, &frame, pitch), solve(&lines, &straight, p))
        else {
            continue;
        };
        // The platform's yaw is left out of the pitch: 1 deg by 0.3 deg of mounting, 0.01 deg.
        assert!((pose.rotation_rad[0] - roll).abs() < 2e-4, "{pose:?}");
        assert!((pose.position_m[0] - plain.position_m[0]).abs() < 1e-3);
        let yaw_error = pose.rotation_rad[2] - yaw;
        assert!((yaw_error - (plain.rotation_rad[2] - w)).abs() < 2e-4);
    }
}

/// The figures of a published-method re-creation: 3.94 mm rms in x and 0.102 deg in yaw.
#[test]
fn noise_free_scans_reach_the_published_figures() {
    let frame = cablar();
    let (mut x2, mut yaw2, mut x_max) = (0.0, 0.0, 0.0f64);
    let all = poses(400, 4);
    for (position_m, rotation_rad) in &all {
        let lines = ideal(&frame, *position_m, *rotation_rad);
        let pose = solve(&lines, &frame, rotation_rad[1]).unwrap();
        assert_eq!((pose.votes, pose.edges), (8, 8));
        let x = pose.position_m[0] - position_m[0];
        x2 += x * x;
        x_max = x_max.max(x.abs());
        yaw2 += (pose.rotation_rad[2] - rotation_rad[2]).powi(2);
    }
    let n = all.len() as f64;
    let (x_mm, yaw_deg) = (1e3 * (x2 / n).sqrt(), (yaw2 / n).sqrt().to_degrees());
    assert!((3.5..4.4).contains(&x_mm), "{x_mm}");
    assert!((0.09..0.115).contains(&yaw_deg), "{yaw_deg}");
    assert!(x_max < 0.02, "{x_max}");
}

/// Counting by the ends of intervals is the same as visiting every cell.
#[test]
fn the_count_is_that_of_all_cells() {
    let frame = cablar();
    let (position_m, rotation_rad) = poses(1, 5)[0];
    let mut lines = ideal(&frame, position_m, rotation_rad);
    // One edge that contradicts the others, so that the winners have fewer votes.
    lines.edges[3].from_rad += 0.03;
    lines.edges[3].to_rad += 0.03;
    let crossings = crossings(&lines, &frame, corner_m(&lines.upper, &lines.right)).unwrap();
    let yaw_rad = (-0.02, 0.02);
    let winners = count(&crossings, yaw_rad).unwrap();
    let (x_low, x_high) = first_edge_interval(&crossings[0], yaw_rad).unwrap();
    let (mut most, mut cells, mut sum_x, mut sum_yaw) = (0, 0.0, 0.0, 0.0);
    let mut yaw = yaw_rad.0;
    for column in 0.. {
        if yaw > yaw_rad.1 {
            break;
        }
        let mut row = 0;
        while x_low + f64::from(row) * X_STEP_M <= x_high {
            let x = x_low + f64::from(row) * X_STEP_M;
            let (sin, cos) = yaw.sin_cos();
            let votes = crossings
                .iter()
                .filter(|c| {
                    // Where the line from (x, dy/2) along (sin, -cos) meets the edge (eq. 3.99).
                    let t = (c.from_wall_m - c.slope * x) / (cos + c.slope * sin);
                    (c.near_m..=c.far_m).contains(&t)
                })
                .count();
            if votes > most {
                (most, cells, sum_x, sum_yaw) = (votes, 0.0, 0.0, 0.0);
            }
            if votes == most {
                cells += 1.0;
                sum_x += x;
                sum_yaw += yaw;
            }
            row += 1;
        }
        yaw = yaw_rad.0 + f64::from(column + 1) * YAW_STEP_RAD;
    }
    assert_eq!(winners.votes as usize, most);
    assert!(most < 8);
    assert!((winners.corner_x_m - sum_x / cells).abs() < 1e-6);
    assert!((winners.yaw_rad - sum_yaw / cells).abs() < 1e-7);
}

#[test]
fn what_is_missing_has_a_name() {
    let frame = cablar();
    let whole = ideal(&frame, [0.0, 0.0, 2.0], [0.0; 3]);
    let mut lines = whole.clone();
    lines.edges.pop();
    let failure = solve(&lines, &frame, 0.0).unwrap_err();
    assert_eq!(
        failure,
        VoteFailure::Transitions {
            found: 7,
            needed: 8
        }
    );
    assert_eq!(
        pose(&lines, &frame, 0.0).status,
        Status::NO_POSE | Status::FEW_EDGES
    );
    let mut lines = whole.clone();
    lines.edges.push(lines.edges[0]);
    assert!(matches!(
        solve(&lines, &frame, 0.0),
        Err(VoteFailure::Transitions { found: 7, .. })
    ));
    let mut lines = whole.clone();
    lines.left = FittedLine::default();
    assert_eq!(
        solve(&lines, &frame, 0.0),
        Err(VoteFailure::NoLine(Face::Left))
    );
    let mut lines = whole.clone();
    for edge in &mut lines.edges {
        std::mem::swap(&mut edge.from_rad, &mut edge.to_rad);
    }
    assert_eq!(solve(&lines, &frame, 0.0), Err(VoteFailure::Contradiction));
    let mut plain = frame.clone();
    plain.strips.clear();
    assert_eq!(solve(&whole, &plain, 0.0), Err(VoteFailure::NoStrips));
    assert!(pose(&whole, &frame, 0.0).is_solved());
}
