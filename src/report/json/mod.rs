//! The report for machines, and the names of its statistics.
//!
//! The names that `--fail-if` takes are the paths through one case's object: `x.rms_mm`,
//! `scans.solved_pct`, `nees.x_yaw.nees`. Numbers are rounded to six decimals of their unit (a
//! nanometre, 4e-6 arc seconds); a value that does not exist is null.

mod sections;

use super::association::Association;
use super::axis::{AXES, Axis};
use super::case::{AxisResult, Case, Report};
use super::consistency::{Consistency, GROUPS};
use super::inertial::allan::Point;
use super::inertial::{Inertial, Measured};
use super::scans::{Scans, Spread};
use super::statistics::Statistics;
use super::workspace::{CELL_AXES, Cells};
use serde::ser::{Serialize, SerializeMap, Serializer};

/// JSON whose objects keep their order.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Tree {
    Number(f64),
    /// A number with all its digits.
    Exact(f64),
    Count(usize),
    Flag(bool),
    Text(String),
    List(Vec<Tree>),
    Object(Vec<(String, Tree)>),
    Null,
}

impl Serialize for Tree {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Tree::Number(v) if v.is_finite() => serializer.serialize_f64(rounded(*v)),
            Tree::Exact(v) if v.is_finite() => serializer.serialize_f64(*v),
            Tree::Number(_) | Tree::Exact(_) | Tree::Null => serializer.serialize_none(),
            Tree::Count(n) => serializer.serialize_u64(*n as u64),
            Tree::Flag(flag) => serializer.serialize_bool(*flag),
            Tree::Text(text) => serializer.serialize_str(text),
            Tree::List(items) => serializer.collect_seq(items),
            Tree::Object(fields) => {
                let mut map = serializer.serialize_map(Some(fields.len()))?;
                for (name, value) in fields {
                    map.serialize_entry(name, value)?;
                }
                map.end()
            }
        }
    }
}

pub(super) fn rounded(value: f64) -> f64 {
    let scaled = value * 1e6;
    if scaled.abs() < 9e15 {
        // Adding zero turns -0 into 0.
        scaled.round() / 1e6 + 0.0
    } else {
        value
    }
}

/// A number in JSON made by hand: six decimals of its unit, null for what has no value.
pub(super) fn value(value: f64) -> serde_json::Value {
    if value.is_finite() {
        rounded(value).into()
    } else {
        serde_json::Value::Null
    }
}

/// Indented JSON with a line feed at its end.
///
/// # Errors
/// None in practice: everything in a report can be written.
pub(super) fn text(value: &impl Serialize) -> Result<String, serde_json::Error> {
    let mut text = serde_json::to_string_pretty(value)?;
    text.push('\n');
    Ok(text)
}

fn object<const N: usize>(fields: [(&str, Tree); N]) -> Tree {
    Tree::Object(fields.map(|(name, value)| (name.to_owned(), value)).into())
}

fn texts(items: &[String]) -> Tree {
    Tree::List(items.iter().cloned().map(Tree::Text).collect())
}

/// The whole report as indented JSON with a line feed at its end.
///
/// # Errors
/// None in practice: everything in it can be written.
pub fn write(report: &Report) -> Result<String, serde_json::Error> {
    let association = match report.reference.association() {
        Association::Interpolated => "interpolated",
        Association::Nearest => "nearest",
    };
    let reference = object([
        ("role", Tree::Text(report.role.to_owned())),
        ("source", Tree::Text(report.reference_source.clone())),
        ("points", Tree::Count(report.reference.len())),
        ("incomplete", Tree::Count(report.reference.incomplete)),
        ("repeated", Tree::Count(report.reference.repeated)),
        ("unsorted", Tree::Count(report.reference.unsorted)),
        ("association", Tree::Text(association.to_owned())),
        ("max_diff_s", Tree::Number(report.reference.max_diff_s())),
        ("stages", texts(&report.reference_stages)),
    ]);
    let gates = report.verdicts.iter().map(|v| {
        object([
            ("condition", Tree::Text(v.gate.clone())),
            ("run", Tree::Text(v.case.clone())),
            ("value", v.value.map_or(Tree::Null, Tree::Number)),
            ("failed", Tree::Flag(v.failed)),
            ("excess", Tree::Number(v.excess)),
        ])
    });
    let runs = report.cases.iter().map(|c| case_tree(c, true)).collect();
    let mut fields = vec![
        ("version", Tree::Text(env!("CARGO_PKG_VERSION").to_owned())),
        ("reference", reference),
        ("runs", Tree::List(runs)),
        ("gates", Tree::List(gates.collect())),
    ];
    if let Some(inertial) = &report.inertial {
        fields.push(("imu", inertial_tree(inertial)));
    }
    let fields = fields
        .into_iter()
        .map(|(name, value)| (name.to_owned(), value));
    let tree = Tree::Object(fields.collect());
    text(&tree)
}

