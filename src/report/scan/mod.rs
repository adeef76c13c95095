//! One scan as it is: its beams, which of them lie on the reflector lines, the lines, the edges and
//! the residuals, in the axes that the scanner has at the lines' reference instant.

mod figures;
mod outputs;
mod page;

pub use figures::figures;
pub use outputs::{json, table};
pub use page::page;

use super::frame::view::{self, Reflector};
use crate::frame::{Frame, ScannerPose};
use crate::record::{BeamTable, ReflectorLines, Scan, ScanMotion, Stamp};

/// A beam is on a line where its residual is below so many of the line's rms residuals.
const ON_LINE: f64 = 4.0;
/// The least residual that puts a beam off a line, m.
const LEAST_M: f64 = 0.004;
/// Gap of the angles at which the true frame is looked at, rad.
const FINE_RAD: f64 = 0.05 * std::f64::consts::PI / 180.0;

/// A beam with a return.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beam {
    /// Angle as the scan states it, rad.
    pub angle_rad: f64,
    /// Range as measured, m.
    pub range_m: f64,
    /// Where it ends (y, z), the range bias and the scanner's motion taken out, m.
    pub at_m: [f64; 2],
    /// Remission, the device's digits.
    pub remission: Option<f32>,
    /// The line that it would meet first (0 right, 1 upper, 2 left) and how far beyond it ends, m.
    pub residual: Option<(usize, f64)>,
    /// Whether it lies on that line.
    pub on_line: bool,
}

/// A scan made ready to be shown.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// Sequence number.
    pub seq: u32,
    /// Stamp.
    pub stamp: Stamp,
    /// Beams of the scan.
    pub count: usize,
    /// Those with a return.
    pub beams: Vec<Beam>,
    /// What was found in it; none where no lines came for it.
    pub lines: Option<ReflectorLines>,
    /// The true reflectors in the scan plane: the name and the points from beam to beam.
    pub reflectors: Vec<(String, Vec<[f64; 2]>)>,
}

/// Makes a scan ready, with its lines if there are any, and the frame as it is seen from a platform
/// at a position (m) and roll, pitch and yaw (rad).
pub fn view(
    scan: &Scan,
    lines: Option<&ReflectorLines>,
    truth: Option<(&Frame, [f64; 3], [f64; 3])>,
) -> View {
    let motion = lines.map_or(ScanMotion::REST, ReflectorLines::motion);
    let mut table = BeamTable::default();
    table.fit_moving(scan, motion);
    let bias_m = lines.map_or(0.0, |l| l.range_bias_m);
    let bias_m = if bias_m.is_finite() { bias_m } else { 0.0 };
    let rays = scan.ranges_m.iter().zip(&table.cos_sin).enumerate();
    let returned = rays.filter(|(_, (range_m, _))| range_m.is_finite() && **range_m > 0.0);
    let beams = returned.map(|(i, (range_m, (cos, sin)))| {
        let origin = table.origin_m(i);
        let range_true_m = range_m - bias_m;
        let residual = lines.and_then(|l| first_line(l, origin, (*cos, *sin)));
        let residual = residual.map(|(k, expected_m)| (k, range_true_m - expected_m));
        let on_line = residual.is_some_and(|(k, off_m)| {
            let rms_m = lines.and_then(|l| l.lines().get(k).map(|line| line.rms_m));
            let rms_m = rms_m.filter(|r| r.is_finite()).unwrap_or(0.0);
            off_m.abs() <= (ON_LINE * rms_m).max(LEAST_M)
        });
        Beam {
            angle_rad: scan.angle_rad(i),
            range_m: *range_m,
            at_m: [origin.0 + range_true_m * cos, origin.1 + range_true_m * sin],
            remission: scan.remissions.get(i).copied(),
            residual,
            on_line,
        }
    });
    View {
        seq: scan.seq,
        stamp: scan.stamp,
        count: scan.beams(),
        beams: beams.collect(),
        lines: lines.cloned(),
        reflectors: truth.map_or(Vec::new(), |(frame, position_m, rotation_rad)| {
            let pose = ScannerPose::new(frame, position_m, rotation_rad);
            let last = scan.angle_rad(scan.beams().saturating_sub(1));
            reflectors(frame, &pose, [scan.angle_min_rad, last])
        }),
    }
}

/// The line that a ray meets first, and at what distance, m.
fn first_line(
    lines: &ReflectorLines,
    (y, z): (f64, f64),
    (cos, sin): (f64, f64),
) -> Option<(usize, f64)> {
    let met = lines
        .lines()
        .into_iter()
        .enumerate()
        .filter(|(_, line)| line.is_seen());
    let met = met.filter_map(|(k, line)| {
        let (sin_alpha, cos_alpha) = line.normal.alpha_rad.sin_cos();
        let towards = cos * cos_alpha + sin * sin_alpha;
        let distance_m = (line.normal.d_m - (y * cos_alpha + z * sin_alpha)) / towards;
        (towards > 0.0 && distance_m > 0.0 && distance_m.is_finite()).then_some((k, distance_m))
    });
    met.min_by(|a, b| a.1.total_cmp(&b.1))
}

