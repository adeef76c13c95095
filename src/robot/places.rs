//! Where the platform stood still, and what was measured there.

use super::Pose;
use crate::record::{self, Stamp, TrajectoryPoint};
use nalgebra::Matrix6;

/// A place at which the platform stood.
#[derive(Clone, Debug, PartialEq)]
pub struct Place {
    /// Where it was wanted.
    pub desired: Pose,
    /// Mean of the poses measured there.
    pub measured: Pose,
    /// What that mean is taken to be worth. Poses of one place share what does not average out (which
    /// beams meet an edge), so it is no better than the best pose of the place: `solve-pose --smooth`
    /// says what many scans of one place are worth.
    pub covariance: Matrix6<f64>,
    /// Poses.
    pub count: usize,
}

/// When a desired trajectory stands still, and what a measurement is worth that does not say so.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Standing {
    /// Largest change of a position within one place, m.
    pub tolerance_m: f64,
    /// Largest change of an angle, rad.
    pub tolerance_rad: f64,
    /// Shortest rest that counts, s.
    pub least_s: f64,
    /// How long after its begin (and before its end) poses do not count, s.
    pub settle_s: f64,
    /// Standard deviation of a position that comes without a covariance, m.
    pub sigma_m: f64,
    /// The same of an angle, rad.
    pub sigma_rad: f64,
    /// Added to every covariance: how well the robot's other dimensions are known where a pose shows
    /// them, m.
    pub model_sigma_m: f64,
    /// The same for angles, rad.
    pub model_sigma_rad: f64,
}

/// The places of a run, in the order of time: every rest of `desired`, with the poses that were
/// measured in it. Rests without a pose are left out.
pub fn places(desired: &[TrajectoryPoint], poses: &[record::Pose], how: &Standing) -> Vec<Place> {
    rests(desired, how)
        .into_iter()
        .filter_map(|(from, to, pose)| {
            let inside = |p: &&record::Pose| {
                let components = p.components();
                p.is_solved()
                    && components.iter().all(|v| v.is_finite())
                    && p.stamp.since_s(from) >= how.settle_s
                    && to.since_s(p.stamp) >= how.settle_s
            };
            place(pose, poses.iter().filter(inside), how)
        })
        .collect()
}

fn place<'a>(
    desired: Pose,
    poses: impl Iterator<Item = &'a record::Pose>,
    how: &Standing,
) -> Option<Place> {
    let mut sum = Pose::zeros();
    let mut count = 0usize;
    let mut best: Option<Matrix6<f64>> = None;
    for pose in poses {
        sum += Pose::from(pose.components());
        count += 1;
        let covariance = covariance(pose, how);
        if best.is_none_or(|best| covariance.trace() < best.trace()) {
            best = Some(covariance);
        }
    }
    let covariance = best?;
    Some(Place {
        desired,
        measured: sum / count as f64,
        covariance: covariance + diagonal(how.model_sigma_m, how.model_sigma_rad),
        count,
    })
}

/// A pose's covariance; the stated one where it has none.
fn covariance(pose: &record::Pose, how: &Standing) -> Matrix6<f64> {
    if pose.covariance.iter().all(|v| v.is_finite()) {
        Matrix6::from_fn(|row, col| pose.cov(row.min(col), row.max(col)))
    } else {
        diagonal(how.sigma_m, how.sigma_rad)
    }
}

fn diagonal(sigma_m: f64, sigma_rad: f64) -> Matrix6<f64> {
    let (p, a) = (sigma_m * sigma_m, sigma_rad * sigma_rad);
    Matrix6::from_diagonal(&Pose::new(p, p, p, a, a, a))
}

