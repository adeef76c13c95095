//! Messages that only a 3D viewer needs: where the laser sits on the platform, and the frame's
//! box, plates and strips.

use super::cdr;
use super::check::BadField;
use super::ros2::types::{
    Color, FRAME, Header, LASER, Marker, MarkerArray, PLATFORM, Point, Pose, TfMessage, Transform,
    TransformStamped, Vector3,
};
use super::ros2::{MARKERS, TF_STATIC, Topic, rotation};
use crate::frame::{Frame, Scanner, Strip};
use crate::record::{Face, Stamp};
use nalgebra::UnitQuaternion;

/// A message for a viewer, to be written with [`super::Emit::note`]; its time is that of the
/// record that was written before it.
#[derive(Clone, Debug)]
pub struct Note {
    topic: &'static Topic,
    encode: Message,
}

#[derive(Clone, Debug)]
enum Message {
    Markers(MarkerArray),
    Transforms(TfMessage),
}

impl Note {
    pub(super) fn topic(&self) -> &'static Topic {
        self.topic
    }

    /// Appends the message, stamped, to `out`.
    pub(super) fn encode(&self, stamp: Stamp, out: &mut Vec<u8>) -> Result<(), BadField> {
        match &self.encode {
            Message::Markers(array) => {
                let mut array = array.clone();
                for marker in &mut array.markers {
                    marker.header.stamp = stamp.into();
                }
                cdr::encode(out, &array)
            }
            Message::Transforms(message) => {
                let mut message = message.clone();
                for transform in &mut message.transforms {
                    transform.header.stamp = stamp.into();
                }
                cdr::encode(out, &message)
            }
        }
    }
}

/// Where the laser is on the platform: `/tf_static`. A LaserScan's angles are counted from +x of
/// its frame in the x-y plane, so the frame `laser` has x = y of S, y = z of S, z = x of S.
pub fn laser_mounting(scanner: &Scanner) -> Note {
    let [roll, pitch, yaw] = scanner.rotation_deg.map(f64::to_radians);
    let scanner_on_platform = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
    // A third of a turn about (1, 1, 1): x to y, y to z, z to x.
    let third = nalgebra::Quaternion::new(0.5, 0.5, 0.5, 0.5);
    let q = scanner_on_platform * UnitQuaternion::new_unchecked(third);
    Note {
        topic: &TF_STATIC,
        encode: Message::Transforms(TfMessage {
            transforms: vec![TransformStamped {
                header: Header::new(Stamp::default(), PLATFORM),
                child_frame_id: LASER.to_owned(),
                transform: Transform {
                    translation: Vector3::new(scanner.position_m),
                    rotation: q.into(),
                },
            }],
        }),
    }
}

const LINE_LIST: i32 = 5;
const TRIANGLE_LIST: i32 = 11;
const GREY: [f32; 4] = [0.6, 0.6, 0.6, 1.0];
const SILVER: [f32; 4] = [0.85, 0.85, 0.9, 0.9];

/// The frame's box, plates and strips as markers in B: `/markers`.
pub fn frame_messages(frame: &Frame) -> Vec<Note> {
    let mut markers = vec![box_edges(frame)];
    let plates = frame.plates.iter().map(|plate| {
        let y = side_y(frame, plate.face);
        let ([x0, x1], [z0, z1]) = (plate.x_m, plate.z_m);
        (
            "plate",
            [[x0, y, z0], [x1, y, z0], [x1, y, z1], [x0, y, z1]],
        )
    });
    let strips = frame
        .strips
        .iter()
        .map(|strip| ("strip", strip_corners(frame, strip)));
    for (i, (ns, corners)) in plates.chain(strips).enumerate() {
        markers.push(quad(ns, i, corners));
    }
    vec![Note {
        topic: &MARKERS,
        encode: Message::Markers(MarkerArray { markers }),
    }]
}

fn side_y(frame: &Frame, face: Face) -> f64 {
    let half = frame.bounds.dy_m / 2.0;
    if face == Face::Right { half } else { -half }
}

