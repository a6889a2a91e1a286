//! Scores of the answers of identify against the truth.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::case::{Set, Truth};
use crate::coverage::{Fitted, normalised_errors};
use crate::effective_size;
use crate::effects::{Effect, Variable};
use crate::machine_parameters::MachineParameters;
use crate::one_channel;

/// The part of `identify --json` that is scored. Any field may be missing.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
pub struct Answer {
    /// `effect`, `none`, `ambiguous`, `unlisted` or `inadequate`.
    pub verdict: String,
    /// Effects in the order in which they were added.
    pub effects: Vec<Named>,
    /// Effects that the data cannot distinguish from them.
    pub ambiguous_with: Vec<Named>,
    /// Whether a residual remains.
    pub remains: bool,
    /// The unlisted effect.
    pub unlisted: Option<Unlisted>,
    /// Errors by channel.
    pub error: BTreeMap<String, Errors>,
    /// Declared parameters as fitted.
    pub parameters: Vec<Fitted>,
}

/// An effect with its parameters, if it was added.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
pub struct Named {
    /// Id.
    pub id: String,
    /// Site.
    pub site: String,
    /// Parameters.
    pub parameters: Vec<Parameter>,
}

/// A parameter of an effect.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
pub struct Parameter {
    /// Name.
    pub name: String,
    /// Value.
    pub value: Option<f64>,
}

/// An unlisted effect.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
pub struct Unlisted {
    /// Its site.
    pub site: String,
    /// Its variable.
    pub depends_on: String,
}

/// Errors of a channel on the reporting records.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
pub struct Errors {
    /// Of the rig file as it is.
    pub declared: Option<f64>,
    /// Of the declared model, fitted.
    pub before: Option<f64>,
    /// With the effects.
    pub after: Option<f64>,
    /// The noise floor.
    pub floor: Option<f64>,
}

/// How a run of identify ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum End {
    /// With a verdict.
    Done,
    /// With a non-zero exit code, or without a readable result.
    Failed,
    /// Not finished within the time limit.
    TooLate,
}

/// How a named effect compares with the truth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Naming {
    /// Id, site and place within it of the first effect are right.
    Right,
    /// `ambiguous`, and the truth is the first effect or one of at most two rivals.
    Ambiguous,
    /// The id of the first effect is right, but not its site or the place within it (which
    /// encoder).
    WrongSite,
    /// Another effect first.
    Wrong,
    /// Reported as unlisted.
    Unlisted,
    /// Nothing was found.
    Missed,
    /// No answer.
    NoAnswer,
}

/// A scored case.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Score {
    /// Set.
    pub set: Set,
    /// Index within the set.
    pub index: usize,
    /// Effects that were there, `ID@SITE`.
    pub truth: Vec<String>,
    /// Whether each of them is detectable.
    pub detectable: bool,
    /// Smallest gain of [`crate::detectability`] over the effects.
    pub gain: f64,
    /// How the run ended.
    pub end: End,
    /// Exit code.
    pub code: Option<i32>,
    /// Last line on stderr, if it failed.
    pub message: String,
    /// Verdict.
    pub verdict: String,
    /// Effects that were named, `ID@SITE`, in order.
    pub named: Vec<String>,
    /// `ambiguous_with`.
    pub ambiguous_with: Vec<String>,
    /// How the first effect compares; only with one true effect.
    pub naming: Option<Naming>,
    /// Whether any effect was reported, listed or not.
    pub alarm: bool,
    /// Reported as unlisted: verdict `unlisted` or `inadequate`, or a residual remains.
    pub flagged: bool,
    /// Whether the site of `unlisted` is right.
    pub site_right: Option<bool>,
    /// Whether the reported variable is one that describes it.
    pub variable_right: Option<bool>,
    /// Site and variable as reported.
    pub told: Option<(String, String)>,
    /// Whether all of two or three effects were found.
    pub both: Option<bool>,
    /// Whether an effect was found that is none of them.
    pub false_third: Option<bool>,
    /// Error with the effects over the noise floor, of the worst channel that has a floor.
    pub over_floor: Option<f64>,
    /// Ratio of the errors before and after: rms over the channels, each relative to its floor (or,
    /// without one, to its error after).
    pub drop: Option<f64>,
    /// The same with the error of the rig file as it is, if identify reports it.
    #[serde(default)]
    pub drop_from_file: Option<f64>,
    /// Relative error of the effective size of each effect that was found rightly.
    pub size_errors: Vec<f64>,
    /// Relative error of the first parameter of each effect that was found rightly.
    pub raw_size_errors: Vec<f64>,
    /// Errors of identified declared parameters over their stated standard deviations
    /// ([`crate::coverage`]).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub normalised_errors: Vec<f64>,
    /// Wall time of identify, s.
    pub seconds: f64,
    /// Records of the case.
    pub records: usize,
}

