use super::*;
use crate::motion::{Limits, Motion, Quintic, Shuttle};
use crate::record::TrajectoryPoint;
use crate::simulate::Seed;
use crate::simulate::random::Purpose;
use nalgebra::{UnitQuaternion, Vector3};
use proptest::prelude::*;

const PERIOD_S: f64 = 1.0 / 35.0;
const DELAY_S: f64 = 0.062;

fn stamp(t_s: f64) -> Stamp {
    Stamp::from_ns(1_700_000_000_000_000_000).plus_s(t_s)
}

fn carrier(method: CarryMethod) -> Carrier {
    let options = CarryOptions {
        method,
        ..CarryOptions::default()
    };
    Carrier::new(options, Inertia::default())
}

/// A pose with sigmas of 0.5 mm and 0.2 mrad.
fn pose(t_s: f64, position_m: Vector3<f64>, attitude: &UnitQuaternion<f64>) -> Pose {
    let mut covariance = [0.0; 21];
    for i in 0..6 {
        let sigma: f64 = if i < 3 { 5e-4 } else { 2e-4 };
        covariance[upper_index(6, i, i)] = sigma * sigma;
    }
    Pose {
        stamp: stamp(t_s),
        scan_stamp: stamp(t_s) + 5,
        position_m: position_m.into(),
        rotation_rad: turn::euler(attitude),
        covariance,
        // Not NaN, so that poses can be compared.
        range_bias_m: 0.0,
        ..Pose::default()
    }
}

fn level(t_s: f64, position_m: Vector3<f64>) -> Pose {
    pose(t_s, position_m, &UnitQuaternion::identity())
}

fn off_m(pose: &Pose, position_m: Vector3<f64>) -> f64 {
    (Vector3::from(pose.position_m) - position_m).norm()
}

fn off_rad(pose: &Pose, attitude: &UnitQuaternion<f64>) -> f64 {
    turn::attitude(pose.rotation_rad).angle_to(attitude)
}

/// Feeds a motion for a while; the last pose, carried.
fn after(
    carrier: &mut Carrier,
    seconds: f64,
    position_m: impl Fn(f64) -> Vector3<f64>,
    attitude: impl Fn(f64) -> UnitQuaternion<f64>,
) -> (f64, Pose) {
    let mut carried = Pose::default();
    let mut used_s = 0.0;
    for k in 0..(seconds / PERIOD_S) as u32 {
        let t = f64::from(k) * PERIOD_S;
        let pose = pose(t, position_m(t), &attitude(t));
        carrier.measure(&pose, pose.stamp);
        used_s = t + DELAY_S;
        carried = carrier.carried(&pose, pose.stamp, stamp(used_s));
        assert_eq!(carried.stamp, stamp(used_s));
        assert_eq!(carried.scan_stamp, pose.scan_stamp);
    }
    (used_s, carried)
}

#[test]
fn a_constant_velocity_is_carried_exactly() {
    let place = |t: f64| Vector3::new(0.1, -4.0 + 2.9 * t, 0.5 + 0.9 * t);
    for method in [
        CarryMethod::ConstantVelocity,
        CarryMethod::ConstantAcceleration,
    ] {
        let (t, carried) = after(&mut carrier(method), 2.0, place, |_| {
            UnitQuaternion::identity()
        });
        assert!(off_m(&carried, place(t)) < 1e-4, "{method:?}");
        // Not carrying is 180 mm off.
        let (t, late) = after(&mut carrier(CarryMethod::None), 2.0, place, |_| {
            UnitQuaternion::identity()
        });
        assert!((off_m(&late, place(t)) - DELAY_S * (2.9f64 * 2.9 + 0.81).sqrt()).abs() < 1e-9);
    }
}

