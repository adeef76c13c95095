//! Reading: the records of one kind, with everything else handed on.

use super::bytes::{self, Damage, Feed};
use super::{Channels, MESSAGE_ENCODING, Schema};
use crate::record::{ImuSample, Stamp};
use crate::stream::Role;
use crate::stream::check::{BadField, Checks, StreamRecord};
use crate::stream::csv::RowError;
use crate::stream::exit::Fault;
use crate::stream::output::Output;
use crate::stream::provenance::{self, Provenance};
use crate::stream::ros2::{Message, Messages, Topic};
use crate::stream::window::WindowState;
use mcap::records::{Channel, MessageHeader, Record as McapRecord, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader};
use std::collections::HashMap;
use std::io::Read;

/// Reads one kind of record and hands on everything.
pub(in crate::stream) struct McapReader<R: StreamRecord> {
    linear: LinearReader,
    feed: Feed<Box<dyn Read>>,
    state: State<R>,
}

struct State<R: StreamRecord> {
    name: String,
    role: Role,
    channels: Channels,
    /// The channels that are read, or none for one that is not.
    topics: HashMap<u16, Option<&'static Topic>>,
    found: bool,
    record: R,
    checks: Checks,
    parts: R::Parts,
    records: u64,
    provenance: Vec<Provenance>,
    beside: Option<Beside>,
}

/// The IMU samples that travel with the records.
#[derive(Default)]
struct Beside {
    topics: HashMap<u16, &'static Topic>,
    sample: ImuSample,
    parts: <ImuSample as Messages>::Parts,
    complete: Vec<ImuSample>,
}

impl Beside {
    fn take(&mut self, topic: &'static Topic, message: Message<'_>) -> Result<(), BadField> {
        if self.sample.decode(topic, message, &mut self.parts)? {
            self.sample.check()?;
            self.complete.push(self.sample);
        }
        Ok(())
    }
}

/// What a record of the file was good for.
enum Step {
    Nothing,
    Complete,
}

impl<R: StreamRecord> McapReader<R> {
    pub(in crate::stream) fn new(input: Box<dyn Read>, name: &str, role: Role) -> Self {
        McapReader {
            linear: bytes::linear_reader(),
            feed: Feed::new(input),
            state: State {
                name: name.to_owned(),
                role,
                channels: Channels::default(),
                topics: HashMap::new(),
                found: false,
                record: R::default(),
                checks: Checks::default(),
                parts: R::Parts::default(),
                records: 0,
                provenance: Vec::new(),
                beside: None,
            },
        }
    }

    /// Reads the IMU samples of the stream too.
    pub(in crate::stream) fn want_imu(&mut self) {
        self.state.beside = Some(Beside::default());
    }

    /// The IMU samples met since the last call.
    pub(in crate::stream) fn take_imu(&mut self) -> impl Iterator<Item = ImuSample> {
        self.state
            .beside
            .iter_mut()
            .flat_map(|beside| beside.complete.drain(..))
    }

    /// Reads to the end of the next record; false at the end of the stream.
    pub(in crate::stream) fn advance(
        &mut self,
        pass: Option<&Output>,
        window: &mut WindowState,
    ) -> Result<bool, RowError> {
        loop {
            match self.linear.next_event() {
                None => return self.state.end().map(|()| false).map_err(RowError::Fatal),
                Some(Err(error)) => return Err(self.state.damaged(&error.into())),
                Some(Ok(LinearReadEvent::ReadRequest(_))) => {
                    let given = self.feed.give(&mut self.linear);
                    let given = given.map_err(|error| RowError::Fatal(error.into()))?;
                    given.map_err(|damage| self.state.damaged(&damage))?;
                }
                Some(Ok(LinearReadEvent::Record { data, opcode })) => {
                    match self.state.take(opcode, data, pass, window)? {
                        Step::Complete => return Ok(true),
                        Step::Nothing => {}
                    }
                }
            }
        }
    }

    pub(in crate::stream) fn record(&self) -> &R {
        &self.state.record
    }

    pub(in crate::stream) fn provenance(&self) -> &[Provenance] {
        &self.state.provenance
    }
}

impl<R: StreamRecord> State<R> {
    fn take(
        &mut self,
        opcode: u8,
        data: &[u8],
        pass: Option<&Output>,
        window: &mut WindowState,
    ) -> Result<Step, RowError> {
        if !matches!(
            opcode,
            op::MESSAGE | op::SCHEMA | op::CHANNEL | op::METADATA
        ) {
            return Ok(Step::Nothing);
        }
        let record = bytes::parse(opcode, data).map_err(|damage| self.damaged(&damage))?;
        match record {
            McapRecord::Message { header, data } => self.message(&header, &data, pass, window),
            McapRecord::Schema { header, data } => {
                let schema = Schema {
                    name: header.name,
                    encoding: header.encoding,
                    data: data.into_owned(),
                };
                self.channels.schemas.insert(header.id, schema);
                Ok(Step::Nothing)
            }
            McapRecord::Channel(channel) => {
                self.open(channel)
                    .map_err(|fault| RowError::Fatal(fault.into()))?;
                Ok(Step::Nothing)
            }
            McapRecord::Metadata(metadata) => {
                if metadata.name == provenance::RECORD_NAME {
                    let stage = Provenance::from_entries(&metadata.metadata);
                    self.provenance.push(stage);
                }
                if let Some(output) = pass {
                    output
                        .with_mcap(|mcap| mcap.pass_metadata(&metadata))
                        .map_err(RowError::Fatal)?;
                }
                Ok(Step::Nothing)
            }
            _ => Ok(Step::Nothing),
        }
    }

