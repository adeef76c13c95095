//! The search for the three lines with no idea where they are.

use crate::record::{BeamTable, NormalLine};
use std::f64::consts::{FRAC_PI_2, PI};

/// The search, with its histograms kept from scan to scan.
#[derive(Clone, Debug, Default)]
pub(in crate::lines) struct ColdStart {
    points: Vec<(f64, f64)>,
    across: Histogram,
    up: Histogram,
}

/// Points by position.
#[derive(Clone, Debug, Default)]
struct Histogram {
    cells: Vec<u32>,
    /// Each cell's count with its two neighbours'.
    around: Vec<u32>,
}

impl Histogram {
    fn clear(&mut self, cells: usize) {
        self.cells.clear();
        self.cells.resize(cells, 0);
    }

    fn add(&mut self, at_cells: f64) {
        if at_cells >= 0.0
            && let Some(cell) = self.cells.get_mut(at_cells as usize)
        {
            *cell += 1;
        }
    }

    /// To be called when all points are in.
    fn close(&mut self) {
        self.around.clear();
        let cell = |i: Option<usize>| i.and_then(|i| self.cells.get(i)).copied().unwrap_or(0);
        let sum = |i: usize| cell(i.checked_sub(1)) + cell(Some(i)) + cell(i.checked_add(1));
        self.around.extend((0..self.cells.len()).map(sum));
    }

    fn len(&self) -> usize {
        self.around.len()
    }

    /// Points in a cell and its neighbours; none beyond the ends.
    fn around(&self, i: usize) -> u64 {
        self.around.get(i).map_or(0, |count| u64::from(*count))
    }
}

/// Width of a histogram cell, m.
const CELL_M: f64 = 0.04;
/// The largest roll that is looked for, and the step, rad.
const ROLL_MAX_RAD: f64 = 10.0 * PI / 180.0;
const ROLL_STEP_RAD: f64 = 0.5 * PI / 180.0;

impl ColdStart {
    /// Right, upper and left line to within a few centimetres and half a degree.
    pub(in crate::lines) fn find(
        &mut self,
        beams: &BeamTable,
        ranges_m: &[f64],
        dy_m: f64,
        gap_m: Option<f64>,
    ) -> Option<[NormalLine; 3]> {
        self.points.clear();
        self.points.extend(
            beams
                .cos_sin
                .iter()
                .zip(ranges_m)
                .filter(|(_, r)| r.is_finite() && **r > 0.05)
                .map(|((c, s), r)| (r * c, r * s)),
        );
        let reach_m = dy_m + 2.0;
        let across_cells = (2.0 * reach_m / CELL_M) as usize + 1;
        let up_cells = (reach_m / CELL_M) as usize + 1;
        let width_cells = (dy_m / CELL_M).round() as usize;
        let gap_cells = gap_m.map(|gap_m| (gap_m / CELL_M).round() as usize);
        let mut best: Option<(u64, f64, f64, f64)> = None;
        let steps = (2.0 * ROLL_MAX_RAD / ROLL_STEP_RAD).round() as i32;
        for step in 0..=steps {
            let roll_rad = -ROLL_MAX_RAD + f64::from(step) * ROLL_STEP_RAD;
            let (sin, cos) = roll_rad.sin_cos();
            self.across.clear(across_cells);
            self.up.clear(up_cells);
            for (y, z) in &self.points {
                self.across
                    .add((y * cos - z * sin + reach_m) * (1.0 / CELL_M));
                self.up.add((y * sin + z * cos) * (1.0 / CELL_M));
            }
            self.across.close();
            self.up.close();
            let (walls, right_cell) = best_walls(&self.across, width_cells, gap_cells);
            let (ceiling, up_cell) = best_ceiling(&self.up, gap_cells);
            let score = walls + ceiling;
            if best.is_none_or(|(best, ..)| score > best) {
                let right_m = (right_cell as f64 + 0.5) * CELL_M - reach_m;
                let upper_m = (up_cell as f64 + 0.5) * CELL_M;
                best = Some((score, roll_rad, right_m, upper_m));
            }
        }
        let (score, roll_rad, right_m, upper_m) = best?;
        if score == 0 {
            return None;
        }
        Some([
            NormalLine::new(right_m, -roll_rad),
            NormalLine::new(upper_m, FRAC_PI_2 - roll_rad),
            NormalLine::new((dy_m - right_m).max(CELL_M), PI - roll_rad),
        ])
    }
}

/// The right wall's cell: where points pile up there, or one background gap behind it, and one
/// frame width to the left of it, or one gap behind that. A reflector that the scan plane misses
/// shows the surface behind it, which may return more beams than the reflectors do: only points at
/// both ends together tell which is which. With one wall hidden the other decides as it can.
fn best_walls(across: &Histogram, width_cells: usize, gap_cells: Option<usize>) -> (u64, usize) {
    let middle = across.len() / 2;
    let mut best = (0.0, middle);
    // The scanner is inside: the right wall lies to the right of it, the left one to the left.
    for right in middle..(middle + width_cells).min(across.len()) {
        let Some(left) = right.checked_sub(width_cells) else {
            continue;
        };
        let plates = across.around(right) + across.around(left);
        let with_behind = |cell: usize, behind: Option<usize>| {
            across.around(cell) + behind.map_or(0, |behind| across.around(behind))
        };
        let a = with_behind(right, gap_cells.map(|gap| right + gap));
        let b = with_behind(left, gap_cells.and_then(|gap| left.checked_sub(gap)));
        let score = 2.0 * ((a * b) as f64).sqrt() + 0.1 * plates as f64;
        if score > best.0 {
            best = (score, right);
        }
    }
    (best.0 as u64, best.1)
}

/// The strip plane's score and cell. With a background it is where the product of the counts there
/// and one gap behind is largest: the background alone has more points than the strips. The score is
/// that of a wall, points at both places, or a cargo's top would outdo the few strips in sight.
fn best_ceiling(up: &Histogram, gap_cells: Option<usize>) -> (u64, usize) {
    const FIRST: usize = 3; // nearer than 12 cm is the platform itself
    if let Some(gap) = gap_cells {
        let product = |i: &usize| up.around(*i) * up.around(i + gap);
        // Of equals the nearest.
        if let Some(i) = (FIRST..up.len()).rev().max_by_key(product)
            && product(&i) > 0
        {
            return (2 * product(&i).isqrt(), i);
        }
    }
    // Nothing behind: the nearest plane with a fair share of the points.
    let most = (FIRST..up.len()).map(|i| up.around(i)).max().unwrap_or(0);
    let Some(i) = (FIRST..up.len()).find(|i| up.around(*i) * 2 > most) else {
        return (0, 0);
    };
    let near = i..(i + 3).min(up.len());
    let peak = near.max_by_key(|j| up.around(*j)).unwrap_or(i);
    (up.around(peak), peak)
}
