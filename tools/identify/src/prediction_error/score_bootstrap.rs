//! Score bootstrap: how probable it is that chance alone gives a candidate so large a gain.
//!
//! A bootstrap of the whole selection ([`super::parametric_bootstrap`]) takes a search for each
//! replicate. Here the search is linearised at the model without the effect in question: every
//! starting point of every candidate is simulated once, on the fitting and the selecting records.
//! A replicate is what the final model leaves, resampled record by record, and an error of the
//! model: no model is exact, and a machine whose friction is not quite as the model has it gives
//! gains that noise alone does not. In each, the parameters and the size of every candidate are
//! fitted by least squares, the foremost candidates by fit are validated on the selecting records
//! with the statistic of the search, and the largest gain counts, whether the candidate would have
//! passed or not.

use std::collections::BTreeSet;

use nalgebra::DVector;
use plant::effects::Site;
use rand::{Rng, RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;

use super::candidates::Candidate;
use super::dataset::{Dataset, Fitted};
use super::linearised_model::{LinearFits, LinearisedModel};
use super::null_gains::NullGains;
use super::resampled_noise::{ResampledNoise, plus};
use super::search::candidates_beside;
use super::selection_round::REFITTED;
use super::transmission_model::{PlacedEffect, Residual, Setting};
use super::validation::{gain_over_octaves, validate_in_sum};

/// Largest multiple of a starting point that stands for an error of the model.
const MOST_OF_START: f64 = 3.0;
/// A change of which a refit leaves a smaller share than this stands for no error of the model: the
/// parameters take it.
const LEAST_LEFT: f64 = 1e-4;

/// How replicates are drawn, and which gain counts.
#[derive(Clone, Copy, Debug)]
pub struct Replicates {
    /// Number of replicates.
    pub count: usize,
    /// Seed of the draws.
    pub seed: u64,
    /// Largest share by which the model, being inexact, increases the rms error.
    pub model_error: f64,
    /// Whether the gain is the mean over octaves of frequency, not that of the sum.
    pub over_octaves: bool,
}

/// Gains by chance of the candidates beside the model `null`, where what the model `last` leaves is
/// noise. `None` if one of them cannot be simulated, or after the deadline.
pub fn score_bootstrap(
    (fit, select): (&Dataset<'_>, &Dataset<'_>),
    null: &Fitted,
    last: &Setting,
    replicates: Replicates,
) -> Option<NullGains> {
    let candidates = candidates_beside(fit, null);
    let generator = &mut Pcg64Mcg::seed_from_u64(replicates.seed ^ 0x0073_636f_7265);
    let noise = [fit, select]
        .map(|dataset| ResampledNoise::new(dataset.residuals(last)?, replicates.count, generator));
    let [of_fit, of_select] = noise;
    let (of_fit, of_select) = (of_fit?, of_select?);
    let weights = of_fit.weights();
    let selected = select.evaluate(null.setting.clone())?;
    let equal: Vec<Vec<f64>> =
        selected.residuals.iter().map(|own| vec![1.0; own.channels.len()]).collect();
    let model =
        LinearisedModel::at((fit, select), (null, &selected), [weights.as_slice(), &equal])?;
    let mut search = LinearisedSearch {
        model,
        starts: starts_of(&candidates, null),
        fit: Records::new(fit, &null.residuals, weights, of_fit),
        select: Records::new(select, &selected.residuals, equal, of_select),
        beside: null.setting.placed.len(),
    };
    search.add_model_errors(replicates, generator);
    let gains = search.gains(replicates)?;
    (!fit.deadline.has_passed()).then_some(gains)
}

/// A starting point of a candidate.
struct Start<'a> {
    candidate: usize,
    of: &'a Candidate,
    /// One setting, or two of an effect with amplitude and phase.
    settings: Vec<Setting>,
}

/// The starting points of candidates beside a model, one candidate after another.
fn starts_of<'a>(candidates: &'a [Candidate], null: &Fitted) -> Vec<Start<'a>> {
    let with = |placed: &PlacedEffect| null.setting.with(placed);
    let of = |(candidate, of): (usize, &'a Candidate)| {
        of.starts.iter().map(move |start| {
            let quadrature = of.quadrature(start);
            let settings = std::iter::once(start).chain(&quadrature).map(with).collect();
            Start { candidate, of, settings }
        })
    };
    candidates.iter().enumerate().flat_map(of).collect()
}

/// Some records with the model's residuals, and replicates of their noise.
struct Records<'a> {
    dataset: &'a Dataset<'a>,
    weights: Vec<Vec<f64>>,
    /// Weighted residual of the model, stacked.
    here: DVector<f64>,
    noise: ResampledNoise,
}

impl<'a> Records<'a> {
    fn new(
        dataset: &'a Dataset<'a>,
        residuals: &[Residual],
        weights: Vec<Vec<f64>>,
        noise: ResampledNoise,
    ) -> Self {
        let here = Dataset::stack(residuals, &weights);
        Self { dataset, weights, here, noise }
    }

    /// The change of the weighted residual by a setting; `None` if it cannot be simulated, or after
    /// the deadline.
    fn change(&self, setting: &Setting) -> Option<DVector<f64>> {
        if self.dataset.deadline.has_passed() {
            return None;
        }
        Some(Dataset::stack(&self.dataset.residuals(setting)?, &self.weights) - &self.here)
    }

