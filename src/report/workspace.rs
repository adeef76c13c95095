//! Errors by place: the workspace in cells over y (along the frame) and z (up).

/// The components that cells keep, as indices into [`super::AXES`]: x, y, z, yaw, roll and pitch.
pub const CELL_AXES: [usize; 6] = [0, 1, 2, 5, 3, 4];

/// Most cells a layout has, so that a page stays small and a cell can be seen.
const MAX_CELLS: usize = 200;
/// Most cells of a size that was asked for: each takes memory, whether anything falls into it or not.
const MAX_ASKED: usize = 100_000;
/// Poses that a cell should hold on average.
const WANTED: usize = 10;
/// Poses below which a cell of a moving run says nothing.
const FEW: u32 = 3;
/// Different coordinates that a grid can have along one direction.
const GRID_LINES: usize = 1024;
/// Two coordinates closer than this are the same grid line, in micrometres.
const SAME_UM: i64 = 2;

/// Where the cells are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layout {
    /// Lower corner (y, z), m.
    pub origin_m: [f64; 2],
    /// Size of a cell (y, z), m.
    pub size_m: [f64; 2],
    /// Number of cells (y, z).
    pub count: [usize; 2],
    /// Poses below which a cell is left empty: 1 on a grid, where every pose was meant.
    pub few: u32,
}

impl Layout {
    /// Cells for reference positions (y, z) in m: of `size_m` if given (doubled until there are no more
    /// than a hundred thousand), else of a grid's own step (or a multiple of it), else of a round size.
    /// None for no positions.
    pub fn for_positions(positions: &[[f64; 2]], size_m: Option<f64>) -> Option<Layout> {
        let spans = [span(positions, 0)?, span(positions, 1)?];
        let grid = [grid_step(positions, 0), grid_step(positions, 1)];
        let few = match grid {
            [Some(_), Some(_)] => 1,
            _ => FEW,
        };
        if let Some(size) = size_m.filter(|s| s.is_finite() && *s > 0.0) {
            return std::iter::successors(Some(size), |size| Some(2.0 * size))
                .take_while(|size| size.is_finite())
                .map(|size| Layout::around(spans, [size; 2], grid, few))
                .find(|l| l.cells() <= MAX_ASKED && l.origin_m.iter().all(|v| v.is_finite()));
        }
        if let [Some(y), Some(z)] = grid {
            let layouts = (1..).map(|k| {
                let k = f64::from(k);
                Layout::around(spans, [k * y, k * z], grid, few)
            });
            return layouts.into_iter().find(Layout::is_small);
        }
        let round = [0.05, 0.1, 0.2, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0];
        let mut layouts = round
            .iter()
            .map(|size| Layout::around(spans, [*size; 2], [None; 2], few));
        let enough = |l: &Layout| positions.len() >= WANTED * l.count[0] * l.count[1];
        layouts
            .clone()
            .find(|l| l.is_small() && enough(l))
            .or_else(|| layouts.find(Layout::is_small))
    }

    fn is_small(&self) -> bool {
        self.cells() <= MAX_CELLS
    }

    fn cells(&self) -> usize {
        self.count[0].saturating_mul(self.count[1])
    }

    /// Cells that cover `spans`: half a step beyond a grid's first line, or from a whole multiple of
    /// their size.
    fn around(spans: [[f64; 2]; 2], size_m: [f64; 2], grid: [Option<f64>; 2], few: u32) -> Layout {
        let mut layout = Layout {
            origin_m: [0.0; 2],
            size_m,
            count: [1; 2],
            few,
        };
        for i in 0..2 {
            let [low, high] = spans[i];
            let size = size_m[i];
            layout.origin_m[i] = match grid[i] {
                Some(step) => low - 0.5 * step,
                None => (low / size + 1e-9).floor() * size,
            };
            let cells = ((high - layout.origin_m[i]) / size + 1e-9).floor().max(0.0) + 1.0;
            layout.count[i] = cells.min(1e6) as usize;
        }
        layout
    }

    /// From where to where the cells go along y and along z, m.
    pub fn ends_m(&self) -> [[f64; 2]; 2] {
        [0, 1].map(|i| {
            let from = self.origin_m[i];
            [from, from + self.size_m[i] * self.count[i] as f64]
        })
    }

    /// Index of the cell at (y, z), row by row from the lowest z.
    pub fn index(&self, place_m: [f64; 2]) -> Option<usize> {
        let mut at = [0usize; 2];
        for i in 0..2 {
            let place = (place_m[i] - self.origin_m[i]) / self.size_m[i] + 1e-9;
            if !(0.0..self.count[i] as f64).contains(&place) {
                return None;
            }
            at[i] = place as usize;
        }
        Some(at[1] * self.count[0] + at[0])
    }

    /// Middle (y, z) of the cell, m.
    pub fn centre_m(&self, index: usize) -> [f64; 2] {
        let at = [index % self.count[0], index / self.count[0]];
        [0, 1].map(|i| self.origin_m[i] + (at[i] as f64 + 0.5) * self.size_m[i])
    }
}

