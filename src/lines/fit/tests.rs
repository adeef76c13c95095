use super::*;
use nalgebra::{Matrix2, Vector2};
use proptest::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, Normal};

const SIGMA_M: f64 = 0.0065;

/// Beams of a 0.25 degree scanner between two angles (deg) that meet the line exactly.
fn exact(d_m: f64, alpha_deg: f64, from_deg: f64, to_deg: f64) -> Vec<(f64, f64)> {
    let count = ((to_deg - from_deg) / 0.25) as usize;
    let angles = (0..=count).map(|i| (from_deg + 0.25 * i as f64).to_radians());
    angles
        .map(|angle| (angle, d_m / (angle - alpha_deg.to_radians()).cos()))
        .collect()
}

fn noisy(beams: &[(f64, f64)], rng: &mut ChaCha8Rng) -> Beams {
    let noise = Normal::new(0.0, SIGMA_M).unwrap();
    beams
        .iter()
        .map(|(angle, range)| (*angle, range + noise.sample(rng)))
        .collect()
}

proptest! {
    #[test]
    fn noise_free_beams_give_the_line(
        d_m in 0.02f64..12.0,
        alpha_deg in -89.9f64..269.9,
        middle_deg in -60.0f64..60.0,
        half_deg in 4.0f64..20.0,
    ) {
        let (from, to) = (alpha_deg + middle_deg - half_deg, alpha_deg + middle_deg + half_deg);
        let beams: Beams = exact(d_m, alpha_deg, from, to).into_iter().collect();
        for loss in [Loss::Squares, Loss::TUKEY, Loss::Trimmed(3.0)] {
            let line = fit(beams.all(), SIGMA_M, loss).unwrap();
            prop_assert!((line.normal.d_m - d_m).abs() < 1e-9);
            prop_assert!((line.normal.alpha_rad - alpha_deg.to_radians()).abs() < 1e-9);
            prop_assert_eq!(line.points as usize, beams.all().len());
        }
    }

    #[test]
    fn sums_add_up(split in 3usize..140) {
        let beams: Beams = exact(4.0, 10.0, -20.0, 15.0).into_iter().collect();
        let (left, right) = (beams.all().run(0, split), beams.all().run(split, 141));
        let left: InverseRangeSums = left.iter().collect();
        let right: InverseRangeSums = right.iter().collect();
        let whole: InverseRangeSums = beams.all().iter().collect();
        let joined = left.plus(&right).line().unwrap();
        let straight = whole.line().unwrap();
        prop_assert!((joined.a - straight.a).abs() < 1e-12);
        let rest = whole.minus(&left).line().unwrap();
        prop_assert!((rest.b - straight.b).abs() < 1e-7);
        prop_assert!(whole.cost_m2() < 1e-10);
    }
}

#[test]
fn the_seam_does_not_matter() {
    // A wall straight ahead of the seam, seen by beams at 170..180 and -180..-170 degrees.
    let mut beams = exact(3.0, 180.0, 170.0, 180.0);
    beams.extend(exact(3.0, -180.0, -179.75, -170.0));
    let beams: Beams = beams.into_iter().collect();
    let line = fit(beams.all(), SIGMA_M, Loss::Squares).unwrap();
    assert!((line.normal.d_m - 3.0).abs() < 1e-9);
    assert!((line.normal.alpha_rad - std::f64::consts::PI).abs() < 1e-9);
}

#[test]
fn a_line_nearly_through_the_scanner() {
    for (from, to) in [(80.0, 89.0), (70.0, 88.0)] {
        let beams: Beams = exact(0.01, 0.0, from, to).into_iter().collect();
        let line = fit(beams.all(), SIGMA_M, Loss::Squares).unwrap();
        assert!((line.normal.d_m - 0.01).abs() < 1e-9, "{line:?}");
    }
}

#[test]
fn too_little_is_no_line() {
    assert!(fit(Beams::default().all(), SIGMA_M, Loss::Squares).is_none());
    let one: Beams = [(0.3, 2.0)].into_iter().collect();
    assert!(fit(one.all(), SIGMA_M, Loss::TUKEY).is_none());
    let same: Beams = [(0.3, 2.0), (0.3, 2.1)].into_iter().collect();
    assert!(fit(same.all(), SIGMA_M, Loss::Squares).is_none());
}

