//! What a reader of a case's figures should know, in plain sentences.

use super::association::Reference;
use super::axis::AXES;
use super::case::Case;
use super::consistency::GROUPS;
use super::gathered::Gathered;
use super::measured::counts_by_name;
use super::number::{self, fixed};

/// A turn beyond this makes covariances that are not turned with it wrong, rad.
const TURNED_RAD: f64 = 0.02;

/// What a reader of the figures should know.
pub(super) fn notes(case: &Case, run: &Gathered, reference: &Reference) -> Vec<String> {
    let mut notes = Vec::new();
    let mut note = |count: usize, one: &str, many: &str| {
        if count > 0 {
            let what = if count == 1 { one } else { many };
            notes.push(format!("{} {what}", number::count(count)));
        }
    };
    let (scans, matching, input) = (&case.scans, &case.matching, &case.input);
    note(
        case.input.unsorted,
        "row is out of order in time; it was sorted in",
        "rows are out of order in time; they were sorted in",
    );
    note(
        case.input.repeated,
        "row has the stamp of another; it was left out",
        "rows have the stamp of another; they were left out",
    );
    note(
        scans.unexplained,
        "row has no numbers and no status that says why",
        "rows have no numbers and no status that says why",
    );
    note(
        input.nan,
        "row lacks a number, and its status does not say why",
        "rows lack a number, and their status does not say why",
    );
    note(
        scans.lost,
        "scan has no row: the sequence numbers skip it",
        "scans have no row: the sequence numbers skip them",
    );
    note(
        matching.outside,
        "pose is outside the reference's time",
        "poses are outside the reference's time",
    );
    note(
        matching.gap,
        "pose falls into a gap of the reference",
        "poses fall into gaps of the reference",
    );
    note(
        matching.jump,
        "pose falls between two reference points that the platform cannot have moved between",
        "poses fall between reference points that the platform cannot have moved between",
    );
    if input.jumps > 0 {
        notes.push(format!(
            "the stamps jump against the sequence numbers: {}, by up to {} s",
            times(input.jumps),
            fixed(input.largest_jump_s, 3)
        ));
    }
    if input.gaps > 0 {
        notes.push(format!(
            "rows are missing in time: {}, up to {} s",
            times(input.gaps),
            fixed(input.longest_gap_s, 3)
        ));
    }
    if let Some(why) = &run.no_delay {
        notes.push(format!(
            "the delay cannot be estimated: {why}; the errors are as measured"
        ));
    }
    if case.alignment.angle_rad() > TURNED_RAD {
        notes.push(
            "covariances are not turned with the poses: their consistency says nothing".to_owned(),
        );
    }
    if scans.partial > 0 {
        notes.push(format!(
            "{} of {} solved poses lack a component and do not count for it (only for the others): {}",
            number::count(scans.partial),
            number::count(scans.solved),
            counts_by_name(&scans.lacking)
        ));
    }
    notes.extend(left_out_of_nees(case));
    if case.is_empty() {
        notes.push(nothing_to_compare(case, reference));
    }
    notes
}

/// How many measured poses the consistency leaves out because their covariance cannot be used.
fn left_out_of_nees(case: &Case) -> Option<String> {
    let singles = AXES.iter().zip(&case.axes);
    let singles = singles.map(|(axis, result)| (axis.name, &result.consistency));
    let groups = GROUPS.iter().zip(&case.groups);
    let groups = groups.map(|((name, _), consistency)| (*name, consistency));
    let named: Vec<String> = singles
        .chain(groups)
        .filter(|(_, consistency)| consistency.left_out > 0)
        .map(|(name, c)| format!("{name} {}", number::count(c.left_out)))
        .collect();
    (!named.is_empty()).then(|| {
        format!(
            "poses whose variance is missing or not positive are left out of the NEES: {}",
            named.join(", ")
        )
    })
}

/// Why no pose could be compared.
fn nothing_to_compare(case: &Case, reference: &Reference) -> String {
    let why = if case.scans.rows == 0 && case.zone.is_none() {
        "there are no poses".to_owned()
    } else if case.scans.rows == 0 {
        "no pose is in the zone".to_owned()
    } else if case.scans.solved == 0 {
        "no scan has a pose".to_owned()
    } else {
        match (case.span, reference.span()) {
            (_, None) => "the reference has no points".to_owned(),
            (Some((first, last)), Some((from, to))) if last < from || first > to => format!(
                "the poses ({first} to {last} ns) and the reference ({from} to {to} ns) do not \
                 overlap in time"
            ),
            _ => "no pose has a reference close enough in time".to_owned(),
        }
    };
    format!("nothing to compare: {why}")
}

/// "once", "12 times".
fn times(count: usize) -> String {
    match count {
        1 => "once".to_owned(),
        _ => format!("{} times", number::count(count)),
    }
}
