//! An office floor of 80 m by 50 m for line extractors: walls, doors, furniture, round things.
//!
//! The comparison that Kurniawan 2017 builds on (table 4.1; Nguyen et al. 2005) was made in such a
//! place. A [`Plan`] is drawn from the seed; an [`Office`] looks at it from random free places and
//! gives each scan with its true lines. A true line is a run of beams on one flat face (pieces of
//! one wall are one face), interrupted by less than half a metre along it; beams on round things,
//! mixed pixels and wild ranges are on none.

mod plan;
mod view;

pub use plan::Plan;
pub use view::{Errors, View};

use super::random::{Draws, Purpose, Seed};
use crate::record::{NormalLine, Scan, Segment, Stamp};
use std::f64::consts::PI;
use view::{Place, Sight};

/// Gap along a face that ends a true line, m.
const GAP_M: f64 = 0.5;
/// Fewest beams on a true line. Those with fewer than an extractor looks for are in the truth too,
/// so that finding them is no error.
const MIN_POINTS: usize = 4;

/// What is looked at, how and how often.
#[derive(Clone, Debug)]
pub struct Setup {
    /// The scanner.
    pub view: View,
    /// Its errors.
    pub errors: Errors,
    /// The seed of plan, places and errors.
    pub seed: Seed,
    /// Stamp of the first scan.
    pub start: Stamp,
    /// Number of scans.
    pub scans: u64,
    /// Scans from each place.
    pub scans_per_place: u64,
}

/// Scans of an office and the true lines in them.
pub struct Office {
    setup: Setup,
    plan: Plan,
    number: u64,
    scan: Scan,
    truth: Vec<Segment>,
}

impl Office {
    /// Draws the plan.
    pub fn new(setup: Setup) -> Office {
        Office {
            plan: Plan::new(setup.seed.draws(Purpose::OfficePlan, 0)),
            setup,
            number: 0,
            scan: Scan::default(),
            truth: Vec::new(),
        }
    }

    /// The floor.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// The next scan and its true lines in beam order; none after the last.
    pub fn advance(&mut self) -> Option<(&Scan, &[Segment])> {
        if self.number >= self.setup.scans {
            return None;
        }
        let seed = self.setup.seed;
        let place_number = self.number / self.setup.scans_per_place.max(1);
        let place = self.place(seed.draws(Purpose::OfficePlace, place_number));
        let sights = view::look(&self.plan, self.setup.view, place);
        let mut draws = seed.draws(Purpose::OfficeRanges, self.number);
        self.begin_scan();
        let on_face = self.measure(&sights, &mut draws);
        self.find_truth(place, &sights, &on_face);
        self.number += 1;
        Some((&self.scan, &self.truth))
    }

    fn begin_scan(&mut self) {
        let view = self.setup.view;
        self.scan.stamp = self
            .setup
            .start
            .plus_s(self.number as f64 * view.period_s());
        self.scan.seq = self.number as u32;
        self.scan.angle_min_rad = view.angle_min_rad();
        self.scan.angle_increment_rad = view.increment_rad();
        self.scan.time_increment_s = view.increment_rad() / (2.0 * PI) * view.period_s();
        self.scan.scan_time_s = view.period_s();
        self.scan.range_min_m = 0.0;
        self.scan.range_max_m = view.range_max_m();
    }

    /// A place in a room or, nearly as often, in a corridor, an arm's length from everything.
    fn place(&self, mut draws: Draws) -> Place {
        loop {
            let areas = if draws.unit() < 0.45 {
                &self.plan.corridors
            } else {
                &self.plan.rooms
            };
            let Some(area) = areas.get((draws.unit() * areas.len() as f64) as usize) else {
                continue;
            };
            let position_m = [
                draws.between([area.low_m[0], area.high_m[0]]),
                draws.between([area.low_m[1], area.high_m[1]]),
            ];
            let heading_rad = draws.between([-PI, PI]);
            if self.plan.is_free(position_m, 0.35) {
                return Place {
                    position_m,
                    heading_rad,
                };
            }
        }
    }

    /// Fills in the ranges; tells which beams measured the face that they look at.
    fn measure(&mut self, sights: &[Sight], draws: &mut Draws) -> Vec<bool> {
        let errors = &self.setup.errors;
        let max_m = self.setup.view.range_max_m();
        let mut on_face = vec![false; sights.len()];
        self.scan.ranges_m.clear();
        for (i, sight) in sights.iter().enumerate() {
            // Every beam draws the same numbers, whatever becomes of it.
            let noise_m = errors.sigma_m * draws.normal();
            let [mixed, share, wild, wild_share, lost] = [(); 5].map(|()| draws.unit());
            let mut range_m = sight.range_m + noise_m;
            let mut on = sight.face.is_some();
            if let Some(before) = i.checked_sub(1).map(|k| sights[k].range_m)
                && (sight.range_m - before).abs() > errors.mixed_step_m
                && before <= max_m
                && mixed < errors.mixed_share
            {
                range_m = before + (sight.range_m - before) * share;
                on = false;
            }
            if wild < errors.outlier_share {
                range_m = sight.range_m * (0.3 + 0.7 * wild_share);
                on = false;
            }
            range_m = (range_m / errors.resolution_m).round() * errors.resolution_m;
            if sight.range_m > max_m || lost < errors.dropout_share || range_m <= 0.0 {
                range_m = f64::INFINITY;
                on = false;
            }
            self.scan.ranges_m.push(range_m);
            on_face[i] = on;
        }
        on_face
    }

    /// The true lines: runs of beams on one face, from the exact points.
    fn find_truth(&mut self, place: Place, sights: &[Sight], on_face: &[bool]) {
        self.truth.clear();
        let mut beams: Vec<(usize, f64, usize)> = Vec::new();
        for (i, sight) in sights.iter().enumerate() {
            if let Some(face) = sight.face.filter(|_| on_face[i]) {
                let normal = self.plan.face(face).seen_from(place);
                let along_m = normal.along_m(self.setup.view.angle_rad(i), sight.range_m);
                beams.push((face, along_m, i));
            }
        }
        // Along a face, positions grow with the beam angle, also across the seam.
        beams.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let is_one =
            |a: &(usize, f64, usize), b: &(usize, f64, usize)| a.0 == b.0 && b.1 - a.1 <= GAP_M;
        let mut runs: Vec<(usize, Segment)> = Vec::new();
        for run in beams.chunk_by(is_one).filter(|run| run.len() >= MIN_POINTS) {
            let normal = self.plan.face(run[0].0).seen_from(place);
            let ends = [run[0].1, run[run.len() - 1].1];
            let segment = Segment {
                stamp: self.scan.stamp,
                seq: self.scan.seq,
                normal: NormalLine::new(normal.d_m, normal.alpha_rad),
                ends_m: ends.map(|along_m| normal.at(along_m)),
                points: run.len() as u32,
                rms_m: self.setup.errors.sigma_m,
                ..Segment::default()
            };
            runs.push((run[0].2, segment));
        }
        runs.sort_by_key(|(first, _)| *first);
        self.truth.extend(
            runs.into_iter()
                .enumerate()
                .map(|(line, (_, segment))| Segment {
                    line: line as u32,
                    ..segment
                }),
        );
    }
}

#[cfg(test)]
mod tests;
