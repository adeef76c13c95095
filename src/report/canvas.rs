//! The sheet that plotters draws figures on.
//!
//! plotters has whole-number coordinates, and its own SVG sheet draws lines in visible steps and
//! heat maps with seams. Here a unit is a tenth of a pixel (the `viewBox` scales it down). What is
//! drawn is kept as a list of shapes ([`Drawing`]), which becomes SVG for the page, where known inks
//! are classes that the page's style can darken, SVG for a file of its own, or pixels.

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

/// The inks that the page's style knows, as the light page shows them (Okabe and Ito's colours for
/// the series, which people with fewer colours tell apart too).
pub(super) mod ink {
    use plotters::style::RGBColor;
    /// The series.
    pub const SERIES: RGBColor = RGBColor(0, 114, 178);
    /// The solver's band behind it.
    pub const BAND: RGBColor = RGBColor(217, 234, 245);
    /// A second series over the first.
    pub const OTHER: RGBColor = RGBColor(213, 94, 0);
    /// A third series.
    pub const THIRD: RGBColor = RGBColor(0, 158, 115);
    /// Grid lines.
    pub const GRID: RGBColor = RGBColor(228, 231, 235);
    /// The line of zero error and other marks.
    pub const MARK: RGBColor = RGBColor(107, 114, 128);
    /// What is as dark as the text: contour lines, outlines.
    pub const INK: RGBColor = RGBColor(26, 29, 33);
}

/// Known inks and their classes.
const CLASSES: [((u8, u8, u8), &str); 7] = [
    ((0, 114, 178), "se"),
    ((217, 234, 245), "ba"),
    ((213, 94, 0), "ot"),
    ((0, 158, 115), "th"),
    ((228, 231, 235), "gr"),
    ((107, 114, 128), "ma"),
    ((26, 29, 33), "in"),
];

/// The colour of ticks and labels where no style sets it.
pub(super) const SOFT: (u8, u8, u8) = (87, 96, 106);
/// Size of a tick's label, units.
pub(super) const TICK: u32 = 105;

/// A text for the shape that is drawn next.
#[derive(Clone, Default)]
pub(super) struct Hover(Rc<RefCell<Option<String>>>);

impl Hover {
    /// Gives the next shape a text, which shows when the pointer rests on it.
    pub fn set(&self, text: String) {
        self.0.replace(Some(text));
    }
}

/// How a path is inked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Inked {
    /// Its inside, with edges as sharp as the pixels: for what lies along the axes.
    Sharp,
    /// Its inside, with smooth edges.
    Smooth,
    /// A line of this many units along it.
    Line(u32),
    /// A dot of this radius, units, at each of its points.
    Dots(u32),
}

/// Something drawn, in units.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Shape {
    /// Points in order.
    Path {
        points: Vec<BackendCoord>,
        inked: Inked,
        colour: (u8, u8, u8),
        alpha: f64,
        hover: Option<String>,
    },
    /// A label in the colour of ticks; `x` is where its left end, its middle (0.5) or its right end
    /// (1) is, `y` its base line.
    Text {
        text: String,
        x: i32,
        y: i32,
        align: f32,
    },
}

/// What was drawn on a sheet.
#[derive(Clone, Debug, PartialEq)]
pub struct Drawing {
    /// Units wide and high.
    pub(super) size: (u32, u32),
    /// What it shows, to those who cannot see it.
    pub(super) label: String,
    /// In the order of drawing.
    pub(super) shapes: Vec<Shape>,
}

/// Where shapes are written, which decides how their colours are said.
#[derive(Clone, Copy, PartialEq)]
enum Place {
    /// Inside the page, whose style knows the classes.
    Page,
    /// In a file of its own, which any viewer has to understand.
    File,
}

