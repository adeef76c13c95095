//! Results as text and JSON, to stdout or a file.

use crate::stream::Fault;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Writes a whole result: a file gets its name when it is whole, what is no file is written in
/// place; none, or `-`, is stdout.
pub(super) fn write(path: Option<&Path>, text: &str) -> anyhow::Result<()> {
    let fault = |name: &Path, error: &std::io::Error| {
        let why = error.to_string();
        let why = why.split(" (os error").next().unwrap_or_default();
        Fault::Io(format!("{}: {why}", name.display()))
    };
    let Some(path) = path.filter(|path| *path != Path::new("-")) else {
        let mut out = std::io::stdout().lock();
        let written = out.write_all(text.as_bytes()).and_then(|()| out.flush());
        return written.map_err(|error| match error.kind() {
            // A reader that has left is told from a fault by the error itself.
            std::io::ErrorKind::BrokenPipe => error.into(),
            _ => fault(Path::new("stdout"), &error).into(),
        });
    };
    if fs::metadata(path).is_ok_and(|found| !found.is_file()) {
        return fs::OpenOptions::new()
            .write(true)
            .open(path)
            .and_then(|mut file| file.write_all(text.as_bytes()))
            .map_err(|error| fault(path, &error).into());
    }
    let mut partial = path.as_os_str().to_owned();
    partial.push(".partial");
    let partial = PathBuf::from(partial);
    fs::write(&partial, text)
        .and_then(|()| fs::rename(&partial, path))
        .map_err(|error| fault(path, &error).into())
}

/// Nanoseconds as seconds with all their digits: `-12.000000345`.
pub(super) fn seconds(ns: i64) -> String {
    let sign = if ns < 0 { "-" } else { "" };
    let ns = ns.unsigned_abs();
    format!("{sign}{}.{:09}", ns / 1_000_000_000, ns % 1_000_000_000)
}

/// ` +- 0.9 us`, or that it is not known.
pub(super) fn sigma(value: Option<f64>, scale: f64, unit: &str) -> String {
    match value {
        Some(value) => format!(" +- {:.*} {unit}", digits(value * scale), value * scale),
        None => " (too short to say how it scatters)".to_owned(),
    }
}

/// How many digits after the point show two of a number.
fn digits(value: f64) -> usize {
    match value.abs() {
        v if v >= 100.0 => 0,
        v if v >= 10.0 => 1,
        v if v >= 1.0 => 2,
        _ => 3,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seconds_keep_their_digits() {
        assert_eq!(seconds(0), "0.000000000");
        assert_eq!(seconds(-12_000_000_345), "-12.000000345");
        assert_eq!(seconds(-345), "-0.000000345");
        assert_eq!(seconds(i64::MIN), "-9223372036.854775808");
    }
}
