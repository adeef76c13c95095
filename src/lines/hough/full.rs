//! Lines by the Hough transform over the whole space (Duda and Hart 1972).

use super::columns::Columns;
use super::inverse_line;
use crate::lines::assembly::Assembly;
use crate::lines::extractor::{Extractor, ExtractorOptions, Fate};
use crate::lines::pool::Pool;
use crate::lines::segmentation::Returns;
use crate::record::{NormalLine, Scan, Segment};
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

/// The extractor: its settings and buffers.
#[derive(Clone, Debug, Default)]
pub struct Hough {
    /// The settings; may be changed between scans.
    pub options: HoughOptions,
    returns: Returns,
    pool: Pool,
    columns: Columns,
    assembly: Assembly,
}

impl Hough {
    /// An extractor with the given settings.
    pub fn new(options: HoughOptions) -> Hough {
        Hough {
            options,
            ..Hough::default()
        }
    }
}

impl Extractor for Hough {
    fn extract(&mut self, scan: &Scan, out: &mut Vec<Segment>) {
        out.clear();
        let common = &self.options.common;
        self.returns.read(scan, &common.segmentation);
        self.assembly.begin(scan, &self.returns, common);
        self.pool.begin(&self.returns);
        for (from, to) in self.returns.groups() {
            transform(
                &self.returns,
                from..to,
                &self.options,
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
    }
}

/// Takes the lines of a group of beams. Beams whose peaks were no lines vote no more, which may
/// cost a line its votes: so the beams left all vote again as long as that finds something.
pub(super) fn transform(
    returns: &Returns,
    group: Range<usize>,
    options: &HoughOptions,
    columns: &mut Columns,
    pool: &mut Pool,
    assembly: &mut Assembly,
    out: &mut Vec<Segment>,
) {
    let mut before = usize::MAX;
    while out.len() != before {
        before = out.len();
        sweep(
            returns,
            group.clone(),
            options,
            columns,
            pool,
            assembly,
            out,
        );
    }
}

/// Takes one line after the other, the one with the most votes first, from the free beams of a
/// group.
fn sweep(
    returns: &Returns,
    group: Range<usize>,
    options: &HoughOptions,
    columns: &mut Columns,
    pool: &mut Pool,
    assembly: &mut Assembly,
    out: &mut Vec<Segment>,
) {
    let common = &options.common;
    if pool.count(group.clone()) < common.min_points {
        return;
    }
    let row_m = options.row_m.max(common.segmentation.sigma_m);
    columns.begin(options.columns.max(2), row_m);
    let beams = returns.beams();
    for k in group.filter(|k| pool.is_free(*k)) {
        columns.add(beams.y_m[k], beams.z_m[k], k);
    }
    while let Some(peak) = columns.peak() {
        if (peak.votes as usize) < common.min_points {
            break;
        }
        let line = inverse_line(peak.d_m, peak.alpha_rad);
        if pool.take(returns, line, 1.5 * row_m, common, assembly, out) {
            columns.remove(|k| !pool.is_free(k));
        } else {
            columns.remove_peak(&peak);
        }
    }
}
