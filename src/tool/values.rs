//! Values of arguments: numbers, times and sizes with their units. All are for clap's
//! `value_parser`, and a message says what is wanted.

use crate::link::Rotation;
use crate::record::Stamp;
use crate::stream::Instant;
use std::time::Duration;

/// Reads a finite number above 0.
pub(super) fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value > 0.0 && value.is_finite() => Ok(value),
        _ => Err("a positive number is wanted".to_owned()),
    }
}

/// Reads a finite number from 0 on.
pub(super) fn not_negative(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value >= 0.0 && value.is_finite() => Ok(value),
        _ => Err("a number that is not negative is wanted".to_owned()),
    }
}

/// Reads an instant: nanoseconds since the epoch, or `+10s` after the first record.
pub(super) fn parse_instant(text: &str) -> Result<Instant, String> {
    if let Some(after) = text.strip_prefix('+') {
        return parse_duration(after).map(|span| Instant::After(span.as_secs_f64()));
    }
    text.parse()
        .map(|ns| Instant::At(Stamp::from_ns(ns)))
        .map_err(|_| {
            "nanoseconds since the epoch are wanted, or a time after the first record such as +10s"
                .to_owned()
        })
}

/// Longer spans are taken for a slip of the pen, s: over thirty years. Sums of what is shorter with
/// instants and with each other stay in range.
const LONGEST_S: f64 = 1e9;

/// Reads a span of time with its unit: `62ms`, `30s`, `1.5us`, `100ns`, `2min`, `1h`.
pub fn parse_duration(text: &str) -> Result<Duration, String> {
    const UNITS: [(&str, f64); 6] = [
        ("ns", 1e-9),
        ("us", 1e-6),
        ("ms", 1e-3),
        ("min", 60.0),
        ("h", 3600.0),
        ("s", 1.0),
    ];
    let wanted = || "a time with its unit is wanted: ns, us, ms, s, min or h".to_owned();
    let (number, unit_s) = UNITS
        .iter()
        .find_map(|(unit, unit_s)| Some((text.strip_suffix(unit)?, unit_s)))
        .ok_or_else(wanted)?;
    let number: f64 = number.trim_end().parse().map_err(|_| wanted())?;
    let span_s = number * unit_s;
    if span_s > LONGEST_S {
        return Err(format!("a time of at most {LONGEST_S} s is wanted"));
    }
    Duration::try_from_secs_f64(span_s).map_err(|_| wanted())
}

/// Reads a span of time with a sign, s: `8ms`, `-3ms`, `+3ms`.
pub fn parse_signed_duration(text: &str) -> Result<f64, String> {
    let (sign, size) = match text.strip_prefix('-') {
        Some(size) => (-1.0, size),
        None => (1.0, text.strip_prefix('+').unwrap_or(text)),
    };
    if size.starts_with(['-', '+']) {
        return Err("a time with one sign is wanted".to_owned());
    }
    parse_duration(size).map(|size| sign * size.as_secs_f64())
}

/// Reads when a recording goes on in a new file: a size (`100MB`, `4GiB`), an age (`10min`), or both
/// with a bar between them, whichever is first.
pub fn parse_rotation(text: &str) -> Result<Rotation, String> {
    const UNITS: [(&str, u64); 7] = [
        ("KiB", 1 << 10),
        ("MiB", 1 << 20),
        ("GiB", 1 << 30),
        ("kB", 1000),
        ("MB", 1_000_000),
        ("GB", 1_000_000_000),
        ("B", 1),
    ];
    let wanted = || "a size (100MB), an age (10min) or both (100MB|10min) is wanted".to_owned();
    let mut rotation = Rotation::default();
    for part in text.split('|') {
        let size = UNITS
            .iter()
            .find_map(|(unit, bytes)| Some((part.strip_suffix(unit)?, bytes)));
        if let Some((number, unit)) = size {
            let number: u64 = number.trim_end().parse().map_err(|_| wanted())?;
            let bytes = number.checked_mul(*unit).filter(|bytes| *bytes > 0);
            if rotation.bytes.replace(bytes.ok_or_else(wanted)?).is_some() {
                return Err(wanted());
            }
        } else {
            let age = parse_duration(part).map_err(|_| wanted())?;
            if age.is_zero() || rotation.age.replace(age).is_some() {
                return Err(wanted());
            }
        }
    }
    Ok(rotation)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_a_sign_and_an_end() {
        assert_eq!(positive("0.5"), Ok(0.5));
        assert_eq!(not_negative("0"), Ok(0.0));
        for text in ["", "x", "-1", "inf", "nan"] {
            assert!(positive(text).is_err(), "{text}");
            assert!(not_negative(text).is_err(), "{text}");
        }
        assert!(positive("0").is_err());
    }

    #[test]
    fn rotations_are_sizes_or_ages() {
        let both = Rotation {
            bytes: Some(100_000_000),
            age: Some(Duration::from_secs(600)),
        };
        assert_eq!(parse_rotation("100MB|10min"), Ok(both));
        assert_eq!(parse_rotation("10min|100 MB"), Ok(both));
        assert_eq!(parse_rotation("4KiB").unwrap().bytes, Some(4096));
        for text in [
            "",
            "|",
            "5",
            "0MB",
            "0s",
            "1MB|2MB",
            "1s|2s",
            "MB",
            "-1MB",
            "99999999999GB",
        ] {
            assert!(parse_rotation(text).is_err(), "{text}");
        }
    }

    #[test]
    fn durations_have_a_unit() {
        assert_eq!(parse_duration("62ms"), Ok(Duration::from_millis(62)));
        assert_eq!(parse_duration("30s"), Ok(Duration::from_secs(30)));
        assert_eq!(parse_duration("1.5us"), Ok(Duration::from_nanos(1500)));
        assert_eq!(parse_duration("100ns"), Ok(Duration::from_nanos(100)));
        assert_eq!(parse_duration("2 min"), Ok(Duration::from_secs(120)));
        assert_eq!(parse_duration("1h"), Ok(Duration::from_secs(3600)));
        for text in ["", "5", "s", "-1s", "xs", "infs", "1e19s", "nans"] {
            assert!(parse_duration(text).is_err(), "{text}");
        }
    }

    #[test]
    fn instants_are_absolute_or_relative() {
        assert_eq!(parse_instant("12"), Ok(Instant::At(Stamp::from_ns(12))));
        assert_eq!(parse_instant("+10s"), Ok(Instant::After(10.0)));
        assert!(parse_instant("10s").is_err());
        assert!(parse_instant("+10").is_err());
    }
}
