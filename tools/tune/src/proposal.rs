//! From a model that was identified to a rig file for the control: which options, and what tracking
//! error they promise.

use identify::outcome::{Outcome, Verdict};
use identify::write_rig::{Provenance, WriteRigError, fitted};
use lock_step::LockStepError;
use rig::protocol::Protocol;
use rig::{FileError, RigFile};
use serde::Serialize;

use crate::settings::{SETTINGS, Setting};
use crate::simulated::{Machine, play};
use crate::tracking::{SETTLING_S, SHORTEST_S, TrackingError};

/// A choice with more parts must predict a tracking error this much smaller.
const WORTH: f64 = 0.97;
/// Gains of outer loop and observer are raised by this factor to see whether they have a margin, as
/// the position gains must have ([`plant::stability::MARGIN`]).
const MARGIN: f64 = plant::stability::MARGIN;
/// With gains so raised the predicted error may grow by this factor.
const RAISED_ERROR: f64 = 2.0;
/// An effect without which the predicted error would be smaller than this share is not compensated.
const COMPENSATED: f64 = 1.0 / 1.1;

/// Why there is no proposal.
#[derive(Debug, thiserror::Error)]
pub enum ProposeError {
    /// The model cannot be written into a rig file.
    #[error(transparent)]
    Write(#[from] WriteRigError),
    /// Nothing was identified that a rig file can hold.
    #[error("no rig file can be proposed: {0}")]
    NoModel(String),
    /// The present gains are unstable with the model that was identified.
    #[error("the present gains are refused with the model that was identified:\n{0}")]
    Unstable(String),
    /// The model cannot be simulated along the movement.
    #[error("the model that was identified cannot be simulated: {0}")]
    Simulation(#[from] LockStepError),
    /// The movement is too short.
    #[error(
        "expected a movement of {SHORTEST_S} s or more, of which the first {SETTLING_S} s and the \
         last second are not evaluated; found one of {0:.1} s"
    )]
    Short(f64),
}

/// A choice of options, and what it promises.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Choice {
    /// Its name.
    pub name: &'static str,
    /// Lead of its outer loop (s).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lead_s: Option<f64>,
    /// The predicted tracking error, or why it is refused.
    #[serde(flatten)]
    pub predicted: Predicted,
}

/// What is predicted of a choice.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Predicted {
    /// The tracking error of the model.
    Predicted(TrackingError),
    /// Why the choice is refused.
    Refused(String),
}

impl Predicted {
    /// The error; `None` where the choice is refused.
    pub fn error(&self) -> Option<&TrackingError> {
        match self {
            Self::Predicted(error) => Some(error),
            Self::Refused(_) => None,
        }
    }
}

/// An effect that the law does not compensate.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Uncompensated {
    /// `ID@SITE`.
    pub effect: String,
    /// Predicted root-mean-square error without the effect (rad or m).
    pub rms_without: f64,
}

/// The best control of a rig by its own model.
#[derive(Clone, Debug)]
pub struct BestControl {
    /// The rig file with the options chosen.
    pub rig: RigFile,
    /// The choice.
    pub chosen: Choice,
    /// All choices, the best lead of each.
    pub choices: Vec<Choice>,
    /// Predicted tracking error.
    pub error: TrackingError,
    /// Effects of the model that the law does not compensate.
    pub uncompensated: Vec<Uncompensated>,
}

/// A rig file that is proposed.
#[derive(Clone, Debug)]
pub struct Proposal {
    /// The file, and what it promises.
    pub control: BestControl,
    /// Predicted error of the present control on the model that was identified.
    pub before: TrackingError,
    /// What was written of the model.
    pub model: String,
    /// What was not.
    pub left_out: Vec<String>,
}

/// Proposes a rig file: the model that was identified, and the options of the control (of the first
/// axis) whose simulated tracking error along `movement` is least.
///
/// # Errors
/// [`ProposeError`].
pub fn propose(
    rig: &RigFile,
    outcome: &Outcome,
    movement: &Protocol,
    provenance: &Provenance,
) -> Result<Proposal, ProposeError> {
    let (text, model, left_out) = model_text(rig, outcome, provenance)?;
    let identified = RigFile::parse(&text, rig.file_name()).map_err(unusable)?;
    let machine = Machine { rig: &identified, effects: &[] };
    let before = error_of(rig, machine, movement)?;
    let control = best_control(&identified, movement)?;
    Ok(Proposal { control, before, model, left_out })
}

/// The options of the control (of the first axis) whose tracking error along `movement` is least,
/// simulated with the model of the rig file itself.
///
/// # Errors
/// [`ProposeError`].
pub fn best_control(rig: &RigFile, movement: &Protocol) -> Result<BestControl, ProposeError> {
    let machine = Machine { rig, effects: &[] };
    let mut choices: Vec<Choice> = Vec::with_capacity(SETTINGS.len());
    let mut best: Option<(RigFile, Choice, TrackingError)> = None;
    for setting in SETTINGS {
        let (choice, file) = best_of(setting, rig, machine, movement)?;
        if let (Some(file), Some(error)) = (file, choice.predicted.error().copied())
            && best.as_ref().is_none_or(|(.., least)| error.rms < WORTH * least.rms)
        {
            best = Some((file, choice.clone(), error));
        }
        choices.push(choice);
    }
    let Some((rig, chosen, error)) = best else {
        return Err(ProposeError::NoModel("every choice of options is refused".to_owned()));
    };
    let uncompensated = uncompensated(&rig, movement, error)?;
    Ok(BestControl { rig, chosen, choices, error, uncompensated })
}

