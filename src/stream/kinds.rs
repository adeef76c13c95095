//! The kinds of records: what each looks like from outside, to tell which one a file holds, and how
//! to do something with whichever it is.

use super::Role;
use super::check::StreamRecord;
use super::ros2::Topic;
use crate::record::{
    BeamFate, ClockExchange, DelayPoint, ImuSample, Pose, Presence, Record, ReflectorLines, Scan,
    Segment, TrajectoryPoint, Value, Visit,
};
use std::convert::Infallible;

/// What a stream's records are. A trajectory is the true or the desired one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// Scans.
    Scans,
    /// IMU samples.
    Imu,
    /// The three lines of a scan and its strip edges.
    Lines,
    /// Lines of a general scene.
    Segments,
    /// Poses.
    Poses,
    /// The true trajectory.
    Truth,
    /// The desired trajectory.
    Desired,
    /// Exchanges of time stamps with a device.
    Clock,
    /// The error over the delay.
    Delays,
    /// What became of single beams.
    Beams,
}

/// The names of a kind's topics in MCAP.
pub(super) struct KindTopics {
    /// Those that its records are read from.
    pub(super) read: Vec<&'static str>,
    /// Those that they are written to.
    pub(super) written: Vec<&'static str>,
}

/// Something to do with a kind of record.
pub trait KindVisitor {
    /// What comes of it.
    type Out;
    /// Does it.
    fn visit<R: StreamRecord>(self, kind: Kind) -> Self::Out;
}

impl Kind {
    /// All kinds, in the order in which they come about.
    pub const ALL: [Kind; 10] = [
        Kind::Scans,
        Kind::Imu,
        Kind::Lines,
        Kind::Segments,
        Kind::Poses,
        Kind::Truth,
        Kind::Desired,
        Kind::Clock,
        Kind::Delays,
        Kind::Beams,
    ];

    /// What a file of such records is called: `scans`, `truth`.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Scans => "scans",
            Kind::Imu => "imu",
            Kind::Lines => "lines",
            Kind::Segments => "segments",
            Kind::Poses => "poses",
            Kind::Truth => "truth",
            Kind::Desired => "desired",
            Kind::Clock => "clock",
            Kind::Delays => "delays",
            Kind::Beams => "beams",
        }
    }

    /// The kind of this name.
    pub fn named(name: &str) -> Option<Kind> {
        Kind::ALL.into_iter().find(|kind| kind.name() == name)
    }

    /// The kind that a CSV header is of: its required columns are all there, and it knows more of
    /// the columns than any other. A trajectory is taken for the true one.
    pub fn of_header(columns: &[String]) -> Option<Kind> {
        Match::best(columns).map(|best| best.kind)
    }

    /// The kind of the CSV that begins with these bytes, if its header is in them.
    pub fn in_csv(head: &[u8]) -> Option<Kind> {
        let mut reader = csv::ReaderBuilder::new()
            .has_headers(false)
            .comment(Some(b'#'))
            .from_reader(head);
        let mut header = csv::ByteRecord::new();
        if !reader.read_byte_record(&mut header).is_ok_and(|more| more) {
            return None;
        }
        let text = |name: &[u8]| String::from_utf8_lossy(name).into_owned();
        Kind::of_header(&header.iter().map(text).collect::<Vec<_>>())
    }

    /// The kinds whose topics are among these.
    pub fn in_topics<'a>(topics: impl Iterator<Item = &'a str>) -> Vec<Kind> {
        let there: Vec<&str> = topics.collect();
        let has = |kind: &Kind| kind.topics().read.iter().any(|topic| there.contains(topic));
        Kind::ALL.into_iter().filter(has).collect()
    }

    /// Whether such records are read from this topic of MCAP.
    pub fn is_read_from(self, topic: &str) -> bool {
        self.topics().read.contains(&topic)
    }

    /// Whether records of the two kinds can be held against one another: one kind, or poses and
    /// trajectories, which share their columns.
    pub fn is_like(self, other: Kind) -> bool {
        let is_pose = |kind| matches!(kind, Kind::Poses | Kind::Truth | Kind::Desired);
        self == other || (is_pose(self) && is_pose(other))
    }

    /// Which of the two trajectories it is; of no meaning for other kinds.
    pub fn role(self) -> Role {
        if self == Kind::Truth {
            Role::Truth
        } else {
            Role::Desired
        }
    }

    /// Calls a visitor with the record of this kind.
    pub fn call<V: KindVisitor>(self, visitor: V) -> V::Out {
        match self {
            Kind::Scans => visitor.visit::<Scan>(self),
            Kind::Imu => visitor.visit::<ImuSample>(self),
            Kind::Lines => visitor.visit::<ReflectorLines>(self),
            Kind::Segments => visitor.visit::<Segment>(self),
            Kind::Poses => visitor.visit::<Pose>(self),
            Kind::Truth | Kind::Desired => visitor.visit::<TrajectoryPoint>(self),
            Kind::Clock => visitor.visit::<ClockExchange>(self),
            Kind::Delays => visitor.visit::<DelayPoint>(self),
            Kind::Beams => visitor.visit::<BeamFate>(self),
        }
    }

    /// The topics of MCAP that such records travel by.
    pub(super) fn topics(self) -> KindTopics {
        struct Find;
        impl KindVisitor for Find {
            type Out = KindTopics;
            fn visit<R: StreamRecord>(self, kind: Kind) -> KindTopics {
                let names = |topics: &[&'static Topic]| topics.iter().map(|t| t.name).collect();
                let role = kind.role();
                KindTopics {
                    read: names(R::read_from(role)),
                    written: names(R::written_to(role)),
                }
            }
        }
        self.call(Find)
    }
}

