//! Effects that were added too early: what later ones, or a single other one, explain as well.

use plant::effects::Site;

use super::fit::{Fitted, View};
use super::judge::{Judged, LEAST_FIRST, LEAST_GAIN, judge};
use super::knob::Knob;
use super::machine::{Residual, Setting};
use super::round::Tried;

/// How many of the first round's others are tried alone once an effect was added.
const OTHERS: usize = 6;
/// A loss beyond this is not made good by a closer fit.
const FAR_BEHIND: f64 = 0.5;
/// A loss below this is none.
pub const AS_GOOD: f64 = 0.05;
/// How many others are tried in an effect's place, the rounds of the fit of each, and what the best
/// of them must gain.
const EXCHANGED: usize = 3;
/// See there.
const EXCHANGE_ROUNDS: usize = 2;
/// See there.
const LEAST_EXCHANGE: f64 = 0.1;
/// Beyond this, by blocks, two effects are told apart (1).
const TOLD_APART_T: f64 = 4.0;

/// An effect that the later ones made needless: its place, and the model fitted without it. The
/// newest has just been tried against nothing, and stays.
pub fn needless(
    (fit, select): (&View<'_>, &View<'_>),
    now: &Fitted,
    knobs: &[Knob],
) -> Option<(usize, Fitted, Vec<Knob>)> {
    let with = select.residuals(&now.setting)?;
    (0..now.setting.placed.len().saturating_sub(1)).find_map(|at| {
        let mut setting = now.setting.clone();
        let placed = setting.placed.remove(at);
        let left: Vec<Knob> = knobs.iter().filter_map(|knob| knob.without(at)).collect();
        let fitted = fit.fit(&setting, &left, 2)?;
        let without = select.residuals(&fitted.setting)?;
        let judged = judge((placed.id, placed.site), &without, &with);
        (judged.gain < LEAST_GAIN).then_some((at, fitted, left))
    })
}

/// One that did well in its round, but not best.
#[derive(Clone, Debug)]
pub struct Other {
    setting: Setting,
    knobs: Vec<Knob>,
}

impl Other {
    /// Whether a knob is of the effect that it would add.
    fn own(&self, knob: &Knob) -> bool {
        knob.is_of(self.setting.placed.len().saturating_sub(1))
    }

    /// `None` where it did too little.
    pub fn of(tried: &Tried) -> Option<Self> {
        let knobs = tried.knobs.iter().filter(|knob| !knob.is_base()).cloned().collect();
        (tried.judged.gain >= LEAST_FIRST)
            .then(|| Self { setting: tried.fitted.setting.clone(), knobs })
    }
}

/// A model in which another effect stands in one's place.
pub struct Exchanged {
    /// How it does beside the model before.
    pub beside: Judged,
    /// The model.
    pub fitted: Fitted,
    /// What its fit moved.
    pub knobs: Vec<Knob>,
}

/// The best of some others in the place of one of several effects: which came in first was found
/// where the later ones were missing. `None` where none does clearly better.
pub fn exchange(
    (fit, select): (&View<'_>, &View<'_>),
    now: &Fitted,
    knobs: &[Knob],
    at: usize,
    others: &[Other],
) -> Option<Exchanged> {
    let with = select.residuals(&now.setting)?;
    let one = |other: &Other| -> Option<Exchanged> {
        let placed = other.setting.placed.last()?;
        let mut setting = now.setting.clone();
        *setting.placed.get_mut(at)? = placed.clone();
        let kept = knobs.iter().filter(|knob| !knob.is_of(at)).cloned();
        let free: Vec<Knob> = kept
            .chain(other.knobs.iter().filter(|knob| other.own(knob)).map(|knob| knob.moved_to(at)))
            .collect();
        let fitted = fit.fit(&setting, &free, EXCHANGE_ROUNDS)?;
        let beside = judge((placed.id, placed.site), &with, &select.residuals(&fitted.setting)?);
        Some(Exchanged { beside, fitted, knobs: free })
    };
    let there = |other: &&Other| {
        let own = other.setting.placed.last();
        own.is_some_and(|own| {
            now.setting.placed.iter().all(|placed| (placed.id, placed.site) != (own.id, own.site))
        })
    };
    let tried = others.iter().filter(there).take(EXCHANGED).filter_map(one);
    tried
        .max_by(|a, b| a.beside.gain.total_cmp(&b.beside.gain))
        .filter(|best| best.beside.gain >= LEAST_EXCHANGE)
}

