//! What `report` computes of poses: the options, and the inputs beside poses and reference.

use super::inputs::Beside;
use crate::frame::{Frame, Imu, ImuAxes};
use crate::record::{Axes, ImuSample};
use crate::report::{
    Align, Alignment, Attitudes, Case, DelayChoice, Delta, DeltaError, Inertial, LineTally, Pairs,
    Recording, Settings, Zone, origin,
};
use crate::stream::{Fault, Input, Options};
use crate::tool::values::parse_signed_duration;
use std::path::{Path, PathBuf};

/// How poses are evaluated.
#[derive(Clone, Debug, clap::Args)]
pub struct EvaluationArgs {
    /// Bring the poses into the reference's frame first: none, se2 (yaw and x, y, z), se3, full (se3 that
    /// the orientations have a say in), first:N (by the first N poses) or file:PATH (the JSON of an
    /// earlier report, or six numbers as TOML)
    #[arg(long, value_name = "HOW", default_value = "none", value_parser = parse_align)]
    align: AlignChoice,
    /// The poses' delay: show (it is estimated and stated, the errors are as measured), none, estimate
    /// (the errors are without it) or a time to take out, such as 37ms
    #[arg(long, value_name = "WHAT", default_value = "show", value_parser = parse_delay, allow_hyphen_values = true)]
    delay: DelayChoice,
    /// Relative errors too, between poses so far apart: 1s, 500ms, 1m, 500mm, 10f (poses); several
    /// allowed
    #[arg(long = "rpe", value_name = "DELTA", value_parser = parse_delta)]
    rpe: Vec<Delta>,
    /// Pairs of the relative errors: consecutive, or all
    #[arg(long, value_name = "WHICH", default_value = "consecutive", value_parser = parse_pairs)]
    rpe_pairs: Pairs,
    /// Score only where the reference pose is, as 'z<=3.5', '|y|<4,z>=0.5', 'z:0.5:3.5' (m, deg), with a
    /// name in front if wanted (low=z<=3.5); several are scored side by side
    #[arg(long = "zone", value_name = "[NAME=]CONDITION")]
    zones: Vec<Zone>,
    /// Size of the workspace's cells, m [default: from the data]
    #[arg(long, value_name = "SIZE", value_parser = parse_cell)]
    cell_m: Option<f64>,
    /// Leave cells of the workspace with fewer poses empty [default: 3; of a grid 1]
    #[arg(long, value_name = "N")]
    min_count: Option<u32>,
    /// A record of the IMU: orientations and rates are compared with it; of a unit at rest, alone or
    /// with poses, Allan deviations beside the 3DM-GX1's data sheet
    #[arg(long, value_name = "FILE")]
    imu: Option<PathBuf>,
    /// Frame file, for how the IMU is mounted [default: level]
    #[arg(short, long, value_name = "FILE", requires = "imu")]
    frame: Option<PathBuf>,
    /// The lines that the poses were made from: residuals and points by face, strips seen
    #[arg(long, value_name = "FILE")]
    lines: Option<PathBuf>,
}

/// An alignment, or where one is.
#[derive(Clone, Debug)]
enum AlignChoice {
    Found(Align),
    File(PathBuf),
}

fn parse_align(text: &str) -> Result<AlignChoice, String> {
    let found = match text {
        "none" => Align::None,
        "se2" => Align::Se2,
        "se3" => Align::Se3,
        "full" => Align::Full,
        _ => match text.split_once(':') {
            Some(("file", path)) if !path.is_empty() => {
                return Ok(AlignChoice::File(PathBuf::from(path)));
            }
            Some(("first", count)) => match count.parse() {
                Ok(count) if count > 0 => Align::First(count),
                _ => return Err("first:N wants a number of poses".to_owned()),
            },
            _ => return Err("none, se2, se3, full, first:N or file:PATH is wanted".to_owned()),
        },
    };
    Ok(AlignChoice::Found(found))
}

