//! Limits that a run must keep: `--fail-if 'x.rms_mm>4.1'`.

use super::case::Case;
use super::json;
use super::lines::{self, Score};
use super::{frame, standing};

/// A condition under which the report fails.
#[derive(Clone, Debug, PartialEq)]
pub struct Gate {
    /// As given.
    pub text: String,
    /// The run or zone it is for; none is every one.
    only: Option<String>,
    /// Name of the statistic, as in the JSON output.
    pub statistic: String,
    above: bool,
    or_equal: bool,
    limit: f64,
}

/// Why a gate's text is none.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "condition '{text}': {why}; a condition is like 'x.rms_mm>4.1', 'scans.solved_pct<100' or \
     'joint:yaw.p95_deg>0.2', with the names that --json prints"
)]
pub struct GateError {
    text: String,
    why: String,
}

/// What became of a gate in one case.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict {
    /// The gate.
    pub gate: String,
    /// The case it was held against.
    pub case: String,
    /// The statistic's value; none where it has no value, which fails.
    pub value: Option<f64>,
    /// How far the value is on the wrong side; 0 where it passed.
    pub excess: f64,
    /// Whether it failed.
    pub failed: bool,
    statistic: String,
    limit: f64,
}

impl std::str::FromStr for Gate {
    type Err = GateError;

    /// A gate on a statistic of poses.
    fn from_str(text: &str) -> Result<Gate, GateError> {
        Gate::parse(text, json::statistic_exists)
    }
}

impl Gate {
    /// A gate on a statistic of lines, as `truepos_pct<93`.
    ///
    /// # Errors
    /// What is wrong with the text.
    pub fn for_lines(text: &str) -> Result<Gate, GateError> {
        Gate::parse(text, lines::statistic_exists)
    }

    /// A gate on a statistic of standstills, as `x.sigma_mm>1`.
    ///
    /// # Errors
    /// What is wrong with the text.
    pub fn for_standing(text: &str) -> Result<Gate, GateError> {
        Gate::parse(text, standing::statistic_exists)
    }

    /// A gate on what is predicted of a frame, as `x.sigma_mm>3`.
    ///
    /// # Errors
    /// What is wrong with the text.
    pub fn for_frame(text: &str) -> Result<Gate, GateError> {
        Gate::parse(text, frame::statistic_exists)
    }

    fn parse(text: &str, exists: impl Fn(&str) -> bool) -> Result<Gate, GateError> {
        let fail = |why: &str| GateError {
            text: text.to_owned(),
            why: why.to_owned(),
        };
        let at = text
            .find(['<', '>'])
            .ok_or_else(|| fail("no < or > in it"))?;
        let (left, right) = text.split_at(at);
        let above = right.starts_with('>');
        let right = &right[1..];
        let (or_equal, limit) = match right.strip_prefix('=') {
            Some(rest) => (true, rest),
            None => (false, right),
        };
        let limit: f64 = limit
            .trim()
            .parse()
            .ok()
            .filter(|v: &f64| v.is_finite())
            .ok_or_else(|| fail("the limit is not a number"))?;
        let (only, statistic) = match left.rsplit_once(':') {
            Some((only, statistic)) => (Some(only.trim().to_owned()), statistic),
            None => (None, left),
        };
        let statistic = statistic.trim().to_owned();
        if !exists(&statistic) {
            return Err(fail(&format!("there is no statistic '{statistic}'")));
        }
        Ok(Gate {
            text: text.to_owned(),
            only,
            statistic,
            above,
            or_equal,
            limit,
        })
    }

    /// Whether the gate is for this case.
    pub fn is_for(&self, case: &Case) -> bool {
        match self.only.as_deref() {
            None => true,
            Some(name) => {
                name == case.name() || name == case.run || case.zone.as_deref() == Some(name)
            }
        }
    }

    /// The limit and the statistic, for a figure that shows both.
    pub fn limit(&self) -> f64 {
        self.limit
    }

    /// Holds the gate against a case.
    pub fn judge(&self, case: &Case) -> Verdict {
        self.judge_value(case.name(), json::statistic(case, &self.statistic))
    }

    /// Holds the gate against a score of lines; none where it is for another run.
    pub fn judge_lines(&self, score: &Score) -> Option<Verdict> {
        let is_for = self.only.as_ref().is_none_or(|only| *only == score.name);
        let value = || lines::statistic(score, &self.statistic);
        is_for.then(|| self.judge_value(score.name.clone(), value()))
    }

    /// Holds the gate against a run's standstills.
    pub fn judge_standing(&self, found: &standing::Found) -> Verdict {
        self.judge_value(
            "static".to_owned(),
            standing::statistic(found, &self.statistic),
        )
    }

    /// Holds the gate against what is predicted of a frame.
    pub fn judge_frame(&self, survey: &frame::Survey) -> Verdict {
        self.judge_value(
            survey.source.clone(),
            frame::statistic(survey, &self.statistic),
        )
    }

    fn judge_value(&self, case: String, value: Option<f64>) -> Verdict {
        let failed = match value {
            None => true,
            Some(v) if self.or_equal && v == self.limit => true,
            Some(v) if self.above => v > self.limit,
            Some(v) => v < self.limit,
        };
        Verdict {
            gate: self.text.clone(),
            case,
            value,
            excess: match value {
                Some(v) if failed => (v - self.limit).abs(),
                _ => 0.0,
            },
            failed,
            statistic: self.statistic.clone(),
            limit: self.limit,
        }
    }
}

impl std::fmt::Display for Verdict {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Verdict {
            gate,
            case,
            statistic,
            limit,
            ..
        } = self;
        match self.value {
            None => write!(f, "{case}: {statistic} has no value ({gate})"),
            Some(value) if self.failed => write!(
                f,
                "{case}: {statistic} is {value:.4}, {:.4} beyond the limit {limit} ({gate})",
                self.excess
            ),
            Some(value) => write!(
                f,
                "{case}: {statistic} is {value:.4}, within {limit} ({gate})"
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn reads_conditions() {
        let gate: Gate = "joint:x.rms_mm >= 4.1".parse().unwrap();
        assert_eq!(gate.only.as_deref(), Some("joint"));
        assert_eq!(gate.statistic, "x.rms_mm");
        assert!(gate.above && gate.or_equal && gate.limit == 4.1);
        let gate: Gate = "scans.solved_pct<100".parse().unwrap();
        assert!(!gate.above && !gate.or_equal && gate.only.is_none());
    }

    #[test]
    fn mistakes_are_named() {
        for (text, part) in [
            ("x.rms_mm", "no < or >"),
            ("x.rms_mm>", "not a number"),
            ("x.rms_mm>4mm", "not a number"),
            ("x.rms_mm>>4", "not a number"),
            ("x.rms_mm<>4", "not a number"),
            ("x.rms>4", "no statistic 'x.rms'"),
            ("x.rms_mm>inf", "not a number"),
            (">4", "no statistic ''"),
        ] {
            let error = text.parse::<Gate>().unwrap_err().to_string();
            assert!(error.contains(part), "{text}: {error}");
        }
    }

    proptest! {
        #[test]
        fn any_text_is_a_gate_or_an_error(text in "\\PC{0,24}|[a-z_.:<>=0-9-]{0,24}") {
            let _ = text.parse::<Gate>();
        }
    }
}
