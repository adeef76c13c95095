//! The page's figures: error over time, by size and over the workspace.
//!
//! Sizes are in pixels of a page 1120 px wide. Titles and units are the page's business; a figure
//! has only its plot, its ticks and, where it has colours, their scale.

use super::axis::Axis;
use super::canvas::{DrawResult, Drawing, Hover, Sheet, UNIT, figure, ink};
use super::number::fixed;
use super::scale::{above, sign_colour, size_colour, ticks};
use super::statistics::Statistics;
use super::trace::{Histogram, Trace, TraceColumn};
use super::workspace::{Cell, Layout};
use plotters::coord::types::RangedCoordf64;
use plotters::drawing::DrawingArea;
use plotters::element::{PathElement, Polygon, Rectangle, Text};
use plotters::prelude::Cartesian2d;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{Color, IntoFont, RGBColor, ShapeStyle, TextStyle};

/// A plot's place on its sheet with the scales of its two axes.
type Plot<'a> = DrawingArea<super::canvas::Canvas<'a>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// Room around a plot, px: left, right, top, bottom.
type Margins = [i32; 4];

/// The part of `sheet` inside `margins`, with x growing to the right and y upwards.
fn plot<'a>(sheet: &Sheet<'a>, margins: Margins, x: [f64; 2], y: [f64; 2]) -> Plot<'a> {
    let [left, right, top, bottom] = margins.map(|m| m * UNIT);
    sheet
        .margin(top, bottom, left, right)
        .apply_coord_spec(Cartesian2d::<RangedCoordf64, RangedCoordf64>::new(
            x[0]..x[1],
            y[0]..y[1],
            {
                let (wide, high) = sheet.dim_in_pixel();
                (left..wide as i32 - right, high as i32 - bottom..top)
            },
        ))
}

fn line(colour: RGBColor) -> ShapeStyle {
    colour.stroke_width(UNIT as u32)
}

/// A label at a place of the sheet.
fn label(sheet: &Sheet<'_>, text: String, at: (i32, i32), h: HPos, v: VPos) -> DrawResult {
    let style = TextStyle::from(("sans-serif", 105).into_font()).pos(Pos::new(h, v));
    sheet.draw(&Text::new(text, at, style))
}

/// Ticks of y with thin lines across, labels of x below.
fn axes(
    sheet: &Sheet<'_>,
    plot: &Plot<'_>,
    (x_ticks, x_decimals): (Vec<f64>, usize),
    (y_ticks, y_decimals): (Vec<f64>, usize),
) -> DrawResult {
    let (xs, ys) = (plot.get_x_range(), plot.get_y_range());
    for y in y_ticks {
        let colour = if y == 0.0 { ink::MARK } else { ink::GRID };
        let style = if y == 0.0 {
            colour.stroke_width(UNIT as u32 / 2)
        } else {
            line(colour)
        };
        plot.draw(&PathElement::new(vec![(xs.start, y), (xs.end, y)], style))?;
        let (left, at) = plot.map_coordinate(&(xs.start, y));
        label(
            sheet,
            fixed(y, y_decimals),
            (left - 6 * UNIT, at),
            HPos::Right,
            VPos::Center,
        )?;
    }
    for x in x_ticks {
        let (at, bottom) = plot.map_coordinate(&(x, ys.start));
        label(
            sheet,
            fixed(x, x_decimals),
            (at, bottom + 7 * UNIT),
            HPos::Center,
            VPos::Top,
        )?;
    }
    Ok(())
}

/// Room of the plots with a time or an error along x.
const PLOT_MARGINS: Margins = [42, 8, 6, 22];

