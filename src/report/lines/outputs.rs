//! Scores of lines as a table for people and as JSON; the names that `--fail-if` takes.

use super::{Matching, Score};
use crate::report::json;
use crate::report::number::{self, count, fixed};
use serde_json::{Map, Value, json};

/// The columns: title, unit, digits behind the point, value.
type Column = (&'static str, &'static str, usize, fn(&Score) -> f64);

const COLUMNS: [Column; 11] = [
    ("true", "", 0, |s| s.true_lines as f64),
    ("lines", "", 0, |s| s.lines as f64),
    ("matches", "", 0, |s| s.matches as f64),
    ("TruePos", "%", 1, Score::true_positive_pct),
    ("FalsePos", "%", 1, Score::false_positive_pct),
    ("d", "cm", 2, |s| 100.0 * s.d_m.std),
    ("alpha", "deg", 3, |s| s.alpha_rad.std.to_degrees()),
    ("centre", "cm", 2, |s| 100.0 * s.centre_m.std),
    ("NEES", "", 2, |s| s.nees[0]),
    ("median", "", 2, |s| s.nees[1]),
    ("length", "", 3, |s| s.length_ratio),
];

const WIDTH: usize = 9;

/// The scores as a table. `ascii` leaves out what is not ASCII.
pub fn table(truth: &str, scores: &[Score], matching: &Matching, ascii: bool) -> String {
    let names = scores.iter().map(|s| s.name.chars().count());
    let first = names.max().unwrap_or(0).max(12);
    let mut out = format!("Lines against {truth}\n\n{:first$}", "");
    for (title, ..) in COLUMNS {
        out.push_str(&format!("{title:>WIDTH$}"));
    }
    out.push_str(&format!("\n{:first$}", ""));
    for (_, unit, ..) in COLUMNS {
        out.push_str(&format!("{unit:>WIDTH$}"));
    }
    out = out.trim_end().to_owned();
    out.push('\n');
    for score in scores {
        out.push_str(&format!("{:first$}", score.name));
        for (_, _, digits, value) in COLUMNS {
            let text = match digits {
                0 => count(value(score) as usize),
                _ => fixed(value(score), digits),
            };
            out.push_str(&format!("{text:>WIDTH$}"));
        }
        out.push('\n');
    }
    out.push_str(&format!(
        "\nd, alpha and centre (offset at the true segment's centre) are standard deviations over the \
         matches;\nNEES is with each line's own covariance (2 where it is honest; its median 1.39); \
         length is found over\ntrue. A match: chi-square gate {} % for {} cm of point noise with a \
         floor of {} cm and {} deg,\n{} % overlap, lines of at least {} beams and {} m.\n",
        plain(100.0 * matching.probability),
        plain(100.0 * matching.point_sigma_m),
        plain(100.0 * matching.floor_m),
        plain(matching.floor_rad.to_degrees()),
        plain(100.0 * matching.overlap),
        matching.min_points,
        plain(matching.min_length_m),
    ));
    if ascii { number::ascii(&out) } else { out }
}

/// A given number as it was given: degrees may have gone through radians.
fn plain(value: f64) -> f64 {
    (value * 1e9).round() / 1e9
}

/// The scores as indented JSON with a line feed at its end.
///
/// # Errors
/// None in practice: everything in it can be written.
pub fn json(
    truth: &str,
    scores: &[Score],
    matching: &Matching,
) -> Result<String, serde_json::Error> {
    let runs: Vec<Value> = scores.iter().map(object).collect();
    let whole = json!({
        "truth": truth,
        "matching": {
            "point_sigma_m": matching.point_sigma_m,
            "probability": matching.probability,
            "floor_m": matching.floor_m,
            "floor_deg": plain(matching.floor_rad.to_degrees()),
            "overlap": matching.overlap,
            "min_points": matching.min_points,
            "min_length_m": matching.min_length_m,
        },
        "runs": runs,
    });
    json::text(&whole)
}

/// A statistic's name, as `--fail-if` takes it and JSON nests it at the point, and its value.
type Statistic = (&'static str, fn(&Score) -> f64);

/// Every statistic.
const STATISTICS: [Statistic; 17] = [
    ("true_lines", |s| s.true_lines as f64),
    ("lines", |s| s.lines as f64),
    ("matches", |s| s.matches as f64),
    ("truepos_pct", Score::true_positive_pct),
    ("falsepos_pct", Score::false_positive_pct),
    ("d.std_mm", |s| 1e3 * s.d_m.std),
    ("d.bias_mm", |s| 1e3 * s.d_m.mean),
    ("d.median_abs_mm", |s| 1e3 * s.d_m.median_abs),
    ("alpha.std_deg", |s| s.alpha_rad.std.to_degrees()),
    ("alpha.bias_deg", |s| s.alpha_rad.mean.to_degrees()),
    ("alpha.median_abs_deg", |s| {
        s.alpha_rad.median_abs.to_degrees()
    }),
    ("centre.std_mm", |s| 1e3 * s.centre_m.std),
    ("centre.bias_mm", |s| 1e3 * s.centre_m.mean),
    ("centre.median_abs_mm", |s| 1e3 * s.centre_m.median_abs),
    ("nees.mean", |s| s.nees[0]),
    ("nees.median", |s| s.nees[1]),
    ("length.median_ratio", |s| s.length_ratio),
];

/// Whether there is a statistic of this name.
pub(in crate::report) fn statistic_exists(name: &str) -> bool {
    STATISTICS.iter().any(|(known, _)| *known == name)
}

/// A statistic's value; none where it has no value.
pub(in crate::report) fn statistic(score: &Score, name: &str) -> Option<f64> {
    let (_, value) = STATISTICS.iter().find(|(known, _)| *known == name)?;
    Some(value(score)).filter(|value| value.is_finite())
}

fn object(score: &Score) -> Value {
    let mut fields = Map::new();
    fields.insert("name".to_owned(), json!(score.name));
    fields.insert("source".to_owned(), json!(score.source));
    for (name, value) in STATISTICS {
        let value = value(score);
        let value = match name {
            "true_lines" | "lines" | "matches" => json!(value as u64),
            _ => json::value(value),
        };
        match name.split_once('.') {
            None => {
                fields.insert(name.to_owned(), value);
            }
            Some((group, name)) => {
                let group = fields.entry(group).or_insert_with(|| json!({}));
                if let Value::Object(group) = group {
                    group.insert(name.to_owned(), value);
                }
            }
        }
    }
    Value::Object(fields)
}
