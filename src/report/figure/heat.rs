//! Maps of the workspace: cells in colours, or contours.

use super::super::canvas::{DrawResult, Drawing, Hover, Sheet, UNIT, figure, ink};
use super::super::number::fixed;
use super::super::scale::{above, sign_colour, size_colour, ticks};
use super::super::workspace::Layout;
use super::contour::{Grid, joined};
use super::{Margins, Plot, label, plot, stroke, x_labels};
use plotters::element::{PathElement, Polygon, Rectangle};
use plotters::style::text_anchor::{HPos, VPos};
use plotters::style::{Color, RGBColor};

/// How a map is drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MapStyle {
    /// Cells in colours.
    #[default]
    Cells,
    /// The areas between contours in colours.
    Contours,
    /// Cells in colours with contours over them.
    Both,
}

/// What a map shows and how it is coloured.
pub(in crate::report) struct Heat<'a> {
    /// Where the cells are.
    pub layout: Layout,
    /// A value for each cell in the unit shown, row by row from the lowest; NaN for an empty one.
    pub values: &'a [f64],
    /// The values of the first and of the last colour.
    pub range: [f64; 2],
    /// Blue, white and red about the middle instead of dark to bright.
    pub signed: bool,
    /// Decimals of a value.
    pub decimals: usize,
    /// Cells or contours.
    pub style: MapStyle,
}

/// Room of a heat map: ticks at the left and below, the colour scale at the right.
const HEAT_MARGINS: Margins = [34, 62, 4, 22];

/// Contours on a map: about this many.
const LEVELS: usize = 8;

impl Heat<'_> {
    fn colour(&self, value: f64) -> RGBColor {
        let [low, high] = self.range;
        let share = (value - low) / (high - low);
        let (r, g, b) = if self.signed {
            sign_colour(2.0 * share - 1.0)
        } else {
            size_colour(share)
        };
        RGBColor(r, g, b)
    }

    /// The values of the contours.
    fn levels(&self) -> Vec<f64> {
        let [low, high] = self.range;
        let (mut levels, _) = ticks(low, high, LEVELS);
        let room = 1e-6 * (high - low);
        levels.retain(|l| *l > low + room && *l < high - room);
        levels
    }

    /// The colours between the contours: each with the value it begins at.
    fn bands(&self) -> Vec<(f64, RGBColor)> {
        let [low, high] = self.range;
        let levels = self.levels();
        let ends = |k: usize| levels.get(k).copied().unwrap_or(high);
        let bands = (0..=levels.len()).map(|k| {
            let from = if k == 0 { low } else { ends(k - 1) };
            (from, self.colour(0.5 * (from + ends(k))))
        });
        bands.collect()
    }

    fn grid(&self) -> Grid<'_> {
        Grid {
            count: self.layout.count,
            values: self.values,
        }
    }

    /// A place in cells in metres.
    fn place(&self, (i, j): (f64, f64)) -> (f64, f64) {
        let Layout {
            origin_m, size_m, ..
        } = self.layout;
        (origin_m[0] + i * size_m[0], origin_m[1] + j * size_m[1])
    }
}

/// Height of a heat map of this width, px: cells in their true shape as far as that looks well.
fn heat_height(layout: &Layout, width: u32) -> u32 {
    let [wide, high] = [0, 1].map(|i| layout.size_m[i] * layout.count[i] as f64);
    let inner = f64::from(width) - f64::from(HEAT_MARGINS[0] + HEAT_MARGINS[1]);
    let height = (inner * high / wide).clamp(110.0, 0.8 * inner.max(200.0));
    height.round() as u32 + (HEAT_MARGINS[2] + HEAT_MARGINS[3]) as u32
}

