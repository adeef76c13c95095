//! Tests of the angle jitter's model.

use super::*;
use crate::record::Stamp;
use crate::simulate::random::{Draws, Purpose, Seed};

const A: f64 = 0.09;
const B: f64 = -0.05;
const C: f64 = -0.02;

/// Scans of a room's corner from a scanner whose turn hangs on its periods by A, B, C (mdeg/us):
/// walls at y = 2 m and z = 3 m, 3 mm of noise. With the true turn of each, rad.
fn scans(count: usize, seed: u64) -> Vec<(Scan, f64)> {
    let mut draws = Seed(seed).draws(Purpose::Clocks, 0);
    let swing = |k: usize, draws: &mut Draws| {
        150.0 * (2.0 * std::f64::consts::PI * 0.3 * k as f64).sin() + 60.0 * draws.normal()
    };
    let off_us: Vec<f64> = (0..count + 3)
        .map(|k| swing(k, &mut draws).round())
        .collect();
    let mut us = 1e9;
    (0..count)
        .map(|k| {
            // off_us[k + 2] is the period that begins with scan k.
            let mdeg = A * off_us[k + 1] + B * off_us[k + 2] + C * off_us[k];
            let turn_rad = (mdeg * 1e-3).to_radians();
            let mut scan = Scan {
                seq: k as u32,
                device: Some(Stamp::from_ns((us * 1e3) as i64)),
                angle_min_rad: 0.1,
                angle_increment_rad: 0.005,
                ..Scan::default()
            };
            us += 40_000.0 + off_us[k + 2];
            for beam in 0..280 {
                let theta = scan.angle_rad(beam) + turn_rad;
                let range_m = (2.0 / theta.cos()).min(3.0 / theta.sin());
                scan.ranges_m.push(range_m + 0.003 * draws.normal());
            }
            (scan, turn_rad)
        })
        .collect()
}

#[test]
fn the_model_is_found_and_takes_the_jitter_out() {
    let mut learner = Learner::default();
    scans(400, 1)
        .iter()
        .for_each(|(scan, _)| learner.push(scan));
    let model = learner.learn().unwrap();
    for (found, true_mdeg) in model.one_late_deg_per_us.into_iter().zip([A, B, C]) {
        assert!((found * 1e3 - true_mdeg).abs() < 0.01, "{model:?}");
    }
    assert_eq!(AngleJitter::from_toml(&model.to_toml()).unwrap(), model);
    let left_deg = |delay| {
        let mut correction = Correction::new(model.clone(), delay);
        let mut left = Vec::new();
        let mut note = |scan: &Scan, turn_rad: f64| {
            left.push((turn_rad - (scan.angle_min_rad - 0.1)).to_degrees());
        };
        let all = scans(300, 2);
        for (scan, _) in &all {
            if let Some(ready) = correction.push(scan) {
                note(ready, all[ready.seq as usize].1);
            }
        }
        if let Some(ready) = correction.finish() {
            note(ready, all[ready.seq as usize].1);
        }
        assert_eq!(left.len(), 300);
        mean_and_sd(&left[5..299]).1
    };
    let before_deg = mean_and_sd(&scans(300, 2)[5..].iter().map(|s| s.1).collect::<Vec<_>>()).1;
    let (at_once_deg, late_deg) = (left_deg(Delay::None), left_deg(Delay::OneScan));
    assert!(before_deg.to_degrees() > 0.009);
    assert!(at_once_deg < 0.7 * before_deg.to_degrees(), "{at_once_deg}");
    assert!(late_deg < 0.0015, "{late_deg}");
}

#[test]
fn a_gap_and_another_setting_go_out_as_they_came() {
    let mut learner = Learner::default();
    let all = scans(200, 3);
    all.iter().for_each(|(scan, _)| learner.push(scan));
    let model = learner.learn().unwrap();
    let mut correction = Correction::new(model.clone(), Delay::None);
    for lost in [0, 1, 10, 11] {
        let scan = &all[lost].0;
        let turned = correction.push(scan).unwrap().angle_min_rad != scan.angle_min_rad;
        assert_eq!(turned, matches!(lost, 1 | 11), "{lost}");
    }
    // Twice the speed.
    let mut correction = Correction::new(model, Delay::OneScan);
    for (k, (scan, _)) in all.iter().enumerate() {
        let device = Some(Stamp::from_ns(20_000_000 * k as i64));
        let scan = Scan {
            device,
            ..scan.clone()
        };
        if let Some(ready) = correction.push(&scan) {
            assert_eq!(ready.angle_min_rad, 0.1);
        }
    }
    assert_eq!(correction.finish().unwrap().angle_min_rad, 0.1);
    assert_eq!(correction.counts(), (0, 200));
}

#[test]
fn what_cannot_be_learned_is_said() {
    let mut learner = Learner::default();
    assert_eq!(learner.learn(), Err(AngleJitterError::FewScans(0)));
    // Straight ahead of a wall at equal ranges nothing shows the angle.
    for (k, (mut scan, _)) in scans(100, 4).into_iter().enumerate() {
        scan.ranges_m
            .iter_mut()
            .for_each(|m| *m = 2.0 + 1e-4 * (k % 3) as f64);
        learner.push(&scan);
    }
    assert_eq!(learner.learn(), Err(AngleJitterError::FewBeams(0)));
    assert!(AngleJitter::from_toml("scans = 3").is_err());
    let text = scans(100, 5);
    let mut learner = Learner::default();
    text.iter().for_each(|(scan, _)| learner.push(scan));
    let model = learner.learn().unwrap().to_toml();
    let wrong = model.replace("at_once_deg_per_us = ", "at_once_deg_per_us = inf #");
    assert!(matches!(
        AngleJitter::from_toml(&wrong),
        Err(AngleJitterError::File(_))
    ));
}
