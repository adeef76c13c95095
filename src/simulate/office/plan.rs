//! The floor plan: a spine corridor, two cross corridors, and between them blocks that are halved
//! into rooms until these have the size of rooms. Walls are 12 cm thick and have doors, open ones
//! and closed ones whose leaf lies 3 cm deeper.

use super::super::random::Draws;
use super::view::{Normal, Place};
use std::f64::consts::{FRAC_PI_2, TAU};

/// Size of the floor, m.
pub const SIZE_M: [f64; 2] = [80.0, 50.0];
/// Thickness of inner walls, m.
const WALL_M: f64 = 0.12;
/// A closed door's leaf lies this much deeper than the wall, m.
const RECESS_M: f64 = 0.03;
/// Rooms longer than this are halved, m.
const ROOM_M: f64 = 8.5;
/// No room is narrower, m.
const NARROW_M: f64 = 3.0;

/// A rectangle along the axes, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Area {
    /// Corner with the smaller coordinates.
    pub low_m: [f64; 2],
    /// Corner with the larger ones.
    pub high_m: [f64; 2],
}

impl Area {
    fn new(x: [f64; 2], y: [f64; 2]) -> Area {
        Area {
            low_m: [x[0], y[0]],
            high_m: [x[1], y[1]],
        }
    }

    fn size_m(&self, axis: usize) -> f64 {
        self.high_m[axis] - self.low_m[axis]
    }

    fn span(&self, axis: usize) -> [f64; 2] {
        [self.low_m[axis], self.high_m[axis]]
    }

    /// Whether a point lies inside or nearer than `margin_m`.
    fn is_near(&self, [x, y]: [f64; 2], margin_m: f64) -> bool {
        (self.low_m[0] - margin_m..=self.high_m[0] + margin_m).contains(&x)
            && (self.low_m[1] - margin_m..=self.high_m[1] + margin_m).contains(&y)
    }

    fn less(&self, margin_m: f64) -> Area {
        Area {
            low_m: self.low_m.map(|v| v + margin_m),
            high_m: self.high_m.map(|v| v - margin_m),
        }
    }
}

/// A straight piece of a face.
#[derive(Clone, Copy, Debug)]
pub(super) struct Piece {
    /// One end, m.
    pub from_m: [f64; 2],
    /// From there to the other end, m.
    pub step_m: [f64; 2],
    /// Which face.
    pub face: usize,
}

/// A round thing.
#[derive(Clone, Copy, Debug)]
pub(super) struct Disc {
    /// Centre, m.
    pub centre_m: [f64; 2],
    /// Radius, m.
    pub radius_m: f64,
}

/// The infinite line that a face is on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FaceLine {
    point_m: [f64; 2],
    /// Unit vector along it.
    along: [f64; 2],
}

impl FaceLine {
    /// The line in the scanner's coordinates.
    pub fn seen_from(&self, place: Place) -> Normal {
        let [dx, dy] = [0, 1].map(|i| self.point_m[i] - place.position_m[i]);
        let [ux, uy] = self.along;
        let mut normal = [-uy, ux];
        let mut d_m = normal[0] * dx + normal[1] * dy;
        if d_m < 0.0 {
            normal = normal.map(|v| -v);
            d_m = -d_m;
        }
        Normal {
            d_m,
            alpha_rad: libm::atan2(normal[1], normal[0]) - place.heading_rad,
        }
    }
}

/// A flat face of something that stands along the axes, with which others may be in line.
#[derive(Clone, Copy, Debug, PartialEq)]
struct WallFace {
    /// The axis across it.
    axis: usize,
    at_m: f64,
    outward: bool,
    face: usize,
}

/// The floor.
#[derive(Clone, Debug, Default)]
pub struct Plan {
    pub(super) pieces: Vec<Piece>,
    pub(super) discs: Vec<Disc>,
    faces: Vec<FaceLine>,
    wall_faces: Vec<WallFace>,
    /// What is full.
    solids: Vec<Area>,
    /// The rooms' insides.
    pub rooms: Vec<Area>,
    /// The corridors' insides.
    pub corridors: Vec<Area>,
}

