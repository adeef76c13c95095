//! How people read numbers: fixed decimals, a real minus sign, grouped thousands.

/// A dash where there is no value.
pub(super) const NONE: &str = "–";

/// `value` with `decimals` digits and a real minus sign; never "-0.00".
pub(super) fn fixed(value: f64, decimals: usize) -> String {
    if !value.is_finite() {
        return NONE.to_owned();
    }
    let text = format!("{:.*}", decimals, value.abs());
    let zero = text.bytes().all(|b| b == b'0' || b == b'.');
    let (whole, fraction) = match text.split_once('.') {
        Some((whole, fraction)) => (whole, Some(fraction)),
        None => (text.as_str(), None),
    };
    let mut out = String::new();
    if value < 0.0 && !zero {
        out.push('−');
    }
    out.push_str(&grouped(whole));
    if let Some(fraction) = fraction {
        out.push('.');
        out.push_str(fraction);
    }
    out
}

/// `value` with a sign in front, plus included.
pub(super) fn signed(value: f64, decimals: usize) -> String {
    let text = fixed(value, decimals);
    if value > 0.0 && text.bytes().any(|b| (b'1'..=b'9').contains(&b)) {
        format!("+{text}")
    } else {
        text
    }
}

/// A count with grouped thousands: 20,000.
pub(super) fn count(value: usize) -> String {
    grouped(&value.to_string())
}

/// The relative change from `first` to `value` in percent, with its sign.
pub(super) fn change(first: f64, value: f64) -> String {
    let percent = 100.0 * (value - first) / first;
    if !percent.is_finite() {
        return NONE.to_owned();
    }
    let decimals = if percent.abs() < 100.0 { 1 } else { 0 };
    format!("{} %", signed(percent, decimals))
}

fn grouped(digits: &str) -> String {
    if digits.len() < 5 {
        return digits.to_owned();
    }
    let mut out = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(',');
        }
        out.push(digit);
    }
    out
}

/// The characters of `text` that a terminal without UTF-8 lacks, in ASCII.
pub(super) fn ascii(text: &str) -> String {
    text.chars()
        .map(|c| match c {
            '−' | '–' => '-',
            '·' => ',',
            '°' => 'd',
            'σ' => 's',
            '▁'..='█' => BARS[(c as usize - '▁' as usize).min(7)],
            c if c.is_ascii() => c,
            _ => '?',
        })
        .collect()
}

const BARS: [char; 8] = ['_', '.', '-', '=', '+', '*', '%', '#'];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_for_people() {
        assert_eq!(fixed(-1.235, 2), "−1.24");
        assert_eq!(fixed(-0.0001, 2), "0.00");
        assert_eq!(fixed(f64::NAN, 2), "–");
        assert_eq!(fixed(1234567.891, 1), "1,234,567.9");
        assert_eq!(fixed(1234.0, 0), "1234");
        assert_eq!(signed(0.001, 1), "0.0");
        assert_eq!(signed(0.1, 1), "+0.1");
        assert_eq!(count(20_000), "20,000");
        assert_eq!(change(2.0, 1.0), "−50.0 %");
        assert_eq!(change(1.0, 4.0), "+300 %");
        assert_eq!(change(0.0, 4.0), "–");
        assert_eq!(ascii("−1 ▁█ °"), "-1 _# d");
    }
}
