//! A TOML file that describes something: read and checked, with messages that name the key.

use serde::de::DeserializeOwned;
use std::path::{Path, PathBuf};

/// Why such a file cannot be used. The text names the key.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file could not be read.
    #[error("{path}: {why}")]
    Read {
        /// The file.
        path: PathBuf,
        /// Why. Not a `source`: the text says it already.
        why: std::io::Error,
    },
    /// Not TOML, or a key that is missing, unknown or of the wrong type.
    #[error("{path}:{place}{why}")]
    Syntax {
        /// The file.
        path: PathBuf,
        /// Line, column and key, as far as they are known: `7:14: plate[0].z_m: `.
        place: String,
        /// What is wrong.
        why: String,
    },
    /// A value that makes no sense.
    #[error("{path}: {key}: {why}")]
    Value {
        /// The file.
        path: PathBuf,
        /// The key, as `strip[2].width_m`.
        key: String,
        /// What is wrong with it and what would be right.
        why: String,
    },
}

/// A key whose value makes no sense, and what is wrong with it.
pub(crate) type Unsound = (String, String);

/// Reads the text of a file.
///
/// # Errors
/// [`ConfigError::Read`].
pub(crate) fn read(path: &Path) -> Result<String, ConfigError> {
    std::fs::read_to_string(path).map_err(|why| ConfigError::Read {
        path: path.to_owned(),
        why,
    })
}

/// Parses a file's text and checks what it says; `path` only names it in messages.
///
/// # Errors
/// [`ConfigError::Syntax`], [`ConfigError::Value`].
pub(crate) fn parse<T: DeserializeOwned>(
    text: &str,
    path: &Path,
    check: impl FnOnce(&T) -> Result<(), Unsound>,
) -> Result<T, ConfigError> {
    let value: T = toml::from_str(text).map_err(|error| ConfigError::Syntax {
        path: path.to_owned(),
        place: error
            .span()
            .map_or(" ".to_owned(), |span| place(text, span.start)),
        why: error.message().to_owned(),
    })?;
    check(&value).map_err(|(key, why)| ConfigError::Value {
        path: path.to_owned(),
        key,
        why,
    })?;
    Ok(value)
}

/// `line:column: key: ` of a place in the text of a TOML file of tables; the
/// key, with its table, is that of the last line up to there that has one.
fn place(text: &str, offset: usize) -> String {
    let before = text.get(..offset).unwrap_or(text);
    let start = before.rfind('\n').map_or(0, |at| at + 1);
    let (line, column) = (
        before.matches('\n').count() + 1,
        before[start..].chars().count() + 1,
    );
    let whole_line = text[start..].lines().next().unwrap_or_default();
    let (mut table, mut key) = (String::new(), None);
    let mut tables: Vec<&str> = Vec::new();
    for line in text[..start].lines().chain([whole_line]) {
        let line = line.split('#').next().unwrap_or_default().trim();
        if let Some(name) = line.strip_prefix("[[").and_then(|l| l.strip_suffix("]]")) {
            let index = tables.iter().filter(|seen| **seen == name).count();
            tables.push(name);
            (table, key) = (format!("{name}[{index}]"), None);
        } else if let Some(name) = line.strip_prefix('[').and_then(|l| l.strip_suffix(']'))
            && name
                .chars()
                .all(|c| c.is_ascii_alphanumeric() || "_-.".contains(c))
        {
            (table, key) = (name.to_owned(), None);
        } else if let Some((name, _)) = line.split_once('=') {
            key = Some(name.trim());
        }
    }
    let dot = if table.is_empty() || key.is_none() {
        ""
    } else {
        "."
    };
    let key = format!("{table}{dot}{}", key.unwrap_or_default());
    let colon = if key.is_empty() { "" } else { ": " };
    format!("{line}:{column}: {key}{colon}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_has_line_column_and_key() {
        let text =
            "name = \"a\"\n[box]\ndx_m = 1\n[[strip]]\n[[strip]] # second\nx_m = [\n  0,\n  ?]\n";
        let at = |what: &str| place(text, text.find(what).unwrap());
        assert_eq!(at("\"a\""), "1:8: name: ");
        assert_eq!(at("1\n"), "3:8: box.dx_m: ");
        assert_eq!(at("[box]"), "2:1: box: ");
        assert_eq!(at("?"), "8:3: strip[1].x_m: ");
        assert_eq!(place("", 0), "1:1: ");
        assert_eq!(place("x", 9), "1:2: x: ".replace("x: ", ""));
    }
}
