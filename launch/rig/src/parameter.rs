//! Declared parameters: value, tolerance, source.

use crate::checked_toml::{Keys, Section, bounds};

/// A declared parameter of a model.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameter {
    /// Name, as in the crate `plant`.
    pub name: String,
    /// Nominal value (SI).
    pub value: f64,
    /// Tolerance as a fraction of the value: 0.05 is ±5 %. Above 1 a parameter that cannot be
    /// negative is believed to lie between its least value and the upper end.
    pub tolerance: f64,
    /// Tolerance in the parameter's own unit (SI); replaces `tolerance` for values near 0.
    pub tolerance_absolute: Option<f64>,
    /// Where the value comes from.
    pub source: ParameterSource,
}

/// Where a parameter's value comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ParameterSource {
    /// Printed in the thesis or on a data sheet.
    Printed,
    /// Assumed, as it is printed nowhere.
    Assumed,
    /// Traced from measured results.
    Traced,
    /// Fitted to measured records by `farreach identify`.
    Fitted,
}

impl ParameterSource {
    const WORDS: &'static [(&'static str, Self)] = &[
        ("printed", Self::Printed),
        ("assumed", Self::Assumed),
        ("traced", Self::Traced),
        ("fitted", Self::Fitted),
    ];
}

const KEYS: Keys = &[
    ("value", "Nominal value, in the parameter's unit (SI)."),
    ("tolerance", "Tolerance as a fraction of the value."),
    ("tolerance_absolute", "Tolerance in the parameter's unit; replaces `tolerance` near 0."),
    ("source", "Where the value comes from."),
];

impl Parameter {
    /// Tolerance of a parameter that declares none (fraction of the value).
    pub const DEFAULT_TOLERANCE: f64 = 0.25;

    /// Half-width of the interval in which the value is believed to lie (SI); its lower end may lie
    /// below the least value of the parameter, where the interval then begins.
    pub fn spread(&self) -> f64 {
        self.tolerance_absolute.unwrap_or(self.tolerance * self.value.abs())
    }

    /// Reads every parameter of a table.
    pub(crate) fn read_all(table: &Section<'_>) -> Vec<Self> {
        table.keys().into_iter().map(|name| Self::read(table, name)).collect()
    }

    fn read(table: &Section<'_>, name: String) -> Self {
        let any = bounds(f64::MIN, f64::MAX, "");
        let assumed = ParameterSource::Assumed;
        if !table.holds_section(&name) {
            let (value, tolerance) = (table.number(&name, any), Self::DEFAULT_TOLERANCE);
            return Self { name, value, tolerance, tolerance_absolute: None, source: assumed };
        }
        let section = table.section(&name);
        section.document("[model.parameters] and [axes.model], each entry", KEYS);
        let fraction =
            bounds(0.0, 4.0, "a tolerance is a fraction of the value: write 5 % as 0.05");
        let absolute = bounds(0.0, f64::MAX, "half the interval, in the parameter's unit");
        let parameter = Self {
            name,
            value: section.number("value", any),
            tolerance: section.number_or("tolerance", Self::DEFAULT_TOLERANCE, fraction),
            tolerance_absolute: section.number_or_none("tolerance_absolute", absolute),
            source: section.word_or("source", ParameterSource::WORDS, assumed),
        };
        if section.has("tolerance") && section.has("tolerance_absolute") {
            let advice = "keep the fraction, or the absolute one for a value near 0";
            section.problem("tolerance_absolute", "one tolerance", "two", advice);
        }
        parameter
    }
}
