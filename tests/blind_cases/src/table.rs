//! The table of a campaign: counts with Wilson's 95 % bounds, medians and percentiles, and a row
//! for each effect.

use std::collections::BTreeMap;
use std::fmt::{self, Write};

use serde::Serialize;

use crate::case::Set;
use crate::score::{End, Naming, Score};

/// A count out of a total.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Share {
    /// The count.
    pub count: usize,
    /// The total.
    pub of: usize,
    /// Wilson's 95 % bounds.
    pub bounds: [f64; 2],
}

impl Share {
    /// The share of the scores for which something holds.
    pub fn of(scores: &[&Score], holds: impl Fn(&Score) -> bool) -> Self {
        Self::new(scores.iter().filter(|score| holds(score)).count(), scores.len())
    }

    /// With its bounds.
    pub fn new(count: usize, of: usize) -> Self {
        Self { count, of, bounds: wilson(count, of) }
    }
}

impl fmt::Display for Share {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.of == 0 {
            return f.pad("none");
        }
        let percent = 100.0 * self.count as f64 / self.of as f64;
        let [low, high] = self.bounds.map(|bound| 100.0 * bound);
        f.pad(&format!("{} of {} = {percent:.1} % ({low:.1} to {high:.1} %)", self.count, self.of))
    }
}

/// Bounds of a share at 95 % (Wilson, JASA 22, 1927).
pub fn wilson(count: usize, of: usize) -> [f64; 2] {
    if of == 0 {
        return [0.0, 1.0];
    }
    let z = 1.959_963_985;
    let (n, p) = (of as f64, count as f64 / of as f64);
    let centre = p + z * z / (2.0 * n);
    let half = z * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt();
    [-1.0, 1.0].map(|sign| ((centre + sign * half) / (1.0 + z * z / n)).clamp(0.0, 1.0))
}

/// One row: quantity, requirement, result.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Set.
    pub set: &'static str,
    /// The quantity.
    pub what: String,
    /// The requirement.
    pub bar: &'static str,
    /// The result as text.
    pub found: String,
    /// The result as a share.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub share: Option<Share>,
    /// The result as a number.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub value: Option<f64>,
}

impl Row {
    /// A row with a number, if there is one.
    fn number(
        set: &'static str,
        what: &str,
        bar: &'static str,
        value: Option<f64>,
        found: String,
    ) -> Self {
        Self { set, what: what.to_owned(), bar, found, share: None, value }
    }
}

/// Results of the cases of one effect.
#[derive(Clone, Debug, Default, Serialize)]
pub struct ByEffect {
    /// Number of cases.
    pub cases: usize,
    /// Number of detectable cases.
    pub detectable: usize,
    /// Detectable cases by answer.
    pub said: BTreeMap<String, usize>,
    /// Effects that were found first instead, with their counts.
    pub instead: BTreeMap<String, usize>,
    /// Median relative error of the effective size.
    pub size_error: Option<f64>,
}

/// The whole table.
#[derive(Clone, Debug, Serialize)]
pub struct Table {
    /// Rows.
    pub rows: Vec<Row>,
    /// By effect, `ID@SITE`.
    pub by_effect: BTreeMap<String, ByEffect>,
}

