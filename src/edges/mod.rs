//! Strip edges from a scan and its reflector lines.
//!
//! On a face that carries strips every beam is a hit (it returned from the face's line), a gap (it
//! went on to the surface behind), or neither. Between the last sure beam of one kind and the first
//! of the other lies an edge: its interval. Mixed pixels, cables and cargo only make an interval
//! longer, never wrong. Each edge is then given the strip that it belongs to, and where the device
//! sends remissions, its place between the beams is measured from them.

mod association;
mod classification;
mod footprint;
mod photometer;
mod photometry;
mod planes;

use crate::frame::Frame;
use crate::record::{BeamTable, Edge, EdgeKind, Face, NormalLine, ReflectorLines, Scan};
use association::Association;
use classification::{Beam, State};
use photometer::{Photometer, View};
use planes::Planes;

/// A spot that came back from both surfaces as two echoes covers both by some per cent: its centre is
/// within this many spot radii of the edge.
const BOTH_REACH: f64 = 0.85;

/// More mixed pixels in a row than this are not those of an edge.
const MIXED_RUN: usize = 3;

/// Two edges with nothing but hits between them are a strip's, and with nothing but gaps two
/// neighbours'. Runs below this share of the narrowest that the frame has are wild ranges (a turned
/// platform sees them shorter, and nothing else does).
const RUN_SHARE: f64 = 0.7;
/// The platform is no further than this from x = 0, m.
const X_MAX_M: f64 = 0.5;

/// An edge with the beams that it was found at.
#[derive(Clone, Copy, Debug)]
struct Found {
    edge: Edge,
    /// The last sure beam before it and the first behind it.
    beams: (usize, usize),
    /// Whether mixed pixels are between the two.
    mixed: bool,
}

/// Measures the strip edges, scan after scan.
#[derive(Clone, Debug)]
pub struct EdgeMeter {
    frame: Frame,
    with_strips: [bool; 3],
    /// Of each face: the narrowest run of hits and the narrowest run of gaps, m.
    narrowest_m: [[f64; 2]; 3],
    table: BeamTable,
    beams: Vec<Beam>,
    found: Vec<Found>,
    association: Association,
    photometer: Photometer,
}

impl EdgeMeter {
    /// A meter for scans taken in `frame`.
    pub fn new(frame: &Frame) -> EdgeMeter {
        EdgeMeter {
            frame: frame.clone(),
            with_strips: Face::ALL.map(|face| frame.strips_on(face).next().is_some()),
            narrowest_m: Face::ALL.map(|face| narrowest_m(frame, face)),
            table: BeamTable::default(),
            beams: Vec::new(),
            found: Vec::new(),
            association: Association::new(frame),
            photometer: Photometer::new(frame),
        }
    }

    /// Finds the edges of `scan` on the faces whose lines are known and puts them into `lines`.
    /// All angles are those under which the scanner at the reference instant sees the face's
    /// points.
    pub fn measure(&mut self, scan: &Scan, lines: &mut ReflectorLines) {
        self.table.fit_moving(scan, lines.motion());
        let (table, beams, found) = (&self.table, &mut self.beams, &mut self.found);
        let gap_m = self.frame.bounds.background_gap_m.unwrap_or(0.0);
        let planes = Planes::new(lines, table.motion(), gap_m);
        classification::classify(
            &self.frame,
            self.with_strips,
            scan,
            lines,
            table,
            &planes,
            beams,
        );
        found.clear();
        classification::transitions(beams, |at| {
            let seen_rad = |i: usize| table.seen_rad(i, beams[i].face_m);
            let (before, behind) = at.beams;
            found.push(Found {
                edge: Edge {
                    face: Face::ALL[usize::from(at.face)],
                    kind: if at.onto_strip {
                        EdgeKind::On
                    } else {
                        EdgeKind::Off
                    },
                    from_rad: seen_rad(before),
                    to_rad: seen_rad(behind),
                    time_s: table
                        .time_at_s(0.5 * (table.angle_rad(before) + table.angle_rad(behind))),
                    ..Edge::default()
                },
                beams: at.beams,
                mixed: at.mixed,
            });
        });
        drop_narrow(found, beams, table, &self.narrowest_m);
        let pose = self.association.assign(&self.frame, lines, found);
        tighten(found, beams, table);
        if let Some(pose) = pose {
            let view = View {
                scan,
                table,
                planes: &planes,
                beams,
                lines,
                pose: &pose,
            };
            self.photometer.measure(&self.frame, &view, found);
        }
        lines.edges.clear();
        lines.edges.extend(found.iter().map(|found| found.edge));
    }
}

