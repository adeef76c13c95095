//! Runs joined to their reference, summed up case by case.

use super::association::{Matching, Reference};
use super::axis::{AXES, POSITION};
use super::consistency::{Consistency, GROUPS, nees};
use super::gate::Verdict;
use super::inertial::Inertial;
use super::measured::{counts_by_name, lacking, measured};
use super::number;
use super::scans::Scans;
use super::statistics::{Statistics, wrap_angle};
use super::trace::{Histogram, Trace};
use super::workspace::{Cells, Layout};
use super::zone::Zone;
use crate::record::{Pose, Stamp};

/// A run as it was read.
#[derive(Clone, Debug, Default)]
pub struct Run {
    /// What people call it.
    pub name: String,
    /// Where it came from: a file's name without its folder, or `standard input`.
    pub source: String,
    /// One pose a scan, in any order.
    pub poses: Vec<Pose>,
    /// Command lines of the stages that made it, if the stream says so.
    pub stages: Vec<String>,
}

/// What to sum up.
#[derive(Clone, Debug, Default)]
pub struct Settings {
    /// Zones to score apart; none is the whole workspace.
    pub zones: Vec<Zone>,
    /// Size of the workspace's cells, m; chosen from the data if none.
    pub cell_m: Option<f64>,
}

/// One component's errors.
#[derive(Clone, Debug, PartialEq)]
pub struct AxisResult {
    /// Statistics, m or rad.
    pub statistics: Statistics,
    /// e^2 over its variance; not for the position's distance.
    pub consistency: Consistency,
    /// Share of the errors within 1, 2 and 3 of the solver's sigmas; NaN where none are known.
    pub within: [f64; 3],
    /// Over time.
    pub trace: Trace,
    /// By size.
    pub histogram: Histogram,
}

/// One run in one zone, summed up: all that the outputs show.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// The run's name.
    pub run: String,
    /// The zone's name; none is the whole workspace.
    pub zone: Option<String>,
    /// The run's source.
    pub source: String,
    /// The run's stages.
    pub stages: Vec<String>,
    /// First and last stamp of the run.
    pub span: Option<(Stamp, Stamp)>,
    /// How the solved poses found their reference.
    pub matching: Matching,
    /// What became of the scans.
    pub scans: Scans,
    /// Rows that came before an earlier one; sorted in.
    pub unsorted: usize,
    /// Rows at another row's stamp; the first is kept.
    pub repeated: usize,
    /// In the order of [`AXES`].
    pub axes: Vec<AxisResult>,
    /// In the order of [`GROUPS`].
    pub groups: Vec<Consistency>,
    /// By place; none without a matched pose.
    pub cells: Option<Cells>,
    /// What a reader should know, in plain sentences.
    pub notes: Vec<String>,
}

impl Case {
    /// `run`, or `run in zone`.
    pub fn name(&self) -> String {
        match &self.zone {
            Some(zone) => format!("{} in {zone}", self.run),
            None => self.run.clone(),
        }
    }

    /// Whether there is nothing that could be compared.
    pub fn is_empty(&self) -> bool {
        self.axes.iter().all(|axis| axis.statistics.n == 0)
    }

    /// Seconds from the first to the last stamp.
    pub fn duration_s(&self) -> f64 {
        self.span
            .map_or(f64::NAN, |(first, last)| last.since_s(first))
    }

    /// Rows per second; NaN for less than two.
    pub fn rate_hz(&self) -> f64 {
        if self.scans.rows < 2 {
            return f64::NAN;
        }
        (self.scans.rows - 1) as f64 / self.duration_s()
    }

    /// A case of nothing, for the names of its statistics.
    pub(super) fn empty() -> Case {
        let gathered = Gathered::new(Run::default(), &Reference::default());
        summarise(&gathered, None, None, (Stamp::default(), Stamp::default()))
    }
}

/// Everything the outputs need.
#[derive(Clone, Debug)]
pub struct Report {
    /// Title of the page.
    pub title: String,
    /// What the poses are compared with: `truth` or `desired`.
    pub role: &'static str,
    /// Where the reference came from, without its folder.
    pub reference_source: String,
    /// The reference, for its counts and limits.
    pub reference: Reference,
    /// Runs and zones, side by side.
    pub cases: Vec<Case>,
    /// A record of the IMU at rest, if there is one.
    pub inertial: Option<Inertial>,
    /// The gates' verdicts.
    pub verdicts: Vec<Verdict>,
    /// The report's own command line, file names without folders.
    pub command: String,
    /// A date to show, if one was asked for.
    pub date: Option<String>,
}