/// What `draw` puts on a sheet of `width` by `height` pixels; `label` says to those who cannot see
/// it what it shows.
pub(super) fn figure(
    (width, height): (u32, u32),
    label: &str,
    draw: impl FnOnce(&Sheet<'_>, &Hover) -> DrawResult,
) -> Drawing {
    let mut drawing = Drawing {
        size: (width * UNIT as u32, height * UNIT as u32),
        label: label.to_owned(),
        shapes: Vec::new(),
    };
    let hover = Hover::default();
    let canvas = Canvas {
        size: drawing.size,
        shapes: &mut drawing.shapes,
        hover: hover.clone(),
    };
    // The canvas accepts everything, and a figure that plotters gave up on shows what it has.
    let _ = draw(&canvas.into_drawing_area(), &hover);
    drawing
}

/// `text` as SVG and HTML want it.
pub(super) fn escaped(text: &str) -> String {
    let text = text.replace('&', "&amp;").replace('<', "&lt;");
    text.replace('>', "&gt;").replace('"', "&quot;")
}

impl Drawing {
    /// An SVG element for the page, in the page's classes.
    pub fn svg(&self) -> String {
        let (width, height) = self.size;
        let (label, body) = (escaped(&self.label), self.body(Place::Page));
        format!(
            "<svg viewBox=\"0 0 {width} {height}\" role=\"img\" aria-label=\"{label}\">{body}</svg>"
        )
    }

    /// The shapes as SVG elements in units, with their colours.
    pub(super) fn plain_body(&self) -> String {
        self.body(Place::File)
    }

    fn body(&self, place: Place) -> String {
        let mut out = String::new();
        let mut shapes = self.shapes.iter().peekable();
        while let Some(shape) = shapes.next() {
            match shape {
                Shape::Text { text, x, y, align } => {
                    let anchor = match align {
                        0.0 => "",
                        0.5 => " text-anchor=\"middle\"",
                        _ => " text-anchor=\"end\"",
                    };
                    let text = escaped(text);
                    let _ = write!(out, "<text x=\"{x}\" y=\"{y}\"{anchor}>{text}</text>");
                }
                Shape::Path { points, inked, .. } => {
                    let _ = write!(out, "<path{} d=\"", style(shape, place));
                    let mut pen = None;
                    path(&mut out, points, *inked, &mut pen);
                    // Lines of one style, such as a grid's, are one path.
                    while let Some(Shape::Path { points, inked, .. }) =
                        shapes.next_if(|next| continues(shape, next))
                    {
                        path(&mut out, points, *inked, &mut pen);
                    }
                    out.push('"');
                    close(&mut out, shape);
                }
            }
        }
        out
    }
}

fn close(out: &mut String, shape: &Shape) {
    match shape {
        Shape::Path {
            hover: Some(text), ..
        } => {
            let _ = write!(out, "><title>{}</title></path>", escaped(text));
        }
        _ => out.push_str("/>"),
    }
}

/// Whether `next` can go on in the path of `shape`: the same opaque line or dots, nothing to hover.
fn continues(shape: &Shape, next: &Shape) -> bool {
    let style = |shape: &Shape| match shape {
        Shape::Path {
            inked: inked @ (Inked::Line(_) | Inked::Dots(_)),
            colour,
            alpha,
            hover: None,
            ..
        } if *alpha >= 1.0 => Some((*inked, *colour)),
        _ => None,
    };
    style(shape).is_some() && style(shape) == style(next)
}

/// The attributes that say how a path is inked.
fn style(shape: &Shape, place: Place) -> String {
    let Shape::Path {
        inked,
        colour,
        alpha,
        ..
    } = shape
    else {
        return String::new();
    };
    let (r, g, b) = *colour;
    let known = CLASSES.iter().find(|(rgb, _)| rgb == colour);
    let known = known
        .filter(|_| place == Place::Page)
        .map(|(_, class)| *class);
    let colour = format!("#{r:02x}{g:02x}{b:02x}");
    let mut out = match (known, place, inked) {
        (Some(class), _, Inked::Sharp) => format!(" class=\"{class}\""),
        (Some(class), _, Inked::Smooth) => format!(" class=\"s {class}\""),
        (Some(class), _, Inked::Line(_)) => format!(" class=\"l {class}\""),
        (Some(class), _, Inked::Dots(_)) => format!(" class=\"d {class}\""),
        (None, Place::Page, Inked::Sharp) => format!(" fill=\"{colour}\""),
        (None, Place::Page, Inked::Smooth) => format!(" class=\"s\" fill=\"{colour}\""),
        (None, Place::Page, Inked::Line(_)) => format!(" class=\"l\" stroke=\"{colour}\""),
        (None, Place::Page, Inked::Dots(_)) => format!(" class=\"d\" stroke=\"{colour}\""),
        (None, Place::File, Inked::Sharp) => {
            format!(" fill=\"{colour}\" shape-rendering=\"crispEdges\"")
        }
        (None, Place::File, Inked::Smooth) => format!(" fill=\"{colour}\""),
        (None, Place::File, Inked::Line(_)) => {
            format!(" fill=\"none\" stroke=\"{colour}\" stroke-linejoin=\"round\"")
        }
        (None, Place::File, Inked::Dots(_)) => {
            format!(" fill=\"none\" stroke=\"{colour}\" stroke-linecap=\"round\"")
        }
    };
    let width = match inked {
        Inked::Line(width) if *width != UNIT as u32 || place == Place::File => Some(*width),
        Inked::Dots(radius) => Some(2 * radius),
        _ => None,
    };
    if let Some(width) = width {
        let _ = write!(out, " stroke-width=\"{width}\"");
    }
    if *alpha < 1.0 {
        let _ = write!(out, " opacity=\"{alpha}\"");
    }
    out
}

/// Appends `points` in relative moves from where the pen is; points that do not move are left out.
fn path(out: &mut String, points: &[BackendCoord], inked: Inked, pen: &mut Option<BackendCoord>) {
    let dots = matches!(inked, Inked::Dots(_));
    for (i, (x, y)) in points.iter().copied().enumerate() {
        let start = i == 0 || dots;
        let _ = match *pen {
            None => write!(out, "M{x},{y}"),
            Some((u, v)) => {
                let (dx, dy) = (x - u, y - v);
                let comma = if dy < 0 { "" } else { "," };
                match (start, dx, dy) {
                    (true, ..) => write!(out, "m{dx}{comma}{dy}"),
                    (_, 0, 0) => Ok(()),
                    (_, _, 0) => write!(out, "h{dx}"),
                    (_, 0, _) => write!(out, "v{dy}"),
                    _ => write!(out, "l{dx}{comma}{dy}"),
                }
            }
        };
        if dots {
            out.push_str("h0");
        }
        *pen = Some((x, y));
    }
    if matches!(inked, Inked::Sharp | Inked::Smooth) {
        out.push('z');
        *pen = points.first().copied();
    }
}

/// Shapes in the making.
pub(super) struct Canvas<'a> {
    size: (u32, u32),
    shapes: &'a mut Vec<Shape>,
    hover: Hover,
}

