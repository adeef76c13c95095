//! A figure as it leaves the report: in the page, or as a file of its own.

use super::canvas::{Drawing, SOFT, TICK, UNIT, escaped, ink};
use super::pixels;
use maud::{Markup, PreEscaped, html};
use std::fmt::Write;

/// Why a figure has no picture in pixels.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PictureError {
    /// It is too large.
    #[error("a picture of {0} by {1} pixels is too large")]
    TooLarge(u32, u32),
    /// It could not be packed as PNG.
    #[error("PNG: {0}")]
    Png(String),
    /// The font inside the program is broken.
    #[error("the built-in font: {0}")]
    Font(String),
}

/// A drawing with its title.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// The file's name without its ending: small letters, digits and dashes.
    pub name: String,
    /// What it shows.
    pub title: String,
    /// The unit of its values, and what else fits at the right of the title.
    pub unit: String,
    /// Itself.
    pub(super) drawing: Drawing,
}

/// Room around a figure in a file of its own, px.
const MARGIN: u32 = 12;
/// Height of the row with the title, px.
const TITLE: u32 = 22;
/// Sizes of the title and the unit, px.
const SIZES: [f32; 2] = [12.5, 11.5];
/// The title's colour.
const INK: (u8, u8, u8) = (ink::INK.0, ink::INK.1, ink::INK.2);

impl Figure {
    /// A figure whose file is called `name`, made of small letters, digits and dashes.
    pub(super) fn new(
        name: &str,
        title: impl Into<String>,
        unit: impl Into<String>,
        drawing: Drawing,
    ) -> Figure {
        Figure {
            name: slug(name),
            title: title.into(),
            unit: unit.into(),
            drawing,
        }
    }

    /// The same figure with `prefix` and a dash before its file's name, if there is a prefix.
    #[must_use]
    pub(super) fn of(mut self, prefix: &str) -> Figure {
        let prefix = slug(prefix);
        if !prefix.is_empty() {
            self.name = format!("{prefix}-{}", self.name);
        }
        self
    }

    /// The figure in the page: its title at the left, its unit at the right, the drawing below.
    pub(super) fn markup(&self) -> Markup {
        html! {
            figure {
                figcaption { (self.title) span { (self.unit) } }
                (PreEscaped(self.drawing.svg()))
            }
        }
    }

    /// Width and height of the figure in a file of its own, px.
    fn size(&self) -> (u32, u32) {
        let (width, height) = self.drawing.size;
        let unit = UNIT as u32;
        (
            width / unit + 2 * MARGIN,
            height / unit + 2 * MARGIN + TITLE,
        )
    }

    /// The figure as an SVG file: on white, with its title, and with nothing that a viewer would have
    /// to fetch.
    pub fn svg(&self) -> String {
        let (width, height) = self.size();
        let (left, right, base) = (MARGIN, width - MARGIN, MARGIN + 11);
        let hex = |(r, g, b): (u8, u8, u8)| format!("#{r:02x}{g:02x}{b:02x}");
        let (ink, soft) = (hex(INK), hex(SOFT));
        let (title, unit) = (escaped(&self.title), escaped(&self.unit));
        let label = escaped(&self.drawing.label);
        let mut out = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
             viewBox=\"0 0 {width} {height}\" role=\"img\" aria-label=\"{label}\" \
             font-family=\"'DejaVu Sans',Verdana,Helvetica,Arial,sans-serif\">\
             <rect width=\"{width}\" height=\"{height}\" fill=\"#ffffff\"/>\
             <text x=\"{left}\" y=\"{base}\" font-size=\"{}\" font-weight=\"bold\" fill=\"{ink}\">{title}</text>",
            SIZES[0]
        );
        if !unit.is_empty() {
            let _ = write!(
                out,
                "<text x=\"{right}\" y=\"{base}\" font-size=\"{}\" text-anchor=\"end\" fill=\"{soft}\">{unit}</text>",
                SIZES[1]
            );
        }
        let top = MARGIN + TITLE;
        let scale = 1.0 / f64::from(UNIT);
        let _ = writeln!(
            out,
            "<g transform=\"translate({left} {top}) scale({scale})\" font-size=\"{TICK}\" fill=\"{soft}\">{}</g></svg>",
            self.drawing.plain_body()
        );
        out
    }

    /// The figure as a PNG file with `scale` pixels for a pixel of the page.
    ///
    /// # Errors
    /// A picture too large to be drawn.
    pub fn png(&self, scale: f32) -> Result<Vec<u8>, PictureError> {
        let mut pixels = pixels::Pixels::new(self.size(), scale)?;
        let (width, _) = self.size();
        let base = (MARGIN + 11) as f32;
        let title = pixels::Label {
            text: &self.title,
            at: (MARGIN as f32, base),
            align: 0.0,
            size: SIZES[0],
            bold: true,
            colour: INK,
        };
        pixels.label(&title);
        pixels.label(&pixels::Label {
            text: &self.unit,
            at: ((width - MARGIN) as f32, base),
            align: 1.0,
            size: SIZES[1],
            bold: false,
            colour: SOFT,
        });
        let corner = (MARGIN as f32, (MARGIN + TITLE) as f32);
        pixels.drawing(&self.drawing, corner);
        pixels.png()
    }
}

