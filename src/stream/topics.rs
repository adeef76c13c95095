//! What is in an MCAP file, topic by topic, whatever it is.

use super::Options;
use super::input::Bytes;
use super::mcap::bytes::{self, Damage, Feed};
use mcap::records::Record as McapRecord;
use mcap::sans_io::linear_reader::LinearReadEvent;
use std::collections::hash_map::DefaultHasher;
use std::collections::{BTreeMap, HashMap};
use std::hash::Hasher;
use std::path::Path;

/// A topic's messages.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TopicContents {
    /// The type of the messages; empty where the file does not say.
    pub type_name: String,
    /// A digest of each message's bytes, in the file's order.
    pub messages: Vec<u64>,
}

/// The topics of an MCAP file by name, those without messages included.
///
/// # Errors
/// [`Fault::NoInput`](super::Fault::NoInput) where it cannot be opened, [`Fault::BadData`](super::Fault::BadData) where it is damaged.
pub fn topics(path: &Path, options: &Options) -> anyhow::Result<BTreeMap<String, TopicContents>> {
    let input = Bytes::open(Some(path), options)?;
    let name = input.name().to_owned();
    let damaged = |damage: Damage| damage.fault(&name, "");
    let mut feed = Feed::new(input);
    let mut reader = bytes::linear_reader();
    let mut schemas: HashMap<u16, String> = HashMap::new();
    let mut channels: HashMap<u16, String> = HashMap::new();
    let mut topics: BTreeMap<String, TopicContents> = BTreeMap::new();
    while let Some(event) = reader.next_event() {
        match event.map_err(|error| damaged(error.into()))? {
            LinearReadEvent::ReadRequest(_) => {
                feed.give(&mut reader)?.map_err(damaged)?;
            }
            LinearReadEvent::Record { data, opcode } => {
                match bytes::parse(opcode, data).map_err(damaged)? {
                    McapRecord::Schema { header, .. } => {
                        schemas.insert(header.id, header.name);
                    }
                    McapRecord::Channel(channel) => {
                        let topic = topics.entry(channel.topic.clone()).or_default();
                        if let Some(type_name) = schemas.get(&channel.schema_id) {
                            topic.type_name.clone_from(type_name);
                        }
                        channels.insert(channel.id, channel.topic);
                    }
                    McapRecord::Message { header, data } => {
                        let topic = channels.get(&header.channel_id);
                        if let Some(topic) = topic.and_then(|name| topics.get_mut(name)) {
                            let mut digest = DefaultHasher::new();
                            digest.write(&data);
                            topic.messages.push(digest.finish());
                        }
                    }
                    _ => {}
                }
            }
        }
    }
    Ok(topics)
}
