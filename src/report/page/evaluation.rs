//! What else a run is judged by: its delay, the way along and across, steps from pose to pose,
//! orientation against the IMU, what the poses rest on, and how still a standing run is.

use super::super::axis::AXES;
use super::super::canvas::ink;
use super::super::case::Case;
use super::super::figure::{self, Course, HALF, Mark, Series, THIRD, TRIPLE};
use super::super::lag::Delay;
use super::super::number::{NONE, count, fixed};
use super::super::orientation::Orientation;
use super::super::picture::Figure;
use super::super::scale::above;
use super::super::statistics::Statistics;
use super::super::trace::Trace;
use super::{Detail, courses, row};
use crate::record::Face;
use maud::{Markup, html};
use plotters::style::RGBColor;

/// Names of the orientation's angles.
const ANGLES: [&str; 3] = ["roll", "pitch", "yaw"];
/// Milliseconds of a second, millimetres of a metre.
const MS: f64 = 1e3;
const MM: f64 = 1e3;

/// Every figure of these sections.
pub(super) fn figures(case: &Case, detail: Detail) -> Vec<Figure> {
    let mut all: Vec<Figure> = delay_figure(case).into_iter().collect();
    all.extend(track_figures(case, detail));
    all.extend(orientation_figures(case, detail));
    all.extend(quality_figures(case, detail));
    all.extend(stability_figures(case));
    all
}

/// The rms against the delay that is taken out.
fn delay_figure(case: &Case) -> Option<Figure> {
    let delay = case.delay.as_ref().filter(|d| d.curve.len() > 1)?;
    let points: Vec<(f64, f64)> = delay.curve.iter().map(|(s, m)| (MS * s, MM * m)).collect();
    let mark = Mark {
        x: MS * delay.delay_s,
        text: format!(
            "{} ms → {} mm",
            fixed(MS * delay.delay_s, 1),
            fixed(MM * delay.rms_after_m, 2)
        ),
    };
    let title = "Error against the delay taken out";
    let drawing = figure::curve(&points, Some(&mark), (HALF, 170), title);
    Some(Figure::new("delay", title, "rms, mm; delay in ms", drawing))
}

/// The delay and its standard error, ms.
pub(super) fn delay_parts(delay: &Delay) -> (String, String) {
    // Two digits of what is uncertain.
    let sigma = MS * delay.sigma_s;
    let decimals = match sigma {
        s if s < 0.01 => 3,
        s if s < 0.1 => 2,
        _ => 1,
    };
    (fixed(MS * delay.delay_s, decimals), fixed(sigma, decimals))
}

/// "36.8 ± 0.4 ms".
pub(super) fn delay_text(delay: &Delay) -> String {
    let (value, sigma) = delay_parts(delay);
    if delay.sigma_s.is_finite() {
        format!("{value} ± {sigma} ms")
    } else {
        format!("{value} ms")
    }
}

/// The delay of each case that has one.
pub(super) fn delay(case: &Case) -> Markup {
    let Some(delay) = &case.delay else {
        return html! {};
    };
    let [low, high] = delay.interval_s.map(|s| fixed(MS * s, 2));
    html! {
        div class="two" {
            @if let Some(figure) = delay_figure(case) { (figure.markup()) }
            div {
                p class="says" { (delay.sentence()) "." }
                table {
                    tbody {
                        tr { td { "delay, ± its standard error" } td { (delay_text(delay)) } }
                        @if delay.sigma_s.is_finite() {
                            tr { td { "95 % interval" } td { (low) " … " (high) " ms" } }
                            tr { td { "poses; independent ones" } td { (count(delay.samples)) "; " (fixed(delay.effective_n, 0)) } }
                        }
                        tr { td { "position error, rms, as measured" } td { (fixed(MM * delay.rms_before_m, 2)) " mm" } }
                        tr { td { "without the delay" } td { (fixed(MM * delay.rms_after_m, 2)) " mm" } }
                        tr { td { "the other figures are" } td { (if delay.removed { "without it" } else { "as measured" }) } }
                    }
                }
            }
        }
    }
}

/// The error along the way and the distance from it over time.
pub(super) fn track_figures(case: &Case, detail: Detail) -> Vec<Figure> {
    let Some(track) = &case.track else {
        return Vec::new();
    };
    let axis = &AXES[0];
    let size = (HALF, 150);
    let along = courses::of(
        &track.along,
        axis,
        ["along", "Error along the way"],
        size,
        true,
        detail,
    );
    let cross = courses::of(
        &track.cross,
        axis,
        ["cross", "Distance from the way"],
        size,
        false,
        detail,
    );
    // Where several runs share the page, the distance's numbers have to do.
    let cross = cross.filter(|_| !detail.several);
    along.into_iter().chain(cross).collect()
}

