//! `presliding_hysteresis`: bristles: friction that builds up over a small travel.
//!
//! Of the side's dry friction `F` the part `p` follows Dahl's law ([`crate::friction::Bristle`])
//! with the stiffness `p F / q_d`, `F` being the side's breakaway where it first moves, mean of
//! both directions. The rest stays dry. Source: Dahl, 1968; Canudas de Wit et al., IEEE TAC 40
//! (1995).
//!
//! # In a model of one channel
//!
//! Presliding friction (bristles): it builds up over a small travel.
//!
//! `F = bristle_force · z`, `dz/dx = (1 - z sign(v)) / travel`: Dahl's law, whose limit for a small
//! `travel` is Coulomb friction. Source: Dahl 1968; Canudas de Wit, Olsson, Åström, Lischinsky,
//! IEEE Transactions on Automatic Control 40 (1995). The state starts at 0; an error of this
//! initial state decays over a few `travel`.
//!
//! Parameters: `bristle_force` (N or N·m), at least 0; `travel` (m or rad), 0.01 to 5 % of the
//! record's travel (30 % for elements and oscillators).
//!
//! In a residual: after each reversal the force changes from one side to the other as a function of
//! *position*, however slow the movement. Confused with: Coulomb friction (small travel), a Maxwell
//! branch (a function of time instead), backlash.

use super::one_channel::{Shape, Term};
use super::search::{SearchRange, pairs};
use super::{Demand, Effect, LineConstants, Moment, SideLoad, Site, effect};
use crate::friction::Bristle;

/// Shortest travel that is searched, in counts of that side's encoder.
const LEAST_COUNTS: f64 = 2.0;
/// Longest travel in a model of one channel, as a share of the record's: over a longer one a drive
/// would be elastic, and what it touches is taken for friction.
const LONGEST: f64 = 0.05;
/// The same for elements and oscillators, which are elastic.
const LONGEST_OF_ELEMENTS: f64 = 0.3;

effect! {
    "presliding_hysteresis": "bristles: friction that builds up over a small travel";
    at Master = 0.5 "1", Slave = 0.5 "1";
    /// A part of the dry friction as bristles.
    pub struct PreslidingHysteresis {
        /// Part of the dry friction that is bristles `p`.
        part: "1", 0.0, 1.0, 0.5, "assumed";
        /// Travel over which it builds up `q_d`.
        travel: "rad (m)", 1e-6, 1.0, 0.02, "assumed";
    }
    state {
        bristle: Bristle = Bristle::default();
        stiffness: f64 = 0.0;
    }
    search {
        space: |of| {
            let count_rad = of.features.count_rad[usize::from(of.site == Site::Slave)];
            let least = (LEAST_COUNTS * count_rad).clamp(5e-4, 0.05);
            let travels = [0.004, 0.015, 0.06].map(|travel| f64::max(travel, 1.3 * least));
            of.space(
                [
                    SearchRange::linear("part", 0.0, 1.0),
                    SearchRange::logarithmic("travel", least, 0.3),
                ],
                pairs(("part", &[0.4, 0.95]), ("travel", &travels)),
            )
        },
        imitates_coarse_steps: true,
    }
    one_channel {
        rank: 70,
        words: "presliding friction that builds up over a small travel",
        experiment: "small strokes about one place at two speeds that differ tenfold: presliding \
                     follows the travel, smoothing of friction the speed, a relaxing branch the \
                     time",
        refines: Some("coulomb_friction"),
        terms: |axis| vec![Term::positive("bristle_force", axis.units.force)],
        shapes: |axis| {
            let longest = if axis.spring { LONGEST_OF_ELEMENTS } else { LONGEST };
            let range = (1e-4 * axis.travel(), longest * axis.travel());
            vec![Shape::by_factors("travel", axis.units.position, range, 8)]
        },
        columns: Some(|view, shapes| {
            let mut state = 0.0;
            let mut last = view.signals.position.first().copied().unwrap_or(0.0);
            // Exact for a movement that keeps its direction between samples.
            let bristle = |x: &f64| {
                let step = x - last;
                last = *x;
                if step != 0.0 {
                    let side = step.signum();
                    state = side + (state - side) * (-step.abs() / shapes[0]).exp();
                }
                state
            };
            vec![view.signals.position.iter().map(bristle).collect()]
        }),
        states: 1,
        rates: |now, shapes, states, rates| {
            rates[0] = (now.velocity - now.velocity.abs() * states[0]) / shapes[0]
        },
        force: Some(|_, _, states, out| out[0] = states[0]),
        // The plant's is a fraction of the friction of the side.
        of_plant: |_| None,
    }
}

impl Effect for PreslidingHysteresis {
    fn side(&mut self, load: &mut SideLoad, moment: &Moment) {
        let dry = load.load.dry;
        if self.stiffness == 0.0 {
            // Fixed from here on: a spring whose stiffness changes while it is bent would give
            // energy.
            self.stiffness =
                0.5 * self.part * (dry.forward_at_rest + dry.backward_at_rest) / self.travel;
        }
        let level = self.part * if load.velocity_rad_s >= 0.0 { dry.forward } else { dry.backward };
        let at = load.operating_point(moment);
        self.bristle.contribute(&mut load.load, self.stiffness, level, &at);
        load.load.dry.scale(1.0 - self.part);
    }

    fn moved(&mut self, displacement: f64, _moment: &Moment) {
        self.bristle.settle(displacement);
    }

    fn prepare(&mut self, _constants: &dyn LineConstants) {
        self.bristle = Bristle::default();
        self.stiffness = 0.0;
    }

    fn demand(&self) -> Demand {
        // Bristle stiffness p F / q_d on the side's inertia, for frictions of a few N m on 2e-3 kg
        // m².
        Demand { rate_rad_s: (1000.0 * self.part / self.travel).sqrt(), ..Demand::default() }
    }
}
