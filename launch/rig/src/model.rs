//! The declared model: a kind, and parameters that are known to a tolerance.

use plant::axes::{CouplingError, HandleCoupling, LEAST_EIGENVALUE};
use plant::{ParameterInfo, ParameterSet, any, cable, drive, hydrostatic};

use crate::axis::Axis;
use crate::effect::ModelEffect;
use crate::error::{Problem, RigError};
use crate::one_channel;
use crate::read::{NumberOrSection, Section, Source, bounds, nearest};

/// What stands between motor and handle, as far as the laboratory declares it.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// Which equations.
    pub kind: ModelKind,
    /// Declared parameters, in the order of the file: those of every axis's transmission.
    pub parameters: Vec<Parameter>,
    /// What every axis's transmission has beyond its equations, as measured records showed it.
    pub effects: Vec<ModelEffect>,
    /// What the axes' handle has of inertia beside each axis's own, a number a pair: first and
    /// second axis, first and third, second and third (kg·m²). Empty where the axes move as if
    /// alone.
    pub handle_coupling: Vec<f64>,
}

/// Which equations the model has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ModelKind {
    /// Two oil lines between master and slave (ch. 3).
    Hydrostatic,
    /// A cable between master and slave (ch. 5).
    Cable,
    /// One mass with friction, driven by a force.
    Drive,
    /// Mass, damper, spring.
    Oscillator,
    /// A part tested by itself under imposed motion.
    Element,
}

impl ModelKind {
    const WORDS: &'static [(&'static str, Self)] = &[
        ("hydrostatic", Self::Hydrostatic),
        ("cable", Self::Cable),
        ("drive", Self::Drive),
        ("oscillator", Self::Oscillator),
        ("element", Self::Element),
    ];

    /// The word in the file.
    pub fn name(self) -> &'static str {
        Self::WORDS.iter().find(|(_, kind)| *kind == self).map_or("", |(word, _)| word)
    }

    /// Whether it is a transmission between a motor that takes volts and a handle: what the virtual
    /// card can simulate.
    pub fn is_transmission(self) -> bool {
        matches!(self, Self::Hydrostatic | Self::Cable)
    }
}

/// A declared parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameter {
    /// Name, as in `plant`.
    pub name: String,
    /// Nominal value (SI).
    pub value: f64,
    /// How well it is known, as a fraction of the value: 0.05 is ±5 %.
    pub tolerance: f64,
    /// How well it is known in its own unit (SI); takes the place of `tolerance`, for values near
    /// 0.
    pub tolerance_absolute: Option<f64>,
    /// Where it comes from.
    pub source: ParameterSource,
}

/// Where a parameter comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ParameterSource {
    /// Printed in the thesis or on a data sheet.
    Printed,
    /// Assumed, because nobody printed it.
    Assumed,
    /// Traced from measured results.
    Traced,
}

impl ParameterSource {
    const WORDS: &'static [(&'static str, Self)] =
        &[("printed", Self::Printed), ("assumed", Self::Assumed), ("traced", Self::Traced)];
}

impl Parameter {
    /// Half the width of the range in which the value is believed to lie (SI).
    pub fn spread(&self) -> f64 {
        self.tolerance_absolute.unwrap_or(self.tolerance * self.value.abs())
    }
}

/// What the motor of a drive makes of a volt: `plant`'s drive begins at the force.
const FORCE_PER_VOLT: ParameterInfo = ParameterInfo {
    name: "force_per_volt_n",
    unit: "N/V",
    minimum: 1e-6,
    maximum: 1e6,
    printed: 35.15065,
    source: "EMPS: Janot, Gautier, Brunot 2019",
};

/// How far a turn of the motor moves a drive; what repeats with the motor's angle is told by it. It
/// need not be declared.
const MOTOR_TURN: ParameterInfo = ParameterInfo {
    name: "motor_turn_m",
    unit: "m",
    minimum: 1e-6,
    maximum: 1e3,
    printed: 2.5e-3,
    source: "EMPS: Janot, Gautier, Brunot 2019",
};

/// The file's model is not the one that was asked for.
pub(crate) fn unfit(file: &str, key: String, expected: String, found: String) -> RigError {
    let (file, advice) = (file.to_owned(), "take a rig file with that model".to_owned());
    RigError::Invalid { problems: vec![Problem { file, line: 1, key, expected, found, advice }] }
}

fn is_of_the_motor(kind: ModelKind, name: &str) -> bool {
    kind == ModelKind::Drive && [FORCE_PER_VOLT.name, MOTOR_TURN.name].contains(&name)
}

/// Tolerance where the file says none.
const TOLERANCE: f64 = 0.25;

impl Model {
    /// The parameter of that name.
    pub fn parameter(&self, name: &str) -> Option<&Parameter> {
        self.parameters.iter().find(|parameter| parameter.name == name)
    }

    /// The same model with what one axis has otherwise.
    pub(crate) fn with(&self, own: &[Parameter]) -> Self {
        let mut model = self.clone();
        for parameter in own {
            match model.parameters.iter_mut().find(|declared| declared.name == parameter.name) {
                Some(declared) => declared.clone_from(parameter),
                None => model.parameters.push(parameter.clone()),
            }
        }
        model
    }

