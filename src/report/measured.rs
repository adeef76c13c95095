//! What a pose claims to have measured.

use crate::record::{POSE_STATE, Pose, Status};

/// Which components a remark disowns, by the meaning of the remark: a number that is there
/// nevertheless (a prior's, another program's) is no measurement.
const DISOWNED: [(Status, &[usize]); 4] = [
    (Status::NO_POSE, &[0, 1, 2, 3, 4, 5]),
    (Status::NO_WALLS, &[1]),
    (Status::NO_EDGES, &[0, 5]),
    (Status::NO_YAW, &[5]),
];

/// The components in the order of [`POSE_STATE`], m and rad; NaN where the pose has no number or
/// its status disowns it.
pub(super) fn measured(pose: &Pose) -> [f64; 6] {
    let mut components = pose.components();
    for (remark, disowned) in DISOWNED {
        for (i, component) in components.iter_mut().enumerate() {
            if pose.status.has(remark) && disowned.contains(&i) {
                *component = f64::NAN;
            }
        }
    }
    components
}

/// Which components of a pose lack a measurement; none for a pose without any: that is a refused
/// scan, not a solved one with a remark.
pub(super) fn lacking(pose: &Pose) -> Option<[bool; 6]> {
    let lacking = measured(pose).map(|component| !component.is_finite());
    (!lacking.iter().all(|lacks| *lacks)).then_some(lacking)
}

/// "x 12, yaw 12": the components with a count, by name.
pub(super) fn counts_by_name(counts: &[usize; POSE_STATE.len()]) -> String {
    let named = POSE_STATE.iter().zip(counts).filter(|(_, n)| **n > 0);
    let named = named.map(|(name, n)| format!("{name} {}", super::number::count(*n)));
    named.collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(status: Status) -> Pose {
        Pose {
            position_m: [1.0; 3],
            rotation_rad: [0.1; 3],
            status,
            ..Pose::default()
        }
    }

    #[test]
    fn a_status_disowns_what_it_says_is_not_known() {
        for (status, missing) in [
            (Status::OK, &[][..]),
            (Status::FEW_EDGES | Status::NO_IMU | Status::ONE_WALL, &[]),
            (Status::NO_EDGES, &[0, 5]),
            (Status::NO_YAW | Status::FEW_EDGES, &[5]),
            (Status::NO_WALLS, &[1]),
            (Status::NO_WALLS | Status::NO_EDGES, &[0, 1, 5]),
        ] {
            let lacking = lacking(&pose(status)).unwrap();
            let got: Vec<usize> = (0..6).filter(|i| lacking[*i]).collect();
            assert_eq!(got, missing, "{status}");
        }
        assert_eq!(lacking(&pose(Status::NO_POSE)), None);
        assert_eq!(lacking(&Pose::default()), None);
    }

    #[test]
    fn an_empty_number_is_lacking_whatever_the_status() {
        let mut pose = pose(Status::OK);
        pose.rotation_rad[2] = f64::NAN;
        assert_eq!(
            lacking(&pose),
            Some([false, false, false, false, false, true])
        );
    }
}
