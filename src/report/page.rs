//! The report as one page: no script, nothing fetched, the same bytes for the same input.
//!
//! Its size does not depend on the run's length: figures are made from what a [`Case`] keeps.

use super::axis::{AXES, Axis, POSITION};
use super::canvas::Drawing;
use super::case::{AxisResult, Case, Report};
use super::consistency::Consistency;
use super::figure::{self, Heat};
use super::inertial::outputs;
use super::number::{NONE, change, count, fixed};
use super::picture::Figure;
use super::terminal::{ComparisonRow, comparison_rows, matching_line, run_line};
use super::workspace::{CELL_AXES, Cell, Cells};
use maud::{DOCTYPE, Markup, PreEscaped, html};

/// Share of scans below which the card for solved scans is coloured, percent.
const SOLVED_LIMIT_PCT: f64 = 99.0;
/// Cases that get figures of their own; further ones are in the tables.
const DRAWN: usize = 4;
/// Status rows shown; the rest is summed up.
const STATUSES: usize = 12;

/// The whole page.
pub fn write(report: &Report) -> String {
    let one = report.cases.len() == 1;
    let posed = !report.cases.is_empty();
    let body = html! {
        h1 { (report.title) }
        (provenance_line(report))
        @if let [case] = report.cases.as_slice() { (cards(case)) }
        @if posed && !one { h2 { "Side by side" } (comparison(&report.cases)) }
        @if !report.verdicts.is_empty() { (gates(report)) }
        @if posed {
            h2 { "Errors" }
            @for case in &report.cases {
                @if !one { h3 { (case.name()) } }
                (error_table(case))
            }
            (workspace(&report.cases))
            (over_time(&report.cases))
            (distributions(&report.cases))
            h2 { "Covariances" }
            p {
                "Mean of the squared error over its variance, per degree of freedom (1 is honest, \
                 above is too confident), with the 95 % band for the effective number of \
                 independent poses; share of errors within 1, 2 and 3 σ."
            }
            @for case in &report.cases {
                @if !one { h3 { (case.name()) } }
                (consistency_table(case))
            }
            h2 { "Scans" }
            @for case in &report.cases {
                @if !one { h3 { (case.name()) } }
                (scan_table(case))
            }
        }
        @if let Some(inertial) = &report.inertial { (outputs::section(inertial)) }
        (how(report))
    };
    document(&report.title, &body)
}

/// A page around `body` with the style of every page: nothing is fetched, no script runs.
pub(super) fn document(title: &str, body: &Markup) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width,initial-scale=1";
                title { (title) }
                style { (PreEscaped(include_str!("page.css"))) }
            }
            body { main { (body) } }
        }
    };
    let mut text = page.into_string();
    text.push('\n');
    text
}

fn provenance_line(report: &Report) -> Markup {
    html! {
        @for (i, case) in report.cases.iter().enumerate() {
            p {
                @if report.cases.len() > 1 { (case.name()) ": " }
                "measured against " (report.role) " (" (report.reference_source) ") · "
                (run_line(case)) " · " (matching_line(report, case))
                @if i + 1 == report.cases.len() {
                    " · report " (env!("CARGO_PKG_VERSION"))
                    @if let Some(date) = &report.date { ", " (date) }
                }
            }
        }
    }
}

/// A number with its unit: "2.00 mm", "0.031°".
fn quantity(value: f64, axis: &Axis) -> String {
    let text = fixed(value * axis.factor, axis.decimals);
    match axis.symbol {
        "°" => format!("{text}°"),
        symbol => format!("{text} {symbol}"),
    }
}

