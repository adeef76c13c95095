//! The edges' angles against the true ones, by the formulas of the beam alone: no line, no crossing
//! of the estimator's geometry.

use super::footprint::{Slant, Spot};
use super::*;
use crate::frame::{ScannerPose, disc_share};
use crate::lines::reflectors::{Options, ReflectorFit};
use crate::record::{EdgeBasis, TrajectoryPoint};
use crate::simulate::staged::{frame, scattered, scattered_with, scattered_within};
use crate::simulate::{Parameters, Scatter, Step};
use std::path::Path;

fn inclined() -> Frame {
    let text = include_str!("../../testdata/inclined.toml");
    Frame::parse(text, Path::new("inclined.toml")).unwrap()
}

/// Signed distance along y (ceiling) or z (walls) from an edge at which a beam meets its face.
fn off_m(frame: &Frame, truth: &TrajectoryPoint, edge: &Edge, angle_rad: f64) -> f64 {
    let [x, y, z] = truth.position_m;
    let [roll, pitch, yaw] = truth.rotation_rad;
    let alpha = angle_rad + roll;
    let u_y = yaw.sin() * alpha.sin() * pitch.sin() + yaw.cos() * alpha.cos();
    let u_z = alpha.sin() * pitch.cos();
    let u_x = yaw.cos() * alpha.sin() * pitch.sin() - yaw.sin() * alpha.cos();
    let b = &frame.bounds;
    let t = match edge.face {
        Face::Upper => (b.dz_m - z) / u_z,
        Face::Right => (b.dy_m / 2.0 - y) / u_y,
        Face::Left => (-b.dy_m / 2.0 - y) / u_y,
    };
    let along = if edge.face == Face::Upper {
        y + t * u_y
    } else {
        z + t * u_z
    };
    let strip = &frame.strips[edge.strip as usize];
    // With growing angle a beam on the right wall rises and elsewhere goes towards -y or down.
    let far_side = (edge.kind == EdgeKind::On) != (edge.face == Face::Right);
    let half_m = if far_side { 0.5 } else { -0.5 } * strip.width_m;
    along - strip.offset_m - half_m - strip.inclination_deg.to_radians().tan() * (x + t * u_x)
}

/// The true angle of an edge, by secants.
fn true_rad(frame: &Frame, truth: &TrajectoryPoint, edge: &Edge) -> f64 {
    let mut a = 0.5 * (edge.from_rad + edge.to_rad);
    let mut b = a + 1e-4;
    let mut at_a = off_m(frame, truth, edge, a);
    for _ in 0..20 {
        let at_b = off_m(frame, truth, edge, b);
        if at_b == at_a {
            break;
        }
        (a, b, at_a) = (b, b - at_b * (b - a) / (at_b - at_a), at_b);
    }
    b
}

/// An edge with its true angle.
struct Checked {
    edge: Edge,
    true_rad: f64,
    /// The next edge of the same strip, where its covariance is known.
    next: Option<(Edge, f64)>,
}

impl Checked {
    /// Error over sigma for a true footprint scale.
    fn normalised(&self, scale: f64) -> f64 {
        error_rad(&self.edge, self.true_rad, scale) / self.edge.sigma_rad
    }
}

fn error_rad(edge: &Edge, true_rad: f64, scale: f64) -> f64 {
    edge.edge_rad + edge.d_footprint * (scale - 1.0) - true_rad
}

/// Lines and edges of scans one after the other.
fn measure(frame: &Frame, steps: &[Step], track: bool) -> Vec<(ReflectorLines, TrajectoryPoint)> {
    let mut fit = ReflectorFit::new(
        frame,
        Options {
            track,
            ..Options::default()
        },
    );
    let mut meter = EdgeMeter::new(frame);
    let mut measured = Vec::new();
    for step in steps {
        let mut lines = ReflectorLines::default();
        lines.begin(&step.scan);
        if let Some(found) = fit.fit(&step.scan) {
            fit.record(&found, &mut lines);
            meter.measure(&step.scan, &mut lines);
        }
        measured.push((lines, step.truth));
    }
    measured
}

