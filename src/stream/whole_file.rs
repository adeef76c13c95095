//! What a run writes whole at its end: a table, a page, a picture, a calibrated frame.

use super::flow;
use super::output::{Claim, behind_links, partial_of};
use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Where such a thing goes: stdout, or a file that is there whole or not at all.
///
/// It is opened when the run begins, so that an hour's run does not end with a directory that
/// cannot be written. What is there and is no regular file (a FIFO, a device) is written in place,
/// at the end; of a symbolic link, the file that it leads to is written.
pub struct WholeFile(Place);

enum Place {
    Stdout,
    There(PathBuf),
    File(Box<Partial>),
}

/// A file that has its name only when it is whole. Without [`WholeFile::finish`] it goes away again.
struct Partial {
    file: File,
    from: PathBuf,
    to: PathBuf,
    whole: bool,
    _claim: Claim,
}

impl Drop for Partial {
    fn drop(&mut self) {
        if !self.whole {
            // An empty file that stays does no harm.
            let _ = fs::remove_file(&self.from);
        }
    }
}

impl WholeFile {
    /// Opens a place: none, or `-`, is stdout.
    ///
    /// # Errors
    /// A file that cannot be written, or one that another output of this process has.
    pub fn open(path: Option<&Path>) -> anyhow::Result<WholeFile> {
        let Some(path) = path.filter(|path| *path != Path::new("-")) else {
            return Ok(WholeFile(Place::Stdout));
        };
        match fs::metadata(path) {
            Ok(found) if found.is_dir() => {
                return Err(named(path, io::ErrorKind::IsADirectory.into()).into());
            }
            Ok(found) if !found.is_file() => {
                return Ok(WholeFile(Place::There(path.to_owned())));
            }
            _ => {}
        }
        let to = behind_links(path);
        let from = partial_of(&to);
        let claim = Claim::new([&to, &from])?;
        let file = File::create(&from).map_err(|error| named(&to, error))?;
        Ok(WholeFile(Place::File(Box::new(Partial {
            file,
            from,
            to,
            whole: false,
            _claim: claim,
        }))))
    }

    /// Writes what the file is to hold and gives it its name.
    ///
    /// # Errors
    /// What goes wrong with writing, with the file's name. A reader of stdout that has left is told
    /// by the error's kind.
    pub fn finish(self, whole: impl AsRef<[u8]>) -> anyhow::Result<()> {
        let bytes = whole.as_ref();
        match self.0 {
            Place::Stdout => {
                let mut out = io::stdout().lock();
                let written = out.write_all(bytes).and_then(|()| out.flush());
                Ok(written.map_err(|error| flow::named("stdout", error))?)
            }
            Place::There(path) => {
                let file = OpenOptions::new().write(true).open(&path);
                let written = file.and_then(|mut file| file.write_all(bytes));
                Ok(written.map_err(|error| named(&path, error))?)
            }
            Place::File(mut partial) => {
                let written = partial.file.write_all(bytes);
                written
                    .and_then(|()| fs::rename(&partial.from, &partial.to))
                    .map_err(|error| named(&partial.to, error))?;
                partial.whole = true;
                Ok(())
            }
        }
    }
}

fn named(path: &Path, error: io::Error) -> io::Error {
    flow::named(&path.display().to_string(), error)
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use crate::stream::exit;
    use crate::stream::scratch::Scratch;

    #[test]
    fn it_is_there_whole_or_not_at_all() {
        let dir = Scratch::new("whole-file");
        let path = dir.file("page.html");
        fs::write(&path, "old").unwrap();
        let partial = dir.file("page.html.partial");
        drop(WholeFile::open(Some(&path)).unwrap());
        assert!(!partial.exists());
        let file = WholeFile::open(Some(&path)).unwrap();
        assert!(partial.exists());
        // The same name twice, or a place that cannot be written, shows at the start.
        let twice = WholeFile::open(Some(&path)).err().unwrap();
        assert_eq!(exit::status(&twice), 2);
        let nowhere = WholeFile::open(Some(&dir.file("none/page.html")))
            .err()
            .unwrap();
        assert_eq!(exit::status(&nowhere), 74);
        assert!(
            nowhere.to_string().contains("none/page.html: No such file"),
            "{nowhere}"
        );
        // So does a directory, which has no place for it.
        let folder = WholeFile::open(Some(dir.directory())).err().unwrap();
        assert_eq!(exit::status(&folder), 74);
        assert!(folder.to_string().ends_with(": is a directory"), "{folder}");
        assert_eq!(fs::read_to_string(&path).unwrap(), "old");
        file.finish("new").unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "new");
        assert!(!partial.exists());
    }
}
