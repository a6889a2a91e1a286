//! One line of the comparison, as programs read it.

use serde::Serialize;

use crate::published::Published;

/// What a value has to do with the fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// Went into the model's constants.
    Input,
    /// The softening was fitted to it.
    Fitted,
    /// Took no part in any fit.
    Predicted,
}

impl Role {
    /// Its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Input => "input",
            Self::Fitted => "fitted",
            Self::Predicted => "predicted",
        }
    }
}

/// A published value (or none), beside the model's with the printed constants and with the traced
/// effect.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Name, stable.
    pub id: String,
    /// Figure of the thesis that it belongs to.
    pub figure: String,
    /// Unit of all three values.
    pub unit: String,
    /// What it has to do with the fit.
    pub role: Role,
    /// The thesis's value.
    pub published: Option<f64>,
    /// The model's with the printed constants; none where the quantity does not exist there.
    pub printed_constants: Option<f64>,
    /// The model's with the traced effect.
    pub traced: Option<f64>,
    /// How the published value was come by.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kind: Option<&'static str>,
    /// Where it stands.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub section: Option<&'static str>,
    /// `printed_constants` against `published`, %.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub printed_constants_error_percent: Option<f64>,
    /// `traced` against `published`, %.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub traced_error_percent: Option<f64>,
    /// What the value is, or how it was measured.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
    /// Of a conclusion: whether every cell of the grid agrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub survives: Option<bool>,
    /// Of a conclusion: the cells that contradict it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub contradicted_by: Option<Vec<String>>,
}

impl Row {
    /// Beside a published value.
    pub fn beside(
        published: &Published,
        role: Role,
        printed_constants: Option<f64>,
        traced: Option<f64>,
    ) -> Self {
        let error = |ours: Option<f64>| ours.map(|ours| error_percent(ours, published));
        Self {
            published: Some(published.value),
            kind: Some(published.kind.name()),
            section: Some(published.section),
            printed_constants_error_percent: error(printed_constants),
            traced_error_percent: error(traced),
            ..Self::own(published.id, published.figure, published.unit, printed_constants, traced)
        }
        .role(role)
    }

    /// A value that the thesis does not give.
    pub fn own(
        id: impl Into<String>,
        figure: &str,
        unit: &str,
        printed_constants: Option<f64>,
        traced: Option<f64>,
    ) -> Self {
        Self {
            id: id.into(),
            figure: figure.to_owned(),
            unit: unit.to_owned(),
            role: Role::Predicted,
            published: None,
            printed_constants,
            traced,
            kind: None,
            section: None,
            printed_constants_error_percent: None,
            traced_error_percent: None,
            note: None,
            survives: None,
            contradicted_by: None,
        }
    }

    /// The same with another role.
    #[must_use]
    pub fn role(self, role: Role) -> Self {
        Self { role, ..self }
    }

    /// The same with a word on what it is.
    #[must_use]
    pub fn note(self, note: impl Into<String>) -> Self {
        Self { note: Some(note.into()), ..self }
    }
}

/// Relative error, %; of decibels, which have no natural zero, that of the ratios they stand for.
fn error_percent(ours: f64, published: &Published) -> f64 {
    if published.unit == "dB" {
        return 100.0 * (10f64.powf((ours - published.value) / 20.0) - 1.0);
    }
    100.0 * (ours / published.value - 1.0)
}

/// A number as a reader wants it: three digits, a dash where there is none.
pub fn short(value: Option<f64>) -> String {
    let Some(value) = value.filter(|value| value.is_finite()) else {
        return "–".to_owned();
    };
    if value == 0.0 {
        return "0".to_owned();
    }
    let digits = (2 - value.abs().log10().floor() as i32).clamp(0, 6) as usize;
    format!("{value:.digits$}")
}
