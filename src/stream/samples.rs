//! Records with a value in every column, and strategies for arbitrary ones, for the tests.

use crate::record::{
    Axes, ClockExchange, Edge, EdgeBasis, EdgeKind, Face, FittedLine, ImuSample, NormalLine, Pose,
    Ranges, ReflectorLines, Scan, ScanInfo, Segment, Stamp, Status, TrajectoryPoint, upper_index,
};
use proptest::collection::vec;
use proptest::option;
use proptest::prelude::*;

pub(super) const START: Stamp = Stamp::from_ns(1_700_000_000_123_456_789);

pub(super) fn scan() -> Scan {
    Scan {
        stamp: START,
        received: Some(START + 30_000_000),
        device: Some(Stamp::from_ns(77)),
        seq: 5,
        angle_min_rad: (-5f64).to_radians(),
        angle_increment_rad: 0.25f64.to_radians(),
        time_increment_s: 0.25 / 360.0 / 35.0,
        scan_time_s: 1.0 / 35.0,
        range_min_m: 0.2,
        range_max_m: 65.0,
        ranges_m: vec![1.292, 5.123457, f64::INFINITY, f64::NEG_INFINITY, 65.533].into(),
        remissions: vec![0.0, 17.0, 254.5, 65535.0, 3.0],
        further_ranges_m: vec![Ranges::default(), vec![2.0; 5].into()],
        further_remissions: vec![vec![1.0; 5]],
        info: Some(Box::new(ScanInfo {
            transmit: Some(Stamp::from_ns(99)),
            telegram_counter: Some(65535),
            encoder: vec![-3, 7],
            scan_frequency_hz: 35.0,
            device_name: "LMS511, \"left\"\nwall".to_owned(),
            ..ScanInfo::default()
        })),
    }
}

pub(super) fn pose() -> Pose {
    let mut covariance = [0.0; 21];
    for row in 0..6 {
        for col in row..6 {
            let diagonal = if row == col { 5e-6 } else { 1e-7 };
            covariance[upper_index(6, row, col)] = diagonal * (1.0 + row as f64);
        }
    }
    Pose {
        stamp: START + 1000,
        scan_stamp: START,
        seq: 5,
        position_m: [0.012, -3.75, 1.0 / 3.0],
        rotation_rad: [0.01, -0.002, 0.05],
        covariance,
        edges: 16,
        votes: Some(12),
        range_bias_m: -0.011,
        status: Status::STALE_IMU | Status::FEW_EDGES,
        pushed: Some(START + 45_000_000),
    }
}

pub(super) fn imu() -> ImuSample {
    ImuSample {
        stamp: START,
        received: Some(START + 5),
        seq: 7,
        axes: Axes::Ned,
        roll_rad: 0.1,
        pitch_rad: -0.2,
        accel_z_m_s2: -9.81,
        mag_x_gauss: 0.2,
        mag_y_gauss: 0.0,
        mag_z_gauss: 0.45,
        pitch_sigma_rad: 0.004,
        accel_sigma_m_s2: 0.026,
        ..ImuSample::default()
    }
}

pub(super) fn point() -> TrajectoryPoint {
    TrajectoryPoint {
        stamp: START,
        position_m: [0.1, -2.0, 1.7],
        rotation_rad: [0.02, 0.01, -0.4],
        velocity_m_s: [0.0, 1.5, -0.25],
    }
}

pub(super) fn segment() -> Segment {
    Segment {
        stamp: START,
        seq: 4,
        line: 2,
        normal: NormalLine::new(1.292, 0.3),
        ends_m: [[1.0, 2.0], [3.0, -4.5]],
        points: 321,
        covariance: [1e-6, -2e-9, 3e-8],
        rms_m: 0.0041,
    }
}

fn stamp() -> impl Strategy<Value = Stamp> {
    (0..4_000_000_000_000_000_000i64).prop_map(Stamp::from_ns)
}

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        8 => prop::num::f64::NORMAL | prop::num::f64::SUBNORMAL | prop::num::f64::ZERO,
        4 => -10.0..10.0f64,
        2 => Just(f64::NAN),
        1 => prop_oneof![Just(f64::INFINITY), Just(f64::NEG_INFINITY)],
    ]
}

fn finite() -> impl Strategy<Value = f64> {
    -20.0..20.0f64
}

