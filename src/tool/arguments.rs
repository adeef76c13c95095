//! Arguments that all tools share, with one meaning everywhere.

use super::values::parse_instant;
use crate::frame::Frame;
use crate::stream::{Encoding, Fault, Instant, Options, Window};
use std::path::PathBuf;

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::Stamp;

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
