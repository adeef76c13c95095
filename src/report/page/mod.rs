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

/// A page is at most so large, bytes, whatever it is of: it opens at once and goes with a mail.
const MOST_BYTES: usize = 250_000;

/// How much a page shows of its cases.
#[derive(Clone, Copy, Debug)]
struct Detail {
    /// Several cases share the page: each has fewer figures.
    several: bool,
    /// How much coarser courses and maps are than they could be.
    coarse: usize,
    /// Most cases that get figures of their own.
    drawn: usize,
    /// Whether all cases have tables of their own, not only those that are drawn.
    all_tables: bool,
}

impl Detail {
    /// From all that there is to what makes a small page of any number of cases.
    fn levels(cases: &[Case]) -> [Detail; 5] {
        let several = cases.len() > 1;
        let levels = [
            (1, 3, true),
            (2, 3, true),
            (3, 2, true),
            (4, 1, true),
            (4, 1, false),
        ];
        levels.map(|(coarse, drawn, all_tables)| Detail {
            several,
            coarse,
            drawn,
            all_tables,
        })
    }

    /// Pixels of a course that share one pair of extremes.
    fn step_px(self) -> usize {
        self.coarse + usize::from(self.several)
    }

    /// The cases that get figures: of too many the first, which the others are compared with, and
    /// the last ones, the last of which the cards are of.
    fn drawn(self, cases: &[Case]) -> Vec<&Case> {
        let mut drawn: Vec<&Case> = cases.iter().filter(|c| !c.is_empty()).collect();
        if drawn.len() > self.drawn {
            let first = usize::from(self.drawn > 1);
            let last = drawn.split_off(drawn.len() + first - self.drawn);
            drawn.truncate(first);
            drawn.extend(last);
        }
        drawn
    }

    /// The cases that have tables of their own.
    fn tabled(self, cases: &[Case]) -> Vec<&Case> {
        if self.all_tables {
            cases.iter().collect()
        } else {
            self.drawn(cases)
        }
    }

    /// What is left out, in words; nothing on a page of one case.
    fn words(self, cases: &[Case]) -> Option<String> {
        let drawn = self.drawn(cases);
        if !self.several || drawn.is_empty() {
            return None;
        }
        let mut words = String::new();
        if drawn.len() < cases.len() {
            let names: Vec<String> = drawn.iter().map(|case| case.name()).collect();
            let (names, all) = (names.join(", "), number::count(cases.len()));
            words = if self.all_tables {
                format!("The tables are of all {all}, the figures of {names}. ")
            } else {
                format!(
                    "The table before and after is of all {all}, the other tables and the figures of {names}. "
                )
            };
        }
        let fewer = "Where several runs or zones share a page, each that is drawn has the courses of x and yaw, \
                     the distributions of x, z and yaw and three maps; a page of one has all of them.";
        Some(words + fewer)
    }
}

/// The whole page, its maps of the workspace drawn as `maps` says.
pub fn write(report: &Report, maps: MapStyle) -> String {
    let mut page = String::new();
    for detail in Detail::levels(&report.cases) {
        page = write_with(report, maps, detail);
        if page.len() <= MOST_BYTES {
            break;
        }
    }
    page
}

