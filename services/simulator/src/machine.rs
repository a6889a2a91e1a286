//! The simulated machine of a rig file.

use plant::ParameterError;
use plant::coupled_axes::{CouplingError, HandleCoupling, Plant};
use plant::effects::end_stop::EndStop;
use plant::effects::{Effect, EffectError, parse};
use rig::{HandKind, RigFile};
use thiserror::Error;

/// Why the simulated card cannot be built from a rig file.
#[derive(Debug, Error)]
#[allow(missing_docs)]
pub enum CardError {
    #[error(transparent)]
    Rig(#[from] rig::RigError),
    #[error("model.parameters: {0}")]
    Parameter(#[from] ParameterError),
    #[error("--effect: {0}")]
    Effect(#[from] EffectError),
    #[error("coupling of the handle: {0}")]
    Coupling(#[from] CouplingError),
    /// The model kind has no simulated plant.
    #[error(
        "{file}: the simulated card can simulate the model kinds \"hydrostatic\" and \"cable\"; \
         found kind \"{kind}\"; replay a measured record instead (`farreach up --replay RECORD`)"
    )]
    NoPlant { file: String, kind: &'static str },
}

/// The machine of a rig file, with further effects (`ID[@SITE][=SIZE]`) in every axis.
///
/// # Errors
/// As [`crate::Card::new`].
pub fn plant_of(rig: &RigFile, effects: &[String]) -> Result<Plant, CardError> {
    plant_with(rig, effects, |_| Ok(Vec::new()))
}

/// The same, with what `broken` gives for each axis.
pub(crate) fn plant_with(
    rig: &RigFile,
    effects: &[String],
    broken: impl Fn(usize) -> Result<Vec<Box<dyn Effect>>, EffectError>,
) -> Result<Plant, CardError> {
    let kind = rig.model.kind;
    if !kind.is_transmission() {
        return Err(CardError::NoPlant { file: rig.file_name().to_owned(), kind: kind.name() });
    }
    let (simulation, hand) = (&rig.simulation, rig.simulation.hand);
    let mut transmissions = Vec::with_capacity(rig.axes.len());
    for (index, axis) in rig.axes.iter().enumerate() {
        let mut parameters = rig.axis_parameters(axis)?;
        if hand.kind != HandKind::Absent {
            parameters.load_handle(hand.inertia)?;
        }
        let requested = effects.iter().map(|text| parse(text)).collect::<Result<Vec<_>, _>>()?;
        let mut effects = rig.axis_effects(axis)?;
        effects.extend(requested);
        effects.extend(broken(index)?);
        if let Some((lower, upper)) = simulation.end_stops {
            effects.push(Box::new(EndStop::between(lower, upper)));
        }
        transmissions.push(parameters.plant(effects)?);
    }
    let coupling = HandleCoupling::of_pairs(rig.axes.len(), &rig.model.handle_coupling)?;
    Ok(Plant::new(transmissions, &coupling)?)
}
