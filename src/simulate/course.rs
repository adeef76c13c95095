//! Where the platform is in each scan: at rest in one pose after another, or moving.

use super::random::{Purpose, Seed};
use crate::motion::{Motion, Pose, State};
use nalgebra::Vector3;

/// The platform's course over a run.
pub enum Course {
    /// At rest, a fixed number of scans in each pose; between poses it jumps.
    Stations {
        /// In order.
        poses: Vec<Pose>,
        /// Scans in each.
        scans_each: u64,
    },
    /// In motion.
    Moving {
        /// The true motion.
        truth: Box<dyn Motion>,
        /// The motion that was asked for.
        desired: Box<dyn Motion>,
        /// The platform follows the desired motion this much later, s.
        lag_s: f64,
    },
}

impl Course {
    /// How many scans fit into it, one every `period_s` and each lasting `sweep_s`.
    pub fn scans(&self, period_s: f64, sweep_s: f64) -> u64 {
        match self {
            Course::Stations { poses, scans_each } => poses.len() as u64 * scans_each,
            Course::Moving { truth, lag_s, .. } => {
                let room_s = truth.duration_s() + lag_s - sweep_s;
                if room_s < 0.0 {
                    0
                } else {
                    (room_s / period_s + 1e-9).floor() as u64 + 1
                }
            }
        }
    }

    /// The true state `t_s` after the start, during scan `number`.
    pub fn truth(&self, number: u64, t_s: f64) -> State {
        match self {
            Course::Stations { .. } => self.station(number),
            Course::Moving { truth, lag_s, .. } => truth.at(t_s - lag_s),
        }
    }

    /// The state asked for.
    pub fn desired(&self, number: u64, t_s: f64) -> State {
        match self {
            Course::Stations { .. } => self.station(number),
            Course::Moving { desired, .. } => desired.at(t_s),
        }
    }

    /// Whether the platform rests during every scan.
    pub fn is_resting(&self) -> bool {
        matches!(self, Course::Stations { .. })
    }

    fn station(&self, number: u64) -> State {
        let Course::Stations { poses, scans_each } = self else {
            return State::resting(ORIGIN);
        };
        let index = usize::try_from(number / (*scans_each).max(1)).unwrap_or(usize::MAX);
        // Past its end the course stays in the last pose.
        let pose = poses.get(index).or(poses.last()).copied().unwrap_or(ORIGIN);
        State::resting(pose)
    }
}

const ORIGIN: Pose = Pose {
    position_m: Vector3::new(0.0, 0.0, 0.0),
    rotation_rad: Vector3::new(0.0, 0.0, 0.0),
};

/// A grid of poses in the plane x = const.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// x and attitude of all poses (roll, pitch, yaw in rad); y and z are not used.
    pub pose: Pose,
    /// From and to along y, m.
    pub y_m: [f64; 2],
    /// From and to along z, m.
    pub z_m: [f64; 2],
    /// From pose to pose, m.
    pub step_m: f64,
}

impl Grid {
    /// Row after row from the bottom, there and back along y, so that neighbours in time are
    /// neighbours in space.
    pub fn poses(&self) -> Vec<Pose> {
        let values = |[from, to]: [f64; 2]| {
            let steps = ((to - from) / self.step_m + 1e-9).floor().max(0.0) as usize;
            (0..=steps).map(move |k| from + k as f64 * self.step_m)
        };
        let row: Vec<f64> = values(self.y_m).collect();
        let mut poses = Vec::new();
        for (index, z) in values(self.z_m).enumerate() {
            let mut place = |y: f64| {
                poses.push(Pose {
                    position_m: Vector3::new(self.pose.position_m.x, y, z),
                    rotation_rad: self.pose.rotation_rad,
                });
            };
            if index % 2 == 0 {
                row.iter().for_each(|y| place(*y));
            } else {
                row.iter().rev().for_each(|y| place(*y));
            }
        }
        poses
    }
}

/// Uniformly distributed poses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scatter {
    /// From and to along x, y and z, m.
    pub position_m: [[f64; 2]; 3],
    /// From and to of roll, pitch and yaw, rad.
    pub rotation_rad: [[f64; 2]; 3],
}

impl Scatter {
    /// `count` poses; pose k is the same whatever the count.
    pub fn poses(&self, seed: Seed, count: u64) -> Vec<Pose> {
        (0..count)
            .map(|number| {
                let mut draws = seed.draws(Purpose::Course, number);
                Pose {
                    position_m: self.position_m.map(|span| draws.between(span)).into(),
                    rotation_rad: self.rotation_rad.map(|span| draws.between(span)).into(),
                }
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::Straight;

    #[test]
    fn a_grid_runs_to_and_fro() {
        let grid = Grid {
            pose: ORIGIN,
            y_m: [-4.0, 4.0],
            z_m: [0.5, 3.5],
            step_m: 0.2,
        };
        let poses = grid.poses();
        assert_eq!(poses.len(), 41 * 16);
        for pair in poses.windows(2) {
            assert!((pair[0].distance_m(&pair[1]) - 0.2).abs() < 1e-9);
        }
        assert!((poses.last().unwrap().position_m.z - 3.5).abs() < 1e-12);
    }

    #[test]
    fn scattered_poses_fill_their_spans() {
        let scatter = Scatter {
            position_m: [[-0.05, 0.05], [-4.0, 4.0], [0.5, 3.5]],
            rotation_rad: [[-0.02, 0.02]; 3],
        };
        let poses = scatter.poses(Seed(3), 4000);
        let mean = poses.iter().map(|p| p.position_m.y).sum::<f64>() / 4000.0;
        let square = poses.iter().map(|p| p.position_m.y.powi(2)).sum::<f64>() / 4000.0;
        assert!(mean.abs() < 0.15);
        assert!((square - 16.0 / 3.0).abs() < 0.25);
        assert!(poses.iter().all(|p| (0.5..=3.5).contains(&p.position_m.z)));
        assert_eq!(scatter.poses(Seed(3), 2), poses[..2]);
    }

    #[test]
    fn scans_fit_into_a_motion() {
        let line = Straight {
            from: ORIGIN,
            to: Pose {
                position_m: Vector3::new(0.0, 1.0, 0.0),
                ..ORIGIN
            },
            speed_m_s: 1.0,
        };
        let course = Course::Moving {
            truth: Box::new(line),
            desired: Box::new(line),
            lag_s: 0.1,
        };
        // Scans start at 0, 0.1, .. and the last ends within 1.1 s.
        assert_eq!(course.scans(0.1, 0.05), 11);
        assert_eq!(course.scans(0.1, 2.0), 0);
        assert!((course.truth(3, 0.6).position_m.y - 0.5).abs() < 1e-12);
        assert!((course.desired(3, 0.6).position_m.y - 0.6).abs() < 1e-12);
    }
}
