//! Points beside one another: means with the band they should lie in, and shares of errors within
//! 1, 2 and 3 sigma.

use super::super::canvas::{DrawResult, Drawing, Sheet, UNIT, figure, ink};
use super::super::number::fixed;
use super::{PLOT_MARGINS, Plot, TRIPLE, axes, label, line, plot, stroke};
use plotters::element::{Circle, PathElement};
use plotters::style::Color;
use plotters::style::text_anchor::{HPos, VPos};

/// A value with the band in which it should lie.
pub(in crate::report) struct Interval {
    /// Whose it is.
    pub name: String,
    /// The value.
    pub value: f64,
    /// The band's ends.
    pub band: [f64; 2],
}

/// Radius of a point, units.
const RADIUS: i32 = 35;
/// A value below this is of a component that was given, not measured; it stands at the lower end.
const MODEST: f64 = 0.03;

/// Values about 1 on a scale by ratio, each with its band; those outside are in the second colour.
pub(in crate::report) fn intervals(
    values: &[Interval],
    size: (u32, u32),
    label_text: &str,
) -> Drawing {
    figure(size, label_text, |sheet, hover| {
        let all = values
            .iter()
            .flat_map(|v| [v.value, v.band[0], v.band[1]])
            .filter(|v| *v > MODEST && v.is_finite());
        let reach = all.map(|v| v.log10().abs()).fold(0.0, f64::max);
        // From 0.5 to 2 at least.
        let reach = (1.1 * reach).clamp(0.302, 4.0);
        let end = values.len().max(1) as f64;
        let plot = plot(sheet, PLOT_MARGINS, [0.0, end], [-reach, reach]);
        for tick in [
            1e-4, 1e-3, 0.01, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 1e2, 1e3, 1e4,
        ] {
            let at = f64::log10(tick);
            let near = reach <= 1.0 || (at - at.round()).abs() < 1e-9;
            if at.abs() > reach + 1e-9 || !near {
                continue;
            }
            let style = if tick == 1.0 {
                stroke(ink::MARK, UNIT as u32 / 2)
            } else {
                line(ink::GRID)
            };
            plot.draw(&PathElement::new([(0.0, at), (end, at)], style))?;
            let (left, y) = plot.map_coordinate(&(0.0, at));
            let decimals = usize::try_from(-(at.floor() as i32)).unwrap_or(0);
            let place = (left - 6 * UNIT, y);
            label(
                sheet,
                fixed(tick, decimals),
                place,
                HPos::Right,
                VPos::Center,
            )?;
        }
        for (i, value) in values.iter().enumerate() {
            let x = i as f64 + 0.5;
            name_below(sheet, &plot, (x, -reach), &value.name)?;
            let at = |v: f64| v.max(1e-9).log10().clamp(-reach, reach);
            let [low, high] = value.band;
            if low.is_finite() && high.is_finite() {
                let ends = [(x, at(low)), (x, at(high))];
                plot.draw(&PathElement::new(ends, stroke(ink::BAND, 120)))?;
            }
            if !value.value.is_finite() {
                continue;
            }
            let inside = value.value >= low && value.value <= high;
            let colour = if inside { ink::SERIES } else { ink::OTHER };
            hover.set(format!(
                "{}: {}, band {} to {}",
                value.name,
                fixed(value.value, 2),
                fixed(low, 2),
                fixed(high, 2)
            ));
            plot.draw(&Circle::new((x, at(value.value)), RADIUS, colour.filled()))?;
        }
        Ok(())
    })
}

/// The shares of a normal distribution within 1, 2 and 3 sigma, percent.
const NORMAL: [f64; 3] = [68.27, 95.45, 99.73];

/// The shares (0 to 1) of the errors within 1, 2 and 3 sigma, beside those of the normal
/// distribution.
pub(in crate::report) fn coverage(
    shares: &[(String, [f64; 3])],
    size: (u32, u32),
    label_text: &str,
) -> Drawing {
    figure(size, label_text, |sheet, hover| {
        let end = shares.len().max(1) as f64;
        let plot = plot(sheet, PLOT_MARGINS, [0.0, end], [0.0, 105.0]);
        let grid = vec![0.0, 20.0, 40.0, 60.0, 80.0, 100.0];
        axes(sheet, &plot, (Vec::new(), 0), (grid, 0))?;
        for (normal, colour) in NORMAL.into_iter().zip(TRIPLE) {
            let across = [(0.0, normal), (end, normal)];
            plot.draw(&PathElement::new(across, line(colour)))?;
        }
        for (i, (name, within)) in shares.iter().enumerate() {
            let x = i as f64 + 0.5;
            name_below(sheet, &plot, (x, 0.0), name)?;
            for ((k, share), colour) in within.iter().enumerate().zip(TRIPLE) {
                if share.is_finite() {
                    let percent = 100.0 * share;
                    hover.set(format!("{name}: {} % within {}σ", fixed(percent, 1), k + 1));
                    plot.draw(&Circle::new((x, percent), RADIUS, colour.filled()))?;
                }
            }
        }
        Ok(())
    })
}

fn name_below(sheet: &Sheet<'_>, plot: &Plot<'_>, at: (f64, f64), name: &str) -> DrawResult {
    let (x, bottom) = plot.map_coordinate(&at);
    let place = (x, bottom + 7 * UNIT);
    label(sheet, name.to_owned(), place, HPos::Center, VPos::Top)
}
