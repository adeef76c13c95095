//! The run loop that every filter shares.

use super::check::StreamRecord;
use super::exit;
use super::flow;
use super::input::{Input, Source};
use super::output::Output;
use super::viewer::Note;
use super::{Options, Outcome, Role};
use crate::record::ImuSample;
use std::marker::PhantomData;
use std::path::Path;
use std::time::Instant;

/// A filter's state: records in, records out.
pub trait Stage {
    /// What it reads.
    type In: StreamRecord;
    /// What it writes.
    type Out: StreamRecord;
    /// Takes one record.
    fn push(&mut self, record: &Self::In, emit: &mut Emit<'_, Self::Out>) -> anyhow::Result<()>;
    /// Whether IMU samples that travel in the same MCAP stream are wanted.
    fn wants_imu(&self) -> bool {
        false
    }
    /// Takes such a sample; it came before the record that is pushed next.
    fn imu(&mut self, _sample: &ImuSample) {}
    /// The end of the input: writes what is still held back and says how it went.
    fn finish(&mut self, emit: &mut Emit<'_, Self::Out>) -> anyhow::Result<Outcome>;
}

/// Where a stage puts its records.
pub struct Emit<'a, O> {
    output: &'a Output,
    record: PhantomData<fn(O)>,
}

impl<O: StreamRecord> Emit<'_, O> {
    /// Writes a record.
    pub fn write(&mut self, record: &O) -> anyhow::Result<()> {
        self.output.put(record, Role::Desired)
    }

    /// Fixes the columns of a CSV stream before its first record: those in which `like` has a value.
    pub fn columns_like(&mut self, like: &O) -> anyhow::Result<()> {
        self.output.fix_columns(like)
    }

    /// Writes further messages for a viewer into an MCAP stream; CSV has no place for them.
    pub fn note(&mut self, notes: &[Note]) -> anyhow::Result<()> {
        self.output.with_mcap(|mcap| mcap.note(notes))
    }
}

/// Runs a stage from `input` (none, or `-`, is stdin) to the output of `options`, in the input's
/// encoding unless `--format` says otherwise.
///
/// In MCAP every message that the stage does not itself write is passed on. A bad record ends the
/// run after everything before it has been written, or is skipped with `--skip-bad`. The first
/// SIGINT is left to the source.
pub fn filter<S: Stage>(
    options: &Options,
    input: Option<&Path>,
    stage: &mut S,
) -> anyhow::Result<Outcome> {
    let start = Instant::now();
    flow::drain_on_interrupt()?;
    let source = Source::open(input, options)?;
    let output = Output::open_as(
        options,
        options.format.unwrap_or(source.encoding.of_filter()),
    )?;
    let mut input = Input::from_source(source, Role::Desired, options.window, options)?;
    output.with_mcap(|mcap| {
        mcap.declare::<S::Out>();
        Ok(())
    })?;
    let mut emit = Emit {
        output: &output,
        record: PhantomData,
    };
    let outcome = match drive(&mut input, stage, &mut emit) {
        Ok(outcome) => outcome,
        Err(error) => {
            // A second fault on the way out would hide the first.
            let _ = output.end();
            return Err(error);
        }
    };
    let written = output.records();
    output.finish_kind::<S::Out>()?;
    if options.verbose > 0 {
        eprintln!(
            "{}: {} records in, {written} out, {} bad, {:.2} s",
            options.tool,
            input.records(),
            input.bad(),
            start.elapsed().as_secs_f64()
        );
    }
    Ok(exit::with_losses(outcome))
}

fn drive<S: Stage>(
    input: &mut Input<S::In>,
    stage: &mut S,
    emit: &mut Emit<'_, S::Out>,
) -> anyhow::Result<Outcome> {
    if stage.wants_imu() {
        input.want_imu();
    }
    let mut begun = false;
    loop {
        let read = input.advance(Some(emit.output));
        if !begun {
            // Before the first record, when an MCAP input has said all that there is to say.
            begun = true;
            emit.output.follow(input)?;
        }
        match read {
            Ok(true) => {
                input.take_imu().iter().for_each(|sample| stage.imu(sample));
                stage.push(input.current(), emit)?;
            }
            Ok(false) => return stage.finish(emit),
            Err(error) => {
                // What the stage held back came before the fault and must not be lost.
                let _ = stage.finish(emit);
                return Err(error);
            }
        }
    }
}
