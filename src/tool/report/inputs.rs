//! report's inputs: the runs and what they are compared with, in an order that cannot deadlock.

use crate::record::{Pose, ReflectorLines, Segment, TrajectoryPoint};
use crate::report::{Run, origin};
use crate::stream::{
    Encoding, Fault, Input, Options, Role, StreamCopy, StreamRecord, Window, copies, read_all,
};
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

/// Files that are read at the same time; of pipes there is no limit.
const FILES_AT_ONCE: usize = 8;

/// Something to read.
#[derive(Clone, Copy)]
enum Job {
    /// The run of this index.
    Run(usize),
    /// The reference of this index.
    Reference(usize),
}

/// What came of a [`Job`].
enum Done {
    Run(Run),
    Reference(Part),
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
}

/// Reads all inputs: first what comes through pipes, all at the same time, because they may be
/// branches of one pipeline, where a branch that is not read holds up the others; then files, which
/// the same pipeline may still have been writing (`simulate --truth T | .. | report --truth T`).
pub(super) fn read(
    sources: &[origin::Source],
    wanted: Wanted<'_>,
    options: &Options,
) -> anyhow::Result<Inputs> {
    let shared = wanted.paths.iter().enumerate().find_map(|(j, path)| {
        let i = sources.iter().position(|s| s.path == *path)?;
        is_pipe(path).then_some((i, j))
    });
    let mut halves = match shared.and_then(|(i, _)| sources.get(i)) {
        Some(source) => copies(Some(&source.path))?.map(Some),
        None => [None, None],
    };
    let jobs: Vec<(Job, &Path)> = sources
        .iter()
        .enumerate()
        .map(|(i, source)| (Job::Run(i), source.path.as_path()))
        .chain(
            (wanted.paths.iter().enumerate()).map(|(j, path)| (Job::Reference(j), path.as_path())),
        )
        .collect();
    let mut runs: Vec<Option<Run>> = vec![None; sources.len()];
    let mut parts: Vec<Part> = Vec::new();
    for pipes in [true, false] {
        let now: Vec<_> = jobs
            .iter()
            .filter(|(_, path)| is_pipe(path) == pipes)
            .collect();
        let at_once = if pipes { now.len() } else { FILES_AT_ONCE };
        for batch in now.chunks(at_once.max(1)) {
            thread::scope(|scope| {
                let mut threads = Vec::new();
                for (job, path) in batch {
                    let half = match (*job, shared) {
                        (Job::Run(i), Some((own, _))) if i == own => halves[0].take(),
                        (Job::Reference(j), Some((_, own))) if j == own => halves[1].take(),
                        _ => None,
                    };
                    let job = *job;
                    let thread = scope.spawn(move || match job {
                        Job::Run(i) => sources
                            .get(i)
                            .map(|source| read_run(source, half, options).map(Done::Run)),
                        Job::Reference(_) => {
                            Some(read_reference(path, wanted, half, options).map(Done::Reference))
                        }
                    });
                    threads.push((job, thread));
                }
                for (job, thread) in threads {
                    match (job, joined(thread).transpose()?) {
                        (Job::Run(i), Some(Done::Run(run))) => {
                            runs.splice(i..=i, [Some(run)]);
                        }
                        (_, Some(Done::Reference(part))) => parts.push(part),
                        _ => {}
                    }
                }
                anyhow::Ok(())
            })?;
        }
    }
    let Part { points, stages } = whole(parts);
    Ok(Inputs {
        runs: runs.into_iter().flatten().collect(),
        points,
        stages,
    })
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
        stages.extend(part.stages);
    }
    points.sort_by_key(|point| point.stamp);
    let pose = |p: &TrajectoryPoint| (p.stamp, p.position_m, p.rotation_rad);
    points.dedup_by(|b, a| pose(b) == pose(a));
    Part { points, stages }
}

/// Lines that poses were made from.
pub(super) fn open_lines(path: &Path, options: &Options) -> anyhow::Result<Input<ReflectorLines>> {
    Input::open(Some(path), options)
}

/// True segments and those of every run: first what comes through pipes, all at the same time, then
/// files, as in [`read`].
pub(super) fn read_segments(
    truth: &Path,
    sources: &[origin::Source],
    options: &Options,
) -> anyhow::Result<(Vec<Segment>, Vec<Vec<Segment>>)> {
    let paths: Vec<&Path> = std::iter::once(truth)
        .chain(sources.iter().map(|source| source.path.as_path()))
        .collect();
    let mut read: Vec<Vec<Segment>> = vec![Vec::new(); paths.len()];
    for pipes in [true, false] {
        thread::scope(|scope| {
            let threads: Vec<_> = paths
                .iter()
                .enumerate()
                .filter(|(_, path)| is_pipe(path) == pipes)
                .map(|(i, path)| (i, scope.spawn(move || read_all(Some(path), options))))
                .collect();
            for (i, thread) in threads {
                read[i] = joined(thread)?;
            }
            anyhow::Ok(())
        })?;
    }
    let runs = read.split_off(1);
    Ok((read.pop().unwrap_or_default(), runs))
}

/// Whether an input is stdin, a FIFO or a device: anything but a file that is there or will be.
pub(super) fn is_pipe(path: &Path) -> bool {
    path == Path::new("-") || std::fs::metadata(path).is_ok_and(|m| !m.is_file())
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
