use super::*;
use crate::edges::EdgeMeter;
use crate::lines::reflectors::{self, ReflectorFit};
use crate::simulate::staged;

/// Lines and edges of a simulated run, seen with `frame`.
fn seen(frame: &Frame, steps: &[crate::simulate::Step]) -> Vec<(ReflectorLines, [f64; 6])> {
    let mut fit = ReflectorFit::new(frame, reflectors::Options::default());
    let mut edges = EdgeMeter::new(frame);
    let mut out = Vec::new();
    for step in steps {
        let mut lines = ReflectorLines::default();
        lines.begin(&step.scan);
        if let Some(found) = fit.fit(&step.scan) {
            fit.record(&found, &mut lines);
            edges.measure(&step.scan, &mut lines);
            let t = &step.truth;
            let [r, p, y] = t.rotation_rad;
            let [a, b, c] = t.position_m;
            out.push((lines, [a, b, c, r, p, y]));
        }
    }
    out
}
