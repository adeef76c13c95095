//! `report convert`: files of records in other encodings, several in one, one in several.

use super::{inputs, outputs};
use crate::report::origin;
use crate::stream::{
    Bytes, Encoding, Fault, Kind, Lane, Loss, Options, Outcome, Output, lane_of, lanes, write_lanes,
};
use crate::tool::arguments::CommonArgs;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
EXAMPLES
  A run's files in one MCAP for Foxglove, Lichtblick or ros2 bag, and back:
    report convert scans.csv lines.csv poses.csv imu.csv truth.csv -o all.mcap
    report convert all.mcap -o run/
  Poses for evo and other kits:
    report convert --format tum poses.csv -o poses.tum
    report convert --format tum --only truth all.mcap > truth.tum
  A command's trajectory from another kit as the desired one, scans out of an MCAP stream:
    report convert --format csv desired=poses.tum > desired.csv
    report convert --format csv --only scans run.mcap | extract-lines -f frame.toml > lines.csv

FILES
  What a CSV holds is told from its header; a trajectory, and what comes from TUM or EuRoC, is the
  truth unless its name says desired or poses. In front of a file the kind is given as NAME=FILE:
  scans, imu, lines, segments, poses, truth, desired, clock, delays, beams. Several inputs go into one
  MCAP, in order of time. With -o DIR/ every kind goes to a file of its own there: scans.csv, poses.csv.
  CSV and MCAP hold every column to the last digit. What the target has no place for is said on
  standard error; -q is quiet about it.

EXIT STATUS
  0 done; 2 usage; 3 records skipped or without a place; 65 bad data; 66 no such input; 74 I/O error";

/// Writes records in another encoding, several files into one, one into several
#[derive(Clone, Debug, clap::Args)]
#[command(
    long_about = "Writes files of records in another encoding: CSV, MCAP, TUM, EuRoC. Several CSV files \
                  become one MCAP in order of time, and one MCAP becomes a CSV file a kind again.",
    after_long_help = EXAMPLES
)]
pub struct ConvertArgs {
    /// Files; - is stdin (the default). NAME= in front says what records they hold
    #[arg(value_name = "[NAME=]FILE")]
    files: Vec<String>,
    /// Of an MCAP only these records: scans, imu, lines, segments, poses, truth, desired, clock, ..
    #[arg(long, value_name = "NAME", value_parser = parse_kind)]
    only: Option<Kind>,
    #[command(flatten)]
    common: CommonArgs,
}

fn parse_kind(text: &str) -> Result<Kind, String> {
    Kind::named(text).ok_or_else(|| {
        let names = Kind::ALL.map(Kind::name).join(", ");
        format!("one of {names} is wanted")
    })
}

/// A file on the command line.
struct File {
    path: PathBuf,
    /// A pipe, which can be read only once; none for a file.
    pipe: Option<Bytes>,
    encoding: Encoding,
    /// What it is to be read as; none is everything that an MCAP has.
    kind: Option<Kind>,
}

/// Runs the subcommand.
pub(super) fn run(args: &ConvertArgs) -> anyhow::Result<Outcome> {
    let options = args.common.options("report")?;
    let stdin = ["-".to_owned()];
    let given = if args.files.is_empty() {
        &stdin[..]
    } else {
        &args.files
    };
    inputs::refuse_twice(given.iter().map(|text| Path::new(text.as_str())))?;
    let files: Vec<File> = given
        .iter()
        .map(|text| file(text, args.only, &options))
        .collect::<anyhow::Result<_>>()?;
    let folder = folder(args.common.output.as_deref());
    let one = |lanes: &[Box<dyn Lane>]| lanes.len() == 1;
    let mut all: Vec<Box<dyn Lane>> = Vec::new();
    let mut losses: Vec<(String, Loss)> = Vec::new();
    for file in files {
        let (found, loss) = match file.pipe {
            Some(bytes) => {
                let kind = file.kind.unwrap_or(Kind::Truth);
                (vec![lane_of(bytes, kind, &options)?], None)
            }
            None => lanes(&file.path, file.encoding, file.kind, &options)?,
        };
        if found.is_empty() {
            let name = origin::input_name(&file.path);
            return Err(Fault::BadData(format!("{name}: no records of ours in it")).into());
        }
        losses.extend(loss.map(|loss| (origin::input_name(&file.path), loss)));
        all.extend(found);
    }
    let target = options.format.unwrap_or(match folder {
        Some(_) => Encoding::Csv,
        None if one(&all) => by_name(options.output.as_deref()).unwrap_or(Encoding::Csv),
        None => Encoding::Mcap,
    });
    let outcome = match folder {
        Some(folder) => apart(&mut all, folder, target, &options)?,
        None => together(&mut all, target, &options)?,
    };
    if !options.quiet {
        for lane in &all {
            let of_lane = lane.losses(target).into_iter();
            losses.extend(of_lane.map(|loss| (lane.kind().to_string(), loss)));
        }
        for (name, loss) in losses {
            eprintln!("report: {name}: {loss}");
        }
    }
    Ok(outcome)
}

