//! The IMU's section in the terminal and on the page.

use super::super::figure::{self, HALF, LIMIT, Series, TRIPLE};
use super::super::number::{NONE, count, fixed};
use super::super::picture::Figure;
use super::{Inertial, Kind, Measured};
use maud::{Markup, html};

/// "IMU still.csv: 60,000 samples, 600.0 s at 100.00 Hz, no gap; ned axes".
fn summary(inertial: &Inertial) -> String {
    let gaps = match inertial.gaps {
        0 => "no gap".to_owned(),
        1 => "1 gap".to_owned(),
        n => format!("{} gaps", count(n)),
    };
    format!(
        "{} samples, {} s at {} Hz, {gaps}; {} axes",
        count(inertial.samples),
        fixed(inertial.duration_s, 1),
        fixed(1.0 / inertial.period_s, 2),
        inertial.axes.name()
    )
}

const TITLES: [&str; 8] = [
    "mean",
    "std",
    "unit",
    "random walk",
    "sheet",
    "instability",
    "sheet",
    "at tau, s",
];

/// One channel as the cells of [`TITLES`].
fn cells(measured: &Measured) -> [String; 8] {
    let kind = measured.channel.kind;
    let (mean, std) = (fixed(measured.mean, 4), fixed(measured.std, 4));
    let unit = kind.unit().to_owned();
    let none = || NONE.to_owned();
    let Some(sheet) = kind.sheet().filter(|_| measured.walk.is_finite()) else {
        return [mean, std, unit, none(), none(), none(), none(), none()];
    };
    let limit = if measured.has_floor { "" } else { "≤" };
    let instability = fixed(measured.instability, 4);
    [
        mean,
        std,
        unit,
        format!("{} {}", fixed(measured.walk, 3), kind.walk_unit()),
        fixed(sheet.walk, 1),
        format!("{limit}{instability} {}", kind.instability_unit()),
        fixed(sheet.instability, 2),
        fixed(measured.instability_tau_s, 1),
    ]
}

/// The section as lines of text, its title first.
pub(in crate::report) fn lines(inertial: &Inertial) -> Vec<String> {
    let mut lines = vec![
        format!("IMU at rest, {}", inertial.source),
        format!("  {}", summary(inertial)),
    ];
    let mut rows = vec![("", TITLES.map(str::to_owned))];
    rows.extend(inertial.channels.iter().map(|m| (m.channel.name, cells(m))));
    let width = |k: usize| {
        rows.iter()
            .map(|(_, c)| c[k].chars().count())
            .max()
            .unwrap_or(0)
    };
    let widths: [usize; 8] = std::array::from_fn(width);
    if rows.len() > 1 {
        lines.push(String::new());
        for (name, cells) in &rows {
            let cells = cells.iter().zip(widths);
            let cells: String = cells.map(|(text, w)| format!("  {text:>w$}")).collect();
            lines.push(format!("  {name:<8}{cells}"));
        }
    }
    for note in &inertial.notes {
        lines.push(format!("  {note}"));
    }
    lines.push(String::new());
    lines
}

/// The section of the page.
pub(in crate::report) fn section(inertial: &Inertial) -> Markup {
    html! {
        h2 { "IMU at rest" }
        p { (inertial.source) ": " (summary(inertial)) "." }
        @if !inertial.channels.is_empty() {
            table {
                thead { tr { th { "channel" } @for title in TITLES { th { (title) } } } }
                tbody {
                    @for measured in &inertial.channels {
                        tr {
                            td { (measured.channel.name) }
                            @for cell in cells(measured) { td { (cell) } }
                        }
                    }
                }
            }
            div class="two" style="margin-top:14px" {
                @for figure in figures(inertial) { (figure.markup()) }
            }
            p {
                "Blue, orange, green: x, y, z; grey: the white noise of the 3DM-GX1’s data sheet. The random walk is \
                 the white part of a fit of quantisation, white noise, floor and random walk; the instability is the \
                 lowest deviation over 0.664, an upper limit (≤) where the curve still falls. Sheet: angle random walk \
                 3.5 deg/√h, velocity random walk 0.4 m/s/√h, in-run bias 0.02 deg/s and 0.2 mg."
            }
        }
        @if !inertial.notes.is_empty() {
            ul { @for note in &inertial.notes { li { (note) } } }
        }
    }
}

/// The section's figures.
pub(in crate::report) fn figures(inertial: &Inertial) -> Vec<Figure> {
    let kinds = [
        (Kind::Rate, "imu-rates", "Allan deviation of the rates"),
        (
            Kind::Force,
            "imu-accelerations",
            "Allan deviation of the accelerations",
        ),
    ];
    let curves = kinds.into_iter();
    curves
        .filter_map(|(kind, name, title)| curves_of(inertial, kind, name, title))
        .collect()
}

fn curves_of(inertial: &Inertial, kind: Kind, name: &str, title: &str) -> Option<Figure> {
    let of_kind: Vec<&Measured> = inertial
        .channels
        .iter()
        .filter(|m| m.channel.kind == kind && m.curve.len() > 1)
        .collect();
    let taus = || of_kind.iter().flat_map(|m| m.curve.iter().map(|p| p.tau_s));
    let ends = [
        taus().fold(f64::INFINITY, f64::min),
        taus().fold(0.0, f64::max),
    ];
    let mut series = Vec::new();
    if let Some(sheet) = kind.sheet() {
        // deg/sqrt(h) is a sixtieth of deg/s over the root of one second.
        let white = |tau_s: f64| sheet.walk / 60.0 / tau_s.sqrt();
        series.push(Series {
            name: "white noise of the data sheet".to_owned(),
            points: ends.map(|tau_s| (tau_s, white(tau_s))).to_vec(),
            colour: LIMIT,
        });
    }
    for (measured, colour) in of_kind.iter().zip(TRIPLE) {
        series.push(Series {
            name: measured.channel.name.to_owned(),
            points: measured
                .curve
                .iter()
                .map(|p| (p.tau_s, p.deviation))
                .collect(),
            colour,
        });
    }
    let unit = format!("{} over averaging time in s", kind.unit());
    let drawing = figure::log_log(&series, (HALF, 260), title);
    (!of_kind.is_empty()).then(|| Figure::new(name, title, unit, drawing))
}

#[cfg(test)]
mod tests {
    use super::super::tests::still;
    use super::*;

    #[test]
    fn both_outputs_name_every_channel() {
        let found = still(60, 7).finish("still.csv".to_owned());
        let text = lines(&found).join("\n");
        let page = section(&found).into_string();
        for channel in &found.channels {
            assert!(text.contains(channel.channel.name) && page.contains(channel.channel.name));
        }
        assert!(text.contains("6000 samples, 60.0 s at 100.00 Hz, no gap; ned axes"));
        assert!(text.contains("deg/sqrt(h)"));
        // Two figures with three curves and the sheet's line each.
        assert_eq!(page.matches("<svg").count(), 2);
        assert_eq!(page.matches("<title>").count(), 8);
    }
}
