//! `slip`: a cable or a belt that slips on the pulley of one side, or is torn.
//!
//! The pulley transmits no more than a torque `T`, as dry friction does: each of the two lines at
//! it carries up to `T / (2 a)`, `a` the displacement per angle. Beyond it the line slips and its
//! deflection stays where the declared spring carries that force (Jenkins's element: a spring in
//! series with dry friction); no damper acts while it slips. With `T = 0` it is torn.
//!
//! Once over, it holds where it then lies: what it slipped stays.

use super::super::{Breakdown, Effect, Link, Moment, Side, Site, effect};

effect! {
    "slip": "a cable or belt that slips on its pulley";
    at Master = 0.1 "N m", Slave = 0.1 "N m";
    /// A cable or belt that slips.
    pub struct Slip {
        /// Torque that the pulley still transmits; 0: torn.
        torque_nm: "N m (N)", 0.0, 1e4, 0.1, "assumed";
    }
    state {
        breakdown: Breakdown = Breakdown::default();
    }
}

impl Effect for Slip {
    fn acts_on_links(&self) -> bool {
        true
    }

    fn breakdown(&self) -> Option<&Breakdown> {
        Some(&self.breakdown)
    }

    fn breakdown_mut(&mut self) -> Option<&mut Breakdown> {
        Some(&mut self.breakdown)
    }

    fn deflect(&mut self, link: &mut Link, _moment: &Moment) {
        if !matches!(
            (self.site, link.end),
            (Site::Master, Side::Master) | (Site::Slave, Side::Slave)
        ) {
            return;
        }
        let slipped_m = &mut self.breakdown.offset_m[link.line][link.end as usize];
        link.deflection_m -= *slipped_m;
        if self.breakdown.over {
            return;
        }
        let most_n = 0.5 * self.torque_nm / link.displacement_m_per_rad;
        let most_m = most_n / link.stiffness_n_per_m;
        let held_m = link.deflection_m.clamp(-most_m, most_m);
        if held_m != link.deflection_m || most_m == 0.0 {
            *slipped_m += link.deflection_m - held_m;
            link.deflection_m = held_m;
            link.rate_m_s = 0.0;
        }
    }
}
