//! How a value is written with its error.

use crate::outcome_tables::short;

/// Values outside of this are written with an exponent.
const PLAIN: std::ops::Range<f64> = 1e-3..1e6;

/// A value and its error, to two digits of the error.
pub(super) fn with_error(value: f64, error: f64) -> String {
    if !(error.is_finite() && error > 0.0 && value.is_finite()) {
        return short(value);
    }
    let size = value.abs().max(error);
    let decimals = |error: f64| (1 - error.log10().floor() as i32).clamp(0, 12) as usize;
    if PLAIN.contains(&size) {
        let digits = decimals(error);
        return format!("{value:.digits$} ± {error:.digits$}");
    }
    let exponent = size.log10().floor() as i32;
    let unit = 10f64.powi(exponent);
    let (value, error) = (value / unit, error / unit);
    let digits = decimals(error);
    format!("{value:.digits$}e{exponent} ± {error:.digits$}e{exponent}")
}

/// A declared value with its tolerance, in percent where it is not 0.
pub(super) fn with_tolerance(declared: f64, tolerance: f64) -> String {
    match declared {
        0.0 => format!("0 ± {}", short(tolerance)),
        _ => format!("{} ± {:.0} %", short(declared), 100.0 * tolerance / declared.abs()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_is_written_to_two_digits_of_its_error() {
        assert_eq!(with_error(0.766_83, 0.001_615), "0.7668 ± 0.0016");
        assert_eq!(with_error(847.0, 16.94), "847 ± 17");
        assert_eq!(with_error(1.86e9, 9.3e7), "1.860e9 ± 0.093e9");
        assert_eq!(with_error(-1.76e-4, 8.8e-6), "-1.760e-4 ± 0.088e-4");
        assert_eq!(with_error(0.0, 0.25), "0.00 ± 0.25");
        assert_eq!(with_error(2.0, 0.0), "2.000");
        assert_eq!(with_tolerance(-0.767, 0.19175), "-0.7670 ± 25 %");
        assert_eq!(with_tolerance(0.0, 2.5), "0 ± 2.500");
    }
}
