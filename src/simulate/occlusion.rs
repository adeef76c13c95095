//! Things on the platform's side of the reflectors: cables and cargo.

use super::coverage::beyond_edge;
use super::parameters::{Cables, Cargo};
use super::random::Draws;
use super::world::{Spot, Surface};

/// An obstacle's part in what a beam sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shadow {
    /// Where the beam meets it.
    pub surface: Surface,
    /// Share of the spot on it.
    pub share: f64,
    /// The share above which it gives the range.
    pub threshold: f64,
    /// Its remission over a reflector's.
    pub remission: f64,
}

#[derive(Clone, Copy, Debug)]
enum Shape {
    /// Straight across the scan plane.
    Cable { diameter_m: f64, threshold: f64 },
    /// Flat, square to the beam through its middle.
    Block { half_width_rad: f64 },
}

#[derive(Clone, Copy, Debug)]
struct Obstacle {
    shape: Shape,
    /// Direction of its middle in the scan plane, rad.
    angle_rad: f64,
    range_m: f64,
    remission: f64,
}

/// The obstacles of one scan.
#[derive(Clone, Debug, Default)]
pub struct Obstacles(Vec<Obstacle>);

impl Obstacles {
    /// Cables anywhere between two beam angles.
    pub fn add_cables(&mut self, cables: &Cables, aperture_rad: [f64; 2], draws: &mut Draws) {
        for _ in 0..cables.count {
            self.0.push(Obstacle {
                shape: Shape::Cable {
                    diameter_m: cables.diameter_mm * 1e-3,
                    threshold: cables.share,
                },
                angle_rad: draws.between(aperture_rad),
                range_m: draws.between(cables.range_m),
                remission: cables.remission,
            });
        }
    }

    /// One block.
    pub fn add_cargo(&mut self, cargo: &Cargo, draws: &mut Draws) {
        let half_width_rad = draws.between(cargo.width_deg).to_radians() / 2.0;
        self.0.push(Obstacle {
            shape: Shape::Block { half_width_rad },
            angle_rad: draws.between(cargo.between_deg).to_radians(),
            range_m: draws.between(cargo.range_m),
            remission: cargo.remission,
        });
    }

    /// Whether there are none.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The nearest obstacle that a beam touches.
    pub fn look(&self, angle_rad: f64, spot: &Spot) -> Option<Shadow> {
        let mut nearest: Option<Shadow> = None;
        for obstacle in &self.0 {
            let Some(shadow) = obstacle.shadow(angle_rad, spot) else {
                continue;
            };
            if nearest.is_none_or(|n| shadow.surface.range_m < n.surface.range_m) {
                nearest = Some(shadow);
            }
        }
        nearest
    }
}

impl Obstacle {
    fn shadow(&self, angle_rad: f64, spot: &Spot) -> Option<Shadow> {
        let off_rad = angle_rad - self.angle_rad;
        if off_rad.abs() > 0.5 {
            return None;
        }
        let (sin, cos) = libm::sincos(off_rad);
        let range_m = self.range_m / cos;
        let radius_m = spot.radius_m(range_m);
        // Distances across the beam from its axis to the two sides.
        let (near_m, far_m, threshold) = match self.shape {
            Shape::Cable {
                diameter_m,
                threshold,
            } => {
                let across_m = self.range_m * sin;
                (
                    diameter_m / 2.0 - across_m,
                    diameter_m / 2.0 + across_m,
                    threshold,
                )
            }
            Shape::Block { half_width_rad } => (
                range_m * (half_width_rad - off_rad),
                range_m * (half_width_rad + off_rad),
                0.5,
            ),
        };
        let side = |distance_m: f64| {
            if radius_m > 0.0 {
                beyond_edge(distance_m / radius_m)
            } else {
                f64::from(u8::from(distance_m >= 0.0))
            }
        };
        let share = side(near_m) + side(far_m) - 1.0;
        (share > 0.0).then_some(Shadow {
            surface: Surface {
                range_m,
                cos_incidence: cos,
            },
            share,
            threshold,
            remission: self.remission,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::random::{Purpose, Seed};

    #[test]
    fn cargo_covers_its_width() {
        let mut obstacles = Obstacles::default();
        let cargo = Cargo::default();
        obstacles.add_cargo(&cargo, &mut Seed(1).draws(Purpose::Cargo, 0));
        let seen: Vec<(f64, Shadow)> = (0..19_000)
            .filter_map(|k| {
                let angle = (f64::from(k) * 0.01 - 5.0).to_radians();
                obstacles.look(angle, &Spot::Pencil).map(|s| (angle, s))
            })
            .collect();
        let width_deg = (seen.last().unwrap().0 - seen[0].0).to_degrees();
        assert!((cargo.width_deg[0] - 0.02..cargo.width_deg[1]).contains(&width_deg));
        // Flat: all points at one distance along the middle beam.
        let middle = (seen.last().unwrap().0 + seen[0].0) / 2.0;
        let depth = |(angle, s): &(f64, Shadow)| s.surface.range_m * (angle - middle).cos();
        let first = depth(&seen[0]);
        assert!(seen.iter().all(|s| (depth(s) - first).abs() < 1e-4));
        assert!((cargo.range_m[0]..cargo.range_m[1]).contains(&first));
    }

    #[test]
    fn a_cable_is_as_wide_as_it_is() {
        let mut obstacles = Obstacles::default();
        let cables = Cables {
            count: 1,
            diameter_mm: 8.0,
            range_m: [2.0, 2.0],
            ..Cables::default()
        };
        obstacles.add_cables(&cables, [1.0, 1.0], &mut Seed(1).draws(Purpose::Cables, 0));
        // asin(4 mm / 2 m) to each side.
        assert!(obstacles.look(1.0 + 0.00199, &Spot::Pencil).is_some());
        assert!(obstacles.look(1.0 - 0.00201, &Spot::Pencil).is_none());
        let shadow = obstacles.look(1.0, &Spot::Pencil).unwrap();
        assert_eq!((shadow.surface.range_m, shadow.share), (2.0, 1.0));
    }
}
