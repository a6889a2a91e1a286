//! What one check found, before it is a row of the report.

use runtime::Verdict;
use serde::Serialize;
use serde_json::Value;

/// What one check found.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Outcome {
    /// The verdict.
    pub(crate) verdict: Verdict,
    /// What was measured, in words with units; of a skipped check why it was.
    pub(crate) value: String,
    /// What to do, where it is not what the check's row says.
    pub(crate) remedy: Option<String>,
    /// What was measured, for programs.
    pub(crate) measured: Value,
}

impl Outcome {
    /// An outcome without figures for programs.
    pub(crate) fn new(verdict: Verdict, value: impl Into<String>) -> Self {
        Self { verdict, value: value.into(), remedy: None, measured: Value::Null }
    }

    /// A check that was not made, why, and what to do.
    pub(crate) fn skipped(why: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::new(Verdict::Skipped, why).remedy(remedy)
    }

    /// With a remedy of its own.
    pub(crate) fn remedy(self, remedy: impl Into<String>) -> Self {
        Self { remedy: Some(remedy.into()), ..self }
    }

    /// With what was measured, for programs.
    pub(crate) fn measured(self, measured: &impl Serialize) -> Self {
        // A measurement is a plain structure of numbers and texts: it always serialises.
        Self { measured: serde_json::to_value(measured).unwrap_or(Value::Null), ..self }
    }
}

/// The worse of two verdicts; a skipped one counts as the best.
pub(crate) fn worse(a: Verdict, b: Verdict) -> Verdict {
    let rank = |verdict| match verdict {
        Verdict::Skipped => 0,
        Verdict::Pass => 1,
        Verdict::Warn => 2,
        Verdict::Fail => 3,
    };
    if rank(b) > rank(a) { b } else { a }
}

/// `value` against two limits, of which the first is the lower.
pub(crate) fn at_most<T: PartialOrd>(value: T, pass: T, warn: T) -> Verdict {
    if value <= pass {
        Verdict::Pass
    } else if value <= warn {
        Verdict::Warn
    } else {
        // What is not a number is in no range.
        Verdict::Fail
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_belong_to_the_better_side() {
        let of = |value: f64| at_most(value, 1.0, 2.0);
        assert_eq!([of(1.0), of(1.1), of(2.0), of(2.1)], {
            use Verdict::{Fail, Pass, Warn};
            [Pass, Warn, Warn, Fail]
        });
        assert_eq!(of(f64::NAN), Verdict::Fail);
        assert_eq!(worse(Verdict::Warn, Verdict::Skipped), Verdict::Warn);
        assert_eq!(worse(Verdict::Pass, Verdict::Fail), Verdict::Fail);
    }
}