#[test]
fn a_constant_acceleration_is_carried_exactly() {
    let place = |t: f64| Vector3::new(0.0, -3.0 + 1.5 * t * t, 0.5 + 0.4 * t * t);
    let (t, carried) = after(
        &mut carrier(CarryMethod::ConstantAcceleration),
        1.4,
        place,
        |_| UnitQuaternion::identity(),
    );
    assert!(off_m(&carried, place(t)) < 2e-4);
}

#[test]
fn a_turn_about_a_fixed_axis_is_carried_as_a_rotation() {
    // Far from level, where rates of roll, pitch and yaw are anything but constant.
    let rate = Vector3::new(0.3, 0.5, -0.4);
    let turned = |t: f64| turn::turn(rate * t) * turn::attitude([0.4, 0.9, 2.8]);
    for method in [
        CarryMethod::ConstantVelocity,
        CarryMethod::ConstantAcceleration,
    ] {
        let (t, carried) = after(&mut carrier(method), 2.0, |_| Vector3::zeros(), turned);
        let off = off_rad(&carried, &turned(t));
        assert!(off < 1e-4, "{method:?} {off}");
    }
}

/// A desired motion that moves and turns, as points every 10 ms.
fn desired(t: f64) -> (Vector3<f64>, Vector3<f64>, UnitQuaternion<f64>) {
    (
        Vector3::new(0.0, (2.0 * t).sin(), 1.0 + 0.3 * t),
        Vector3::new(0.0, 2.0 * (2.0 * t).cos(), 0.3),
        turn::turn(Vector3::new(0.2, 0.1, -0.1) * t),
    )
}

fn guided(method: CarryMethod, until_s: f64) -> Carrier {
    let mut carrier = carrier(method);
    for k in 0..=(until_s / 0.01).round() as u32 {
        let t = f64::from(k) * 0.01;
        let (position, velocity, attitude) = desired(t);
        carrier.guide().push(&TrajectoryPoint {
            stamp: stamp(t),
            position_m: position.into(),
            rotation_rad: turn::euler(&attitude),
            velocity_m_s: velocity.into(),
        });
    }
    carrier
}

#[test]
fn a_desired_motion_moves_the_measured_pose() {
    let (from, to) = (0.5, 0.5 + DELAY_S);
    let (start, v0, turned) = desired(from);
    let (end, v1, turned_on) = desired(to);
    // The platform is off its desired pose, and stays so.
    let off = Vector3::new(0.01, -0.02, 0.03);
    let tilt = turn::turn(Vector3::new(0.02, 0.0, 0.01));
    let measured = pose(from, start + off, &(turned * tilt));
    let carry = |method| {
        let mut carrier = guided(method, 1.0);
        carrier.measure(&measured, measured.stamp);
        carrier.carried(&measured, measured.stamp, stamp(to))
    };
    let exact = carry(CarryMethod::DesiredExact);
    assert!(off_m(&exact, end + off) < 1e-7);
    assert!(off_rad(&exact, &(turned_on * tilt)) < 1e-9);
    assert_eq!(exact.status, Status::OK);
    // As published: the mean of the two velocities times the delay, and no better.
    let trapezoid = carry(CarryMethod::DesiredTrapezoid);
    assert!(off_m(&trapezoid, start + off + (v0 + v1) * (DELAY_S / 2.0)) < 1e-7);
    assert!(off_m(&trapezoid, end + off) > 1e-5);
    assert!(off_rad(&trapezoid, &(turned_on * tilt)) < 1e-9);
    // What is known stays as well known: the motion is taken as certain.
    assert!((exact.cov(1, 1) - 2.5e-7).abs() < 1e-12);
}

