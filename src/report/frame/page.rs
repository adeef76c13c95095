//! A survey as a page.

use super::Survey;
use super::figures::{figures, on_faces};
use crate::report::axis::AXES;
use crate::report::number::fixed;
use crate::report::page;
use maud::{Markup, html};

/// The page: no script, nothing fetched.
pub fn page(title: Option<&str>, survey: &Survey) -> String {
    let frame = &survey.frame;
    let name = if frame.name.is_empty() {
        &survey.source
    } else {
        &frame.name
    };
    let title = title.map_or_else(|| format!("Frame: {name}"), str::to_owned);
    let figures = figures(survey);
    let (drawings, maps) = figures.split_at(figures.len().min(4));
    let [front, ceiling, walls @ ..] = drawings else {
        return page::document(&title, &html! { h1 { (title) } });
    };
    let b = &frame.bounds;
    let [right, upper, left] = on_faces(survey);
    let body = html! {
        h1 { (title) }
        p {
            (survey.source) " · " (b.dx_m) " m deep, " (b.dy_m) " m wide, " (b.dz_m) " m high · "
            (frame.scanner.model) ", " (survey.mode) " · reflectors: " (right) " right, " (upper) " upper, "
            (left) " left · report " (env!("CARGO_PKG_VERSION"))
        }
        (cards(survey))
        h2 { "Checks" }
        table { tbody {
            @for (well, text) in survey.findings() {
                tr {
                    td class="wide" { (text) }
                    td class=(if well { "good" } else { "warn" }) { (if well { "ok" } else { "look at it" }) }
                }
            }
        } }
        h2 { "The frame" }
        p { "To scale. Plates blue, strips red, the workspace pale; thin lines lead from the scanner in the middle of the workspace to the strips’ edges at x = 0." }
        div class="one" { (front.markup()) (ceiling.markup()) }
        div class="two" { @for wall in walls { (wall.markup()) } }
        h2 { "What one scan can tell" }
        p { "Least standard deviation of each component over the workspace: " (survey.conditions) ". y to the right, z up, m." }
        div class="three" { @for map in maps { (map.markup()) } }
        (prediction(survey))
        h2 { "Reflectors" }
        (reflectors(survey))
        h2 { "How it was made" }
        code { (survey.command) }
    };
    page::document(&title, &body)
}

fn cards(survey: &Survey) -> Markup {
    let sigma = |k: usize| {
        let [rms, worst] = survey.sigma(k);
        AXES.get(k).map_or((String::new(), String::new()), |axis| {
            let worst = format!("worst place {}", axis.quantity(worst));
            (axis.quantity(rms), worst)
        })
    };
    let ((x, x_worst), (yaw, yaw_worst)) = (sigma(0), sigma(5));
    let [fewest, mean, all] = survey.edges();
    let [both, one] = survey.least_yaw().map(|v| fixed(v.to_degrees(), 2));
    let told = survey.share_pct(|p| p.told);
    let card = |title: &str, value: String, below: String| {
        html! { div class="card" { span { (title) } b { (value) } span { (below) } } }
    };
    html! {
        div class="cards" {
            (card("x of one scan, sigma", x, x_worst))
            (card("yaw of one scan, sigma", yaw, yaw_worst))
            (card("strip edges in sight", format!("{mean:.1}"), format!("{fewest:.0} at least, of {all:.0}")))
            (card("yaw range, both walls", format!("±{both}°"), format!("one wall ±{one}°")))
            (card("poses that can be told", format!("{} %", fixed(told, 1)), format!("{} places", survey.places.len())))
        }
    }
}

fn prediction(survey: &Survey) -> Markup {
    html! {
        table {
            thead { tr { th { "component" } th { "rms" } th { "worst place" } } }
            tbody {
                @for (k, axis) in AXES.iter().take(6).enumerate() {
                    @let [rms, worst] = survey.sigma(k).map(|s| fixed(s * axis.factor, axis.decimals + 1));
                    tr { td { (axis.name) ", " (axis.symbol) } td { (rms) } td { (worst) } }
                }
            }
        }
    }
}

fn reflectors(survey: &Survey) -> Markup {
    let span = |[from, to]: [f64; 2]| format!("{} … {}", fixed(from, 3), fixed(to, 3));
    html! {
        table {
            thead { tr { th { "key" } th { "face" } th { "offset, m" } th { "width, m" } th { "inclination, °" } th { "x, m" } th { "z, m" } } }
            tbody {
                @for (i, plate) in survey.frame.plates.iter().enumerate() {
                    tr { td { "plate[" (i) "]" } td { (plate.face.name()) } td {} td {} td {} td { (span(plate.x_m)) } td { (span(plate.z_m)) } }
                }
                @for (i, strip) in survey.frame.strips.iter().enumerate() {
                    tr {
                        td { "strip[" (i) "]" } td { (strip.face.name()) } td { (fixed(strip.offset_m, 3)) } td { (fixed(strip.width_m, 3)) }
                        td { (fixed(strip.inclination_deg, 2)) } td { (span(strip.x_span_m(&survey.frame.bounds))) } td {}
                    }
                }
            }
        }
    }
}
