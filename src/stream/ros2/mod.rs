//! Records as ROS 2 messages.

use crate::record::{
    ClockExchange, ImuSample, Pose, Record, ReflectorLines, Scan, Segment, TrajectoryPoint,
};

/// How a record maps to messages.
pub trait Messages: Record {}
impl Messages for Scan {}
impl Messages for ImuSample {}
impl Messages for ReflectorLines {}
impl Messages for Pose {}
impl Messages for TrajectoryPoint {}
impl Messages for Segment {}
impl Messages for ClockExchange {}
