//! Where records come from: stdin, a file or a FIFO, in either encoding.

use super::check::StreamRecord;
use super::csv::{CsvReader, Lines, RowError, take_remarks};
use super::exit::{self, Fault};
use super::flow::{self, LiveReader};
use super::kinds::Kind;
use super::mcap::McapReader;
use super::output::Output;
use super::progress::Progress;
use super::provenance::Provenance;
use super::trajectory_text::{self, Layout};
use super::window::{Place, WindowState};
use super::{Encoding, Options, Role, Window};
use crate::record::{ImuSample, TrajectoryPoint};
use std::fs::File;
use std::io::{self, Cursor, Read};
use std::path::Path;

/// Reads one kind of record, one after the other.
///
/// Before a read that may block, the thread's outputs are flushed.
pub struct Input<R: StreamRecord> {
    reader: Reader<R>,
    name: String,
    encoding: Encoding,
    tool: &'static str,
    window: WindowState,
    skip_bad: bool,
    records: u64,
    bad: u64,
    first_bad: Option<Fault>,
    ended: bool,
    /// The lines above a CSV header.
    remarks: Vec<Vec<u8>>,
    /// The stages that those lines name.
    stages: Vec<Provenance>,
}

enum Reader<R: StreamRecord> {
    Csv(Box<CsvReader<R>>),
    Mcap(Box<McapReader<R>>),
}

impl<R: StreamRecord> Input<R> {
    /// Opens a main input; no path, or `-`, is stdin. `--from` and `--to` hold for it.
    pub fn open(path: Option<&Path>, options: &Options) -> anyhow::Result<Input<R>> {
        Input::open_in(path, Role::Desired, options.window, options)
    }

    /// Opens a main input of a kind; `-` is stdin.
    pub fn open_kind(path: &Path, kind: Kind, options: &Options) -> anyhow::Result<Input<R>> {
        Input::open_in(Some(path), kind.role(), options.window, options)
    }

    /// Opens bytes that do not come from a path, such as one copy of a stream that two readers
    /// share ([`super::copies`]). `name` is for messages, `role` for trajectories in MCAP.
    pub fn from_reader(
        bytes: impl Read + 'static,
        name: &str,
        role: Role,
        options: &Options,
    ) -> anyhow::Result<Input<R>> {
        let name = name.to_owned();
        let source = Source::sniff(Box::new(bytes), name, false, options.input_format)?;
        Input::from_source(source, role, options.window, options)
    }

    fn open_in(
        path: Option<&Path>,
        role: Role,
        window: Window,
        options: &Options,
    ) -> anyhow::Result<Input<R>> {
        let source = Source::open(path, options)?;
        if source.is_stdin {
            flow::drain_on_interrupt()?;
        }
        Input::from_source(source, role, window, options)
    }

    /// Opens an input that has been opened and sniffed already.
    pub(super) fn from_source(
        source: Source,
        role: Role,
        window: Window,
        options: &Options,
    ) -> anyhow::Result<Input<R>> {
        let Source {
            bytes,
            name,
            encoding,
            ..
        } = source;
        let (remarks, bytes) = match encoding {
            Encoding::Csv => take_remarks(bytes)?,
            Encoding::Mcap | Encoding::Tum | Encoding::Euroc => (Vec::new(), bytes),
        };
        let stages = remarks
            .iter()
            .filter_map(|line| Provenance::from_line(line));
        let stages = stages.collect();
        let reader = match encoding {
            Encoding::Csv | Encoding::Tum | Encoding::Euroc => {
                let lines = Lines {
                    taken_off: remarks.len() as u64,
                    layout: encoding.layout(),
                };
                Reader::Csv(Box::new(csv_reader(bytes, &name, lines)?))
            }
            Encoding::Mcap => Reader::Mcap(Box::new(McapReader::new(bytes, &name, role))),
        };
        Ok(Input {
            reader,
            name,
            encoding,
            tool: options.tool,
            window: WindowState::new(window),
            skip_bad: options.skip_bad,
            records: 0,
            bad: 0,
            first_bad: None,
            ended: false,
            remarks,
            stages,
        })
    }

    /// The next record; none at the end.
    // Not an iterator: the record is lent, so that its buffers are used again.
    #[allow(clippy::should_implement_trait)]
    pub fn next(&mut self) -> anyhow::Result<Option<&R>> {
        Ok(self.advance(None)?.then(|| self.current()))
    }

