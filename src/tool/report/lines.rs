//! `report lines`: segments against the true ones.

use super::inputs;
use super::outputs;
use crate::report::lines::{Matching, Score, json, score, table};
use crate::report::{Gate, GateError, origin};
use crate::stream::{Fault, Outcome, WholeFile};
use crate::tool::arguments::CommonArgs;
use crate::tool::values::positive;
use std::path::PathBuf;

const EXAMPLES: &str = "\
EXAMPLES
  Split-and-merge in a simulated office:
    simulate --scene office --n-scans 10 --truth true.csv \\
      | extract-lines --sigma-mm 15 | tee segments.csv | report lines --truth true.csv
  Two runs side by side, as JSON:
    report lines --truth true.csv first=segments.csv again=<(cat segments.csv) --json
  In a script, with a gate:
    report lines --truth true.csv segments.csv --fail-if 'truepos_pct<90'

STATISTICS
  A found line is a true one of the same scan (the same stamp) where their difference passes a
  chi-square gate and they overlap; pairs are one to one, the nearest first. Shorter true lines than
  --min-points and --min-length-m are neither missed nor false. TruePos is matches / true lines,
  FalsePos (lines - matches) / lines (Nguyen et al. 2005). Names for --fail-if are paths in --json:
  truepos_pct, falsepos_pct, d.std_mm, alpha.std_deg, centre.std_mm, nees.mean, length.median_ratio.

EXIT STATUS
  0 done; 2 usage; 3 no true line or no line at all in some run; 4 a --fail-if condition holds, or
  its statistic has no value; 65 bad data; 66 no such input; 74 I/O error";

/// Scores extracted lines against the true ones
#[derive(Clone, Debug, clap::Args)]
#[command(
    long_about = "Scores the lines that extract-lines found (segment records) against the true ones, as \
                  simulate --scene office writes them: how many were found, how many are none, how \
                  exact they are and whether their covariances are honest.",
    after_long_help = EXAMPLES,
    mut_arg("format", |arg| arg.hide(true))
)]
pub struct LineArgs {
    /// Segments: a file, a FIFO or - for stdin (the default), with a name for the run in front if wanted
    #[arg(value_name = "[NAME=]SEGMENTS")]
    segments: Vec<String>,
    /// True segments
    #[arg(long, value_name = "FILE")]
    truth: PathBuf,
    /// Gate: noise of a point
    #[arg(long, value_name = "CM", default_value_t = 2.0, value_parser = positive)]
    point_sigma_cm: f64,
    /// Gate: probability that a true line passes
    #[arg(long, value_name = "PERCENT", default_value_t = 99.0, value_parser = percent)]
    gate_pct: f64,
    /// Gate: floor of the offset at a line's centre
    #[arg(long, value_name = "CM", default_value_t = 1.0, value_parser = positive)]
    floor_cm: f64,
    /// Gate: floor of a line's direction
    #[arg(long, value_name = "DEG", default_value_t = 0.5, value_parser = positive)]
    floor_deg: f64,
    /// Least overlap, of the shorter line
    #[arg(long, value_name = "PERCENT", default_value_t = 50.0, value_parser = percent)]
    overlap_pct: f64,
    /// Fewest beams of a line that counts
    #[arg(long, value_name = "N", default_value_t = 9)]
    min_points: u32,
    /// Shortest line that counts
    #[arg(long, value_name = "M", default_value_t = 0.5, value_parser = positive)]
    min_length_m: f64,
    /// End with status 4 if the condition holds, as 'truepos_pct<93' or 'ml:nees.mean>2.1'; several
    /// allowed
    #[arg(long = "fail-if", value_name = "[RUN:]CONDITION", value_parser = parse_gate)]
    fail_if: Vec<Gate>,
    /// Print JSON in place of the table
    #[arg(long)]
    json: bool,
    /// ASCII only [default: where the locale is not UTF-8]
    #[arg(long)]
    ascii: bool,
    #[command(flatten)]
    common: CommonArgs,
}

fn parse_gate(text: &str) -> Result<Gate, GateError> {
    Gate::for_lines(text)
}

fn percent(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value > 0.0 && value < 100.0 => Ok(value),
        _ => Err("a number between 0 and 100 is wanted".to_owned()),
    }
}

impl LineArgs {
    fn matching(&self) -> Matching {
        Matching {
            point_sigma_m: self.point_sigma_cm / 100.0,
            probability: self.gate_pct / 100.0,
            floor_m: self.floor_cm / 100.0,
            floor_rad: self.floor_deg.to_radians(),
            overlap: self.overlap_pct / 100.0,
            min_points: self.min_points,
            min_length_m: self.min_length_m,
        }
    }
}

/// Runs the subcommand.
pub(super) fn run(args: &LineArgs) -> anyhow::Result<Outcome> {
    let options = args.common.options("report")?;
    let output = WholeFile::open(args.common.output.as_deref())?;
    let sources = origin::sources(&args.segments);
    let (truth, runs) = inputs::read_segments(&args.truth, &sources, &options)?;
    let matching = args.matching();
    let scores: Vec<Score> = sources
        .iter()
        .zip(&runs)
        .map(|(source, segments)| {
            let file = origin::input_name(&source.path);
            score(&source.name, &file, &truth, segments, &matching)
        })
        .collect();
    let name = origin::input_name(&args.truth);
    let text = if args.json {
        json(&name, &scores, &matching)?
    } else {
        table(&name, &scores, &matching, args.ascii || !outputs::is_utf8())
    };
    output.finish(&text)?;
    outcome(args, &scores)
}

/// Says on stderr what a reader must not miss, and which status that is.
fn outcome(args: &LineArgs, scores: &[Score]) -> anyhow::Result<Outcome> {
    let mut outcome = Outcome::Done;
    for score in scores {
        let missing = match (score.true_lines, score.lines) {
            (0, _) => "there are no true lines",
            (_, 0) => "it has no lines",
            _ => continue,
        };
        outcome = Outcome::Degraded;
        eprintln!("report: {}: {missing}", score.name);
    }
    for gate in &args.fail_if {
        let verdicts: Vec<_> = scores.iter().filter_map(|s| gate.judge_lines(s)).collect();
        if verdicts.is_empty() {
            let text = format!("--fail-if '{}' names no run", gate.text);
            return Err(Fault::Usage(text).into());
        }
        outcome = outcome.and(outputs::judged(verdicts));
    }
    Ok(outcome)
}
