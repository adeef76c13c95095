//! The methods that find one line at a time, on an office with truth: they find what they should,
//! the same every time, and take any ranges. And the scores of `report lines` are those of an
//! independent scorer.

use cablepose::lines::extractor::{Extractor, ExtractorOptions, Fate};
use cablepose::lines::methods;
use cablepose::lines::segmentation::Cut;
use cablepose::record::{NormalLine, Scan, Segment, Stamp};
use cablepose::report::lines::{Matching, Score, score};
use cablepose::simulate::Seed;
use cablepose::simulate::office::{Errors, Office, Setup, View};
use proptest::prelude::*;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A method by name.
fn extractor(name: &str, common: ExtractorOptions) -> Box<dyn Extractor> {
    methods::extractor(name, common).unwrap()
}

const METHODS: [&str; 5] = ["hough", "fast-hough", "modified-hough", "ransac", "em"];

fn options(sigma_m: f64, cluster: bool) -> ExtractorOptions {
    let mut options = ExtractorOptions::default();
    options.segmentation.sigma_m = sigma_m;
    if !cluster {
        options.segmentation.cut = Cut::Nowhere;
    }
    options
}

/// Scans of an office and all true lines.
fn office(scans: u64) -> (Vec<Scan>, Vec<Segment>) {
    let mut office = Office::new(Setup {
        view: View::AllRound,
        errors: Errors::of(View::AllRound),
        seed: Seed(20),
        start: Stamp::from_ns(0),
        scans,
        scans_per_place: 1,
    });
    let (mut all, mut truth) = (Vec::new(), Vec::new());
    while let Some((scan, lines)) = office.advance() {
        all.push(scan.clone());
        truth.extend_from_slice(lines);
    }
    (all, truth)
}

fn extracted(scans: &[Scan], method: &mut dyn Extractor) -> Vec<Segment> {
    let (mut all, mut lines) = (Vec::new(), Vec::new());
    for scan in scans {
        method.extract(scan, &mut lines);
        all.extend_from_slice(&lines);
    }
    all
}

fn scored(truth: &[Segment], found: &[Segment]) -> Score {
    score("run", "run", truth, found, &Matching::default())
}

/// At least as correct as the rows of the published comparison (Kurniawan 2017, table 4.1).
#[test]
fn lines_are_found_as_well_as_published() {
    let (scans, truth) = office(40);
    for (name, cluster, true_pct, false_pct) in [
        ("hough", false, 82.0, 32.5),
        ("hough", true, 79.5, 10.0),
        ("fast-hough", false, 70.0, 32.5),
        ("fast-hough", true, 75.0, 10.0),
        ("modified-hough", true, 79.5, 10.0),
        ("ransac", false, 75.6, 31.5),
        ("ransac", true, 70.7, 12.2),
        ("em", false, 78.6, 53.7),
        ("em", true, 80.3, 23.1),
    ] {
        let mut method = extractor(name, options(0.015, cluster));
        let score = scored(&truth, &extracted(&scans, &mut *method));
        let (found, wrong) = (score.true_positive_pct(), score.false_positive_pct());
        eprintln!("{name} {cluster}: {found:.1} % {wrong:.1} %");
        assert!(score.true_lines > 300);
        assert!(found >= true_pct, "{name} {cluster}: {found}");
        assert!(wrong <= false_pct, "{name} {cluster}: {wrong}");
        assert!(score.alpha_rad.std.to_degrees() < 0.67, "{name}: {score:?}");
    }
}

#[test]
fn the_same_scans_give_the_same_lines() {
    let (scans, _) = office(6);
    for name in METHODS {
        let text = |order: &[usize]| {
            let mut method = extractor(name, options(0.015, true));
            let mut of_last = Vec::new();
            for i in order {
                method.extract(&scans[*i], &mut of_last);
            }
            format!("{of_last:?}")
        };
        // Whatever came before.
        assert_eq!(text(&[0, 1, 2, 3]), text(&[5, 4, 3]), "{name}");
    }
}

