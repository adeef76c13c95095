//! The sheet that plotters draws the page's figures on: SVG text.
//!
//! plotters has whole-number coordinates, and its own SVG sheet draws lines in visible steps and
//! heat maps with seams. Here a unit is a tenth of a pixel (the `viewBox` scales it down), paths
//! move relatively so that a page stays small, known inks become classes that the page's style can
//! darken, and a shape can carry a text that shows when the pointer rests on it.

use plotters::drawing::{DrawingArea, IntoDrawingArea};
use plotters_backend::text_anchor::{HPos, VPos};
use plotters_backend::{
    BackendColor, BackendCoord, BackendStyle, BackendTextStyle, DrawingBackend, DrawingErrorKind,
};
use std::cell::RefCell;
use std::convert::Infallible;
use std::fmt::Write;
use std::rc::Rc;

/// Units of the sheet in a pixel of the page.
pub(super) const UNIT: i32 = 10;

/// What plotters draws on.
pub(super) type Sheet<'a> = DrawingArea<Canvas<'a>, plotters::coord::Shift>;
/// Drawing cannot fail but in plotters' types.
pub(super) type DrawResult = Result<(), plotters::drawing::DrawingAreaErrorKind<Infallible>>;

/// The inks that the page's style knows, as the light page shows them.
pub(super) mod ink {
    use plotters::style::RGBColor;
    /// The series.
    pub const SERIES: RGBColor = RGBColor(0, 114, 178);
    /// The solver's band behind it.
    pub const BAND: RGBColor = RGBColor(217, 234, 245);
    /// A second series over the first.
    pub const OTHER: RGBColor = RGBColor(213, 94, 0);
    /// Grid lines.
    pub const GRID: RGBColor = RGBColor(228, 231, 235);
    /// The line of zero error and other marks.
    pub const MARK: RGBColor = RGBColor(107, 114, 128);
}

/// Known inks and their classes.
const CLASSES: [((u8, u8, u8), &str); 5] = [
    ((0, 114, 178), "se"),
    ((217, 234, 245), "ba"),
    ((213, 94, 0), "ot"),
    ((228, 231, 235), "gr"),
    ((107, 114, 128), "ma"),
];

/// A text for the shape that is drawn next.
#[derive(Clone, Default)]
pub(super) struct Hover(Rc<RefCell<Option<String>>>);

impl Hover {
    /// Gives the next shape a text.
    pub fn set(&self, text: String) {
        self.0.replace(Some(text));
    }
}

/// SVG text in the making.
pub(super) struct Canvas<'a> {
    size: (u32, u32),
    out: &'a mut String,
    hover: Hover,
}

/// An SVG element of `width` by `height` pixels with what `draw` puts on it; `label` says to those
/// who cannot see it what it shows.
pub(super) fn figure(
    (width, height): (u32, u32),
    label: &str,
    draw: impl FnOnce(&Sheet<'_>, &Hover) -> DrawResult,
) -> String {
    let mut body = String::new();
    let hover = Hover::default();
    let size = (width * UNIT as u32, height * UNIT as u32);
    let canvas = Canvas {
        size,
        out: &mut body,
        hover: hover.clone(),
    };
    // The canvas accepts everything, and a figure that plotters gave up on shows what it has.
    let _ = draw(&canvas.into_drawing_area(), &hover);
    let label = escaped(label);
    format!(
        "<svg viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{label}\">{body}</svg>",
        size.0, size.1
    )
}

fn escaped(text: &str) -> String {
    let text = text.replace('&', "&amp;").replace('<', "&lt;");
    text.replace('>', "&gt;").replace('"', "&quot;")
}

impl Canvas<'_> {
    /// Appends a shape: its path, its ink, its hover text.
    fn shape(&mut self, path: &str, filled: bool, width: u32, colour: BackendColor) {
        let (r, g, b) = colour.rgb;
        let class = CLASSES.iter().find(|(rgb, _)| *rgb == colour.rgb);
        let _ = match (class, filled) {
            (Some((_, class)), true) => write!(self.out, "<path class=\"{class}\""),
            (Some((_, class)), false) => write!(self.out, "<path class=\"l {class}\""),
            (None, true) => write!(self.out, "<path fill=\"#{r:02x}{g:02x}{b:02x}\""),
            (None, false) => {
                write!(
                    self.out,
                    "<path class=\"l\" stroke=\"#{r:02x}{g:02x}{b:02x}\""
                )
            }
        };
        if !filled && width != UNIT as u32 {
            let _ = write!(self.out, " stroke-width=\"{width}\"");
        }
        if colour.alpha < 1.0 {
            let _ = write!(self.out, " opacity=\"{}\"", colour.alpha);
        }
        let _ = write!(self.out, " d=\"{path}\"");
        match self.hover.0.take() {
            Some(text) => {
                let _ = write!(self.out, "><title>{}</title></path>", escaped(&text));
            }
            None => self.out.push_str("/>"),
        }
    }
}

