//! Where the platform is in each scan: at rest in one pose after another, or moving.

use super::random::{Purpose, Seed};
use crate::motion::{Motion, Pose, State};
use nalgebra::Vector3;

/// A motion along which several threads make scans.
pub type SharedMotion = Box<dyn Motion + Send + Sync>;

/// The platform's course over a run.
pub enum Course {
    /// At rest, a fixed number of scans in each pose; between poses it jumps.
    Stations {
        /// In order.
        poses: Places,
        /// Scans in each.
        scans_each: u64,
    },
    /// In motion.
    Moving {
        /// The true motion.
        truth: SharedMotion,
        /// The motion that was asked for.
        desired: SharedMotion,
        /// The platform follows the desired motion this much later, s.
        lag_s: f64,
    },
}

impl Course {
    /// At rest in poses drawn from a seed, a scan in each.
    pub fn scattered(scatter: Scatter, seed: Seed, count: u64) -> Course {
        Course::Stations {
            poses: Places::Scattered {
                scatter,
                seed,
                count,
            },
            scans_each: 1,
        }
    }

    /// In motion, exactly as it was asked for.
    pub fn along(motion: impl Motion + Clone + Send + Sync + 'static) -> Course {
        Course::Moving {
            truth: Box::new(motion.clone()),
            desired: Box::new(motion),
            lag_s: 0.0,
        }
    }

    /// How many scans fit into it, one every `period_s` and each lasting `sweep_s`.
    pub fn scans(&self, period_s: f64, sweep_s: f64) -> u64 {
        match self {
            Course::Stations { poses, scans_each } => poses.count() * scans_each,
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
        // Past its end the course stays in the last pose.
        let last = poses.count().saturating_sub(1);
        let index = (number / (*scans_each).max(1)).min(last);
        State::resting(poses.pose(index).unwrap_or(ORIGIN))
    }
}

const ORIGIN: Pose = Pose::level(0.0, 0.0, 0.0);

/// Poses in an order: listed, or made when they are asked for, so that a long run takes no more
/// memory than a short one.
#[derive(Clone, Debug, PartialEq)]
pub enum Places {
    /// These.
    Listed(Vec<Pose>),
    /// A grid's.
    Grid(Grid),
    /// A number of random ones.
    Scattered {
        /// Where.
        scatter: Scatter,
        /// The run's seed.
        seed: Seed,
        /// How many.
        count: u64,
    },
}

impl Places {
    /// How many.
    pub fn count(&self) -> u64 {
        match self {
            Places::Listed(poses) => poses.len() as u64,
            Places::Grid(grid) => grid.count(),
            Places::Scattered { count, .. } => *count,
        }
    }

    /// One of them; none past the end.
    pub fn pose(&self, index: u64) -> Option<Pose> {
        if index >= self.count() {
            return None;
        }
        Some(match self {
            Places::Listed(poses) => *poses.get(usize::try_from(index).ok()?)?,
            Places::Grid(grid) => grid.pose(index),
            Places::Scattered { scatter, seed, .. } => scatter.pose(*seed, index),
        })
    }
}

impl From<Vec<Pose>> for Places {
    fn from(poses: Vec<Pose>) -> Places {
        Places::Listed(poses)
    }
}

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
    fn steps(&self, [from, to]: [f64; 2]) -> u64 {
        ((to - from) / self.step_m + 1e-9).floor().max(0.0) as u64
    }

    /// Number of poses in a row, which runs along y.
    pub fn row(&self) -> u64 {
        self.steps(self.y_m) + 1
    }

    /// Number of poses.
    pub fn count(&self) -> u64 {
        self.row().saturating_mul(self.steps(self.z_m) + 1)
    }

    /// Pose `index`, row after row from the bottom, there and back along y, so that neighbours in
    /// time are neighbours in space.
    pub fn pose(&self, index: u64) -> Pose {
        let (row, place) = (index / self.row(), index % self.row());
        let column = if row.is_multiple_of(2) {
            place
        } else {
            self.row() - 1 - place
        };
        let y = self.y_m[0] + column as f64 * self.step_m;
        let z = self.z_m[0] + row as f64 * self.step_m;
        Pose {
            position_m: Vector3::new(self.pose.position_m.x, y, z),
            rotation_rad: self.pose.rotation_rad,
        }
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
    /// Where the estimators' figures are stated: x within 50 mm, y within 4 m, heights from and to,
    /// angles within a degree.
    pub fn workspace(z_m: [f64; 2]) -> Scatter {
        let tilt_rad = 1f64.to_radians();
        Scatter {
            position_m: [[-0.05, 0.05], [-4.0, 4.0], z_m],
            rotation_rad: [[-tilt_rad, tilt_rad]; 3],
        }
    }

    /// Pose `index` of a seed.
    pub fn pose(&self, seed: Seed, index: u64) -> Pose {
        let mut draws = seed.draws(Purpose::Course, index);
        Pose {
            position_m: self.position_m.map(|span| draws.between(span)).into(),
            rotation_rad: self.rotation_rad.map(|span| draws.between(span)).into(),
        }
    }

    /// The first `count` poses.
    pub fn poses(&self, seed: Seed, count: u64) -> Vec<Pose> {
        (0..count).map(|index| self.pose(seed, index)).collect()
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
        let poses: Vec<Pose> = (0..grid.count()).map(|k| grid.pose(k)).collect();
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
