//! Streams from one encoding into another, several into one, one into several.
//!
//! A [`Lane`] is one kind of record of one file. Lanes of all kinds and files are written in order
//! of time into one MCAP, or one lane into a text. What the target has no place for is counted and
//! said ([`Loss`]), and nothing else is lost: text and MCAP carry every column to the last digit.

use super::check::StreamRecord;
use super::input::{Bytes, Input};
use super::kinds::{Kind, KindVisitor};
use super::output::Output;
use super::provenance::Provenance;
use super::topics::topics;
use super::{Encoding, Options, Outcome, exit};
use crate::record::{POSE_COLUMNS, Presence, Stamp, VELOCITY_COLUMNS, Value, Visit};
use std::collections::BTreeSet;
use std::convert::Infallible;
use std::path::Path;

/// Something that the target has no place for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Loss {
    /// Columns of a header that no record of this kind has.
    Columns(Vec<String>),
    /// Columns that had values.
    Values(Vec<&'static str>),
    /// Topics of MCAP that hold no records of ours, or nothing but what viewers need.
    Topics(Vec<String>),
    /// Rotations are quaternions on one side and angles on the other.
    Digits,
}

impl std::fmt::Display for Loss {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Loss::Columns(names) => write!(f, "columns of no such record left out: {}", few(names)),
            Loss::Values(names) => write!(
                f,
                "stamp, position and rotation have a place here, the rest is left out: {}",
                few(names)
            ),
            Loss::Topics(names) => write!(f, "topics left out: {}", few(names)),
            Loss::Digits => f.write_str(
                "rotations are quaternions there and angles here: last digits may differ",
            ),
        }
    }
}

/// The first few of many names.
fn few<T: AsRef<str>>(names: &[T]) -> String {
    const SHOWN: usize = 8;
    let shown: Vec<&str> = names.iter().take(SHOWN).map(AsRef::as_ref).collect();
    let shown = shown.join(", ");
    match names.len().saturating_sub(SHOWN) {
        0 => shown,
        more => format!("{shown} and {more} more"),
    }
}

/// One kind of record of one file, read record by record.
pub trait Lane {
    /// Its kind.
    fn kind(&self) -> Kind;
    /// The file's encoding.
    fn encoding(&self) -> Encoding;
    /// The stamp of the record that comes next; none at the end.
    fn stamp(&self) -> Option<Stamp>;
    /// Writes the record that comes next and reads on.
    ///
    /// # Errors
    /// What reading or writing says.
    fn write_next(&mut self, output: &mut Output) -> anyhow::Result<()>;
    /// Says where the records come from, but for the stages that have been `named` already.
    ///
    /// # Errors
    /// What writing says.
    fn introduce(&self, output: &Output, named: &mut Vec<Provenance>) -> anyhow::Result<()>;
    /// Ends an output that holds this lane alone.
    ///
    /// # Errors
    /// What writing says.
    fn finish(&self, output: Output) -> anyhow::Result<()>;
    /// What was lost of the records written so far.
    fn losses(&self, to: Encoding) -> Vec<Loss>;
}

struct LaneOf<R: StreamRecord> {
    kind: Kind,
    input: Input<R>,
    /// Whether there is a record that comes next.
    more: bool,
    /// Columns that had values.
    filled: BTreeSet<&'static str>,
}

impl<R: StreamRecord> LaneOf<R> {
    fn new(mut input: Input<R>, kind: Kind) -> anyhow::Result<LaneOf<R>> {
        let more = input.advance(None)?;
        Ok(LaneOf {
            kind,
            input,
            more,
            filled: BTreeSet::new(),
        })
    }
}

impl<R: StreamRecord> Lane for LaneOf<R> {
    fn kind(&self) -> Kind {
        self.kind
    }

    fn encoding(&self) -> Encoding {
        self.input.encoding()
    }

    fn stamp(&self) -> Option<Stamp> {
        self.more.then(|| self.input.current().stamp())
    }

    fn write_next(&mut self, output: &mut Output) -> anyhow::Result<()> {
        let record = self.input.current();
        output.put(record, self.kind.role())?;
        if output.encoding().layout().is_some() {
            let Ok(()) = record.visit(&mut Filled(&mut self.filled));
        }
        self.more = self.input.advance(None)?;
        Ok(())
    }

    fn introduce(&self, output: &Output, named: &mut Vec<Provenance>) -> anyhow::Result<()> {
        if output.encoding() != Encoding::Mcap {
            return output.follow(&self.input);
        }
        // The lanes of one file have the same stages.
        for stage in self.input.provenance() {
            if !named.contains(stage) {
                named.push(stage.clone());
                output.with_mcap(|mcap| mcap.write_stage(stage))?;
            }
        }
        Ok(())
    }

    fn finish(&self, output: Output) -> anyhow::Result<()> {
        output.finish_kind::<R>()
    }

    fn losses(&self, to: Encoding) -> Vec<Loss> {
        let mut losses = Vec::new();
        let unknown = self.input.unknown_columns();
        if !unknown.is_empty() {
            losses.push(Loss::Columns(unknown.to_vec()));
        }
        // What a TUM or EuRoC file has a place for.
        let held = |name: &&str| {
            let velocity = to == Encoding::Euroc && VELOCITY_COLUMNS.contains(name);
            *name == "stamp_ns" || POSE_COLUMNS.contains(name) || velocity
        };
        let filled = self.filled.iter().copied();
        let filled: Vec<&str> = filled.filter(|name| !held(name)).collect();
        if !filled.is_empty() {
            losses.push(Loss::Values(filled));
        }
        let text = |encoding: Encoding| encoding.layout().is_some();
        if text(to) != text(self.encoding()) {
            losses.push(Loss::Digits);
        }
        losses
    }
}