/// Puts scores into a table.
pub fn table(scores: &[Score]) -> Table {
    let mut rows = Vec::new();
    let all = |set: Set| scores.iter().filter(|score| score.set == set).collect::<Vec<_>>();
    let seen =
        |set: Set| all(set).into_iter().filter(|score| score.detectable).collect::<Vec<&Score>>();
    for set in Set::ALL {
        let cases = all(set);
        if cases.is_empty() {
            continue;
        }
        let mut shares =
            vec![("a verdict at all", "", Share::of(&cases, |score| score.end == End::Done))];
        if !matches!(set, Set::Clean | Set::OneChannelClean) {
            let share = Share::of(&cases, |score| score.detectable);
            shares.push(("detectable (all rows below are of these)", "", share));
        }
        let seen = seen(set);
        // Errors are counted over the cases with an answer, so that missing answers do not improve
        // them.
        let answered: Vec<&Score> =
            seen.iter().copied().filter(|score| score.end == End::Done).collect();
        shares.extend(match set {
            Set::Listed => listed_shares(&seen, &answered),
            Set::Clean => clean_shares(&answered),
            Set::Unlisted => unlisted_shares(&seen, &answered),
            Set::Pairs => several_shares(("both named", ">= 85 %"), &seen, &answered),
            Set::OneChannelPairs => several_shares(("both named", ""), &seen, &answered),
            Set::Triples => several_shares(("all three named", ">= 60 %"), &seen, &answered),
            Set::OneChannelListed => one_channel_shares(&seen, &answered),
            Set::OneChannelClean => one_channel_clean_shares(&answered),
            Set::OneChannelUnlisted => unlisted_shares(&seen, &answered),
        });
        rows.extend(shares.into_iter().map(|(what, bar, share)| {
            let (what, found) = (what.to_owned(), share.to_string());
            Row { set: set.name(), what, bar, found, share: Some(share), value: None }
        }));
    }
    let (listed, pairs) = (seen(Set::Listed), seen(Set::Pairs));
    accuracy(&mut rows, &listed);
    let stated: Vec<&Score> = all(Set::Clean).into_iter().chain(listed.iter().copied()).collect();
    if stated.iter().any(|score| !score.normalised_errors.is_empty()) {
        for (what, bar, deviations) in [
            ("parameters within one stated deviation", "68 %", 1.0),
            ("parameters within 1.96 stated deviations", "95 %", 1.96),
        ] {
            let share = within(&stated, deviations);
            let row = Row::number("listed", what, bar, None, share.to_string());
            rows.push(Row { set: "clean, listed", share: Some(share), ..row });
        }
    }
    sizes_and_times(&mut rows, &listed, &pairs);
    Table { rows, by_effect: by_effect(scores) }
}

/// The share of the normalised errors of all scores that are at most so many stated deviations.
fn within(scores: &[&Score], deviations: f64) -> Share {
    let all = scores.iter().flat_map(|score| &score.normalised_errors);
    Share::new(all.clone().filter(|error| error.abs() <= deviations).count(), all.count())
}

/// Quantity, requirement and share of a row.
type ShareRow = (&'static str, &'static str, Share);

fn listed_shares(seen: &[&Score], answered: &[&Score]) -> Vec<ShareRow> {
    let naming = |naming: Naming| Share::of(seen, |score| score.naming == Some(naming));
    let wrong = |naming: Naming| Share::of(answered, |score| score.naming == Some(naming));
    let right =
        Share::of(seen, |score| matches!(score.naming, Some(Naming::Right | Naming::Ambiguous)));
    vec![
        ("right name first (id and site)", "", naming(Naming::Right)),
        ("ambiguous, the truth among at most two", "counted apart", naming(Naming::Ambiguous)),
        ("right or ambiguous with the truth", ">= 97 %", right),
        ("wrong name first (of those answered)", "<= 1 %", wrong(Naming::Wrong)),
        ("right id at another site (likewise)", "(in the 1 %)", wrong(Naming::WrongSite)),
        ("said to have no name", "", naming(Naming::Unlisted)),
        ("missed", "", naming(Naming::Missed)),
        ("no answer", "0", naming(Naming::NoAnswer)),
        ("named more than the one effect", "", Share::of(seen, |score| score.named.len() > 1)),
    ]
}

fn clean_shares(answered: &[&Score]) -> Vec<ShareRow> {
    let (plain, foreign): (Vec<&Score>, Vec<&Score>) =
        answered.iter().partition(|score| score.index % 2 == 0);
    let alarms = |cases: &[&Score]| Share::of(cases, |score| score.alarm);
    vec![
        ("false alarms (of those answered)", "0", alarms(answered)),
        ("... with the model's own smoothing", "0", alarms(&plain)),
        ("... with a smoothing it does not have", "0", alarms(&foreign)),
        ("... that named an effect", "0", Share::of(answered, |score| !score.named.is_empty())),
    ]
}

