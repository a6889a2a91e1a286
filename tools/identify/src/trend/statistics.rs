//! Weighted mean and weighted linear drift of repeated estimates.

/// One estimate of a quantity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// When, in any unit; ascending in a series.
    pub time: f64,
    /// Estimate.
    pub value: f64,
    /// Its standard deviation, in the same unit, above 0.
    pub deviation: f64,
}

impl Point {
    fn weight(&self) -> f64 {
        1.0 / (self.deviation * self.deviation)
    }
}

/// A mean of estimates that differ in accuracy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mean {
    /// Mean, weighted by the inverse variances.
    pub value: f64,
    /// Its standard deviation; times the overdispersion where that is above 1.
    pub deviation: f64,
    /// Sum of the squared deviations from the mean, each over its variance.
    pub squares: f64,
    /// Birge's ratio `√(squares/(n - 1))`: how far the estimates scatter, in their standard
    /// deviations. 1 for a single one.
    pub overdispersion: f64,
}

/// The weighted mean; `None` without points.
pub fn weighted_mean(points: &[Point]) -> Option<Mean> {
    let first = points.first()?.value;
    let weight: f64 = points.iter().map(Point::weight).sum();
    let off = points.iter().map(|point| point.weight() * (point.value - first)).sum::<f64>();
    let value = first + off / weight;
    let squares = points.iter().map(|own| own.weight() * (own.value - value).powi(2)).sum();
    let overdispersion = dispersion(squares, points.len(), 1);
    Some(Mean {
        value,
        deviation: overdispersion.max(1.0) / weight.sqrt(),
        squares,
        overdispersion,
    })
}

/// A line through estimates that differ in accuracy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drift {
    /// Slope, per unit of time.
    pub slope: f64,
    /// Its standard deviation; times the overdispersion where that is above 1.
    pub deviation: f64,
    /// Slope over the standard deviation that the scatter about the line gives it: Student's t of
    /// `n - 2` degrees of freedom where nothing drifts.
    pub t: f64,
    /// Sum of the squared deviations from the line, each over its variance.
    pub squares: f64,
    /// Value at the last point.
    pub last: f64,
    /// Its standard deviation.
    pub last_deviation: f64,
}

/// The weighted least-squares line; `None` for fewer than three points, or where all have the same
/// time.
pub fn drift(points: &[Point]) -> Option<Drift> {
    let (first, last) = (points.first()?, points.last()?);
    let weight: f64 = points.iter().map(Point::weight).sum();
    let mean_of = |of: &dyn Fn(&Point) -> f64| {
        points.iter().map(|point| point.weight() * of(point)).sum::<f64>() / weight
    };
    let time = first.time + mean_of(&|point| point.time - first.time);
    let value = first.value + mean_of(&|point| point.value - first.value);
    let spread: f64 = points.iter().map(|own| own.weight() * (own.time - time).powi(2)).sum();
    if points.len() < 3 || spread <= 0.0 {
        return None;
    }
    let product = |own: &Point| own.weight() * (own.time - time) * (own.value - value);
    let slope = points.iter().map(product).sum::<f64>() / spread;
    let left = |own: &Point| own.value - value - slope * (own.time - time);
    let squares = points.iter().map(|own| own.weight() * left(own).powi(2)).sum();
    let scatter = dispersion(squares, points.len(), 2);
    let inflation = scatter.max(1.0);
    let ahead = last.time - time;
    Some(Drift {
        slope,
        deviation: inflation / spread.sqrt(),
        t: slope * spread.sqrt() / scatter.max(f64::MIN_POSITIVE),
        squares,
        last: value + slope * ahead,
        last_deviation: inflation * (1.0 / weight + ahead * ahead / spread).sqrt(),
    })
}

/// `√(squares/(n - p))`; 1 where there are no degrees of freedom.
fn dispersion(squares: f64, points: usize, parameters: usize) -> f64 {
    match points.checked_sub(parameters) {
        None | Some(0) => 1.0,
        Some(freedom) => (squares / freedom as f64).sqrt(),
    }
}

/// The median; `None` without values.
pub fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut sorted: Vec<f64> = values.collect();
    sorted.sort_by(f64::total_cmp);
    let middle = sorted.len() / 2;
    match sorted.len() % 2 {
        _ if sorted.is_empty() => None,
        1 => Some(sorted[middle]),
        _ => Some(f64::midpoint(sorted[middle - 1], sorted[middle])),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(found: f64, expected: f64) {
        assert!((found - expected).abs() < 1e-12 * expected.abs().max(1.0), "{found} {expected}");
    }

    fn point(time: f64, value: f64, deviation: f64) -> Point {
        Point { time, value, deviation }
    }

    #[test]
    fn the_mean_is_weighted_and_its_error_grows_with_the_scatter() {
        // Weights 1 and 1/4: (1·10 + 4/4)/(5/4).
        let mean = weighted_mean(&[point(0.0, 10.0, 1.0), point(1.0, 4.0, 2.0)]).unwrap();
        close(mean.value, 8.8);
        close(mean.squares, 1.2f64.powi(2) + (4.8f64 / 2.0).powi(2));
        close(mean.overdispersion, 7.2f64.sqrt());
        close(mean.deviation, (7.2f64 / 1.25).sqrt());
        // Estimates that agree better than their errors say leave the error as it is.
        let agreeing = weighted_mean(&[point(0.0, 5.0, 1.0); 4]).unwrap();
        close(agreeing.deviation, 0.5);
        close(agreeing.overdispersion, 0.0);
        assert!(weighted_mean(&[]).is_none());
        close(weighted_mean(&[point(0.0, 3.0, 0.2)]).unwrap().deviation, 0.2);
    }

    #[test]
    fn a_line_is_found_exactly() {
        let times = [0.0, 1.0, 4.0, 9.0, 10.0];
        let on_line = times.map(|time| point(1e6 + time, 7.0 - 0.25 * time, 0.1 + 0.01 * time));
        let drift = drift(&on_line).unwrap();
        assert!((drift.slope + 0.25).abs() < 1e-9 && drift.squares < 1e-12, "{drift:?}");
        assert!((drift.last - 4.5).abs() < 1e-9, "{drift:?}");
    }

    #[test]
    fn the_error_of_a_slope_is_that_of_the_textbook() {
        // Equal errors s at -1, 0, 1: the slope's is s/√2, that of the end √(1/3 + 1/2) s.
        let values = [1.0, 1.3, 1.0];
        let three = [-1.0, 0.0, 1.0].map(|at| point(at, values[(at + 1.0) as usize], 0.5));
        let drift = drift(&three).unwrap();
        close(drift.slope, 0.0);
        close(drift.deviation, 0.5 / 2f64.sqrt());
        close(drift.last_deviation, 0.5 * (1.0f64 / 3.0 + 0.5).sqrt());
        // Larger scatter than the errors, `squares` = 0.06/0.01 with one degree of freedom.
        let small = three.map(|own| Point { deviation: 0.1, ..own });
        close(super::drift(&small).unwrap().deviation, 0.1 * 6f64.sqrt() / 2f64.sqrt());
        assert!(super::drift(&three[..2]).is_none());
        assert!(super::drift(&[point(1.0, 2.0, 0.1); 5]).is_none());
    }

    #[test]
    fn the_median_of_an_even_number_is_the_middle_of_two() {
        assert_eq!(median([4.0, 1.0, 9.0, 2.0].into_iter()), Some(3.0));
        assert_eq!(median([4.0, 1.0, 9.0].into_iter()), Some(4.0));
        assert_eq!(median(std::iter::empty()), None);
    }
}
