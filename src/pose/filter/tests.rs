use super::chain::{Chain, EdgeBox, EdgeName, Node, Point};
use super::*;
use crate::motion::Gait;
use crate::pose::interval::BoxFactor;
use crate::pose::joint::{X, Y};
use crate::pose::staged::{errors, known, lines_of};
use crate::record::{EdgeKind, Face};
use crate::simulate::staged::{frame, scattered};
use crate::simulate::{Course, Scatter, Seed, Setup, Simulator, Step as Scan};
use nalgebra::{Matrix2, Vector2};
use state::VELOCITY;

const DT: f64 = 1.0 / 35.0;

fn unit(k: usize) -> State {
    let mut row = State::zeros();
    row[k] = 1.0;
    row
}

fn moving(psd: f64) -> Step {
    Step {
        span_s: DT,
        gaits: [Gait::Moving { psd }; 6],
    }
}

const RESTING: Step = Step {
    span_s: DT,
    gaits: [Gait::Rest; 6],
};

fn wide() -> Gaussian<N> {
    Gaussian::independent([0.0; N], [1.0; N])
}

/// Measurements of y with some white noise, and the filter and smoother of position and velocity as
/// the textbooks have them (Bar-Shalom, Li and Kirubarajan 2001, 5.2.3 and 8.6.2).
#[test]
fn a_linear_gaussian_run_is_the_textbook_filter_and_smoother() {
    let psd = 0.3;
    let (variance, noises) = (1e-4, [0.7, -1.2, 0.4, 1.9, -0.6, -0.3, 1.1, -1.4]);
    let measured: Vec<f64> = noises
        .iter()
        .enumerate()
        .map(|(k, n)| 0.2 + 0.8 * DT * k as f64 + 0.01 * n)
        .collect();
    let mut chain = Chain::new(wide(), Nuisances::default());
    let f = Matrix2::new(1.0, DT, 0.0, 1.0);
    let q = psd * Matrix2::new(DT.powi(3) / 3.0, DT.powi(2) / 2.0, DT.powi(2) / 2.0, DT);
    let (mut m, mut p) = (Vector2::zeros(), Matrix2::identity());
    let mut predicted = Vec::new();
    let mut filtered = Vec::new();
    for (k, value) in measured.iter().enumerate() {
        let point = Point {
            row: unit(Y),
            value: *value,
            variance,
            is_edge: false,
        };
        chain.push(Node::new(moving(psd), vec![point], Vec::new()));
        if k > 0 {
            m = f * m;
            p = f * p * f.transpose() + q;
        }
        predicted.push((m, p));
        let gain = p.column(0) / (p[(0, 0)] + variance);
        m += gain * (value - m[0]);
        p -= gain * p.row(0);
        filtered.push((m, p));
        let newest = chain.newest();
        assert!((newest.mean[Y] - m[0]).abs() < 1e-9);
        assert!((newest.mean[VELOCITY + Y] - m[1]).abs() < 1e-7);
        assert!((newest.covariance[(Y, Y)] / p[(0, 0)] - 1.0).abs() < 1e-7);
        assert!((newest.covariance[(VELOCITY + Y, VELOCITY + Y)] / p[(1, 1)] - 1.0).abs() < 1e-7);
    }
    chain.backward(0.0);
    let smoothed: Vec<_> = chain.nodes().map(|node| *node.smoothed()).collect();
    for k in (0..measured.len()).rev() {
        if k + 1 < measured.len() {
            let (own, own_p) = filtered[k];
            let gain = own_p * f.transpose() * predicted[k + 1].1.try_inverse().unwrap();
            m = own + gain * (m - predicted[k + 1].0);
            p = own_p + gain * (p - predicted[k + 1].1) * gain.transpose();
        }
        assert!((smoothed[k].mean[Y] - m[0]).abs() < 1e-9, "{k}");
        assert!(
            (smoothed[k].covariance[(Y, Y)] / p[(0, 0)] - 1.0).abs() < 1e-6,
            "{k}"
        );
        let velocity = VELOCITY + Y;
        assert!((smoothed[k].mean[velocity] - m[1]).abs() < 1e-7, "{k}");
        let ratio = smoothed[k].covariance[(velocity, velocity)] / p[(1, 1)];
        assert!((ratio - 1.0).abs() < 1e-6, "{k}");
    }
}

