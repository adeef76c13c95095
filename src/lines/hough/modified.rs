//! Lines by the modified Hough transform: votes only in windows around the lines predicted
//! (Kurniawan 2017, section 4.1).
//!
//! A window reaches as far as a line can have moved since the scan before, eq. 4.6, and the cell with
//! the most votes in it is the line. Beams that no predicted line explains are transformed as a
//! whole, so that lines which come into view are found; without a prediction that is everything.

use super::full::{HoughOptions, WholeSpace};
use super::inverse_line;
use super::reflectors::WindowSize;
use super::window::{Accumulator, Window};
use crate::lines::extractor::ExtractorOptions;
use crate::lines::taking::{Scene, Taker, Taking};
use crate::record::{NormalLine, Scan};
use std::ops::Range;

/// Settings of the transform.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ModifiedHoughOptions {
    /// Those of the transform over the whole space, for what was not predicted.
    pub whole: HoughOptions,
    /// How large a window is.
    pub window: WindowSize,
}

/// The extractor.
pub type ModifiedHough = Taking<ExpectedWindows>;

/// Looks around the lines expected first, and then for what is left in the whole space.
#[derive(Clone, Debug, Default)]
pub struct ExpectedWindows {
    window: WindowSize,
    expected: Vec<NormalLine>,
    accumulator: Accumulator,
    whole: WholeSpace,
}

impl ExpectedWindows {
    /// Votes in the window about a line, and takes the line that wins.
    fn look_around(&mut self, line: NormalLine, reach: [f64; 2], scene: &mut Scene<'_>) {
        let common = self.whole.common();
        let row_m = self.window.row_m.max(common.segmentation.sigma_m);
        let around = [line.d_m, line.alpha_rad];
        let window = Window::around(around, reach, row_m, self.window.column_rad);
        let (sin, cos) = line.alpha_rad.sin_cos();
        let beams = scene.beams();
        self.accumulator.clear();
        for k in scene.free(0..beams.len()) {
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
        if let Some(([d_m, alpha_rad], _)) = self.accumulator.peak(&window) {
            scene.take(inverse_line(d_m, alpha_rad), 1.5 * row_m);
        }
    }
}

impl Taker for ExpectedWindows {
    type Options = ModifiedHoughOptions;

    fn new(options: ModifiedHoughOptions) -> ExpectedWindows {
        ExpectedWindows {
            window: options.window,
            expected: Vec::new(),
            accumulator: Accumulator::default(),
            whole: WholeSpace::new(options.whole),
        }
    }

    fn common(&self) -> &ExtractorOptions {
        self.whole.common()
    }

    fn begin(&mut self, scan: &Scan, scene: &mut Scene<'_>) {
        let reach = self.window.reach(scan.scan_time_s);
        for i in 0..self.expected.len() {
            self.look_around(self.expected[i], reach, scene);
        }
    }

    fn take(&mut self, group: Range<usize>, scene: &mut Scene<'_>) {
        self.whole.take(group, scene);
    }

    fn expect(&mut self, lines: &[NormalLine]) {
        self.expected.clear();
        self.expected.extend(
            lines
                .iter()
                .filter(|line| line.d_m >= 0.0 && line.alpha_rad.is_finite()),
        );
    }
}
