//! Runs joined to their reference and summed up, zone by zone.

use super::association::Reference;
use super::axis::{AXES, POSITION, ROTATION};
use super::case::{AxisResult, Case, Run, Settings, Track};
use super::consistency::{Consistency, GROUPS, nees};
use super::gathered::{Gathered, Sample};
use super::measured::measured;
use super::notes::notes;
use super::orientation::Seen;
use super::quality::Quality;
use super::relative::{Relative, Step};
use super::scans::Scans;
use super::stability::Stability;
use super::statistics::Statistics;
use super::trace::{Histogram, Trace};
use super::workspace::{Cells, Layout};
use super::zone::Zone;
use crate::record::{Pose, Stamp};

/// Fewer moving poses have no track.
const FEWEST_MOVING: usize = 10;

/// Joins every run to the reference and sums it up in every zone.
pub fn evaluate(runs: Vec<Run>, reference: &Reference, settings: &Settings) -> Vec<Case> {
    let gathered: Vec<Gathered> = runs
        .into_iter()
        .map(|run| Gathered::new(run, reference, settings))
        .collect();
    let places: Vec<[f64; 2]> = gathered
        .iter()
        .flat_map(|g| &g.samples)
        .map(|s| [s.reference[1], s.reference[2]])
        .collect();
    let mut layout = Layout::for_positions(&places, settings.cell_m);
    drop(places);
    if let (Some(layout), Some(count)) = (&mut layout, settings.min_count) {
        layout.few = count.max(1);
    }
    // All traces share one time axis, so that runs can be compared by eye.
    let spans = || gathered.iter().filter_map(Gathered::span);
    let start = spans().map(|s| s.0).min().unwrap_or_default();
    let end = spans().map(|s| s.1).max().unwrap_or_default();
    let view = View {
        settings,
        layout,
        time: (start, end),
    };
    let mut cases = Vec::new();
    for run in &gathered {
        if settings.zones.is_empty() {
            let mut case = view.summarise(run, None);
            case.notes.extend(super::pushes::note(&run.run.poses));
            case.notes.extend(notes(&case, run, reference));
            cases.push(case);
        }
        for zone in &settings.zones {
            let mut case = view.summarise(run, Some(zone));
            case.notes = notes(&case, run, reference);
            cases.push(case);
        }
    }
    if let (Some(asked_m), Some(layout)) = (settings.cell_m, layout)
        && asked_m != layout.size_m[0]
    {
        let got_m = layout.size_m[0];
        let note = format!("cells of {asked_m} m would be too many; they are of {got_m} m");
        cases.iter_mut().for_each(|c| c.notes.push(note.clone()));
    }
    cases
}

impl Case {
    /// A case of nothing, for the names of its statistics.
    pub(super) fn empty() -> Case {
        let settings = Settings::default();
        let gathered = Gathered::new(Run::default(), &Reference::default(), &settings);
        let view = View {
            settings: &settings,
            layout: None,
            time: (Stamp::default(), Stamp::default()),
        };
        view.summarise(&gathered, None)
    }
}

/// What all cases have in common.
struct View<'a> {
    settings: &'a Settings,
    layout: Option<Layout>,
    /// First and last instant of the traces.
    time: (Stamp, Stamp),
}