/// Statistics in the table of errors, row by row: along and across the way, and steps.
pub(super) fn more_errors(case: &Case) -> Vec<(String, Statistics, usize)> {
    let mut rows = Vec::new();
    let axis = &AXES[0];
    if let Some(track) = &case.track {
        for (name, result) in [("along the way", &track.along), ("across it", &track.cross)] {
            let statistics = result.statistics.scaled(axis.factor);
            rows.push((
                format!("{name}, {}", axis.symbol),
                statistics,
                axis.decimals,
            ));
        }
    }
    for relative in &case.relative {
        let axes = AXES.iter().zip(&relative.axes);
        // The steps' length and turn; each component's is in --json.
        for (axis, statistics) in axes.filter(|(a, _)| ["position", "rotation"].contains(&a.name)) {
            let name = format!(
                "{} over {}, {}",
                axis.name, relative.delta.text, axis.symbol
            );
            rows.push((name, statistics.scaled(axis.factor), axis.decimals));
        }
    }
    rows
}

fn orientation_figures(case: &Case, detail: Detail) -> Vec<Figure> {
    let Some(orientation) = &case.orientation else {
        return Vec::new();
    };
    let factor = AXES[3].factor;
    let angles = ANGLES.iter().zip(&orientation.angles);
    let figure = |(name, angle): (&&str, &super::super::orientation::AngleResult)| {
        if angle.residual.n == 0 {
            return None;
        }
        let (limit, _) = figure::trace_limit(&angle.trace, &angle.residual);
        let course = Course {
            trace: &angle.trace,
            factor,
            range: [-limit * factor, limit * factor],
            step_px: detail.step_px(),
        };
        let title = format!("Pose − IMU in {name}, less the offset");
        let drawing = figure::over_time(&course, (THIRD, 140), &title);
        Some(Figure::new(&format!("imu-{name}"), title, "°", drawing))
    };
    angles.filter_map(figure).collect()
}

/// Orientation against the IMU's.
pub(super) fn orientation(case: &Case, detail: Detail) -> Markup {
    let Some(found) = &case.orientation else {
        return html! {};
    };
    html! {
        p {
            "Poses minus IMU (" (found.source) "): a line over time is fitted to each angle; rates are those of "
            "the poses against the gyros’."
        }
        (orientation_table(found))
        (row("three", &orientation_figures(case, detail)))
    }
}

fn orientation_table(found: &Orientation) -> Markup {
    let degrees = AXES[3].factor;
    html! {
        table {
            thead {
                tr {
                    th { "angle" } th { "n" } th { "offset, °" } th { "drift, °/h" } th { "left, rms, °" } th { "max, °" }
                    th { "rate, rms, °/s" } th { "rate, bias, °/s" } th { "scale" }
                }
            }
            tbody {
                @for (i, (name, angle)) in ANGLES.iter().zip(&found.angles).enumerate() {
                    @let rate = found.rates.get(i);
                    @let rated = |value: Option<f64>, decimals| value.map_or(NONE.to_owned(), |v| fixed(v, decimals));
                    tr {
                        td { (name) }
                        td { (count(angle.residual.n)) }
                        td { (fixed(degrees * angle.offset_rad, 3)) }
                        td { (fixed(3600.0 * degrees * angle.drift_rad_s, 2)) }
                        td { (fixed(degrees * angle.residual.rms, 3)) }
                        td { (fixed(degrees * angle.residual.max, 3)) }
                        td { (rated(rate.map(|r| degrees * r.rms_rad_s), 3)) }
                        td { (rated(rate.map(|r| degrees * r.bias_rad_s), 3)) }
                        td { (rated(rate.map(|r| r.scale), 3)) }
                    }
                }
            }
        }
    }
}

