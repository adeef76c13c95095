//! The three reflector lines and the surfaces behind them, as the beams of a scan meet them.
//!
//! With growing angle the beams of a scan meet the right wall, the ceiling, and the left wall, and
//! so it is with the surfaces behind. Where one follows the other is found by bisection; between
//! two such borders every beam meets the same two lines, which takes two divisions a beam.

use super::components;
use crate::record::{BeamTable, FittedLine, ReflectorLines, ScanMotion};
use std::f64::consts::FRAC_PI_2;
use std::ops::Range;

/// A beam goes into a corner behind if another surface is as near to this share.
const CORNER: f64 = 0.99;

/// A line as the beams of a moving scanner meet it.
#[derive(Clone, Copy, Debug)]
struct Plane {
    /// Its normal.
    y: f64,
    z: f64,
    /// How far away it is at the reference instant, m, ...
    d_m: f64,
    /// ... and how fast the scanner comes nearer, m/s.
    nearer_m_s: f64,
}

impl Plane {
    fn new(line: &FittedLine, motion: ScanMotion) -> Plane {
        let (y, z, d_m) = if line.is_seen() {
            components(&line.normal)
        } else {
            // No beam comes nearer to a line without a normal: it is met nowhere.
            (0.0, 0.0, 1.0)
        };
        Plane {
            y,
            z,
            d_m,
            nearer_m_s: motion.vy_m_s * y + motion.vz_m_s * z,
        }
    }

    fn moved_back(self, by_m: f64) -> Plane {
        Plane {
            d_m: self.d_m + by_m,
            ..self
        }
    }

    /// Cosine of incidence of a ray.
    fn cosine(&self, (cos, sin): (f64, f64)) -> f64 {
        cos * self.y + sin * self.z
    }

    /// How far from the line the scanner is `tau_s` after the reference instant, m.
    fn distance_m(&self, tau_s: f64) -> f64 {
        self.d_m - self.nearer_m_s * tau_s
    }

    /// How far a ray has to go to the line, m; negative where it goes away from it.
    fn range_m(&self, ray: (f64, f64), tau_s: f64) -> f64 {
        self.distance_m(tau_s) / self.cosine(ray)
    }

    /// Whether a ray meets this line before the other.
    fn is_before(&self, other: &Plane, ray: (f64, f64), tau_s: f64) -> bool {
        self.cosine(ray) * other.distance_m(tau_s) > other.cosine(ray) * self.distance_m(tau_s)
    }
}

/// The lines and the surfaces behind them, numbered right, upper, left.
#[derive(Clone, Copy, Debug)]
pub(super) struct Planes {
    faces: [Plane; 3],
    behind: [Plane; 3],
}

impl Planes {
    /// For lines and the motion that was taken out of them; `gap_m` is how far behind them the
    /// next surface is.
    pub(super) fn new(lines: &ReflectorLines, motion: ScanMotion, gap_m: f64) -> Planes {
        let faces = lines.lines().map(|line| Plane::new(line, motion));
        Planes {
            faces,
            behind: faces.map(|plane| plane.moved_back(gap_m)),
        }
    }

    /// The runs of beams that meet `face` first, one for each of the surfaces behind it, with how
    /// far each beam has to go to the face and to the surface behind, m.
    pub(super) fn runs<'a>(
        &'a self,
        face: usize,
        table: &'a BeamTable,
    ) -> impl Iterator<Item = (Range<usize>, impl Iterator<Item = (f64, f64)> + 'a)> + 'a {
        let own = beams_of(&self.faces, table)[face].clone();
        let behind = beams_of(&self.behind, table);
        let plane = &self.faces[face];
        let (zero_s, step_s) = (table.time_s(0), table.time_s(1) - table.time_s(0));
        behind
            .into_iter()
            .zip(&self.behind)
            .filter_map(move |(run, plane_behind)| {
                let run = run.start.max(own.start)..run.end.min(own.end);
                let rays = table
                    .cos_sin
                    .get(run.clone())
                    .filter(|rays| !rays.is_empty())?;
                let meetings = (run.start as i32..).zip(rays).map(move |(i, ray)| {
                    let tau_s = zero_s + f64::from(i) * step_s;
                    let behind_m = plane_behind.range_m(*ray, tau_s);
                    (plane.range_m(*ray, tau_s), behind_m)
                });
                Some((run, meetings))
            })
    }

    /// Cosine of incidence of beam `i` on the face, and on the surface behind; NaN near a corner
    /// behind, where it may be either of two.
    pub(super) fn cos_incidence(&self, face: u8, table: &BeamTable, i: usize) -> [f64; 2] {
        let (ray, tau_s) = (table.cos_sin[i], table.time_s(i));
        let face = usize::from(face);
        let on_face = self.faces[face].cosine(ray);
        // Nearly always the surface right behind the face comes first by far, which shows without a
        // division, and it is parallel to the face.
        let (behind, behind_m) = (&self.behind[face], self.behind[face].distance_m(tau_s));
        let reached = CORNER * behind.cosine(ray);
        let is_later = |k: usize| {
            let (other, other_m) = (&self.behind[k], self.behind[k].distance_m(tau_s));
            other_m > 0.0 && other.cosine(ray) * behind_m < reached * other_m
        };
        if reached > 0.0 && behind_m > 0.0 && is_later((face + 1) % 3) && is_later((face + 2) % 3) {
            return [on_face, on_face];
        }
        // How soon each is met.
        let soon = self
            .behind
            .map(|p| (p.cosine(ray) / p.distance_m(tau_s), p.cosine(ray)));
        let (mut soonest, mut next) = ((0.0, f64::NAN), 0.0);
        for one in soon {
            if one.0 > soonest.0 {
                (next, soonest) = (soonest.0, one);
            } else if one.0 > next {
                next = one.0;
            }
        }
        let in_corner = next > CORNER * soonest.0;
        [on_face, if in_corner { f64::NAN } else { soonest.1 }]
    }
}

