//! The workspace as a picture on a terminal: in colours, two rows of cells to a line by half blocks;
//! where there are none, by digits.

use super::super::axis::{AXES, Axis};
use super::super::figure::heat_range;
use super::super::number::fixed;
use super::super::scale::size_colour;
use super::super::workspace::{CELL_AXES, Cell, Cells, Layout};
use std::fmt::Write;

/// How a map shows the sizes of values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Shades {
    /// Colours of 24 bits.
    Colours,
    /// 0 for the smallest to 9 for the largest.
    Digits,
}

impl Shades {
    /// Most cells of a map across and up: of colours as many as a line holds, of digits as many as
    /// can be read.
    fn most_cells(self) -> [usize; 2] {
        match self {
            Shades::Colours => [36, 36],
            Shades::Digits => [16, 12],
        }
    }
}

/// The rms of x and yaw over the workspace, as lines.
pub(super) fn of(cells: &Cells, shades: Shades) -> Vec<String> {
    let [columns, rows] = shades.most_cells();
    let cells = cells.coarser(columns, rows);
    let axes = CELL_AXES.iter().filter_map(|i| AXES.get(*i)).enumerate();
    let shown = axes.filter(|(_, axis)| ["x", "yaw"].contains(&axis.name));
    let lines = |(k, axis): (usize, &Axis)| {
        let few = cells.layout.few;
        let value = |c: &Cell| {
            if c.n >= few {
                c.rms(k) * axis.factor
            } else {
                f64::NAN
            }
        };
        let values: Vec<f64> = cells.cells.iter().map(value).collect();
        let map = Map {
            title: format!("{} rms, {}", axis.name, axis.unit),
            layout: cells.layout,
            values: &values,
            range: heat_range(&values, false).0,
            decimals: axis.decimals,
        };
        let mut lines = map.lines(shades);
        lines.push(String::new());
        lines
    };
    shown.flat_map(lines).collect()
}

/// What a map shows.
struct Map<'a> {
    /// What it is of, with its unit.
    title: String,
    /// Where the cells are.
    layout: Layout,
    /// A value for each cell, row by row from the lowest; NaN for an empty one.
    values: &'a [f64],
    /// The values of the first and of the last shade.
    range: [f64; 2],
    /// Decimals of a value.
    decimals: usize,
}

/// Characters that a cell is wide: two, so that with half a line of height it is a square.
const WIDE: usize = 2;
/// Characters of the colour scale.
const SCALE: usize = 16;

type Rgb = (u8, u8, u8);

impl Map<'_> {
    /// How far along the scale a value is, from 0 to 1.
    fn share(&self, value: f64) -> f64 {
        let [low, high] = self.range;
        ((value - low) / (high - low)).clamp(0.0, 1.0)
    }

    fn colour(&self, value: f64) -> Option<Rgb> {
        value.is_finite().then(|| size_colour(self.share(value)))
    }

    fn digit(&self, value: f64) -> Option<u32> {
        value
            .is_finite()
            .then(|| (10.0 * self.share(value)).min(9.0) as u32)
    }

    /// The map as lines: the title, rows from the highest z down, where y is, the scale.
    fn lines(&self, shades: Shades) -> Vec<String> {
        let mut lines = vec![self.title.clone()];
        match shades {
            Shades::Colours => lines.extend(self.colours()),
            Shades::Digits => lines.extend(self.digits()),
        }
        let [[from, to], _] = self.layout.ends_m();
        lines.push(format!("y {} to {} m", fixed(from, 2), fixed(to, 2)));
        lines.push(match shades {
            Shades::Colours => self.colour_scale(),
            Shades::Digits => self.digit_scale(),
        });
        lines
    }

    fn value(&self, column: usize, row: usize) -> f64 {
        let [columns, rows] = self.layout.count;
        let index = (row < rows).then_some(row * columns + column);
        let value = index.and_then(|i| self.values.get(i)).copied();
        value.unwrap_or(f64::NAN)
    }

    /// What stands at the right of a row.
    fn height(&self, row: usize) -> String {
        let [_, z] = self.layout.centre_m(row * self.layout.count[0]);
        format!(" z {} m", fixed(z, 2))
    }

    fn colours(&self) -> Vec<String> {
        let [columns, rows] = self.layout.count;
        let line = |upper: usize| {
            let mut line = String::new();
            for column in 0..columns {
                let below = upper.checked_sub(1);
                let below = below.and_then(|row| self.colour(self.value(column, row)));
                block(&mut line, self.colour(self.value(column, upper)), below);
            }
            line.push_str(RESET);
            line + &self.height(upper)
        };
        (0..rows).rev().step_by(2).map(line).collect()
    }

    fn digits(&self) -> Vec<String> {
        let [columns, rows] = self.layout.count;
        let line = |row: usize| {
            let digit = |column: usize| self.digit(self.value(column, row));
            let cells = (0..columns).map(|column| match digit(column) {
                Some(digit) => format!("{digit:<WIDE$}"),
                None => " ".repeat(WIDE),
            });
            cells.collect::<String>() + &self.height(row)
        };
        (0..rows).rev().map(line).collect()
    }

    /// Which colour is which value.
    fn colour_scale(&self) -> String {
        let [low, high] = self.range;
        let mut line = format!("{} ", fixed(low, self.decimals));
        for i in 0..SCALE {
            let value = low + (high - low) * (i as f64 + 0.5) / SCALE as f64;
            if let Some((r, g, b)) = self.colour(value) {
                let _ = write!(line, "\x1b[48;2;{r};{g};{b}m ");
            }
        }
        let _ = write!(line, "{RESET} {}", fixed(high, self.decimals));
        line
    }

    /// Which digit is which value.
    fn digit_scale(&self) -> String {
        let [low, high] = self.range;
        let step = (high - low) / 10.0;
        let text = |value: f64| fixed(value, self.decimals);
        format!(
            "0: {} to {}, each digit {} more, 9: from {} on",
            text(low),
            text(low + step),
            text(step),
            text(high - step)
        )
    }
}

