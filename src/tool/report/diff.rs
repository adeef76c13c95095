//! `report diff`: where two files of records differ.

use crate::report::diff::{Comparison, DiffError, Pattern, Rules, Tolerance, table, tree};
use crate::stream::{
    Bytes, Encoding, Fault, Input, Kind, KindVisitor, Options, Outcome, StreamRecord, WholeFile,
    topics,
};
use crate::tool::arguments::CommonArgs;
use std::io::Read;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
EXAMPLES
  Byte for byte:
    report diff poses.csv <(cat poses.csv)
  Numbers may differ in their last digits, as they do from machine to machine:
    solve-pose -f frame.toml --imu imu.csv lines.csv \\
      | report diff --tol '*_m=1e-9' --tol '*_rad=1e-9' --tol 'cov_*=0.1%' poses.csv -
  Rows met by their stamp, some columns left out:
    report diff --key stamp_ns --ignore 'cov_*' --ignore status --tol '*=0' poses.csv poses.csv

COMPARISON
  Both are CSV with a header row, JSON, or streams of records in MCAP, TUM or EuRoC (and then the
  records are compared whatever the encodings: CSV against MCAP too). Columns are met by name, rows by
  place or by --key; in MCAP topic by topic, without provenance. A field is equal to one of the same
  text; with --tol also to one whose numbers, item by item of a list, are as near as that. An empty
  field, nan and inf are equal to themselves alone. --tol '*=0' is for values that may be spelt
  differently. Without --tol, --ignore and --key the bytes between the fields count too.

  Files that hold different kinds of records cannot be compared. A column that is named here and in
  neither file is an error.

EXIT STATUS
  0 equal; 2 usage, a column that neither file has included; 4 they differ; 65 they cannot be
  compared, or bad data; 66 no such input; 74 I/O error";

/// Compares two files of records
#[derive(Clone, Debug, clap::Args)]
#[command(
    long_about = "Compares two files of records, or of report's JSON, within tolerances: says which \
                  columns differ, where first and how far at most. Says nothing and ends with status 0 \
                  where they are equal, for golden files.",
    after_long_help = EXAMPLES,
    mut_arg("format", |arg| arg.hide(true)),
    mut_arg("skip_bad", |arg| arg.hide(true)),
    mut_arg("meta", |arg| arg.hide(true))
)]
pub struct DiffArgs {
    /// One file; - is stdin
    #[arg(value_name = "A")]
    a: PathBuf,
    /// The other
    #[arg(value_name = "B")]
    b: PathBuf,
    /// Numbers of these columns may be as far apart: in the column's unit, or in % of the larger one.
    /// NAME may have * for any characters; the last one that fits a column holds
    #[arg(long = "tol", value_name = "NAME=VALUE")]
    tolerances: Vec<Tolerance>,
    /// Pass these columns over
    #[arg(long, value_name = "NAME")]
    ignore: Vec<String>,
    /// CSV: rows with the same value of this column belong together
    #[arg(long, value_name = "COLUMN")]
    key: Option<String>,
    #[command(flatten)]
    common: CommonArgs,
}

/// What a file is compared as.
enum Contents {
    /// Columns of text, and the kind of record that has such columns, if any.
    Table(Option<Kind>),
    /// JSON.
    Tree,
    /// Records of ours.
    Records,
}

/// Runs the subcommand.
pub(super) fn run(args: &DiffArgs) -> anyhow::Result<Outcome> {
    let options = args.common.options("report")?;
    if args.a == Path::new("-") && args.b == Path::new("-") {
        return Err(Fault::Usage("only one of the two can be stdin".into()).into());
    }
    let rules = Rules {
        tolerances: args.tolerances.clone(),
        ignored: args.ignore.iter().map(|name| Pattern::new(name)).collect(),
    };
    let mut comparison = compare(args, &rules, &options)?;
    let text = comparison.text();
    if comparison.is_equal() {
        if options.verbose > 0 {
            eprint!("{text}");
        }
        return Ok(Outcome::Done);
    }
    if !options.quiet {
        WholeFile::open(args.common.output.as_deref())?.finish(&text)?;
    }
    Ok(Outcome::GateFailed)
}

