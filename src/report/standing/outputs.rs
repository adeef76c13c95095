//! Standstills as a table for people, as CSV and as JSON; the names that `--fail-if` takes.

use super::{Criteria, Found, Standing};
use crate::record::text::push_f64;
use crate::report::axis::{Axis, components};
use crate::report::json;
use crate::report::number::{self, count, fixed, signed};
use serde_json::{Map, Value, json};

const WIDTH: usize = 12;

/// The standstills as a table. `ascii` leaves out what is not ASCII.
pub fn table(source: &str, found: &Found, criteria: &Criteria, ascii: bool) -> String {
    let mut out = format!(
        "Standstills in {source}: {} of at least {} s ({} of {} poses have numbers)\n\n",
        count(found.standing.len()),
        criteria.least_s,
        count(found.poses[0]),
        count(found.poses[1]),
    );
    out.push_str(&format!(
        "{:>3} {:>9} {:>8} {:>7}  {:<11}",
        "", "from", "for", "poses", ""
    ));
    for (_, axis) in components() {
        let unit = format!("{} {}", axis.name, axis.unit);
        out.push_str(&format!("{unit:>WIDTH$}"));
    }
    out.push('\n');
    for (i, standing) in found.standing.iter().enumerate() {
        let from_s = standing.first.since_s(found.start);
        let head = format!(
            "{:>3} {:>7} s {:>6} s {:>7}  ",
            i + 1,
            fixed(from_s, 2),
            fixed(standing.duration_s(), 2),
            count(standing.poses)
        );
        let blank = " ".repeat(head.chars().count());
        out.push_str(&head);
        let mut row = |name: &str, indent: &str, value: &dyn Fn(usize, &Axis) -> String| {
            let mut line = format!("{indent}{name:<11}");
            for (k, axis) in components() {
                line.push_str(&format!("{:>WIDTH$}", value(k, axis)));
            }
            out.push_str(line.trim_end());
            out.push('\n');
        };
        let c = &standing.components;
        row("mean", "", &|k, a| fixed(c[k].mean * a.factor, a.decimals));
        row("sigma", &blank, &|k, a| {
            fixed(c[k].sigma * a.factor, a.decimals + 1)
        });
        row("  stays", &blank, &|k, a| {
            fixed(c[k].fixed * a.factor, a.decimals + 1)
        });
        row("independent", &blank, &|k, _| fixed(c[k].effective_n, 0));
        if let Some(d) = &standing.correction {
            row("to desired", &blank, &|k, a| {
                signed(d[k] * a.factor, a.decimals)
            });
        }
    }
    out.push_str(
        "\nsigma is that of the mean: its averaging part falls with the number of independent poses, \
         what stays\ndoes not (the part of the poses' own covariance that their scatter does not show). \
         To desired is desired\nminus mean, along the axes of B and in its angles.\n",
    );
    for note in notes(found, criteria) {
        out.push_str(&note);
        out.push('\n');
    }
    if ascii { number::ascii(&out) } else { out }
}

/// What a reader must know besides.
fn notes(found: &Found, criteria: &Criteria) -> Vec<String> {
    let mut notes = Vec::new();
    if found.creeping > 0 {
        let speed = fixed(criteria.still_m_s * 1e3, 2);
        let turn = fixed(criteria.still_rad_s.to_degrees(), 3);
        let n = count(found.creeping);
        notes.push(format!(
            "{n} left out: as a whole they move faster than {speed} mm/s or {turn} deg/s."
        ));
    }
    let out: usize = found.standing.iter().map(|s| s.left_out).sum();
    if out > 0 {
        notes.push(format!(
            "{} poses contradict the others of their standstill and are in no mean.",
            count(out)
        ));
    }
    if found.without_covariance && found.poses[0] > 0 {
        notes.push("The poses have no covariances: what stays is not known.".to_owned());
    }
    notes
}

/// One row a standstill, SI units and radians, stamps in nanoseconds.
pub fn csv(found: &Found) -> String {
    let mut out = b"interval,first_ns,last_ns,duration_s,poses,left_out".to_vec();
    let unit = |axis: &Axis| if axis.unit == "mm" { "m" } else { "rad" };
    for (_, axis) in components() {
        let (name, unit) = (axis.name, unit(axis));
        for column in ["", "_sigma", "_averaging", "_fixed", "_scatter"] {
            out.extend(format!(",{name}{column}_{unit}").bytes());
        }
        out.extend(
            format!(",{name}_effective_n,{name}_drift_{unit}_s,{name}_drift_sigma_{unit}_s")
                .bytes(),
        );
        out.extend(format!(",{name}_correction_{unit}").bytes());
    }
    out.push(b'\n');
    for (i, s) in found.standing.iter().enumerate() {
        let (first, last) = (s.first.ns(), s.last.ns());
        out.extend(format!("{},{first},{last},", i + 1).bytes());
        push_f64(&mut out, s.duration_s());
        out.extend(format!(",{},{}", s.poses, s.left_out).bytes());
        for (k, c) in s.components.iter().enumerate() {
            let correction = s.correction.map_or(f64::NAN, |d| d[k]);
            let values = [
                c.mean,
                c.sigma,
                c.averaging,
                c.fixed,
                c.scatter,
                c.effective_n,
                c.drift,
                c.drift_sigma,
                correction,
            ];
            for value in values {
                out.push(b',');
                if value.is_finite() {
                    push_f64(&mut out, value);
                }
            }
        }
        out.push(b'\n');
    }
    String::from_utf8_lossy(&out).into_owned()
}

