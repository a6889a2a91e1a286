//! Coarse screening of large grids of nonlinear parameters.
//!
//! The residual of the model without the new effect is regressed on the effect's columns, without
//! the low-pass and without refitting the rest. Tones are found in the residual's spectrum. The
//! best few points that are not neighbours are then fitted exactly.

use super::block_roles::Block;
use super::model::{RegressionModel, Structure, residual};
use crate::effects::{Shape, View};
use crate::regression::{Gram, solve};
use crate::spectral::periodogram;

/// Columns of one record, row by row.
type Columns = Vec<Vec<f64>>;

/// Number of points that are fitted exactly.
const KEPT: usize = 6;
/// Largest product of rows and points; beyond it rows are decimated.
const LARGEST_COST: usize = 20_000_000;

/// The best of the `points` for the one new effect after the settled ones; all of them where there
/// are several new ones.
pub(super) fn grid_prescreen(
    regression: &RegressionModel,
    structure: &Structure<'_>,
    blocks: &[Block],
    before: &Structure<'_>,
    (columns, signs, points): (&[Columns], &[Vec<f64>], Vec<Vec<f64>>),
) -> Option<Vec<Vec<f64>>> {
    let [effect] = structure.effects[before.effects.len()..] else { return Some(points) };
    let fit = solve(&regression.gram(columns, blocks), &regression.bounds(before))?;
    let left: Vec<Vec<f64>> = blocks
        .iter()
        .map(|b| {
            residual(&columns[b.record], &regression.balances[b.record].force, &fit.coefficients, b)
        })
        .collect();
    if effect.declaration().is_tone {
        return Some(tones(
            regression,
            blocks,
            &left,
            &(effect.declaration().shapes)(&regression.axis),
        ));
    }
    let bounds: Vec<_> = effect.terms(&regression.axis).iter().map(|t| t.bound).collect();
    let thin: Vec<_> = regression.balances.iter().map(|b| b.signals.thin()).collect();
    let thinner = |full: &[f64], record: usize| regression.balances[record].signals.rows(full);
    let signs: Vec<Vec<f64>> = signs.iter().enumerate().map(|(i, s)| thinner(s, i)).collect();
    let models: Vec<Vec<f64>> =
        structure.model.iter().enumerate().map(|(i, m)| thinner(m, i)).collect();
    let rows: usize = blocks.iter().map(|b| b.rows.len()).sum();
    let every = (rows * points.len()).div_ceil(LARGEST_COST).max(1);
    let explained = |shapes: &Vec<f64>| {
        let mut gram = Gram::empty(bounds.len());
        let columns: Vec<Vec<Vec<f64>>> = thin
            .iter()
            .enumerate()
            .map(|(i, signals)| {
                let model = models.get(i).map_or(&[][..], Vec::as_slice);
                effect.columns(
                    &View { signals, sign: &signs[i], model, axis: &regression.axis },
                    shapes,
                )
            })
            .collect();
        for (block, left) in blocks.iter().zip(&left) {
            let pick = |c: &[f64]| c.iter().step_by(every).copied().collect::<Vec<f64>>();
            let columns = columns[block.record].iter();
            let own: Vec<Vec<f64>> = columns.map(|c| pick(&c[block.rows.clone()])).collect();
            let target = pick(left);
            gram.add(&own, &target, 0..target.len());
        }
        solve(&gram, &bounds).map_or(0.0, |fit| gram.yy - fit.squares)
    };
    let scores: Vec<f64> = points.iter().map(explained).collect();
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by(|a, b| scores[*b].total_cmp(&scores[*a]));
    let mut kept: Vec<usize> = Vec::new();
    for i in order {
        if kept.len() < KEPT && kept.iter().all(|k| k.abs_diff(i) > 2) {
            kept.push(i);
        }
    }
    Some(kept.into_iter().map(|i| points[i].clone()).collect())
}

/// The strongest lines in the residual's spectrum, over all records, within the range of the one
/// shape.
fn tones(
    regression: &RegressionModel,
    blocks: &[Block],
    left: &[Vec<f64>],
    shapes: &[Shape],
) -> Vec<Vec<f64>> {
    let Some(shape) = shapes.first() else { return Vec::new() };
    let mut spectra: Vec<Vec<(f64, f64)>> = Vec::new();
    for (record, balance) in regression.balances.iter().enumerate() {
        let mut rows = vec![0.0; balance.rows()];
        for (block, left) in blocks.iter().zip(left).filter(|(b, _)| b.record == record) {
            rows[block.rows.clone()].copy_from_slice(left);
        }
        spectra.push(periodogram(&rows, 1.0 / balance.row_step()));
    }
    let Some(longest) = spectra.iter().max_by_key(|s| s.len()) else { return Vec::new() };
    let power = |frequency: f64| -> f64 {
        spectra
            .iter()
            .filter_map(|s| s.get((frequency / s.get(1)?.0).round() as usize).map(|bin| bin.1))
            .sum()
    };
    // Frequencies outside the range of the shape are excluded.
    let allowed = |f: &f64| (shape.at(shape.share(*f)) - f).abs() < 1e-6;
    let mut lines: Vec<(f64, f64)> =
        longest.iter().map(|bin| bin.0).filter(allowed).map(|f| (f, power(f))).collect();
    lines.sort_by(|a, b| b.1.total_cmp(&a.1));
    let width = 1.5 / regression.axis.seconds;
    let mut kept: Vec<f64> = Vec::new();
    for (frequency, _) in lines {
        if kept.len() < KEPT && kept.iter().all(|k| (k - frequency).abs() > width) {
            kept.push(frequency);
        }
    }
    kept.into_iter().map(|f| vec![f]).collect()
}