impl std::fmt::Display for Kind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

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
    Match::best(names)
        .filter(|best| best.name != wanted)
        .map(|best| best.name)
}

/// How well a header fits a kind.
struct Match {
    kind: Kind,
    /// The record's name in messages.
    name: &'static str,
    /// How many of the kind's columns are there.
    known: usize,
    /// Whether all required ones are.
    whole: bool,
}

impl Match {
    /// The kind that fits best, if its required columns are all there.
    fn best(names: &[String]) -> Option<Match> {
        let kinds = Kind::ALL.into_iter().filter(|kind| *kind != Kind::Desired);
        kinds
            .map(|kind| kind.call(Header(names)))
            .max_by_key(|found| (found.known, found.whole))
            .filter(|best| best.whole)
    }

    fn of<R: Record>(kind: Kind, names: &[String]) -> Match {
        let has = |column: &str| names.iter().any(|name| name == column);
        let columns = columns::<R>();
        Match {
            kind,
            name: R::KIND,
            known: columns.iter().filter(|(name, _)| has(name)).count(),
            whole: columns
                .iter()
                .all(|(name, presence)| *presence != Presence::Required || has(name)),
        }
    }
}

/// The columns of a header that is to be matched.
struct Header<'a>(&'a [String]);

impl KindVisitor for Header<'_> {
    type Out = Match;
    fn visit<R: StreamRecord>(self, kind: Kind) -> Match {
        Match::of::<R>(kind, self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_have_names_and_topics() {
        for kind in Kind::ALL {
            assert_eq!(Kind::named(kind.name()), Some(kind));
            let KindTopics { read, written } = kind.topics();
            assert!(read.iter().all(|topic| written.contains(topic)), "{kind}");
            let others = Kind::ALL.into_iter().filter(|other| *other != kind);
            for other in others {
                let theirs = other.topics().read;
                assert!(!read.iter().any(|t| theirs.contains(t)), "{kind} {other}");
            }
        }
        assert_eq!(Kind::named("pose"), None);
    }

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
