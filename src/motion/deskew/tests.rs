use super::*;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

const DY_M: f64 = 10.45;
const PERIOD_S: f64 = 1.0 / 35.0;

/// A scanner that moves as told, whose lines come with noise: place and velocity at a time.
struct Bench {
    rng: ChaCha8Rng,
    path: fn(f64) -> ([f64; 3], [f64; 3]),
}

impl Bench {
    fn new(path: fn(f64) -> ([f64; 3], [f64; 3])) -> Bench {
        Bench {
            rng: ChaCha8Rng::seed_from_u64(9),
            path,
        }
    }

    fn lines(&self, t: f64) -> [NormalLine; 3] {
        let ([y, z, roll], _) = (self.path)(t);
        [
            NormalLine::new(DY_M / 2.0 - y, -roll),
            NormalLine::new(5.5 - z, FRAC_PI_2 - roll),
            NormalLine::new(DY_M / 2.0 + y, PI - roll),
        ]
    }

    fn motion(&self, t: f64) -> ScanMotion {
        let ([_, _, roll], [vy, vz, roll_rad_s]) = (self.path)(t);
        let (sin, cos) = roll.sin_cos();
        ScanMotion {
            vy_m_s: cos * vy + sin * vz,
            vz_m_s: cos * vz - sin * vy,
            roll_rad_s,
        }
    }

    /// The fit of the scan at `t` with an assumed motion, for one draw of the noise. A wall is
    /// seen 5 ms before and after the reference instant; the bias differs from scan to scan.
    fn fit(&self, t: f64, noise: &SVector<f64, 7>, assumed: ScanMotion) -> LineFit {
        let mut sensitivity = SMatrix::<f64, 7, 3>::zeros();
        for (row, column, value) in [
            (0, 0, 5e-3),
            (4, 0, 5e-3),
            (2, 1, 1e-3),
            (1, 0, 1e-3),
            (5, 0, -1e-3),
            (3, 1, 1.5e-3),
            (1, 2, 5e-3),
            (5, 2, -5e-3),
            (0, 2, 3e-3),
        ] {
            sensitivity[(row, column)] = value;
        }
        let mut covariance = SMatrix::<f64, 7, 7>::zeros();
        for (k, sigma) in [1e-3, 4e-4, 5e-4, 1e-4, 1e-3, 4e-4, 0.0].iter().enumerate() {
            covariance[(k, k)] = sigma * sigma;
        }
        // The bias moves all three lines.
        let by_bias = SVector::<f64, 7>::from_column_slice(&[-1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0]);
        covariance += by_bias * by_bias.transpose() * 0.015 * 0.015;
        covariance[(6, 6)] += 1e-10;
        let root = covariance.cholesky().unwrap().l();
        let off = root * noise + sensitivity * (vector(assumed) - vector(self.motion(t)));
        let mut lines = self.lines(t);
        for (k, line) in lines.iter_mut().enumerate() {
            line.d_m += off[2 * k];
            line.alpha_rad += off[2 * k + 1];
        }
        LineFit {
            lines,
            seen: [true; 3],
            covariance,
            sensitivity,
        }
    }

    fn take(&mut self, own: &mut SelfMotion, t: f64) -> (Deskewed, LineFit) {
        let noise = SVector::from_fn(|_, _| StandardNormal.sample(&mut self.rng));
        let mut last = None;
        let deskewed = own.take(stamp(t), |assumed| {
            last = Some(self.fit(t, &noise, assumed));
            last
        });
        (deskewed.unwrap(), last.unwrap())
    }
}

fn stamp(t: f64) -> Stamp {
    Stamp::from_ns(1_000_000_000).plus_s(t)
}

fn steady(t: f64) -> ([f64; 3], [f64; 3]) {
    ([-4.0 + 2.8 * t, 0.5 + 1.1 * t, 0.01], [2.8, 1.1, 0.0])
}

fn rolling(t: f64) -> ([f64; 3], [f64; 3]) {
    // 1 deg at 2 Hz, and 5 m/s^2 back and forth.
    let (a, w) = (0.0175, 4.0 * PI);
    let (s, c) = (w * t).sin_cos();
    let place = [0.03 * s, 2.0 + 0.02 * c, a * s];
    (place, [0.03 * w * c, -0.02 * w * s, a * w * c])
}