#[test]
fn a_desired_motion_that_ends_is_extrapolated_and_then_not_believed() {
    let mut carrier = guided(CarryMethod::DesiredExact, 0.53);
    let statuses: Vec<Status> = (0..24)
        .map(|k| {
            let t = f64::from(k) * PERIOD_S;
            let pose = level(t, desired(t).0);
            carrier.measure(&pose, pose.stamp);
            let carried = carrier.carried(&pose, pose.stamp, stamp(t + DELAY_S));
            // A motion at the desired one's end goes on, or the poses' own is used.
            assert!(off_m(&carried, desired(t + DELAY_S).0) < 0.05 || k < 3);
            carried.status
        })
        .collect();
    assert!(statuses[..16].iter().all(|status| status.is_ok()));
    assert_eq!(statuses[17], Status::EXTRAPOLATED);
    assert_eq!(statuses[23], Status::STALE_MOTION);
}

#[test]
fn further_than_the_limit_the_numbers_are_empty() {
    let mut carrier = carrier(CarryMethod::ConstantVelocity);
    let pose = level(0.0, Vector3::new(0.0, 1.0, 2.0));
    carrier.measure(&pose, pose.stamp);
    for (horizon_s, far) in [(0.499, false), (0.501, true), (-0.501, true), (1e9, true)] {
        let carried = carrier.carried(&pose, pose.stamp, stamp(horizon_s));
        assert_eq!(carried.is_solved(), !far);
        assert_eq!(carried.status.has(Status::TOO_FAR | Status::NO_POSE), far);
        assert_eq!(carried.components().iter().any(|v| v.is_nan()), far);
    }
}

#[test]
fn what_is_missing_stays_missing_and_harms_nothing() {
    let place = |t: f64| Vector3::new(0.0, 1.0 * t, 2.0);
    let mut carrier = carrier(CarryMethod::ConstantVelocity);
    for k in 0..40 {
        let t = f64::from(k) * PERIOD_S;
        let mut pose = level(t, place(t));
        if k % 7 == 3 {
            pose = Pose {
                stamp: pose.stamp,
                status: Status::NO_POSE,
                ..Pose::default()
            };
        } else {
            // No edges: x and yaw are not known, nor what they have to do with the rest.
            pose.position_m[0] = f64::NAN;
            pose.rotation_rad[2] = f64::NAN;
            for other in 0..6 {
                pose.covariance[upper_index(6, 0, other)] = f64::NAN;
                pose.covariance[upper_index(6, other, 5)] = f64::NAN;
            }
            pose.status = Status::NO_EDGES;
        }
        carrier.measure(&pose, pose.stamp);
        let carried = carrier.carried(&pose, pose.stamp, stamp(t + DELAY_S));
        assert_eq!(carried.status, pose.status);
        for (before, after) in pose.components().iter().zip(carried.components()) {
            assert_eq!(before.is_nan(), after.is_nan());
        }
        for (before, after) in pose.covariance.iter().zip(carried.covariance) {
            assert_eq!(before.is_nan(), after.is_nan());
        }
        if k > 5 && pose.is_solved() {
            assert!(
                (carried.position_m[1] - place(t + DELAY_S).y).abs() < 2e-3,
                "{k}"
            );
        }
    }
}

#[test]
fn a_pose_out_of_order_passes_and_teaches_nothing() {
    let place = |t: f64| Vector3::new(0.0, 2.0 * t, 2.0);
    let (mut steady, mut disturbed) = (
        carrier(CarryMethod::ConstantAcceleration),
        carrier(CarryMethod::ConstantAcceleration),
    );
    for k in 0..40 {
        let t = f64::from(k) * PERIOD_S;
        let pose = level(t, place(t));
        steady.measure(&pose, pose.stamp);
        disturbed.measure(&pose, pose.stamp);
        let expected = steady.carried(&pose, pose.stamp, stamp(t + DELAY_S));
        let got = disturbed.carried(&pose, pose.stamp, stamp(t + DELAY_S));
        assert_eq!(got, expected);
        // The pose before once more, and wrong; then the same stamp twice.
        for again_s in [t - PERIOD_S, t] {
            let late = level(again_s, place(again_s) + Vector3::new(0.0, 0.2, 0.0));
            disturbed.measure(&late, late.stamp);
            let carried = disturbed.carried(&late, late.stamp, stamp(again_s + DELAY_S));
            assert!(carried.is_solved());
            if k > 10 {
                let expected = place(again_s + DELAY_S) + Vector3::new(0.0, 0.2, 0.0);
                assert!(off_m(&carried, expected) < 1e-3);
            }
        }
    }
}

