//! report's outputs: which characters they may have, and that no two go to one place.

use crate::stream::Fault;
use std::fs;
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

/// Whether the locale is one of UTF-8.
pub(super) fn is_utf8() -> bool {
    let set = |name: &str| std::env::var(name).ok().filter(|v| !v.is_empty());
    let locale = ["LC_ALL", "LC_CTYPE", "LANG"].into_iter().find_map(set);
    locale.is_some_and(|l| l.to_uppercase().replace('-', "").contains("UTF8"))
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

/// Makes a folder for several files, unless it is there.
pub(super) fn folder(path: &Path) -> Result<(), Fault> {
    fs::create_dir_all(path).map_err(|error| {
        let why = match error.kind() {
            std::io::ErrorKind::AlreadyExists => "is there and no folder".to_owned(),
            _ => error.to_string(),
        };
        Fault::Io(format!("{}: {why}", path.display()))
    })
}
