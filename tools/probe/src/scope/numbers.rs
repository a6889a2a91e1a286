//! Numbers and steps on the screen.

/// The least of 1, 2 and 5 times a power of ten that is not below a positive value.
pub(crate) fn step_at_least(value: f64) -> f64 {
    let power = 10f64.powf(value.log10().floor());
    let steps = [1.0, 2.0, 5.0].map(|factor| factor * power);
    steps.into_iter().find(|step| *step >= value * (1.0 - 1e-9)).unwrap_or(10.0 * power)
}

/// The next larger step.
pub(crate) fn larger(step: f64) -> f64 {
    step_at_least(step * 1.01)
}

/// The next smaller step.
pub(crate) fn smaller(step: f64) -> f64 {
    let power = 10f64.powf(step.log10().floor());
    let steps = [5.0, 2.0, 1.0, 0.5].map(|factor| factor * power);
    steps.into_iter().find(|smaller| *smaller < step * 0.99).unwrap_or(0.2 * power)
}

/// A value with four digits; a whole number with all of them.
pub(crate) fn short(value: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    if !value.is_finite() {
        return "-".to_owned();
    }
    let size = value.abs();
    // Counts and ticks, to the last one.
    if value.fract() == 0.0 && size < 1e15 {
        return format!("{value:.0}");
    }
    if !(1e-4..1e6).contains(&size) {
        return format!("{value:.3e}");
    }
    let decimals = (3.0 - size.log10().floor()).clamp(0.0, 7.0) as usize;
    let text = format!("{value:.decimals$}");
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

/// A time, given in seconds, in s, ms or µs.
pub(crate) fn time(seconds: f64) -> String {
    let size = seconds.abs();
    let (factor, unit) = match size {
        0.0 => (1.0, "s"),
        _ if size < 0.999_95e-3 => (1e6, "µs"),
        _ if size < 0.999_95 => (1e3, "ms"),
        _ => (1.0, "s"),
    };
    format!("{} {unit}", short(seconds * factor))
}

/// A value with its unit, if that is known.
pub(crate) fn with_unit(value: f64, unit: &str) -> String {
    let value = short(value);
    if unit.is_empty() { value } else { format!("{value} {unit}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_one_two_and_five() {
        let mut step = 0.001;
        let mut up = Vec::new();
        for _ in 0..7 {
            step = larger(step);
            up.push(short(step));
        }
        assert_eq!(up, ["0.002", "0.005", "0.01", "0.02", "0.05", "0.1", "0.2"]);
        let mut down = Vec::new();
        for _ in 0..7 {
            step = smaller(step);
            down.push(short(step));
        }
        assert_eq!(down, ["0.1", "0.05", "0.02", "0.01", "0.005", "0.002", "0.001"]);
        assert_eq!(
            (short(step_at_least(0.3)), short(step_at_least(7.0))),
            ("0.5".into(), "10".into())
        );
        assert_eq!((short(smaller(0.3)), short(larger(0.3))), ("0.2".into(), "0.5".into()));
    }

    #[test]
    fn values_have_four_digits_and_times_their_unit() {
        for (value, expected) in [
            (0.0, "0"),
            (1.0, "1"),
            (-12.3456, "-12.35"),
            (0.000_512_34, "0.0005123"),
            (123_456.7, "123457"),
            (1.5e-7, "1.500e-7"),
            (2.5e8, "250000000"),
            (1.234_567_89e8, "123456789"),
            (2.5e18, "2.500e18"),
            (f64::NAN, "-"),
        ] {
            assert_eq!(short(value), expected);
        }
        for (seconds, expected) in
            [(0.0, "0 s"), (1.5, "1.5 s"), (-0.02, "-20 ms"), (0.000_35, "350 µs"), (0.001, "1 ms")]
        {
            assert_eq!(time(seconds), expected);
        }
        assert_eq!((with_unit(0.5, "N·m"), with_unit(3.0, "")), ("0.5 N·m".into(), "3".into()));
    }
}