impl Plan {
    pub(super) fn new(mut draws: Draws) -> Plan {
        let mut plan = Plan::default();
        let [width, depth] = SIZE_M;
        for outer in [
            Area::new([-0.4, width + 0.4], [-0.4, 0.0]),
            Area::new([-0.4, width + 0.4], [depth, depth + 0.4]),
            Area::new([-0.4, 0.0], [-0.4, depth + 0.4]),
            Area::new([width, width + 0.4], [-0.4, depth + 0.4]),
        ] {
            plan.wall(outer);
        }
        let spine = draws.between([22.0, 25.0]);
        let spine = [spine, spine + 2.5];
        let cross =
            [draws.between([22.0, 30.0]), draws.between([50.0, 58.0])].map(|x| [x, x + 2.1]);
        plan.corridors
            .push(Area::new([0.0, width], spine).less(WALL_M / 2.0));
        for x in cross {
            plan.corridors
                .push(Area::new(x, [0.0, depth]).less(WALL_M / 2.0));
        }
        let columns = [
            [0.0, cross[0][0]],
            [cross[0][1], cross[1][0]],
            [cross[1][1], width],
        ];
        for x in columns {
            for y in [[0.0, spine[0]], [spine[1], depth]] {
                plan.block(Area::new(x, y), &mut draws);
            }
        }
        plan.furnish_corridors(&mut draws);
        for room in plan.rooms.clone() {
            plan.furnish(room, &mut draws);
        }
        plan
    }

    /// A face's line.
    pub(super) fn face(&self, face: usize) -> FaceLine {
        self.faces[face]
    }

    /// Whether a circle about a point holds nothing.
    pub fn is_free(&self, point_m: [f64; 2], margin_m: f64) -> bool {
        let inside = (0..2).all(|i| (margin_m..=SIZE_M[i] - margin_m).contains(&point_m[i]));
        let hits = |disc: &Disc| {
            let [dx, dy] = [0, 1].map(|i| disc.centre_m[i] - point_m[i]);
            let reach_m = disc.radius_m + margin_m;
            dx * dx + dy * dy <= reach_m * reach_m
        };
        inside
            && !self
                .solids
                .iter()
                .any(|solid| solid.is_near(point_m, margin_m))
            && !self.discs.iter().any(hits)
    }

    /// A block between corridors: its outer walls with doors, and its rooms.
    fn block(&mut self, area: Area, draws: &mut Draws) {
        for axis in [0, 1] {
            for at_m in area.span(1 - axis) {
                // The floor's own walls are there already.
                if at_m > 0.0 && at_m < SIZE_M[1 - axis] {
                    self.partition(axis, at_m, area.span(axis), 5.0, draws);
                }
            }
        }
        self.halve(area, draws);
    }

    fn halve(&mut self, area: Area, draws: &mut Draws) {
        let axis = usize::from(area.size_m(1) > area.size_m(0));
        let size_m = area.size_m(axis);
        let large = size_m > ROOM_M || (size_m > 2.0 * NARROW_M && draws.unit() < 0.4);
        if !large {
            self.rooms.push(area.less(WALL_M / 2.0));
            return;
        }
        let least = (NARROW_M / size_m).max(0.3);
        let share = draws.between([least, 1.0 - least]);
        let at_m = area.low_m[axis] + share * size_m;
        self.partition(1 - axis, at_m, area.span(1 - axis), 9.0, draws);
        let (mut first, mut second) = (area, area);
        first.high_m[axis] = at_m;
        second.low_m[axis] = at_m;
        self.halve(first, draws);
        self.halve(second, draws);
    }

