//! Rules by which the cases of transmissions are drawn.
//!
//! The usual ones keep parameters mostly near their declared values and record everything at
//! 2 kHz. The harder ones go to the edges of the tolerances, smooth friction as the model does not,
//! halve effects, and record as laboratories do: at lower rates, with rows lost, without a column,
//! or with a record in which the slave sticks.

use serde::{Deserialize, Serialize};

use crate::effects::Effect;
use crate::random::Draw;

/// Which rules.
#[derive(
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    Hash,
    PartialOrd,
    Ord,
    Serialize,
    Deserialize,
    clap::ValueEnum,
)]
#[serde(rename_all = "snake_case")]
pub enum Rules {
    /// Those of all campaigns until now.
    #[default]
    Usual,
    /// Edges of tolerances, other smoothing, half effects, incomplete records.
    Harder,
}

impl Rules {
    /// Its name in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Usual => "usual",
            Self::Harder => "harder",
        }
    }
}

/// How the records of a case are taken.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Conditions {
    /// Samples of the simulator (2 kHz) per row.
    pub stride: usize,
    /// Share of the rows that are lost, never two in succession.
    pub lost: f64,
    /// The column that is missing.
    pub missing: Option<Missing>,
    /// Index of the record in which the slave sticks.
    pub stuck: Option<usize>,
}

/// A column that a laboratory may not have.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Missing {
    /// No encoder at the slave.
    SlaveAngle,
    /// No torque cell; nobody is at the handle then.
    SlaveTorque,
}

impl Missing {
    /// Its name in the header.
    pub fn name(self) -> &'static str {
        match self {
            Self::SlaveAngle => "slave_rad",
            Self::SlaveTorque => "slave_torque_nm",
        }
    }
}

impl Default for Conditions {
    fn default() -> Self {
        Self { stride: 1, lost: 0.0, missing: None, stuck: None }
    }
}

/// Share of the rows that a lossy record lacks.
const LOST: f64 = 2e-3;
/// Records that a slave may stick in: those that are not repeated.
const STUCK: [usize; 4] = [1, 3, 5, 7];
/// Size of the movement in such a record, of the usual one.
pub const STUCK_SCALE: f64 = 0.01;
/// Effects whose first parameter is not a strength: it is kept where others are halved.
const NOT_A_STRENGTH: [&str; 1] = ["amplifier_saturation"];

impl Conditions {
    /// Drawn by rules.
    pub fn drawn(rules: Rules, draw: &mut Draw) -> Self {
        if rules == Rules::Usual {
            return Self::default();
        }
        Self {
            stride: [1, 2, 4, 8][draw.below(4)],
            lost: draw.choose(&[0.0, 0.0, LOST]),
            missing: [None, None, Some(Missing::SlaveAngle), Some(Missing::SlaveTorque)]
                [draw.below(4)],
            stuck: [None, None, Some(STUCK[draw.below(STUCK.len())])][draw.below(3)],
        }
    }

    /// Whether a channel of the residual is there: master, slave, torque.
    pub fn shows(&self, channel: usize) -> bool {
        match self.missing {
            None => true,
            Some(Missing::SlaveAngle) => channel != 1,
            Some(Missing::SlaveTorque) => channel != 2,
        }
    }
}

/// Halves every second effect.
pub fn weakened(mut effect: Effect, rules: Rules, draw: &mut Draw) -> Effect {
    let halved = rules == Rules::Harder && draw.below(2) == 0;
    if halved
        && !NOT_A_STRENGTH.contains(&effect.id.as_str())
        && let Some(size) = effect.parameters.0.first_mut()
    {
        size.value *= 0.5;
    }
    effect
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_usual_rules_record_everything() {
        let usual = Conditions::drawn(Rules::Usual, &mut Draw::new(1));
        assert_eq!((usual, usual.stride), (Conditions::default(), 1));
        assert!((0..3).all(|channel| usual.shows(channel)));
    }

    #[test]
    fn the_harder_ones_reach_every_condition() {
        let drawn: Vec<Conditions> =
            (0..200).map(|seed| Conditions::drawn(Rules::Harder, &mut Draw::new(seed))).collect();
        for stride in [1, 2, 4, 8] {
            assert!(drawn.iter().any(|own| own.stride == stride), "{stride}");
        }
        for missing in [None, Some(Missing::SlaveAngle), Some(Missing::SlaveTorque)] {
            assert!(drawn.iter().any(|own| own.missing == missing), "{missing:?}");
        }
        assert!(drawn.iter().any(|own| own.lost > 0.0));
        for record in STUCK {
            assert!(drawn.iter().any(|own| own.stuck == Some(record)), "{record}");
        }
    }

    #[test]
    fn half_of_the_effects_are_halved() {
        let entry = crate::effects::find("backlash@slave").unwrap();
        let mut draw = Draw::new(5);
        let halved = (0..200)
            .filter(|_| {
                let effect = entry.draw(&mut draw);
                let whole = effect.parameters.0[0].value;
                weakened(effect, Rules::Harder, &mut draw).parameters.0[0].value < 0.9 * whole
            })
            .count();
        assert!((70..130).contains(&halved), "{halved}");
    }
}
