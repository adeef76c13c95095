//! The report as text for a terminal.

mod map;
mod sections;

use super::association::Association;
use super::axis::{AXES, Axis, POSITION, ROTATION};
use super::case::{Case, Report, Track};
use super::consistency::Consistency;
use super::inertial::outputs;
use super::lag::Delay;
use super::number::{self, change, count, fixed};
use super::statistics::Statistics;
use super::workspace::{CELL_AXES, Cells};
use map::Shades;
use std::fmt::Write;

/// What the terminal can show.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Style {
    /// Headers in bold.
    pub bold: bool,
    /// Colours of 24 bits, and UTF-8: the workspace in colours.
    pub colour: bool,
    /// ASCII only.
    pub ascii: bool,
    /// The workspace's cells as numbers, of all components, instead of maps of x and yaw.
    pub all_cells: bool,
}

/// Characters of a sparkline.
const SPARK: usize = 24;
/// Width of the rows' names.
const NAME: usize = 12;
/// Width of a column.
const COLUMN: usize = 9;
/// The figures of a row of errors.
const TITLES: [&str; 8] = ["bias", "std", "rms", "median", "MAD", "p95", "p99", "max"];
/// Statuses listed; the rest is summed up.
const STATUSES: usize = 8;

/// The whole report.
pub fn write(report: &Report, style: Style) -> String {
    let mut text = Text {
        out: String::new(),
        bold: style.bold,
    };
    for case in &report.cases {
        text.case(report, case, style);
    }
    if report.cases.len() > 1 {
        text.comparison(&report.cases);
    }
    if let Some(inertial) = &report.inertial {
        let mut lines = outputs::lines(inertial).into_iter();
        if let Some(title) = lines.next() {
            text.header(&title);
        }
        lines.for_each(|line| text.line(&line));
    }
    for verdict in &report.verdicts {
        let word = if verdict.failed { "FAILED" } else { "passed" };
        text.line(&format!("{word}  {verdict}"));
    }
    if style.ascii {
        number::ascii(&text.out)
    } else {
        text.out
    }
}

struct Text {
    out: String,
    bold: bool,
}

impl Text {
    fn line(&mut self, line: &str) {
        self.out.push_str(line.trim_end());
        self.out.push('\n');
    }

    fn header(&mut self, line: &str) {
        if self.bold {
            let _ = write!(self.out, "\x1b[1m{}\x1b[0m", line.trim_end());
            self.out.push('\n');
        } else {
            self.line(line);
        }
    }

    fn case(&mut self, report: &Report, case: &Case, style: Style) {
        self.header(&format!("{} against {}", case.name(), report.role));
        self.line(&format!("  {}", run_line(case)));
        self.line(&format!("  {}", matching_line(report, case)));
        self.alignment(case);
        self.out.push('\n');
        if !case.is_empty() {
            self.errors(case, "mm");
            self.errors(case, "deg");
            self.delay(case);
            self.track(case);
            self.relative(case);
            self.orientation(case);
            self.stability(case);
            self.consistency(case);
            self.workspace(case, style);
        }
        self.scans(case);
    }

    fn errors(&mut self, case: &Case, unit: &str) {
        let most = case.axes.iter().map(|a| a.statistics.n).max().unwrap_or(0);
        let mut rows = Rows::default();
        rows.add(
            &format!("error, {unit}"),
            TITLES,
            "   over the run".to_owned(),
        );
        for (axis, result) in AXES.iter().zip(&case.axes).filter(|(a, _)| a.unit == unit) {
            let n = result.statistics.n;
            let mut end = format!("   {}", spark(&result.trace.means(SPARK)));
            if n < most {
                let _ = write!(end, "  n {}", count(n));
            }
            rows.add(axis.name, figures(axis, &result.statistics), end);
        }
        self.rows(&rows, true);
    }

    /// A table, its first row as a header if wanted, and a blank line.
    fn rows(&mut self, rows: &Rows, header: bool) {
        for (i, line) in rows.lines().iter().enumerate() {
            if header && i == 0 {
                self.header(line);
            } else {
                self.line(line);
            }
        }
        self.out.push('\n');
    }

