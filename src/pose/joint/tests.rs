use super::state::threshold_mean;
use super::*;
use crate::motion::{self, Motion, State};
use crate::pose::staged::{errors, known, lines_of};
use crate::record::{EdgeKind, Face, Stamp};
use crate::simulate::staged::{frame, scattered};
use crate::simulate::{Course, Seed, Setup, Simulator, Step};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

fn solve(lines: &ReflectorLines, frame: &Frame, pitch: Option<Pitch>, options: &Options) -> Pose {
    Estimator::new(frame, *options).solve(lines, pitch, &[])
}

#[test]
fn threshold_of_half_the_spot_is_no_offset() {
    assert!(threshold_mean(0.5).abs() < 1e-12);
    // Share 0.4: hits begin with the centre further outside.
    let q = threshold_mean(0.4);
    assert!((q - 0.158).abs() < 0.002, "{q}");
    assert!((threshold_mean(0.6) + q).abs() < 1e-9);
}

/// The walls' distance also tells |yaw|, this well a wall.
const WALL_SIGMA_M: f64 = 0.001;

/// Mean and covariance of (x, yaw) by brute force: the cells of a fine grid, weighted by how far
/// they satisfy all softened intervals at the true y, z, roll and pitch, and by the distance between
/// the walls.
fn exact_posterior(frame: &Frame, step: &Step, lines: &ReflectorLines) -> [f64; 4] {
    let [x0, y, z] = step.truth.position_m;
    let [roll, pitch, yaw0] = step.truth.rotation_rad;
    let below = |v: f64| 0.5 * libm::erfc(-v * std::f64::consts::FRAC_1_SQRT_2);
    let (mut n, mut sums) = (0.0, [0.0; 4]);
    for i in -80..=80 {
        for j in -80..=80 {
            let (x, yaw) = (x0 + 0.0005 * f64::from(i), yaw0 + 0.0002 * f64::from(j));
            let pose = ScannerPose::new(frame, [x, y, z], [roll, pitch, yaw]);
            let satisfied: f64 = lines
                .edges
                .iter()
                .map(|edge| {
                    let strip = &frame.strips[edge.strip as usize];
                    let side = if edge.kind == EdgeKind::On { 0.5 } else { -0.5 };
                    let g = |angle: f64| {
                        let p = pose.crossing(angle, Face::Upper).unwrap().point_m;
                        p[1] - strip.offset_m - side * strip.width_m - strip.slope() * p[0]
                    };
                    let (from_m, to_m) = (g(edge.from_rad), g(edge.to_rad));
                    let width_m = from_m - to_m;
                    // 0.1 mm, and a share of the spot's radius seen on the face.
                    let radius_m = width_m * edge.d_threshold / (edge.to_rad - edge.from_rad);
                    let soft_m = f64::hypot(0.0001, 0.018 * radius_m);
                    let within = |more_m: f64| {
                        below((from_m + more_m) / soft_m) - below((to_m - more_m) / soft_m)
                    };
                    0.9997 * within(0.0) + 0.0003 * within(width_m)
                })
                .product();
            let walls_m = [Face::Right, Face::Left].map(|face| pose.line(face).normal.d_m);
            let off_m = lines.right.normal.d_m + lines.left.normal.d_m - walls_m[0] - walls_m[1];
            let wall = (-0.5 * off_m * off_m / (2.0 * WALL_SIGMA_M * WALL_SIGMA_M)).exp();
            let weight = satisfied * wall;
            n += weight;
            let (dx, dyaw) = (x - x0, yaw - yaw0);
            for (sum, value) in sums.iter_mut().zip([dx, dyaw, dx * dx, dyaw * dyaw]) {
                *sum += weight * value;
            }
        }
    }
    let [dx, dyaw, xx, yy] = sums.map(|sum| sum / n);
    [
        x0 + dx,
        yaw0 + dyaw,
        (xx - dx * dx).sqrt(),
        (yy - dyaw * dyaw).sqrt(),
    ]
}