fn span(positions: &[[f64; 2]], i: usize) -> Option<[f64; 2]> {
    positions
        .iter()
        .map(|p| p[i])
        .fold(None, |span, v| match span {
            None => Some([v, v]),
            Some([low, high]) => Some([v.min(low), v.max(high)]),
        })
}

/// The step of a grid that the coordinates lie on; a metre for a single line. None if on no grid.
fn grid_step(positions: &[[f64; 2]], i: usize) -> Option<f64> {
    let mut lines: Vec<i64> = Vec::new();
    for position in positions {
        let um = (position[i] * 1e6).round() as i64;
        if let Err(place) = lines.binary_search(&um) {
            lines.insert(place, um);
            if lines.len() > 2 * GRID_LINES {
                return None;
            }
        }
    }
    lines.dedup_by(|b, a| *b - *a <= SAME_UM);
    let steps: Vec<i64> = lines.windows(2).map(|w| w[1] - w[0]).collect();
    let Some(step) = steps.iter().copied().min() else {
        return Some(1.0);
    };
    let even = lines.iter().all(|line| {
        let rest = (line - lines[0]) % step;
        rest.min(step - rest) <= SAME_UM
    });
    (even && lines.len() <= GRID_LINES && step > 1000).then_some(step as f64 * 1e-6)
}

/// The errors of one cell.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cell {
    /// Poses in the cell.
    pub n: u32,
    counts: [u32; CELL_AXES.len()],
    sums: [f64; CELL_AXES.len()],
    squares: [f64; CELL_AXES.len()],
    maxima: [f64; CELL_AXES.len()],
    edges: u64,
    votes: u64,
    voted: u32,
}

impl Cell {
    /// Mean error of the component numbered as in `CELL_AXES`.
    pub fn bias(&self, k: usize) -> f64 {
        self.sums[k] / f64::from(self.counts[k])
    }

    /// Root mean square error of that component.
    pub fn rms(&self, k: usize) -> f64 {
        (self.squares[k] / f64::from(self.counts[k])).sqrt()
    }

    /// Largest size of that component's error; NaN without any.
    pub fn max(&self, k: usize) -> f64 {
        if self.counts[k] > 0 {
            self.maxima[k]
        } else {
            f64::NAN
        }
    }

    /// Mean number of edges that a pose rests on.
    pub fn edges(&self) -> f64 {
        self.edges as f64 / f64::from(self.n)
    }

    /// Mean number of votes; NaN where no pose has any.
    pub fn votes(&self) -> f64 {
        self.votes as f64 / f64::from(self.voted)
    }

    fn merge(&mut self, other: &Cell) {
        self.n += other.n;
        self.edges += other.edges;
        self.votes += other.votes;
        self.voted += other.voted;
        for k in 0..CELL_AXES.len() {
            self.maxima[k] = self.maxima[k].max(other.maxima[k]);
            self.counts[k] += other.counts[k];
            self.sums[k] += other.sums[k];
            self.squares[k] += other.squares[k];
        }
    }
}

/// The errors of all cells.
#[derive(Clone, Debug, PartialEq)]
pub struct Cells {
    /// Where they are.
    pub layout: Layout,
    /// Row by row from the lowest z.
    pub cells: Vec<Cell>,
}

impl Cells {
    /// Empty cells.
    pub fn new(layout: Layout) -> Cells {
        Cells {
            layout,
            cells: vec![Cell::default(); layout.count[0] * layout.count[1]],
        }
    }

    /// Adds a pose's errors (x, y, z, roll, pitch, yaw) at a reference position (y, z), m, with the
    /// edges and votes that it rests on.
    pub fn add(&mut self, place_m: [f64; 2], error: &[f64; 6], edges: u32, votes: Option<u32>) {
        let Some(cell) = self
            .layout
            .index(place_m)
            .and_then(|i| self.cells.get_mut(i))
        else {
            return;
        };
        cell.n += 1;
        cell.edges += u64::from(edges);
        if let Some(votes) = votes {
            cell.votes += u64::from(votes);
            cell.voted += 1;
        }
        for (k, axis) in CELL_AXES.iter().enumerate() {
            let e = error[*axis];
            if e.is_finite() {
                cell.counts[k] += 1;
                cell.sums[k] += e;
                cell.squares[k] += e * e;
                cell.maxima[k] = cell.maxima[k].max(e.abs());
            }
        }
    }

    /// Cells with enough poses to say something, with their index.
    pub fn filled(&self) -> impl Iterator<Item = (usize, &Cell)> {
        let few = self.layout.few;
        self.cells
            .iter()
            .enumerate()
            .filter(move |(_, c)| c.n >= few)
    }