/// What both encodings hold exactly: micrometres up to 16 m, millimetres beyond.
fn range_m() -> impl Strategy<Value = f64> {
    prop_oneof![
        6 => (0..16_000_000u32).prop_map(|um| f64::from(um) / 1e6),
        6 => (0..80_000u32).prop_map(|mm| f64::from(mm) / 1e3),
        1 => Just(f64::INFINITY),
        1 => Just(f64::NEG_INFINITY),
        1 => Just(f64::NAN),
    ]
}

fn remission() -> impl Strategy<Value = f32> {
    prop_oneof![
        (0..65_536u32).prop_map(|digits| digits as f32),
        0.0..1000.0f32
    ]
}

fn info() -> impl Strategy<Value = ScanInfo> {
    let numbers = vec(option::of(any::<u32>()), 6);
    let lists = (vec(any::<i64>(), 0..5), vec(finite(), 0..8), ".{0,12}");
    (option::of(stamp()), numbers, lists, number()).prop_map(|(transmit, n, lists, hz)| ScanInfo {
        transmit,
        telegram_counter: n[0],
        scan_counter: n[1],
        device_status: n[2],
        inputs: n[3],
        layer: n[4],
        angular_step_raw: n[5],
        encoder: lists.0,
        position: lists.1,
        comment: lists.2,
        scan_frequency_hz: hz,
        ..ScanInfo::default()
    })
}

prop_compose! {
    pub(super) fn any_scan()(beams in 1..40usize)(
        stamps in (stamp(), option::of(stamp()), option::of(stamp()), any::<u32>()),
        angles in (finite(), 1e-4..1.0f64, finite(), number(), number(), number()),
        ranges in vec(range_m(), beams),
        remissions in prop_oneof![vec(remission(), 0), vec(remission(), beams)],
        echoes in vec(vec(range_m(), beams), 0..=4),
        echo_remissions in vec(vec(remission(), beams), 0..=4),
        info in option::of(info()),
    ) -> Scan {
        Scan {
            stamp: stamps.0,
            received: stamps.1,
            device: stamps.2,
            seq: stamps.3,
            angle_min_rad: angles.0,
            angle_increment_rad: angles.1,
            time_increment_s: angles.2,
            scan_time_s: angles.3,
            range_min_m: angles.4,
            range_max_m: angles.5,
            ranges_m: ranges.into(),
            remissions,
            further_ranges_m: echoes.into_iter().map(Ranges).collect(),
            further_remissions: echo_remissions,
            info: info.filter(|info| !info.is_missing()).map(Box::new),
        }
    }
}

prop_compose! {
    pub(super) fn any_imu()(
        stamps in (stamp(), option::of(stamp()), option::of(stamp()), any::<u32>()),
        axes in prop_oneof![Just(Axes::Ned), Just(Axes::Enu), Just(Axes::Platform)],
        n in vec(number(), 12),
        // A column that is there in some rows only would be left out by the first.
        sigma in vec(1e-6..10.0f64, 5),
    ) -> ImuSample {
        ImuSample {
            stamp: stamps.0,
            received: stamps.1,
            device: stamps.2,
            seq: stamps.3,
            axes,
            roll_rad: n[0],
            pitch_rad: n[1],
            yaw_rad: n[2],
            gyro_x_rad_s: n[3],
            gyro_y_rad_s: n[4],
            gyro_z_rad_s: n[5],
            accel_x_m_s2: n[6],
            accel_y_m_s2: n[7],
            accel_z_m_s2: n[8],
            mag_x_gauss: n[9],
            mag_y_gauss: n[10],
            mag_z_gauss: n[11],
            roll_sigma_rad: sigma[0],
            pitch_sigma_rad: sigma[1],
            yaw_sigma_rad: sigma[2],
            gyro_sigma_rad_s: sigma[3],
            accel_sigma_m_s2: sigma[4],
        }
    }
}

prop_compose! {
    fn line()(n in vec(number(), 6), points in any::<u32>()) -> FittedLine {
        FittedLine {
            normal: NormalLine { d_m: n[0], alpha_rad: n[1] },
            cov_dd: n[2],
            cov_da: n[3],
            cov_aa: n[4],
            points,
            rms_m: n[5],
        }
    }
}

