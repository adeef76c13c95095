//! The whole space, column by column: the votes of one direction are counted, its best row kept, and
//! the counters used again for the next.
//!
//! Taking votes away can only lower a count, so a column's old best is a bound, and the best of all
//! is known as soon as the column with the highest bound is up to date. The result is that of an
//! accumulator array which is decremented, in the space of one of its columns.

use super::row_of;
use std::f64::consts::PI;

/// The cell with the most votes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Peak {
    /// Distance, m; negative where the normal points away from the line.
    pub d_m: f64,
    /// Direction of the normal, rad, in [0, pi).
    pub alpha_rad: f64,
    /// Votes in the cell and the two beside it in distance.
    pub votes: u32,
}

/// Votes by direction; keeps its buffers from scan to scan.
#[derive(Clone, Debug, Default)]
pub struct Columns {
    directions: Vec<(f32, f32)>,
    row_m: f64,
    /// The points that vote, in rows.
    y: Vec<f32>,
    z: Vec<f32>,
    id: Vec<u32>,
    rows: Vec<u32>,
    counts: Vec<u16>,
    best: Vec<Best>,
    version: u32,
    /// Points that a column looked at, over all columns: the measure of work.
    pub votes_cast: u64,
}

#[derive(Clone, Copy, Debug, Default)]
struct Best {
    votes: u32,
    row: u32,
    version: u32,
}

impl Columns {
    /// Begins with `columns` directions and rows of `row_m`, without points.
    pub fn begin(&mut self, columns: usize, row_m: f64) {
        if self.directions.len() != columns {
            self.directions.clear();
            self.directions.extend((0..columns).map(|k| {
                let (sin, cos) = (PI * k as f64 / columns as f64).sin_cos();
                (cos as f32, sin as f32)
            }));
        }
        self.row_m = row_m;
        self.y.clear();
        self.z.clear();
        self.id.clear();
        self.best.clear();
        self.version = 1;
    }

    /// Adds a point (m) with a number of the caller's.
    pub fn add(&mut self, y_m: f64, z_m: f64, id: usize) {
        let scale = 1.0 / self.row_m;
        self.y.push((y_m * scale) as f32);
        self.z.push((z_m * scale) as f32);
        self.id.push(id as u32);
    }

    /// Takes away the votes of all points that `goes` says, by their numbers.
    pub fn remove(&mut self, mut goes: impl FnMut(usize) -> bool) {
        self.keep(|id, _| !goes(id));
    }

    /// Takes away the points of a peak's cells.
    pub fn remove_peak(&mut self, peak: &Peak) {
        let (sin, cos) = peak.alpha_rad.sin_cos();
        let (sin, cos, d) = (sin as f32, cos as f32, (peak.d_m / self.row_m) as f32);
        let before = self.id.len();
        self.keep(|_, [y, z]| (y * cos + z * sin - d).abs() > 1.5);
        // Rounding must not keep a peak alive for ever.
        if self.id.len() == before {
            self.keep(|_, _| false);
        }
    }

    /// Keeps the points that `stays` says, by their numbers or by where they are, in rows.
    fn keep(&mut self, mut stays: impl FnMut(usize, [f32; 2]) -> bool) {
        let mut kept = 0;
        for k in 0..self.id.len() {
            let (y, z, id) = (self.y[k], self.z[k], self.id[k]);
            (self.y[kept], self.z[kept], self.id[kept]) = (y, z, id);
            kept += usize::from(stays(id as usize, [y, z]));
        }
        if kept < self.id.len() {
            self.y.truncate(kept);
            self.z.truncate(kept);
            self.id.truncate(kept);
            self.version += 1;
        }
    }

    /// The cell with the most votes; none without points.
    pub fn peak(&mut self) -> Option<Peak> {
        if self.id.is_empty() {
            return None;
        }
        if self.best.is_empty() {
            self.best.resize(self.directions.len(), Best::default());
            for column in 0..self.directions.len() {
                self.count(column);
            }
        }
        loop {
            let mut top = 0;
            for (column, best) in self.best.iter().enumerate() {
                if best.votes > self.best[top].votes {
                    top = column;
                }
            }
            if self.best[top].version == self.version {
                let best = self.best[top];
                return Some(Peak {
                    d_m: f64::from(best.row as u16 as i16) * self.row_m,
                    alpha_rad: PI * top as f64 / self.directions.len() as f64,
                    votes: best.votes,
                });
            }
            self.count(top);
        }
    }

    /// Counts a column's votes and keeps its best row.
    fn count(&mut self, column: usize) {
        const ROWS: usize = 1 << 16;
        self.counts.resize(ROWS, 0);
        let (cos, sin) = self.directions[column];
        self.rows.clear();
        self.rows.extend(
            self.y
                .iter()
                .zip(&self.z)
                .map(|(y, z)| row_of(y * cos + z * sin)),
        );
        self.votes_cast += self.rows.len() as u64;
        let Ok(counts) = <&mut [u16; ROWS]>::try_from(&mut self.counts[..]) else {
            return;
        };
        for row in &self.rows {
            let count = &mut counts[(*row & 0xffff) as usize];
            *count = count.saturating_add(1);
        }
        let mut best = Best {
            version: self.version,
            ..Best::default()
        };
        for row in &self.rows {
            let at = |off: u32| u32::from(counts[(row.wrapping_add(off) & 0xffff) as usize]);
            let votes = at(0) + at(1) + at(u32::MAX);
            if votes > best.votes {
                best.votes = votes;
                best.row = *row;
            }
        }
        for row in &self.rows {
            counts[(*row & 0xffff) as usize] = 0;
        }
        self.best[column] = best;
    }
}
