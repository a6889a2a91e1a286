//! The declared model: its kind, its parameters with tolerances, its effects.

use plant::transmission_kinds::{Kind, Parameters};

use crate::axis_unit::AxisUnit;
use crate::checked_toml::{Keys, Section, bounds};
use crate::effect::ModelEffect;
use crate::error::RigError;
use crate::parameter::Parameter;
use crate::siso_parameters::{MOTOR_TURN, is_rotary};

/// The model of the rig that the laboratory declares.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// Which equations.
    pub kind: ModelKind,
    /// Where the force column of a model with one measured channel comes from; `None` where the
    /// file does not say.
    pub force: Option<ForceSource>,
    /// Declared parameters of every axis's transmission, in the order of the file.
    pub parameters: Vec<Parameter>,
    /// Effects that measured records showed beyond the model's equations, of every axis.
    pub effects: Vec<ModelEffect>,
    /// Products of inertia of the handle that the axes share, one per pair of axes: first and
    /// second, first and third, second and third (kg·m²). Empty where the axes are uncoupled.
    pub handle_coupling: Vec<f64>,
}

/// Where the force column of a record comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ForceSource {
    /// It is the command to an amplifier, whose effects stand between it and the machine.
    Commanded,
    /// A sensor measured it at the machine.
    Measured,
}

/// Which equations the model has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ModelKind {
    /// A master and a slave joined by two lines.
    Transmission(Kind),
    /// One mass with friction, driven by a force.
    Drive,
    /// Mass, damper, spring.
    Oscillator,
    /// A single part on a test bench, under imposed motion.
    Element,
}

impl ModelKind {
    /// All kinds: the transmissions of [`plant::transmission_kinds`], then the others.
    pub fn all() -> impl Iterator<Item = Self> {
        let transmissions = Kind::ALL.iter().copied().map(Self::Transmission);
        transmissions.chain([Self::Drive, Self::Oscillator, Self::Element])
    }

    /// The word in the file.
    pub fn name(self) -> &'static str {
        match self {
            Self::Transmission(kind) => kind.name(),
            Self::Drive => "drive",
            Self::Oscillator => "oscillator",
            Self::Element => "element",
        }
    }

    /// Whether it is a transmission from a motor, driven by volts, to a handle: what the simulated
    /// card can simulate.
    pub fn is_transmission(self) -> bool {
        matches!(self, Self::Transmission(_))
    }
}

const KEYS: Keys = &[
    ("kind", "Which equations the model has."),
    ("force", "Where the force column of records comes from; as the kind has it, if left out."),
    ("parameters", "Declared parameters; those left out have their printed values."),
    ("effects", "Effects beyond the model's equations."),
    ("handle_coupling_kg_m2", "Products of inertia of a shared handle, one per pair, to ±25 %."),
];

impl Model {
    /// The declared parameter of that name.
    pub fn parameter(&self, name: &str) -> Option<&Parameter> {
        self.parameters.iter().find(|parameter| parameter.name == name)
    }

    /// Travel of a drive per turn of its motor (m or rad), where it is declared.
    pub fn motor_turn(&self) -> Option<f64> {
        MOTOR_TURN.iter().find_map(|name| Some(self.parameter(name)?.value))
    }

    /// Unit of the positions of a model with one measured channel, by the names of its parameters.
    pub(crate) fn unit(&self) -> AxisUnit {
        match self.parameters.iter().any(|parameter| is_rotary(&parameter.name)) {
            true => AxisUnit::Radian,
            false => AxisUnit::Metre,
        }
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
    pub(crate) fn of_axis(&self, own: &[Parameter], file: &str) -> Result<Parameters, RigError> {
        self.with(own).transmission(file)
    }

    /// Constants of a transmission of any kind; those not declared have their printed values.
    ///
    /// # Errors
    /// [`RigError::Invalid`] where the model is no transmission; `file` names the file in it.
    pub fn transmission(&self, file: &str) -> Result<Parameters, RigError> {
        let ModelKind::Transmission(kind) = self.kind else {
            let names: Vec<_> =
                Kind::ALL.iter().map(|kind| format!("\"{}\"", kind.name())).collect();
            let expected = format!("a transmission: the model {}", names.join(" or "));
            let found = format!("\"{}\"", self.kind.name());
            return Err(RigError::wrong_model(file, "model.kind", expected, found));
        };
        let mut parameters = kind.printed();
        for declared in &self.parameters {
            parameters.set(&declared.name, declared.value).map_err(|error| {
                let key = format!("model.parameters.{}", declared.name);
                let expected = "a value within the model's range".to_owned();
                RigError::wrong_model(file, &key, expected, error.to_string())
            })?;
        }
        Ok(parameters)
    }

    pub(crate) fn read(section: Section<'_>) -> Self {
        section.document("[model]", KEYS);
        let kinds: Vec<_> = ModelKind::all().map(|kind| (kind.name(), kind)).collect();
        let assumed = ModelKind::Transmission(Kind::Hydrostatic);
        let kind = section.word("kind", &kinds).unwrap_or(assumed);
        let sources = [("commanded", ForceSource::Commanded), ("measured", ForceSource::Measured)];
        let force = section.word_or_none("force", &sources);
        let parameters = Parameter::read_all(&section.section("parameters"));
        let effects = ModelEffect::read_all(&section, "[[model.effects]]");
        let products = bounds(-1.0, 1.0, "in kg·m²; a handle of 1 kg at 0.1 m has 0.01");
        let handle_coupling =
            section.numbers_or_none("handle_coupling_kg_m2", products).unwrap_or_default();
        Self { kind, force, parameters, effects, handle_coupling }
    }
}
