use super::*;
use crate::motion::{Limits, Profile, Quintic, Sampled, State};
use crate::record::{Stamp, TrajectoryPoint};
use crate::simulate::Seed;
use crate::simulate::random::Purpose;

/// Moves of 8 m along y at 3.13 m/s, there and back `loops` times, with rests of 1 s.
struct Loops {
    moves: u32,
    profile: Quintic,
}

const REST_S: f64 = 1.0;

impl Loops {
    fn new(moves: u32) -> Loops {
        let limits = Limits {
            speed_m_s: 3.13,
            acceleration_m_s2: 100.0,
            jerk_m_s3: 1e3,
        };
        Loops {
            moves,
            profile: Quintic::new(8.0, limits),
        }
    }
}

impl Motion for Loops {
    fn at(&self, t_s: f64) -> State {
        let cycle_s = REST_S + self.profile.duration_s();
        let t_s = t_s.clamp(0.0, self.duration_s());
        let number = (t_s / cycle_s).floor().min(f64::from(self.moves));
        let travel = match number < f64::from(self.moves) {
            true => self.profile.at((t_s - number * cycle_s - REST_S).max(0.0)),
            false => Default::default(),
        };
        let back = number as u32 % 2 == 1;
        let (from_m, sign) = if back { (4.0, -1.0) } else { (-4.0, 1.0) };
        State {
            position_m: Vector3::new(0.0, from_m + sign * travel.distance_m, 2.0),
            rotation_rad: Vector3::zeros(),
            velocity_m_s: Vector3::new(0.0, sign * travel.speed_m_s, 0.0),
            rotation_rate_rad_s: Vector3::zeros(),
            acceleration_m_s2: Vector3::new(0.0, sign * travel.acceleration_m_s2, 0.0),
        }
    }

    fn duration_s(&self) -> f64 {
        f64::from(self.moves) * (REST_S + self.profile.duration_s()) + REST_S
    }
}

/// What a scanner at 35 Hz sees of it, `delay_s` late.
fn measured(
    motion: &Loops,
    delay_s: f64,
    [noise_m, jitter_s]: [f64; 2],
    [gain, offset_m]: [f64; 2],
    number: u64,
) -> Vec<Measured> {
    let mut draws = Seed(7).draws(Purpose::Noise, number);
    let count = (motion.duration_s() * 35.0) as u32;
    (1..count)
        .map(|k| {
            let t_s = f64::from(k) / 35.0;
            let late_s = delay_s + jitter_s * draws.normal();
            let mut position_m = motion.at(t_s - late_s).position_m;
            position_m.y = gain * position_m.y + offset_m + noise_m * draws.normal();
            Measured { t_s, position_m }
        })
        .collect()
}

#[test]
fn without_noise_the_delay_is_exact() {
    let motion = Loops::new(4);
    for delay_s in [-0.06, 0.0, 0.0137, 0.062, 0.3] {
        let measured = measured(&motion, delay_s, [0.0; 2], [1.002, 0.02], 0);
        let found = fit(&measured, &motion, &DelaySettings::default()).unwrap();
        assert!((found.delay_s - delay_s).abs() < 1e-8, "{found:?}");
        let [axis] = found.axes[..] else {
            panic!("{found:?}")
        };
        assert_eq!(axis.axis, 1);
        assert!((axis.gain - 1.002).abs() < 1e-7 && (axis.offset_m - 0.02).abs() < 1e-7);
    }
}

#[test]
fn noise_and_jitter_are_found_and_the_error_is_honest() {
    let motion = Loops::new(10);
    let (mut squares, mut within, mut sigmas) = (0.0, 0, 0.0);
    let runs = 40;
    for number in 0..runs {
        let measured = measured(&motion, 0.062, [3e-3, 1e-3], [1.0, 0.0], number);
        let found = fit(&measured, &motion, &DelaySettings::default()).unwrap();
        let off_s = found.delay_s - 0.062;
        squares += off_s * off_s;
        within += u32::from(off_s.abs() < 2.0 * found.sigma_s);
        sigmas += found.sigma_s;
        let axis = found.axes[0];
        assert!((2e-3..4e-3).contains(&axis.noise_m), "{axis:?}");
        assert!((0.5e-3..1.6e-3).contains(&axis.jitter_s), "{axis:?}");
        assert_eq!(found.parts.len(), 5);
        for part in &found.parts {
            assert!(
                (part.delay_s - 0.062).abs() < 5.0 * part.sigma_s,
                "{part:?}"
            );
        }
    }
    let n = runs as f64;
    // The bound of this case is 48.5 us.
    let rms_us = (squares / n).sqrt() * 1e6;
    assert!((30.0..70.0).contains(&rms_us), "{rms_us}");
    assert!(within >= 34, "{within}");
    assert!((sigmas / n * 1e6 / rms_us - 1.0).abs() < 0.4);
}

#[test]
fn outliers_and_gaps_do_little() {
    let motion = Loops::new(10);
    let mut measured = measured(&motion, 0.062, [3e-3, 1e-3], [1.0, 0.0], 1);
    let mut draws = Seed(8).draws(Purpose::Outliers, 0);
    measured.retain(|_| draws.unit() > 0.05);
    for m in &mut measured {
        if draws.unit() < 0.01 {
            m.position_m.y += 0.1 * draws.normal();
        }
    }
    measured[5].position_m.y = f64::NAN;
    let found = fit(&measured, &motion, &DelaySettings::default()).unwrap();
    assert!((found.delay_s - 0.062).abs() < 250e-6, "{found:?}");
    assert!((5..40).contains(&found.outliers));
}

