//! The wire form against a second CDR encoder and by hand, and every record there and back.

use super::types::{
    Header, Imu, LaserScanHead, Odometry, PoseWithCovarianceStamped, Square6, TfMessage, Time,
};
use super::*;
use crate::record::{Pose, Ranges, Scan, Status, TrajectoryPoint};
use crate::stream::cdr as ours;
use crate::stream::samples;
use serde::{Deserialize, Serialize};

/// `cdr`'s form of a message: the same header, written by somebody else.
fn second_opinion(message: &impl Serialize) -> Vec<u8> {
    ::cdr::serialize::<_, _, ::cdr::CdrLe>(message, ::cdr::Infinite).unwrap()
}

/// A LaserScan in one piece, as no code of ours has it.
#[derive(Serialize, Deserialize)]
struct LaserScan {
    head: LaserScanHead,
    ranges: Vec<f32>,
    intensities: Vec<f32>,
}

fn bodies<R: Messages>(record: &R, role: Role) -> Bodies {
    let mut out = Bodies::default();
    record.encode(role, &mut out).unwrap();
    out
}

fn body(bodies: &Bodies, topic: &str) -> Vec<u8> {
    let found = bodies.iter().find(|(t, _)| t.name == topic);
    found.unwrap_or_else(|| panic!("no {topic}")).1.to_vec()
}

#[test]
fn a_second_encoder_writes_the_same_bytes() {
    let scan = samples::scan();
    let bytes = body(&bodies(&scan, Role::Desired), "/scan");
    let whole: LaserScan = ::cdr::deserialize(&bytes).unwrap();
    assert_eq!(second_opinion(&whole), bytes);
    assert_eq!(whole.ranges.len(), scan.beams());
    assert_eq!(whole.intensities, scan.remissions);

    let pose = bodies(&samples::pose(), Role::Desired);
    let (message, _) = ours::decode::<PoseWithCovarianceStamped>(&body(&pose, "/pose")).unwrap();
    assert_eq!(second_opinion(&message), body(&pose, "/pose"));
    let (message, _) = ours::decode::<TfMessage>(&body(&pose, "/tf")).unwrap();
    assert_eq!(second_opinion(&message), body(&pose, "/tf"));

    let imu = bodies(&samples::imu(), Role::Desired);
    let (message, _) = ours::decode::<Imu>(&body(&imu, "/imu")).unwrap();
    assert_eq!(second_opinion(&message), body(&imu, "/imu"));

    let truth = bodies(&samples::point(), Role::Truth);
    let (message, _) = ours::decode::<Odometry>(&body(&truth, "/truth")).unwrap();
    assert_eq!(second_opinion(&message), body(&truth, "/truth"));
}

/// The columns of a record, which no struct of ours lists a second time.
#[test]
fn a_second_encoder_reads_our_own_types() {
    #[derive(Serialize, Deserialize, PartialEq, Debug)]
    struct Segment {
        stamp_ns: i64,
        seq: u32,
        line: u32,
        numbers: [f64; 6],
        points: u32,
        covariance: [f64; 3],
        rms_m: f64,
    }
    let segment = samples::segment();
    let bytes = body(&bodies(&segment, Role::Desired), "/segments");
    let read: Segment = ::cdr::deserialize(&bytes).unwrap();
    assert_eq!(read.stamp_ns, segment.stamp.ns());
    assert_eq!((read.line, read.points), (segment.line, segment.points));
    assert_eq!(read.numbers[0], segment.normal.d_m);
    assert_eq!(read.rms_m, segment.rms_m);
    assert_eq!(second_opinion(&read), bytes);
}

#[test]
fn a_message_by_hand() {
    let scan = Scan {
        stamp: Stamp::from_ns(3_000_000_004),
        angle_min_rad: 0.5,
        angle_increment_rad: 0.25,
        time_increment_s: 0.0,
        scan_time_s: 0.0,
        range_min_m: 0.0,
        range_max_m: 1.0,
        ranges_m: vec![1.5, f64::INFINITY].into(),
        ..Scan::default()
    };
    #[rustfmt::skip]
    let expected = [
        0, 1, 0, 0, // plain CDR, little-endian
        3, 0, 0, 0, // sec
        4, 0, 0, 0, // nanosec
        6, 0, 0, 0, b'l', b'a', b's', b'e', b'r', 0, // frame_id with its end
        0, 0, // to a multiple of 4
        0, 0, 0, 0x3f, // angle_min 0.5
        0, 0, 0x40, 0x3f, // angle_max 0.75
        0, 0, 0x80, 0x3e, // angle_increment 0.25
        0, 0, 0, 0, // time_increment
        0, 0, 0, 0, // scan_time
        0, 0, 0, 0, // range_min
        0, 0, 0x80, 0x3f, // range_max 1
        2, 0, 0, 0, // ranges
        0, 0, 0xc0, 0x3f, // 1.5
        0, 0, 0x80, 0x7f, // inf
        0, 0, 0, 0, // intensities
    ];
    assert_eq!(body(&bodies(&scan, Role::Desired), "/scan"), expected);
}

/// Feeds messages to a reader and gives out the records it makes complete.
fn read<R: Messages>(bodies: &Bodies, only: &[&str], role: Role) -> Vec<R> {
    let mut record = R::default();
    let mut parts = R::Parts::default();
    let mut records = Vec::new();
    for (topic, body) in bodies.iter() {
        let read_from = R::read_from(role).iter().find(|t| t.name == topic.name);
        let Some(topic) = read_from else { continue };
        if !only.is_empty() && !only.contains(&topic.name) {
            continue;
        }
        let sequence = bodies.sequence.unwrap_or(0);
        let message = Message { sequence, body };
        if record.decode(topic, message, &mut parts).unwrap() {
            records.push(record.clone());
        }
    }
    records
}

