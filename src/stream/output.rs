//! Where records go: stdout or a file, in one of the encodings.

use super::check::StreamRecord;
use super::csv::CsvWriter;
use super::exit::{self, Fault};
use super::flow::{self, BeforeWait};
use super::input::Input;
use super::mcap::McapWriter;
#[cfg(unix)]
use super::patient::Patient;
use super::provenance::Provenance;
use super::trajectory_text::{Layout, TextWriter};
use super::{Encoding, Options, Role};
use crate::record::TrajectoryPoint;
use std::cell::RefCell;
use std::fs::{self, File};
use std::io::{self, IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::{Mutex, PoisonError};

/// An output stream: stdout or `-o`.
///
/// A file is written as `NAME.partial` and gets its name in [`Output::finish`]; a program that is
/// cut off leaves the partial file with what it had. A symbolic link stays: its target is written
/// so. No two outputs of a process can be one file. What is not a regular file (a FIFO,
/// `/dev/null`) is written in place.
pub struct Output {
    core: Rc<RefCell<Core>>,
    encoding: Encoding,
}

struct Core {
    encoder: Encoder,
    rename: Option<Rename>,
    /// Keeps the file's names from the other outputs.
    _claim: Option<Claim>,
    /// Whether every record goes out at once.
    prompt: bool,
    records: u64,
    tool: &'static str,
    name: String,
    /// This process as a stage of the records' provenance.
    stage: Provenance,
    /// Whether CSV says where it comes from.
    meta: bool,
}

enum Encoder {
    Csv(Box<CsvWriter<Target>>),
    Mcap(Box<McapWriter<Target>>),
    Text(Box<TextWriter<Target>>),
}

struct Rename {
    from: PathBuf,
    to: PathBuf,
}

/// The files that this process is writing.
static CLAIMED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// The names that an output has to itself as long as it is open.
pub(super) struct Claim([PathBuf; 2]);

impl Claim {
    /// Claims a file's name and its partial name; fails if another output has one of them.
    pub(super) fn new(names: [&Path; 2]) -> Result<Claim, Fault> {
        let names = names.map(absolute);
        let mut claimed = CLAIMED.lock().unwrap_or_else(PoisonError::into_inner);
        if names.iter().any(|name| claimed.contains(name)) {
            let name = names[0].display();
            return Err(Fault::Usage(format!("{name}: two outputs go to this file")));
        }
        claimed.extend(names.iter().cloned());
        Ok(Claim(names))
    }
}

impl Drop for Claim {
    fn drop(&mut self) {
        let mut claimed = CLAIMED.lock().unwrap_or_else(PoisonError::into_inner);
        claimed.retain(|name| !self.0.contains(name));
    }
}

/// A file's name, the same however its directory is spelt. The file need not be there.
fn absolute(path: &Path) -> PathBuf {
    let directory = match path.parent() {
        Some(parent) if parent != Path::new("") => parent,
        _ => Path::new("."),
    };
    match (fs::canonicalize(directory), path.file_name()) {
        (Ok(directory), Some(name)) => directory.join(name),
        _ => path.to_owned(),
    }
}

/// What a symbolic link points to in the end, whether or not it is there; any other path itself.
pub(super) fn behind_links(path: &Path) -> PathBuf {
    /// As many as Linux follows.
    const LINKS: usize = 40;
    let mut path = path.to_owned();
    for _ in 0..LINKS {
        let Ok(target) = fs::read_link(&path) else {
            break;
        };
        path = path.parent().unwrap_or(Path::new("")).join(target);
    }
    path
}

/// What a file is called until it is whole.
pub(super) fn partial_of(path: &Path) -> PathBuf {
    let mut partial = path.as_os_str().to_owned();
    partial.push(".partial");
    PathBuf::from(partial)
}

/// A file or stdout whose errors name it.
pub(super) struct Target {
    inner: Box<dyn Write>,
    name: String,
}

impl Write for Target {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.inner
            .write(bytes)
            .map_err(|error| flow::named(&self.name, error))
    }
    fn flush(&mut self) -> io::Result<()> {
        self.inner
            .flush()
            .map_err(|error| flow::named(&self.name, error))
    }
}

