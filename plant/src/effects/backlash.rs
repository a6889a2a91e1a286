//! `backlash`: a gap in the line or at one side.
//!
//! No force while the deflection stays within a gap of width `b`; beyond it the spring acts on the
//! rest: `x → x - clamp(x, -b/2, b/2)`. At the line the gap is split between both ends, in m of
//! fluid displacement; at master or slave it is the play of that side's belt and pulley, in rad.
//! The port damping acts only beyond the gap. Source: Nordin and Gutman, Automatica 38 (2002), dead
//! zone model.

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
}

impl Effect for Backlash {
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