fn compare(args: &DiffArgs, rules: &Rules, options: &Options) -> anyhow::Result<Comparison> {
    let mut files = [
        Bytes::open(Some(&args.a), options)?,
        Bytes::open(Some(&args.b), options)?,
    ];
    let names = [label(&args.a), label(&args.b)];
    let names = [names[0].as_str(), names[1].as_str()];
    let [a, b] = &mut files;
    let contents = [contents(a, options)?, contents(b, options)?];
    let refused = |why: String| -> anyhow::Result<Comparison> {
        let [a, b] = names;
        Err(Fault::BadData(format!("{a} and {b} cannot be compared: {why}")).into())
    };
    let found = match contents {
        [Contents::Table(Some(one)), Contents::Table(Some(other))] if !one.is_like(other) => {
            return refused(format!("these are {one} and those {other}"));
        }
        [Contents::Table(_), Contents::Table(_)] => {
            table::compare(a, b, names, args.key.as_deref(), rules)
        }
        [Contents::Tree, Contents::Tree] => {
            let (mut left, mut right) = (Vec::new(), Vec::new());
            a.read_to_end(&mut left)?;
            b.read_to_end(&mut right)?;
            tree::compare(&left, &right, names, rules)
        }
        [Contents::Tree, _] | [_, Contents::Tree] => return refused("one is JSON".to_owned()),
        _ => return records([&args.a, &args.b], names, rules, options),
    };
    found.map_err(fault)
}

fn fault(error: DiffError) -> anyhow::Error {
    match error {
        DiffError::Bad(text) => Fault::BadData(text).into(),
        DiffError::Unknown(text) => Fault::Usage(text).into(),
        DiffError::Io(error) => error.into(),
    }
}

fn label(path: &Path) -> String {
    if path == Path::new("-") {
        "stdin".to_owned()
    } else {
        path.display().to_string()
    }
}

fn contents(bytes: &mut Bytes, options: &Options) -> anyhow::Result<Contents> {
    let (sniffed, head) = bytes.peek()?;
    let first = head.iter().find(|b| !b.is_ascii_whitespace());
    Ok(match options.input_format.unwrap_or(sniffed) {
        Encoding::Csv if matches!(first, Some(b'{' | b'[')) => Contents::Tree,
        Encoding::Csv => Contents::Table(Kind::in_csv(head)),
        Encoding::Mcap | Encoding::Tum | Encoding::Euroc => Contents::Records,
    })
}

/// Compares files kind by kind of record. Each is read once a kind, so that pipes will not do.
fn records(
    paths: [&PathBuf; 2],
    names: [&str; 2],
    rules: &Rules,
    options: &Options,
) -> anyhow::Result<Comparison> {
    for path in paths {
        if !std::fs::metadata(path).is_ok_and(|found| found.is_file()) {
            let text = format!(
                "{}: MCAP, TUM and EuRoC are read more than once: a file is wanted, not a pipe",
                label(path)
            );
            return Err(Fault::Usage(text).into());
        }
    }
    let mut comparison = Comparison::new(names, rules);
    let there = [kinds(paths[0], options)?, kinds(paths[1], options)?];
    let [left, right] = &there;
    let both: Vec<Kind> = left
        .kinds
        .iter()
        .copied()
        .filter(|k| right.kinds.contains(k))
        .collect();
    // A text may be read as poses and as a trajectory: once is enough.
    let both = match (left.certain, right.certain) {
        (true, true) => both,
        _ => both.into_iter().take(1).collect(),
    };
    if both.is_empty() {
        let why = format!(
            "{} and {} cannot be compared: no records of one kind",
            names[0], names[1]
        );
        return Err(Fault::BadData(why).into());
    }
    for kind in both {
        kind.call(Compare {
            paths,
            options,
            comparison: &mut comparison,
            with_name: there.iter().all(|file| file.is_mcap),
        })?;
    }
    if left.is_mcap && right.is_mcap {
        // What one of them has alone differs as a whole; rules for its columns are none for nothing.
        for kind in left.kinds.iter().chain(&right.kinds) {
            kind.call(Known(&mut comparison));
        }
        other_topics(&mut comparison, paths, &there, options)?;
    }
    comparison.check_rules().map_err(fault)?;
    Ok(comparison)
}

/// The kinds of records of a file.
struct There {
    kinds: Vec<Kind>,
    /// Whether it has all of them, not one of them.
    certain: bool,
    is_mcap: bool,
}

