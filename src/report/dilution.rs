//! A map of predicted standard deviations as a page.

use super::axis::{AXES, Axis};
use super::figure::{self, Heat, MapStyle, THIRD};
use super::number::fixed;
use super::page;
use super::picture::Figure;
use super::workspace::{CELL_AXES, Cell, Cells};
use maud::html;

/// The page of a map whose cells hold standard deviations (m and rad) as they hold errors elsewhere;
/// `conditions` says what was assumed.
pub fn page(title: &str, conditions: &str, cells: &Cells) -> String {
    let figures: Vec<Figure> = figures(cells);
    let body = html! {
        h1 { (title) }
        p {
            "Least standard deviation of each component that a single scan allows; "
            (conditions) ". y to the right, z up, m."
        }
        div class="three" { @for figure in &figures { (figure.markup()) } }
    };
    page::document(title, &body)
}

/// The map of each component.
pub(super) fn figures(cells: &Cells) -> Vec<Figure> {
    let axes = CELL_AXES
        .iter()
        .take(4)
        .filter_map(|a| AXES.get(*a))
        .enumerate();
    let figure = |(k, axis): (usize, &Axis)| {
        let value = |cell: &Cell| cell.rms(k) * axis.factor;
        let values: Vec<f64> = cells
            .cells
            .iter()
            .map(|c| if c.n > 0 { value(c) } else { f64::NAN })
            .collect();
        let (range, largest) = figure::heat_range(&values, false);
        let heat = Heat {
            layout: cells.layout,
            values: &values,
            range,
            signed: false,
            decimals: axis.decimals,
            style: MapStyle::Cells,
        };
        let mut unit = axis.symbol.to_owned();
        if largest > range[1] * (1.0 + 1e-9) {
            let largest = fixed(largest, axis.decimals);
            unit = format!("{unit}, up to {largest} beyond the scale");
        }
        let label = format!("standard deviation of {} over the workspace", axis.name);
        Figure::new(
            &format!("sigma-{}", axis.name),
            format!("{}, standard deviation", axis.name),
            unit,
            figure::heat_map(&heat, THIRD, &label),
        )
    };
    axes.map(figure).collect()
}
