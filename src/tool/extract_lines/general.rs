//! All lines of any scene: the options, the methods by name, and the stage.

use super::strategy::{self, WindowArgs};
use super::{Method, first_given};
use crate::lines::extractor::{Extractor, ExtractorOptions};
use crate::lines::fit::{Axis, Estimator, Loss};
use crate::lines::hough::{HoughOptions, ModifiedHough, ModifiedHoughOptions, WindowSize};
use crate::lines::known_lines::SecondLook;
use crate::lines::methods;
use crate::lines::ml::{Ml, MlOptions};
use crate::lines::segmentation::{Cut, SegmentationOptions};
use crate::record::{BeamFate, NormalLine, Scan, Segment};
use crate::stream::{self, Emit, Fault, Input, Options, Outcome, Stage};
use crate::tool::values::{not_negative, positive};
use std::path::Path;

/// Settings of the extractors for any scene.
#[derive(Clone, Copy, Debug, clap::Args)]
#[command(next_help_heading = "Lines of any scene")]
pub(super) struct GeneralArgs {
    /// Standard deviation of a range; rather too large than too small [default: 6.5]
    #[arg(long, value_name = "MM", value_parser = positive)]
    sigma_mm: Option<f64>,
    /// Fewest beams on a line [default: 9]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..))]
    min_points: Option<u32>,
    /// Shortest line [default: 0.5]
    #[arg(long, value_name = "M", value_parser = positive)]
    min_length_m: Option<f64>,
    /// Widest gap within a line [default: 0.5]
    #[arg(long, value_name = "M", value_parser = positive)]
    max_gap_m: Option<f64>,
    /// Whether the scan is first cut into groups of connected beams [default: on]
    #[arg(
        long,
        value_enum,
        value_name = "WHETHER",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "on"
    )]
    cluster: Option<Switch>,
    /// What counts as a jump between two surfaces [default: adaptive]
    #[arg(long, value_enum, value_name = "RULE")]
    segment: Option<Segmentation>,
    /// What becomes of a wall through the first and last beam of an all-round scan [default: join]
    #[arg(long, value_enum, value_name = "WHAT")]
    seam: Option<Seam>,
    /// What a line is fitted by [default: ml]
    #[arg(long, value_enum, value_name = "ESTIMATOR")]
    fit: Option<Fit>,
    /// The coordinate in error for --fit ols [default: the one that varies less along the line]
    #[arg(long, value_enum, value_name = "AXIS")]
    axis: Option<AxisName>,
    /// What large residuals count for in the fit [default: none]
    #[arg(long, value_enum, value_name = "LOSS")]
    loss: Option<LossName>,
    /// How uneven a wall may be and still be one line, for --method ml [default: 11]
    #[arg(long, value_name = "MM", value_parser = not_negative)]
    flatness_mm: Option<f64>,
    /// Write what became of every beam, a row a beam, instead of the lines
    #[arg(long)]
    explain: bool,
    /// Seed of the methods that draw at random [default: 1]
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Switch {
    On,
    Off,
}

