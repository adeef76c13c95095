//! Contours of values on a grid, by marching squares.
//!
//! The values are at the middles of cells; cells without a value are outside. A region ends half a
//! cell beyond its last value, where the cell ends.

use std::collections::BTreeMap;

/// Values on a grid, row by row from the lowest; NaN where there is none.
pub(in crate::report) struct Grid<'a> {
    /// Columns and rows.
    pub count: [usize; 2],
    /// Values.
    pub values: &'a [f64],
}

/// The outline of a region: closed, the region on its left, so that holes run the other way round.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::report) struct Loop {
    /// Corners in cells from the grid's lower corner.
    pub points: Vec<(f64, f64)>,
    /// Whether the corner lies at the end of the values, not on the contour.
    pub border: Vec<bool>,
}

/// An edge between two middles: the lower or left one (counted from -1, moved by one), and whether it
/// goes up.
type Edge = (usize, usize, bool);

impl Grid<'_> {
    /// The value of column `i - 1` in row `j - 1`.
    fn at(&self, (i, j): (usize, usize)) -> f64 {
        let [columns, rows] = self.count;
        if i == 0 || j == 0 || i > columns || j > rows {
            return f64::NAN;
        }
        let index = (j - 1) * columns + i - 1;
        self.values.get(index).copied().unwrap_or(f64::NAN)
    }

    /// The outlines of where values are at or above `level`; of minus infinity, of all values.
    pub fn region(&self, level: f64) -> Vec<Loop> {
        let inside = |v: f64| v.is_finite() && v >= level;
        // From the edge where an outline enters a square to the one where it leaves it.
        let mut steps: BTreeMap<Edge, Edge> = BTreeMap::new();
        for j in 0..=self.count[1] {
            for i in 0..=self.count[0] {
                let corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)];
                let edges = [
                    (i, j, false),
                    (i + 1, j, true),
                    (i, j + 1, false),
                    (i, j, true),
                ];
                let values = corners.map(|c| self.at(c));
                let within = values.map(inside);
                let leaves = |k: usize| within[k] && !within[(k + 1) % 4];
                let enters = |k: usize| !within[k] && within[(k + 1) % 4];
                let saddle = (0..4).filter(|k| leaves(*k)).count() == 2;
                let mean = values.iter().sum::<f64>() / 4.0;
                for k in (0..4).filter(|k| leaves(*k)) {
                    // Round the square, the next edge that comes in again; at a saddle whose middle is
                    // outside, the one before.
                    let next = if saddle && !inside(mean) { 3 } else { 1 };
                    let to = (0..4)
                        .map(|n| (k + next * (n + 1)) % 4)
                        .find(|m| enters(*m));
                    if let Some(to) = to {
                        steps.insert(edges[k], edges[to]);
                    }
                }
            }
        }
        let mut loops = Vec::new();
        while let Some((&start, _)) = steps.first_key_value() {
            let mut found = Loop {
                points: Vec::new(),
                border: Vec::new(),
            };
            let mut edge = start;
            while let Some(next) = steps.remove(&edge) {
                let (point, border) = self.crossing(edge, level);
                found.points.push(point);
                found.border.push(border);
                edge = next;
            }
            loops.push(found);
        }
        loops
    }

    /// Where an edge is crossed, and whether that is at the end of the values.
    fn crossing(&self, (i, j, up): Edge, level: f64) -> ((f64, f64), bool) {
        let other = if up { (i, j + 1) } else { (i + 1, j) };
        let (a, b) = (self.at((i, j)), self.at(other));
        let share = (level - a) / (b - a);
        let (share, border) = if share.is_finite() {
            (share.clamp(0.0, 1.0), false)
        } else {
            (0.5, true)
        };
        let (x, y) = (i as f64 - 0.5, j as f64 - 0.5);
        let point = if up { (x, y + share) } else { (x + share, y) };
        (point, border)
    }

    /// The lines where the values are `level`.
    pub fn lines(&self, level: f64) -> Vec<Vec<(f64, f64)>> {
        let mut lines = Vec::new();
        for found in self.region(level) {
            let n = found.points.len();
            // A line begins after a stretch along the border, if there is one.
            let along = |k: usize| found.border[k % n] && found.border[(k + 1) % n];
            let start = (0..n).find(|k| along(*k)).map(|k| k + 1);
            let first = start.unwrap_or(0);
            let mut piece = Vec::new();
            for k in first..=first + n {
                piece.push(found.points[k % n]);
                if along(k) || k == first + n {
                    if piece.len() > 1 {
                        lines.push(std::mem::take(&mut piece));
                    }
                    piece.clear();
                }
            }
        }
        lines
    }
}

