//! The frame's pictures: seen from the front, its ceiling and its walls, and the maps of what scans
//! in it can tell.

use super::{Survey, yaw_range};
use crate::frame::Strip;
use crate::record::Face;
use crate::report::canvas::{DrawResult, Drawing, ink};
use crate::report::dilution;
use crate::report::drafting::{Plan, free, pen, to_scale};
use crate::report::figure::{HALF, THIRD, WHOLE};
use crate::report::number::fixed;
use crate::report::picture::Figure;
use crate::report::scale::{above, size_colour};
use plotters::style::{Color, RGBColor};

/// All figures of a survey.
pub fn figures(survey: &Survey) -> Vec<Figure> {
    let mut figures = vec![
        Figure::new(
            "front",
            "From the front",
            "y to the right, z up, m",
            front(survey),
        ),
        Figure::new(
            "ceiling",
            "Ceiling, from below",
            "y to the right, x up, m",
            ceiling(survey),
        ),
        Figure::new(
            "wall-right",
            "Right wall, from inside",
            "x to the right, z up, m",
            wall(survey, Face::Right),
        ),
        Figure::new(
            "wall-left",
            "Left wall, from inside",
            "x to the left, z up, m",
            wall(survey, Face::Left),
        ),
    ];
    figures.extend(dilution::figures(&survey.cells()));
    figures.push(Figure::new(
        "edges",
        "Strip edges in sight, fewest",
        format!("of {}", 2 * survey.frame.strips.len()),
        edges(survey),
    ));
    figures.push(Figure::new(
        "yaw-range",
        "Yaw with walls in sight",
        "deg over y, m",
        yaw(survey),
    ));
    figures
}

fn outline(
    plan: &Plan<'_, '_>,
    [u, v]: [[f64; 2]; 2],
    style: plotters::style::ShapeStyle,
) -> DrawResult {
    let corners = [
        [u[0], v[0]],
        [u[1], v[0]],
        [u[1], v[1]],
        [u[0], v[1]],
        [u[0], v[0]],
    ];
    plan.line(&corners, style)
}

/// The box in the plane x = 0, with the scanner in the middle of the workspace and the beams that
/// meet strip edges from there.
fn front(survey: &Survey) -> Drawing {
    let b = &survey.frame.bounds;
    let (half_y, gap_m) = (0.5 * b.dy_m, b.background_gap_m.unwrap_or(0.0));
    let beyond = gap_m + 0.03 * b.dy_m;
    // Reflectors are drawn this far to both sides of their face.
    let thick_m = 0.003 * b.dy_m;
    let label = "the frame from the front, with plates, strips, workspace and scanner";
    to_scale(
        WHOLE,
        [-half_y - beyond, half_y + beyond],
        [-0.1, b.dz_m + beyond],
        label,
        |plan| {
            plan.axes(false)?;
            if gap_m > 0.0 {
                let out = half_y + gap_m;
                let behind = [
                    [-out, 0.0],
                    [-out, b.dz_m + gap_m],
                    [out, b.dz_m + gap_m],
                    [out, 0.0],
                ];
                plan.line(&behind, pen(&ink::GRID, 1.5))?;
            }
            let [ys, zs] = survey.workspace_m;
            plan.say(format!(
                "workspace: y {} to {}, z {} to {} m",
                fixed(ys[0], 2),
                fixed(ys[1], 2),
                fixed(zs[0], 2),
                fixed(zs[1], 2)
            ));
            plan.rectangle([ys[0], zs[0]], [ys[1], zs[1]], &ink::BAND)?;
            let at = [0.5 * (ys[0] + ys[1]), 0.5 * (zs[0] + zs[1])];
            rays(survey, plan, at)?;
            outline(
                plan,
                [[-half_y, half_y], [0.0, b.dz_m]],
                pen(&ink::INK, 1.0),
            )?;
            for (i, plate) in survey.frame.plates.iter().enumerate() {
                let y = if plate.face == Face::Right {
                    half_y
                } else {
                    -half_y
                };
                plan.say(format!(
                    "plate[{i}]: x {} to {}, z {} to {} m",
                    fixed(plate.x_m[0], 3),
                    fixed(plate.x_m[1], 3),
                    fixed(plate.z_m[0], 3),
                    fixed(plate.z_m[1], 3)
                ));
                let [low, high] = plate.z_m;
                plan.rectangle([y - thick_m, low], [y + thick_m, high], &ink::SERIES)?;
            }
            for (i, strip) in survey.frame.strips.iter().enumerate() {
                let ends = [-0.5, 0.5].map(|side| strip.offset_m + side * strip.width_m);
                plan.say(described(i, strip));
                let across = |at: f64| [at - thick_m, at + thick_m];
                let (u, v) = match strip.face {
                    Face::Upper => (ends, across(b.dz_m)),
                    Face::Right => (across(half_y), ends),
                    Face::Left => (across(-half_y), ends),
                };
                plan.rectangle([u[0], v[0]], [u[1], v[1]], &ink::OTHER)?;
            }
            plan.say(format!(
                "scanner: {}, {}",
                survey.frame.scanner.model, survey.mode
            ));
            plan.dot(at, 5.0, &ink::INK)
        },
    )
}

