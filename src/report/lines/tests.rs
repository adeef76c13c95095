use super::*;
use crate::record::NormalLine;

/// A segment on the line (d, alpha) between two positions along it, with `points` beams.
fn segment(stamp: i64, d_m: f64, alpha_deg: f64, from_m: f64, to_m: f64, points: u32) -> Segment {
    let alpha_rad = alpha_deg.to_radians();
    let (sin, cos) = alpha_rad.sin_cos();
    let at = |along_m: f64| [d_m * cos - along_m * sin, d_m * sin + along_m * cos];
    Segment {
        stamp: Stamp::from_ns(stamp),
        normal: NormalLine::new(d_m, alpha_rad),
        ends_m: [at(from_m), at(to_m)],
        points,
        covariance: [1e-6, 0.0, 1e-8],
        ..Segment::default()
    }
}

fn scored(truth: &[Segment], found: &[Segment]) -> Score {
    score("run", "run.csv", truth, found, &Matching::default())
}

#[test]
fn the_truth_itself_scores_in_full() {
    let truth = [
        segment(1, 2.0, 10.0, -1.0, 1.5, 80),
        segment(1, 3.0, 179.0, -1.0, 1.5, 60),
        segment(2, 0.1, -60.0, 1.0, 3.0, 40),
    ];
    let score = scored(&truth, &truth);
    assert_eq!((score.true_lines, score.lines, score.matches), (3, 3, 3));
    assert_eq!(score.true_positive_pct(), 100.0);
    assert_eq!(score.false_positive_pct(), 0.0);
    assert!(score.d_m.std < 1e-12 && score.alpha_rad.std < 1e-12);
    assert!((score.length_ratio - 1.0).abs() < 1e-12);
    assert!(score.nees[0] < 1e-9);
}

#[test]
fn misses_and_false_lines_are_counted() {
    let truth = [
        segment(1, 2.0, 10.0, -1.0, 1.5, 80),
        segment(1, 3.0, 100.0, -1.0, 1.5, 60),
    ];
    let found = [
        segment(1, 2.0, 10.0, -1.0, 1.5, 80),
        // Twenty centimetres off, and one in a scan of which nothing is known.
        segment(1, 3.2, 100.0, -1.0, 1.5, 60),
        segment(5, 2.0, 10.0, -1.0, 1.5, 80),
    ];
    let score = scored(&truth, &found);
    assert_eq!((score.true_lines, score.lines, score.matches), (2, 3, 1));
    assert_eq!(score.true_positive_pct(), 50.0);
    assert!((score.false_positive_pct() - 200.0 / 3.0).abs() < 1e-9);
}

#[test]
fn pairs_are_one_to_one_and_the_nearest_wins() {
    let truth = [segment(1, 2.0, 10.0, -1.0, 1.5, 80)];
    let found = [
        segment(1, 2.01, 10.0, -1.0, 1.5, 80),
        segment(1, 2.001, 10.0, -1.0, 1.5, 80),
    ];
    let score = scored(&truth, &found);
    assert_eq!((score.lines, score.matches), (2, 1));
    assert!((score.d_m.mean - 0.001).abs() < 1e-9);
    assert!(score.d_m.std.is_nan());
}

#[test]
fn short_true_lines_neither_count_nor_punish() {
    let truth = [
        segment(1, 2.0, 10.0, 0.0, 0.4, 20),
        segment(1, 3.0, 100.0, -1.0, 1.5, 60),
    ];
    let found = [
        segment(1, 2.0, 10.0, -0.15, 0.4, 20),
        segment(1, 3.0, 100.0, -1.0, 1.5, 60),
    ];
    let score = scored(&truth, &found);
    assert_eq!((score.true_lines, score.lines, score.matches), (1, 1, 1));
    assert_eq!(score.false_positive_pct(), 0.0);
    // A found line that is too short is not judged at all.
    let short = [segment(1, 5.0, 0.0, 0.0, 0.3, 20)];
    assert_eq!(scored(&truth, &short).lines, 0);
}

#[test]
fn the_overlap_is_of_the_shorter_line() {
    let truth = [segment(1, 2.0, 10.0, 0.0, 4.0, 80)];
    for (from_m, to_m, matches) in [(1.0, 2.0, 1), (3.6, 4.4, 1), (3.7, 4.5, 0), (4.5, 6.0, 0)] {
        let found = [segment(1, 2.0, 10.0, from_m, to_m, 30)];
        assert_eq!(scored(&truth, &found).matches, matches, "{from_m} {to_m}");
    }
}

#[test]
fn a_line_seen_from_its_other_side_is_the_same() {
    // Through the scanner nearly: the found line passes it on the other side.
    let truth = [segment(1, 0.003, 10.0, 1.0, 3.0, 40)];
    let mut found = segment(1, 0.002, 190.0, -3.0, -1.0, 40);
    found.ends_m.reverse();
    let score = scored(&truth, &[found]);
    assert_eq!(score.matches, 1);
    assert!((score.d_m.mean + 0.005).abs() < 1e-12, "{}", score.d_m.mean);
}

/// The gate's covariance against its definition: offset at the centre and angle are independent,
/// and d = offset + along * alpha.
#[test]
fn the_gate_is_carried_to_the_foot_point() {
    let line = segment(1, 2.0, 10.0, 3.0, 5.0, 50);
    let [dd, da, aa] = gate_covariance(&line, &Matching::default());
    let offset = 0.02f64.powi(2) / 50.0 + 0.01f64.powi(2);
    let angle = 12.0 * 0.02f64.powi(2) / (50.0 * 4.0) + 0.5f64.to_radians().powi(2);
    assert!((aa - angle).abs() < 1e-15);
    assert!((da - 4.0 * angle).abs() < 1e-12);
    assert!((dd - (offset + 16.0 * angle)).abs() < 1e-12);
}

#[test]
fn the_table_and_json_have_the_figures() {
    let truth = [
        segment(1, 2.0, 10.0, -1.0, 1.5, 80),
        segment(1, 3.0, 179.0, -1.0, 1.5, 60),
    ];
    let found = [segment(1, 2.0, 10.0, -1.0, 1.5, 80)];
    let scores = [scored(&truth, &found)];
    let table = table("truth.csv", &scores, &Matching::default(), false);
    assert!(
        table.contains("50.0") && table.contains("TruePos"),
        "{table}"
    );
    let text = json("truth.csv", &scores, &Matching::default()).unwrap();
    let value: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(value["runs"][0]["truepos_pct"], 50.0);
    assert!(value["runs"][0]["d"]["std_mm"].is_null());
    assert_eq!(value["matching"]["floor_deg"], 0.5);
}
