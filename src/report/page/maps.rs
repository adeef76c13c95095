//! Maps of the workspace: small multiples, three in a row, on common scales where they are alike.

use super::super::axis::AXES;
use super::super::case::Case;
use super::super::figure::{self, Heat, MapStyle, THIRD};
use super::super::number::fixed;
use super::super::picture::Figure;
use super::super::workspace::{CELL_AXES, Cell, Cells};
use super::Detail;

/// What one map shows.
struct Map {
    name: &'static str,
    title: &'static str,
    unit: &'static str,
    signed: bool,
    decimals: usize,
    /// Maps of the same family share one scale.
    family: usize,
    value: fn(&Cell) -> f64,
}

/// A cell's value of the component with index `k` in [`CELL_AXES`], in the unit shown.
fn shown(value: f64, k: usize) -> f64 {
    let axis = CELL_AXES.get(k).and_then(|i| AXES.get(*i));
    value * axis.map_or(f64::NAN, |axis| axis.factor)
}

/// Rms of the distance, m.
fn distance(cell: &Cell) -> f64 {
    let squares = [0, 1, 2].map(|k| cell.rms(k).powi(2));
    squares.iter().sum::<f64>().sqrt()
}

/// The maps in the order of the page, row by row; where there are several runs, the first row.
fn maps() -> Vec<Map> {
    let map = |name, title, unit, family, value| Map {
        name,
        title,
        unit,
        signed: false,
        decimals: 2,
        family,
        value,
    };
    let signed = |name, title, family, value| Map {
        signed: true,
        ..map(name, title, "mm", family, value)
    };
    vec![
        map("position-rms", "Position error, rms", "mm", 0, |c| {
            shown(distance(c), 0)
        }),
        signed("x-bias", "Bias in x", 1, |c| shown(c.bias(0), 0)),
        Map {
            decimals: 3,
            ..map("yaw-rms", "Yaw error, rms", "°", 2, |c| shown(c.rms(3), 3))
        },
        signed("y-bias", "Bias in y", 8, |c| shown(c.bias(1), 1)),
        signed("z-bias", "Bias in z", 8, |c| shown(c.bias(2), 2)),
        Map {
            unit: "°",
            decimals: 3,
            ..signed("yaw-bias", "Bias in yaw", 9, |c| shown(c.bias(3), 3))
        },
        map("x-max", "x error, max", "mm", 5, |c| shown(c.max(0), 0)),
        map("y-rms", "y error, rms", "mm", 3, |c| shown(c.rms(1), 1)),
        map("z-rms", "z error, rms", "mm", 3, |c| shown(c.rms(2), 2)),
        Map {
            decimals: 0,
            ..map("votes", "Votes", "mean", 6, Cell::votes)
        },
        Map {
            decimals: 2,
            ..map("edges", "Edges", "mean", 7, Cell::edges)
        },
        Map {
            decimals: 0,
            ..map("count", "Poses", "count", 4, |c| f64::from(c.n))
        },
    ]
}

/// Cells of the maps of one page, whatever the number of maps: of one run's, and of several.
const PAGE_CELLS: [usize; 2] = [1800, 800];

/// The maps of all runs.
pub(super) struct Maps {
    maps: Vec<Map>,
    /// Name and cells of each run that is drawn.
    cells: Vec<(String, Option<Cells>)>,
    style: MapStyle,
}

impl Maps {
    pub fn of(cases: &[&Case], style: MapStyle, detail: Detail) -> Maps {
        let mut maps = maps();
        if detail.several {
            maps.truncate(3);
        }
        let page = PAGE_CELLS[usize::from(detail.several)] / detail.coarse;
        let room = page / (maps.len() * cases.len().max(1));
        let cells = |c: &&Case| (c.name(), c.cells.as_ref().map(|cells| cells.within(room)));
        Maps {
            maps,
            cells: cases.iter().map(cells).collect(),
            style,
        }
    }

    /// Whether there is any place to tell from another.
    pub fn any(&self) -> bool {
        self.each().any(|cells| cells.filled().count() > 1)
    }

    fn each(&self) -> impl Iterator<Item = &Cells> {
        self.cells.iter().filter_map(|(_, cells)| cells.as_ref())
    }

    /// What the axes are, and which cells are empty.
    pub fn says(&self) -> String {
        let few = self.each().map(|c| c.layout.few).max().unwrap_or(1);
        let size = self.each().next().map_or([0.0; 2], |c| c.layout.size_m);
        let (wide, high) = (fixed(size[0], 2), fixed(size[1], 2));
        let empty = if few > 1 {
            format!(", empty with fewer than {few} poses")
        } else {
            String::new()
        };
        format!("y to the right, z up, m; cells of {wide} by {high} m{empty}.")
    }

    /// Every cell's value, NaN for those that say nothing.
    fn values(&self, cells: &Cells, map: &Map) -> Vec<f64> {
        let few = cells.layout.few;
        let value = |c: &Cell| if c.n >= few { (map.value)(c) } else { f64::NAN };
        cells.cells.iter().map(value).collect()
    }

    /// The range of a family in one run, and the largest size.
    fn own(&self, cells: &Cells, map: &Map) -> ([f64; 2], f64) {
        let alike = self.maps.iter().filter(|m| m.family == map.family);
        let values: Vec<f64> = alike.flat_map(|m| self.values(cells, m)).collect();
        figure::heat_range(&values, map.signed)
    }

    /// Runs share a scale where they are alike; a run that fails by metres would blind the others.
    fn range(&self, cells: &Cells, map: &Map) -> ([f64; 2], f64) {
        let ranges: Vec<[f64; 2]> = self.each().map(|c| self.own(c, map).0).collect();
        let fold = |pick: fn(f64, f64) -> f64, start: f64, i: usize| {
            ranges.iter().map(|r| r[i]).fold(start, pick)
        };
        let least = fold(f64::min, f64::INFINITY, 1);
        let common = [
            fold(f64::min, f64::INFINITY, 0),
            fold(f64::max, f64::NEG_INFINITY, 1),
        ];
        let (own, largest) = self.own(cells, map);
        (
            if common[1] <= 4.0 * least {
                common
            } else {
                own
            },
            largest,
        )
    }

    /// The maps of the run with this index.
    pub fn figures(&self, run: usize) -> Vec<Figure> {
        let Some((name, Some(cells))) = self.cells.get(run) else {
            return Vec::new();
        };
        if cells.filled().count() < 2 {
            return Vec::new();
        }
        let figure = |map: &Map| {
            let (range, largest) = self.range(cells, map);
            let values = self.values(cells, map);
            // Nothing to tell: no votes, or none but zero edges.
            if !values.iter().any(|v| v.is_finite() && *v != 0.0) {
                return None;
            }
            let heat = Heat {
                layout: cells.layout,
                values: &values,
                range,
                signed: map.signed,
                decimals: map.decimals,
                style: self.style,
            };
            let unit = if largest > range[1] * (1.0 + 1e-9) {
                let largest = fixed(largest, map.decimals);
                format!("{}, up to {largest} beyond the scale", map.unit)
            } else {
                map.unit.to_owned()
            };
            let label = format!("{} over the workspace, {name}", map.title);
            Some(Figure::new(
                &format!("map-{}", map.name),
                map.title,
                unit,
                figure::heat_map(&heat, THIRD, &label),
            ))
        };
        self.maps.iter().filter_map(figure).collect()
    }
}
