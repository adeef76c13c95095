//! The report as one page: no script, nothing fetched, the same bytes for the same input.
//!
//! Its size does not depend on the run's length: figures are made from what a [`Case`] keeps. Every
//! section makes its figures in a function of its own, so that they can leave the page as files too
//! ([`figures`]).

mod cards;
mod courses;
mod evaluation;
mod maps;
mod provenance;
mod tables;

use super::case::{Case, Report};
use super::figure::MapStyle;
use super::inertial::outputs;
use super::number;
use super::picture::{Figure, make_unique};
use super::terminal::{matching_line, run_line};
use maud::{DOCTYPE, Markup, PreEscaped, html};

/// Most cases that get figures of their own; the others are in the tables.
const DRAWN: usize = 3;

/// The whole page, its maps of the workspace drawn as `maps` says.
pub fn write(report: &Report, maps: MapStyle) -> String {
    let body = html! {
        h1 { (report.title) }
        (provenance_line(report))
        @if let Some(words) = left_out(&report.cases) { p { (words) } }
        @if let Some(case) = report.cases.last().filter(|_| whole_runs(report)) {
            (cards::cards(report, case))
        }
        @if !report.cases.is_empty() { (sections(report, maps)) }
        @if let Some(inertial) = &report.inertial { (outputs::section(inertial)) }
        @if report.cases.len() > 1 {
            h2 { "Before and after" }
            p { "Each figure with its change from the first row: green where it is better, amber where it is worse." }
            (tables::comparison(&report.cases))
        }
        @if !report.verdicts.is_empty() { (tables::gates(report)) }
        (provenance::how(report))
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

/// Every figure of the page, each with a name of its own; those of several runs begin with the run's.
pub fn figures(report: &Report, maps: MapStyle) -> Vec<Figure> {
    let several = report.cases.len() > 1;
    let drawn = drawn(&report.cases);
    let mut all = Vec::new();
    let shown = maps::Maps::of(&drawn, maps);
    for (i, case) in drawn.iter().enumerate() {
        let name = if several { case.name() } else { String::new() };
        let mut figures = shown.figures(i);
        figures.extend(courses::wide(case, several));
        figures.extend(courses::small(case, several));
        figures.extend(courses::distributions(case, several));
        figures.extend(tables::consistency_figures(case));
        figures.extend(evaluation::figures(case, several));
        all.extend(figures.into_iter().map(|f| f.of(&name)));
    }
    if let Some(inertial) = &report.inertial {
        all.extend(outputs::figures(inertial));
    }
    make_unique(&mut all);
    all
}

/// The cases that get figures: of too many the first, which the others are compared with, and the
/// last ones.
fn drawn(cases: &[Case]) -> Vec<&Case> {
    let mut drawn: Vec<&Case> = cases.iter().filter(|c| !c.is_empty()).collect();
    if let Some(surplus) = drawn.len().checked_sub(DRAWN) {
        drawn.drain(1..1 + surplus);
    }
    drawn
}

/// Which figures are left out where several cases share the page; nothing for one.
fn left_out(cases: &[Case]) -> Option<String> {
    let drawn = drawn(cases);
    if cases.len() < 2 || drawn.is_empty() {
        return None;
    }
    let of_each = "Where several runs or zones share a page, each has the courses of x and yaw, the distributions of \
                   x, z and yaw and three maps; a page of one has them all.";
    let with: Vec<String> = drawn.iter().map(|case| case.name()).collect();
    Some(if with.len() < cases.len() {
        let (with, all) = (with.join(", "), number::count(cases.len()));
        format!("The tables are of all {all}, the figures of {with}. {of_each}")
    } else {
        of_each.to_owned()
    })
}

/// Whether `case` is one of `cases`; the same one, as numbers that are missing make all unequal.
fn is_one_of(cases: &[&Case], case: &Case) -> bool {
    cases.iter().any(|c| std::ptr::eq(*c, case))
}

/// Whether the cases are runs, the last of which the cards are of; not parts of the workspace.
fn whole_runs(report: &Report) -> bool {
    report.cases.iter().all(|c| c.zone.is_none())
}

/// Figures in a row: `three` or `two` of them, or `one`.
fn row(class: &str, figures: &[Figure]) -> Markup {
    html! {
        @if !figures.is_empty() {
            div class=(class) { @for figure in figures { (figure.markup()) } }
        }
    }
}

fn sections(report: &Report, maps: MapStyle) -> Markup {
    let cases = &report.cases;
    let several = cases.len() > 1;
    let drawn = drawn(cases);
    let shown = maps::Maps::of(&drawn, maps);
    let head = |case: &Case| html! { @if several { h3 { (case.name()) } } };
    html! {
        h2 { "Errors" }
        @for case in cases { (head(case)) (tables::errors(case)) }
        @if shown.any() {
            h2 { "Over the workspace" }
            p { (shown.says()) }
            @for (i, case) in drawn.iter().enumerate() {
                (head(case))
                (row("three", &shown.figures(i)))
            }
        }
        @if !drawn.is_empty() { h2 { "Over time" } }
        @for case in &drawn {
            (head(case))
            (row("one", &courses::wide(case, several)))
            (row("two", &courses::small(case, several)))
        }
        @if !drawn.is_empty() {
            h2 { "Distribution" }
            p { "Counts of errors by size; the line is the normal curve of the same bias and standard deviation." }
        }
        @for case in &drawn {
            (head(case))
            (row("three", &courses::distributions(case, several)))
        }
        @if drawn.iter().any(|c| c.delay.is_some()) { h2 { "Delay" } }
        @for case in drawn.iter().filter(|c| c.delay.is_some()) {
            (head(case))
            (evaluation::delay(case))
        }
        @if drawn.iter().any(|c| c.track.is_some()) {
            h2 { "Along and across the way" }
            p { "The position’s error along the reference’s velocity (positive: ahead of it) and its distance from the path." }
        }
        @for case in drawn.iter().filter(|c| c.track.is_some()) {
            (head(case))
            (row("two", &evaluation::track_figures(case, several)))
        }
        @if drawn.iter().any(|c| c.orientation.is_some()) { h2 { "Orientation against the IMU" } }
        @for case in drawn.iter().filter(|c| c.orientation.is_some()) {
            (head(case))
            (evaluation::orientation(case))
        }
        h2 { "Covariances" }
        p {
            "Mean of the squared error over its variance, per degree of freedom (1 is honest, above is too \
             confident), with the 95 % band for the effective number of independent poses; share of errors \
             within 1, 2 and 3 σ."
        }
        @for case in cases {
            (head(case))
            @if is_one_of(&drawn, case) { (row("two", &tables::consistency_figures(case))) }
            (tables::consistency(case))
        }
        h2 { "Scans" }
        @for case in cases {
            (head(case))
            (tables::scans(case))
            @if is_one_of(&drawn, case) { (row("three", &evaluation::quality_figures(case, several))) }
        }
        @if drawn.iter().any(|c| c.stability.is_some()) { h2 { "Standing still" } }
        @for case in drawn.iter().filter(|c| c.stability.is_some()) {
            (head(case))
            (evaluation::stability(case))
        }
    }
}

fn provenance_line(report: &Report) -> Markup {
    html! {
        @for (i, case) in report.cases.iter().enumerate() {
            p {
                @if report.cases.len() > 1 { (case.name()) ": " }
                "measured against " (report.role) " (" (report.reference_source) ") · "
                (run_line(case)) " · " (matching_line(report, case))
                @if let Some(moved) = case.alignment.sentence() { " · " (moved) }
                @if let Some(delay) = case.delay.as_ref().filter(|d| d.removed) {
                    " · delay removed: " (evaluation::delay_text(delay))
                }
                @if i + 1 == report.cases.len() {
                    " · report " (env!("CARGO_PKG_VERSION"))
                    @if let Some(date) = &report.date { ", " (date) }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::case::tests::{run, truth};
    use super::super::{Settings, evaluate};
    use super::*;

    fn report(runs: &[(&str, f64)], n: i64) -> Report {
        let reference = truth(n);
        let read = runs.iter().map(|(name, s)| run(name, &reference, n, *s));
        let cases = evaluate(read.collect(), &reference, &Settings::default());
        Report {
            title: "a < b".to_owned(),
            role: "truth",
            reference_source: "truth.csv".to_owned(),
            reference_stages: Vec::new(),
            reference,
            cases,
            inertial: None,
            verdicts: Vec::new(),
            command: "report".to_owned(),
            date: None,
        }
    }

    /// A case holds no more than columns of pixels, bins and cells: with several poses in each of
    /// them, a page does not grow any more.
    #[test]
    fn a_page_is_small_however_long_the_run() {
        let runs = [("first", 4.0), ("second", 2.0), ("third", 1.0)];
        for runs in [&runs[..], &runs[..1]] {
            let page = write(&report(runs, 10_000), MapStyle::Cells);
            assert!(page.len() <= 250_000, "{} bytes", page.len());
            let longer = write(&report(runs, 40_000), MapStyle::Cells);
            assert!(longer.len() <= 250_000, "{} bytes", longer.len());
            assert!(longer.len() as f64 <= 1.2 * page.len() as f64);
            assert_eq!(page, write(&report(runs, 10_000), MapStyle::Cells));
            assert!(!page.contains("NaN") && page.contains("a &lt; b"));
        }
    }

    #[test]
    fn every_figure_has_a_name_and_is_on_the_page() {
        for maps in [MapStyle::Cells, MapStyle::Contours, MapStyle::Both] {
            let report = report(&[("a", 1.0), ("b", 2.0)], 3000);
            let page = write(&report, maps);
            let figures = figures(&report, maps);
            assert_eq!(figures.len(), page.matches("<figure>").count());
            let mut names: Vec<&str> = figures.iter().map(|f| f.name.as_str()).collect();
            assert!(
                names
                    .iter()
                    .all(|n| n.starts_with("a-") || n.starts_with("b-"))
            );
            names.sort_unstable();
            names.dedup();
            assert_eq!(names.len(), figures.len());
            for figure in &figures {
                assert!(page.contains(&figure.drawing.svg()), "{}", figure.name);
            }
        }
    }

    #[test]
    fn what_cannot_be_compared_is_a_page_too() {
        let mut report = report(&[("a", 1.0)], 200);
        let nothing = evaluate(
            vec![Default::default()],
            &super::super::Reference::default(),
            &Settings::default(),
        );
        report.cases = nothing;
        let page = write(&report, MapStyle::Cells);
        assert!(page.contains("there are no poses"));
        assert!(figures(&report, MapStyle::Cells).is_empty());
    }
}
