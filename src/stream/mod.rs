//! How records flow: CSV and MCAP with ROS 2 messages (and, for trajectories, TUM and EuRoC), sniffed
//! on input, chosen on output; the flush rule, the side inputs, the exit statuses.
//!
//! The only place that knows what `-` is, which encoding a stream has and when it is flushed. A
//! filter gives [`filter()`] its [`Stage`], a source writes to an [`Output`] until [`Stop`] asks it
//! to end, a sink reads an [`Input`] or [`read_all`], and each gets this behaviour with it:
//!
//! - A record goes out as soon as it is complete when the input is live: before a read that may
//!   block, everything written is flushed. While input is waiting, output is batched.
//! - A consumer that left (a closed pipe) ends a tool quietly with status 0.
//! - `-o NAME` writes `NAME.partial` and renames it at the end.
//! - A bad record names file, line and column and ends the tool with status 65, everything before
//!   it written; `--skip-bad` counts and skips it. [`exit`] has the other statuses.
//! - The first SIGINT ends a source in good order, and a filter only when the end has come through.

mod cdr;
mod check;
mod convert;
mod copies;
mod csv;
pub mod exit;
mod filter;
mod flow;
mod input;
mod kinds;
mod mcap;
mod output;
mod passing;
#[cfg(unix)]
mod patient;
mod progress;
mod provenance;
mod reader;
mod ros2;
#[cfg(test)]
mod round_trip_tests;
#[cfg(test)]
mod samples;
#[cfg(test)]
pub(crate) mod scratch;
mod side;
mod topics;
mod trajectory_text;
pub mod viewer;
mod whole_file;
mod window;

pub use check::{BadField, StreamRecord};
pub use convert::{Lane, Loss, lane_of, lanes, write_lanes};
pub use copies::{StreamCopy, copies};
pub use exit::Fault;
pub use filter::{Emit, Stage, filter};
pub use flow::Stop;
pub(crate) use flow::outlive_file_limit;
pub use input::{Bytes, Input, read_all};
pub use kinds::{Kind, KindVisitor};
pub use output::Output;
pub use passing::{pass_unchanged, passes_unchanged};
#[cfg(unix)]
pub(crate) use patient::leave_stuck_writes;
pub use provenance::Provenance;
#[cfg(not(unix))]
pub(crate) use reader::leave_stuck_writes;
pub use reader::reader_left;
pub use side::SideInput;
pub use topics::{TopicContents, topics};
pub use whole_file::WholeFile;
pub use window::{Place, WindowState};

use crate::record::Stamp;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// The encodings of a stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// RFC 4180 with a header row; one kind of record.
    Csv,
    /// MCAP, profile ros2, CDR messages; all kinds of records together.
    Mcap,
    /// The TUM benchmark's text: poses and trajectories, without covariance or status.
    Tum,
    /// The EuRoC dataset's text: the same, with a trajectory's velocity.
    Euroc,
}

impl Encoding {
    /// The text layout of a trajectory in another kit's format.
    fn layout(self) -> Option<trajectory_text::Layout> {
        match self {
            Encoding::Csv | Encoding::Mcap => None,
            Encoding::Tum => Some(trajectory_text::Layout::Tum),
            Encoding::Euroc => Some(trajectory_text::Layout::Euroc),
        }
    }

    /// What a filter writes unless told otherwise: the encoding that it reads, CSV where that
    /// could not hold all that a record has.
    fn of_filter(self) -> Encoding {
        match self {
            Encoding::Mcap => Encoding::Mcap,
            Encoding::Csv | Encoding::Tum | Encoding::Euroc => Encoding::Csv,
        }
    }
}

/// A window of time that records must lie in.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Window {
    /// First instant, or seconds after the stream's first record.
    pub from: Option<Instant>,
    /// Last instant, or seconds after the stream's first record.
    pub to: Option<Instant>,
}

/// One end of a [`Window`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Instant {
    /// Nanoseconds since the epoch.
    At(Stamp),
    /// Seconds after the stream's first record (`+10s`).
    After(f64),
}

/// What every tool's common options say about its streams.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// The tool's name, for messages and provenance.
    pub tool: &'static str,
    /// `-o`: the output file; none is stdout.
    pub output: Option<PathBuf>,
    /// `--format`: encoding of the output; none is the input's, or CSV for a source.
    pub format: Option<Encoding>,
    /// `--input-format`: encoding of the input; none is sniffed.
    pub input_format: Option<Encoding>,
    /// `--skip-bad`: count and skip bad records.
    pub skip_bad: bool,
    /// `--from`, `--to`.
    pub window: Window,
    /// `-q`.
    pub quiet: bool,
    /// `-v`, counted.
    pub verbose: u8,
    /// Whether CSV says in lines above its header where it comes from (`--meta`); it does anyway
    /// where its input does.
    pub meta: bool,
    /// Seed of a simulation, for the provenance record.
    pub seed: Option<u64>,
    /// Configuration text (the frame file), for the provenance record.
    pub configuration: Option<String>,
    /// What else is to be known of where the stream comes from, for the provenance record: the
    /// device's identity and state.
    pub notes: BTreeMap<String, String>,
}

/// How a tool that did not fail ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Everything done: status 0.
    Done,
    /// Done, but records were lost, skipped or none could be solved: status 3.
    Degraded,
    /// A `--fail-if` gate failed: status 4.
    GateFailed,
}

/// Topic of a trajectory stream in MCAP.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// `/truth`
    Truth,
    /// `/desired`
    Desired,
}
