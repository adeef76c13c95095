//! report's outputs: a file gets its name when it is whole; what is no file is written in place.

use crate::stream::Fault;
use anyhow::Context;
use std::ffi::OsString;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Symbolic links followed from one name to a file; as many as Linux follows.
const LINKS: usize = 40;

/// Refuses a page and a table at one place, where the second would take the first one's.
pub(super) fn refuse_one_place(page: Option<&Path>, table: Option<&Path>) -> Result<(), Fault> {
    let (Some(page), Some(table)) = (page, table) else {
        return Ok(());
    };
    if place(page) != place(table) {
        return Ok(());
    }
    let name = page.display();
    Err(Fault::Usage(format!(
        "--html and -o name the same output, {name}: each needs one of its own"
    )))
}

/// Prints a text, or writes it to the file of `-o`.
pub(super) fn print(text: &str, output: Option<&Path>) -> anyhow::Result<()> {
    match output.filter(|path| *path != Path::new("-")) {
        Some(path) => write(path, text),
        None => {
            let mut out = std::io::stdout().lock();
            out.write_all(text.as_bytes())?;
            Ok(out.flush()?)
        }
    }
}

/// Whether the locale is one of UTF-8.
pub(super) fn is_utf8() -> bool {
    let set = |name: &str| std::env::var(name).ok().filter(|v| !v.is_empty());
    let locale = ["LC_ALL", "LC_CTYPE", "LANG"].into_iter().find_map(set);
    locale.is_some_and(|l| l.to_uppercase().replace('-', "").contains("UTF8"))
}

/// Writes a file under a temporary name and renames it when it is whole. What is there already and
/// is no regular file (a FIFO, a device) is written in place; of a symbolic link, the file that it
/// leads to is written.
pub(super) fn write(path: &Path, text: impl AsRef<[u8]>) -> anyhow::Result<()> {
    let bytes = text.as_ref();
    let name = || path.display().to_string();
    if fs::metadata(path).is_ok_and(|found| !found.is_file()) {
        let mut file = fs::OpenOptions::new()
            .write(true)
            .open(path)
            .with_context(name)?;
        return file.write_all(bytes).with_context(name);
    }
    let target = linked(path);
    let mut partial = OsString::from(&target);
    partial.push(".partial");
    let partial = PathBuf::from(partial);
    fs::write(&partial, bytes).with_context(name)?;
    fs::rename(&partial, target).with_context(name)
}

/// Where a chain of symbolic links leads, whether there is a file yet or not.
fn linked(path: &Path) -> PathBuf {
    let mut path = path.to_owned();
    for _ in 0..LINKS {
        let Ok(target) = fs::read_link(&path) else {
            break;
        };
        path = match path.parent() {
            Some(folder) => folder.join(target),
            None => target,
        };
    }
    path
}

/// One name for a file, however its path is written.
fn place(path: &Path) -> PathBuf {
    let path = linked(path);
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty());
    let folder = fs::canonicalize(folder.unwrap_or(Path::new(".")));
    match (folder, path.file_name()) {
        (Ok(folder), Some(name)) => folder.join(name),
        _ => path,
    }
}
