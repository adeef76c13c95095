//! The modified transform for the three reflectors of a frame: one window each.

use super::window::{Accumulator, Window};
use crate::record::NormalLine;

/// How far a line can be from where it was, and the cells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WindowSize {
    /// Largest speed of the platform, m/s (CABLAR: 3).
    pub speed_m_s: f64,
    /// Largest rate of turn in the scan plane, rad/s.
    pub turn_rad_s: f64,
    /// The scaling factor of eq. 4.6: a scan may be lost.
    pub factor: f64,
    /// From scan to scan where the scan does not say, s.
    pub cycle_s: f64,
    /// Height of a cell, m.
    pub row_m: f64,
    /// Width of a cell, rad.
    pub column_rad: f64,
}

impl Default for WindowSize {
    fn default() -> Self {
        WindowSize {
            speed_m_s: 3.0,
            turn_rad_s: 20f64.to_radians(),
            factor: 2.0,
            cycle_s: 1.0 / 35.0,
            row_m: 0.01,
            column_rad: 0.1f64.to_radians(),
        }
    }
}

impl WindowSize {
    /// Half height (m) and half width (rad) of a window, eq. 4.6: speed times cycle times factor.
    /// A scan's own time is used where it has one.
    pub fn reach(&self, scan_time_s: f64) -> [f64; 2] {
        let cycle_s = if scan_time_s > 0.0 && scan_time_s.is_finite() {
            scan_time_s
        } else {
            self.cycle_s
        };
        [self.speed_m_s, self.turn_rad_s].map(|rate| rate * cycle_s * self.factor)
    }
}

/// The transform in three windows; keeps its buffers.
#[derive(Clone, Debug, Default)]
pub struct ReflectorTransform {
    accumulator: Accumulator,
    near: Vec<(f32, f32)>,
    /// Cells of the three windows of the scan before.
    pub cells: usize,
    /// Votes cast in them, eq. 4.4.
    pub votes_cast: u64,
}

impl ReflectorTransform {
    /// The right, upper and left line near the predicted ones: distance, m, direction, rad, and the
    /// votes of the cell; none where nothing voted. `y_m` and `z_m` are the points; beams without a
    /// return are not finite.
    pub fn find(
        &mut self,
        [y_m, z_m]: [&[f32]; 2],
        predicted: &[NormalLine; 3],
        size: &WindowSize,
        scan_time_s: f64,
    ) -> [Option<([f64; 2], u32)>; 3] {
        let reach = size.reach(scan_time_s);
        (self.cells, self.votes_cast) = (0, 0);
        predicted.map(|line| {
            let around = [line.d_m, line.alpha_rad];
            let window = Window::around(around, reach, size.row_m, size.column_rad);
            self.gather([y_m, z_m], &line, reach);
            self.accumulator.vote(&window);
            self.cells += window.cells();
            self.votes_cast += (self.accumulator.points() * window.columns) as u64;
            self.accumulator.peak(&window)
        })
    }

    /// Puts the points into the accumulator that can vote in a line's window.
    fn gather(&mut self, [y_m, z_m]: [&[f32]; 2], line: &NormalLine, reach: [f64; 2]) {
        let (sin, cos) = line.alpha_rad.sin_cos();
        let (sin, cos, d) = (sin as f32, cos as f32, line.d_m as f32);
        let [d_reach, turn] = reach.map(|v| v as f32);
        // Every point is written where the next one belongs, which spares a branch a point.
        self.near.resize(y_m.len() + 1, (0.0, 0.0));
        let mut count = 0;
        for (y, z) in y_m.iter().zip(z_m) {
            let off = (y * cos + z * sin - d).abs();
            let limit = d_reach + turn * (z * cos - y * sin).abs();
            if let Some(place) = self.near.get_mut(count) {
                *place = (*y, *z);
            }
            count += usize::from(off <= limit);
        }
        self.accumulator.clear();
        for (y, z) in &self.near[..count] {
            self.accumulator.add_single(*y, *z);
        }
    }
}
