//! How a report names what it came from: nothing of the machine it was made on, no clock of its own.

use std::path::{Path, PathBuf};

/// A run on the command line: `[NAME=]POSES`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Source {
    /// What people call it; no two runs have the same name.
    pub name: String,
    /// File, FIFO, or `-` for stdin.
    pub path: PathBuf,
}

/// The runs that are `given`, stdin if none. A run without a name is called by its file; a file name
/// with `=` in it is told from a name by a `/` in front.
pub fn sources(given: &[String]) -> Vec<Source> {
    let stdin = ["-".to_owned()];
    let given = if given.is_empty() { &stdin } else { given };
    let mut sources: Vec<Source> = Vec::new();
    for text in given {
        let (name, path) = match text.split_once('=') {
            Some((name, path)) if !name.is_empty() && !name.contains('/') => (Some(name), path),
            _ => (None, text.as_str()),
        };
        let path = PathBuf::from(path);
        let file = path.file_stem().filter(|_| !is_nameless(&path));
        let base = match (name, file) {
            (Some(name), _) => name.to_owned(),
            (None, Some(file)) => file.to_string_lossy().into_owned(),
            (None, None) => "poses".to_owned(),
        };
        let mut name = base.clone();
        let mut number = 1;
        while sources.iter().any(|s| s.name == name) {
            number += 1;
            name = format!("{base} {number}");
        }
        sources.push(Source { name, path });
    }
    sources
}

/// The parts of runs that are `given`, stdin if none. Parts with the same name belong together, and so
/// do all that have none: they are called by what the first of their files is called without its
/// number.
pub fn parts(given: &[String]) -> Vec<Source> {
    let mut parts = sources(given);
    let named = |text: &str| sources(&[text.to_owned()]).pop().map(|s| s.name);
    let mut whole: Option<String> = None;
    for (part, text) in parts.iter_mut().zip(given) {
        let path = part.path.to_string_lossy();
        if text.as_str() != path {
            part.name = named(text).unwrap_or_default();
            continue;
        }
        let number = |c: char| c.is_ascii_digit() || "-_. ".contains(c);
        let name = || match part.name.trim_end_matches(number) {
            "" => "run".to_owned(),
            name => name.to_owned(),
        };
        part.name = whole.get_or_insert_with(name).clone();
    }
    parts
}

/// What several inputs are called together: `a.csv`, `a.csv and b.csv`, `4 files, a.csv to d.csv`, or
/// `4 files, a.csv` where all have one name, each in a folder of its own.
pub fn input_names(names: impl Iterator<Item = String>) -> String {
    let names: Vec<String> = names.collect();
    match &names[..] {
        [] => String::new(),
        [one] => one.clone(),
        [first, ..] if names.iter().all(|name| name == first) => {
            format!("{} files, {first}", names.len())
        }
        [one, other] => format!("{one} and {other}"),
        [first, .., last] => format!("{} files, {first} to {last}", names.len()),
    }
}

/// What an input is called: its file's name, without its folder.
pub fn input_name(path: &Path) -> String {
    if path == Path::new("-") {
        return "standard input".to_owned();
    }
    if is_nameless(path) {
        return "a pipe".to_owned();
    }
    let name = path.file_name().unwrap_or_default();
    name.to_string_lossy().into_owned()
}

/// Stdin, or a pipe that a shell made (`<(...)`), whose number means nothing.
fn is_nameless(path: &Path) -> bool {
    path == Path::new("-") || path.starts_with("/dev") || path.starts_with("/proc")
}

/// The command line of this process; what is no text in it is shown as well as it can be.
pub fn own_command_line() -> String {
    command_line(std::env::args_os().map(|word| word.to_string_lossy().into_owned()))
}

/// A command line that can be pasted into a shell, without folders.
fn command_line(words: impl Iterator<Item = String>) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_=+,./:@%".contains(c);
    let words = words.map(|word| {
        let word = without_folders(&word);
        if !word.is_empty() && word.chars().all(plain) {
            word
        } else {
            format!("'{}'", word.replace('\'', r"'\''"))
        }
    });
    words.collect::<Vec<_>>().join(" ")
}

