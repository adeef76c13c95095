//! What became of every scan: solved, solved with a remark, refused and why, lost on the way.

use super::measured::lacking;
use crate::record::{Pose, Status};
use std::collections::BTreeMap;

/// Smallest, mean and largest of a count.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// Smallest.
    pub min: u32,
    /// Mean.
    pub mean: f64,
    /// Largest.
    pub max: u32,
}

/// How many scans ended with one status.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Tally {
    /// The status as text.
    pub status: String,
    /// Whether these scans have a pose.
    pub solved: bool,
    /// How many.
    pub count: usize,
}

/// The account of a run's scans.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scans {
    /// Rows, one a scan.
    pub rows: usize,
    /// Rows with a pose, in whole or in part.
    pub solved: usize,
    /// Of these, rows without one or more of the six components.
    pub partial: usize,
    /// Solved rows without x, y, z, roll, pitch, yaw.
    pub lacking: [usize; 6],
    /// Scans that have no row: gaps in the sequence numbers.
    pub lost: usize,
    /// Rows without a pose whose status does not say so.
    pub unexplained: usize,
    /// Rows by their whole status: every row is in one of these, the most frequent first.
    pub statuses: Vec<Tally>,
    /// Rows by single remark: a row counts for each of its remarks.
    pub words: Vec<(&'static str, usize)>,
    /// Strip edges used, of rows with a pose.
    pub edges: Option<Spread>,
    /// Votes of the winning cell, of rows that have them.
    pub votes: Option<Spread>,
}

impl Scans {
    /// Accounts for `poses`, in order of time.
    pub fn of<'a>(poses: impl Iterator<Item = &'a Pose>) -> Scans {
        let mut scans = Scans::default();
        let mut statuses: BTreeMap<(u32, bool), (Status, usize)> = BTreeMap::new();
        let (mut edges, mut votes) = (Spreading::default(), Spreading::default());
        let mut previous = None;
        for pose in poses {
            let lacking = lacking(pose);
            let solved = lacking.is_some();
            scans.rows += 1;
            scans.solved += usize::from(solved);
            let lacks = lacking.unwrap_or_default();
            scans.partial += usize::from(lacks.contains(&true));
            for (count, lacks) in scans.lacking.iter_mut().zip(lacks) {
                *count += usize::from(lacks);
            }
            scans.unexplained += usize::from(!solved && !pose.status.has(Status::NO_POSE));
            let tally = statuses.entry((pose.status.bits(), solved));
            tally.or_insert((pose.status, 0)).1 += 1;
            if solved {
                edges.add(pose.edges);
            }
            if let Some(n) = pose.votes {
                votes.add(n);
            }
            scans.lost += previous.map_or(0, |p| skipped(p, pose.seq));
            previous = Some(pose.seq);
        }
        for (status, count) in statuses.values() {
            for word in status.names() {
                match scans.words.iter_mut().find(|(name, _)| *name == word) {
                    Some((_, n)) => *n += count,
                    None => scans.words.push((word, *count)),
                }
            }
        }
        scans.statuses = statuses
            .into_iter()
            .map(|((_, solved), (status, count))| Tally {
                status: status.to_string(),
                solved,
                count,
            })
            .collect();
        scans.statuses.sort_by_key(|t| std::cmp::Reverse(t.count));
        scans.edges = edges.spread();
        scans.votes = votes.spread();
        scans
    }

    /// Share of all scans, lost ones included, that have a pose; percent, NaN for no scans.
    pub fn solved_pct(&self) -> f64 {
        100.0 * self.solved as f64 / (self.rows + self.lost) as f64
    }

    /// Rows without a pose.
    pub fn refused(&self) -> usize {
        self.rows - self.solved
    }
}

/// Sequence numbers left out between two rows. A step back is a restart, not a loss.
fn skipped(previous: u32, seq: u32) -> usize {
    let step = seq.wrapping_sub(previous);
    if (2..u32::MAX / 2).contains(&step) {
        step as usize - 1
    } else {
        0
    }
}

#[derive(Default)]
struct Spreading {
    n: u64,
    sum: u64,
    min: Option<u32>,
    max: u32,
}

impl Spreading {
    fn add(&mut self, value: u32) {
        self.n += 1;
        self.sum += u64::from(value);
        self.min = Some(self.min.map_or(value, |m| m.min(value)));
        self.max = self.max.max(value);
    }

    fn spread(&self) -> Option<Spread> {
        self.min.map(|min| Spread {
            min,
            mean: self.sum as f64 / self.n as f64,
            max: self.max,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(seq: u32, x: f64, status: Status) -> Pose {
        Pose {
            seq,
            position_m: [x; 3],
            status,
            edges: 8,
            votes: Some(seq),
            ..Pose::default()
        }
    }

    #[test]
    fn every_scan_is_accounted_for() {
        let rows = [
            pose(10, 0.0, Status::OK),
            pose(11, 0.0, Status::FEW_EDGES | Status::NO_IMU),
            pose(14, f64::NAN, Status::NO_POSE | Status::NO_EDGES),
            pose(15, f64::NAN, Status::OK),
            pose(15, 0.0, Status::OK),
            pose(2, 0.0, Status::OK),
        ];
        let scans = Scans::of(rows.iter());
        assert_eq!(
            (scans.rows, scans.solved, scans.refused(), scans.lost),
            (6, 4, 2, 2)
        );
        assert_eq!(scans.unexplained, 1);
        assert_eq!(scans.solved_pct(), 50.0);
        assert_eq!(
            scans.statuses.iter().map(|t| t.count).sum::<usize>(),
            scans.rows
        );
        assert_eq!(
            (scans.statuses[0].status.as_str(), scans.statuses[0].count),
            ("ok", 3)
        );
        assert!(scans.words.contains(&("few-edges", 1)) && scans.words.contains(&("no-pose", 1)));
        let edges = scans.edges.unwrap();
        assert_eq!((edges.min, edges.mean, edges.max), (8, 8.0, 8));
        assert_eq!(scans.votes.unwrap().max, 15);
    }

    #[test]
    fn a_pose_without_some_components_is_solved_in_part() {
        let rows = [
            pose(1, 0.0, Status::NO_EDGES | Status::NO_YAW),
            pose(2, 0.0, Status::NO_YAW),
            pose(3, f64::NAN, Status::NO_POSE),
        ]
        .map(|pose| Pose {
            rotation_rad: [pose.position_m[0]; 3],
            ..pose
        });
        let scans = Scans::of(rows.iter());
        assert_eq!((scans.solved, scans.partial, scans.refused()), (2, 2, 1));
        assert_eq!(scans.lacking, [1, 0, 0, 0, 0, 2]);
        assert!(scans.statuses.iter().filter(|t| t.solved).count() == 2);
    }

    #[test]
    fn sequence_numbers_wrap() {
        assert_eq!(skipped(u32::MAX, 0), 0);
        assert_eq!(skipped(u32::MAX, 2), 2);
        assert_eq!(skipped(5, 5), 0);
        assert_eq!(skipped(100, 0), 0);
    }
}
