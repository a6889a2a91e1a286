//! How often the stated standard deviations of declared parameters hold the truth.

use std::collections::BTreeMap;

use serde::Deserialize;

/// A declared parameter in the answer of identify.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
pub struct Fitted {
    /// Name.
    pub name: String,
    /// Fitted value.
    pub fitted: Option<f64>,
    /// Its standard deviation.
    pub std: Option<f64>,
    /// Whether the records identify it.
    pub identifiable: bool,
}

/// Returns, for each parameter of a machine that is said to be identified, its error over its
/// stated standard deviation.
pub fn normalised_errors(machine: &BTreeMap<String, f64>, parameters: &[Fitted]) -> Vec<f64> {
    let error = |own: &Fitted| {
        let std = own.std.filter(|std| *std > 0.0 && own.identifiable)?;
        Some((own.fitted? - machine.get(&own.name)?) / std)
    };
    parameters.iter().filter_map(error).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_identified_parameters_with_a_deviation_count() {
        let fitted = |name: &str, fitted: f64, std: Option<f64>, identifiable: bool| Fitted {
            name: name.to_owned(),
            fitted: Some(fitted),
            std,
            identifiable,
        };
        let parameters = [
            fitted("mass", 1.2, Some(0.1), true),
            fitted("drag", 3.0, Some(0.5), false),
            fitted("spring", 5.0, None, true),
            fitted("smoothing", 0.1, Some(0.1), true),
        ];
        let machine = [("mass", 1.0), ("drag", 2.0), ("spring", 5.0)];
        let machine = machine.map(|(name, value)| (name.to_owned(), value)).into();
        let errors = normalised_errors(&machine, &parameters);
        assert!(matches!(errors[..], [error] if (error - 2.0).abs() < 1e-9), "{errors:?}");
    }
}
