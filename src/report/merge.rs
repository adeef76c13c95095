//! The parts of a run, put together: a run that was split over processes or machines is one again.

use super::case::Run;
use super::origin;

/// Joins runs of the same name to one, in the order in which their names first come. Parts go in the
/// order of their first pose, whatever the order they are given in.
pub fn merge(parts: Vec<Run>) -> Vec<Run> {
    let mut names: Vec<String> = Vec::new();
    for part in &parts {
        if !names.contains(&part.name) {
            names.push(part.name.clone());
        }
    }
    let mut rest = parts;
    names
        .into_iter()
        .map(|name| {
            let (mut own, others): (Vec<Run>, Vec<Run>) = std::mem::take(&mut rest)
                .into_iter()
                .partition(|p| p.name == name);
            rest = others;
            // The order of the files is for people, that of time for the poses.
            let source = origin::input_names(own.iter().map(|part| part.source.clone()));
            own.sort_by_key(|part| part.poses.first().map(|pose| pose.stamp));
            let mut whole = Run {
                name,
                source,
                ..Run::default()
            };
            for part in own {
                whole.poses.extend(part.poses);
                // Parts are made by the same stages, but for the one that says which part it is.
                for stage in part.stages {
                    if !whole.stages.contains(&stage) {
                        whole.stages.push(stage);
                    }
                }
            }
            whole
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::case::tests::{run, truth};
    use super::super::{Settings, evaluate};
    use super::*;

    #[test]
    fn parts_make_the_whole_in_any_order() {
        let reference = truth(300);
        let whole = run("a", &reference, 300, 1.0);
        let cut = |from: usize, to: usize| Run {
            poses: whole.poses[from..to].to_vec(),
            ..whole.clone()
        };
        let other = run("b", &reference, 300, 2.0);
        let merged = merge(vec![cut(200, 300), other.clone(), cut(0, 90), cut(90, 200)]);
        assert_eq!(merged.len(), 2);
        assert_eq!(merged[0].source, "3 files, a.csv");
        let cases = |runs| evaluate(runs, &reference, &Settings::default());
        let apart = cases(vec![whole, other]);
        let mut together = cases(merged);
        together[0].source.clone_from(&apart[0].source);
        // Missing numbers are not equal to themselves.
        assert_eq!(format!("{together:?}"), format!("{apart:?}"));
    }
}