/// The information matrix from finite differences of the exact range.
fn crb(beams: &[(f64, f64)], d_m: f64, alpha_rad: f64) -> Matrix2<f64> {
    let range = |angle: f64, d: f64, alpha: f64| d / (angle - alpha).cos();
    let h = 1e-6;
    let mut information = Matrix2::zeros();
    for (angle, _) in beams {
        let j = Vector2::new(
            (range(*angle, d_m + h, alpha_rad) - range(*angle, d_m - h, alpha_rad)) / (2.0 * h),
            (range(*angle, d_m, alpha_rad + h) - range(*angle, d_m, alpha_rad - h)) / (2.0 * h),
        );
        information += j * j.transpose() / (SIGMA_M * SIGMA_M);
    }
    information.try_inverse().unwrap()
}

struct Spread {
    /// rms over bound and bias over bound, of d and alpha.
    rms: [f64; 2],
    bias: [f64; 2],
    nees: f64,
    correlation: f64,
}

fn monte_carlo(beams: &[(f64, f64)], d_m: f64, alpha_deg: f64, loss: Loss) -> Spread {
    monte_carlo_by(Estimator::MaximumLikelihood, beams, d_m, alpha_deg, loss)
}

fn monte_carlo_by(
    estimator: Estimator,
    beams: &[(f64, f64)],
    d_m: f64,
    alpha_deg: f64,
    loss: Loss,
) -> Spread {
    let trials = 2000;
    let alpha_rad = alpha_deg.to_radians();
    let bound = crb(beams, d_m, alpha_rad);
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let (mut sum, mut squares, mut nees) = (Vector2::zeros(), Matrix2::zeros(), 0.0);
    for _ in 0..trials {
        let beams = noisy(beams, &mut rng);
        let start: InverseRangeSums = beams.all().iter().collect();
        let start = start.line().unwrap();
        let line = fit_near(start, beams.all(), SIGMA_M, estimator, loss).unwrap();
        let e = Vector2::new(line.normal.d_m - d_m, line.normal.alpha_rad - alpha_rad);
        let cov = Matrix2::new(line.cov_dd, line.cov_da, line.cov_da, line.cov_aa);
        nees += (e.transpose() * cov.try_inverse().unwrap() * e)[0];
        sum += e;
        squares += e * e.transpose();
    }
    let n = f64::from(trials);
    let cov = squares / n;
    Spread {
        rms: [0, 1].map(|i| (cov[(i, i)] / bound[(i, i)]).sqrt()),
        bias: [0, 1].map(|i| sum[i] / n / bound[(i, i)].sqrt()),
        nees: nees / n,
        correlation: cov[(0, 1)] / (cov[(0, 0)] * cov[(1, 1)]).sqrt(),
    }
}

/// Beams (angle, range), and the line's d_m and alpha in degrees.
type Scene = (Vec<(f64, f64)>, f64, f64);

/// A side wall 4 m away, seen from 0.5 m to 4 m above the scanner, and a ceiling 2 m above it.
fn scenes() -> [Scene; 2] {
    let side = exact(4.0, 0.0, 0.5f64.atan2(4.0).to_degrees(), 45.0);
    let ceiling = exact(2.0, 90.0, 90.0 - 68.0, 90.0 + 68.0);
    [(side, 4.0, 0.0), (ceiling, 2.0, 90.0)]
}

#[test]
fn the_fit_reaches_the_bound() {
    for (beams, d_m, alpha_deg) in scenes() {
        let spread = monte_carlo(&beams, d_m, alpha_deg, Loss::Squares);
        for i in 0..2 {
            assert!((0.96..=1.04).contains(&spread.rms[i]), "{:?}", spread.rms);
            // The bias' own scatter is 1/sqrt(2000) of the bound.
            assert!(spread.bias[i].abs() < 0.05, "{:?}", spread.bias);
        }
        assert!((1.85..=2.15).contains(&spread.nees), "{}", spread.nees);
    }
}

