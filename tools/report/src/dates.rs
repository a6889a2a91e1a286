//! Ticks at calendar dates.

use std::time::{Duration, UNIX_EPOCH};

const DAY_S: f64 = 86_400.0;
/// Steps of a day, in hours.
const HOURS: [u32; 5] = [1, 2, 4, 8, 12];
/// Steps within a month, in days.
const DAYS: [u32; 4] = [1, 2, 5, 10];
const NAMES: [&str; 12] =
    ["Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec"];
/// Steps of months.
const MONTHS: [u32; 11] = [1, 2, 3, 6, 12, 24, 60, 120, 240, 600, 1200];
/// Share of the distance wanted that two ticks keep.
const CROWDED: f64 = 0.75;
const DAYS_PER_MONTH: f64 = 30.5;

/// About `wanted` ticks with their labels, at round dates or hours (UTC) between two times (s since
/// 1970).
pub(crate) fn ticks(low: f64, high: f64, wanted: usize) -> Vec<(f64, String)> {
    let days = (high - low) / DAY_S;
    let least = days / wanted.max(1) as f64;
    if least < 0.5 {
        return of_hours(low, high, least);
    }
    let within = |days: &u32| f64::from(*days) >= CROWDED * least;
    match DAYS.into_iter().find(within) {
        Some(step) => of_days(low, high, |date| {
            // The 31st would crowd the first of the next month.
            let round = step == 1 || ((date.day - 1).is_multiple_of(step) && date.day < 30);
            let name =
                NAMES.get((date.month as usize).saturating_sub(1)).copied().unwrap_or_default();
            round.then(|| format!("{} {name}", date.day))
        }),
        None => {
            let wide = |months: &u32| f64::from(*months) * DAYS_PER_MONTH >= CROWDED * least;
            let step = MONTHS.into_iter().find(wide).unwrap_or(1200);
            of_days(low, high, |date| {
                let month = 12 * date.year + date.month - 1;
                let round = date.day == 1 && month.is_multiple_of(step);
                round.then(|| date.text.chars().take(if step < 12 { 7 } else { 4 }).collect())
            })
        }
    }
}

/// A date of the calendar.
struct Date {
    year: u32,
    month: u32,
    day: u32,
    /// As `2026-03-05`.
    text: String,
}

/// Date and time of day as `2026-03-05T07:00:00Z`.
fn written(seconds: f64) -> String {
    let since = Duration::try_from_secs_f64(seconds).unwrap_or_default();
    let time = UNIX_EPOCH.checked_add(since).unwrap_or(UNIX_EPOCH);
    humantime::format_rfc3339_seconds(time).to_string()
}

fn of_days(low: f64, high: f64, label: impl Fn(&Date) -> Option<String>) -> Vec<(f64, String)> {
    let (first, last) = ((low / DAY_S).ceil() as i64, (high / DAY_S).floor() as i64);
    let tick = |day: i64| {
        let at = day as f64 * DAY_S;
        let text: String = written(at).chars().take(10).collect();
        let mut parts = text.split('-').filter_map(|part| part.parse().ok());
        let [year, month, day] = std::array::from_fn(|_| parts.next().unwrap_or(1));
        label(&Date { year, month, day, text }).map(|label| (at, label))
    };
    (first..=last).filter_map(tick).collect()
}

/// Hours of the day; the date stands at its beginning.
fn of_hours(low: f64, high: f64, least: f64) -> Vec<(f64, String)> {
    let enough = |hours: &u32| f64::from(*hours) >= 24.0 * least;
    let step_s = 3600.0 * f64::from(HOURS.into_iter().find(enough).unwrap_or(12));
    let (first, last) = ((low / step_s).ceil() as i64, (high / step_s).floor() as i64);
    let tick = |step: i64| {
        let at = step as f64 * step_s;
        let text = written(at);
        let of_day: String = text.chars().skip(11).take(5).collect();
        let date = text.chars().take(10).collect();
        (at, if of_day == "00:00" { date } else { of_day })
    };
    (first..=last).map(tick).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 2026-03-05 07:00 (UTC).
    const MORNING: f64 = 1_772_694_000.0;

    fn labels(days: f64) -> Vec<String> {
        ticks(MORNING, MORNING + days * DAY_S, 4).into_iter().map(|(_, label)| label).collect()
    }

    #[test]
    fn ticks_are_at_round_dates() {
        assert_eq!(labels(0.5), ["08:00", "12:00", "16:00"]);
        assert_eq!(labels(3.0), ["6 Mar", "7 Mar", "8 Mar"]);
        assert_eq!(labels(16.0), ["6 Mar", "11 Mar", "16 Mar", "21 Mar"]);
        assert_eq!(labels(34.0), ["11 Mar", "21 Mar", "1 Apr"]);
        assert_eq!(labels(100.0), ["2026-04", "2026-05", "2026-06"]);
        assert_eq!(labels(300.0), ["2026-05", "2026-07", "2026-09", "2026-11"]);
        assert_eq!(labels(1500.0), ["2027", "2028", "2029", "2030"]);
        assert!(labels(1e5).len() <= 5);
    }
}