fn cards(case: &Case) -> Markup {
    let size = |index: usize, title: &str| {
        let axis = &AXES[index];
        let s = case.axes.get(index).map(|a| a.statistics);
        let value = |v: Option<f64>| quantity(v.unwrap_or(f64::NAN), axis);
        let below = if index == POSITION {
            format!("95 % below {}", value(s.map(|s| s.p95)))
        } else {
            let bias = s.map_or(f64::NAN, |s| s.bias * axis.factor);
            format!(
                "bias {}, max {}",
                fixed(bias, axis.decimals),
                value(s.map(|s| s.max))
            )
        };
        card(title, &value(s.map(|s| s.rms)), &below, "")
    };
    let nees = case.groups.first();
    let (value, below, class) = match nees.filter(|c| c.n > 0) {
        None => (NONE.to_owned(), "no covariances".to_owned(), ""),
        Some(c) => (
            fixed(c.nees, 2),
            format!("95 % band {} … {}", fixed(c.low, 2), fixed(c.high, 2)),
            if c.is_honest() == Some(true) {
                "good"
            } else {
                "warn"
            },
        ),
    };
    let scans = &case.scans;
    let without = scans.refused() + scans.lost;
    let total = count(scans.rows + scans.lost);
    let (solved, below_solved) = if scans.solved_pct() < SOLVED_LIMIT_PCT {
        let limit = fixed(SOLVED_LIMIT_PCT, 0);
        (
            "warn",
            format!("below {limit} %: {} without", count(without)),
        )
    } else {
        ("", format!("{} of {total} without a pose", count(without)))
    };
    html! {
        div class="cards" {
            (size(POSITION, "position error, rms"))
            (size(0, "x error, rms"))
            (size(5, "yaw error, rms"))
            (card("NEES of x and yaw, per dof", &value, &below, class))
            (card(
                "scans solved",
                &format!("{} %", fixed(scans.solved_pct(), if without == 0 { 0 } else { 1 })),
                &below_solved,
                solved,
            ))
        }
    }
}

fn card(title: &str, value: &str, below: &str, class: &str) -> Markup {
    html! {
        div class="card" { span { (title) } b class=[Some(class).filter(|c| !c.is_empty())] { (value) } span { (below) } }
    }
}

fn error_table(case: &Case) -> Markup {
    let titles = [
        "n", "bias", "std", "rms", "median", "MAD", "p95", "p99", "max",
    ];
    html! {
        table {
            thead { tr { th { "axis" } @for title in titles { th { (title) } } th class="spark" { "over the run" } } }
            tbody {
                @for (axis, result) in AXES.iter().zip(&case.axes) {
                    @let s = result.statistics.scaled(axis.factor);
                    tr {
                        td { (axis.name) ", " (axis.symbol) }
                        td { (count(s.n)) }
                        @for value in [s.bias, s.std, s.rms, s.median, s.mad, s.p95, s.p99, s.max] {
                            td { (fixed(value, axis.decimals)) }
                        }
                        td { (PreEscaped(figure::sparkline(&result.trace.means(100)).svg())) }
                    }
                }
            }
        }
    }
}

/// A figure with its title at the left and its unit at the right.
fn titled(title: &str, unit: &str, drawing: Drawing) -> Markup {
    Figure::new(title, title, unit, drawing).markup()
}

/// What one heat map shows.
struct Map {
    title: &'static str,
    unit: &'static str,
    signed: bool,
    decimals: usize,
    /// Maps with the same family share one scale.
    family: usize,
    value: fn(&Cell) -> f64,
}

fn maps() -> [Map; 6] {
    fn in_unit(cell: &Cell, k: usize, signed: bool) -> f64 {
        let value = if signed { cell.bias(k) } else { cell.rms(k) };
        value * AXES[CELL_AXES[k]].factor
    }
    let map = |title, unit, family, value| Map {
        title,
        unit,
        signed: false,
        decimals: 2,
        family,
        value,
    };
    [
        map("x error, rms", "mm", 0, |c| in_unit(c, 0, false)),
        Map {
            signed: true,
            ..map("Bias in x", "mm", 1, |c| in_unit(c, 0, true))
        },
        Map {
            decimals: 3,
            ..map("Yaw error, rms", "°", 2, |c| in_unit(c, 3, false))
        },
        map("y error, rms", "mm", 3, |c| in_unit(c, 1, false)),
        map("z error, rms", "mm", 3, |c| in_unit(c, 2, false)),
        Map {
            decimals: 0,
            ..map("Poses", "count", 4, |c| f64::from(c.n))
        },
    ]
}