fn checked(frame: &Frame, steps: &[Step]) -> Vec<Checked> {
    let mut all = Vec::new();
    for (lines, truth) in measure(frame, steps, true) {
        for (i, edge) in lines.edges.iter().enumerate().filter(|(_, e)| e.strip >= 0) {
            let next = lines.edges.get(i + 1).filter(|_| edge.cov_next_rad2 != 0.0);
            all.push(Checked {
                edge: *edge,
                true_rad: true_rad(frame, &truth, edge),
                next: next.map(|next| (*next, true_rad(frame, &truth, next))),
            });
        }
    }
    all
}

/// What a set of edges shows.
#[derive(Debug)]
struct Figures {
    measured: f64,
    nees: f64,
    /// Mean error over sigma outwards from the strip, and with growing angle.
    outward: f64,
    along: f64,
    /// Normalised squares of the sum and difference of a strip's two errors.
    sum: f64,
    difference: f64,
    rms_rad: f64,
}

fn figures(edges: &[Checked], scale: f64) -> Figures {
    let with: Vec<&Checked> = edges
        .iter()
        .filter(|c| c.edge.edge_rad.is_finite())
        .collect();
    let mean = |f: &dyn Fn(&Checked) -> f64| {
        with.iter().map(|c| f(c)).sum::<f64>() / with.len().max(1) as f64
    };
    let pair = |sign: f64| {
        let squares: Vec<f64> = with
            .iter()
            .filter_map(|c| {
                let (next, next_rad) = c.next?;
                let (a, b) = (c.edge.sigma_rad, next.sigma_rad);
                let variance = a * a + b * b + 2.0 * sign * c.edge.cov_next_rad2;
                let error = error_rad(&c.edge, c.true_rad, scale)
                    + sign * error_rad(&next, next_rad, scale);
                Some(error * error / variance)
            })
            .collect();
        squares.iter().sum::<f64>() / squares.len() as f64
    };
    Figures {
        measured: with.len() as f64 / edges.len() as f64,
        nees: mean(&|c| c.normalised(scale).powi(2)),
        outward: mean(&|c| {
            let side = if c.edge.kind == EdgeKind::On {
                -1.0
            } else {
                1.0
            };
            side * c.normalised(scale)
        }),
        along: mean(&|c| c.normalised(scale)),
        sum: pair(1.0),
        difference: pair(-1.0),
        rms_rad: mean(&|c| error_rad(&c.edge, c.true_rad, scale).powi(2)).sqrt(),
    }
}

#[track_caller]
fn assert_honest(name: &str, f: &Figures, share: f64) {
    eprintln!("{name}: {f:?}");
    assert!(f.measured >= share, "{name}: {f:?}");
    for value in [f.nees, f.sum, f.difference] {
        assert!((0.8..1.3).contains(&value), "{name}: {f:?}");
    }
    for bias in [f.outward, f.along] {
        assert!(bias.abs() < 0.1, "{name}: {f:?}");
    }
}

fn parameters(text: &str) -> Parameters {
    toml::from_str(text).unwrap()
}

#[test]
fn remissions_place_edges_between_beams() {
    let frame = frame(&[]);
    for (name, effects, z_m) in [
        ("low", "reference", [0.5, 3.5]),
        ("low, mixed", "reference,mixed", [0.5, 3.5]),
        ("high, mixed", "reference,mixed", [3.5, 4.0]),
    ] {
        let edges = checked(&frame, &scattered(&frame, effects, 250, z_m, 31));
        let f = figures(&edges, 1.0);
        // High up many strips have the corner of the background behind them.
        assert_honest(name, &f, if z_m[0] > 3.0 { 0.9 } else { 0.95 });
        // Beams are 4.4 mrad apart: even intervals would leave 1.26 mrad.
        assert!(f.rms_rad < 0.35e-3, "{f:?}");
    }
}

#[test]
fn noise_is_learned() {
    let frame = frame(&[]);
    for noise in [0.03, 0.05] {
        let p = parameters(&format!("[remission]\nnoise = {noise}"));
        let steps = scattered_with(&frame, "reference", &p, 250, [0.5, 3.5], 32);
        assert_honest(
            &format!("noise {noise}"),
            &figures(&checked(&frame, &steps), 1.0),
            0.95,
        );
    }
}

