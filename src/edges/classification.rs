//! What every beam met: a strip's face, what is behind it, something in between, or nobody knows.

use super::planes::Planes;
use crate::frame::{Frame, disc_centre};
use crate::record::{BeamTable, ReflectorLines, Scan};

/// A hit lies within this many sigma of the line.
const HIT_SIGMA: f64 = 4.0;
/// And within at least this, and never more than that, m.
const HIT_MIN_M: f64 = 0.020;
const HIT_MAX_M: f64 = 0.060;
/// A gap is at least this share of the way to the surface behind.
const GAP_SHARE: f64 = 0.85;
/// A gap beam beside a hit is a mixed pixel if it falls short of where its neighbours further in
/// put the surface behind by more than this many sigma, and at least this, m.
const SHORT_SIGMA: f64 = 4.0;
const SHORT_MIN_M: f64 = 0.030;

/// A sure beam is like one of so many beams on either side; a gap beam in its depth behind the face,
/// to within this share of the gap.
const SUPPORT_BEAMS: usize = 4;
const SUPPORT_SHARE: f64 = 0.15;

/// A mixed pixel's range is the centre of gravity of the pulse's two parts. The part from behind
/// weighs as the surface there reflects, from this much of what the strip does to that much.
const BEHIND_WEIGHT: [f64; 2] = [0.4, 1.1];
/// What its range, as a share of the way to the surface behind, may be off.
const MIXED_SLACK: f64 = 0.03;
/// Mixed pixels lie no further than this from the sure beams around them, beams.
const MIXED_NEAR: usize = 2;

/// What a beam met.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum State {
    /// The face's line.
    Hit,
    /// The surface behind, or nothing where nothing is behind.
    Gap,
    /// Both: they came back as two echoes.
    Both,
    /// Something in between: a mixed pixel.
    Mixed,
    /// No echo, or something in front.
    Unknown,
}

/// A beam and what it met.
#[derive(Clone, Copy, Debug)]
pub(super) struct Beam {
    /// What it met.
    pub state: State,
    /// The face that it meets first, numbered as in [`Face::ALL`](crate::record::Face::ALL);
    /// [`NO_FACE`] where none carries a strip.
    pub face: u8,
    /// Range of the face's line, m.
    pub face_m: f64,
    /// How far behind the line the first echo came from, m.
    pub excess_m: f64,
    /// How far behind the line the next surface is, m.
    pub depth_m: f64,
}

/// No face with strips.
const NO_FACE: u8 = 3;

impl Beam {
    const NOTHING: Beam = Beam {
        state: State::Unknown,
        face: NO_FACE,
        face_m: f64::NAN,
        excess_m: f64::NAN,
        depth_m: f64::NAN,
    };

    fn is(&self, state: State, face: u8) -> bool {
        self.state == state && self.face == face
    }
}

/// Gives every beam its state on the face that it meets first, where that carries strips.
pub(super) fn classify(
    frame: &Frame,
    with_strips: [bool; 3],
    scan: &Scan,
    lines: &ReflectorLines,
    table: &BeamTable,
    planes: &Planes,
    beams: &mut Vec<Beam>,
) {
    let fitted = lines.lines();
    let gap_m = frame.bounds.background_gap_m;
    let ranging = Ranging {
        bias_m: frame.calibration.range_bias_m + lines.range_bias_m * frame.calibration.range_scale,
        scale: 1.0 / frame.calibration.range_scale,
        with_behind: gap_m.is_some(),
    };
    beams.clear();
    beams.resize(scan.beams(), Beam::NOTHING);
    let (mut first, mut last) = (scan.beams(), 0);
    for face in (0..3).filter(|k| with_strips[*k] && fitted[*k].is_seen()) {
        let tolerance_m = (HIT_SIGMA * fitted[face].rms_m).clamp(HIT_MIN_M, HIT_MAX_M);
        for (run, meetings) in planes.runs(face, table) {
            (first, last) = (first.min(run.start), last.max(run.end));
            let ranges_m = &scan.ranges_m[run.clone()];
            let run = beams[run].iter_mut().zip(ranges_m).zip(meetings);
            for ((beam, range_m), (face_m, behind_m)) in run {
                // A face that a beam turns away from is not met.
                if face_m > 0.0 && face_m < f64::INFINITY {
                    *beam = ranging.beam(face as u8, tolerance_m, *range_m, face_m, behind_m);
                }
            }
        }
    }
    if let Some(second_m) = scan.further_ranges_m.first() {
        for (beam, range_m) in beams.iter_mut().zip(second_m.iter()) {
            if beam.state == State::Hit && range_m.is_finite() {
                beam.state = State::Both;
            }
        }
    }
    // The rest is about faces with strips.
    let Some(beams) = beams.get_mut(first..last) else {
        return;
    };
    drop_unsupported(beams, gap_m.is_some());
    drop_contradictions(beams);
    if gap_m.is_some() {
        mark_short(beams, fitted.map(|line| line.rms_m));
    }
}

