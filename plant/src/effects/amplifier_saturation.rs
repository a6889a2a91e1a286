//! `amplifier_saturation`: an amplifier that clips.
//!
//! `v → clamp(v, -v_max, v_max)`.
//!
//! # In a model of one channel
//!
//! Saturation of the amplifier.
//!
//! `f = clamp(F, ±limit)`: the part of the command `F` beyond the limit is lost.
//!
//! Parameter: `limit` (N, N·m or V), searched from 2 to 98 % of the largest command of the
//! records: an integrating law winds up to several times the limit.
//!
//! In a residual: an error only at the highest commands, where the force falls short. Confused
//! with: load-dependent friction, a command channel that clips.

use super::one_channel::{Shape, Term};
use super::search::{SearchRange, each};
use super::{Effect, Moment, effect};

effect! {
    "amplifier_saturation": "an amplifier that clips";
    at Drive = 2.0 "V";
    /// An amplifier that clips.
    pub struct AmplifierSaturation {
        /// Largest output `v_max`.
        limit: "V (N)", 1e-3, 1e4, 2.0, "assumed";
    }
    search {
        space: |of| {
            let volts = of.features.volts;
            let starts = each("limit", &[0.45, 0.6, 0.75, 0.9].map(|share| share * volts));
            // The limit falls as the effect grows.
            of.space([SearchRange::linear("limit", 0.2 * volts, volts)], starts).with_sizes(0)
        },
    }
    one_channel {
        rank: 190,
        words: "an amplifier that clips",
        experiment: "steps of the command up to its limit with the current measured",
        applies: |axis| axis.commanded,
        terms: |_| vec![Term::given()],
        shapes: |axis| {
            vec![Shape::by_factors(
                "limit",
                axis.units.force,
                (0.02 * axis.force_peak, 0.98 * axis.force_peak),
                40,
            )]
        },
        columns: Some(|view, shapes| {
            vec![view.signals.force.iter().map(|f| f - f.clamp(-shapes[0], shapes[0])).collect()]
        }),
        deliver: Some(|command, _, _, shapes| {
            command.iter().map(|f| f.clamp(-shapes[0], shapes[0])).collect()
        }),
        of_plant: |fit| fit.renamed(&[("limit", "limit")]),
    }
}

impl Effect for AmplifierSaturation {
    fn amplifier(&mut self, volts: f64, _moment: &Moment) -> f64 {
        volts.clamp(-self.limit, self.limit)
    }
}