/// A box on x (m), between two beams whose angles tell it from others.
fn x_box(low: f64, high: f64) -> EdgeBox {
    let name = EdgeName {
        face: Face::Upper,
        strip: 0,
        kind: EdgeKind::On,
    };
    let factor = BoxFactor {
        row: unit(X),
        low,
        high,
        softness: 2e-4,
        doubt: 0.0,
    };
    EdgeBox::new(name, [1.0 + low, 1.0 + high], factor)
}

fn x_of(state: &Gaussian<N>) -> [f64; 2] {
    [state.mean[X], state.covariance[(X, X)].sqrt()]
}

#[test]
fn boxes_of_a_platform_at_rest_intersect_and_do_not_average() {
    let even = |width: f64| width / 12f64.sqrt();
    let mut chain = Chain::new(wide(), Nuisances::default());
    for _ in 0..70 {
        chain.push(Node::new(RESTING, Vec::new(), vec![x_box(-0.006, 0.010)]));
        chain.trim(8);
    }
    let [mean, sigma] = x_of(chain.newest());
    assert!((mean - 0.002).abs() < 5e-4, "{mean}");
    assert!((sigma / even(0.016) - 1.0).abs() < 0.1, "{sigma}");
    // A larger one says nothing, a smaller one replaces it, one that overlaps cuts.
    chain.push(Node::new(RESTING, Vec::new(), vec![x_box(-0.012, 0.010)]));
    let [_, unmoved] = x_of(chain.newest());
    assert!((unmoved / sigma - 1.0).abs() < 0.02, "{unmoved}");
    chain.push(Node::new(RESTING, Vec::new(), vec![x_box(0.000, 0.010)]));
    let [mean, sigma] = x_of(chain.newest());
    assert!((mean - 0.005).abs() < 5e-4, "{mean}");
    assert!((sigma / even(0.010) - 1.0).abs() < 0.1, "{sigma}");
    chain.push(Node::new(RESTING, Vec::new(), vec![x_box(-0.002, 0.004)]));
    let [mean, sigma] = x_of(chain.newest());
    assert!((mean - 0.002).abs() < 6e-4, "{mean}");
    assert!((sigma / even(0.004) - 1.0).abs() < 0.2, "{sigma}");
}

#[test]
fn of_a_run_of_equal_boxes_the_ends_count() {
    let nuisances = Nuisances::default();
    let pushed = |spans: usize| {
        let mut chain = Chain::new(wide(), nuisances);
        for _ in 0..spans {
            chain.push(Node::new(
                moving(1e-4),
                Vec::new(),
                vec![x_box(-0.006, 0.006)],
            ));
        }
        chain.settle(20);
        x_of(chain.newest())[1]
    };
    // Without the rule the deviation would go on shrinking with every scan.
    let even = 0.012 / 12f64.sqrt();
    for scans in [5, 20, 60] {
        let sigma = pushed(scans);
        assert!(
            sigma > 0.8 * even && sigma < 1.1 * even,
            "{scans}: {}",
            sigma / even
        );
    }
}

#[test]
fn a_trimmed_chain_ends_where_the_whole_one_does() {
    let [mut whole, mut trimmed] = [0, 1].map(|_| Chain::new(wide(), Nuisances::default()));
    for k in 0..40 {
        // x goes on by 3 mm a scan through boxes of 10 mm.
        let low = 0.01 * (0.3 * f64::from(k)).floor();
        for chain in [&mut whole, &mut trimmed] {
            chain.push(Node::new(
                moving(1e-5),
                Vec::new(),
                vec![x_box(low, low + 0.01)],
            ));
        }
        trimmed.settle(2);
        trimmed.trim(12);
    }
    whole.settle(20);
    let ([a, sigma], [b, other]) = (x_of(whole.newest()), x_of(trimmed.newest()));
    assert!((a - b).abs() < sigma, "{a} {b} {sigma}");
    assert!((other / sigma - 1.0).abs() < 0.3, "{sigma} {other}");
}