/// A record of an IMU at rest. Allan deviations are in the channel's unit, and not rounded to six
/// decimals of it: they may be smaller.
pub(super) fn inertial_tree(inertial: &Inertial) -> Tree {
    let channel = |measured: &Measured| {
        let kind = measured.channel.kind;
        let mut fields = vec![
            ("unit".to_owned(), Tree::Text(kind.unit().to_owned())),
            ("mean".to_owned(), Tree::Number(measured.mean)),
            ("std".to_owned(), Tree::Number(measured.std)),
        ];
        if let Some(sheet) = kind.sheet().filter(|_| !measured.curve.is_empty()) {
            let list = |value: fn(&Point) -> f64| {
                Tree::List(
                    measured
                        .curve
                        .iter()
                        .map(|p| Tree::Exact(value(p)))
                        .collect(),
                )
            };
            let more = [
                ("random_walk", Tree::Number(measured.walk)),
                ("random_walk_unit", Tree::Text(kind.walk_unit().to_owned())),
                ("random_walk_sheet", Tree::Number(sheet.walk)),
                ("bias_sheet", Tree::Number(sheet.bias)),
                ("instability", Tree::Number(measured.instability)),
                (
                    "instability_unit",
                    Tree::Text(kind.instability_unit().to_owned()),
                ),
                ("instability_sheet", Tree::Number(sheet.instability)),
                (
                    "instability_tau_s",
                    Tree::Number(measured.instability_tau_s),
                ),
                ("has_floor", Tree::Flag(measured.has_floor)),
                ("tau_s", list(|p| p.tau_s)),
                ("allan_deviation", list(|p| p.deviation)),
                ("relative_error", list(|p| p.error)),
            ];
            fields.extend(more.map(|(name, value)| (name.to_owned(), value)));
        }
        (measured.channel.name.to_owned(), Tree::Object(fields))
    };
    object([
        ("source", Tree::Text(inertial.source.clone())),
        ("axes", Tree::Text(inertial.axes.name().to_owned())),
        ("samples", Tree::Count(inertial.samples)),
        ("duration_s", Tree::Number(inertial.duration_s)),
        ("period_s", Tree::Exact(inertial.period_s)),
        ("gaps", Tree::Count(inertial.gaps)),
        (
            "channels",
            Tree::Object(inertial.channels.iter().map(channel).collect()),
        ),
        ("notes", texts(&inertial.notes)),
    ])
}

pub(super) fn case_tree(case: &Case, with_cells: bool) -> Tree {
    let text = |t: &String| Tree::Text(t.clone());
    let mut fields = vec![
        ("run".to_owned(), text(&case.run)),
        (
            "zone".to_owned(),
            case.zone.as_ref().map_or(Tree::Null, text),
        ),
        ("source".to_owned(), text(&case.source)),
        ("duration_s".to_owned(), Tree::Number(case.duration_s())),
        ("matching".to_owned(), matching_tree(case)),
        ("scans".to_owned(), scans_tree(case)),
    ];
    for (axis, result) in AXES.iter().zip(&case.axes) {
        fields.push((axis.name.to_owned(), axis_tree(axis, result)));
    }
    let sections = sections::sections(case, with_cells);
    fields.extend(
        sections
            .into_iter()
            .map(|(name, tree)| (name.to_owned(), tree)),
    );
    let groups = GROUPS
        .iter()
        .zip(&case.groups)
        .map(|((name, _), c)| ((*name).to_owned(), Tree::Object(consistency_fields(c))));
    fields.push(("nees".to_owned(), Tree::Object(groups.collect())));
    if with_cells {
        let cells = case.cells.as_ref().map_or(Tree::Null, cells_tree);
        fields.push(("workspace".to_owned(), cells));
        fields.push(("stages".to_owned(), texts(&case.stages)));
        fields.push(("notes".to_owned(), texts(&case.notes)));
    }
    Tree::Object(fields)
}

fn matching_tree(case: &Case) -> Tree {
    let m = &case.matching;
    object([
        ("matched", Tree::Count(m.matched())),
        ("exact", Tree::Count(m.exact)),
        ("interpolated", Tree::Count(m.interpolated)),
        ("nearest", Tree::Count(m.nearest)),
        ("unmatched", Tree::Count(m.unmatched())),
        ("outside", Tree::Count(m.outside)),
        ("gap", Tree::Count(m.gap)),
        ("jump", Tree::Count(m.jump)),
    ])
}

