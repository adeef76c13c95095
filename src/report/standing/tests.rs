//! Standstills of runs whose truth is known.

use super::*;
use crate::record::upper_index;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

const RATE_HZ: f64 = 35.0;

/// How the poses of a run err.
#[derive(Clone, Copy)]
struct Errors {
    /// Standard deviation of what changes from pose to pose, m and rad.
    white: [f64; 6],
    /// Correlation from pose to pose.
    memory: f64,
    /// Standard deviation of what stays while the platform stands.
    fixed: [f64; 6],
}

const USUAL: Errors = Errors {
    white: [9e-4, 4e-4, 6e-4, 1.4e-4, 1e-4, 4e-4],
    memory: 0.0,
    fixed: [0.0; 6],
};

fn pose(stamp: Stamp, value: [f64; 6], errors: &Errors) -> Pose {
    let mut pose = Pose {
        stamp,
        position_m: [value[0], value[1], value[2]],
        rotation_rad: [value[3], value[4], value[5]],
        ..Pose::default()
    };
    for k in 0..6 {
        pose.covariance[upper_index(6, k, k)] = errors.white[k].powi(2) + errors.fixed[k].powi(2);
    }
    pose
}

/// Stands at each place for `stand_s`, and goes smoothly (quintic) to the next in `move_s`.
fn run(places: &[[f64; 6]], stand_s: f64, move_s: f64, errors: &Errors, seed: u64) -> Vec<Pose> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut normal = move || -> f64 { StandardNormal.sample(&mut random) };
    let mut poses = Vec::new();
    let mut state = [0.0; 6];
    for s in &mut state {
        *s = normal();
    }
    let drive = (1.0 - errors.memory * errors.memory).sqrt();
    let mut stays: [f64; 6] = std::array::from_fn(|k| errors.fixed[k] * normal());
    let whole_s = stand_s + move_s;
    let count = (RATE_HZ * (whole_s * places.len() as f64 - move_s)) as usize;
    let mut last = 0;
    for i in 0..count {
        let t_s = i as f64 / RATE_HZ;
        let at = (t_s / whole_s) as usize;
        if at != last {
            last = at;
            stays = std::array::from_fn(|k| errors.fixed[k] * normal());
        }
        let u = ((t_s - at as f64 * whole_s - stand_s) / move_s).clamp(0.0, 1.0);
        let share = u * u * u * (10.0 - 15.0 * u + 6.0 * u * u);
        let (from, to) = (places[at], *places.get(at + 1).unwrap_or(&places[at]));
        let value = std::array::from_fn(|k| {
            state[k] = errors.memory * state[k] + drive * normal();
            from[k] + share * (to[k] - from[k]) + errors.white[k] * state[k] + stays[k]
        });
        let stamp = Stamp::from_ns(1_700_000_000_000_000_000).plus_s(t_s);
        poses.push(pose(stamp, value, errors));
    }
    poses
}

fn places(count: usize) -> Vec<[f64; 6]> {
    let at = |i: usize| {
        let turn = i as f64 * 2.4;
        [
            0.02 * turn.sin(),
            3.0 * turn.cos(),
            2.0 + turn.sin(),
            0.0,
            0.0,
            0.01 * turn.cos(),
        ]
    };
    (0..count).map(at).collect()
}

/// How the errors of means compare with their stated sigmas, over all components of all standstills.
struct Coverage {
    /// Share of the true places within 1.96 sigmas.
    within: f64,
    /// Root of the mean squared sigma over the root of the mean squared error, both in units of the
    /// component's white noise: 1 where they are honest, above where they are too cautious.
    caution: f64,
}

/// Over `runs` runs of so many standstills.
fn coverage(errors: &Errors, runs: u64, standstills: usize, stand_s: f64) -> Coverage {
    let places = places(standstills);
    let (mut within, mut all, mut sigmas, mut squares) = (0, 0, 0.0, 0.0);
    for seed in 0..runs {
        let poses = run(&places, stand_s, 1.5, errors, seed);
        let found = find(&poses, &Criteria::default(), None);
        assert_eq!(found.standing.len(), places.len(), "seed {seed}: {found:?}");
        for (s, place) in found.standing.iter().zip(&places) {
            for ((c, truth), unit) in s.components.iter().zip(place).zip(errors.white) {
                let error = c.mean - truth;
                all += 1;
                within += usize::from(error.abs() <= 1.96 * c.sigma);
                sigmas += (c.sigma / unit).powi(2);
                squares += (error / unit).powi(2);
            }
        }
    }
    Coverage {
        within: within as f64 / f64::from(all),
        caution: (sigmas / squares).sqrt(),
    }
}

