//! Gains of replicates in which an effect is not missing, and what a measured gain is among them.

/// The largest gain of an absent effect in each replicate: the null distribution of the gain.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NullGains(pub Vec<f64>);

impl NullGains {
    /// Number of replicates.
    pub const fn replicates(&self) -> usize {
        self.0.len()
    }

    /// Number of replicates with at least this gain.
    pub fn as_much(&self, gain: f64) -> usize {
        self.0.iter().filter(|own| **own >= gain).count()
    }

    /// Bootstrap p-value of a gain: `(1 + exceedances) / (1 + replicates)`.
    pub fn probability(&self, gain: f64) -> f64 {
        (1 + self.as_much(gain)) as f64 / (1 + self.replicates()) as f64
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn the_p_value_counts_the_records_themselves() {
        let gains = NullGains([vec![0.0; 17], vec![0.3, 0.5]].concat());
        assert!((gains.probability(0.6) - 0.05).abs() < 1e-12);
        assert!((gains.probability(0.4) - 0.1).abs() < 1e-12);
        assert_eq!(gains.as_much(0.3), 2);
    }

    proptest! {
        #[test]
        fn a_p_value_is_in_range_and_falls_with_the_gain(
            gains in prop::collection::vec(-1.0f64..1.0, 0..50),
            gain in -2.0f64..2.0,
            more in 0.0f64..1.0,
        ) {
            let gains = NullGains(gains);
            let (p, further) = (gains.probability(gain), gains.probability(gain + more));
            prop_assert!(p > 0.0 && p <= 1.0);
            prop_assert!(further <= p);
            prop_assert!(p >= 1.0 / (1 + gains.replicates()) as f64);
        }
    }
}
