//! Poses to take away: as they were compared, in the reference's frame and at their true instants.

use super::case::{Case, Run};
use super::lag;
use crate::record::Pose;

/// A run's whole poses in order of time, aligned as its `case` was, and earlier by the delay that was
/// taken out there. The covariances are left as they are: the formats for other kits hold none.
pub fn placed(run: &Run, case: &Case) -> Vec<Pose> {
    let delay = case.delay.as_ref().filter(|delay| delay.removed);
    let delay_s = delay.map_or(0.0, |delay| delay.delay_s);
    let whole = |pose: &&Pose| pose.components().iter().all(|v| v.is_finite());
    let mut poses: Vec<Pose> = run.poses.iter().filter(whole).cloned().collect();
    poses.sort_by_key(|pose| pose.stamp);
    poses.dedup_by_key(|pose| pose.stamp);
    for pose in &mut poses {
        pose.stamp = lag::earlier(pose.stamp, delay_s);
        if !case.alignment.is_none() {
            case.alignment
                .apply(&mut pose.position_m, &mut pose.rotation_rad);
        }
    }
    poses
}

/// A file's name without its ending for a run: what names may have and file names should not becomes
/// `_`.
pub fn file_name(run: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "-_. ".contains(c);
    let name: String = run
        .chars()
        .map(|c| if plain(c) { c } else { '_' })
        .collect();
    if name.starts_with('.') {
        format!("_{name}")
    } else {
        name
    }
}

#[cfg(test)]
mod tests {
    use super::super::case::tests::{run, truth};
    use super::super::{Align, DelayChoice, Settings, evaluate};
    use super::*;

    #[test]
    fn poses_are_where_they_were_compared() {
        let reference = truth(400);
        let mut moved = run("a", &reference, 400, 0.0);
        for pose in &mut moved.poses {
            pose.position_m[0] += 0.5;
            pose.position_m[2] -= 0.25;
            pose.stamp = pose.stamp + 37_000_000;
        }
        let settings = Settings {
            align: Align::Se2,
            delay: DelayChoice::Given(0.037),
            ..Settings::default()
        };
        let case = &evaluate(vec![moved.clone()], &reference, &settings)[0];
        let placed = placed(&moved, case);
        assert_eq!(placed.len(), 392);
        for pose in &placed {
            let (truth, _) = reference.at(pose.stamp).unwrap();
            for (a, b) in pose.position_m.iter().zip(&truth) {
                assert!((a - b).abs() < 1e-6, "{pose:?} {truth:?}");
            }
        }
        let plain = &evaluate(vec![moved.clone()], &reference, &Settings::default())[0];
        let whole = |pose: &&Pose| pose.is_solved();
        let left: Vec<Pose> = moved.poses.iter().filter(whole).cloned().collect();
        // Missing numbers are not equal to themselves.
        assert_eq!(
            format!("{:?}", super::placed(&moved, plain)),
            format!("{left:?}")
        );
    }

    #[test]
    fn names_are_file_names() {
        assert_eq!(file_name("joint 2"), "joint 2");
        assert_eq!(file_name("a/b:c"), "a_b_c");
        assert_eq!(file_name("../x"), "_.._x");
    }
}
