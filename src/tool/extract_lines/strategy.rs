//! The frame's three lines by the modified Hough transform, alone or as part of the dissertation's
//! strategy: the options and the stage. The window's options serve any scene too.

use super::{Tally, first_given};
use crate::edges::EdgeMeter;
use crate::frame::Frame;
use crate::lines::dissertation::{Strategy, StrategyOptions};
use crate::lines::fit::Estimator;
use crate::lines::hough::WindowSize;
use crate::record::{NormalLine, ReflectorLines, Scan};
use crate::stream::{self, Emit, Fault, Input, Options, Outcome, Stage};
use crate::tool::values::positive;
use std::path::{Path, PathBuf};

/// Settings of the windows.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Windows of modified-hough and dissertation")]
pub(super) struct WindowArgs {
    /// Where the lines are before the first scan: its first record (lines with a frame, else the
    /// segments of one scan) [default: looked for everywhere]
    #[arg(long, value_name = "FILE")]
    pub(super) predict: Option<PathBuf>,
    /// Largest speed of the platform: half the window is speed times cycle times 2 [default: 3]
    #[arg(long, value_name = "M_S", value_parser = positive)]
    window_speed_m_s: Option<f64>,
    /// Largest rate of turn in the scan plane [default: 20]
    #[arg(long, value_name = "DEG_S", value_parser = positive)]
    window_turn_deg_s: Option<f64>,
    /// Height of the transform's cells [default: 10]
    #[arg(long, value_name = "MM", value_parser = positive)]
    cell_mm: Option<f64>,
    /// Width of the transform's cells [default: 0.1]
    #[arg(long, value_name = "DEG", value_parser = positive)]
    cell_deg: Option<f64>,
    /// Stop after the transform, whose best cells are the lines: no edges, y and z to a cell's height
    /// (Kurniawan 2017, Fig. 5.14); with a frame
    #[arg(long)]
    pub(super) coarse: bool,
}

impl WindowArgs {
    /// The first option that is given.
    pub(super) fn given(&self) -> Option<&'static str> {
        first_given(&[
            (self.predict.is_some(), "--predict"),
            (self.window_speed_m_s.is_some(), "--window-speed-m-s"),
            (self.window_turn_deg_s.is_some(), "--window-turn-deg-s"),
            (self.cell_mm.is_some(), "--cell-mm"),
            (self.cell_deg.is_some(), "--cell-deg"),
            (self.coarse, "--coarse"),
        ])
    }

    pub(super) fn size(&self) -> WindowSize {
        let default = WindowSize::default();
        let radians = |given: Option<f64>, default: f64| given.map_or(default, f64::to_radians);
        WindowSize {
            speed_m_s: self.window_speed_m_s.unwrap_or(default.speed_m_s),
            turn_rad_s: radians(self.window_turn_deg_s, default.turn_rad_s),
            row_m: self.cell_mm.map_or(default.row_m, |mm| mm / 1000.0),
            column_rad: radians(self.cell_deg, default.column_rad),
            ..default
        }
    }
}

/// Reads scans and writes the three lines and the strip edges of each: the dissertation's, or by
/// the transform and the fits and edges of the other methods.
pub(super) fn run(
    frame: Option<Frame>,
    dissertation: bool,
    windows: &WindowArgs,
    input: Option<&Path>,
    options: &Options,
) -> anyhow::Result<Outcome> {
    let Some(frame) = frame else {
        let text = "--method dissertation needs the frame: -f FILE";
        return Err(Fault::Usage(text.to_owned()).into());
    };
    let settings = StrategyOptions {
        window: windows.size(),
        coarse: windows.coarse,
        ..StrategyOptions::default()
    };
    let settings = if dissertation {
        settings
    } else {
        StrategyOptions {
            estimator: Estimator::MaximumLikelihood,
            ..settings
        }
    };
    let mut strategy = Strategy::new(&frame, settings);
    if let Some(path) = &windows.predict {
        strategy.predict(predicted(path, options)?);
    }
    let mut stage = ThreeLines {
        strategy,
        edges: (!dissertation && !windows.coarse).then(|| EdgeMeter::new(&frame)),
        coarse: windows.coarse,
        lines: ReflectorLines::default(),
        tally: Tally::default(),
    };
    stream::filter(options, input, &mut stage)
}

/// The first lines record with all three lines.
fn predicted(path: &Path, options: &Options) -> anyhow::Result<[NormalLine; 3]> {
    let mut records = Input::<ReflectorLines>::open(Some(path), &side(options))?;
    while let Some(record) = records.next()? {
        let lines = record.lines();
        if lines.iter().all(|line| line.is_seen()) {
            return Ok(lines.map(|line| line.normal));
        }
    }
    let name = path.display();
    let text = format!("{name}: no record with all three lines to start from");
    Err(Fault::BadData(text).into())
}

/// Options for reading a file beside the scans: all of it.
pub(super) fn side(options: &Options) -> Options {
    Options {
        window: Default::default(),
        input_format: None,
        ..options.clone()
    }
}

/// Scans in, three lines and the strip edges of each out.
struct ThreeLines {
    strategy: Strategy,
    /// Measures the edges; none where the strategy does it itself.
    edges: Option<EdgeMeter>,
    /// Whether there are none.
    coarse: bool,
    lines: ReflectorLines,
    tally: Tally,
}

impl Stage for ThreeLines {
    type In = Scan;
    type Out = ReflectorLines;

    fn push(&mut self, scan: &Scan, emit: &mut Emit<'_, ReflectorLines>) -> anyhow::Result<()> {
        self.tally.scans += 1;
        self.lines.begin(scan);
        if self.strategy.find_lines(scan, &mut self.lines) {
            match &mut self.edges {
                Some(edges) => edges.measure(scan, &mut self.lines),
                None if self.coarse => {}
                None => self.strategy.find_strips(scan, &mut self.lines),
            }
        } else {
            self.tally.without += 1;
        }
        emit.write(&self.lines)
    }

    fn finish(&mut self, _emit: &mut Emit<'_, ReflectorLines>) -> anyhow::Result<Outcome> {
        Ok(self.tally.outcome())
    }
}