impl Canvas<'_> {
    fn shape(&mut self, points: Vec<BackendCoord>, inked: Inked, colour: BackendColor) {
        let hover = self.hover.0.take();
        self.shapes.push(Shape::Path {
            points,
            inked,
            colour: colour.rgb,
            alpha: colour.alpha,
            hover,
        });
    }
}

/// Whether every side of a closed outline lies along an axis.
fn along_axes(outline: &[BackendCoord]) -> bool {
    let next = outline.iter().cycle().skip(1);
    outline
        .iter()
        .zip(next)
        .all(|(a, b)| a.0 == b.0 || a.1 == b.1)
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
        let (u, v) = (x + UNIT, y + UNIT);
        self.shape(vec![(x, y), (u, y), (u, v), (x, v)], Inked::Sharp, colour);
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
        let mut corners = vec![(left, top), (right, top), (right, bottom), (left, bottom)];
        let inked = if fill {
            Inked::Sharp
        } else {
            corners.push((left, top));
            Inked::Line(style.stroke_width())
        };
        self.shape(corners, inked, style.color());
        Ok(())
    }

    fn draw_path<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        path: I,
        style: &S,
    ) -> Drawn {
        let inked = Inked::Line(style.stroke_width());
        self.shape(path.into_iter().collect(), inked, style.color());
        Ok(())
    }

    /// A filled circle is a dot; an empty one a line of 32 corners.
    fn draw_circle<S: BackendStyle>(
        &mut self,
        (x, y): BackendCoord,
        radius: u32,
        style: &S,
        fill: bool,
    ) -> Drawn {
        if fill {
            self.shape(vec![(x, y)], Inked::Dots(radius), style.color());
            return Ok(());
        }
        let corner = |i: u32| {
            let turn = f64::from(i) * std::f64::consts::TAU / 32.0;
            let at = |part: f64| (f64::from(radius) * part).round() as i32;
            (x + at(turn.cos()), y + at(turn.sin()))
        };
        self.draw_path((0..=32).map(corner), style)
    }

    fn fill_polygon<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        corners: I,
        style: &S,
    ) -> Drawn {
        let corners: Vec<BackendCoord> = corners.into_iter().collect();
        let inked = if along_axes(&corners) {
            Inked::Sharp
        } else {
            Inked::Smooth
        };
        self.shape(corners, inked, style.color());
        Ok(())
    }

    /// Size, face and colour come from the place it is shown at; only where it is counts here.
    fn draw_text<T: BackendTextStyle>(
        &mut self,
        text: &str,
        style: &T,
        (x, y): BackendCoord,
    ) -> Drawn {
        let align = match style.anchor().h_pos {
            HPos::Left => 0.0,
            HPos::Center => 0.5,
            HPos::Right => 1.0,
        };
        // The height of a digit is about 7.5 px of the 10.5 px that ticks are set in.
        let y = match style.anchor().v_pos {
            VPos::Top => y + 9 * UNIT,
            VPos::Center => y + 4 * UNIT,
            VPos::Bottom => y,
        };
        let text = text.to_owned();
        self.shapes.push(Shape::Text { text, x, y, align });
        Ok(())
    }

    fn estimate_text_size<T: BackendTextStyle>(
        &self,
        text: &str,
        _: &T,
    ) -> Result<(u32, u32), DrawingErrorKind<Infallible>> {
        Ok((text.chars().count() as u32 * 60, TICK))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plotters::element::{Circle, PathElement, Rectangle};
    use plotters::style::{Color, RGBColor, ShapeStyle};

    #[test]
    fn paths_are_relative_and_short() {
        let points = [(10, 10), (20, 10), (20, 5), (20, 5), (15, 2), (16, 9)];
        let drawn = |points: &[BackendCoord], inked: Inked| {
            let mut out = String::new();
            path(&mut out, points, inked, &mut None);
            out
        };
        assert_eq!(drawn(&points, Inked::Line(10)), "M10,10h10v-5l-5-3l1,7");
        assert_eq!(drawn(&points[..2], Inked::Dots(3)), "M10,10h0m10,0h0");
        assert_eq!(drawn(&[], Inked::Sharp), "z");
    }

    #[test]
    fn inks_become_classes_and_texts_are_escaped() {
        let drawing = figure((2, 1), "a < b & \"c\"", |sheet, hover| {
            hover.set("1 < 2".to_owned());
            sheet.draw(&Rectangle::new([(0, 0), (10, 10)], ink::SERIES.filled()))?;
            sheet.draw(&Rectangle::new(
                [(10, 0), (20, 10)],
                RGBColor(1, 2, 3).filled(),
            ))
        });
        assert_eq!(
            drawing.svg(),
            "<svg viewBox=\"0 0 20 10\" role=\"img\" aria-label=\"a &lt; b &amp; &quot;c&quot;\">\
             <path class=\"se\" d=\"M0,0h10v10h-10z\"><title>1 &lt; 2</title></path>\
             <path fill=\"#010203\" d=\"M10,0h10v10h-10z\"/></svg>"
        );
        assert!(drawing.plain_body().starts_with(
            "<path fill=\"#0072b2\" shape-rendering=\"crispEdges\" d=\"M0,0h10v10h-10z\"><title>"
        ));
    }

    #[test]
    fn what_has_one_style_is_one_path() {
        let drawing = figure((2, 1), "", |sheet, hover| {
            for y in [2, 4] {
                let line = ShapeStyle::from(&ink::GRID).stroke_width(UNIT as u32);
                sheet.draw(&PathElement::new([(0, y), (20, y)], line))?;
            }
            for x in [3, 9] {
                sheet.draw(&Circle::new((x, 5), 3, ink::OTHER.filled()))?;
            }
            hover.set("here".to_owned());
            sheet.draw(&Circle::new((1, 5), 3, ink::OTHER.filled()))
        });
        let svg = drawing.svg();
        for part in [
            "<path class=\"l gr\" d=\"M0,2h20m-20,2h20\"/>",
            "<path class=\"d ot\" stroke-width=\"6\" d=\"M3,5h0m6,0h0\"/>",
            "d=\"M1,5h0\"><title>here</title>",
        ] {
            assert!(svg.contains(part), "{part}: {svg}");
        }
        assert_eq!(svg.matches("<path").count(), 3);
    }
}
