//! Numbers as people read them.

/// Nanoseconds as seconds with all their digits: `-12.000000345`.
pub(super) fn seconds(ns: i64) -> String {
    let sign = if ns < 0 { "-" } else { "" };
    let ns = ns.unsigned_abs();
    format!("{sign}{}.{:09}", ns / 1_000_000_000, ns % 1_000_000_000)
}

/// ` +- 0.9 us`, or that it is not known.
pub(super) fn sigma(value: Option<f64>, scale: f64, unit: &str) -> String {
    match value {
        Some(value) => format!(" +- {:.*} {unit}", digits(value * scale), value * scale),
        None => " (too short to say how it scatters)".to_owned(),
    }
}

/// How many digits after the point show two of a number.
fn digits(value: f64) -> usize {
    match value.abs() {
        v if v >= 100.0 => 0,
        v if v >= 10.0 => 1,
        v if v >= 1.0 => 2,
        _ => 3,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seconds_keep_their_digits() {
        assert_eq!(seconds(0), "0.000000000");
        assert_eq!(seconds(-12_000_000_345), "-12.000000345");
        assert_eq!(seconds(-345), "-0.000000345");
        assert_eq!(seconds(i64::MIN), "-9223372036.854775808");
    }
}
