//! Rows of the calibration: the fit, the grid, the alternative explanations, the conclusions.

use std::fmt::Display;

use super::Calibration;
use super::alternatives::{Alternative, Read};
use super::conclusions::Conclusion;
use super::sensitivity::SweepPoint;
use crate::table_row::{Role, Row};
use anyhow::Result;

/// Figure to which these rows belong: the measured response.
const FIGURE: &str = "5.7";

fn own(name: impl Display, unit: &str, ours: [Option<f64>; 2]) -> Row {
    Row::own(format!("own.{name}"), FIGURE, unit, ours)
}

/// What a value has to do with the fit to the measured resonance.
fn role(name: &str) -> Role {
    let fitted = ["line_stiffness_factor", "peak_hz"].contains(&name);
    if fitted { Role::Fitted } else { Role::Predicted }
}

/// All rows of the calibration.
///
/// # Errors
/// Where a published value is missing from the table.
pub fn rows(
    calibration: &Calibration,
    cells: &[SweepPoint],
    alternatives: &[Alternative],
    conclusions: &[Conclusion],
) -> Result<Vec<Row>> {
    let difference = [None, Some(calibration.misprint_difference)];
    let mut rows = vec![
        own("line_stiffness_factor", "1", [Some(1.0), Some(calibration.factor)])
            .role(Role::Fitted)
            .note(
                "fitted to the measured resonance alone; effect line_compliance of size 1/factor - \
                    1",
            ),
        own("misprinted_bulk_modulus.largest_gain_difference", "1", difference).note(
            "line_compliance against a bulk modulus smaller by the same factor, 0.2 to 24 Hz: the \
                numbers cannot separate them",
        ),
    ];
    let by = calibration.softening_as();
    let each = [
        (
            "hose_wall_modulus_pa",
            "Pa",
            by.wall_modulus_pa,
            "Young's modulus of a hose wall of 2 mm (assumed) round the printed area",
        ),
        ("gas_fraction", "1", by.gas_fraction, "volume of gas in the oil at atmospheric pressure"),
        ("belt_stiffness_n_per_m", "N/m", by.belt_stiffness_n_per_m, "of the belt at either end"),
        ("bulk_modulus_pa", "Pa", by.bulk_modulus_pa, "if B is misprinted"),
    ];
    rows.extend(each.map(|(name, unit, value, note)| {
        own(format!("softening_as.{name}"), unit, [None, Some(value)])
            .note(format!("what the softening would be, by itself: {note}"))
    }));
    rows.extend(grid_rows(cells));
    rows.extend(alternative_rows(alternatives)?);
    for conclusion in conclusions {
        let mut row = own(format!("conclusion.{}", conclusion.id), "", [None; 2])
            .note(conclusion.statement.clone());
        row.survives = Some(conclusion.survives());
        row.contradicted_by = Some(conclusion.against.clone());
        rows.push(row);
    }
    Ok(rows)
}

/// What is predicted in each cell of the grid and by each explanation: name, unit, value.
const PREDICTED: [(&str, &str, Read); 6] = [
    ("peak_hz", "Hz", |p| p.peak_hz),
    ("cutoff_hz", "Hz", |p| p.cut_off_hz),
    ("lag_1hz_s", "s", |p| p.lag_1hz_s),
    ("low_frequency_gain", "1", |p| p.low_frequency_gain),
    ("short_peak_hz", "Hz", |p| p.short_peak_hz),
    ("short_cutoff_hz", "Hz", |p| p.short_cut_off_hz),
];

/// What the fit gives in every cell of the grid.
fn grid_rows(cells: &[SweepPoint]) -> Vec<Row> {
    let mut rows = Vec::new();
    for cell in cells {
        let mut add = |name: &str, unit: &str, ours| {
            rows.push(own(format!("grid.{}.{name}", cell.name()), unit, ours).role(role(name)));
        };
        add("line_stiffness_factor", "1", [Some(1.0), cell.factor]);
        for (name, unit, read) in PREDICTED {
            add(name, unit, [read(&cell.printed), read(&cell.traced)]);
        }
    }
    rows
}

/// Prediction and miss of each explanation.
fn alternative_rows(alternatives: &[Alternative]) -> Result<Vec<Row>> {
    let mut rows = Vec::new();
    for alternative in alternatives {
        let id = alternative.id;
        let size =
            own(format!("explanation.{id}.size"), alternative.unit, [None, alternative.size]);
        rows.push(size.role(Role::Fitted).note(alternative.what));
        let predicted =
            PREDICTED.map(|(name, unit, read)| (name, unit, read(&alternative.prediction)));
        let misses = [
            ("miss_measured_percent", "%", alternative.miss_percent(true)?),
            ("miss_all_percent", "%", alternative.miss_percent(false)?),
        ];
        for (name, unit, value) in predicted.into_iter().chain(misses) {
            let row = own(format!("explanation.{id}.{name}"), unit, [None, value]);
            rows.push(row.role(role(name)));
        }
    }
    Ok(rows)
}