/// A strip's corners: both edges from the front of its depth to the back.
fn strip_corners(frame: &Frame, strip: &Strip) -> [[f64; 3]; 4] {
    let [x0, x1] = strip.x_span_m(&frame.bounds);
    let reach = strip.width_m / 2.0;
    [(x0, -reach), (x1, -reach), (x1, reach), (x0, reach)].map(|(x, side)| {
        let across = strip.offset_m + side + x * strip.slope();
        match strip.face {
            Face::Upper => [x, across, frame.bounds.dz_m],
            Face::Right | Face::Left => [x, side_y(frame, strip.face), across],
        }
    })
}

fn marker(ns: &str, id: usize, kind: i32, colour: [f32; 4]) -> Marker {
    let [r, g, b, a] = colour;
    Marker {
        header: Header::new(Stamp::default(), FRAME),
        ns: ns.to_owned(),
        id: i32::try_from(id).unwrap_or(i32::MAX),
        kind,
        pose: Pose {
            orientation: rotation::quaternion([0.0; 3]),
            ..Pose::default()
        },
        color: Color { r, g, b, a },
        frame_locked: true,
        ..Marker::default()
    }
}

fn quad(ns: &str, id: usize, corners: [[f64; 3]; 4]) -> Marker {
    let [a, b, c, d] = corners.map(Point::new);
    Marker {
        scale: Vector3::new([1.0; 3]),
        points: vec![a.clone(), b, c.clone(), a, c, d],
        ..marker(ns, id, TRIANGLE_LIST, SILVER)
    }
}

fn box_edges(frame: &Frame) -> Marker {
    let half = [frame.bounds.dx_m / 2.0, frame.bounds.dy_m / 2.0];
    let dz = frame.bounds.dz_m;
    let corner = |bits: usize| {
        let side = |axis: usize, half: f64| if bits >> axis & 1 == 1 { half } else { -half };
        let z = if bits >> 2 & 1 == 1 { dz } else { 0.0 };
        Point::new([side(0, half[0]), side(1, half[1]), z])
    };
    let edges = (0..8usize).flat_map(|from| {
        let to = (0..3).map(move |axis| from | 1 << axis);
        to.filter(move |to| *to != from).map(move |to| (from, to))
    });
    Marker {
        // The width of the lines.
        scale: Vector3::new([0.02, 0.0, 0.0]),
        points: edges
            .flat_map(|(from, to)| [corner(from), corner(to)])
            .collect(),
        ..marker("box", 0, LINE_LIST, GREY)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3 as V;

    fn cablar() -> Frame {
        let text = include_str!("../../testdata/cablar.toml");
        Frame::parse(text, std::path::Path::new("cablar.toml")).unwrap()
    }

    #[test]
    fn the_laser_frame_turns_a_scan_into_the_scan_plane() {
        let note = laser_mounting(&Scanner::default());
        let Message::Transforms(message) = &note.encode else {
            panic!("not a transform");
        };
        let q = &message.transforms[0].transform.rotation;
        let q = UnitQuaternion::new_normalize(nalgebra::Quaternion::new(q.w, q.x, q.y, q.z));
        let delta = 0.7f64;
        // A beam in the laser's frame, and the same beam in S.
        let beam = q * V::new(delta.cos(), delta.sin(), 0.0);
        assert!((beam - V::new(0.0, delta.cos(), delta.sin())).norm() < 1e-15);
    }

    #[test]
    fn the_frame_is_drawn() {
        let notes = frame_messages(&cablar());
        let Message::Markers(array) = &notes[0].encode else {
            panic!("no markers");
        };
        assert_eq!(array.markers.len(), 1 + 2 + 4);
        assert_eq!(array.markers[0].points.len(), 2 * 12);
        // The first strip: 3.9 m off the middle, 0.8 m wide, inclined by 30 degrees.
        let corners: Vec<[f64; 3]> = array.markers[3]
            .points
            .iter()
            .map(Point::to_array)
            .collect();
        let y = 3.9 - 0.4 - 0.75 * 30f64.to_radians().tan();
        assert!((corners[0][1] - y).abs() < 1e-12);
        assert_eq!(corners[0][2], 5.5);
        let mut out = Vec::new();
        notes[0].encode(Stamp::from_ns(5), &mut out).unwrap();
        let (back, _) = cdr::decode::<MarkerArray>(&out).unwrap();
        assert_eq!(back.markers.len(), array.markers.len());
        assert_eq!(back.markers[2].header.stamp.nanosec, 5);
    }
}