/// Cells of the heat maps of one page, whatever the number of maps.
const PAGE_CELLS: usize = 1200;

fn workspace(cases: &[Case]) -> Markup {
    let drawn: Vec<&Case> = cases.iter().filter(|c| !c.is_empty()).take(DRAWN).collect();
    let maps = maps();
    // Several runs show the first row of maps each, on common scales.
    let shown = if drawn.len() > 1 { 3 } else { 6 };
    let room = PAGE_CELLS / (shown * drawn.len().max(1));
    let cells: Vec<(String, Cells)> = drawn
        .iter()
        .filter_map(|c| Some((c.name(), c.cells.as_ref()?.within(room))))
        .collect();
    if cells.iter().all(|(_, c)| c.filled().count() < 2) {
        return html! {};
    }
    let own = |cells: &Cells, family: usize| {
        let alike = maps.iter().filter(|m| m.family == family);
        let values = alike.flat_map(|m| cells.filled().map(|(_, cell)| (m.value)(cell)));
        figure::heat_limit(&values.collect::<Vec<f64>>())
    };
    // Runs share a scale where they are alike; a run that fails by metres would blind the others.
    let limit = |cells_of: &Cells, family: usize| {
        let limits = || cells.iter().map(|(_, c)| own(c, family).0);
        let (low, high) = limits().fold((f64::INFINITY, 0.0f64), |(l, h), v| (l.min(v), h.max(v)));
        let (limit, largest) = own(cells_of, family);
        (if high <= 4.0 * low { high } else { limit }, largest)
    };
    let few = cells.iter().map(|(_, c)| c.layout.few).max().unwrap_or(1);
    let size = cells.first().map_or([0.0; 2], |(_, c)| c.layout.size_m);
    html! {
        h2 { "Over the workspace" }
        p {
            "y to the right, z up, m; cells of " (fixed(size[0], 2)) " by " (fixed(size[1], 2)) " m"
            @if few > 1 { ", empty with fewer than " (few) " poses" }
            "."
        }
        @for (name, cells) in &cells {
            @if cases.len() > 1 { h3 { (name) } }
            div class="three" {
                @for map in maps.iter().take(shown) {
                    @let (end, largest) = limit(cells, map.family);
                    @let heat = Heat {
                        layout: cells.layout,
                        cells: cells.filled().collect(),
                        value: &map.value,
                        limit: end,
                        signed: map.signed,
                        decimals: map.decimals,
                    };
                    @let unit = if largest > end * (1.0 + 1e-9) {
                        format!("{}, up to {} beyond the scale", map.unit, fixed(largest, 0))
                    } else {
                        map.unit.to_owned()
                    };
                    @let label = format!("{} over the workspace, {name}", map.title);
                    (titled(map.title, &unit, figure::heat_map(&heat, 341, &label)))
                }
            }
        }
    }
}

fn over_time(cases: &[Case]) -> Markup {
    let drawn: Vec<&Case> = cases.iter().filter(|c| !c.is_empty()).take(DRAWN).collect();
    let several = cases.len() > 1;
    let axes: &[usize] = if several { &[0, 5] } else { &[1, 2, 3, 4] };
    let limit = |result: &AxisResult| figure::trace_limit(&result.trace, &result.statistics);
    html! {
        @if !drawn.is_empty() { h2 { "Over time" } }
        @for case in &drawn {
            @if several { h3 { (case.name()) } }
            @if !several {
                @for index in [0, 5] {
                    @if let Some(result) = case.axes.get(index).filter(|a| a.statistics.n > 0) {
                        div style="margin-top:12px" { (time_figure(index, result, limit(result), (1072, 190))) }
                    }
                }
            }
            div class="two" style="margin-top:14px" {
                @for index in axes {
                    @if let Some(result) = case.axes.get(*index).filter(|a| a.statistics.n > 0) {
                        (time_figure(*index, result, limit(result), (524, 150)))
                    }
                }
            }
        }
    }
}

