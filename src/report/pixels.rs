//! A drawing in pixels.
//!
//! tiny-skia fills the shapes; letters are outlines from a font inside the program, so that a
//! picture is the same on every machine. Going by the shapes instead of by their SVG text needs a
//! third of the crates that an SVG renderer brings.

use super::canvas::{Drawing, Inked, SOFT, Shape, TICK, UNIT};
use super::picture::PictureError;
use tiny_skia::{Color, FillRule, LineJoin, Paint, Path, PathBuilder, Pixmap, Stroke, Transform};
use ttf_parser::{Face, GlyphId, OutlineBuilder};

static REGULAR: &[u8] = include_bytes!("fonts/DejaVuSans-subset.ttf");
static BOLD: &[u8] = include_bytes!("fonts/DejaVuSans-Bold-subset.ttf");

/// The most pixels along one side of a picture.
const LONGEST: u32 = 20_000;

/// A text to draw, in pixels of the page.
pub(super) struct Label<'a> {
    pub text: &'a str,
    /// Where its base line is, and its left end (`align` 0), middle (0.5) or right end (1).
    pub at: (f32, f32),
    pub align: f32,
    pub size: f32,
    pub bold: bool,
    pub colour: (u8, u8, u8),
}

/// A picture in the making, white at first.
pub(super) struct Pixels {
    pixmap: Pixmap,
    scale: f32,
    regular: Face<'static>,
    bold: Face<'static>,
}

impl Pixels {
    /// A picture of so many pixels of the page at `scale`.
    pub fn new((width, height): (u32, u32), scale: f32) -> Result<Pixels, PictureError> {
        let side = |length: u32| (length as f32 * scale).ceil() as u32;
        let (wide, high) = (side(width), side(height));
        let pixmap = Some((wide, high))
            .filter(|_| wide <= LONGEST && high <= LONGEST)
            .and_then(|_| Pixmap::new(wide, high));
        let mut pixmap = pixmap.ok_or(PictureError::TooLarge(wide, high))?;
        pixmap.fill(Color::WHITE);
        let face = |bytes| Face::parse(bytes, 0).map_err(|e| PictureError::Font(e.to_string()));
        Ok(Pixels {
            pixmap,
            scale,
            regular: face(REGULAR)?,
            bold: face(BOLD)?,
        })
    }

    /// Draws all shapes of `drawing`, whose upper left corner is at `corner`.
    pub fn drawing(&mut self, drawing: &Drawing, corner: (f32, f32)) {
        for shape in &drawing.shapes {
            match shape {
                Shape::Text { text, x, y, align } => self.label(&Label {
                    text,
                    at: (corner.0 + page(*x), corner.1 + page(*y)),
                    align: *align,
                    size: page(TICK as i32),
                    bold: false,
                    colour: SOFT,
                }),
                Shape::Path {
                    points,
                    inked,
                    colour,
                    alpha,
                    ..
                } => self.path(points, *inked, &paint(*colour, *alpha), corner),
            }
        }
    }

    fn path(&mut self, points: &[(i32, i32)], inked: Inked, paint: &Paint<'_>, corner: (f32, f32)) {
        let to_pixels =
            Transform::from_translate(corner.0, corner.1).post_scale(self.scale, self.scale);
        let mut sharp = paint.clone();
        sharp.anti_alias = false;
        match inked {
            Inked::Dots(radius) => {
                let mut builder = PathBuilder::new();
                for (x, y) in points {
                    builder.push_circle(page(*x), page(*y), page(radius as i32));
                }
                self.fill(builder.finish(), paint, to_pixels);
            }
            Inked::Line(width) => {
                let Some(path) = outline(points, false) else {
                    return;
                };
                let stroke = Stroke {
                    width: page(width as i32),
                    line_join: LineJoin::Round,
                    ..Stroke::default()
                };
                self.pixmap
                    .stroke_path(&path, paint, &stroke, to_pixels, None);
            }
            Inked::Sharp => self.fill(outline(points, true), &sharp, to_pixels),
            Inked::Smooth => self.fill(outline(points, true), paint, to_pixels),
        }
    }

