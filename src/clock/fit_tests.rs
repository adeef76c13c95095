use super::*;
use crate::simulate::Seed;
use crate::simulate::exchanges::ExchangeModel;

fn exchanges(run: &[[i64; 3]]) -> Vec<Exchange> {
    let exchange = |&[send_ns, device_ns, receive_ns]: &[i64; 3]| Exchange {
        send_ns,
        device_ns,
        receive_ns,
    };
    run.iter().map(exchange).collect()
}

/// Error of the offset at the line's own instant, ns, and of the rate, ppb.
fn errors(line: &ClockLine, model: &ExchangeModel) -> (f64, f64) {
    let truth = model.offset_ns(line.at_host_ns as f64 * 1e-9);
    (
        line.offset_ns as f64 - truth,
        line.drift_ppb - model.drift_ppm * 1e3,
    )
}

fn fit_of(model: &ExchangeModel, number: u64, method: Method) -> ClockFit {
    let run = exchanges(&model.run(Seed(20), number));
    let settings = FitSettings {
        method,
        ..FitSettings::default()
    };
    fit(&run, &settings).unwrap()
}

#[test]
fn the_hull_is_within_microseconds() {
    let model = ExchangeModel::default();
    let (mut offsets, mut drifts, mut sigmas) = (0.0, 0.0, 0.0);
    let runs = 20;
    for number in 0..runs {
        let found = fit_of(&model, number, Method::Hull);
        assert_eq!(found.verdict, Verdict::TwoWay);
        assert_eq!(found.exchanges, 2100);
        let (offset_ns, drift_ppb) = errors(&found.line, &model);
        assert!(offset_ns.abs() < 4e3, "{offset_ns}");
        assert!(found.bracket_ns.unwrap() > 150e3 && found.bracket_ns.unwrap() < 250e3);
        assert!(found.support_points >= 4);
        assert!((found.hull_gap_ns.unwrap() - found.rtt_min_ns).abs() < 100e3);
        offsets += offset_ns * offset_ns;
        drifts += drift_ppb * drift_ppb;
        sigmas += found.offset_sigma_ns.unwrap();
    }
    let n = runs as f64;
    let (offset_ns, drift_ppb) = ((offsets / n).sqrt(), (drifts / n).sqrt());
    assert!(offset_ns < 1400.0, "{offset_ns}");
    assert!(drift_ppb < 90.0, "{drift_ppb}");
    let ratio = sigmas / n / offset_ns;
    assert!((0.4..2.5).contains(&ratio), "{ratio}");
}

#[test]
fn the_methods_are_ranked_as_known() {
    let model = ExchangeModel::default();
    let rms_us = |method| {
        let squares: f64 = (0..8)
            .map(|number| {
                errors(&fit_of(&model, number, method).line, &model)
                    .0
                    .powi(2)
            })
            .sum();
        (squares / 8.0).sqrt() * 1e-3
    };
    // The figures of simulations with the same delays, 300 runs.
    for (method, low_us, high_us) in [
        (Method::Hull, 0.0, 2.0),
        (Method::Joint, 0.0, 2.5),
        (Method::Window, 1.0, 6.0),
        (Method::MinRtt, 1.0, 10.0),
        (Method::Weighted, 30.0, 60.0),
        (Method::OneWay, 145.0, 165.0),
        (Method::Mean, 140.0, 240.0),
    ] {
        let rms = rms_us(method);
        assert!((low_us..high_us).contains(&rms), "{method:?}: {rms}");
    }
}

#[test]
fn a_known_asymmetry_is_taken_off() {
    let model = ExchangeModel {
        minimum_s: [150e-6, 320e-6],
        ..ExchangeModel::default()
    };
    let run = exchanges(&model.run(Seed(3), 0));
    let plain = fit(&run, &FitSettings::default()).unwrap();
    let (off_ns, _) = errors(&plain.line, &model);
    assert!((off_ns + 85e3).abs() < 5e3, "{off_ns}");
    let settings = FitSettings {
        asymmetry_ns: 170e3,
        ..FitSettings::default()
    };
    let found = fit(&run, &settings).unwrap();
    let (off_ns, _) = errors(&found.line, &model);
    assert!(off_ns.abs() < 5e3, "{off_ns}");
    assert_eq!(found.asymmetry_ns, 170e3);
    assert!(off_ns.abs() < found.bracket_ns.unwrap());
}

