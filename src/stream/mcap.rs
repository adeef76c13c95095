//! MCAP: profile `ros2`, CDR messages, one stream for all kinds of records.
//!
//! Into a pipe messages go as they are, without chunks and compression (a default chunk would hold
//! 13 s of scans back), and are flushed by the flow rule. Into a file they go in chunks of 1 MiB,
//! or of one second of a live stream, zstd-compressed and indexed, as `ros2 bag` wants them.
//!
//! Reading takes either form, from a pipe or a file, and gives out everything that is whole before
//! it complains of an end in the middle.

use super::check::{BadField, Checks, StreamRecord};
use super::csv::RowError;
use super::exit::Fault;
use super::mcap_bytes::{self, Damage, Feed};
use super::output::Output;
use super::provenance::{self, Provenance};
use super::ros2::{Bodies, MARKERS, Message, Messages, TF_STATIC, Topic};
use super::viewer::{self, Note};
use super::window::WindowState;
use super::{Options, Role};
use crate::frame::{Frame, Scanner};
use crate::record::{ImuSample, Stamp};
use mcap::records::{MessageHeader, Metadata, Record as McapRecord, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader};
use mcap::write::NoSeek;
use mcap::{Compression, WriteOptions};
use std::collections::{BTreeMap, HashMap};
use std::io::{BufWriter, Read, Write};
use std::path::Path;
use std::time::{Duration, Instant};

const PROFILE: &str = "ros2";
const SCHEMA_ENCODING: &str = "ros2msg";
const MESSAGE_ENCODING: &str = "cdr";

/// A write fills what a pipe holds at once.
const BUFFER: usize = 1 << 16;

/// A chunk of a live stream is closed at this age.
const CHUNK_AGE: Duration = Duration::from_secs(1);

/// Writes records of any kind, and passes on messages that were read.
pub(super) struct McapWriter<W: Write> {
    writer: mcap::Writer<NoSeek<BufWriter<W>>>,
    /// Whether the output is a file, with chunks.
    chunked: bool,
    chunk_opened: Option<Instant>,
    channels: Vec<(&'static str, u16)>,
    /// Topics that are not passed on, because this process writes them itself.
    own: Vec<&'static str>,
    /// The topics of the kind of record that was announced.
    declared: &'static [&'static Topic],
    /// Where the channels of the input go; none for those that are not passed on.
    passed: HashMap<u16, Option<u16>>,
    bodies: Bodies,
    scratch: Vec<u8>,
    sequence: u32,
    last: MessageHeader,
    /// When the last message of the input was received.
    last_passed: Option<u64>,
    /// What is still to be written before the first message.
    provenance: Option<Provenance>,
    stages: usize,
    /// What a viewer needs once, before the first scan or pose.
    statics: Vec<Note>,
}

impl<W: Write> McapWriter<W> {
    /// Starts a stream into a file (with chunks) or a pipe.
    pub(super) fn new(output: W, file: bool, options: &Options) -> anyhow::Result<Self> {
        let write = WriteOptions::new()
            .profile(PROFILE)
            .library(concat!("cablepose ", env!("CARGO_PKG_VERSION")))
            .disable_seeking(true)
            .use_chunks(file)
            .compression(file.then_some(Compression::Zstd))
            .compression_threads(0)
            .calculate_data_section_crc(file);
        let output = NoSeek::new(BufWriter::with_capacity(BUFFER, output));
        Ok(McapWriter {
            writer: write.create(output)?,
            chunked: file,
            chunk_opened: None,
            channels: Vec::new(),
            own: Vec::new(),
            declared: &[],
            passed: HashMap::new(),
            bodies: Bodies::default(),
            scratch: Vec::new(),
            sequence: 0,
            last: MessageHeader {
                channel_id: 0,
                sequence: 0,
                log_time: 0,
                publish_time: 0,
            },
            last_passed: None,
            provenance: Some(Provenance::of_this(options)),
            stages: 0,
            statics: statics(options),
        })
    }

    /// Announces a kind of record that will be written: its topics are not passed on from the
    /// input, and a reader sees its channel even if no record comes.
    pub(super) fn declare<R: StreamRecord>(&mut self) {
        for topic in R::written_to(Role::Desired) {
            let once = topic.name == TF_STATIC.name || topic.name == MARKERS.name;
            if !once || self.statics.iter().any(|n| n.topic().name == topic.name) {
                self.own.push(topic.name);
            }
        }
        self.declared = R::read_from(Role::Desired);
    }

    /// Writes a record's messages.
    pub(super) fn write<R: StreamRecord>(&mut self, record: &R, role: Role) -> anyhow::Result<()> {
        let mut bodies = std::mem::take(&mut self.bodies);
        bodies.clear();
        record
            .encode(role, &mut bodies)
            .map_err(|bad| Fault::BadData(format!("{} cannot be written: {bad}", R::KIND)))?;
        let publish_time = nanoseconds(record.stamp());
        self.sequence = self.sequence.wrapping_add(1);
        self.last = MessageHeader {
            channel_id: 0,
            sequence: bodies.sequence.unwrap_or(self.sequence),
            log_time: self.log_time(bodies.received, publish_time),
            publish_time,
        };
        if !self.statics.is_empty() && R::written_to(role).iter().any(|t| t.name == TF_STATIC.name)
        {
            let notes = std::mem::take(&mut self.statics);
            self.note_at(&notes, record.stamp())?;
        }
        for (topic, body) in bodies.iter() {
            let channel_id = self.channel(topic)?;
            let header = MessageHeader {
                channel_id,
                ..self.last
            };
            self.writer.write_to_known_channel(&header, body)?;
        }
        self.bodies = bodies;
        self.close_old_chunk()
    }