/// The frame's reflectors between two angles, in the scan plane.
fn reflectors(
    frame: &Frame,
    pose: &ScannerPose,
    [from, to]: [f64; 2],
) -> Vec<(String, Vec<[f64; 2]>)> {
    let mut spans: Vec<(String, Vec<[f64; 2]>)> = Vec::new();
    let mut last: Option<Reflector> = None;
    let steps = ((to - from) / FINE_RAD).clamp(0.0, 20_000.0) as usize;
    for i in 0..=steps {
        let angle_rad = from + i as f64 * FINE_RAD;
        let met = view::met(frame, pose, angle_rad);
        let now = met.and_then(|m| m.reflector);
        if let (Some(met), Some(reflector)) = (met, now) {
            let (sin, cos) = angle_rad.sin_cos();
            let point = [met.range_m * cos, met.range_m * sin];
            match spans.last_mut() {
                Some((_, points)) if last == now => points.push(point),
                _ => spans.push((name(reflector), vec![point])),
            }
        }
        last = now;
    }
    // On a straight line only the ends say something.
    for (_, points) in &mut spans {
        if let [first, .., end] = points[..] {
            *points = vec![first, end];
        }
    }
    spans
}

fn name(reflector: Reflector) -> String {
    match reflector {
        Reflector::Plate(i) => format!("plate[{i}]"),
        Reflector::Strip(i) => format!("strip[{i}]"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::{FittedLine, NormalLine};
    use std::f64::consts::{FRAC_PI_2, PI};
    use std::path::Path;

    /// A scan of an empty room 4 m to either side and 3 m above, with a bias of 10 mm.
    fn room() -> (Scan, ReflectorLines) {
        let mut scan = Scan {
            angle_min_rad: -0.05,
            angle_increment_rad: 0.005,
            time_increment_s: 4e-5,
            ..Scan::default()
        };
        let line = |d_m: f64, alpha_rad: f64| FittedLine {
            normal: NormalLine { d_m, alpha_rad },
            points: 50,
            rms_m: 0.002,
            ..FittedLine::default()
        };
        let lines = ReflectorLines {
            right: line(4.0, 0.0),
            upper: line(3.0, FRAC_PI_2),
            left: line(4.0, PI),
            range_bias_m: 0.010,
            ..ReflectorLines::default()
        };
        scan.ranges_m = (0..649)
            .map(|i| {
                let angle = -0.05 + 0.005 * f64::from(i);
                let met = lines.lines().map(|l| l.normal.range_m(angle));
                met.into_iter()
                    .filter(|r| *r > 0.0)
                    .fold(f64::INFINITY, f64::min)
                    + 0.010
            })
            .collect();
        (scan, lines)
    }

    #[test]
    fn beams_lie_on_the_lines_they_meet_first() {
        let (mut scan, lines) = room();
        // One short, one without return.
        scan.ranges_m[300] -= 0.5;
        scan.ranges_m[301] = f64::INFINITY;
        let view = view(&scan, Some(&lines), None);
        assert_eq!((view.count, view.beams.len()), (649, 648));
        for (i, beam) in view.beams.iter().enumerate() {
            let (k, off) = beam.residual.unwrap();
            if i == 300 {
                assert!(!beam.on_line && (off + 0.5).abs() < 1e-9);
                continue;
            }
            assert!(beam.on_line && off.abs() < 1e-9, "{i}: {off}");
            let [y, z] = beam.at_m;
            let on = [y - 4.0, z - 3.0, y + 4.0][k];
            assert!(on.abs() < 1e-9, "{i}: {y} {z}");
        }
        let [first, last] =
            [view.beams.first(), view.beams.last()].map(|b| b.unwrap().residual.unwrap().0);
        assert_eq!((first, last), (0, 2));
    }

    #[test]
    fn without_lines_there_are_only_beams() {
        let (scan, _) = room();
        let view = super::view(&scan, None, None);
        assert!(
            view.beams
                .iter()
                .all(|b| b.residual.is_none() && !b.on_line)
        );
        assert!(table(&[view], false).contains("no lines"));
        let empty = super::view(&Scan::default(), None, None);
        assert!(empty.beams.is_empty());
        assert!(page(None, "scan", &[empty], "report scan").contains("</html>"));
    }

    #[test]
    fn the_true_frame_is_where_it_is() {
        let text = include_str!("../../../testdata/cablar.toml");
        let frame = Frame::parse(text, Path::new("cablar.toml")).unwrap();
        let (scan, _) = room();
        let seen = view(&scan, None, Some((&frame, [0.0, 0.5, 2.0], [0.0; 3])));
        let names: Vec<&str> = seen.reflectors.iter().map(|(n, _)| n.as_str()).collect();
        assert_eq!(
            names,
            [
                "plate[0]", "strip[0]", "strip[1]", "strip[2]", "strip[3]", "plate[1]"
            ]
        );
        for (_, points) in &seen.reflectors[1..5] {
            // On the ceiling, 0.8 m wide less what falls between two angles.
            assert!(points.iter().all(|p| (p[1] - 3.5).abs() < 1e-9));
            let wide = points[0][0] - points[1][0];
            assert!(wide > 0.77 && wide <= 0.8 + 1e-9, "{wide}");
        }
    }
}
