//! Figures of residuals against a variable.

use report::{Colour, Figure};

/// Bins of a figure.
const BINS: usize = 40;
/// Gap in the rows, as a share of the range, across which no line is drawn.
const HOLE: f64 = 0.05;

/// Returns the curves of the declared model and of the model with effects, with name and colour:
/// one curve if they coincide; `with` tells whether effects were found that do not act on this
/// channel.
pub(crate) fn drawn<T: PartialEq>(
    before: T,
    after: T,
    with: bool,
) -> Vec<(&'static str, Colour, T)> {
    if before == after {
        let name = if with { "declared model, and with effects" } else { "declared model" };
        return vec![(name, Colour::Vermillion, before)];
    }
    vec![("declared model", Colour::Vermillion, before), ("with effects", Colour::Blue, after)]
}

/// Rows sorted by a variable, in bins of about a fortieth of them. A bin without rows marks a gap
/// wider than a twentieth of the range, as between records, across which no line is drawn.
fn bins(values: &[f64]) -> Vec<Vec<usize>> {
    let mut order: Vec<usize> = (0..values.len()).filter(|i| values[*i].is_finite()).collect();
    order.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
    let (Some(first), Some(last)) = (order.first(), order.last()) else { return Vec::new() };
    let hole = HOLE * (values[*last] - values[*first]);
    let mut bins = Vec::new();
    for run in order.chunk_by(|a, b| values[*b] - values[*a] <= hole) {
        if !bins.is_empty() {
            bins.push(Vec::new());
        }
        let parts = (BINS * run.len()).div_ceil(order.len());
        bins.extend(
            (0..parts)
                .map(|part| run[part * run.len() / parts..(part + 1) * run.len() / parts].to_vec()),
        );
    }
    bins
}

/// Residuals against a variable: mean and standard deviation in some forty bins with about equal
/// numbers of rows.
pub(crate) fn banded(
    what: &str,
    unit: &str,
    force: &str,
    values: &[f64],
    (before, after): (&[f64], &[f64]),
    with: bool,
) -> Figure {
    let bins = bins(values);
    // NaN for a gap, which ends a line.
    let mean = |bin: &[usize], of: &dyn Fn(usize) -> f64| {
        bin.iter().map(|i| of(*i)).sum::<f64>() / bin.len() as f64
    };
    let x: Vec<f64> = bins.iter().map(|bin| mean(bin, &|i| values[i])).collect();
    let mut figure = Figure::new("", format!("{what} / {unit}"), format!("residual / {force}"))
        .size(680, 270)
        .horizontal(Colour::Grey, "", 0.0);
    for (name, colour, residual) in drawn(before, after, with) {
        let means: Vec<f64> = bins.iter().map(|bin| mean(bin, &|i| residual[i])).collect();
        let spread =
            |(bin, m): (&Vec<usize>, &f64)| mean(bin, &|i| (residual[i] - m).powi(2)).sqrt();
        let spreads: Vec<f64> = bins.iter().zip(&means).map(spread).collect();
        let edge =
            |sign: f64| means.iter().zip(&spreads).map(|(m, s)| m + sign * s).collect::<Vec<f64>>();
        figure =
            figure.band(colour, "", &x, &edge(-1.0), &edge(1.0)).line(colour, name, &x, &means);
    }
    figure
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_curves_are_drawn_once() {
        let (one, other) = ([1.0, 2.0], [1.0, 2.5]);
        assert_eq!(
            drawn(&one, &other, true).iter().map(|drawn| drawn.0).collect::<Vec<_>>(),
            ["declared model", "with effects"]
        );
        assert_eq!(
            drawn(&one, &one, true).iter().map(|drawn| drawn.0).collect::<Vec<_>>(),
            ["declared model, and with effects"]
        );
        assert_eq!(
            drawn(&one, &one, false).iter().map(|drawn| drawn.0).collect::<Vec<_>>(),
            ["declared model"]
        );
    }

    #[test]
    fn no_bin_spans_a_gap_and_every_row_is_in_one() {
        let values: Vec<f64> =
            (0..400).map(|i| f64::from(i) * 0.01 + if i < 100 { 0.0 } else { 20.0 }).collect();
        let bins = bins(&values);
        assert_eq!(bins.iter().filter(|bin| bin.is_empty()).count(), 1);
        assert_eq!(bins.len(), 41);
        let mut rows: Vec<usize> = bins.iter().flatten().copied().collect();
        rows.sort_unstable();
        assert!(rows.iter().copied().eq(0..400));
        assert!(
            bins.iter().all(|bin| bin.iter().all(|i| *i < 100) || bin.iter().all(|i| *i >= 100))
        );
        assert!(super::bins(&[]).is_empty());
        assert_eq!(super::bins(&[2.0, f64::NAN, 2.0]).concat(), [0, 2]);
    }
}