/// Rules for jumps.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Segmentation {
    /// Neighbouring points further apart than the widest gap
    Jump,
    /// Successive edge following: neighbouring ranges that differ by more than 0.3 m
    Sef,
    /// A point further off than a surface seen at 5 deg would put it (Borges and Aldon)
    Adaptive,
    /// A point further off than the line expected there would put it (Kurniawan 2017, eq. 4.19)
    Reflector,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Seam {
    /// It is one line
    Join,
    /// It is cut in two
    Cut,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Fit {
    /// Maximum likelihood in the ranges
    Ml,
    /// Total least squares
    Tls,
    /// Ordinary least squares
    Ols,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum AxisName {
    Y,
    Z,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum LossName {
    None,
    Huber,
    Tukey,
}

impl GeneralArgs {
    /// The first option that is given.
    pub(super) fn given(&self) -> Option<&'static str> {
        first_given(&[
            (self.sigma_mm.is_some(), "--sigma-mm"),
            (self.min_points.is_some(), "--min-points"),
            (self.min_length_m.is_some(), "--min-length-m"),
            (self.max_gap_m.is_some(), "--max-gap-m"),
            (self.cluster.is_some(), "--cluster"),
            (self.segment.is_some(), "--segment"),
            (self.seam.is_some(), "--seam"),
            (self.fit.is_some(), "--fit"),
            (self.axis.is_some(), "--axis"),
            (self.loss.is_some(), "--loss"),
            (self.flatness_mm.is_some(), "--flatness-mm"),
            (self.explain, "--explain"),
            (self.seed.is_some(), "--seed"),
        ])
    }

    fn options(&self) -> Result<ExtractorOptions, Fault> {
        let clustered = self.cluster != Some(Switch::Off);
        let cut = match self.segment {
            Some(_) if !clustered => {
                let text = "--segment says how --cluster cuts the scan; --cluster=off does not cut";
                return Err(Fault::Usage(text.to_owned()));
            }
            None if !clustered => Cut::Nowhere,
            None | Some(Segmentation::Adaptive) => Cut::Adaptive,
            Some(Segmentation::Jump) => Cut::Jump,
            Some(Segmentation::Sef) => Cut::Sef,
            Some(Segmentation::Reflector) => Cut::Reflector,
        };
        if self.axis.is_some() && self.fit != Some(Fit::Ols) {
            let text = "--axis belongs to --fit ols; the other fits need none";
            return Err(Fault::Usage(text.to_owned()));
        }
        let estimator = match self.fit {
            None | Some(Fit::Ml) => Estimator::MaximumLikelihood,
            Some(Fit::Tls) => Estimator::TotalLeastSquares,
            Some(Fit::Ols) => Estimator::OrdinaryLeastSquares(match self.axis {
                None => Axis::Auto,
                Some(AxisName::Y) => Axis::Y,
                Some(AxisName::Z) => Axis::Z,
            }),
        };
        let loss = match self.loss {
            None | Some(LossName::None) => Loss::Squares,
            Some(LossName::Huber) => Loss::HUBER,
            Some(LossName::Tukey) => Loss::TUKEY,
        };
        let default = ExtractorOptions::default();
        let cutting = default.segmentation;
        Ok(ExtractorOptions {
            segmentation: SegmentationOptions {
                cut,
                sigma_m: self.sigma_mm.map_or(cutting.sigma_m, |mm| mm / 1000.0),
                max_gap_m: self.max_gap_m.unwrap_or(cutting.max_gap_m),
                cut_at_seam: self.seam == Some(Seam::Cut),
                ..cutting
            },
            estimator,
            loss,
            min_points: self.min_points.map_or(default.min_points, |n| n as usize),
            min_length_m: self.min_length_m.unwrap_or(default.min_length_m),
            seed: self.seed.unwrap_or(default.seed),
            explain: self.explain,
            ..default
        })
    }

    /// The extractor of a method; none for the reflectors, which are no general scene.
    fn extractor(&self, method: Method, window: WindowSize) -> Result<Box<dyn Extractor>, Fault> {
        let common = self.options()?;
        let second = self.extractor_with(method, common, window)?;
        if common.segmentation.cut != Cut::Reflector {
            return Ok(second);
        }
        let mut first = common;
        first.segmentation.cut = Cut::Adaptive;
        let first = self.extractor_with(method, first, window)?;
        Ok(Box::new(SecondLook::new(first, second)))
    }

    fn extractor_with(
        &self,
        method: Method,
        common: ExtractorOptions,
        window: WindowSize,
    ) -> Result<Box<dyn Extractor>, Fault> {
        if self.flatness_mm.is_some() && method != Method::Ml {
            let text = "--flatness-mm belongs to --method ml";
            return Err(Fault::Usage(text.to_owned()));
        }
        match method {
            Method::Ml => {
                let default = MlOptions::default();
                Ok(Box::new(Ml::new(MlOptions {
                    common,
                    flatness_m: self
                        .flatness_mm
                        .map_or(default.flatness_m, |mm| mm / 1000.0),
                    ..default
                })))
            }
            Method::ModifiedHough => Ok(Box::new(ModifiedHough::new(ModifiedHoughOptions {
                whole: HoughOptions {
                    common,
                    ..HoughOptions::default()
                },
                window,
            }))),
            _ => methods::extractor(&method.name(), common).ok_or_else(|| {
                Fault::Usage(format!("--method {} cannot be used here", method.name()))
            }),
        }
    }
}

/// Reads scans and writes the segments of each.
pub(super) fn run(
    method: Method,
    settings: &GeneralArgs,
    windows: &WindowArgs,
    input: Option<&Path>,
    options: &Options,
) -> anyhow::Result<Outcome> {
    if windows.coarse {
        let text = "--coarse needs the frame: -f FILE";
        return Err(Fault::Usage(text.to_owned()).into());
    }
    let mut extractor = settings.extractor(method, windows.size())?;
    if let Some(path) = &windows.predict {
        extractor.expect(&predicted(path, options)?);
    }
    let mut stage = General {
        extractor,
        segments: Vec::new(),
        follows: method == Method::ModifiedHough,
        lines: Vec::new(),
    };
    if settings.explain {
        let mut stage = Explain {
            general: stage,
            row: BeamFate::default(),
        };
        return stream::filter(options, input, &mut stage);
    }
    stream::filter(options, input, &mut stage)
}

/// The lines of the first scan in a file of segments.
fn predicted(path: &Path, options: &Options) -> anyhow::Result<Vec<NormalLine>> {
    let mut segments = Input::<Segment>::open(Some(path), &strategy::side(options))?;
    let (mut lines, mut first) = (Vec::new(), None);
    while let Some(segment) = segments.next()? {
        if segment.stamp != *first.get_or_insert(segment.stamp) {
            break;
        }
        lines.push(segment.normal);
    }
    Ok(lines)
}

/// Scans in, the segments of each out.
struct General {
    extractor: Box<dyn Extractor>,
    segments: Vec<Segment>,
    /// Whether a scan's lines are the prediction for the next.
    follows: bool,
    lines: Vec<NormalLine>,
}

impl General {
    fn extract(&mut self, scan: &Scan) {
        self.extractor.extract(scan, &mut self.segments);
        if self.follows {
            self.lines.clear();
            self.lines.extend(self.segments.iter().map(|s| s.normal));
            self.extractor.expect(&self.lines);
        }
    }
}

impl Stage for General {
    type In = Scan;
    type Out = Segment;

    fn push(&mut self, scan: &Scan, emit: &mut Emit<'_, Segment>) -> anyhow::Result<()> {
        self.extract(scan);
        for segment in &self.segments {
            emit.write(segment)?;
        }
        Ok(())
    }

    fn finish(&mut self, _emit: &mut Emit<'_, Segment>) -> anyhow::Result<Outcome> {
        Ok(Outcome::Done)
    }
}

/// Scans in, what became of each beam out.
struct Explain {
    general: General,
    row: BeamFate,
}

impl Stage for Explain {
    type In = Scan;
    type Out = BeamFate;

    fn push(&mut self, scan: &Scan, emit: &mut Emit<'_, BeamFate>) -> anyhow::Result<()> {
        self.general.extract(scan);
        (self.row.stamp, self.row.seq) = (scan.stamp, scan.seq);
        let fates = self.general.extractor.fates().iter();
        for (beam, (fate, range_m)) in fates.zip(scan.ranges_m.iter()).enumerate() {
            self.row.beam = beam as u32;
            self.row.angle_rad = scan.angle_rad(beam);
            self.row.range_m = *range_m;
            self.row.fate.clear();
            self.row.fate.push_str(fate.name());
            self.row.line = fate.line();
            emit.write(&self.row)?;
        }
        Ok(())
    }

    fn finish(&mut self, _emit: &mut Emit<'_, BeamFate>) -> anyhow::Result<Outcome> {
        Ok(Outcome::Done)
    }
}