#[test]
fn after_a_gap_nothing_is_known_of_the_motion() {
    let mut carrier = carrier(CarryMethod::ConstantAcceleration);
    let place = |t: f64| Vector3::new(0.0, 2.0 * t, 2.0);
    let (_, carried) = after(&mut carrier, 1.0, place, |_| UnitQuaternion::identity());
    assert!(carried.cov(1, 1).sqrt() < 5e-3);
    // It went on for a while and then stopped; that was not seen.
    let pose = level(5.0, Vector3::new(0.0, 6.0, 2.0));
    carrier.measure(&pose, pose.stamp);
    let carried = carrier.carried(&pose, pose.stamp, stamp(5.0 + DELAY_S));
    assert!(off_m(&carried, Vector3::new(0.0, 6.0, 2.0)) < 1e-9);
    assert!(carried.cov(1, 1).sqrt() > 0.03);
}

#[test]
fn one_wild_pose_does_not_set_the_platform_in_motion() {
    let rest = Vector3::new(0.0, 1.0, 2.0);
    let mut carrier = carrier(CarryMethod::ConstantAcceleration);
    for k in 0..100 {
        let t = f64::from(k) * PERIOD_S;
        let wild = k == 60;
        let off = if wild { 0.1 } else { 0.0 };
        let pose = level(t, rest + Vector3::new(0.0, off, 0.0));
        carrier.measure(&pose, pose.stamp);
        let carried = carrier.carried(&pose, pose.stamp, stamp(t + DELAY_S));
        assert!(
            off_m(&carried, rest + Vector3::new(0.0, off, 0.0)) < 1e-3,
            "{k}"
        );
    }
    // A platform that has really been moved is believed after a few poses.
    let mut last = f64::NAN;
    for k in 100..140 {
        let t = f64::from(k) * PERIOD_S;
        let pose = level(t, rest + Vector3::new(0.0, 0.5, 0.0));
        carrier.measure(&pose, pose.stamp);
        let carried = carrier.carried(&pose, pose.stamp, stamp(t + DELAY_S));
        last = off_m(&carried, rest + Vector3::new(0.0, 0.5, 0.0));
    }
    assert!(last < 1e-3, "{last}");
}

#[test]
fn an_uncertain_delay_shows_along_the_motion_only() {
    let mut carrier = Carrier::new(
        CarryOptions {
            method: CarryMethod::ConstantVelocity,
            delay_sigma_s: 5e-3,
            ..CarryOptions::default()
        },
        Inertia::default(),
    );
    let place = |t: f64| Vector3::new(0.0, 3.0 * t, 2.0);
    let (_, carried) = after(&mut carrier, 2.0, place, |_| UnitQuaternion::identity());
    assert!((carried.cov(1, 1).sqrt() - 0.015).abs() < 1e-3);
    assert!(carried.cov(2, 2).sqrt() < 5e-3);
}

/// An IMU on a platform that turns about a fixed axis and accelerates, at 100 Hz.
fn sample(t: f64, rate: Vector3<f64>, bias: Vector3<f64>) -> crate::record::ImuSample {
    let attitude = turn::turn(rate * t);
    let body = attitude.inverse() * rate;
    let force = attitude.inverse() * (accelerating(t).1 + Vector3::z() * 9.80665) + bias;
    crate::record::ImuSample {
        stamp: stamp(t),
        gyro_x_rad_s: body.x,
        gyro_y_rad_s: body.y,
        gyro_z_rad_s: body.z,
        accel_x_m_s2: force.x,
        accel_y_m_s2: force.y,
        accel_z_m_s2: force.z,
        ..crate::record::ImuSample::default()
    }
}

