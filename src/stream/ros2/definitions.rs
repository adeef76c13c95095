//! Full definition texts (`ros2msg`): a type's own fields, then those of every type it uses, each
//! after a line of 80 `=` and its name.
//!
//! Field names and types are those of ROS 2 Humble to Jazzy; only the comments are left out. Our
//! own types have the columns of their record as fields.

use super::Keep;
use crate::record::{Presence, Record, Value, Visit};
use std::convert::Infallible;

/// Standard types: the name, and the fields as type and name.
const STANDARD: &[(&str, &str)] = &[
    ("builtin_interfaces/Duration", "int32 sec\nuint32 nanosec\n"),
    ("builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n"),
    (
        "std_msgs/Header",
        "builtin_interfaces/Time stamp\nstring frame_id\n",
    ),
    (
        "std_msgs/ColorRGBA",
        "float32 r\nfloat32 g\nfloat32 b\nfloat32 a\n",
    ),
    ("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n"),
    ("geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z\n"),
    (
        "geometry_msgs/Quaternion",
        "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1\n",
    ),
    (
        "geometry_msgs/Pose",
        "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n",
    ),
    (
        "geometry_msgs/PoseWithCovariance",
        "geometry_msgs/Pose pose\nfloat64[36] covariance\n",
    ),
    (
        "geometry_msgs/PoseWithCovarianceStamped",
        "std_msgs/Header header\ngeometry_msgs/PoseWithCovariance pose\n",
    ),
    (
        "geometry_msgs/Twist",
        "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n",
    ),
    (
        "geometry_msgs/TwistWithCovariance",
        "geometry_msgs/Twist twist\nfloat64[36] covariance\n",
    ),
    (
        "geometry_msgs/Transform",
        "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n",
    ),
    (
        "geometry_msgs/TransformStamped",
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n",
    ),
    (
        "tf2_msgs/TFMessage",
        "geometry_msgs/TransformStamped[] transforms\n",
    ),
    (
        "nav_msgs/Odometry",
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n\
         geometry_msgs/TwistWithCovariance twist\n",
    ),
    (
        "sensor_msgs/LaserScan",
        "std_msgs/Header header\nfloat32 angle_min\nfloat32 angle_max\nfloat32 angle_increment\n\
         float32 time_increment\nfloat32 scan_time\nfloat32 range_min\nfloat32 range_max\n\
         float32[] ranges\nfloat32[] intensities\n",
    ),
    (
        "sensor_msgs/Imu",
        "std_msgs/Header header\ngeometry_msgs/Quaternion orientation\n\
         float64[9] orientation_covariance\ngeometry_msgs/Vector3 angular_velocity\n\
         float64[9] angular_velocity_covariance\ngeometry_msgs/Vector3 linear_acceleration\n\
         float64[9] linear_acceleration_covariance\n",
    ),
    (
        "sensor_msgs/MagneticField",
        "std_msgs/Header header\ngeometry_msgs/Vector3 magnetic_field\n\
         float64[9] magnetic_field_covariance\n",
    ),
    (
        "sensor_msgs/CompressedImage",
        "std_msgs/Header header\nstring format\nuint8[] data\n",
    ),
    ("visualization_msgs/UVCoordinate", "float32 u\nfloat32 v\n"),
    (
        "visualization_msgs/MeshFile",
        "string filename\nuint8[] data\n",
    ),
    (
        "visualization_msgs/Marker",
        "int32 ARROW=0\nint32 CUBE=1\nint32 SPHERE=2\nint32 CYLINDER=3\nint32 LINE_STRIP=4\n\
         int32 LINE_LIST=5\nint32 CUBE_LIST=6\nint32 SPHERE_LIST=7\nint32 POINTS=8\n\
         int32 TEXT_VIEW_FACING=9\nint32 MESH_RESOURCE=10\nint32 TRIANGLE_LIST=11\n\
         int32 ARROW_STRIP=12\nint32 ADD=0\nint32 MODIFY=0\nint32 DELETE=2\nint32 DELETEALL=3\n\
         std_msgs/Header header\nstring ns\nint32 id\nint32 type\nint32 action\n\
         geometry_msgs/Pose pose\ngeometry_msgs/Vector3 scale\nstd_msgs/ColorRGBA color\n\
         builtin_interfaces/Duration lifetime\nbool frame_locked\ngeometry_msgs/Point[] points\n\
         std_msgs/ColorRGBA[] colors\nstring texture_resource\n\
         sensor_msgs/CompressedImage texture\nvisualization_msgs/UVCoordinate[] uv_coordinates\n\
         string text\nstring mesh_resource\nvisualization_msgs/MeshFile mesh_file\n\
         bool mesh_use_embedded_materials\n",
    ),
    (
        "visualization_msgs/MarkerArray",
        "visualization_msgs/Marker[] markers\n",
    ),
];

