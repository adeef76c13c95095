//! The page's tables, and the figures that show what is in them.

use super::super::axis::AXES;
use super::super::case::{Case, Report};
use super::super::consistency::Consistency;
use super::super::figure::{self, HALF, Interval};
use super::super::number::{NONE, change, count, fixed};
use super::super::picture::Figure;
use super::super::terminal::{ComparisonRow, comparison_rows_of};
use super::evaluation::more_errors;
use maud::{Markup, PreEscaped, html};

/// Status rows shown; the rest is summed up.
const STATUSES: usize = 12;

/// Statistics of every component, with its course in a few pixels.
pub(super) fn errors(case: &Case) -> Markup {
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
                        td { (PreEscaped(figure::sparkline(&result.trace.means(50)).svg())) }
                    }
                }
                @for (name, s, decimals) in more_errors(case) {
                    tr {
                        td { (name) }
                        td { (count(s.n)) }
                        @for value in [s.bias, s.std, s.rms, s.median, s.mad, s.p95, s.p99, s.max] {
                            td { (fixed(value, decimals)) }
                        }
                        td {}
                    }
                }
            }
        }
    }
}

/// The groups of components as people call them.
const GROUP_NAMES: [&str; 3] = ["x and yaw", "position", "whole pose"];

/// NEES against its band, and the shares of errors within 1, 2 and 3 sigma; none without
/// covariances.
pub(super) fn consistency_figures(case: &Case) -> Vec<Figure> {
    let singles = || AXES.iter().zip(&case.axes).take(6);
    let groups = ["x+yaw", "position", "pose"].into_iter().zip(&case.groups);
    let values = singles()
        .map(|(axis, a)| (axis.name, &a.consistency))
        .chain(groups);
    let values: Vec<Interval> = values
        .filter(|(_, c)| c.n > 0)
        .map(|(name, c)| Interval {
            name: name.to_owned(),
            value: c.nees,
            band: [c.low, c.high],
        })
        .collect();
    if values.is_empty() {
        return Vec::new();
    }
    let shares: Vec<(String, [f64; 3])> = singles()
        .filter(|(_, a)| a.consistency.n > 0)
        .map(|(axis, a)| (axis.name.to_owned(), a.within))
        .collect();
    let size = (HALF, 170);
    let nees = figure::intervals(
        &values,
        size,
        "NEES per degree of freedom with its 95 % band",
    );
    let within = figure::coverage(&shares, size, "Share of errors within 1, 2 and 3 sigma");
    vec![
        Figure::new(
            "nees",
            "NEES per degree of freedom",
            "with the 95 % band",
            nees,
        ),
        Figure::new(
            "coverage",
            "Within 1σ, 2σ and 3σ",
            "%; lines: a normal distribution",
            within,
        ),
    ]
}

/// NEES and shares within the sigmas.
pub(super) fn consistency(case: &Case) -> Markup {
    let singles = AXES.iter().zip(&case.axes).take(6);
    let singles = singles.map(|(axis, a)| (axis.name, a.consistency, Some(a.within)));
    let groups = GROUP_NAMES
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

/// What became of the scans.
pub(super) fn scans(case: &Case) -> Markup {
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

/// Runs below one another, each figure with its change from the first run's.
pub(super) fn comparison(cases: &[Case]) -> Markup {
    // What a run is judged by; the rest is in the tables above.
    let left_out = ["max", "roll", "pitch"];
    let rows: Vec<ComparisonRow> = comparison_rows_of(cases)
        .into_iter()
        .filter(|row| !left_out.iter().any(|word| row.title.contains(word)))
        .collect();
    html! {
        table class="runs" {
            thead { tr { th { "run" } @for row in &rows { th { (row.title) } } } }
            tbody {
                @for (i, case) in cases.iter().enumerate() {
                    tr {
                        td { (case.name()) }
                        @for row in &rows {
                            @let value = (row.value)(case);
                            @let first = cases.first().map_or(f64::NAN, |c| (row.value)(c));
                            td {
                                (fixed(value, row.decimals))
                                @if i > 0 { small class=[better(row, first, value)] { (change(first, value)) } }
                            }
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

/// The limits of `--fail-if` and what became of them.
pub(super) fn gates(report: &Report) -> Markup {
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