    /// The declared constants of one axis's transmission.
    pub(crate) fn of_axis(
        &self,
        own: &[Parameter],
        file: &str,
    ) -> Result<any::Parameters, RigError> {
        self.with(own).transmission(file)
    }

    /// The declared constants of a hydrostatic transmission; those that the file leaves out are as
    /// printed.
    pub(crate) fn hydrostatic(&self, file: &str) -> Result<hydrostatic::Parameters, RigError> {
        self.fill(ModelKind::Hydrostatic, hydrostatic::Parameters::printed(), file)
    }

    /// The declared constants of a cable transmission; those that the file leaves out are as
    /// printed.
    pub(crate) fn cable(&self, file: &str) -> Result<cable::Parameters, RigError> {
        self.fill(ModelKind::Cable, cable::Parameters::printed(), file)
    }

    /// The declared constants of a transmission, whichever it is.
    pub fn transmission(&self, file: &str) -> Result<any::Parameters, RigError> {
        match self.kind {
            ModelKind::Hydrostatic => self.hydrostatic(file).map(Into::into),
            ModelKind::Cable => self.cable(file).map(Into::into),
            ModelKind::Drive | ModelKind::Oscillator | ModelKind::Element => {
                let expected = format!(
                    "a transmission: the model \"{}\" or \"{}\"",
                    ModelKind::Hydrostatic.name(),
                    ModelKind::Cable.name()
                );
                Err(unfit(
                    file,
                    "model.kind".to_owned(),
                    expected,
                    format!("\"{}\"", self.kind.name()),
                ))
            }
        }
    }

    /// The declared constants of a one-mass drive.
    pub(crate) fn drive(&self, file: &str) -> Result<drive::Parameters, RigError> {
        self.fill(ModelKind::Drive, drive::Parameters::default(), file)
    }

    fn fill<P: ParameterSet>(
        &self,
        kind: ModelKind,
        mut parameters: P,
        file: &str,
    ) -> Result<P, RigError> {
        let problem = |key, expected, found| unfit(file, key, expected, found);
        if self.kind != kind {
            let (expected, found) =
                (format!("the model \"{}\"", kind.name()), format!("\"{}\"", self.kind.name()));
            return Err(problem("model.kind".to_owned(), expected, found));
        }
        for declared in
            self.parameters.iter().filter(|declared| !is_of_the_motor(kind, &declared.name))
        {
            parameters.set(&declared.name, declared.value).map_err(|error| {
                let key = format!("model.parameters.{}", declared.name);
                problem(key, "a value that the model stands for".to_owned(), error.to_string())
            })?;
        }
        Ok(parameters)
    }

    /// Names and ranges; and the handle that several axes share.
    pub(crate) fn check(&self, axes: &[Axis], source: &Source<'_>) {
        self.check_parameters("model.parameters", &self.parameters, source);
        for (at, axis) in axes.iter().enumerate() {
            let table = format!("axes.{at}.model");
            if !axis.model.is_empty() && !self.kind.is_transmission() {
                let found = format!("the model \"{}\"", self.kind.name());
                source.problem(
                    &table,
                    "a transmission of the axis's own",
                    found,
                    "take the section out",
                );
            } else {
                self.check_parameters(&table, &axis.model, source);
            }
        }
        let motor = FORCE_PER_VOLT;
        if self.kind == ModelKind::Drive && self.parameter(motor.name).is_none() {
            let advice = format!("add {} = {{ value = … }}, in {}", motor.name, motor.unit);
            source.problem("model.parameters", format!("`{}`", motor.name), "nothing", advice);
        }
        if source.is_clean() {
            self.check_effects(axes, source);
        }
        if source.is_clean() && !self.handle_coupling.is_empty() {
            self.check_coupling(axes, source);
        }
    }

    /// Whether the effects can act in each axis's transmission.
    fn check_effects(&self, axes: &[Axis], source: &Source<'_>) {
        for (at, effect) in self.effects.iter().enumerate() {
            if let Some(before) = self.effects[..at]
                .iter()
                .position(|other| (other.id, other.site) == (effect.id, effect.site))
            {
                let expected =
                    format!("an effect of its own (model.effects.{before} has it already)");
                let found = format!("{} at {}", effect.id, effect.site);
                source.problem(
                    &format!("model.effects.{at}.id"),
                    expected,
                    found,
                    "take one of the two out",
                );
            }
            for axis in axes {
                effect.check(at, self.of_axis(&axis.model, "").ok().as_ref(), source);
                if !source.is_clean() {
                    break;
                }
            }
        }
    }