/// A folder to write to: one that is there, or a name that ends like one.
fn folder(output: Option<&Path>) -> Option<&Path> {
    output.filter(|path| path.is_dir() || path.as_os_str().as_encoded_bytes().ends_with(b"/"))
}

/// The encoding that a file's name says.
fn by_name(output: Option<&Path>) -> Option<Encoding> {
    match output?.extension()?.to_str()? {
        "mcap" => Some(Encoding::Mcap),
        "tum" => Some(Encoding::Tum),
        "euroc" => Some(Encoding::Euroc),
        _ => None,
    }
}

/// What a file holds, by its name on the command line, its own name and its first bytes.
fn file(text: &str, only: Option<Kind>, options: &Options) -> anyhow::Result<File> {
    let (name, path) = match text.split_once('=') {
        Some((name, path)) if !name.is_empty() && !name.contains('/') => (Some(name), path),
        _ => (None, text),
    };
    let path = PathBuf::from(path);
    let wrong = |why: String| Fault::Usage(format!("{text}: {why}"));
    let named = name.map(parse_kind).transpose().map_err(wrong)?;
    let mut bytes = Bytes::open(Some(&path), options)?;
    let (sniffed, head) = bytes.peek()?;
    let encoding = options.input_format.unwrap_or(sniffed);
    let by_content = Kind::in_csv(head).filter(|_| encoding == Encoding::Csv);
    let stem = path.file_stem().and_then(|stem| stem.to_str());
    let is_trajectory = |kind: Option<Kind>| matches!(kind, None | Some(Kind::Truth));
    let by_file = stem
        .and_then(Kind::named)
        .filter(|kind| matches!(kind, Kind::Desired | Kind::Poses))
        .filter(|kind| *kind == Kind::Desired || encoding != Encoding::Csv)
        .filter(|_| is_trajectory(by_content));
    let kind = match encoding {
        Encoding::Mcap => named.or(only),
        Encoding::Csv => match named.or(by_file).or(by_content) {
            Some(kind) => Some(kind),
            None => {
                let name = origin::input_name(&path);
                let why =
                    format!("{name}: its columns are of no record; NAME= in front says which");
                return Err(Fault::BadData(why).into());
            }
        },
        Encoding::Tum | Encoding::Euroc => named.or(by_file),
    };
    let is_file = std::fs::metadata(&path).is_ok_and(|found| found.is_file());
    if !is_file && encoding == Encoding::Mcap && kind.is_none() {
        let why = "a pipe can be read only once: one kind of its records, with --only, or a file";
        return Err(wrong(why.into()).into());
    }
    Ok(File {
        path,
        pipe: (!is_file).then_some(bytes),
        encoding,
        kind,
    })
}

/// Every lane into a file of its own.
fn apart(
    all: &mut [Box<dyn Lane>],
    folder: &Path,
    target: Encoding,
    options: &Options,
) -> anyhow::Result<Outcome> {
    outputs::folder(folder)?;
    let ending = match target {
        Encoding::Csv => "csv",
        Encoding::Mcap => "mcap",
        Encoding::Tum => "tum",
        Encoding::Euroc => "euroc",
    };
    let mut outcome = Outcome::Done;
    for lane in all {
        let kind = lane.kind();
        let trajectory = matches!(kind, Kind::Poses | Kind::Truth | Kind::Desired);
        if !trajectory && matches!(target, Encoding::Tum | Encoding::Euroc) {
            continue;
        }
        let path = folder.join(format!("{kind}.{ending}"));
        let output = Output::create(&path, target, options)?;
        outcome = outcome.and(write_lanes(std::slice::from_mut(lane), output)?);
    }
    Ok(outcome)
}

/// All lanes into one output.
fn together(
    all: &mut [Box<dyn Lane>],
    target: Encoding,
    options: &Options,
) -> anyhow::Result<Outcome> {
    if target != Encoding::Mcap && all.len() > 1 {
        let kinds: Vec<String> = all.iter().map(|lane| lane.kind().to_string()).collect();
        let text = format!(
            "{} do not go into one file of this encoding: choose with --only, or give a folder, -o DIR/",
            kinds.join(", ")
        );
        return Err(Fault::Usage(text).into());
    }
    let mut options = options.clone();
    options.format = Some(target);
    let output = Output::open(&options)?;
    write_lanes(all, output)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_ends_like_one() {
        assert!(folder(Some(Path::new("no/such/"))).is_some());
        assert!(folder(Some(Path::new("src"))).is_some());
        assert!(folder(Some(Path::new("src/lib.rs"))).is_none());
        assert!(folder(None).is_none());
    }

    #[test]
    fn kinds_and_encodings_have_names() {
        assert_eq!(parse_kind("truth"), Ok(Kind::Truth));
        assert!(parse_kind("pose").unwrap_err().contains("poses, truth"));
        let by_name = |name: &str| by_name(Some(Path::new(name)));
        assert_eq!(by_name("a.mcap"), Some(Encoding::Mcap));
        assert_eq!(by_name("a.csv"), None);
    }
}
