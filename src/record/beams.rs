//! The beams of a scan as rays: where each starts and where it points.

use super::Scan;
use std::f64::consts::FRAC_PI_2;
use std::ops::Range;

/// How the scanner moves while it scans: constant over the scan, about the reference instant, at
/// which the beam at 90 degrees fires (Kurniawan 2017, eq. 3.9 to 3.21).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ScanMotion {
    /// Velocity of the scanner's origin along the y axis that S has at the reference instant, m/s.
    pub vy_m_s: f64,
    /// The same along the z axis, m/s.
    pub vz_m_s: f64,
    /// Rate at which S turns in its own plane, rad/s; positive from y to z.
    pub roll_rad_s: f64,
}

impl ScanMotion {
    /// No motion.
    pub const REST: ScanMotion = ScanMotion {
        vy_m_s: 0.0,
        vz_m_s: 0.0,
        roll_rad_s: 0.0,
    };

    /// Whether it is no motion.
    pub fn is_rest(&self) -> bool {
        *self == ScanMotion::REST
    }

    fn is_finite(&self) -> bool {
        self.vy_m_s.is_finite() && self.vz_m_s.is_finite() && self.roll_rad_s.is_finite()
    }
}

/// The rays of a scan's beams in the axes that S has at the reference instant, kept from scan to
/// scan.
///
/// Beam `i` fires `tau = (i - i_ref) * time_increment` after that instant. In a moving scan it
/// starts at `(vy, vz) * tau` and points along its angle plus `roll_rate * tau`.
#[derive(Clone, Debug, Default)]
pub struct BeamTable {
    angle_min_rad: f64,
    increment_rad: f64,
    time_increment_s: f64,
    /// Index of the beam at 90 degrees, as a fraction.
    reference_index: f64,
    motion: ScanMotion,
    /// Cosine and sine of each beam's angle.
    at_rest: Vec<(f64, f64)>,
    /// Whether `cos_sin` differs from `at_rest`.
    turned: bool,
    /// Cosine and sine of each beam's direction.
    pub cos_sin: Vec<(f64, f64)>,
}

impl BeamTable {
    /// Makes the table fit a scan taken at rest; does nothing where it already does.
    pub fn fit(&mut self, scan: &Scan) {
        self.fit_moving(scan, ScanMotion::REST);
    }

    /// Makes the table fit a scan taken in motion. Where the scan does not say when its beams
    /// fire, or the motion is not finite, it is taken as at rest.
    pub fn fit_moving(&mut self, scan: &Scan, motion: ScanMotion) {
        let same_angles = self.at_rest.len() == scan.beams()
            && self.angle_min_rad == scan.angle_min_rad
            && self.increment_rad == scan.angle_increment_rad;
        let timed = scan.time_increment_s.is_finite();
        let time_increment_s = if timed { scan.time_increment_s } else { 0.0 };
        let motion = if timed && motion.is_finite() {
            motion
        } else {
            ScanMotion::REST
        };
        if !same_angles {
            self.angle_min_rad = scan.angle_min_rad;
            self.increment_rad = scan.angle_increment_rad;
            self.reference_index = self.index_at(FRAC_PI_2);
            self.at_rest.clear();
            self.at_rest.extend((0..scan.beams()).map(|i| {
                let (sin, cos) = scan.angle_rad(i).sin_cos();
                (cos, sin)
            }));
        }
        let same_turn = motion.roll_rad_s == self.motion.roll_rad_s
            && time_increment_s == self.time_increment_s;
        self.time_increment_s = time_increment_s;
        self.motion = motion;
        if !(same_angles && same_turn) {
            self.turn();
        }
    }

    /// Fills `cos_sin` for the motion.
    fn turn(&mut self) {
        let turns = self.motion.roll_rad_s != 0.0;
        if !turns && !self.turned && self.cos_sin.len() == self.at_rest.len() {
            // Only the angles may have changed; copying is as quick as looking.
            self.cos_sin.copy_from_slice(&self.at_rest);
            return;
        }
        self.turned = turns;
        if !turns {
            self.cos_sin.clone_from(&self.at_rest);
            return;
        }
        let step = self.time_increment_s * self.motion.roll_rad_s;
        let first = -self.reference_index * step;
        let last = first + self.at_rest.len() as f64 * step;
        // The choice is made once a scan, so that the loop has no branch.
        if first.abs().max(last.abs()) < SMALL_TURN_RAD {
            self.turn_by(first, step, small_sin_cos);
        } else {
            self.turn_by(first, step, f64::sin_cos);
        }
    }

