//! Scans as a page: one, or several to step through without a script.

use super::View;
use super::figures::{edge_text, figures, line_name};
use crate::report::number::{count, fixed};
use crate::report::page;
use maud::{Markup, PreEscaped, html};
use std::fmt::Write;

/// The page of scans of `source`. Several are stepped through by radio buttons, which the style alone
/// understands; printed, all are there.
pub fn page(title: Option<&str>, source: &str, views: &[View], command: &str) -> String {
    let title = title.map_or_else(|| format!("Scans of {source}"), str::to_owned);
    let several = views.len() > 1;
    let body = html! {
        h1 { (title) }
        p {
            "Beams end blue where they lie on a reflector line (within 4 rms residuals of it), grey elsewhere; lines red, strip "
            "edges green: the interval between two beams, and the estimate across it"
            @if views.iter().any(|v| !v.reflectors.is_empty()) { "; pale: the frame’s reflectors as the pose has them" }
            ". In the axes of the scanner when the beam at 90° fires · report " (env!("CARGO_PKG_VERSION"))
        }
        @if several {
            style { (PreEscaped(style(views.len()))) }
            div class="steps" {
                @for i in 0..views.len() {
                    input type="radio" name="scan" id=(format!("s{i}")) checked[i == 0];
                }
                nav {
                    @for (i, view) in views.iter().enumerate() { label for=(format!("s{i}")) { (view.seq) } }
                }
                @for (i, view) in views.iter().enumerate() {
                    section id=(format!("v{i}")) {
                        div class="turn" {
                            label for=(format!("s{}", i.saturating_sub(1))) { "‹ before" }
                            label for=(format!("s{}", (i + 1).min(views.len() - 1))) { "next ›" }
                        }
                        (of_scan(view, false))
                    }
                }
            }
        } @else {
            @for view in views { (of_scan(view, true)) }
        }
        h2 { "How it was made" }
        code { (command) }
    };
    page::document(&title, &body)
}

/// Shows the section whose button is chosen, and marks its label.
fn style(count: usize) -> String {
    let mut style = ".steps>input{position:absolute;opacity:0}.steps>section{display:none}\
        .steps nav{display:flex;flex-wrap:wrap;gap:4px;margin:10px 0}\
        .steps label{cursor:pointer;padding:2px 9px;border-radius:6px;background:var(--card);color:var(--soft)}\
        .turn{display:flex;justify-content:space-between}"
        .to_owned();
    let all = |out: &mut String, selector: &dyn Fn(usize) -> String| {
        let parts: Vec<String> = (0..count).map(selector).collect();
        out.push_str(&parts.join(","));
    };
    all(&mut style, &|i| format!("#s{i}:checked~#v{i}"));
    style.push_str("{display:block}");
    all(&mut style, &|i| {
        format!("#s{i}:checked~nav label[for=s{i}]")
    });
    style.push_str("{color:var(--paper);background:var(--series)}");
    all(&mut style, &|i| {
        format!("#s{i}:focus-visible~nav label[for=s{i}]")
    });
    style.push_str("{outline:2px solid var(--ink)}");
    let _ = write!(
        style,
        "@media print{{.steps>section{{display:block}}.steps nav,.turn{{display:none}}}}"
    );
    style
}

fn of_scan(view: &View, texts: bool) -> Markup {
    let on_lines = view.beams.iter().filter(|b| b.on_line).count();
    html! {
        p {
            "scan " (view.seq) " · " (view.stamp.ns()) " ns · " (count(view.count)) " beams, " (count(view.beams.len()))
            " returns, " (count(on_lines)) " on lines"
        }
        div class="one" { @for figure in figures(view, texts, "") { (figure.markup()) } }
        @if let Some(lines) = &view.lines {
            table {
                thead { tr { th { "line" } th { "d, m" } th { "alpha, °" } th { "points" } th { "rms, mm" } } }
                tbody {
                    @for (k, line) in lines.lines().into_iter().enumerate() {
                        tr {
                            td { (line_name(k)) } td { (fixed(line.normal.d_m, 4)) } td { (fixed(line.normal.alpha_rad.to_degrees(), 3)) }
                            td { (line.points) } td { (fixed(line.rms_m * 1e3, 2)) }
                        }
                    }
                }
            }
            ul {
                li { "range bias " (fixed(lines.range_bias_m * 1e3, 2)) " mm" }
                @for edge in &lines.edges { li { (edge_text(edge)) } }
            }
        } @else { p { "No lines came for this scan." } }
    }
}
