//! Scans as text and as JSON.

use super::View;
use super::figures::{edge_text, line_name};
use crate::report::json;
use crate::report::number::{self, count, fixed};
use serde_json::{Value, json};

/// The scans as text. `ascii` leaves out what is not ASCII.
pub fn table(views: &[View], ascii: bool) -> String {
    let mut out = String::new();
    for (i, view) in views.iter().enumerate() {
        if i > 0 {
            out.push('\n');
        }
        let on_lines = view.beams.iter().filter(|b| b.on_line).count();
        out.push_str(&format!(
            "Scan {} at {} ns: {} beams, {} returns, {} on lines\n",
            view.seq,
            view.stamp.ns(),
            count(view.count),
            count(view.beams.len()),
            count(on_lines)
        ));
        let Some(lines) = &view.lines else {
            out.push_str("  no lines\n");
            continue;
        };
        out.push_str(&format!(
            "  {:<6}{:>10}{:>12}{:>9}{:>9}{:>10}\n",
            "line", "d m", "alpha deg", "points", "rms mm", "on line"
        ));
        for (k, line) in lines.lines().into_iter().enumerate() {
            let name = line_name(k);
            let on = view
                .beams
                .iter()
                .filter(|b| b.on_line && b.residual.is_some_and(|(of, _)| of == k))
                .count();
            out.push_str(&format!(
                "  {name:<6}{:>10}{:>12}{:>9}{:>9}{:>10}\n",
                fixed(line.normal.d_m, 4),
                fixed(line.normal.alpha_rad.to_degrees(), 3),
                line.points,
                fixed(line.rms_m * 1e3, 2),
                on
            ));
        }
        out.push_str(&format!(
            "  range bias {} mm; {} edges\n",
            fixed(lines.range_bias_m * 1e3, 2),
            lines.edges.len()
        ));
        for edge in &lines.edges {
            out.push_str(&format!("  {}\n", edge_text(edge)));
        }
    }
    if ascii { number::ascii(&out) } else { out }
}

/// The scans as indented JSON with a line feed at its end.
///
/// # Errors
/// None in practice: everything in it can be written.
pub fn json(source: &str, views: &[View]) -> Result<String, serde_json::Error> {
    let scans: Vec<Value> = views.iter().map(scan).collect();
    json::text(&json!({ "source": source, "scans": scans }))
}

fn scan(view: &View) -> Value {
    let of_lines = view.lines.as_ref().map(|lines| {
        let line = |(k, l): (usize, &crate::record::FittedLine)| {
            json!({
                "line": line_name(k),
                "d_m": json::value(l.normal.d_m),
                "alpha_deg": json::value(l.normal.alpha_rad.to_degrees()),
                "points": l.points,
                "rms_mm": json::value(l.rms_m * 1e3),
            })
        };
        let edges = lines.edges.iter().map(|e| {
            json!({
                "face": e.face.name(),
                "strip": e.strip,
                "kind": e.kind.name(),
                "from_deg": json::value(e.from_rad.to_degrees()),
                "to_deg": json::value(e.to_rad.to_degrees()),
                "edge_deg": json::value(e.edge_rad.to_degrees()),
                "sigma_deg": json::value(e.sigma_rad.to_degrees()),
                "basis": e.basis.name(),
            })
        });
        json!({
            "range_bias_mm": json::value(lines.range_bias_m * 1e3),
            "lines": lines.lines().into_iter().enumerate().map(line).collect::<Vec<_>>(),
            "edges": edges.collect::<Vec<_>>(),
        })
    });
    json!({
        "seq": view.seq,
        "stamp_ns": view.stamp.ns(),
        "beams": view.count,
        "returns": view.beams.len(),
        "on_lines": view.beams.iter().filter(|b| b.on_line).count(),
        "found": of_lines,
    })
}