const RESET: &str = "\x1b[0m";

/// Two cells above each other; what is empty keeps the terminal's own colour.
fn block(line: &mut String, upper: Option<Rgb>, lower: Option<Rgb>) {
    line.push_str(RESET);
    let front = |(r, g, b): Rgb| format!("\x1b[38;2;{r};{g};{b}m");
    let back = |(r, g, b): Rgb| format!("\x1b[48;2;{r};{g};{b}m");
    let (codes, sign) = match (upper, lower) {
        (Some(upper), Some(lower)) => (front(upper) + &back(lower), "▀"),
        (Some(upper), None) => (front(upper), "▀"),
        (None, Some(lower)) => (front(lower), "▄"),
        (None, None) => (String::new(), " "),
    };
    line.push_str(&codes);
    line.push_str(&sign.repeat(WIDE));
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Row by row from the lowest, of 1 m.
    fn map(values: &[f64]) -> Map<'_> {
        Map {
            title: "x, mm".to_owned(),
            layout: Layout {
                origin_m: [0.0; 2],
                size_m: [1.0; 2],
                count: [2, 3],
                few: 1,
            },
            values,
            range: [0.0, 1.0],
            decimals: 1,
        }
    }

    #[test]
    fn colours_are_where_the_cells_were() {
        let lines = map(&[0.0, 1.0, f64::NAN, 0.0, 1.0, f64::NAN]).lines(Shades::Colours);
        assert_eq!(lines.len(), 5, "title, two pairs of rows, y, scale");
        let (dark, bright) = ("68;1;84m", "253;231;37m");
        // The highest row: bright, empty; below it empty, dark.
        assert_eq!(
            lines[1],
            format!("\x1b[0m\x1b[38;2;{bright}▀▀\x1b[0m\x1b[38;2;{dark}▄▄\x1b[0m z 2.50 m")
        );
        assert_eq!(
            lines[2],
            format!("\x1b[0m\x1b[38;2;{dark}▀▀\x1b[0m\x1b[38;2;{bright}▀▀\x1b[0m z 0.50 m")
        );
        assert_eq!(lines[3], "y 0.00 to 2.00 m");
        assert!(lines[4].starts_with("0.0 ") && lines[4].ends_with(" 1.0"));
    }

    #[test]
    fn digits_are_where_the_cells_were() {
        let lines = map(&[0.0, 0.95, f64::NAN, 0.31, 7.0, 0.09]).lines(Shades::Digits);
        let want = [
            "x, mm",
            "9 0  z 2.50 m",
            "  3  z 1.50 m",
            "0 9  z 0.50 m",
            "y 0.00 to 2.00 m",
            "0: 0.0 to 0.1, each digit 0.1 more, 9: from 0.9 on",
        ];
        assert_eq!(lines, want);
    }
}