/// From the scanner to the strip edges and the plates' ends in the plane x = 0.
fn rays(survey: &Survey, plan: &Plan<'_, '_>, at: [f64; 2]) -> DrawResult {
    let b = &survey.frame.bounds;
    for strip in &survey.frame.strips {
        for side in [-0.5, 0.5] {
            let v = strip.offset_m + side * strip.width_m;
            let to = match strip.face {
                Face::Upper => [v, b.dz_m],
                Face::Right => [0.5 * b.dy_m, v],
                Face::Left => [-0.5 * b.dy_m, v],
            };
            plan.line(&[at, to], pen(&ink::MARK, 0.5))?;
        }
    }
    Ok(())
}

fn described(index: usize, strip: &Strip) -> String {
    format!(
        "strip[{index}] ({}): offset {} m, width {} m, {} deg",
        strip.face.name(),
        fixed(strip.offset_m, 3),
        fixed(strip.width_m, 3),
        fixed(strip.inclination_deg, 2)
    )
}

/// A strip's corners, first along its own axis v, then x.
fn corners(survey: &Survey, strip: &Strip) -> [[f64; 2]; 4] {
    let [from, to] = strip.x_span_m(&survey.frame.bounds);
    let at = |x: f64, side: f64| [strip.offset_m + side * strip.width_m + x * strip.slope(), x];
    [at(from, -0.5), at(from, 0.5), at(to, 0.5), at(to, -0.5)]
}

/// The ceiling from below, with the scan line of a platform at x = 0 and yaw 0.
fn ceiling(survey: &Survey) -> Drawing {
    let b = &survey.frame.bounds;
    let (half_x, half_y) = (0.5 * b.dx_m, 0.5 * b.dy_m);
    let beyond = 0.03 * b.dy_m + b.background_gap_m.unwrap_or(0.0);
    to_scale(
        WHOLE,
        [-half_y - beyond, half_y + beyond],
        [-half_x, half_x],
        "the ceiling from below",
        |plan| {
            plan.axes(false)?;
            for (i, strip) in survey.frame.strips_on(Face::Upper) {
                plan.say(described(i, strip));
                plan.area(&corners(survey, strip), &ink::OTHER.mix(0.8))?;
                let beside = strip.offset_m + 0.5 * strip.width_m;
                // On the side of the scan line where the strip leans away.
                let down_px = if strip.slope() > 0.0 { 9 } else { -9 };
                plan.text(i.to_string(), [beside, 0.0], (9, down_px))?;
            }
            outline(
                plan,
                [[-half_y, half_y], [-half_x, half_x]],
                pen(&ink::INK, 1.0),
            )?;
            let x = survey.frame.scanner.position_m[0];
            plan.say("scan line at x = 0, yaw 0".to_owned());
            plan.line(&[[-half_y, x], [half_y, x]], pen(&ink::SERIES, 1.0))
        },
    )
}

