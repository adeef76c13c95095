//! Straight lines from a scan.
//!
//! A wall or a row of coplanar reflectors shows up in a scan as a run of beams whose ranges are
//! `d / cos(theta - alpha)`. This room fits such lines by maximum likelihood in the ranges, with
//! their covariance, and finds them:
//!
//! - [`fit`] one line to given beams, plain or robust, and run costs in O(1)
//! - [`segmentation`] beams that returned something, cut at the jumps between surfaces
//! - [`split_and_merge`] all lines of any scene
//! - [`reflectors`] the frame's three reflector lines, fitted jointly with the range bias

pub mod fit;
pub mod reflectors;
pub mod segmentation;
pub mod split_and_merge;

pub use split_and_merge::SplitAndMerge;
