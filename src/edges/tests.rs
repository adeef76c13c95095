use super::*;
use crate::frame::ScannerPose;
use crate::lines::reflectors::{Options, ReflectorFit};
use crate::record::TrajectoryPoint;
use crate::simulate::Step;
use crate::simulate::staged::{frame, scattered};
use std::f64::consts::FRAC_PI_2;

fn lines_and_edges(frame: &Frame, scan: &Scan) -> ReflectorLines {
    let mut fit = ReflectorFit::new(frame, Options::default());
    let mut lines = ReflectorLines::default();
    lines.begin(scan);
    let found = fit.fit(scan).expect("lines");
    fit.record(&found, &mut lines);
    EdgeMeter::new(frame).measure(scan, &mut lines);
    lines
}

/// Signed distance of the point where a beam meets the ceiling from the boundary of an edge, by
/// the true pose: positive on the +y side.
fn distance_m(frame: &Frame, truth: &TrajectoryPoint, edge: &Edge, angle_rad: f64) -> f64 {
    let pose = ScannerPose::new(frame, truth.position_m, truth.rotation_rad);
    let point = pose.crossing(angle_rad, Face::Upper).unwrap().point_m;
    let strip = &frame.strips[edge.strip as usize];
    let side = if edge.kind == EdgeKind::On { 0.5 } else { -0.5 };
    point[1] - strip.offset_m - side * strip.width_m - strip.slope() * point[0]
}

fn check_intervals(frame: &Frame, step: &Step, slack_m: f64) -> usize {
    let lines = lines_and_edges(frame, &step.scan);
    let mut misses = 0;
    for edge in &lines.edges {
        assert!(edge.from_rad < edge.to_rad);
        if edge.strip < 0 {
            continue;
        }
        let before = distance_m(frame, &step.truth, edge, edge.from_rad);
        let behind = distance_m(frame, &step.truth, edge, edge.to_rad);
        misses += usize::from(!(before > -slack_m && behind < slack_m));
    }
    misses
}

#[test]
fn every_interval_holds_its_edge() {
    let frame = frame(&[]);
    for step in &scattered(&frame, "none", 80, [0.5, 4.0], 21) {
        let lines = lines_and_edges(&frame, &step.scan);
        let strips: Vec<i32> = lines.edges.iter().map(|e| e.strip).collect();
        assert_eq!(strips, [0, 0, 1, 1, 2, 2, 3, 3]);
        assert_eq!(check_intervals(&frame, step, 1e-6), 0);
        // From beam to beam, no wider.
        for edge in &lines.edges {
            let beams = (edge.to_rad - edge.from_rad) / step.scan.angle_increment_rad;
            assert!((beams - 1.0).abs() < 1e-9, "{beams}");
        }
    }
}

#[test]
fn cables_and_cargo_only_lengthen_intervals() {
    let frame = frame(&[]);
    let steps = scattered(&frame, "cables,cargo,dropouts", 150, [0.5, 3.5], 22);
    let wrong: usize = steps
        .iter()
        .map(|step| check_intervals(&frame, step, 1e-6))
        .sum();
    let edges: usize = steps
        .iter()
        .map(|s| lines_and_edges(&frame, &s.scan).edges.len())
        .sum();
    // A cable close under the ceiling can look like part of a strip.
    assert!(wrong * 200 <= edges, "{wrong} of {edges}");
    assert!(edges > 150 * 6, "{edges}");
}

#[test]
fn mixed_pixels_stay_within_their_spot() {
    // The hit threshold is off by up to a tenth of the spot's area, 0.16 of its radius.
    let frame = frame(&[]);
    let steps = scattered(&frame, "reference,mixed", 200, [0.5, 3.5], 23);
    let wrong: usize = steps
        .iter()
        .map(|step| check_intervals(&frame, step, 0.008))
        .sum();
    assert!(wrong <= 8, "{wrong} of 1600");
}

#[test]
fn a_missing_strip_leaves_the_others_in_place() {
    let frame = frame(&[]);
    for step in &scattered(&frame, "reference,missing-strip", 60, [0.5, 3.5], 24) {
        let lines = lines_and_edges(&frame, &step.scan);
        let known = lines.edges.iter().filter(|e| e.strip >= 0).count();
        assert_eq!(known, 6, "{:?}", lines.edges);
        assert_eq!(check_intervals(&frame, step, 0.004), 0);
    }
}

