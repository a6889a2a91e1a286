//! The loop's own rows: what was fitted, the grid, the rivals, the conclusions.

use super::Calibration;
use super::conclusions::Conclusion;
use super::grid::Cell;
use super::rivals::Rival;
use crate::error::Result;
use crate::row::{Role, Row};

/// Figure to which these rows belong: the measured response.
const FIGURE: &str = "5.7";

/// All rows of the loop.
///
/// # Errors
/// Where a published value is missing from the table.
pub fn rows(
    calibration: &Calibration,
    cells: &[Cell],
    rivals: &[Rival],
    conclusions: &[Conclusion],
) -> Result<Vec<Row>> {
    let mut rows = vec![
        Row::own("own.line_stiffness_factor", FIGURE, "1", Some(1.0), Some(calibration.factor))
            .role(Role::Fitted)
            .note(
                "fitted to the measured resonance alone; effect line_compliance of size 1/factor \
                - 1",
            ),
        Row::own(
            "own.misprinted_bulk_modulus.largest_gain_difference",
            FIGURE,
            "1",
            None,
            Some(calibration.misprint_difference),
        )
        .note(
            "line_compliance against a bulk modulus smaller by the same factor, 0.2 to 24 \
                Hz: the numbers cannot separate them",
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
        Row::own(format!("own.softening_as.{name}"), FIGURE, unit, None, Some(value))
            .note(format!("what the softening would be, by itself: {note}"))
    }));
    rows.extend(grid_rows(cells));
    rows.extend(rival_rows(rivals)?);
    for conclusion in conclusions {
        let mut row = Row::own(format!("own.conclusion.{}", conclusion.id), FIGURE, "", None, None)
            .note(conclusion.statement.clone());
        row.survives = Some(conclusion.survives());
        row.contradicted_by = Some(conclusion.against.clone());
        rows.push(row);
    }
    Ok(rows)
}

/// What the fit gives in every cell of the grid.
fn grid_rows(cells: &[Cell]) -> Vec<Row> {
    let mut rows = Vec::new();
    for cell in cells {
        let (p, t) = (&cell.printed, &cell.traced);
        let values = [
            ("line_stiffness_factor", "1", Some(1.0), cell.factor),
            ("peak_hz", "Hz", p.peak_hz, t.peak_hz),
            ("cutoff_hz", "Hz", p.cut_off_hz, t.cut_off_hz),
            ("lag_1hz_s", "s", p.lag_1hz_s, t.lag_1hz_s),
            ("low_frequency_gain", "1", p.low_frequency_gain, t.low_frequency_gain),
            ("short_peak_hz", "Hz", None, t.short_peak_hz),
            ("short_cutoff_hz", "Hz", None, t.short_cut_off_hz),
        ];
        for (name, unit, printed, traced) in values {
            let role = if ["line_stiffness_factor", "peak_hz"].contains(&name) {
                Role::Fitted
            } else {
                Role::Predicted
            };
            rows.push(
                Row::own(format!("own.grid.{}.{name}", cell.name()), FIGURE, unit, printed, traced)
                    .role(role),
            );
        }
    }
    rows
}

/// What every explanation predicts, and by how much it misses.
fn rival_rows(rivals: &[Rival]) -> Result<Vec<Row>> {
    let mut rows = Vec::new();
    for rival in rivals {
        let (id, t) = (rival.id, &rival.prediction);
        rows.push(
            Row::own(format!("own.explanation.{id}.size"), FIGURE, rival.unit, None, rival.size)
                .role(Role::Fitted)
                .note(rival.what),
        );
        let values = [
            ("peak_hz", "Hz", t.peak_hz),
            ("cutoff_hz", "Hz", t.cut_off_hz),
            ("lag_1hz_s", "s", t.lag_1hz_s),
            ("low_frequency_gain", "1", t.low_frequency_gain),
            ("short_peak_hz", "Hz", t.short_peak_hz),
            ("short_cutoff_hz", "Hz", t.short_cut_off_hz),
            ("miss_measured_percent", "%", rival.miss_percent(true)?),
            ("miss_all_percent", "%", rival.miss_percent(false)?),
        ];
        for (name, unit, value) in values {
            let role = if name == "peak_hz" { Role::Fitted } else { Role::Predicted };
            rows.push(
                Row::own(format!("own.explanation.{id}.{name}"), FIGURE, unit, None, value)
                    .role(role),
            );
        }
    }
    Ok(rows)
}
