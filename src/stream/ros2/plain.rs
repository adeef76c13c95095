//! Records that have no standard message: one topic of our own type each.

use super::{Bodies, Message, Messages, Topic, definitions, every};
use crate::record::{BeamFate, ClockExchange, DelayPoint, ReflectorLines, Segment};
use crate::stream::check::{BadField, StreamRecord};
use crate::stream::{Role, cdr};

macro_rules! plain {
    ($record:ty, $topic:literal, $type:literal, sequence = |$this:ident| $sequence:expr) => {
        impl Messages for $record {
            type Parts = ();

            fn read_from(_: Role) -> &'static [&'static Topic] {
                static TOPIC: Topic = Topic {
                    name: $topic,
                    type_name: $type,
                    definition: |_| definitions::of_columns::<$record>(every),
                };
                static TOPICS: [&Topic; 1] = [&TOPIC];
                &TOPICS
            }

            fn written_to(role: Role) -> &'static [&'static Topic] {
                <$record>::read_from(role)
            }

            fn encode(&self, role: Role, out: &mut Bodies) -> Result<(), BadField> {
                let $this = self;
                out.sequence = $sequence;
                for topic in <$record>::written_to(role) {
                    out.add(topic, |out| cdr::encode_columns(out, self, every))?;
                }
                Ok(())
            }

            fn decode(
                &mut self,
                _: &'static Topic,
                message: Message<'_>,
                _: &mut (),
            ) -> Result<bool, BadField> {
                cdr::decode_columns(message.body, self, every, <$record>::PARALLEL_LISTS)?;
                Ok(true)
            }
        }
    };
}

plain!(
    ReflectorLines,
    "/lines",
    "cablepose_msgs/msg/ReflectorLines",
    sequence = |lines| Some(lines.seq)
);
plain!(
    Segment,
    "/segments",
    "cablepose_msgs/msg/Segment",
    sequence = |segment| Some(segment.seq)
);
plain!(
    BeamFate,
    "/beam_fates",
    "cablepose_msgs/msg/BeamFate",
    sequence = |beam| Some(beam.seq)
);
plain!(
    DelayPoint,
    "/delay_curve",
    "cablepose_msgs/msg/DelayPoint",
    sequence = |_point| None
);
plain!(
    ClockExchange,
    "/clock_exchange",
    "cablepose_msgs/msg/ClockExchange",
    sequence = |_exchange| None
);
