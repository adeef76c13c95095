//! `simulate --scene office`: scans of an office floor and its true lines.

use super::args::START_NS;
use super::{Args, side_output};
use crate::record::Stamp;
use crate::simulate::Seed;
use crate::simulate::office::{Errors, Office, Setup, View};
use crate::stream::{Encoding, Fault, Outcome, Output, Stop};
use crate::tool::arguments::Format;
use clap::parser::ValueSource;

/// A scene that is no frame.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Scene without a frame")]
pub struct SceneArgs {
    /// Scans of this scene instead: office, 80 m by 50 m, for extract-lines; --truth gets its true lines
    #[arg(long, value_name = "NAME", value_parser = ["office"], conflicts_with_all = ["frame", "replay", "serving"])]
    pub scene: Option<String>,
    /// The scanner: all-round (722 beams, 15 mm of noise), half (722 over 180 deg), lms500 (761 over
    /// 190 deg, 6.5 mm)
    #[arg(long, value_name = "WHICH", default_value = "all-round", value_parser = parse_view)]
    pub view: View,
}

fn parse_view(text: &str) -> Result<View, String> {
    match text {
        "all-round" => Ok(View::AllRound),
        "half" => Ok(View::Half),
        "lms500" => Ok(View::Lms500),
        _ => Err("all-round, half or lms500 is wanted".to_owned()),
    }
}

/// Scans unless told otherwise: as many as in the published comparison.
const SCANS: u64 = 100;

/// The options that the scene takes.
const OPTIONS: [&str; 20] = [
    "scene",
    "view",
    "seed",
    "truth",
    "n_scans",
    "start_ns",
    "scans_per_pose",
    "sigma_mm",
    "outlier_share",
    "dropout_share",
    "output",
    "format",
    "input_format",
    "skip_bad",
    "from",
    "to",
    "meta",
    "quiet",
    "verbose",
    "serving",
];

/// Refuses an option of a frame, which would have no effect.
pub(super) fn refuse_foreign(written: &clap::ArgMatches) -> Result<(), Fault> {
    let foreign = written.ids().map(clap::Id::as_str).find(|option| {
        let is_written = written.value_source(option) == Some(ValueSource::CommandLine);
        // Groups have capital letters and no option of their own.
        is_written && !OPTIONS.contains(option) && !option.starts_with(char::is_uppercase)
    });
    foreign.map_or(Ok(()), |option| {
        let option = option.replace('_', "-");
        let text = format!("--{option} is for a frame, and --scene office has none");
        Err(Fault::Usage(text))
    })
}

/// Writes the scans, and the true lines where asked.
pub(super) fn run(args: &Args) -> anyhow::Result<Outcome> {
    if args.common.format == Some(Format::Cola) {
        return Err(Fault::Usage("--format: csv or mcap is wanted with --scene".into()).into());
    }
    let mut options = args.common.options("simulate")?;
    options.seed = Some(args.seed);
    let stop = Stop::install()?;
    let mut truth = side_output(args.truth.as_deref(), &options)?;
    let mut main = Output::open(&options)?;
    let mut office = Office::new(setup(args)?);
    while !stop.requested() {
        let Some((scan, lines)) = office.advance() else {
            break;
        };
        if let Some(truth) = &mut truth {
            lines.iter().try_for_each(|line| truth.write(line))?;
            if truth.encoding() == Encoding::Csv {
                truth.flush()?;
            }
        }
        main.write(scan)?;
    }
    let records = main.records();
    truth.map_or(Ok(()), Output::finish)?;
    main.finish()?;
    stop.check(records)?;
    Ok(Outcome::Done)
}

fn setup(args: &Args) -> anyhow::Result<Setup> {
    let view = args.scene.view;
    let mut errors = Errors::of(view);
    let sizes = args.sizes();
    if let Some(sigma_mm) = sizes.sigma_mm {
        errors.sigma_m = sigma_mm / 1000.0;
    }
    errors.outlier_share = sizes.outlier_share.unwrap_or(errors.outlier_share);
    errors.dropout_share = sizes.dropout_share.unwrap_or(errors.dropout_share);
    let shares = [errors.outlier_share, errors.dropout_share];
    if !(errors.sigma_m >= 0.0 && errors.sigma_m.is_finite())
        || shares.iter().any(|share| !(0.0..=1.0).contains(share))
    {
        let text = "--sigma-mm must not be negative, and shares lie between 0 and 1";
        return Err(Fault::Usage(text.into()).into());
    }
    Ok(Setup {
        view,
        errors,
        seed: Seed(args.seed),
        start: Stamp::from_ns(args.start_ns().unwrap_or(START_NS)),
        scans: args.n_scans().unwrap_or(SCANS),
        scans_per_place: args.course.scans_per_pose,
    })
}