#[test]
fn motion_and_lines_scatter_as_their_covariances_say() {
    for path in [steady, rolling] {
        let mut bench = Bench::new(path);
        let mut own = SelfMotion::new(DY_M);
        let (mut lines_nees, mut motion_nees, mut n) = (0.0, 0.0, 0.0);
        let mut worst = [0.0f64; 3];
        // Six runs of 100 scans: at 2.8 m/s the frame is not longer.
        for run in 0..600 {
            let k = run % 100;
            if k == 0 {
                own = SelfMotion::new(DY_M);
            }
            let t = f64::from(k) * PERIOD_S;
            let (deskewed, fit) = bench.take(&mut own, t);
            if k < 10 {
                continue;
            }
            let mut off = SVector::<f64, 6>::zeros();
            for (i, truth) in bench.lines(t).iter().enumerate() {
                off[2 * i] = fit.lines[i].d_m + deskewed.step[2 * i] - truth.d_m;
                off[2 * i + 1] =
                    fit.lines[i].alpha_rad + deskewed.step[2 * i + 1] - truth.alpha_rad;
            }
            let covariance: SMatrix<f64, 6, 6> =
                deskewed.covariance.fixed_view::<6, 6>(0, 0).into();
            lines_nees += off.dot(&(covariance.cholesky().unwrap().inverse() * off)) / 6.0;
            let motion = vector(deskewed.motion) - vector(bench.motion(t));
            let spread = own.belief.unwrap().motion_covariance();
            motion_nees += motion.dot(&(spread.cholesky().unwrap().inverse() * motion)) / 3.0;
            for (worst, off) in worst.iter_mut().zip(&motion) {
                *worst = worst.max(off.abs());
            }
            n += 1.0;
        }
        // The standard error of the first is sqrt(2 / 6 / 540) = 0.025; consecutive motions are
        // correlated, and the noise of the model is chosen for livelier ones.
        assert!((lines_nees / n - 1.0).abs() < 0.12, "{}", lines_nees / n);
        assert!(motion_nees / n < 1.3, "{}", motion_nees / n);
        assert!(
            worst[0] < 0.2 && worst[1] < 0.2 && worst[2] < 0.1,
            "{worst:?}"
        );
    }
}

#[test]
fn a_start_is_unsure_and_the_second_scan_settles_it() {
    let mut bench = Bench::new(steady);
    let mut own = SelfMotion::new(DY_M);
    let (first, _) = bench.take(&mut own, 0.0);
    assert_eq!(first.relation, Relation::Begins);
    // What no bias can move: the ceiling against the mean of the walls.
    let sigma = |deskewed: &Deskewed| {
        let row = SVector::<f64, 7>::from_column_slice(&[-0.5, 0.0, 1.0, 0.0, -0.5, 0.0, 0.0]);
        (row.transpose() * deskewed.covariance * row)[0].sqrt()
    };
    let (second, _) = bench.take(&mut own, PERIOD_S);
    let Relation::GoesOn(Some((motion, covariance))) = second.relation else {
        panic!("{:?}", second.relation);
    };
    let off = vector(motion) - vector(bench.motion(0.0));
    let distance = off.dot(&(covariance.cholesky().unwrap().inverse() * off));
    assert!(
        off[0].abs() < 0.3 && off[1].abs() < 0.3 && distance < 20.0,
        "{off} {distance}"
    );
    assert!(sigma(&first) > 1.2 * sigma(&second));
    let (third, _) = bench.take(&mut own, 2.0 * PERIOD_S);
    assert_eq!(third.relation, Relation::GoesOn(None));
}

#[test]
fn a_jump_is_no_motion() {
    let jumping = |t: f64| {
        let k = (t / PERIOD_S).round();
        (
            [3.5 * (k * 2.4).sin(), 2.0 + (k * 1.7).cos(), 0.01 * k.cos()],
            [0.0; 3],
        )
    };
    let mut bench = Bench::new(jumping);
    let mut own = SelfMotion::new(DY_M);
    for k in 0..50 {
        let (deskewed, _) = bench.take(&mut own, f64::from(k) * PERIOD_S);
        let expected = if k == 0 {
            Relation::Begins
        } else {
            Relation::Elsewhere
        };
        assert_eq!(deskewed.relation, expected, "{k}");
        let speed = vector(deskewed.motion).norm();
        assert!(k == 0 || speed < 0.01, "{k} {speed}");
    }
}

