//! The report as tables for other programs and for papers: CSV, Markdown, LaTeX.
//!
//! All three are made from the tree that [`super::json`] writes, so that a statistic has one name
//! and one value everywhere. CSV holds every number, one a row, as `run,zone,axis,statistic,value`:
//! the name for `--fail-if` is the axis and the statistic with a point between them. Markdown and
//! LaTeX hold what people compare: the errors, the runs side by side, and where they come from.

use super::axis::AXES;
use super::case::{Case, Report};
use super::chain;
use super::json::{self, Tree};
use super::number::{self, fixed};
use super::terminal;
use crate::record::text;
use std::fmt::Write;

/// Every number of the report, one a row.
///
/// # Errors
/// None in practice: everything in it can be written.
pub fn csv(report: &Report) -> Result<String, csv::Error> {
    let mut out = csv::Writer::from_writer(Vec::new());
    out.write_record(["run", "zone", "axis", "statistic", "value"])?;
    for case in &report.cases {
        let zone = case.zone.as_deref().unwrap_or_default();
        for (path, value) in leaves(&json::case_tree(case, false)) {
            let (axis, statistic) = path.rsplit_once('.').unwrap_or(("", &path));
            out.write_record([&case.run, zone, axis, statistic, &value])?;
        }
    }
    if let Some(inertial) = &report.inertial {
        for (path, value) in leaves(&json::inertial_tree(inertial)) {
            let (axis, statistic) = path.rsplit_once('.').unwrap_or(("", &path));
            out.write_record([&inertial.source, "", axis, statistic, &value])?;
        }
    }
    let bytes = out
        .into_inner()
        .map_err(|error| csv::Error::from(error.into_error()))?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

/// The numbers of a tree with their paths, missing ones with an empty text; no lists.
fn leaves(tree: &Tree) -> Vec<(String, String)> {
    fn add(tree: &Tree, path: &str, out: &mut Vec<(String, String)>) {
        let number = |value: f64| {
            let mut bytes = Vec::new();
            if value.is_finite() {
                text::push_f64(&mut bytes, value);
            }
            String::from_utf8_lossy(&bytes).into_owned()
        };
        let value = match tree {
            Tree::Object(fields) => {
                for (name, field) in fields {
                    let path = match path {
                        "" => name.clone(),
                        path => format!("{path}.{name}"),
                    };
                    add(field, &path, out);
                }
                return;
            }
            Tree::Number(value) => number(json::rounded(*value)),
            Tree::Exact(value) => number(*value),
            Tree::Count(n) => n.to_string(),
            Tree::Flag(_) | Tree::Text(_) | Tree::List(_) | Tree::Null => return,
        };
        out.push((path.to_owned(), value));
    }
    let mut out = Vec::new();
    add(tree, "", &mut out);
    out
}

/// A table for people: its first column holds names, the others numbers.
#[derive(Clone, Debug, PartialEq)]
struct Table {
    title: String,
    header: Vec<String>,
    rows: Vec<Vec<String>>,
}

/// Columns of error tables that are there where a row has them: a statistic, and its heading.
const FURTHER: [(&str, &str); 2] = [("nees", "NEES"), ("within_3s_pct", "in 3σ, %")];

/// The errors of a case, a table for each unit.
fn error_tables(case: &Case) -> Vec<Table> {
    let mut rows = Vec::new();
    error_rows(&json::case_tree(case, false), "", &mut rows);
    let mut units: Vec<String> = Vec::new();
    for (_, unit, _) in &rows {
        if !units.contains(unit) {
            units.push(unit.clone());
        }
    }
    units
        .into_iter()
        .map(|unit| {
            let own: Vec<_> = rows.iter().filter(|(_, of, _)| *of == unit).collect();
            error_table(&unit, &own)
        })
        .collect()
}

/// An object of the tree that has an rms: its path, the unit, its numbers by name.
type ErrorRow = (String, String, Vec<(String, f64)>);

fn error_rows(tree: &Tree, path: &str, out: &mut Vec<ErrorRow>) {
    let Tree::Object(fields) = tree else {
        return;
    };
    let values: Vec<(String, f64)> = fields
        .iter()
        .filter_map(|(name, field)| match field {
            Tree::Number(value) | Tree::Exact(value) => Some((name.clone(), *value)),
            Tree::Count(n) => Some((name.clone(), *n as f64)),
            _ => None,
        })
        .collect();
    let rms = values.iter().find_map(|(name, value)| {
        let unit = name.strip_prefix("rms_")?;
        // Not of `rms_before_mm`, which is a delay's.
        let bias = format!("bias_{unit}");
        let is_unit = AXES.iter().any(|axis| axis.unit == unit)
            || values.iter().any(|(name, _)| *name == bias);
        (value.is_finite() && is_unit).then(|| unit.to_owned())
    });
    if let Some(unit) = rms {
        out.push((path.to_owned(), unit, values));
    }
    for (name, field) in fields {
        let path = match path {
            "" => name.clone(),
            path => format!("{path}.{name}"),
        };
        error_rows(field, &path, out);
    }
}

fn error_table(unit: &str, rows: &[&ErrorRow]) -> Table {
    let ending = format!("_{unit}");
    let mut columns: Vec<(String, String)> = vec![("n".to_owned(), "n".to_owned())];
    for (name, _) in rows.iter().flat_map(|(_, _, values)| values) {
        if let Some(heading) = name.strip_suffix(&ending)
            && !columns.iter().any(|(known, _)| known == name)
        {
            columns.push((name.clone(), heading.to_owned()));
        }
    }
    for (name, heading) in FURTHER {
        let there =
            |(_, _, values): &&&ErrorRow| values.iter().any(|(n, v)| n == name && v.is_finite());
        if rows.iter().any(|row| there(&row)) {
            columns.push((name.to_owned(), heading.to_owned()));
        }
    }
    let decimals = AXES
        .iter()
        .find(|axis| axis.unit == unit)
        .map_or(3, |axis| axis.decimals);
    let cells = rows.iter().map(|(path, _, values)| {
        let mut cells = vec![path.clone()];
        for (name, _) in &columns {
            let value = values
                .iter()
                .find(|(n, _)| n == name)
                .map_or(f64::NAN, |(_, v)| *v);
            let decimals = match name.as_str() {
                "n" => 0,
                "nees" => 2,
                "within_3s_pct" => 1,
                _ => decimals,
            };
            cells.push(fixed(value, decimals));
        }
        cells
    });
    let names = columns.iter().map(|(_, heading)| heading.clone());
    Table {
        title: format!("Error in {}", unit.replace('_', "/")),
        header: std::iter::once(String::new()).chain(names).collect(),
        rows: cells.collect(),
    }
}

/// Runs and zones side by side, with the change from the first one.
fn comparison(cases: &[Case]) -> Option<Table> {
    let (first, others) = cases.split_first()?;
    if others.is_empty() {
        return None;
    }
    let mut header = vec![String::new(), first.name()];
    for case in others {
        header.extend([case.name(), "change".to_owned()]);
    }
    let rows = terminal::comparison_rows_of(cases).into_iter().map(|row| {
        let of_first = (row.value)(first);
        let mut cells = vec![row.title.clone(), fixed(of_first, row.decimals)];
        for case in others {
            let value = (row.value)(case);
            cells.push(fixed(value, row.decimals));
            cells.push(number::change(of_first, value));
        }
        cells
    });
    Some(Table {
        title: "Side by side".to_owned(),
        header,
        rows: rows.collect(),
    })
}

/// The report in Markdown.
pub fn markdown(report: &Report) -> String {
    let mut out = format!("# {}\n\n", marked(&report.title));
    if let Some(date) = &report.date {
        let _ = writeln!(out, "{date}\n");
    }
    for case in &report.cases {
        let _ = writeln!(out, "## {} against {}\n", marked(&case.name()), report.role);
        let lines = [
            terminal::run_line(case),
            terminal::matching_line(report, case),
        ];
        let _ = writeln!(out, "{}  \n{}\n", marked(&lines[0]), marked(&lines[1]));
        for table in error_tables(case) {
            markdown_table(&table, &mut out);
        }
        for note in &case.notes {
            let _ = writeln!(out, "- {}", marked(note));
        }
        if !case.notes.is_empty() {
            out.push('\n');
        }
    }
    if let Some(table) = comparison(&report.cases) {
        let _ = writeln!(out, "## {}\n", table.title);
        markdown_table(&table, &mut out);
    }
    if !report.verdicts.is_empty() {
        let _ = writeln!(out, "## Limits\n");
        for verdict in &report.verdicts {
            let word = if verdict.failed {
                "**failed**"
            } else {
                "passed"
            };
            let _ = writeln!(out, "- {word}: {}", marked(&verdict.to_string()));
        }
        out.push('\n');
    }
    let _ = writeln!(out, "## Where it comes from\n");
    for line in chain::lines(report) {
        let _ = writeln!(out, "    {line}");
    }
    out
}

/// Text whose characters mean nothing to Markdown.
fn marked(text: &str) -> String {
    let mut out = String::new();
    for c in text.chars() {
        if "\\`*_{}[]<>#|~".contains(c) {
            out.push('\\');
        }
        out.push(c);
    }
    out
}

fn markdown_table(table: &Table, out: &mut String) {
    let line = |cells: &[String], out: &mut String| {
        let cells: Vec<String> = cells.iter().map(|cell| marked(cell)).collect();
        let _ = writeln!(out, "| {} |", cells.join(" | "));
    };
    let mut header = table.header.clone();
    if let Some(corner) = header.first_mut().filter(|corner| corner.is_empty()) {
        corner.clone_from(&table.title);
    }
    line(&header, out);
    let rule = std::iter::once("---").chain(table.header.iter().skip(1).map(|_| "---:"));
    let _ = writeln!(out, "| {} |", rule.collect::<Vec<_>>().join(" | "));
    for row in &table.rows {
        line(row, out);
    }
    out.push('\n');
}

/// The tables in LaTeX, for `\input` into a paper; the rules are those of the package booktabs.
pub fn latex(report: &Report) -> String {
    let mut out = "% \\usepackage{booktabs}\n".to_owned();
    for line in chain::lines(report) {
        let _ = writeln!(out, "% {line}");
    }
    for case in &report.cases {
        for table in error_tables(case) {
            let name = format!("{} against {}", case.name(), report.role);
            latex_table(&table, &name, &mut out);
        }
    }
    if let Some(table) = comparison(&report.cases) {
        latex_table(&table, &report.title, &mut out);
    }
    out
}

fn latex_table(table: &Table, of: &str, out: &mut String) {
    let columns = "r".repeat(table.header.len().saturating_sub(1));
    let _ = writeln!(out, "\n\\begin{{table}}\n  \\centering");
    let _ = writeln!(out, "  \\caption{{{}: {}}}", set(&table.title), set(of));
    let _ = writeln!(out, "  \\begin{{tabular}}{{l{columns}}}\n    \\toprule");
    let line = |cells: &[String], out: &mut String| {
        let cells: Vec<String> = cells.iter().map(|cell| set(cell)).collect();
        let _ = writeln!(out, "    {} \\\\", cells.join(" & "));
    };
    line(&table.header, out);
    let _ = writeln!(out, "    \\midrule");
    for row in &table.rows {
        line(row, out);
    }
    let _ = writeln!(out, "    \\bottomrule\n  \\end{{tabular}}\n\\end{{table}}");
}

/// Text as LaTeX sets it.
fn set(text: &str) -> String {
    let mut out = String::new();
    for c in text.chars() {
        match c {
            '&' | '%' | '$' | '#' | '_' | '{' | '}' => {
                out.push('\\');
                out.push(c);
            }
            '\\' => out.push_str("\\textbackslash{}"),
            '~' => out.push_str("\\textasciitilde{}"),
            '^' => out.push_str("\\textasciicircum{}"),
            '<' | '>' | '|' => {
                let _ = write!(out, "${c}$");
            }
            '−' => out.push_str("$-$"),
            '–' => out.push_str("--"),
            '±' => out.push_str("$\\pm$"),
            'σ' => out.push_str("$\\sigma$"),
            '°' => out.push_str("$^\\circ$"),
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::super::case::tests::{run, truth};
    use super::super::{Limits, Reference, Settings, evaluate};
    use super::*;

    fn report() -> Report {
        let reference = truth(200);
        let mut runs = vec![
            run("a_1", &reference, 200, 1.0),
            run("b, 2", &reference, 200, 2.0),
        ];
        runs[0].stages = vec!["simulate --seed 7  # simulate 1.0".to_owned()];
        Report {
            title: "Pose report: a_1".to_owned(),
            role: "truth",
            reference_source: "truth.csv".to_owned(),
            reference_stages: Vec::new(),
            cases: evaluate(runs, &reference, &Settings::default()),
            reference: Reference::new(Vec::new(), Limits::default()),
            inertial: None,
            verdicts: Vec::new(),
            command: "report --markdown a_1.csv".to_owned(),
            date: None,
        }
    }

    /// The value of a row of the CSV.
    fn value(text: &str, run: &str, axis: &str, statistic: &str) -> String {
        let mut rows = csv::Reader::from_reader(text.as_bytes());
        let found = rows
            .records()
            .map(Result::unwrap)
            .find(|row| (&row[0], &row[2], &row[3]) == (run, axis, statistic));
        found.unwrap_or_else(|| panic!("no {run} {axis} {statistic}"))[4].to_owned()
    }

    #[test]
    fn every_statistic_is_a_row_of_its_name() {
        let report = report();
        let text = csv(&report).unwrap();
        let x = report.cases[1].axes[0].statistics.rms * 1e3;
        let written: f64 = value(&text, "b, 2", "x", "rms_mm").parse().unwrap();
        assert!((written - x).abs() < 1e-6);
        assert_eq!(value(&text, "a_1", "scans", "solved"), "196");
        assert_eq!(value(&text, "a_1", "nees.x_yaw", "dof"), "2");
        let mut rows = csv::Reader::from_reader(text.as_bytes());
        for row in rows.records().map(Result::unwrap) {
            let name = match &row[2] {
                "" => row[3].to_owned(),
                axis => format!("{axis}.{}", &row[3]),
            };
            assert!(json::statistic_exists(&name), "{name}");
            let case = report.cases.iter().find(|case| case.run == row[0]).unwrap();
            let gate = json::statistic(case, &name).map(json::rounded);
            assert_eq!(gate, row[4].parse().ok(), "{name}");
        }
    }

    #[test]
    fn tables_hold_what_the_terminal_shows() {
        let report = report();
        let text = markdown(&report);
        let x = fixed(report.cases[0].axes[0].statistics.rms * 1e3, 2);
        let row = text.lines().find(|line| line.starts_with("| x |")).unwrap();
        assert!(row.contains(&format!(" {x} |")), "{row} {x}");
        let header = text
            .lines()
            .find(|line| line.starts_with("| Error in mm |"))
            .unwrap();
        assert!(
            header.starts_with("| Error in mm | n | bias | std | rms |"),
            "{header}"
        );
        assert_eq!(header.matches('|').count(), row.matches('|').count());
        assert!(text.contains("| Error in deg | n | bias |"));
        assert!(text.contains("## a\\_1 against truth"));
        assert!(text.contains("+100 %") && text.contains("simulate --seed 7  # simulate 1.0"));
        assert!(text.contains("unknown"), "{text}");
    }

    #[test]
    fn latex_is_whole() {
        let text = latex(&report());
        for (open, close) in [
            ("\\begin{table}", "\\end{table}"),
            ("\\toprule", "\\bottomrule"),
            ("{", "}"),
        ] {
            assert_eq!(
                text.matches(open).count(),
                text.matches(close).count(),
                "{open}"
            );
        }
        assert_eq!(text.matches("\\begin{tabular}").count(), 5);
        assert!(text.contains("a\\_1 against truth"));
        assert_eq!(set("−1 ± 2°"), "$-$1 $\\pm$ 2$^\\circ$");
        for line in text.lines().filter(|line| !line.starts_with('%')) {
            assert!(line.is_ascii(), "{line}");
        }
        assert_eq!(
            set("50 % of a_b & c^2 ~ {x} \\"),
            "50 \\% of a\\_b \\& c\\textasciicircum{}2 \\textasciitilde{} \\{x\\} \\textbackslash{}"
        );
    }

    #[test]
    fn markdown_text_means_nothing() {
        assert_eq!(marked("a|b *c* _d_ <e>"), "a\\|b \\*c\\* \\_d\\_ \\<e\\>");
    }
}
