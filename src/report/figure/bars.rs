//! Bars: how often which error or which count occurs, and one value each for a few names.

use super::super::axis::Axis;
use super::super::canvas::{DrawResult, Drawing, Hover, UNIT, figure, ink};
use super::super::number::fixed;
use super::super::scale::{above, ticks};
use super::super::statistics::Statistics;
use super::super::trace::Histogram;
use super::{PLOT_MARGINS, Plot, axes, label, line, plot};
use plotters::element::{PathElement, Rectangle};
use plotters::style::Color;
use plotters::style::text_anchor::{HPos, VPos};

/// How often which error occurs, with the normal curve of the same bias and standard deviation.
pub(in crate::report) fn histogram(
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
        bins(&plot, histogram, (limit, width), axis, hover)?;
        if s.std > 0.0 {
            let points = (0..=80).map(|i| -limit + 2.0 * limit * f64::from(i) / 80.0);
            let points: Vec<_> = points.map(|e| (e, normal(e).min(top))).collect();
            plot.draw(&PathElement::new(points, line(ink::OTHER)))?;
        }
        Ok(())
    })
}

fn bins(
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
        bar(plot, [from, from + width], f64::from(*n))?;
    }
    Ok(())
}

/// A bar of height `value`, with a little room at its sides.
fn bar(plot: &Plot<'_>, [from, to]: [f64; 2], value: f64) -> DrawResult {
    let room = 0.06 * (to - from);
    let corners = [(from + room, 0.0), (to - room, value)];
    plot.draw(&Rectangle::new(corners, ink::SERIES.mix(0.75).filled()))
}

/// How often which count occurs: `counts` by number from 0, of which the last is of that many and
/// more.
pub(in crate::report) fn counts(
    counts: &[usize],
    what: &str,
    size: (u32, u32),
    label_text: &str,
) -> Drawing {
    figure(size, label_text, |sheet, hover| {
        let filled = |n: &&usize| **n > 0;
        let first = counts.iter().position(|n| *n > 0).unwrap_or(0);
        let last = counts.len() - counts.iter().rev().take_while(|n| **n == 0).count();
        let last = last.max(first + 1);
        // More than some forty bars become groups of numbers.
        let wide = (last - first).div_ceil(41);
        let shown = counts.get(first..last).unwrap_or_default();
        let groups: Vec<usize> = shown.chunks(wide).map(|c| c.iter().sum()).collect();
        let highest = groups.iter().copied().max().unwrap_or(0) as f64;
        let top = above(1.02 * highest);
        // Some room for a single bar, which would be as wide as the plot.
        let spare = (4.0 - groups.len() as f64).max(0.0) * wide as f64;
        let from = first as f64 - 0.5 - 0.5 * spare;
        let to = (first + groups.len() * wide) as f64 - 0.5 + 0.5 * spare;
        let plot = plot(sheet, PLOT_MARGINS, [from, to], [0.0, top]);
        let (mut x, decimals) = ticks(from, to, size.0 as usize / 70);
        x.retain(|x| (x - x.round()).abs() < 1e-9 && *x >= 0.0);
        let decimals = if x.is_empty() { decimals } else { 0 };
        axes(sheet, &plot, (x, decimals), ticks(0.0, top, 4))?;
        for (i, n) in groups.iter().enumerate().filter(|(_, n)| filled(n)) {
            let low = first + i * wide;
            let high = low + wide - 1;
            let range = if wide > 1 {
                format!("{low} to {high}")
            } else {
                low.to_string()
            };
            hover.set(format!("{range} {what}: {n}"));
            let ends = [low as f64 - 0.5, high as f64 + 0.5];
            bar(&plot, ends, *n as f64)?;
        }
        Ok(())
    })
}

/// One value for each of a few names.
pub(in crate::report) fn bars(
    values: &[(String, f64)],
    decimals: usize,
    size: (u32, u32),
    label_text: &str,
) -> Drawing {
    figure(size, label_text, |sheet, hover| {
        let top = above(1.02 * super::largest(values.iter().map(|v| v.1)));
        let end = values.len().max(1) as f64;
        let plot = plot(sheet, PLOT_MARGINS, [0.0, end], [0.0, top]);
        axes(sheet, &plot, (Vec::new(), 0), ticks(0.0, top, 4))?;
        for (i, (name, value)) in values.iter().enumerate() {
            let from = i as f64;
            let (x, bottom) = plot.map_coordinate(&(from + 0.5, 0.0));
            let place = (x, bottom + 7 * UNIT);
            label(sheet, name.clone(), place, HPos::Center, VPos::Top)?;
            if value.is_finite() {
                hover.set(format!("{name}: {}", fixed(*value, decimals)));
                bar(&plot, [from + 0.2, from + 0.8], *value)?;
            }
        }
        Ok(())
    })
}