impl Output {
    /// Opens the main output of a source: `-o` or stdout, in `--format` or CSV.
    pub fn open(options: &Options) -> anyhow::Result<Output> {
        Output::open_as(options, options.format.unwrap_or(Encoding::Csv))
    }

    /// Opens the main output in an encoding.
    pub(super) fn open_as(options: &Options, encoding: Encoding) -> anyhow::Result<Output> {
        match &options.output {
            Some(path) if path != Path::new("-") => {
                Output::create_file(path, encoding, options, false)
            }
            _ => {
                if encoding == Encoding::Mcap && io::stdout().is_terminal() {
                    return Err(Fault::Usage(
                        "MCAP is binary and stdout a terminal: redirect it or give -o FILE".into(),
                    )
                    .into());
                }
                // `Stdout` has a line buffer of its own; the file descriptor has not.
                let target = Target {
                    inner: Box::new(stdout_unbuffered()),
                    name: "stdout".to_owned(),
                };
                Output::new(target, encoding, options, None, false)
            }
        }
    }

    /// Creates a further output file (`--truth FILE`). Into a FIFO every record goes out at once:
    /// it is another program's side input, which must not lag behind its main one.
    ///
    /// # Errors
    /// A file that cannot be written; [`Fault::Usage`] for `-`, which is the main output's.
    pub fn create(path: &Path, encoding: Encoding, options: &Options) -> anyhow::Result<Output> {
        if path == Path::new("-") {
            let text =
                "- is stdout, which is for the main output: give a file (./- for one of that name)";
            return Err(Fault::Usage(text.to_owned()).into());
        }
        Output::create_file(path, encoding, options, true)
    }

    fn create_file(
        path: &Path,
        encoding: Encoding,
        options: &Options,
        further: bool,
    ) -> anyhow::Result<Output> {
        let in_place = fs::metadata(path).is_ok_and(|found| !found.is_file());
        let (create, rename) = if in_place {
            (path.to_owned(), None)
        } else {
            let to = behind_links(path);
            let from = partial_of(&to);
            let claim = Claim::new([&to, &from])?;
            let rename = Rename {
                from: from.clone(),
                to,
            };
            (from, Some((rename, claim)))
        };
        let file: io::Result<Box<dyn Write>> = match in_place {
            #[cfg(unix)]
            true => Patient::open(&create).map(|file| Box::new(file) as Box<dyn Write>),
            _ => File::create(&create).map(|file| Box::new(file) as Box<dyn Write>),
        };
        let name = path.display().to_string();
        let inner = file.map_err(|error| flow::named(&name, error))?;
        let target = Target { inner, name };
        Output::new(target, encoding, options, rename, in_place && further)
    }

    fn new(
        target: Target,
        encoding: Encoding,
        options: &Options,
        file: Option<(Rename, Claim)>,
        prompt: bool,
    ) -> anyhow::Result<Output> {
        let (rename, claim) = file.unzip();
        let name = target.name.clone();
        let encoder = match encoding {
            Encoding::Csv => Encoder::Csv(Box::new(CsvWriter::new(target))),
            Encoding::Mcap => Encoder::Mcap(Box::new(McapWriter::new(
                target,
                rename.is_some(),
                options,
            )?)),
            Encoding::Tum => Encoder::Text(Box::new(TextWriter::new(target, Layout::Tum))),
            Encoding::Euroc => Encoder::Text(Box::new(TextWriter::new(target, Layout::Euroc))),
        };
        let core = Rc::new(RefCell::new(Core {
            encoder,
            rename,
            _claim: claim,
            prompt,
            records: 0,
            tool: options.tool,
            name,
            stage: Provenance::of_this(options),
            meta: options.meta,
        }));
        if options.meta {
            core.borrow_mut().precede(&[]);
        }
        flow::register(&core);
        Ok(Output { core, encoding })
    }

    /// The encoding of this output.
    pub fn encoding(&self) -> Encoding {
        self.encoding
    }

    /// How many records have been written.
    pub fn records(&self) -> u64 {
        self.core.borrow().records
    }

    /// Fixes the columns of a CSV stream before its first record: those in which `like` has a value.
    pub fn columns_like<R: StreamRecord>(&mut self, like: &R) -> anyhow::Result<()> {
        self.fix_columns(like)
    }

