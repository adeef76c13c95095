//! Simulated scans for the tests of the rooms that estimate from them.

use super::{Course, Parameters, Scatter, Seed, Setup, Simulator, Step};
use crate::frame::{Frame, ScannerModel};
use crate::record::{Axes, Stamp};
use std::path::Path;

/// The reconstructed frame, with some of its text replaced.
pub(crate) fn frame(replacements: &[(&str, &str)]) -> Frame {
    let text = include_str!("../../testdata/cablar.toml").to_owned();
    let text = replacements.iter().fold(text, |text, (from, to)| {
        assert!(text.contains(from), "{from}");
        text.replacen(from, to, 1)
    });
    Frame::parse(&text, Path::new("frame.toml")).unwrap()
}

/// `count` poses over the workspace (|y| <= 4 m, the given heights, x within 50 mm, angles within
/// 1 degree), one scan each.
pub(crate) fn scattered(
    frame: &Frame,
    effects: &str,
    count: u64,
    z_m: [f64; 2],
    seed: u64,
) -> Vec<Step> {
    scattered_with(frame, effects, &Parameters::default(), count, z_m, seed)
}

/// The same with the effects' sizes given.
pub(crate) fn scattered_with(
    frame: &Frame,
    effects: &str,
    parameters: &Parameters,
    count: u64,
    z_m: [f64; 2],
    seed: u64,
) -> Vec<Step> {
    let tilt = 1f64.to_radians();
    let scatter = Scatter {
        position_m: [[-0.05, 0.05], [-4.0, 4.0], z_m],
        rotation_rad: [[-tilt, tilt]; 3],
    };
    scattered_within(frame, effects, parameters, count, &scatter, seed)
}

/// The same with the poses' limits given.
pub(crate) fn scattered_within(
    frame: &Frame,
    effects: &str,
    parameters: &Parameters,
    count: u64,
    scatter: &Scatter,
    seed: u64,
) -> Vec<Step> {
    let model = ScannerModel::by_name("lms511-hr").unwrap();
    let mut simulator = Simulator::new(Setup {
        frame: frame.clone(),
        model,
        mode: model.modes[0],
        course: Course::Stations {
            poses: scatter.poses(Seed(seed), count).into(),
            scans_each: 1,
        },
        effects: effects.parse().unwrap(),
        parameters: parameters.clone(),
        seed: Seed(seed),
        start: Stamp::from_ns(0),
        scans: Some(count),
        imu_rate_hz: None,
        imu_axes: Axes::Platform,
    });
    let mut steps = Vec::new();
    while let Some(step) = simulator.advance() {
        steps.push(step.clone());
    }
    steps
}