fn kinds(path: &Path, options: &Options) -> anyhow::Result<There> {
    let mut bytes = Bytes::open(Some(path), options)?;
    let (sniffed, head) = bytes.peek()?;
    Ok(match options.input_format.unwrap_or(sniffed) {
        Encoding::Mcap => {
            let there = topics(path, options)?;
            There {
                kinds: Kind::in_topics(there.keys().map(String::as_str)),
                certain: true,
                is_mcap: true,
            }
        }
        Encoding::Csv => There {
            kinds: Kind::in_csv(head).into_iter().collect(),
            certain: true,
            is_mcap: false,
        },
        Encoding::Tum | Encoding::Euroc => There {
            kinds: vec![Kind::Truth, Kind::Desired, Kind::Poses],
            certain: false,
            is_mcap: false,
        },
    })
}

/// Topics that hold no records of ours, or those of a kind that only one file has.
fn other_topics(
    comparison: &mut Comparison,
    paths: [&PathBuf; 2],
    there: &[There; 2],
    options: &Options,
) -> anyhow::Result<()> {
    let [a, b] = [topics(paths[0], options)?, topics(paths[1], options)?];
    let compared = |topic: &str| {
        let both = there[0].kinds.iter().filter(|k| there[1].kinds.contains(k));
        both.into_iter().any(|kind| kind.is_read_from(topic))
    };
    for (topic, contents) in &a {
        if comparison.passes_over(topic) {
            continue;
        }
        match b.get(topic) {
            None => comparison.only_in(0, &format!("topic {topic}")),
            Some(other) if other.type_name != contents.type_name => comparison.remark(format!(
                "topic {topic}: {} and {}",
                contents.type_name, other.type_name
            )),
            Some(_) if compared(topic) => {}
            Some(other) => {
                let (n, m) = (contents.messages.len(), other.messages.len());
                let pairs = contents.messages.iter().zip(&other.messages);
                let different = pairs.filter(|(a, b)| a != b).count();
                if n != m {
                    comparison.remark(format!("topic {topic}: {n} and {m} messages"));
                } else if different > 0 {
                    comparison.remark(format!("topic {topic}: {different} messages of {n} differ"));
                }
            }
        }
    }
    for topic in b.keys().filter(|topic| !a.contains_key(*topic)) {
        if !comparison.passes_over(topic) {
            comparison.only_in(1, &format!("topic {topic}"));
        }
    }
    Ok(())
}

/// Compares the records of one kind.
/// Makes the columns of a kind of record known.
struct Known<'a>(&'a mut Comparison);

impl KindVisitor for Known<'_> {
    type Out = ();

    fn visit<R: StreamRecord>(self, kind: Kind) {
        self.0.columns_of::<R>(kind.name());
    }
}

struct Compare<'a> {
    paths: [&'a PathBuf; 2],
    options: &'a Options,
    comparison: &'a mut Comparison,
    /// Whether columns are named by their stream as well.
    with_name: bool,
}

impl KindVisitor for Compare<'_> {
    type Out = anyhow::Result<()>;

    fn visit<R: StreamRecord>(self, kind: Kind) -> anyhow::Result<()> {
        let open = |path: &Path| Input::<R>::open_kind(path, kind, self.options);
        let (mut a, mut b) = (open(self.paths[0])?, open(self.paths[1])?);
        let prefix = if self.with_name { kind.name() } else { "" };
        let columns = self.comparison.columns_of::<R>(prefix);
        let mut count = 0u64;
        loop {
            match (a.next()?, b.next()?) {
                (Some(a), Some(b)) => {
                    count += 1;
                    let place = || format!("record {count} ({} ns)", a.stamp());
                    self.comparison.records(&columns, &place, a, b);
                }
                (None, None) => return Ok(()),
                (more, _) => {
                    let file = usize::from(more.is_none());
                    let longer = if file == 0 { &mut a } else { &mut b };
                    while longer.next()?.is_some() {}
                    let surplus = longer.records() - count;
                    let what = format!("{surplus} of {} {kind} records", longer.records());
                    self.comparison.only_in(file, &what);
                    return Ok(());
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_label_is_a_file_or_stdin() {
        assert_eq!(label(Path::new("-")), "stdin");
        assert_eq!(label(Path::new("a/b.csv")), "a/b.csv");
    }
}