/// Platforms at rest, `scans_each` scans in each of some poses.
fn standing(frame: &Frame, effects: &str, poses: u64, scans_each: u64, seed: u64) -> Vec<Scan> {
    let course = Course::Stations {
        poses: Scatter::workspace([0.5, 3.5])
            .poses(Seed(seed), poses)
            .into(),
        scans_each,
    };
    let setup = Setup {
        effects: effects.parse().unwrap(),
        seed: Seed(seed),
        ..Setup::new(frame.clone(), course)
    };
    Simulator::new(setup).all()
}

fn filter(frame: &Frame) -> Filter {
    Filter::new(frame, joint::Options::default(), Options::default())
}

/// Mean squared errors of x, y, z, roll and yaw over their variances, and x's own (m^2), over the
/// last scan of every pose.
fn judged(scans: &[Scan], poses: &[Pose], scans_each: usize) -> ([f64; 5], f64) {
    let mut nees = [0.0; 5];
    let mut x = 0.0;
    let ends = scans.chunks(scans_each).zip(poses.chunks(scans_each));
    let n = scans.len() as f64 / scans_each as f64;
    for (scans, poses) in ends {
        let (scan, pose) = (scans.last().unwrap(), poses.last().unwrap());
        let off = errors(scan, pose);
        for (sum, k) in nees.iter_mut().zip([0, 1, 2, 3, 5]) {
            *sum += off[k] * off[k] / pose.cov(k, k) / n;
        }
        x += off[0] * off[0] / n;
    }
    (nees, x)
}

#[test]
fn standing_platforms_get_better_poses_with_honest_covariances() {
    let frame = frame(&[]);
    let scans_each = 20;
    let scans = standing(&frame, "reference,mixed,-remission", 60, scans_each, 5);
    let lines: Vec<_> = scans.iter().map(|scan| lines_of(&frame, scan)).collect();
    let (mut causal, mut alone) = (filter(&frame), Estimator::new(&frame, Default::default()));
    let mut smoother = Smoother::new(&frame, joint::Options::default(), Options::default());
    let [mut filtered, mut single, mut smoothed] = [0; 3].map(|_| Vec::new());
    for (scan, lines) in scans.iter().zip(&lines) {
        filtered.push(causal.take(lines, known(scan), &[]));
        single.push(alone.solve(lines, known(scan), &[]));
        smoother.take(lines, known(scan), &[], |pose| smoothed.push(pose));
    }
    smoother.finish(|pose| smoothed.push(pose));
    assert_eq!(smoothed.len(), scans.len());
    assert!(
        scans
            .iter()
            .zip(&smoothed)
            .all(|(s, p)| s.scan.seq == p.seq)
    );
    assert_eq!((causal.starts(), smoother.starts()), (60, 60));
    let each = scans_each as usize;
    let (nees, x) = judged(&scans, &filtered, each);
    let (smooth_nees, smooth_x) = judged(&scans, &smoothed, each);
    let (_, single_x) = judged(&scans, &single, each);
    // 60 samples: the mean of chi-square over its expectation is within 0.45 to 1.75.
    for nees in nees.iter().chain(&smooth_nees) {
        assert!((0.45..1.75).contains(nees), "{nees}");
    }
    assert!(
        x < 0.5 * single_x && smooth_x < 0.5 * single_x,
        "{x} {smooth_x} {single_x}"
    );
    // White noise would have left a twentieth.
    assert!(x > 0.06 * single_x, "{x} {single_x}");
}

