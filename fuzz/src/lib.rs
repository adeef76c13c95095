//! What the fuzz targets share: streams read as the programs read them, and a limit on memory.

use allocation_counter::measure;
use cablepose::record::{
    BeamFate, ClockExchange, DelayPoint, ImuSample, Pose, ReflectorLines, Scan, Segment,
    TrajectoryPoint,
};
use cablepose::stream::{Encoding, Input, Options, Output, Role, StreamRecord};
use std::any::Any;
use std::fmt::Debug;
use std::io::{self, Read};
use std::path::PathBuf;

/// How many kinds of record there are.
pub const KINDS: u8 = 9;

/// Runs `run` and panics where it held more than `limit` bytes at one time: a length that stands in
/// the input must not decide how much memory is taken.
pub fn bounded<T>(limit: u64, run: impl FnOnce() -> T) -> T {
    let mut result = None;
    let info = measure(|| result = Some(run()));
    assert!(info.bytes_max <= limit, "{} bytes were held", info.bytes_max);
    result.unwrap()
}

/// Bytes that come in pieces of a set size, as from a pipe.
struct Pieces {
    bytes: Vec<u8>,
    at: usize,
    piece: usize,
}

impl Read for Pieces {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let length = self.piece.min(buffer.len()).min(self.bytes.len() - self.at);
        buffer[..length].copy_from_slice(&self.bytes[self.at..self.at + length]);
        self.at += length;
        Ok(length)
    }
}

/// How a stream is read.
#[derive(Clone, Copy)]
pub struct Reading {
    /// Which record is wanted, a number below [`KINDS`].
    pub kind: u8,
    /// `--input-format`.
    pub encoding: Option<Encoding>,
    /// `--skip-bad`.
    pub skip_bad: bool,
    /// Topic of a trajectory.
    pub role: Role,
    /// Whether the first record is written and read back as well.
    pub write: bool,
}

impl Reading {
    fn options(&self) -> Options {
        Options {
            tool: "fuzz",
            input_format: self.encoding,
            skip_bad: self.skip_bad,
            quiet: true,
            ..Options::default()
        }
    }

    /// What the stream holds, as text, and the fault that ended it.
    pub fn read(&self, bytes: &[u8], piece: usize) -> Vec<String> {
        match self.kind % KINDS {
            0 => self.records::<Scan>(bytes, piece),
            1 => self.records::<ImuSample>(bytes, piece),
            2 => self.records::<ReflectorLines>(bytes, piece),
            3 => self.records::<Pose>(bytes, piece),
            4 => self.records::<TrajectoryPoint>(bytes, piece),
            5 => self.records::<Segment>(bytes, piece),
            6 => self.records::<ClockExchange>(bytes, piece),
            7 => self.records::<BeamFate>(bytes, piece),
            _ => self.records::<DelayPoint>(bytes, piece),
        }
    }

    fn records<R: StreamRecord + Debug>(&self, bytes: &[u8], piece: usize) -> Vec<String> {
        let bytes = Pieces { bytes: bytes.to_vec(), at: 0, piece: piece.max(1) };
        let options = self.options();
        let mut seen = Vec::new();
        let mut input = match Input::<R>::from_reader(bytes, "fuzz", self.role, &options) {
            Ok(input) => input,
            Err(error) => return vec![format!("{error:#}")],
        };
        loop {
            match input.next() {
                Ok(Some(record)) => {
                    if self.write && seen.is_empty() {
                        written_and_read(record, &options);
                    }
                    seen.push(format!("{record:?}"));
                }
                Ok(None) => return seen,
                Err(error) => {
                    seen.push(format!("{error:#}"));
                    return seen;
                }
            }
        }
    }
}

/// A record that was read can be written as CSV and is the same when it is read again, but for
/// ranges, which the streams carry to 1 um.
fn written_and_read<R: StreamRecord + Debug>(record: &R, options: &Options) {
    let path = memory_file();
    let mut output = Output::create(&path, Encoding::Csv, options).unwrap();
    output.write(record).unwrap();
    output.finish().unwrap();
    let options = Options { input_format: Some(Encoding::Csv), ..options.clone() };
    let mut input = Input::<R>::open(Some(&path), &options).unwrap();
    let mut again = input.next().unwrap().expect("a record was written").clone();
    if let (Some(scan), Some(again)) =
        ((record as &dyn Any).downcast_ref(), (&mut again as &mut dyn Any).downcast_mut())
    {
        unround(again, scan);
    }
    assert_eq!(format!("{again:?}"), format!("{record:?}"));
    assert!(input.next().unwrap().is_none());
}

/// Gives the ranges of `scan` to `again`, which has read them rounded to 1 um.
fn unround(again: &mut Scan, scan: &Scan) {
    let first = (&mut again.ranges_m, &scan.ranges_m);
    let further = again.further_ranges_m.iter_mut().zip(&scan.further_ranges_m);
    for (again, ranges_m) in std::iter::once(first).chain(further) {
        for (again_m, range_m) in again.iter_mut().zip(ranges_m.iter()) {
            // Half a micrometre, and what a division by 1000 rounds.
            let limit_m = 0.5e-6 + 4.0 * f64::EPSILON * range_m.abs();
            if (*again_m - range_m).abs() <= limit_m {
                *again_m = *range_m;
            }
        }
    }
}

/// A file of this process in memory.
pub fn memory_file() -> PathBuf {
    format!("/dev/shm/cablepose-fuzz-{}", std::process::id()).into()
}