/// How a range is read.
#[derive(Clone, Copy)]
struct Ranging {
    bias_m: f64,
    scale: f64,
    /// Whether there is a surface behind the faces.
    with_behind: bool,
}

impl Ranging {
    /// What a beam met that has `face_m` to go to its face and `behind_m` to the surface behind.
    fn beam(&self, face: u8, tolerance_m: f64, range_m: f64, face_m: f64, behind_m: f64) -> Beam {
        let excess_m = (range_m - self.bias_m) * self.scale - face_m;
        let depth_m = behind_m - face_m;
        let state = if excess_m.abs() <= tolerance_m {
            State::Hit
        } else if range_m.is_nan() || excess_m < 0.0 {
            State::Unknown
        } else if !self.with_behind {
            State::Gap
        } else if range_m == f64::INFINITY {
            State::Unknown
        } else if excess_m >= GAP_SHARE * depth_m {
            State::Gap
        } else {
            State::Mixed
        };
        Beam {
            state,
            face,
            face_m,
            excess_m,
            depth_m,
        }
    }
}

/// Finds mixed pixels that reach almost to the surface behind. Where that surface really is, the
/// gap beams further from the hit tell (it need not be exactly the frame file's gap away).
fn mark_short(beams: &mut [Beam], sigma_m: [f64; 3]) {
    let n = beams.len();
    for i in 0..n {
        let Beam {
            state: State::Gap,
            face,
            excess_m,
            depth_m,
            ..
        } = beams[i]
        else {
            continue;
        };
        // Amid its like.
        let around = &beams[i.saturating_sub(2)..n.min(i + 3)];
        if around.iter().all(|b| b.state == State::Gap) {
            continue;
        }
        let tolerance_m = (SHORT_SIGMA * sigma_m[usize::from(face)]).max(SHORT_MIN_M);
        for inward in [1isize, -1] {
            let at = |k: isize| i.checked_add_signed(k * inward).filter(|j| *j < n);
            let hit_near = [-1, -2].into_iter().any(|k| {
                at(k).is_some_and(|j| {
                    beams[j].is(State::Hit, face) || beams[j].is(State::Both, face)
                })
            });
            if !hit_near {
                continue;
            }
            let mut count = 0.0;
            let mut sum = 0.0;
            for j in (2..6)
                .filter_map(at)
                .take_while(|j| beams[*j].is(State::Gap, face))
            {
                sum += beams[j].excess_m / beams[j].depth_m;
                count += 1.0;
            }
            if count >= 2.0 && excess_m < sum / count * depth_m - tolerance_m {
                beams[i].state = State::Mixed;
            }
        }
    }
}