/// `text` in small letters, digits and single dashes.
pub(super) fn slug(text: &str) -> String {
    let mut out = String::new();
    for c in text.to_ascii_lowercase().chars() {
        if c.is_ascii_alphanumeric() {
            out.push(c);
        } else if !out.is_empty() && !out.ends_with('-') {
            out.push('-');
        }
    }
    out.trim_end_matches('-').to_owned()
}

/// Gives figures of the same name numbers, so that each has a file.
pub(super) fn make_unique(figures: &mut [Figure]) {
    let mut seen = std::collections::BTreeMap::<String, usize>::new();
    for figure in figures {
        let name = figure.name.clone();
        let mut n = *seen.get(&name).unwrap_or(&0) + 1;
        if n > 1 {
            while seen.contains_key(&format!("{name}-{n}")) {
                n += 1;
            }
            figure.name = format!("{name}-{n}");
            seen.insert(figure.name.clone(), 1);
        }
        seen.insert(name, n);
    }
}

#[cfg(test)]
mod tests {
    use super::super::canvas::figure;
    use super::*;
    use plotters::element::{Circle, PathElement, Rectangle, Text};
    use plotters::style::{Color, IntoFont};

    fn one() -> Figure {
        let drawing = figure((40, 20), "a < b", |sheet, _| {
            sheet.draw(&Rectangle::new([(0, 0), (200, 100)], ink::SERIES.filled()))?;
            sheet.draw(&PathElement::new(
                [(200, 150), (400, 150)],
                ink::OTHER.stroke_width(20),
            ))?;
            sheet.draw(&Circle::new((300, 50), 30, ink::THIRD.filled()))?;
            sheet.draw(&Text::new("8", (20, 120), ("sans-serif", 105).into_font()))
        });
        Figure::new("A b/c", "Title & more", "mm", drawing)
    }

    #[test]
    fn a_file_of_its_own_needs_no_page() {
        let svg = one().svg();
        for part in [
            "<svg xmlns=",
            "width=\"64\" height=\"66\"",
            "Title &amp; more",
            "fill=\"#0072b2\"",
            "stroke=\"#d55e00\"",
        ] {
            assert!(svg.contains(part), "{part}: {svg}");
        }
        assert!(!svg.contains("class=") && !svg.contains("var("));
        assert_eq!(svg.matches("<text").count(), 3);
    }

    #[test]
    fn pixels_are_where_the_shapes_are() {
        let png = one().png(2.0).unwrap();
        assert_eq!(png[..8], *b"\x89PNG\r\n\x1a\n");
        assert_eq!(png, one().png(2.0).unwrap(), "the same bytes twice");
        let read = tiny_skia::Pixmap::decode_png(&png).unwrap();
        assert_eq!((read.width(), read.height()), (128, 132));
        // In pixels of the page, from the drawing's corner.
        let at = |x: u32, y: u32| {
            let c = read
                .pixel(2 * (MARGIN + x), 2 * (MARGIN + TITLE + y))
                .unwrap();
            (c.red(), c.green(), c.blue())
        };
        assert_eq!(at(5, 5), (0, 114, 178));
        assert_eq!(at(30, 15), (213, 94, 0));
        assert_eq!(at(30, 5), (0, 158, 115));
        assert_eq!(at(38, 2), (255, 255, 255));
        let dark = read
            .pixels()
            .iter()
            .filter(|p| p.red() < 60 && p.blue() < 60);
        assert!(dark.count() > 50, "the title is there");
    }

    #[test]
    fn names_are_tame_and_different() {
        assert_eq!(one().name, "a-b-c");
        assert_eq!(one().of("Run 1/").name, "run-1-a-b-c");
        assert_eq!(slug("../?"), "");
        let mut figures = vec![one(), one(), one().of(""), one()];
        figures[2].name = "a-b-c-2".to_owned();
        make_unique(&mut figures);
        let mut names: Vec<_> = figures.iter().map(|f| f.name.clone()).collect();
        names.sort();
        names.dedup();
        assert_eq!(names.len(), 4, "{names:?}");
    }

    #[test]
    fn too_large_is_said() {
        let mut large = one();
        large.drawing.size = (4_000_000_000, 4_000_000_000);
        assert!(matches!(large.png(2.0), Err(PictureError::TooLarge(..))));
    }
}
