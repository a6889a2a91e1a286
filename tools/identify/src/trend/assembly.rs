//! From the fits of all recordings to the trend of each parameter and the machine's verdict.

use std::ops::Range;

use rig::Model as Declared;

use super::change_points::FEWEST;
use super::fits::RecordingFit;
use super::folder::{LeftOut, date, date_and_time, days};
use super::quantity::{History, Level, history};
use super::result::{
    Change, DAYS_PER_MONTH, Estimate, FALSE_ALARM, ParameterTrend, RecordingEntry, Standing, Told,
    Trend, Verdict,
};
use super::sentences::sentences;
use super::statistics::{Point, median};
use crate::outcome::{FittedParameter, FoundEffect};

/// Standard deviations of a recording within which today's value agrees with the declared one.
const AGREES: f64 = 2.0;
/// Error with the values of the rig file over that with fitted ones, up to which they describe the
/// recordings as well. Simulated machines as declared had 1.03 to 1.04, and one whose motor
/// friction was 18 % higher 2.2.
const AS_GOOD: f64 = 1.2;
/// Standard deviation of a parameter of which only the tolerance is known, in half-widths of it.
const UNIFORM: f64 = 0.577;

/// The trend of fits in the order of their recordings; `declared` is the model of the rig file.
pub fn trend(declared: &Declared, fits: &[RecordingFit], left_out: Vec<LeftOut>) -> Trend {
    let first_s = fits.first().and_then(|fit| fit.began_s);
    let time = |(index, fit): (usize, &RecordingFit)| match (first_s, fit.began_s) {
        (Some(first_s), Some(began_s)) => days(first_s, began_s),
        _ => index as f64,
    };
    let recordings: Vec<RecordingEntry> =
        fits.iter().enumerate().map(|own| entry(own.1, time(own))).collect();
    let told: Vec<(&FittedParameter, f64, Vec<Told>)> = declared_of(fits, declared)
        .map(|(parameter, tolerance)| {
            (parameter, tolerance, told_of(&parameter.name, tolerance, fits))
        })
        .collect();
    let examined = told.iter().filter(|(.., told)| told.len() >= FEWEST).count();
    let probability = FALSE_ALARM / examined.max(1) as f64;
    let mut parameters: Vec<ParameterTrend> = told
        .into_iter()
        .map(|(parameter, tolerance, told)| {
            let point = |told: &Told| Point {
                time: recordings[told.recording].time,
                value: told.value,
                deviation: told.std,
            };
            let history = history(&told.iter().map(point).collect::<Vec<_>>(), probability);
            let changes = changes(&history, &told, fits);
            trend_of(parameter, tolerance, &history, (told, changes), first_s.is_some())
        })
        .collect();
    let stretches = stretches(&parameters, &recordings);
    let ratios: Vec<Option<f64>> =
        stretches.iter().map(|stretch| error_ratio(&recordings[stretch.clone()])).collect();
    let as_good = ratios.iter().flatten().any(|ratio| *ratio <= AS_GOOD);
    let unmoved =
        parameters.iter_mut().filter(|own| own.standing == Standing::AtBound && !own.has_changed());
    unmoved.filter(|_| as_good).for_each(|own| own.standing = Standing::Indifferent);
    let mut trend = Trend {
        verdict: verdict(&parameters),
        sentence: String::new(),
        details: Vec::new(),
        dated: first_s.is_some(),
        false_alarm_probability: FALSE_ALARM,
        error_ratio: ratios.last().copied().flatten(),
        since_last_change: stretches.last().map_or(0, ExactSizeIterator::len),
        parameters,
        recordings,
        left_out,
        seconds: 0.0,
    };
    (trend.sentence, trend.details) = sentences(&trend);
    trend
}

/// The recordings between changes of any parameter.
fn stretches(parameters: &[ParameterTrend], recordings: &[RecordingEntry]) -> Vec<Range<usize>> {
    let index = |file: &str| recordings.iter().position(|own| own.file == file);
    let since = parameters.iter().flat_map(|own| &own.changes).filter_map(|own| index(&own.since));
    let mut ends: Vec<usize> = since.chain([0, recordings.len()]).collect();
    ends.sort_unstable();
    ends.dedup();
    ends.windows(2).map(|pair| pair[0]..pair[1]).collect()
}

/// Median of the recordings' errors with declared values over those with fitted ones.
fn error_ratio(recordings: &[RecordingEntry]) -> Option<f64> {
    let of_recording = |own: &RecordingEntry| {
        let logarithms: Option<Vec<f64>> =
            own.error.values().map(|own| Some((own.declared? / own.before).ln())).collect();
        let logarithms = logarithms.filter(|own| !own.is_empty())?;
        Some((logarithms.iter().sum::<f64>() / logarithms.len() as f64).exp())
    };
    median(recordings.iter().filter_map(of_recording).filter(|ratio| ratio.is_finite()))
}

