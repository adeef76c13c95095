//! The one spelling of a number.
//!
//! Everything that prints a number into a stream goes through here, so that a value has one
//! spelling in the whole kit: the shortest decimal that reads back to the same value, without a
//! trailing `.0`, `inf`/`-inf`/`nan` in lists, and nothing at all for a missing scalar.

/// Appends `value` in the shortest form that reads back to it; NaN is `nan`.
pub fn push_f64(out: &mut Vec<u8>, value: f64) {
    if value.is_nan() {
        out.extend_from_slice(b"nan");
    } else if value.is_infinite() {
        out.extend_from_slice(if value > 0.0 { b"inf" } else { b"-inf" });
    } else {
        let mut buffer = zmij::Buffer::new();
        push_trimmed(out, buffer.format_finite(value).as_bytes());
    }
}

/// Appends a single precision `value`; the shortest form that reads back to the same `f32`.
pub fn push_f32(out: &mut Vec<u8>, value: f32) {
    if value.is_finite() {
        let mut buffer = zmij::Buffer::new();
        push_trimmed(out, buffer.format_finite(value).as_bytes());
    } else {
        push_f64(out, f64::from(value));
    }
}

/// Appends a whole number.
pub fn push_int(out: &mut Vec<u8>, value: impl itoa::Integer) {
    out.extend_from_slice(itoa::Buffer::new().format(value).as_bytes());
}

fn push_trimmed(out: &mut Vec<u8>, text: &[u8]) {
    out.extend_from_slice(text.strip_suffix(b".0").unwrap_or(text));
}

/// Appends a range in metres as millimetres with up to three decimals (the streams carry ranges to
/// 1 um); `inf`, `-inf` and `nan` as ROS REP 117 has them.
pub fn push_range_mm(out: &mut Vec<u8>, range_m: f64) {
    if !range_m.is_finite() {
        return push_f64(out, range_m);
    }
    let um = (range_m * 1e6).round();
    if um.abs() > 9e15 {
        return push_f64(out, range_m * 1e3);
    }
    let um = um as i64;
    if um < 0 {
        out.push(b'-');
    }
    let um = um.unsigned_abs();
    push_int(out, um / 1000);
    let fraction = (um % 1000) as u16;
    if fraction != 0 {
        let digits = [
            b'0' + (fraction / 100) as u8,
            b'0' + (fraction / 10 % 10) as u8,
            b'0' + (fraction % 10) as u8,
        ];
        out.push(b'.');
        let end = 3 - digits.iter().rev().take_while(|d| **d == b'0').count();
        out.extend_from_slice(&digits[..end]);
    }
}

/// Parses a number as written by [`push_f64`] (and anything else `f64::from_str` takes).
pub fn parse_f64(text: &[u8]) -> Option<f64> {
    std::str::from_utf8(text).ok()?.parse().ok()
}

/// Parses a range in millimetres to metres. Whole millimetres up to nine digits take a short path.
pub fn parse_range_mm(text: &[u8]) -> Option<f64> {
    if !text.is_empty() && text.len() <= 9 {
        let mut mm = 0u32;
        let mut whole = true;
        for &byte in text {
            let digit = byte.wrapping_sub(b'0');
            if digit > 9 {
                whole = false;
                break;
            }
            mm = mm * 10 + u32::from(digit);
        }
        if whole {
            return Some(f64::from(mm) / 1000.0);
        }
    }
    let mm = parse_f64(text)?;
    // Up to three decimals the thousandth part is exact in whole micrometres, as MCAP gives it back.
    let um = (mm * 1e3).round();
    Some(if (um / 1e3 - mm).abs() < 1e-9 && um.abs() < 9e15 {
        um / 1e6
    } else {
        mm / 1e3
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn f64_text(value: f64) -> String {
        let mut out = Vec::new();
        push_f64(&mut out, value);
        String::from_utf8(out).unwrap()
    }

    fn mm_text(range_m: f64) -> String {
        let mut out = Vec::new();
        push_range_mm(&mut out, range_m);
        String::from_utf8(out).unwrap()
    }

    #[test]
    fn one_spelling() {
        assert_eq!(f64_text(1.0), "1");
        assert_eq!(f64_text(-0.5), "-0.5");
        assert_eq!(f64_text(0.1 + 0.2), "0.30000000000000004");
        assert_eq!(f64_text(f64::NAN), "nan");
        assert_eq!(f64_text(f64::NEG_INFINITY), "-inf");
        let mut out = Vec::new();
        push_f32(&mut out, 0.1);
        assert_eq!(out, b"0.1");
    }

    #[test]
    fn every_range_comes_back() {
        for mm in 0..80_000u32 {
            let range_m = f64::from(mm) / 1000.0;
            let text = mm_text(range_m);
            assert_eq!(text, mm.to_string());
            assert_eq!(parse_range_mm(text.as_bytes()), Some(range_m));
        }
        for um in [1i64, 10, 100, 999, 1_001, 1_292_123, 10_450_100, -5] {
            let range_m = um as f64 / 1e6;
            assert_eq!(
                parse_range_mm(mm_text(range_m).as_bytes()),
                Some(range_m),
                "{um}"
            );
        }
        assert_eq!(mm_text(1.2925), "1292.5");
        assert_eq!(mm_text(f64::INFINITY), "inf");
        assert_eq!(parse_range_mm(b"inf"), Some(f64::INFINITY));
        assert_eq!(parse_range_mm(b""), None);
        assert_eq!(parse_range_mm(b"12a"), None);
    }
}
