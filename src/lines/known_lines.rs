//! A second look at a scan with the lines that the first look found.
//!
//! The dissertation's segmentation needs to know how surfaces run before it can tell a jump from a
//! surface seen at a slant (Kurniawan 2017, eq. 4.19 to 4.21; its lines come "from the previous
//! step"). Here the first look cuts the scan another way and finds lines; with them the second look
//! cuts it again.

use super::extractor::{Extractor, Fate};
use crate::record::{NormalLine, Scan, Segment};

/// Two extractors, the second of which is told what the first one found.
pub struct SecondLook {
    first: Box<dyn Extractor>,
    second: Box<dyn Extractor>,
    found: Vec<Segment>,
    lines: Vec<NormalLine>,
}

impl SecondLook {
    /// Tells `second` the lines that `first` finds, in every scan.
    pub fn new(first: Box<dyn Extractor>, second: Box<dyn Extractor>) -> SecondLook {
        SecondLook {
            first,
            second,
            found: Vec::new(),
            lines: Vec::new(),
        }
    }
}

impl Extractor for SecondLook {
    fn extract(&mut self, scan: &Scan, out: &mut Vec<Segment>) {
        self.first.extract(scan, &mut self.found);
        self.lines.clear();
        self.lines.extend(self.found.iter().map(|s| s.normal));
        self.second.expect(&self.lines);
        self.second.extract(scan, out);
    }

    fn fates(&self) -> &[Fate] {
        self.second.fates()
    }

    fn expect(&mut self, lines: &[NormalLine]) {
        self.first.expect(lines);
    }
}
