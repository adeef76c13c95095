//! The hierarchical Hough transform of Li, Lavin and Le Master (1986).
//!
//! With lines written as z = m y + c (or y = m z + c for the steep ones, so that |m| <= 1), a point
//! is a straight line in the space of (m, c), and it votes for every hypercube that this line meets.
//! A hypercube's votes bound those of its parts. So the space is halved where there are votes, the
//! part with the most votes first, until a part is as small as a cell: that cell has the most votes
//! of all. Parts with too few votes are never looked into.

use crate::lines::extractor::ExtractorOptions;
use crate::lines::fit::{BeamSlice, InverseLine};
use crate::lines::taking::{Scene, Taker, Taking};
use crate::record::Scan;
use std::collections::BinaryHeap;
use std::ops::Range;

/// Settings of the transform.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FastHoughOptions {
    /// What all extractors have.
    pub common: ExtractorOptions,
    /// Width of the smallest hypercube in m, the tangent of the direction.
    pub slope: f64,
    /// Its height in c, m; never less than three times the noise.
    pub offset_m: f64,
}

impl Default for FastHoughOptions {
    fn default() -> Self {
        FastHoughOptions {
            common: ExtractorOptions::default(),
            slope: 1.0 / 64.0,
            offset_m: 0.03,
        }
    }
}

/// A part of the space, and where its voters are listed.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Hypercube {
    // In this order they decide which is looked into first.
    votes: u32,
    level: u32,
    /// Whether y and z have changed places.
    steep: bool,
    /// Place in (m, c) in units of its own size.
    place: [i32; 2],
    from: u32,
}

/// The extractor.
pub type FastHough = Taking<Hypercubes>;

/// Halves the space where free beams vote.
#[derive(Clone, Debug, Default)]
pub struct Hypercubes {
    options: FastHoughOptions,
    heap: BinaryHeap<Hypercube>,
    /// Voters of all hypercubes, one after the other.
    voters: Vec<u32>,
    /// Points that voted in vain and do so no more.
    spent: Vec<bool>,
    /// Hypercubes that were looked into in the scan extracted last: the measure of work.
    looked_into: u64,
}

/// The space of one group of beams.
#[derive(Clone, Copy, Debug)]
struct Space {
    /// The points are seen from here, so that a slope moves them little.
    centre_m: [f64; 2],
    /// Half of the height in c, m.
    reach_m: f64,
    /// Halvings down to a cell, in m and c.
    levels: [u32; 2],
}

impl Space {
    /// Middle and half size of a hypercube in m and c.
    fn extent(&self, cube: &Hypercube) -> [[f64; 2]; 2] {
        let reach = [1.0, self.reach_m];
        [0, 1].map(|i| {
            let level = cube.level.min(self.levels[i]);
            let half = reach[i] / f64::from(1u32 << level);
            [
                (2.0 * f64::from(cube.place[i]) + 1.0) * half - reach[i],
                half,
            ]
        })
    }

    /// A point as (abscissa, ordinate) of a line's equation.
    #[inline]
    fn point(&self, beams: BeamSlice<'_>, steep: bool, voter: u32) -> [f64; 2] {
        let k = voter as usize;
        let y = beams.y_m[k] - self.centre_m[0];
        let z = beams.z_m[k] - self.centre_m[1];
        if steep { [z, y] } else { [y, z] }
    }
}

impl FastHough {
    /// Hypercubes that were looked into in the scan extracted last.
    pub fn looked_into(&self) -> u64 {
        self.taker.looked_into
    }
}

impl Taker for Hypercubes {
    type Options = FastHoughOptions;

    fn new(options: FastHoughOptions) -> Hypercubes {
        Hypercubes {
            options,
            ..Hypercubes::default()
        }
    }

    fn common(&self) -> &ExtractorOptions {
        &self.options.common
    }

    fn begin(&mut self, _: &Scan, scene: &mut Scene<'_>) {
        self.spent.clear();
        self.spent.resize(scene.beams().len(), false);
        self.looked_into = 0;
    }

