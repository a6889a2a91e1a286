//! `backlash`: a gap in the line or at one side.
//!
//! No force while the deflection stays within a gap of width `b`; beyond it the spring acts on the
//! rest: `x → x - clamp(x, -b/2, b/2)`. At the line the gap is split between both ends, in m of
//! fluid displacement; at master or slave it is the play of that side's belt and pulley, in rad.
//! The port damping acts only beyond the gap. Source: Nordin and Gutman, Automatica 38 (2002), dead
//! zone model.
//!
//! # In a model of one channel
//!
//! Backlash: a gap in which no force is transmitted.
//!
//! `F = -stiffness_lost · clamp(x - centre, ±gap/2)` beside the declared `k x`, with
//! `stiffness_lost` near `k`: inside the gap there is no spring force, outside it the force starts
//! from the edge of the gap. Source: Nordin and Gutman, Automatica 38 (2002), dead zone model.
//!
//! Parameters: `gap` (m or rad), 0.5 to 60 % of the travel; `centre` (m or rad), within the travel;
//! `stiffness_lost` (N/m or N·m/rad), at least 0, near the stiffness for a real gap.
//!
//! In a residual: plotted over the position, a flat part between two kinks, without a loop.
//! Confused with: a stiffening spring (no kinks), presliding hysteresis (a loop).

use super::one_channel::{Shape, Term};
use super::{Effect, Link, Moment, Side, Site, effect};

effect! {
    "backlash": "backlash";
    at Line = 1e-3 "m", Master = 0.02 "rad", Slave = 0.02 "rad";
    /// A gap without force.
    pub struct Backlash {
        /// Width of the gap: m at the line, rad at master or slave.
        gap: "m or rad", 0.0, 1.0, 1e-3, "play of a worn belt or piston rod";
    }
    search {
        space: |of| of.sizes(of.up_to("gap", 20.0), &[0.25, 1.0, 3.0]),
    }
    monitoring {
        proportional: false,
    }
    one_channel {
        rank: 130,
        words: "backlash",
        experiment: "very slow load and unload through zero force, with the position read finely: \
                     the flat part is the gap",
        applies: |axis| axis.spring,
        terms: |axis| vec![Term::positive("stiffness_lost", axis.units.stiffness)],
        shapes: |axis| {
            let (low, travel) = (axis.positions.0, axis.travel());
            vec![
                Shape::by_factors("gap", axis.units.position, (0.005 * travel, 0.6 * travel), 8),
                Shape::by_steps(
                    "centre",
                    axis.units.position,
                    (low + 0.1 * travel, low + 0.9 * travel),
                    17,
                ),
            ]
        },
        force: Some(|now, shapes, _, out| {
            let half = 0.5 * shapes[0];
            out[0] = -(now.position - shapes[1]).clamp(-half, half);
        }),
        // The plant's gap is centred at zero and takes the whole force.
        of_plant: |_| None,
    }
}

impl Effect for Backlash {
    fn acts_on_links(&self) -> bool {
        true
    }

    fn deflect(&mut self, link: &mut Link, _moment: &Moment) {
        let half = match (self.site, link.end) {
            (Site::Master, Side::Master) | (Site::Slave, Side::Slave) => {
                0.5 * self.gap * link.displacement_m_per_rad
            }
            (Site::Line, _) => 0.25 * self.gap,
            _ => return,
        };
        let inside = link.deflection_m.clamp(-half, half);
        if inside == link.deflection_m {
            link.rate_m_s = 0.0;
        }
        link.deflection_m -= inside;
    }
}
