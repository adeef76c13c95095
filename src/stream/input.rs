//! Where records come from: stdin, a file or a FIFO, in either encoding.

use super::check::StreamRecord;
use super::csv::{CsvReader, RowError};
use super::exit::{self, Fault};
use super::flow::{self, LiveReader};
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
        let reader = match encoding {
            Encoding::Csv | Encoding::Tum | Encoding::Euroc => {
                Reader::Csv(Box::new(csv_reader(bytes, &name, encoding)?))
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
        })
    }

    /// The next record; none at the end.
    // Not an iterator: the record is lent, so that its buffers are used again.
    #[allow(clippy::should_implement_trait)]
    pub fn next(&mut self) -> anyhow::Result<Option<&R>> {
        self.next_passing(None)
    }

    /// The next record. What an MCAP input holds besides is handed on to `pass`.
    pub(super) fn next_passing(&mut self, pass: Option<&Output>) -> anyhow::Result<Option<&R>> {
        Ok(if self.advance(pass)? {
            Some(self.current())
        } else {
            None
        })
    }

    /// Reads to the next record; false at the end.
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

    /// Where the records come from: the stages that made an MCAP stream, first one first, as far
    /// as it has been read. Empty for CSV.
    pub fn provenance(&self) -> &[Provenance] {
        match &self.reader {
            Reader::Csv(_) => &[],
            Reader::Mcap(mcap) => mcap.provenance(),
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
    encoding: Encoding,
) -> anyhow::Result<CsvReader<R>> {
    match encoding.layout() {
        None => CsvReader::new(bytes, name, 0),
        Some(layout) => {
            let text = trajectory_text::AsCsv::new(bytes, layout);
            CsvReader::new(Box::new(text), name, trajectory_text::LINES_ADDED)
        }
    }
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
        let (bytes, name, is_stdin) = open_raw(path, options)?;
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
                // One byte tells: no CSV header starts with a byte that is not text.
                if head.first() == mcap::MAGIC.first() {
                    Encoding::Mcap
                } else {
                    match trajectory_text::sniff(&head) {
                        Some(Layout::Tum) => Encoding::Tum,
                        Some(Layout::Euroc) => Encoding::Euroc,
                        None => Encoding::Csv,
                    }
                }
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

/// Opens stdin (no path, or `-`) or a file; gives its bytes, its name and whether it is stdin.
fn open_raw(
    path: Option<&Path>,
    options: &Options,
) -> anyhow::Result<(Box<dyn Read>, String, bool)> {
    match path {
        Some(path) if path != Path::new("-") => {
            let name = path.display().to_string();
            let no_input = |error| Fault::NoInput(flow::named(&name, error).to_string());
            let file = File::open(path).map_err(no_input)?;
            let found = file.metadata().map_err(no_input)?;
            if found.is_dir() {
                return Err(Fault::NoInput(format!("{name}: is a directory")).into());
            }
            let length = found.is_file().then_some(found.len());
            let bytes = Progress::around(file, length, options);
            Ok((bytes, name, false))
        }
        _ => Ok((Box::new(io::stdin()), "stdin".to_owned(), true)),
    }
}

/// An input that holds a device's bytes, not records. Its reads obey the flush rule.
pub struct Bytes {
    live: LiveReader<Box<dyn Read>>,
    name: String,
}

impl Bytes {
    /// Opens a file; no path, or `-`, is stdin.
    pub fn open(path: Option<&Path>, options: &Options) -> anyhow::Result<Bytes> {
        let (bytes, name, _) = open_raw(path, options)?;
        Ok(Bytes {
            live: LiveReader::new(bytes, &name),
            name,
        })
    }

    /// The file's name, or `stdin`.
    pub fn name(&self) -> &str {
        &self.name
    }
}

impl Read for Bytes {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.live.read(buffer)
    }
}
