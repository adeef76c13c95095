//! What a run of poses is worth: its error against a true or desired trajectory, per component,
//! over time and over the workspace; whether its covariances are honest; what became of every scan.
//! And what extracted lines are worth ([`lines`]).
//!
//! The way through the room:
//!
//! - [`Reference`] finds the trajectory's pose at a pose's instant ([`Association`]);
//! - [`evaluate`] joins [`Run`]s to it, run by run and zone by zone ([`Zone`]), into [`Case`]s: a
//!   case holds only what the outputs show and has the same size whatever the run's length;
//! - [`Gate`] compares a case's statistics with limits (`--fail-if`);
//! - [`Recording`] sums a record of an IMU at rest up to an [`Inertial`]: its Allan deviations;
//! - [`terminal`], [`json`] and [`page`] show a [`Report`].
//!
//! An error is measured minus reference. Inside, errors are in metres and radians; only the three
//! outputs speak of millimetres and degrees ([`Axis`]).

mod association;
mod axis;
mod canvas;
mod case;
mod consistency;
pub mod diff;
pub mod dilution;
mod figure;
mod gate;
mod inertial;
pub mod json;
pub mod lines;
mod measured;
mod merge;
mod number;
pub mod origin;
pub mod page;
mod pushes;
mod scale;
mod scans;
mod statistics;
pub mod terminal;
mod trace;
mod workspace;
mod zone;

pub use association::{Association, Limits, Match, Matching, Reference, Unmatched};
pub use axis::{AXES, Axis};
pub use case::{AxisResult, Case, Report, Run, Settings, evaluate};
pub use consistency::{Consistency, GROUPS, effective_number};
pub use gate::{Gate, GateError, Verdict};
pub use inertial::{Inertial, Recording};
pub use merge::merge;
pub use scans::{Scans, Tally};
pub use statistics::{Statistics, percentile, wrap_angle};
pub use trace::{Histogram, Trace, TraceColumn};
pub use workspace::{Cell, Cells, Layout};
pub use zone::{Zone, ZoneError};