/// What the poses rest on: edges, votes, residuals; over time too where the page is one run's.
pub(super) fn quality_figures(case: &Case, detail: Detail) -> Vec<Figure> {
    let quality = &case.quality;
    let size = (THIRD, 140);
    let mut figures = Vec::new();
    for (name, what, title, counts) in [
        (
            "edges",
            "edges",
            "Edges that a pose rests on",
            &quality.edges,
        ),
        (
            "votes",
            "votes",
            "Votes of the winning cell",
            &quality.votes,
        ),
    ] {
        if counts.iter().any(|n| *n > 0) {
            let drawing = figure::counts(counts, what, size, title);
            figures.push(Figure::new(name, title, "poses", drawing));
        }
    }
    for (name, title, trace) in [
        ("edges-time", "Edges over time", &quality.edges_trace),
        ("votes-time", "Votes over time", &quality.votes_trace),
    ] {
        figures.extend(counted(name, title, trace).filter(|_| !detail.several));
    }
    let Some(lines) = &quality.lines else {
        return figures;
    };
    let faces = || Face::ALL.iter().zip(&lines.faces);
    let residuals: Vec<(String, f64)> = faces()
        .map(|(face, tally)| (face.name().to_owned(), MM * tally.residual_rms_m()))
        .collect();
    if residuals.iter().any(|(_, v)| v.is_finite()) {
        let title = "Residual by face, rms";
        let drawing = figure::bars(&residuals, 2, size, title);
        figures.push(Figure::new("residuals", title, "mm", drawing));
    }
    let points: Vec<(String, f64)> = faces()
        .map(|(face, tally)| (face.name().to_owned(), tally.points()))
        .collect();
    if points.iter().any(|(_, v)| v.is_finite()) {
        let title = "Points by face, mean";
        let drawing = figure::bars(&points, 1, size, title);
        figures.push(Figure::new("points", title, "points", drawing));
    }
    if !lines.strips.is_empty() && lines.strips.len() <= 40 {
        let scans = lines.scans.max(1) as f64;
        let share = |(i, n): (usize, &usize)| (i.to_string(), 100.0 * *n as f64 / scans);
        let shares: Vec<(String, f64)> = lines.strips.iter().enumerate().map(share).collect();
        let title = "Scans that met a strip, by its number";
        let drawing = figure::bars(&shares, 1, size, title);
        figures.push(Figure::new("strips", title, "%", drawing));
    }
    figures
}

/// A count over time, from zero.
fn counted(name: &str, title: &str, trace: &Trace) -> Option<Figure> {
    let filled = trace.columns.iter().filter(|c| c.n > 0);
    let top = filled.map(|c| c.max).fold(f64::NAN, f64::max);
    let course = Course {
        trace,
        factor: 1.0,
        range: [0.0, above(top)],
        step_px: 1,
    };
    let drawing = figure::over_time(&course, (THIRD, 140), title);
    (top > 0.0).then(|| Figure::new(name, title, "time in s", drawing))
}

/// Allan deviations of a standing run's poses.
fn stability_figures(case: &Case) -> Vec<Figure> {
    let Some(stability) = &case.stability else {
        return Vec::new();
    };
    let parts: [(&str, &str, &str, [usize; 3]); 2] = [
        (
            "allan-position",
            "Allan deviation of the position",
            "mm",
            [0, 1, 2],
        ),
        (
            "allan-angles",
            "Allan deviation of the angles",
            "°",
            [3, 4, 5],
        ),
    ];
    let part = |(name, title, unit, indices): (&str, &str, &str, [usize; 3])| {
        let series = |(i, colour): (usize, RGBColor)| {
            let curve = stability.curves.get(i).filter(|c| c.len() > 1)?;
            let axis = AXES.get(i)?;
            let points = curve.iter().map(|p| (p.tau_s, axis.factor * p.deviation));
            Some(Series {
                name: axis.name.to_owned(),
                points: points.collect(),
                colour,
            })
        };
        let series: Vec<Series> = indices.into_iter().zip(TRIPLE).filter_map(series).collect();
        let drawing = figure::log_log(&series, (HALF, 220), title);
        let unit = format!("{unit} over averaging time in s");
        (!series.is_empty()).then(|| Figure::new(name, title, unit, drawing))
    };
    parts.into_iter().filter_map(part).collect()
}

/// How still a standing run is.
pub(super) fn stability(case: &Case) -> Markup {
    let figures = stability_figures(case);
    html! {
        @if !figures.is_empty() {
            (row("two", &figures))
            p { (swatch(ink::SERIES)) "x, roll " (swatch(ink::OTHER)) "y, pitch " (swatch(ink::THIRD)) "z, yaw" }
        }
    }
}

/// A spot of a series' colour.
fn swatch(colour: RGBColor) -> Markup {
    let RGBColor(r, g, b) = colour;
    html! { span class="swatch" style=(format!("background:#{r:02x}{g:02x}{b:02x}")) {} }
}