    /// Reads to the next record; false at the end. What an MCAP input holds besides is handed on to
    /// `pass`.
    pub(super) fn advance(&mut self, pass: Option<&Output>) -> anyhow::Result<bool> {
        while !self.ended {
            let read = match &mut self.reader {
                Reader::Csv(csv) => csv.advance(),
                Reader::Mcap(mcap) => mcap.advance(pass, &mut self.window),
            };
            match read {
                Ok(true) => match self.window.place(self.current().stamp()) {
                    Place::Before => {}
                    Place::Inside => {
                        self.records += 1;
                        return Ok(true);
                    }
                    // A stream is in order of time: nothing that is wanted can follow.
                    Place::After => self.end(),
                },
                Ok(false) => self.end(),
                Err(RowError::Bad(fault)) if self.skip_bad => {
                    self.bad += 1;
                    self.first_bad.get_or_insert(fault);
                }
                Err(RowError::Bad(fault)) => {
                    self.ended = true;
                    return Err(fault.into());
                }
                Err(RowError::Fatal(error)) => {
                    self.end();
                    return Err(error);
                }
            }
        }
        Ok(false)
    }

    /// Reads the IMU samples of an MCAP stream beside the records.
    pub(super) fn want_imu(&mut self) {
        if let Reader::Mcap(mcap) = &mut self.reader {
            mcap.want_imu();
        }
    }

    /// The IMU samples met since the last call.
    pub(super) fn take_imu(&mut self) -> Vec<ImuSample> {
        match &mut self.reader {
            Reader::Csv(_) => Vec::new(),
            Reader::Mcap(mcap) => mcap.take_imu().collect(),
        }
    }

    /// The record that was read last.
    pub(super) fn current(&self) -> &R {
        match &self.reader {
            Reader::Csv(csv) => csv.record(),
            Reader::Mcap(mcap) => mcap.record(),
        }
    }

    fn end(&mut self) {
        self.ended = true;
        if let Some(first) = &self.first_bad {
            let (tool, bad, name) = (self.tool, self.bad, &self.name);
            let s = if bad == 1 { "" } else { "s" };
            eprintln!("{tool}: {name}: {bad} bad record{s} skipped, the first at {first}");
            exit::note_lost();
        }
    }

    /// Records given out so far.
    pub fn records(&self) -> u64 {
        self.records
    }

    /// Bad records skipped so far.
    pub fn bad(&self) -> u64 {
        self.bad
    }

    /// Where the records come from: the stages that made the stream, first one first, as far as it
    /// has been read. CSV says so only where it was asked to (`--meta`), in lines above its header.
    pub fn provenance(&self) -> &[Provenance] {
        match &self.reader {
            Reader::Csv(_) => &self.stages,
            Reader::Mcap(mcap) => mcap.provenance(),
        }
    }

    /// The lines that start with `#` above a CSV header.
    pub(super) fn remarks(&self) -> &[Vec<u8>] {
        &self.remarks
    }

    /// Columns of a CSV header that a record of this kind does not have.
    pub(super) fn unknown_columns(&self) -> &[String] {
        match &self.reader {
            Reader::Csv(csv) => csv.unknown_columns(),
            Reader::Mcap(_) => &[],
        }
    }

    /// The encoding of this input.
    pub fn encoding(&self) -> Encoding {
        self.encoding
    }
}

impl Input<TrajectoryPoint> {
    /// Opens a trajectory: in MCAP, `role` says which of the two. `--from` and `--to` do not hold
    /// for it, because it is compared with records that they hold for.
    pub fn open_trajectory(
        path: Option<&Path>,
        role: Role,
        options: &Options,
    ) -> anyhow::Result<Input<TrajectoryPoint>> {
        Input::open_in(path, role, Window::default(), options)
    }
}

/// A reader of CSV, or of a text that is read as CSV.
fn csv_reader<R: StreamRecord>(
    bytes: Box<dyn Read>,
    name: &str,
    lines: Lines,
) -> anyhow::Result<CsvReader<R>> {
    let bytes = match lines.layout {
        None => bytes,
        Some(layout) => Box::new(trajectory_text::AsCsv::new(bytes, layout)),
    };
    CsvReader::new(bytes, name, lines)
}

/// All records of an input; `--from` and `--to` hold for it.
pub fn read_all<R: StreamRecord>(path: Option<&Path>, options: &Options) -> anyhow::Result<Vec<R>> {
    let mut input = Input::open(path, options)?;
    let mut records = Vec::new();
    while let Some(record) = input.next()? {
        records.push(R::clone(record));
    }
    Ok(records)
}