/// A model with one of the first round's others alone.
pub struct Alone {
    /// What all the effects that are there do beside it, on the selecting records.
    pub beside: Judged,
    /// The model.
    pub fitted: Fitted,
    /// What its fit moved.
    pub knobs: Vec<Knob>,
    /// What it leaves of the selecting records.
    pub selected: Vec<Residual>,
}

/// The first round's others, each alone, from the declared parameters to which the effects that
/// were added have led: the first round did not know those. The best first; those far behind are
/// left out.
pub fn alone(
    (fit, select): (&View<'_>, &View<'_>),
    now: &Fitted,
    knobs: &[Knob],
    others: &[Other],
) -> Option<Vec<Alone>> {
    let with = select.residuals(&now.setting)?;
    let one = |other: &Other| -> Option<Alone> {
        let placed = other.setting.placed.first()?;
        let mut free: Vec<Knob> = knobs.iter().filter(|knob| knob.is_base()).cloned().collect();
        free.extend(other.knobs.iter().cloned());
        let there = Setting { placed: vec![placed.clone()], ..now.setting.clone() };
        let starts = [there, other.setting.clone()].map(|start| fit.evaluate(start));
        let first =
            starts.into_iter().flatten().min_by(|a, b| a.objective.total_cmp(&b.objective))?;
        let beside = |fitted: &Fitted| {
            let selected = select.residuals(&fitted.setting)?;
            Some((judge((placed.id, placed.site), &selected, &with), selected))
        };
        let near = fit.fit(&first.setting, &free, 1)?;
        if beside(&near)?.0.gain > FAR_BEHIND {
            return None;
        }
        let fitted = fit.fit(&near.setting, &free, 2)?;
        let (beside, selected) = beside(&fitted)?;
        Some(Alone { beside, fitted, knobs: free, selected })
    };
    let mut found: Vec<Alone> = others.iter().take(OTHERS).filter_map(one).collect();
    found.sort_by(|a, b| a.beside.gain.total_cmp(&b.beside.gain));
    Some(found)
}

/// How many of some knobs are an effect's.
pub fn effect_count(knobs: &[Knob]) -> usize {
    knobs.iter().filter(|knob| !knob.is_base()).count()
}

/// Whether two effects do the same to every record: whether the volts reach the motor late or all
/// sensors show late is a matter of which clock is called right. What the records tell of them is
/// how each is computed.
fn the_same(one: (&str, Site), other: (&str, Site)) -> bool {
    let late = |(id, site): (&str, Site)| {
        id == "transport_delay" && matches!(site, Site::Drive | Site::Sensor)
    };
    late(one) && late(other)
}

/// Where an effect does the same to every record.
pub fn twin((id, site): (&str, Site)) -> Option<Site> {
    [Site::Drive, Site::Sensor]
        .into_iter()
        .find(|other| *other != site && the_same((id, site), (id, *other)))
}

/// Those of some models, at most two, that the selecting records cannot tell from one with `count`
/// parameters that leaves `selected`, `meant` by name: of models that do the same the one with the
/// fewest is meant.
pub fn rivals<'a>(
    meant: (&str, Site),
    selected: &[Residual],
    count: usize,
    models: impl Iterator<Item = &'a Alone>,
) -> Vec<(&'static str, Site)> {
    models
        .filter(|model| effect_count(&model.knobs) <= count)
        .filter(|model| {
            let beside = judge((model.beside.id, model.beside.site), &model.selected, selected);
            let same = the_same(meant, (model.beside.id, model.beside.site));
            beside.gain < AS_GOOD && beside.t.abs() < TOLD_APART_T
                || same && beside.gain < LEAST_GAIN
        })
        .map(|model| (model.beside.id, model.beside.site))
        .take(2)
        .collect()
}