#[test]
fn distance_and_angle_of_a_side_wall_are_correlated() {
    let (beams, d_m, alpha_deg) = scenes()[0].clone();
    let spread = monte_carlo(&beams, d_m, alpha_deg, Loss::Squares);
    assert!(
        (spread.correlation - 0.91).abs() < 0.02,
        "{}",
        spread.correlation
    );
    let beams: Beams = beams.into_iter().collect();
    let line = fit(beams.all(), SIGMA_M, Loss::Squares).unwrap();
    let correlation = line.cov_da / (line.cov_dd * line.cov_aa).sqrt();
    assert!((correlation - 0.91).abs() < 0.01, "{correlation}");
    assert!((line.cov_dd.sqrt() - 1.117e-3).abs() < 0.02e-3, "{line:?}");
    assert!(
        (line.cov_aa.sqrt().to_degrees() - 0.0258).abs() < 0.0005,
        "{line:?}"
    );
}

#[test]
fn tukey_costs_little_and_says_so() {
    let (beams, d_m, alpha_deg) = scenes()[0].clone();
    let spread = monte_carlo(&beams, d_m, alpha_deg, Loss::TUKEY);
    assert!(spread.rms.iter().all(|rms| *rms < 1.07), "{:?}", spread.rms);
    assert!((1.8..=2.2).contains(&spread.nees), "{}", spread.nees);
}

#[test]
fn outliers_do_not_pull() {
    let (beams, d_m, _) = scenes()[0].clone();
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let mut squares = [0.0; 2];
    let trials = 300;
    for _ in 0..trials {
        let clean = noisy(&beams, &mut rng);
        // Every tenth beam ends on something 2 cm to 1.5 m in front of the wall.
        let dirty: Beams = beams
            .iter()
            .zip(clean.all().range_m)
            .enumerate()
            .map(|(i, ((angle, _), range_m))| {
                let front_m = if i % 10 == 3 {
                    0.02 + 0.1 * (i % 15) as f64
                } else {
                    0.0
                };
                (*angle, range_m - front_m)
            })
            .collect();
        for (sum, loss) in squares.iter_mut().zip([Loss::Squares, Loss::TUKEY]) {
            let line = fit(dirty.all(), SIGMA_M, loss).unwrap();
            *sum += (line.normal.d_m - d_m).powi(2);
        }
    }
    let bound_m = crb(&beams, d_m, 0.0)[(0, 0)].sqrt();
    let [plain, robust] = squares.map(|sum| (sum / f64::from(trials)).sqrt() / bound_m);
    assert!(plain > 10.0, "{plain}");
    assert!(robust < 1.3, "{robust}");
}

/// The walls of six scenes as a scanner sees them: three side walls, a ceiling at two heights, and
/// half a ceiling.
fn six_scenes() -> [Scene; 6] {
    let side = |d_m: f64| {
        let to = |z_m: f64| z_m.atan2(d_m).to_degrees();
        (exact(d_m, 0.0, to(0.5), to(4.0)), d_m, 0.0)
    };
    let ceiling = |d_m: f64, from_m: f64, to_m: f64| {
        let at = |y_m: f64| 90.0 + y_m.atan2(d_m).to_degrees();
        (exact(d_m, 90.0, at(from_m), at(to_m)), d_m, 90.0)
    };
    [
        side(4.0),
        side(7.0),
        side(10.0),
        ceiling(2.0, -5.0, 5.0),
        ceiling(4.0, -5.0, 5.0),
        ceiling(3.0, 0.5, 5.0),
    ]
}

/// One beam in ten ends in front of the wall: the robust fit stays near the bound of all beams,
/// whatever stands there.
#[test]
fn a_tenth_of_outliers_costs_little_in_six_scenes() {
    let mut rng = ChaCha8Rng::seed_from_u64(13);
    let uniform = rand_distr::Uniform::new(0.0f64, 1.0).unwrap();
    for (name, [from_m, to_m], allowed) in
        [("gross", [0.05, 1.5], 1.15), ("small", [0.02, 0.05], 1.35)]
    {
        for (scene, (beams, d_m, alpha_deg)) in six_scenes().iter().enumerate() {
            let alpha_rad = alpha_deg.to_radians();
            let bound = crb(beams, *d_m, alpha_rad);
            let mut squares = [0.0; 2];
            let trials = 1000;
            for _ in 0..trials {
                let clean = noisy(beams, &mut rng);
                let dirty: Beams = beams
                    .iter()
                    .zip(clean.all().range_m)
                    .map(|((angle, _), range_m)| {
                        let hit = uniform.sample(&mut rng) < 0.1;
                        let front_m = from_m + (to_m - from_m) * uniform.sample(&mut rng);
                        (*angle, range_m - if hit { front_m } else { 0.0 })
                    })
                    .collect();
                let line = fit(dirty.all(), SIGMA_M, Loss::TUKEY).unwrap();
                squares[0] += (line.normal.d_m - d_m).powi(2);
                squares[1] += (line.normal.alpha_rad - alpha_rad).powi(2);
            }
            let ratio = [0, 1].map(|i| (squares[i] / f64::from(trials) / bound[(i, i)]).sqrt());
            println!("{name} outliers, scene {scene}: {ratio:.2?} of the bound");
            assert!(
                ratio.iter().all(|r| *r <= allowed),
                "{name} {scene} {ratio:?}"
            );
        }
    }
}