/// Values over the workspace: y to the right, z up.
pub(in crate::report) fn heat_map(heat: &Heat<'_>, width: u32, label: &str) -> Drawing {
    let height = heat_height(&heat.layout, width);
    figure((width, height), label, |sheet, hover| {
        let [y, z] = heat.layout.ends_m();
        let plot = plot(sheet, HEAT_MARGINS, y, z);
        match heat.style {
            MapStyle::Cells => cells(&plot, heat, hover)?,
            MapStyle::Contours => {
                areas(&plot, heat, hover)?;
                contours(&plot, heat)?;
            }
            MapStyle::Both => {
                cells(&plot, heat, hover)?;
                contours(&plot, heat)?;
            }
        }
        heat_ticks(sheet, &plot, [y, z])?;
        colour_scale(sheet, heat, (width, height))
    })
}

/// The cells; neighbours in a row that read and look the same are one shape.
fn cells(plot: &Plot<'_>, heat: &Heat<'_>, hover: &Hover) -> DrawResult {
    let columns = heat.layout.count[0].max(1);
    let look_alike = 0.02 * (heat.range[1] - heat.range[0]).abs();
    for (j, row) in heat.values.chunks(columns).enumerate() {
        let mut i = 0;
        while let Some(value) = row.get(i) {
            let text = fixed(*value, heat.decimals);
            let alike = row.iter().skip(i).take_while(|v| {
                v.is_finite() == value.is_finite()
                    && fixed(**v, heat.decimals) == text
                    && !((**v - value).abs() > look_alike)
            });
            let end = i + alike.count().max(1);
            if value.is_finite() {
                hover.set(text);
                let corners = [(i, j), (end, j + 1)].map(|(i, j)| heat.place((i as f64, j as f64)));
                plot.draw(&Rectangle::new(corners, heat.colour(*value).filled()))?;
            }
            i = end;
        }
    }
    Ok(())
}

/// The areas between contours, each over the one below it, so that there are no seams.
fn areas(plot: &Plot<'_>, heat: &Heat<'_>, hover: &Hover) -> DrawResult {
    let grid = heat.grid();
    for (k, (from, colour)) in heat.bands().into_iter().enumerate() {
        let level = if k == 0 { f64::NEG_INFINITY } else { from };
        let outline = joined(&grid.region(level));
        if outline.len() > 2 {
            let outline: Vec<_> = outline.into_iter().map(|p| heat.place(p)).collect();
            hover.set(format!("from {}", fixed(from, heat.decimals)));
            plot.draw(&Polygon::new(outline, colour.filled()))?;
        }
    }
    Ok(())
}

fn contours(plot: &Plot<'_>, heat: &Heat<'_>) -> DrawResult {
    let grid = heat.grid();
    for level in heat.levels() {
        for line in grid.lines(level) {
            let line: Vec<_> = line.into_iter().map(|p| heat.place(p)).collect();
            plot.draw(&PathElement::new(line, stroke(ink::MARK, 5)))?;
        }
    }
    Ok(())
}

fn heat_ticks(sheet: &Sheet<'_>, plot: &Plot<'_>, ends: [[f64; 2]; 2]) -> DrawResult {
    let [[left, right], [low, high]] = ends;
    x_labels(sheet, plot, ticks(left, right, 5))?;
    let (zs, decimals) = ticks(low, high, 4);
    for z in zs {
        let (x, at) = plot.map_coordinate(&(left, z));
        let place = (x - 6 * UNIT, at);
        label(sheet, fixed(z, decimals), place, HPos::Right, VPos::Center)?;
    }
    Ok(())
}