#[test]
fn the_estimate_is_the_mean_of_the_exact_posterior() {
    let frame = frame(&[]);
    let steps = scattered(&frame, "none", 40, [0.5, 3.5], 31);
    let mut off = (0.0, 0.0);
    let mut spread = (0.0, 0.0);
    let mut n = 0.0;
    for step in &steps {
        let mut lines = lines_of(&frame, step);
        for line in [&mut lines.right, &mut lines.upper, &mut lines.left] {
            line.cov_dd = 1e-8;
            line.cov_da = 0.0;
            line.cov_aa = 1e-10;
        }
        // Their angles would tell yaw times pitch, which the brute force does not know.
        for wall in [&mut lines.right, &mut lines.left] {
            wall.cov_dd = WALL_SIGMA_M * WALL_SIGMA_M;
            wall.cov_aa = 1e-5;
        }
        lines.joint_cov.clear();
        let options = Options {
            threshold_sigma: 1e-4,
            ..Options::default()
        };
        let pose = solve(&lines, &frame, known(step), &options);
        let [x, yaw, x_sd, yaw_sd] = exact_posterior(&frame, step, &lines);
        n += 1.0;
        off.0 += ((pose.position_m[0] - x) / x_sd).powi(2);
        off.1 += ((pose.rotation_rad[2] - yaw) / yaw_sd).powi(2);
        spread.0 += pose.cov(0, 0).sqrt() / x_sd;
        spread.1 += pose.cov(5, 5).sqrt() / yaw_sd;
    }
    // In units of the posterior's own width.
    assert!((off.0 / n).sqrt() < 0.25, "x off {}", (off.0 / n).sqrt());
    assert!((off.1 / n).sqrt() < 0.25, "yaw off {}", (off.1 / n).sqrt());
    assert!(
        (spread.0 / n - 1.0).abs() < 0.12,
        "x spread {}",
        spread.0 / n
    );
    assert!(
        (spread.1 / n - 1.0).abs() < 0.12,
        "yaw spread {}",
        spread.1 / n
    );
}

#[test]
fn covariance_is_honest() {
    let frame = frame(&[]);
    for effects in [
        "reference,-remission",
        "reference,mixed,-remission",
        "reference,mixed",
    ] {
        let steps = scattered(&frame, effects, 500, [0.5, 3.5], 32);
        let mut nees = [0.0; 6];
        for step in &steps {
            let pose = solve(
                &lines_of(&frame, step),
                &frame,
                known(step),
                &Options::default(),
            );
            assert!(pose.is_solved(), "{}", pose.status);
            for (k, e) in errors(step, &pose).into_iter().enumerate() {
                nees[k] += e * e / pose.cov(k, k) / steps.len() as f64;
            }
        }
        for k in [0, 1, 2, 3, 5] {
            assert!(nees[k] > 0.75 && nees[k] < 1.35, "{effects}: {k}: {nees:?}");
        }
    }
}

#[test]
fn pitch_moves_x_and_its_variance_says_so() {
    let frame = frame(&[]);
    let sigma = 0.5f64.to_radians();
    for step in &scattered(&frame, "reference", 30, [0.5, 3.5], 33) {
        let lines = lines_of(&frame, step);
        let exact = solve(&lines, &frame, known(step), &Options::default());
        let imu = known(step).map(|pitch| Pitch {
            sigma_rad: sigma,
            ..pitch
        });
        let wide = solve(&lines, &frame, imu, &Options::default());
        let height_m = frame.bounds.dz_m - exact.position_m[2];
        // dx = -h dtheta: 0.5 deg at 3 m is 26 mm. With roll and yaw the edges tell a little of the
        // pitch, so that less may remain, never more.
        let expected = (height_m * sigma).powi(2) + exact.cov(0, 0);
        let ratio = wide.cov(0, 0) / expected;
        assert!(ratio > 0.4 && ratio < 1.05, "{ratio}");
        assert!(wide.cov(0, 4) < 0.0, "{}", wide.cov(0, 4));
    }
}

/// Means of e'P^-1 e over its degrees of freedom for x, pitch and the pair of them, with a pitch
/// that is wrong by `sigma_deg`.
fn nees_with_pitch(sigma_deg: f64, effects: &str, seed: u64) -> [f64; 3] {
    let frame = frame(&[]);
    let sigma_rad = sigma_deg.to_radians();
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let steps = scattered(&frame, effects, 600, [0.5, 3.5], seed);
    let mut sums = [0.0; 3];
    for step in &steps {
        let z: f64 = StandardNormal.sample(&mut random);
        let imu = Pitch::within(step.truth.rotation_rad[1] + sigma_rad * z, sigma_rad);
        let lines = lines_of(&frame, step);
        let pose = solve(&lines, &frame, Some(imu), &Options::default());
        let e = errors(step, &pose);
        let p = nalgebra::Matrix2::new(
            pose.cov(0, 0),
            pose.cov(0, 4),
            pose.cov(0, 4),
            pose.cov(4, 4),
        );
        let pair = nalgebra::Vector2::new(e[0], e[4]);
        let nees = [
            e[0] * e[0] / p[(0, 0)],
            e[4] * e[4] / p[(1, 1)],
            0.5 * pair.dot(&(p.cholesky().expect("positive definite").solve(&pair))),
        ];
        for (sum, nees) in sums.iter_mut().zip(nees) {
            *sum += nees / steps.len() as f64;
        }
    }
    sums
}