    /// Fills `cos_sin` with beam `i` turned by `first + i * step`.
    fn turn_by(&mut self, first: f64, step: f64, sin_cos: impl Fn(f64) -> (f64, f64)) {
        self.cos_sin.resize(self.at_rest.len(), (0.0, 0.0));
        let rays = self.cos_sin.iter_mut().zip(&self.at_rest);
        for (i, (turned, (cos, sin))) in (0i32..).zip(rays) {
            let (sin_turn, cos_turn) = sin_cos(first + f64::from(i) * step);
            *turned = (
                cos * cos_turn - sin * sin_turn,
                sin * cos_turn + cos * sin_turn,
            );
        }
    }

    /// The motion that is in the table.
    pub fn motion(&self) -> ScanMotion {
        self.motion
    }

    /// Angle that the scan states for beam `i`, rad; where it points in a scan at rest.
    pub fn angle_rad(&self, i: usize) -> f64 {
        self.angle_min_rad + i as f64 * self.increment_rad
    }

    /// Angle from beam to beam, rad.
    pub fn increment_rad(&self) -> f64 {
        self.increment_rad
    }

    /// When the beam with the stated angle fires, s after the reference instant.
    pub fn time_at_s(&self, angle_rad: f64) -> f64 {
        (self.index_at(angle_rad) - self.reference_index) * self.time_increment_s
    }

    /// When beam `i` fires, s after the reference instant.
    #[inline]
    pub fn time_s(&self, i: usize) -> f64 {
        (i as f64 - self.reference_index) * self.time_increment_s
    }

    /// Where beam `i` starts (y and z in the axes of the reference instant), m.
    pub fn origin_m(&self, i: usize) -> (f64, f64) {
        let tau_s = self.time_s(i);
        (self.motion.vy_m_s * tau_s, self.motion.vz_m_s * tau_s)
    }

    /// The angle under which the scanner at the reference instant would see what beam `i` meets
    /// at `range_m`, rad. At rest this is the beam's own angle.
    pub fn seen_rad(&self, i: usize, range_m: f64) -> f64 {
        let angle_rad = self.angle_rad(i);
        if self.motion.is_rest() {
            return angle_rad;
        }
        let tau_s = self.time_s(i);
        let (cos, sin) = self.cos_sin[i];
        let (y, z) = self.origin_m(i);
        // The origin in the beam's own axes: along it and to the left of it.
        let along_m = range_m + y * cos + z * sin;
        let aside_m = z * cos - y * sin;
        angle_rad + self.motion.roll_rad_s * tau_s + small_angle(aside_m, along_m)
    }

    /// Stated angle of the beam that passes through a point given by its angle (rad) and distance
    /// (m) at the reference instant: the reverse of [`BeamTable::seen_rad`].
    pub fn angle_towards(&self, angle_rad: f64, distance_m: f64) -> f64 {
        if self.motion.is_rest() {
            return angle_rad;
        }
        let (sin, cos) = angle_rad.sin_cos();
        let ScanMotion {
            vy_m_s,
            vz_m_s,
            roll_rad_s,
        } = self.motion;
        let mut stated_rad = angle_rad;
        // Each round is better by the ratio of the platform's speed to the spot's: a hundredth.
        for _ in 0..4 {
            let tau_s = self.time_at_s(stated_rad);
            let along_m = distance_m - (vy_m_s * cos + vz_m_s * sin) * tau_s;
            let aside_m = (vy_m_s * sin - vz_m_s * cos) * tau_s;
            stated_rad = angle_rad + aside_m.atan2(along_m) - roll_rad_s * tau_s;
        }
        stated_rad
    }

    /// The index at a stated angle, as a fraction, not bounded.
    fn index_at(&self, angle_rad: f64) -> f64 {
        (angle_rad - self.angle_min_rad) / self.increment_rad
    }

    /// Indices of the beams between two stated angles, both included.
    pub fn index_range(&self, from_rad: f64, to_rad: f64) -> Range<usize> {
        let n = self.cos_sin.len() as f64;
        let from = self.index_at(from_rad).ceil().clamp(0.0, n) as usize;
        let to = (self.index_at(to_rad).floor() + 1.0).clamp(0.0, n) as usize;
        from..to.max(from)
    }
}

/// The angle of a point that lies `along` an axis and a little `aside` from it, as `atan2` gives it;
/// exact to rounding up to a thirtieth of a radian, and without a call below that.
fn small_angle(aside: f64, along: f64) -> f64 {
    let t = aside / along;
    if !(along > 0.0 && t.abs() < 0.03) {
        return aside.atan2(along);
    }
    let s = t * t;
    t * (1.0 - s * (1.0 / 3.0 - s * (1.0 / 5.0 - s * (1.0 / 7.0 - s * (1.0 / 9.0)))))
}

