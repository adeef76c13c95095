//! The beams of a scan as directions.

use super::Scan;
use std::ops::Range;

/// Angles of a scan's beams with their sines and cosines, kept from scan to scan.
#[derive(Clone, Debug, Default)]
pub struct BeamTable {
    angle_min_rad: f64,
    increment_rad: f64,
    /// Cosine and sine of each beam's angle.
    pub cos_sin: Vec<(f64, f64)>,
}

impl BeamTable {
    /// Makes the table fit a scan; does nothing where it already does.
    pub fn fit(&mut self, scan: &Scan) {
        if self.cos_sin.len() == scan.beams()
            && self.angle_min_rad == scan.angle_min_rad
            && self.increment_rad == scan.angle_increment_rad
        {
            return;
        }
        self.angle_min_rad = scan.angle_min_rad;
        self.increment_rad = scan.angle_increment_rad;
        self.cos_sin.clear();
        self.cos_sin.extend((0..scan.beams()).map(|i| {
            let (sin, cos) = scan.angle_rad(i).sin_cos();
            (cos, sin)
        }));
    }

    /// Angle of beam `i`, rad.
    pub fn angle_rad(&self, i: usize) -> f64 {
        self.angle_min_rad + i as f64 * self.increment_rad
    }

    /// Angle from beam to beam, rad.
    pub fn increment_rad(&self) -> f64 {
        self.increment_rad
    }

    /// The index at an angle, as a fraction, not bounded.
    fn index_at(&self, angle_rad: f64) -> f64 {
        (angle_rad - self.angle_min_rad) / self.increment_rad
    }

    /// Indices of the beams between two angles, both included.
    pub fn index_range(&self, from_rad: f64, to_rad: f64) -> Range<usize> {
        let n = self.cos_sin.len() as f64;
        let from = self.index_at(from_rad).ceil().clamp(0.0, n) as usize;
        let to = (self.index_at(to_rad).floor() + 1.0).clamp(0.0, n) as usize;
        from..to.max(from)
    }
}