fn unusable(error: FileError) -> ProposeError {
    ProposeError::Unstable(error.to_string())
}

/// The rig file with the model that was identified, what was written, and what was not. Of effects
/// that the records cannot distinguish, the first is taken: on the records they do the same.
fn model_text(
    rig: &RigFile,
    outcome: &Outcome,
    provenance: &Provenance,
) -> Result<(String, String, Vec<String>), ProposeError> {
    let mut outcome = outcome.clone();
    let mut left_out = Vec::new();
    if outcome.verdict == Verdict::Ambiguous {
        outcome.verdict = Verdict::Effect;
        left_out.push(format!(
            "that {} would explain the records as well: the movement that was recorded does not \
             distinguish them",
            outcome.rivals().join(" or ")
        ));
    }
    let written = fitted(rig.text(), rig.file_name(), &outcome, provenance)?;
    let Some(text) = written.text else {
        return Err(ProposeError::NoModel(written.left_out.join("; ")));
    };
    left_out.extend(written.left_out);
    Ok((text, written.told, left_out))
}

/// The best lead of a choice, with its rig file unless it is refused.
fn best_of(
    setting: &Setting,
    rig: &RigFile,
    machine: Machine<'_>,
    movement: &Protocol,
) -> Result<(Choice, Option<RigFile>), ProposeError> {
    let leads: Vec<Option<f64>> = match setting.leads_s {
        [] => vec![None],
        leads => leads.iter().copied().map(Some).collect(),
    };
    let mut best: Option<(Choice, Option<RigFile>)> = None;
    for lead_s in leads {
        let text = setting.of(rig.text(), 0, lead_s);
        let (predicted, file) = match text.map(|text| RigFile::parse(&text, rig.file_name())) {
            None => (Predicted::Refused("the rig file has no axis".to_owned()), None),
            Some(Err(error)) => (Predicted::Refused(error.to_string()), None),
            Some(Ok(control)) => (predict(&control, machine, movement)?, Some(control)),
        };
        let rms = |choice: &Predicted| choice.error().map_or(f64::INFINITY, |error| error.rms);
        if best.as_ref().is_none_or(|(best, _)| rms(&predicted) < rms(&best.predicted)) {
            best = Some((Choice { name: setting.name, lead_s, predicted }, file));
        }
    }
    best.ok_or_else(|| ProposeError::NoModel("no lead is tried".to_owned()))
}

/// Predicts the error of a control, and refuses one whose outer loop or observer has no margin.
fn predict(
    control: &RigFile,
    machine: Machine<'_>,
    movement: &Protocol,
) -> Result<Predicted, ProposeError> {
    let error = match error_of(control, machine, movement) {
        Ok(error) => error,
        Err(ProposeError::Short(length_s)) => return Err(ProposeError::Short(length_s)),
        Err(error) => return Ok(Predicted::Refused(error.to_string())),
    };
    let mut raised = control.clone();
    for axis in &mut raised.axes {
        if let Some(observer) = &mut axis.control.options.observer {
            observer.share = (MARGIN * observer.share).min(1.0);
            observer.cutoff_hz *= MARGIN;
        }
        if let Some(slave) = &mut axis.control.options.slave {
            slave.proportional_gain *= MARGIN;
            slave.integral_gain *= MARGIN;
        }
    }
    let grows = match error_of(&raised, machine, movement) {
        Ok(with_margin) => with_margin.rms > RAISED_ERROR * error.rms,
        Err(_) => true,
    };
    if grows {
        return Ok(Predicted::Refused(format!(
            "no gain margin of {MARGIN}: with gains of outer loop and observer {MARGIN} times as \
             high the simulated error more than doubles"
        )));
    }
    Ok(Predicted::Predicted(error))
}

/// The simulated tracking error.
fn error_of(
    control: &RigFile,
    machine: Machine<'_>,
    movement: &Protocol,
) -> Result<TrackingError, ProposeError> {
    let played = play(control, machine, movement)?;
    played.followed.error().ok_or(ProposeError::Short(movement.duration_s()))
}

/// The effects of a rig file that its control does not compensate: without them the simulated error
/// would be clearly smaller.
fn uncompensated(
    rig: &RigFile,
    movement: &Protocol,
    with: TrackingError,
) -> Result<Vec<Uncompensated>, ProposeError> {
    let mut found = Vec::new();
    for (at, effect) in rig.model.effects.iter().enumerate() {
        let mut without = rig.clone();
        without.model.effects.remove(at);
        // Control and machine alike: what is left is what no knowledge of the effect takes away.
        let machine = Machine { rig: &without, effects: &[] };
        let error = error_of(&without, machine, movement)?;
        if error.rms < COMPENSATED * with.rms {
            let effect = format!("{}@{}", effect.id, effect.site.name());
            found.push(Uncompensated { effect, rms_without: error.rms });
        }
    }
    Ok(found)
}

#[cfg(test)]
mod tests;
