//! MCAP: profile `ros2`, CDR messages, one stream for all kinds of records.
//!
//! Into a pipe messages go as they are, without chunks and compression (a default chunk would hold
//! 13 s of scans back), and are flushed by the flow rule. Into a file they go in chunks of 1 MiB,
//! or of one second of a live stream, zstd-compressed and indexed, as `ros2 bag` wants them.
//!
//! Reading takes either form, from a pipe or a file, and gives out everything that is whole before
//! it complains of an end in the middle.

pub(super) mod bytes;
mod reader;
mod writer;

pub(super) use reader::McapReader;
pub(super) use writer::McapWriter;

use super::ros2::{MARKERS, TF_STATIC};
use std::collections::HashMap;

const PROFILE: &str = "ros2";
const SCHEMA_ENCODING: &str = "ros2msg";
const MESSAGE_ENCODING: &str = "cdr";

struct Schema {
    name: String,
    encoding: String,
    data: Vec<u8>,
}

/// What the input has said of its channels.
#[derive(Default)]
struct Channels {
    schemas: HashMap<u16, Schema>,
    channels: HashMap<u16, mcap::records::Channel>,
}

impl Channels {
    /// Whether a channel's messages hold from their time on and so belong to every window.
    fn is_latched(&self, id: u16) -> bool {
        let topic = self.channels.get(&id).map(|channel| channel.topic.as_str());
        topic == Some(TF_STATIC.name) || topic == Some(MARKERS.name)
    }
}