#[test]
fn every_beam_has_a_fate() {
    let (scans, _) = office(3);
    for name in METHODS {
        let mut common = options(0.015, true);
        common.explain = true;
        let mut method = extractor(name, common);
        let mut lines = Vec::new();
        for scan in &scans {
            method.extract(scan, &mut lines);
            assert_eq!(method.fates().len(), scan.beams());
            for (number, line) in lines.iter().enumerate() {
                let on = Fate::OnLine(number as u32);
                let count = method.fates().iter().filter(|fate| **fate == on).count();
                assert_eq!(count, line.points as usize, "{name}");
            }
        }
    }
}

/// Noise-free walls all round, at any turn.
#[test]
fn exact_walls_give_exact_lines() {
    for degrees in (0..360).step_by(30) {
        let turn = f64::from(degrees).to_radians();
        let step = std::f64::consts::TAU / 722.0;
        let walls = [(2.5, 0.0), (2.8, 0.5), (3.5, 1.0), (1.2, 1.5)]
            .map(|(d, k)| (d, turn + k * std::f64::consts::PI));
        let range = |i: usize| {
            let angle = (i as f64 + 0.5) * step;
            let hits = walls.iter().map(|(d, alpha)| d / (angle - alpha).cos());
            hits.filter(|r| *r > 0.0).fold(f64::INFINITY, f64::min)
        };
        let scan = Scan {
            angle_min_rad: 0.5 * step,
            angle_increment_rad: step,
            ranges_m: (0..722).map(range).collect(),
            ..Scan::default()
        };
        for name in METHODS {
            let lines = extracted(
                std::slice::from_ref(&scan),
                &mut *extractor(name, options(0.001, false)),
            );
            assert_eq!(lines.len(), 4, "{name} {degrees}: {lines:#?}");
            for (d_m, alpha_rad) in walls {
                let wall = NormalLine::new(d_m, alpha_rad);
                let near = |s: &&Segment| (s.normal.d_m - d_m).abs() < 0.02;
                let line = lines.iter().find(near);
                let line = line.unwrap_or_else(|| panic!("{name} {degrees} {d_m}"));
                // The noise is set so small that no beam of the next wall is within it.
                assert!((line.normal.d_m - d_m).abs() < 2e-4, "{name}: {line:?}");
                assert!(
                    (line.normal.alpha_rad - wall.alpha_rad).abs() < 2e-4,
                    "{name} {degrees}: {line:?} {wall:?}"
                );
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn any_ranges_are_taken(
        ranges_m in proptest::collection::vec(proptest::num::f64::ANY, 0..60),
        step_rad in -0.2f64..0.2,
        method in 0usize..5,
    ) {
        let scan = Scan {
            angle_min_rad: 0.0,
            angle_increment_rad: step_rad,
            ranges_m: ranges_m.into(),
            ..Scan::default()
        };
        let mut method = extractor(METHODS[method], options(0.0065, false));
        for segment in extracted(&[scan], &mut *method) {
            prop_assert!(segment.normal.d_m.is_finite());
            prop_assert!(segment.points >= 9);
        }
    }
}

/// The folder of the independent generator and scorer, if it is there.
fn tools() -> Option<PathBuf> {
    let data = std::env::var_os("CABLEPOSE_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"),
        PathBuf::from,
    );
    let tools = data.parent()?.join("tools");
    (tools.join("score.py").is_file() && tools.join("gen_office.py").is_file()).then_some(tools)
}

/// A CSV file as rows of numbers by column name.
fn rows(path: &Path) -> Vec<std::collections::HashMap<String, f64>> {
    let text = std::fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    lines
        .map(|line| {
            let values = line.split(',').map(|v| v.parse().unwrap());
            names.iter().map(|n| (*n).to_owned()).zip(values).collect()
        })
        .collect()
}

/// Scans and truth of the independent generator, lines of two methods, and the independent scorer's
/// figures for them beside ours. Needs Python with numpy (PYTHON says which).
#[test]
fn scores_are_those_of_an_independent_scorer() {
    let python = std::env::var("PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let has_numpy = Command::new(&python)
        .args(["-c", "import numpy"])
        .output()
        .is_ok_and(|output| output.status.success());
    let Some(tools) = tools().filter(|_| has_numpy) else {
        eprintln!(
            "skipped: no gen_office.py and score.py beside the data, or no Python with numpy"
        );
        return;
    };
    let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join("independent-scorer");
    std::fs::create_dir_all(&dir).unwrap();
    let set = "office360_722";
    let made = Command::new(&python)
        .arg(tools.join("gen_office.py"))
        .args(["--scans", "15", "--sets", set, "--out"])
        .arg(&dir)
        .output()
        .unwrap();
    assert!(
        made.status.success(),
        "{}",
        String::from_utf8_lossy(&made.stderr)
    );
    let truth_file = dir.join(format!("{set}.truth.csv"));
    let truth: Vec<Segment> = rows(&truth_file)
        .iter()
        .map(|row| Segment {
            stamp: Stamp::from_ns(row["scan"] as i64),
            normal: NormalLine::new(row["r"], row["alpha"]),
            ends_m: [[row["x0"], row["y0"]], [row["x1"], row["y1"]]],
            points: row["n"] as u32,
            ..Segment::default()
        })
        .collect();
    let text = std::fs::read_to_string(dir.join(format!("{set}.csv"))).unwrap();
    let scans: Vec<Scan> = text
        .lines()
        .skip(1)
        .enumerate()
        .map(|(i, line)| {
            let values: Vec<f64> = line.split(',').map(|v| v.parse().unwrap()).collect();
            Scan {
                stamp: Stamp::from_ns(i as i64),
                angle_min_rad: values[1],
                angle_increment_rad: values[2],
                ranges_m: values[3..].iter().copied().collect(),
                ..Scan::default()
            }
        })
        .collect();
    for (name, cluster) in [("ransac", true), ("hough", false)] {
        let found = extracted(&scans, &mut *extractor(name, options(0.015, cluster)));
        let mut csv = "scan,r,alpha,x0,y0,x1,y1,n,crr,cra,caa\n".to_owned();
        for s in &found {
            let ([[x0, y0], [x1, y1]], [dd, da, aa]) = (s.ends_m, s.covariance);
            let (scan, n) = (s.stamp.ns(), s.points);
            let NormalLine { d_m, alpha_rad } = s.normal;
            writeln!(
                csv,
                "{scan},{d_m},{alpha_rad},{x0},{y0},{x1},{y1},{n},{dd},{da},{aa}"
            )
            .unwrap();
        }
        let file = dir.join(format!("{name}.csv"));
        std::fs::write(&file, csv).unwrap();
        let program = format!(
            "import sys; sys.path.insert(0, {tools:?}); import score as s\n\
             a = s.options([{truth_file:?}, {file:?}])\n\
             f = s.score(s.read(a.truth), s.read(a.lines[0]), a)\n\
             for k in 'true lines matched TruePos FalsePos sd_dr_cm sd_da_deg sd_de_cm mean_dr_cm nees \
             nees_med len_ratio'.split(): print(repr(float(f[k])))"
        );
        let scored_there = Command::new(&python)
            .args(["-c", &program])
            .output()
            .unwrap();
        let error = String::from_utf8_lossy(&scored_there.stderr);
        assert!(scored_there.status.success(), "{error}");
        let there = String::from_utf8(scored_there.stdout).unwrap();
        let there: Vec<f64> = there.lines().map(|v| v.parse().unwrap()).collect();
        let here = scored(&truth, &found);
        let here = [
            here.true_lines as f64,
            here.lines as f64,
            here.matches as f64,
            here.true_positive_pct(),
            here.false_positive_pct(),
            100.0 * here.d_m.std,
            here.alpha_rad.std.to_degrees(),
            100.0 * here.centre_m.std,
            100.0 * here.d_m.mean,
            here.nees[0],
            here.nees[1],
            here.length_ratio,
        ];
        assert!(here[0] > 80.0);
        assert_eq!(here.len(), there.len());
        for (k, (a, b)) in here.iter().zip(&there).enumerate() {
            // The truth has six decimals.
            assert!(
                (a - b).abs() <= 2e-4 * (1.0 + b.abs()),
                "{name} figure {k}: {a} {b}"
            );
        }
    }
}
