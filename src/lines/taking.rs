//! What the extractors share that take one line after the other from the beams that no line has
//! taken yet. How a line is found is theirs: [`Taker`].

use super::assembly::Assembly;
use super::extractor::{Extractor, ExtractorOptions, Fate};
use super::fit::{BeamSlice, InverseLine};
use super::pool::Pool;
use super::segmentation::Returns;
use crate::record::{NormalLine, Scan, Segment};
use std::ops::Range;

/// A way to find lines among free beams.
pub trait Taker {
    /// Its settings.
    type Options;

    /// A taker with the given settings.
    fn new(options: Self::Options) -> Self;

    /// What all extractors share.
    fn common(&self) -> &ExtractorOptions;

    /// Begins a scan, all of whose beams are free.
    fn begin(&mut self, scan: &Scan, scene: &mut Scene<'_>);

    /// Takes lines from the free beams of a group. This is asked for again as long as it finds any:
    /// beams that were left aside may be of a line that lacked them.
    fn take(&mut self, group: Range<usize>, scene: &mut Scene<'_>);

    /// Tells which lines to expect; see [`Extractor::expect`].
    fn expect(&mut self, _lines: &[NormalLine]) {}
}

/// The scan at hand: its beams, and the segments that were made of those that are not free.
pub struct Scene<'a> {
    returns: &'a Returns,
    options: &'a ExtractorOptions,
    pool: &'a mut Pool,
    assembly: &'a mut Assembly,
    segments: &'a mut Vec<Segment>,
}

impl<'a> Scene<'a> {
    /// Ranges and points of all beams.
    pub fn beams(&self) -> BeamSlice<'a> {
        self.returns.beams()
    }

    /// Whether no line has taken a beam.
    #[inline]
    pub fn is_free(&self, beam: usize) -> bool {
        self.pool.is_free(beam)
    }

    /// The free ones of these beams.
    pub fn free(&self, beams: Range<usize>) -> impl Iterator<Item = usize> {
        beams.filter(move |k| self.pool.is_free(*k))
    }

    /// How many of these beams are free.
    pub fn count(&self, beams: Range<usize>) -> usize {
        self.pool.count(beams)
    }

    /// Takes the beams of the longest row on a line that lies within `reach_m` of `line`. Tells
    /// whether there was one.
    pub fn take(&mut self, line: InverseLine, reach_m: f64) -> bool {
        self.pool.take(
            self.returns,
            line,
            reach_m,
            self.options,
            self.assembly,
            self.segments,
        )
    }
}

/// An extractor that takes one line after the other: a taker with the buffers of a scan.
#[derive(Clone, Debug)]
pub struct Taking<T> {
    pub(super) taker: T,
    returns: Returns,
    pool: Pool,
    assembly: Assembly,
}

impl<T: Taker> Taking<T> {
    /// An extractor with the given settings.
    pub fn new(options: T::Options) -> Taking<T> {
        Taking {
            taker: T::new(options),
            returns: Returns::default(),
            pool: Pool::default(),
            assembly: Assembly::default(),
        }
    }
}

impl<T: Taker> Default for Taking<T>
where
    T::Options: Default,
{
    fn default() -> Taking<T> {
        Taking::new(T::Options::default())
    }
}

impl<T: Taker> Extractor for Taking<T> {
    fn extract(&mut self, scan: &Scan, out: &mut Vec<Segment>) {
        out.clear();
        let options = *self.taker.common();
        self.returns.read(scan, &options.segmentation);
        self.assembly.begin(scan, &self.returns, &options);
        self.pool.begin(&self.returns);
        let mut scene = Scene {
            returns: &self.returns,
            options: &options,
            pool: &mut self.pool,
            assembly: &mut self.assembly,
            segments: out,
        };
        self.taker.begin(scan, &mut scene);
        for (from, to) in self.returns.groups() {
            let mut before = usize::MAX;
            while scene.segments.len() != before {
                before = scene.segments.len();
                self.taker.take(from..to, &mut scene);
            }
        }
        self.assembly.end(out);
    }

    fn fates(&self) -> &[Fate] {
        self.assembly.fates()
    }

    fn expect(&mut self, lines: &[NormalLine]) {
        self.returns.expect(lines);
        self.taker.expect(lines);
    }
}