    fn fill(&mut self, path: Option<Path>, paint: &Paint<'_>, to_pixels: Transform) {
        if let Some(path) = path {
            self.pixmap
                .fill_path(&path, paint, FillRule::Winding, to_pixels, None);
        }
    }

    /// Draws a text.
    pub fn label(&mut self, label: &Label<'_>) {
        let face = if label.bold {
            &self.bold
        } else {
            &self.regular
        };
        let em = label.size / f32::from(face.units_per_em());
        let glyphs: Vec<GlyphId> = label
            .text
            .chars()
            .map(|c| face.glyph_index(c).unwrap_or(GlyphId(0)))
            .collect();
        let advance = |g: &GlyphId| em * f32::from(face.glyph_hor_advance(*g).unwrap_or(0));
        let width: f32 = glyphs.iter().map(advance).sum();
        let mut letters = Letters {
            builder: PathBuilder::new(),
            em,
            x: label.at.0 - label.align * width,
            y: label.at.1,
        };
        for glyph in glyphs {
            face.outline_glyph(glyph, &mut letters);
            letters.x += advance(&glyph);
        }
        let paint = paint(label.colour, 1.0);
        let to_pixels = Transform::from_scale(self.scale, self.scale);
        self.fill(letters.builder.finish(), &paint, to_pixels);
    }

    /// The picture as a PNG file.
    pub fn png(&self) -> Result<Vec<u8>, PictureError> {
        self.pixmap
            .encode_png()
            .map_err(|e| PictureError::Png(e.to_string()))
    }
}

/// Units of a sheet in pixels of the page.
fn page(units: i32) -> f32 {
    units as f32 / UNIT as f32
}

fn paint((r, g, b): (u8, u8, u8), alpha: f64) -> Paint<'static> {
    let mut paint = Paint::default();
    paint.set_color_rgba8(r, g, b, (alpha.clamp(0.0, 1.0) * 255.0).round() as u8);
    paint
}

fn outline(points: &[(i32, i32)], closed: bool) -> Option<Path> {
    let mut builder = PathBuilder::new();
    for (i, (x, y)) in points.iter().enumerate() {
        if i == 0 {
            builder.move_to(page(*x), page(*y));
        } else {
            builder.line_to(page(*x), page(*y));
        }
    }
    if closed {
        builder.close();
    }
    builder.finish()
}

/// Outlines of letters, put at their places.
struct Letters {
    builder: PathBuilder,
    /// Pixels of the page in a unit of the font.
    em: f32,
    x: f32,
    y: f32,
}

impl Letters {
    fn place(&self, x: f32, y: f32) -> (f32, f32) {
        (self.x + self.em * x, self.y - self.em * y)
    }
}

impl OutlineBuilder for Letters {
    fn move_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.place(x, y);
        self.builder.move_to(x, y);
    }

    fn line_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.place(x, y);
        self.builder.line_to(x, y);
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        let ((x1, y1), (x, y)) = (self.place(x1, y1), self.place(x, y));
        self.builder.quad_to(x1, y1, x, y);
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        let ((x1, y1), (x2, y2), (x, y)) =
            (self.place(x1, y1), self.place(x2, y2), self.place(x, y));
        self.builder.cubic_to(x1, y1, x2, y2, x, y);
    }

    fn close(&mut self) {
        self.builder.close();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every character that the report can put on a figure has a letter.
    #[test]
    fn the_fonts_have_what_figures_say() {
        for bytes in [REGULAR, BOLD] {
            let face = Face::parse(bytes, 0).unwrap();
            for c in (' '..='~').chain("−±°·σχµ–’…≤≥×²√→".chars()) {
                assert!(face.glyph_index(c).is_some(), "{c}");
            }
            let digit = |c| face.glyph_hor_advance(face.glyph_index(c).unwrap());
            assert!(('0'..='9').all(|c| digit(c) == digit('0')), "tabular");
        }
    }
}
