//! The report as text for a terminal.

use super::association::Association;
use super::axis::{AXES, Axis};
use super::case::{Case, Report};
use super::consistency::Consistency;
use super::number::{self, change, count, fixed};
use super::workspace::{CELL_AXES, Cells};
use std::fmt::Write;

/// What the terminal can show.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Style {
    /// Headers in bold.
    pub bold: bool,
    /// ASCII only.
    pub ascii: bool,
    /// The workspace's cells for all of x, y, z and yaw instead of x and yaw.
    pub all_cells: bool,
}

/// Characters of a sparkline.
const SPARK: usize = 24;
/// Width of the rows' names.
const NAME: usize = 12;
/// Width of a column.
const COLUMN: usize = 9;
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
        self.out.push('\n');
        if !case.is_empty() {
            self.errors(case, "mm");
            self.errors(case, "deg");
            self.consistency(case);
            self.workspace(case, style);
        }
        self.scans(case);
    }

    fn errors(&mut self, case: &Case, unit: &str) {
        let titles = ["bias", "std", "rms", "median", "MAD", "p95", "p99", "max"];
        let most = case.axes.iter().map(|a| a.statistics.n).max().unwrap_or(0);
        let mut header = name(&format!("error, {unit}"));
        for title in titles {
            header.push_str(&cell(title));
        }
        header.push_str("   over the run");
        self.header(&header);
        for (axis, result) in AXES.iter().zip(&case.axes).filter(|(a, _)| a.unit == unit) {
            let s = result.statistics.scaled(axis.factor);
            let values = [s.bias, s.std, s.rms, s.median, s.mad, s.p95, s.p99, s.max];
            let mut line = name(axis.name);
            for value in values {
                line.push_str(&cell(&fixed(value, axis.decimals)));
            }
            let _ = write!(line, "   {}", spark(&result.trace.means(SPARK)));
            if s.n < most {
                let _ = write!(line, "  n {}", count(s.n));
            }
            self.line(&line);
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
        let mut row = |title: &str, value: &dyn Fn(usize, &Consistency) -> String| {
            let cells = all.iter().enumerate().map(|(i, (_, c))| cell(&value(i, c)));
            let line = name(title) + &cells.collect::<String>();
            self.line(&line);
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
        self.out.push('\n');
    }

    fn workspace(&mut self, case: &Case, style: Style) {
        let Some(cells) = case.cells.as_ref().map(|c| c.coarser(9, 6)) else {
            return;
        };
        if cells.filled().count() < 2 {
            return;
        }
        for (k, i) in CELL_AXES.iter().enumerate() {
            if style.all_cells || k == 0 || k == 3 {
                self.cells(&cells, k, &AXES[*i]);
            }
        }
    }

    /// One component's rms by cell: y across, z up.
    fn cells(&mut self, cells: &Cells, k: usize, axis: &Axis) {
        let [ny, nz] = cells.layout.count;
        let mut header = name(&format!("{} rms, {}", axis.name, axis.unit));
        for column in 0..ny {
            let [y, _] = cells.layout.centre_m(column);
            header.push_str(&cell(&fixed(y, 2)));
        }
        header.push_str("   y, m");
        self.header(&header);
        for row in (0..nz).rev() {
            let [_, z] = cells.layout.centre_m(row * ny);
            let mut line = name(&format!("z {} m", fixed(z, 2)));
            for column in 0..ny {
                let filled = cells.cells.get(row * ny + column);
                let filled = filled.filter(|c| c.n >= cells.layout.few);
                let value = filled.map(|c| fixed(c.rms(k) * axis.factor, axis.decimals));
                line.push_str(&cell(&value.unwrap_or_default()));
            }
            self.line(&line);
        }
        self.out.push('\n');
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
        for note in &case.notes {
            self.line(&format!("{}{note}", name("note")));
        }
        self.out.push('\n');
    }

    /// Cases side by side, with the change from the first one.
    fn comparison(&mut self, cases: &[Case]) {
        let longest = cases.iter().map(|c| c.name().chars().count()).max();
        let width = longest.unwrap_or(0).max(COLUMN) + 2;
        let mut header = name("side by side");
        header.push_str("    ");
        for (i, case) in cases.iter().enumerate() {
            let _ = write!(header, "{:>width$}", case.name());
            if i > 0 {
                let _ = write!(header, "{:>COLUMN$}", "change");
            }
        }
        self.header(&header);
        for row in comparison_rows() {
            let first = cases.first().map_or(f64::NAN, |c| (row.value)(c));
            let mut line = format!("{:<w$}", row.title, w = NAME + 4);
            for (i, case) in cases.iter().enumerate() {
                let value = (row.value)(case);
                let _ = write!(line, "{:>width$}", fixed(value, row.decimals));
                if i > 0 {
                    let _ = write!(line, "{:>COLUMN$}", change(first, value));
                }
            }
            self.line(&line);
        }
        self.out.push('\n');
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
    format!(
        "{} poses matched: {} at equal stamps, {between}; {} unmatched",
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

fn cell(text: &str) -> String {
    format!("{text:>COLUMN$}")
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
    fn sparks() {
        assert_eq!(spark(&[0.0, 1.0, f64::NAN, 0.5]), "▁█ ▄");
        assert_eq!(spark(&[2.0, 2.0]), "▄▄");
        assert_eq!(spark(&[]), "");
    }
}
