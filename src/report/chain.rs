//! Where a report comes from: the commands that made each of its inputs, and its own.

use super::case::Report;

/// What is said of an input that does not say where it comes from.
pub(super) const UNKNOWN: &str =
    "unknown: the stream does not say; CSV does where it was written with --meta";

/// An input and the commands that made it, first one first; none where it does not say.
pub(super) struct Made<'a> {
    pub(super) name: String,
    pub(super) stages: &'a [String],
}

/// The runs, and what they are compared with.
pub(super) fn inputs(report: &Report) -> Vec<Made<'_>> {
    let mut inputs: Vec<Made<'_>> = Vec::new();
    for case in &report.cases {
        let name = format!("{} ({})", case.run, case.source);
        // The zones of a run come from one file.
        if !inputs.iter().any(|made| made.name == name) {
            let stages = &case.stages;
            inputs.push(Made { name, stages });
        }
    }
    if !report.cases.is_empty() {
        inputs.push(Made {
            name: format!("{} ({})", report.role, report.reference_source),
            stages: &report.reference_stages,
        });
    }
    inputs
}

/// The report's own command.
pub(super) fn own(report: &Report) -> String {
    format!("{}  # report {}", report.command, env!("CARGO_PKG_VERSION"))
}

/// The chain in lines: what each input is called, its stages below it, and this report at the end.
pub fn lines(report: &Report) -> Vec<String> {
    let mut lines = Vec::new();
    for Made { name, stages } in inputs(report) {
        lines.push(name);
        if stages.is_empty() {
            lines.push(format!("  {UNKNOWN}"));
        }
        lines.extend(stages.iter().map(|stage| format!("  {stage}")));
    }
    lines.push(own(report));
    lines
}
