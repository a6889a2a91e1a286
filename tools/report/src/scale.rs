//! Axis ranges, ticks and their labels.

use crate::dates;

/// How an axis maps values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Linear,
    Logarithmic,
    /// Linear in seconds since 1970 (UTC).
    Dates,
}

/// One axis: its range (in values) and kind.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scale {
    pub(crate) kind: Kind,
    pub(crate) low: f64,
    pub(crate) high: f64,
}

/// A tick: where, and what is written beside it (nothing on minor ticks).
pub(crate) struct Tick {
    pub(crate) at: f64,
    pub(crate) label: Option<String>,
}

impl Scale {
    /// An axis that shows all `values`, with a margin of `margin` of the range at each end.
    pub(crate) fn fit(kind: Kind, values: impl Iterator<Item = f64>, margin: f64) -> Option<Self> {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for v in values.filter(|v| v.is_finite() && (kind != Kind::Logarithmic || *v > 0.0)) {
            low = low.min(v);
            high = high.max(v);
        }
        if low > high {
            return None;
        }
        Some(match kind {
            Kind::Linear | Kind::Dates => {
                let spread = high - low;
                let pad = if spread > 1e-12 * low.abs().max(high.abs()) {
                    spread * margin
                } else if low == 0.0 {
                    1.0
                } else {
                    0.05 * low.abs()
                };
                Self { kind, low: low - pad, high: high + pad }
            }
            Kind::Logarithmic => {
                let pad = if high > low { (high / low).powf(margin) } else { 2.0 };
                Self { kind, low: low / pad, high: high * pad }
            }
        })
    }

    /// Where a value lies between the ends: 0 at the low end, 1 at the high one.
    pub(crate) fn fraction(&self, value: f64) -> f64 {
        match self.kind {
            Kind::Linear | Kind::Dates => (value - self.low) / (self.high - self.low),
            Kind::Logarithmic => (value / self.low).ln() / (self.high / self.low).ln(),
        }
    }

    /// About `wanted` major ticks at round values.
    pub(crate) fn ticks(&self, wanted: usize) -> Vec<Tick> {
        match self.kind {
            Kind::Dates => dates::ticks(self.low, self.high, wanted)
                .into_iter()
                .map(|(at, label)| Tick { at, label: Some(label) })
                .collect(),
            Kind::Logarithmic if self.high / self.low >= 10.0 => self.decades(wanted),
            _ => self.steps(wanted),
        }
    }

    fn steps(&self, wanted: usize) -> Vec<Tick> {
        let raw = (self.high - self.low) / wanted.max(1) as f64;
        let power = 10f64.powf(raw.log10().floor());
        let step =
            [1.0, 2.0, 2.5, 5.0, 10.0].map(|m| m * power).into_iter().find(|s| *s >= raw * 0.999);
        let step = step.unwrap_or(10.0 * power);
        let (first, last) =
            ((self.low / step - 1e-9).ceil() as i64, (self.high / step + 1e-9).floor() as i64);
        (first..=last)
            .map(|i| Tick { at: i as f64 * step, label: Some(label(i as f64 * step, step)) })
            .collect()
    }

    fn decades(&self, wanted: usize) -> Vec<Tick> {
        let (first, last) = (self.low.log10().floor() as i32, self.high.log10().ceil() as i32);
        let stride = ((last - first) as usize / wanted.max(1)).max(1) as i32;
        // Over less than three decades 2 and 5 are labelled too, or too few labels are left.
        let dense = (self.high / self.low).log10() < 2.5;
        let mut ticks = Vec::new();
        for decade in first..=last {
            for m in 1..10 {
                let at = f64::from(m) * 10f64.powi(decade);
                if at < self.low * (1.0 - 1e-9) || at > self.high * (1.0 + 1e-9) {
                    continue;
                }
                let major = m == 1 && (decade - first) % stride == 0 || dense && (m == 2 || m == 5);
                ticks.push(Tick { at, label: major.then(|| decade_label(m, decade)) });
            }
        }
        ticks
    }
}

fn decade_label(m: i32, decade: i32) -> String {
    if (-3..=4).contains(&decade) {
        return label(f64::from(m) * 10f64.powi(decade), 10f64.powi(decade));
    }
    let exponent = superscript(decade);
    if m == 1 { format!("10{exponent}") } else { format!("{m}·10{exponent}") }
}

fn superscript(n: i32) -> String {
    const DIGITS: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    let digit = |c: char| c.to_digit(10).map_or('⁻', |digit| DIGITS[digit as usize]);
    n.to_string().chars().map(digit).collect()
}

/// A tick's value with as many digits as the step needs, and a proper minus sign.
pub(crate) fn label(value: f64, step: f64) -> String {
    if value.abs() < step * 1e-9 {
        return "0".to_owned();
    }
    let size = value.abs().max(step);
    let text = if !(1e-4..1e6).contains(&size) {
        let exponent = size.log10().floor() as i32;
        let mantissa = value / 10f64.powi(exponent);
        let digits = (f64::from(exponent) - step.log10().floor()).max(0.0) as usize;
        format!("{mantissa:.digits$}·10{}", superscript(exponent))
    } else {
        let mut digits = (-step.log10().floor()).max(0.0) as usize;
        // a step of 2.5 needs one digit more than a step of 2
        let scaled = step * 10f64.powi(digits as i32);
        if (scaled - scaled.round()).abs() > 1e-6 {
            digits += 1;
        }
        format!("{value:.digits$}")
    };
    text.replace('-', "−")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(kind: Kind, low: f64, high: f64) -> Vec<String> {
        Scale { kind, low, high }.ticks(5).into_iter().filter_map(|t| t.label).collect()
    }

    #[test]
    fn linear_ticks_are_round() {
        assert_eq!(labels(Kind::Linear, -1.05, 1.05), ["−1.0", "−0.5", "0", "0.5", "1.0"]);
        assert_eq!(labels(Kind::Linear, 0.0, 24.8), ["0", "5", "10", "15", "20"]);
        assert_eq!(labels(Kind::Linear, 0.0, 0.012), ["0", "0.0025", "0.0050", "0.0075", "0.0100"]);
        assert_eq!(labels(Kind::Linear, 0.0, 3e-6), ["0", "1·10⁻⁶", "2·10⁻⁶", "3·10⁻⁶"]);
    }

    #[test]
    fn logarithmic_ticks_are_decades() {
        assert_eq!(labels(Kind::Logarithmic, 0.1, 100.0), ["0.1", "1", "10", "100"]);
        assert_eq!(labels(Kind::Logarithmic, 0.2, 15.0), ["0.2", "0.5", "1", "2", "5", "10"]);
    }

    #[test]
    fn a_constant_series_still_has_an_axis() {
        let scale = Scale::fit(Kind::Linear, [3.0, 3.0].into_iter(), 0.05).unwrap();
        assert!(scale.low < 3.0 && scale.high > 3.0);
        assert!(Scale::fit(Kind::Logarithmic, [-1.0, 0.0].into_iter(), 0.05).is_none());
    }
}
