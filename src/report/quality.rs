//! What poses rest on: edges and votes, residuals and points of the lines they came from, and why
//! scans were refused.

use super::measured::lacking;
use super::trace::Trace;
use crate::record::{Pose, ReflectorLines, Stamp, Status};
use std::collections::BTreeMap;

/// The account of a run, of a size that does not depend on its length.
#[derive(Clone, Debug, PartialEq)]
pub struct Quality {
    /// How many solved poses used so many edges: by number, the last for that many and more.
    pub edges: Vec<usize>,
    /// How many poses had so many votes; empty where none has any.
    pub votes: Vec<usize>,
    /// Edges over time.
    pub edges_trace: Trace,
    /// Votes over time; empty columns where there are none.
    pub votes_trace: Trace,
    /// Refused scans by reason, the most frequent first: the words of their status joined by `+`.
    pub refused: Vec<(String, usize)>,
    /// What the lines say, where they are given.
    pub lines: Option<LineTally>,
}

/// The counts go up to this.
const MOST: usize = 255;

/// What a refused scan without a reason is called.
const UNSAID: &str = "unsaid";

impl Quality {
    /// Of `poses`, in order of time, over a trace of `time`.
    pub(super) fn of<'a>(
        poses: impl Iterator<Item = &'a Pose>,
        time: (Stamp, Stamp),
        lines: Option<LineTally>,
    ) -> Quality {
        let mut refused: BTreeMap<u32, (Status, usize)> = BTreeMap::new();
        let mut found = Quality {
            edges: Vec::new(),
            votes: Vec::new(),
            edges_trace: Trace::new(time.0, time.1),
            votes_trace: Trace::new(time.0, time.1),
            refused: Vec::new(),
            lines,
        };
        for pose in poses {
            if let Some(votes) = pose.votes {
                count(&mut found.votes, votes);
                found
                    .votes_trace
                    .add(pose.stamp, f64::from(votes), f64::NAN);
            }
            if lacking(pose).is_some() {
                count(&mut found.edges, pose.edges);
                found
                    .edges_trace
                    .add(pose.stamp, f64::from(pose.edges), f64::NAN);
            } else {
                refused
                    .entry(pose.status.bits())
                    .or_insert((pose.status, 0))
                    .1 += 1;
            }
        }
        for (status, count) in refused.into_values() {
            let reason = reason(status);
            match found.refused.iter_mut().find(|(known, _)| *known == reason) {
                Some((_, n)) => *n += count,
                None => found.refused.push((reason, count)),
            }
        }
        found
            .refused
            .sort_by_key(|(_, count)| std::cmp::Reverse(*count));
        found
    }
}

fn count(counts: &mut Vec<usize>, value: u32) {
    let index = (value as usize).min(MOST);
    if counts.len() <= index {
        counts.resize(index + 1, 0);
    }
    if let Some(count) = counts.get_mut(index) {
        *count += 1;
    }
}

fn reason(status: Status) -> String {
    let words = status.names().filter(|word| *word != "no-pose");
    let words: Vec<&str> = words.collect();
    if words.is_empty() {
        UNSAID.to_owned()
    } else {
        words.join("+")
    }
}

/// Whether a text is a reason for which a scan can be refused.
pub(super) fn is_reason(text: &str) -> bool {
    use crate::record::Value;
    let is_word = |word: &str| {
        let mut status = Status::OK;
        let known = !word.is_empty() && word != "ok" && word != "no-pose";
        known && status.parse_text(word.as_bytes()).is_ok()
    };
    text == UNSAID || text.split('+').all(is_word)
}

/// The lines of a run, summed up.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LineTally {
    /// Where they came from.
    pub source: String,
    /// Scans.
    pub scans: usize,
    /// In the order of [`crate::record::Face::ALL`].
    pub faces: [FaceTally; 3],
    /// Scans in which each strip of the frame was met, by its number in the frame file.
    pub strips: Vec<usize>,
    /// Strips met, summed over the scans; those without a number count once an edge pair.
    strips_met: usize,
    edges: usize,
}

/// One reflector line over a run.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FaceTally {
    /// Scans in which it was seen.
    pub seen: usize,
    points: u64,
    /// Sum of squared residuals, m^2, and how many points have one.
    squares: f64,
    residuals: u64,
}

/// Most strips that are told apart.
const STRIPS: usize = 1024;

impl FaceTally {
    /// Rms of the points' residuals, m; NaN without any.
    pub fn residual_rms_m(&self) -> f64 {
        (self.squares / self.residuals as f64).sqrt()
    }

    /// Mean number of points, of the scans that saw it.
    pub fn points(&self) -> f64 {
        self.points as f64 / self.seen as f64
    }
}