/// One outline of all `loops`: each is joined to the first by a line there and back, which has no
/// inside.
pub(in crate::report) fn joined(loops: &[Loop]) -> Vec<(f64, f64)> {
    let mut outline = Vec::new();
    let start = loops.first().and_then(|l| l.points.first()).copied();
    for found in loops {
        outline.extend(&found.points);
        outline.extend(found.points.first());
        outline.extend(start);
    }
    outline
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Twice the area of a closed outline, positive where it runs counterclockwise.
    fn area(points: &[(f64, f64)]) -> f64 {
        let next = points.iter().cycle().skip(1);
        let cross = points.iter().zip(next).map(|(a, b)| a.0 * b.1 - a.1 * b.0);
        0.5 * cross.sum::<f64>()
    }

    #[test]
    fn a_cone_has_circles() {
        let n = 41;
        let value = |k: usize| {
            let (x, y) = ((k % n) as f64 - 20.0, (k / n) as f64 - 20.0);
            20.0 - x.hypot(y)
        };
        let values: Vec<f64> = (0..n * n).map(value).collect();
        let grid = Grid {
            count: [n, n],
            values: &values,
        };
        for radius in [5.0, 10.0, 15.0] {
            let region = grid.region(20.0 - radius);
            assert_eq!(region.len(), 1);
            let want = std::f64::consts::PI * radius * radius;
            let got = area(&region[0].points);
            assert!((got / want - 1.0).abs() < 0.01, "{radius}: {got} {want}");
            let lines = grid.lines(20.0 - radius);
            assert_eq!(lines.len(), 1);
            assert_eq!(lines[0].first(), lines[0].last(), "it is closed");
            for (x, y) in &lines[0] {
                let r = (x - 20.5).hypot(y - 20.5);
                assert!((r - radius).abs() < 0.1, "{r}");
            }
        }
    }

    #[test]
    fn holes_run_the_other_way_round() {
        let mut values = vec![1.0; 25];
        values[12] = f64::NAN;
        let grid = Grid {
            count: [5, 5],
            values: &values,
        };
        let mut areas: Vec<f64> = grid
            .region(f64::NEG_INFINITY)
            .iter()
            .map(|l| area(&l.points))
            .collect();
        areas.sort_by(f64::total_cmp);
        // 5 by 5 cells without their four corners' eighths; a hole of one cell with cut corners.
        assert_eq!(areas, [-0.5, 24.5]);
        assert!(
            grid.lines(0.5).is_empty(),
            "an end of the values is no contour"
        );
    }

    #[test]
    fn a_slope_has_straight_lines_from_end_to_end() {
        let values: Vec<f64> = (0..20).map(|k| f64::from(k % 5)).collect();
        let grid = Grid {
            count: [5, 4],
            values: &values,
        };
        let lines = grid.lines(1.25);
        assert_eq!(lines.len(), 1);
        assert!(
            lines[0]
                .iter()
                .filter(|(x, _)| (x - 1.75).abs() < 1e-12)
                .count()
                >= 4
        );
    }

    proptest! {
        #[test]
        fn any_grid_has_closed_outlines(
            columns in 1usize..7,
            values in prop::collection::vec(prop_oneof![3 => -1.0f64..1.0, 1 => Just(f64::NAN)], 1..40),
            level in -1.2f64..1.2,
        ) {
            let rows = values.len() / columns;
            let grid = Grid { count: [columns, rows], values: &values[..columns * rows] };
            let total: f64 = grid.region(level).iter().map(|l| area(&l.points)).sum();
            let all: f64 = grid.region(f64::NEG_INFINITY).iter().map(|l| area(&l.points)).sum();
            prop_assert!(total >= -1e-9 && total <= all + 1e-9, "{} of {}", total, all);
            let _ = grid.lines(level);
        }
    }
}
