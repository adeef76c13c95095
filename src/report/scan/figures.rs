//! The pictures of a scan: to scale, the residuals, the remissions.

use super::{Beam, View};
use crate::record::{Edge, Face, FittedLine, ReflectorLines};
use crate::report::canvas::{DrawResult, Drawing, ink};
use crate::report::drafting::{Plan, free, pen, to_scale};
use crate::report::figure::WHOLE;
use crate::report::number::fixed;
use crate::report::picture::Figure;
use crate::report::scale::above;
use crate::report::statistics::percentile;

/// Most beams of a scan that have texts for the pointer: more would make the page too large.
const WITH_TEXT: usize = 1200;

/// The figures of a scan; `texts`: beams have texts for the pointer. Their files' names begin with
/// `prefix`.
pub fn figures(view: &View, texts: bool, prefix: &str) -> Vec<Figure> {
    let mut figures = vec![Figure::new(
        "scan",
        format!("Scan {}", view.seq),
        "y to the right, z up, m",
        drawn(view, texts && view.beams.len() <= WITH_TEXT),
    )];
    if view.beams.iter().any(|b| b.residual.is_some()) {
        figures.push(Figure::new(
            "residuals",
            "Range beyond the line",
            "mm over the beam’s angle, deg",
            residuals(view),
        ));
    }
    if view.beams.iter().any(|b| b.remission.is_some()) {
        figures.push(Figure::new(
            "remissions",
            "Remission",
            "digits over the beam’s angle, deg",
            remissions(view),
        ));
    }
    figures.into_iter().map(|f| f.of(prefix)).collect()
}

/// What part of the plane is shown: all but the farthest hundredth of the beams, and the scanner.
fn bounds(view: &View) -> [[f64; 2]; 2] {
    let mut ranges: Vec<f64> = view.beams.iter().map(|b| b.range_m).collect();
    ranges.sort_unstable_by(f64::total_cmp);
    let far_m = percentile(&ranges, 99.0);
    let near = view.beams.iter().filter(|b| b.range_m <= 1.2 * far_m);
    let start = [[-0.3, 0.3], [-0.3, 0.3]];
    near.fold(start, |mut bounds, beam| {
        for (ends, v) in bounds.iter_mut().zip(beam.at_m) {
            *ends = [ends[0].min(v - 0.1), ends[1].max(v + 0.1)];
        }
        bounds
    })
}

fn drawn(view: &View, texts: bool) -> Drawing {
    let [u, v] = bounds(view);
    let shown = |b: &&Beam| {
        let [y, z] = b.at_m;
        y >= u[0] && y <= u[1] && z >= v[0] && z <= v[1]
    };
    to_scale(WHOLE, u, v, "the scan with its lines and edges", |plan| {
        plan.axes(false)?;
        for (name, points) in &view.reflectors {
            plan.say(format!("{name}, from the pose"));
            plan.line(points, pen(&ink::BAND, 9.0))?;
        }
        for beam in view.beams.iter().filter(shown) {
            plan.line(&[[0.0, 0.0], beam.at_m], pen(&ink::GRID, 0.6))?;
        }
        if let Some(lines) = &view.lines {
            for (k, line) in lines
                .lines()
                .into_iter()
                .enumerate()
                .filter(|(_, l)| l.is_seen())
            {
                fitted(plan, view, k, line)?;
            }
        }
        for on_line in [false, true] {
            for beam in view
                .beams
                .iter()
                .filter(|b| b.on_line == on_line)
                .filter(shown)
            {
                if texts {
                    plan.say(described(beam));
                }
                let (radius, colour) = if on_line {
                    (1.6, ink::SERIES)
                } else {
                    (1.3, ink::MARK)
                };
                plan.dot(beam.at_m, radius, &colour)?;
            }
        }
        if let Some(lines) = &view.lines {
            for edge in &lines.edges {
                edge_mark(plan, lines, edge)?;
            }
        }
        plan.say("scanner".to_owned());
        plan.dot([0.0, 0.0], 4.0, &ink::INK)
    })
}

fn described(beam: &Beam) -> String {
    let mut text = format!(
        "{}°, {} m",
        fixed(beam.angle_rad.to_degrees(), 2),
        fixed(beam.range_m, 3)
    );
    if let Some((_, off_m)) = beam.residual {
        text.push_str(&format!(", {} mm", fixed(off_m * 1e3, 1)));
    }
    if let Some(remission) = beam.remission {
        text.push_str(&format!(", {remission}"));
    }
    text
}

/// What the line with this index in a record is called.
pub(super) fn line_name(k: usize) -> &'static str {
    Face::ALL.get(k).map_or("", |face| face.name())
}

/// A line between the outermost beams on it.
fn fitted(plan: &Plan<'_, '_>, view: &View, k: usize, line: &FittedLine) -> DrawResult {
    let (sin, cos) = line.normal.alpha_rad.sin_cos();
    let along = view
        .beams
        .iter()
        .filter(|b| b.on_line && b.residual.is_some_and(|(of, _)| of == k))
        .map(|b| b.at_m[1] * cos - b.at_m[0] * sin);
    let (low, high) = along.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), a| {
        (l.min(a), h.max(a))
    });
    if !(low < high) {
        return Ok(());
    }
    let d_m = line.normal.d_m;
    let at = |along: f64| [d_m * cos - along * sin, d_m * sin + along * cos];
    plan.say(format!(
        "{}: d {} m, alpha {}°, {} points, rms {} mm",
        line_name(k),
        fixed(d_m, 4),
        fixed(line.normal.alpha_rad.to_degrees(), 3),
        line.points,
        fixed(line.rms_m * 1e3, 2)
    ));
    plan.line(&[at(low), at(high)], pen(&ink::OTHER, 1.4))
}