#[test]
fn standard_topics_alone_can_be_read() {
    let scan = samples::scan();
    let foreign: Vec<Scan> = read(&bodies(&scan, Role::Desired), &["/scan"], Role::Desired);
    assert_eq!(foreign.len(), 1);
    assert_eq!(foreign[0].ranges_m, scan.ranges_m);
    assert_eq!(foreign[0].seq, scan.seq);
    assert!((foreign[0].angle_min_rad - scan.angle_min_rad).abs() < 1e-7);
    assert!(foreign[0].further_ranges_m.is_empty() && foreign[0].info.is_none());

    let pose = samples::pose();
    let foreign: Vec<Pose> = read(&bodies(&pose, Role::Desired), &["/pose"], Role::Desired);
    assert_eq!(foreign.len(), 1);
    for (read, value) in foreign[0].components().iter().zip(pose.components()) {
        assert!((read - value).abs() < 1e-14);
    }
    for (read, value) in foreign[0].covariance.iter().zip(pose.covariance) {
        assert!((read - value).abs() < 1e-18);
    }

    let imu = samples::imu();
    let only = ["/imu", "/mag"];
    let foreign: Vec<crate::record::ImuSample> =
        read(&bodies(&imu, Role::Desired), &only, Role::Desired);
    assert_eq!(foreign.len(), 1);
    assert_eq!(foreign[0].axes, imu.axes);
    assert!((foreign[0].pitch_rad - imu.pitch_rad).abs() < 1e-14);
    assert!((foreign[0].mag_z_gauss - imu.mag_z_gauss).abs() < 1e-14);
    assert!((foreign[0].pitch_sigma_rad - imu.pitch_sigma_rad).abs() < 1e-15);
    assert!(foreign[0].roll_sigma_rad.is_nan());
    assert!(foreign[0].yaw_rad.is_nan() && foreign[0].gyro_x_rad_s.is_nan());

    let point = samples::point();
    let foreign: Vec<TrajectoryPoint> =
        read(&bodies(&point, Role::Truth), &["/truth"], Role::Truth);
    assert_eq!(foreign.len(), 1);
    for (read, value) in foreign[0].velocity_m_s.iter().zip(point.velocity_m_s) {
        assert!((read - value).abs() < 1e-14);
    }
}

/// Odometry's twist is in the child's axes: driving along the frame's y while turned by 90 degrees
/// to the left is driving ahead.
#[test]
fn the_twist_is_in_the_child_frame() {
    let point = TrajectoryPoint {
        position_m: [0.0; 3],
        rotation_rad: [0.0, 0.0, std::f64::consts::FRAC_PI_2],
        velocity_m_s: [0.0, 2.0, 0.0],
        ..TrajectoryPoint::default()
    };
    let bytes = body(&bodies(&point, Role::Desired), "/desired");
    let (odometry, _) = ours::decode::<Odometry>(&bytes).unwrap();
    assert!((odometry.twist.twist.linear.x - 2.0).abs() < 1e-15);
    assert!(odometry.twist.twist.linear.y.abs() < 1e-15);
    assert_eq!(odometry.child_frame_id, "desired");
}

#[test]
fn a_scan_without_a_pose_is_only_a_status() {
    let none = Pose {
        status: Status::NO_POSE,
        ..Pose::default()
    };
    let bodies = bodies(&none, Role::Desired);
    let topics: Vec<&str> = bodies.iter().map(|(topic, _)| topic.name).collect();
    assert_eq!(topics, ["/pose_status"]);
}

#[test]
fn parts_of_another_scan_are_not_mixed_in() {
    let scan = samples::scan();
    let mut later = scan.clone();
    later.stamp = scan.stamp + 1;
    later.seq = 9;
    let (first, second) = (bodies(&scan, Role::Desired), bodies(&later, Role::Desired));
    let mut record = Scan::default();
    let mut parts = Default::default();
    // Everything of the first scan but its /scan, then only the /scan of the second.
    for (topic, body) in first.iter().filter(|(topic, _)| topic.name != "/scan") {
        let message = Message { sequence: 1, body };
        assert!(!record.decode(topic, message, &mut parts).unwrap());
    }
    let (topic, body) = second.iter().last().unwrap();
    let message = Message { sequence: 9, body };
    assert!(record.decode(topic, message, &mut parts).unwrap());
    assert_eq!(record.stamp, later.stamp);
    assert_eq!(record.seq, 9);
    assert_eq!(record.info, None);
    assert_eq!(record.further_ranges_m, Vec::<Ranges>::new());
}

#[test]
fn damaged_messages_are_errors() {
    let scan = bodies(&samples::scan(), Role::Desired);
    let (topic, whole) = scan.iter().last().unwrap();
    for length in 0..whole.len() {
        let message = Message {
            sequence: 0,
            body: &whole[..length],
        };
        let result = Scan::default().decode(topic, message, &mut Default::default());
        assert!(result.is_err(), "{length} of {} bytes", whole.len());
    }
    let big_endian = [0, 0, 0, 0, 1, 2, 3, 4];
    assert!(ours::decode::<Time>(&big_endian).is_err());
    let text = ours::decode::<Header>(&[0, 1, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 255, 255, 255, 255]);
    assert!(text.is_err());
}

#[test]
fn a_matrix_has_no_lengths() {
    let mut out = Vec::new();
    ours::encode(&mut out, &Square6::default()).unwrap();
    assert_eq!(out.len(), 4 + 36 * 8);
}
