//! The parts of a case's object that a run need not have. In the output such a part is null where it
//! is missing; for the names of statistics it has all its fields.

use super::super::align::Alignment;
use super::super::axis::{AXES, Axis};
use super::super::case::{Case, Track};
use super::super::inertial::allan::Point;
use super::super::lag::Delay;
use super::super::orientation::{AngleResult, Orientation, RateResult};
use super::super::quality::LineTally;
use super::super::relative::{Delta, Relative};
use super::super::stability::Stability;
use super::super::statistics::Statistics;
use super::{Tree, object, statistics_fields};
use crate::record::Face;

/// A distance that is no component.
const LENGTH: usize = 0;
/// An angle that is none.
const ANGLE: usize = 3;

fn axis(index: usize) -> &'static Axis {
    &AXES[index.min(AXES.len() - 1)]
}

fn nothing() -> Statistics {
    Statistics::of(&mut [])
}

fn named(fields: Vec<(&str, Tree)>) -> Tree {
    let fields = fields
        .into_iter()
        .map(|(name, value)| (name.to_owned(), value));
    Tree::Object(fields.collect())
}

/// All parts, with null for a missing one where `output` is meant.
pub(super) fn sections(case: &Case, output: bool) -> Vec<(&'static str, Tree)> {
    let part = |missing: bool, tree: Tree| if missing && output { Tree::Null } else { tree };
    let (along, cross) = (
        case.track.as_ref().map(|t| t.along.statistics),
        case.track.as_ref().map(cross),
    );
    vec![
        ("alignment", alignment(&case.alignment)),
        (
            "delay",
            part(case.delay.is_none(), delay(case.delay.as_ref())),
        ),
        ("along", part(along.is_none(), length(along))),
        ("cross", part(cross.is_none(), length(cross))),
        ("rpe", relatives(&case.relative)),
        (
            "orientation",
            part(
                case.orientation.is_none(),
                orientation(case.orientation.as_ref()),
            ),
        ),
        ("quality", quality(case)),
        ("refused", refused(case)),
        ("input", input(case)),
        (
            "stability",
            part(case.stability.is_none(), stability(case.stability.as_ref())),
        ),
    ]
}

fn cross(track: &Track) -> Statistics {
    track.cross.statistics
}

fn length(statistics: Option<Statistics>) -> Tree {
    Tree::Object(statistics_fields(
        axis(LENGTH),
        &statistics.unwrap_or_else(nothing),
    ))
}

fn alignment(found: &Alignment) -> Tree {
    let [x, y, z] = [0, 1, 2].map(|i| Tree::Number(found.shift_m[i] * 1e3));
    let [roll, pitch, yaw] = found.angles_rad().map(|v| Tree::Number(v.to_degrees()));
    object([
        ("kind", Tree::Text(found.kind.clone())),
        ("x_mm", x),
        ("y_mm", y),
        ("z_mm", z),
        ("roll_deg", roll),
        ("pitch_deg", pitch),
        ("yaw_deg", yaw),
        ("note", found.note.clone().map_or(Tree::Null, Tree::Text)),
    ])
}

fn delay(found: Option<&Delay>) -> Tree {
    let ms = |value: fn(&Delay) -> f64| Tree::Number(found.map_or(f64::NAN, value) * 1e3);
    let curve = found
        .map_or(&[][..], |d| &d.curve)
        .iter()
        .map(|(delay_s, rms_m)| {
            Tree::List(vec![Tree::Number(delay_s * 1e3), Tree::Number(rms_m * 1e3)])
        });
    object([
        ("delay_ms", ms(|d| d.delay_s)),
        ("sigma_ms", ms(|d| d.sigma_s)),
        ("low_ms", ms(|d| d.interval_s[0])),
        ("high_ms", ms(|d| d.interval_s[1])),
        (
            "removed",
            found.map_or(Tree::Null, |d| Tree::Flag(d.removed)),
        ),
        ("samples", Tree::Count(found.map_or(0, |d| d.samples))),
        (
            "effective_n",
            Tree::Number(found.map_or(f64::NAN, |d| d.effective_n)),
        ),
        ("rms_before_mm", ms(|d| d.rms_before_m)),
        ("rms_after_mm", ms(|d| d.rms_after_m)),
        ("share_mm", ms(Delay::share_m)),
        (
            "sentence",
            found.map_or(Tree::Null, |d| Tree::Text(d.sentence())),
        ),
        ("curve", Tree::List(curve.collect())),
    ])
}