    /// When a record was received. One that was made here from others was there when the last of
    /// those had come, one that was made from nothing at its stamp: so the times of an unindexed
    /// stream do not go back, which some readers insist on.
    fn log_time(&self, received: Option<Stamp>, publish_time: u64) -> u64 {
        match (received, self.last_passed) {
            (Some(received), _) => nanoseconds(received),
            (None, Some(log_time)) => log_time,
            (None, None) => publish_time.max(self.last.log_time),
        }
    }

    /// Writes messages for a viewer at the time of the last record.
    pub(super) fn note(&mut self, notes: &[Note]) -> anyhow::Result<()> {
        let stamp = i64::try_from(self.last.publish_time).unwrap_or(i64::MAX);
        self.note_at(notes, Stamp::from_ns(stamp))
    }

    fn note_at(&mut self, notes: &[Note], stamp: Stamp) -> anyhow::Result<()> {
        for note in notes {
            let channel_id = self.channel(note.topic())?;
            self.scratch.clear();
            note.encode(stamp, &mut self.scratch)
                .map_err(|bad| Fault::BadData(bad.to_string()))?;
            let header = MessageHeader {
                channel_id,
                ..self.last
            };
            self.writer.write_to_known_channel(&header, &self.scratch)?;
        }
        Ok(())
    }

    /// Passes a message of the input on, unless this process writes its topic itself.
    fn pass(
        &mut self,
        channels: &Channels,
        header: &MessageHeader,
        body: &[u8],
    ) -> anyhow::Result<()> {
        let channel_id = match self.passed.get(&header.channel_id) {
            Some(channel_id) => *channel_id,
            None => {
                let channel_id = self.open_passed(channels, header.channel_id)?;
                self.passed.insert(header.channel_id, channel_id);
                channel_id
            }
        };
        self.last_passed = Some(header.log_time);
        if let Some(channel_id) = channel_id {
            let header = MessageHeader {
                channel_id,
                ..*header
            };
            self.writer.write_to_known_channel(&header, body)?;
            self.close_old_chunk()?;
        }
        Ok(())
    }

    fn open_passed(&mut self, channels: &Channels, id: u16) -> anyhow::Result<Option<u16>> {
        let Some(channel) = channels.channels.get(&id) else {
            return Ok(None);
        };
        if self.own.contains(&channel.topic.as_str()) {
            return Ok(None);
        }
        self.write_provenance()?;
        let schema_id = match channels.schemas.get(&channel.schema_id) {
            Some(s) => self.writer.add_schema(&s.name, &s.encoding, &s.data)?,
            None => 0,
        };
        let (topic, encoding) = (&channel.topic, &channel.message_encoding);
        let metadata = &channel.metadata;
        Ok(Some(
            self.writer
                .add_channel(schema_id, topic, encoding, metadata)?,
        ))
    }

    /// Writes a stage that the input has gone through, and that it said elsewhere than in MCAP.
    pub(super) fn pass_stage(&mut self, stage: &Provenance) -> anyhow::Result<()> {
        self.writer.write_metadata(&Metadata {
            name: provenance::RECORD_NAME.to_owned(),
            metadata: stage.to_entries(self.stages),
        })?;
        self.stages += 1;
        Ok(())
    }

    /// Passes a metadata record of the input on.
    fn pass_metadata(&mut self, metadata: &Metadata) -> anyhow::Result<()> {
        if metadata.name == provenance::RECORD_NAME {
            self.stages += 1;
        }
        self.writer.write_metadata(metadata)?;
        Ok(())
    }

    fn has_channel(&self, topic: &Topic) -> bool {
        self.channels.iter().any(|(name, _)| *name == topic.name)
    }

    fn channel(&mut self, topic: &'static Topic) -> anyhow::Result<u16> {
        if let Some((_, id)) = self.channels.iter().find(|(name, _)| *name == topic.name) {
            return Ok(*id);
        }
        self.write_provenance()?;
        let text = (topic.definition)(topic.type_name);
        let schema = self
            .writer
            .add_schema(topic.type_name, SCHEMA_ENCODING, text.as_bytes())?;
        let id = self
            .writer
            .add_channel(schema, topic.name, MESSAGE_ENCODING, &BTreeMap::new())?;
        self.channels.push((topic.name, id));
        Ok(id)
    }

    /// This process's own metadata record. It comes before its first channel, when those of the
    /// stages before it have been passed on, so that they stand in the order of the pipeline.
    fn write_provenance(&mut self) -> anyhow::Result<()> {
        if let Some(provenance) = self.provenance.take() {
            self.writer.write_metadata(&Metadata {
                name: provenance::RECORD_NAME.to_owned(),
                metadata: provenance.to_entries(self.stages),
            })?;
        }
        Ok(())
    }

