//! report's inputs: the runs and what they are compared with, in an order that cannot deadlock.

use super::evaluation::ImuRecord;
use crate::frame::ImuAxes;
use crate::record::{Pose, ReflectorLines, Segment, TrajectoryPoint};
use crate::report::{LineTally, Run, origin};
use crate::stream::{
    Encoding, Fault, Input, Options, Role, StreamCopy, StreamRecord, Window, copies, read_all,
};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::thread;

/// What the runs are to be compared with.
#[derive(Clone, Copy)]
pub(super) struct Wanted<'a> {
    /// Where it is: one file, or the parts of a trajectory.
    pub(super) paths: &'a [PathBuf],
    /// Which trajectory of an MCAP stream.
    pub(super) role: Role,
    /// Whether the command line names it; otherwise it is looked for in the runs' streams.
    pub(super) given: bool,
}

/// What there may be beside runs and reference.
pub(super) struct Beside<'a> {
    /// An IMU's record, and how the unit is mounted.
    pub(super) imu: Option<(&'a Path, ImuAxes)>,
    /// The lines that the poses were made from.
    pub(super) lines: Option<&'a Path>,
}

/// A trajectory, or a part of one, and the stages that made it.
#[derive(Default)]
struct Part {
    points: Vec<TrajectoryPoint>,
    stages: Vec<String>,
}

/// All that has been read.
pub(super) struct Inputs {
    /// The runs in the order given.
    pub(super) runs: Vec<Run>,
    /// The reference's points.
    pub(super) points: Vec<TrajectoryPoint>,
    /// The stages that made the reference, as far as it says.
    pub(super) stages: Vec<String>,
    /// The IMU's record.
    pub(super) imu: Option<ImuRecord>,
    /// The lines, summed up.
    pub(super) lines: Option<LineTally>,
}

/// What came of a [`Job`].
enum Done {
    Run(Run),
    Reference(Part),
    Imu(Box<ImuRecord>),
    Lines(Box<LineTally>),
}

/// Reads all inputs.
pub(super) fn read(
    sources: &[origin::Source],
    wanted: Wanted<'_>,
    beside: &Beside<'_>,
    options: &Options,
) -> anyhow::Result<Inputs> {
    let is_run = |path: &Path| sources.iter().any(|source| source.path == path);
    let of_runs = sources.iter().map(|source| source.path.as_path());
    let of_others = wanted.paths.iter().map(PathBuf::as_path);
    let of_others = of_others.filter(|path| !is_run(path));
    let of_imu = beside.imu.as_ref().map(|(path, _)| *path);
    let all = of_runs.chain(of_others).chain(of_imu).chain(beside.lines);
    refuse_twice(all)?;
    refuse_twice(wanted.paths.iter().map(PathBuf::as_path))?;
    let mut jobs: Vec<Job<'_, Done>> = Vec::new();
    // A pipe that holds a run and its reference is read once, for both.
    let mut halves: BTreeMap<&Path, StreamCopy> = BTreeMap::new();
    for source in sources {
        let path = source.path.as_path();
        let mut own = None;
        if is_pipe(path) && wanted.paths.contains(&source.path) {
            let [half, other] = copies(Some(path))?;
            own = Some(half);
            halves.insert(path, other);
        }
        let read = move || read_run(source, own, options).map(Done::Run);
        jobs.push(Job::new(path, read));
    }
    for path in wanted.paths {
        let half = halves.remove(path.as_path());
        let read = move || read_reference(path, wanted, half, options).map(Done::Reference);
        jobs.push(Job::new(path, read));
    }
    if let Some((path, axes)) = &beside.imu {
        let read = || ImuRecord::read(path, axes, options).map(|imu| Done::Imu(Box::new(imu)));
        jobs.push(Job::new(path, read));
    }
    if let Some(path) = beside.lines {
        let read = move || read_lines(path, options).map(|lines| Done::Lines(Box::new(lines)));
        jobs.push(Job::new(path, read));
    }
    let mut inputs = Inputs {
        runs: Vec::new(),
        points: Vec::new(),
        stages: Vec::new(),
        imu: None,
        lines: None,
    };
    let mut parts = Vec::new();
    for done in do_all(jobs)? {
        match done {
            Done::Run(run) => inputs.runs.push(run),
            Done::Reference(part) => parts.push(part),
            Done::Imu(imu) => inputs.imu = Some(*imu),
            Done::Lines(lines) => inputs.lines = Some(*lines),
        }
    }
    let Part { points, stages } = whole(parts);
    Ok(Inputs {
        points,
        stages,
        ..inputs
    })
}