/// A scanner turns less than this within half a scan, rad; a faster one takes the longer way.
const SMALL_TURN_RAD: f64 = 0.02;

/// Sine and cosine of a turn below [`SMALL_TURN_RAD`], exact to rounding.
#[inline]
fn small_sin_cos(x: f64) -> (f64, f64) {
    let s = x * x;
    let sin = 1.0 - s * (1.0 / 6.0 - s * (1.0 / 120.0 - s * (1.0 / 5040.0)));
    let cos = 0.5 - s * (1.0 / 24.0 - s * (1.0 / 720.0));
    (x * sin, 1.0 - s * cos)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scan() -> Scan {
        let step = 0.25f64.to_radians();
        Scan {
            angle_min_rad: -5f64.to_radians(),
            angle_increment_rad: step,
            time_increment_s: 1.0 / 35.0 / 1440.0,
            ranges_m: vec![1.0; 761].into(),
            ..Scan::default()
        }
    }

    const MOTION: ScanMotion = ScanMotion {
        vy_m_s: 2.8,
        vz_m_s: -1.1,
        roll_rad_s: 0.4,
    };

    #[test]
    fn rest_is_the_stated_angles_to_the_bit() {
        let mut table = BeamTable::default();
        table.fit_moving(&scan(), MOTION);
        table.fit(&scan());
        for (i, (cos, sin)) in table.cos_sin.iter().enumerate() {
            let angle = scan().angle_rad(i);
            assert_eq!((angle.cos(), angle.sin()), (*cos, *sin));
            assert_eq!(table.seen_rad(i, 3.0), angle);
            assert_eq!(table.origin_m(i), (0.0, 0.0));
        }
        assert_eq!(table.angle_towards(1.0, 3.0), 1.0);
    }

    #[test]
    fn a_moving_beam_starts_and_points_where_the_motion_has_carried_it() {
        let mut table = BeamTable::default();
        table.fit_moving(&scan(), MOTION);
        for i in [0, 123, 380, 500, 760] {
            // 35 revolutions a second; the beam at 90 deg fires at zero.
            let tau = (scan().angle_rad(i) - FRAC_PI_2) / (std::f64::consts::TAU * 35.0);
            let direction = scan().angle_rad(i) + 0.4 * tau;
            let (cos, sin) = table.cos_sin[i];
            assert!((cos - direction.cos()).abs() < 1e-14 && (sin - direction.sin()).abs() < 1e-14);
            let (y, z) = table.origin_m(i);
            assert!((y - 2.8 * tau).abs() < 1e-14 && (z + 1.1 * tau).abs() < 1e-14);
            // The point that it meets 2.5 m away, seen from the reference origin.
            let (py, pz) = (y + 2.5 * cos, z + 2.5 * sin);
            let seen = table.seen_rad(i, 2.5);
            assert!((seen.cos() * pz - seen.sin() * py).abs() < 1e-12);
            assert!(seen.cos() * py + seen.sin() * pz > 2.0);
            let back = table.angle_towards(seen, py.hypot(pz));
            assert!((back - scan().angle_rad(i)).abs() < 1e-9, "{i}");
        }
    }

    #[test]
    fn without_times_or_with_a_motion_that_is_no_number_it_is_at_rest() {
        let mut table = BeamTable::default();
        let untimed = Scan {
            time_increment_s: f64::NAN,
            ..scan()
        };
        table.fit_moving(&untimed, MOTION);
        assert!(table.motion().is_rest());
        let nowhere = ScanMotion {
            vy_m_s: f64::NAN,
            ..MOTION
        };
        table.fit_moving(&scan(), nowhere);
        assert!(table.motion().is_rest() && table.cos_sin[7] == table.at_rest[7]);
    }

    #[test]
    fn small_angles_are_exact() {
        for k in -300..=300 {
            let turn = f64::from(k) / 300.0 * SMALL_TURN_RAD;
            let (sin, cos) = small_sin_cos(turn);
            assert!((sin - turn.sin()).abs() < 1e-17 && (cos - turn.cos()).abs() < 3e-16);
            let turn = 5.0 * turn;
            // Beyond a thirtieth of a radian the system's arc tangent takes over.
            for along in [4.0, -4.0] {
                let aside = turn * 4.0;
                assert!((small_angle(aside, along) - aside.atan2(along)).abs() < 1e-16);
            }
        }
    }
}
