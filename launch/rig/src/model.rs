//! The declared model: its kind, its parameters with tolerances, its effects.

use plant::{ParameterInfo, ParameterSet, any, cable, drive, hydrostatic};

use crate::effect::ModelEffect;
use crate::error::RigError;
use crate::parameter::Parameter;
use crate::read::{Section, bounds};

/// The model of the rig that the laboratory declares.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// Which equations.
    pub kind: ModelKind,
    /// Declared parameters of every axis's transmission, in the order of the file.
    pub parameters: Vec<Parameter>,
    /// Effects that measured records showed beyond the model's equations, of every axis.
    pub effects: Vec<ModelEffect>,
    /// Products of inertia of the handle that the axes share, one per pair of axes: first and
    /// second, first and third, second and third (kg·m²). Empty where the axes are uncoupled.
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
    /// A single part on a test bench, under imposed motion.
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

    /// Whether it is a transmission from a motor, driven by volts, to a handle: what the simulated
    /// card can simulate.
    pub fn is_transmission(self) -> bool {
        matches!(self, Self::Hydrostatic | Self::Cable)
    }
}

/// Force of a drive's motor per volt; the input of [`plant::drive`] is that force.
pub(crate) const FORCE_PER_VOLT: ParameterInfo = ParameterInfo {
    name: "force_per_volt_n",
    unit: "N/V",
    minimum: 1e-6,
    maximum: 1e6,
    printed: 35.15065,
    source: "EMPS: Janot, Gautier, Brunot 2019",
};

/// Travel of a drive per turn of its motor, from which effects periodic in the motor's angle are
/// recognised. Optional.
pub(crate) const MOTOR_TURN: ParameterInfo = ParameterInfo {
    name: "motor_turn_m",
    unit: "m",
    minimum: 1e-6,
    maximum: 1e3,
    printed: 2.5e-3,
    source: "EMPS: Janot, Gautier, Brunot 2019",
};

fn is_motor_parameter(kind: ModelKind, name: &str) -> bool {
    kind == ModelKind::Drive && [FORCE_PER_VOLT.name, MOTOR_TURN.name].contains(&name)
}

impl Model {
    /// The declared parameter of that name.
    pub fn parameter(&self, name: &str) -> Option<&Parameter> {
        self.parameters.iter().find(|parameter| parameter.name == name)
    }

    /// The model with one axis's own parameters in place of, or beside, the common ones.
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

    /// Constants of one axis's transmission.
    pub(crate) fn of_axis(
        &self,
        own: &[Parameter],
        file: &str,
    ) -> Result<any::Parameters, RigError> {
        self.with(own).transmission(file)
    }

    /// Constants of a hydrostatic transmission; those not declared have their printed values.
    pub(crate) fn hydrostatic(&self, file: &str) -> Result<hydrostatic::Parameters, RigError> {
        self.fill(ModelKind::Hydrostatic, hydrostatic::Parameters::printed(), file)
    }

    /// Constants of a cable transmission; those not declared have their printed values.
    pub(crate) fn cable(&self, file: &str) -> Result<cable::Parameters, RigError> {
        self.fill(ModelKind::Cable, cable::Parameters::printed(), file)
    }

    /// Constants of a transmission of either kind.
    ///
    /// # Errors
    /// [`RigError::Invalid`] where the model is no transmission; `file` names the file in it.
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
                let found = format!("\"{}\"", self.kind.name());
                Err(RigError::wrong_model(file, "model.kind", expected, found))
            }
        }
    }

    /// Constants of a one-mass drive; those not declared are those of EMPS.
    pub(crate) fn drive(&self, file: &str) -> Result<drive::Parameters, RigError> {
        self.fill(ModelKind::Drive, drive::Parameters::default(), file)
    }

    fn fill<P: ParameterSet>(
        &self,
        kind: ModelKind,
        mut parameters: P,
        file: &str,
    ) -> Result<P, RigError> {
        if self.kind != kind {
            let (expected, found) =
                (format!("the model \"{}\"", kind.name()), format!("\"{}\"", self.kind.name()));
            return Err(RigError::wrong_model(file, "model.kind", expected, found));
        }
        for declared in
            self.parameters.iter().filter(|declared| !is_motor_parameter(kind, &declared.name))
        {
            parameters.set(&declared.name, declared.value).map_err(|error| {
                let key = format!("model.parameters.{}", declared.name);
                let expected = "a value within the model's range".to_owned();
                RigError::wrong_model(file, &key, expected, error.to_string())
            })?;
        }
        Ok(parameters)
    }

    pub(crate) fn read(section: Section<'_>) -> Self {
        let kind = section.word("kind", ModelKind::WORDS).unwrap_or(ModelKind::Hydrostatic);
        let parameters = Parameter::read_all(&section.section("parameters"));
        let effects = ModelEffect::read_all(&section);
        let products = bounds(-1.0, 1.0, "in kg·m²; a handle of 1 kg at 0.1 m has 0.01");
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