/// 1440 cases each, of which 95 % should be covered (binomial standard deviation 0.6 %). Noise alone
/// must not be taken for something that stays, white or not.
#[test]
fn noise_alone_is_covered_as_often_as_it_should_be() {
    for (memory, stand_s) in [(0.0, 2.0), (0.5, 3.0), (0.7, 4.0)] {
        let errors = Errors { memory, ..USUAL };
        let found = coverage(&errors, 40, 6, stand_s);
        let Coverage { within, caution } = found;
        assert!(
            (0.93..=0.995).contains(&within),
            "{memory}: {within} {caution}"
        );
        assert!(
            (0.9..=1.6).contains(&caution),
            "{memory}: {within} {caution}"
        );
    }
    // Of a single standstill less is known, and cannot be: it stays on the honest side.
    let found = coverage(&USUAL, 120, 1, 4.0);
    assert!((0.94..=1.0).contains(&found.within), "{}", found.within);
    assert!(found.caution < 1.9, "{}", found.caution);
}

/// Parts that stay, from 5 to 90 % of the variance.
#[test]
fn what_stays_is_covered_too() {
    let fixed = Errors {
        fixed: [2e-3, 2e-4, 6e-4, 1e-4, 3e-4, 1e-4],
        ..USUAL
    };
    let found = coverage(&fixed, 40, 6, 2.0);
    assert!((0.88..=0.985).contains(&found.within), "{}", found.within);
    // The usual formula, scatter over the root of n, does not.
    let places = places(6);
    let mut within = 0;
    for seed in 0..40 {
        let poses = run(&places, 2.0, 1.5, &fixed, seed);
        let found = find(&poses, &Criteria::default(), None);
        for (s, place) in found.standing.iter().zip(&places) {
            let c = &s.components[0];
            let naive = c.scatter / (s.poses as f64).sqrt();
            within += usize::from((c.mean - place[0]).abs() <= 1.96 * naive);
        }
    }
    assert!(within < 240 / 2, "{within} of 240");
}

/// Both parts come out as they were put in.
#[test]
fn what_stays_is_told_from_what_averages_out() {
    let errors = Errors {
        fixed: [3e-3; 6],
        ..USUAL
    };
    let found = find(
        &run(&places(3), 6.0, 1.5, &errors, 1),
        &Criteria::default(),
        None,
    );
    for s in &found.standing {
        let x = &s.components[0];
        assert!((x.fixed / 3e-3 - 1.0).abs() < 0.1, "{x:?}");
        assert!((x.scatter / 9e-4 - 1.0).abs() < 0.25, "{x:?}");
        assert!(x.averaging < 2.5e-4 && x.sigma > 2.9e-3, "{x:?}");
        assert!((s.duration_s() - 6.0).abs() < 0.6, "{}", s.duration_s());
    }
}

#[test]
fn standstills_are_where_the_platform_stands() {
    let found = find(
        &run(&places(5), 1.0, 2.0, &USUAL, 3),
        &Criteria::default(),
        None,
    );
    assert_eq!(found.standing.len(), 5);
    for (i, s) in found.standing.iter().enumerate() {
        let from_s = s.first.since_s(found.start);
        // A quintic of 2 s over metres moves a millimetre in its first 0.15 s.
        assert!((from_s - 3.0 * i as f64).abs() < 0.3, "{i}: {from_s}");
        assert!(
            s.duration_s() > 0.7 && s.duration_s() < 1.5,
            "{}",
            s.duration_s()
        );
    }
    // 0.2 s is too short.
    assert!(
        find(
            &run(&places(5), 0.2, 2.0, &USUAL, 3),
            &Criteria::default(),
            None
        )
        .standing
        .is_empty()
    );
}

