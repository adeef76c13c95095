//! The raw bytes of a device, kept as they came, with their times of arrival beside them.

use super::HostInstant;
use super::connection::plain;
use std::ffi::{OsStr, OsString};
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// When a recording goes on in a new file. With neither it stays in one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rotation {
    /// Once a file has this many bytes.
    pub bytes: Option<u64>,
    /// Once a file is this old.
    pub age: Option<Duration>,
}

impl Rotation {
    /// Whether there is more than one file at all.
    pub fn is_on(&self) -> bool {
        self.bytes.is_some() || self.age.is_some()
    }
}

/// A recording cannot be written (any more).
#[derive(Debug, thiserror::Error)]
#[error("{}: {reason}", path.display())]
pub struct RecordingError {
    /// The file.
    pub path: PathBuf,
    /// What the system says.
    pub reason: String,
}

impl RecordingError {
    /// What the system says of `path`.
    pub fn new(path: &Path, error: &io::Error) -> RecordingError {
        RecordingError {
            path: path.to_owned(),
            reason: plain(error),
        }
    }
}

/// Bytes stay in memory no longer than this while more come.
const LONGEST_IN_MEMORY: Duration = Duration::from_secs(1);
/// Bytes kept before they are written in one piece.
const BUFFER: usize = 1 << 18;

/// Writes `NAME.EXT` with the bytes and `NAME.times.csv` with a row a chunk, as
/// [`Arrivals`](super::Arrivals) reads them; with rotation `NAME.000.EXT`, `NAME.001.EXT`, and so on,
/// counted on behind files that are already there. Read one after the other, the files are the
/// stream: they are not cut at telegrams.
#[derive(Debug)]
pub struct Recorder {
    path: PathBuf,
    rotation: Rotation,
    index: u32,
    part: Part,
    /// First arrival on this connection; none until the next chunk comes.
    session: Option<HostInstant>,
    bytes: u64,
}

#[derive(Debug)]
struct Part {
    path: PathBuf,
    stream: BufWriter<File>,
    times_path: PathBuf,
    times: BufWriter<File>,
    bytes: u64,
    since: Instant,
    written: Instant,
}

impl Recorder {
    /// Creates the first file and its table. What had that name is gone.
    pub fn create(path: &Path, rotation: Rotation) -> Result<Recorder, RecordingError> {
        let index = if rotation.is_on() {
            first_free(path)
        } else {
            0
        };
        Ok(Recorder {
            path: path.to_owned(),
            rotation,
            index,
            part: Part::create(&name_of_part(path, rotation, index))?,
            session: None,
            bytes: 0,
        })
    }

    /// Says that what comes next is of another connection.
    pub fn new_session(&mut self) {
        self.session = None;
    }

    /// Bytes recorded so far.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// The file being written.
    pub fn path(&self) -> &Path {
        &self.part.path
    }

    /// Keeps a chunk of bytes that had arrived at `at`.
    pub fn chunk(&mut self, chunk: &[u8], at: HostInstant) -> Result<(), RecordingError> {
        let full = self
            .rotation
            .bytes
            .is_some_and(|most| self.part.bytes >= most);
        let old = self
            .rotation
            .age
            .is_some_and(|most| self.part.since.elapsed() >= most);
        if self.part.bytes > 0 && (full || old) {
            self.part.flush()?;
            self.index += 1;
            self.part = Part::create(&name_of_part(&self.path, self.rotation, self.index))?;
        }
        let session = *self.session.get_or_insert(at);
        self.bytes += chunk.len() as u64;
        self.part.chunk(chunk, at, session)
    }

    /// Lets everything go to the files.
    pub fn flush(&mut self) -> Result<(), RecordingError> {
        self.part.flush()
    }

    /// Ends the recording.
    pub fn finish(mut self) -> Result<(), RecordingError> {
        self.part.flush()
    }
}

impl Part {
    fn create(path: &Path) -> Result<Part, RecordingError> {
        let times_path = times_beside(path);
        let open = |path: &Path| {
            File::create(path)
                .map(|file| BufWriter::with_capacity(BUFFER, file))
                .map_err(|error| RecordingError::new(path, &error))
        };
        let mut part = Part {
            stream: open(path)?,
            times: open(&times_path)?,
            path: path.to_owned(),
            times_path,
            bytes: 0,
            since: Instant::now(),
            written: Instant::now(),
        };
        // The header goes out at once: a table without one is none, whatever ends this process.
        writeln!(part.times, "t_s,raw_s,offset,length,session_s")
            .and_then(|()| part.times.flush())
            .map_err(|error| RecordingError::new(&part.times_path, &error))?;
        Ok(part)
    }

