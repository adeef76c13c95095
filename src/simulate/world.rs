//! The frame as things that beams meet: faces with reflectors on them, and the background behind.

use super::coverage;
use crate::frame::{Frame, Optics, Plate, Strip};
use crate::record::Face;
use nalgebra::Vector3;

/// The beam's spot where it meets a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Spot {
    /// No extent.
    Pencil,
    /// A disc of `optics.diameter_m(range) * scale` across the beam.
    Disc {
        /// Diameter by range.
        optics: Optics,
        /// True diameter over the data sheet's.
        scale: f64,
    },
}

impl Spot {
    /// Radius at a range, m.
    #[inline]
    pub fn radius_m(&self, range_m: f64) -> f64 {
        match self {
            Spot::Pencil => 0.0,
            Spot::Disc { optics, scale } => 0.5 * scale * optics.diameter_m(range_m),
        }
    }
}

/// A surface where a beam's axis meets it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Along the beam, m.
    pub range_m: f64,
    /// Cosine of the angle between beam and normal.
    pub cos_incidence: f64,
}

/// A reflector that a beam meets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// The face's plane on the beam's axis.
    pub surface: Surface,
    /// Share of the spot on the reflector, above 0.
    pub share: f64,
    /// The face.
    pub face: Face,
}

/// What one beam meets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sight {
    /// The reflector with the largest share of the spot; in most beams there is at most one.
    pub reflector: Option<Hit>,
    /// The surface behind the frame.
    pub background: Option<Surface>,
}

/// One straight edge of a reflector.
#[derive(Clone, Copy, Debug)]
struct Edge {
    point: Vector3<f64>,
    /// Unit vector along the edge.
    along: Vector3<f64>,
    /// Unit vector in the face, away from the edge into the reflector.
    inward: Vector3<f64>,
}

/// A flat convex reflector.
#[derive(Clone, Debug)]
struct Patch {
    corners: [Vector3<f64>; 4],
    edges: [Edge; 4],
    /// Smallest and largest x of the corners, and the same along the wall.
    x_m: [f64; 2],
    along_m: [f64; 2],
}

impl Patch {
    fn new(face: Face, corners: [Vector3<f64>; 4]) -> Patch {
        let span = |place: fn(&Vector3<f64>) -> f64| {
            let places = corners.iter().map(place);
            let low = places.clone().fold(f64::INFINITY, f64::min);
            [low, places.fold(f64::NEG_INFINITY, f64::max)]
        };
        let centre = corners.iter().sum::<Vector3<f64>>() / 4.0;
        let edge = |k: usize| {
            let (point, end) = (corners[k], corners[(k + 1) % 4]);
            let along = (end - point).normalize();
            let to_centre = centre - point;
            let inward = (to_centre - along * to_centre.dot(&along)).normalize();
            Edge {
                point,
                along,
                inward,
            }
        };
        Patch {
            corners,
            edges: [edge(0), edge(1), edge(2), edge(3)],
            x_m: span(|corner| corner.x),
            along_m: match face {
                Face::Upper => span(|corner| corner.y),
                Face::Right | Face::Left => span(|corner| corner.z),
            },
        }
    }

    /// Whether a point of the patch's wall, given by x and the place along the wall, is within
    /// `reach_m` of the rectangle about the patch. Most patches are far from any one beam, and this
    /// says so at little cost.
    #[inline]
    fn is_near(&self, x_m: f64, along_m: f64, reach_m: f64) -> bool {
        let within = |at: f64, [low, high]: [f64; 2]| at >= low - reach_m && at <= high + reach_m;
        within(along_m, self.along_m) && within(x_m, self.x_m)
    }

    /// Share of a spot of `radius_m` on the patch; `point` is where the beam's axis meets the
    /// patch's plane, `slant` the cosine between beam and plane's normal.
    fn share(&self, point: Vector3<f64>, beam: Vector3<f64>, slant: f64, radius_m: f64) -> f64 {
        let mut inside = 1.0;
        let mut cut = 0;
        for edge in &self.edges {
            let depth_m = (point - edge.point).dot(&edge.inward);
            if radius_m <= 0.0 {
                if depth_m < 0.0 {
                    return 0.0;
                }
                continue;
            }
            // Nearest the axis can be to the edge when it is seen square on.
            if depth_m * slant >= radius_m {
                continue;
            }
            // Distance of the two straight lines beam axis and edge: across the beam, the edge lies
            // this far from the spot's centre.
            let across = beam.cross(&edge.along).norm();
            let q = depth_m * slant / (across * radius_m);
            let share = coverage::beyond_edge(q);
            if share <= 0.0 {
                return 0.0;
            }
            if share < 1.0 {
                cut += 1;
                inside *= share;
            }
        }
        if cut < 2 {
            return inside;
        }
        self.share_of_polygon(point, beam, radius_m)
    }

