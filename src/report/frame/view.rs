//! What the beams of a scanner meet in a frame: which reflector, which edges.

use crate::frame::{Frame, ScannerPose};
use crate::record::Face;

/// The beams of a scan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beams {
    /// Angle of the first beam, rad.
    pub angle_min_rad: f64,
    /// From beam to beam, rad.
    pub step_rad: f64,
    /// How many.
    pub count: usize,
}

impl Beams {
    /// Angle of beam `i`, rad.
    pub fn angle_rad(&self, i: usize) -> f64 {
        self.angle_min_rad + i as f64 * self.step_rad
    }
}

/// A reflector by its index in the frame file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reflector {
    /// A plate.
    Plate(usize),
    /// A strip.
    Strip(usize),
}

/// Where a beam meets the box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Met {
    /// The face.
    pub face: Face,
    /// How far along the beam, m.
    pub range_m: f64,
    /// What is there; none is the bare face.
    pub reflector: Option<Reflector>,
}

/// What the beam at an angle meets first; none where it meets neither wall nor ceiling.
pub fn met(frame: &Frame, pose: &ScannerPose, angle_rad: f64) -> Option<Met> {
    let crossings = Face::ALL.map(|face| pose.crossing(angle_rad, face).map(|c| (face, c)));
    let nearest = crossings
        .into_iter()
        .flatten()
        .min_by(|a, b| a.1.range_m.total_cmp(&b.1.range_m));
    let (face, crossing) = nearest?;
    Some(Met {
        face,
        range_m: crossing.range_m,
        reflector: reflector_at(frame, face, crossing.point_m),
    })
}

/// The reflector at a point of a face; a strip before a plate.
fn reflector_at(frame: &Frame, face: Face, [x, y, z]: [f64; 3]) -> Option<Reflector> {
    let within = |v: f64, [from, to]: [f64; 2]| v >= from && v <= to;
    let v = if face == Face::Upper { y } else { z };
    let strip = frame.strips_on(face).find(|(_, strip)| {
        let off = v - strip.offset_m - x * strip.slope();
        off.abs() <= 0.5 * strip.width_m && within(x, strip.x_span_m(&frame.bounds))
    });
    if let Some((index, _)) = strip {
        return Some(Reflector::Strip(index));
    }
    let plate = |p: &crate::frame::Plate| p.face == face && within(x, p.x_m) && within(z, p.z_m);
    frame.plates.iter().position(plate).map(Reflector::Plate)
}

/// What a scan shows: strip edges crossed, and beams on the reflectors of each face (right, upper,
/// left).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Seen {
    /// Edges.
    pub edges: u32,
    /// Beams on reflectors.
    pub points: [u32; 3],
}

/// What a scan from a pose shows.
pub fn seen(frame: &Frame, beams: &Beams, position_m: [f64; 3], rotation_rad: [f64; 3]) -> Seen {
    let pose = ScannerPose::new(frame, position_m, rotation_rad);
    let mut seen = Seen::default();
    let mut last: Option<Met> = None;
    for i in 0..beams.count {
        let now = met(frame, &pose, beams.angle_rad(i));
        if let Some(m) = now.filter(|m| m.reflector.is_some()) {
            seen.points[m.face as usize] += 1;
        }
        // Only between two beams on one face does an edge show that is the strip's and not the face's.
        if let (Some(a), Some(b)) = (last, now)
            && a.face == b.face
            && a.reflector != b.reflector
        {
            let strips = [a, b].into_iter();
            let strips = strips
                .filter(|m| matches!(m.reflector, Some(Reflector::Strip(_))))
                .count();
            let bare = a.reflector.is_none() || b.reflector.is_none();
            seen.edges += u32::from(bare && strips == 1);
        }
        last = now;
    }
    seen
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    const BEAMS: Beams = Beams {
        angle_min_rad: -5.0 * std::f64::consts::PI / 180.0,
        step_rad: 0.25 * std::f64::consts::PI / 180.0,
        count: 761,
    };

    #[test]
    fn the_middle_of_the_reference_sees_all_its_edges() {
        let text = include_str!("../../../testdata/cablar.toml");
        let frame = Frame::parse(text, Path::new("cablar.toml")).unwrap();
        let seen = seen(&frame, &BEAMS, [0.0, 0.1, 2.0], [0.0; 3]);
        assert_eq!(seen.edges, 8);
        assert!(seen.points.iter().all(|p| *p > 50), "{seen:?}");
        // Turned by 5 deg the beams pass beside the plates, which are 0.25 m wide to either side.
        let turned = super::seen(
            &frame,
            &BEAMS,
            [0.0, 0.1, 2.0],
            [0.0, 0.0, 5f64.to_radians()],
        );
        assert_eq!((turned.points[0], turned.points[2]), (0, 0));
        assert!(turned.points[1] > 50 && turned.edges == 8, "{turned:?}");
    }

    #[test]
    fn a_beam_straight_up_meets_what_is_above() {
        let text = include_str!("../../../testdata/cablar.toml");
        let frame = Frame::parse(text, Path::new("cablar.toml")).unwrap();
        let at = |y: f64| {
            let pose = ScannerPose::new(&frame, [0.0, y, 2.0], [0.0; 3]);
            met(&frame, &pose, std::f64::consts::FRAC_PI_2).unwrap()
        };
        assert_eq!(at(3.9).reflector, Some(Reflector::Strip(0)));
        assert_eq!(at(0.0).reflector, None);
        assert!((at(0.0).range_m - 3.5).abs() < 1e-12);
    }
}