impl Report {
    /// What was left out or could not be compared, in plain sentences; empty if all is well.
    pub fn losses(&self) -> Vec<String> {
        let mut losses = Vec::new();
        for (count, what) in [
            (self.reference.incomplete, "without all six numbers"),
            (self.reference.repeated, "at the stamp of another"),
        ] {
            if count > 0 {
                let (source, count) = (&self.reference_source, number::count(count));
                losses.push(format!("{source}: points {what}: {count} left out"));
            }
        }
        for case in self.cases.iter().filter(|c| c.repeated > 0) {
            let count = number::count(case.repeated);
            losses.push(format!(
                "{}: rows at the stamp of another: {count} left out",
                case.name()
            ));
        }
        if let Some(inertial) = self.inertial.as_ref().filter(|i| i.channels.is_empty()) {
            let why = inertial.notes.first().cloned().unwrap_or_default();
            losses.push(format!("{}: {why}", inertial.source));
        }
        for case in self.cases.iter().filter(|c| c.is_empty()) {
            let why = case.notes.last().cloned().unwrap_or_default();
            losses.push(format!("{}: {why}", case.name()));
        }
        losses
    }
}

/// A pose with its reference.
struct Sample {
    /// Index into the run's poses.
    pose: u32,
    reference: [f64; 6],
    /// Measured minus reference; NaN where not measured.
    error: [f64; 6],
}

/// A run in order of time, joined to the reference.
struct Gathered {
    run: Run,
    samples: Vec<Sample>,
    matching: Matching,
    unsorted: usize,
    repeated: usize,
}

impl Gathered {
    fn new(mut run: Run, reference: &Reference) -> Gathered {
        let poses = &mut run.poses;
        let unsorted = poses
            .windows(2)
            .filter(|w| matches!(w, [a, b] if b.stamp < a.stamp))
            .count();
        if unsorted > 0 {
            poses.sort_by_key(|p| p.stamp);
        }
        let rows = poses.len();
        poses.dedup_by_key(|p| p.stamp);
        let repeated = rows - poses.len();
        let mut matching = Matching::default();
        let mut samples = Vec::new();
        for (index, pose) in poses.iter().enumerate() {
            let found = reference.at(pose.stamp);
            if lacking(pose).is_some() {
                matching.add(&found);
            }
            if let Ok((truth, _)) = found {
                samples.push(Sample {
                    pose: index as u32,
                    reference: truth,
                    error: error(&measured(pose), &truth),
                });
            }
        }
        Gathered {
            run,
            samples,
            matching,
            unsorted,
            repeated,
        }
    }

    fn pose(&self, sample: &Sample) -> Option<&Pose> {
        self.run.poses.get(sample.pose as usize)
    }

    fn span(&self) -> Option<(Stamp, Stamp)> {
        let poses = &self.run.poses;
        Some((poses.first()?.stamp, poses.last()?.stamp))
    }
}

fn error(measured: &[f64; 6], truth: &[f64; 6]) -> [f64; 6] {
    let mut error = [0.0; 6];
    for (i, e) in error.iter_mut().enumerate() {
        let difference = measured[i] - truth[i];
        *e = if i < 3 {
            difference
        } else {
            wrap_angle(difference)
        };
    }
    error
}

/// Joins every run to the reference and sums it up in every zone.
pub fn evaluate(runs: Vec<Run>, reference: &Reference, settings: &Settings) -> Vec<Case> {
    let gathered: Vec<Gathered> = runs
        .into_iter()
        .map(|run| Gathered::new(run, reference))
        .collect();
    let places: Vec<[f64; 2]> = gathered
        .iter()
        .flat_map(|g| &g.samples)
        .map(|s| [s.reference[1], s.reference[2]])
        .collect();
    let layout = Layout::for_positions(&places, settings.cell_m);
    drop(places);
    // All traces share one time axis, so that runs can be compared by eye.
    let spans = || gathered.iter().filter_map(Gathered::span);
    let start = spans().map(|s| s.0).min().unwrap_or_default();
    let end = spans().map(|s| s.1).max().unwrap_or_default();
    let mut cases = Vec::new();
    for run in &gathered {
        if settings.zones.is_empty() {
            let mut case = summarise(run, None, layout, (start, end));
            case.notes.extend(super::pushes::note(&run.run.poses));
            case.notes.extend(notes(&case, reference));
            cases.push(case);
        }
        for zone in &settings.zones {
            let mut case = summarise(run, Some(zone), layout, (start, end));
            case.notes = notes(&case, reference);
            cases.push(case);
        }
    }
    cases
}

