//! The replies of a recording as they are, one a row.

use crate::gx1::{Arrived, Gains, scale};
use crate::record::text;
use std::io::{self, Write};

/// The header row.
pub(super) const HEADER: &str = "offset,received_ns,command,ticks,words,names,values";

/// Writes a reply: place of its first byte, arrival, command, words as sent, and their values in the
/// units of the names.
pub(super) fn row(out: &mut impl Write, arrived: &Arrived, gains: Gains) -> io::Result<()> {
    let packet = &arrived.packet;
    let joined = |fields: Vec<String>| fields.join(" ");
    let words = joined(packet.words().iter().map(u16::to_string).collect());
    let names = packet.fields().map(|(word, _)| match scale::unit(word) {
        "" => word.name(),
        unit => format!("{}_{unit}", word.name()),
    });
    let values = packet.fields().map(|(word, bits)| {
        let mut value = Vec::new();
        text::push_f64(&mut value, gains.value(word, bits));
        String::from_utf8(value).unwrap_or_default()
    });
    let ticks = packet
        .ticks()
        .map_or(String::new(), |ticks| ticks.to_string());
    writeln!(
        out,
        "{},{},0x{:02X},{ticks},{words},{},{}",
        arrived.offset,
        arrived.at.utc,
        packet.command().byte(),
        joined(names.collect()),
        joined(values.collect()),
    )
}