/// The standstills as indented JSON with a line feed at its end.
///
/// # Errors
/// None in practice: everything in it can be written.
pub fn json(source: &str, found: &Found, criteria: &Criteria) -> Result<String, serde_json::Error> {
    let interval = |s: &Standing| {
        let mut fields = Map::new();
        fields.insert("first_ns".to_owned(), json!(s.first.ns()));
        fields.insert("last_ns".to_owned(), json!(s.last.ns()));
        fields.insert("duration_s".to_owned(), json::value(s.duration_s()));
        fields.insert("poses".to_owned(), json!(s.poses));
        fields.insert("left_out".to_owned(), json!(s.left_out));
        for (k, axis) in components() {
            let (c, u, f) = (&s.components[k], axis.unit, axis.factor);
            let correction = s.correction.map_or(f64::NAN, |d| d[k]);
            let mut of_axis = Map::new();
            for (name, value) in [
                (format!("mean_{u}"), c.mean * f),
                (format!("sigma_{u}"), c.sigma * f),
                (format!("averaging_{u}"), c.averaging * f),
                (format!("fixed_{u}"), c.fixed * f),
                (format!("scatter_{u}"), c.scatter * f),
                ("effective_n".to_owned(), c.effective_n),
                (format!("drift_{u}_s"), c.drift * f),
                (format!("drift_sigma_{u}_s"), c.drift_sigma * f),
                (format!("correction_{u}"), correction * f),
            ] {
                of_axis.insert(name, json::value(value));
            }
            fields.insert(axis.name.to_owned(), Value::Object(of_axis));
        }
        let distance_mm = s.distance_m().map_or(f64::NAN, |d| d * 1e3);
        fields.insert(
            "position".to_owned(),
            json!({ "correction_mm": json::value(distance_mm) }),
        );
        Value::Object(fields)
    };
    let whole = json!({
        "source": source,
        "poses": found.poses[1],
        "solved": found.poses[0],
        "criteria": {
            "least_s": criteria.least_s,
            "still_mm_s": json::value(criteria.still_m_s * 1e3),
            "still_deg_s": json::value(criteria.still_rad_s.to_degrees()),
        },
        "standing": found.standing.len(),
        "creeping": found.creeping,
        "notes": notes(found, criteria),
        "intervals": found.standing.iter().map(interval).collect::<Vec<_>>(),
    });
    json::text(&whole)
}

/// Whether there is a statistic of this name: `standing`, or the largest of a figure over the
/// standstills, as `x.sigma_mm`, `yaw.correction_deg`, `position.correction_mm`.
pub(in crate::report) fn statistic_exists(name: &str) -> bool {
    matches!(name, "standing" | "creeping" | "position.correction_mm") || of_axis(name).is_some()
}

fn of_axis(name: &str) -> Option<(usize, &'static Axis, &str)> {
    let (axis_name, rest) = name.split_once('.')?;
    let (k, axis) = components().find(|(_, axis)| axis.name == axis_name)?;
    let column = rest.strip_suffix(axis.unit)?.strip_suffix('_')?;
    let known = ["sigma", "averaging", "fixed", "scatter", "correction"];
    known.contains(&column).then_some((k, axis, column))
}

/// A statistic's value; none where it has no value.
pub(in crate::report) fn statistic(found: &Found, name: &str) -> Option<f64> {
    let largest = |value: &dyn Fn(&Standing) -> f64| {
        let sizes = found.standing.iter().map(|s| value(s).abs());
        sizes
            .filter(|v| v.is_finite())
            .fold(None, |most: Option<f64>, v| {
                Some(most.map_or(v, |m| m.max(v)))
            })
    };
    match name {
        "standing" => Some(found.standing.len() as f64),
        "creeping" => Some(found.creeping as f64),
        "position.correction_mm" => largest(&|s| s.distance_m().map_or(f64::NAN, |d| d * 1e3)),
        _ => {
            let (k, axis, column) = of_axis(name)?;
            largest(&|s| {
                let c = &s.components[k];
                let value = match column {
                    "sigma" => c.sigma,
                    "averaging" => c.averaging,
                    "fixed" => c.fixed,
                    "scatter" => c.scatter,
                    _ => s.correction.map_or(f64::NAN, |d| d[k]),
                };
                value * axis.factor
            })
        }
    }
}
