use super::*;
use crate::simulate::staged;

const FAN: Fan = Fan {
    angle_min_rad: -5.0 * std::f64::consts::PI / 180.0,
    step_rad: 0.25 * std::f64::consts::PI / 180.0,
    count: 761,
};

/// Root of the mean variances of x, y, z (mm), roll and yaw (deg) over poses of the workspace.
fn over_workspace(frame: &Frame, z_m: [f64; 2], assumed: &Assumptions, n: usize) -> [f64; 5] {
    let mut sums = [0.0; 5];
    let mut count = 0.0;
    let within = |u: f64, [a, b]: [f64; 2]| a + u * (b - a);
    for (i, [a, b, c, d]) in spread(n).enumerate() {
        let tilt = |u: f64| within(u, [-1.0, 1.0]).to_radians();
        let roll = tilt((i as f64 * 0.754_877_666).fract());
        let pitch = tilt((i as f64 * 0.569_840_29).fract());
        let position_m = [
            within(a, [-0.05, 0.05]),
            within(b, [-4.0, 4.0]),
            within(c, z_m),
        ];
        let rotation_rad = [roll, pitch, tilt(d)];
        if let Some(c) = of_scan(frame, &FAN, position_m, rotation_rad, assumed) {
            for (sum, k) in sums.iter_mut().zip([0, 1, 2, 3, 5]) {
                *sum += c[k];
            }
            count += 1.0;
        }
    }
    assert!(count > 0.95 * n as f64);
    let unit = |k: usize| {
        if k < 3 {
            1e3
        } else {
            180.0 / std::f64::consts::PI
        }
    };
    std::array::from_fn(|k| (sums[k] / count).sqrt() * unit(k))
}

fn near(value: f64, expected: f64, share: f64) {
    assert!(
        (value / expected - 1.0).abs() < share,
        "{value} is not about {expected}"
    );
}

/// The prototype's exact posterior of noise-free ranges over 2000 poses: x 3.92 and 2.54 mm, yaw
/// 0.100 deg; y, z and roll from the lines with 6.5 mm: 0.43 mm, 0.64 mm, 0.0077 deg.
#[test]
fn ranges_meet_the_exact_posterior_of_the_prototype() {
    let frame = staged::frame(&[]);
    let exact = Assumptions {
        range_sigma_m: 1e-5,
        bias_sigma_m: 1e-5,
        ..Assumptions::default()
    };
    let low = over_workspace(&frame, [0.5, 3.5], &exact, 1000);
    near(low[0], 3.92, 0.05);
    near(low[4], 0.100, 0.06);
    let high = over_workspace(&frame, [3.5, 4.0], &exact, 1000);
    near(high[0], 2.54, 0.06);
    near(high[4], 0.100, 0.06);
    let noisy = over_workspace(&frame, [0.5, 3.5], &Assumptions::default(), 1000);
    near(noisy[1], 0.43, 0.06);
    near(noisy[2], 0.64, 0.06);
    near(noisy[3], 0.0077, 0.06);
    assert!(noisy[0] > low[0] && noisy[0] < 4.2, "{noisy:?}");
}

/// A prototype's estimator, which left the law of incidence in, had x 0.94 to 1.0 mm and yaw 0.025 deg
/// with 4 % noise; ours has 0.89 mm in simulated scans. Twice the noise is twice the error.
#[test]
fn remission_is_below_what_estimators_reach_and_scales_with_its_noise() {
    let frame = staged::frame(&[]);
    let with = |noise: f64| Assumptions {
        edges: EdgeModel::Remission(Remissions {
            noise,
            contrast: 0.35,
            floor: 1.0 / 150.0 / 12f64.sqrt(),
        }),
        ..Assumptions::default()
    };
    let at = |noise: f64| over_workspace(&frame, [0.5, 3.5], &with(noise), 600);
    let (once, twice) = (at(0.04), at(0.08));
    assert!(once[0] > 0.82 && once[0] < 0.90, "{once:?}");
    assert!(once[4] > 0.020 && once[4] < 0.028, "{once:?}");
    assert!(
        twice[0] > 1.7 * once[0] && twice[0] < 2.05 * once[0],
        "{twice:?}"
    );
    // And against what the estimators have reached: nothing is below the bound of y and z.
    assert!(once[1] > 0.36 && once[2] > 0.5, "{once:?}");
}

#[test]
fn a_pitch_that_is_not_known_moves_x_by_the_height() {
    let frame = staged::frame(&[]);
    let at = |pitch_sigma_rad: f64| {
        let assumed = Assumptions {
            pitch_sigma_rad,
            ..Assumptions::default()
        };
        of_scan(&frame, &FAN, [0.01, 0.3, 2.0], [0.0; 3], &assumed).unwrap()
    };
    let (known, open) = (at(0.0), at(0.5f64.to_radians()));
    let added = (open[0] - known[0]).sqrt();
    // h tan(0.5 deg) = 3.5 m 0.00873 = 30.5 mm.
    near(added, 0.0305, 0.1);
    assert!((open[4].sqrt() / 0.5f64.to_radians() - 1.0).abs() < 0.01);
}
