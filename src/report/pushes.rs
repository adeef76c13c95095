//! How old poses were when the robot's controller had acknowledged them.

use super::number::{count, fixed};
use super::statistics::percentile;
use crate::record::Pose;

/// A sentence on the pushes that the poses carry (`pushed_ns`); none where they carry none.
pub(super) fn note(poses: &[Pose]) -> Option<String> {
    let ages = poses.iter().filter_map(|pose| {
        let pushed = pose.pushed?;
        Some(pushed.since_s(pose.stamp))
    });
    let mut ages_ms: Vec<f64> = ages.map(|age_s| age_s * 1e3).collect();
    if ages_ms.is_empty() {
        return None;
    }
    ages_ms.sort_by(f64::total_cmp);
    let at = |share| fixed(percentile(&ages_ms, share), 2);
    Some(format!(
        "{} of {} poses were acknowledged by the controller, {} ms after their stamp (median; 99 %: {} \
         ms, longest: {} ms)",
        count(ages_ms.len()),
        count(poses.len()),
        at(50.0),
        at(99.0),
        at(100.0)
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::Stamp;

    #[test]
    fn ages_are_from_the_stamp_to_the_acknowledgement() {
        let pose = |pushed_ns: Option<i64>| Pose {
            stamp: Stamp::from_ns(1_000_000_000),
            pushed: pushed_ns.map(|ns| Stamp::from_ns(1_000_000_000 + ns)),
            ..Pose::default()
        };
        assert_eq!(note(&[pose(None)]), None);
        let poses = [pose(Some(40_000_000)), pose(None), pose(Some(40_000_000))];
        let text = note(&poses).unwrap();
        assert!(text.starts_with("2 of 3 poses were acknowledged"), "{text}");
        assert!(text.contains(" 40.00 ms after their stamp"), "{text}");
    }
}
