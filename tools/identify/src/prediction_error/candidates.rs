//! The listed effects as candidates of the stepwise selection. How each is searched, the plant
//! declares with the effect ([`plant::effects::search`]).

use std::f64::consts::FRAC_PI_2;

use plant::effects::search::{MultiStart, PHASE, RecordFeatures, SearchRange, SearchSpace};
use plant::effects::{Entry, LIST, Place, Site};

use super::free_parameter::FreeParameter;
use super::transmission_model::PlacedEffect;

/// A listed effect at one site.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidate {
    /// Its id.
    pub id: &'static str,
    /// Where.
    pub site: Site,
    /// Its free parameters.
    pub free: Vec<SearchRange>,
    /// How many of a starting point's leading values scale with the effect's size.
    pub sizes: usize,
    /// Whether the fit converges from some starting points only, which no score predicts.
    pub multi_start: Option<MultiStart>,
    /// Name and bound of the amplitude of an effect with amplitude and phase; the fit varies its
    /// sine and cosine parts.
    pub phasor: Option<(&'static str, f64)>,
    /// Whether the size may change its sign.
    pub signed: bool,
    /// Starting points: the effect with all its parameters.
    pub starts: Vec<PlacedEffect>,
}

/// The free parameters of the effect at index `placed`.
pub fn free_parameters_of(candidate: &Candidate, placed: usize) -> Vec<FreeParameter> {
    let free = candidate.free.iter().map(|range| FreeParameter::Effect { placed, range: *range });
    let waves = candidate.phasor.iter().flat_map(|(name, most)| {
        [0, 1].map(|part| FreeParameter::Phasor { placed, name, most: *most, part })
    });
    free.chain(waves).collect()
}

/// Returns all listed effects at all their sites that records with these features can reveal.
pub fn candidates(features: &RecordFeatures) -> Vec<Candidate> {
    LIST.iter()
        .flat_map(|entry| entry.sites.iter().map(|place| candidate(entry, place, features)))
        .filter(|candidate| !candidate.starts.is_empty())
        .filter(|candidate| features.slave || candidate.site != Site::Slave)
        .collect()
}

fn candidate(entry: &Entry, place: &Place, features: &RecordFeatures) -> Candidate {
    let SearchSpace { free, sizes, multi_start, phasor, signed, starts } =
        entry.search_space(place, features);
    let (id, site) = (entry.id, place.site);
    let starts = starts.into_iter().map(|values| PlacedEffect { id, site, values }).collect();
    Candidate { id, site, free, sizes, multi_start, phasor, signed, starts }
}

impl Candidate {
    /// A starting point shifted by a quarter period, for effects with amplitude and phase.
    pub fn quadrature(&self, start: &PlacedEffect) -> Option<PlacedEffect> {
        self.phasor?;
        let mut shifted = start.clone();
        shifted.values.iter_mut().filter(|(name, _)| *name == PHASE).for_each(|value| {
            value.1 = FRAC_PI_2;
        });
        Some(shifted)
    }

    /// Limits of the factor by which a linear prediction may scale a starting point.
    pub(super) const fn factor_limits(&self) -> (f64, f64) {
        if self.signed { (-3.0, 3.0) } else { (0.0, 2.0) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Features of records in which every effect of the list can show.
    fn features() -> RecordFeatures {
        RecordFeatures {
            step_s: 2e-3,
            volts: 10.0,
            lines_hz: [vec![7.0], vec![7.0]],
            hum_hz: vec![50.0],
            torque: true,
            hand: true,
            slave: true,
            other_axes: vec![1, 2],
            ..RecordFeatures::default()
        }
    }

    #[test]
    fn every_listed_effect_is_searched_at_each_of_its_sites() {
        let searched = candidates(&features());
        let listed = LIST.iter().flat_map(|entry| entry.sites.iter().map(move |at| (entry, at)));
        let searched_at_all =
            |entry: &Entry| !entry.sites.is_empty() || entry.one_channel.is_some();
        assert!(LIST.iter().all(searched_at_all));
        for (entry, place) in listed {
            let own = searched.iter().find(|own| (own.id, own.site) == (entry.id, place.site));
            let own = own.unwrap_or_else(|| {
                panic!("identify does not search {} at {}", entry.id, place.site);
            });
            for start in &own.starts {
                assert!(start.effect().is_some(), "{start:?} is no valid effect");
            }
            let names = |name: &str| own.starts[0].effect().unwrap().get(name).is_some();
            assert!(own.free.iter().all(|free| names(free.name)), "{own:?}");
            let becomes = entry.search.becomes;
            assert!(
                becomes.is_none_or(|simpler| names(simpler.parameter)
                    && LIST.iter().any(|entry| entry.id == simpler.id)),
                "{own:?}"
            );
            assert!(entry.search.choice.is_none_or(|choice| names(choice.parameter)), "{own:?}");
        }
    }
}
