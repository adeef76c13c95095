//! The methods that part a scan into runs of beams, on walls that are known exactly, and on the
//! offices of an independent generator where CABLEPOSE_OFFICE names the folder it wrote.

// The bench prints all of a score.
#[allow(dead_code)]
#[path = "office/mod.rs"]
mod office;

use cablepose::lines::extractor::{Extractor, ExtractorOptions, Fate};
use cablepose::lines::known_lines::SecondLook;
use cablepose::lines::methods;
use cablepose::lines::segmentation::Cut;
use cablepose::record::{Scan, Segment};
use std::f64::consts::{FRAC_PI_2, TAU};
use std::path::Path;

const METHODS: [&str; 5] = [
    "split-and-merge",
    "iepf",
    "incremental",
    "line-regression",
    "ml",
];

fn extractor(name: &str, common: ExtractorOptions) -> Box<dyn Extractor> {
    methods::extractor(name, common).unwrap()
}

fn lines(scan: &Scan, extractor: &mut dyn Extractor) -> Vec<Segment> {
    let mut out = Vec::new();
    extractor.extract(scan, &mut out);
    out
}

/// One wall 2 m long at 3 m, its middle at `alpha_rad`, seen all round; nothing else returns.
fn wall(alpha_rad: f64) -> Scan {
    let step_rad = TAU / 720.0;
    let range_m = |i: u32| {
        let off_rad = -FRAC_PI_2 * 2.0 + (f64::from(i) + 0.31) * step_rad - alpha_rad;
        let off_rad = (off_rad + TAU / 2.0).rem_euclid(TAU) - TAU / 2.0;
        if off_rad.abs() < (1.0f64 / 3.0).atan() {
            3.0 / off_rad.cos()
        } else {
            f64::INFINITY
        }
    };
    Scan {
        angle_min_rad: -FRAC_PI_2 * 2.0 + 0.31 * step_rad,
        angle_increment_rad: step_rad,
        ranges_m: (0..720).map(range_m).collect(),
        ..Scan::default()
    }
}

#[test]
fn one_wall_at_every_azimuth() {
    for name in METHODS {
        for cut in [Cut::Nowhere, Cut::Jump, Cut::Sef, Cut::Adaptive] {
            let mut common = ExtractorOptions::default();
            common.segmentation.cut = cut;
            let mut extractor = extractor(name, common);
            for degrees in (-180..180).step_by(15) {
                let alpha_rad = f64::from(degrees).to_radians();
                let found = lines(&wall(alpha_rad), &mut *extractor);
                // A single group all round has no end but where its first beam was put; and with
                // both ends of the wall equally far, edge following sees no edge between them.
                let one_group = matches!(cut, Cut::Nowhere | Cut::Sef);
                if one_group && found.len() == 2 {
                    continue;
                }
                assert_eq!(found.len(), 1, "{name} {cut:?} {degrees}: {found:#?}");
                let off_rad = (found[0].normal.alpha_rad - alpha_rad + TAU / 2.0).rem_euclid(TAU);
                assert!((found[0].normal.d_m - 3.0).abs() < 1e-9, "{name} {degrees}");
                assert!((off_rad - TAU / 2.0).abs() < 1e-9, "{name} {degrees}");
            }
        }
    }
}

#[test]
fn no_return_is_no_return_however_it_is_written() {
    for name in METHODS {
        let mut extractor = extractor(name, ExtractorOptions::default());
        let reference = lines(&wall(0.3), &mut *extractor);
        assert_eq!(reference.len(), 1);
        for value in [0.0, -1.0, f64::NAN, f64::NEG_INFINITY, 90.0] {
            let mut scan = wall(0.3);
            scan.range_max_m = 80.0;
            for range_m in scan.ranges_m.iter_mut() {
                if range_m.is_infinite() {
                    *range_m = value;
                }
            }
            assert_eq!(lines(&scan, &mut *extractor), reference, "{name} {value}");
        }
    }
}

#[test]
fn every_beam_has_a_fate() {
    for name in METHODS {
        let common = ExtractorOptions {
            explain: true,
            ..ExtractorOptions::default()
        };
        let mut extractor = extractor(name, common);
        let scan = wall(1.0);
        let found = lines(&scan, &mut *extractor);
        let fates = extractor.fates();
        assert_eq!(fates.len(), 720);
        let on_line = fates.iter().filter(|fate| **fate == Fate::OnLine(0));
        assert_eq!(on_line.count(), found[0].points as usize, "{name}");
        let nothing = fates.iter().filter(|fate| **fate == Fate::NoReturn).count();
        assert_eq!(nothing, 720 - found[0].points as usize, "{name}");
    }
}

/// The figures of the README; half a point off is a change that somebody should know of.
#[test]
fn office_scores_are_what_they_were() {
    let Some(folder) = std::env::var_os("CABLEPOSE_OFFICE") else {
        eprintln!("skipped: CABLEPOSE_OFFICE names no folder with offices");
        return;
    };
    let sets = [
        ("office360_722", 0.015),
        ("office180_722", 0.015),
        ("office190_761_lms500", 0.0065),
    ];
    let known = [
        [[98.1, 0.5], [98.8, 1.2], [99.1, 0.4]],
        [[93.8, 1.5], [91.7, 1.0], [93.5, 1.9]],
        [[96.8, 0.6], [98.5, 1.2], [99.3, 0.4]],
        [[92.7, 1.5], [89.8, 2.7], [96.9, 0.9]],
        [[98.4, 0.8], [99.0, 0.0], [99.8, 0.5]],
    ];
    for (column, (set, sigma_m)) in sets.iter().enumerate() {
        let office = office::read(Path::new(&folder), set).unwrap();
        let mut common = ExtractorOptions::default();
        common.segmentation.sigma_m = *sigma_m;
        common.segmentation.cut_at_seam = true;
        for (row, name) in METHODS.iter().enumerate() {
            let score = office::score(&office, &mut *extractor(name, common));
            let [found, wrong] = known[row][column];
            let text = format!("{set} {name}: {score:?}");
            assert!((score.true_pos_percent - found).abs() <= 0.5, "{text}");
            assert!((score.false_pos_percent - wrong).abs() <= 0.5, "{text}");
        }
        // The dissertation's segmentation, with the lines of a first look.
        let mut known_lines = common;
        known_lines.segmentation.cut = Cut::Reflector;
        let first = extractor("ml", common);
        let mut second = SecondLook::new(first, extractor("ml", known_lines));
        let score = office::score(&office, &mut second);
        assert!(score.true_pos_percent > 90.0, "{set} {score:?}");
        assert!(score.false_pos_percent < 3.0, "{set} {score:?}");
    }
}
