//! The pages of section 5 say what the code does: cablepose-formats(5) has every column of every
//! record in its order, cablepose-frame(5) every key of a frame file; their examples are accepted.

use cablepose::frame::Frame;
use cablepose::record::{
    BeamFate, ClockExchange, DelayPoint, ImuSample, Pose, Presence, Record, ReflectorLines, Scan,
    Segment, Status, TrajectoryPoint, Value, Visit,
};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

fn page(name: &str) -> String {
    let dir: PathBuf = Path::new(env!("CARGO_MANIFEST_DIR")).join("man");
    fs::read_to_string(dir.join(name)).unwrap()
}

/// A page's entries: the words in bold that stand at the left of a description, by the section that
/// they are in. A section's title ends at " \-".
fn entries(page: &str) -> BTreeMap<String, Vec<String>> {
    let mut sections: BTreeMap<String, Vec<String>> = BTreeMap::new();
    let mut section = String::new();
    let mut names_next = false;
    for line in page.lines() {
        if let Some(title) = line
            .strip_prefix(".SS ")
            .or_else(|| line.strip_prefix(".SH "))
        {
            section = title.split(" \\-").next().unwrap_or(title).to_owned();
        }
        if names_next && let Some(name) = line.strip_prefix(".B ") {
            let name = name.replace('\\', "");
            sections.entry(section.clone()).or_default().push(name);
        }
        names_next = matches!(line, ".TP" | ".TQ");
    }
    sections
}

struct Names(Vec<String>);

impl Visit for Names {
    type Error = ();
    fn column<T: Value>(&mut self, name: &'static str, _: Presence, _: &T) -> Result<(), ()> {
        self.0.push(name.to_owned());
        Ok(())
    }
}

fn columns<R: Record>() -> (String, Vec<String>) {
    let mut names = Names(Vec::new());
    R::default().visit(&mut names).unwrap();
    (R::KIND.to_owned(), names.0)
}

#[test]
fn every_column_of_every_record_is_described() {
    let described = entries(&page("cablepose-formats.5"));
    let records = [
        columns::<Scan>(),
        columns::<ImuSample>(),
        columns::<ReflectorLines>(),
        columns::<Pose>(),
        columns::<TrajectoryPoint>(),
        columns::<Segment>(),
        columns::<BeamFate>(),
        columns::<DelayPoint>(),
        columns::<ClockExchange>(),
    ];
    for (kind, names) in records {
        assert_eq!(described.get(&kind), Some(&names), "{kind}");
    }
}

#[test]
fn every_status_is_described() {
    let described = entries(&page("cablepose-formats.5"));
    let known: Vec<String> = (0..32)
        .filter_map(Status::from_bit)
        .map(|status| status.to_string())
        .collect();
    assert_eq!(described.get("STATUS"), Some(&known));
}

/// Every key that a frame file can have, in the order of the page.
const WHOLE: &str = r#"
name = "whole"
[box]
dx_m = 1.5
dy_m = 10.0
dz_m = 5.0
background_gap_m = 0.7
[[plate]]
face = "right"
x_m = [-0.25, 0.25]
z_m = [0.2, 4.0]
[[strip]]
face = "upper"
offset_m = 0.0
width_m = 0.8
inclination_deg = 30.0
x_m = [-0.5, 0.5]
[scanner]
model = "lms511-hr"
position_m = [0.0, 0.0, 0.0]
rotation_deg = [0.0, 0.0, 0.0]
index_to_first_beam_s = 0.0
[imu]
rotation_deg = [0.0, 0.0, 0.0]
[calibration]
range_bias_m = 0.0
range_scale = 1.0
hit_threshold = 0.5
footprint_scale = 1.0
"#;

#[test]
fn every_key_of_a_frame_file_is_described() {
    // What the parser's own types write is every key that there is.
    let frame = Frame::parse(WHOLE, Path::new("frame.toml")).unwrap();
    let written: toml::Table = toml::from_str(&toml::to_string(&frame).unwrap()).unwrap();
    let described = entries(&page("cablepose-frame.5"));
    let sorted = |names: &[String]| {
        let mut names = names.to_vec();
        names.sort();
        names
    };
    for (key, value) in &written {
        let (title, table) = match value {
            toml::Value::Array(tables) => (format!("[[{key}]]"), tables[0].as_table()),
            toml::Value::Table(table) => (format!("[{key}]"), Some(table)),
            _ => {
                assert!(described["KEYS"].contains(key), "{key}");
                continue;
            }
        };
        let keys: Vec<String> = table.unwrap().keys().cloned().collect();
        let found = described.get(&title).map(|names| sorted(names));
        assert_eq!(found, Some(sorted(&keys)), "{title}");
    }
    assert_eq!(described.len(), written.len(), "a section without a table");
}

#[test]
fn the_example_of_a_frame_file_is_one() {
    let page = page("cablepose-frame.5");
    let (_, example) = page.split_once(".nf\n").unwrap();
    let (example, _) = example.split_once(".fi\n").unwrap();
    let frame = Frame::parse(&example.replace("\\-", "-"), Path::new("example")).unwrap();
    assert_eq!((frame.plates.len(), frame.strips.len()), (2, 1));
}