fn parse_delay(text: &str) -> Result<DelayChoice, String> {
    match text {
        "show" => Ok(DelayChoice::Show),
        "none" => Ok(DelayChoice::None),
        "estimate" => Ok(DelayChoice::Estimate),
        _ => parse_signed_duration(text)
            .map(DelayChoice::Given)
            .map_err(|_| "show, none, estimate or a time such as 37ms is wanted".to_owned()),
    }
}

fn parse_delta(text: &str) -> Result<Delta, DeltaError> {
    text.parse()
}

fn parse_pairs(text: &str) -> Result<Pairs, String> {
    match text {
        "consecutive" => Ok(Pairs::Consecutive),
        "all" => Ok(Pairs::All),
        _ => Err("consecutive or all is wanted".to_owned()),
    }
}

fn parse_cell(text: &str) -> Result<f64, String> {
    let size: Option<f64> = text.parse().ok();
    size.filter(|m| m.is_finite() && *m > 0.0)
        .ok_or_else(|| "a size above 0 is wanted, in m".to_owned())
}

/// An IMU's record, for either use.
pub(super) struct ImuRecord {
    /// To compare orientations with.
    pub(super) attitudes: Attitudes,
    /// For its noise.
    pub(super) rest: Rest,
}

/// An IMU's record of a unit at rest, if it was.
pub(super) struct Rest {
    recording: Recording,
    source: String,
}

impl EvaluationArgs {
    /// What else is to be read.
    pub(super) fn beside(&self) -> anyhow::Result<Beside<'_>> {
        let frame = self.frame.as_deref().map(Frame::read).transpose()?;
        let axes = ImuAxes::new(&frame.map_or_else(Imu::default, |frame| frame.imu));
        Ok(Beside {
            imu: self.imu.as_deref().map(|path| (path, axes)),
            lines: self.lines.as_deref(),
        })
    }

    /// How to evaluate, with what was read beside poses and reference.
    pub(super) fn settings(
        &self,
        align: Align,
        imu: Option<Attitudes>,
        lines: Option<LineTally>,
    ) -> Settings {
        Settings {
            zones: self.zones.clone(),
            cell_m: self.cell_m,
            min_count: self.min_count,
            align,
            delay: self.delay,
            relative: self.rpe.clone(),
            pairs: self.rpe_pairs,
            imu,
            lines,
        }
    }

    /// The alignment, from its file if it is in one.
    pub(super) fn align(&self) -> anyhow::Result<Align> {
        let path = match &self.align {
            AlignChoice::Found(align) => return Ok(align.clone()),
            AlignChoice::File(path) => path,
        };
        let name = path.display();
        let bytes = std::fs::read(path).map_err(|e| Fault::NoInput(format!("{name}: {e}")))?;
        let text = String::from_utf8_lossy(&bytes);
        let given = Alignment::parse(&text).map_err(|e| Fault::BadData(format!("{name}: {e}")))?;
        Ok(Align::Given(Box::new(given)))
    }
}

impl ImuRecord {
    /// Reads a record of a unit that is mounted so.
    pub(super) fn read(path: &Path, axes: &ImuAxes, options: &Options) -> anyhow::Result<Self> {
        let mut input: Input<ImuSample> = Input::open(Some(path), options)?;
        let (mut recording, mut attitudes) = (Recording::default(), Attitudes::default());
        while let Some(sample) = input.next()? {
            recording.push(sample);
            attitudes.push(&axes.turned(sample, Axes::Platform));
        }
        let source = origin::input_name(path);
        Ok(ImuRecord {
            attitudes: attitudes.finish(source.clone()),
            rest: Rest { recording, source },
        })
    }
}

impl Rest {
    /// The noise of a unit at rest: none where the poses say that it moved.
    pub(super) fn noise(self, cases: &[Case]) -> Option<Inertial> {
        let moved = |case: &Case| case.orientation.is_some() && case.stability.is_none();
        let moved = cases.iter().any(moved);
        (!moved).then(|| self.recording.finish(self.source))
    }
}