fn scans_tree(case: &Case) -> Tree {
    let scans: &Scans = &case.scans;
    let statuses = scans.statuses.iter().map(|t| {
        object([
            ("status", Tree::Text(t.status.clone())),
            ("solved", Tree::Flag(t.solved)),
            ("count", Tree::Count(t.count)),
        ])
    });
    let words = scans
        .words
        .iter()
        .map(|(w, n)| ((*w).to_owned(), Tree::Count(*n)));
    let spread = |s: Option<Spread>| {
        object([
            ("min", s.map_or(Tree::Null, |s| Tree::Count(s.min as usize))),
            ("mean", s.map_or(Tree::Null, |s| Tree::Number(s.mean))),
            ("max", s.map_or(Tree::Null, |s| Tree::Count(s.max as usize))),
        ])
    };
    object([
        ("rows", Tree::Count(scans.rows)),
        ("solved", Tree::Count(scans.solved)),
        ("partial", Tree::Count(scans.partial)),
        ("refused", Tree::Count(scans.refused())),
        ("lost", Tree::Count(scans.lost)),
        ("solved_pct", Tree::Number(scans.solved_pct())),
        ("unexplained", Tree::Count(scans.unexplained)),
        ("unsorted", Tree::Count(case.input.unsorted)),
        ("repeated", Tree::Count(case.input.repeated)),
        ("edges", spread(scans.edges)),
        ("votes", spread(scans.votes)),
        ("statuses", Tree::List(statuses.collect())),
        (WORDS, Tree::Object(words.collect())),
    ])
}

/// The object whose fields are the status words that occurred.
const WORDS: &str = "words";

/// A block of statistics, with the unit in the names.
fn statistics_fields(axis: &Axis, statistics: &Statistics) -> Vec<(String, Tree)> {
    let s = statistics.scaled(axis.factor);
    let mut fields = vec![("n".to_owned(), Tree::Count(s.n))];
    for (name, value) in [
        ("bias", s.bias),
        ("std", s.std),
        ("rms", s.rms),
        ("median", s.median),
        ("mad", s.mad),
        ("p95", s.p95),
        ("p99", s.p99),
        ("max", s.max),
        ("min", s.min),
    ] {
        fields.push((format!("{name}_{}", axis.unit), Tree::Number(value)));
    }
    fields.push((format!("sse_{}2", axis.unit), Tree::Number(s.sse)));
    fields
}

fn axis_tree(axis: &Axis, result: &AxisResult) -> Tree {
    let mut fields = statistics_fields(axis, &result.statistics);
    if !matches!(axis.name, "position" | "rotation") {
        fields.extend(consistency_fields(&result.consistency).into_iter().skip(2));
        for (k, share) in result.within.iter().enumerate() {
            fields.push((
                format!("within_{}s_pct", k + 1),
                Tree::Number(100.0 * share),
            ));
        }
    }
    Tree::Object(fields)
}

fn consistency_fields(c: &Consistency) -> Vec<(String, Tree)> {
    let fields = [
        ("dof", Tree::Count(c.dof)),
        ("n", Tree::Count(c.n)),
        ("nees", Tree::Number(c.nees)),
        ("nees_low", Tree::Number(c.low)),
        ("nees_high", Tree::Number(c.high)),
        ("effective_n", Tree::Number(c.effective_n)),
    ];
    fields.map(|(name, value)| (name.to_owned(), value)).into()
}

fn cells_tree(cells: &Cells) -> Tree {
    let rows = cells.filled().map(|(index, cell)| {
        let [y, z] = cells.layout.centre_m(index);
        let mut fields = vec![
            ("y_m".to_owned(), Tree::Number(y)),
            ("z_m".to_owned(), Tree::Number(z)),
            ("n".to_owned(), Tree::Count(cell.n as usize)),
            ("edges".to_owned(), Tree::Number(cell.edges())),
            ("votes".to_owned(), Tree::Number(cell.votes())),
        ];
        for (k, i) in CELL_AXES.iter().enumerate() {
            let axis = &AXES[*i];
            let values = [
                ("bias", cell.bias(k)),
                ("rms", cell.rms(k)),
                ("max", cell.max(k)),
            ];
            for (name, value) in values {
                let name = format!("{}_{name}_{}", axis.name, axis.unit);
                fields.push((name, Tree::Number(value * axis.factor)));
            }
        }
        Tree::Object(fields)
    });
    let [dy, dz] = cells.layout.size_m;
    object([
        ("cell_y_m", Tree::Number(dy)),
        ("cell_z_m", Tree::Number(dz)),
        ("cells", Tree::List(rows.collect())),
    ])
}

/// Whether a case has a statistic of this name (it may have no value all the same).
pub(super) fn statistic_exists(name: &str) -> bool {
    let leaf = |t: &Tree| matches!(t, Tree::Number(_) | Tree::Count(_));
    if let Some((delta, rest)) = sections::relative_path(name) {
        return find(&sections::relative_names(delta), rest).is_some_and(leaf);
    }
    is_word_count(name)
        || is_reason_count(name)
        || find(&case_tree(&Case::empty(), false), name).is_some_and(leaf)
        || is_spread(name)
}

