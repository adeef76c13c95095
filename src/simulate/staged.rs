//! Simulated scans for the tests of the rooms that estimate from them.

use super::{Course, Parameters, Scatter, Seed, Setup, Simulator, Step};
use crate::frame::Frame;
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
    let scatter = Scatter::workspace(z_m);
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
    let course = Course::scattered(*scatter, Seed(seed), count);
    let setup = Setup {
        effects: effects.parse().unwrap(),
        parameters: parameters.clone(),
        seed: Seed(seed),
        ..Setup::new(frame.clone(), course)
    };
    Simulator::new(setup).all()
}