#[test]
fn a_wider_spot_is_what_the_derivative_says() {
    let frame = frame(&[]);
    let p = parameters("[footprint]\nscale = 1.1");
    let steps = scattered_with(&frame, "reference", &p, 250, [0.5, 3.5], 33);
    let edges = checked(&frame, &steps);
    assert_honest("scale 1.1", &figures(&edges, 1.1), 0.95);
    // A frame file that knows the scale needs no derivative.
    let mut known = self::frame(&[]);
    known.calibration.footprint_scale = 1.3;
    let p = parameters("[footprint]\nscale = 1.3");
    let steps = scattered_with(&known, "reference", &p, 250, [0.5, 3.5], 34);
    assert_honest(
        "scale 1.3 known",
        &figures(&checked(&known, &steps), 1.0),
        0.95,
    );
}

#[test]
fn strips_on_the_walls_are_placed_too() {
    let frame = inclined();
    let steps = scattered(&frame, "reference,mixed", 120, [1.0, 3.0], 35);
    let edges = checked(&frame, &steps);
    for face in Face::ALL {
        let on_face: Vec<Checked> = edges
            .iter()
            .filter(|c| c.edge.face == face)
            .map(|c| Checked { ..*c })
            .collect();
        assert_honest(&format!("{face:?}"), &figures(&on_face, 1.0), 0.9);
    }
}

#[test]
fn saturated_strips_fall_back_to_their_intervals() {
    let frame = frame(&[]);
    // Half as bright again as the ceiling even at the far end.
    let p = parameters("[remission]\ndigits = 700.0\nceiling = 254.0");
    let steps = scattered_with(&frame, "reference,mixed", &p, 100, [0.5, 3.5], 37);
    let edges = checked(&frame, &steps);
    assert!(edges.len() > 700);
    for c in &edges {
        assert_eq!(c.edge.basis, EdgeBasis::Saturated, "{:?}", c.edge);
        assert!(c.edge.edge_rad.is_nan() && c.edge.cov_next_rad2 == 0.0);
    }
}

#[test]
fn without_contrast_the_intervals_stand() {
    let frame = frame(&[]);
    let p = parameters("[remission]\ncontrast = 0.98");
    let steps = scattered_with(&frame, "reference,mixed", &p, 60, [0.5, 3.5], 38);
    let edges = checked(&frame, &steps);
    let measured = edges.iter().filter(|c| c.edge.edge_rad.is_finite()).count();
    assert!(measured * 50 < edges.len(), "{measured} of {}", edges.len());
}

#[test]
fn echoes_need_no_level() {
    let frame = frame(&[]);
    let remission = checked(
        &frame,
        &scattered(&frame, "reference,mixed", 250, [0.5, 3.5], 36),
    );
    let steps = scattered(&frame, "reference,mixed,echoes", 250, [0.5, 3.5], 36);
    let edges = checked(&frame, &steps);
    let (f, by_level) = (figures(&edges, 1.0), figures(&remission, 1.0));
    // Where two echoes ran into one, nothing is known of the shares.
    assert_honest("echoes", &f, 0.75);
    assert!(f.rms_rad < by_level.rms_rad, "{f:?} {by_level:?}");
    assert!(edges.iter().all(|c| c.edge.basis != EdgeBasis::Remission));
}

#[test]
fn cables_cargo_and_wild_ranges_do_not_move_edges() {
    let frame = frame(&[]);
    let effects = "reference,mixed,outliers,dropouts,cables,cargo";
    let edges = checked(&frame, &scattered(&frame, effects, 250, [0.5, 3.5], 39));
    let f = figures(&edges, 1.0);
    assert_honest("cables and cargo", &f, 0.8);
    let far = edges
        .iter()
        .filter(|c| c.normalised(1.0).abs() > 6.0)
        .count();
    assert!(far * 200 <= edges.len(), "{far} of {}", edges.len());
}