fn summarise(
    run: &Gathered,
    zone: Option<&Zone>,
    layout: Option<Layout>,
    time: (Stamp, Stamp),
) -> Case {
    let inside = |s: &&Sample| zone.is_none_or(|z| z.contains(&s.reference));
    let samples: Vec<&Sample> = run.samples.iter().filter(inside).collect();
    let mut scans = match zone {
        None => Scans::of(run.run.poses.iter()),
        Some(_) => Scans::of(samples.iter().filter_map(|s| run.pose(s))),
    };
    if zone.is_some() {
        // A scan that has no row has no place either, and leaving a zone is no loss.
        scans.lost = 0;
    }
    let mut cells = layout.map(Cells::new);
    if let Some(cells) = &mut cells {
        for s in &samples {
            if s.error.iter().any(|e| e.is_finite()) {
                cells.add([s.reference[1], s.reference[2]], &s.error);
            }
        }
    }
    Case {
        run: run.run.name.clone(),
        zone: zone.map(|z| z.name.clone()),
        source: run.run.source.clone(),
        stages: run.run.stages.clone(),
        span: run.span(),
        matching: run.matching,
        scans,
        unsorted: run.unsorted,
        repeated: run.repeated,
        axes: (0..AXES.len())
            .map(|i| axis(run, &samples, i, time))
            .collect(),
        groups: (0..GROUPS.len()).map(|k| group(run, &samples, k)).collect(),
        cells,
        notes: Vec::new(),
    }
}