    fn consistency(&mut self, case: &Case) {
        let singles = AXES.iter().zip(&case.axes).take(6);
        let singles = singles.map(|(axis, result)| (axis.name, result.consistency));
        let groups = ["x+yaw", "position", "pose"];
        let groups = groups.into_iter().zip(case.groups.iter().copied());
        let all: Vec<(&str, Consistency)> = singles.chain(groups).collect();
        if all.iter().all(|(_, c)| c.n == 0) {
            return;
        }
        let mut rows = Rows::default();
        let mut row = |title: &str, value: &dyn Fn(usize, &Consistency) -> String| {
            let cells = all.iter().enumerate().map(|(i, (_, c))| value(i, c));
            rows.add(title, cells, String::new());
        };
        row("NEES / dof", &|i, _| {
            all.get(i).map_or(String::new(), |(n, _)| (*n).to_owned())
        });
        row("mean", &|_, c| fixed(c.nees, 2));
        row("band from", &|_, c| fixed(band(c, c.low), 2));
        row("band to", &|_, c| fixed(band(c, c.high), 2));
        row("effective n", &|_, c| fixed(band(c, c.effective_n), 0));
        for k in 0..3 {
            row(
                &format!("within {}σ, %", k + 1),
                &|i, _| match case.axes.get(i).filter(|_| i < 6) {
                    Some(axis) => fixed(100.0 * axis.within[k], 1),
                    None => String::new(),
                },
            );
        }
        self.rows(&rows, false);
    }

    fn workspace(&mut self, case: &Case, style: Style) {
        let Some(cells) = case.cells.as_ref() else {
            return;
        };
        if cells.filled().count() < 2 {
            return;
        }
        if !style.all_cells {
            let shades = if style.colour {
                Shades::Colours
            } else {
                Shades::Digits
            };
            let lines = map::of(cells, shades);
            lines.iter().for_each(|line| self.line(line));
            return;
        }
        let cells = cells.coarser(9, 6);
        for (k, i) in CELL_AXES.iter().enumerate() {
            self.cells(&cells, k, &AXES[*i]);
        }
    }

    /// One component's rms by cell: y across, z up.
    fn cells(&mut self, cells: &Cells, k: usize, axis: &Axis) {
        let [ny, nz] = cells.layout.count;
        let mut rows = Rows::default();
        let ys = (0..ny).map(|column| fixed(cells.layout.centre_m(column)[0], 2));
        let title = format!("{} rms, {}", axis.name, axis.unit);
        rows.add(&title, ys, "   y, m".to_owned());
        for row in (0..nz).rev() {
            let [_, z] = cells.layout.centre_m(row * ny);
            let values = (0..ny).map(|column| {
                let filled = cells.cells.get(row * ny + column);
                let filled = filled.filter(|c| c.n >= cells.layout.few);
                let value = filled.map(|c| fixed(c.rms(k) * axis.factor, axis.decimals));
                value.unwrap_or_default()
            });
            rows.add(&format!("z {} m", fixed(z, 2)), values, String::new());
        }
        self.rows(&rows, true);
    }

    fn scans(&mut self, case: &Case) {
        let scans = &case.scans;
        let mut line = name("scans");
        let _ = write!(
            line,
            "{} of {} solved ({} %), {} refused, {} lost",
            count(scans.solved),
            count(scans.rows + scans.lost),
            fixed(scans.solved_pct(), 1),
            count(scans.refused()),
            count(scans.lost)
        );
        if scans.partial > 0 {
            let _ = write!(line, "; {} lack a component", count(scans.partial));
        }
        for (what, spread) in [("edges", scans.edges), ("votes", scans.votes)] {
            if let Some(s) = spread.filter(|s| s.max > 0) {
                let mean = fixed(s.mean, 1);
                let _ = write!(line, "; {what} {} to {}, mean {mean}", s.min, s.max);
            }
        }
        self.line(&line);
        for tally in scans.statuses.iter().take(STATUSES) {
            let what = if tally.solved { "" } else { "no pose: " };
            let line = format!(
                "{}{:>COLUMN$}  {what}{}",
                name(""),
                count(tally.count),
                tally.status
            );
            self.line(&line);
        }
        let rest: usize = scans.statuses.iter().skip(STATUSES).map(|t| t.count).sum();
        if rest > 0 {
            self.line(&format!("{}{:>COLUMN$}  other", name(""), count(rest)));
        }
        self.lines_of(case);
        for note in &case.notes {
            self.line(&format!("{}{note}", name("note")));
        }
        self.out.push('\n');
    }