    fn take(&mut self, group: Range<usize>, scene: &mut Scene<'_>) {
        let common = self.options.common;
        self.spent.fill(false);
        if scene.count(group.clone()) < common.min_points {
            return;
        }
        let beams = scene.beams();
        let space = self.space(beams.run(group.start, group.end));
        self.heap.clear();
        self.voters.clear();
        for steep in [false, true] {
            let from = self.voters.len() as u32;
            self.voters
                .extend(scene.free(group.clone()).map(|k| k as u32));
            self.heap.push(Hypercube {
                votes: self.voters.len() as u32 - from,
                level: 0,
                steep,
                place: [0, 0],
                from,
            });
        }
        while let Some(mut cube) = self.heap.pop() {
            if (cube.votes as usize) < common.min_points {
                break;
            }
            let left = self.recount(&cube, scene);
            if left < cube.votes {
                cube.votes = left;
                self.heap.push(cube);
            } else if cube.level < space.levels[0].max(space.levels[1]) {
                self.looked_into += 1;
                self.halve(&space, beams, &cube);
            } else {
                self.take_cell(&space, cube, scene);
            }
        }
    }
}

impl Hypercubes {
    fn space(&self, beams: BeamSlice<'_>) -> Space {
        let span = |values: &[f64]| {
            let low = values.iter().copied().fold(f64::INFINITY, f64::min);
            let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            [(low + high) / 2.0, (high - low) / 2.0]
        };
        let ([y, half_y], [z, half_z]) = (span(beams.y_m), span(beams.z_m));
        let reach_m = half_y + half_z + 1e-3;
        let offset_m = self
            .options
            .offset_m
            .max(3.0 * self.options.common.segmentation.sigma_m);
        // 2 * reach / 2^level <= size, for sizes that make sense.
        let levels =
            |reach: f64, size: f64| (2.0 * reach / size).log2().ceil().clamp(1.0, 20.0) as u32;
        Space {
            centre_m: [y, z],
            reach_m,
            levels: [levels(1.0, self.options.slope), levels(reach_m, offset_m)],
        }
    }

    /// Votes that are left of a hypercube's; its list is kept up to date.
    fn recount(&mut self, cube: &Hypercube, scene: &Scene<'_>) -> u32 {
        let from = cube.from as usize;
        let mut kept = from;
        for i in from..from + cube.votes as usize {
            let voter = self.voters[i];
            self.voters[kept] = voter;
            let votes = scene.is_free(voter as usize) && !self.spent[voter as usize];
            kept += usize::from(votes);
        }
        (kept - from) as u32
    }

    /// Halves a hypercube in every direction in which it is not small enough yet.
    fn halve(&mut self, space: &Space, beams: BeamSlice<'_>, cube: &Hypercube) {
        let parts = |i: usize| {
            let place = cube.place[i];
            if cube.level < space.levels[i] {
                2 * place..2 * place + 2
            } else {
                place..place + 1
            }
        };
        let voters = cube.from as usize..(cube.from + cube.votes) as usize;
        for m in parts(0) {
            for c in parts(1) {
                let mut part = Hypercube {
                    votes: 0,
                    level: cube.level + 1,
                    steep: cube.steep,
                    place: [m, c],
                    from: self.voters.len() as u32,
                };
                let [[slope, half_slope], [offset, half_offset]] = space.extent(&part);
                for i in voters.clone() {
                    let voter = self.voters[i];
                    let [x, v] = space.point(beams, cube.steep, voter);
                    if (v - slope * x - offset).abs() <= half_offset + half_slope * x.abs() {
                        self.voters.push(voter);
                    }
                }
                part.votes = self.voters.len() as u32 - part.from;
                if part.votes as usize >= self.options.common.min_points {
                    self.heap.push(part);
                } else {
                    self.voters.truncate(part.from as usize);
                }
            }
        }
    }

    /// Takes the line of a cell; where there is none, its points vote no more.
    fn take_cell(&mut self, space: &Space, cube: Hypercube, scene: &mut Scene<'_>) {
        let [[slope, half_slope], [offset, half_offset]] = space.extent(&cube);
        // v - slope x = offset, in the scanner's coordinates.
        let [y0, z0] = space.centre_m;
        let (normal, distance) = if cube.steep {
            ([1.0, -slope], offset + y0 - slope * z0)
        } else {
            ([-slope, 1.0], offset + z0 - slope * y0)
        };
        let distance = if distance.abs() < 1e-6 {
            1e-6
        } else {
            distance
        };
        let line = InverseLine {
            a: normal[0] / distance,
            b: normal[1] / distance,
        };
        if scene.take(line, half_offset + half_slope) {
            // What is left of the cell is looked at again.
            self.heap.push(cube);
        } else {
            for i in cube.from..cube.from + cube.votes {
                self.spent[self.voters[i as usize] as usize] = true;
            }
        }
    }
}