    fn close_old_chunk(&mut self) -> anyhow::Result<()> {
        if !self.chunked {
            return Ok(());
        }
        match self.chunk_opened {
            None => self.chunk_opened = Some(Instant::now()),
            Some(opened) if opened.elapsed() >= CHUNK_AGE => {
                self.chunk_opened = None;
                self.writer.flush()?;
            }
            Some(_) => {}
        }
        Ok(())
    }

    /// Lets everything out, whatever it costs in small chunks.
    pub(super) fn flush(&mut self) -> anyhow::Result<()> {
        self.chunk_opened = None;
        Ok(self.writer.flush()?)
    }

    /// Before the input may keep us waiting: into a pipe everything goes out, into a file a chunk
    /// that is old enough.
    pub(super) fn before_wait(&mut self) -> anyhow::Result<()> {
        if self.chunked {
            self.close_old_chunk()
        } else {
            self.flush()
        }
    }

    /// Ends the stream with its summary. A kind that was announced and did not come gets its
    /// channel here, so that a reader can tell "none" from "not there".
    pub(super) fn finish(&mut self) -> anyhow::Result<()> {
        self.write_provenance()?;
        if !self.declared.iter().any(|topic| self.has_channel(topic)) {
            for topic in self.declared.iter().rev().take(1) {
                self.channel(topic)?;
            }
        }
        self.writer.finish()?;
        Ok(())
    }
}

/// What a viewer needs once: the laser's mounting and, where the frame is known, the frame.
fn statics(options: &Options) -> Vec<Note> {
    let frame = options
        .configuration
        .as_deref()
        .and_then(|text| Frame::parse(text, Path::new("configuration")).ok());
    match frame {
        Some(frame) => {
            let mut notes = vec![viewer::laser_mounting(&frame.scanner)];
            notes.extend(viewer::frame_messages(&frame));
            notes
        }
        None => vec![viewer::laser_mounting(&Scanner::default())],
    }
}

fn nanoseconds(stamp: Stamp) -> u64 {
    u64::try_from(stamp.ns()).unwrap_or(0)
}

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

/// Reads one kind of record and hands on everything.
pub(super) struct McapReader<R: StreamRecord> {
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
    pub(super) fn new(input: Box<dyn Read>, name: &str, role: Role) -> Self {
        McapReader {
            linear: mcap_bytes::linear_reader(),
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
    pub(super) fn want_imu(&mut self) {
        self.state.beside = Some(Beside::default());
    }

    /// The IMU samples met since the last call.
    pub(super) fn take_imu(&mut self) -> impl Iterator<Item = ImuSample> {
        self.state
            .beside
            .iter_mut()
            .flat_map(|beside| beside.complete.drain(..))
    }

    /// Reads to the end of the next record; false at the end of the stream.
    pub(super) fn advance(
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

    pub(super) fn record(&self) -> &R {
        &self.state.record
    }

    pub(super) fn provenance(&self) -> &[Provenance] {
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
        let record = mcap_bytes::parse(opcode, data).map_err(|damage| self.damaged(&damage))?;
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
                let topic = self.topic_of(&channel).map_err(RowError::Fatal)?;
                self.topics.insert(channel.id, topic);
                self.channels.channels.insert(channel.id, channel);
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

    /// The topic that a channel is of, if it is read; an error for one that has the name of such a
    /// topic and another type.
    fn topic_of(
        &mut self,
        channel: &mcap::records::Channel,
    ) -> anyhow::Result<Option<&'static Topic>> {
        if let Some(beside) = &mut self.beside {
            let topics = ImuSample::read_from(self.role);
            let own = channel.message_encoding == MESSAGE_ENCODING;
            if let Some(topic) = topics.iter().find(|t| own && t.name == channel.topic) {
                beside.topics.insert(channel.id, topic);
            }
        }
        let topics = R::read_from(self.role);
        let Some(topic) = topics.iter().find(|topic| topic.name == channel.topic) else {
            return Ok(None);
        };
        self.found = true;
        let schema = self.channels.schemas.get(&channel.schema_id);
        let type_name = schema.map_or("a message without a schema", |s| s.name.as_str());
        if type_name != topic.type_name || channel.message_encoding != MESSAGE_ENCODING {
            return Err(Fault::BadData(format!(
                "{}: {} is {type_name} in {}; {} in {MESSAGE_ENCODING} is wanted",
                self.name, topic.name, channel.message_encoding, topic.type_name
            ))
            .into());
        }
        // Our own types may gain fields, and CDR does not say where one begins.
        let own = topic.type_name.starts_with("cablepose_msgs/");
        let text = (topic.definition)(topic.type_name);
        if own && schema.is_some_and(|s| s.data != text.as_bytes()) {
            return Err(Fault::BadData(format!(
                "{}: {} has other fields than this version's {}",
                self.name, topic.name, topic.type_name
            ))
            .into());
        }
        Ok(Some(topic))
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
