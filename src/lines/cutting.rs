//! What the extractors share that cut each group of neighbouring beams into runs on one line each,
//! and then join the runs that one line explains together. How a group is cut is theirs:
//! [`Cutter`].

use super::assembly::Assembly;
use super::extractor::{Extractor, ExtractorOptions, Fate};
use super::fit::BeamSlice;
use super::runs::{MergeRule, Runs};
use super::segmentation::Returns;
use crate::record::{NormalLine, Scan, Segment};

/// A way to cut a group of neighbouring beams into runs.
pub trait Cutter {
    /// Its settings.
    type Options;

    /// A cutter with the given settings.
    fn new(options: Self::Options) -> Self;

    /// What all extractors share.
    fn common(&self) -> &ExtractorOptions;

    /// Which runs of `scan` may be joined.
    fn merge_rule(&self, scan: &Scan) -> MergeRule;

    /// Adds the runs of `group`, whose first beam is the return with number `offset`, to `runs`, in
    /// beam order.
    fn cut(&mut self, group: BeamSlice<'_>, offset: usize, runs: &mut Runs);
}

/// An extractor that cuts and joins: a cutter with the buffers of a scan.
#[derive(Clone, Debug, Default)]
pub struct Cutting<C> {
    cutter: C,
    returns: Returns,
    runs: Runs,
    assembly: Assembly,
}

impl<C: Cutter> Cutting<C> {
    /// An extractor with the given settings.
    pub fn new(options: C::Options) -> Cutting<C> {
        Cutting {
            cutter: C::new(options),
            returns: Returns::default(),
            runs: Runs::default(),
            assembly: Assembly::default(),
        }
    }
}

impl<C: Cutter> Extractor for Cutting<C> {
    fn extract(&mut self, scan: &Scan, out: &mut Vec<Segment>) {
        let options = *self.cutter.common();
        self.returns.read(scan, &options.segmentation);
        self.runs.clear();
        for (from, to) in self.returns.groups() {
            let group = self.returns.beams().run(from, to);
            self.cutter.cut(group, from, &mut self.runs);
        }
        self.runs
            .merge(&self.returns, &self.cutter.merge_rule(scan));
        self.assembly
            .add_all(scan, &self.returns, &self.runs, &options, out);
    }

    fn fates(&self) -> &[Fate] {
        self.assembly.fates()
    }

    fn expect(&mut self, lines: &[NormalLine]) {
        self.returns.expect(lines);
    }
}

/// Parts the beams `0..length` where `border` says, and each part again until it names no border
/// any more; gives out the parts in beam order. `pending` is a buffer to use again.
pub(super) fn halve(
    pending: &mut Vec<(usize, usize)>,
    length: usize,
    border: impl Fn(usize, usize) -> Option<usize>,
    mut part: impl FnMut(usize, usize),
) {
    pending.clear();
    pending.push((0, length));
    while let Some((from, to)) = pending.pop() {
        match border(from, to) {
            Some(border) => {
                // The left half is taken up first.
                pending.push((border, to));
                pending.push((from, border));
            }
            None => part(from, to),
        }
    }
}