    /// The general case: the patch seen along the beam is a quadrilateral.
    fn share_of_polygon(&self, point: Vector3<f64>, beam: Vector3<f64>, radius_m: f64) -> f64 {
        let helper = if beam.x.abs() < 0.7 {
            Vector3::x()
        } else {
            Vector3::y()
        };
        let e1 = beam.cross(&helper).normalize();
        let e2 = beam.cross(&e1);
        let seen = self.corners.map(|corner| {
            let offset = (corner - point) / radius_m;
            [offset.dot(&e1), offset.dot(&e2)]
        });
        coverage::of_polygon(&seen)
    }
}

/// A face of the box with its reflectors.
#[derive(Clone, Debug)]
struct Wall {
    face: Face,
    /// From the middle of the box (for the ceiling from the floor), m.
    distance_m: f64,
    patches: Vec<Patch>,
}

impl Wall {
    /// Component of a vector along the wall's outward normal.
    #[inline]
    fn outward(&self, v: &Vector3<f64>) -> f64 {
        match self.face {
            Face::Upper => v.z,
            Face::Right => v.y,
            Face::Left => -v.y,
        }
    }
}

/// The frame and its surroundings.
#[derive(Clone, Debug)]
pub struct World {
    walls: Vec<Wall>,
    background: Option<Background>,
}

/// The box behind the frame's.
#[derive(Clone, Copy, Debug)]
struct Background {
    low: Vector3<f64>,
    high: Vector3<f64>,
}

impl Background {
    /// Where a ray from inside leaves the box.
    fn meet(&self, origin: &Vector3<f64>, beam: &Vector3<f64>) -> Option<Surface> {
        let mut nearest: Option<Surface> = None;
        let axes = [
            (beam.z, origin.z, self.low.z, self.high.z),
            (beam.y, origin.y, self.low.y, self.high.y),
            (beam.x, origin.x, self.low.x, self.high.x),
        ];
        for (slant, from, low, high) in axes {
            let room_m = if slant > 0.0 { high - from } else { from - low };
            let slant = slant.abs();
            // Whether it is the nearest is told without the division.
            if room_m > 0.0 && nearest.is_none_or(|n| room_m < n.range_m * slant) {
                let range_m = room_m / slant;
                if range_m.is_finite() {
                    nearest = Some(Surface {
                        range_m,
                        cos_incidence: slant,
                    });
                }
            }
        }
        nearest
    }
}

impl World {
    /// The frame as configured, without the strips whose indices are listed.
    pub fn new(frame: &Frame, missing_strips: &[usize]) -> World {
        let b = &frame.bounds;
        let (hx, hy) = (b.dx_m / 2.0, b.dy_m / 2.0);
        let mut walls = vec![
            wall(Face::Right, hy),
            wall(Face::Upper, b.dz_m),
            wall(Face::Left, hy),
        ];
        for wall in &mut walls {
            for plate in frame.plates.iter().filter(|p| p.face == wall.face) {
                wall.patches.push(plate_patch(plate, wall));
            }
            for (index, strip) in frame.strips_on(wall.face) {
                if !missing_strips.contains(&index) {
                    wall.patches.push(strip_patch(strip, wall, hx));
                }
            }
        }
        let background = b.background_gap_m.map(|gap_m| Background {
            low: Vector3::new(-hx - gap_m, -hy - gap_m, -gap_m),
            high: Vector3::new(hx + gap_m, hy + gap_m, b.dz_m + gap_m),
        });
        World { walls, background }
    }

    /// The reflector that a beam (unit vector) from `origin` meets.
    pub fn reflector(&self, origin: Vector3<f64>, beam: Vector3<f64>, spot: &Spot) -> Option<Hit> {
        let mut reflector: Option<Hit> = None;
        for wall in &self.walls {
            let slant = wall.outward(&beam);
            if slant <= 0.0 {
                continue;
            }
            let range_m = (wall.distance_m - wall.outward(&origin)) / slant;
            if range_m <= 0.0 || !range_m.is_finite() {
                continue;
            }
            let point = origin + beam * range_m;
            let along_m = match wall.face {
                Face::Upper => point.y,
                Face::Right | Face::Left => point.z,
            };
            let radius_m = spot.radius_m(range_m);
            // The spot on the wall is an ellipse that is longest along the beam; a little more
            // keeps rounding out of it.
            let reach_m = radius_m / slant * (1.0 + 1e-9) + 1e-9;
            for patch in &wall.patches {
                if !patch.is_near(point.x, along_m, reach_m) {
                    continue;
                }
                let share = patch.share(point, beam, slant, radius_m);
                if share > reflector.map_or(0.0, |hit| hit.share) {
                    let surface = Surface {
                        range_m,
                        cos_incidence: slant,
                    };
                    reflector = Some(Hit {
                        surface,
                        share,
                        face: wall.face,
                    });
                }
            }
        }
        reflector
    }