fn write_with(report: &Report, maps: MapStyle, detail: Detail) -> String {
    let body = html! {
        h1 { (report.title) }
        (provenance_line(report))
        @if let Some(words) = detail.words(&report.cases) { p { (words) } }
        @if let Some(case) = report.cases.last().filter(|_| whole_runs(report)) {
            (cards::cards(report, case))
        }
        @if !report.cases.is_empty() { (sections(report, maps, detail)) }
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
    let [detail, ..] = Detail::levels(&report.cases);
    let drawn = detail.drawn(&report.cases);
    let mut all = Vec::new();
    let shown = maps::Maps::of(&drawn, maps, detail);
    for (i, case) in drawn.iter().enumerate() {
        let name = if detail.several {
            case.name()
        } else {
            String::new()
        };
        let mut figures = shown.figures(i);
        figures.extend(courses::wide(case, detail));
        figures.extend(courses::small(case, detail));
        figures.extend(courses::distributions(case, detail));
        figures.extend(tables::consistency_figures(case));
        figures.extend(evaluation::figures(case, detail));
        all.extend(figures.into_iter().map(|f| f.of(&name)));
    }
    if let Some(inertial) = &report.inertial {
        all.extend(outputs::figures(inertial));
    }
    make_unique(&mut all);
    all
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

fn sections(report: &Report, maps: MapStyle, detail: Detail) -> Markup {
    let drawn = detail.drawn(&report.cases);
    let tabled = detail.tabled(&report.cases);
    let shown = maps::Maps::of(&drawn, maps, detail);
    let head = |case: &Case| html! { @if detail.several { h3 { (case.name()) } } };
    html! {
        h2 { "Errors" }
        @for case in &tabled { (head(case)) (tables::errors(case)) }
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
            (row("one", &courses::wide(case, detail)))
            (row("two", &courses::small(case, detail)))
        }
        @if !drawn.is_empty() {
            h2 { "Distribution" }
            p { "Counts of errors by size; the line is the normal curve of the same bias and standard deviation." }
        }
        @for case in &drawn {
            (head(case))
            (row("three", &courses::distributions(case, detail)))
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
            (row("two", &evaluation::track_figures(case, detail)))
        }
        @if drawn.iter().any(|c| c.orientation.is_some()) { h2 { "Orientation against the IMU" } }
        @for case in drawn.iter().filter(|c| c.orientation.is_some()) {
            (head(case))
            (evaluation::orientation(case, detail))
        }
        h2 { "Covariances" }
        p {
            "Mean of the squared error over its variance, per degree of freedom (1 is honest, above is too \
             confident), with the 95 % band for the effective number of independent poses; share of errors \
             within 1, 2 and 3 σ."
        }
        @for case in &tabled {
            (head(case))
            @if is_one_of(&drawn, case) { (row("two", &tables::consistency_figures(case))) }
            (tables::consistency(case))
        }
        h2 { "Scans" }
        @for case in &tabled {
            (head(case))
            (tables::scans(case))
            @if is_one_of(&drawn, case) { (row("three", &evaluation::quality_figures(case, detail))) }
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

    /// The worst that options make of three runs, and many runs.
    #[test]
    fn a_page_is_small_whatever_is_on_it() {
        let three = [("a", 4.0), ("b", 2.0), ("c", 1.0)];
        let mut report = report(&three, 4000);
        for case in &mut report.cases {
            // As with --imu: three courses more.
            let trace = &case.axes[5].trace;
            let angle = |trace: &super::super::Trace| super::super::AngleResult {
                offset_rad: 0.0,
                drift_rad_s: 0.0,
                residual: case.axes[5].statistics,
                trace: trace.clone(),
            };
            let angles = vec![angle(trace), angle(trace), angle(trace)];
            case.orientation = Some(super::super::Orientation {
                source: "imu.csv".to_owned(),
                angles,
                rates: Vec::new(),
            });
        }
        let page = write(&report, MapStyle::Both);
        assert!(page.len() <= MOST_BYTES, "{} bytes", page.len());
        assert!(page.matches("<h3>c</h3>").count() > 5);
        let first = report.cases[0].clone();
        for count in [10, 40] {
            let named = |i: usize| Case {
                run: format!("run {i}"),
                ..first.clone()
            };
            report.cases = (0..count).map(named).collect();
            let page = write(&report, MapStyle::Both);
            assert!(page.len() <= MOST_BYTES, "{count}: {} bytes", page.len());
            // What is not drawn is named, and every run is in the comparison.
            assert!(page.contains(&format!("of all {count}, ")), "{count}");
            let last = format!("run {}", count - 1);
            assert!(page.contains("figures of ") && page.contains(&last));
            for i in 0..count {
                assert!(page.contains(&format!("<td>run {i}</td>")), "{i}");
            }
        }
    }

    #[test]
    fn the_first_and_the_last_are_drawn() {
        let report = report(&[("a", 4.0), ("b", 2.0), ("c", 1.0), ("d", 1.0)], 200);
        let names = |most: usize| -> Vec<String> {
            let detail = Detail {
                drawn: most,
                ..Detail::levels(&report.cases)[0]
            };
            let drawn = detail.drawn(&report.cases);
            drawn.iter().map(|case| case.name()).collect()
        };
        assert_eq!(names(3), ["a", "c", "d"]);
        assert_eq!(names(2), ["a", "d"]);
        assert_eq!(names(1), ["d"]);
        assert_eq!(names(4).len(), 4);
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
