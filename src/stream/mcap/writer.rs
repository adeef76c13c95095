//! Writing: records as messages, and what of the input is passed on.

use super::{Channels, MESSAGE_ENCODING, PROFILE, SCHEMA_ENCODING};
use crate::frame::{Frame, Scanner};
use crate::record::Stamp;
use crate::stream::check::StreamRecord;
use crate::stream::exit::Fault;
use crate::stream::provenance::{self, Provenance};
use crate::stream::ros2::{Bodies, MARKERS, TF_STATIC, Topic};
use crate::stream::viewer::{self, Note};
use crate::stream::{Options, Role};
use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;
use mcap::{Compression, WriteOptions};
use std::collections::{BTreeMap, HashMap};
use std::io::{BufWriter, Write};
use std::path::Path;
use std::time::{Duration, Instant};

/// A write fills what a pipe holds at once.
const BUFFER: usize = 1 << 16;

/// A chunk of a live stream is closed at this age.
const CHUNK_AGE: Duration = Duration::from_secs(1);

/// Writes records of any kind, and passes on messages that were read.
pub(in crate::stream) struct McapWriter<W: Write> {
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
    pub(in crate::stream) fn new(output: W, file: bool, options: &Options) -> anyhow::Result<Self> {
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
    pub(in crate::stream) fn declare<R: StreamRecord>(&mut self) {
        for topic in R::written_to(Role::Desired) {
            let once = topic.name == TF_STATIC.name || topic.name == MARKERS.name;
            if !once || self.statics.iter().any(|n| n.topic().name == topic.name) {
                self.own.push(topic.name);
            }
        }
        self.declared = R::read_from(Role::Desired);
    }

    /// Writes a record's messages.
    pub(in crate::stream) fn write<R: StreamRecord>(
        &mut self,
        record: &R,
        role: Role,
    ) -> anyhow::Result<()> {
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
    pub(in crate::stream) fn note(&mut self, notes: &[Note]) -> anyhow::Result<()> {
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
    pub(super) fn pass(
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

    /// Writes a stage of the stream's provenance: this process, or one that the input names elsewhere
    /// than in MCAP.
    pub(in crate::stream) fn write_stage(&mut self, stage: &Provenance) -> anyhow::Result<()> {
        self.writer.write_metadata(&Metadata {
            name: provenance::RECORD_NAME.to_owned(),
            metadata: stage.to_entries(self.stages),
        })?;
        self.stages += 1;
        Ok(())
    }

    /// Passes a metadata record of the input on.
    pub(super) fn pass_metadata(&mut self, metadata: &Metadata) -> anyhow::Result<()> {
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
        if let Some(stage) = self.provenance.take() {
            self.write_stage(&stage)?;
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
    pub(in crate::stream) fn flush(&mut self) -> anyhow::Result<()> {
        self.chunk_opened = None;
        Ok(self.writer.flush()?)
    }

    /// Before the input may keep us waiting: into a pipe everything goes out, into a file a chunk
    /// that is old enough.
    pub(in crate::stream) fn before_wait(&mut self) -> anyhow::Result<()> {
        if self.chunked {
            self.close_old_chunk()
        } else {
            self.flush()
        }
    }

    /// Ends the stream with its summary. A kind that was announced and did not come gets its
    /// channel here, so that a reader can tell "none" from "not there".
    pub(in crate::stream) fn finish(&mut self) -> anyhow::Result<()> {
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
