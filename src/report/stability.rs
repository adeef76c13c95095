//! How still the poses of a standing platform are: the Allan deviation of each component. At tau it
//! says how far the means over one tau and over the next differ (over sqrt 2); where it stops falling,
//! longer averaging helps no more.

use super::inertial::allan::{self, Point};
use crate::record::Stamp;

/// The curves of a standing run.
#[derive(Clone, Debug, PartialEq)]
pub struct Stability {
    /// Time from pose to pose, s.
    pub period_s: f64,
    /// Of x, y, z (m), roll, pitch, yaw (rad); empty for a component that is missing too often.
    pub curves: Vec<Vec<Point>>,
}

/// A reference that stays within this stands, m and rad.
const STILL_M: f64 = 0.002;
const STILL_RAD: f64 = 1e-3;
/// Fewer poses make no curve.
const FEWEST: usize = 30;
/// A spacing above this many usual ones cuts the record.
const GAP: f64 = 1.5;

/// Whether a reference pose (m, rad) is where the first one was.
pub(super) fn is_still(first: &[f64; 6], reference: &[f64; 6]) -> bool {
    (0..6).all(|i| {
        let off = reference[i] - first[i];
        if i < 3 {
            off.abs() <= STILL_M
        } else {
            super::wrap_angle(off).abs() <= STILL_RAD
        }
    })
}

impl Stability {
    /// Of poses (stamp, measured, reference) in order of time; none where the platform moves.
    pub(super) fn of(poses: &[(Stamp, [f64; 6], [f64; 6])]) -> Option<Stability> {
        let (_, _, first) = poses.first()?;
        let stands = poses
            .iter()
            .all(|(_, _, reference)| is_still(first, reference));
        if poses.len() < FEWEST || !stands {
            return None;
        }
        let mut spacings: Vec<f64> = poses
            .windows(2)
            .filter_map(|w| match w {
                [a, b] => Some(b.0.since_s(a.0)),
                _ => None,
            })
            .collect();
        let period_s = super::statistics::percentile_of(&mut spacings, 50.0);
        let curve = |i: usize| {
            let mut pieces: Vec<Vec<f64>> = Vec::new();
            let mut last: Option<Stamp> = None;
            for (stamp, measured, _) in poses.iter().filter(|p| p.1[i].is_finite()) {
                if last.is_none_or(|last| stamp.since_s(last) > GAP * period_s) {
                    pieces.push(Vec::new());
                }
                last = Some(*stamp);
                // About the first: angles near the seam stay together.
                let value = super::wrap_angle(measured[i] - first[i]);
                if let Some(piece) = pieces.last_mut() {
                    piece.push(if i < 3 { measured[i] - first[i] } else { value });
                }
            }
            let pieces: Vec<&[f64]> = pieces.iter().map(Vec::as_slice).collect();
            if pieces.iter().map(|p| p.len()).sum::<usize>() < FEWEST {
                return Vec::new();
            }
            allan::curve(&pieces, period_s)
        };
        Some(Stability {
            period_s,
            curves: (0..6).map(curve).collect(),
        })
    }

    /// The lowest point of a component's curve: how still it gets, and after how long.
    pub fn floor(&self, component: usize) -> Option<&Point> {
        let curve = self.curves.get(component)?;
        curve
            .iter()
            .min_by(|a, b| a.deviation.total_cmp(&b.deviation))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    fn poses(n: i64, moves: f64) -> Vec<(Stamp, [f64; 6], [f64; 6])> {
        let mut random = ChaCha8Rng::seed_from_u64(4);
        (0..n)
            .map(|i| {
                let reference = [
                    0.0,
                    1.0 + moves * i as f64,
                    2.0,
                    0.0,
                    0.0,
                    std::f64::consts::PI - 0.001,
                ];
                let mut measured = reference;
                for (k, m) in measured.iter_mut().enumerate() {
                    let white: f64 = StandardNormal.sample(&mut random);
                    *m += white * if k < 3 { 3e-3 } else { 2e-3 };
                }
                measured[5] = super::super::wrap_angle(measured[5]);
                measured[4] = f64::NAN;
                (Stamp::from_ns(i * 28_571_429), measured, reference)
            })
            .collect()
    }

    #[test]
    fn white_noise_falls_with_the_root_of_time() {
        let found = Stability::of(&poses(20_000, 0.0)).unwrap();
        assert!((found.period_s - 0.028_571_429).abs() < 1e-12);
        for (i, sigma) in [(0, 3e-3), (1, 3e-3), (5, 2e-3)] {
            for point in found.curves[i].iter().take(25) {
                let want = sigma * (found.period_s / point.tau_s).sqrt();
                let off = (point.deviation / want - 1.0).abs();
                assert!(off < 5.0 * point.error + 0.01, "{i}: {point:?}, not {want}");
            }
        }
        assert!(found.curves[4].is_empty() && found.floor(4).is_none());
        assert!(found.floor(0).unwrap().tau_s > 10.0);
    }

    #[test]
    fn a_moving_platform_has_none() {
        assert_eq!(Stability::of(&poses(1000, 1e-4)), None);
        assert_eq!(Stability::of(&poses(10, 0.0)), None);
        assert_eq!(Stability::of(&[]), None);
    }
}