#[test]
fn another_place_and_an_outage_are_new_starts() {
    let frame = frame(&[]);
    let scans = standing(&frame, "reference,-remission", 2, 10, 9);
    let mut filter = filter(&frame);
    let mut lines: Vec<_> = scans.iter().map(|scan| lines_of(&frame, scan)).collect();
    for lines in &mut lines[15..] {
        lines.stamp = lines.stamp.plus_s(3.0);
    }
    let poses: Vec<_> = scans
        .iter()
        .zip(&lines)
        .map(|(scan, lines)| filter.take(lines, known(scan), &[]))
        .collect();
    for (k, pose) in poses.iter().enumerate() {
        let expected = k == 10 || k == 15;
        assert_eq!(pose.status.has(Status::RE_ACQUIRED), expected, "{k}");
        let off = errors(&scans[k], pose);
        assert!(off[1].abs() < 0.003 && off[2].abs() < 0.004, "{k} {off:?}");
    }
    assert_eq!(filter.starts(), 3);
    // A start knows what a single scan knows.
    let sigma = |k: usize| poses[k].cov(1, 1).sqrt();
    assert!(sigma(9) < 0.5 * sigma(10) && sigma(14) < 0.6 * sigma(15));
}

#[test]
fn a_short_outage_widens_and_scans_from_the_past_teach_nothing() {
    let frame = frame(&[]);
    let scans = standing(&frame, "reference,-remission", 1, 12, 3);
    let lines: Vec<_> = scans.iter().map(|scan| lines_of(&frame, scan)).collect();
    let take = |order: &[usize]| {
        let mut filter = filter(&frame);
        let mut last = Pose::default();
        for k in order {
            last = filter.take(&lines[*k], known(&scans[*k]), &[]);
        }
        (last, filter.refused())
    };
    let (plain, refused) = take(&[0, 1, 2, 3, 4, 5]);
    assert_eq!(refused, 0);
    let (again, refused) = take(&[0, 1, 2, 3, 3, 2, 4, 5]);
    assert_eq!(refused, 2);
    assert_eq!(again, plain);
    // A scan that comes twice is solved on its own.
    let (twice, _) = take(&[0, 1, 2, 3, 4, 5, 5]);
    assert!(twice.cov(1, 1) > 2.0 * plain.cov(1, 1));
}

#[test]
fn a_start_and_a_stop_leave_no_lag() {
    // y as a platform that stands, starts with 5 m/s^2 and stops again; the judge sees single scans
    // of 0.43 mm.
    let mut chain = Chain::new(wide(), Nuisances::default());
    let mut gaits = Gaits::new(true);
    let (mut y, mut velocity, sigma) = (0.0, 0.0, 4.3e-4);
    let mut squares = [0.0, 0.0];
    for k in 0..200 {
        let acceleration = match k {
            60..80 => 5.0,
            120..140 => -5.0,
            _ => 0.0,
        };
        velocity += acceleration * DT;
        y += velocity * DT;
        let noise = sigma * [0.3, -1.4, 0.9, 1.3, -0.8, -0.3, 1.2, -1.2][k % 8];
        let mut pose = Pose {
            position_m: [0.0, y + noise, 0.0],
            rotation_rad: [0.0; 3],
            covariance: [0.0; 21],
            ..Pose::default()
        };
        for i in 0..6 {
            pose.covariance[upper_index(6, i, i)] = sigma * sigma;
        }
        gaits.see(if k == 0 { 0.0 } else { DT }, &pose);
        let step = Step {
            span_s: DT,
            gaits: gaits.now(),
        };
        let point = Point {
            row: unit(Y),
            value: y + noise,
            variance: sigma * sigma,
            is_edge: false,
        };
        chain.push(Node::new(step, vec![point], Vec::new()));
        chain.trim(8);
        let off = chain.newest().mean[Y] - y;
        if k >= 59 {
            squares[0] += off * off;
            squares[1] += noise * noise;
        }
        assert!(off.abs() < 5.0 * sigma, "{k}: {off}");
    }
    assert!(squares[0] < squares[1], "{squares:?}");
}

/// A pose whose components but y and z are zero and have a small variance.
fn flat(y_m: f64, z_m: f64, sigma_m: [f64; 2]) -> Pose {
    let mut pose = Pose {
        position_m: [0.0, y_m, z_m],
        rotation_rad: [0.0; 3],
        covariance: [0.0; 21],
        ..Pose::default()
    };
    for k in 0..6 {
        let sigma = match k {
            1 | 2 => sigma_m[k - 1],
            _ => 1e-4,
        };
        pose.covariance[upper_index(6, k, k)] = sigma * sigma;
    }
    pose
}