    /// The same errors on at most `most` cells: neighbours are put together, y and z alike.
    #[must_use]
    pub fn within(&self, most: usize) -> Cells {
        let [ny, nz] = self.layout.count;
        let fits = |k: &usize| ny.div_ceil(*k) * nz.div_ceil(*k) <= most.max(1);
        let k = (1..=ny.max(nz)).find(fits).unwrap_or(1);
        self.coarser(ny.div_ceil(k), nz.div_ceil(k))
    }

    /// The same errors on at most `columns` by `rows` cells.
    #[must_use]
    pub fn coarser(&self, columns: usize, rows: usize) -> Cells {
        let [ny, nz] = self.layout.count;
        let by = [ny.div_ceil(columns.max(1)), nz.div_ceil(rows.max(1))];
        let mut coarse = Cells::new(Layout {
            size_m: [0, 1].map(|i| self.layout.size_m[i] * by[i] as f64),
            count: [ny.div_ceil(by[0]), nz.div_ceil(by[1])],
            ..self.layout
        });
        for (i, cell) in self.cells.iter().enumerate() {
            let at = i / ny / by[1] * coarse.layout.count[0] + i % ny / by[0];
            if let Some(sum) = coarse.cells.get_mut(at) {
                sum.merge(cell);
            }
        }
        coarse
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(step: f64, ny: usize, nz: usize) -> Vec<[f64; 2]> {
        let at = |i: usize| [-4.0 + step * (i % ny) as f64, 0.5 + step * (i / ny) as f64];
        (0..ny * nz).map(at).collect()
    }

    #[test]
    fn a_grid_has_its_own_cells() {
        let positions = grid(0.5, 17, 7);
        let layout = Layout::for_positions(&positions, None).unwrap();
        assert_eq!((layout.count, layout.few), ([17, 7], 1));
        for (i, place) in positions.iter().enumerate() {
            assert_eq!(layout.index(*place), Some(i));
            let [y, z] = layout.centre_m(i);
            assert!((y - place[0]).abs() < 1e-9 && (z - place[1]).abs() < 1e-9);
        }
        // A finer grid takes whole multiples of its step.
        let fine = Layout::for_positions(&grid(0.02, 401, 151), None).unwrap();
        assert!(fine.is_small() && fine.few == 1);
        let steps = fine.size_m[0] / 0.02;
        assert!((steps - steps.round()).abs() < 1e-6);
    }

    #[test]
    fn a_moving_run_has_round_cells() {
        let positions: Vec<[f64; 2]> = (0..20_000)
            .map(|i| {
                let t = f64::from(i) * 0.001;
                [4.0 * (1.3 * t).sin(), 2.0 + 1.5 * (1.7 * t).cos()]
            })
            .collect();
        let layout = Layout::for_positions(&positions, None).unwrap();
        assert_eq!((layout.size_m, layout.few), ([0.5; 2], 3));
        assert!(positions.iter().all(|p| layout.index(*p).is_some()));
        assert_eq!(
            Layout::for_positions(&positions, Some(1.0)).unwrap().count,
            [8, 4]
        );
        assert_eq!(Layout::for_positions(&[], None), None);
        // Cells that no memory has room for become larger ones; a size beyond all numbers is none.
        for asked in [1e-9, 1e-3, f64::MIN_POSITIVE] {
            let fine = Layout::for_positions(&positions, Some(asked)).unwrap();
            assert!(fine.cells() <= MAX_ASKED && fine.cells() > MAX_ASKED / 8);
            assert!(positions.iter().all(|p| fine.index(*p).is_some()));
        }
        assert_eq!(
            Layout::for_positions(&[[1.0, 2.0]], None).unwrap().count,
            [1, 1]
        );
    }

    #[test]
    fn cells_keep_sums() {
        let mut cells = Cells::new(Layout::for_positions(&grid(1.0, 4, 3), None).unwrap());
        for place in grid(1.0, 4, 3) {
            cells.add(place, &[place[0], -1.0, f64::NAN, 0.0, 0.0, 2.0], 8, None);
            cells.add(
                place,
                &[-place[0], 3.0, f64::NAN, 0.0, 0.0, 2.0],
                5,
                Some(7),
            );
        }
        let (i, first) = cells.filled().next().unwrap();
        assert_eq!((i, first.n), (0, 2));
        assert_eq!((first.bias(0), first.rms(0)), (0.0, 4.0));
        assert_eq!((first.bias(1), first.rms(1)), (1.0, 5f64.sqrt()));
        assert!(first.bias(2).is_nan());
        assert_eq!(first.rms(3), 2.0);
        assert_eq!((first.max(0), first.max(1)), (4.0, 3.0));
        assert!(first.max(2).is_nan());
        assert_eq!((first.edges(), first.votes()), (6.5, 7.0));
        let coarse = cells.coarser(2, 2);
        assert_eq!((coarse.layout.count, coarse.cells[0].n), ([2, 2], 8));
        assert_eq!(coarse.cells.iter().map(|c| c.n).sum::<u32>(), 24);
        assert_eq!(coarse.cells[0].rms(0), ((16.0 + 9.0) / 2f64).sqrt());
    }
}
