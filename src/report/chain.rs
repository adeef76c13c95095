//! Where a report comes from: the commands that made each of its inputs, and its own.

use super::case::Report;

/// What is said of an input that does not say where it comes from.
const UNKNOWN: &str = "unknown: the stream does not say; CSV does where it was written with --meta";

/// The chain in lines: what each input is called, its stages below it, and this report at the end.
pub fn lines(report: &Report) -> Vec<String> {
    let mut lines = Vec::new();
    let mut add = |name: String, stages: &[String]| {
        lines.push(name);
        if stages.is_empty() {
            lines.push(format!("  {UNKNOWN}"));
        }
        lines.extend(stages.iter().map(|stage| format!("  {stage}")));
    };
    let mut told: Vec<&str> = Vec::new();
    for case in &report.cases {
        // The zones of a run come from one file.
        if !told.contains(&case.run.as_str()) {
            told.push(&case.run);
            add(format!("{} ({})", case.run, case.source), &case.stages);
        }
    }
    if !report.cases.is_empty() {
        let name = format!("{} ({})", report.role, report.reference_source);
        add(name, &report.reference_stages);
    }
    lines.push(format!(
        "{}  # report {}",
        report.command,
        env!("CARGO_PKG_VERSION")
    ));
    lines
}
