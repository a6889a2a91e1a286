//! Plots of a residual: over time, over what it may depend on, and over frequency.

use report::{Colour, Figure, Panels};

use crate::correlation::{Correlogram, OctaveError, TestedResidual};
use crate::spectral::periodogram;

/// Bins of a figure.
const BINS: usize = 40;
/// Gap in the rows, as a share of the range, across which no line is drawn.
const HOLE: f64 = 0.05;
/// Frequency bins per decade.
const BINS_A_DECADE: f64 = 20.0;
/// Width and height of a panel.
const SIZE: (u32, u32) = (460, 250);

/// Returns the curves of the declared model and of the model with effects, with name and colour:
/// one curve if they coincide; `with` tells whether effects were found that do not act on this
/// channel.
pub(super) fn plotted<T: PartialEq>(
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

/// The residual over time, with a rule at zero.
pub(super) fn over_time(
    title: &str,
    of: String,
    time: &[f64],
    curves: Vec<(&'static str, Colour, &[f64])>,
) -> Figure {
    curves
        .into_iter()
        .fold(Figure::new(title, "time / s", of).size(680, 260), |figure, (name, colour, y)| {
            figure.line(colour, name, time, y)
        })
        .horizontal(Colour::Grey, "", 0.0)
}

/// A correlation over the lag, with its 95 % band.
fn over_lags((what, correlogram): (String, Correlogram)) -> Figure {
    let Correlogram { lags_s, values, band } = correlogram;
    let [low, high] = [-band, band].map(|edge| vec![edge; lags_s.len()]);
    Figure::new("", "lag / s", what)
        .size(SIZE.0, SIZE.1)
        .band(Colour::Grey, "95 % band", &lags_s, &low, &high)
        .horizontal(Colour::Grey, "", 0.0)
        .line(Colour::Blue, "final model", &lags_s, &values)
}

/// The error over the noise floor by octave, with a rule where the two are equal; `None` without
/// octaves.
fn over_octaves(octaves: &[OctaveError]) -> Option<Figure> {
    // The lowest octave reaches down to 0, which a logarithmic axis does not show.
    let low = |own: &OctaveError| own.from_hz.max(0.5 * own.to_hz);
    let rising = octaves.iter().rev();
    let hz: Vec<f64> = rising.clone().flat_map(|own| [low(own), own.to_hz]).collect();
    let over: Vec<f64> = rising.flat_map(|own| [own.over_floor; 2]).collect();
    let empty = Figure::new("", "frequency / Hz", "error / noise floor").size(SIZE.0, SIZE.1);
    (!octaves.is_empty()).then(|| {
        let empty = empty.log_x().log_y().horizontal(Colour::Grey, "", 1.0);
        empty.line(Colour::Blue, "final model, selection rows", &hz, &over)
    })
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

/// A variable that the residual may depend on: name, unit, values by row; not finite where it has
/// none.
pub(super) type Variable = (&'static str, &'static str, Vec<f64>);

/// The residual of one channel, over the rows of all records that are shown.
pub(super) struct ChannelResidual {
    /// The channel's name.
    pub(super) name: &'static str,
    /// Its unit.
    pub(super) unit: &'static str,
    /// What the residual may depend on.
    pub(super) variables: Vec<Variable>,
    /// Residual of the declared model, by row.
    pub(super) before: Vec<f64>,
    /// Residual of the final model, by row.
    pub(super) after: Vec<f64>,
    /// Curves of the spectrum: name, colour, segments.
    pub(super) spectra: Vec<(&'static str, Colour, Vec<Vec<f64>>)>,
    /// Sampling period of the segments (s).
    pub(super) step_s: f64,
    /// Whether effects were found.
    pub(super) with: bool,
    /// The final model's residual on the reporting rows.
    pub(super) tested: TestedResidual,
}

impl ChannelResidual {
    /// One panel for each variable, the spectrum, and the correlations.
    pub(super) fn panels(&self, residual: &str) -> Panels {
        let sheet = Panels::new(format!("What the {residual} of {} depends on", self.name));
        let variables = self.variables.iter().filter_map(|variable| self.over(variable));
        let correlations = self.tested.correlograms().into_iter().map(over_lags);
        let octaves = over_octaves(&self.tested.octaves);
        let panels = variables.chain(self.spectrum()).chain(octaves).chain(correlations);
        panels.fold(sheet.columns(2), Panels::panel)
    }

    /// Mean and standard deviation in some forty bins of a variable with about equal numbers of
    /// rows; `None` without finite values, as after a movement without reversal.
    fn over(&self, (what, unit, values): &Variable) -> Option<Figure> {
        let bins = bins(values);
        if bins.is_empty() {
            return None;
        }
        // NaN for a gap, which ends a line.
        let mean = |bin: &[usize], of: &dyn Fn(usize) -> f64| {
            bin.iter().map(|i| of(*i)).sum::<f64>() / bin.len() as f64
        };
        let x: Vec<f64> = bins.iter().map(|bin| mean(bin, &|i| values[i])).collect();
        let of = format!("residual / {}", self.unit);
        let mut figure = Figure::new("", format!("{what} / {unit}"), of)
            .size(SIZE.0, SIZE.1)
            .horizontal(Colour::Grey, "", 0.0);
        for (name, colour, residual) in plotted(&self.before, &self.after, self.with) {
            let means: Vec<f64> = bins.iter().map(|bin| mean(bin, &|i| residual[i])).collect();
            let spread =
                |(bin, m): (&Vec<usize>, &f64)| mean(bin, &|i| (residual[i] - m).powi(2)).sqrt();
            let spreads: Vec<f64> = bins.iter().zip(&means).map(spread).collect();
            let [low, high] = [-1.0, 1.0].map(|sign| {
                means.iter().zip(&spreads).map(|(m, s)| m + sign * s).collect::<Vec<f64>>()
            });
            figure = figure.band(colour, "", &x, &low, &high).line(colour, name, &x, &means);
        }
        Some(figure)
    }

    /// The amplitude spectral density; `None` for segments that are too short.
    fn spectrum(&self) -> Option<Figure> {
        let of = format!("amplitude / ({}/√Hz)", self.unit);
        let empty = Figure::new("", "frequency / Hz", of).size(SIZE.0, SIZE.1).log_x().log_y();
        let curves: Vec<_> = self
            .spectra
            .iter()
            .map(|(name, colour, segments)| (name, colour, density(segments, self.step_s)))
            .filter(|(.., (hz, _))| !hz.is_empty())
            .collect();
        (!curves.is_empty()).then(|| {
            curves.into_iter().fold(empty, |figure, (name, colour, (hz, amplitude))| {
                figure.line(*colour, *name, &hz, &amplitude)
            })
        })
    }
}

/// Amplitude spectral density of some segments with equal sampling, in logarithmic bins:
/// frequencies (Hz) and unit/√Hz. A Hann window reduces the leakage of what is not periodic in a
/// segment.
fn density(segments: &[Vec<f64>], step_s: f64) -> (Vec<f64>, Vec<f64>) {
    let longest = segments.iter().map(Vec::len).max().unwrap_or(0) as f64 * step_s;
    if longest <= 0.0 {
        return (Vec::new(), Vec::new());
    }
    let lowest = 2.0 / longest;
    let mut bins: Vec<(f64, f64, f64)> = Vec::new();
    for rows in segments {
        let n = rows.len().max(1) as f64;
        let mean = rows.iter().sum::<f64>() / n;
        let window = |i: usize| 1.0 - (std::f64::consts::TAU * i as f64 / n).cos();
        let windowed: Vec<f64> =
            rows.iter().enumerate().map(|(i, value)| (value - mean) * window(i)).collect();
        // The power of all rows; negative frequencies are left out, so that it counts twice. The
        // window has a mean square of 1.5.
        let scale = 2.0 * step_s / (1.5 * n);
        for (frequency, power) in
            periodogram(&windowed, 1.0 / step_s).into_iter().filter(|(f, _)| *f >= lowest)
        {
            let bin = (BINS_A_DECADE * (frequency / lowest).log10()) as usize;
            if bins.len() <= bin {
                bins.resize(bin + 1, (0.0, 0.0, 0.0));
            }
            let (sum_hz, sum, count) = &mut bins[bin];
            (*sum_hz, *sum, *count) = (*sum_hz + frequency, *sum + scale * power, *count + 1.0);
        }
    }
    let filled = bins.into_iter().filter(|(_, power, count)| *count > 0.0 && *power > 0.0);
    filled.map(|(hz, power, count)| (hz / count, (power / count).sqrt())).unzip()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_noise::noise;

    #[test]
    fn equal_curves_are_drawn_once() {
        let (one, other) = ([1.0, 2.0], [1.0, 2.5]);
        assert_eq!(
            plotted(&one, &other, true).iter().map(|plotted| plotted.0).collect::<Vec<_>>(),
            ["declared model", "with effects"]
        );
        assert_eq!(
            plotted(&one, &one, true).iter().map(|plotted| plotted.0).collect::<Vec<_>>(),
            ["declared model, and with effects"]
        );
        assert_eq!(
            plotted(&one, &one, false).iter().map(|plotted| plotted.0).collect::<Vec<_>>(),
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

    #[test]
    fn a_plot_without_finite_values_is_left_out() {
        let row = vec![0.0, 1.0, 2.0];
        let residual = ChannelResidual {
            name: "master_rad",
            unit: "rad",
            variables: Vec::new(),
            before: row.clone(),
            after: row.clone(),
            spectra: Vec::new(),
            step_s: 1.0,
            with: false,
            tested: TestedResidual::default(),
        };
        let none = vec![f64::NAN; 3];
        assert!(residual.over(&("time since the last reversal", "s", none)).is_none());
        assert!(residual.over(&("time", "s", row)).is_some());
        assert!(residual.spectrum().is_none());
    }

    #[test]
    fn density_of_a_known_tone_and_of_known_noise() {
        // White: the mean square over the band of half the sampling frequency.
        let noise = noise(1, 4000);
        let (hz, amplitude) = density(&[noise[..2000].to_vec(), noise[2000..].to_vec()], 4e-3);
        let expected = (1.0 / 12.0 / 125.0_f64).sqrt();
        let high = hz.iter().zip(&amplitude).filter(|(hz, _)| **hz > 20.0);
        assert!(high.clone().count() > 10);
        for (hz, amplitude) in high {
            assert!(
                (amplitude / expected - 1.0).abs() < 0.25,
                "{hz}: {amplitude}, expected {expected}"
            );
        }
        let tone: Vec<f64> = (0..2000)
            .map(|row| (std::f64::consts::TAU * 30.0 * 4e-3 * f64::from(row)).sin())
            .collect();
        let (hz, amplitude) = density(&[tone], 4e-3);
        let most = amplitude
            .iter()
            .enumerate()
            .max_by(|a, b| a.1.total_cmp(b.1))
            .map(|(at, _)| hz[at])
            .unwrap();
        assert!((most / 30.0 - 1.0).abs() < 0.06, "{most}");
        assert!(density(&[], 4e-3).0.is_empty());
    }
}
