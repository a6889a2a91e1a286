//! Values of unit files: numbers, spans of time, lists, specifiers. Each returns what it would have
//! accepted.

use std::time::Duration;

/// Replaces `%i` by the instance and `%%` by a percent sign.
pub(super) fn specifiers(text: &str, instance: &str) -> Result<String, &'static str> {
    let mut out = String::with_capacity(text.len());
    let mut characters = text.chars();
    while let Some(character) = characters.next() {
        if character != '%' {
            out.push(character);
            continue;
        }
        match characters.next() {
            Some('i') => out.push_str(instance),
            Some('%') => out.push('%'),
            _ => return Err("the specifiers %i and %%"),
        }
    }
    Ok(out)
}

/// A span of time: a number with `us`, `ms`, `s` or `min`; without a unit, seconds.
pub(super) fn span(text: &str) -> Result<Duration, &'static str> {
    const EXPECTED: &str =
        "a span of time: a whole number with us, ms, s or min (seconds without a unit)";
    let digits = text.find(|character: char| !character.is_ascii_digit()).unwrap_or(text.len());
    let number: u64 = text[..digits].parse().map_err(|_| EXPECTED)?;
    match &text[digits..] {
        "us" => Ok(Duration::from_micros(number)),
        "ms" => Ok(Duration::from_millis(number)),
        "" | "s" => Ok(Duration::from_secs(number)),
        "min" => number.checked_mul(60).map(Duration::from_secs).ok_or(EXPECTED),
        _ => Err(EXPECTED),
    }
}

/// A whole number from `low` to `high`; `expected` says so in words.
pub(super) fn whole(
    text: &str,
    low: i64,
    high: i64,
    expected: &'static str,
) -> Result<i64, &'static str> {
    text.parse::<i64>().ok().filter(|number| (low..=high).contains(number)).ok_or(expected)
}

/// Core numbers, separated by blanks or commas; a range as `2-4`.
pub(super) fn cores(text: &str) -> Result<Vec<usize>, &'static str> {
    const EXPECTED: &str =
        "core numbers from 0 to 1023 separated by blanks or commas, or a range such as 2-4";
    let mut cores = Vec::new();
    for word in text.split([' ', ',']).filter(|word| !word.is_empty()) {
        let (first, last) = word.split_once('-').unwrap_or((word, word));
        let first: usize = first.parse().map_err(|_| EXPECTED)?;
        let last: usize = last.parse().map_err(|_| EXPECTED)?;
        if first > last || last > 1023 {
            return Err(EXPECTED);
        }
        cores.extend(first..=last);
    }
    cores.sort_unstable();
    cores.dedup();
    if cores.is_empty() { Err(EXPECTED) } else { Ok(cores) }
}

/// Words at blanks. Quotes and backslashes mean something to systemd that is not read here:
/// refused.
pub(super) fn words(text: &str) -> Result<Vec<String>, &'static str> {
    if text.contains(['"', '\'', '\\', '$']) {
        return Err("plain words separated by blanks, without quotes, backslashes or $");
    }
    Ok(text.split_whitespace().map(str::to_owned).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_of_time() {
        assert_eq!(span("50ms"), Ok(Duration::from_millis(50)));
        assert_eq!(span("2"), Ok(Duration::from_secs(2)));
        assert_eq!(span("3min"), Ok(Duration::from_secs(180)));
        assert_eq!(span("7us"), Ok(Duration::from_micros(7)));
        for wrong in ["", "ms", "1.5s", "-1s", "infinity", "1min 30s", "1h"] {
            assert!(span(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn core_lists() {
        assert_eq!(cores("1"), Ok(vec![1]));
        assert_eq!(cores("3,0-1 1"), Ok(vec![0, 1, 3]));
        assert!(cores("2-1").is_err());
        assert!(cores("").is_err());
        assert!(cores("numa").is_err());
    }

    #[test]
    fn only_two_specifiers() {
        assert_eq!(specifiers("a@%i 100%%", "bench"), Ok("a@bench 100%".to_owned()));
        assert!(specifiers("%n", "bench").is_err());
        assert!(specifiers("end %", "bench").is_err());
    }
}
