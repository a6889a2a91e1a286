//! Unlisted effects at the line.

use super::{Entry, Site, Values, Variable};
use crate::deviation::{Deviation, Link, View};

pub(super) const ENTRIES: &[Entry] = &[
    Entry {
        id: "one_way_orifice",
        site: Site::Line,
        depends_on: &[Variable::Velocity],
        draw: |draw, _| Values::of([("coefficient", draw.uniform(60.0, 160.0), "N s^2/m^2")]),
        build: |values, _| Box::new(Orifice { coefficient: values.get("coefficient") }),
    },
    Entry {
        id: "relief_valve",
        site: Site::Line,
        depends_on: &[Variable::Load],
        draw: |draw, _| {
            Values::of([
                ("opening_n", draw.uniform(16.0, 19.0), "N"),
                ("slope", draw.uniform(3e-3, 1e-2), "m/(s N)"),
            ])
        },
        build: |values, _| {
            Box::new(Relief { opening_n: values.get("opening_n"), slope: values.get("slope") })
        },
    },
    Entry {
        id: "column_separation",
        site: Site::Line,
        depends_on: &[Variable::Load],
        draw: |draw, _| Values::of([("tension_n", draw.uniform(6.0, 12.0), "N")]),
        build: |values, _| Box::new(Separation { tension_n: values.get("tension_n") }),
    },
];

/// A chip at one port of the first line that acts as a flap: `F = c v²` while the fluid flows
/// forward, no loss backward.
#[derive(Debug)]
struct Orifice {
    coefficient: f64,
}

impl Deviation for Orifice {
    fn hose_loss(&self, line: usize, loss: f64, view: &View<'_>) -> f64 {
        if line == 0 { loss + self.coefficient * view.fluid_velocity[0].max(0.0) } else { loss }
    }
}

/// A relief valve between the chambers: a deflection under a force beyond its opening force creeps,
/// under a smaller one it stays.
#[derive(Debug)]
struct Relief {
    opening_n: f64,
    slope: f64,
}

impl Deviation for Relief {
    fn states(&self) -> usize {
        4
    }

    fn stretch(&self, link: &mut Link, _view: &View<'_>, own: &[f64]) {
        link.deflection_m -= own[2 * link.line + link.side];
    }

    fn link(&self, link: &mut Link, _view: &View<'_>, _own: &[f64], rates: &mut [f64]) {
        let beyond = (link.force_n.abs() - self.opening_n).max(0.0).copysign(link.force_n);
        rates[2 * link.line + link.side] = self.slope * beyond;
    }
}

/// Time in which a pocket opens or closes, s.
const POCKET_S: f64 = 2e-3;

/// A line with limited tension: beyond it a pocket of vapour opens, and must be filled before the
/// line carries pressure again. The lines push in opposite directions, so that one of them is
/// always under tension. States: size of the pocket at each end, m.
#[derive(Debug)]
struct Separation {
    tension_n: f64,
}

impl Separation {
    /// Sign of the force of a link under tension: the first line is compressed while the slave is
    /// driven forward, the second while it is driven backward.
    fn tension(link: &Link) -> f64 {
        let pressed = if link.side == 1 { 1.0 } else { -1.0 };
        if link.line == 0 { -pressed } else { pressed }
    }
}

impl Deviation for Separation {
    fn states(&self) -> usize {
        4
    }

    fn stretch(&self, link: &mut Link, _view: &View<'_>, own: &[f64]) {
        link.deflection_m -= Self::tension(link) * own[2 * link.line + link.side].max(0.0);
    }

    fn link(&self, link: &mut Link, _view: &View<'_>, own: &[f64], rates: &mut [f64]) {
        let index = 2 * link.line + link.side;
        let tension = Self::tension(link) * link.force_n;
        rates[index] = if tension > self.tension_n {
            (tension - self.tension_n) / link.stiffness_n_per_m / POCKET_S
        } else if tension < 0.0 && own[index] > 0.0 {
            tension / link.stiffness_n_per_m / POCKET_S
        } else {
            0.0
        };
    }
}