/// The narrowest strip of a face and the narrowest gap between two, each less what no slant of the
/// platform takes off, m.
fn narrowest_m(frame: &Frame, face: Face) -> [f64; 2] {
    let strips: Vec<_> = frame.strips_on(face).map(|(_, strip)| strip).collect();
    let width_m = strips.iter().map(|s| s.width_m).fold(f64::MAX, f64::min);
    let between_m = |(i, a): (usize, &&crate::frame::Strip)| {
        let to = |b: &&crate::frame::Strip| {
            let nearer_m = (a.slope() - b.slope()).abs() * X_MAX_M;
            (a.offset_m - b.offset_m).abs() - 0.5 * (a.width_m + b.width_m) - nearer_m
        };
        strips[i + 1..].iter().map(to).fold(f64::MAX, f64::min)
    };
    let gap_m = strips.iter().enumerate().map(between_m);
    [width_m, gap_m.fold(f64::MAX, f64::min)].map(|m| {
        if m < f64::MAX {
            RUN_SHARE * m.max(0.0)
        } else {
            0.0
        }
    })
}

/// Takes away both edges of a run that is too narrow to be a strip or the gap between two, the
/// narrowest first.
fn drop_narrow(
    found: &mut Vec<Found>,
    beams: &[Beam],
    table: &BeamTable,
    narrowest_m: &[[f64; 2]; 3],
) {
    let point = |i: usize| {
        let (cos, sin) = table.cos_sin[i];
        [beams[i].face_m * cos, beams[i].face_m * sin]
    };
    loop {
        let share = |pair: &[Found]| {
            let [a, b] = pair else { return f64::MAX };
            if a.edge.face != b.edge.face {
                return f64::MAX;
            }
            // From the last beam that is sure to be outside to the first that is again.
            let ([y0, z0], [y1, z1]) = (point(a.beams.0), point(b.beams.1));
            let of = narrowest_m[a.edge.face as usize];
            let least_m = of[usize::from(a.edge.kind != EdgeKind::On)];
            (y1 - y0).hypot(z1 - z0) / least_m
        };
        let narrow = found.windows(2).map(share).enumerate();
        match narrow.min_by(|a, b| a.1.total_cmp(&b.1)) {
            Some((k, share)) if share < 1.0 => drop(found.drain(k..k + 2)),
            _ => return,
        }
    }
}

/// Draws an interval that holds mixed pixels closer around them.
fn tighten(found: &mut [Found], beams: &[Beam], table: &BeamTable) {
    for Found {
        edge,
        beams: (before, behind),
        mixed,
    } in found
    {
        let out_rad = edge.d_threshold;
        if !*mixed || edge.strip < 0 || !(out_rad.abs() > 0.0) {
            continue;
        }
        // Beside a cable or a cargo a range between the two may be of anything.
        let between = beams.get(*before + 1..*behind).unwrap_or_default();
        let clear = |b: &Beam| matches!(b.state, State::Mixed | State::Both);
        if between.len() > MIXED_RUN || !between.iter().all(clear) {
            continue;
        }
        let (mut from_rad, mut to_rad) = (edge.from_rad, edge.to_rad);
        for (i, beam) in (*before + 1..).zip(between) {
            let [low, high] = match beam.state {
                State::Mixed => classification::mixed_reach(beam.excess_m / beam.depth_m),
                State::Both => [-BOTH_REACH, BOTH_REACH],
                _ => continue,
            };
            // The boundary is further out than the spot's centre by as much as that is inside.
            let seen_rad = table.seen_rad(i, beam.face_m);
            let (a_rad, b_rad) = (seen_rad + low * out_rad, seen_rad + high * out_rad);
            from_rad = from_rad.max(a_rad.min(b_rad));
            to_rad = to_rad.min(a_rad.max(b_rad));
        }
        if from_rad < to_rad {
            (edge.from_rad, edge.to_rad) = (from_rad, to_rad);
        }
    }
}

/// cos(alpha), sin(alpha), d of a line.
fn components(normal: &NormalLine) -> (f64, f64, f64) {
    let (sin, cos) = normal.alpha_rad.sin_cos();
    (cos, sin, normal.d_m)
}

#[cfg(test)]
mod remission_tests;
#[cfg(test)]
mod tests;
