//! What tuning found: one value for the terminal, the page and programs.

use identify::outcome::{Outcome, Verdict};
use rig::AxisUnit;
use serde::Serialize;
use similar::TextDiff;

use crate::live::Movement;
use crate::proposal::{Choice, Proposal, Uncompensated};
use crate::tracking::TrackingError;

/// A tuning from its first movement to its last.
#[derive(Debug)]
pub struct Tuning {
    /// Unit of the axis's positions.
    pub unit: AxisUnit,
    /// The movement with the control as it was.
    pub before: Movement,
    /// What identification says of the excitation.
    pub outcome: Outcome,
    /// The same as a sentence.
    pub sentence: String,
    /// What is proposed.
    pub proposal: Proposal,
    /// Text of the rig file before.
    pub text_before: String,
    /// The movement with the proposal; `None` where it was not taken.
    pub after: Option<Movement>,
}

/// `summary.json`, and `--json`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TuningSummary {
    /// Unit of the errors: `rad` or `m`.
    pub unit: &'static str,
    /// Verdict of the identification.
    pub verdict: Verdict,
    /// Effects found, `ID@SITE`.
    pub effects: Vec<String>,
    /// Measured tracking error with the control as it was.
    pub before: TrackingError,
    /// The same, predicted by the model that was identified from the excitation alone.
    pub before_predicted: TrackingError,
    /// The options chosen.
    pub chosen: Choice,
    /// All choices.
    pub choices: Vec<Choice>,
    /// Predicted tracking error with the proposal.
    pub after_predicted: TrackingError,
    /// Measured tracking error with the proposal; null where it was not taken.
    pub after: Option<TrackingError>,
    /// Effects that the law does not compensate.
    pub uncompensated: Vec<Uncompensated>,
    /// What of the model was not written into the rig file.
    pub left_out: Vec<String>,
}

/// A prediction that is off by more than this part of the measured error is not to be relied on.
const TRUSTED: f64 = 0.2;

/// An error (rad or m) in words, in degrees or millimetres.
pub(crate) fn shown(unit: AxisUnit, error: f64) -> String {
    match unit {
        AxisUnit::Radian => format!("{:.2}°", error.to_degrees()),
        AxisUnit::Metre => format!("{:.2} mm", 1e3 * error),
    }
}

impl Tuning {
    /// For programs.
    pub fn summary(&self) -> TuningSummary {
        let Proposal { control, before, left_out, .. } = &self.proposal;
        TuningSummary {
            unit: self.unit.symbol(),
            verdict: self.outcome.verdict,
            effects: self.outcome.named(),
            before: self.before.error,
            before_predicted: *before,
            chosen: control.chosen.clone(),
            choices: control.choices.clone(),
            after_predicted: control.error,
            after: self.after.as_ref().map(|movement| movement.error),
            uncompensated: control.uncompensated.clone(),
            left_out: left_out.clone(),
        }
    }

    /// An error in words, in degrees or millimetres.
    pub fn shown(&self, error: f64) -> String {
        shown(self.unit, error)
    }

    /// The changes of the rig file, as a unified diff.
    pub fn diff(&self) -> String {
        let (before, after) = (self.text_before.as_str(), self.proposal.control.rig.text());
        let name = &self.proposal.control.rig.name;
        TextDiff::from_lines(before, after)
            .unified_diff()
            .context_radius(1)
            .header(&format!("{name}.toml"), &format!("{name}.toml (proposed)"))
            .to_string()
    }

    /// How far the prediction for the present control is from what was measured, as a part of it.
    pub fn prediction_error(&self) -> f64 {
        self.proposal.before.rms / self.before.error.rms - 1.0
    }

    /// Lines for the terminal on what is proposed.
    pub fn proposal_lines(&self) -> Vec<String> {
        let Proposal { control, before, model, left_out } = &self.proposal;
        let mut lines = vec![
            format!("identify    {}", self.sentence),
            format!("model       {model}"),
            format!(
                "prediction  {} with the control as it is; measured {} ({:+.0} %) on a movement \
                 that took no part in the fit",
                self.shown(before.rms),
                self.shown(self.before.error.rms),
                100.0 * self.prediction_error()
            ),
        ];
        if self.prediction_error().abs() > TRUSTED {
            lines.push(
                "            the model does not predict what was measured: do not rely on its \
                 promise"
                    .to_owned(),
            );
        }
        for choice in &control.choices {
            let told = match choice.predicted.error() {
                Some(error) => self.shown(error.rms),
                None => "refused".to_owned(),
            };
            let mark = if choice.name == control.chosen.name { "→" } else { " " };
            lines.push(format!("  {mark} {told:>8}  {}", choice.name));
        }
        lines.extend(left_out.iter().map(|left| format!("not written {left}")));
        lines.extend(self.uncompensated_lines());
        lines
    }

    /// What the law does not compensate, in sentences.
    pub fn uncompensated_lines(&self) -> Vec<String> {
        let with = self.proposal.control.error.rms;
        let uncompensated = self.proposal.control.uncompensated.iter();
        uncompensated
            .map(|Uncompensated { effect, rms_without }| {
                format!(
                    "remains     the law does not compensate {effect}: of {} predicted, {} would \
                     be left without it",
                    self.shown(with),
                    self.shown(*rms_without)
                )
            })
            .collect()
    }
}