/// The bar at the right that says which colour is which value.
fn colour_scale(sheet: &Sheet<'_>, heat: &Heat<'_>, (width, height): (u32, u32)) -> DrawResult {
    const STEPS: i32 = 32;
    let [_, right, top, bottom] = HEAT_MARGINS;
    let [low, high] = heat.range;
    let margins = [width as i32 - right + 14, right - 24, top, bottom];
    let bar = plot(sheet, margins, [0.0, 1.0], heat.range);
    let step = (high - low) / f64::from(STEPS);
    let smooth = (0..STEPS).map(|i| {
        let from = low + step * f64::from(i);
        (from, heat.colour(from + 0.5 * step))
    });
    let colours: Vec<(f64, RGBColor)> = match heat.style {
        MapStyle::Contours => heat.bands(),
        _ => smooth.collect(),
    };
    for (k, (from, colour)) in colours.iter().enumerate() {
        let to = colours.get(k + 1).map_or(high, |(to, _)| *to);
        bar.draw(&Rectangle::new([(0.0, *from), (1.0, to)], colour.filled()))?;
    }
    let (values, decimals) = ticks(low, high, (height / 32) as usize);
    for value in values {
        let (x, at) = bar.map_coordinate(&(1.0, value));
        let place = (x + 5 * UNIT, at);
        label(
            sheet,
            fixed(value, decimals),
            place,
            HPos::Left,
            VPos::Center,
        )?;
    }
    Ok(())
}

/// The values of the first and last colour for `values`, and the largest size among them, which is
/// beyond the end where a few cells would leave all others in one colour. A scale of sizes begins at
/// zero unless all of them are far from it; one of signs is symmetric.
pub(in crate::report) fn heat_range(values: &[f64], signed: bool) -> ([f64; 2], f64) {
    let finite = values.iter().copied().filter(|v| v.is_finite());
    let mut sizes: Vec<f64> = finite.map(f64::abs).collect();
    sizes.sort_unstable_by(f64::total_cmp);
    let largest = sizes.last().copied().unwrap_or(0.0);
    let median = super::super::statistics::percentile(&sizes, 50.0);
    let limit = if largest > 10.0 * median && median > 0.0 {
        5.0 * median
    } else {
        largest
    };
    let high = above(limit);
    if signed {
        return ([-high, high], largest);
    }
    let least = sizes.first().copied().unwrap_or(0.0);
    if least > 0.5 * limit && limit > least {
        let step = |(t, _): (Vec<f64>, usize)| match t.as_slice() {
            [a, b, ..] => b - a,
            _ => 1.0,
        };
        let step = step(ticks(least, limit, 4));
        let ends = [(least / step).floor(), (limit / step).ceil()];
        return (ends.map(|e| e * step), largest);
    }
    ([0.0, high], largest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_round_and_hold_the_values() {
        assert_eq!(heat_range(&[0.2, 3.7], false), ([0.0, 4.0], 3.7));
        assert_eq!(heat_range(&[-0.2, 3.7], true), ([-4.0, 4.0], 3.7));
        let (range, _) = heat_range(&[903.0, 988.0, f64::NAN], false);
        assert_eq!(range, [900.0, 1000.0]);
        // One cell of a hundred must not leave the others in one colour.
        let mut values = vec![1.0; 100];
        values[3] = 200.0;
        let (range, largest) = heat_range(&values, false);
        assert_eq!((range, largest), ([0.0, 5.0], 200.0));
        assert_eq!(heat_range(&[], false).0, [0.0, 1.0]);
    }

    #[test]
    fn cells_and_contours_stay_small() {
        let layout = Layout {
            origin_m: [-4.0, 0.0],
            size_m: [0.5; 2],
            count: [16, 8],
            few: 1,
        };
        let value = |k: usize| ((k % 16) as f64 * 0.3).sin() + (k / 16) as f64 * 0.2;
        let mut values: Vec<f64> = (0..128).map(value).collect();
        values[5] = f64::NAN;
        let (range, _) = heat_range(&values, true);
        let draw = |style| {
            let heat = Heat {
                layout,
                values: &values,
                range,
                signed: true,
                decimals: 2,
                style,
            };
            heat_map(&heat, 341, "a map").svg()
        };
        let cells = draw(MapStyle::Cells);
        assert!(cells.matches("<title>").count() > 100);
        let contours = draw(MapStyle::Contours);
        assert!(contours.matches("<title>from").count() >= 5);
        assert!(contours.len() < cells.len(), "{}", contours.len());
        assert!(draw(MapStyle::Both).len() > cells.len());
        assert!(!cells.contains("NaN") && !contours.contains("NaN"));
    }
}
