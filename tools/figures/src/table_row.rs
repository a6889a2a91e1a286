//! One line of the comparison, as programs read it.

use anyhow::Result;
use serde::Serialize;

use crate::published::{Published, published};

/// What a value has to do with the fit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// Went into the model's constants.
    Input,
    /// The softening was fitted to it.
    Fitted,
    /// Took no part in any fit.
    #[default]
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
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
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
    /// Beside the published value of that name; `ours` with the printed constants and with the
    /// traced effect.
    ///
    /// # Errors
    /// Where the table of published values has no such value.
    pub fn beside(id: &'static str, role: Role, ours: [Option<f64>; 2]) -> Result<Self> {
        let published = published(id)?;
        let [printed, traced] = ours.map(|ours| Some(error_percent(ours?, published)));
        Ok(Self {
            role,
            published: Some(published.value),
            kind: Some(published.kind.name()),
            section: Some(published.section),
            printed_constants_error_percent: printed,
            traced_error_percent: traced,
            ..Self::own(id, published.figure, published.unit, ours)
        })
    }

    /// A value that the thesis does not give: with the printed constants and with the traced
    /// effect.
    pub fn own(
        id: impl Into<String>,
        figure: &str,
        unit: &str,
        [printed_constants, traced]: [Option<f64>; 2],
    ) -> Self {
        let (id, figure, unit) = (id.into(), figure.to_owned(), unit.to_owned());
        Self { id, figure, unit, printed_constants, traced, ..Self::default() }
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

/// A number for a reader: three digits, a dash where there is none.
pub fn short(value: impl Into<Option<f64>>) -> String {
    let Some(value) = value.into().filter(|value| value.is_finite()) else {
        return "–".to_owned();
    };
    if value == 0.0 {
        return "0".to_owned();
    }
    let digits = (2 - value.abs().log10().floor() as i32).clamp(0, 6) as usize;
    format!("{value:.digits$}")
}
