//! A point of the true or the desired trajectory: `/truth_info` or `/desired_info` with every
//! column, then `/truth` or `/desired` for other programs.

use super::types::{
    FRAME, Header, Odometry, Point, Pose, PoseWithCovariance, Square6, Twist, TwistWithCovariance,
    UNKNOWN_VARIANCE, Vector3,
};
use super::{Bodies, Exact, Message, Messages, Topic, definitions, every, rotation};
use crate::record::{Stamp, TrajectoryPoint};
use crate::stream::check::BadField;
use crate::stream::{Role, cdr};

const fn exact(name: &'static str) -> Topic {
    Topic {
        name,
        type_name: "cablepose_msgs/msg/TrajectoryPoint",
        definition: |_| definitions::of_columns::<TrajectoryPoint>(every),
    }
}

static TRUTH_INFO: Topic = exact("/truth_info");
static TRUTH: Topic = Topic::standard("/truth", "nav_msgs/msg/Odometry");
static DESIRED_INFO: Topic = exact("/desired_info");
static DESIRED: Topic = Topic::standard("/desired", "nav_msgs/msg/Odometry");
static TRUTH_TOPICS: [&Topic; 2] = [&TRUTH_INFO, &TRUTH];
static DESIRED_TOPICS: [&Topic; 2] = [&DESIRED_INFO, &DESIRED];

impl Messages for TrajectoryPoint {
    type Parts = Exact;

    fn read_from(role: Role) -> &'static [&'static Topic] {
        match role {
            Role::Truth => &TRUTH_TOPICS,
            Role::Desired => &DESIRED_TOPICS,
        }
    }

    fn written_to(role: Role) -> &'static [&'static Topic] {
        TrajectoryPoint::read_from(role)
    }

    fn encode(&self, role: Role, out: &mut Bodies) -> Result<(), BadField> {
        let (info, standard, child) = match role {
            Role::Truth => (&TRUTH_INFO, &TRUTH, "truth"),
            Role::Desired => (&DESIRED_INFO, &DESIRED, "desired"),
        };
        out.add(info, |out| cdr::encode_columns(out, self, every))?;
        out.add(standard, |out| cdr::encode(out, &to_message(self, child)))
    }

    fn decode(
        &mut self,
        topic: &'static Topic,
        message: Message<'_>,
        exact: &mut Exact,
    ) -> Result<bool, BadField> {
        if topic.name == TRUTH_INFO.name || topic.name == DESIRED_INFO.name {
            cdr::decode_columns(message.body, self, every, None)?;
            exact.set(self.stamp);
            return Ok(true);
        }
        let (odometry, _) = cdr::decode::<Odometry>(message.body)?;
        if exact.repeats(odometry.header.stamp) {
            return Ok(false);
        }
        *self = from_message(&odometry);
        Ok(true)
    }
}

/// The standard message, whose twist is in the axes of the child frame.
fn to_message(point: &TrajectoryPoint, child: &str) -> Odometry {
    let known = point.velocity_m_s.iter().all(|v| v.is_finite());
    let (linear, variance) = if known {
        (
            rotation::to_child(point.rotation_rad, point.velocity_m_s),
            0.0,
        )
    } else {
        ([0.0; 3], UNKNOWN_VARIANCE)
    };
    let mut twist_covariance = Square6::default();
    for axis in 0..3 {
        twist_covariance.0[axis][axis] = variance;
    }
    Odometry {
        header: Header::new(point.stamp, FRAME),
        child_frame_id: child.to_owned(),
        pose: PoseWithCovariance {
            pose: Pose {
                position: Point::new(point.position_m),
                orientation: rotation::quaternion(point.rotation_rad),
            },
            covariance: Square6::default(),
        },
        twist: TwistWithCovariance {
            twist: Twist {
                linear: Vector3::new(linear),
                angular: Vector3::default(),
            },
            covariance: twist_covariance,
        },
    }
}

fn from_message(odometry: &Odometry) -> TrajectoryPoint {
    let rotation_rad = rotation::euler(&odometry.pose.pose.orientation);
    let known = odometry.twist.covariance.0[0][0] < UNKNOWN_VARIANCE;
    TrajectoryPoint {
        stamp: Stamp::from(odometry.header.stamp),
        position_m: odometry.pose.pose.position.to_array(),
        rotation_rad,
        velocity_m_s: if known {
            rotation::from_child(rotation_rad, odometry.twist.twist.linear.to_array())
        } else {
            [f64::NAN; 3]
        },
    }
}
