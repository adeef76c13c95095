//! report's outputs: which characters they may have, that no two go to one place, and what is said
//! of limits.

use crate::report::Verdict;
use crate::stream::{Fault, Outcome, WholeFile};
use std::fs;
use std::path::{Path, PathBuf};

/// Symbolic links followed from one name to a file; as many as Linux follows.
const LINKS: usize = 40;

/// Opens the page, if one is wanted, and the text beside it, which goes to stdout where it has no
/// file. Both at one place are refused, where the second would take the first one's.
pub(super) fn open(
    page: Option<&Path>,
    text: Option<&Path>,
) -> anyhow::Result<(Option<WholeFile>, WholeFile)> {
    let stdout = Path::new("-");
    let refused = match (page, text.filter(|path| *path != stdout)) {
        (Some(page), None) if page == stdout => {
            Some("--html -: the text goes to stdout too; give it a file with -o".to_owned())
        }
        (Some(page), Some(text)) if place(page) == place(text) => {
            let name = page.display();
            Some(format!(
                "--html and -o name the same output, {name}: each needs one of its own"
            ))
        }
        _ => None,
    };
    if let Some(why) = refused {
        return Err(Fault::Usage(why).into());
    }
    let page = page.map(|path| WholeFile::open(Some(path))).transpose()?;
    Ok((page, WholeFile::open(text)?))
}

/// Says on stderr which limits do not hold.
pub(super) fn judged(verdicts: impl IntoIterator<Item = Verdict>) -> Outcome {
    let mut outcome = Outcome::Done;
    for verdict in verdicts.into_iter().filter(|verdict| verdict.failed) {
        outcome = Outcome::GateFailed;
        eprintln!("report: {verdict}");
    }
    outcome
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
