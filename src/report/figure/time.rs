//! A quantity over time: the extremes of every column of pixels.

use super::super::canvas::{DrawResult, Drawing, figure, ink};
use super::super::scale::{above, ticks};
use super::super::statistics::Statistics;
use super::super::trace::{Trace, TraceColumn};
use super::{PLOT_MARGINS, Plot, axes, line, plot};
use plotters::element::{PathElement, Polygon};
use plotters::style::Color;

/// What is drawn over time.
pub(in crate::report) struct Course<'a> {
    /// The values with their sigmas.
    pub trace: &'a Trace,
    /// How many of the unit shown make one of the trace's.
    pub factor: f64,
    /// From where to where the scale goes, in the unit shown; what is beyond is cut off there.
    pub range: [f64; 2],
    /// Pixels that share one pair of extremes: 1, or more where a page holds many courses.
    pub step_px: usize,
}

/// The height that a trace's axis needs on either side of zero, m or rad, and how many columns go
/// beyond it: a few failures by metres must not press the rest flat.
pub(in crate::report) fn trace_limit(trace: &Trace, statistics: &Statistics) -> (f64, usize) {
    let sizes = || {
        let filled = trace.columns.iter().filter(|c| c.n > 0);
        filled.map(|c| c.max.abs().max(c.min.abs()))
    };
    let largest = sizes().fold(0.0, f64::max);
    let band = trace
        .columns
        .iter()
        .map(TraceColumn::sigma)
        .filter(|s| s.is_finite());
    let band = 3.0 * band.fold(0.0, f64::max);
    let limit = if largest > 6.0 * statistics.p99 {
        2.0 * statistics.p99
    } else {
        largest
    };
    // Errors of rounding, as of a pitch that was given, need no axis of their own size.
    let limit = limit.max(1e-3);
    // A band far wider than the errors may leave the picture; the errors may not.
    let limit = above(limit.max(band.min(2.0 * limit)));
    (limit, sizes().filter(|s| *s > limit).count())
}

/// A course over time with the band of 3 sigma where sigmas are known, `width` by `height` px.
pub(in crate::report) fn over_time(
    course: &Course<'_>,
    (width, height): (u32, u32),
    label: &str,
) -> Drawing {
    let trace = course.trace;
    figure((width, height), label, |sheet, _| {
        let [low, high] = course.range;
        let plot = plot(
            sheet,
            PLOT_MARGINS,
            [0.0, trace.duration_s.max(1e-9)],
            course.range,
        );
        let inner = (width as i32 - PLOT_MARGINS[0] - PLOT_MARGINS[1]).max(1) as usize;
        let columns = trace.coarser(inner / course.step_px.max(1));
        let step = trace.duration_s.max(1e-9) / columns.len().max(1) as f64;
        let at = |i: usize| (i as f64 + 0.5) * step;
        let shown = |v: f64| (v * course.factor).clamp(low, high);
        band(&plot, &columns, &at, &|c| 3.0 * c.sigma(), &shown)?;
        // A run of 399.97 s still has its tick at 400.
        let x_ticks = ticks(0.0, trace.duration_s * 1.005, width as usize / 110);
        axes(
            sheet,
            &plot,
            x_ticks,
            ticks(low, high, height as usize / 34),
        )?;
        for piece in pieces(&columns) {
            let points: Vec<(f64, f64)> = piece
                .iter()
                .flat_map(|(i, c)| extremes(c).map(|v| (at(*i), shown(v))))
                .collect();
            plot.draw(&PathElement::new(points, line(ink::SERIES)))?;
        }
        Ok(())
    })
}

/// Both extremes of a column.
fn extremes(column: &TraceColumn) -> [f64; 2] {
    [column.min, column.max]
}

/// Columns that make one corner of the band: it is smooth enough for that.
const BAND_COLUMNS: usize = 4;

/// The area within +-3 sigma, as far as sigmas are known.
fn band(
    plot: &Plot<'_>,
    columns: &[TraceColumn],
    at: &dyn Fn(usize) -> f64,
    sigma3: &dyn Fn(&TraceColumn) -> f64,
    shown: &dyn Fn(f64) -> f64,
) -> DrawResult {
    for piece in pieces(columns) {
        let known: Vec<(f64, f64)> = piece
            .iter()
            .map(|(i, c)| (at(*i), sigma3(c)))
            .filter(|(_, s)| s.is_finite())
            .collect();
        let last = known.len().saturating_sub(1);
        let known: Vec<(f64, f64)> = known
            .chunks(BAND_COLUMNS)
            .enumerate()
            .map(|(k, chunk)| {
                let mean = chunk.iter().map(|p| p.1).sum::<f64>() / chunk.len() as f64;
                // The ends stay where they are.
                let end = chunk.last().filter(|_| k == last / BAND_COLUMNS && k > 0);
                (end.or(chunk.first()).map_or(0.0, |p| p.0), mean)
            })
            .collect();
        let above = known.iter().map(|(x, s)| (*x, shown(*s)));
        let below = known.iter().rev().map(|(x, s)| (*x, shown(-s)));
        let outline: Vec<(f64, f64)> = above.chain(below).collect();
        if known.len() > 1 {
            plot.draw(&Polygon::new(outline, ink::BAND.filled()))?;
        }
    }
    Ok(())
}

/// The filled columns in pieces, parted where far more columns are empty than the run's density
/// explains.
fn pieces(columns: &[TraceColumn]) -> Vec<Vec<(usize, &TraceColumn)>> {
    let filled: Vec<_> = columns
        .iter()
        .enumerate()
        .filter(|(_, c)| c.n > 0)
        .collect();
    let usual = columns.len() / filled.len().max(1) + 1;
    let mut pieces: Vec<Vec<(usize, &TraceColumn)>> = Vec::new();
    let mut last = None;
    for (i, column) in filled {
        match pieces.last_mut() {
            Some(piece) if last.is_some_and(|l| i - l <= 4 * usual) => piece.push((i, column)),
            _ => pieces.push(vec![(i, column)]),
        }
        last = Some(i);
    }
    pieces
}
