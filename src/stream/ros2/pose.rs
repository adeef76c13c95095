//! A pose: `/pose_status` with every column, then `/pose` and `/tf` if there are numbers.

use super::rotation;
use super::types::{
    FRAME, Header, PLATFORM, Point, Pose as PoseMessage, PoseWithCovariance,
    PoseWithCovarianceStamped, Square6, TfMessage, Transform, TransformStamped, Vector3,
};
use super::{Bodies, Exact, MARKERS, Message, Messages, TF, TF_STATIC, Topic, definitions, every};
use crate::record::{Pose, Stamp, Status};
use crate::stream::check::BadField;
use crate::stream::{Role, cdr};

static POSE_STATUS: Topic = Topic {
    name: "/pose_status",
    type_name: "cablepose_msgs/msg/PoseStatus",
    definition: |_| definitions::of_columns::<Pose>(every),
};
static POSE: Topic = Topic::standard("/pose", "geometry_msgs/msg/PoseWithCovarianceStamped");
static READ: [&Topic; 2] = [&POSE_STATUS, &POSE];
static WRITTEN: [&Topic; 5] = [&POSE_STATUS, &POSE, &TF, &TF_STATIC, &MARKERS];

impl Messages for Pose {
    type Parts = Exact;

    fn read_from(_: Role) -> &'static [&'static Topic] {
        &READ
    }

    fn written_to(_: Role) -> &'static [&'static Topic] {
        &WRITTEN
    }

    fn encode(&self, _: Role, out: &mut Bodies) -> Result<(), BadField> {
        out.sequence = Some(self.seq);
        out.add(&POSE_STATUS, |out| cdr::encode_columns(out, self, every))?;
        if !self.is_solved() || self.components().iter().any(|v| !v.is_finite()) {
            return Ok(());
        }
        let header = Header::new(self.stamp, FRAME);
        let orientation = rotation::quaternion(self.rotation_rad);
        let pose = PoseWithCovarianceStamped {
            header: header.clone(),
            pose: PoseWithCovariance {
                pose: PoseMessage {
                    position: Point::new(self.position_m),
                    orientation: orientation.clone(),
                },
                covariance: rotation::to_fixed_axes(&self.covariance, self.rotation_rad),
            },
        };
        out.add(&POSE, |out| cdr::encode(out, &pose))?;
        let transform = TransformStamped {
            header,
            child_frame_id: PLATFORM.to_owned(),
            transform: Transform {
                translation: Vector3::new(self.position_m),
                rotation: orientation,
            },
        };
        let transforms = vec![transform];
        out.add(&TF, |out| cdr::encode(out, &TfMessage { transforms }))
    }

    fn decode(
        &mut self,
        topic: &'static Topic,
        message: Message<'_>,
        exact: &mut Exact,
    ) -> Result<bool, BadField> {
        if topic.name == POSE_STATUS.name {
            cdr::decode_columns(message.body, self, every, None)?;
            exact.set(self.stamp);
            return Ok(true);
        }
        let (pose, _) = cdr::decode::<PoseWithCovarianceStamped>(message.body)?;
        if exact.repeats(pose.header.stamp) {
            return Ok(false);
        }
        let stamp = Stamp::from(pose.header.stamp);
        let rotation_rad = rotation::euler(&pose.pose.pose.orientation);
        *self = Pose {
            stamp,
            scan_stamp: stamp,
            seq: message.sequence,
            position_m: pose.pose.pose.position.to_array(),
            rotation_rad,
            // All zero is ROS's way to say that nothing is known of it.
            covariance: if pose.pose.covariance == Square6::default() {
                [f64::NAN; 21]
            } else {
                rotation::from_fixed_axes(&pose.pose.covariance, rotation_rad)
            },
            status: Status::OK,
            ..Pose::default()
        };
        Ok(true)
    }
}
