//! A small part of the space and its accumulator array.

use super::row_of;

/// A part of the space of lines, in cells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Window {
    /// Distance of the first row's middle, m.
    pub d_from_m: f64,
    /// Height of a cell, m.
    pub row_m: f64,
    /// Number of rows, below 65536.
    pub rows: usize,
    /// Direction of the first column's middle, rad.
    pub alpha_from_rad: f64,
    /// Width of a cell, rad.
    pub column_rad: f64,
    /// Number of columns.
    pub columns: usize,
}

impl Window {
    /// The window that reaches `d_reach_m` and `alpha_reach_rad` to all sides of a line, eq. 4.7 and
    /// 4.8.
    pub fn around(
        [d_m, alpha_rad]: [f64; 2],
        [d_reach_m, alpha_reach_rad]: [f64; 2],
        row_m: f64,
        column_rad: f64,
    ) -> Window {
        let rows = (d_reach_m / row_m).ceil().clamp(1.0, 30_000.0);
        let columns = (alpha_reach_rad / column_rad).ceil().clamp(1.0, 30_000.0);
        Window {
            d_from_m: d_m - rows * row_m,
            row_m,
            rows: 2 * rows as usize + 1,
            alpha_from_rad: alpha_rad - columns * column_rad,
            column_rad,
            columns: 2 * columns as usize + 1,
        }
    }

    /// Number of cells.
    pub fn cells(&self) -> usize {
        self.rows * self.columns
    }

    /// Distance and direction of a cell, which may lie between cells.
    pub fn at(&self, row: f64, column: f64) -> [f64; 2] {
        [
            self.d_from_m + row * self.row_m,
            self.alpha_from_rad + column * self.column_rad,
        ]
    }
}

const LANES: usize = 4;

/// The votes in a window; keeps its buffers.
#[derive(Clone, Debug, Default)]
pub struct Accumulator {
    /// Column by column; each has a row for the votes outside behind its own.
    cells: Vec<u16>,
    lanes: Vec<u16>,
    rows: Vec<u32>,
    y: Vec<f32>,
    z: Vec<f32>,
}

impl Accumulator {
    /// Forgets the points.
    pub fn clear(&mut self) {
        self.y.clear();
        self.z.clear();
    }

    /// Adds a point, m; one that is not finite has no vote.
    #[inline]
    pub fn add(&mut self, y_m: f64, z_m: f64) {
        if (y_m + z_m).is_finite() {
            self.y.push(y_m as f32);
            self.z.push(z_m as f32);
        }
    }

    /// Adds a finite point in single precision, m.
    #[inline]
    pub(super) fn add_single(&mut self, y_m: f32, z_m: f32) {
        self.y.push(y_m);
        self.z.push(z_m);
    }

    /// Number of points.
    pub fn points(&self) -> usize {
        self.y.len()
    }

    /// Lets all points vote in a window, eq. 4.2, in place of what the cells held.
    pub fn vote(&mut self, window: &Window) {
        let stride = window.rows + 1;
        let outside = window.rows as u32;
        self.cells.clear();
        self.cells.resize(stride * window.columns, 0);
        self.rows.resize(self.y.len(), 0);
        let scale = (1.0 / window.row_m) as f32;
        let from = (window.d_from_m / window.row_m) as f32;
        for (column, cells) in self.cells.chunks_exact_mut(stride).enumerate() {
            let [_, alpha_rad] = window.at(0.0, column as f64);
            let (sin, cos) = alpha_rad.sin_cos();
            let (sin, cos) = (sin as f32 * scale, cos as f32 * scale);
            let points = self.y.iter().zip(&self.z);
            for (row, (y, z)) in self.rows.iter_mut().zip(points) {
                *row = row_of(y * cos + z * sin - from).min(outside);
            }
            // Neighbouring beams of one line vote for one cell: in lanes of their own, so that one
            // count need not wait for the other.
            self.lanes.clear();
            self.lanes.resize(LANES * stride, 0);
            let (fours, rest) = self.rows.as_chunks::<LANES>();
            for rows in fours {
                for (lane, row) in rows.iter().enumerate() {
                    if let Some(count) = self.lanes.get_mut(lane * stride + *row as usize) {
                        *count = count.saturating_add(1);
                    }
                }
            }
            for row in rest {
                if let Some(count) = self.lanes.get_mut(*row as usize) {
                    *count = count.saturating_add(1);
                }
            }
            for lane in self.lanes.chunks_exact(stride) {
                for (cell, count) in cells.iter_mut().zip(lane) {
                    *cell = cell.saturating_add(*count);
                }
            }
        }
    }

    /// The window's cell with the most votes, eq. 4.7 and 4.8 turned round, as distance (m) and
    /// direction (rad), with its votes: to a fraction of a cell, the middle of the votes around it.
    /// None where nothing voted.
    pub fn peak(&self, window: &Window) -> Option<([f64; 2], u32)> {
        let stride = window.rows + 1;
        let mut best = (0u16, 0, 0);
        for (column, cells) in self.cells.chunks_exact(stride).enumerate() {
            let top = cells[..window.rows].iter().copied().max().unwrap_or(0);
            if top > best.0 {
                let row = cells.iter().position(|votes| *votes == top).unwrap_or(0);
                best = (top, column, row);
            }
        }
        let (votes, column, row) = best;
        if votes == 0 {
            return None;
        }
        let (mut sum, mut row_sum, mut column_sum) = (0.0, 0.0, 0.0);
        for c in column.saturating_sub(1)..(column + 2).min(window.columns) {
            for r in row.saturating_sub(1)..(row + 2).min(window.rows) {
                // Cells that hold less than half of the peak are of its flanks.
                let weight = f64::from(self.cells[c * stride + r]) - 0.5 * f64::from(votes);
                let weight = weight.max(0.0);
                sum += weight;
                row_sum += weight * r as f64;
                column_sum += weight * c as f64;
            }
        }
        let line = window.at(row_sum / sum, column_sum / sum);
        Some((line, u32::from(votes)))
    }

    /// Votes of a cell.
    pub fn votes(&self, window: &Window, row: usize, column: usize) -> u32 {
        let cell = self.cells.get(column * (window.rows + 1) + row);
        cell.map_or(0, |votes| u32::from(*votes))
    }
}
