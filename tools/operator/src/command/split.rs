//! When a recording goes on in another file: `--split 10min`, `--split 500MB`.

use std::time::Duration;

use ipc_types::Split;
use runtime::clock::SECOND_NS;

/// Parts into which the length of a ring is cut.
const PARTS: u64 = 4;
/// Sizes by their units (bytes).
const SIZES: [(&str, f64); 6] = [
    ("kB", 1e3),
    ("MB", 1e6),
    ("GB", 1e9),
    ("KiB", 1024.0),
    ("MiB", 1_048_576.0),
    ("GiB", 1_073_741_824.0),
];

/// Reads a time or a size.
///
/// # Errors
/// What else the text is.
pub(super) fn parse_split(text: &str) -> Result<Split, String> {
    let wrong =
        || format!("expected a time such as 10min, or a size such as 500MB, found `{text}`");
    let digits = text.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(text.len());
    let (number, unit) = text.split_at(digits);
    if let Some((_, factor)) = SIZES.into_iter().find(|(name, _)| *name == unit.trim()) {
        let number: f64 = number.parse().map_err(|_| wrong())?;
        return Ok(Split { every_bytes: Some((number * factor) as u64), ..Split::default() });
    }
    let time = humantime::parse_duration(text).map_err(|_| wrong())?;
    let every_ns = u64::try_from(time.as_nanos()).map_err(|_| wrong())?;
    Ok(Split { every_ns: Some(every_ns), ..Split::default() })
}

/// A ring of that length: its parts are a quarter of it, but at least a second.
pub(super) fn ring_of(length: Duration) -> Split {
    let keep_ns = nanoseconds(length);
    let every_ns = (keep_ns / PARTS).max(SECOND_NS);
    Split { every_ns: Some(every_ns), every_bytes: None, keep_ns: Some(keep_ns) }
}

/// A time in ns; the longest that there is for one that is longer.
pub(super) fn nanoseconds(time: Duration) -> u64 {
    u64::try_from(time.as_nanos()).unwrap_or(u64::MAX)
}

/// All of them at once: the shortest time and the smallest size.
pub(super) fn whichever_first(all: &[Split]) -> Split {
    Split {
        every_ns: all.iter().filter_map(|split| split.every_ns).min(),
        every_bytes: all.iter().filter_map(|split| split.every_bytes).min(),
        keep_ns: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_and_sizes_are_told_apart() {
        let time = |ns| Split { every_ns: Some(ns), ..Split::default() };
        let size = |bytes| Split { every_bytes: Some(bytes), ..Split::default() };
        for (text, expected) in [
            ("10min", time(600_000_000_000)),
            ("1h 30m", time(5_400_000_000_000)),
            ("30s", time(30_000_000_000)),
            ("500MB", size(500_000_000)),
            ("1.5 GiB", size(1_610_612_736)),
            ("2000kB", size(2_000_000)),
        ] {
            assert_eq!(parse_split(text), Ok(expected), "{text}");
        }
        for text in ["", "10", "MB", "1.2.3MB", "10 parsecs", "-5min", "500mb"] {
            let error = parse_split(text).unwrap_err();
            assert!(error.contains("10min") && error.contains(&format!("`{text}`")), "{error}");
        }
    }

    #[test]
    fn a_ring_has_parts_of_a_quarter_and_at_least_a_second() {
        let seconds =
            |split: Split| [split.every_ns, split.keep_ns].map(|ns| ns.unwrap() as f64 / 1e9);
        assert_eq!(seconds(ring_of(Duration::from_secs(30))), [7.5, 30.0]);
        assert_eq!(seconds(ring_of(Duration::from_secs(2))), [1.0, 2.0]);
    }

    #[test]
    fn of_several_the_first_that_comes_counts() {
        assert_eq!(whichever_first(&[]), Split::default());
        let all = ["10min", "2GB", "5min", "1GB"].map(|text| parse_split(text).unwrap());
        let first = Split {
            every_ns: Some(300_000_000_000),
            every_bytes: Some(1_000_000_000),
            keep_ns: None,
        };
        assert_eq!(whichever_first(&all), first);
    }
}