    fn chunk(
        &mut self,
        chunk: &[u8],
        at: HostInstant,
        session: HostInstant,
    ) -> Result<(), RecordingError> {
        self.stream
            .write_all(chunk)
            .map_err(|error| RecordingError::new(&self.path, &error))?;
        writeln!(
            self.times,
            "{},{},{},{},{}",
            Seconds(at.utc.ns()),
            Seconds(at.raw_ns),
            self.bytes,
            chunk.len(),
            Seconds(session.utc.ns()),
        )
        .map_err(|error| RecordingError::new(&self.times_path, &error))?;
        self.bytes += chunk.len() as u64;
        if self.written.elapsed() >= LONGEST_IN_MEMORY {
            self.flush()?;
        }
        Ok(())
    }

    fn flush(&mut self) -> Result<(), RecordingError> {
        self.written = Instant::now();
        self.stream
            .flush()
            .map_err(|error| RecordingError::new(&self.path, &error))?;
        self.times
            .flush()
            .map_err(|error| RecordingError::new(&self.times_path, &error))
    }
}

/// Nanoseconds as decimal seconds, all nine digits.
struct Seconds(i64);

impl std::fmt::Display for Seconds {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let sign = if self.0 < 0 { "-" } else { "" };
        let ns = self.0.unsigned_abs();
        write!(f, "{sign}{}.{:09}", ns / 1_000_000_000, ns % 1_000_000_000)
    }
}

/// The table of arrival times that belongs to a recording: `NAME.times.csv` for `NAME.EXT`.
pub fn times_beside(recording: &Path) -> PathBuf {
    recording.with_extension("times.csv")
}

/// Whether a recorder of `recording` would write the file at `path`.
pub fn would_write(recording: &Path, rotation: Rotation, path: &Path) -> bool {
    if !rotation.is_on() {
        return path == recording || path == times_beside(recording);
    }
    if path.parent() != recording.parent() {
        return false;
    }
    // A part's table is named after the part, whatever the recording's extension is.
    let stem = path.to_string_lossy();
    let stem = stem.strip_suffix(".times.csv");
    let of_table = stem.map(|stem| PathBuf::from(format!("{stem}.x")));
    part_number(recording, path).is_some()
        || of_table.is_some_and(|part| part_number(&recording.with_extension("x"), &part).is_some())
}

fn name_of_part(path: &Path, rotation: Rotation, index: u32) -> PathBuf {
    if !rotation.is_on() {
        return path.to_owned();
    }
    let mut name = OsString::from(path.file_stem().unwrap_or_default());
    name.push(format!(".{index:03}"));
    if let Some(extension) = path.extension() {
        name.push(".");
        name.push(extension);
    }
    path.with_file_name(name)
}

/// The number of a part of `recording`; none for any other file.
fn part_number(recording: &Path, file: &Path) -> Option<u32> {
    let text = |part: Option<&OsStr>| Some(part?.to_str()?.to_owned());
    let name = text(file.file_name())?;
    let rest = name
        .strip_prefix(&text(recording.file_stem())?)?
        .strip_prefix('.')?;
    let number = match recording.extension() {
        None => rest,
        Some(extension) => rest.strip_suffix(extension.to_str()?)?.strip_suffix('.')?,
    };
    let digits = number.len() >= 3 && number.bytes().all(|byte| byte.is_ascii_digit());
    digits.then(|| number.parse().ok())?
}