    fn changes(&self, start: &Start<'_>) -> Option<Vec<DVector<f64>>> {
        start.settings.iter().map(|setting| self.change(setting)).collect()
    }
}

/// One round of the search, linearised at a model.
struct LinearisedSearch<'a> {
    model: LinearisedModel,
    starts: Vec<Start<'a>>,
    fit: Records<'a>,
    select: Records<'a>,
    /// Number of effects in the model.
    beside: usize,
}

impl LinearisedSearch<'_> {
    /// Adds to every replicate what an error of the model may look like: an effect that is too
    /// small for a name. It increases the rms error by a random share after a refit.
    fn add_model_errors(&mut self, replicates: Replicates, generator: &mut impl Rng) {
        let of_candidates = self.starts.chunk_by(|a, b| a.candidate == b.candidate);
        let one_of_each: Vec<&Setting> = of_candidates
            .filter_map(|own| own[generator.random_range(0..own.len())].settings.first())
            .collect();
        let error = |setting| {
            let (of_fit, of_select) = (self.fit.change(setting)?, self.select.change(setting)?);
            let left = self.model.left_of(&of_fit);
            // A share η of the rms is 2η of the sum of squares, which is the number of rows.
            let size = (2.0 * of_fit.len() as f64 / left).sqrt();
            (left > LEAST_LEFT * of_fit.norm_squared()).then_some((size, (of_fit, of_select)))
        };
        let errors: Vec<_> = one_of_each.into_par_iter().filter_map(error).collect();
        if errors.is_empty() {
            return;
        }
        let (sizes, changes): (Vec<f64>, Vec<_>) = errors.into_iter().unzip();
        let (of_fit, of_select): (Vec<_>, Vec<_>) = changes.into_iter().unzip();
        let draw = |_| {
            let error = generator.random_range(0..sizes.len());
            let share: f64 = replicates.model_error * generator.random::<f64>();
            let sign = if generator.random::<bool>() { 1.0 } else { -1.0 };
            (error, sign * (share.sqrt() * sizes[error]).min(MOST_OF_START))
        };
        let draws: Vec<(usize, f64)> = (0..replicates.count).map(draw).collect();
        self.fit.noise.add_errors(of_fit, draws.clone());
        self.select.noise.add_errors(of_select, draws);
    }

    /// The largest gain in every replicate.
    fn gains(&self, replicates: Replicates) -> Option<NullGains> {
        let (noise, weights) = (&self.fit.noise, &self.fit.weights);
        let fit = |start: &Start<'_>| {
            let changes = self.fit.changes(start)?;
            self.model.fit_effect(noise, weights, &changes, start.of.factor_limits())
        };
        let fits: Vec<Option<LinearFits>> = self.starts.par_iter().map(fit).collect();
        let replicate = |own: usize| self.foremost(&fits, own);
        let foremost: Vec<Vec<usize>> =
            (0..replicates.count).into_par_iter().map(replicate).collect();
        let used: BTreeSet<usize> = foremost.iter().flatten().copied().collect();
        let on_selected = |index: usize| {
            let fits = fits[index].as_ref().filter(|_| used.contains(&index))?;
            Some(self.model.on_selected(fits, &self.select.changes(&self.starts[index])?))
        };
        let selected: Vec<Option<Vec<DVector<f64>>>> =
            (0..self.starts.len()).into_par_iter().map(on_selected).collect();
        let refits = self.model.refits(noise, weights)?;
        let gain = |replicate: usize| {
            let refitted = self.model.refitted(&refits.column(replicate).into_owned());
            let before = plus(self.select.noise.replicate(replicate), &[(1.0, &refitted)]);
            let of = |index: &usize| {
                let (factors, changes) = (fits[*index].as_ref()?, selected[*index].as_ref()?);
                let factors = factors.factors[replicate].iter().copied();
                let added: Vec<(f64, &DVector<f64>)> = factors.zip(changes).collect();
                let named = (self.starts[*index].of.id, self.starts[*index].of.site);
                let after = plus(before.clone(), &added);
                Some(self.gain(named, (&before, &after), replicates.over_octaves))
            };
            foremost[replicate].iter().filter_map(of).fold(0.0, f64::max)
        };
        Some(NullGains((0..replicates.count).into_par_iter().map(gain).collect()))
    }

    /// The best starting points of the foremost candidates by fit in a replicate.
    fn foremost(&self, fits: &[Option<LinearFits>], replicate: usize) -> Vec<usize> {
        let mut best: Vec<(usize, usize, f64)> = Vec::new();
        for (index, (start, fits)) in self.starts.iter().zip(fits).enumerate() {
            let Some(fits) = fits else { continue };
            let own = (start.candidate, index, fits.decreases[replicate]);
            match best.last_mut().filter(|known| known.0 == own.0) {
                Some(known) if known.2 >= own.2 => {}
                Some(known) => *known = own,
                None => best.push(own),
            }
        }
        best.sort_by(|a, b| b.2.total_cmp(&a.2));
        best.into_iter().take(REFITTED).map(|(_, index, _)| index).collect()
    }

    /// The gain of an effect beside those of the model.
    fn gain(
        &self,
        named: (&'static str, Site),
        (before, after): (&[Residual], &[Residual]),
        over_octaves: bool,
    ) -> f64 {
        match over_octaves {
            true => gain_over_octaves(before, after).unwrap_or(0.0),
            false => validate_in_sum(self.beside, named, before, after).gain,
        }
    }
}