/// The height that a trace's axis needs on either side of zero, m or rad, and how many columns go
/// beyond it: a few failures by metres must not press the rest flat.
pub(super) fn trace_limit(trace: &Trace, statistics: &Statistics) -> (f64, usize) {
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

/// Error over time with the solver's band of 3 sigma, `width` by `height` px, between `-limit` and
/// `limit` (m or rad).
pub(super) fn over_time(
    trace: &Trace,
    axis: &Axis,
    limit: f64,
    (width, height): (u32, u32),
    label: &str,
) -> Drawing {
    figure((width, height), label, |sheet, _| {
        let top = limit * axis.factor;
        let plot = plot(
            sheet,
            PLOT_MARGINS,
            [0.0, trace.duration_s.max(1e-9)],
            [-top, top],
        );
        let inner = (width as i32 - PLOT_MARGINS[0] - PLOT_MARGINS[1]).max(1) as usize;
        let columns = trace.coarser(inner);
        let step = trace.duration_s.max(1e-9) / columns.len().max(1) as f64;
        let at = |i: usize| (i as f64 + 0.5) * step;
        let shown = |v: f64| (v * axis.factor).clamp(-top, top);
        band(&plot, &columns, &at, &|c| shown(3.0 * c.sigma()))?;
        // A run of 399.97 s still has its tick at 400.
        let x_ticks = ticks(0.0, trace.duration_s * 1.005, width as usize / 110);
        axes(
            sheet,
            &plot,
            x_ticks,
            ticks(-top, top, height as usize / 34),
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

/// The area within +-3 sigma, as far as sigmas are known.
fn band(
    plot: &Plot<'_>,
    columns: &[TraceColumn],
    at: &dyn Fn(usize) -> f64,
    sigma3: &dyn Fn(&TraceColumn) -> f64,
) -> DrawResult {
    for piece in pieces(columns) {
        let known: Vec<(f64, f64)> = piece
            .iter()
            .map(|(i, c)| (at(*i), sigma3(c)))
            .filter(|(_, s)| s.is_finite())
            .collect();
        let below = known.iter().rev().map(|(x, s)| (*x, -s));
        let outline: Vec<(f64, f64)> = known.iter().copied().chain(below).collect();
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

/// How often which error occurs, with the normal curve of the same bias and standard deviation.
pub(super) fn histogram(
    histogram: &Histogram,
    statistics: &Statistics,
    axis: &Axis,
    size: (u32, u32),
    label: &str,
) -> Drawing {
    figure(size, label, |sheet, hover| {
        let limit = histogram.limit * axis.factor;
        let width = 2.0 * limit / histogram.bins.len().max(1) as f64;
        let total = f64::from(histogram.bins.iter().sum::<u32>() + histogram.beyond);
        let s = statistics.scaled(axis.factor);
        let normal = |e: f64| {
            let z = (e - s.bias) / s.std;
            total * width * (-0.5 * z * z).exp() / (s.std * (2.0 * std::f64::consts::PI).sqrt())
        };
        let highest = f64::from(histogram.bins.iter().copied().max().unwrap_or(0));
        let top = highest.max(normal(s.bias).min(1.5 * highest));
        let top = above(if top.is_finite() { top } else { highest } * 1.02);
        let plot = plot(sheet, PLOT_MARGINS, [-limit, limit], [0.0, top]);
        axes(
            sheet,
            &plot,
            ticks(-limit, limit, size.0 as usize / 70),
            ticks(0.0, top, 4),
        )?;
        bars(&plot, histogram, (limit, width), axis, hover)?;
        if s.std > 0.0 {
            let points = (0..=100).map(|i| -limit + 2.0 * limit * f64::from(i) / 100.0);
            let points: Vec<_> = points.map(|e| (e, normal(e).min(top))).collect();
            plot.draw(&PathElement::new(points, line(ink::OTHER)))?;
        }
        Ok(())
    })
}

fn bars(
    plot: &Plot<'_>,
    histogram: &Histogram,
    (limit, width): (f64, f64),
    axis: &Axis,
    hover: &Hover,
) -> DrawResult {
    let filled = histogram.bins.iter().enumerate().filter(|(_, n)| **n > 0);
    for (i, n) in filled {
        let from = -limit + width * i as f64;
        hover.set(format!(
            "{} to {} {}: {n}",
            fixed(from, axis.decimals),
            fixed(from + width, axis.decimals),
            axis.symbol
        ));
        let corners = [
            (from + 0.06 * width, 0.0),
            (from + 0.94 * width, f64::from(*n)),
        ];
        plot.draw(&Rectangle::new(corners, ink::SERIES.mix(0.75).filled()))?;
    }
    Ok(())
}

/// One line of a figure with two logarithmic scales.
pub(super) struct LogSeries {
    /// What it is called where the pointer rests on it.
    pub name: String,
    /// Its points, both coordinates above zero.
    pub points: Vec<(f64, f64)>,
    /// Its colour.
    pub colour: RGBColor,
}

/// Colours of x, y and z, told apart by those who see fewer colours too, and of a limit.
pub(super) const TRIPLE: [RGBColor; 3] = [ink::SERIES, ink::OTHER, ink::THIRD];
/// The colour of a line to compare with.
pub(super) const LIMIT: RGBColor = ink::MARK;

/// Lines over two logarithmic scales, with a grid at the powers of ten.
pub(super) fn log_log(series: &[LogSeries], size: (u32, u32), label_text: &str) -> Drawing {
    figure(size, label_text, |sheet, hover| {
        let ends = |pick: fn(&(f64, f64)) -> f64| {
            let values = series.iter().flat_map(|s| s.points.iter().map(pick));
            let logs = values.filter(|v| *v > 0.0).map(f64::log10);
            let (low, high) = logs.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
                (l.min(v), h.max(v))
            });
            if low < high { [low, high] } else { [0.0, 1.0] }
        };
        let (x, y) = (ends(|p| p.0), ends(|p| p.1));
        let room = 0.06 * (y[1] - y[0]);
        let y = [y[0] - room, y[1] + room];
        let plot = plot(sheet, [56, 8, 6, 22], x, y);
        let decades = |[low, high]: [f64; 2]| (low.ceil() as i32)..=(high.floor() as i32);
        for power in decades(y) {
            let at = f64::from(power);
            plot.draw(&PathElement::new(
                vec![(x[0], at), (x[1], at)],
                line(ink::GRID),
            ))?;
            let (left, height) = plot.map_coordinate(&(x[0], at));
            label(
                sheet,
                power_of_ten(power),
                (left - 6 * UNIT, height),
                HPos::Right,
                VPos::Center,
            )?;
        }
        for power in decades(x) {
            let at = f64::from(power);
            plot.draw(&PathElement::new(
                vec![(at, y[0]), (at, y[1])],
                line(ink::GRID),
            ))?;
            let (place, bottom) = plot.map_coordinate(&(at, y[0]));
            label(
                sheet,
                power_of_ten(power),
                (place, bottom + 7 * UNIT),
                HPos::Center,
                VPos::Top,
            )?;
        }
        for LogSeries {
            name,
            points,
            colour,
        } in series
        {
            let shown = points.iter().filter(|(x, y)| *x > 0.0 && *y > 0.0);
            let logs: Vec<(f64, f64)> = shown.map(|(x, y)| (x.log10(), y.log10())).collect();
            hover.set(name.clone());
            plot.draw(&PathElement::new(logs, line(*colour)))?;
        }
        Ok(())
    })
}

/// 0.001, 1, 100.
fn power_of_ten(power: i32) -> String {
    fixed(10f64.powi(power), usize::try_from(-power).unwrap_or(0))
}

/// An error's course in a few pixels, for a row of a table.
pub(super) fn sparkline(values: &[f64]) -> Drawing {
    figure((100, 20), "over the run", |sheet, _| {
        let known: Vec<(f64, f64)> = values
            .iter()
            .enumerate()
            .filter(|(_, v)| v.is_finite())
            .map(|(i, v)| (i as f64, *v))
            .collect();
        let low = known.iter().map(|p| p.1).fold(f64::INFINITY, f64::min);
        let high = known.iter().map(|p| p.1).fold(f64::NEG_INFINITY, f64::max);
        let room = if high > low { 0.0 } else { 1.0 };
        let end = (values.len() as f64 - 1.0).max(1.0);
        let plot = plot(sheet, [1, 1, 2, 2], [0.0, end], [low - room, high + room]);
        plot.draw(&PathElement::new(known, line(ink::SERIES)))
    })
}

/// What a heat map shows and how it is coloured.
pub(super) struct Heat<'a> {
    /// Where the cells are.
    pub layout: Layout,
    /// The cells to show, with their index.
    pub cells: Vec<(usize, &'a Cell)>,
    /// A cell's value in the unit shown.
    pub value: &'a dyn Fn(&Cell) -> f64,
    /// Value of the brightest colour (and, signed, minus it of the other end).
    pub limit: f64,
    /// Blue, white and red about zero instead of dark to bright from zero.
    pub signed: bool,
    /// Decimals of a value.
    pub decimals: usize,
}

/// Room of a heat map: ticks at the left and below, the colour scale at the right.
const HEAT_MARGINS: Margins = [34, 62, 4, 22];

/// Height of a heat map of this width, px: cells in their true shape as far as that looks well.
fn heat_height(layout: &Layout, width: u32) -> u32 {
    let [wide, high] = [0, 1].map(|i| layout.size_m[i] * layout.count[i] as f64);
    let inner = f64::from(width) - f64::from(HEAT_MARGINS[0] + HEAT_MARGINS[1]);
    let height = (inner * high / wide).clamp(110.0, 190.0);
    height.round() as u32 + (HEAT_MARGINS[2] + HEAT_MARGINS[3]) as u32
}

/// Errors over the workspace: y to the right, z up.
pub(super) fn heat_map(heat: &Heat<'_>, width: u32, label: &str) -> Drawing {
    let height = heat_height(&heat.layout, width);
    figure((width, height), label, |sheet, hover| {
        let layout = &heat.layout;
        let ends = [0, 1].map(|i| {
            let from = layout.origin_m[i];
            [from, from + layout.size_m[i] * layout.count[i] as f64]
        });
        let plot = plot(sheet, HEAT_MARGINS, ends[0], ends[1]);
        for (index, cell) in &heat.cells {
            let value = (heat.value)(cell);
            if !value.is_finite() {
                continue;
            }
            let [y, z] = layout.centre_m(*index);
            let text = fixed(value, heat.decimals);
            hover.set(format!("{}, {}: {text}", fixed(y, 2), fixed(z, 2)));
            let [dy, dz] = layout.size_m.map(|s| 0.5 * s);
            let corners = [(y - dy, z - dz), (y + dy, z + dz)];
            plot.draw(&Rectangle::new(corners, colour(heat, value).filled()))?;
        }
        heat_ticks(sheet, &plot, ends)?;
        colour_scale(sheet, heat, (width, height))
    })
}

fn colour(heat: &Heat<'_>, value: f64) -> RGBColor {
    let share = value / heat.limit;
    let (r, g, b) = if heat.signed {
        sign_colour(share)
    } else {
        size_colour(share)
    };
    RGBColor(r, g, b)
}

fn heat_ticks(sheet: &Sheet<'_>, plot: &Plot<'_>, ends: [[f64; 2]; 2]) -> DrawResult {
    let [[left, right], [low, high]] = ends;
    let (ys, decimals) = ticks(left, right, 5);
    for y in ys {
        let (x, bottom) = plot.map_coordinate(&(y, low));
        label(
            sheet,
            fixed(y, decimals),
            (x, bottom + 7 * UNIT),
            HPos::Center,
            VPos::Top,
        )?;
    }
    let (zs, decimals) = ticks(low, high, 4);
    for z in zs {
        let (x, at) = plot.map_coordinate(&(left, z));
        label(
            sheet,
            fixed(z, decimals),
            (x - 6 * UNIT, at),
            HPos::Right,
            VPos::Center,
        )?;
    }
    Ok(())
}

/// The bar at the right that says which colour is which value.
fn colour_scale(sheet: &Sheet<'_>, heat: &Heat<'_>, (width, height): (u32, u32)) -> DrawResult {
    const STEPS: i32 = 40;
    let [_, right, top, bottom] = HEAT_MARGINS;
    let low = if heat.signed { -heat.limit } else { 0.0 };
    let margins = [width as i32 - right + 14, right - 24, top, bottom];
    let bar = plot(sheet, margins, [0.0, 1.0], [low, heat.limit]);
    let step = (heat.limit - low) / f64::from(STEPS);
    for i in 0..STEPS {
        let from = low + step * f64::from(i);
        let style = colour(heat, from + 0.5 * step).filled();
        bar.draw(&Rectangle::new([(0.0, from), (1.0, from + step)], style))?;
    }
    let (values, decimals) = ticks(low, heat.limit, (height / 32) as usize);
    for value in values {
        let (x, at) = bar.map_coordinate(&(1.0, value));
        label(
            sheet,
            fixed(value, decimals),
            (x + 5 * UNIT, at),
            HPos::Left,
            VPos::Center,
        )?;
    }
    Ok(())
}

/// The end of a colour scale for `values` and the largest of them, which is beyond the end where a
/// few cells would leave all others in one colour.
pub(super) fn heat_limit(values: &[f64]) -> (f64, f64) {
    let mut sizes: Vec<f64> = values
        .iter()
        .filter(|v| v.is_finite())
        .map(|v| v.abs())
        .collect();
    sizes.sort_unstable_by(f64::total_cmp);
    let largest = sizes.last().copied().unwrap_or(0.0);
    let median = super::statistics::percentile(&sizes, 50.0);
    let limit = if largest > 10.0 * median && median > 0.0 {
        5.0 * median
    } else {
        largest
    };
    (above(limit), largest)
}
