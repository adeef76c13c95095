//! Whether a serial line carries what a scanner is set to send.

use super::commands::EchoFilter;
use super::configure::Present;
use crate::link::baud;
use crate::sick::cola::Dialect;

/// The length of a scan's telegram, bytes. In CoLa A it depends on the distances: this is what an
/// LMS511 in a hall needs (8.2 kB for 1141 beams with remissions).
pub fn telegram_bytes(dialect: Dialect, beams: usize, present: &Present) -> usize {
    let remission = present.contents.is_some_and(|contents| contents.remission);
    let time = present.contents.is_some_and(|contents| contents.time);
    let encoder = present
        .contents
        .is_some_and(|contents| contents.encoder[0] > 0);
    let echoes = match present.echoes {
        Some(EchoFilter::All) => 5,
        _ => 1,
    };
    match dialect {
        Dialect::Binary => {
            let remissions = if remission { echoes * (21 + beams) } else { 0 };
            let distances = echoes * (21 + 2 * beams);
            let tail = 10 + if time { 11 } else { 0 };
            9 + 56 + 6 * usize::from(encoder) + distances + 2 + remissions + tail
        }
        Dialect::Text => {
            let remissions = if remission { 30 * beams / 10 + 40 } else { 0 };
            120 + echoes * (42 * beams / 10 + 40 + remissions)
        }
    }
}

/// The length of a scan's telegram as the device is set, bytes, and how many of them a line of `baud`
/// carries a second; none where too little is known.
pub fn carried(dialect: Dialect, baud: u32, present: &Present) -> Option<(usize, f64)> {
    let scan = present.scan?;
    let range = present
        .range
        .map_or([scan.start, scan.end], |r| [r.start, r.end]);
    let span = u32::try_from(range[1].checked_sub(range[0])?).ok()?;
    let beams = (f64::from(span) / f64::from(scan.resolution.max(1))).round() as usize + 1;
    let bytes = telegram_bytes(dialect, beams, present);
    Some((bytes, baud::telegrams_a_second(baud, bytes)))
}

/// What is to be said where a line of `baud` is too slow for how the device is set; none where it
/// is fast enough or too little is known.
pub fn overload(dialect: Dialect, baud: u32, present: &Present) -> Option<String> {
    let (bytes, carried) = carried(dialect, baud, present)?;
    let made = 1.0 / present.interval_s()?;
    if carried >= made {
        return None;
    }
    // The scanner already sends every n-th scan only; --divider says anew of how many.
    let divider = present.contents.map_or(1, |contents| contents.every.max(1));
    let every = (made * f64::from(divider) / carried).ceil();
    Some(format!(
        "{baud} baud carry {carried:.1} scans/s of {bytes} bytes, and the scanner sends {made:.1}: \
         scans will be lost. Send less: --configure with a narrower --range-deg, --remission off, or \
         --divider {every:.0}"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sick::client::commands::{OutputRange, ScanConfiguration, ScanContents};

    fn present(frequency: u32, resolution: u32, remission: bool, time: bool) -> Present {
        let contents = ScanContents {
            channels: [1, 0],
            remission,
            wide_remission: false,
            unit: 0,
            encoder: [0, 0],
            position: false,
            device_name: false,
            comment: false,
            time,
            every: 1,
        };
        Present {
            scan: Some(ScanConfiguration {
                frequency,
                resolution,
                start: -50_000,
                end: 1_850_000,
            }),
            contents: Some(contents),
            ..Present::default()
        }
    }

    /// Lengths of recorded telegrams.
    #[test]
    fn lengths_as_recorded() {
        let full = present(2500, 1667, true, true);
        assert_eq!(telegram_bytes(Dialect::Binary, 1141, &full), 3553);
        let text = telegram_bytes(Dialect::Text, 1141, &full) as f64;
        assert!((text / 8200.0 - 1.0).abs() < 0.05, "{text}");
        let small = present(5000, 5000, false, false);
        assert_eq!(telegram_bytes(Dialect::Binary, 381, &small), 860);
    }

    #[test]
    fn a_slow_line_is_told_with_numbers() {
        let full = present(2500, 1667, true, true);
        let text = overload(Dialect::Binary, 500_000, &full).unwrap();
        assert!(text.contains("14.1 scans/s of 3553 bytes"), "{text}");
        assert!(
            text.contains("sends 25.0") && text.contains("--divider 2"),
            "{text}"
        );
        // 115 200 baud carry one in eight, whether the scanner sends each now or every second.
        for every in [1, 2] {
            let mut full = full;
            full.contents = full.contents.map(|c| ScanContents { every, ..c });
            let text = overload(Dialect::Binary, 115_200, &full).unwrap();
            assert!(text.contains("--divider 8"), "{text}");
        }
        let small = present(5000, 5000, false, false);
        assert_eq!(overload(Dialect::Binary, 500_000, &small), None);
        assert!(overload(Dialect::Binary, 115_200, &small).is_some());
        let mut narrow = full;
        narrow.range = Some(OutputRange {
            resolution: 1667,
            start: 450_000,
            end: 1_350_000,
        });
        assert_eq!(overload(Dialect::Binary, 500_000, &narrow), None);
        assert_eq!(overload(Dialect::Binary, 9600, &Present::default()), None);
    }
}
