//! Round numbers for axes, and colours for sizes and signs.

/// The next value at or above `value` that a person would end an axis at: 1, 1.2, 1.5, 2, 2.5, 3, 4,
/// 5, 6, 8 times a power of ten. 1 for nothing.
pub(super) fn above(value: f64) -> f64 {
    if !(value.is_finite() && value > 0.0) {
        return 1.0;
    }
    let power = 10f64.powi(value.log10().floor() as i32);
    let steps = [1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0];
    let fits = |s: &&f64| **s * power >= value * (1.0 - 1e-9);
    steps.iter().find(fits).map_or(value, |s| s * power)
}

/// About `count` round ticks from `low` to `high`, and the decimals that tell them apart.
pub(super) fn ticks(low: f64, high: f64, count: usize) -> (Vec<f64>, usize) {
    let span = high - low;
    if !(span.is_finite() && span > 0.0) {
        return (Vec::new(), 0);
    }
    let rough = span / count.max(1) as f64;
    let power = 10f64.powi(rough.log10().floor() as i32);
    let step = [1.0, 2.0, 2.5, 5.0, 10.0]
        .iter()
        .map(|s| s * power)
        .find(|s| *s >= rough * 0.999)
        .unwrap_or(10.0 * power);
    let first = (low / step - 1e-6).ceil() as i64;
    let last = (high / step + 1e-6).floor() as i64;
    let values = (first..=last).map(|i| i as f64 * step).collect();
    // 2.5 needs a digit more than its power of ten.
    let digits = |d: &usize| {
        let scaled = step * 10f64.powi(*d as i32);
        (scaled - scaled.round()).abs() < 1e-6 * scaled
    };
    (values, (0..9).find(digits).unwrap_or(9))
}

/// Viridis, from 0 (dark violet) to 1 (yellow).
pub(super) fn size_colour(share: f64) -> (u8, u8, u8) {
    mixed(&VIRIDIS, share)
}

/// Blue (-1) over white (0) to red (1).
pub(super) fn sign_colour(share: f64) -> (u8, u8, u8) {
    mixed(&BLUE_WHITE_RED, 0.5 * (share + 1.0))
}

fn mixed(anchors: &[(u8, u8, u8)], share: f64) -> (u8, u8, u8) {
    let last = anchors.len().saturating_sub(1);
    let place = share.clamp(0.0, 1.0) * last as f64;
    let index = (place as usize).min(last.saturating_sub(1));
    let rest = place - index as f64;
    match (anchors.get(index), anchors.get(index + 1)) {
        (Some(a), Some(b)) => {
            let mix =
                |p: u8, q: u8| (f64::from(p) + (f64::from(q) - f64::from(p)) * rest).round() as u8;
            (mix(a.0, b.0), mix(a.1, b.1), mix(a.2, b.2))
        }
        _ => (0, 0, 0),
    }
}

/// matplotlib's viridis at every sixteenth (Smith and van der Walt, public domain).
const VIRIDIS: [(u8, u8, u8); 17] = [
    (68, 1, 84),
    (72, 21, 104),
    (72, 38, 119),
    (69, 55, 129),
    (63, 71, 136),
    (57, 85, 140),
    (50, 100, 142),
    (45, 113, 142),
    (39, 127, 142),
    (33, 144, 141),
    (31, 158, 137),
    (41, 175, 127),
    (68, 190, 112),
    (110, 206, 88),
    (155, 217, 60),
    (205, 225, 29),
    (253, 231, 37),
];

/// ColorBrewer's RdBu, turned round (Brewer, Apache 2.0).
const BLUE_WHITE_RED: [(u8, u8, u8); 11] = [
    (5, 48, 97),
    (33, 102, 172),
    (67, 147, 195),
    (146, 197, 222),
    (209, 229, 240),
    (247, 247, 247),
    (253, 219, 199),
    (244, 165, 130),
    (214, 96, 77),
    (178, 24, 43),
    (103, 0, 31),
];

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn round_ends_and_ticks() {
        assert_eq!(above(3.9), 4.0);
        assert_eq!(above(4.0), 4.0);
        assert!((above(0.0171) - 0.02).abs() < 1e-12);
        assert_eq!(above(f64::NAN), 1.0);
        assert_eq!(ticks(-4.0, 4.0, 4), (vec![-4.0, -2.0, 0.0, 2.0, 4.0], 0));
        let (values, decimals) = ticks(0.0, 0.1, 4);
        assert_eq!((values.len(), decimals), (5, 3));
        assert!(ticks(1.0, 1.0, 4).0.is_empty());
    }

    #[test]
    fn colours_end_where_they_should() {
        assert_eq!(size_colour(-1.0), (68, 1, 84));
        assert_eq!(size_colour(2.0), (253, 231, 37));
        assert_eq!(sign_colour(0.0), (247, 247, 247));
        assert_eq!(sign_colour(1.0), (103, 0, 31));
    }

    proptest! {
        #[test]
        fn ticks_are_inside_and_few(low in -1e6f64..1e6, span in 1e-6f64..1e6, count in 2usize..12) {
            let (values, _) = ticks(low, low + span, count);
            prop_assert!(values.len() <= count + 2);
            for v in values {
                prop_assert!(v >= low - 1e-5 * span.max(low.abs()) && v <= low + span + 1e-5 * span.max(low.abs()));
            }
        }

        #[test]
        fn an_end_is_at_or_above(value in 1e-9f64..1e9) {
            let end = above(value);
            prop_assert!(end >= value * (1.0 - 1e-8) && end <= value * 1.35);
        }
    }
}