#[test]
fn after_a_pause_it_says_what_it_does_not_know() {
    let mut bench = Bench::new(steady);
    let mut own = SelfMotion::new(DY_M);
    let spread = |own: &SelfMotion| own.belief.unwrap().motion_covariance()[(0, 0)].sqrt();
    for k in 0..20 {
        bench.take(&mut own, f64::from(k) * PERIOD_S);
    }
    let before = spread(&own);
    let (after, _) = bench.take(&mut own, 20.0 * PERIOD_S + 0.4);
    assert_eq!(after.relation, Relation::GoesOn(None));
    assert!(spread(&own) > 3.0 * before);
    let off = vector(after.motion) - vector(bench.motion(0.0));
    assert!(off.norm() < 4.0 * spread(&own));
    let (late, _) = bench.take(&mut own, 3.0);
    assert_eq!(late.relation, Relation::Begins);
}

#[test]
fn stamps_that_repeat_or_go_back_teach_nothing_and_do_no_harm() {
    let mut bench = Bench::new(steady);
    let mut own = SelfMotion::new(DY_M);
    for k in 0..20 {
        bench.take(&mut own, f64::from(k) * PERIOD_S);
    }
    let known = own.belief.unwrap();
    let (again, _) = bench.take(&mut own, 19.0 * PERIOD_S);
    assert_eq!(again.relation, Relation::GoesOn(None));
    assert!((vector(again.motion) - vector(known.motion())).norm() < 0.1);
    assert_eq!(own.belief.unwrap().state, known.state);
    // The same clock for ever: at rest as far as anybody can tell, and finite.
    let mut stuck = SelfMotion::new(DY_M);
    for k in 0..20 {
        let t = f64::from(k) * PERIOD_S;
        let noise = SVector::zeros();
        let deskewed = stuck.take(stamp(0.0), |assumed| Some(bench.fit(t, &noise, assumed)));
        let deskewed = deskewed.unwrap();
        assert!(k == 0 || vector(deskewed.motion).norm() < 0.01, "{k}");
        assert!(deskewed.covariance.iter().all(|v| v.is_finite()));
    }
    // A clock set back by an hour starts anew.
    let (back, _) = bench.take(&mut own, -3600.0);
    assert_eq!(back.relation, Relation::Begins);
}

#[test]
fn lines_that_are_missing_or_no_numbers_are_survived() {
    let bench = Bench::new(steady);
    let mut own = SelfMotion::new(DY_M);
    let noise = SVector::zeros();
    for k in 0..40 {
        let t = f64::from(k) * PERIOD_S;
        let taken = own.take(stamp(t), |assumed| {
            let mut fit = bench.fit(t, &noise, assumed);
            if k % 5 == 3 {
                return None;
            }
            fit.seen[2] = k % 7 != 0;
            if k % 11 == 10 {
                fit.lines[1].d_m = f64::NAN;
            }
            Some(fit)
        });
        assert_eq!(taken.is_none(), k % 5 == 3 || k % 11 == 10, "{k}");
        if let Some(taken) = taken.filter(|_| k > 10) {
            let off = vector(taken.motion) - vector(bench.motion(t));
            assert!(off.norm() < 0.05, "{k} {off}");
        }
    }
}

#[test]
fn hindsight_is_better_and_says_so() {
    let mut bench = Bench::new(rolling);
    let mut own = SelfMotion::remembering(DY_M);
    let mut causal = 0.0;
    for k in 0..400 {
        let t = f64::from(k) * PERIOD_S;
        let (deskewed, _) = bench.take(&mut own, t);
        causal += (vector(deskewed.motion) - vector(bench.motion(t))).norm_squared();
    }
    let smoothed = own.smoothed();
    assert_eq!(smoothed.len(), 400);
    let (mut late, mut nees) = (0.0, 0.0);
    for (k, known) in smoothed.iter().enumerate() {
        let (motion, covariance) = known.unwrap();
        let off = vector(motion) - vector(bench.motion(k as f64 * PERIOD_S));
        late += off.norm_squared();
        nees += off.dot(&(covariance.cholesky().unwrap().inverse() * off)) / 1200.0;
    }
    assert!(late < 0.5 * causal, "{late} {causal}");
    assert!(nees < 1.3, "{nees}");
}
