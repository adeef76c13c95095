//! Arguments that all tools share, with one meaning everywhere.

use crate::frame::Frame;
use crate::link::Rotation;
use crate::record::Stamp;
use crate::stream::{Encoding, Fault, Instant, Options, Window};
use std::path::PathBuf;
use std::time::Duration;

/// What a tool writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Records.
    Records(Encoding),
    /// A scanner's own telegrams; only `simulate` writes them.
    Cola,
}

/// Where a tool's records go, and how its streams are read and written.
#[derive(Clone, Debug, Default, clap::Args)]
#[command(next_help_heading = "Streams")]
pub struct CommonArgs {
    /// Write to FILE (as FILE.partial, renamed at the end) instead of stdout
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Encoding of the output: csv, mcap; for poses and trajectories also tum, euroc [default: the
    /// input's, csv for a source]
    #[arg(long, value_name = "FORMAT", value_parser = parse_format)]
    pub format: Option<Format>,
    /// Encoding of the input: csv, mcap, tum, euroc [default: told from its first bytes]
    #[arg(long, value_name = "FORMAT", value_parser = parse_encoding)]
    pub input_format: Option<Encoding>,
    /// Count and skip bad records instead of ending with status 65
    #[arg(long)]
    pub skip_bad: bool,
    /// Leave out records before TIME: nanoseconds since the epoch, or +10s after the first record
    #[arg(long, value_name = "TIME", value_parser = parse_instant)]
    pub from: Option<Instant>,
    /// Leave out records after TIME
    #[arg(long, value_name = "TIME", value_parser = parse_instant)]
    pub to: Option<Instant>,
    /// Say in # lines above a CSV header where the records come from: tool, version, arguments, seed
    /// (also with CABLEPOSE_META=1 in the environment, or where the input says so)
    #[arg(long)]
    pub meta: bool,
    /// No progress bar and no remarks
    #[arg(short, long)]
    pub quiet: bool,
    /// Say at the end how many records came and went
    #[arg(short, long, action = clap::ArgAction::Count)]
    pub verbose: u8,
}

impl CommonArgs {
    /// The stream options of the tool of this name.
    ///
    /// # Errors
    /// [`Fault::Usage`] where `--from` is after `--to`, as far as that can be known here.
    pub fn options(&self, tool: &'static str) -> anyhow::Result<Options> {
        let turned = match (self.from, self.to) {
            (Some(Instant::At(from)), Some(Instant::At(to))) => from > to,
            (Some(Instant::After(from)), Some(Instant::After(to))) => from > to,
            _ => false,
        };
        if turned {
            return Err(Fault::Usage("--from is after --to: nothing lies between".into()).into());
        }
        let format = match self.format {
            Some(Format::Records(encoding)) => Some(encoding),
            Some(Format::Cola) if tool != "simulate" => {
                return Err(
                    Fault::Usage("--format: csv, mcap, tum or euroc is wanted".into()).into(),
                );
            }
            Some(Format::Cola) | None => None,
        };
        Ok(Options {
            tool,
            output: self.output.clone(),
            format,
            input_format: self.input_format,
            skip_bad: self.skip_bad,
            window: Window {
                from: self.from,
                to: self.to,
            },
            meta: self.meta
                || std::env::var_os("CABLEPOSE_META")
                    .is_some_and(|set| !set.is_empty() && set != "0"),
            quiet: self.quiet,
            verbose: self.verbose,
            seed: None,
            configuration: None,
            notes: Default::default(),
        })
    }
}

/// The frame file.
#[derive(Clone, Debug, clap::Args)]
pub struct FrameArg {
    /// Frame file: the box, its reflectors and the mountings
    #[arg(short, long, value_name = "FILE")]
    pub frame: PathBuf,
}

impl FrameArg {
    /// The checked frame and the file's text; a fault ends the tool with status 78, a file
    /// that cannot be opened with 66.
    pub fn read(&self) -> anyhow::Result<(Frame, String)> {
        Ok(Frame::read_with_text(&self.frame)?)
    }
}

fn parse_encoding(text: &str) -> Result<Encoding, String> {
    match text {
        "csv" => Ok(Encoding::Csv),
        "mcap" => Ok(Encoding::Mcap),
        "tum" => Ok(Encoding::Tum),
        "euroc" => Ok(Encoding::Euroc),
        _ => Err("csv, mcap, tum or euroc is wanted".to_owned()),
    }
}

fn parse_format(text: &str) -> Result<Format, String> {
    match text {
        "cola" => Ok(Format::Cola),
        _ => parse_encoding(text).map(Format::Records),
    }
}

pub(super) fn parse_instant(text: &str) -> Result<Instant, String> {
    if let Some(after) = text.strip_prefix('+') {
        return parse_duration(after).map(|span| Instant::After(span.as_secs_f64()));
    }
    text.parse()
        .map(|ns| Instant::At(Stamp::from_ns(ns)))
        .map_err(|_| {
            "nanoseconds since the epoch are wanted, or a time after the first record such as +10s"
                .to_owned()
        })
}

/// Reads a span of time with its unit: `62ms`, `30s`, `1.5us`, `100ns`, `2min`, `1h`; for clap's
/// `value_parser`.
pub fn parse_duration(text: &str) -> Result<Duration, String> {
    const UNITS: [(&str, f64); 6] = [
        ("ns", 1e-9),
        ("us", 1e-6),
        ("ms", 1e-3),
        ("min", 60.0),
        ("h", 3600.0),
        ("s", 1.0),
    ];
    let wanted = || "a time with its unit is wanted: ns, us, ms, s, min or h".to_owned();
    let (number, unit_s) = UNITS
        .iter()
        .find_map(|(unit, unit_s)| Some((text.strip_suffix(unit)?, unit_s)))
        .ok_or_else(wanted)?;
    let number: f64 = number.trim_end().parse().map_err(|_| wanted())?;
    Duration::try_from_secs_f64(number * unit_s).map_err(|_| wanted())
}

/// Reads a span of time with a sign, s: `8ms`, `-3ms`, `+3ms`; for clap's `value_parser`.
pub fn parse_signed_duration(text: &str) -> Result<f64, String> {
    let (sign, size) = match text.strip_prefix('-') {
        Some(size) => (-1.0, size),
        None => (1.0, text.strip_prefix('+').unwrap_or(text)),
    };
    if size.starts_with(['-', '+']) {
        return Err("a time with one sign is wanted".to_owned());
    }
    parse_duration(size).map(|size| sign * size.as_secs_f64())
}

/// Reads when a recording goes on in a new file: a size (`100MB`, `4GiB`), an age (`10min`), or both
/// with a bar between them, whichever is first; for clap's `value_parser`.
pub fn parse_rotation(text: &str) -> Result<Rotation, String> {
    const UNITS: [(&str, u64); 7] = [
        ("KiB", 1 << 10),
        ("MiB", 1 << 20),
        ("GiB", 1 << 30),
        ("kB", 1000),
        ("MB", 1_000_000),
        ("GB", 1_000_000_000),
        ("B", 1),
    ];
    let wanted = || "a size (100MB), an age (10min) or both (100MB|10min) is wanted".to_owned();
    let mut rotation = Rotation::default();
    for part in text.split('|') {
        let size = UNITS
            .iter()
            .find_map(|(unit, bytes)| Some((part.strip_suffix(unit)?, bytes)));
        if let Some((number, unit)) = size {
            let number: u64 = number.trim_end().parse().map_err(|_| wanted())?;
            let bytes = number.checked_mul(*unit).filter(|bytes| *bytes > 0);
            if rotation.bytes.replace(bytes.ok_or_else(wanted)?).is_some() {
                return Err(wanted());
            }
        } else {
            let age = parse_duration(part).map_err(|_| wanted())?;
            if age.is_zero() || rotation.age.replace(age).is_some() {
                return Err(wanted());
            }
        }
    }
    Ok(rotation)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotations_are_sizes_or_ages() {
        let both = Rotation {
            bytes: Some(100_000_000),
            age: Some(Duration::from_secs(600)),
        };
        assert_eq!(parse_rotation("100MB|10min"), Ok(both));
        assert_eq!(parse_rotation("10min|100 MB"), Ok(both));
        assert_eq!(parse_rotation("4KiB").unwrap().bytes, Some(4096));
        for text in [
            "",
            "|",
            "5",
            "0MB",
            "0s",
            "1MB|2MB",
            "1s|2s",
            "MB",
            "-1MB",
            "99999999999GB",
        ] {
            assert!(parse_rotation(text).is_err(), "{text}");
        }
    }

    #[test]
    fn durations_have_a_unit() {
        assert_eq!(parse_duration("62ms"), Ok(Duration::from_millis(62)));
        assert_eq!(parse_duration("30s"), Ok(Duration::from_secs(30)));
        assert_eq!(parse_duration("1.5us"), Ok(Duration::from_nanos(1500)));
        assert_eq!(parse_duration("100ns"), Ok(Duration::from_nanos(100)));
        assert_eq!(parse_duration("2 min"), Ok(Duration::from_secs(120)));
        assert_eq!(parse_duration("1h"), Ok(Duration::from_secs(3600)));
        for text in ["", "5", "s", "-1s", "xs", "infs", "1e30s", "nans"] {
            assert!(parse_duration(text).is_err(), "{text}");
        }
    }

    #[test]
    fn instants_are_absolute_or_relative() {
        assert_eq!(parse_instant("12"), Ok(Instant::At(Stamp::from_ns(12))));
        assert_eq!(parse_instant("+10s"), Ok(Instant::After(10.0)));
        assert!(parse_instant("10s").is_err());
        assert!(parse_instant("+10").is_err());
    }

    #[test]
    fn from_comes_before_to() {
        let options = |from, to| {
            let args = CommonArgs {
                from,
                to,
                ..CommonArgs::default()
            };
            args.options("test")
        };
        let at = |ns| Some(Instant::At(Stamp::from_ns(ns)));
        let after = |s| Some(Instant::After(s));
        for (from, to) in [
            (at(5), at(5)),
            (after(1.0), after(2.0)),
            (after(9.0), at(1)),
        ] {
            assert!(options(from, to).is_ok());
        }
        for (from, to) in [(at(6), at(5)), (after(2.5), after(2.0))] {
            let error = options(from, to).unwrap_err();
            assert_eq!(crate::stream::exit::status(&error), 2);
        }
    }

    #[test]
    fn encodings_have_names() {
        assert_eq!(parse_encoding("mcap"), Ok(Encoding::Mcap));
        assert_eq!(parse_encoding("tum"), Ok(Encoding::Tum));
        assert!(parse_encoding("kitti").is_err());
        assert_eq!(parse_format("cola"), Ok(Format::Cola));
        assert_eq!(parse_format("csv"), Ok(Format::Records(Encoding::Csv)));
        let args = CommonArgs {
            format: Some(Format::Cola),
            ..CommonArgs::default()
        };
        assert!(args.options("simulate").is_ok());
        assert!(args.options("extract-lines").is_err());
    }
}