/// Files that are read at the same time; of pipes there is no limit.
const FILES_AT_ONCE: usize = 8;

/// Something to read.
struct Job<'a, T> {
    path: &'a Path,
    read: Box<dyn FnOnce() -> anyhow::Result<T> + Send + 'a>,
}

impl<'a, T> Job<'a, T> {
    fn new(path: &'a Path, read: impl FnOnce() -> anyhow::Result<T> + Send + 'a) -> Self {
        let read = Box::new(read);
        Job { path, read }
    }
}

/// Does all jobs: first what comes through pipes, all at the same time, because they may be branches
/// of one pipeline, where a branch that is not read holds up the others; then files, which the same
/// pipeline may still have been writing (`simulate --truth T | .. | report --truth T`). What comes of
/// the jobs is in their order.
fn do_all<T: Send>(jobs: Vec<Job<'_, T>>) -> anyhow::Result<Vec<T>> {
    let jobs = jobs.into_iter().enumerate();
    let (pipes, mut files): (Vec<_>, Vec<_>) = jobs.partition(|(_, job)| is_pipe(job.path));
    let mut done = do_at_once(pipes)?;
    while !files.is_empty() {
        let rest = files.split_off(FILES_AT_ONCE.min(files.len()));
        done.extend(do_at_once(std::mem::replace(&mut files, rest))?);
    }
    done.sort_by_key(|(place, _)| *place);
    Ok(done.into_iter().map(|(_, result)| result).collect())
}

/// Does numbered jobs, all at the same time.
fn do_at_once<T: Send>(jobs: Vec<(usize, Job<'_, T>)>) -> anyhow::Result<Vec<(usize, T)>> {
    thread::scope(|scope| {
        let threads: Vec<_> = jobs
            .into_iter()
            .map(|(place, job)| (place, scope.spawn(job.read)))
            .collect();
        let results = threads
            .into_iter()
            .map(|(place, thread)| Ok((place, joined(thread)?)));
        results.collect()
    })
}

/// Refuses a pipe that is named twice: each of its two readers would get a part of it.
pub(super) fn refuse_twice<'a>(paths: impl Iterator<Item = &'a Path>) -> Result<(), Fault> {
    let mut pipes: Vec<&Path> = Vec::new();
    for path in paths.filter(|path| is_pipe(path)) {
        if pipes.contains(&path) {
            let name = origin::input_name(path);
            return Err(Fault::Usage(format!(
                "{name} is named twice: it can be read only once"
            )));
        }
        pipes.push(path);
    }
    Ok(())
}

/// The parts of a trajectory put together. They come in any order, and a point that two of them
/// share is one.
fn whole(mut parts: Vec<Part>) -> Part {
    if parts.len() < 2 {
        return parts.pop().unwrap_or_default();
    }
    parts.sort_by_key(|part| part.points.first().map(|point| point.stamp));
    let mut points = Vec::new();
    let mut stages = Vec::new();
    for part in parts {
        points.extend(part.points);
        // Parts are made by the same stages, but for the one that says which part it is.
        for stage in part.stages {
            if !stages.contains(&stage) {
                stages.push(stage);
            }
        }
    }
    points.sort_by_key(|point| point.stamp);
    let pose = |p: &TrajectoryPoint| (p.stamp, p.position_m, p.rotation_rad);
    points.dedup_by(|b, a| pose(b) == pose(a));
    Part { points, stages }
}

/// True segments and those of every run.
pub(super) fn read_segments(
    truth: &Path,
    sources: &[origin::Source],
    options: &Options,
) -> anyhow::Result<(Vec<Segment>, Vec<Vec<Segment>>)> {
    let paths = || std::iter::once(truth).chain(sources.iter().map(|s| s.path.as_path()));
    refuse_twice(paths())?;
    let jobs = paths().map(|path| Job::new(path, move || read_all(Some(path), options)));
    let mut read = do_all(jobs.collect())?;
    let runs = read.split_off(1);
    Ok((read.pop().unwrap_or_default(), runs))
}