/// A wall from inside.
fn wall(survey: &Survey, face: Face) -> Drawing {
    let b = &survey.frame.bounds;
    let half_x = 0.5 * b.dx_m;
    // Whoever looks at the left wall from inside has x to the left.
    let sign = if face == Face::Right { 1.0 } else { -1.0 };
    let wide = 1.05 * half_x.max(0.72 * b.dz_m);
    let label = format!("the {} wall from inside", face.name());
    to_scale(
        HALF,
        [-sign * wide, sign * wide],
        [0.0, b.dz_m],
        &label,
        |plan| {
            plan.axes(false)?;
            let [low, high] = survey.workspace_m[1];
            plan.say("heights of the workspace".to_owned());
            plan.rectangle([-half_x, low], [half_x, high], &ink::BAND)?;
            for (i, plate) in survey
                .frame
                .plates
                .iter()
                .enumerate()
                .filter(|(_, p)| p.face == face)
            {
                plan.say(format!("plate[{i}]"));
                plan.rectangle(
                    [plate.x_m[0], plate.z_m[0]],
                    [plate.x_m[1], plate.z_m[1]],
                    &ink::SERIES.mix(0.8),
                )?;
            }
            for (i, strip) in survey.frame.strips_on(face) {
                plan.say(described(i, strip));
                plan.area(
                    &corners(survey, strip).map(|[v, x]| [x, v]),
                    &ink::OTHER.mix(0.8),
                )?;
                plan.text(i.to_string(), [sign * half_x, strip.offset_m], (12, 0))?;
            }
            outline(
                plan,
                [[-half_x, half_x], [0.0, b.dz_m]],
                pen(&ink::INK, 1.0),
            )
        },
    )
}

/// How many edges the pose with the fewest shows, place by place.
fn edges(survey: &Survey) -> Drawing {
    let layout = &survey.layout;
    let [ys, zs] = layout.ends_m();
    let all = 2 * survey.frame.strips.len().max(1);
    free(
        (THIRD, 216),
        ys,
        zs,
        "fewest strip edges in sight over the workspace",
        |plan| {
            plan.axes(false)?;
            for place in survey.places.iter().filter(|p| p.tried > 0) {
                let [y, z] = place.at_m;
                let [dy, dz] = layout.size_m.map(|s| 0.5 * s);
                let (r, g, b) = size_colour(f64::from(place.edges[0]) / all as f64);
                let mean = f64::from(place.edges[1]) / f64::from(place.tried);
                plan.say(format!(
                    "{}, {}: {} at least, {} on average",
                    fixed(y, 2),
                    fixed(z, 2),
                    place.edges[0],
                    fixed(mean, 1)
                ));
                plan.rectangle([y - dy, z - dz], [y + dy, z + dz], &RGBColor(r, g, b))?;
            }
            Ok(())
        },
    )
}

/// eq. 3.104 over the frame's width.
fn yaw(survey: &Survey) -> Drawing {
    let [from, to] = survey.workspace_m[0];
    let at = |i: u32| from + (to - from) * f64::from(i) / 80.0;
    let ranges: Vec<(f64, [f64; 2])> = (0..=80)
        .map(|i| (at(i), yaw_range(&survey.frame, at(i)).map(f64::to_degrees)))
        .collect();
    let top = ranges.iter().map(|(_, r)| r[1]).fold(0.0, f64::max);
    free(
        (THIRD, 216),
        [from, to],
        [0.0, above(top)],
        "yaw range over y",
        |plan| {
            plan.axes(true)?;
            for (k, colour, name) in [
                (1, ink::OTHER, "one wall in sight"),
                (0, ink::SERIES, "both walls in sight"),
            ] {
                let points: Vec<[f64; 2]> = ranges.iter().map(|(y, r)| [*y, r[k]]).collect();
                plan.say(name.to_owned());
                plan.line(&points, pen(&colour, 1.6))?;
                let end = ranges.get(70).map_or([0.0; 2], |(y, r)| [*y, r[k]]);
                plan.text(
                    name.to_owned(),
                    end,
                    if k == 1 { (-52, 0) } else { (-10, -9) },
                )?;
            }
            Ok(())
        },
    )
}

/// How many reflectors each face has, for the page's words.
pub(super) fn on_faces(survey: &Survey) -> [usize; 3] {
    Face::ALL.map(|face| {
        let plates = survey
            .frame
            .plates
            .iter()
            .filter(|p| p.face == face)
            .count();
        plates + survey.frame.strips_on(face).count()
    })
}
