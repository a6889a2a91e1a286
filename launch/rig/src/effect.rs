//! Declared effects beyond the equations of the model: `[[model.effects]]` of every axis,
//! `[[axes.effects]]` of one.

use plant::ParameterError;
use plant::effects::{Effect, EffectError, Site, make, of_one_axis};

use crate::checked_toml::{Keys, Section, bounds};

/// An effect that measured records showed, with its parameters; those not named keep their
/// defaults.
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

/// Why an effect of a rig file cannot be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ModelEffectError {
    /// Unknown id, or a site where the effect cannot act.
    #[error(transparent)]
    Effect(#[from] EffectError),
    /// An unknown parameter, or a value out of range.
    #[error(transparent)]
    Parameter(#[from] ParameterError),
}

const KEYS: Keys = &[
    ("id", "Name of the effect."),
    ("site", "Where it acts."),
    ("parameters", "Values by name, in the effect's units; the others keep their defaults."),
];

impl ModelEffect {
    /// Makes the effect, for a plant.
    ///
    /// # Errors
    /// [`ModelEffectError`] where there is no such effect, or where a parameter is unknown or out
    /// of range.
    pub fn make(&self) -> Result<Box<dyn Effect>, ModelEffectError> {
        let place = of_one_axis().find(|entry| entry.id == self.id).and_then(|entry| {
            let place = entry.sites.iter().find(|place| place.site == self.site)?;
            Some(place.size)
        });
        let mut effect = make(self.id, self.site, place.unwrap_or_default())?;
        for (name, value) in &self.parameters {
            effect.set(name, *value)?;
        }
        Ok(effect)
    }

    /// Reads one entry; `None` where it is wrong, which is reported.
    fn read(section: Section<'_>, heading: &'static str) -> Option<Self> {
        section.document(heading, KEYS);
        let ids: Vec<(&str, &'static str)> =
            of_one_axis().map(|entry| (entry.id, entry.id)).collect();
        let sites = Site::ALL.map(|site| (site.name(), site));
        let id = section.word("id", &ids);
        let site = section.word("site", &sites);
        let table = section.section("parameters");
        let any = bounds(f64::MIN, f64::MAX, "");
        let parameters = table.keys().into_iter().map(|name| {
            let value = table.number(&name, any);
            (name, value)
        });
        let parameters = parameters.collect();
        Some(Self { id: id?, site: site?, parameters })
    }

    /// Reads every entry of the list `effects` in a section; `heading` is that of an entry.
    pub(crate) fn read_all(section: &Section<'_>, heading: &'static str) -> Vec<Self> {
        let entries = section.sections("effects").into_iter();
        entries.filter_map(|entry| Self::read(entry, heading)).collect()
    }
}
