//! Records as ROS 2 messages: which topics a record goes to and how it is put together again.
//!
//! A standard message ([`geometry_msgs`'s pose](types), say) is what other programs read, but it
//! cannot hold everything: a pose's status, a scan's exact angles, Euler angles to the last digit.
//! So every record also goes, with its CSV columns as fields, to a topic of its own
//! (`/pose_status`, `/scan_info`), which is written first. A reader of ours takes that one and
//! passes over the standard message that follows it; a file that has only the standard topic is
//! read from there. Either way a record is complete with a message that has already come.

mod definitions;
mod imu;
mod plain;
mod pose;
pub(super) mod rotation;
mod scan;
mod trajectory;
pub(super) mod types;

use super::Role;
use super::cdr::Keep;
use super::check::BadField;
use crate::record::{Record, Stamp};

pub(super) use definitions::definition;

/// A topic: its name, the type of its messages and how to get that type's full definition.
#[derive(Debug)]
pub struct Topic {
    pub(super) name: &'static str,
    pub(super) type_name: &'static str,
    pub(super) definition: fn(&str) -> String,
}

impl Topic {
    /// A topic of a standard type.
    pub(super) const fn standard(name: &'static str, type_name: &'static str) -> Topic {
        Topic {
            name,
            type_name,
            definition,
        }
    }
}

/// Where the platform is in the frame.
pub(super) static TF: Topic = Topic::standard("/tf", "tf2_msgs/msg/TFMessage");
/// Where the laser is on the platform.
pub(super) static TF_STATIC: Topic = Topic::standard("/tf_static", "tf2_msgs/msg/TFMessage");
/// The frame's box, plates and strips.
pub(super) static MARKERS: Topic =
    Topic::standard("/markers", "visualization_msgs/msg/MarkerArray");

/// A record's messages, one after the other in one buffer that is used again.
#[derive(Debug, Default)]
pub struct Bodies {
    bytes: Vec<u8>,
    ends: Vec<(&'static Topic, usize)>,
    /// The record's running number; the writer counts where it has none.
    pub(super) sequence: Option<u32>,
    /// When the record had arrived, if that is known.
    pub(super) received: Option<Stamp>,
}

impl Bodies {
    pub(super) fn clear(&mut self) {
        self.bytes.clear();
        self.ends.clear();
        self.sequence = None;
        self.received = None;
    }

    /// Adds a message that `encode` appends to the buffer.
    pub(super) fn add(
        &mut self,
        topic: &'static Topic,
        encode: impl FnOnce(&mut Vec<u8>) -> Result<(), BadField>,
    ) -> Result<(), BadField> {
        encode(&mut self.bytes)?;
        self.ends.push((topic, self.bytes.len()));
        Ok(())
    }

    /// The messages in order.
    pub(super) fn iter(&self) -> impl Iterator<Item = (&'static Topic, &[u8])> {
        let mut start = 0;
        self.ends.iter().map(move |(topic, end)| {
            let body = &self.bytes[start..*end];
            start = *end;
            (*topic, body)
        })
    }
}

/// A message that has been read.
#[derive(Clone, Copy, Debug)]
pub struct Message<'a> {
    pub(super) sequence: u32,
    pub(super) body: &'a [u8],
}

/// How a record maps to messages.
pub trait Messages: Record {
    /// What has been seen of the record that is being put together.
    type Parts: Default;

    /// The topics it is read from. The last one is what a stream without such records lacks.
    fn read_from(role: Role) -> &'static [&'static Topic];

    /// The topics it is written to.
    fn written_to(role: Role) -> &'static [&'static Topic];

    /// Adds the record's messages; the one that completes it for a reader of ours comes last, or
    /// is the only one that such a reader needs.
    fn encode(&self, role: Role, out: &mut Bodies) -> Result<(), BadField>;

    /// Takes a message of one of the topics in [`Messages::read_from`]; true when it makes a
    /// record complete.
    fn decode(
        &mut self,
        topic: &'static Topic,
        message: Message<'_>,
        parts: &mut Self::Parts,
    ) -> Result<bool, BadField>;
}

/// The stamp of the last record that was read from its own topic; the standard message with the
/// same stamp repeats it.
#[derive(Debug, Default)]
pub struct Exact(Option<types::Time>);

impl Exact {
    fn set(&mut self, stamp: Stamp) {
        self.0 = Some(stamp.into());
    }

    fn repeats(&self, stamp: types::Time) -> bool {
        self.0 == Some(stamp)
    }
}

/// Every column.
fn every(_: &str) -> bool {
    true
}

#[cfg(test)]
mod tests;
