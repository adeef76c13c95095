//! A map of predicted standard deviations as a page.

use super::axis::AXES;
use super::figure::{self, Heat};
use super::number::fixed;
use super::workspace::{CELL_AXES, Cell, Cells};
use maud::{DOCTYPE, PreEscaped, html};

/// The page of a map whose cells hold standard deviations (m and rad) as they hold errors elsewhere;
/// `conditions` says what was assumed.
pub fn page(title: &str, conditions: &str, cells: &Cells) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width,initial-scale=1";
                title { (title) }
                style { (PreEscaped(include_str!("page.css"))) }
            }
            body {
                main {
                    h1 { (title) }
                    p {
                        "Least standard deviation of each component that a single scan allows; "
                        (conditions) ". y to the right, z up, m."
                    }
                    div class="three" {
                        @for (k, axis) in CELL_AXES.iter().take(4).filter_map(|a| AXES.get(*a)).enumerate() {
                            @let value = |cell: &Cell| cell.rms(k) * axis.factor;
                            @let values: Vec<f64> =
                                cells.cells.iter().filter(|c| c.n > 0).map(value).collect();
                            @let (limit, largest) = figure::heat_limit(&values);
                            @let heat = Heat {
                                layout: cells.layout,
                                cells: cells.cells.iter().enumerate().filter(|(_, c)| c.n > 0).collect(),
                                value: &value,
                                limit,
                                signed: false,
                                decimals: axis.decimals,
                            };
                            div {
                                h3 { (axis.name) ", " (axis.symbol) }
                                @if largest > limit * (1.0 + 1e-9) {
                                    p { "up to " (fixed(largest, axis.decimals)) " beyond the scale" }
                                }
                                (PreEscaped(figure::heat_map(
                                    &heat,
                                    341,
                                    &format!("standard deviation of {} over the workspace", axis.name),
                                )))
                            }
                        }
                    }
                }
            }
        }
    };
    let mut text = page.into_string();
    text.push('\n');
    text
}