/// An edge's interval along its line, and its estimate across.
fn edge_mark(plan: &Plan<'_, '_>, lines: &ReflectorLines, edge: &Edge) -> DrawResult {
    let Some(line) = lines
        .lines()
        .get(edge.face as usize)
        .copied()
        .filter(|l| l.is_seen())
    else {
        return Ok(());
    };
    let at = |angle_rad: f64, beyond: f64| {
        let range_m = line.normal.range_m(angle_rad) * beyond;
        [range_m * angle_rad.cos(), range_m * angle_rad.sin()]
    };
    let best_rad = if edge.edge_rad.is_finite() {
        edge.edge_rad
    } else {
        0.5 * (edge.from_rad + edge.to_rad)
    };
    plan.line(
        &[at(edge.from_rad, 1.015), at(edge.to_rad, 1.015)],
        pen(&ink::THIRD, 4.0),
    )?;
    plan.say(edge_text(edge));
    plan.line(
        &[at(best_rad, 0.96), at(best_rad, 1.05)],
        pen(&ink::THIRD, 1.6),
    )
}

/// What is to be said of an edge.
pub(super) fn edge_text(edge: &Edge) -> String {
    let degrees = |v: f64| fixed(v.to_degrees(), 3);
    let strip = if edge.strip < 0 {
        "unknown strip".to_owned()
    } else {
        format!("strip[{}]", edge.strip)
    };
    let estimate = if edge.edge_rad.is_finite() {
        format!(
            ", estimate {}° ± {}°",
            degrees(edge.edge_rad),
            degrees(edge.sigma_rad)
        )
    } else {
        String::new()
    };
    format!(
        "{strip} {} ({}): {}° to {}°{estimate}, by {}",
        edge.kind.name(),
        edge.face.name(),
        degrees(edge.from_rad),
        degrees(edge.to_rad),
        edge.basis.name()
    )
}

/// First and last angle, deg.
fn angles(view: &View) -> [f64; 2] {
    let degrees = view.beams.iter().map(|b| b.angle_rad.to_degrees());
    let (low, high) = degrees.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), a| {
        (l.min(a), h.max(a))
    });
    if low < high {
        [low, high]
    } else {
        [0.0, 180.0]
    }
}

/// The edges as thin lines across a plot over the angle.
fn edges_across(plan: &Plan<'_, '_>, view: &View, [low, high]: [f64; 2]) -> DrawResult {
    for edge in view.lines.iter().flat_map(|l| &l.edges) {
        let [from, to] = [edge.from_rad, edge.to_rad].map(f64::to_degrees);
        plan.say(edge_text(edge));
        plan.rectangle([from, low], [to, high], &ink::GRID)?;
        if edge.edge_rad.is_finite() {
            let at = edge.edge_rad.to_degrees();
            plan.line(&[[at, low], [at, high]], pen(&ink::THIRD, 0.8))?;
        }
    }
    Ok(())
}

fn residuals(view: &View) -> Drawing {
    let rms = view
        .lines
        .iter()
        .flat_map(|l| l.lines().map(|l| l.rms_m))
        .filter(|r| r.is_finite());
    let limit = above((5.0 * rms.fold(0.0, f64::max)).max(super::LEAST_M) * 1e3);
    free(
        (WHOLE, 200),
        angles(view),
        [-limit, limit],
        "residuals over the angle",
        |plan| {
            edges_across(plan, view, [-limit, limit])?;
            plan.axes(true)?;
            let [from, to] = angles(view);
            plan.line(&[[from, 0.0], [to, 0.0]], pen(&ink::MARK, 0.5))?;
            for on_line in [false, true] {
                for beam in view.beams.iter().filter(|b| b.on_line == on_line) {
                    let Some((_, off_m)) = beam.residual else {
                        continue;
                    };
                    // What is far off lies at the rim.
                    let off = (off_m * 1e3).clamp(-limit, limit);
                    let (radius, colour) = if on_line {
                        (1.6, ink::SERIES)
                    } else {
                        (1.1, ink::MARK)
                    };
                    plan.dot([beam.angle_rad.to_degrees(), off], radius, &colour)?;
                }
            }
            Ok(())
        },
    )
}

fn remissions(view: &View) -> Drawing {
    let digits = |b: &Beam| b.remission.map(f64::from).filter(|r| r.is_finite());
    let top = above(view.beams.iter().filter_map(digits).fold(0.0, f64::max));
    free(
        (WHOLE, 180),
        angles(view),
        [0.0, top],
        "remissions over the angle",
        |plan| {
            edges_across(plan, view, [0.0, top])?;
            plan.axes(true)?;
            for on_line in [false, true] {
                for beam in view.beams.iter().filter(|b| b.on_line == on_line) {
                    let Some(digits) = digits(beam) else { continue };
                    let (radius, colour) = if on_line {
                        (1.6, ink::SERIES)
                    } else {
                        (1.3, ink::MARK)
                    };
                    plan.dot([beam.angle_rad.to_degrees(), digits], radius, &colour)?;
                }
            }
            Ok(())
        },
    )
}