    /// A wall along `axis` at a position across it, with a door every `door_m` or so.
    fn partition(
        &mut self,
        axis: usize,
        at_m: f64,
        span: [f64; 2],
        door_m: f64,
        draws: &mut Draws,
    ) {
        let doors = ((span[1] - span[0]) / door_m).round().max(1.0) as usize;
        let room_m = (span[1] - span[0]) / doors as f64;
        let half = WALL_M / 2.0;
        let mut from = span[0];
        for k in 0..doors {
            let width_m = [0.85, 0.95, 1.25][(draws.unit() * 3.0) as usize % 3];
            let free = [0.3, (room_m - width_m - 0.3).max(0.3)];
            let door = span[0] + k as f64 * room_m + draws.between(free);
            let is_closed = draws.unit() < 0.4;
            self.wall(along(axis, [from, door], [at_m - half, at_m + half]));
            if is_closed {
                let leaf = half - RECESS_M;
                self.wall(along(
                    axis,
                    [door, door + width_m],
                    [at_m - leaf, at_m + leaf],
                ));
            }
            from = door + width_m;
        }
        if from < span[1] {
            self.wall(along(axis, [from, span[1]], [at_m - half, at_m + half]));
        }
    }

    /// Something along the axes whose faces may be in line with others.
    fn wall(&mut self, area: Area) {
        self.solids.push(area);
        for axis in [0, 1] {
            for (at_m, outward) in [(area.low_m[axis], false), (area.high_m[axis], true)] {
                let ends = area.span(1 - axis);
                let [a, b] = ends.map(|v| if axis == 0 { [at_m, v] } else { [v, at_m] });
                let face = self.wall_face(axis, at_m, outward, a, b);
                self.piece(a, b, face);
            }
        }
    }

    fn wall_face(
        &mut self,
        axis: usize,
        at_m: f64,
        outward: bool,
        a: [f64; 2],
        b: [f64; 2],
    ) -> usize {
        let known = self.wall_faces.iter().find(|known| {
            known.axis == axis && known.outward == outward && (known.at_m - at_m).abs() < 1e-4
        });
        if let Some(known) = known {
            return known.face;
        }
        let face = self.new_face(a, b);
        self.wall_faces.push(WallFace {
            axis,
            at_m,
            outward,
            face,
        });
        face
    }

    fn new_face(&mut self, a: [f64; 2], b: [f64; 2]) -> usize {
        let [dx, dy] = [b[0] - a[0], b[1] - a[1]];
        let length_m = (dx * dx + dy * dy).sqrt();
        self.faces.push(FaceLine {
            point_m: a,
            along: [dx / length_m, dy / length_m],
        });
        self.faces.len() - 1
    }

    fn piece(&mut self, a: [f64; 2], b: [f64; 2], face: usize) {
        self.pieces.push(Piece {
            from_m: a,
            step_m: [b[0] - a[0], b[1] - a[1]],
            face,
        });
    }

    /// A box with faces of its own, turned.
    fn furniture(&mut self, centre_m: [f64; 2], size_m: [f64; 2], turn_rad: f64) {
        let (sin, cos) = libm::sincos(turn_rad);
        let [hx, hy] = size_m.map(|v| v / 2.0);
        let corners = [[-hx, -hy], [hx, -hy], [hx, hy], [-hx, hy]].map(|[u, v]| {
            [
                centre_m[0] + cos * u - sin * v,
                centre_m[1] + sin * u + cos * v,
            ]
        });
        for k in 0..4 {
            let (a, b) = (corners[k], corners[(k + 1) % 4]);
            let face = self.new_face(a, b);
            self.piece(a, b, face);
        }
        let reach = [0, 1].map(|i| {
            let values = corners.map(|corner| corner[i]);
            [
                values.iter().copied().fold(f64::INFINITY, f64::min),
                values.iter().copied().fold(f64::NEG_INFINITY, f64::max),
            ]
        });
        self.solids.push(Area::new(reach[0], reach[1]));
    }

    fn disc(&mut self, centre_m: [f64; 2], radius_m: f64) {
        self.discs.push(Disc { centre_m, radius_m });
    }