#[test]
fn a_start_that_one_scan_cannot_show_is_in_the_covariance() {
    let (rest, scan) = ([6e-5, 9e-5], [4.3e-4, 6.5e-4]);
    let variance = |k: usize| rest[k] * rest[k] + scan[k] * scan[k];
    let noises = [0.3, -1.4, 0.9, 1.3, -0.8, -0.3, 1.2, -1.2];
    // By how much a scan that is `way_m` off the rest misses, over what the mixed pose allows.
    let nees = |way_m: f64, noise: [f64; 2]| {
        let mut gaits = Gaits::new(true);
        let found = [0, 1].map(|k| way_m + scan[k] * noise[k]);
        for off in [[0.0; 2], [0.0; 2], found] {
            let [y, z] = off;
            gaits.compare(
                DT,
                &[0.0, y, z, 0.0, 0.0, 0.0],
                &[1.0, variance(0), variance(1), 1.0, 1.0, 1.0],
            );
        }
        let mut pose = flat(0.0, 0.0, rest);
        let plain = way_m * way_m / pose.cov(1, 1);
        match gaits.may_have_started() {
            // It is sure, and the filter follows the scan.
            0.0 => pose = flat(found[0], found[1], scan),
            started => mix(&mut pose, &flat(found[0], found[1], scan), started),
        }
        let off = pose.position_m[1] - way_m;
        (off * off / pose.cov(1, 1), plain)
    };
    let (mut mixed, mut plain, mut still, mut n) = (0.0, 0.0, 0.0, 0.0);
    for phase in 0..10 {
        // 5 m/s^2 from somewhere between the two scans on.
        let since_s = DT * (f64::from(phase) + 0.5) / 10.0;
        for k in 0..8 {
            let noise = [noises[k], noises[(k + 3) % 8]];
            let (with, without) = nees(2.5 * since_s * since_s, noise);
            mixed += with;
            plain += without;
            still += nees(0.0, noise).0;
            n += 1.0;
        }
    }
    assert!(mixed < 0.25 * plain, "{} {}", mixed / n, plain / n);
    assert!(still < 0.3 * n, "{}", still / n);
}

#[test]
fn scans_from_all_over_are_so_many_starts() {
    let frame = frame(&[]);
    let scans = scattered(&frame, "reference,-remission", 40, [0.5, 3.5], 12);
    let mut filter = filter(&frame);
    let mut far = 0;
    for scan in &scans {
        let pose = filter.take(&lines_of(&frame, scan), known(scan), &[]);
        let off = errors(scan, &pose);
        far += usize::from(off[1].abs() > 0.003 || off[2].abs() > 0.004);
    }
    assert_eq!(far, 0);
    assert!(filter.starts() > 30);
}

#[test]
fn an_imu_that_is_heard_late_is_not_taken_for_exact() {
    let text = include_str!("../../../testdata/inclined.toml");
    let frame = Frame::parse(text, std::path::Path::new("inclined.toml")).unwrap();
    let scans = standing(&frame, "reference,-remission", 1, 8, 4);
    let mut filter = filter(&frame);
    for (k, scan) in scans.iter().enumerate() {
        // Strips on the walls tell the pitch to 0.05 deg; the IMU, from the third scan on, is 0.1 deg
        // off, as good as its 0.5 deg promise, but not exact.
        let wrong_rad = scan.truth.rotation_rad[1] + 0.1f64.to_radians();
        let late = (k > 1).then_some(Pitch::within(wrong_rad, 0.5f64.to_radians()));
        let pose = filter.take(&lines_of(&frame, scan), late, &[]);
        let off = errors(scan, &pose)[PITCH] / pose.cov(PITCH, PITCH).sqrt();
        assert!(off.abs() < 4.0, "{k}: {off}");
    }
}