fn verdict(parameters: &[ParameterTrend]) -> Verdict {
    let any = |is: &dyn Fn(&ParameterTrend) -> bool| parameters.iter().any(is);
    if any(&|own| own.standing == Standing::AtBound) {
        Verdict::Outside
    } else if any(&|own| own.has_changed()) {
        Verdict::Changed
    } else if any(&|own| own.standing != Standing::Unknown) {
        Verdict::Same
    } else {
        Verdict::Unknown
    }
}

fn entry(fit: &RecordingFit, time: f64) -> RecordingEntry {
    let named = |effects: &Vec<FoundEffect>| {
        effects.iter().map(|own| format!("{}@{}", own.id, own.site)).collect()
    };
    RecordingEntry {
        file: fit.file.clone(),
        began: fit.began_s.map(date_and_time),
        time,
        error: fit.error.clone(),
        effects: fit.effects.as_ref().map(named),
        sentence: fit.sentence.clone(),
        seconds: fit.seconds,
    }
}

/// The declared parameters of the fits, with the half-widths of their tolerances.
fn declared_of<'a>(
    fits: &'a [RecordingFit],
    declared: &'a Declared,
) -> impl Iterator<Item = (&'a FittedParameter, f64)> {
    let most = fits.iter().max_by_key(|fit| fit.parameters.len());
    let parameters = most.map_or(&[][..], |fit| &fit.parameters);
    parameters.iter().filter_map(|own| {
        let spread = declared.parameter(&own.name).map(rig::Parameter::spread);
        Some((own, spread.filter(|spread| own.declared.is_some() && *spread > 0.0)?))
    })
}

/// What the recordings tell of a parameter. At the bound of its tolerance the value counts with the
/// typical error of the others: a parameter that left its tolerance stays visible as a change.
fn told_of(name: &str, tolerance: f64, fits: &[RecordingFit]) -> Vec<Told> {
    let own = |fit: &RecordingFit| fit.parameters.iter().find(|own| own.name == name).cloned();
    let told: Vec<(usize, FittedParameter)> = fits
        .iter()
        .enumerate()
        .filter_map(|(recording, fit)| Some((recording, own(fit)?)))
        .filter(|(_, own)| own.at_tolerance || own.identifiable)
        .collect();
    let known = |own: &FittedParameter| own.std.filter(|std| std.is_finite() && *std > 0.0);
    let typical = median(told.iter().filter_map(|(_, own)| known(own)));
    let typical = typical.unwrap_or(UNIFORM * tolerance);
    told.into_iter()
        .map(|(recording, own)| Told {
            recording,
            value: own.fitted,
            std: known(&own).unwrap_or(typical),
            at_bound: own.at_tolerance,
        })
        .collect()
}

fn changes(history: &History, told: &[Told], fits: &[RecordingFit]) -> Vec<Change> {
    let pairs = history.levels.windows(2);
    let change = |pair: &[Level]| {
        let (before, after) = (&pair[0], &pair[1]);
        let [last, first] = [after.from - 1, after.from].map(|point| &fits[told[point].recording]);
        let estimate =
            |level: &Level| Estimate { value: level.mean.value, std: level.mean.deviation };
        Change {
            after: last.file.clone(),
            since: first.file.clone(),
            between: last.began_s.zip(first.began_s).map(|(a, b)| [date(a), date(b)]),
            from: estimate(before),
            to: estimate(after),
            recordings_before: before.to - before.from,
            recordings_after: after.to - after.from,
        }
    };
    pairs.map(change).collect()
}

fn trend_of(
    parameter: &FittedParameter,
    tolerance: f64,
    history: &History,
    (told, changes): (Vec<Told>, Vec<Change>),
    dated: bool,
) -> ParameterTrend {
    let declared = parameter.declared.unwrap_or(f64::NAN);
    let today = history.today.map(|(value, std)| Estimate { value, std });
    let since = history.levels.last().map_or(0, |level| level.from);
    let latest = &told[since.min(told.len())..];
    let at_bound = latest.iter().filter(|own| own.at_bound).count();
    let standing = match today {
        None => Standing::Unknown,
        Some(_) if 2 * at_bound > latest.len() => Standing::AtBound,
        // Errors that all recordings share do not become smaller with their number.
        Some(own) if (own.value - declared).abs() <= AGREES * own.std.max(history.typical) => {
            Standing::Agrees
        }
        Some(_) => Standing::WithinTolerance,
    };
    let unit = if dated { DAYS_PER_MONTH } else { 1.0 };
    ParameterTrend {
        name: parameter.name.clone(),
        unit: parameter.unit.clone(),
        declared,
        tolerance,
        movement: history.movement,
        mean: history.mean.map(|own| Estimate { value: own.value, std: own.deviation }),
        overdispersion: history.mean.filter(|_| told.len() > 1).map(|own| own.overdispersion),
        drift: history
            .drift
            .map(|own| Estimate { value: unit * own.slope, std: unit * own.deviation }),
        changes,
        today,
        typical_std: Some(history.typical).filter(|typical| typical.is_finite()),
        standing,
        told,
    }
}