#[test]
fn neither_a_loop_nor_a_creep_stands() {
    let moving = |position: &dyn Fn(f64) -> [f64; 6]| -> Vec<Pose> {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let at = |i: u32| {
            let t_s = f64::from(i) / RATE_HZ;
            let truth = position(t_s);
            let value = std::array::from_fn(|k| {
                let normal: f64 = StandardNormal.sample(&mut random);
                truth[k] + USUAL.white[k] * normal
            });
            pose(Stamp::from_ns(0).plus_s(t_s), value, &USUAL)
        };
        (0..1400).map(at).collect()
    };
    let circle = |t: f64| {
        [
            0.0,
            2.0 * (1.5 * t).sin(),
            2.0 + (1.5 * t).cos(),
            0.0,
            0.0,
            0.0,
        ]
    };
    let found = find(&moving(&circle), &Criteria::default(), None);
    assert!(found.standing.is_empty(), "{found:?}");
    let creep = |t: f64| [0.0, 0.003 * t, 2.0, 0.0, 0.0, 0.0];
    let found = find(&moving(&creep), &Criteria::default(), None);
    assert!(found.standing.is_empty(), "{found:?}");
    // A step of 10 mm parts two standstills.
    let step = |t: f64| [0.0, if t < 20.0 { 0.0 } else { 0.01 }, 2.0, 0.0, 0.0, 0.0];
    let found = find(&moving(&step), &Criteria::default(), None);
    assert_eq!(found.standing.len(), 2, "{found:?}");
    for (s, y) in found.standing.iter().zip([0.0, 0.01]) {
        assert!((s.components[1].mean - y).abs() < 3e-4, "{s:?}");
        assert!(s.duration_s() > 19.0, "{s:?}");
    }
}

#[test]
fn wrong_poses_and_failures_do_not_matter() {
    let mut poses = run(&places(4), 3.0, 1.5, &USUAL, 9);
    let honest = find(&poses, &Criteria::default(), None);
    for (i, pose) in poses.iter_mut().enumerate() {
        if i % 13 == 5 {
            pose.position_m[1] += 0.4;
        }
        if i % 17 == 3 {
            *pose = Pose {
                stamp: pose.stamp,
                ..Pose::default()
            };
        }
    }
    let found = find(&poses, &Criteria::default(), None);
    assert_eq!(found.standing.len(), honest.standing.len());
    for (a, b) in found.standing.iter().zip(&honest.standing) {
        assert!(a.left_out >= 4, "{}", a.left_out);
        let apart = (a.components[1].mean - b.components[1].mean).abs();
        assert!(apart < 2e-4, "{apart}");
    }
}

#[test]
fn the_correction_leads_home() {
    let poses = run(&places(1), 3.0, 1.0, &USUAL, 2);
    let home = [0.0, 2.5, 2.2, f64::NAN, 0.0, -3.1];
    let found = find(&poses, &Criteria::default(), Some(&Desired::Home(home)));
    let d = found.standing[0].correction.unwrap();
    assert!(
        (d[1] + 0.5).abs() < 1e-3 && (d[2] - 0.2).abs() < 1e-3 && d[3].is_nan(),
        "{d:?}"
    );
    // From 0.01 to -3.1 the short way round.
    assert!((d[5] + 3.11).abs() < 1e-3, "{d:?}");
    assert_eq!(
        statistic(&found, "position.correction_mm").map(|v| v > 500.0),
        Some(true)
    );
    assert!(statistic_exists("yaw.sigma_deg") && !statistic_exists("yaw.sigma_mm"));
    let text = table("run", &found, &Criteria::default(), true);
    assert!(text.contains("to desired") && text.is_ascii(), "{text}");
    let rows = csv(&found);
    let columns = |line: &str| line.split(',').count();
    let widths: Vec<usize> = rows.lines().map(columns).collect();
    assert_eq!(widths, vec![60, 60]);
}

#[test]
fn nothing_comes_of_nothing() {
    for poses in [
        Vec::new(),
        vec![Pose::default(); 3],
        run(&places(1), 0.1, 1.0, &USUAL, 1),
    ] {
        let found = find(&poses, &Criteria::default(), None);
        assert!(found.standing.is_empty());
        assert!(table("run", &found, &Criteria::default(), false).contains("0 of at least"));
    }
    // Without covariances the scatter has to do.
    let mut poses = run(&places(3), 2.0, 1.5, &USUAL, 4);
    for pose in &mut poses {
        pose.covariance = [f64::NAN; 21];
    }
    let found = find(&poses, &Criteria::default(), None);
    assert_eq!(found.standing.len(), 3);
    assert!(found.without_covariance && found.standing[0].components[0].fixed == 0.0);
}
