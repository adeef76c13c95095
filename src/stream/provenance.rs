//! Where a stream comes from: each stage's command line, version, seed and configuration.

use super::Options;
use std::collections::BTreeMap;
use std::path::Path;

/// Name of the MCAP metadata records that hold one stage each.
pub(super) const RECORD_NAME: &str = "provenance";

/// One stage that a stream has gone through.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Provenance {
    /// The program.
    pub tool: String,
    /// Its version.
    pub version: String,
    /// Its command line.
    pub command: String,
    /// Its seed, where chance was involved.
    pub seed: Option<u64>,
    /// The text of its configuration file.
    pub configuration: Option<String>,
    /// What else is known, such as the device's identity and state.
    pub notes: BTreeMap<String, String>,
}

/// Keys of notes in a metadata record begin with this.
const NOTE: &str = "note.";

/// What a `#` line of CSV that holds a stage begins with; the entries follow as one JSON object.
const LINE: &str = "# cablepose ";

impl Provenance {
    /// This process.
    pub(super) fn of_this(options: &Options) -> Provenance {
        Provenance {
            tool: options.tool.to_owned(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            command: command_line(std::env::args_os().map(|a| a.to_string_lossy().into_owned())),
            seed: options.seed,
            configuration: options.configuration.clone(),
            notes: options.notes.clone(),
        }
    }

    /// As the entries of a metadata record; `stage` counts from 0 along the pipeline.
    pub(super) fn to_entries(&self, stage: usize) -> BTreeMap<String, String> {
        let mut entries = BTreeMap::from([
            ("stage".to_owned(), stage.to_string()),
            ("tool".to_owned(), self.tool.clone()),
            ("version".to_owned(), self.version.clone()),
            ("command".to_owned(), self.command.clone()),
        ]);
        if let Some(seed) = self.seed {
            entries.insert("seed".to_owned(), seed.to_string());
        }
        if let Some(configuration) = &self.configuration {
            entries.insert("configuration".to_owned(), configuration.clone());
        }
        for (key, text) in &self.notes {
            entries.insert(format!("{NOTE}{key}"), text.clone());
        }
        entries
    }

    /// As a line above the header of CSV, without its line feed.
    pub(super) fn to_line(&self, stage: usize) -> String {
        // A map of texts is always JSON.
        let entries = serde_json::to_string(&self.to_entries(stage)).unwrap_or_default();
        format!("{LINE}{entries}")
    }

    /// From such a line; none for any other remark.
    pub(super) fn from_line(line: &[u8]) -> Option<Provenance> {
        let entries = line.strip_prefix(LINE.as_bytes())?;
        let entries: BTreeMap<String, String> = serde_json::from_slice(entries).ok()?;
        Some(Provenance::from_entries(&entries))
    }

    /// From the entries of a metadata record; what is missing stays empty.
    pub(super) fn from_entries(entries: &BTreeMap<String, String>) -> Provenance {
        let text = |key: &str| entries.get(key).cloned().unwrap_or_default();
        Provenance {
            tool: text("tool"),
            version: text("version"),
            command: text("command"),
            seed: entries.get("seed").and_then(|seed| seed.parse().ok()),
            configuration: entries.get("configuration").cloned(),
            notes: entries
                .iter()
                .filter_map(|(key, text)| Some((key.strip_prefix(NOTE)?.to_owned(), text.clone())))
                .collect(),
        }
    }
}

/// The arguments as they were given, the program without its directory, quoted for a shell.
fn command_line(args: impl Iterator<Item = String>) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_=+,./:@%".contains(c);
    args.enumerate()
        .map(|(i, arg)| {
            let name = Path::new(&arg).file_name().filter(|_| i == 0);
            let arg = name.map_or(arg.clone(), |name| name.to_string_lossy().into_owned());
            if !arg.is_empty() && arg.chars().all(plain) {
                arg
            } else {
                format!("'{}'", arg.replace('\'', r"'\''"))
            }
        })
        .collect::<Vec<_>>()
        .join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_come_back() {
        let stage = Provenance {
            tool: "simulate".into(),
            version: "1.2".into(),
            command: "simulate --seed 7".into(),
            seed: Some(7),
            configuration: Some("[box]\n".into()),
            notes: BTreeMap::from([("serial number".into(), "7".into())]),
        };
        let entries = stage.to_entries(3);
        assert_eq!(entries["stage"], "3");
        assert_eq!(Provenance::from_entries(&entries), stage.clone());
        let line = stage.to_line(3);
        assert!(
            !line.contains('\n') && line.starts_with("# cablepose {"),
            "{line}"
        );
        assert_eq!(Provenance::from_line(line.as_bytes()), Some(stage));
        for other in [
            "# a remark",
            "# cablepose ",
            "# cablepose {\"a\":1}",
            "#cablepose {}",
        ] {
            assert_eq!(Provenance::from_line(other.as_bytes()), None, "{other}");
        }
        let bare = Provenance::default();
        assert_eq!(Provenance::from_entries(&bare.to_entries(0)), bare);
    }

    #[test]
    fn a_command_line_can_be_pasted_into_a_shell() {
        let args = ["/usr/bin/report", "-", "my run.csv", "it's", ""];
        let line = command_line(args.iter().map(ToString::to_string));
        assert_eq!(line, r"report - 'my run.csv' 'it'\''s' ''");
    }
}