impl View<'_> {
    fn summarise(&self, run: &Gathered, zone: Option<&Zone>) -> Case {
        let inside = |s: &&Sample| zone.is_none_or(|z| z.contains(&s.reference));
        let samples: Vec<&Sample> = run.samples.iter().filter(inside).collect();
        let chosen = || samples.iter().filter_map(|s| run.pose(s));
        let lines = self.settings.lines.clone().filter(|_| zone.is_none());
        let (scans, quality) = match zone {
            None => (
                Scans::of(run.run.poses.iter()),
                Quality::of(run.run.poses.iter(), self.time, lines),
            ),
            Some(_) => (
                Scans {
                    // A scan that has no row has no place either, and leaving a zone is no loss.
                    lost: 0,
                    ..Scans::of(chosen())
                },
                Quality::of(chosen(), self.time, lines),
            ),
        };
        let steps = self.steps(run, &samples);
        let relative = self.settings.relative.iter();
        let relative = relative.map(|delta| Relative::of(delta, self.settings.pairs, &steps));
        let relative = relative.collect();
        drop(steps);
        Case {
            run: run.run.name.clone(),
            zone: zone.map(|z| z.name.clone()),
            source: run.run.source.clone(),
            stages: run.run.stages.clone(),
            span: run.span(),
            matching: run.matching,
            scans,
            input: run.disorder,
            alignment: run.alignment.clone(),
            delay: run.delay.clone(),
            axes: (0..AXES.len())
                .map(|i| self.axis(run, &samples, i))
                .collect(),
            relative,
            track: self.track(run, &samples),
            orientation: self.orientation(run, &samples),
            quality,
            stability: stability(run, &samples),
            groups: (0..GROUPS.len()).map(|k| group(run, &samples, k)).collect(),
            cells: self.cells(run, &samples),
            notes: Vec::new(),
        }
    }

    /// The whole poses, for relative errors; none where none are asked for.
    fn steps<'a>(&self, run: &Gathered, samples: &[&'a Sample]) -> Vec<Step<'a>> {
        if self.settings.relative.is_empty() {
            return Vec::new();
        }
        let whole = samples
            .iter()
            .filter(|s| s.error.iter().all(|e| e.is_finite()));
        let step = |s: &&'a Sample| {
            Some(Step {
                stamp: run.pose(s)?.stamp,
                reference: &s.reference,
                error: &s.error,
            })
        };
        whole.filter_map(step).collect()
    }

    fn axis(&self, run: &Gathered, samples: &[&Sample], index: usize) -> AxisResult {
        let error = |s: &Sample| match index {
            POSITION => s.distance_m(),
            ROTATION => s.turned_rad,
            _ => s.error.get(index).copied().unwrap_or(f64::NAN),
        };
        let sigma = |pose: &Pose| {
            let variance = Some(index)
                .filter(|i| *i < POSITION)
                .map(|i| pose.cov(i, i));
            let usable = variance.filter(|v| *v > 0.0 && v.is_finite());
            usable.map_or(f64::NAN, f64::sqrt)
        };
        let values = samples.iter().filter_map(|s| {
            let pose = run.pose(s)?;
            Some((pose.stamp, error(s), sigma(pose)))
        });
        let mut result = self.result(values);
        if index >= POSITION {
            result.consistency.left_out = 0;
        }
        result
    }

    /// Errors (stamp, error, its sigma, NaN where unknown) summed up; those that are no number are
    /// not there.
    fn result(&self, values: impl Iterator<Item = (Stamp, f64, f64)>) -> AxisResult {
        let mut errors = Vec::with_capacity(values.size_hint().1.unwrap_or(0));
        let mut squares = Vec::new();
        let mut within = [0usize; 3];
        let mut trace = Trace::new(self.time.0, self.time.1);
        for (stamp, e, sigma) in values.filter(|(_, e, _)| e.is_finite()) {
            if sigma.is_finite() {
                squares.push((e / sigma).powi(2));
                for (k, count) in within.iter_mut().enumerate() {
                    *count += usize::from(e.abs() <= (k + 1) as f64 * sigma);
                }
            }
            trace.add(stamp, e, sigma);
            errors.push(e);
        }
        let mut changed = errors.clone();
        let statistics = Statistics::of(&mut changed);
        drop(changed);
        let limit = super::scale::above(statistics.max.min(1.5 * statistics.p99));
        AxisResult {
            statistics,
            consistency: Consistency {
                left_out: errors.len() - squares.len(),
                ..Consistency::of(&squares, 1)
            },
            within: within.map(|count| count as f64 / squares.len() as f64),
            histogram: Histogram::of(&errors, limit),
            trace,
        }
    }

    fn track(&self, run: &Gathered, samples: &[&Sample]) -> Option<Track> {
        let moving = || {
            samples.iter().filter_map(|s| {
                let (along, cross) = s.along_and_cross_m()?;
                Some((run.pose(s)?.stamp, along, cross))
            })
        };
        if moving().take(FEWEST_MOVING).count() < FEWEST_MOVING {
            return None;
        }
        Some(Track {
            along: self.result(moving().map(|(stamp, along, _)| (stamp, along, f64::NAN))),
            cross: self.result(moving().map(|(stamp, _, cross)| (stamp, cross, f64::NAN))),
        })
    }

    fn orientation(
        &self,
        run: &Gathered,
        samples: &[&Sample],
    ) -> Option<super::orientation::Orientation> {
        let imu = self.settings.imu.as_ref()?;
        let seen = samples.iter().filter_map(|s| {
            let pose = run.pose(s)?;
            let [.., roll, pitch, yaw] = measured(pose);
            Some(Seen {
                stamp: pose.stamp,
                angles_rad: [roll, pitch, yaw],
            })
        });
        imu.compare(&seen.collect::<Vec<_>>(), self.time)
    }

    fn cells(&self, run: &Gathered, samples: &[&Sample]) -> Option<Cells> {
        let mut cells = Cells::new(self.layout?);
        for s in samples {
            if let Some(pose) = run.pose(s)
                && s.error.iter().any(|e| e.is_finite())
            {
                let place = [s.reference[1], s.reference[2]];
                cells.add(place, &s.error, pose.edges, pose.votes);
            }
        }
        Some(cells)
    }
}

fn stability(run: &Gathered, samples: &[&Sample]) -> Option<Stability> {
    let poses = samples.iter().filter_map(|s| {
        let pose = run.pose(s)?;
        Some((pose.stamp, measured(pose), s.reference))
    });
    // Most runs move, and are seen to by a few of their poses.
    let some: Vec<_> = poses.clone().step_by(samples.len() / 32 + 1).collect();
    let stands = |(_, _, reference): &(Stamp, [f64; 6], [f64; 6])| {
        some.first()
            .is_some_and(|first| super::stability::is_still(&first.2, reference))
    };
    if !some.iter().all(stands) {
        return None;
    }
    Stability::of(&poses.collect::<Vec<_>>())
}

fn group(run: &Gathered, samples: &[&Sample], group: usize) -> Consistency {
    let state = GROUPS.get(group).map_or(&[][..], |(_, state)| state);
    let measured = |s: &&&Sample| state.iter().all(|i| s.error[*i].is_finite());
    let samples = samples.iter().filter(measured);
    let squares: Vec<f64> = samples
        .clone()
        .filter_map(|s| nees(run.pose(s)?, &s.error, group))
        .collect();
    Consistency {
        left_out: samples.count() - squares.len(),
        ..Consistency::of(&squares, state.len())
    }
}