impl LineTally {
    /// Of lines from `source`.
    pub fn new(source: String) -> LineTally {
        LineTally {
            source,
            ..LineTally::default()
        }
    }

    /// Takes the lines of one scan.
    pub fn add(&mut self, lines: &ReflectorLines) {
        self.scans += 1;
        for (face, line) in self.faces.iter_mut().zip(lines.lines()) {
            if !line.is_seen() {
                continue;
            }
            face.seen += 1;
            face.points += u64::from(line.points);
            if line.rms_m.is_finite() {
                face.squares += line.rms_m.powi(2) * f64::from(line.points);
                face.residuals += u64::from(line.points);
            }
        }
        self.edges += lines.edges.len();
        let mut met: Vec<i32> = lines.edges.iter().map(|edge| edge.strip).collect();
        let nameless = met.iter().filter(|strip| **strip < 0).count();
        met.sort_unstable();
        met.dedup();
        for strip in met.into_iter().filter(|strip| *strip >= 0) {
            self.strips_met += 1;
            let index = (strip as usize).min(STRIPS);
            if self.strips.len() <= index {
                self.strips.resize(index + 1, 0);
            }
            if let Some(count) = self.strips.get_mut(index) {
                *count += 1;
            }
        }
        self.strips_met += nameless.div_ceil(2);
    }

    /// Mean number of edges that a scan has.
    pub fn edges_seen(&self) -> f64 {
        self.edges as f64 / self.scans as f64
    }

    /// Mean number of strips that a scan has.
    pub fn strips_seen(&self) -> f64 {
        self.strips_met as f64 / self.scans as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::{Edge, FittedLine, NormalLine};

    #[test]
    fn refusals_have_their_whole_reason_once() {
        let refused = |status| Pose {
            status,
            ..Pose::default()
        };
        let solved = |edges, votes| Pose {
            position_m: [0.0; 3],
            rotation_rad: [0.0; 3],
            edges,
            votes,
            ..Pose::default()
        };
        let poses = [
            refused(Status::NO_POSE | Status::NO_UPPER | Status::NO_WALLS),
            refused(Status::NO_POSE | Status::NO_WALLS),
            refused(Status::NO_POSE | Status::NO_WALLS),
            refused(Status::NO_POSE),
            refused(Status::OK),
            solved(8, Some(3)),
            solved(8, None),
            solved(1000, Some(0)),
        ];
        let time = (Stamp::default(), Stamp::from_ns(1));
        let found = Quality::of(poses.iter(), time, None);
        let want = [("no-walls", 2), ("unsaid", 2), ("no-upper+no-walls", 1)];
        let mut got: Vec<(&str, usize)> = found
            .refused
            .iter()
            .map(|(w, n)| (w.as_str(), *n))
            .collect();
        got.sort_by_key(|(word, n)| (std::cmp::Reverse(*n), *word));
        assert_eq!(got, want);
        assert!(found.refused.iter().all(|(word, _)| is_reason(word)));
        assert!(!is_reason("odd") && !is_reason("") && !is_reason("no-walls+") && !is_reason("ok"));
        assert_eq!(
            (found.edges[8], found.edges.len(), found.edges[MOST]),
            (2, MOST + 1, 1)
        );
        assert_eq!(found.votes, [1, 0, 0, 1]);
    }

    #[test]
    fn residuals_weigh_by_their_points() {
        let line = |points, rms_m| FittedLine {
            normal: NormalLine::new(2.0, 0.0),
            points,
            rms_m,
            ..FittedLine::default()
        };
        let edge = |strip| Edge {
            strip,
            ..Edge::default()
        };
        let mut tally = LineTally::new("lines.csv".to_owned());
        tally.add(&ReflectorLines {
            right: line(10, 0.003),
            upper: line(100, 0.004),
            edges: vec![edge(2), edge(2), edge(0), edge(0)],
            ..ReflectorLines::default()
        });
        tally.add(&ReflectorLines {
            right: line(30, 0.001),
            edges: vec![edge(2), edge(2), edge(-1), edge(-1)],
            ..ReflectorLines::default()
        });
        let [right, upper, left] = tally.faces;
        assert_eq!((right.seen, upper.seen, left.seen), (2, 1, 0));
        let rms = ((10.0 * 9e-6 + 30.0 * 1e-6) / 40f64).sqrt();
        assert!((right.residual_rms_m() - rms).abs() < 1e-12 && right.points() == 20.0);
        assert!(left.residual_rms_m().is_nan() && left.points().is_nan());
        assert_eq!((tally.strips_seen(), tally.edges_seen()), (2.0, 4.0));
        assert_eq!(tally.strips, [1, 0, 2]);
    }
}
