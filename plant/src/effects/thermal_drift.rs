//! `thermal_drift`: friction that changes as the machine warms.
//!
//! Friction (at a side: dry and viscous; at the line: the fluid's loss) times `1 + a exp(-t/τ)`,
//! `t` since the start: more when cold for positive `a`.

use super::search::{Becomes, SearchRange, pairs};
use super::{Effect, Moment, SideLoad, effect};

effect! {
    "thermal_drift": "friction or viscosity that drifts with time on the run";
    at Master = 0.5 "1", Slave = 0.5 "1", Line = 0.5 "1";
    /// Friction that changes as the machine warms.
    pub struct ThermalDrift {
        /// Excess when cold `a`.
        excess: "1", -0.9, 20.0, 0.5, "assumed";
        /// Time constant `τ`.
        time_constant_s: "s", 0.1, 1e5, 20.0, "assumed";
    }
    search {
        space: |of| of
            .space(
                [
                    SearchRange::linear("excess", -0.9, 6.0),
                    SearchRange::logarithmic("time_constant_s", 3.0, 1000.0),
                ],
                pairs(("excess", &[0.3]), ("time_constant_s", &[10.0, 30.0, 100.0])),
            )
            .signed(),
        becomes: Some(Becomes { parameter: "time_constant_s", id: "coulomb_friction" }),
    }
}

impl Effect for ThermalDrift {
    fn side(&mut self, load: &mut SideLoad, moment: &Moment) {
        let factor = self.factor(moment);
        load.load.dry.scale(factor);
        load.load.viscous_forward *= factor;
        load.load.viscous_backward *= factor;
    }

    fn fluid(&mut self, coefficient: f64, moment: &Moment) -> f64 {
        coefficient * self.factor(moment)
    }
}

impl ThermalDrift {
    fn factor(&self, moment: &Moment) -> f64 {
        1.0 + self.excess * (-moment.time_s / self.time_constant_s).exp()
    }
}
