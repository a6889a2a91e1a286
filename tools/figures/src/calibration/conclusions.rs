//! Statements that are tested in every cell of the grid over what the thesis leaves open. A
//! statement fails if one cell contradicts it beyond its tolerance or has no value for it.

use super::measured_resonance_hz;
use super::sensitivity::SweepPoint;
use crate::published::published;
use anyhow::Result;

/// A statement and the cells that contradict it.
#[derive(Clone, Debug, PartialEq)]
pub struct Conclusion {
    /// Name for programs.
    pub id: &'static str,
    /// The statement.
    pub statement: String,
    /// Names of the cells that contradict it.
    pub against: Vec<String>,
    /// Smallest and largest value over the cells, and its unit.
    pub range: Option<(f64, f64, &'static str)>,
}

impl Conclusion {
    /// Whether it holds in every cell.
    pub fn survives(&self) -> bool {
        self.against.is_empty()
    }
}

/// A statement of the form "this lies within so many percent of that".
struct Within {
    id: &'static str,
    what: &'static str,
    published: &'static str,
    percent: f64,
    value: fn(&SweepPoint) -> Option<f64>,
}

const WITHIN: [Within; 6] = [
    Within {
        id: "cut_off_predicted",
        what: "With the softening fitted to the resonance, the measured cut-off is predicted",
        published: "hydrostatic.frequency_response_measured.cutoff_hz",
        percent: 20.0,
        value: |cell| cell.traced.cut_off_hz,
    },
    Within {
        id: "lag_predicted",
        what: "With the softening fitted to the resonance, the measured lag at 1 Hz is predicted",
        published: "hydrostatic.delay_measured.delay_s",
        percent: 25.0,
        value: |cell| cell.traced.lag_1hz_s,
    },
    Within {
        id: "low_frequency_gain_predicted",
        what: "With the softening fitted to the resonance, the low-frequency gain of eq. 3.3.1 is \
            predicted",
        published: "hydrostatic.linear_fit_10m.low_frequency_gain",
        percent: 10.0,
        value: |cell| cell.traced.low_frequency_gain,
    },
    Within {
        id: "short_hose_resonance_predicted",
        what: "With the softening fitted at 10 m, the natural frequency of eq. 3.3.2 at 1 m is \
            predicted",
        published: "hydrostatic.linear_fit_1m.formula_natural_hz",
        percent: 20.0,
        value: |cell| cell.traced.short_peak_hz,
    },
    Within {
        id: "short_hose_cut_off_predicted",
        what: "With the softening fitted at 10 m, the cut-off of eq. 3.3.2 at 1 m is predicted",
        published: "hydrostatic.linear_fit_1m.formula_cutoff_hz",
        percent: 20.0,
        value: |cell| cell.traced.short_cut_off_hz,
    },
    Within {
        id: "printed_lag",
        what: "The printed constants give the measured lag at 1 Hz",
        published: "hydrostatic.delay_measured.delay_s",
        percent: 25.0,
        value: |cell| cell.printed.lag_1hz_s,
    },
];

/// How far the softening may differ from cell to cell.
const FACTOR_PERCENT: f64 = 5.0;
/// How far the printed constants' peak must stay from the measured one.
const PEAK_PERCENT: f64 = 25.0;

/// All statements over the cells of a grid.
///
/// # Errors
/// Where a published value is missing from the table.
pub fn conclusions(cells: &[SweepPoint], nominal_factor: f64) -> Result<Vec<Conclusion>> {
    let resonance = measured_resonance_hz()?;
    let conclusion = |id, statement, agrees: &dyn Fn(&SweepPoint) -> bool, range| {
        let against = cells.iter().filter(|cell| !agrees(cell)).map(SweepPoint::name).collect();
        Conclusion { id, statement, against, range }
    };
    let mut all = vec![
        conclusion(
            "printed_cannot_give_8_hz",
            format!("The printed constants cannot give the measured resonance of {resonance} Hz."),
            &|cell| {
                cell.printed.peak_hz.is_some_and(|peak| deviation(peak, resonance) > PEAK_PERCENT)
            },
            range(cells, |cell| cell.printed.peak_hz, "Hz"),
        ),
        conclusion(
            "softer_line_gives_8_hz",
            format!("One softening of the line gives the measured resonance of {resonance} Hz."),
            &|cell| cell.factor.is_some(),
            None,
        ),
        conclusion(
            "softening_is_fixed",
            format!(
                "The softening is known: its factor is within {FACTOR_PERCENT} % of 1/{:.1} \
                    everywhere.",
                1.0 / nominal_factor
            ),
            &|cell| {
                cell.factor
                    .is_some_and(|factor| deviation(factor, nominal_factor) <= FACTOR_PERCENT)
            },
            range(cells, |cell| cell.factor.map(|factor| 1.0 / factor), "times softer"),
        ),
        conclusion(
            "softer_line_lags_more",
            "The softened line lags more at 1 Hz than the printed one does.".to_owned(),
            &|cell| {
                let lags = cell.printed.lag_1hz_s.zip(cell.traced.lag_1hz_s);
                lags.is_some_and(|(printed, traced)| traced > printed)
            },
            None,
        ),
    ];
    for Within { id, what, published: name, percent, value } in WITHIN {
        let row = published(name)?;
        let unit = if row.unit == "1" { String::new() } else { format!(" {}", row.unit) };
        let statement = format!("{what} ({}{unit}, within {percent} %).", row.value);
        let agrees = |cell: &SweepPoint| {
            value(cell).is_some_and(|value| deviation(value, row.value) <= percent)
        };
        all.push(conclusion(id, statement, &agrees, range(cells, value, row.unit)));
    }
    Ok(all)
}

fn deviation(value: f64, reference: f64) -> f64 {
    100.0 * (value / reference - 1.0).abs()
}

fn range(
    cells: &[SweepPoint],
    value: impl Fn(&SweepPoint) -> Option<f64>,
    unit: &'static str,
) -> Option<(f64, f64, &'static str)> {
    let values = || cells.iter().filter_map(&value);
    let (low, high) =
        (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max));
    (low <= high).then_some((low, high, unit))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::Prediction;
    use crate::calibration::sensitivity::Friction;

    fn cell(lag_1hz_s: f64) -> SweepPoint {
        let traced = Prediction { lag_1hz_s: Some(lag_1hz_s), ..Prediction::default() };
        let printed =
            Prediction { peak_hz: Some(30.0), lag_1hz_s: Some(0.002), ..Prediction::default() };
        SweepPoint {
            amplitude_deg: 1e3 * lag_1hz_s,
            friction: Friction::Printed,
            factor: Some(0.07),
            printed,
            traced,
        }
    }

    fn lag(cells: &[SweepPoint]) -> Conclusion {
        conclusions(cells, 0.07)
            .unwrap()
            .into_iter()
            .find(|conclusion| conclusion.id == "lag_predicted")
            .unwrap()
    }

    #[test]
    fn one_cell_against_a_statement_takes_it_back() {
        assert!(lag(&[cell(0.028), cell(0.033)]).survives());
        let flipped = lag(&[cell(0.028), cell(0.033), cell(0.050)]);
        assert_eq!(flipped.against, ["50deg_printed_friction"]);
        assert_eq!(flipped.range, Some((0.028, 0.050, "s")));
    }

    #[test]
    fn a_cell_that_cannot_say_is_against_it() {
        let mute = SweepPoint { traced: Prediction::default(), ..cell(0.030) };
        assert!(!lag(&[cell(0.030), mute]).survives());
    }
}
