//! Tables that the pages of all models share, and how numbers are written.

use plant::effects::Site;
use report::Table;

use crate::false_alarm::FalseAlarm;
use crate::outcome::{FoundEffect, Left, Named, Outcome};

/// Listed candidates of each round in the table.
const MOST_CANDIDATES: usize = 6;

/// The name of an effect or function that is left.
pub(crate) fn what_is_left(left: &Left) -> String {
    match &left.site {
        Some(site) => format!("{}@{site}", left.id),
        None => function_of(&left.id),
    }
}

/// The name of a nonparametric function of a variable.
fn function_of(variable: &str) -> String {
    format!("function of {}", variable.replace('_', " "))
}

/// Validation of the candidates, round by round.
pub(crate) fn ranking(outcome: &Outcome) -> Table {
    let mut table = Table::new([
        "round",
        "candidate",
        "error falls by / %",
        "block t",
        "blocks better",
        "worse",
        "result",
    ]);
    let mut shown = (0, 0);
    for c in &outcome.candidates {
        shown = if shown.0 == c.round { (c.round, shown.1 + 1) } else { (c.round, 1) };
        if shown.1 > MOST_CANDIDATES && !c.generic && !c.accepted {
            continue;
        }
        table = table.row([
            c.round.to_string(),
            if c.generic { function_of(&c.id) } else { c.id.clone() },
            format!("{:.1}", c.gain_percent),
            format!("{:.1}", c.t),
            c.blocks_better.to_string(),
            c.blocks_worse.to_string(),
            if c.accepted { "passes" } else { "no" }.to_owned(),
        ]);
    }
    table
}

/// Declared parameters and those of effects, as fitted.
pub(crate) fn parameters(outcome: &Outcome) -> Table {
    let mut table = Table::new(["parameter", "declared", "fitted", "±", "unit", "remark"]);
    let number = |v: Option<f64>| v.map_or("–".to_owned(), short);
    for p in &outcome.parameters {
        let cells = [
            p.name.clone(),
            number(p.declared),
            short(p.fitted),
            number(p.std),
            p.unit.clone(),
            p.remark(),
        ];
        table = table.row(cells);
    }
    for effect in &outcome.effects {
        for p in &effect.parameters {
            let name = format!("{}@{}: {}", effect.id, effect.site, p.name);
            table = table.row([
                name,
                "–".into(),
                short(p.value),
                number(p.std),
                p.unit.clone(),
                "effect".into(),
            ]);
        }
    }
    table
}

/// Estimates that are strongly correlated.
pub(crate) fn correlations(outcome: &Outcome) -> Table {
    let rows = outcome.correlations.iter().map(|own| {
        let [first, second] = own.parameters.clone();
        [first, second, format!("{:.2}", own.coefficient)]
    });
    Table::new(["estimate", "and", "correlation"]).rows(rows)
}

/// Four significant digits.
pub fn short(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    let digits = (3 - value.abs().log10().floor() as i32).clamp(0, 12) as usize;
    if (1e-4..1e7).contains(&value.abs()) {
        format!("{value:.digits$}")
    } else {
        format!("{value:.3e}")
    }
}

/// How probable it is that a name is a false alarm.
pub(crate) fn false_alarms(outcome: &Outcome) -> Table {
    let row = |own: &FalseAlarm| {
        [
            format!("{}@{}", own.id, own.site),
            format!("{:.1}", own.gain_percent),
            format!("{} of {}", own.as_much, own.replicates),
            own.p_value(),
        ]
    };
    let header = ["effect", "error falls by / %", "replicates with that gain", "p"];
    Table::new(header).rows(outcome.false_alarms.iter().map(row))
}

impl Named {
    /// The effect of this id at a site.
    pub(crate) fn new(id: &str, site: Site) -> Self {
        Self { id: id.to_owned(), site: site.name().to_owned() }
    }
}

impl Outcome {
    /// Effects that were added, each as `ID@SITE`.
    pub fn named(&self) -> Vec<String> {
        self.effects.iter().map(|own| format!("{}@{}", own.id, own.site)).collect()
    }

    /// How probable it is that an effect that was added is a false alarm, where it is known.
    pub(crate) fn false_alarm(&self, of: &FoundEffect) -> Option<&FalseAlarm> {
        let is = |own: &&FalseAlarm| (&own.id, &own.site) == (&of.id, &of.site);
        self.false_alarms.iter().find(is)
    }

    /// Effects that the data cannot distinguish from them, likewise.
    pub fn rivals(&self) -> Vec<String> {
        self.ambiguous_with.iter().map(|own| format!("{}@{}", own.id, own.site)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_can_be_parsed() {
        for value in [-0.36261, -1.5e-7, 2.0e9, -20.53] {
            let parsed: f64 = short(value).parse().unwrap();
            assert!((parsed / value - 1.0).abs() < 1e-3, "{}", short(value));
        }
    }
}