fn unlisted_shares(seen: &[&Score], answered: &[&Score]) -> Vec<ShareRow> {
    let named = |score: &Score| !score.named.is_empty();
    let unflagged = Share::of(answered, |score| named(score) && !score.flagged);
    let site = Share::of(seen, |score| score.site_right == Some(true));
    let variable = Share::of(seen, |score| score.variable_right == Some(true));
    vec![
        ("flagged", ">= 95 %", Share::of(seen, |score| score.flagged)),
        ("a listed name (of those answered)", "<= 5 %", Share::of(answered, named)),
        ("... and not flagged", "", unflagged),
        ("right site", ">= 85 %", site),
        ("right variable", ">= 70 %", variable),
    ]
}

fn several_shares(
    (all, bar): (&'static str, &'static str),
    seen: &[&Score],
    answered: &[&Score],
) -> Vec<ShareRow> {
    let further = Share::of(answered, Score::false_further);
    vec![
        (all, "", Share::of(seen, |score| score.both == Some(true))),
        ("... or rightly ambiguous", bar, Share::of(seen, Score::all_found_or_ambiguous)),
        ("a false further one (of those answered)", "<= 5 %", further),
        ("no answer", "0", Share::of(seen, |score| score.end != End::Done)),
    ]
}

fn one_channel_shares(seen: &[&Score], answered: &[&Score]) -> Vec<ShareRow> {
    let naming = |naming: Naming| Share::of(seen, |score| score.naming == Some(naming));
    let wrong = Share::of(answered, |score| {
        matches!(score.naming, Some(Naming::Wrong | Naming::WrongSite))
    });
    let right =
        Share::of(seen, |score| matches!(score.naming, Some(Naming::Right | Naming::Ambiguous)));
    vec![
        ("right or ambiguous with the truth", ">= 90 %", right),
        ("... of them ambiguous", "", naming(Naming::Ambiguous)),
        ("wrong name first (of those answered)", "<= 2 %", wrong),
        ("said to have no name, or inadequate", "", naming(Naming::Unlisted)),
        ("missed", "", naming(Naming::Missed)),
        ("no answer", "0", naming(Naming::NoAnswer)),
        ("named more than the one effect", "", Share::of(seen, |score| score.named.len() > 1)),
    ]
}

fn one_channel_clean_shares(answered: &[&Score]) -> Vec<ShareRow> {
    vec![
        ("false alarms (of those answered)", "0", Share::of(answered, |score| score.alarm)),
        ("... that named an effect", "0", Share::of(answered, |score| !score.named.is_empty())),
    ]
}

fn accuracy(rows: &mut Vec<Row>, listed: &[&Score]) {
    let number = |what, bar, value, found| Row::number("listed", what, bar, value, found);
    let plain = |value: f64| format!("{value:.3}");
    // A case without an answer or without a noise floor counts as beyond all that have a number.
    let over: Vec<Option<f64>> =
        listed.iter().map(|score| score.over_floor.filter(|ratio| ratio.is_finite())).collect();
    if !over.is_empty() {
        let without = over.iter().filter(|ratio| ratio.is_none()).count();
        let missing = if without > 0 {
            format!(", {without} of them without an answer or a floor")
        } else {
            String::new()
        };
        let within =
            Share::new(over.iter().flatten().filter(|ratio| **ratio <= 1.4).count(), over.len());
        let found = format!("{within}{missing}");
        let row = number("error at most 1.4 repeat floors", ">= 90 %", None, found);
        rows.push(Row { share: Some(within), ..row });
        let p90 = quantile_of_all(&over, 0.9);
        let text = of_all(p90, &over, &plain);
        rows.push(number("error over floor, 90th percentile", "<= 1.4", p90, text));
    }
    let drops: Vec<f64> = listed.iter().filter_map(|score| score.drop).collect();
    let median = quantile(&drops, 0.5);
    rows.push(number("drop of the error, median", ">= 10 times", median, or_none(median, &plain)));
    let from_file: Vec<f64> = listed.iter().filter_map(|score| score.drop_from_file).collect();
    if let Some(median) = quantile(&from_file, 0.5) {
        let what = "drop from what the rig file leaves as it is, median";
        rows.push(number(what, "", Some(median), plain(median)));
    }
}