/// An input's bytes, before anything but the encoding is known of them.
pub(super) struct Source {
    pub(super) bytes: Box<dyn Read>,
    pub(super) name: String,
    pub(super) encoding: Encoding,
    pub(super) is_stdin: bool,
}

impl Source {
    /// Opens stdin or a file, and waits for its first bytes unless `--input-format` says what they
    /// will be.
    pub(super) fn open(path: Option<&Path>, options: &Options) -> anyhow::Result<Source> {
        let Opened {
            bytes,
            name,
            is_stdin,
        } = open_raw(path, options)?;
        Source::sniff(bytes, name, is_stdin, options.input_format)
    }

    fn sniff(
        bytes: Box<dyn Read>,
        name: String,
        is_stdin: bool,
        wanted: Option<Encoding>,
    ) -> anyhow::Result<Source> {
        let mut live = LiveReader::new(bytes, &name);
        let mut head = Vec::new();
        let encoding = match wanted {
            Some(encoding) => encoding,
            None => {
                let mut block = vec![0; 1 << 16];
                let length = live.read(&mut block)?;
                block.truncate(length);
                head = block;
                sniff(&head)
            }
        };
        Ok(Source {
            bytes: Box::new(Cursor::new(head).chain(live)),
            name,
            encoding,
            is_stdin,
        })
    }
}

/// The encoding that a stream's first bytes tell.
fn sniff(head: &[u8]) -> Encoding {
    // One byte tells: no CSV header starts with a byte that is not text.
    if head.first() == mcap::MAGIC.first() {
        return Encoding::Mcap;
    }
    match trajectory_text::sniff(head) {
        Some(Layout::Tum) => Encoding::Tum,
        Some(Layout::Euroc) => Encoding::Euroc,
        None => Encoding::Csv,
    }
}

/// Bytes that have been opened, and what is known of them.
struct Opened {
    bytes: Box<dyn Read>,
    name: String,
    is_stdin: bool,
}

/// Opens stdin (no path, or `-`) or a file, with a progress bar where one is wanted.
fn open_raw(path: Option<&Path>, options: &Options) -> Result<Opened, Fault> {
    let Some(path) = path.filter(|path| *path != Path::new("-")) else {
        return Ok(Opened {
            bytes: Box::new(io::stdin()),
            name: "stdin".to_owned(),
            is_stdin: true,
        });
    };
    let (file, length) = open_file(path)?;
    Ok(Opened {
        bytes: Progress::around(file, length, options),
        name: path.display().to_string(),
        is_stdin: false,
    })
}

/// Opens a file that is to be read; gives its length too, where it has one.
///
/// # Errors
/// [`Fault::NoInput`] where it cannot be opened or is a directory.
pub(super) fn open_file(path: &Path) -> Result<(File, Option<u64>), Fault> {
    let name = path.display().to_string();
    let no_input = |error| Fault::NoInput(flow::named(&name, error).to_string());
    let file = File::open(path).map_err(no_input)?;
    let found = file.metadata().map_err(no_input)?;
    if found.is_dir() {
        return Err(Fault::NoInput(format!("{name}: is a directory")));
    }
    Ok((file, found.is_file().then_some(found.len())))
}

/// An input that holds a device's bytes, not records. Its reads obey the flush rule.
pub struct Bytes {
    live: LiveReader<Box<dyn Read>>,
    name: String,
    /// What has been looked at already.
    head: Cursor<Vec<u8>>,
}

impl Bytes {
    /// Opens a file; no path, or `-`, is stdin.
    pub fn open(path: Option<&Path>, options: &Options) -> anyhow::Result<Bytes> {
        let Opened { bytes, name, .. } = open_raw(path, options)?;
        Ok(Bytes {
            live: LiveReader::new(bytes, &name),
            name,
            head: Cursor::default(),
        })
    }

    /// Looks at the first bytes, as many as come at once, and leaves them there to be read: the
    /// encoding that they would have as a stream of records, and themselves.
    pub fn peek(&mut self) -> anyhow::Result<(Encoding, &[u8])> {
        if self.head.get_ref().is_empty() {
            let mut block = vec![0; 1 << 16];
            let length = self.live.read(&mut block)?;
            block.truncate(length);
            self.head = Cursor::new(block);
        }
        let head = self.head.get_ref();
        Ok((sniff(head), head))
    }

    /// The file's name, or `stdin`.
    pub fn name(&self) -> &str {
        &self.name
    }
}

impl Read for Bytes {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let length = self.head.read(buffer)?;
        if length > 0 || buffer.is_empty() {
            return Ok(length);
        }
        self.live.read(buffer)
    }
}
