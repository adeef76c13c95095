//! Plans to scale and plots with two free scales, for what the figures of errors do not cover: the
//! frame, a scan.

use super::canvas::{DrawResult, Drawing, Hover, Sheet, TICK, UNIT, figure, ink};
use super::number::fixed;
use super::scale::ticks;
use plotters::element::{Circle, PathElement, Polygon, Text};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{Color, IntoFont, ShapeStyle, TextStyle};

/// Room around a plan, px: left, right, top, bottom.
const MARGINS: [i32; 4] = [40, 10, 10, 24];

/// A sheet with the scales of its two axes: u to the right, v upwards.
pub(super) struct Plan<'s, 'a> {
    sheet: &'s Sheet<'a>,
    hover: &'s Hover,
    u: [f64; 2],
    v: [f64; 2],
    /// Left, right, top and bottom of the plot, units.
    place: [i32; 4],
}

/// A plan with one scale for both axes, `width` px wide. The first of `u` is at the left, whether it
/// is the smaller or not; the first of `v` below.
pub(super) fn to_scale(
    width: u32,
    u: [f64; 2],
    v: [f64; 2],
    label: &str,
    draw: impl FnOnce(&Plan<'_, '_>) -> DrawResult,
) -> Drawing {
    let [left, right, top, bottom] = MARGINS;
    let inner = f64::from(width as i32 - left - right);
    let height = inner * ((v[1] - v[0]) / (u[1] - u[0])).abs();
    let height = height.clamp(20.0, 2000.0).round() as u32 + (top + bottom) as u32;
    free((width, height), u, v, label, draw)
}

/// A plot with a scale for each axis.
pub(super) fn free(
    size: (u32, u32),
    u: [f64; 2],
    v: [f64; 2],
    label: &str,
    draw: impl FnOnce(&Plan<'_, '_>) -> DrawResult,
) -> Drawing {
    figure(size, label, |sheet, hover| {
        let [left, right, top, bottom] = MARGINS.map(|m| m * UNIT);
        let (wide, high) = sheet.dim_in_pixel();
        draw(&Plan {
            sheet,
            hover,
            u,
            v,
            place: [left, wide as i32 - right, top, high as i32 - bottom],
        })
    })
}

/// A line of so many pixels.
pub(super) fn pen(colour: &impl Color, width_px: f64) -> ShapeStyle {
    colour.stroke_width((width_px * f64::from(UNIT)).round() as u32)
}

impl Plan<'_, '_> {
    fn at(&self, [u, v]: [f64; 2]) -> (i32, i32) {
        let share = |value: f64, [from, to]: [f64; 2]| {
            let share = (value - from) / (to - from);
            if share.is_finite() {
                share.clamp(-1.0, 2.0)
            } else {
                0.0
            }
        };
        let [left, right, top, bottom] = self.place.map(f64::from);
        (
            (left + share(u, self.u) * (right - left)).round() as i32,
            (bottom + share(v, self.v) * (top - bottom)).round() as i32,
        )
    }

    /// Gives the next shape a text for the pointer.
    pub fn say(&self, text: String) {
        self.hover.set(text);
    }

    pub fn line(&self, points: &[[f64; 2]], style: ShapeStyle) -> DrawResult {
        let points: Vec<_> = points.iter().map(|p| self.at(*p)).collect();
        self.sheet.draw(&PathElement::new(points, style))
    }

    pub fn area(&self, corners: &[[f64; 2]], colour: &impl Color) -> DrawResult {
        let corners: Vec<_> = corners.iter().map(|p| self.at(*p)).collect();
        self.sheet.draw(&Polygon::new(corners, colour.filled()))
    }

    /// A rectangle from one corner to the opposite one.
    pub fn rectangle(&self, a: [f64; 2], b: [f64; 2], colour: &impl Color) -> DrawResult {
        self.area(&[a, [b[0], a[1]], b, [a[0], b[1]]], colour)
    }

    pub fn dot(&self, at: [f64; 2], radius_px: f64, colour: &impl Color) -> DrawResult {
        let radius = (radius_px * f64::from(UNIT)).round() as u32;
        let style = colour.filled();
        self.sheet.draw(&Circle::new(self.at(at), radius, style))
    }

    /// A text with its middle at a place, moved by so many pixels to the right and down.
    pub fn text(&self, text: String, at: [f64; 2], (dx, dy): (i32, i32)) -> DrawResult {
        let (x, y) = self.at(at);
        self.label(
            text,
            (x + dx * UNIT, y + dy * UNIT),
            HPos::Center,
            VPos::Center,
        )
    }

    fn label(&self, text: String, at: (i32, i32), h: HPos, v: VPos) -> DrawResult {
        let style = TextStyle::from(("sans-serif", TICK as i32).into_font()).pos(Pos::new(h, v));
        self.sheet.draw(&Text::new(text, at, style))
    }

    /// Ticks of both axes; thin lines across at those of v where `lines` says so.
    pub fn axes(&self, lines: bool) -> DrawResult {
        let [left, right, top, bottom] = self.place;
        let about = |length: i32, px: i32| (length / (px * UNIT)).max(2) as usize;
        let ends = |[a, b]: [f64; 2]| (a.min(b), a.max(b));
        let (low, high) = ends(self.v);
        let (values, decimals) = ticks(low, high, about(bottom - top, 36));
        for v in values {
            let (_, y) = self.at([self.u[0], v]);
            if lines {
                let style = pen(&ink::GRID, 1.0);
                self.sheet
                    .draw(&PathElement::new(vec![(left, y), (right, y)], style))?;
            }
            let at = (left - 6 * UNIT, y);
            self.label(fixed(v, decimals), at, HPos::Right, VPos::Center)?;
        }
        let (low, high) = ends(self.u);
        let (values, decimals) = ticks(low, high, about(right - left, 70));
        for u in values {
            let (x, _) = self.at([u, self.v[0]]);
            let at = (x, bottom + 7 * UNIT);
            self.label(fixed(u, decimals), at, HPos::Center, VPos::Top)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plan_is_to_scale_and_may_run_to_the_left() {
        let drawing = to_scale(150, [1.0, -1.0], [0.0, 3.0], "", |plan| {
            assert_eq!(plan.at([1.0, 0.0]), (400, 1600));
            assert_eq!(plan.at([-1.0, 3.0]), (1400, 100));
            assert_eq!(plan.at([f64::NAN, 0.0]).0, 400);
            plan.axes(true)
        });
        // 100 px for 2 m, so 150 px for 3 m, and the margins.
        assert_eq!(drawing.size, (1500, (150 + 34) * 10));
        assert!(drawing.svg().contains("−1"), "{}", drawing.svg());
    }
}
