//! simulate --dilution: the map has its cells, agrees with what simulated scans give, and is refused
//! where it makes no sense.

mod shell;

use shell::{scratch, sh, testdata};
use std::fs;

/// Rows of the map: y, z, poses, poses told, then six standard deviations (m, rad).
fn rows(text: &str) -> Vec<Vec<f64>> {
    let number = |field: &str| field.parse().unwrap_or(f64::NAN);
    text.lines()
        .skip(1)
        .map(|line| line.split(',').map(number).collect())
        .collect()
}

#[test]
fn a_map_agrees_with_scans() {
    let dir = scratch("dilution");
    fs::copy(testdata("cablar.toml"), dir.join("frame.toml")).unwrap();
    let command = "simulate -f frame.toml --dilution --effects reference,-remission --step-m 1 \
                   --z-range 0.5,3.5 --dilution-html map.html";
    let ended = sh(&dir, command).expect(0);
    let header = ended.text().lines().next().unwrap();
    assert!(
        header.starts_with("y_m,z_m,poses,told,x_sigma_m,"),
        "{header}"
    );
    assert!(header.ends_with("yaw_sigma_rad"), "{header}");
    let map = rows(ended.text());
    assert_eq!(map.len(), 9 * 4);
    assert!(ended.stderr.contains("x     rms"), "{}", ended.stderr);
    let page = fs::read_to_string(dir.join("map.html")).unwrap();
    assert_eq!(page.matches("<svg").count(), 4);
    let rms_mm = |k: usize| {
        let squares: f64 = map.iter().map(|r| r[k] * r[k]).sum();
        (squares / map.len() as f64).sqrt() * 1e3
    };
    // The same conditions, 600 scans: nothing is better than the bound, and the solver is near it.
    sh(
        &dir,
        "simulate -q -f frame.toml --effects reference,-remission --trajectory random --n-scans 600 \
         --truth truth.csv --imu imu.csv -o scans.csv && extract-lines -q -f frame.toml scans.csv \
         | solve-pose -q -f frame.toml --imu imu.csv --imu-pitch-sigma-deg 0 > poses.csv",
    )
    .expect(0);
    let found = |component: &str| {
        let command = format!(
            "report --truth truth.csv --json poses.csv | grep -A 12 '\"{component}\": {{' \
             | grep rms_mm | tr -dc 0-9."
        );
        let ended = sh(&dir, &command).expect(0);
        ended.text().trim().parse::<f64>().unwrap()
    };
    for (k, component) in [(4, "x"), (5, "y"), (6, "z")] {
        let ratio = found(component) / rms_mm(k);
        assert!(ratio > 0.85 && ratio < 1.3, "{component}: {ratio}");
    }
}

#[test]
fn a_map_says_what_cannot_be() {
    let dir = scratch("dilution-faults");
    fs::copy(testdata("cablar.toml"), dir.join("frame.toml")).unwrap();
    for (options, says) in [
        ("--dilution --n-scans 5", "--n-scans"),
        ("--dilution --step-m 0", "--step-m"),
        ("--dilution --speed-m-s 2", "--speed-m-s"),
        ("--dilution-poses 5", "--dilution"),
    ] {
        let ended = sh(&dir, &format!("simulate -f frame.toml {options}")).expect(2);
        assert!(ended.stderr.contains(says), "{options}: {}", ended.stderr);
    }
    // Beside the plates no wall is hit: there is nothing to tell, and the cells are empty.
    let command = "simulate -q -f frame.toml --dilution --x-range 0.7,0.74 --tilt-deg 0 --step-m 2";
    let ended = sh(&dir, command).expect(0);
    let map = rows(ended.text());
    assert!(
        map.iter().all(|r| r[3] == 0.0 && r[4].is_nan()),
        "{}",
        ended.text()
    );
}
