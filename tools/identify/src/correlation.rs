//! Residual tests: the correlation of a residual with itself and with an input, with the bands
//! within which those of a residual lie that neither contains.

use std::collections::BTreeMap;

use serde::Serialize;

/// Largest lag (rows).
const LAST: usize = 50;
/// Bands of 95 % (standard deviations).
const BAND: f64 = 1.96;
/// Most lags of Bartlett's sum (rows).
const MOST_TERMS: usize = 500;

/// Correlation by lag.
#[derive(Clone, Debug, PartialEq)]
pub struct Correlogram {
    /// Lags (s); positive where the residual comes after the input.
    pub lags_s: Vec<f64>,
    /// Correlation coefficients, -1 to 1.
    pub values: Vec<f64>,
    /// Half width of the 95 % band about zero.
    pub band: f64,
}

/// Summary of a correlogram.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LagTest {
    /// Half width of the 95 % band about zero.
    pub band: f64,
    /// Share of the lags outside the band (%); about 5 for a residual that passes.
    pub outside_percent: f64,
    /// The correlation coefficient farthest from zero.
    pub largest: f64,
    /// Its lag (s); positive where the residual comes after the input.
    pub at_lag_s: f64,
}

impl Correlogram {
    /// Its summary; `None` without lags.
    pub fn test(&self) -> Option<LagTest> {
        let by_size = |a: &(&f64, &f64), b: &(&f64, &f64)| a.1.abs().total_cmp(&b.1.abs());
        let (lag_s, largest) = self.lags_s.iter().zip(&self.values).max_by(by_size)?;
        let outside = self.values.iter().filter(|value| value.abs() > self.band).count();
        Some(LagTest {
            band: self.band,
            outside_percent: 100.0 * outside as f64 / self.values.len() as f64,
            largest: *largest,
            at_lag_s: *lag_s,
        })
    }
}

/// Residual tests of one channel of the final model, on the reporting rows.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ResidualTests {
    /// Autocorrelation of the residual.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub autocorrelation: Option<LagTest>,
    /// Autocorrelation of the differences of repeated records, which no model explains: what the
    /// residual of a true model would have. Transmissions only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub autocorrelation_of_repeats: Option<LagTest>,
    /// Correlation of the residual with each input, by column.
    pub cross_correlation: BTreeMap<&'static str, LagTest>,
    /// Error on the selection rows over the noise floor by octave of frequency, the highest first.
    /// Transmissions only.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub octaves: Vec<OctaveError>,
}

/// Error over the noise floor in an octave of frequency.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct OctaveError {
    /// Lower edge of the octave (Hz); the last one reaches down to 0.
    pub from_hz: f64,
    /// Upper edge (Hz).
    pub to_hz: f64,
    /// Root mean square of the error over that of the noise.
    pub over_floor: f64,
}

/// The residual of one channel in segments, with the inputs along them.
#[derive(Clone, Debug, Default)]
pub struct TestedResidual {
    /// The residual.
    pub residual: Vec<Vec<f64>>,
    /// Name and segments of each input.
    pub inputs: Vec<(&'static str, Vec<Vec<f64>>)>,
    /// Differences of repeated records.
    pub repeats: Vec<Vec<f64>>,
    /// Time from row to row (s).
    pub step_s: f64,
    /// The error by octave, the highest first.
    pub octaves: Vec<OctaveError>,
}

impl TestedResidual {
    /// What is correlated, and by how much at which lag.
    pub fn correlograms(&self) -> Vec<(String, Correlogram)> {
        let own = autocorrelation(&self.residual, self.step_s);
        let own = own.map(|own| ("autocorrelation".to_owned(), own));
        let with = self.with_inputs().map(|(name, own)| (format!("correlation with {name}"), own));
        own.into_iter().chain(with).collect()
    }

    /// The correlation with each input.
    fn with_inputs(&self) -> impl Iterator<Item = (&'static str, Correlogram)> {
        self.inputs.iter().filter_map(|(name, input)| {
            Some((*name, cross_correlation(&self.residual, input, self.step_s)?))
        })
    }