    /// The surface behind the frame that a beam (unit vector) from `origin` meets.
    pub fn background(&self, origin: Vector3<f64>, beam: Vector3<f64>) -> Option<Surface> {
        self.background
            .as_ref()
            .and_then(|background| background.meet(&origin, &beam))
    }
}

fn wall(face: Face, distance_m: f64) -> Wall {
    Wall {
        face,
        distance_m,
        patches: Vec::new(),
    }
}

/// The point of a wall at depth x, and y (ceiling) or z (side walls).
fn on_wall(wall: &Wall, x_m: f64, v_m: f64) -> Vector3<f64> {
    match wall.face {
        Face::Upper => Vector3::new(x_m, v_m, wall.distance_m),
        Face::Right => Vector3::new(x_m, wall.distance_m, v_m),
        Face::Left => Vector3::new(x_m, -wall.distance_m, v_m),
    }
}

fn plate_patch(plate: &Plate, wall: &Wall) -> Patch {
    let ([x0, x1], [z0, z1]) = (plate.x_m, plate.z_m);
    let corners = [(x0, z0), (x1, z0), (x1, z1), (x0, z1)].map(|(x, z)| on_wall(wall, x, z));
    Patch::new(wall.face, corners)
}

fn strip_patch(strip: &Strip, wall: &Wall, half_depth_m: f64) -> Patch {
    let [x0, x1] = strip.x_m.unwrap_or([-half_depth_m, half_depth_m]);
    let slope = libm::tan(strip.inclination_deg.to_radians());
    let half_m = strip.width_m / 2.0;
    let corner = |x: f64, side: f64| on_wall(wall, x, strip.offset_m + side * half_m + x * slope);
    let corners = [
        corner(x0, -1.0),
        corner(x1, -1.0),
        corner(x1, 1.0),
        corner(x0, 1.0),
    ];
    Patch::new(wall.face, corners)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::ScannerModel;
    use crate::simulate::rotation::attitude_matrix;
    use std::path::Path;

    fn frame() -> Frame {
        let text = include_str!("../../testdata/cablar.toml");
        Frame::parse(text, Path::new("cablar.toml")).unwrap()
    }

    fn inclined() -> Frame {
        let text = include_str!("../../testdata/inclined.toml");
        Frame::parse(text, Path::new("inclined.toml")).unwrap()
    }

    fn disc() -> Spot {
        Spot::Disc {
            optics: ScannerModel::by_name("lms511-hr").unwrap().optics,
            scale: 1.0,
        }
    }

    /// Whether a point in B lies on a reflector, straight from the frame file's definition.
    fn on_reflector(frame: &Frame, face: Face, x: f64, v: f64) -> bool {
        let hx = frame.bounds.dx_m / 2.0;
        frame.plates.iter().any(|p| {
            p.face == face
                && (p.x_m[0]..=p.x_m[1]).contains(&x)
                && (p.z_m[0]..=p.z_m[1]).contains(&v)
        }) || frame.strips.iter().any(|s| {
            let [x0, x1] = s.x_m.unwrap_or([-hx, hx]);
            let centre = s.offset_m + x * s.inclination_deg.to_radians().tan();
            s.face == face && (x0..=x1).contains(&x) && (v - centre).abs() <= s.width_m / 2.0
        })
    }

    /// Share of parallel sub-rays over the disc that meet a reflector of the face.
    fn counted(frame: &Frame, origin: Vector3<f64>, beam: Vector3<f64>, hit: &Hit) -> f64 {
        let (normal, distance) = match hit.face {
            Face::Upper => (Vector3::z(), frame.bounds.dz_m),
            Face::Right => (Vector3::y(), frame.bounds.dy_m / 2.0),
            Face::Left => (-Vector3::y(), frame.bounds.dy_m / 2.0),
        };
        let radius = disc().radius_m(hit.surface.range_m);
        let e1 = beam.cross(&Vector3::x()).normalize();
        let e2 = beam.cross(&e1);
        let n = 120;
        let (mut hits, mut all) = (0u32, 0u32);
        for i in 0..n {
            for k in 0..n {
                let a = (f64::from(i) + 0.5) / f64::from(n) * 2.0 - 1.0;
                let b = (f64::from(k) + 0.5) / f64::from(n) * 2.0 - 1.0;
                if a * a + b * b >= 1.0 {
                    continue;
                }
                let start = origin + (e1 * a + e2 * b) * radius;
                let t = (distance - normal.dot(&start)) / normal.dot(&beam);
                let p = start + beam * t;
                let v = if hit.face == Face::Upper { p.y } else { p.z };
                all += 1;
                hits += u32::from(on_reflector(frame, hit.face, p.x, v));
            }
        }
        f64::from(hits) / f64::from(all)
    }

    #[test]
    fn shares_agree_with_sub_rays() {
        let mut partial = 0;
        for (frame, origin, angles) in [
            (
                frame(),
                Vector3::new(0.03, 1.7, 1.2),
                Vector3::new(0.015, -0.01, 0.02),
            ),
            (
                frame(),
                Vector3::new(-0.04, -3.0, 3.7),
                Vector3::new(-0.01, 0.0, -0.025),
            ),
            (
                inclined(),
                Vector3::new(0.3, 2.0, 2.0),
                Vector3::new(0.0, 0.05, 0.01),
            ),
        ] {
            let world = World::new(&frame, &[]);
            let turn = attitude_matrix(angles);
            for k in 0..3800 {
                let angle = (-5.0 + 0.05 * f64::from(k)).to_radians();
                let beam = turn * Vector3::new(0.0, angle.cos(), angle.sin());
                let Some(hit) = world.reflector(origin, beam, &disc()) else {
                    continue;
                };
                if hit.share < 1.0 && hit.share > 0.0 {
                    let expected = counted(&frame, origin, beam, &hit);
                    assert!(
                        (hit.share - expected).abs() < 0.01,
                        "{k} {hit:?} {expected}"
                    );
                    partial += 1;
                }
            }
        }
        assert!(partial > 100, "{partial}");
    }

    #[test]
    fn corners_agree_with_sub_rays() {
        // Beams about the upper corner of the right plate, at x = 0.25, z = 5.2.
        let frame = frame();
        let world = World::new(&frame, &[]);
        let origin = Vector3::new(0.0, 2.0, 2.0);
        for (dx, dz) in [
            (0.0, 0.0),
            (0.005, -0.004),
            (-0.006, 0.003),
            (-0.002, -0.006),
        ] {
            let aim = Vector3::new(0.25 + dx, 5.225, 5.2 + dz);
            let beam = (aim - origin).normalize();
            let hit = world.reflector(origin, beam, &disc()).unwrap();
            let expected = counted(&frame, origin, beam, &hit);
            assert!((hit.share - expected).abs() < 0.02, "{hit:?} {expected}");
        }
    }

    #[test]
    fn a_level_beam_meets_plate_and_background() {
        let world = World::new(&frame(), &[]);
        let origin = Vector3::new(0.0, 1.0, 2.0);
        let hit = world
            .reflector(origin, Vector3::y(), &Spot::Pencil)
            .unwrap();
        assert_eq!((hit.face, hit.share), (Face::Right, 1.0));
        assert!((hit.surface.range_m - 4.225).abs() < 1e-12);
        let behind = world.background(origin, Vector3::y()).unwrap();
        assert!((behind.range_m - 4.925).abs() < 1e-12);
        // Straight up at y = 0 there is a gap between the strips; a strip taken away is one too.
        let middle = Vector3::new(0.0, 0.0, 2.0);
        let up = world.reflector(middle, Vector3::z(), &Spot::Pencil);
        assert!(up.is_none());
        let behind = world.background(middle, Vector3::z()).unwrap();
        assert!((behind.range_m - 4.2).abs() < 1e-12);
        let under_second = Vector3::new(0.0, 1.3, 2.0);
        assert!(
            world
                .reflector(under_second, Vector3::z(), &disc())
                .is_some()
        );
        let without = World::new(&frame(), &[1]);
        assert!(
            without
                .reflector(under_second, Vector3::z(), &disc())
                .is_none()
        );
    }

    #[test]
    fn nothing_behind_a_frame_without_background() {
        let mut frame = frame();
        frame.bounds.background_gap_m = None;
        let (world, origin) = (World::new(&frame, &[]), Vector3::new(0.0, 0.0, 2.0));
        let hit = world.reflector(origin, Vector3::z(), &Spot::Pencil);
        assert!(hit.is_none() && world.background(origin, Vector3::z()).is_none());
    }
}
