//! Triggers and windows in words and numbers.

use crate::scope::channel::Channel;
use crate::scope::numbers::with_unit;
use crate::scope::ring::Point;
use crate::scope::trigger::Condition;

/// A trigger in words: `handle_torque rises to 0.5 N·m`.
pub(crate) fn condition(channel: &Channel, condition: &Condition) -> String {
    let value = |value: f64| with_unit(value, &channel.unit);
    let text = match *condition {
        Condition::Rising(level) => format!("rises to {}", value(level)),
        Condition::Falling(level) => format!("falls to {}", value(level)),
        Condition::Above(level) => format!("at or above {}", value(level)),
        Condition::Below(level) => format!("at or below {}", value(level)),
        Condition::Enters(low, high) => format!("enters {} to {}", value(low), value(high)),
        Condition::Leaves(low, high) => format!("leaves {} to {}", value(low), value(high)),
    };
    format!("{} {text}", channel.name)
}

/// The value of a channel at a time (ns): that of the newest sample until then. `None` before the
/// first one, within a gap, and where it is not finite.
pub(crate) fn value_at(points: impl Iterator<Item = Point>, time_ns: u64) -> Option<f64> {
    let mut before: Option<Point> = None;
    for point in points {
        if point.time_ns > time_ns {
            let known = |before: &Point| point.gap.is_none() || before.time_ns == time_ns;
            return before.filter(known).map(|before| before.value);
        }
        before = Some(point).filter(|point| point.value.is_finite());
    }
    before.filter(|before| before.time_ns == time_ns).map(|point| point.value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_trigger_is_told_with_its_unit() {
        let channel = Channel { name: "torque".into(), unit: "N·m".into(), place: (0, 0) };
        for (of, expected) in [
            (Condition::Rising(0.5), "torque rises to 0.5 N·m"),
            (Condition::Below(-2.0), "torque at or below -2 N·m"),
            (Condition::Leaves(-1.0, 1.0), "torque leaves -1 N·m to 1 N·m"),
        ] {
            assert_eq!(condition(&channel, &of), expected);
        }
    }

    #[test]
    fn there_is_no_value_within_a_gap_and_beyond_the_ends() {
        let point = |time_ns, value, gap| Point { time_ns, value, gap };
        let points = [
            point(10, 1.0, None),
            point(20, 2.0, None),
            point(50, 5.0, Some(2)),
            point(60, f64::NAN, None),
            point(70, 7.0, None),
        ];
        let at = |time_ns| value_at(points.into_iter(), time_ns);
        assert_eq!(at(9), None);
        assert_eq!((at(10), at(19), at(20)), (Some(1.0), Some(1.0), Some(2.0)));
        assert_eq!(at(30), None, "within a gap");
        assert_eq!((at(50), at(59), at(60), at(65)), (Some(5.0), Some(5.0), None, None));
        assert_eq!((at(70), at(71)), (Some(7.0), None));
    }
}