/// The value of a statistic, in the unit that its name says.
pub(super) fn statistic(case: &Case, name: &str) -> Option<f64> {
    let number = |tree: Option<&Tree>| match tree {
        Some(Tree::Number(v)) => Some(*v).filter(|v| v.is_finite()),
        Some(Tree::Count(n)) => Some(*n as f64),
        _ => None,
    };
    if let Some((delta, rest)) = sections::relative_path(name) {
        return number(find(&sections::relative_of(case, &delta)?, rest));
    }
    let tree = case_tree(case, false);
    match find(&tree, name) {
        None if is_word_count(name) || is_reason_count(name) => Some(0.0),
        found => number(found),
    }
}

/// `refused.no-edges`: a reason that did not occur occurred zero times.
fn is_reason_count(name: &str) -> bool {
    let reason = name.strip_prefix("refused.");
    reason.is_some_and(super::quality::is_reason)
}

/// The counts that a run without edges or votes has no spread of.
fn is_spread(name: &str) -> bool {
    let name = name.strip_prefix("scans.");
    let spread = name.and_then(|name| name.split_once('.'));
    spread.is_some_and(|(what, which)| {
        ["edges", "votes"].contains(&what) && ["min", "mean", "max"].contains(&which)
    })
}

/// `scans.words.few-edges`: a status word that did not occur occurred zero times.
fn is_word_count(name: &str) -> bool {
    let word = name.strip_prefix("scans.words.");
    word.is_some_and(|word| {
        let mut status = crate::record::Status::OK;
        word != "ok"
            && !word.is_empty()
            && crate::record::Value::parse_text(&mut status, word.as_bytes()).is_ok()
    })
}

fn find<'a>(tree: &'a Tree, path: &str) -> Option<&'a Tree> {
    path.split('.').try_fold(tree, |tree, part| match tree {
        Tree::Object(fields) => fields.iter().find(|(name, _)| name == part).map(|(_, t)| t),
        _ => None,
    })
}

#[cfg(test)]
mod tests {
    use super::super::case::tests::{run, truth};
    use super::super::{Settings, evaluate};
    use super::*;

    #[test]
    fn names_lead_to_values() {
        let reference = truth(200);
        let case = &evaluate(
            vec![run("a", &reference, 200, 1.0)],
            &reference,
            &Settings::default(),
        )[0];
        let x = &case.axes[0].statistics;
        assert_eq!(statistic(case, "x.rms_mm"), Some(x.rms * 1e3));
        let yaw = case.axes[5].statistics.p95.to_degrees();
        assert!((statistic(case, "yaw.p95_deg").unwrap() - yaw).abs() < 1e-12);
        assert_eq!(statistic(case, "scans.solved_pct"), Some(98.0));
        assert_eq!(statistic(case, "scans.words.no-edges"), Some(4.0));
        assert_eq!(statistic(case, "scans.words.no-yaw"), Some(0.0));
        for name in [
            "x.rms_mm",
            "nees.x_yaw.nees",
            "z.within_3s_pct",
            "scans.words.no-yaw",
            "scans.votes.max",
            "refused.total",
            "refused.no-upper+no-walls",
            "delay.delay_ms",
            "delay.share_mm",
            "alignment.yaw_deg",
            "along.bias_mm",
            "cross.p95_mm",
            "rotation.rms_deg",
            "rpe.1s.position.rms_mm",
            "rpe.0.5m.yaw.p95_deg",
            "rpe.10f.pairs",
            "orientation.yaw.drift_deg_h",
            "orientation.rate.z.scale",
            "quality.residual.upper.rms_mm",
            "quality.points.left",
            "input.jumps",
            "stability.x.floor_mm",
        ] {
            assert!(statistic_exists(name), "{name}");
        }
        for name in [
            "",
            "x",
            "x.rms",
            "zone",
            "run",
            "x.rms_mm.more",
            "scans.words.odd",
            "scans.words.",
            "alignment.note",
            "alignment.kind",
            "delay",
            "delay.curve",
            "rpe.1s",
            "rpe.1.position.rms_mm",
            "rpe.1s.position.rms_deg",
            "refused.odd",
            "scans.votes.median",
        ] {
            assert!(!statistic_exists(name), "{name}");
        }
    }

    #[test]
    fn numbers_are_rounded_and_missing_ones_null() {
        let tree = object([
            ("a", Tree::Number(f64::NAN)),
            ("b", Tree::Number(-1e-9)),
            ("c", Tree::Number(1.23456789)),
        ]);
        assert_eq!(
            serde_json::to_string(&tree).unwrap(),
            r#"{"a":null,"b":0.0,"c":1.234568}"#
        );
    }
}