/// The number behind the last part that is there.
fn first_free(path: &Path) -> u32 {
    let directory = match path.parent() {
        Some(parent) if parent != Path::new("") => parent,
        _ => Path::new("."),
    };
    let Ok(entries) = fs::read_dir(directory) else {
        return 0;
    };
    entries
        .filter_map(|entry| part_number(path, &entry.ok()?.path()))
        .max()
        .map_or(0, |last| last.saturating_add(1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::Arrivals;
    use crate::record::Stamp;

    struct Directory(PathBuf);

    impl Directory {
        fn new(name: &str) -> Directory {
            let name = format!("cablepose-recording-{}-{name}", std::process::id());
            let path = std::env::temp_dir().join(name);
            fs::create_dir_all(&path).unwrap();
            Directory(path)
        }

        fn arrivals(&self, name: &str) -> Arrivals {
            Arrivals::read(File::open(self.0.join(name)).unwrap()).unwrap()
        }
    }

    impl Drop for Directory {
        fn drop(&mut self) {
            let _ = fs::remove_dir_all(&self.0);
        }
    }

    fn at(ns: i64) -> HostInstant {
        HostInstant {
            utc: Stamp::from_ns(1_600_000_000_000_000_000 + ns),
            raw_ns: ns,
        }
    }

    #[test]
    fn bytes_and_times_come_back() {
        let dir = Directory::new("back");
        let mut recorder = Recorder::create(&dir.0.join("run.cola"), Rotation::default()).unwrap();
        recorder.chunk(b"abc", at(1)).unwrap();
        recorder.chunk(b"de", at(20)).unwrap();
        recorder.new_session();
        recorder.chunk(b"f", at(300)).unwrap();
        assert_eq!(recorder.bytes(), 6);
        recorder.finish().unwrap();
        assert_eq!(fs::read(dir.0.join("run.cola")).unwrap(), b"abcdef");
        let arrivals = dir.arrivals("run.times.csv");
        assert_eq!(arrivals.at(2), Some(at(1)));
        assert_eq!(arrivals.at(4), Some(at(20)));
        assert_eq!(arrivals.at(5), Some(at(300)));
        assert_eq!(arrivals.at(6), None);
        assert_eq!(arrivals.next_session(0), Some(5));
    }

    #[test]
    fn parts_follow_each_other_and_none_is_overwritten() {
        let dir = Directory::new("parts");
        let rotation = Rotation {
            bytes: Some(4),
            age: None,
        };
        for _ in 0..2 {
            let mut recorder = Recorder::create(&dir.0.join("run.cola"), rotation).unwrap();
            for (number, chunk) in [&b"abc"[..], b"de", b"fghijk"].iter().enumerate() {
                recorder.chunk(chunk, at(number as i64)).unwrap();
            }
            recorder.finish().unwrap();
        }
        for (name, bytes) in [
            ("run.000.cola", &b"abcde"[..]),
            ("run.001.cola", b"fghijk"),
            ("run.002.cola", b"abcde"),
            ("run.003.cola", b"fghijk"),
        ] {
            assert_eq!(fs::read(dir.0.join(name)).unwrap(), bytes, "{name}");
        }
        let first = dir.arrivals("run.000.times.csv");
        let second = dir.arrivals("run.001.times.csv");
        assert!(second.continues(&first));
        assert_eq!(second.at(0), Some(at(2)));
    }

    #[test]
    fn age_begins_a_new_part() {
        let dir = Directory::new("age");
        let rotation = Rotation {
            bytes: None,
            age: Some(Duration::ZERO),
        };
        let mut recorder = Recorder::create(&dir.0.join("run"), rotation).unwrap();
        recorder.chunk(b"a", at(1)).unwrap();
        recorder.chunk(b"b", at(2)).unwrap();
        assert_eq!(recorder.path(), dir.0.join("run.001"));
        recorder.finish().unwrap();
        assert_eq!(fs::read(dir.0.join("run.000")).unwrap(), b"a");
    }

    #[test]
    fn a_recorder_knows_its_files() {
        let plain = Rotation::default();
        let parts = Rotation {
            bytes: Some(1),
            age: None,
        };
        let writes =
            |rotation, file: &str| would_write(Path::new("d/run.cola"), rotation, Path::new(file));
        assert!(writes(plain, "d/run.cola") && writes(plain, "d/run.times.csv"));
        assert!(!writes(plain, "d/run.000.cola") && !writes(plain, "d/run.csv"));
        assert!(writes(parts, "d/run.000.cola") && writes(parts, "d/run.1234.times.csv"));
        assert!(!writes(parts, "d/run.cola") && !writes(parts, "run.000.cola"));
    }

    #[test]
    fn a_full_disk_is_said() {
        if !Path::new("/dev/full").exists() {
            return;
        }
        let dir = Directory::new("full");
        let path = dir.0.join("run.cola");
        std::os::unix::fs::symlink("/dev/full", &path).unwrap();
        let mut recorder = Recorder::create(&path, Rotation::default()).unwrap();
        recorder.chunk(b"abc", at(1)).unwrap();
        let error = recorder.flush().unwrap_err().to_string();
        assert!(
            error.ends_with("run.cola: No space left on device"),
            "{error}"
        );
    }
}