#[test]
fn stamps_before_their_requests_are_not_trusted() {
    // The device stamps when a scan was done, up to a period of 28.57 ms before it is asked.
    let model = ExchangeModel {
        drift_ppm: 20.0,
        ..ExchangeModel::default()
    };
    let mut run = exchanges(&model.run(Seed(4), 0));
    for exchange in &mut run {
        let age_ns = exchange.device_ns.rem_euclid(28_571_429);
        exchange.device_ns -= age_ns - age_ns % 1000;
    }
    run.sort_by_key(|exchange| exchange.device_ns);
    let found = fit(&run, &FitSettings::default()).unwrap();
    assert_eq!(found.verdict, Verdict::OneWayStampsVoid);
    assert_eq!(found.method, Method::OneWay);
    assert_eq!(found.bracket_ns, None);
    assert!(found.hull_gap_ns.unwrap() < 0.0);
    let (off_ns, _) = errors(&found.line, &model);
    assert!(off_ns < 0.0 && off_ns > -2e6, "{off_ns}");
}

#[test]
fn a_fast_clock_is_no_void_stamp() {
    // 300 us a second are more than the shortest round trip.
    let model = ExchangeModel {
        drift_ppm: 300.0,
        minimum_s: [25e-6, 25e-6],
        duration_s: 20.0,
        ..ExchangeModel::default()
    };
    let found = fit_of(&model, 0, Method::Hull);
    assert_eq!(found.verdict, Verdict::TwoWay);
    assert!((found.line.drift_ppb - 300e3).abs() < 2e3, "{found:?}");
}

#[test]
fn void_stamps_show_in_slow_polls_too() {
    let run: Vec<Exchange> = (0..40)
        .map(|k| {
            let send_ns = k * 2_000_000_000 + (k * 7_919_003) % 1_000_000_000;
            let read_ns = send_ns + 100_000;
            Exchange {
                send_ns,
                device_ns: read_ns - read_ns % 28_571_000,
                receive_ns: send_ns + 300_000,
            }
        })
        .collect();
    let found = fit(&run, &FitSettings::default()).unwrap();
    assert_eq!(found.verdict, Verdict::OneWayStampsVoid);
}

#[test]
fn coarse_stamps_are_no_bias() {
    // A calendar that counts whole milliseconds, more than a round trip.
    let model = ExchangeModel {
        tick_ns: 1_000_000,
        ..ExchangeModel::default()
    };
    let found = fit_of(&model, 0, Method::Hull);
    assert_eq!(found.verdict, Verdict::TwoWay);
    let (off_ns, _) = errors(&found.line, &model);
    assert!(off_ns.abs() < 30e3, "{off_ns}");
    let found = fit_of(&model, 0, Method::OneWay);
    let (off_ns, _) = errors(&found.line, &model);
    assert!((-250e3..-100e3).contains(&off_ns), "{off_ns}");
}

#[test]
fn a_changing_rate_is_followed_in_pieces() {
    let model = ExchangeModel {
        wander_ppm: 10.0,
        duration_s: 120.0,
        ..ExchangeModel::default()
    };
    let found = fit_of(&model, 0, Method::Hull);
    assert_eq!(found.verdict, Verdict::DriftChanged);
    assert!(found.pieces.len() >= 4, "{}", found.pieces.len());
    let mut last = i64::MIN;
    for piece in &found.pieces {
        assert!(piece.from_host_ns > last);
        last = piece.to_host_ns;
        let (off_ns, _) = errors(&piece.line, &model);
        assert!(off_ns.abs() < 12e3, "{off_ns}");
    }
    let even = fit_of(&ExchangeModel::default(), 1, Method::Hull);
    assert_eq!(even.pieces.len(), 1);
}

#[test]
fn lines_go_both_ways() {
    let line = ClockLine {
        at_host_ns: 1_700_000_000_000_000_000,
        offset_ns: -1_699_999_000_000_000_000,
        drift_ppb: 20_000.0,
    };
    assert_eq!(line.device_ns(1_700_000_001_000_000_000), 1_001_000_020_000);
    for host_ns in [1_699_999_000_000_000_001, 1_700_000_100_000_000_007] {
        assert!((line.host_ns(line.device_ns(host_ns)) - host_ns).abs() <= 1);
    }
}

#[test]
fn too_little_is_refused() {
    let run = exchanges(&ExchangeModel::default().run(Seed(1), 0));
    let settings = FitSettings::default();
    assert!(matches!(
        fit(&[], &settings),
        Err(FitError::TooFew { found: 0, .. })
    ));
    assert!(matches!(
        fit(&run[..3], &settings),
        Err(FitError::TooFew { found: 3, .. })
    ));
    assert_eq!(fit(&[run[0]; 10], &settings), Err(FitError::Still));
    assert!(fit(&run[..4], &settings).is_ok());
}