#[test]
fn what_a_wrong_pitch_does_to_x_is_in_the_covariance() {
    for (sigma_deg, effects, seed) in [
        (0.5, "reference", 41),
        (0.5, "reference,mixed", 42),
        (0.1, "reference", 43),
    ] {
        let nees = nees_with_pitch(sigma_deg, effects, seed);
        for value in nees {
            assert!(
                (0.8..1.3).contains(&value),
                "{sigma_deg} {effects}: {nees:?}"
            );
        }
    }
}

/// A platform that nods in one place.
struct Nodding {
    at: motion::Pose,
    amplitude_rad: f64,
    per_s: f64,
}

impl Motion for Nodding {
    fn at(&self, t_s: f64) -> State {
        let mut state = State::resting(self.at);
        let (sin, cos) = (self.per_s * t_s).sin_cos();
        state.rotation_rad.y += self.amplitude_rad * sin;
        state.rotation_rate_rad_s.y += self.amplitude_rad * self.per_s * cos;
        state
    }

    fn duration_s(&self) -> f64 {
        1e3
    }
}

#[test]
fn each_edge_has_the_pitch_of_its_own_instant() {
    let frame = frame(&[]);
    let nodding = || {
        Box::new(Nodding {
            at: motion::Pose {
                position_m: nalgebra::Vector3::new(0.01, 1.2, 1.5),
                rotation_rad: nalgebra::Vector3::new(0.004, 0.0, -0.006),
            },
            amplitude_rad: 1.5f64.to_radians(),
            per_s: 2.0 * std::f64::consts::PI * 5.3,
        })
    };
    let course = Course::Moving {
        truth: nodding(),
        desired: nodding(),
        lag_s: 0.0,
    };
    let mut simulator = Simulator::new(Setup {
        effects: "reference,motion".parse().unwrap(),
        seed: Seed(44),
        scans: Some(200),
        ..Setup::new(frame.clone(), course)
    });
    let (mut frozen, mut followed, mut n) = ([0.0; 2], [0.0; 2], 0.0);
    while let Some(step) = simulator.advance() {
        let lines = lines_of(&frame, step);
        let pitch_at = |t_s: f64| nodding().at(t_s).rotation_rad.y;
        let reference_s = lines.stamp.since_s(Stamp::from_ns(0));
        let changes_rad: Vec<f64> = lines
            .edges
            .iter()
            .map(|edge| pitch_at(reference_s + edge.time_s) - pitch_at(reference_s))
            .collect();
        let options = Options::default();
        for (sums, changes_rad) in [(&mut frozen, &[][..]), (&mut followed, &changes_rad[..])] {
            let pose = Estimator::new(&frame, options).solve(&lines, known(step), changes_rad);
            let e = errors(step, &pose);
            sums[0] += e[0] * e[0];
            sums[1] += e[5] * e[5];
        }
        n += 1.0;
    }
    let rms = |sums: [f64; 2]| sums.map(|sum| (sum / n).sqrt());
    let (frozen, followed) = (rms(frozen), rms(followed));
    assert!(
        followed[1] < 0.6 * frozen[1] && followed[1] < 0.11f64.to_radians(),
        "yaw {followed:?}, frozen {frozen:?}"
    );
}

#[test]
fn without_an_imu_the_platform_is_level_and_x_uncertain() {
    let frame = frame(&[]);
    let step = &scattered(&frame, "reference", 1, [2.0, 2.1], 34)[0];
    let lines = lines_of(&frame, step);
    let level = Some(Pitch::exact(0.0));
    let (given, assumed) = (
        solve(&lines, &frame, level, &Options::default()),
        solve(&lines, &frame, None, &Options::default()),
    );
    assert_eq!(given.components(), assumed.components());
    assert!(assumed.status.has(Status::NO_IMU));
    let moved_m = (frame.bounds.dz_m - given.position_m[2]) * 1f64.to_radians();
    assert!((assumed.cov(0, 0).sqrt() / moved_m - 1.0).abs() < 0.1);
}