fn time_figure(
    index: usize,
    result: &AxisResult,
    (limit, beyond): (f64, usize),
    size: (u32, u32),
) -> Markup {
    let axis = &AXES[index];
    let banded = result.consistency.n > 0;
    let title = if banded {
        format!("Error in {}, with the solver’s ±3σ", axis.name)
    } else {
        format!("Error in {}", axis.name)
    };
    let mut unit = format!("{}, time in s", axis.symbol);
    if beyond > 0 {
        unit = format!("cut at {}; {unit}", quantity(limit, axis));
    }
    titled(
        &title,
        &unit,
        figure::over_time(&result.trace, axis, limit, size, &title),
    )
}

fn distributions(cases: &[Case]) -> Markup {
    let drawn: Vec<&Case> = cases.iter().filter(|c| !c.is_empty()).take(DRAWN).collect();
    let several = cases.len() > 1;
    let axes: &[usize] = if several {
        &[0, 2, 5]
    } else {
        &[0, 1, 2, 3, 4, 5]
    };
    html! {
        @if !drawn.is_empty() {
            h2 { "Distribution" }
            p { "Counts of errors by size; the line is the normal curve of the same bias and standard deviation." }
        }
        @for case in &drawn {
            @if several { h3 { (case.name()) } }
            div class="three" {
                @for index in axes {
                    @if let Some(result) = case.axes.get(*index).filter(|a| a.statistics.n > 0) {
                        @let axis = &AXES[*index];
                        @let title = format!("Error in {}", axis.name);
                        @let beyond = result.histogram.beyond;
                        @let unit = if beyond > 0 { format!("{}; {} beyond", axis.symbol, count(beyond as usize)) } else { axis.symbol.to_owned() };
                        (titled(&title, &unit, figure::histogram(&result.histogram, &result.statistics, axis, (341, 140), &format!("Distribution of the error in {}", axis.name))))
                    }
                }
            }
        }
    }
}

fn consistency_table(case: &Case) -> Markup {
    let singles = AXES.iter().zip(&case.axes).take(6);
    let singles = singles.map(|(axis, a)| (axis.name, a.consistency, Some(a.within)));
    let names = ["x and yaw", "position", "whole pose"];
    let groups = names
        .into_iter()
        .zip(&case.groups)
        .map(|(name, c)| (name, *c, None));
    let rows: Vec<(&str, Consistency, Option<[f64; 3]>)> = singles.chain(groups).collect();
    if rows.iter().all(|(_, c, _)| c.n == 0) {
        return html! { p { "The poses carry no covariances." } };
    }
    html! {
        table {
            thead {
                tr {
                    th { "component" } th { "n" } th { "effective n" } th { "NEES per dof" } th { "95 % band" }
                    th { "within 1σ (68.3 %)" } th { "2σ (95.4 %)" } th { "3σ (99.7 %)" }
                }
            }
            tbody {
                @for (name, c, within) in rows.iter().filter(|(_, c, _)| c.n > 0) {
                    tr {
                        td { (name) }
                        td { (count(c.n)) }
                        td { (fixed(c.effective_n, 0)) }
                        td class=(if c.is_honest() == Some(true) { "good" } else { "warn" }) { (fixed(c.nees, 2)) }
                        td { (fixed(c.low, 2)) " … " (fixed(c.high, 2)) }
                        @for k in 0..3 {
                            td { @if let Some(share) = within { (fixed(100.0 * share[k], 1)) " %" } }
                        }
                    }
                }
            }
        }
    }
}

