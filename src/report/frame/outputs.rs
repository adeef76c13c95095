//! A survey as a table for people and as JSON; the names that `--fail-if` takes.

use super::Survey;
use crate::report::axis::{Axis, components};
use crate::report::json;
use crate::report::number::{self, fixed};
use serde_json::{Map, Value, json};

/// The survey as text. `ascii` leaves out what is not ASCII.
pub fn table(survey: &Survey, ascii: bool) -> String {
    let f = &survey.frame;
    let name = if f.name.is_empty() {
        &survey.source
    } else {
        &f.name
    };
    let b = &f.bounds;
    let mut out = format!(
        "{name}: {} m deep, {} m wide, {} m high; {}, {}\n\n",
        b.dx_m, b.dy_m, b.dz_m, f.scanner.model, survey.mode
    );
    for (well, text) in survey.findings() {
        out.push_str(if well { "  ok    " } else { "  look  " });
        out.push_str(&text);
        out.push('\n');
    }
    let [ys, zs] = survey.workspace_m;
    out.push_str(&format!(
        "\nLeast standard deviation that one scan allows over y {} to {}, z {} to {} m\n({}):\n\n",
        ys[0], ys[1], zs[0], zs[1], survey.conditions
    ));
    out.push_str(&format!(
        "{:8}{:>6}{:>12}{:>12}\n",
        "", "", "rms", "worst place"
    ));
    for (k, axis) in components() {
        let [rms, worst] = survey
            .sigma(k)
            .map(|s| fixed(s * axis.factor, axis.decimals + 1));
        out.push_str(&format!(
            "{:8}{:>6}{rms:>12}{worst:>12}\n",
            axis.name, axis.unit
        ));
    }
    if ascii { number::ascii(&out) } else { out }
}

/// The survey as indented JSON with a line feed at its end.
///
/// # Errors
/// None in practice: everything in it can be written.
pub fn json(survey: &Survey) -> Result<String, serde_json::Error> {
    let mut whole = Map::new();
    whole.insert("source".to_owned(), json!(survey.source));
    whole.insert("frame".to_owned(), serde_json::to_value(&survey.frame)?);
    whole.insert("mode".to_owned(), json!(survey.mode));
    whole.insert("conditions".to_owned(), json!(survey.conditions));
    let [y, z] = survey.workspace_m;
    whole.insert("workspace".to_owned(), json!({ "y_m": y, "z_m": z }));
    let findings: Vec<Value> = survey
        .findings()
        .into_iter()
        .map(|(well, text)| json!({ "well": well, "text": text }))
        .collect();
    whole.insert("findings".to_owned(), json!(findings));
    let gaps = survey.gaps.iter().map(|g| {
        json!({ "strips": g.strips, "face": g.face.name(), "least_mm": json::value(g.least_m * 1e3) })
    });
    whole.insert("gaps".to_owned(), Value::Array(gaps.collect()));
    for name in names() {
        let value = json::value(statistic(survey, &name).unwrap_or(f64::NAN));
        match name.split_once('.') {
            None => {
                whole.insert(name, value);
            }
            Some((group, rest)) => {
                let group = whole.entry(group).or_insert_with(|| json!({}));
                if let Value::Object(group) = group {
                    group.insert(rest.to_owned(), value);
                }
            }
        }
    }
    let cell = |place: &super::Place| {
        let mut fields = Map::new();
        fields.insert("y_m".to_owned(), json::value(place.at_m[0]));
        fields.insert("z_m".to_owned(), json::value(place.at_m[1]));
        fields.insert("poses".to_owned(), json!(place.tried));
        fields.insert("told".to_owned(), json!(place.told));
        fields.insert("edges_least".to_owned(), json!(place.edges[0]));
        for (k, axis) in components() {
            let name = format!("{}_sigma_{}", axis.name, axis.unit);
            fields.insert(name, json::value(place.sigma(k) * axis.factor));
        }
        Value::Object(fields)
    };
    whole.insert("cells".to_owned(), survey.places.iter().map(cell).collect());
    json::text(&Value::Object(whole))
}

/// Every statistic's name.
fn names() -> Vec<String> {
    let of_axis =
        |(_, a): (usize, &Axis)| ["sigma", "worst"].map(|w| format!("{}.{w}_{}", a.name, a.unit));
    let plain = [
        "told_pct",
        "edges.least",
        "edges.mean",
        "walls.both_pct",
        "walls.one_pct",
        "yaw_range.both_deg",
        "yaw_range.one_deg",
        "gap.least_mm",
    ];
    components()
        .flat_map(of_axis)
        .chain(plain.map(str::to_owned))
        .collect()
}

/// Whether there is a statistic of this name.
pub(in crate::report) fn statistic_exists(name: &str) -> bool {
    names().iter().any(|known| known == name)
}

/// A statistic's value; none where it has no value.
pub(in crate::report) fn statistic(survey: &Survey, name: &str) -> Option<f64> {
    let value = match name {
        "told_pct" => survey.share_pct(|p| p.told),
        "edges.least" => survey.edges()[0],
        "edges.mean" => survey.edges()[1],
        "walls.one_pct" => survey.share_pct(|p| p.walls[0]),
        "walls.both_pct" => survey.share_pct(|p| p.walls[1]),
        "yaw_range.both_deg" => survey.least_yaw()[0].to_degrees(),
        "yaw_range.one_deg" => survey.least_yaw()[1].to_degrees(),
        "gap.least_mm" => survey
            .gaps
            .iter()
            .map(|g| g.least_m * 1e3)
            .reduce(f64::min)?,
        _ => {
            let (axis_name, rest) = name.split_once('.')?;
            let (k, axis) = components().find(|(_, a)| a.name == axis_name)?;
            let which = usize::from(rest.starts_with("worst"));
            survey.sigma(k)[which] * axis.factor
        }
    };
    Some(value).filter(|v| v.is_finite())
}