    /// Cases side by side, with the change from the first one.
    fn comparison(&mut self, cases: &[Case]) {
        let longest = cases.iter().map(|c| c.name().chars().count()).max();
        let width = longest.unwrap_or(0).max(COLUMN) + 2;
        // All values' columns are alike, however short the name of one run.
        let wide = |text: String| format!("{text:>width$}");
        let mut rows = Rows::default();
        let mut cells = Vec::new();
        for (i, case) in cases.iter().enumerate() {
            cells.push(wide(case.name()));
            cells.extend((i > 0).then(|| "change".to_owned()));
        }
        rows.add(
            &format!("{:<w$}", "side by side", w = NAME + 4),
            cells,
            String::new(),
        );
        for row in comparison_rows_of(cases) {
            let first = cases.first().map_or(f64::NAN, |c| (row.value)(c));
            let mut cells = Vec::new();
            for (i, case) in cases.iter().enumerate() {
                let value = (row.value)(case);
                cells.push(wide(fixed(value, row.decimals)));
                cells.extend((i > 0).then(|| change(first, value)));
            }
            rows.add(
                &format!("{:<w$}", row.title, w = NAME + 4),
                cells,
                String::new(),
            );
        }
        self.rows(&rows, true);
    }
}

/// A table: a name, right-aligned columns and what follows them, row by row.
#[derive(Default)]
struct Rows(Vec<(String, Vec<String>, String)>);

impl Rows {
    fn add<T: Into<String>>(
        &mut self,
        title: &str,
        cells: impl IntoIterator<Item = T>,
        end: String,
    ) {
        let cells = cells.into_iter().map(Into::into).collect();
        self.0.push((name(title), cells, end));
    }

    /// The rows as text: every column as wide as its widest cell wants it, a blank before it included.
    fn lines(&self) -> Vec<String> {
        let wide = |k: usize| {
            let cells = self.0.iter().filter_map(|(_, cells, _)| cells.get(k));
            let widths = cells.map(|text| 1 + text.trim_start().chars().count());
            widths.max().unwrap_or(0).max(COLUMN)
        };
        let columns = self.0.iter().map(|(_, cells, _)| cells.len()).max();
        let widths: Vec<usize> = (0..columns.unwrap_or(0)).map(wide).collect();
        let line = |(title, cells, end): &(String, Vec<String>, String)| {
            let cells = cells.iter().zip(&widths);
            let cells: String = cells.map(|(text, w)| format!("{text:>w$}")).collect();
            format!("{title}{cells}{end}")
        };
        self.0.iter().map(line).collect()
    }
}

/// A figure by which runs are compared.
pub(super) struct ComparisonRow {
    pub title: String,
    pub decimals: usize,
    pub smaller_is_better: bool,
    pub value: Box<dyn Fn(&Case) -> f64>,
}

/// What runs are compared by, in the terminal and on the page.
pub(super) fn comparison_rows() -> Vec<ComparisonRow> {
    let mut rows = Vec::new();
    for (i, axis) in AXES.iter().enumerate() {
        for maximum in [false, true] {
            rows.push(ComparisonRow {
                title: format!(
                    "{} {}, {}",
                    axis.name,
                    if maximum { "max" } else { "rms" },
                    axis.unit
                ),
                decimals: axis.decimals,
                smaller_is_better: true,
                value: Box::new(move |case: &Case| {
                    let s = case.axes.get(i).map(|a| a.statistics);
                    s.map_or(f64::NAN, |s| {
                        axis.factor * if maximum { s.max } else { s.rms }
                    })
                }),
            });
        }
    }
    rows.push(ComparisonRow {
        title: "x+yaw NEES / dof".to_owned(),
        decimals: 2,
        smaller_is_better: false,
        value: Box::new(|case| case.groups.first().map_or(f64::NAN, |g| g.nees)),
    });
    rows.push(ComparisonRow {
        title: "solved, %".to_owned(),
        decimals: 1,
        smaller_is_better: false,
        value: Box::new(|case| case.scans.solved_pct()),
    });
    rows
}