#[test]
fn runs_too_narrow_for_a_strip_are_wild_ranges() {
    let frame = frame(&[]);
    let spans = |edges: &[Edge]| -> Vec<(i32, f64, f64)> {
        let span = |e: &Edge| (e.strip, e.from_rad, e.to_rad);
        edges.iter().map(span).collect()
    };
    for step in &mut scattered(&frame, "none", 40, [0.5, 3.5], 27) {
        let edges = lines_and_edges(&frame, &step.scan).edges;
        let pose = ScannerPose::new(&frame, step.truth.position_m, step.truth.rotation_rad);
        let scan = &mut step.scan;
        let mut spoil = |between: [f64; 2], behind_m: f64| {
            let middle = 0.5 * (between[0] + between[1]) - scan.angle_min_rad;
            let i = (middle / scan.angle_increment_rad) as usize;
            for i in [i, i + 1] {
                let mut line = pose.line(Face::Upper).normal;
                line.d_m += behind_m;
                let ranges: &mut [f64] = &mut scan.ranges_m;
                ranges[i] = line.range_m(scan.angle_min_rad + i as f64 * scan.angle_increment_rad);
            }
        };
        // Two beams at the strips' distance amid the widest gap, two as far as the background amid
        // a strip.
        spoil([edges[3].to_rad, edges[4].from_rad], 0.0);
        spoil([edges[2].to_rad, edges[3].from_rad], 0.7);
        let spoilt = lines_and_edges(&frame, &step.scan).edges;
        assert_eq!(spans(&spoilt), spans(&edges));
    }
}

#[test]
fn strips_on_the_walls_are_found_too() {
    let text = include_str!("../../testdata/inclined.toml");
    let frame = Frame::parse(text, std::path::Path::new("inclined.toml")).unwrap();
    let (mut known, mut unknown) = (0, 0);
    for step in &scattered(&frame, "reference", 40, [1.0, 3.0], 25) {
        let lines = lines_and_edges(&frame, &step.scan);
        for face in [Face::Right, Face::Left] {
            let on_face: Vec<&Edge> = lines.edges.iter().filter(|e| e.face == face).collect();
            assert!(on_face.len() >= 2, "{:?}", lines.edges);
            for edge in on_face {
                if edge.strip < 0 {
                    eprintln!("{edge:?} {:?}", step.truth);
                    unknown += 1;
                    continue;
                }
                known += 1;
                assert!(edge.strip >= 4, "{edge:?}");
                let pose = ScannerPose::new(&frame, step.truth.position_m, step.truth.rotation_rad);
                let strip = &frame.strips[edge.strip as usize];
                let rising = face == Face::Right;
                let lower = (edge.kind == EdgeKind::On) == rising;
                let side = if lower { -0.5 } else { 0.5 };
                let g = |angle: f64| {
                    let p = pose.crossing(angle, face).unwrap().point_m;
                    p[2] - strip.offset_m - side * strip.width_m - strip.slope() * p[0]
                };
                let (from, to) = (g(edge.from_rad), g(edge.to_rad));
                let (low, high) = (from.min(to), from.max(to));
                assert!(low < 0.004 && high > -0.004, "{low} {high} {edge:?}");
            }
        }
    }
    assert!(
        known > 40 * 8 && unknown * 50 < known,
        "{known} known, {unknown} unknown"
    );
}

#[test]
fn edges_know_when_they_were_passed() {
    let frame = frame(&[]);
    let step = &scattered(&frame, "none", 1, [2.0, 2.1], 26)[0];
    let lines = lines_and_edges(&frame, &step.scan);
    // 360 deg a period of 1/35 s, zero at 90 deg.
    for edge in &lines.edges {
        let middle = 0.5 * (edge.from_rad + edge.to_rad) - FRAC_PI_2;
        let expected_s = middle / std::f64::consts::TAU / 35.0;
        assert!((edge.time_s - expected_s).abs() < 1e-9);
    }
}