/// The rests of a trajectory: begin, end, pose.
fn rests(points: &[TrajectoryPoint], how: &Standing) -> Vec<(Stamp, Stamp, Pose)> {
    let pose = |p: &TrajectoryPoint| {
        let ([x, y, z], [a, b, c]) = (p.position_m, p.rotation_rad);
        Pose::new(x, y, z, a, b, c)
    };
    let same = |a: &Pose, b: &Pose| {
        let d = (a - b).abs();
        let angle = |v: f64| v.min((std::f64::consts::TAU - v).abs());
        (0..3).all(|i| d[i] <= how.tolerance_m) && (3..6).all(|i| angle(d[i]) <= how.tolerance_rad)
    };
    let mut found = Vec::new();
    let mut rest = points;
    while let Some(first) = rest.first() {
        let start = pose(first);
        let count = rest.iter().take_while(|p| same(&start, &pose(p))).count();
        // A pose that is not a number is not even the same as itself.
        let (here, beyond) = rest.split_at(count.max(1));
        if let Some(last) = here.last()
            && last.stamp.since_s(first.stamp) >= how.least_s
        {
            found.push((first.stamp, last.stamp, start));
        }
        rest = beyond;
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOW: Standing = Standing {
        tolerance_m: 1e-4,
        tolerance_rad: 1e-4,
        least_s: 0.5,
        settle_s: 0.2,
        sigma_m: 0.002,
        sigma_rad: 0.001,
        model_sigma_m: 0.0,
        model_sigma_rad: 0.0,
    };

    /// Two seconds at y = 0, one on the way to y = 1, two there, at 100 Hz.
    fn tour() -> Vec<TrajectoryPoint> {
        (0..500)
            .map(|k| TrajectoryPoint {
                stamp: Stamp::from_ns(k * 10_000_000),
                position_m: [0.0, (k as f64 / 100.0 - 2.0).clamp(0.0, 1.0), 2.0],
                rotation_rad: [0.0; 3],
                velocity_m_s: [f64::NAN; 3],
            })
            .collect()
    }

    #[test]
    fn rests_are_found_and_poses_belong_to_them() {
        let desired = tour();
        let poses: Vec<record::Pose> = desired
            .iter()
            .enumerate()
            .map(|(k, p)| record::Pose {
                stamp: p.stamp,
                position_m: [0.0, p.position_m[1] + 0.001 * (k % 3) as f64, 2.0],
                rotation_rad: [0.0; 3],
                ..record::Pose::default()
            })
            .collect();
        let found = places(&desired, &poses, &HOW);
        assert_eq!(found.len(), 2);
        assert_eq!(found[1].desired[1], 1.0);
        // The last rest ends with the trajectory, at 4.99 s; 0.2 s at both ends are left out.
        assert!((158..=162).contains(&found[1].count), "{}", found[1].count);
        assert!((found[1].measured[1] - 1.001).abs() < 1e-4);
        assert!((found[0].covariance[(1, 1)] - 4e-6).abs() < 1e-12);
    }

    #[test]
    fn the_best_covariance_of_a_place_counts() {
        let desired = tour();
        let pose = |at_s: f64, variance: f64| {
            let mut pose = record::Pose {
                stamp: Stamp::from_ns(0).plus_s(at_s),
                position_m: [0.0, 0.0, 2.0],
                rotation_rad: [0.0; 3],
                covariance: [0.0; 21],
                ..record::Pose::default()
            };
            for k in [0, 6, 11, 15, 18, 20] {
                pose.covariance[k] = variance;
            }
            pose
        };
        let how = Standing {
            model_sigma_m: 1e-3,
            ..HOW
        };
        let found = places(&desired, &[pose(0.5, 4e-6), pose(1.0, 1e-6)], &how);
        assert_eq!((found.len(), found[0].count), (1, 2));
        assert!((found[0].covariance[(0, 0)] - 2e-6).abs() < 1e-12);
        assert!((found[0].covariance[(5, 5)] - 1e-6).abs() < 1e-12);
    }

    #[test]
    fn poses_that_are_no_numbers_and_empty_runs_do_no_harm() {
        assert!(places(&[], &[], &HOW).is_empty());
        assert!(places(&tour(), &[record::Pose::default()], &HOW).is_empty());
        let lost = vec![TrajectoryPoint::default(); 20];
        assert!(places(&lost, &[], &HOW).is_empty());
    }
}
