//! What a run of poses is worth: its error against a true or desired trajectory, per component,
//! over time and over the workspace; whether its covariances are honest; what became of every scan.
//!
//! The way through the room:
//!
//! - [`Reference`] finds the trajectory's pose at a pose's instant ([`Association`]);
//! - [`evaluate`] joins [`Run`]s to it, aligned ([`Align`]) and freed of their [`Delay`] where that is
//!   wanted, and sums them up run by run and zone by zone ([`Zone`]) in [`Case`]s: absolute and
//!   [`Relative`] errors, errors along and across the way ([`Track`]), [`Orientation`] against an IMU,
//!   what the poses rest on ([`Quality`]), what was wrong with the rows ([`Disorder`]). A case holds
//!   only what the outputs show and has the same size whatever the run's length;
//! - [`Gate`] compares a case's statistics with limits (`--fail-if`);
//! - [`Recording`] sums a record of an IMU at rest up to an [`Inertial`]: its Allan deviations;
//! - [`terminal`], [`json`], [`tables`] and [`page`] show a [`Report`]; each [`Figure`] of the page can
//!   be had as a file of its own, SVG or PNG. [`chain`] says where a report comes from, [`export`] what
//!   its poses are to other kits.
//!
//! Beside poses: [`lines`] scores extracted lines, [`standing`] finds where a run stands, [`scan`] draws
//! a scan, [`frame`] what a frame allows, [`robot`] tells of pulleys, [`diff`] where two files differ.
//!
//! An error is measured minus reference. Inside, errors are in metres and radians; only the outputs
//! speak of millimetres and degrees ([`Axis`]).

mod align;
mod association;
mod axis;
mod canvas;
mod case;
pub mod chain;
mod consistency;
pub mod diff;
pub mod dilution;
mod disorder;
mod drafting;
mod evaluate;
pub mod export;
mod figure;
pub mod frame;
mod gate;
mod gathered;
mod inertial;
pub mod json;
mod lag;
pub mod lines;
mod measured;
mod merge;
mod notes;
mod number;
mod orientation;
pub mod origin;
pub mod page;
mod picture;
mod pixels;
mod pushes;
mod quality;
mod relative;
pub mod robot;
mod scale;
pub mod scan;
mod scans;
mod stability;
pub mod standing;
mod statistics;
pub mod tables;
pub mod terminal;
mod trace;
mod workspace;
mod zone;

pub use align::{Align, Alignment, AlignmentError};
pub use association::{Association, Limits, Match, Matching, Reference, Unmatched};
pub use axis::{AXES, Axis};
pub use case::{AxisResult, Case, Report, Run, Settings, Track};
pub use consistency::{Consistency, GROUPS, effective_number};
pub use disorder::Disorder;
pub use evaluate::evaluate;
pub use figure::MapStyle;
pub use gate::{Gate, GateError, Verdict};
pub use inertial::allan::Point as AllanPoint;
pub use inertial::{Inertial, Recording};
pub use lag::{Delay, DelayChoice};
pub use merge::merge;
pub use orientation::{AngleResult, Attitudes, Orientation, RateResult};
pub use picture::{Figure, PictureError};
pub use quality::{FaceTally, LineTally, Quality};
pub use relative::{Delta, DeltaError, Pairs, Relative, Span};
pub use scans::{Scans, Tally};
pub use stability::Stability;
pub use statistics::{Statistics, percentile, wrap_angle};
pub use trace::{Histogram, Trace, TraceColumn};
pub use workspace::{Cell, Cells, Layout};
pub use zone::{Zone, ZoneError};
