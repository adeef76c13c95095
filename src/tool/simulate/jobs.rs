//! A run on several cores, and a part of a run.

use crate::simulate::{Simulator, Step};
use crate::stream::{Fault, Stop};
use std::num::NonZeroUsize;
use std::ops::Range;

/// Scans that a thread makes before they are written.
const BATCH: usize = 16;

/// The command line's part.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Running")]
pub(super) struct JobArgs {
    /// Make so many scans side by side; the records are the same for any number, to the byte
    /// [default: one a core]
    #[arg(long, value_name = "N", conflicts_with_all = ["serving", "replay", "dilution", "scene", "imu_pty"])]
    jobs: Option<NonZeroUsize>,
    /// Make only the I-th of N equal parts of the run, the same bytes as in the whole run (without
    /// its header); counted from 1
    #[arg(long, value_name = "I/N", value_parser = parse_shard, conflicts_with_all = ["serving", "replay", "dilution", "scene", "imu_pty", "imu_record", "real_time"])]
    shard: Option<Shard>,
}

impl JobArgs {
    /// Leaves of a run the part that is asked for.
    pub(super) fn restrict(&self, simulator: &mut Simulator) {
        if let Some(shard) = self.shard {
            simulator.only(shard.of(simulator.scans()));
        }
    }

    /// Gives every scan of the run to `write`, in order, until the end or until the tool is asked to
    /// stop.
    pub(super) fn run(
        &self,
        simulator: &mut Simulator,
        stop: &Stop,
        write: &mut dyn FnMut(&Step) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        let cores = || std::thread::available_parallelism().map_or(1, NonZeroUsize::get);
        let jobs = self.jobs.map_or_else(cores, NonZeroUsize::get);
        if jobs == 1 {
            return one_by_one(simulator, stop, write);
        }
        let pool = rayon::ThreadPoolBuilder::new().num_threads(jobs).build();
        let pool = pool.map_err(|error| Fault::Io(format!("--jobs {jobs}: {error}")))?;
        let (mut ready, mut next): (Vec<Step>, Vec<Step>) = Default::default();
        loop {
            // While some scans are written, the next ones are made.
            pool.in_place_scope(|scope| {
                scope.spawn(|_| simulator.advance_many(BATCH * jobs, &mut next));
                let mut wanted = ready.iter().take_while(|_| !stop.requested());
                wanted.try_for_each(&mut *write)
            })?;
            std::mem::swap(&mut ready, &mut next);
            if ready.is_empty() || stop.requested() {
                return Ok(());
            }
        }
    }
}

/// Scan after scan, each given out before the next is begun.
pub(super) fn one_by_one(
    simulator: &mut Simulator,
    stop: &Stop,
    write: &mut dyn FnMut(&Step) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    while !stop.requested() {
        let Some(step) = simulator.advance() else {
            break;
        };
        write(step)?;
    }
    Ok(())
}

/// One of some equal parts of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Shard {
    /// Counted from 0.
    index: u64,
    parts: u64,
}

impl Shard {
    /// Its scans.
    fn of(self, scans: u64) -> Range<u64> {
        let bound = |k: u64| (u128::from(scans) * u128::from(k) / u128::from(self.parts)) as u64;
        bound(self.index)..bound(self.index + 1)
    }
}

fn parse_shard(text: &str) -> Result<Shard, String> {
    let numbers = text.split_once('/').and_then(|(index, parts)| {
        let (index, parts): (u64, u64) = (index.parse().ok()?, parts.parse().ok()?);
        (1..=parts).contains(&index).then_some((index, parts))
    });
    let (index, parts) = numbers.ok_or("I/N is wanted, I from 1 to N, as in 2/8")?;
    Ok(Shard {
        index: index - 1,
        parts,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_make_up_the_run() {
        for (scans, parts) in [(10, 3), (2, 5), (0, 2), (u64::MAX, 7)] {
            let ranges = (0..parts).map(|index| Shard { index, parts }.of(scans));
            let end = ranges.fold(0, |end, range| {
                assert_eq!(range.start, end);
                assert!(range.end - range.start <= scans.div_ceil(parts));
                range.end
            });
            assert_eq!(end, scans);
        }
    }

    #[test]
    fn shards_are_counted_from_one() {
        let shard = parse_shard("2/8").unwrap();
        assert_eq!(shard, Shard { index: 1, parts: 8 });
        for wrong in ["0/2", "3/2", "1", "1/0", "a/b", "-1/2"] {
            assert!(parse_shard(wrong).is_err(), "{wrong}");
        }
    }
}