/// How a run ended.
#[derive(Clone, Debug)]
pub struct Run {
    /// How.
    pub end: End,
    /// Exit code.
    pub code: Option<i32>,
    /// Last line on stderr.
    pub message: String,
    /// Wall time, s.
    pub seconds: f64,
}

/// What the scoring needs of the truth about a case.
#[derive(Clone, Copy, Debug)]
pub struct Facts<'a> {
    /// Set.
    pub set: Set,
    /// Index within the set.
    pub index: usize,
    /// Effects.
    pub effects: &'a [Effect],
    /// Whether each of them is detectable.
    pub detectable: bool,
    /// Smallest gain over the effects.
    pub gain: f64,
    /// Constants of a transmission, by which sizes are compared.
    pub machine: Option<&'a BTreeMap<String, f64>>,
    /// Number of records.
    pub records: usize,
}

/// Scores an answer about a transmission.
pub fn score(truth: &Truth, answer: Option<&Answer>, run: &Run) -> Score {
    let gains = truth.detectability.iter().map(|seen| seen.gain);
    let facts = Facts {
        set: truth.set,
        index: truth.index,
        effects: &truth.effects,
        detectable: truth.detectability.iter().all(|seen| seen.detectable()),
        gain: gains.fold(f64::INFINITY, f64::min).min(1e9),
        machine: Some(&truth.machine),
        records: truth.records.len(),
    };
    judge(&facts, answer, run)
}

/// Ids of one column in a model with one channel.
const EQUAL: [[&str; 2]; 1] = [["line_damping", "viscous_friction"]];

/// Scores an answer about a machine with one channel. One channel does not tell at which of its
/// sites an effect acts, and so the site of the truth stands for all.
pub fn score_one_channel(
    truth: &one_channel::case::Truth,
    answer: Option<&Answer>,
    run: &Run,
) -> Score {
    let gains = truth.visibility.iter().map(one_channel::visibility::Visibility::gain);
    let facts = Facts {
        set: truth.set,
        index: truth.index,
        effects: &truth.effects,
        detectable: truth.visibility.iter().all(one_channel::visibility::Visibility::seen),
        gain: gains.fold(f64::INFINITY, f64::min).min(1e9),
        machine: None,
        records: truth.records.len(),
    };
    let equal = |one: &str, other: &str| {
        one == other || EQUAL.iter().any(|pair| pair.contains(&one) && pair.contains(&other))
    };
    let told = answer.map(|answer| {
        let mut told = answer.clone();
        for named in told.effects.iter_mut().chain(&mut told.ambiguous_with) {
            if let Some(meant) = truth.effects.iter().find(|own| equal(&own.id, &named.id)) {
                named.id.clone_from(&meant.id);
                meant.site.name().clone_into(&mut named.site);
            }
        }
        told
    });
    judge(&facts, told.as_ref(), run)
}