/// Position and acceleration that no polynomial of the poses before foresees.
fn accelerating(t: f64) -> (Vector3<f64>, Vector3<f64>) {
    let w = 6.0;
    (
        Vector3::new(0.0, 0.1 * (w * t).sin(), 2.0),
        Vector3::new(0.0, -0.1 * w * w * (w * t).sin(), 0.0),
    )
}

#[test]
fn an_imu_carries_attitude_and_position() {
    let rate = Vector3::new(0.2, -0.1, 0.3);
    let bias = Vector3::new(0.05, -0.08, 0.1);
    let mut carrier = carrier(CarryMethod::Imu);
    let mut samples = (0..400).map(|k| sample(f64::from(k) * 0.01, rate, bias));
    let (mut worst_m, mut worst_rad) = (0.0f64, 0.0f64);
    for k in 0..100 {
        let t = f64::from(k) * PERIOD_S;
        let used_s = t + DELAY_S;
        while carrier.inertia().newest().is_none_or(|s| s < stamp(used_s)) {
            carrier.inertia().push(&samples.next().unwrap());
        }
        let pose = pose(t, accelerating(t).0, &turn::turn(rate * t));
        carrier.measure(&pose, pose.stamp);
        let carried = carrier.carried(&pose, pose.stamp, stamp(used_s));
        assert_eq!(carried.status, Status::OK);
        if k > 50 {
            worst_m = worst_m.max(off_m(&carried, accelerating(used_s).0));
            worst_rad = worst_rad.max(off_rad(&carried, &turn::turn(rate * used_s)));
        }
    }
    // Acceleration alone would be 0.5 a t^2 = 7 mm off, and the jerk 0.9 mm.
    assert!(worst_m < 1e-3, "{worst_m}");
    assert!(worst_rad < 1e-4, "{worst_rad}");
}

#[test]
fn an_imu_that_falls_silent_is_said_and_replaced() {
    let mut carrier = carrier(CarryMethod::Imu);
    let pose = |t: f64| level(t, Vector3::new(0.0, t, 2.0));
    carrier.measure(&pose(0.0), stamp(0.0));
    let carried = carrier.carried(&pose(0.0), stamp(0.0), stamp(DELAY_S));
    assert_eq!(carried.status, Status::NO_IMU);
    for k in 0..60 {
        let t = f64::from(k) * PERIOD_S;
        if t < 1.0 {
            for step in 0..4 {
                let mut sample = sample(
                    t + f64::from(step) * 0.01,
                    Vector3::zeros(),
                    Vector3::zeros(),
                );
                sample.accel_y_m_s2 = 0.0;
                carrier.inertia().push(&sample);
            }
        }
        carrier.measure(&pose(t), stamp(t));
        let carried = carrier.carried(&pose(t), stamp(t), stamp(t + DELAY_S));
        if t > 1.2 {
            assert_eq!(carried.status, Status::STALE_IMU);
            assert!(off_m(&carried, Vector3::new(0.0, t + DELAY_S, 2.0)) < 2e-3);
        }
    }
}

