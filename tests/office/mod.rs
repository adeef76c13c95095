//! Office scans with known lines, and the score of an extractor on them.
//!
//! The scans and their truth come from a generator outside the repository (`gen_office.py`), which
//! knows nothing of this crate. The score is that of `score.py` beside it, after the comparison of
//! Nguyen et al. (IROS 2005): an extracted and a true line match when their difference passes the
//! 99 % gate of chi-square and they overlap by half of the shorter one.

use cablepose::lines::extractor::Extractor;
use cablepose::record::{Scan, Segment};
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::path::Path;

/// A true line: beams on one plane face.
#[derive(Clone, Copy, Debug)]
pub struct TrueLine {
    pub r_m: f64,
    pub alpha_rad: f64,
    pub ends_m: [[f64; 2]; 2],
    pub points: f64,
    pub length_m: f64,
    /// Whether an extractor has to find it.
    pub counts: bool,
}

/// Scans and the true lines of each.
pub struct Office {
    pub scans: Vec<Scan>,
    pub truth: Vec<Vec<TrueLine>>,
}

/// Reads a set that the generator wrote.
pub fn read(folder: &Path, name: &str) -> std::io::Result<Office> {
    let rows = |file: String| -> std::io::Result<Vec<Vec<f64>>> {
        let text = std::fs::read_to_string(folder.join(file))?;
        let rows = text.lines().skip(1);
        Ok(rows
            .map(|row| row.split(',').map(|v| v.parse().unwrap()).collect())
            .collect())
    };
    let scans: Vec<Scan> = rows(format!("{name}.csv"))?
        .iter()
        .enumerate()
        .map(|(i, row)| Scan {
            seq: i as u32,
            angle_min_rad: row[1],
            angle_increment_rad: row[2],
            ranges_m: row[3..].to_vec().into(),
            ..Scan::default()
        })
        .collect();
    let mut truth = vec![Vec::new(); scans.len()];
    for row in rows(format!("{name}.truth.csv"))? {
        truth[row[0] as usize].push(TrueLine {
            r_m: row[3],
            alpha_rad: row[4],
            ends_m: [[row[5], row[6]], [row[7], row[8]]],
            points: row[9],
            length_m: row[10],
            counts: row[13] > 0.0,
        });
    }
    Ok(Office { scans, truth })
}

/// How well lines agree with the truth.
#[derive(Clone, Copy, Debug, Default)]
pub struct Score {
    pub lines: usize,
    pub true_pos_percent: f64,
    pub false_pos_percent: f64,
    pub sd_d_cm: f64,
    pub sd_alpha_deg: f64,
    pub sd_offset_cm: f64,
    pub nees_median: f64,
}

/// Extracts and scores.
pub fn score(office: &Office, extractor: &mut dyn Extractor) -> Score {
    let (mut found, mut judged, mut wanted) = (0usize, 0usize, 0usize);
    let (mut d_cm, mut alpha_deg, mut offset_cm, mut nees) = (vec![], vec![], vec![], vec![]);
    let mut segments: Vec<Segment> = Vec::new();
    for (scan, truth) in office.scans.iter().zip(&office.truth) {
        extractor.extract(scan, &mut segments);
        segments.retain(|s| s.points >= 9 && length_m(s.ends_m) >= 0.5);
        wanted += truth.iter().filter(|line| line.counts).count();
        judged += segments.len();
        let mut pairs = Vec::new();
        for (i, line) in truth.iter().enumerate() {
            for (j, segment) in segments.iter().enumerate() {
                let (dr, da, offset) = difference(line, segment);
                let [rr, ra, aa] = gate(line);
                let det = rr * aa - ra * ra;
                let d2 = (aa * dr * dr - 2.0 * ra * dr * da + rr * da * da) / det;
                if d2 <= -2.0 * 0.01f64.ln() && overlap(line, segment) >= 0.5 {
                    // Lines that count come first: a short neighbour cannot steal them.
                    let rank = if line.counts { d2 } else { d2 + 1e3 };
                    pairs.push((rank, i, j, dr, da, offset));
                }
            }
        }
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (mut used_i, mut used_j) = (vec![false; truth.len()], vec![false; segments.len()]);
        for (_, i, j, dr, da, offset) in pairs {
            if used_i[i] || used_j[j] {
                continue;
            }
            (used_i[i], used_j[j]) = (true, true);
            if !truth[i].counts {
                judged -= 1;
                continue;
            }
            found += 1;
            d_cm.push(100.0 * dr);
            alpha_deg.push(da.to_degrees());
            offset_cm.push(100.0 * offset);
            let [dd, cross, aa] = segments[j].covariance;
            nees.push(
                (aa * dr * dr - 2.0 * cross * dr * da + dd * da * da) / (dd * aa - cross * cross),
            );
        }
    }
    nees.sort_by(f64::total_cmp);
    Score {
        lines: judged,
        true_pos_percent: 100.0 * found as f64 / wanted.max(1) as f64,
        false_pos_percent: 100.0 * (judged - found) as f64 / judged.max(1) as f64,
        sd_d_cm: deviation(&d_cm),
        sd_alpha_deg: deviation(&alpha_deg),
        sd_offset_cm: deviation(&offset_cm),
        nees_median: nees.get(nees.len() / 2).copied().unwrap_or(f64::NAN),
    }
}

fn length_m(ends: [[f64; 2]; 2]) -> f64 {
    (ends[1][0] - ends[0][0]).hypot(ends[1][1] - ends[0][1])
}

fn wrap(angle_rad: f64) -> f64 {
    (angle_rad + PI).rem_euclid(TAU) - PI
}

fn middle(line: &TrueLine) -> [f64; 2] {
    [0, 1].map(|i| (line.ends_m[0][i] + line.ends_m[1][i]) / 2.0)
}

/// Differences in r (m) and alpha (rad), and the offset at the true line's middle (m).
fn difference(line: &TrueLine, segment: &Segment) -> (f64, f64, f64) {
    let mut da = wrap(segment.normal.alpha_rad - line.alpha_rad);
    let mut r = segment.normal.d_m;
    if da.abs() > FRAC_PI_2 {
        da = wrap(da + PI);
        r = -r;
    }
    let [x, y] = middle(line);
    let (sin, cos) = (line.alpha_rad + da).sin_cos();
    (r - line.r_m, da, r - (x * cos + y * sin))
}

/// Covariance of a fit with 2 cm of noise a point, and a surveyor's 1 cm and 0.5 deg.
fn gate(line: &TrueLine) -> [f64; 3] {
    let (n, length) = (line.points.max(2.0), line.length_m.max(1e-3));
    let offset = 0.02f64.powi(2) / n + 0.01f64.powi(2);
    let angle = 12.0 * 0.02f64.powi(2) / (n * length * length) + 0.5f64.to_radians().powi(2);
    let [x, y] = middle(line);
    let (sin, cos) = line.alpha_rad.sin_cos();
    let u = y * cos - x * sin;
    [offset + u * u * angle, u * angle, angle]
}

fn overlap(line: &TrueLine, segment: &Segment) -> f64 {
    let (sin, cos) = line.alpha_rad.sin_cos();
    let span = |ends: [[f64; 2]; 2]| {
        let [a, b] = ends.map(|[x, y]| y * cos - x * sin);
        (a.min(b), a.max(b))
    };
    let (p, q) = (span(line.ends_m), span(segment.ends_m));
    let both = (p.1.min(q.1) - p.0.max(q.0)).max(0.0);
    both / (p.1 - p.0).min(q.1 - q.0).max(1e-6)
}

fn deviation(values: &[f64]) -> f64 {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt()
}