fn sizes_and_times(rows: &mut Vec<Row>, listed: &[&Score], pairs: &[&Score]) {
    let percent = |value: f64| format!("{:.2} %", 100.0 * value);
    let first = |errors: &[f64]| errors.first().copied().filter(|error| error.is_finite());
    // One effect per case: the size of another effect says nothing about this one.
    let sizes: Vec<Option<f64>> = listed.iter().map(|score| first(&score.size_errors)).collect();
    let raw: Vec<Option<f64>> = listed.iter().map(|score| first(&score.raw_size_errors)).collect();
    for (what, bar, values, at) in [
        ("error of the effective size, median", "<= 1 %", &sizes, 0.5),
        ("error of the effective size, 90th percentile", "<= 6 %", &sizes, 0.9),
        ("error of the raw first parameter, median", "", &raw, 0.5),
        ("error of the raw first parameter, 90th percentile", "", &raw, 0.9),
    ] {
        let value = quantile_of_all(values, at);
        rows.push(Row::number("listed", what, bar, value, of_all(value, values, &percent)));
    }
    let named: Vec<f64> = sizes.iter().flatten().copied().collect();
    for (what, at) in [
        ("... of those rightly named, median", 0.5),
        ("... of those rightly named, 90th percentile", 0.9),
    ] {
        let value = quantile(&named, at);
        let found = format!("{} (n = {})", or_none(value, &percent), named.len());
        rows.push(Row::number("listed", what, "", value, found));
    }
    for (set, cases) in [("listed", listed), ("pairs", pairs)] {
        let ended = cases.iter().filter(|score| score.end != End::Failed);
        let seconds: Vec<f64> = ended.map(|score| score.seconds).collect();
        for (what, bar, at) in [
            ("time of a case, median, late ones at the limit (s)", "<= 15 s", 0.5),
            ("time of a case, 95th percentile, likewise (s)", "<= 60 s", 0.95),
        ] {
            let value = quantile(&seconds, at);
            let found = or_none(value, &|value| format!("{value:.1}"));
            rows.push(Row::number(set, what, bar, value, found));
        }
    }
}

/// A value as text.
fn or_none(value: Option<f64>, text: &dyn Fn(f64) -> String) -> String {
    value.map_or_else(|| "none".to_owned(), text)
}

fn by_effect(scores: &[Score]) -> BTreeMap<String, ByEffect> {
    let mut rows: BTreeMap<String, ByEffect> = BTreeMap::new();
    let mut sizes: BTreeMap<String, Vec<f64>> = BTreeMap::new();
    for score in scores.iter().filter(|score| score.truth.len() == 1) {
        let row = rows.entry(score.truth[0].clone()).or_default();
        row.cases += 1;
        if !score.detectable {
            continue;
        }
        row.detectable += 1;
        let said = score.naming.map_or_else(String::new, |naming| format!("{naming:?}"));
        *row.said.entry(said).or_default() += 1;
        if let (Some(Naming::Wrong | Naming::WrongSite | Naming::Ambiguous), Some(first)) =
            (score.naming, score.named.first())
        {
            // The right effect at the wrong place within its site.
            let elsewhere = score.naming == Some(Naming::WrongSite) && *first == score.truth[0];
            let shown = if elsewhere { format!("{first}, elsewhere") } else { first.clone() };
            *row.instead.entry(shown).or_default() += 1;
        }
        sizes.entry(score.truth[0].clone()).or_default().extend(&score.size_errors);
    }
    for (name, row) in &mut rows {
        row.size_error = sizes.get(name).and_then(|sizes| quantile(sizes, 0.5));
    }
    rows
}

