//! Changing single values in a frame file's text.
//!
//! A frame file is written by people, with comments that say where its numbers come from. So a tool
//! that measures one of them changes that one in the text and leaves the rest as it is, byte for
//! byte.

use std::ops::Range;

/// Why a value cannot be put in its place.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EditError {
    /// The text writes the table in a way that cannot be edited line by line.
    #[error("{0} is not written as a [table] with `key = value` lines: put it so, then try again")]
    Form(String),
}

/// The text with `[table]`'s `key` set to `value` (as TOML); `table` may be one of an array of tables,
/// as `strip[2]` for the third `[[strip]]`. Key and plain table are made where they are missing.
/// `remark` becomes the line's comment if it has none.
///
/// # Errors
/// [`EditError::Form`] where the table is an inline table or the key a dotted one, or the array has
/// no such table.
pub fn set(
    text: &str,
    table: &str,
    key: &str,
    value: &str,
    remark: Option<&str>,
) -> Result<String, EditError> {
    let mut out = text.to_owned();
    match find(text, table, key) {
        Place::Value(range) => {
            let line_end = text[range.end..]
                .find('\n')
                .map_or(text.len(), |i| range.end + i);
            let bare = text[range.end..line_end].trim().is_empty();
            if let Some(remark) = remark.filter(|_| bare) {
                out.replace_range(range.end..line_end, &format!(" # {remark}"));
            }
            out.replace_range(range, value);
        }
        Place::Table(at) => out.insert_str(at, &format!("{}\n", line(key, value, remark))),
        Place::Nowhere if table.ends_with(']') => {
            return Err(EditError::Form(format!("{table}.{key}")));
        }
        Place::Nowhere => {
            if !(out.is_empty() || out.ends_with('\n')) {
                out.push('\n');
            }
            out.push_str(&format!("\n[{table}]\n{}\n", line(key, value, remark)));
        }
    }
    // The parser has the last word on whether that is what the text now says.
    let wanted = format!("v = {value}").parse::<toml::Table>().ok();
    let wanted = wanted.as_ref().and_then(|t| t.get("v"));
    let now = out.parse::<toml::Table>().ok();
    let now = now.as_ref().and_then(|t| match element(table) {
        Some((name, index)) => t.get(name)?.get(index)?.get(key),
        None => t.get(table)?.get(key),
    });
    if wanted.is_some() && now == wanted {
        Ok(out)
    } else {
        Err(EditError::Form(format!("{table}.{key}")))
    }
}

/// Name and index of `strip[2]`.
fn element(table: &str) -> Option<(&str, usize)> {
    let (name, index) = table.strip_suffix(']')?.split_once('[')?;
    Some((name, index.parse().ok()?))
}

fn line(key: &str, value: &str, remark: Option<&str>) -> String {
    let remark = remark.map_or(String::new(), |r| format!(" # {r}"));
    format!("{key} = {value}{remark}")
}

enum Place {
    /// Where the value stands.
    Value(Range<usize>),
    /// Behind the table's header line.
    Table(usize),
    Nowhere,
}

fn find(text: &str, table: &str, key: &str) -> Place {
    let (header, mut before) = match element(table) {
        Some((name, index)) => (format!("[[{name}]]"), index),
        None => (format!("[{table}]"), 0),
    };
    let mut inside = false;
    let mut place = Place::Nowhere;
    let mut at = 0;
    for line in text.split_inclusive('\n') {
        let content = line.split('#').next().unwrap_or("").trim();
        let start = at;
        at += line.len();
        if content.starts_with('[') {
            inside = content == header && before == 0;
            if content == header && before > 0 {
                before -= 1;
            } else if inside {
                // Only the first of that name, or the one asked for.
                before = usize::MAX;
                place = Place::Table(at);
            }
        } else if inside
            && let Some((name, _)) = content.split_once('=')
            && name.trim() == key
            && let Some(equals) = line.find('=')
        {
            return Place::Value(value_range(text, start + equals + 1));
        }
    }
    place
}