/// A sure beam stands alone if no other within some beams says the same: a wild range that stands
/// for a hit as well as for a gap. Gap beams say the same if their depths behind the face agree
/// (with nothing behind there are none).
fn drop_unsupported(beams: &mut [Beam], with_depth: bool) {
    let agree = |a: &Beam, b: &Beam| match a.state {
        State::Hit => b.is(State::Hit, a.face) || b.is(State::Both, a.face),
        // Shares of depths compared without dividing.
        State::Gap => {
            let apart = (a.excess_m * b.depth_m - b.excess_m * a.depth_m).abs();
            b.is(State::Gap, a.face)
                && (!with_depth || apart < SUPPORT_SHARE * a.depth_m * b.depth_m)
        }
        _ => true,
    };
    for i in 0..beams.len() {
        let beam = beams[i];
        if !matches!(beam.state, State::Hit | State::Gap) || (i > 0 && agree(&beam, &beams[i - 1]))
        {
            continue;
        }
        let before = &beams[i.saturating_sub(SUPPORT_BEAMS)..i];
        let behind = &beams[i + 1..beams.len().min(i + SUPPORT_BEAMS + 1)];
        if !before.iter().chain(behind).any(|other| agree(&beam, other)) {
            beams[i].state = State::Unknown;
        }
    }
}

/// A beam that three of its four neighbours contradict and none supports is not trusted.
fn drop_contradictions(beams: &mut [Beam]) {
    // Neighbours are judged as they were found: two beams back and one back before any change.
    let nobody = (State::Unknown, NO_FACE);
    let (mut back2, mut back1) = (nobody, nobody);
    for i in 0..beams.len() {
        let here = (beams[i].state, beams[i].face);
        let other = match here.0 {
            State::Hit => State::Gap,
            State::Gap => State::Hit,
            _ => {
                (back2, back1) = (back1, here);
                continue;
            }
        };
        if back1 == here {
            (back2, back1) = (back1, here);
            continue;
        }
        let ahead = |k: usize| beams.get(i + k).map_or(nobody, |b| (b.state, b.face));
        let around = [back2, back1, ahead(1), ahead(2)];
        let against = around.iter().filter(|b| **b == (other, here.1)).count();
        if against >= 3 && !around.contains(&here) {
            beams[i].state = State::Unknown;
        }
        (back2, back1) = (back1, here);
    }
}

/// The run of sure beams before and behind an edge, as [`transitions`] reports it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Transition {
    /// The last sure beam before and the first behind.
    pub beams: (usize, usize),
    /// Whether the strip is behind it.
    pub onto_strip: bool,
    /// The face.
    pub face: u8,
    /// Whether mixed pixels are between the two.
    pub mixed: bool,
}

/// Reports a transition wherever the last sure state changes on a face.
pub(super) fn transitions(beams: &[Beam], mut report: impl FnMut(Transition)) {
    let mut last: Option<(usize, State)> = None;
    let mut mixed: Option<(usize, usize)> = None;
    let mut face = NO_FACE;
    for (i, beam) in beams.iter().enumerate() {
        if beam.face != face {
            (last, mixed, face) = (None, None, beam.face);
        }
        match beam.state {
            State::Hit | State::Gap => {}
            State::Mixed | State::Both => {
                mixed = Some((mixed.map_or(i, |(first, _)| first), i));
                continue;
            }
            State::Unknown => continue,
        }
        if let Some((before, kind)) = last
            && kind != beam.state
        {
            // A mixed pixel tells of the edge only in an unbroken run of beams: among beams that
            // something hides it may be anything.
            let mixed = mixed.is_some_and(|(first, last)| {
                first - before <= MIXED_NEAR && i - last <= MIXED_NEAR
            });
            report(Transition {
                beams: (before, i),
                onto_strip: beam.state == State::Hit,
                face,
                mixed,
            });
        }
        last = Some((i, beam.state));
        mixed = None;
    }
}

/// How far a mixed pixel's spot has its centre inside the strip, in spot radii, at least and at
/// most; `way` is its range as a share of the way from the strip to the surface behind.
pub(super) fn mixed_reach(way: f64) -> [f64; 2] {
    let inside = |way: f64, weight: f64| {
        let way = way.clamp(0.0, 1.0);
        // way = weight (1 - f) / (f + weight (1 - f)), f the share of the spot on the strip.
        let on_strip = weight * (1.0 - way);
        disc_centre(on_strip / (way + on_strip))
    };
    [
        inside(way + MIXED_SLACK, BEHIND_WEIGHT[0]),
        inside(way - MIXED_SLACK, BEHIND_WEIGHT[1]),
    ]
}