/// A path through `points` in relative moves; points that do not move are left out.
fn relative(points: impl IntoIterator<Item = BackendCoord>, closed: bool) -> String {
    let mut path = String::new();
    let mut last: Option<BackendCoord> = None;
    for (x, y) in points {
        match last {
            None => {
                let _ = write!(path, "M{x},{y}");
            }
            Some((u, v)) => {
                let (dx, dy) = (x - u, y - v);
                let _ = match (dx, dy) {
                    (0, 0) => Ok(()),
                    (_, 0) => write!(path, "h{dx}"),
                    (0, _) => write!(path, "v{dy}"),
                    (_, ..=-1) => write!(path, "l{dx}{dy}"),
                    _ => write!(path, "l{dx},{dy}"),
                };
            }
        }
        last = Some((x, y));
    }
    if closed {
        path.push('z');
    }
    path
}

type Drawn = Result<(), DrawingErrorKind<Infallible>>;

impl DrawingBackend for Canvas<'_> {
    type ErrorType = Infallible;

    fn get_size(&self) -> (u32, u32) {
        self.size
    }

    fn ensure_prepared(&mut self) -> Drawn {
        Ok(())
    }

    fn present(&mut self) -> Drawn {
        Ok(())
    }

    fn draw_pixel(&mut self, (x, y): BackendCoord, colour: BackendColor) -> Drawn {
        self.shape(&format!("M{x},{y}h{UNIT}v{UNIT}h-{UNIT}z"), true, 0, colour);
        Ok(())
    }

    fn draw_line<S: BackendStyle>(&mut self, a: BackendCoord, b: BackendCoord, style: &S) -> Drawn {
        self.draw_path([a, b], style)
    }

    fn draw_rect<S: BackendStyle>(
        &mut self,
        (left, top): BackendCoord,
        (right, bottom): BackendCoord,
        style: &S,
        fill: bool,
    ) -> Drawn {
        let corners = [(left, top), (right, top), (right, bottom), (left, bottom)];
        self.shape(
            &relative(corners, true),
            fill,
            style.stroke_width(),
            style.color(),
        );
        Ok(())
    }

    fn draw_path<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        path: I,
        style: &S,
    ) -> Drawn {
        self.shape(
            &relative(path, false),
            false,
            style.stroke_width(),
            style.color(),
        );
        Ok(())
    }

    fn fill_polygon<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        corners: I,
        style: &S,
    ) -> Drawn {
        self.shape(&relative(corners, true), true, 0, style.color());
        Ok(())
    }

    /// Size, face and colour come from the page's style; only place and anchor count here.
    fn draw_text<T: BackendTextStyle>(
        &mut self,
        text: &str,
        style: &T,
        (x, y): BackendCoord,
    ) -> Drawn {
        let anchor = match style.anchor().h_pos {
            HPos::Left => "",
            HPos::Center => " text-anchor=\"middle\"",
            HPos::Right => " text-anchor=\"end\"",
        };
        // The height of a digit is about 7.5 px of the 10.5 px that ticks are set in.
        let y = match style.anchor().v_pos {
            VPos::Top => y + 9 * UNIT,
            VPos::Center => y + 4 * UNIT,
            VPos::Bottom => y,
        };
        let text = escaped(text);
        let _ = write!(self.out, "<text x=\"{x}\" y=\"{y}\"{anchor}>{text}</text>");
        Ok(())
    }

    fn estimate_text_size<T: BackendTextStyle>(
        &self,
        text: &str,
        _: &T,
    ) -> Result<(u32, u32), DrawingErrorKind<Infallible>> {
        Ok((text.chars().count() as u32 * 60, 105))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plotters::element::Rectangle;
    use plotters::style::{Color, RGBColor};

    #[test]
    fn paths_are_relative_and_short() {
        let points = [(10, 10), (20, 10), (20, 5), (20, 5), (15, 2), (16, 9)];
        assert_eq!(relative(points, false), "M10,10h10v-5l-5-3l1,7");
        assert_eq!(relative([], true), "z");
    }

    #[test]
    fn inks_become_classes_and_texts_are_escaped() {
        let svg = figure((2, 1), "a < b & \"c\"", |sheet, hover| {
            hover.set("1 < 2".to_owned());
            sheet.draw(&Rectangle::new([(0, 0), (10, 10)], ink::SERIES.filled()))?;
            sheet.draw(&Rectangle::new(
                [(10, 0), (20, 10)],
                RGBColor(1, 2, 3).filled(),
            ))
        });
        assert_eq!(
            svg,
            "<svg viewBox=\"0 0 20 10\" role=\"img\" aria-label=\"a &lt; b &amp; &quot;c&quot;\">\
             <path class=\"se\" d=\"M0,0h10v10h-10z\"><title>1 &lt; 2</title></path>\
             <path fill=\"#010203\" d=\"M10,0h10v10h-10z\"/></svg>"
        );
    }
}