    /// The same for those that share the output.
    pub(super) fn fix_columns<R: StreamRecord>(&self, like: &R) -> anyhow::Result<()> {
        match &mut self.core.borrow_mut().encoder {
            Encoder::Csv(csv) => csv.columns_like(like).map_err(unhide),
            Encoder::Mcap(_) | Encoder::Text(_) => Ok(()),
        }
    }

    /// Writes a record. In CSV the first one fixes the stream's kind.
    pub fn write<R: StreamRecord>(&mut self, record: &R) -> anyhow::Result<()> {
        self.put(record, Role::Desired)
    }

    /// Writes a point of the true or the desired trajectory.
    pub fn write_trajectory(&mut self, role: Role, point: &TrajectoryPoint) -> anyhow::Result<()> {
        self.put(point, role)
    }

    pub(super) fn put<R: StreamRecord>(&self, record: &R, role: Role) -> anyhow::Result<()> {
        let mut core = self.core.borrow_mut();
        core.records += 1;
        match &mut core.encoder {
            Encoder::Csv(csv) => csv.write(record),
            Encoder::Mcap(mcap) => mcap.write(record, role),
            Encoder::Text(text) => text.write(record),
        }
        .map_err(unhide)?;
        if core.prompt {
            core.flush().map_err(unhide)?;
        }
        Ok(())
    }

    /// Says where the records come from that are about to be written: what the input says of itself.
    /// In MCAP the input's own stages go on by themselves.
    pub(super) fn follow<R: StreamRecord>(&self, input: &Input<R>) -> anyhow::Result<()> {
        let core = &mut *self.core.borrow_mut();
        let stages = input.provenance();
        match &mut core.encoder {
            Encoder::Csv(_) if input.encoding() == Encoding::Csv => {
                core.meta |= !stages.is_empty();
                core.precede(input.remarks());
                Ok(())
            }
            Encoder::Csv(_) => {
                let lines = stages.iter().enumerate();
                let lines = lines.map(|(i, stage)| stage.to_line(i).into_bytes());
                let lines: Vec<_> = lines.filter(|_| core.meta).collect();
                core.precede(&lines);
                Ok(())
            }
            Encoder::Mcap(_) if input.encoding() == Encoding::Mcap => Ok(()),
            Encoder::Mcap(mcap) => stages.iter().try_for_each(|stage| mcap.write_stage(stage)),
            Encoder::Text(_) => Ok(()),
        }
        .map_err(unhide)
    }

    /// Calls `use_mcap` with the MCAP writer, if this is one.
    pub(super) fn with_mcap(
        &self,
        use_mcap: impl FnOnce(&mut McapWriter<Target>) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        match &mut self.core.borrow_mut().encoder {
            Encoder::Csv(_) | Encoder::Text(_) => Ok(()),
            Encoder::Mcap(mcap) => use_mcap(mcap).map_err(unhide),
        }
    }

    /// Lets everything written so far go out. Inputs do this by themselves before they wait; a
    /// source does it before it sleeps.
    pub fn flush(&mut self) -> anyhow::Result<()> {
        self.core.borrow_mut().flush().map_err(unhide)
    }

    /// Ends the stream and gives the file its name.
    pub fn finish(self) -> anyhow::Result<()> {
        self.end()?;
        match self.core.borrow_mut().rename.take() {
            Some(Rename { from, to }) => fs::rename(&from, &to)
                .map_err(|error| flow::named(&to.display().to_string(), error).into()),
            None => Ok(()),
        }
    }

    /// Ends a stream of one kind, which may have had no records, and gives the file its name.
    pub fn finish_kind<R: StreamRecord>(self) -> anyhow::Result<()> {
        match &mut self.core.borrow_mut().encoder {
            Encoder::Csv(csv) => csv.write_empty::<R>(),
            Encoder::Mcap(_) => Ok(()),
            Encoder::Text(text) => text.begin::<R>(),
        }
        .map_err(unhide)?;
        self.finish()
    }

    /// Ends the stream's bytes; a file keeps its partial name, because something went wrong.
    pub(super) fn end(&self) -> anyhow::Result<()> {
        let mut core = self.core.borrow_mut();
        let Core {
            encoder,
            tool,
            name,
            ..
        } = &mut *core;
        match encoder {
            Encoder::Csv(csv) => csv.flush().map_err(anyhow::Error::from),
            Encoder::Mcap(mcap) => mcap.finish(),
            Encoder::Text(text) => text.finish(tool, name).map_err(anyhow::Error::from),
        }
        .map_err(unhide)
    }
}