/// The beams that meet each of three planes first.
fn beams_of(planes: &[Plane; 3], table: &BeamTable) -> [Range<usize>; 3] {
    let [right, upper, left] = planes;
    let start = table.index_range(-FRAC_PI_2, FRAC_PI_2);
    let end = table
        .index_range(FRAC_PI_2, 3.0 * FRAC_PI_2)
        .end
        .max(start.end);
    let before = |a: &Plane, b: &Plane, i| a.is_before(b, table.cos_sin[i], table.time_s(i));
    let first = bisect(start.clone(), |i| before(upper, right, i));
    let second = bisect(start.end..end, |i| before(left, upper, i));
    [start.start..first, first..second, second..end]
}

/// The first of a run for which something holds that holds for all behind it, or the run's end.
fn bisect(run: Range<usize>, holds: impl Fn(usize) -> bool) -> usize {
    let Range { mut start, mut end } = run;
    while start < end {
        let middle = start + (end - start) / 2;
        if holds(middle) {
            end = middle;
        } else {
            start = middle + 1;
        }
    }
    start
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::{NormalLine, Scan};

    fn lines(seen: [bool; 3], roll_rad: f64) -> ReflectorLines {
        let line = |d_m: f64, k: usize| FittedLine {
            normal: NormalLine::new(d_m, k as f64 * FRAC_PI_2 - roll_rad),
            points: u32::from(seen[k]) * 100,
            ..FittedLine::default()
        };
        ReflectorLines {
            right: line(3.1, 0),
            upper: line(2.7, 1),
            left: line(7.3, 2),
            ..ReflectorLines::default()
        }
    }

    fn table(motion: ScanMotion) -> BeamTable {
        let mut table = BeamTable::default();
        let scan = Scan {
            angle_min_rad: -45f64.to_radians(),
            angle_increment_rad: 0.25f64.to_radians(),
            time_increment_s: 1.0 / 35.0 / 1440.0,
            ranges_m: vec![1.0; 1081].into(),
            ..Scan::default()
        };
        table.fit_moving(&scan, motion);
        table
    }

    /// By looking at every line from every beam: the first that it meets, and how far it has to go.
    fn first_met(planes: &[Plane; 3], table: &BeamTable, i: usize) -> Option<(usize, f64)> {
        let reach_m = |k: usize| planes[k].range_m(table.cos_sin[i], table.time_s(i));
        let ahead = (0..3)
            .map(|k| (k, reach_m(k)))
            .filter(|(_, m)| *m > 0.0 && *m < 1e9);
        ahead.min_by(|a, b| a.1.total_cmp(&b.1))
    }

    #[test]
    fn runs_are_what_every_beam_meets_first() {
        let motion = ScanMotion {
            vy_m_s: 2.0,
            vz_m_s: -1.5,
            roll_rad_s: 0.4,
        };
        let mut compared = 0;
        for (seen, motion) in [
            ([true; 3], ScanMotion::REST),
            ([true; 3], motion),
            ([false, true, true], motion),
            ([true, true, false], motion),
        ] {
            for roll_deg in [-8.0f64, 0.0, 5.0] {
                let table = table(motion);
                let lines = lines(seen, roll_deg.to_radians());
                let planes = Planes::new(&lines, motion, 0.7);
                let mut face_of = vec![None; table.cos_sin.len()];
                for face in (0..3).filter(|face| seen[*face]) {
                    for (run, meetings) in planes.runs(face, &table) {
                        for (i, (face_m, behind_m)) in run.zip(meetings) {
                            let (_, wanted_m) = first_met(&planes.behind, &table, i).unwrap();
                            assert!((behind_m - wanted_m).abs() < 1e-9, "beam {i}");
                            face_of[i] = (face_m > 0.0).then_some((face, face_m));
                        }
                    }
                }
                for (i, found) in face_of.into_iter().enumerate() {
                    let wanted = first_met(&planes.faces, &table, i);
                    assert_eq!(found.map(|f| f.0), wanted.map(|w| w.0), "beam {i}");
                    if let (Some(found), Some(wanted)) = (found, wanted) {
                        assert!((found.1 - wanted.1).abs() < 1e-9);
                        compared += 1;
                    }
                }
            }
        }
        assert!(compared > 8000, "{compared}");
    }

    #[test]
    fn a_corner_behind_leaves_the_incidence_open() {
        let table = table(ScanMotion::REST);
        let planes = Planes::new(&lines([true; 3], 0.0), ScanMotion::REST, 0.7);
        let beam = |deg: f64| ((deg + 45.0) / 0.25) as usize;
        let [face, behind] = planes.cos_incidence(1, &table, beam(90.0));
        assert!((face - 1.0).abs() < 1e-12 && (behind - 1.0).abs() < 1e-12);
        let corner_deg = (2.7f64 + 0.7).atan2(3.1 + 0.7).to_degrees();
        assert!(planes.cos_incidence(0, &table, beam(corner_deg))[1].is_nan());
        let [_, behind] = planes.cos_incidence(0, &table, beam(corner_deg - 5.0));
        assert!((behind - (corner_deg - 5.0).to_radians().cos()).abs() < 0.01);
    }
}