fn relatives(relatives: &[Relative]) -> Tree {
    let trees = relatives
        .iter()
        .map(|r| (r.delta.text.clone(), relative(r)));
    Tree::Object(trees.collect())
}

fn relative(relative: &Relative) -> Tree {
    let mut fields = vec![("pairs".to_owned(), Tree::Count(relative.pairs))];
    let axes = AXES.iter().zip(&relative.axes);
    fields.extend(axes.map(|(axis, s)| {
        (
            axis.name.to_owned(),
            Tree::Object(statistics_fields(axis, s)),
        )
    }));
    Tree::Object(fields)
}

/// `rpe.500ms.x.rms_mm`: the distance, and the rest of the path. A distance may have a point in it.
pub(super) fn relative_path(name: &str) -> Option<(Delta, &str)> {
    let rest = name.strip_prefix("rpe.")?;
    let ends = rest.match_indices('.').map(|(at, _)| at);
    ends.filter_map(|at| {
        let (delta, rest) = rest.split_at(at);
        Some((delta.parse().ok()?, rest.trim_start_matches('.')))
    })
    .next_back()
}

/// The tree below a distance, as far as names go.
pub(super) fn relative_names(delta: Delta) -> Tree {
    relative(&Relative {
        delta,
        pairs: 0,
        axes: vec![nothing(); AXES.len()],
    })
}

/// A run's tree below a distance that it was asked for.
pub(super) fn relative_of(case: &Case, delta: &Delta) -> Option<Tree> {
    case.relative
        .iter()
        .find(|r| r.delta.text == delta.text)
        .map(relative)
}

fn orientation(found: Option<&Orientation>) -> Tree {
    let mut fields = vec![(
        "source",
        found.map_or(Tree::Null, |o| Tree::Text(o.source.clone())),
    )];
    for (i, name) in ["roll", "pitch", "yaw"].into_iter().enumerate() {
        fields.push((name, angle(found.and_then(|o| o.angles.get(i)))));
    }
    let rates = ["x", "y", "z"].into_iter().enumerate();
    let rates = rates.map(|(i, name)| (name, rate(found.and_then(|o| o.rates.get(i)))));
    fields.push(("rate", named(rates.collect())));
    named(fields)
}

/// Seconds in an hour.
const HOUR_S: f64 = 3600.0;

fn angle(found: Option<&AngleResult>) -> Tree {
    let offset = found.map_or(f64::NAN, |a| a.offset_rad);
    let drift = found.map_or(f64::NAN, |a| a.drift_rad_s);
    let mut fields = vec![
        ("offset_deg".to_owned(), Tree::Number(offset.to_degrees())),
        (
            "drift_deg_h".to_owned(),
            Tree::Number(drift.to_degrees() * HOUR_S),
        ),
    ];
    let residual = found.map_or_else(nothing, |a| a.residual);
    fields.extend(statistics_fields(axis(ANGLE), &residual));
    Tree::Object(fields)
}

fn rate(found: Option<&RateResult>) -> Tree {
    let number = |value: fn(&RateResult) -> f64| found.map_or(f64::NAN, value);
    object([
        ("n", Tree::Count(found.map_or(0, |r| r.n))),
        (
            "rms_deg_s",
            Tree::Number(number(|r| r.rms_rad_s).to_degrees()),
        ),
        (
            "bias_deg_s",
            Tree::Number(number(|r| r.bias_rad_s).to_degrees()),
        ),
        ("scale", Tree::Number(number(|r| r.scale))),
    ])
}

