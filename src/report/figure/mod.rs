//! The figures: courses over time, distributions, curves, maps of the workspace.
//!
//! They are made from plain numbers, in the unit in which they are shown. Sizes are in pixels of a
//! page 1120 px wide. Titles and units are the page's business; a figure has only its plot, its ticks
//! and, where it has colours, their scale.

mod bars;
pub(super) mod contour;
mod curve;
mod heat;
mod points;
mod time;

pub(super) use bars::{bars, counts, histogram};
pub(super) use curve::{Mark, curve, log_log};
pub use heat::MapStyle;
pub(super) use heat::{Heat, heat_map, heat_range};
pub(super) use points::{Interval, coverage, intervals};
pub(super) use time::{Course, over_time, trace_limit};

use super::canvas::{Canvas, DrawResult, Drawing, Sheet, UNIT, figure, ink};
use super::number::fixed;
use plotters::coord::types::RangedCoordf64;
use plotters::drawing::DrawingArea;
use plotters::element::{PathElement, Text};
use plotters::prelude::Cartesian2d;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{IntoFont, RGBColor, ShapeStyle, TextStyle};

/// Widths of the page's figures, px: alone in a row,
pub(super) const WHOLE: u32 = 1072;
/// one of two,
pub(super) const HALF: u32 = 524;
/// one of three.
pub(super) const THIRD: u32 = 341;

/// A plot's place on its sheet with the scales of its two axes.
type Plot<'a> = DrawingArea<Canvas<'a>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// Room around a plot, px: left, right, top, bottom.
type Margins = [i32; 4];

/// Room of the plots with a scale at the left and one below.
const PLOT_MARGINS: Margins = [42, 8, 6, 22];

/// Colours of x, y and z, told apart by those who see fewer colours too.
pub(super) const TRIPLE: [RGBColor; 3] = [ink::SERIES, ink::OTHER, ink::THIRD];
/// The colour of a line to compare with.
pub(super) const LIMIT: RGBColor = ink::MARK;

/// One line of a figure.
pub(super) struct Series {
    /// What it is called where the pointer rests on it.
    pub name: String,
    /// Its points; on logarithmic scales, those with both coordinates above zero are drawn.
    pub points: Vec<(f64, f64)>,
    /// Its colour.
    pub colour: RGBColor,
}

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
    stroke(colour, UNIT as u32)
}

/// A line of so many units.
fn stroke(colour: RGBColor, width: u32) -> ShapeStyle {
    ShapeStyle::from(&colour).stroke_width(width)
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
    x_ticks: (Vec<f64>, usize),
    (y_ticks, y_decimals): (Vec<f64>, usize),
) -> DrawResult {
    let (xs, ys) = (plot.get_x_range(), plot.get_y_range());
    let across = |y: f64, style: ShapeStyle| {
        plot.draw(&PathElement::new(vec![(xs.start, y), (xs.end, y)], style))
    };
    for y in y_ticks.iter().filter(|y| **y != 0.0) {
        across(*y, line(ink::GRID))?;
    }
    if ys.start <= 0.0 && ys.end >= 0.0 {
        across(0.0, stroke(ink::MARK, UNIT as u32 / 2))?;
    }
    for y in y_ticks {
        let (left, at) = plot.map_coordinate(&(xs.start, y));
        let text = fixed(y, y_decimals);
        label(
            sheet,
            text,
            (left - 6 * UNIT, at),
            HPos::Right,
            VPos::Center,
        )?;
    }
    x_labels(sheet, plot, x_ticks)
}

/// Labels below a plot.
fn x_labels(
    sheet: &Sheet<'_>,
    plot: &Plot<'_>,
    (ticks, decimals): (Vec<f64>, usize),
) -> DrawResult {
    let bottom = plot.get_y_range().start;
    for x in ticks {
        let (at, bottom) = plot.map_coordinate(&(x, bottom));
        let place = (at, bottom + 7 * UNIT);
        label(sheet, fixed(x, decimals), place, HPos::Center, VPos::Top)?;
    }
    Ok(())
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

/// The largest finite value; zero for none.
fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.filter(|v| v.is_finite()).fold(0.0, f64::max)
}
