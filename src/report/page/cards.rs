//! Five numbers that say the most. A colour stands only where a limit is stated: by `--fail-if`, by
//! the band of an honest covariance, or on the card.

use super::super::axis::{AXES, POSITION};
use super::super::case::{Case, Report};
use super::super::number::{NONE, change, count, fixed};
use super::evaluation::delay_parts;
use maud::{Markup, html};

/// Share of scans below which the card for solved scans is coloured, percent.
const SOLVED_LIMIT_PCT: f64 = 99.0;

/// One number.
struct Card {
    title: String,
    value: String,
    below: String,
    class: &'static str,
}

/// The cards of `case`, with what was before where the report has an earlier run.
pub(super) fn cards(report: &Report, case: &Case) -> Markup {
    let all = [
        position(report, case),
        yaw(report, case),
        late(report, case),
        nees(case),
        solved(case),
    ];
    html! {
        @if report.cases.len() > 1 { p class="whose" { (case.name()) } }
        div class="cards" {
            @for card in &all {
                div class="card" {
                    span { (card.title) }
                    b class=[Some(card.class).filter(|c| !c.is_empty())] { (card.value) }
                    span { (card.below) }
                }
            }
        }
    }
}

fn rms(case: &Case, index: usize) -> f64 {
    let axis = case.axes.get(index);
    axis.map_or(f64::NAN, |a| a.statistics.rms)
}

/// The class of a value that `--fail-if` limits.
fn judged(report: &Report, case: &Case, statistic: &str) -> &'static str {
    let about = |gate: &str| {
        let condition = gate.rsplit_once(':').map_or(gate, |(_, c)| c).trim();
        let rest = condition.strip_prefix(statistic).map(str::trim_start);
        rest.is_some_and(|r| r.starts_with(['<', '>']))
    };
    let name = case.name();
    let verdicts = report.verdicts.iter();
    let found: Vec<bool> = verdicts
        .filter(|v| v.case == name && about(&v.gate))
        .map(|v| v.failed)
        .collect();
    match found.as_slice() {
        [] => "",
        failed if failed.contains(&true) => "warn",
        _ => "good",
    }
}

/// "before: 43.66 mm (−92.6 %)", of the report's first run.
fn before(report: &Report, case: &Case, index: usize) -> Option<String> {
    let first = report.cases.first().filter(|c| !std::ptr::eq(*c, case))?;
    let (was, is) = (rms(first, index), rms(case, index));
    let axis = AXES.get(index).filter(|_| was.is_finite())?;
    Some(format!(
        "before: {} ({})",
        axis.quantity(was),
        change(was, is)
    ))
}

fn position(report: &Report, case: &Case) -> Card {
    let axis = &AXES[POSITION];
    let s = case.axes.get(POSITION).map(|a| a.statistics);
    let p95 = s.map_or(f64::NAN, |s| s.p95);
    let below = before(report, case, POSITION).or_else(|| {
        let delay = case.delay.as_ref()?;
        let mm = |m: f64| axis.quantity(m);
        if delay.removed {
            Some(format!("with the delay: {}", mm(delay.rms_before_m)))
        } else if delay.rms_after_m < 0.9 * delay.rms_before_m {
            Some(format!("without the delay: {}", mm(delay.rms_after_m)))
        } else {
            None
        }
    });
    Card {
        title: "position error, rms".to_owned(),
        value: axis.quantity(rms(case, POSITION)),
        below: below.unwrap_or_else(|| format!("95 % below {}", axis.quantity(p95))),
        class: judged(report, case, "position.rms_mm"),
    }
}

fn yaw(report: &Report, case: &Case) -> Card {
    let mut card = component(report, case, 5);
    let imu = case.orientation.as_ref().and_then(|o| o.angles.get(2));
    if let Some(angle) = imu.filter(|a| a.residual.n > 0) {
        let rms = AXES[5].quantity(angle.residual.rms);
        card.below = format!("against the IMU: {rms}");
    }
    card
}

fn component(report: &Report, case: &Case, index: usize) -> Card {
    let axis = &AXES[index];
    let s = case.axes.get(index).map(|a| a.statistics);
    let (bias, max) = s.map_or((f64::NAN, f64::NAN), |s| (s.bias, s.max));
    let below = before(report, case, index);
    Card {
        title: format!("{} error, rms", axis.name),
        value: axis.quantity(rms(case, index)),
        below: below.unwrap_or_else(|| {
            let bias = fixed(bias * axis.factor, axis.decimals);
            format!("bias {bias}, max {}", axis.quantity(max))
        }),
        class: judged(report, case, &format!("{}.rms_{}", axis.name, axis.unit)),
    }
}

/// The delay where there is one to tell, else the error in x.
fn late(report: &Report, case: &Case) -> Card {
    let Some(delay) = &case.delay else {
        return component(report, case, 0);
    };
    let sigma = if delay.sigma_s.is_finite() {
        let (_, sigma) = delay_parts(delay);
        format!("± {sigma} ms")
    } else {
        "as given".to_owned()
    };
    let removed = if delay.removed {
        "taken out"
    } else {
        "in the errors"
    };
    Card {
        title: "delay".to_owned(),
        value: format!("{} ms", delay_parts(delay).0),
        below: format!("{sigma}, {removed}"),
        class: judged(report, case, "delay.delay_ms"),
    }
}

fn nees(case: &Case) -> Card {
    let title = "NEES of x and yaw, per dof".to_owned();
    let Some(c) = case.groups.first().filter(|c| c.n > 0) else {
        return Card {
            title,
            value: NONE.to_owned(),
            below: "no covariances".to_owned(),
            class: "",
        };
    };
    Card {
        title,
        value: fixed(c.nees, 2),
        below: format!("95 % band {} … {}", fixed(c.low, 2), fixed(c.high, 2)),
        class: if c.is_honest() == Some(true) {
            "good"
        } else {
            "warn"
        },
    }
}

fn solved(case: &Case) -> Card {
    let scans = &case.scans;
    let without = scans.refused() + scans.lost;
    let total = count(scans.rows + scans.lost);
    let (class, below) = if scans.solved_pct() < SOLVED_LIMIT_PCT {
        let limit = fixed(SOLVED_LIMIT_PCT, 0);
        (
            "warn",
            format!("limit {limit} %: {} without a pose", count(without)),
        )
    } else {
        ("", format!("{} of {total} without a pose", count(without)))
    };
    Card {
        title: "scans solved".to_owned(),
        value: format!(
            "{} %",
            fixed(scans.solved_pct(), if without == 0 { 0 } else { 1 })
        ),
        below,
        class,
    }
}