/// A quantile over all cases as text, with the number of cases and of those without a value.
fn of_all(quantile: Option<f64>, values: &[Option<f64>], text: &dyn Fn(f64) -> String) -> String {
    let without = values.iter().filter(|value| value.is_none()).count();
    let missing = if without == 0 { String::new() } else { format!(", {without} of them without") };
    // If it falls on a missing value, it has no bound.
    let shown = match quantile {
        Some(value) => text(value),
        None if values.is_empty() => "none".to_owned(),
        None => "no bound".to_owned(),
    };
    format!("{shown} (n = {}{missing})", values.len())
}

/// [`quantile`] over all cases, with missing values ranked last; `None` if it falls on one of them.
fn quantile_of_all(values: &[Option<f64>], share: f64) -> Option<f64> {
    let mut sorted: Vec<f64> = values.iter().map(|value| value.unwrap_or(f64::INFINITY)).collect();
    sorted.sort_by(f64::total_cmp);
    between(&sorted, share).filter(|value| value.is_finite())
}

/// The value below which a share of the values lies, linearly interpolated.
pub fn quantile(values: &[f64], share: f64) -> Option<f64> {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|value| value.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    between(&sorted, share)
}

/// A quantile of sorted values, linearly interpolated.
fn between(sorted: &[f64], share: f64) -> Option<f64> {
    let place = share * sorted.len().checked_sub(1)? as f64;
    let (low, part) = (place.floor() as usize, place - place.floor());
    // Without a step toward the neighbour, which may be infinite.
    if part == 0.0 {
        return Some(sorted[low]);
    }
    let high = (low + 1).min(sorted.len() - 1);
    Some(sorted[low] + part * (sorted[high] - sorted[low]))
}

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let widest = self.rows.iter().map(|row| row.what.chars().count()).max().unwrap_or(0);
        let mut set = "";
        for row in &self.rows {
            let shown = if row.set == set { "" } else { row.set };
            set = row.set;
            writeln!(f, "{shown:20} {:widest$}  {:14} {}", row.what, row.bar, row.found)?;
        }
        writeln!(f)?;
        for (name, row) in &self.by_effect {
            let mut text =
                format!("{name:36} {:3} cases, {:3} detectable", row.cases, row.detectable);
            for (said, count) in &row.said {
                write!(text, ", {count} {said}")?;
            }
            if let Some(error) = row.size_error {
                write!(text, ", size off by {:.2} %", 100.0 * error)?;
            }
            for (instead, count) in &row.instead {
                write!(text, "; {instead} x{count}")?;
            }
            writeln!(f, "{text}")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_as_published() {
        // Newcombe, Statistics in Medicine 17 (1998), table I, method 3: 81 of 263 and 0 of 20.
        let [low, high] = wilson(81, 263);
        assert!((low - 0.2553).abs() < 1e-4 && (high - 0.3662).abs() < 1e-4, "{low} {high}");
        let [low, high] = wilson(0, 20);
        assert!(low == 0.0 && (high - 0.1611).abs() < 1e-4, "{high}");
    }

    #[test]
    fn quantiles() {
        assert_eq!(quantile(&[3.0, 1.0, 2.0], 0.5), Some(2.0));
        assert_eq!(quantile(&[0.0, 10.0], 0.9), Some(9.0));
        assert_eq!(quantile(&[], 0.5), None);
    }

    #[test]
    fn missing_values_rank_behind_all_others() {
        let nine = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9].map(Some);
        assert_eq!(quantile_of_all(&nine, 0.5), Some(0.5));
        let all = [&nine[..], &[None, None]].concat();
        assert_eq!(quantile_of_all(&all, 0.5), Some(0.6));
        assert_eq!(quantile_of_all(&all, 0.9), None, "two of eleven are more than a tenth");
        let text = |value: f64| value.to_string();
        assert_eq!(of_all(Some(0.6), &all, &text), "0.6 (n = 11, 2 of them without)");
        assert_eq!(of_all(None, &all, &text), "no bound (n = 11, 2 of them without)");
        assert_eq!(of_all(Some(0.5), &nine, &text), "0.5 (n = 9)");
        assert_eq!(quantile_of_all(&[None], 0.5), None);
    }
}