fn quality(case: &Case) -> Tree {
    let counts = |list: &[usize]| Tree::List(list.iter().copied().map(Tree::Count).collect());
    let tally = case.quality.lines.clone().unwrap_or_default();
    let face = |value: &dyn Fn(&LineTally, usize) -> Tree| {
        let faces = Face::ALL.iter().enumerate();
        named(
            faces
                .map(|(i, face)| (face.name(), value(&tally, i)))
                .collect(),
        )
    };
    let residual = face(&|tally, i| {
        let rms_m = tally.faces.get(i).map_or(f64::NAN, |f| f.residual_rms_m());
        object([("rms_mm", Tree::Number(rms_m * 1e3))])
    });
    let points =
        face(&|tally, i| Tree::Number(tally.faces.get(i).map_or(f64::NAN, |f| f.points())));
    let seen = face(&|tally, i| Tree::Count(tally.faces.get(i).map_or(0, |f| f.seen)));
    let source = case
        .quality
        .lines
        .as_ref()
        .map(|lines| lines.source.clone());
    object([
        ("edges", counts(&case.quality.edges)),
        ("votes", counts(&case.quality.votes)),
        ("source", source.map_or(Tree::Null, Tree::Text)),
        ("scans", Tree::Count(tally.scans)),
        ("seen", seen),
        ("residual", residual),
        ("points", points),
        ("edges_seen", Tree::Number(tally.edges_seen())),
        (
            "edges_used",
            Tree::Number(case.scans.edges.map_or(f64::NAN, |s| s.mean)),
        ),
        ("strips_seen", Tree::Number(tally.strips_seen())),
        ("strips", counts(&tally.strips)),
    ])
}

fn refused(case: &Case) -> Tree {
    let mut fields = vec![("total".to_owned(), Tree::Count(case.scans.refused()))];
    let reasons = case.quality.refused.iter();
    fields.extend(reasons.map(|(reason, count)| (reason.clone(), Tree::Count(*count))));
    Tree::Object(fields)
}

fn input(case: &Case) -> Tree {
    let input = &case.input;
    object([
        ("nan", Tree::Count(input.nan)),
        ("unsorted", Tree::Count(input.unsorted)),
        ("repeated", Tree::Count(input.repeated)),
        ("gaps", Tree::Count(input.gaps)),
        ("longest_gap_s", Tree::Number(input.longest_gap_s)),
        ("jumps", Tree::Count(input.jumps)),
        ("largest_jump_s", Tree::Number(input.largest_jump_s)),
    ])
}

fn stability(found: Option<&Stability>) -> Tree {
    let period_s = found.map_or(f64::NAN, |s| s.period_s);
    let mut fields = vec![("period_s".to_owned(), Tree::Number(period_s))];
    for (i, axis) in AXES.iter().enumerate().take(6) {
        let curve = found.and_then(|s| s.curves.get(i)).map_or(&[][..], |c| c);
        let list = |value: &dyn Fn(&Point) -> f64| {
            Tree::List(curve.iter().map(|p| Tree::Exact(value(p))).collect())
        };
        let floor = found.and_then(|s| s.floor(i));
        let floor = |value: fn(&Point) -> f64| floor.map_or(f64::NAN, value);
        let curve = vec![
            (
                format!("floor_{}", axis.unit),
                Tree::Number(floor(|p| p.deviation) * axis.factor),
            ),
            ("floor_tau_s".to_owned(), Tree::Number(floor(|p| p.tau_s))),
            ("tau_s".to_owned(), list(&|p| p.tau_s)),
            (
                format!("deviation_{}", axis.unit),
                list(&|p| p.deviation * axis.factor),
            ),
            ("relative_error".to_owned(), list(&|p| p.error)),
        ];
        fields.push((axis.name.to_owned(), Tree::Object(curve)));
    }
    Tree::Object(fields)
}