    /// Round columns and lockers along the walls.
    fn furnish_corridors(&mut self, draws: &mut Draws) {
        for corridor in self.corridors.clone() {
            let axis = usize::from(corridor.size_m(1) > corridor.size_m(0));
            let [from, to] = corridor.span(axis);
            let sides = corridor.span(1 - axis);
            let mut at_m = from + draws.between([2.0, 5.0]);
            while at_m < to - 3.0 {
                let left = draws.unit() < 0.5;
                if draws.unit() < 0.55 {
                    let depth_m = draws.between([0.25, 0.45]);
                    let length_m = draws.between([0.7, 2.2]);
                    let across = if left {
                        [sides[0] + depth_m / 2.0, depth_m]
                    } else {
                        [sides[1] - depth_m / 2.0, depth_m]
                    };
                    let (centre, size) = if axis == 0 {
                        ([at_m + length_m / 2.0, across[0]], [length_m, across[1]])
                    } else {
                        ([across[0], at_m + length_m / 2.0], [across[1], length_m])
                    };
                    self.furniture(centre, size, 0.0);
                } else {
                    let radius_m = draws.between([0.12, 0.28]);
                    let off_m = radius_m + draws.between([0.02, 0.2]);
                    let across = if left {
                        sides[0] + off_m
                    } else {
                        sides[1] - off_m
                    };
                    let centre = if axis == 0 {
                        [at_m, across]
                    } else {
                        [across, at_m]
                    };
                    self.disc(centre, radius_m);
                }
                at_m += draws.between([3.0, 9.0]);
            }
        }
    }

    fn furnish(&mut self, room: Area, draws: &mut Draws) {
        let things = 1 + (draws.unit() * (2.0 + room.size_m(0) * room.size_m(1) / 14.0)) as usize;
        for _ in 0..things {
            let inner = room.less(0.6);
            let centre = [0, 1].map(|i| draws.between(inner.span(i)));
            let kind = draws.unit();
            if kind < 0.35 {
                // A desk, mostly along the walls.
                let turn = match draws.unit() {
                    u if u < 0.35 => 0.0,
                    u if u < 0.7 => FRAC_PI_2,
                    _ => draws.between([0.0, FRAC_PI_2]),
                };
                self.furniture(centre, [draws.between([1.2, 1.9]), 0.8], turn);
            } else if kind < 0.6 {
                self.cabinet(room, draws);
            } else if kind < 0.82 {
                self.chair(centre, draws);
            } else if kind < 0.92 {
                // A person's legs.
                let apart = draws.between([-0.2, 0.2]);
                self.disc(centre, 0.07);
                self.disc(
                    [centre[0] + draws.between([0.15, 0.35]), centre[1] + apart],
                    0.07,
                );
            } else {
                // A bin, a round table or a curved screen.
                let radius_m = [0.18, 0.55, 1.1][(draws.unit() * 3.0) as usize % 3];
                self.disc(centre, radius_m);
            }
        }
    }

    /// A cabinet 45 cm deep with its back to a wall.
    fn cabinet(&mut self, room: Area, draws: &mut Draws) {
        const DEPTH_M: f64 = 0.45;
        let axis = usize::from(draws.unit() < 0.5);
        let [from, to] = room.span(axis);
        let length_m = draws.between([0.8, 2.2]).min(to - from);
        let middle = draws.between([from + length_m / 2.0, to - length_m / 2.0]);
        let [low, high] = room.span(1 - axis);
        let across = if draws.unit() < 0.5 {
            low + DEPTH_M / 2.0
        } else {
            high - DEPTH_M / 2.0
        };
        if axis == 0 {
            self.furniture([middle, across], [length_m, DEPTH_M], 0.0);
        } else {
            self.furniture([across, middle], [DEPTH_M, length_m], 0.0);
        }
    }

    /// A swivel chair: a post and five castors.
    fn chair(&mut self, centre_m: [f64; 2], draws: &mut Draws) {
        self.disc(centre_m, 0.035);
        let turn = draws.between([0.0, TAU]);
        for k in 0..5 {
            let (sin, cos) = libm::sincos(turn + TAU * f64::from(k) / 5.0);
            self.disc([centre_m[0] + 0.3 * cos, centre_m[1] + 0.3 * sin], 0.025);
        }
    }
}

/// A rectangle by its extents along and across an axis.
fn along(axis: usize, extent: [f64; 2], across: [f64; 2]) -> Area {
    if axis == 0 {
        Area::new(extent, across)
    } else {
        Area::new(across, extent)
    }
}