    /// Notes a channel, and what its messages are read for.
    ///
    /// # Errors
    /// One that has the name of a topic of these records and another type. An IMU's that cannot be
    /// read is no concern of a stream of other records.
    fn open(&mut self, channel: Channel) -> Result<(), Fault> {
        let named = |topics: &'static [&'static Topic]| {
            let mut topics = topics.iter().copied();
            topics.find(|topic| topic.name == channel.topic)
        };
        let imu = named(ImuSample::read_from(self.role))
            .filter(|topic| self.verify(&channel, topic).is_ok());
        if let (Some(beside), Some(topic)) = (&mut self.beside, imu) {
            beside.topics.insert(channel.id, topic);
        }
        let topic = named(R::read_from(self.role));
        if let Some(topic) = topic {
            self.verify(&channel, topic)?;
            self.found = true;
        }
        self.topics.insert(channel.id, topic);
        self.channels.channels.insert(channel.id, channel);
        Ok(())
    }

    /// Whether a channel's messages are those of a topic.
    fn verify(&self, channel: &Channel, topic: &Topic) -> Result<(), Fault> {
        let schema = self.channels.schemas.get(&channel.schema_id);
        let type_name = schema.map_or("a message without a schema", |s| s.name.as_str());
        if type_name != topic.type_name || channel.message_encoding != MESSAGE_ENCODING {
            return Err(Fault::BadData(format!(
                "{}: {} is {type_name} in {}; {} in {MESSAGE_ENCODING} is wanted",
                self.name, topic.name, channel.message_encoding, topic.type_name
            )));
        }
        // Our own types may gain fields at their end, which an older file does not have; CDR does
        // not say where any other begins.
        let own = topic.type_name.starts_with("cablepose_msgs/");
        let text = (topic.definition)(topic.type_name);
        let is_older = |data: &[u8]| data.ends_with(b"\n") && text.as_bytes().starts_with(data);
        if own && schema.is_some_and(|s| *s.data != *text.as_bytes() && !is_older(&s.data)) {
            return Err(Fault::BadData(format!(
                "{}: {} has other fields than this version's {}",
                self.name, topic.name, topic.type_name
            )));
        }
        Ok(())
    }

    fn message(
        &mut self,
        header: &MessageHeader,
        body: &[u8],
        pass: Option<&Output>,
        window: &mut WindowState,
    ) -> Result<Step, RowError> {
        let topic = self.topics.get(&header.channel_id).copied().flatten();
        let stamp = i64::try_from(header.publish_time).unwrap_or(i64::MAX);
        if let Some(output) = pass
            && (window.passes(Stamp::from_ns(stamp), topic.is_some())
                || self.channels.is_latched(header.channel_id))
        {
            output
                .with_mcap(|mcap| mcap.pass(&self.channels, header, body))
                .map_err(RowError::Fatal)?;
        }
        let message = Message {
            sequence: header.sequence,
            body,
        };
        if let Some(beside) = &mut self.beside
            && let Some(topic) = beside.topics.get(&header.channel_id).copied()
            && let Err(bad) = beside.take(topic, message)
        {
            return Err(RowError::Bad(self.bad(topic, header, &bad)));
        }
        let Some(topic) = topic else {
            return Ok(Step::Nothing);
        };
        let complete = self.record.decode(topic, message, &mut self.parts);
        let checked = complete.and_then(|complete| {
            if complete {
                self.checks.check(&self.record)?;
            }
            Ok(complete)
        });
        match checked {
            Ok(true) => {
                self.records += 1;
                Ok(Step::Complete)
            }
            Ok(false) => Ok(Step::Nothing),
            Err(bad) => Err(RowError::Bad(self.bad(topic, header, &bad))),
        }
    }

    fn bad(&self, topic: &Topic, header: &MessageHeader, bad: &BadField) -> Fault {
        Fault::BadData(format!(
            "{}: {} message {} at {} ns: {bad}",
            self.name, topic.name, header.sequence, header.publish_time
        ))
    }

    /// The error of a file that cannot be read on.
    fn damaged(&self, damage: &Damage) -> RowError {
        let place = format!(" after {} {} records", self.records, R::KIND);
        RowError::Fatal(damage.fault(&self.name, &place).into())
    }

    /// At the end: a stream that never had such records was not meant for this.
    fn end(&self) -> anyhow::Result<()> {
        if self.found {
            return Ok(());
        }
        let mut topics: Vec<&str> = self
            .channels
            .channels
            .values()
            .map(|c| c.topic.as_str())
            .collect();
        topics.sort_unstable();
        let wanted = R::read_from(self.role)
            .last()
            .map_or("", |topic| topic.name);
        let found = if topics.is_empty() {
            "it has no topics".to_owned()
        } else {
            format!("it has {}", topics.join(", "))
        };
        let name = &self.name;
        Err(Fault::BadData(format!("{name}: no {wanted} in this stream: {found}")).into())
    }
}
