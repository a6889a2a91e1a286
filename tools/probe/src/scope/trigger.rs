//! The trigger: decides at which sample of one channel a window begins.

/// When a channel triggers; levels are in the channel's unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Condition {
    /// It rises to the level or above it.
    Rising(f64),
    /// It falls to the level or below it.
    Falling(f64),
    /// It is at the level or above it, however it came there.
    Above(f64),
    /// It is at the level or below it.
    Below(f64),
    /// It comes into the band from outside.
    Enters(f64, f64),
    /// It leaves the band from inside.
    Leaves(f64, f64),
}

impl Condition {
    /// The levels, one or two.
    pub(crate) fn levels(&self) -> impl Iterator<Item = f64> {
        let (first, second) = match *self {
            Self::Rising(level)
            | Self::Falling(level)
            | Self::Above(level)
            | Self::Below(level) => (level, None),
            Self::Enters(low, high) | Self::Leaves(low, high) => (low, Some(high)),
        };
        std::iter::once(first).chain(second)
    }

    /// The same with its levels moved by a distance.
    pub(crate) fn moved(self, by: f64) -> Self {
        match self {
            Self::Rising(level) => Self::Rising(level + by),
            Self::Falling(level) => Self::Falling(level + by),
            Self::Above(level) => Self::Above(level + by),
            Self::Below(level) => Self::Below(level + by),
            Self::Enters(low, high) => Self::Enters(low + by, high + by),
            Self::Leaves(low, high) => Self::Leaves(low + by, high + by),
        }
    }

    /// The next kind, at the same level or band.
    pub(crate) fn next(self) -> Self {
        match self {
            Self::Rising(level) => Self::Falling(level),
            Self::Falling(level) => Self::Above(level),
            Self::Above(level) => Self::Below(level),
            Self::Below(level) => Self::Rising(level),
            Self::Enters(low, high) => Self::Leaves(low, high),
            Self::Leaves(low, high) => Self::Enters(low, high),
        }
    }

    /// Whether a value alone meets it.
    fn holds(&self, value: f64) -> bool {
        match *self {
            Self::Rising(level) | Self::Above(level) => value >= level,
            Self::Falling(level) | Self::Below(level) => value <= level,
            Self::Enters(low, high) => (low..=high).contains(&value),
            Self::Leaves(low, high) => value < low || value > high,
        }
    }

    /// Whether a value is on the other side, by the hysteresis at least; `None` for those that do
    /// not ask where the channel came from.
    fn opposite(&self, value: f64, hysteresis: f64) -> Option<bool> {
        let clear = match *self {
            Self::Rising(level) => value <= level - hysteresis,
            Self::Falling(level) => value >= level + hysteresis,
            Self::Above(_) | Self::Below(_) => return None,
            Self::Enters(low, high) => value <= low - hysteresis || value >= high + hysteresis,
            Self::Leaves(low, high) => (low + hysteresis..=high - hysteresis).contains(&value),
        };
        Some(clear && !self.holds(value))
    }
}

/// Watches one channel.
#[derive(Clone, Debug)]
pub(crate) struct Trigger {
    condition: Condition,
    /// Distance from the level to which the channel must have gone back (its unit).
    hysteresis: f64,
    /// Whether the channel was on the other side since it last triggered, without interruption.
    ready: bool,
}

impl Trigger {
    pub(crate) const fn new(condition: Condition, hysteresis: f64) -> Self {
        Self { condition, hysteresis, ready: false }
    }

