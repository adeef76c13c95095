//! The standard messages' fields in wire order, as their definitions have them.

use crate::record::Stamp;
use serde::{Deserialize, Serialize};

/// The frame of reference B in messages.
pub(crate) const FRAME: &str = "frame";
/// The platform P.
pub(crate) const PLATFORM: &str = "platform";
/// The laser: x = y of S, y = z of S, z = x of S, so that a LaserScan's angles are a scan's.
pub(crate) const LASER: &str = "laser";

/// Stands in a covariance, whose zeros mean "not stated", for a quantity that is not known.
pub(crate) const UNKNOWN_VARIANCE: f64 = 1e9;

macro_rules! messages {
    ($($(#[$doc:meta])* $name:ident { $($field:ident: $type:ty),* $(,)? })*) => {
        $(
            $(#[$doc])*
            #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
            pub(crate) struct $name { $(pub(crate) $field: $type),* }
        )*
    };
}

/// builtin_interfaces/msg/Time
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Time {
    pub(crate) sec: i32,
    pub(crate) nanosec: u32,
}

impl From<Stamp> for Time {
    /// Saturates in 1901 and 2038, where the message's seconds end.
    fn from(stamp: Stamp) -> Time {
        let sec = stamp.ns().div_euclid(1_000_000_000);
        let limit = if sec < 0 { i32::MIN } else { i32::MAX };
        Time {
            sec: i32::try_from(sec).unwrap_or(limit),
            nanosec: stamp.ns().rem_euclid(1_000_000_000) as u32,
        }
    }
}

impl From<Time> for Stamp {
    fn from(time: Time) -> Stamp {
        Stamp::from_ns(i64::from(time.sec) * 1_000_000_000 + i64::from(time.nanosec))
    }
}

messages! {
    /// std_msgs/msg/Header
    Header { stamp: Time, frame_id: String }
    /// geometry_msgs/msg/Vector3
    Vector3 { x: f64, y: f64, z: f64 }
    /// geometry_msgs/msg/Point
    Point { x: f64, y: f64, z: f64 }
    /// geometry_msgs/msg/Quaternion
    Quaternion { x: f64, y: f64, z: f64, w: f64 }
    /// geometry_msgs/msg/Pose
    Pose { position: Point, orientation: Quaternion }
    /// geometry_msgs/msg/PoseWithCovariance
    PoseWithCovariance { pose: Pose, covariance: Square6 }
    /// geometry_msgs/msg/PoseWithCovarianceStamped
    PoseWithCovarianceStamped { header: Header, pose: PoseWithCovariance }
    /// geometry_msgs/msg/Twist
    Twist { linear: Vector3, angular: Vector3 }
    /// geometry_msgs/msg/TwistWithCovariance
    TwistWithCovariance { twist: Twist, covariance: Square6 }
    /// nav_msgs/msg/Odometry
    Odometry {
        header: Header,
        child_frame_id: String,
        pose: PoseWithCovariance,
        twist: TwistWithCovariance,
    }
    /// geometry_msgs/msg/Transform
    Transform { translation: Vector3, rotation: Quaternion }
    /// geometry_msgs/msg/TransformStamped
    TransformStamped { header: Header, child_frame_id: String, transform: Transform }
    /// tf2_msgs/msg/TFMessage
    TfMessage { transforms: Vec<TransformStamped> }
    /// sensor_msgs/msg/LaserScan up to its two arrays
    LaserScanHead {
        header: Header,
        angle_min: f32,
        angle_max: f32,
        angle_increment: f32,
        time_increment: f32,
        scan_time: f32,
        range_min: f32,
        range_max: f32,
    }
    /// sensor_msgs/msg/Imu
    Imu {
        header: Header,
        orientation: Quaternion,
        orientation_covariance: [f64; 9],
        angular_velocity: Vector3,
        angular_velocity_covariance: [f64; 9],
        linear_acceleration: Vector3,
        linear_acceleration_covariance: [f64; 9],
    }
    /// sensor_msgs/msg/MagneticField, tesla
    MagneticField { header: Header, magnetic_field: Vector3, magnetic_field_covariance: [f64; 9] }
    /// std_msgs/msg/ColorRGBA
    Color { r: f32, g: f32, b: f32, a: f32 }
    /// builtin_interfaces/msg/Duration
    Duration { sec: i32, nanosec: u32 }
    /// sensor_msgs/msg/CompressedImage
    CompressedImage { header: Header, format: String, data: Vec<u8> }
    /// visualization_msgs/msg/UVCoordinate
    UvCoordinate { u: f32, v: f32 }
    /// visualization_msgs/msg/MeshFile
    MeshFile { filename: String, data: Vec<u8> }
    /// visualization_msgs/msg/Marker
    Marker {
        header: Header,
        ns: String,
        id: i32,
        kind: i32,
        action: i32,
        pose: Pose,
        scale: Vector3,
        color: Color,
        lifetime: Duration,
        frame_locked: bool,
        points: Vec<Point>,
        colors: Vec<Color>,
        texture_resource: String,
        texture: CompressedImage,
        uv_coordinates: Vec<UvCoordinate>,
        text: String,
        mesh_resource: String,
        mesh_file: MeshFile,
        mesh_use_embedded_materials: bool,
    }
    /// visualization_msgs/msg/MarkerArray
    MarkerArray { markers: Vec<Marker> }
}

impl Header {
    pub(crate) fn new(stamp: Stamp, frame_id: &str) -> Header {
        Header {
            stamp: stamp.into(),
            frame_id: frame_id.to_owned(),
        }
    }
}

impl Point {
    pub(crate) fn new([x, y, z]: [f64; 3]) -> Point {
        Point { x, y, z }
    }

    pub(crate) fn to_array(&self) -> [f64; 3] {
        [self.x, self.y, self.z]
    }
}

impl Vector3 {
    pub(crate) fn new([x, y, z]: [f64; 3]) -> Vector3 {
        Vector3 { x, y, z }
    }

    pub(crate) fn to_array(&self) -> [f64; 3] {
        [self.x, self.y, self.z]
    }
}

/// A 6 by 6 matrix, row by row. serde stops at arrays of 32, so it is six rows to it; the wire
/// form of fixed arrays has no lengths and is the same.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Square6(pub(crate) [[f64; 6]; 6]);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_before_the_epoch_and_beyond_2038() {
        let there_and_back = |ns| Stamp::from(Time::from(Stamp::from_ns(ns))).ns();
        for ns in [0, 1, -1, -1_000_000_001, 1_700_000_000_123_456_789] {
            assert_eq!(there_and_back(ns), ns);
        }
        assert_eq!(Time::from(Stamp::from_ns(i64::MAX)).sec, i32::MAX);
        assert_eq!(Time::from(Stamp::from_ns(i64::MIN)).sec, i32::MIN);
    }
}
