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

/// The digits of 00 to 99, the first one in the low byte.
const PAIRS: [u16; 100] = {
    let mut pairs = [0; 100];
    let mut n = 0;
    while n < 100 {
        pairs[n as usize] = (b'0' as u16 + n / 10) | ((b'0' as u16 + n % 10) << 8);
        n += 1;
    }
    pairs
};

/// Appends a whole number below 100 000, which most ranges and remissions are.
///
/// Eight bytes are copied and the surplus is cut off: a copy of a length that is known beforehand
/// costs a fraction of one that is not.
pub(super) fn push_five_digits(out: &mut Vec<u8>, n: u32) {
    let pair = |two_digits: u32| u64::from(PAIRS[two_digits as usize % 100]);
    let first = u64::from(b'0') + u64::from(n / 10_000 % 10);
    let word = first | (pair(n / 100 % 100) << 8) | (pair(n % 100) << 24);
    let leading_zeros = [n < 10_000, n < 1000, n < 100, n < 10].map(usize::from);
    let skip: usize = leading_zeros.iter().sum();
    let end = out.len() + 5 - skip;
    out.extend_from_slice(&(word >> (8 * skip)).to_le_bytes());
    out.truncate(end);
}

/// The whole number nearest to `value`, the even one of two; for magnitudes below 2e15.
///
/// Adding and subtracting 1.5 * 2^52 leaves no room for a fraction; `round` is a call into the
/// system's library on the plainest x86-64.
#[inline]
pub fn whole(value: f64) -> f64 {
    const NO_FRACTION: f64 = 6_755_399_441_055_744.0;
    (value + NO_FRACTION) - NO_FRACTION
}

/// Appends a range in metres as millimetres with up to three decimals (the streams carry ranges to
/// 1 um); `inf`, `-inf` and `nan` as ROS REP 117 has them.
pub fn push_range_mm(out: &mut Vec<u8>, range_m: f64) {
    let um = whole(range_m * 1e6);
    if (0.0..1e8).contains(&um) {
        let um = um as u32;
        push_five_digits(out, um / 1000);
        return push_thousandths(out, um % 1000);
    }
    if !range_m.is_finite() {
        return push_f64(out, range_m);
    }
    if um.abs() > 2e15 {
        return push_f64(out, range_m * 1e3);
    }
    let um = um as i64;
    if um < 0 {
        out.push(b'-');
    }
    push_int(out, um.unsigned_abs() / 1000);
    push_thousandths(out, (um.unsigned_abs() % 1000) as u32);
}

fn push_thousandths(out: &mut Vec<u8>, thousandths: u32) {
    if thousandths != 0 {
        let digits = [thousandths / 100, thousandths / 10 % 10, thousandths % 10];
        out.push(b'.');
        let end = 3 - digits.iter().rev().take_while(|d| **d == 0).count();
        out.extend(digits[..end].iter().map(|d| b'0' + *d as u8));
    }
}

/// Parses a number as written by [`push_f64`] (and anything else `f64::from_str` takes).
pub fn parse_f64(text: &[u8]) -> Option<f64> {
    std::str::from_utf8(text).ok()?.parse().ok()
}

/// The whole number that a text starts with, and its digits, of which nine at most are read.
#[inline]
pub(super) fn leading_whole(text: &[u8]) -> (u32, usize) {
    let mut number = 0;
    for (i, byte) in text.iter().take(9).enumerate() {
        let digit = byte.wrapping_sub(b'0');
        if digit > 9 {
            return (number, i);
        }
        number = number * 10 + u32::from(digit);
    }
    (number, text.len().min(9))
}

/// Whole millimetres in metres.
#[inline]
pub(super) fn metres(mm: u32) -> f64 {
    f64::from(mm) / 1000.0
}

/// Parses a range in millimetres to metres. Whole millimetres up to nine digits take a short path.
pub fn parse_range_mm(text: &[u8]) -> Option<f64> {
    let (mm, digits) = leading_whole(text);
    if digits > 0 && digits == text.len() {
        return Some(metres(mm));
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
    fn five_digits_are_those_of_any_printer() {
        for n in 0..100_000u32 {
            let mut out = b"x".to_vec();
            push_five_digits(&mut out, n);
            assert_eq!(out, format!("x{n}").into_bytes());
        }
    }

    #[test]
    fn whole_numbers_are_the_nearest() {
        for (value, nearest) in [
            (0.4, 0.0),
            (0.6, 1.0),
            (-1.7, -2.0),
            (2.5, 2.0),
            (1e15, 1e15),
        ] {
            assert_eq!(whole(value), nearest);
        }
        assert!(whole(f64::NAN).is_nan());
        assert_eq!(whole(f64::INFINITY), f64::INFINITY);
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
        let long: Vec<f64> = vec![
            99_999.999,
            100_000.0,
            100_000.001,
            1.0e9,
            -0.25,
            2.5e12,
            4.0e18,
        ];
        for range_m in long.iter().map(|mm| mm / 1e3) {
            let back = parse_range_mm(mm_text(range_m).as_bytes()).unwrap();
            assert!((back - range_m).abs() <= range_m.abs() * 1e-15, "{range_m}");
        }
        assert_eq!(mm_text(-0.000_25), "-0.25");
        assert_eq!(mm_text(1.2925), "1292.5");
        assert_eq!(mm_text(f64::INFINITY), "inf");
        assert_eq!(parse_range_mm(b"inf"), Some(f64::INFINITY));
        assert_eq!(parse_range_mm(b""), None);
        assert_eq!(parse_range_mm(b"12a"), None);
    }
}
