//! What a machine has beyond the equations of its model: `[[model.effects]]`.

use plant::any::Parameters;
use plant::effects::{Effect, EffectError, LIST, Site, make};
use plant::{ParameterError, ParameterSet};

use crate::axis::Axis;
use crate::error::RigError;
use crate::model::unfit;
use crate::read::{Section, Source, bounds, nearest};
use crate::rig_file::RigFile;

/// An effect that measured records showed, with its parameters; those that are not named are as by
/// default.
///
/// ```toml
/// [[model.effects]]
/// id = "backlash"
/// site = "slave"
/// parameters = { gap = 0.061 }
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct ModelEffect {
    /// Its name, one of [`plant::effects::LIST`].
    pub id: &'static str,
    /// Where it acts.
    pub site: Site,
    /// Values by name (SI, in the effect's own units).
    pub parameters: Vec<(String, f64)>,
}

/// An effect of a rig file cannot be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ModelEffectError {
    /// Id or site.
    #[error(transparent)]
    Effect(#[from] EffectError),
    /// A parameter.
    #[error(transparent)]
    Parameter(#[from] ParameterError),
}

impl ModelEffect {
    /// The effect, to be put into a plant.
    ///
    /// # Errors
    /// [`ModelEffectError`] where there is no such effect, or where a parameter is unknown or out
    /// of range.
    pub fn make(&self) -> Result<Box<dyn Effect>, ModelEffectError> {
        let place = LIST.iter().find(|entry| entry.id == self.id).and_then(|entry| {
            let place = entry.sites.iter().find(|place| place.site == self.site)?;
            Some(place.size)
        });
        let mut effect = make(self.id, self.site, place.unwrap_or_default())?;
        for (name, value) in &self.parameters {
            effect.set(name, *value)?;
        }
        Ok(effect)
    }

    /// Puts what it changes into a transmission's constants, for laws that know constants alone:
    /// compliance and damping of the line, inertia, dry and viscous friction. Whatever else it does
    /// is left out.
    ///
    /// # Errors
    /// [`ModelEffectError`], as [`ModelEffect::make`], or where the sum is beyond what the model
    /// stands for.
    fn absorb(&self, constants: &mut Parameters) -> Result<(), ModelEffectError> {
        let effect = self.make()?;
        let inertia = effect.extra_inertia();
        let size = |id: &str, name: &str| {
            if self.id == id { effect.get(name).unwrap_or_default() } else { 0.0 }
        };
        let (dry, viscous) =
            (size("coulomb_friction", "level"), size("viscous_friction", "coefficient"));
        let mut parts: Vec<(&str, f64)> = Vec::new();
        match (self.site, &*constants) {
            (Site::Master, _) => parts.extend([
                ("motor_inertia_kg_m2", inertia),
                ("motor_coulomb_nm", dry),
                ("motor_viscous_nm_s", viscous),
            ]),
            // Its rise counts from the corner.
            (Site::Slave, Parameters::Hydrostatic(own)) => parts.extend([
                ("slave_handle_inertia_kg_m2", inertia),
                ("slave_static_friction_nm", dry),
                ("slave_kinetic_friction_nm", dry + viscous * own.slave_corner_speed_rad_s),
                ("slave_falling_slope_nm_s", -viscous),
                ("slave_rising_slope_nm_s", viscous),
            ]),
            (Site::Slave, Parameters::Cable(_)) => {
                parts.extend([("slave_inertia_kg_m2", inertia), ("slave_bearing_nm", dry)]);
            }
            _ => {}
        }
        let set: &mut dyn ParameterSet = match constants {
            Parameters::Hydrostatic(own) => {
                effect.modify(own);
                own
            }
            Parameters::Cable(own) => {
                effect.modify(own);
                own
            }
        };
        for (name, part) in parts.into_iter().filter(|(_, part)| *part != 0.0) {
            set.set(name, set.get(name).unwrap_or_default() + part)?;
        }
        Ok(())
    }

    /// One entry of the list; `None` where something is wrong with it, which is noted.
    fn read(section: Section<'_>) -> Option<Self> {
        let ids: Vec<(&str, &'static str)> =
            LIST.iter().map(|entry| (entry.id, entry.id)).collect();
        let sites = Site::ALL.map(|site| (site.name(), site));
        let id = section.word("id", &ids);
        let site = section.word("site", &sites);
        let table = section.section("parameters");
        let any = bounds(f64::MIN, f64::MAX, "");
        let parameters = table.keys().into_iter().map(|name| {
            let value = table.number(&name, any);
            (name, value)
        });
        let effect = Self { id: id?, site: site?, parameters: parameters.collect() };
        table.finish();
        section.finish();
        Some(effect)
    }

    /// All that stand in a model's section.
    pub(crate) fn read_all(model: &Section<'_>) -> Vec<Self> {
        model.sections("effects").into_iter().filter_map(Self::read).collect()
    }

    /// Whether the effect at this place of the list is one that can be, and acts in the declared
    /// transmission. The other kinds of models name effects as transmissions do: of them sites,
    /// parameters and ranges are what there is to check.
    pub(crate) fn check(&self, at: usize, transmission: Option<&Parameters>, source: &Source<'_>) {
        let key = format!("model.effects.{at}");
        match self.make() {
            Err(ModelEffectError::Effect(EffectError::WrongSite { allowed, .. })) => {
                let expected = format!("a site of {}: {allowed}", self.id);
                source.problem(
                    &format!("{key}.site"),
                    expected,
                    format!("\"{}\"", self.site),
                    "name the site",
                );
            }
            Err(ModelEffectError::Parameter(ParameterError::Unknown { name, known })) => {
                let advice = match nearest(&name, known.split(", ")) {
                    Some(near) => format!("did you mean `{near}`?"),
                    None => format!("it has {known}"),
                };
                let expected = format!("a parameter of {}", self.id);
                source.problem(
                    &format!("{key}.parameters.{name}"),
                    expected,
                    "an unknown key",
                    advice,
                );
            }
            Err(ModelEffectError::Parameter(ParameterError::OutOfRange {
                name,
                value,
                minimum,
                maximum,
                unit,
            })) => {
                let expected = format!("{minimum} to {maximum} {unit}");
                source.problem(
                    &format!("{key}.parameters.{name}"),
                    expected,
                    value,
                    format!("the value is in {unit}"),
                );
            }
            Err(other) => source.problem(
                &key,
                "an effect of the model",
                other,
                "mend the entry, or take it out",
            ),
            Ok(effect) => {
                if let Some(constants) = transmission
                    && let Err(error) = constants.clone().plant(vec![effect])
                {
                    source.problem(
                        &key,
                        "an effect that acts in this transmission",
                        error,
                        "take the entry out",
                    );
                }
            }
        }
    }
}

impl RigFile {
    /// What the declared transmission has beyond its equations, to be put into the plant of any
    /// axis.
    ///
    /// # Errors
    /// [`RigError::Invalid`] where an effect cannot be made, which a file that was read does not
    /// have.
    pub fn model_effects(&self) -> Result<Vec<Box<dyn Effect>>, RigError> {
        self.each_effect(|effect| effect.make())
    }

    /// The constants of one axis's transmission as the control law takes them: as
    /// [`RigFile::axis_parameters`], and what the declared effects change of compliance and damping
    /// of the line, inertia, dry and viscous friction.
    ///
    /// # Errors
    /// [`RigError::Invalid`] where the model is no transmission, or constants and effects together
    /// are beyond what it stands for.
    pub fn control_parameters(&self, axis: &Axis) -> Result<Parameters, RigError> {
        let mut constants = self.axis_parameters(axis)?;
        self.each_effect(|effect| effect.absorb(&mut constants))?;
        Ok(constants)
    }

    fn each_effect<T>(
        &self,
        mut act: impl FnMut(&ModelEffect) -> Result<T, ModelEffectError>,
    ) -> Result<Vec<T>, RigError> {
        let effects = self.model.effects.iter().enumerate();
        effects
            .map(|(at, effect)| {
                act(effect).map_err(|error| {
                    let expected = "an effect that the model stands for".to_owned();
                    unfit(
                        self.file_name(),
                        format!("model.effects.{at}"),
                        expected,
                        error.to_string(),
                    )
                })
            })
            .collect()
    }
}