#[test]
fn strips_on_the_walls_tell_the_pitch() {
    let text = include_str!("../../../testdata/inclined.toml");
    let frame = Frame::parse(text, std::path::Path::new("inclined.toml")).unwrap();
    let (mut sum, mut nees) = (0.0, 0.0);
    let steps = scattered(&frame, "reference", 150, [0.8, 3.5], 35);
    for step in &steps {
        let pose = solve(&lines_of(&frame, step), &frame, None, &Options::default());
        let e = errors(step, &pose)[4];
        sum += e * e;
        nees += e * e / pose.cov(4, 4);
    }
    let rms_deg = (sum / steps.len() as f64).sqrt().to_degrees();
    assert!(rms_deg < 0.12, "{rms_deg}");
    assert!(nees / (steps.len() as f64) < 1.5, "{nees}");
}

#[test]
fn lines_of_no_pose_are_said_to_disagree() {
    let frame = frame(&[]);
    let step = &scattered(&frame, "reference", 1, [2.0, 2.1], 38)[0];
    let mut lines = lines_of(&frame, step);
    assert!(
        solve(&lines, &frame, known(step), &Options::default())
            .status
            .is_ok()
    );
    // A wall taken for the surface 0.7 m behind it.
    lines.right.normal.d_m += 0.7;
    let pose = solve(&lines, &frame, known(step), &Options::default());
    assert!(pose.status.has(Status::DISAGREE), "{}", pose.status);
}

#[test]
fn an_edge_that_contradicts_the_rest_is_left_out() {
    let frame = frame(&[]);
    for step in &scattered(&frame, "reference,-remission", 20, [1.0, 3.0], 36) {
        let mut lines = lines_of(&frame, step);
        let clean = solve(&lines, &frame, known(step), &Options::default());
        for edge in &mut lines.edges[3..4] {
            edge.from_rad += 0.04;
            edge.to_rad += 0.04;
        }
        let pose = solve(&lines, &frame, known(step), &Options::default());
        assert!(pose.status.has(Status::EDGE_OUTLIER), "{}", pose.status);
        assert_eq!(pose.edges, 7);
        assert!((pose.position_m[0] - clean.position_m[0]).abs() < 0.025);
    }
}

#[test]
fn a_sub_beam_edge_that_contradicts_the_rest_falls_back_to_its_interval() {
    let frame = frame(&[]);
    for step in &scattered(&frame, "reference", 20, [1.0, 3.0], 39) {
        let mut lines = lines_of(&frame, step);
        let clean = solve(&lines, &frame, known(step), &Options::default());
        assert!(clean.status.is_ok(), "{}", clean.status);
        let mut between = lines.edges.iter_mut().filter(|e| e.edge_rad.is_finite());
        between.next().unwrap().edge_rad += 0.008;
        let pose = solve(&lines, &frame, known(step), &Options::default());
        assert!(pose.status.has(Status::EDGE_OUTLIER), "{}", pose.status);
        assert_eq!(pose.edges, clean.edges);
        let moved_m = (pose.position_m[0] - clean.position_m[0]).abs();
        assert!(moved_m < 4.0 * clean.cov(0, 0).sqrt(), "{moved_m}");
    }
}

#[test]
fn what_was_not_seen_is_said() {
    let frame = frame(&[]);
    let step = &scattered(&frame, "reference", 1, [2.0, 2.1], 37)[0];
    let lines = lines_of(&frame, step);
    let solve = |lines: &ReflectorLines| solve(lines, &frame, known(step), &Options::default());
    let few = ReflectorLines {
        edges: lines.edges[..3].to_vec(),
        ..lines.clone()
    };
    assert!(solve(&few).status.has(Status::FEW_EDGES));
    let none = ReflectorLines {
        edges: Vec::new(),
        ..lines.clone()
    };
    let pose = solve(&none);
    assert!(pose.status.has(Status::NO_EDGES | Status::NO_YAW));
    // A number there would be the prior's, not a measurement.
    assert!(pose.position_m[0].is_nan() && pose.rotation_rad[2].is_nan());
    assert!(pose.cov(0, 0).is_nan() && pose.cov(5, 5).is_nan() && pose.cov(1, 1) > 0.0);
    assert!((pose.position_m[1] - step.truth.position_m[1]).abs() < 0.01);
    let one_wall = ReflectorLines {
        left: Default::default(),
        ..lines.clone()
    };
    let pose = solve(&one_wall);
    assert!(pose.status.has(Status::ONE_WALL) && pose.is_solved());
    assert!((pose.position_m[1] - step.truth.position_m[1]).abs() < 0.06);
    let no_ceiling = ReflectorLines {
        upper: Default::default(),
        ..lines.clone()
    };
    let pose = solve(&no_ceiling);
    assert!(pose.status.has(Status::NO_UPPER) && !pose.is_solved());
}