#[test]
fn common_methods_fail_as_known() {
    let motion = Loops::new(10);
    let settings = DelaySettings::default();
    let loops = measured(&motion, 0.060, [3e-3, 0.0], [1.0, 0.0], 2);
    let parabolic = correlation::parabolic(&loops, &motion, &settings).unwrap();
    assert!((parabolic - 0.060).abs() < 300e-6, "{parabolic}");
    let derivative = correlation::derivative(&loops, &motion, &settings).unwrap();
    assert!((derivative - 0.060).abs() < 2e-3, "{derivative}");
    // One way with a dwell at the ends: the plain correlation is drawn to zero, the normalised one
    // is not.
    let motion = Loops::new(1);
    let one_way = measured(&motion, 0.060, [3e-3, 0.0], [1.002, 0.02], 3);
    let plain = correlation::plain(&one_way, &motion, &settings).unwrap();
    assert!(plain.abs() < 0.04, "{plain}");
    let found = fit(&one_way, &motion, &settings).unwrap();
    assert!((found.delay_s - 0.060).abs() < 1e-3, "{found:?}");
    let stiff = DelaySettings {
        free_gain: false,
        free_offset: false,
        ..settings
    };
    let off_s = fit(&one_way, &motion, &stiff).unwrap().delay_s - 0.060;
    assert!(off_s.abs() > 3e-3, "{off_s}");
}

#[test]
fn the_curve_is_lowest_at_the_delay() {
    let motion = Loops::new(2);
    let measured = measured(&motion, 0.062, [0.0; 2], [1.0, 0.0], 0);
    let delays = (0..=120).map(|k| f64::from(k) * 1e-3);
    let points = curve(&measured, &motion, Stamp::default(), delays);
    let lowest = points
        .iter()
        .min_by(|a, b| a.rms_m[1].total_cmp(&b.rms_m[1]))
        .unwrap();
    assert!((lowest.delay_s - 0.062).abs() < 1e-9);
    assert!(lowest.max_m[1] < 1e-9);
    // Without compensation: 3.13 m/s for 62 ms.
    assert!((points[0].max_m[1] - 0.194).abs() < 2e-3, "{:?}", points[0]);
}

#[test]
fn the_dissertations_hand_finds_where_the_spike_is_least() {
    let motion = Loops::new(2);
    let late = measured(&motion, 0.062, [0.0; 2], [1.0, 0.0], 0);
    let settings = DelaySettings::default();
    let steps = dissertation(&late, &motion, &settings, Some(0.1), 5e-3).unwrap();
    assert_eq!(steps.delay_s(), steps.cross_correlation_s + 5e-3);
    let best_s = steps.cross_correlation_s + steps.best_adjustment_s;
    assert!((best_s - 0.062).abs() < 1e-9, "{steps:?}");
    // 3.13 m/s for 62 ms without compensation, and for 38 ms with the total delay.
    let [not, total, ..] = steps.spike_m;
    assert!(
        (not - 0.194).abs() < 2e-3 && (total - 0.119).abs() < 2e-3,
        "{steps:?}"
    );
    let unknown = dissertation(&late, &motion, &settings, None, 0.0).unwrap();
    assert!(unknown.spike_m[1].is_nan() && unknown.spike_m[2] == unknown.spike_m[3]);
    // One wild pose in a hundred is no spike.
    let mut wild = late.clone();
    for m in wild.iter_mut().step_by(150) {
        m.position_m.y += 5.0;
    }
    let steps = dissertation(&wild, &motion, &settings, None, 0.0).unwrap();
    assert!((steps.spike_m[0] - not).abs() < 2e-3, "{steps:?}");
}

#[test]
fn a_logged_motion_is_as_good() {
    let motion = Loops::new(2);
    let points: Vec<TrajectoryPoint> = (0..(motion.duration_s() * 35.0) as u32)
        .map(|k| {
            let t_s = f64::from(k) / 35.0;
            TrajectoryPoint {
                stamp: Stamp::from_ns(0).plus_s(t_s),
                position_m: motion.at(t_s).position_m.into(),
                rotation_rad: [0.0; 3],
                ..TrajectoryPoint::default()
            }
        })
        .collect();
    let logged = Sampled::new(&points).unwrap();
    let measured = measured(&motion, 0.062, [0.0; 2], [1.0, 0.0], 0);
    let found = fit(&measured, &logged, &DelaySettings::default()).unwrap();
    assert!((found.delay_s - 0.062).abs() < 20e-6, "{found:?}");
}

#[test]
fn nothing_to_see_is_said() {
    let motion = Loops::new(1);
    let settings = DelaySettings::default();
    assert!(matches!(
        fit(&[], &motion, &settings),
        Err(DelayError::TooFew { .. })
    ));
    let only_x = DelaySettings {
        axes: Some([true, false, false]),
        ..settings
    };
    let seen = measured(&motion, 0.06, [3e-3, 0.0], [1.0, 0.0], 0);
    assert_eq!(fit(&seen, &motion, &only_x), Err(DelayError::Still));
    let elsewhere: Vec<_> = seen
        .iter()
        .map(|m| Measured {
            t_s: m.t_s + 1e6,
            ..*m
        })
        .collect();
    let error = fit(&elsewhere, &motion, &settings);
    assert!(matches!(error, Err(DelayError::TooFew { .. })), "{error:?}");
}