fn judge(truth: &Facts<'_>, answer: Option<&Answer>, run: &Run) -> Score {
    let nothing = Answer::default();
    let said = answer.unwrap_or(&nothing);
    let name = |named: &Named| format!("{}@{}", named.id, named.site);
    let names: Vec<String> = said.effects.iter().map(name).collect();
    let rivals: Vec<String> = said.ambiguous_with.iter().map(name).collect();
    let true_names: Vec<String> = truth.effects.iter().map(Effect::name).collect();
    let flagged = answer.is_some() && said.unexplained();
    let several = truth.effects.len() > 1;
    let hits = truth
        .effects
        .iter()
        .filter(|effect| said.effects.iter().any(|named| said.meant(effect, named)))
        .count();
    let told = said.unlisted.as_ref();
    let unnamed = truth.effects.first().filter(|effect| !effect.listed);
    let sizes: Vec<(f64, f64)> = truth
        .effects
        .iter()
        .filter_map(|effect| {
            let found = said.effects.iter().find(|named| named.is(effect))?;
            size_error(truth.machine?, effect, found, said)
        })
        .collect();
    let names_are_right = answer.is_some()
        && said.unlisted.is_none()
        && hits == truth.effects.len()
        && names.len() == hits;
    // With other effects, declared parameters stand in for those that were there.
    let machine = truth.machine.filter(|_| names_are_right);
    let normalised_errors = machine.map(|machine| normalised_errors(machine, &said.parameters));
    Score {
        set: truth.set,
        index: truth.index,
        detectable: truth.detectable,
        gain: truth.gain,
        normalised_errors: normalised_errors.unwrap_or_default(),
        end: run.end,
        code: run.code,
        message: run.message.clone(),
        verdict: said.verdict.clone(),
        naming: (truth.effects.len() == 1).then(|| naming(&truth.effects[0], answer)),
        alarm: answer.is_some() && (!names.is_empty() || said.verdict != "none"),
        flagged,
        site_right: unnamed.map(|effect| told.is_some_and(|told| told.site == effect.site.name())),
        variable_right: unnamed.map(|effect| {
            told.and_then(|told| variable(&told.depends_on))
                .is_some_and(|found| effect.depends_on.contains(&found))
        }),
        told: told.map(|told| (told.site.clone(), told.depends_on.clone())),
        both: several.then_some(hits == truth.effects.len()),
        false_third: several.then(|| {
            said.effects
                .iter()
                .any(|named| !truth.effects.iter().any(|effect| said.meant(effect, named)))
        }),
        over_floor: over_floor(said),
        drop: drop(said, |errors| errors.before),
        drop_from_file: drop(said, |errors| errors.declared),
        size_errors: sizes.iter().map(|size| size.0).collect(),
        raw_size_errors: sizes.iter().map(|size| size.1).collect(),
        seconds: run.seconds,
        records: truth.records,
        truth: true_names,
        named: names,
        ambiguous_with: rivals,
    }
}

/// Discrete parameters that tell at which place within its site an effect acts.
const PLACES: [(&str, &str); 1] = [("encoder_eccentricity", "on_master")];

/// The place within the site of an effect that has two; `None` if it is not reported.
fn place(id: &str, parameter: impl Fn(&str) -> Option<f64>) -> Option<bool> {
    let (_, name) = PLACES.iter().find(|place| place.0 == id)?;
    parameter(name).map(|value| value > 0.5)
}

impl Named {
    fn place(&self) -> Option<bool> {
        place(&self.id, |name| {
            self.parameters.iter().find(|parameter| parameter.name == name)?.value
        })
    }

    fn named_as(&self, truth: &Effect) -> bool {
        self.id == truth.id && self.site == truth.site.name()
    }

    /// Whether it is that effect: id, site, and place within it. A place that is not reported is
    /// not right.
    fn is(&self, truth: &Effect) -> bool {
        self.named_as(truth) && self.place() == truth_place(truth)
    }
}

fn truth_place(truth: &Effect) -> Option<bool> {
    place(&truth.id, |name| Some(truth.parameters.get(name)))
}

impl Answer {
    /// Whether it says that something is left that has no name.
    fn unexplained(&self) -> bool {
        self.remains || matches!(self.verdict.as_str(), "unlisted" | "inadequate")
    }

    /// Whether the truth is among at most two rivals. A rival without a place stands for all
    /// places.
    fn says_rival(&self, truth: &Effect) -> bool {
        let same = |rival: &Named| {
            rival.named_as(truth)
                && rival.place().is_none_or(|place| Some(place) == truth_place(truth))
        };
        self.verdict == "ambiguous"
            && self.ambiguous_with.len() <= 2
            && self.ambiguous_with.iter().any(same)
    }

