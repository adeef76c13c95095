//! The workspace in colours on a terminal: two rows of cells to a line, by half blocks.

use super::super::axis::{AXES, Axis};
use super::super::figure::heat_range;
use super::super::number::fixed;
use super::super::scale::{sign_colour, size_colour};
use super::super::workspace::{CELL_AXES, Cell, Cells, Layout};
use std::fmt::Write;

/// The rms of x and yaw over the workspace, as lines.
pub(super) fn of(cells: &Cells) -> Vec<String> {
    let cells = cells.coarser(COLUMNS, COLUMNS);
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
            signed: false,
            decimals: axis.decimals,
        };
        let mut lines = map.lines();
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
    /// The values of the first and of the last colour.
    range: [f64; 2],
    /// Blue, white and red about the middle instead of dark to bright.
    signed: bool,
    /// Decimals of a value.
    decimals: usize,
}

/// Most cells of a map across, and as many up.
const COLUMNS: usize = 36;
/// Characters that a cell is wide: two, so that with half a line of height it is a square.
const WIDE: usize = 2;
/// Characters of the colour scale.
const SCALE: usize = 16;

type Rgb = (u8, u8, u8);

impl Map<'_> {
    fn colour(&self, value: f64) -> Option<Rgb> {
        let [low, high] = self.range;
        let share = (value - low) / (high - low);
        let colour = if self.signed {
            sign_colour(2.0 * share - 1.0)
        } else {
            size_colour(share)
        };
        value.is_finite().then_some(colour)
    }

    /// The map as lines: the title, rows from the highest z down, the scale.
    fn lines(&self) -> Vec<String> {
        let [columns, rows] = self.layout.count;
        let mut lines = vec![self.title.clone()];
        let at = |column: usize, row: Option<usize>| {
            let index = row.filter(|r| *r < rows).map(|r| r * columns + column);
            let value = index.and_then(|i| self.values.get(i)).copied();
            self.colour(value.unwrap_or(f64::NAN))
        };
        for upper in (0..rows).rev().step_by(2) {
            let mut line = String::new();
            for column in 0..columns {
                let below = upper.checked_sub(1);
                block(&mut line, at(column, Some(upper)), at(column, below));
            }
            line.push_str(RESET);
            if let Some([_, z]) = (columns > 0).then(|| self.layout.centre_m(upper * columns)) {
                let _ = write!(line, " z {} m", fixed(z, 2));
            }
            lines.push(line);
        }
        lines.push(self.scale());
        lines
    }

    /// Which colour is which value.
    fn scale(&self) -> String {
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

    #[test]
    fn cells_are_where_they_were() {
        let layout = Layout {
            origin_m: [0.0; 2],
            size_m: [1.0; 2],
            count: [2, 3],
            few: 1,
        };
        // Row by row from the lowest.
        let values = [0.0, 1.0, f64::NAN, 0.0, 1.0, f64::NAN];
        let map = Map {
            title: "x, mm".to_owned(),
            layout,
            values: &values,
            range: [0.0, 1.0],
            signed: false,
            decimals: 1,
        };
        let lines = map.lines();
        assert_eq!(lines.len(), 4, "title, two pairs of rows, scale");
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
        assert!(lines[3].starts_with("0.0 ") && lines[3].ends_with(" 1.0"));
    }
}