prop_compose! {
    fn edge()(
        face in prop_oneof![Just(Face::Right), Just(Face::Upper), Just(Face::Left)],
        kind in prop_oneof![Just(EdgeKind::On), Just(EdgeKind::Off)],
        strip in -1..20i32,
        n in vec(finite(), 5),
        sub_beam in option::of((finite(), finite(), finite())),
        basis in prop_oneof![
            Just(EdgeBasis::Interval),
            Just(EdgeBasis::Remission),
            Just(EdgeBasis::Echoes),
            Just(EdgeBasis::Saturated),
            Just(EdgeBasis::Ambiguous),
        ],
    ) -> Edge {
        let (edge_rad, sigma_rad, cov_next_rad2) = sub_beam.unwrap_or((f64::NAN, f64::NAN, 0.0));
        Edge {
            face,
            strip,
            kind,
            from_rad: n[0],
            to_rad: n[1],
            edge_rad,
            sigma_rad,
            d_threshold: n[2],
            d_footprint: n[3],
            cov_next_rad2,
            basis,
            time_s: n[4],
        }
    }
}

prop_compose! {
    pub(super) fn any_lines()(
        stamps in (stamp(), stamp(), any::<u32>()),
        lines in (line(), line(), line()),
        n in vec(number(), 4),
        joint_cov in prop_oneof![vec(number(), 0), vec(number(), 28)],
        edges in vec(edge(), 0..17),
    ) -> ReflectorLines {
        ReflectorLines {
            stamp: stamps.0,
            scan_stamp: stamps.1,
            seq: stamps.2,
            right: lines.0,
            upper: lines.1,
            left: lines.2,
            range_bias_m: n[0],
            joint_cov,
            motion_vy_m_s: n[1],
            motion_vz_m_s: n[2],
            motion_roll_rad_s: n[3],
            edges,
        }
    }
}

prop_compose! {
    pub(super) fn any_pose()(
        stamps in (stamp(), stamp(), any::<u32>(), any::<u32>(), option::of(any::<u32>())),
        n in vec(finite(), 6),
        missing in 0..9usize,
        covariance in vec(number(), 21),
        range_bias_m in number(),
    ) -> Pose {
        let mut pose = Pose {
            stamp: stamps.0,
            scan_stamp: stamps.1,
            seq: stamps.2,
            position_m: [n[0], n[1], n[2]],
            rotation_rad: [n[3], n[4], n[5]],
            covariance: covariance.try_into().unwrap(),
            edges: stamps.3,
            votes: stamps.4,
            range_bias_m,
            status: Status::OK,
            pushed: None,
        };
        match missing {
            0..3 => {
                pose.rotation_rad[missing] = f64::NAN;
                pose.status = Status::NO_YAW | Status::DISAGREE;
            }
            3 => {
                pose = Pose { status: Status::NO_POSE, ..Pose::default() };
            }
            _ => {}
        }
        pose
    }
}

prop_compose! {
    pub(super) fn any_point()(
        stamp in stamp(), n in vec(finite(), 6), v in vec(number(), 3),
    ) -> TrajectoryPoint {
        TrajectoryPoint {
            stamp,
            position_m: [n[0], n[1], n[2]],
            rotation_rad: [n[3], n[4], n[5]],
            velocity_m_s: [v[0], v[1], v[2]],
        }
    }
}

prop_compose! {
    pub(super) fn any_segment()(
        stamp in stamp(), seq in any::<u32>(), line in any::<u32>(), points in any::<u32>(),
        d in (finite(), finite()), n in vec(number(), 8),
    ) -> Segment {
        Segment {
            stamp,
            seq,
            line,
            normal: NormalLine { d_m: d.0, alpha_rad: d.1 },
            ends_m: [[n[0], n[1]], [n[2], n[3]]],
            points,
            covariance: [n[4], n[5], n[6]],
            rms_m: n[7],
        }
    }
}

prop_compose! {
    pub(super) fn any_exchange()(
        s in (stamp(), stamp(), stamp()), more in (stamp(), stamp(), any::<u32>()),
    ) -> ClockExchange {
        ClockExchange {
            host_send: s.0,
            device: s.1,
            host_receive: s.2,
            host_last: Some(more.0),
            host_send_raw: Some(more.1),
            host_receive_raw: Some(more.0),
            request_bytes: Some(more.2),
            reply_bytes: None,
        }
    }
}
