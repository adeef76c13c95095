//! Parts of the workspace that a run is scored in.

use super::axis::AXES;

/// Comparisons on the reference pose's components, all of which must hold, in metres and degrees.
#[derive(Clone, Debug, PartialEq)]
pub struct Zone {
    /// What people call it: its given name, or its text.
    pub name: String,
    conditions: Vec<Condition>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Condition {
    component: usize,
    /// The absolute value is compared (`|y|<=4`).
    absolute: bool,
    low: Bound,
    high: Bound,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Bound {
    value: f64,
    /// The value itself is inside.
    closed: bool,
}

/// Why a zone's text is none.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "zone '{text}': {why}; a zone is like 'z<=3.5', '|y|<4,z>=0.5' or 'z:0.5:3.5' \
     (x, y, z in m, roll, pitch, yaw in deg), with a name in front if wanted: 'low=z<=3.5'"
)]
pub struct ZoneError {
    text: String,
    why: String,
}

impl std::str::FromStr for Zone {
    type Err = ZoneError;

    fn from_str(text: &str) -> Result<Zone, ZoneError> {
        let fail = |why: String| ZoneError {
            text: text.to_owned(),
            why,
        };
        let (name, conditions) = split_name(text);
        let conditions = conditions
            .split(',')
            .map(|c| condition(c.trim()))
            .collect::<Result<Vec<_>, _>>()
            .map_err(fail)?;
        Ok(Zone {
            name: name.trim().to_owned(),
            conditions,
        })
    }
}

/// `low=z<=3.5` is named `low`; `z<=3.5` is named by itself.
fn split_name(text: &str) -> (&str, &str) {
    match text.split_once('=') {
        Some((name, rest)) if !name.contains(['<', '>', ',', ':']) && !name.trim().is_empty() => {
            (name, rest)
        }
        _ => (text, text),
    }
}

fn condition(text: &str) -> Result<Condition, String> {
    const OPEN: f64 = f64::INFINITY;
    let no_low = Bound {
        value: -OPEN,
        closed: true,
    };
    let no_high = Bound {
        value: OPEN,
        closed: true,
    };
    if let Some((name, range)) = text.split_once(':') {
        let (low, high) = range
            .split_once(':')
            .ok_or_else(|| format!("'{text}' has no upper end"))?;
        let (low, high) = (number(low)?, number(high)?);
        if low > high {
            return Err(format!("'{text}' ends before it begins"));
        }
        let closed = true;
        let (component, absolute) = component(name)?;
        return Ok(Condition {
            component,
            absolute,
            low: Bound { value: low, closed },
            high: Bound {
                value: high,
                closed,
            },
        });
    }
    let at = text
        .find(['<', '>'])
        .ok_or_else(|| format!("'{text}' compares nothing"))?;
    let (name, comparison) = text.split_at(at);
    let below = comparison.starts_with('<');
    let value = comparison.trim_start_matches(['<', '>']);
    let closed = value.starts_with('=');
    let bound = Bound {
        value: number(value.strip_prefix('=').unwrap_or(value))?,
        closed,
    };
    let (component, absolute) = component(name)?;
    Ok(Condition {
        component,
        absolute,
        low: if below { no_low } else { bound },
        high: if below { bound } else { no_high },
    })
}

fn number(text: &str) -> Result<f64, String> {
    let value: f64 = text
        .trim()
        .parse()
        .map_err(|_| format!("'{}' is not a number", text.trim()))?;
    if value.is_nan() {
        return Err("nan is not a limit".to_owned());
    }
    Ok(value)
}

fn component(text: &str) -> Result<(usize, bool), String> {
    let text = text.trim();
    let bars = text.strip_prefix('|').and_then(|t| t.strip_suffix('|'));
    let name = bars.unwrap_or(text).trim();
    AXES.iter()
        .take(6)
        .position(|axis| axis.name == name)
        .map(|index| (index, bars.is_some()))
        .ok_or_else(|| format!("'{name}' is no component"))
}

impl Zone {
    /// Whether a reference pose (m, rad) is inside.
    pub fn contains(&self, pose: &[f64; 6]) -> bool {
        self.conditions.iter().all(|c| {
            let degrees = if c.component < 3 { 1.0 } else { AXES[3].factor };
            let value = pose[c.component] * degrees;
            let value = if c.absolute { value.abs() } else { value };
            let above = value > c.low.value || (c.low.closed && value == c.low.value);
            let below = value < c.high.value || (c.high.closed && value == c.high.value);
            above && below
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn inside(zone: &str, pose: [f64; 6]) -> bool {
        zone.parse::<Zone>().unwrap().contains(&pose)
    }

    #[test]
    fn comparisons() {
        let pose = [0.1, -3.0, 3.5, 0.0, 0.0, 0.1];
        assert!(inside("z<=3.5", pose) && !inside("z<3.5", pose));
        assert!(inside("z>=3.5", pose) && !inside("z>3.5", pose));
        assert!(inside("z:0.5:3.5", pose) && inside("z: 3.5 : 4", pose));
        assert!(inside("y<0, z>3, |y|<=3", pose) && !inside("y<0,z>3.6", pose));
        assert!(inside("yaw>5.7,yaw<5.8", pose), "degrees");
        assert!(!inside("z<=3.5", [f64::NAN; 6]));
    }

    #[test]
    fn names() {
        let named: Zone = "low=z<=3.5".parse().unwrap();
        assert_eq!(named.name, "low");
        assert_eq!("z<=3.5".parse::<Zone>().unwrap().name, "z<=3.5");
        assert_eq!(
            named.conditions,
            "z<=3.5".parse::<Zone>().unwrap().conditions
        );
        assert_eq!("a=z:1:2".parse::<Zone>().unwrap().name, "a");
    }

    #[test]
    fn mistakes_are_named() {
        for (text, part) in [
            ("w<3", "'w' is no component"),
            ("z", "compares nothing"),
            ("z<three", "'three' is not a number"),
            ("z:1", "no upper end"),
            ("z:2:1", "ends before it begins"),
            ("", "compares nothing"),
            ("z<nan", "not a limit"),
        ] {
            let error = text.parse::<Zone>().unwrap_err().to_string();
            assert!(error.contains(part), "{text}: {error}");
        }
    }

    proptest! {
        #[test]
        fn any_text_is_a_zone_or_an_error(text in "\\PC{0,24}|[a-z|<>=:,.0-9-]{0,24}") {
            if let Ok(zone) = text.parse::<Zone>() {
                zone.contains(&[0.0; 6]);
            }
        }
    }
}