/// Poses of known noise along a quintic of 3.13 m/s: errors stay small and the covariance honest.
#[test]
fn the_covariance_is_honest_on_a_smooth_run() {
    let place = |y: f64| crate::motion::Pose {
        position_m: Vector3::new(0.0, y, 2.0),
        rotation_rad: Vector3::zeros(),
    };
    let limits = Limits {
        speed_m_s: 3.13,
        acceleration_m_s2: 5.0,
        jerk_m_s3: 50.0,
    };
    let motion = Shuttle {
        from: place(-4.0),
        to: place(4.0),
        profile: Quintic::new(8.0, limits),
        dwell_s: 0.5,
        loops: 1,
    };
    for (method, most_m) in [
        (CarryMethod::ConstantVelocity, 15e-3),
        (CarryMethod::ConstantAcceleration, 7e-3),
    ] {
        let (mut nees, mut n, mut worst_m) = (0.0, 0.0, 0.0f64);
        for seed in 1..=4 {
            let mut carrier = carrier(method);
            for k in 0..(motion.duration_s() / PERIOD_S) as u64 {
                let mut draws = Seed(seed).draws(Purpose::Noise, k);
                let t = k as f64 * PERIOD_S;
                let noise = Vector3::from_fn(|_, _| 5e-4 * draws.normal());
                let pose = level(t, motion.at(t).position_m + noise);
                carrier.measure(&pose, pose.stamp);
                let carried = carrier.carried(&pose, pose.stamp, stamp(t + DELAY_S));
                if k < 3 {
                    continue;
                }
                let off = carried.position_m[1] - motion.at(t + DELAY_S).position_m.y;
                worst_m = worst_m.max(off.abs());
                nees += off * off / carried.cov(1, 1);
                n += 1.0;
            }
        }
        assert!(worst_m < most_m, "{method:?}: {worst_m}");
        assert!((0.5..1.6).contains(&(nees / n)), "{method:?}: {}", nees / n);
    }
}

proptest! {
    /// Whatever comes, in whatever order: the stamp is right, covariances are positive, missing
    /// numbers stay missing, and carrying by nothing changes nothing.
    #[test]
    fn anything_passes(
        steps in proptest::collection::vec(
            (-0.2..1.5f64, -5.0..5.0f64, 0.0..5.0f64, -3.0..3.0f64, 0u8..8),
            1..60,
        ),
        method in 0usize..6,
    ) {
        let method = [
            CarryMethod::None,
            CarryMethod::DesiredExact,
            CarryMethod::DesiredTrapezoid,
            CarryMethod::ConstantVelocity,
            CarryMethod::ConstantAcceleration,
            CarryMethod::Imu,
        ][method];
        let mut carrier = guided(method, 3.0);
        for k in 0..100 {
            carrier.inertia().push(&sample(
                f64::from(k) * 0.02,
                Vector3::new(0.1, 0.2, 0.3),
                Vector3::zeros(),
            ));
        }
        let mut t = 0.0;
        for (step, y, z, yaw, kind) in steps {
            t += step;
            let mut pose = pose(t, Vector3::new(0.0, y, z), &turn::attitude([0.1, -0.1, yaw]));
            match kind {
                0 => pose = Pose { stamp: pose.stamp, status: Status::NO_POSE, ..Pose::default() },
                1 => pose.position_m[0] = f64::NAN,
                2 => pose.covariance = [f64::NAN; 21],
                3 => pose.covariance = [0.0; 21],
                _ => {}
            }
            carrier.measure(&pose, pose.stamp);
            let still = carrier.carried(&pose, pose.stamp, pose.stamp);
            prop_assert_eq!(still.stamp, pose.stamp);
            if pose.is_solved() {
                prop_assert!(off_rad(&still, &turn::attitude(pose.rotation_rad)) < 1e-7);
                prop_assert!((still.position_m[1] - pose.position_m[1]).abs() < 1e-12);
            }
            let carried = carrier.carried(&pose, pose.stamp, stamp(t + DELAY_S));
            prop_assert_eq!(carried.stamp, stamp(t + DELAY_S));
            for (i, (before, after)) in
                pose.components().iter().zip(carried.components()).enumerate()
            {
                prop_assert_eq!(before.is_nan(), after.is_nan());
                if carried.cov(i, i).is_finite() {
                    prop_assert!(carried.cov(i, i) >= 0.0);
                    if i < 3 {
                        prop_assert!(carried.cov(i, i) >= pose.cov(i, i) * (1.0 - 1e-9));
                    }
                }
            }
        }
    }
}