fn fields(name: &str) -> Option<&'static str> {
    let known = STANDARD.iter().find(|(known, _)| *known == name);
    known.map(|(_, fields)| *fields)
}

/// The full text of a standard type, given as `package/msg/Type`.
pub(in crate::stream) fn definition(type_name: &str) -> String {
    let root = type_name.replace("/msg/", "/");
    let mut text = fields(&root).unwrap_or_default().to_owned();
    let mut names = Vec::new();
    collect(&text, &mut names);
    for name in names {
        text.push_str(&"=".repeat(80));
        text.push_str("\nMSG: ");
        text.push_str(name);
        text.push('\n');
        text.push_str(fields(name).unwrap_or_default());
    }
    text
}

/// The types that `text` uses, and those that they use, each once.
fn collect(text: &str, names: &mut Vec<&'static str>) {
    for line in text.lines() {
        let used = line.split([' ', '[']).next().unwrap_or_default();
        let known = STANDARD.iter().find(|(name, _)| *name == used);
        if let Some((name, fields)) = known
            && !names.contains(name)
        {
            names.push(name);
            collect(fields, names);
        }
    }
}

/// The definition of a message that has the columns of a record which `keep` chooses.
pub(super) fn of_columns<R: Record>(keep: Keep) -> String {
    struct List(String, Keep);
    impl Visit for List {
        type Error = Infallible;
        fn column<T: Value>(
            &mut self,
            name: &'static str,
            _: Presence,
            _: &T,
        ) -> Result<(), Infallible> {
            if self.1(name) {
                self.0.push_str(T::ROS_TYPE);
                self.0.push(' ');
                self.0.push_str(name);
                self.0.push('\n');
            }
            Ok(())
        }
    }
    let mut list = List(String::new(), keep);
    let Ok(()) = R::default().visit(&mut list);
    list.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::ClockExchange;

    #[test]
    fn every_type_that_is_used_is_defined() {
        let built_in = [
            "bool", "uint8", "int32", "uint32", "float32", "float64", "string",
        ];
        for (name, fields) in STANDARD {
            for line in fields.lines() {
                let used = line.split([' ', '[']).next().unwrap();
                let known = STANDARD.iter().any(|(name, _)| *name == used);
                assert!(known || built_in.contains(&used), "{name}: {line}");
            }
        }
    }

    #[test]
    fn dependencies_follow_once_each() {
        let text = definition("geometry_msgs/msg/PoseWithCovarianceStamped");
        let names: Vec<&str> = text
            .lines()
            .filter_map(|l| l.strip_prefix("MSG: "))
            .collect();
        assert_eq!(
            names,
            [
                "std_msgs/Header",
                "builtin_interfaces/Time",
                "geometry_msgs/PoseWithCovariance",
                "geometry_msgs/Pose",
                "geometry_msgs/Point",
                "geometry_msgs/Quaternion",
            ]
        );
        assert!(text.starts_with("std_msgs/Header header\n"));
    }

    #[test]
    fn our_own_types_have_the_columns() {
        let fields = of_columns::<ClockExchange>(|_| true);
        let first = "int64 host_send_ns\nint64 device_ns\nint64 host_receive_ns\n";
        assert!(fields.starts_with(first), "{fields}");
        assert!(fields.ends_with("reply_bytes\n"), "{fields}");
    }
}
