//! Curves over one scale or over two logarithmic ones.

use super::super::canvas::{DrawResult, Drawing, Sheet, UNIT, figure, ink};
use super::super::number::fixed;
use super::super::scale::{above, ticks};
use super::{PLOT_MARGINS, Plot, Series, axes, label, line, plot, stroke};
use plotters::element::PathElement;
use plotters::style::text_anchor::{HPos, VPos};

/// A place along x that a curve is marked at.
pub(in crate::report) struct Mark {
    /// Where.
    pub x: f64,
    /// What is there.
    pub text: String,
}

/// A curve that begins at zero height, with a mark.
pub(in crate::report) fn curve(
    points: &[(f64, f64)],
    mark: Option<&Mark>,
    size: (u32, u32),
    label_text: &str,
) -> Drawing {
    figure(size, label_text, |sheet, hover| {
        let xs = || points.iter().map(|p| p.0);
        let low = xs().fold(f64::INFINITY, f64::min);
        let high = xs().fold(f64::NEG_INFINITY, f64::max);
        let (low, high) = if low < high { (low, high) } else { (0.0, 1.0) };
        let top = above(1.02 * super::largest(points.iter().map(|p| p.1)));
        let plot = plot(sheet, PLOT_MARGINS, [low, high], [0.0, top]);
        axes(
            sheet,
            &plot,
            ticks(low, high, size.0 as usize / 70),
            ticks(0.0, top, 4),
        )?;
        if let Some(mark) = mark.filter(|m| m.x >= low && m.x <= high) {
            marked(sheet, &plot, mark, [low, high], top)?;
        }
        hover.set(label_text.to_owned());
        plot.draw(&PathElement::new(points.to_vec(), stroke(ink::OTHER, 14)))
    })
}

/// A dashed line up from the scale, its text beside its upper end where there is room.
fn marked(
    sheet: &Sheet<'_>,
    plot: &Plot<'_>,
    mark: &Mark,
    [low, high]: [f64; 2],
    top: f64,
) -> DrawResult {
    const DASHES: i32 = 24;
    for i in 0..DASHES {
        let y = |part: f64| top * (f64::from(i) + part) / f64::from(DASHES);
        let dash = [(mark.x, y(0.0)), (mark.x, y(0.5))];
        plot.draw(&PathElement::new(dash, line(ink::MARK)))?;
    }
    let (x, y) = plot.map_coordinate(&(mark.x, top));
    let right = mark.x < 0.5 * (low + high);
    let (place, anchor) = if right {
        (x + 6 * UNIT, HPos::Left)
    } else {
        (x - 6 * UNIT, HPos::Right)
    };
    label(sheet, mark.text.clone(), (place, y), anchor, VPos::Top)
}

/// Lines over two logarithmic scales, with a grid at the powers of ten.
pub(in crate::report) fn log_log(series: &[Series], size: (u32, u32), label_text: &str) -> Drawing {
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
            let across = vec![(x[0], at), (x[1], at)];
            plot.draw(&PathElement::new(across, line(ink::GRID)))?;
            let (left, height) = plot.map_coordinate(&(x[0], at));
            let place = (left - 6 * UNIT, height);
            label(sheet, power_of_ten(power), place, HPos::Right, VPos::Center)?;
        }
        for power in decades(x) {
            let at = f64::from(power);
            let up = vec![(at, y[0]), (at, y[1])];
            plot.draw(&PathElement::new(up, line(ink::GRID)))?;
            let (left, bottom) = plot.map_coordinate(&(at, y[0]));
            let place = (left, bottom + 7 * UNIT);
            label(sheet, power_of_ten(power), place, HPos::Center, VPos::Top)?;
        }
        for Series {
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
