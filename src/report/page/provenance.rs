//! Where the numbers come from: the chain of commands, what went wrong on the way, definitions.

use super::super::case::Report;
use super::super::chain;
use maud::{Markup, html};

/// The last sections.
pub(super) fn how(report: &Report) -> Markup {
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
        @for input in chain::inputs(report) {
            p { (input.name) @if input.stages.is_empty() { ": " (chain::UNKNOWN) } }
            @for stage in input.stages { code { (stage) } }
        }
        @if !report.cases.is_empty() { p { "this report" } }
        code { (chain::own(report)) }
        @if !report.cases.is_empty() { p {
            "An error is measured minus " (report.role) ", angles the short way round. std is about the bias, \
             with n − 1; MAD is the median of |e − median|, not scaled; p95, p99 and max are of |e|, percentiles \
             linear between order statistics (numpy’s default); position is the distance."
        } }
    }
}