/// Notes which columns of a record have values.
struct Filled<'a>(&'a mut BTreeSet<&'static str>);

impl Visit for Filled<'_> {
    type Error = Infallible;

    fn column<T: Value>(
        &mut self,
        name: &'static str,
        _: Presence,
        value: &T,
    ) -> Result<(), Infallible> {
        if !value.is_missing() {
            self.0.insert(name);
        }
        Ok(())
    }
}

/// Opens a lane for a kind.
struct Open<'a> {
    path: &'a Path,
    options: &'a Options,
}

impl KindVisitor for Open<'_> {
    type Out = anyhow::Result<Box<dyn Lane>>;
    fn visit<R: StreamRecord>(self, kind: Kind) -> Self::Out {
        let input = Input::open_kind(self.path, kind, self.options)?;
        Ok(Box::new(LaneOf::<R>::new(input, kind)?))
    }
}

/// Makes a lane of bytes for a kind.
struct Take<'a> {
    bytes: Bytes,
    options: &'a Options,
}

impl KindVisitor for Take<'_> {
    type Out = anyhow::Result<Box<dyn Lane>>;
    fn visit<R: StreamRecord>(self, kind: Kind) -> Self::Out {
        let name = self.bytes.name().to_owned();
        let input = Input::from_reader(self.bytes, &name, kind.role(), self.options)?;
        Ok(Box::new(LaneOf::<R>::new(input, kind)?))
    }
}

/// The one lane of an input that can be read once, a pipe.
///
/// # Errors
/// What reading says.
pub fn lane_of(bytes: Bytes, kind: Kind, options: &Options) -> anyhow::Result<Box<dyn Lane>> {
    kind.call(Take { bytes, options })
}

/// The lanes of one file.
pub type Lanes = Vec<Box<dyn Lane>>;

/// The lanes of a file: all kinds of an MCAP, or one of a text; that of TUM, EuRoC and bare
/// trajectories may be any of poses, truth and desired. `kind` chooses; none takes what is there.
/// And what of the file is in no lane.
///
/// # Errors
/// A file that cannot be opened or holds no records of ours, or none of the kind.
pub fn lanes(
    path: &Path,
    encoding: Encoding,
    kind: Option<Kind>,
    options: &Options,
) -> anyhow::Result<(Lanes, Option<Loss>)> {
    let open = |kind: Kind| kind.call(Open { path, options });
    if encoding != Encoding::Mcap {
        return Ok((vec![open(kind.unwrap_or(Kind::Truth))?], None));
    }
    let there = topics(path, options)?;
    let kinds = match kind {
        Some(kind) => vec![kind],
        None => Kind::in_topics(there.keys().map(String::as_str)),
    };
    let own: Vec<&str> = Kind::ALL
        .iter()
        .flat_map(|kind| kind.topics().written)
        .collect();
    let left = there.keys().filter(|name| !own.contains(&name.as_str()));
    let left: Vec<String> = left.cloned().collect();
    let loss = (!left.is_empty() && kind.is_none()).then_some(Loss::Topics(left));
    let lanes: anyhow::Result<Vec<_>> = kinds.into_iter().map(open).collect();
    Ok((lanes?, loss))
}

/// Writes lanes into one output, in order of time; those of the same instant in the order given.
///
/// # Errors
/// What reading or writing says.
pub fn write_lanes(lanes: &mut [Box<dyn Lane>], mut output: Output) -> anyhow::Result<Outcome> {
    let mut named = Vec::new();
    for lane in lanes.iter() {
        lane.introduce(&output, &mut named)?;
    }
    let next = |lanes: &[Box<dyn Lane>]| {
        let stamps = lanes.iter().enumerate();
        let stamps = stamps.filter_map(|(i, lane)| Some((lane.stamp()?, i)));
        stamps.min().map(|(_, i)| i)
    };
    while let Some(lane) = next(lanes).and_then(|i| lanes.get_mut(i)) {
        lane.write_next(&mut output)?;
    }
    match lanes {
        [lane] => lane.finish(output)?,
        _ => output.finish()?,
    }
    Ok(exit::with_losses(Outcome::Done))
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use crate::stream::samples;
    use crate::stream::scratch::Scratch;

    /// What is said to be lost of a pose with everything, written as `to`.
    fn lost_of_a_pose(to: Encoding) -> Vec<&'static str> {
        let options = Options::default();
        let dir = Scratch::new(&format!("convert-{to:?}"));
        let path = dir.file("poses.csv");
        let mut poses = Output::create(&path, Encoding::Csv, &options).unwrap();
        poses.write(&samples::pose()).unwrap();
        poses.finish().unwrap();
        let (mut lanes, _) = lanes(&path, Encoding::Csv, Some(Kind::Poses), &options).unwrap();
        let mut output = Output::create(Path::new("/dev/null"), to, &options).unwrap();
        lanes[0].write_next(&mut output).unwrap();
        let losses = lanes[0].losses(to).into_iter();
        losses
            .filter_map(|loss| match loss {
                Loss::Values(names) => Some(names),
                _ => None,
            })
            .flatten()
            .collect()
    }

    #[test]
    fn every_value_without_a_place_is_said_to_be_lost() {
        for to in [Encoding::Tum, Encoding::Euroc] {
            let lost = lost_of_a_pose(to);
            for name in ["votes", "status", "cov_x_x", "range_bias_m"] {
                assert!(lost.contains(&name), "{to:?}: {name} is not in {lost:?}");
            }
            for name in ["stamp_ns", "x_m", "yaw_rad"] {
                assert!(!lost.contains(&name), "{to:?}: {name} is in {lost:?}");
            }
        }
        assert!(lost_of_a_pose(Encoding::Csv).is_empty());
    }
}
