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

use crate::frame::Frame;
use crate::record::{BeamTable, Edge, EdgeKind, Face, NormalLine, ReflectorLines, Scan};
use association::Association;
use classification::Beam;
use photometer::{Photometer, View};

/// A mixed pixel's range is pulled out of both tolerances only if its spot covers both surfaces by
/// some per cent; then its centre is within this many spot radii of the edge.
const MIXED_REACH: f64 = 0.85;

/// Faces as [`Beam`] numbers them.
const FACES: [Face; 3] = [Face::Right, Face::Upper, Face::Left];

/// An edge with the beams that it was found at.
#[derive(Clone, Copy, Debug)]
struct Found {
    edge: Edge,
    /// The last sure beam before it and the first behind it.
    beams: (usize, usize),
    /// Angles of the first and last mixed pixel between the two, rad.
    mixed: Option<(f64, f64)>,
}

/// Measures the strip edges, scan after scan.
#[derive(Clone, Debug)]
pub struct EdgeMeter {
    frame: Frame,
    with_strips: [bool; 3],
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
            with_strips: FACES.map(|face| frame.strips_on(face).next().is_some()),
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
        classification::classify(&self.frame, self.with_strips, scan, lines, table, beams);
        found.clear();
        classification::transitions(beams, |at| {
            let seen_rad = |i: usize| table.seen_rad(i, beams[i].face_m);
            let (before, behind) = at.beams;
            found.push(Found {
                edge: Edge {
                    face: FACES[usize::from(at.face)],
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
                mixed: at
                    .mixed
                    .map(|(first, last)| (seen_rad(first), seen_rad(last))),
            });
        });
        let pose = self.association.assign(&self.frame, lines, found);
        tighten(found);
        if let Some(pose) = pose {
            let view = View {
                scan,
                table,
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

/// Draws an interval that holds mixed pixels closer around them.
fn tighten(found: &mut [Found]) {
    for Found { edge, mixed, .. } in found {
        let Some((first_rad, last_rad)) = *mixed else {
            continue;
        };
        let reach_rad = MIXED_REACH * edge.d_threshold.abs();
        if edge.strip < 0 || !(reach_rad > 0.0) {
            continue;
        }
        let from_rad = edge.from_rad.max(last_rad - reach_rad);
        let to_rad = edge.to_rad.min(first_rad + reach_rad);
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
