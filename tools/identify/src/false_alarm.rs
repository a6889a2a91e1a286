//! How probable it is that a name is a false alarm, in the form of `--json`.

use serde::Serialize;

/// Probability that a machine without an effect would have been given a name with at least its
/// gain, by a score bootstrap: the search is linearised, and the noise resampled.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FalseAlarm {
    /// Id of the effect.
    pub id: String,
    /// Its site.
    pub site: String,
    /// Its gain, as [`FoundEffect::gain_percent`] (%).
    ///
    /// [`FoundEffect::gain_percent`]: crate::outcome::FoundEffect::gain_percent
    pub gain_percent: f64,
    /// Number of replicates of the noise.
    pub replicates: usize,
    /// Number of replicates in which some candidate had at least this gain.
    pub as_much: usize,
    /// `(1 + as_much) / (1 + replicates)`; the least that can be told is `1 / (1 + replicates)`.
    pub probability: f64,
}

/// Level of significance.
pub const SIGNIFICANT: f64 = 0.05;

impl FalseAlarm {
    /// Whether chance gives such a gain too often for a name.
    pub fn is_insignificant(&self) -> bool {
        self.probability > SIGNIFICANT
    }

    /// The probability in words: `p = 0.012`, or `p < 0.002` where no replicate reached the gain.
    pub fn p_value(&self) -> String {
        let relation = if self.as_much == 0 { '<' } else { '=' };
        let digits = if self.probability < 0.1 { 3 } else { 2 };
        format!("p {relation} {:.digits$}", self.probability)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gain_that_no_replicate_reached_has_a_limit_in_place_of_a_probability() {
        let of = |as_much: usize| FalseAlarm {
            id: "backlash".into(),
            site: "slave".into(),
            gain_percent: 30.0,
            replicates: 499,
            as_much,
            probability: (1 + as_much) as f64 / 500.0,
        };
        assert_eq!(of(0).p_value(), "p < 0.002");
        assert_eq!(of(1).p_value(), "p = 0.004");
        assert_eq!(of(24).p_value(), "p = 0.050");
        assert!(!of(24).is_insignificant() && of(25).is_insignificant());
        assert_eq!(of(99).p_value(), "p = 0.20");
    }
}