fn scan_table(case: &Case) -> Markup {
    let scans = &case.scans;
    let total = scans.rows + scans.lost;
    let rest: usize = scans.statuses.iter().skip(STATUSES).map(|t| t.count).sum();
    let shown = scans.statuses.iter().take(STATUSES);
    let mut rows: Vec<(String, bool, usize)> = shown
        .map(|t| (t.status.clone(), t.solved, t.count))
        .collect();
    if rest > 0 {
        rows.push(("other statuses".to_owned(), false, rest));
    }
    if scans.lost > 0 {
        rows.push((
            "no row: the sequence numbers skip it".to_owned(),
            false,
            scans.lost,
        ));
    }
    let spreads = [("strip edges used", scans.edges), ("votes", scans.votes)];
    html! {
        p {
            (count(scans.solved)) " of " (count(total)) " scans solved ("
            (fixed(scans.solved_pct(), 2)) " %), " (count(scans.refused())) " refused, "
            (count(scans.lost)) " lost"
            @if scans.partial > 0 { "; " (count(scans.partial)) " lack a component" }
            @for (what, spread) in spreads {
                @if let Some(s) = spread.filter(|s| s.max > 0) {
                    "; " (what) " " (s.min) " to " (s.max) ", mean " (fixed(s.mean, 1))
                }
            }
            "."
        }
        table {
            thead { tr { th { "status" } th { "pose" } th { "scans" } th { "share" } th {} } }
            tbody {
                @for (status, solved, n) in &rows {
                    @let share = 100.0 * *n as f64 / total.max(1) as f64;
                    tr {
                        td { (status) }
                        td { (if *solved { "yes" } else { "no" }) }
                        td { (count(*n)) }
                        td { (fixed(share, 2)) " %" }
                        td class="wide" style="width:40%" {
                            span class=(if *solved { "bar" } else { "bar no" }) style=(format!("width:{:.1}%", share.max(0.3))) {}
                        }
                    }
                }
            }
        }
    }
}

fn comparison(cases: &[Case]) -> Markup {
    let rows = comparison_rows();
    html! {
        table {
            thead {
                tr {
                    th { "statistic" }
                    @for (i, case) in cases.iter().enumerate() {
                        th { (case.name()) }
                        @if i > 0 { th { "change" } }
                    }
                }
            }
            tbody {
                @for row in &rows {
                    @let first = cases.first().map_or(f64::NAN, |c| (row.value)(c));
                    tr {
                        td { (row.title) }
                        @for (i, case) in cases.iter().enumerate() {
                            @let value = (row.value)(case);
                            td { (fixed(value, row.decimals)) }
                            @if i > 0 { td class=[better(row, first, value)] { (change(first, value)) } }
                        }
                    }
                }
            }
        }
    }
}

/// The class of a change by more than a hundredth, where smaller is better.
fn better(row: &ComparisonRow, first: f64, value: f64) -> Option<&'static str> {
    if !row.smaller_is_better {
        None
    } else if value < 0.99 * first {
        Some("good")
    } else if value > 1.01 * first {
        Some("warn")
    } else {
        None
    }
}

fn gates(report: &Report) -> Markup {
    html! {
        h2 { "Limits" }
        table {
            thead { tr { th { "condition to fail" } th { "run" } th { "value" } th { "verdict" } } }
            tbody {
                @for v in &report.verdicts {
                    tr {
                        td { (v.gate) }
                        td { (v.case) }
                        td { (v.value.map_or(NONE.to_owned(), |x| fixed(x, 4))) }
                        td class=(if v.failed { "warn" } else { "good" }) {
                            @if v.failed && v.value.is_some() { "failed by " (fixed(v.excess, 4)) }
                            @else if v.failed { "failed: no value" }
                            @else { "passed" }
                        }
                    }
                }
            }
        }
    }
}

/// Where the numbers come from: the chain of commands, what went wrong on the way, definitions.
fn how(report: &Report) -> Markup {
    let notes = || {
        report
            .cases
            .iter()
            .flat_map(|c| c.notes.iter().map(move |n| (c, n)))
    };
    html! {
        @if notes().next().is_some() {
            h2 { "Notes" }
            ul {
                @for (case, note) in notes() {
                    li { @if report.cases.len() > 1 { (case.name()) ": " } (note) }
                }
            }
        }
        h2 { "How it was made" }
        @for (i, case) in report.cases.iter().enumerate() {
            @let repeated = report.cases.iter().take(i).any(|c| c.run == case.run);
            @if !repeated {
                @for stage in &case.stages { code { (stage) } }
            }
        }
        code { (report.command) }
        @if !report.cases.is_empty() { p {
            "An error is measured minus " (report.role) ", angles the short way round. std is about the bias, \
             with n − 1; MAD is the median of |e − median|, not scaled; p95, p99 and max are of |e|, percentiles \
             linear between order statistics (numpy’s default); position is the distance."
        } }
    }
}
