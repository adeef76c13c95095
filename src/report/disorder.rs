//! What is wrong with a run as it was read: rows without numbers, out of order, twice, missing, and
//! stamps that jump.

use crate::record::{Pose, Stamp, Status};

/// Counts over the rows in the order they came in.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Disorder {
    /// Rows with a number missing that their status does not explain.
    pub nan: usize,
    /// Rows that came before an earlier one; sorted in.
    pub unsorted: usize,
    /// Rows at another row's stamp; the first is kept.
    pub repeated: usize,
    /// Places where the stamps are further apart than three usual spacings,
    pub gaps: usize,
    /// and the longest of them, s; 0 for none.
    pub longest_gap_s: f64,
    /// Places where the clock jumps: the stamps go on by another time than the sequence numbers say,
    /// or back while the numbers go on.
    pub jumps: usize,
    /// The largest jump, s, with its sign; 0 for none.
    pub largest_jump_s: f64,
}

/// A spacing beyond this many usual ones is a gap.
const GAP: f64 = 3.0;
/// Stamps that are off the sequence numbers by more than this many usual spacings,
const JUMP: f64 = 2.0;
/// and by more than this, s, are a jump of the clock.
const LEAST_JUMP_S: f64 = 0.1;
/// A step of the sequence number beyond this is a restart.
const RESTART: u32 = 100_000;

impl Disorder {
    /// Counts; `repeated` is known only in order of time and left at 0.
    pub fn of(poses: &[Pose]) -> Disorder {
        let mut spacings: Vec<f64> = steps(poses)
            .map(|(a, b)| b.stamp.since_s(a.stamp))
            .filter(|s| *s > 0.0)
            .collect();
        let usual_s = super::statistics::percentile_of(&mut spacings, 50.0);
        let mut found = Disorder {
            nan: poses.iter().filter(|pose| lacks_a_number(pose)).count(),
            ..Disorder::default()
        };
        // Against the latest so far: one row that comes late is one row out of order.
        let mut latest = Stamp::from_ns(i64::MIN);
        for (a, b) in steps(poses) {
            let spacing_s = b.stamp.since_s(a.stamp);
            latest = latest.max(a.stamp);
            found.unsorted += usize::from(b.stamp < a.stamp);
            if spacing_s > GAP * usual_s && b.stamp > latest {
                found.gaps += 1;
                found.longest_gap_s = found.longest_gap_s.max(spacing_s);
            }
            // Rows without sequence numbers all have the same one.
            let step = b.seq.wrapping_sub(a.seq);
            if (1..RESTART).contains(&step) {
                let off_s = spacing_s - f64::from(step) * usual_s;
                if off_s.abs() > (JUMP * usual_s).max(LEAST_JUMP_S) {
                    found.jumps += 1;
                    if off_s.abs() > found.largest_jump_s.abs() {
                        found.largest_jump_s = off_s;
                    }
                }
            }
        }
        found
    }
}

fn steps(poses: &[Pose]) -> impl Iterator<Item = (&Pose, &Pose)> {
    poses.iter().zip(poses.iter().skip(1))
}

/// Whether a number is missing, or none, and the status does not say why.
fn lacks_a_number(pose: &Pose) -> bool {
    let explained = [
        Status::NO_POSE,
        Status::NO_EDGES,
        Status::NO_YAW,
        Status::NO_WALLS,
        Status::NO_UPPER,
        Status::TOO_FAR,
    ];
    let whole = pose.components().iter().all(|v| v.is_finite());
    !whole && !explained.iter().any(|remark| pose.status.has(*remark))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(n: u32) -> Vec<Pose> {
        (0..n)
            .map(|i| Pose {
                stamp: Stamp::from_ns(i64::from(i) * 20_000_000),
                seq: i,
                position_m: [0.0; 3],
                rotation_rad: [0.0; 3],
                ..Pose::default()
            })
            .collect()
    }

    #[test]
    fn an_orderly_run_has_nothing() {
        assert_eq!(Disorder::of(&rows(100)), Disorder::default());
        assert_eq!(Disorder::of(&[]), Disorder::default());
    }

    #[test]
    fn each_fault_is_counted_as_itself() {
        let mut poses = rows(100);
        poses[10].position_m[1] = f64::NAN;
        poses[11].rotation_rad = [f64::NAN; 3];
        poses[11].status = Status::NO_POSE;
        let found = Disorder::of(&poses);
        assert_eq!((found.nan, found.gaps, found.jumps), (1, 0, 0));
        // Lost scans leave a gap that the sequence numbers explain.
        let mut lost = rows(100);
        lost.drain(40..60);
        let found = Disorder::of(&lost);
        assert_eq!((found.gaps, found.jumps, found.unsorted), (1, 0, 0));
        assert!((found.longest_gap_s - 0.42).abs() < 1e-9);
        // A clock that was set: a step that they do not explain, forward or back.
        for jump_ns in [3_000_000_000i64, -700_000_000] {
            let mut set = rows(100);
            for pose in &mut set[50..] {
                pose.stamp = pose.stamp + jump_ns;
            }
            let found = Disorder::of(&set);
            assert_eq!((found.jumps, found.unsorted), (1, usize::from(jump_ns < 0)));
            assert!(
                (found.largest_jump_s - jump_ns as f64 * 1e-9).abs() < 1e-6,
                "{found:?}"
            );
        }
        // Without sequence numbers a clock that jumps forward is a gap.
        let mut bare = rows(100);
        bare.iter_mut().for_each(|pose| pose.seq = 0);
        bare[50..]
            .iter_mut()
            .for_each(|pose| pose.stamp = pose.stamp + 3_000_000_000);
        let found = Disorder::of(&bare);
        assert_eq!((found.jumps, found.gaps), (0, 1));
    }
}