#[test]
fn every_pose_of_the_workspace_is_found_without_the_one_before() {
    // Plates wide enough to be hit at 3 degrees of yaw.
    let wide = ("x_m = [-0.25, 0.25]", "x_m = [-0.74, 0.74]");
    let frame = frame(&[wide, wide]);
    let degree = 1f64.to_radians();
    let scatter = Scatter {
        position_m: [[-0.15, 0.15], [-3.5, 3.5], [0.5, 3.5]],
        rotation_rad: [
            [-degree, degree],
            [-degree, degree],
            [-3.0 * degree, 3.0 * degree],
        ],
    };
    let effects = "reference,mixed,outliers,dropouts,cables,cargo";
    let steps = scattered_within(&frame, effects, &Parameters::default(), 250, &scatter, 40);
    for track in [false, true] {
        // With `track` every pose is a jump away from the one before: nothing may stick.
        let (mut known, mut wrong) = (0, 0);
        for (lines, truth) in measure(&frame, &steps, track) {
            for edge in lines.edges.iter().filter(|e| e.strip >= 0) {
                known += 1;
                let middle = 0.5 * (edge.from_rad + edge.to_rad);
                let off = off_m(&frame, &truth, edge, middle).abs();
                let half = off_m(&frame, &truth, edge, edge.from_rad)
                    - off_m(&frame, &truth, edge, edge.to_rad);
                wrong += usize::from(off > 0.10 + half.abs());
            }
        }
        assert!(known > 250 * 7 && wrong == 0, "{wrong} of {known}");
    }
}

#[test]
fn with_nothing_behind_the_strips_intervals_are_all_there_is() {
    let frame = frame(&[("background_gap_m = 0.70", "")]);
    for step in &scattered(&frame, "reference", 30, [0.5, 3.5], 41) {
        let (lines, truth) = &measure(&frame, std::slice::from_ref(step), false)[0];
        assert_eq!(lines.edges.len(), 8);
        for edge in &lines.edges {
            let (before, behind) = (
                off_m(&frame, truth, edge, edge.from_rad),
                off_m(&frame, truth, edge, edge.to_rad),
            );
            assert!(before > -0.008 && behind < 0.008, "{before} {behind}");
        }
    }
}

#[test]
fn the_share_of_a_disc_is_its_area() {
    // Counted on a fine grid.
    let n = 2000;
    for q in [-0.9, -0.3, 0.0, 0.45, 0.8] {
        let (mut inside, mut all) = (0u32, 0u32);
        for i in 0..n {
            let y = (f64::from(i) + 0.5) / f64::from(n) * 2.0 - 1.0;
            let width = (1.0 - y * y).max(0.0).sqrt();
            all += (width * 1e4) as u32;
            inside += if y < q { (width * 1e4) as u32 } else { 0 };
        }
        let expected = f64::from(inside) / f64::from(all);
        assert!((disc_share(q).0 - expected).abs() < 2e-3, "{q}");
        let slope = (disc_share(q + 1e-6).0 - disc_share(q - 1e-6).0) / 2e-6;
        assert!((disc_share(q).1 - slope).abs() < 1e-6);
    }
    assert_eq!(
        (disc_share(1.0), disc_share(-1.2)),
        ((1.0, 0.0), (0.0, 0.0))
    );
}

#[test]
fn a_slanted_edge_is_met_as_the_closed_form_says() {
    // q = g cos(gamma) h / sqrt(h^2 + D^2) / R with D the distance of the edge line from the foot
    // point; here the scanner is below the edge's crossing with y at x = 0.
    let frame = frame(&[]);
    let gamma = frame.strips[0].inclination_deg.to_radians();
    let spot = Spot::new(&frame);
    for (y, z) in [(0.0, 2.0), (3.0, 2.0), (-1.5, 1.0)] {
        let pose = ScannerPose::new(&frame, [0.0, y, z], [0.0; 3]);
        let h = frame.bounds.dz_m - z;
        let side = frame.strips[0].offset_m + 0.5 * frame.strips[0].width_m - y;
        let angle = h.atan2(side);
        let mut lines = ReflectorLines::default();
        lines.upper.normal = NormalLine::new(h, std::f64::consts::FRAC_PI_2);
        let edge = Edge {
            from_rad: angle - 1e-3,
            to_rad: angle + 1e-3,
            ..Edge::default()
        };
        let slant = Slant::new(&spot, &pose, &lines, &edge, gamma.tan());
        let (distance, range) = (side * gamma.cos(), h.hypot(side));
        // One radian moves the hit along y by r^2 / h.
        let expected =
            range * range / h * gamma.cos() * h / h.hypot(distance) / spot.radius_m(range);
        assert!((slant.spots_per_rad / expected - 1.0).abs() < 1e-5);
    }
}
