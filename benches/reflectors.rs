//! How long the three-reflector fit takes on one core, a scan of 761 beams, without input and
//! output. `cargo bench --bench reflectors` prints figures and passes no judgement.
//!
//! The scans are those of a scanner that moves along the frame's diagonal at 1 m/s, at 35 Hz, with
//! 6.5 mm of noise, strips on the ceiling and a background 0.7 m behind everything.

use cablepose::frame::Frame;
use cablepose::lines::reflectors::{Options, ReflectorFit};
use cablepose::motion::{LineFit, SelfMotion};
use cablepose::record::{ReflectorLines, Scan, Stamp};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, Normal};
use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

const ROUNDS: usize = 30;

fn main() {
    let text = include_str!("../testdata/cablar.toml");
    let frame = Frame::parse(text, Path::new("cablar.toml")).expect("the frame file is right");
    let scans = scans(250);
    let tracking = Options::default();
    let cold = Options {
        track: false,
        ..tracking
    };
    for (name, options, deskew) in [
        ("cold", cold, false),
        ("tracked", tracking, false),
        ("tracked, deskewed", tracking, true),
    ] {
        let seconds = best(scans.len(), || {
            let mut fit = ReflectorFit::new(&frame, options);
            let mut own = SelfMotion::new(frame.bounds.dy_m);
            let (mut scans, mut lines) = (scans.iter(), ReflectorLines::default());
            move || {
                let Some(scan) = scans.next() else { return };
                let found = if deskew {
                    lines.begin(scan);
                    own.take(lines.stamp, |motion| {
                        let joint = fit.fit_moving(black_box(scan), motion)?;
                        Some(LineFit {
                            lines: joint.lines,
                            seen: joint.seen(&options),
                            covariance: joint.covariance,
                            sensitivity: joint.sensitivity,
                        })
                    })
                    .is_some()
                } else {
                    fit.fit(black_box(scan)).is_some()
                };
                assert!(black_box(found), "lines in every scan");
            }
        });
        println!("reflectors {name:18} {:8.2} us a scan", 1e6 * seconds);
    }
}

/// Mean time of a scan, s: of each scan the best of some rounds, so that other work on the machine
/// counts as little as possible.
fn best<F: FnMut()>(scans: usize, mut round: impl FnMut() -> F) -> f64 {
    let mut least = vec![f64::INFINITY; scans];
    for _ in 0..ROUNDS {
        let mut work = round();
        for least in &mut least {
            let start = Instant::now();
            work();
            *least = least.min(start.elapsed().as_secs_f64());
        }
    }
    least.iter().sum::<f64>() / scans as f64
}

/// Scans along the diagonal, there and no further.
fn scans(count: usize) -> Vec<Scan> {
    let noise = Normal::new(0.0, 0.0065).expect("a valid sigma");
    let mut rng = ChaCha8Rng::seed_from_u64(35);
    let (width, height, gap) = (10.45, 5.5, 0.7);
    let increment = 0.25f64.to_radians();
    let period = 1.0 / 35.0;
    (0..count)
        .map(|k| {
            let start_s = k as f64 * period;
            let ranges: Vec<f64> = (0..761)
                .map(|i| {
                    let angle = -5f64.to_radians() + f64::from(i) * increment;
                    let share = (start_s + f64::from(i) * period / 1440.0) / 8.6;
                    let (y, z) = (-4.0 + 8.0 * share, 0.465 + 3.035 * share);
                    let (v, u) = angle.sin_cos();
                    let wall = |gap: f64| ((0.5 * width + gap) - u.signum() * y) / u.abs();
                    let ceiling = |gap: f64| (height + gap - z) / v.max(1e-9);
                    let at = y + ceiling(0.0) * u;
                    let strip = [3.9f64, 1.3, -1.3, -3.9]
                        .iter()
                        .any(|p| (at - p).abs() < 0.4);
                    let range = if ceiling(0.0) > wall(0.0) {
                        wall(0.0)
                    } else if strip {
                        ceiling(0.0)
                    } else {
                        ceiling(gap).min(wall(gap))
                    };
                    ((range + noise.sample(&mut rng)) * 1000.0).round() / 1000.0
                })
                .collect();
            Scan {
                stamp: Stamp::from_ns(1_000_000_000).plus_s(start_s),
                seq: k as u32,
                angle_min_rad: -5f64.to_radians(),
                angle_increment_rad: increment,
                time_increment_s: period / 1440.0,
                scan_time_s: period,
                ranges_m: ranges.into(),
                ..Scan::default()
            }
        })
        .collect()
}