/// From the value's first byte to behind its last: an array up to its closing bracket, whatever
/// lines it takes, anything else up to a comment or the line's end.
fn value_range(text: &str, from: usize) -> Range<usize> {
    let rest = &text[from..];
    let start = from + (rest.len() - rest.trim_start().len());
    let value = &text[start..];
    let mut depth = 0;
    let mut comment = false;
    for (i, c) in value.char_indices() {
        match c {
            '\n' if depth == 0 => return start..start + value[..i].trim_end().len(),
            '\n' => comment = false,
            _ if comment => {}
            '#' if depth == 0 => return start..start + value[..i].trim_end().len(),
            '#' => comment = true,
            '[' => depth += 1,
            ']' => {
                depth -= 1;
                if depth == 0 {
                    return start..start + i + 1;
                }
            }
            _ => {}
        }
    }
    start..start + value.trim_end().len()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::Frame;
    use std::path::Path;

    const CABLAR: &str = include_str!("../../testdata/cablar.toml");

    fn imu(text: &str) -> Result<String, EditError> {
        set(
            text,
            "imu",
            "rotation_deg",
            "[0.7, -1.1, 0.0]",
            Some("measured"),
        )
    }

    #[test]
    fn one_value_changes_and_nothing_else() {
        let edited = imu(CABLAR).unwrap();
        let frame = Frame::parse(&edited, Path::new("frame.toml")).unwrap();
        assert_eq!(frame.imu.rotation_deg, [0.7, -1.1, 0.0]);
        let changed: Vec<_> = CABLAR
            .lines()
            .zip(edited.lines())
            .filter(|(a, b)| a != b)
            .collect();
        assert_eq!(changed.len(), 1, "{changed:?}");
        assert_eq!(CABLAR.lines().count(), edited.lines().count());
        let before = Frame::parse(CABLAR, Path::new("frame.toml")).unwrap();
        assert_eq!(
            Frame {
                imu: before.imu,
                ..frame
            },
            before
        );
    }

    #[test]
    fn one_of_several_tables_changes() {
        let edited = set(CABLAR, "strip[2]", "width_m", "0.8012", Some("measured")).unwrap();
        let edited = set(&edited, "strip[0]", "x_m", "[-0.7, 0.7]", None).unwrap();
        let before = Frame::parse(CABLAR, Path::new("frame.toml")).unwrap();
        let mut after = before.clone();
        after.strips[2].width_m = 0.8012;
        after.strips[0].x_m = Some([-0.7, 0.7]);
        assert_eq!(
            Frame::parse(&edited, Path::new("frame.toml")).unwrap(),
            after
        );
        assert!(edited.contains("width_m = 0.8012 # measured\n"));
        assert!(set(CABLAR, "strip[4]", "width_m", "0.8", None).is_err());
        assert!(
            set(
                "strip = [{ width_m = 1.0 }]\n",
                "strip[0]",
                "width_m",
                "0.8",
                None
            )
            .is_err()
        );
    }

    #[test]
    fn comments_stay() {
        let text = "[imu] # on the lid\nrotation_deg = [ # roll\n 0, 0, # pitch ]\n 0 ] # by eye\n[scanner]\n";
        let edited = imu(text).unwrap();
        assert_eq!(
            edited,
            "[imu] # on the lid\nrotation_deg = [0.7, -1.1, 0.0] # by eye\n[scanner]\n"
        );
        let bare = imu("[imu]\nrotation_deg=[0,0,0]").unwrap();
        assert_eq!(bare, "[imu]\nrotation_deg=[0.7, -1.1, 0.0] # measured");
    }

    #[test]
    fn what_is_missing_is_made() {
        assert_eq!(
            imu("a = 1").unwrap(),
            "a = 1\n\n[imu]\nrotation_deg = [0.7, -1.1, 0.0] # measured\n"
        );
        assert_eq!(
            imu("[imu]\n[scanner]\n").unwrap(),
            "[imu]\nrotation_deg = [0.7, -1.1, 0.0] # measured\n[scanner]\n"
        );
    }

    #[test]
    fn other_forms_are_refused() {
        for text in [
            "imu = { rotation_deg = [0, 0, 0] }\n",
            "imu.rotation_deg = [0, 0, 0]\n",
            "not toml [",
        ] {
            assert!(imu(text).is_err(), "{text}");
        }
    }
}