fn axis(run: &Gathered, samples: &[&Sample], index: usize, time: (Stamp, Stamp)) -> AxisResult {
    let mut errors = Vec::with_capacity(samples.len());
    let mut squares = Vec::new();
    let mut within = [0usize; 3];
    let mut trace = Trace::new(time.0, time.1);
    for sample in samples {
        let [x, y, z, ..] = sample.error;
        let e = match sample.error.get(index) {
            Some(e) => *e,
            None => (x * x + y * y + z * z).sqrt(),
        };
        let Some(pose) = run.pose(sample).filter(|_| e.is_finite()) else {
            continue;
        };
        let sigma = if index < POSITION {
            Some(pose.cov(index, index)).filter(|v| *v > 0.0 && v.is_finite())
        } else {
            None
        };
        let sigma = sigma.map_or(f64::NAN, f64::sqrt);
        if sigma.is_finite() {
            squares.push((e / sigma).powi(2));
            for (k, count) in within.iter_mut().enumerate() {
                *count += usize::from(e.abs() <= (k + 1) as f64 * sigma);
            }
        }
        trace.add(pose.stamp, e, sigma);
        errors.push(e);
    }
    let mut sorted = errors.clone();
    let statistics = Statistics::of(&mut sorted);
    drop(sorted);
    let limit = super::scale::above(statistics.max.min(1.5 * statistics.p99));
    AxisResult {
        statistics,
        consistency: Consistency {
            left_out: if index < POSITION {
                errors.len() - squares.len()
            } else {
                0
            },
            ..Consistency::of(&squares, 1)
        },
        within: within.map(|count| count as f64 / squares.len() as f64),
        histogram: Histogram::of(&errors, limit),
        trace,
    }
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

/// What a reader of the figures should know.
fn notes(case: &Case, reference: &Reference) -> Vec<String> {
    let mut notes = Vec::new();
    let mut note = |count: usize, one: &str, many: &str| {
        if count > 0 {
            let what = if count == 1 { one } else { many };
            notes.push(format!("{} {what}", number::count(count)));
        }
    };
    let (scans, matching) = (&case.scans, &case.matching);
    note(
        case.unsorted,
        "row is out of order in time; it was sorted in",
        "rows are out of order in time; they were sorted in",
    );
    note(
        case.repeated,
        "row has the stamp of another; it was left out",
        "rows have the stamp of another; they were left out",
    );
    note(
        scans.unexplained,
        "row has no numbers and no status that says why",
        "rows have no numbers and no status that says why",
    );
    note(
        scans.lost,
        "scan has no row: the sequence numbers skip it",
        "scans have no row: the sequence numbers skip them",
    );
    note(
        matching.outside,
        "pose is outside the reference's time",
        "poses are outside the reference's time",
    );
    note(
        matching.gap,
        "pose falls into a gap of the reference",
        "poses fall into gaps of the reference",
    );
    note(
        matching.jump,
        "pose falls between two reference points that the platform cannot have moved between",
        "poses fall between reference points that the platform cannot have moved between",
    );
    if scans.partial > 0 {
        notes.push(format!(
            "{} of {} solved poses lack a component and do not count for it (only for the others): {}",
            number::count(scans.partial),
            number::count(scans.solved),
            counts_by_name(&scans.lacking)
        ));
    }
    notes.extend(left_out_of_nees(case));
    if case.is_empty() {
        notes.push(nothing_to_compare(case, reference));
    }
    notes
}

/// How many measured poses the consistency leaves out because their covariance cannot be used.
fn left_out_of_nees(case: &Case) -> Option<String> {
    let singles = AXES.iter().zip(&case.axes);
    let singles = singles.map(|(axis, result)| (axis.name, &result.consistency));
    let groups = GROUPS.iter().zip(&case.groups);
    let groups = groups.map(|((name, _), consistency)| (*name, consistency));
    let named: Vec<String> = singles
        .chain(groups)
        .filter(|(_, consistency)| consistency.left_out > 0)
        .map(|(name, c)| format!("{name} {}", number::count(c.left_out)))
        .collect();
    (!named.is_empty()).then(|| {
        format!(
            "poses whose variance is missing or not positive are left out of the NEES: {}",
            named.join(", ")
        )
    })
}

/// Why no pose could be compared.
fn nothing_to_compare(case: &Case, reference: &Reference) -> String {
    let why = if case.scans.rows == 0 && case.zone.is_none() {
        "there are no poses".to_owned()
    } else if case.scans.rows == 0 {
        "no pose is in the zone".to_owned()
    } else if case.scans.solved == 0 {
        "no scan has a pose".to_owned()
    } else {
        match (case.span, reference.span()) {
            (_, None) => "the reference has no points".to_owned(),
            (Some((first, last)), Some((from, to))) if last < from || first > to => format!(
                "the poses ({first} to {last} ns) and the reference ({from} to {to} ns) do not \
                 overlap in time"
            ),
            _ => "no pose has a reference close enough in time".to_owned(),
        }
    };
    format!("nothing to compare: {why}")
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::association::Limits;
    use super::*;
    use crate::record::{Status, TrajectoryPoint, upper_index};

    pub const MS: i64 = 1_000_000;

    /// The trajectory of [`runs`]: a loop through the workspace.
    pub fn truth(n: i64) -> Reference {
        let points = (0..n).map(|i| {
            let t = i as f64 * 0.02;
            TrajectoryPoint {
                stamp: Stamp::from_ns(i * 20 * MS),
                position_m: [0.0, 4.0 * (0.13 * t).sin(), 2.0 + 1.5 * (0.17 * t).cos()],
                rotation_rad: [0.0, 0.0, 0.02 * (0.3 * t).sin()],
                velocity_m_s: [0.0, 0.52 * (0.13 * t).cos(), -0.255 * (0.17 * t).sin()],
            }
        });
        Reference::new(points.collect(), Limits::default())
    }

    /// A run with errors of known statistics: alternating +-a about a bias, and honest sigmas.
    pub fn run(name: &str, reference: &Reference, n: i64, scale: f64) -> Run {
        let amplitude = [0.004, 0.0003, 0.0005, 1e-4, 2e-4, 1e-3];
        let poses = (0..n).map(|i| {
            let stamp = Stamp::from_ns(i * 20 * MS);
            let (truth, _) = reference.at(stamp).unwrap();
            let sign = if i % 2 == 0 { 1.0 } else { -1.0 };
            let mut pose = Pose {
                stamp,
                scan_stamp: stamp,
                seq: i as u32,
                edges: 8,
                ..Pose::default()
            };
            let value = |k: usize| truth[k] + scale * amplitude[k] * (sign + 0.25);
            pose.position_m = [0, 1, 2].map(value);
            pose.rotation_rad = [3, 4, 5].map(value);
            pose.covariance = [0.0; 21];
            for (k, sigma) in amplitude.iter().enumerate() {
                pose.covariance[upper_index(6, k, k)] = sigma.powi(2);
            }
            if i % 50 == 49 {
                pose = Pose {
                    stamp,
                    seq: i as u32,
                    status: Status::NO_POSE | Status::NO_EDGES,
                    ..Pose::default()
                };
            }
            pose
        });
        Run {
            name: name.to_owned(),
            source: format!("{name}.csv"),
            poses: poses.collect(),
            stages: Vec::new(),
        }
    }

    #[test]
    fn closed_form_of_a_known_run() {
        let reference = truth(2000);
        let cases = evaluate(
            vec![run("a", &reference, 2000, 1.0)],
            &reference,
            &Settings::default(),
        );
        let case = &cases[0];
        assert_eq!(
            (case.scans.rows, case.scans.solved, case.scans.lost),
            (2000, 1960, 0)
        );
        assert_eq!((case.matching.exact, case.matching.unmatched()), (1960, 0));
        let x = &case.axes[0].statistics;
        // 1000 errors of +1.25 a and 960 of -0.75 a.
        let mean = 0.004 * (1000.0 * 1.25 - 960.0 * 0.75) / 1960.0;
        assert!((x.bias - mean).abs() < 1e-12);
        let square = (1000.0 * 1.25f64.powi(2) + 960.0 * 0.75f64.powi(2)) / 1960.0;
        assert!((x.rms - 0.004 * square.sqrt()).abs() < 1e-12);
        assert!((x.max - 0.005).abs() < 1e-12 && (x.min - 0.003).abs() < 1e-12);
        assert!((case.axes[5].consistency.nees - square).abs() < 1e-9);
        assert!((case.groups[2].nees - square).abs() < 1e-9);
        let within = case.axes[0].within;
        assert!((within[0] - 960.0 / 1960.0).abs() < 1e-12 && within[1] == 1.0);
        assert!(case.axes[POSITION].within[0].is_nan());
        assert_eq!(
            case.cells
                .as_ref()
                .unwrap()
                .cells
                .iter()
                .map(|c| c.n)
                .sum::<u32>(),
            1960
        );
        assert!(case.notes.is_empty(), "{:?}", case.notes);
    }

    #[test]
    fn zones_split_a_run() {
        let reference = truth(2000);
        let zones = vec!["z<=2".parse().unwrap(), "high=z>2".parse().unwrap()];
        let settings = Settings {
            zones,
            cell_m: None,
        };
        let cases = evaluate(vec![run("a", &reference, 2000, 1.0)], &reference, &settings);
        assert_eq!(cases.len(), 2);
        assert_eq!(
            (cases[0].name(), cases[1].name()),
            ("a in z<=2".into(), "a in high".into())
        );
        assert_eq!(cases[0].scans.rows + cases[1].scans.rows, 2000);
        assert_eq!(cases[0].scans.solved + cases[1].scans.solved, 1960);
        assert_eq!(cases[0].scans.lost + cases[1].scans.lost, 0);
        let n: usize = cases.iter().map(|c| c.axes[0].statistics.n).sum();
        assert_eq!(n, 1960);
    }

    #[test]
    fn components_that_a_status_disowns_are_not_scored() {
        let reference = truth(2000);
        let mut odd = run("a", &reference, 2000, 1.0);
        for (i, pose) in odd.poses.iter_mut().enumerate() {
            match i % 50 {
                // Without edges nothing says where x is; a number that stands there is no measurement.
                0 => {
                    pose.status = Status::NO_EDGES | Status::NO_YAW;
                    pose.position_m[0] = f64::NAN;
                    pose.rotation_rad[2] = 1.0;
                }
                1 => {
                    pose.status = Status::NO_YAW;
                    pose.rotation_rad[2] = f64::NAN;
                }
                2 => {
                    pose.status = Status::NO_POSE;
                    pose.position_m[1] = 100.0;
                }
                _ => {}
            }
        }
        let case = &evaluate(vec![odd], &reference, &Settings::default())[0];
        let n = |i: usize| case.axes[i].statistics.n;
        let n: Vec<usize> = (0..AXES.len()).map(n).collect();
        // Of 2000: 40 refused by the run itself, 40 by the loop above.
        assert_eq!(AXES[POSITION].name, "position");
        assert_eq!(n[..6], [1880, 1920, 1920, 1920, 1920, 1840]);
        assert_eq!(n[POSITION], 1880);
        assert!(case.axes.iter().all(|a| a.statistics.max < 0.006));
        assert_eq!([0, 1, 2].map(|k| case.groups[k].n), [1840, 1880, 1840]);
        let scans = &case.scans;
        assert_eq!(
            (scans.solved, scans.partial, scans.refused()),
            (1920, 80, 80)
        );
        assert_eq!(case.matching.matched(), 1920);
        let note = "80 of 1920 solved poses lack a component and do not count for it (only for the \
                    others): x 40, yaw 80";
        assert!(case.notes.iter().any(|n| n == note), "{:?}", case.notes);
    }

    #[test]
    fn variances_that_cannot_be_used_are_counted() {
        let reference = truth(2000);
        let mut odd = run("a", &reference, 2000, 1.0);
        odd.poses[0].covariance[upper_index(6, 0, 0)] = -1e-6;
        odd.poses[1].covariance[upper_index(6, 0, 0)] = f64::NAN;
        odd.poses[2].covariance[upper_index(6, 5, 5)] = 0.0;
        // Each variance is sound, but x and yaw would be correlated by more than 1.
        odd.poses[3].covariance[upper_index(6, 0, 5)] = 1e-5;
        let case = &evaluate(vec![odd], &reference, &Settings::default())[0];
        let consistency = |i: usize| {
            (
                case.axes[i].consistency.n,
                case.axes[i].consistency.left_out,
            )
        };
        assert_eq!(consistency(0), (1958, 2));
        assert_eq!(consistency(1), (1960, 0));
        assert_eq!(consistency(5), (1959, 1));
        assert_eq!(consistency(POSITION), (0, 0));
        let groups = [0, 1, 2].map(|k| (case.groups[k].n, case.groups[k].left_out));
        assert_eq!(groups, [(1956, 4), (1958, 2), (1956, 4)]);
        let note = "poses whose variance is missing or not positive are left out of the NEES: \
                    x 2, yaw 1, x_yaw 4, position 2, pose 4";
        assert_eq!(case.notes, [note]);
        assert_eq!(case.axes[0].statistics.n, 1960, "the errors count");
    }

    #[test]
    fn yaw_is_wrapped() {
        let point = TrajectoryPoint {
            position_m: [0.0; 3],
            rotation_rad: [0.0, 0.0, 3.1],
            ..TrajectoryPoint::default()
        };
        let pose = Pose {
            position_m: [0.0; 3],
            rotation_rad: [0.0, 0.0, -3.1],
            ..Pose::default()
        };
        let reference = Reference::new(vec![point], Limits::default());
        let run = Run {
            poses: vec![pose],
            ..Run::default()
        };
        let cases = evaluate(vec![run], &reference, &Settings::default());
        let want = 2.0 * (std::f64::consts::PI - 3.1);
        assert!((cases[0].axes[5].statistics.bias - want).abs() < 1e-12);
    }

    #[test]
    fn disorder_is_counted() {
        let reference = truth(100);
        let mut run = run("a", &reference, 40, 1.0);
        run.poses.swap(3, 4);
        run.poses.push(run.poses[10].clone());
        run.poses.remove(20);
        run.poses.push(Pose {
            stamp: Stamp::from_ns(10_000 * MS),
            position_m: [0.0; 3],
            rotation_rad: [0.0; 3],
            seq: 40,
            ..Pose::default()
        });
        let case = &evaluate(vec![run], &reference, &Settings::default())[0];
        assert_eq!((case.unsorted, case.repeated, case.scans.lost), (2, 1, 1));
        assert_eq!((case.matching.outside, case.scans.rows), (1, 40));
        assert_eq!(case.notes.len(), 4, "{:?}", case.notes);
    }

    #[test]
    fn nothing_to_compare_is_said() {
        let reference = truth(10);
        let at = |ns: i64, x: f64| Run {
            poses: vec![Pose {
                stamp: Stamp::from_ns(ns),
                position_m: [x; 3],
                ..Pose::default()
            }],
            ..Run::default()
        };
        for (run, reference, words) in [
            (Run::default(), &reference, "there are no poses"),
            (at(0, f64::NAN), &reference, "no scan has a pose"),
            (at(1 << 60, 0.0), &reference, "do not overlap in time"),
            (
                at(0, 0.0),
                &Reference::default(),
                "the reference has no points",
            ),
        ] {
            let case = &evaluate(vec![run], reference, &Settings::default())[0];
            assert!(case.is_empty());
            assert!(
                case.notes.iter().any(|n| n.contains(words)),
                "{:?}",
                case.notes
            );
        }
    }
}