impl Core {
    /// Puts `lines` above the header of CSV and, where that is wanted, this process behind them.
    fn precede(&mut self, lines: &[Vec<u8>]) {
        let Encoder::Csv(csv) = &mut self.encoder else {
            return;
        };
        let mut lines = lines.to_vec();
        if self.meta {
            let earlier = lines.iter().filter_map(|line| Provenance::from_line(line));
            let line = self.stage.to_line(earlier.count());
            lines.push(line.into_bytes());
        }
        csv.set_remarks(&lines);
    }

    fn flush(&mut self) -> anyhow::Result<()> {
        match &mut self.encoder {
            Encoder::Csv(csv) => Ok(csv.flush()?),
            Encoder::Mcap(mcap) => mcap.flush(),
            Encoder::Text(text) => Ok(text.flush()?),
        }
    }
}

impl BeforeWait for Core {
    fn before_wait(&mut self) -> io::Result<()> {
        let result = match &mut self.encoder {
            Encoder::Csv(csv) => return csv.flush(),
            Encoder::Text(text) => return text.flush(),
            Encoder::Mcap(mcap) => mcap.before_wait(),
        };
        result.map_err(|error| match unhide(error).downcast::<io::Error>() {
            Ok(io) => io,
            Err(other) => io::Error::other(other),
        })
    }
}

/// The I/O error that a format's error hides, without the format's words around it.
fn unhide(error: anyhow::Error) -> anyhow::Error {
    match error.chain().find_map(exit::io_error) {
        Some(io) => io::Error::new(io.kind(), io.to_string()).into(),
        None => error,
    }
}

/// Stdout without the line buffer that `std::io::Stdout` puts before it.
#[cfg(unix)]
pub(super) fn stdout_unbuffered() -> impl Write + 'static {
    use std::os::fd::AsFd;
    // A duplicate, so that closing it leaves descriptor 1 open.
    match io::stdout().as_fd().try_clone_to_owned() {
        Ok(fd) => Box::new(Patient::new(File::from(fd))) as Box<dyn Write>,
        Err(_) => Box::new(io::stdout()),
    }
}

/// Stdout; each of our large writes ends with a flush.
#[cfg(not(unix))]
pub(super) fn stdout_unbuffered() -> impl Write + 'static {
    io::stdout()
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use crate::stream::samples;
    use crate::stream::scratch::Scratch;

    #[test]
    fn a_link_stays_a_link() {
        let dir = Scratch::new("output-link");
        fs::create_dir(dir.file("there")).unwrap();
        let link = dir.file("link.csv");
        std::os::unix::fs::symlink("there/file.csv", &link).unwrap();
        // The first time the target is not there yet, the second time it is.
        for _ in 0..2 {
            let mut output = Output::create(&link, Encoding::Csv, &Options::default()).unwrap();
            assert!(dir.file("there/file.csv.partial").exists());
            output.write(&samples::point()).unwrap();
            output.finish().unwrap();
            assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
            assert_eq!(fs::read_to_string(&link).unwrap().lines().count(), 2);
            assert!(!dir.file("there/file.csv.partial").exists());
        }
    }

    #[test]
    fn a_further_output_is_no_file_called_dash() {
        let create = Output::create(Path::new("-"), Encoding::Csv, &Options::default());
        assert_eq!(exit::status(&create.err().unwrap()), 2);
    }

    #[test]
    fn two_outputs_cannot_be_one_file() {
        let dir = Scratch::new("output-twice");
        let create =
            |name: &str| Output::create(&dir.file(name), Encoding::Csv, &Options::default());
        let first = create("a").unwrap();
        for same in ["a", "../a", "./a", "a.partial"] {
            let same = same.replace(
                "..",
                &format!("../{}", dir.directory().file_name().unwrap().display()),
            );
            let error = create(&same).err().unwrap();
            assert_eq!(exit::status(&error), 2, "{same}");
        }
        assert!(create("b").is_ok());
        first.finish().unwrap();
        assert!(create("a").is_ok());
    }
}
