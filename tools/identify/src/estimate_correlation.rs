//! Correlations of estimated parameters: where one is off, a correlated one is off with it.

use nalgebra::DMatrix;
use serde::Serialize;

/// Least magnitude of a correlation that is told.
const STRONG: f64 = 0.8;

/// Two estimates that are strongly correlated.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EstimateCorrelation {
    /// Names of the two parameters.
    pub parameters: [String; 2],
    /// Correlation coefficient of their errors, -1 to 1.
    pub coefficient: f64,
}

/// Returns the correlation matrix of a covariance; 0 for what has no finite variance.
pub fn correlation(covariance: &DMatrix<f64>) -> DMatrix<f64> {
    let deviation: Vec<f64> = covariance.diagonal().iter().map(|own| own.max(0.0).sqrt()).collect();
    DMatrix::from_fn(covariance.nrows(), covariance.ncols(), |row, column| {
        let scale = deviation[row] * deviation[column];
        let value = covariance[(row, column)] / scale;
        if value.is_finite() { value.clamp(-1.0, 1.0) } else { 0.0 }
    })
}

/// Returns the pairs with a strong correlation, the strongest first; `names` are those of rows and
/// columns, in order, `None` for what has no name.
pub fn strong(names: &[Option<String>], correlation: &DMatrix<f64>) -> Vec<EstimateCorrelation> {
    let count = names.len().min(correlation.nrows());
    let pairs = (0..count).flat_map(|first| (first + 1..count).map(move |then| (first, then)));
    let mut strong: Vec<EstimateCorrelation> = pairs
        .filter(|(first, then)| correlation[(*first, *then)].abs() >= STRONG)
        .filter_map(|(first, then)| {
            let parameters = [names[first].clone()?, names[then].clone()?];
            Some(EstimateCorrelation { parameters, coefficient: correlation[(first, then)] })
        })
        .collect();
    strong.sort_by(|a, b| b.coefficient.abs().total_cmp(&a.coefficient.abs()));
    strong
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strong_pairs_are_told_by_name() {
        let covariance =
            DMatrix::from_row_slice(3, 3, &[4.0, -5.7, 0.5, -5.7, 9.0, 0.0, 0.5, 0.0, 1.0]);
        let names = ["mass", "damping", "offset"].map(|name| Some(name.to_owned()));
        let found = strong(&names, &correlation(&covariance));
        let [only] = &found[..] else { panic!("{found:?}") };
        assert_eq!(only.parameters, ["mass", "damping"]);
        assert!((only.coefficient + 0.95).abs() < 1e-12);
    }

    #[test]
    fn what_has_no_variance_has_no_correlation() {
        let covariance = DMatrix::from_row_slice(2, 2, &[0.0, 0.0, 0.0, f64::INFINITY]);
        assert_eq!(correlation(&covariance), DMatrix::zeros(2, 2));
        assert!(strong(&[None, None], &DMatrix::from_element(2, 2, 1.0)).is_empty());
    }
}