/// The same, with what these runs have besides: delays, ways, relative errors.
pub(super) fn comparison_rows_of(cases: &[Case]) -> Vec<ComparisonRow> {
    let mut rows = comparison_rows();
    let mut more = |title: &str, better: bool, value: Box<dyn Fn(&Case) -> f64>| {
        let known = |case: &Case| value(case).is_finite();
        if cases.iter().any(known) {
            rows.push(ComparisonRow {
                title: title.to_owned(),
                decimals: 2,
                smaller_is_better: better,
                value,
            });
        }
    };
    let delay = |value: fn(&Delay) -> f64| -> Box<dyn Fn(&Case) -> f64> {
        Box::new(move |case| 1e3 * case.delay.as_ref().map_or(f64::NAN, value))
    };
    more("delay, ms", false, delay(|d| d.delay_s));
    more("without, mm rms", true, delay(|d| d.rms_after_m));
    let track = |value: fn(&Track) -> f64| -> Box<dyn Fn(&Case) -> f64> {
        Box::new(move |case| 1e3 * case.track.as_ref().map_or(f64::NAN, value))
    };
    more("along, mm rms", true, track(|t| t.along.statistics.rms));
    more("cross, mm rms", true, track(|t| t.cross.statistics.rms));
    let relative = cases.first().map_or(&[][..], |case| &case.relative);
    for (k, delta) in relative.iter().map(|r| &r.delta.text).enumerate() {
        for index in [POSITION, ROTATION] {
            let axis = &AXES[index];
            let value = move |case: &Case| {
                let statistics = case.relative.get(k).and_then(|r| r.axes.get(index));
                statistics.map_or(f64::NAN, |s| s.rms * axis.factor)
            };
            more(
                &format!("rpe {delta}, {}", axis.unit),
                true,
                Box::new(value),
            );
        }
    }
    rows
}

/// A row of errors.
fn figures(axis: &Axis, statistics: &Statistics) -> [String; 8] {
    sections::row_figures(axis, statistics).map(|v| fixed(v, axis.decimals))
}

/// Where it came from, how long it is.
pub(super) fn run_line(case: &Case) -> String {
    format!(
        "{}, {} rows, {} s, {} Hz",
        case.source,
        count(case.scans.rows),
        fixed(case.duration_s(), 1),
        fixed(case.rate_hz(), 1)
    )
}

/// How the poses met their reference.
pub(super) fn matching_line(report: &Report, case: &Case) -> String {
    let m = &case.matching;
    let between = match report.reference.association() {
        Association::Interpolated => format!("{} interpolated", count(m.interpolated)),
        Association::Nearest => format!("{} to the nearest point", count(m.nearest)),
    };
    // Only a whole run knows of the poses that have no place.
    let whole = case.zone.as_ref().map_or("", |_| "of the whole run ");
    format!(
        "{whole}{} poses matched: {} at equal stamps, {between}; {} unmatched",
        count(m.matched()),
        count(m.exact),
        count(m.unmatched())
    )
}

fn band(c: &Consistency, value: f64) -> f64 {
    if c.n > 0 { value } else { f64::NAN }
}

fn name(text: &str) -> String {
    format!("{text:<NAME$}")
}

/// Values as bars from the smallest to the largest; a blank where there is none.
fn spark(values: &[f64]) -> String {
    let finite = || values.iter().copied().filter(|v| v.is_finite());
    let low = finite().fold(f64::INFINITY, f64::min);
    let high = finite().fold(f64::NEG_INFINITY, f64::max);
    let bar = |v: &f64| {
        if !v.is_finite() {
            return ' ';
        }
        let share = if high > low {
            (v - low) / (high - low)
        } else {
            0.5
        };
        char::from_u32('▁' as u32 + (share * 7.99) as u32).unwrap_or('█')
    };
    values.iter().map(bar).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_never_run_together() {
        let mut rows = Rows::default();
        rows.add("NEES / dof", ["yaw", "x+yaw", "pose"], String::new());
        let large = [0.93, 16_839.02, 10_881.72].map(|v| fixed(v, 2));
        rows.add("mean", large, String::new());
        assert_eq!(
            rows.lines(),
            [
                "NEES / dof        yaw     x+yaw      pose",
                "mean             0.93 16,839.02 10,881.72",
            ]
        );
    }

    #[test]
    fn sparks() {
        assert_eq!(spark(&[0.0, 1.0, f64::NAN, 0.5]), "▁█ ▄");
        assert_eq!(spark(&[2.0, 2.0]), "▄▄");
        assert_eq!(spark(&[]), "");
    }
}