    /// Whether a handle can have this inertia.
    fn check_coupling(&self, axes: &[Axis], source: &Source<'_>) {
        let key = "model.handle_coupling_kg_m2";
        let inertia =
            |axis: &Axis| self.of_axis(&axis.model, "").map(|own| own.slave_inertia_kg_m2());
        let Ok(inertia) = axes.iter().map(inertia).collect::<Result<Vec<_>, _>>() else {
            let found = format!("the model \"{}\"", self.kind.name());
            source.problem(
                key,
                "a transmission, whose slave is at the handle",
                found,
                "take the key out",
            );
            return;
        };
        let pairs = axes.len() * (axes.len() - 1) / 2;
        match HandleCoupling::of_pairs(axes.len(), &self.handle_coupling)
            .and_then(|handle| handle.check(&inertia))
        {
            Ok(_) => {}
            Err(CouplingError::TooStrong { found }) => {
                let expected = format!(
                    "a handle with at least {LEAST_EIGENVALUE} of the axes' own inertia in every direction"
                );
                let found = format!("{:?} with a least of {found:.3}", self.handle_coupling);
                let advice = "for two axes: at most 0.8 times the root of the product of their slaves' inertia";
                source.problem(key, expected, found, advice);
            }
            Err(_) => {
                let expected =
                    format!("{pairs} numbers, one for each pair of the {} axes", axes.len());
                let advice =
                    "in the order first and second axis, first and third, second and third";
                source.problem(key, expected, self.handle_coupling.len(), advice);
            }
        }
    }

    fn check_parameters(&self, table: &str, parameters: &[Parameter], source: &Source<'_>) {
        let infos: &[ParameterInfo] = match self.kind {
            ModelKind::Hydrostatic => hydrostatic::Parameters::NAMES,
            ModelKind::Cable => cable::Parameters::NAMES,
            ModelKind::Drive => drive::Parameters::NAMES,
            ModelKind::Oscillator => one_channel::OSCILLATOR,
            ModelKind::Element => one_channel::ELEMENT,
        };
        let extra: &[ParameterInfo] =
            if self.kind == ModelKind::Drive { &[FORCE_PER_VOLT, MOTOR_TURN] } else { &[] };
        let infos = || infos.iter().chain(extra);
        for parameter in parameters {
            let key = format!("{table}.{}", parameter.name);
            let Some(info) = infos().find(|info| info.name == parameter.name) else {
                let names: Vec<_> = infos().map(|info| info.name).collect();
                let advice = match nearest(&parameter.name, names.iter().copied()) {
                    Some(name) => format!("did you mean `{name}`?"),
                    None => format!("the model has {}", names.join(", ")),
                };
                let expected = format!("a parameter of the {} model", self.kind.name());
                source.problem(&key, expected, "an unknown key", advice);
                continue;
            };
            if !(info.minimum..=info.maximum).contains(&parameter.value) {
                let expected = format!("{} to {} {}", info.minimum, info.maximum, info.unit);
                let advice = format!("the value is in {}; printed is {}", info.unit, info.printed);
                source.problem(&key, expected, parameter.value, advice);
            }
        }
    }

    pub(crate) fn read(section: Section<'_>) -> Self {
        let kind = section.word("kind", ModelKind::WORDS).unwrap_or(ModelKind::Hydrostatic);
        let parameters = Parameter::read_all(&section.section("parameters"));
        let effects = ModelEffect::read_all(&section);
        let products = bounds(-1.0, 1.0, "in kg·m²; a handle of 1 kg at 0.1 m makes 0.01");
        let handle_coupling = match section.has("handle_coupling_kg_m2") {
            true => section.numbers("handle_coupling_kg_m2", products),
            false => {
                section.known("handle_coupling_kg_m2");
                Vec::new()
            }
        };
        section.finish();
        Self { kind, parameters, effects, handle_coupling }
    }
}

impl Parameter {
    /// All that stand in a table.
    pub(crate) fn read_all(table: &Section<'_>) -> Vec<Self> {
        table.keys().into_iter().map(|name| Self::read(table, name)).collect()
    }

    fn read(table: &Section<'_>, name: String) -> Self {
        let value = bounds(f64::MIN, f64::MAX, "");
        match table.number_or_section(&name, value) {
            NumberOrSection::Number(value) => Self {
                name,
                value,
                tolerance: TOLERANCE,
                tolerance_absolute: None,
                source: ParameterSource::Assumed,
            },
            NumberOrSection::Section(section) => {
                let fraction =
                    bounds(0.0, 1.0, "a tolerance is a fraction of the value: write 5 % as 0.05");
                let absolute = bounds(0.0, f64::MAX, "half the range, in the parameter's unit");
                let parameter = Self {
                    name,
                    value: section.number("value", value),
                    tolerance: section.number_or("tolerance", TOLERANCE, fraction),
                    tolerance_absolute: section.number_or_none("tolerance_absolute", absolute),
                    source: section
                        .word_or_none("source", ParameterSource::WORDS)
                        .unwrap_or(ParameterSource::Assumed),
                };
                if section.has("tolerance") && section.has("tolerance_absolute") {
                    let advice = "keep the fraction, or the absolute one for a value near 0";
                    section.problem("tolerance_absolute", "one tolerance", "two", advice);
                }
                section.finish();
                parameter
            }
        }
    }
}
