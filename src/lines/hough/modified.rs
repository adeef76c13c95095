//! Lines by the modified Hough transform: votes only in windows around the lines predicted
//! (Kurniawan 2017, section 4.1).
//!
//! A window reaches as far as a line can have moved since the scan before, eq. 4.6, and the cell with
//! the most votes in it is the line. Beams that no predicted line explains are transformed as a
//! whole, so that lines which come into view are found; without a prediction that is everything.

use super::columns::Columns;
use super::full::{HoughOptions, transform};
use super::inverse_line;
use super::reflectors::WindowSize;
use super::window::{Accumulator, Window};
use crate::lines::assembly::Assembly;
use crate::lines::extractor::{Extractor, Fate};
use crate::lines::pool::Pool;
use crate::lines::segmentation::Returns;
use crate::record::{NormalLine, Scan, Segment};

/// Settings of the transform.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ModifiedHoughOptions {
    /// Those of the transform over the whole space, for what was not predicted.
    pub whole: HoughOptions,
    /// How large a window is.
    pub window: WindowSize,
}

/// The extractor: its settings and buffers, and the lines expected.
#[derive(Clone, Debug, Default)]
pub struct ModifiedHough {
    /// The settings; may be changed between scans.
    pub options: ModifiedHoughOptions,
    expected: Vec<NormalLine>,
    returns: Returns,
    pool: Pool,
    accumulator: Accumulator,
    columns: Columns,
    assembly: Assembly,
}

impl ModifiedHough {
    /// An extractor with the given settings.
    pub fn new(options: ModifiedHoughOptions) -> ModifiedHough {
        ModifiedHough {
            options,
            ..ModifiedHough::default()
        }
    }

    /// Votes in the window about a line, and takes the line that wins.
    fn look_around(&mut self, line: NormalLine, reach: [f64; 2], out: &mut Vec<Segment>) {
        let common = &self.options.whole.common;
        let size = &self.options.window;
        let row_m = size.row_m.max(common.segmentation.sigma_m);
        let window = Window::around([line.d_m, line.alpha_rad], reach, row_m, size.column_rad);
        let (sin, cos) = line.alpha_rad.sin_cos();
        let beams = self.returns.beams();
        self.accumulator.clear();
        for k in (0..beams.len()).filter(|k| self.pool.is_free(*k)) {
            let (y, z) = (beams.y_m[k], beams.z_m[k]);
            // A turn moves a point by its place along the line.
            let limit_m = reach[0] + reach[1] * (z * cos - y * sin).abs();
            if (y * cos + z * sin - line.d_m).abs() <= limit_m {
                self.accumulator.add(y, z);
            }
        }
        if self.accumulator.points() < common.min_points {
            return;
        }
        self.accumulator.vote(&window);
        let Some(([d_m, alpha_rad], _)) = self.accumulator.peak(&window) else {
            return;
        };
        let peak = inverse_line(d_m, alpha_rad);
        let assembly = &mut self.assembly;
        self.pool
            .take(&self.returns, peak, 1.5 * row_m, common, assembly, out);
    }
}

impl Extractor for ModifiedHough {
    fn extract(&mut self, scan: &Scan, out: &mut Vec<Segment>) {
        out.clear();
        let common = self.options.whole.common;
        self.returns.read(scan, &common.segmentation);
        self.assembly.begin(scan, &self.returns, &common);
        self.pool.begin(&self.returns);
        let reach = self.options.window.reach(scan.scan_time_s);
        let expected = std::mem::take(&mut self.expected);
        for line in &expected {
            self.look_around(*line, reach, out);
        }
        self.expected = expected;
        for (from, to) in self.returns.groups() {
            transform(
                &self.returns,
                from..to,
                &self.options.whole,
                &mut self.columns,
                &mut self.pool,
                &mut self.assembly,
                out,
            );
        }
        self.assembly.end(out);
    }

    fn fates(&self) -> &[Fate] {
        self.assembly.fates()
    }

    fn expect(&mut self, lines: &[NormalLine]) {
        self.returns.expect(lines);
        self.expected.clear();
        self.expected.extend(
            lines
                .iter()
                .filter(|line| line.d_m >= 0.0 && line.alpha_rad.is_finite()),
        );
    }
}