    /// The tests.
    pub fn tests(&self) -> ResidualTests {
        let whiteness = |rows: &[Vec<f64>]| autocorrelation(rows, self.step_s)?.test();
        let with = self.with_inputs().filter_map(|(name, own)| Some((name, own.test()?)));
        ResidualTests {
            autocorrelation: whiteness(&self.residual),
            autocorrelation_of_repeats: whiteness(&self.repeats),
            cross_correlation: with.collect(),
            octaves: self.octaves.clone(),
        }
    }
}

/// Each segment less its mean.
fn centred(segments: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let of = |rows: &Vec<f64>| {
        let mean = rows.iter().sum::<f64>() / rows.len().max(1) as f64;
        rows.iter().map(|row| row - mean).collect()
    };
    segments.iter().map(of).collect()
}

/// Sum of `first[row] · then[row + lag]` over all segments.
fn product(first: &[Vec<f64>], then: &[Vec<f64>], lag: usize) -> f64 {
    let of = |(first, then): (&Vec<f64>, &Vec<f64>)| -> f64 {
        first.iter().zip(then.iter().skip(lag)).map(|(first, then)| first * then).sum()
    };
    first.iter().zip(then).map(of).sum()
}

/// Autocorrelation of segments `step_s` apart by row (s), from the first lag on: within `±1.96/√N`
/// for white noise. `None` for segments without a change.
pub fn autocorrelation(segments: &[Vec<f64>], step_s: f64) -> Option<Correlogram> {
    let segments = centred(segments);
    let rows: usize = segments.iter().map(Vec::len).sum();
    let last = longest(&segments)?;
    let square = Some(product(&segments, &segments, 0)).filter(|square| *square > 0.0)?;
    Some(Correlogram {
        lags_s: (1..=last).map(|lag| lag as f64 * step_s).collect(),
        values: (1..=last).map(|lag| product(&segments, &segments, lag) / square).collect(),
        band: BAND / (rows as f64).sqrt(),
    })
}

/// Correlation of a residual with an input of equal rows. The variance of each coefficient of two
/// series that are independent of each other is `Σ ρ_e(k) ρ_u(k) / N` over all lags (Bartlett).
/// `None` where either does not change.
pub fn cross_correlation(
    residual: &[Vec<f64>],
    input: &[Vec<f64>],
    step_s: f64,
) -> Option<Correlogram> {
    let (residual, input) = (centred(residual), centred(input));
    let rows: usize = residual.iter().map(Vec::len).sum();
    let last = longest(&residual)?;
    let [of_residual, of_input] = [&residual, &input].map(|own| product(own, own, 0));
    let scale = Some((of_residual * of_input).sqrt()).filter(|scale| *scale > 0.0)?;
    let terms = MOST_TERMS.min(rows / 4);
    let both = |lag: usize| {
        let [residual, input] = [&residual, &input].map(|own| product(own, own, lag));
        residual / of_residual * (input / of_input)
    };
    let variance = (1.0 + 2.0 * (1..=terms).map(both).sum::<f64>()) / rows as f64;
    let lags = -(last as isize)..=last as isize;
    let value = |lag: isize| match usize::try_from(lag) {
        Ok(after) => product(&input, &residual, after),
        Err(_) => product(&residual, &input, lag.unsigned_abs()),
    };
    Some(Correlogram {
        lags_s: lags.clone().map(|lag| lag as f64 * step_s).collect(),
        values: lags.map(|lag| value(lag) / scale).collect(),
        band: BAND * variance.max(1.0 / rows as f64).sqrt(),
    })
}

/// Largest lag for some segments; `None` where they are too short.
fn longest(segments: &[Vec<f64>]) -> Option<usize> {
    let longest = segments.iter().map(Vec::len).max()?;
    Some(LAST.min(longest / 4)).filter(|last| *last > 0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_noise::noise;

    fn lagged(column: &[f64], kept: f64) -> Vec<f64> {
        let mut value = 0.0;
        let of = column.iter().map(|own| {
            value = kept * value + own;
            value
        });
        of.collect()
    }

    #[test]
    fn white_noise_passes_and_a_lag_does_not() {
        let white = vec![noise(1, 2000), noise(2, 2000)];
        let test = autocorrelation(&white, 0.004).unwrap().test().unwrap();
        assert!((test.band - 1.96 / 4000f64.sqrt()).abs() < 1e-12);
        assert!(test.outside_percent <= 10.0 && test.largest.abs() < 0.06, "{test:?}");
        let coloured: Vec<Vec<f64>> = white.iter().map(|own| lagged(own, 0.8)).collect();
        let correlogram = autocorrelation(&coloured, 0.004).unwrap();
        assert!((correlogram.values[0] - 0.8).abs() < 0.05);
        assert!((correlogram.lags_s[0] - 0.004).abs() < 1e-12);
        assert!(correlogram.test().unwrap().outside_percent > 20.0);
    }

    /// Of independent coloured series far more than 5 % would lie outside the band of white ones.
    #[test]
    fn the_band_of_coloured_series_is_bartletts() {
        let (mut outside, mut outside_white, mut lags) = (0, 0, 0);
        for seed in 0..40 {
            let residual = vec![lagged(&noise(2 * seed + 100, 1500), 0.95)];
            let input = vec![lagged(&noise(2 * seed + 101, 1500), 0.95)];
            let correlogram = cross_correlation(&residual, &input, 1.0).unwrap();
            let beyond =
                |band: f64| correlogram.values.iter().filter(|own| own.abs() > band).count();
            outside += beyond(correlogram.band);
            outside_white += beyond(1.96 / 1500f64.sqrt());
            lags += correlogram.values.len();
        }
        let share = |count: usize| count as f64 / lags as f64;
        assert!((0.01..0.12).contains(&share(outside)), "{}", share(outside));
        assert!(share(outside_white) > 0.4, "{}", share(outside_white));
    }

    #[test]
    fn an_input_that_comes_before_has_a_positive_lag() {
        let input = noise(5, 1000);
        let residual: Vec<f64> =
            (0..1000usize).map(|row| row.checked_sub(7).map_or(0.0, |row| input[row])).collect();
        let test = cross_correlation(&[residual], &[input], 0.01).unwrap().test().unwrap();
        assert!((test.at_lag_s - 0.07).abs() < 1e-12 && test.largest > 0.9, "{test:?}");
    }

    #[test]
    fn what_does_not_change_has_no_correlation() {
        assert!(autocorrelation(&[vec![1.0; 100]], 1.0).is_none());
        assert!(cross_correlation(&[noise(1, 100)], &[vec![2.0; 100]], 1.0).is_none());
        assert!(autocorrelation(&[vec![1.0, 2.0]], 1.0).is_none());
        assert!(autocorrelation(&[], 1.0).is_none());
    }
}
