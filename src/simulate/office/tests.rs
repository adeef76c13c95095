use super::*;

fn office(view: View, errors: Errors, seed: u64, scans: u64) -> Office {
    Office::new(Setup {
        view,
        errors,
        seed: Seed(seed),
        start: Stamp::from_ns(0),
        scans,
        scans_per_place: 1,
    })
}

fn exact(view: View) -> Errors {
    Errors {
        sigma_m: 0.0,
        resolution_m: 1e-9,
        mixed_share: 0.0,
        outlier_share: 0.0,
        dropout_share: 0.0,
        ..Errors::of(view)
    }
}

#[test]
fn the_same_seed_gives_the_same_scans() {
    let all = |seed: u64| {
        let mut office = office(View::Lms500, Errors::of(View::Lms500), seed, 3);
        let mut out = Vec::new();
        while let Some((scan, truth)) = office.advance() {
            out.push((scan.clone(), truth.to_vec()));
        }
        out
    };
    let debug = |seed: u64| format!("{:?}", all(seed));
    assert_eq!(debug(3), debug(3));
    assert_ne!(debug(3), debug(4));
}

/// Without errors, the beams between a true line's ends that lie on it are as many as it says.
#[test]
fn true_lines_hold_the_beams_they_say() {
    for view in [View::AllRound, View::Half, View::Lms500] {
        let mut office = office(view, exact(view), 11, 6);
        let mut lines = 0;
        while let Some((scan, truth)) = office.advance() {
            for line in truth {
                let (sin, cos) = line.normal.alpha_rad.sin_cos();
                let along = |[y, z]: [f64; 2]| z * cos - y * sin;
                let [from, to] = line.ends_m.map(along);
                assert!(from <= to, "{line:?}");
                for [y, z] in line.ends_m {
                    assert!((y * cos + z * sin - line.normal.d_m).abs() < 1e-9);
                }
                let on = scan.ranges_m.iter().enumerate().filter(|(i, range_m)| {
                    let (s, c) = scan.angle_rad(*i).sin_cos();
                    let point = [*range_m * c, *range_m * s];
                    let off = point[0] * cos + point[1] * sin - line.normal.d_m;
                    let place = along(point);
                    off.abs() < 1e-6 && (from - 1e-6..=to + 1e-6).contains(&place)
                });
                // A corner's beam may lie on both faces.
                let on = on.count() as i64;
                assert!((on - i64::from(line.points)).abs() <= 1, "{on} {line:?}");
                lines += 1;
            }
        }
        assert!(lines > 40, "{lines}");
    }
}

#[test]
fn lines_go_on_across_the_seam() {
    let view = View::AllRound;
    let mut office = office(view, exact(view), 5, 40);
    let mut across = 0;
    while let Some((_, truth)) = office.advance() {
        for line in truth {
            let [a, b] = line.ends_m.map(|[y, z]| z.atan2(y));
            across += u32::from(a > 0.0 && b < 0.0 && a - b > PI);
        }
    }
    assert!(across > 10, "{across}");
}

#[test]
fn there_is_everything_that_makes_it_hard() {
    let view = View::AllRound;
    let errors = Errors::of(view);
    let mut office = office(view, errors, 1, 60);
    assert!(
        office.plan().rooms.len() > 50,
        "{}",
        office.plan().rooms.len()
    );
    let (mut long, mut short, mut beams, mut on_lines, mut lost) = (0, 0, 0u32, 0u32, 0usize);
    while let Some((scan, truth)) = office.advance() {
        for line in truth {
            let [[y0, z0], [y1, z1]] = line.ends_m;
            let counts = line.points >= 9 && (y1 - y0).hypot(z1 - z0) >= 0.5;
            long += u32::from(counts);
            short += u32::from(!counts);
            on_lines += line.points;
        }
        beams += scan.beams() as u32;
        lost += scan.ranges_m.iter().filter(|r| r.is_infinite()).count();
    }
    assert!((5 * 60..20 * 60).contains(&long), "{long}");
    assert!(short > 60, "{short}");
    let share = f64::from(on_lines) / f64::from(beams);
    assert!((0.7..0.97).contains(&share), "{share}");
    assert!(lost > 60, "{lost}");
}

#[test]
fn ranges_scatter_as_they_should() {
    let view = View::Lms500;
    let errors = Errors {
        mixed_share: 0.0,
        outlier_share: 0.0,
        dropout_share: 0.0,
        ..Errors::of(view)
    };
    let mut noisy = office(view, errors, 2, 20);
    let mut clean = office(view, exact(view), 2, 20);
    let (mut sum, mut squares, mut n) = (0.0, 0.0, 0.0);
    while let (Some((a, _)), Some((b, _))) = (noisy.advance(), clean.advance()) {
        for (a, b) in a.ranges_m.iter().zip(b.ranges_m.iter()) {
            if a.is_finite() && b.is_finite() {
                sum += a - b;
                squares += (a - b).powi(2);
                n += 1.0;
                assert!(((a * 1000.0).round() - a * 1000.0).abs() < 1e-6);
            }
        }
    }
    assert!((sum / n).abs() < 2e-4);
    let sigma_m = f64::sqrt(squares / n);
    assert!((sigma_m - 0.0065).abs() < 2e-4, "{sigma_m}");
}
