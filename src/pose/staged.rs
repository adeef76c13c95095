//! Simulated scans as the estimators get them, for their tests.

use super::pitch::Pitch;
use crate::edges::EdgeMeter;
use crate::frame::Frame;
use crate::lines::reflectors::{self, ReflectorFit};
use crate::record::{Pose, ReflectorLines};
use crate::simulate::Step;

/// Lines and edges of one scan after the other, seen with `frame`.
pub(super) fn all_lines(frame: &Frame, steps: &[Step]) -> Vec<ReflectorLines> {
    let mut fit = ReflectorFit::new(frame, reflectors::Options::default());
    let mut edges = EdgeMeter::new(frame);
    let lines = |step: &Step| {
        let mut lines = ReflectorLines::default();
        lines.begin(&step.scan);
        let found = fit.fit(&step.scan).expect("three lines");
        fit.record(&found, &mut lines);
        edges.measure(&step.scan, &mut lines);
        lines
    };
    steps.iter().map(lines).collect()
}

/// Lines and edges of one scan by itself.
pub(super) fn lines_of(frame: &Frame, step: &Step) -> ReflectorLines {
    all_lines(frame, std::slice::from_ref(step)).remove(0)
}

/// The true pitch, known exactly.
pub(super) fn known(step: &Step) -> Option<Pitch> {
    Some(Pitch::exact(step.truth.rotation_rad[1]))
}

/// The true x, y, z (m), roll, pitch, yaw (rad).
pub(super) fn truth(step: &Step) -> [f64; 6] {
    let ([x, y, z], [roll, pitch, yaw]) = (step.truth.position_m, step.truth.rotation_rad);
    [x, y, z, roll, pitch, yaw]
}

/// By how much a pose is off.
pub(super) fn errors(step: &Step, pose: &Pose) -> [f64; 6] {
    let truth = truth(step);
    std::array::from_fn(|k| pose.components()[k] - truth[k])
}