    /// Takes the next sample and says whether it triggers. After a gap, and where a value is not
    /// finite, nobody knows how the channel came to where it is: an edge is seen again only after
    /// the channel was on the other side.
    pub(crate) fn see(&mut self, value: f64, after_gap: bool) -> bool {
        if after_gap || !value.is_finite() {
            self.ready = false;
        }
        if !value.is_finite() {
            return false;
        }
        match self.condition.opposite(value, self.hysteresis) {
            None => self.condition.holds(value),
            Some(true) => {
                self.ready = true;
                false
            }
            Some(false) => {
                let fires = self.ready && self.condition.holds(value);
                self.ready &= !fires;
                fires
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Indices of the samples that trigger.
    fn fired(condition: Condition, hysteresis: f64, values: &[f64]) -> Vec<usize> {
        let mut trigger = Trigger::new(condition, hysteresis);
        (0..values.len()).filter(|&at| trigger.see(values[at], false)).collect()
    }

    #[test]
    fn an_edge_is_where_the_level_is_reached_from_the_other_side() {
        let values = [0.0, 1.0, 2.0, 3.0, 2.0, 1.0, 2.0];
        assert_eq!(fired(Condition::Rising(2.0), 0.0, &values), [2, 6]);
        assert_eq!(fired(Condition::Falling(2.0), 0.0, &values), [4]);
        // The first sample may be anywhere: nothing is known of before.
        assert_eq!(fired(Condition::Rising(0.0), 0.0, &values), [0; 0]);
        assert_eq!(fired(Condition::Above(2.0), 0.0, &values), [2, 3, 4, 6]);
        assert_eq!(fired(Condition::Below(1.0), 0.0, &values), [0, 1, 5]);
    }

    #[test]
    fn noise_at_the_level_triggers_once_with_hysteresis() {
        let noise = |at: usize| if at.is_multiple_of(2) { 0.04 } else { -0.04 };
        let rise: Vec<f64> = (0..100).map(|at| at as f64 * 0.01 + noise(at)).collect();
        assert!(fired(Condition::Rising(0.5), 0.0, &rise).len() > 1);
        assert_eq!(fired(Condition::Rising(0.5), 0.1, &rise).len(), 1);
        let fall: Vec<f64> = rise.iter().map(|value| -value).collect();
        assert_eq!(fired(Condition::Falling(-0.5), 0.1, &fall).len(), 1);
        // Back below the level by less than the hysteresis is no new edge.
        let values = [0.0, 1.0, 0.95, 1.0, 0.85, 1.0];
        assert_eq!(fired(Condition::Rising(1.0), 0.1, &values), [1, 5]);
    }

    #[test]
    fn a_window_is_entered_and_left() {
        let values = [0.0, 1.5, 3.0, 1.5, 0.0, 5.0, 1.9];
        assert_eq!(fired(Condition::Enters(1.0, 2.0), 0.0, &values), [1, 3, 6]);
        assert_eq!(fired(Condition::Leaves(1.0, 2.0), 0.0, &values), [2, 4]);
        // 1.9 is inside, but not by the hysteresis.
        let values = [1.5, 2.5, 1.9, 2.5, 1.5, 0.5];
        assert_eq!(fired(Condition::Leaves(1.0, 2.0), 0.2, &values), [1, 5]);
    }

    #[test]
    fn an_edge_within_a_gap_is_not_seen() {
        let mut trigger = Trigger::new(Condition::Rising(1.0), 0.0);
        assert!(!trigger.see(0.0, false));
        assert!(!trigger.see(2.0, true), "it may have risen and fallen several times");
        assert!(!trigger.see(0.5, false));
        assert!(trigger.see(1.0, false));
        assert!(!trigger.see(0.0, false));
        assert!(!trigger.see(f64::NAN, false));
        assert!(!trigger.see(2.0, false));
        // A level needs no past.
        assert!(Trigger::new(Condition::Above(1.0), 0.0).see(2.0, true));
    }

    #[test]
    fn moving_and_changing_a_condition_keeps_its_levels() {
        let moved = Condition::Leaves(1.0, 2.0).moved(0.5);
        assert_eq!(moved.levels().collect::<Vec<_>>(), [1.5, 2.5]);
        assert_eq!(moved.next(), Condition::Enters(1.5, 2.5));
        let mut edge = Condition::Rising(3.0);
        for _ in 0..4 {
            edge = edge.next();
            assert_eq!(edge.levels().collect::<Vec<_>>(), [3.0]);
        }
        assert_eq!(edge, Condition::Rising(3.0));
    }

    proptest! {
        /// Between two edges of the same kind lies a value on the other side, by the hysteresis.
        #[test]
        fn two_edges_have_the_other_side_between_them(
            values in prop::collection::vec(-2.0..2.0f64, 0..200),
            level in -1.0..1.0f64,
            hysteresis in 0.0..1.0f64,
        ) {
            let edges = fired(Condition::Rising(level), hysteresis, &values);
            for &edge in &edges {
                prop_assert!(values[edge] >= level);
            }
            let begins = std::iter::once(0).chain(edges.iter().copied());
            for (begin, &end) in begins.zip(&edges) {
                let between = &values[begin..end];
                prop_assert!(between.iter().any(|v| *v <= level - hysteresis && *v < level));
            }
        }
    }
}