/// One run of poses, and the desired trajectory where there is one.
pub(super) fn read_with_desired(
    poses: &Path,
    desired: Option<&Path>,
    options: &Options,
) -> anyhow::Result<(Vec<Pose>, Option<Vec<TrajectoryPoint>>)> {
    enum Half {
        Poses(Vec<Pose>),
        Desired(Vec<TrajectoryPoint>),
    }
    refuse_twice([poses].into_iter().chain(desired))?;
    let mut jobs: Vec<Job<'_, Half>> = Vec::new();
    jobs.push(Job::new(poses, || {
        read_all(Some(poses), options).map(Half::Poses)
    }));
    jobs.extend(
        desired.map(|path| Job::new(path, move || read_desired(path, options).map(Half::Desired))),
    );
    let (mut found, mut points) = (Vec::new(), None);
    for half in do_all(jobs)? {
        match half {
            Half::Poses(poses) => found = poses,
            Half::Desired(desired) => points = Some(desired),
        }
    }
    Ok((found, points))
}

/// The points of a desired trajectory.
fn read_desired(path: &Path, options: &Options) -> anyhow::Result<Vec<TrajectoryPoint>> {
    let mut input = Input::open_trajectory(Some(path), Role::Desired, options)?;
    let mut points = Vec::new();
    while let Some(point) = input.next()? {
        points.push(*point);
    }
    Ok(points)
}

/// Whether an input is stdin, a FIFO or a device: anything but a file that is there or will be. A
/// folder is none of them, and is refused where it is opened.
pub(super) fn is_pipe(path: &Path) -> bool {
    let is_one = |found: std::fs::Metadata| !found.is_file() && !found.is_dir();
    path == Path::new("-") || std::fs::metadata(path).is_ok_and(is_one)
}

pub(super) fn joined<T>(thread: thread::ScopedJoinHandle<'_, T>) -> T {
    thread
        .join()
        .unwrap_or_else(|panic| std::panic::resume_unwind(panic))
}

/// The reference's points. Poses have a trajectory's columns, so that a run in CSV could be read as
/// one and compared with itself: where none is given, only a trajectory of its own in MCAP will do.
fn read_reference(
    path: &Path,
    wanted: Wanted<'_>,
    half: Option<StreamCopy>,
    options: &Options,
) -> anyhow::Result<Part> {
    let Wanted { role, given, .. } = wanted;
    let mut input = match half {
        Some(bytes) => {
            let mut all = options.clone();
            all.window = Window::default();
            Input::from_reader(bytes, &origin::input_name(path), role, &all)?
        }
        None => Input::open_trajectory(Some(path), role, options)?,
    };
    if !given && input.encoding() != Encoding::Mcap {
        return Err(no_reference("it is CSV"));
    }
    let mut points = Vec::new();
    loop {
        match input.next() {
            Ok(Some(point)) => points.push(*point),
            Ok(None) => {
                let stages = stages(&input);
                return Ok(Part { points, stages });
            }
            Err(error) if !given && points.is_empty() && is_bad_data(&error) => {
                return Err(no_reference(&error.to_string()));
            }
            Err(error) => return Err(error),
        }
    }
}

pub(super) fn is_bad_data(error: &anyhow::Error) -> bool {
    matches!(error.downcast_ref(), Some(Fault::BadData(_)))
}

fn no_reference(why: &str) -> anyhow::Error {
    let wanted = "without --truth or --desired, the first run must be MCAP with /truth";
    Fault::Usage(format!("{wanted}: {why}")).into()
}

/// The lines that poses were made from, summed up.
fn read_lines(path: &Path, options: &Options) -> anyhow::Result<LineTally> {
    let mut tally = LineTally::new(origin::input_name(path));
    let mut input: Input<ReflectorLines> = Input::open(Some(path), options)?;
    while let Some(lines) = input.next()? {
        tally.add(lines);
    }
    Ok(tally)
}

fn read_run(
    source: &origin::Source,
    half: Option<StreamCopy>,
    options: &Options,
) -> anyhow::Result<Run> {
    let mut input: Input<Pose> = match half {
        Some(bytes) => Input::from_reader(
            bytes,
            &origin::input_name(&source.path),
            Role::Truth,
            options,
        )?,
        None => Input::open(Some(&source.path), options)?,
    };
    let mut poses = Vec::new();
    while let Some(pose) = input.next()? {
        poses.push(pose.clone());
    }
    Ok(Run {
        name: source.name.clone(),
        source: origin::input_name(&source.path),
        stages: stages(&input),
        poses,
    })
}

/// The commands that made a stream, as far as it says.
fn stages<R: StreamRecord>(input: &Input<R>) -> Vec<String> {
    let stages = input.provenance().iter();
    let stages = stages.map(|stage| {
        let seed = stage
            .seed
            .map(|s| format!("  # seed {s}"))
            .unwrap_or_default();
        let command = origin::command_without_folders(&stage.command);
        format!("{command}{seed}  # {} {}", stage.tool, stage.version)
    });
    stages.collect()
}
