//! What each kind of record looks like from outside, to tell a person which one a file holds.

use crate::record::{
    BeamFate, ClockExchange, DelayPoint, ImuSample, Pose, Presence, Record, ReflectorLines, Scan,
    Segment, TrajectoryPoint, Value, Visit,
};
use std::convert::Infallible;

/// The columns of a kind of record, in order.
pub(super) fn columns<R: Record>() -> Vec<(&'static str, Presence)> {
    struct List(Vec<(&'static str, Presence)>);
    impl Visit for List {
        type Error = Infallible;
        fn column<T: Value>(
            &mut self,
            name: &'static str,
            presence: Presence,
            _: &T,
        ) -> Result<(), Infallible> {
            self.0.push((name, presence));
            Ok(())
        }
    }
    let mut list = List(Vec::new());
    let Ok(()) = R::default().visit(&mut list);
    list.0
}

/// The kind that a header is of, if it is another than the `wanted` one: its required columns are
/// all there, and it knows more of the columns than any other.
pub(super) fn of_header(names: &[String], wanted: &str) -> Option<&'static str> {
    [
        Match::of::<Scan>(names),
        Match::of::<ReflectorLines>(names),
        Match::of::<Segment>(names),
        Match::of::<Pose>(names),
        Match::of::<TrajectoryPoint>(names),
        Match::of::<ImuSample>(names),
        Match::of::<ClockExchange>(names),
        Match::of::<DelayPoint>(names),
        Match::of::<BeamFate>(names),
    ]
    .into_iter()
    .max_by_key(|found| (found.known, found.whole))
    .filter(|best| best.whole && best.kind != wanted)
    .map(|best| best.kind)
}

/// How well a header fits a kind.
struct Match {
    kind: &'static str,
    /// How many of the kind's columns are there.
    known: usize,
    /// Whether all required ones are.
    whole: bool,
}

impl Match {
    fn of<R: Record>(names: &[String]) -> Match {
        let has = |column: &str| names.iter().any(|name| name == column);
        let columns = columns::<R>();
        Match {
            kind: R::KIND,
            known: columns.iter().filter(|(name, _)| has(name)).count(),
            whole: columns
                .iter()
                .all(|(name, presence)| *presence != Presence::Required || has(name)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kind_of<R: Record>() -> Option<&'static str> {
        let names: Vec<String> = columns::<R>().iter().map(|(n, _)| n.to_string()).collect();
        of_header(&names, "")
    }

    #[test]
    fn every_kind_is_told_from_the_others() {
        assert_eq!(kind_of::<Scan>(), Some("scan"));
        assert_eq!(kind_of::<ReflectorLines>(), Some("lines"));
        assert_eq!(kind_of::<Segment>(), Some("segment"));
        assert_eq!(kind_of::<Pose>(), Some("pose"));
        assert_eq!(kind_of::<TrajectoryPoint>(), Some("trajectory"));
        assert_eq!(kind_of::<ImuSample>(), Some("imu"));
        assert_eq!(kind_of::<ClockExchange>(), Some("clock"));
        assert_eq!(kind_of::<DelayPoint>(), Some("delay"));
        assert_eq!(of_header(&["time".to_owned()], ""), None);
    }
}