    /// Whether a found effect is that one, or that one at another place within its site with the
    /// right place as a rival.
    fn meant(&self, truth: &Effect, named: &Named) -> bool {
        named.is(truth) || (named.named_as(truth) && self.says_rival(truth))
    }
}

fn naming(truth: &Effect, answer: Option<&Answer>) -> Naming {
    let Some(answer) = answer else { return Naming::NoAnswer };
    let Some(first) = answer.effects.first() else {
        return if answer.unexplained() { Naming::Unlisted } else { Naming::Missed };
    };
    if answer.verdict == "ambiguous" && (first.is(truth) || answer.says_rival(truth)) {
        Naming::Ambiguous
    } else if first.is(truth) {
        Naming::Right
    } else if first.id == truth.id {
        Naming::WrongSite
    } else {
        Naming::Wrong
    }
}

/// The kind of variable that a text describes, such as `slave_velocity`, `master_rad`,
/// `line force (N)`.
pub fn variable(text: &str) -> Option<Variable> {
    let text = text.to_lowercase();
    let has = |words: &[&str]| words.iter().any(|word| text.contains(word));
    Some(if has(&["accel", "rad_s2", "rad/s²", "rad/s^2"]) {
        Variable::Acceleration
    } else if has(&["veloc", "speed", "flow", "rate", "rad_s", "rad/s", "m_s", "m/s"]) {
        Variable::Velocity
    } else if has(&["volt", "motor_v"]) {
        Variable::Volts
    } else if has(&["torque", "force", "load", "pressure", "tension", "_nm", "deflection"]) {
        Variable::Load
    } else if has(&["posit", "angle", "_rad", "displacement", "stroke"]) {
        Variable::Position
    } else if has(&["time", "_s"]) {
        Variable::Time
    } else {
        return None;
    })
}

fn over_floor(answer: &Answer) -> Option<f64> {
    let ratios = answer
        .error
        .values()
        .filter_map(|errors| Some(errors.after? / errors.floor.filter(|floor| *floor > 0.0)?));
    ratios.reduce(f64::max)
}

fn drop(answer: &Answer, from: impl Fn(&Errors) -> Option<f64>) -> Option<f64> {
    let (mut before, mut after) = (0.0, 0.0);
    for errors in answer.error.values() {
        let (Some(was), Some(is)) = (from(errors), errors.after) else { continue };
        let unit = errors.floor.filter(|floor| *floor > 0.0).unwrap_or(is.max(1e-12));
        before += (was / unit).powi(2);
        after += (is / unit).powi(2);
    }
    (after > 0.0).then(|| (before / after).sqrt())
}

/// Relative errors of the effective size and of the first parameter.
fn size_error(
    machine: &BTreeMap<String, f64>,
    effect: &Effect,
    found: &Named,
    answer: &Answer,
) -> Option<(f64, f64)> {
    let own = effect.parameters.0.first()?;
    let lookup =
        |name: &str| found.parameters.iter().find(|parameter| parameter.name == name)?.value;
    let first = lookup(&own.name).or_else(|| found.parameters.first()?.value)?;
    let mut fitted = MachineParameters::declared();
    for parameter in &answer.parameters {
        if let (Some(value), Some(place)) = (parameter.fitted, fitted.named_mut(&parameter.name)) {
            *place = value;
        }
    }
    let mut real = MachineParameters::declared();
    for (name, value) in machine {
        if let Some(place) = real.named_mut(name) {
            *place = *value;
        }
    }
    let site = effect.site.name();
    let known = |name: &str| Some(effect.parameters.get(name)).filter(|value| value.is_finite());
    let is = effective_size::value(&effect.id, site, &real, &known, own.value)?;
    let told = effective_size::value(&effect.id, site, &fitted, &lookup, first)?;
    Some(((told / is - 1.0).abs(), (first / own.value - 1.0).abs()))
}
