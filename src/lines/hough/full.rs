//! Lines by the Hough transform over the whole space (Duda and Hart 1972).

use super::columns::Columns;
use super::inverse_line;
use crate::lines::extractor::ExtractorOptions;
use crate::lines::taking::{Scene, Taker, Taking};
use crate::record::Scan;
use std::ops::Range;

/// Settings of the transform.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HoughOptions {
    /// What all extractors have.
    pub common: ExtractorOptions,
    /// Directions in half a turn.
    pub columns: usize,
    /// Height of a cell, m; never less than the noise.
    pub row_m: f64,
}

impl Default for HoughOptions {
    fn default() -> Self {
        HoughOptions {
            common: ExtractorOptions::default(),
            columns: 200,
            row_m: 0.01,
        }
    }
}

/// The extractor.
pub type Hough = Taking<WholeSpace>;

/// Lets free beams vote in the whole space. Beams whose peaks were no lines vote no more, until all
/// that are left are asked again.
#[derive(Clone, Debug, Default)]
pub struct WholeSpace {
    options: HoughOptions,
    columns: Columns,
}

impl Taker for WholeSpace {
    type Options = HoughOptions;

    fn new(options: HoughOptions) -> WholeSpace {
        WholeSpace {
            options,
            columns: Columns::default(),
        }
    }

    fn common(&self) -> &ExtractorOptions {
        &self.options.common
    }

    fn begin(&mut self, _: &Scan, _: &mut Scene<'_>) {}

    /// Takes one line after the other, the one with the most votes first.
    fn take(&mut self, group: Range<usize>, scene: &mut Scene<'_>) {
        let common = &self.options.common;
        if scene.count(group.clone()) < common.min_points {
            return;
        }
        let row_m = self.options.row_m.max(common.segmentation.sigma_m);
        let columns = &mut self.columns;
        columns.begin(self.options.columns.max(2), row_m);
        let beams = scene.beams();
        for k in scene.free(group) {
            columns.add(beams.y_m[k], beams.z_m[k], k);
        }
        while let Some(peak) = columns.peak() {
            if (peak.votes as usize) < common.min_points {
                break;
            }
            let line = inverse_line(peak.d_m, peak.alpha_rad);
            if scene.take(line, 1.5 * row_m) {
                columns.remove(|k| !scene.is_free(k));
            } else {
                columns.remove_peak(&peak);
            }
        }
    }
}