#[test]
fn scale_and_sigma_scale_together() {
    let (beams, ..) = scenes()[0].clone();
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let once = noisy(&beams, &mut rng);
    let twice: Beams = beams
        .iter()
        .zip(once.all().range_m)
        .map(|((angle, _), range_m)| (*angle, 2.0 * range_m))
        .collect();
    let a = fit(once.all(), SIGMA_M, Loss::TUKEY).unwrap();
    let b = fit(twice.all(), 2.0 * SIGMA_M, Loss::TUKEY).unwrap();
    assert!((b.normal.d_m - 2.0 * a.normal.d_m).abs() < 1e-9);
    assert!((b.normal.alpha_rad - a.normal.alpha_rad).abs() < 1e-9);
    assert!((b.cov_dd / a.cov_dd - 4.0).abs() < 1e-6);
    assert!((b.cov_aa / a.cov_aa - 1.0).abs() < 1e-6);
}

#[test]
fn least_squares_in_coordinates_knows_its_own_scatter() {
    for (beams, d_m, alpha_deg) in scenes() {
        let by = |estimator| monte_carlo_by(estimator, &beams, d_m, alpha_deg, Loss::Squares);
        let total = by(Estimator::TotalLeastSquares);
        let auto = by(Estimator::OrdinaryLeastSquares(Axis::Auto));
        for spread in [&total, &auto] {
            assert!((1.8..=2.2).contains(&spread.nees), "{}", spread.nees);
            assert!(spread.rms.iter().all(|rms| *rms < 1.3), "{:?}", spread.rms);
        }
        // The right axis loses nothing to total least squares, on an upright wall as on a level one.
        for i in 0..2 {
            assert!(
                auto.rms[i] < 1.02 * total.rms[i],
                "{:?} {:?}",
                auto.rms,
                total.rms
            );
        }
    }
    // The wrong axis does.
    let (beams, d_m, alpha_deg) = scenes()[0].clone();
    let wrong = Estimator::OrdinaryLeastSquares(Axis::Z);
    let wrong = monte_carlo_by(wrong, &beams, d_m, alpha_deg, Loss::Squares);
    assert!(wrong.rms.iter().all(|rms| *rms > 1.3), "{:?}", wrong.rms);
}

#[test]
fn robust_losses_hold_in_coordinates_too() {
    let (beams, d_m, _) = scenes()[0].clone();
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    for estimator in [
        Estimator::MaximumLikelihood,
        Estimator::TotalLeastSquares,
        Estimator::OrdinaryLeastSquares(Axis::Auto),
    ] {
        let clean = noisy(&beams, &mut rng);
        let dirty: Beams = beams
            .iter()
            .zip(clean.all().range_m)
            .enumerate()
            .map(|(i, ((angle, _), range_m))| {
                (*angle, range_m - if i % 10 == 3 { 0.4 } else { 0.0 })
            })
            .collect();
        let start: InverseRangeSums = dirty.all().iter().collect();
        let start = start.line().unwrap();
        let line = fit_near(start, dirty.all(), SIGMA_M, estimator, Loss::TUKEY).unwrap();
        assert!(
            (line.normal.d_m - d_m).abs() < 0.006,
            "{estimator:?} {line:?}"
        );
        assert!(line.points as usize >= beams.len() * 85 / 100, "{line:?}");
    }
}
