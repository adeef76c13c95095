//! Straight lines from a scan.
//!
//! A wall or a row of coplanar reflectors shows up in a scan as a run of beams whose ranges are
//! `d / cos(theta - alpha)`. In a frame that is known, [`reflectors`] fits its three reflector
//! lines jointly with the range bias. In any other scene an [`extractor::Extractor`] finds all lines:
//!
//! - [`extractor`] what all of them have in common
//! - [`segmentation`] beams that returned something, cut at the jumps between surfaces
//! - [`fit`] one line to given beams, plain or robust, and run costs in O(1)
//! - [`split_and_merge`] runs of beams on one line each
//! - [`iepf`], [`incremental`], [`line_regression`] the classical ways to the same
//! - [`ml`] the most likely partition into runs
//! - [`cutting`] what these five share
//! - [`known_lines`] a second look at a scan, with the lines of the first
//! - [`runs`] runs of beams joined where one line explains them together
//! - [`hough`], [`ransac`], [`em`] one line after the other, from the beams that no line has taken
//! - [`taking`] what these share, [`pool`] those beams
//! - [`methods`] all of them by name
//! - [`assembly`] segments from beams on one line each
//!
//! [`dissertation`] goes Kurniawan's way to a frame's three lines and the ends of its strips.

pub mod assembly;
pub mod cutting;
pub mod dissertation;
pub mod em;
pub mod extractor;
pub mod fit;
pub mod hough;
pub mod iepf;
pub mod incremental;
pub mod known_lines;
pub mod line_regression;
pub mod methods;
pub mod ml;
pub mod pool;
pub mod ransac;
pub mod reflectors;
pub mod runs;
pub mod segmentation;
pub mod split_and_merge;
pub mod taking;