/// A word of a command line with folders left out: `joint=/data/a.csv` becomes `joint=a.csv`.
pub fn without_folders(word: &str) -> String {
    let Some(slash) = word.find('/') else {
        return word.to_owned();
    };
    let (before, _) = word.split_at(slash);
    let start = before.rfind(['=', ':', '\'', '"']).map_or(0, |i| i + 1);
    let (prefix, path) = word.split_at(start);
    let name = path.trim_end_matches('/').rsplit('/').next();
    format!("{prefix}{}", name.unwrap_or_default())
}

/// A command line with folders left out of all its words.
pub fn command_without_folders(command: &str) -> String {
    let words: Vec<String> = command.split(' ').map(without_folders).collect();
    words.join(" ")
}

/// `seconds` since the epoch (`SOURCE_DATE_EPOCH`) as a date, `2026-11-22`; none for no number.
pub fn date(seconds: &str) -> Option<String> {
    let days = seconds.trim().parse::<i64>().ok()?.div_euclid(86_400);
    if days.abs() > 3_000_000 {
        return None;
    }
    // Howard Hinnant's civil_from_days: eras of 400 years that begin on 1 March.
    let z = days + 719_468;
    let era = z.div_euclid(146_097);
    let day_of_era = z.rem_euclid(146_097);
    let year_of_era =
        (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = (month_from_march + 2) % 12 + 1;
    let year = year_of_era + era * 400 + i64::from(month <= 2);
    Some(format!("{year:04}-{month:02}-{day:02}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_are_left_out() {
        assert_eq!(without_folders("/home/me/run.csv"), "run.csv");
        assert_eq!(without_folders("joint=../a/b.csv"), "joint=b.csv");
        assert_eq!(without_folders("--fail-if"), "--fail-if");
        assert_eq!(without_folders("'x/y z.csv'"), "'y z.csv'");
        assert_eq!(without_folders("/"), "");
        let command = command_without_folders("solve-pose -f /etc/a.toml x=/dev/fd/63");
        assert_eq!(command, "solve-pose -f a.toml x=63");
    }

    #[test]
    fn runs_have_names_of_their_own() {
        let given = [
            "-",
            "a/run.csv",
            "b/run.csv",
            "joint=-",
            "./x=y.csv",
            "/dev/fd/63",
        ];
        let sources = sources(&given.map(str::to_owned));
        let names: Vec<&str> = sources.iter().map(|s| s.name.as_str()).collect();
        assert_eq!(names, ["poses", "run", "run 2", "joint", "x=y", "poses 2"]);
        assert_eq!(sources[3].path, Path::new("-"));
        assert_eq!(super::sources(&[]).len(), 1);
        assert_eq!(input_name(Path::new("a/run.csv")), "run.csv");
        assert_eq!(input_name(Path::new("/dev/fd/63")), "a pipe");
        let words = ["/bin/report", "z<=3.5", "it's"];
        let line = command_line(words.iter().map(ToString::to_string));
        assert_eq!(line, r"report 'z<=3.5' 'it'\''s'");
    }

    #[test]
    fn parts_of_a_run_share_its_name() {
        let names = |given: &[&str]| -> Vec<String> {
            let given: Vec<String> = given.iter().map(ToString::to_string).collect();
            parts(&given).into_iter().map(|part| part.name).collect()
        };
        let given = ["out/poses-1.csv", "a=x1.csv", "out/poses-2.csv", "a=x2.csv"];
        assert_eq!(names(&given), ["poses", "a", "poses", "a"]);
        assert_eq!(names(&["1.csv", "2.csv"]), ["run", "run"]);
        assert_eq!(names(&[]), ["poses"]);
        let together = |given: &[&str]| input_names(given.iter().map(ToString::to_string));
        assert_eq!(together(&["a"]), "a");
        assert_eq!(together(&["a", "b"]), "a and b");
        assert_eq!(together(&["a", "b", "c"]), "3 files, a to c");
        assert_eq!(together(&["a", "a"]), "2 files, a");
    }

    #[test]
    fn dates() {
        assert_eq!(date("0").as_deref(), Some("1970-01-01"));
        assert_eq!(date("951782400").as_deref(), Some("2000-02-29"));
        assert_eq!(date("1795305600").as_deref(), Some("2026-11-22"));
        assert_eq!(date("-1").as_deref(), Some("1969-12-31"));
        assert_eq!(date("today"), None);
    }
}
