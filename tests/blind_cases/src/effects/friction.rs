//! Listed effects on the friction of master and slave.

use super::{Entry, Site, Values, Variable};
use crate::deviation::{Deviation, Side, View};
use crate::random::Draw;

macro_rules! both_sides {
    ($($id:literal $depends:ident $draw:path, $build:path;)+) => {
        &[$(
            Entry {
                id: $id,
                site: Site::Master,
                depends_on: &[Variable::$depends],
                draw: $draw,
                build: $build,
            },
            Entry {
                id: $id,
                site: Site::Slave,
                depends_on: &[Variable::$depends],
                draw: $draw,
                build: $build,
            },
        )+]
    };
}

pub(super) const ENTRIES: &[Entry] = both_sides! {
    "coulomb_friction" Velocity Coulomb::draw, Coulomb::build;
    "viscous_friction" Velocity Viscous::draw, Viscous::build;
    "quadratic_drag" Velocity Drag::draw, Drag::build;
    "stribeck_friction" Velocity Breakaway::draw, Breakaway::build;
    "asymmetric_friction" Velocity Asymmetric::draw, Asymmetric::build;
    "position_dependent_friction" Position Uneven::draw, Uneven::build;
    "load_dependent_friction" Load Loaded::draw, Loaded::build;
    "presliding_hysteresis" Position Bristles::draw, Bristles::build;
    "thermal_drift" Time Warming::draw, Warming::build;
};

/// `c` in either direction, more than the tolerances of the declared friction.
#[derive(Debug)]
struct Coulomb {
    side: usize,
    level: f64,
}

impl Coulomb {
    fn draw(draw: &mut Draw, site: Site) -> Values {
        let level =
            if site == Site::Master { draw.uniform(0.4, 0.8) } else { draw.uniform(0.7, 1.2) };
        Values::of([("level", level, "N m")])
    }

    fn build(values: &Values, site: Site) -> Box<dyn Deviation> {
        Box::new(Self { side: site.side(), level: values.get("level") })
    }
}

impl Deviation for Coulomb {
    fn side(&self, side: &mut Side, _view: &View<'_>, _own: &[f64], _rates: &mut [f64]) {
        if side.side == self.side {
            side.add_dry(self.level);
        }
    }
}

/// `b q̇`; at the slave more than the tolerances of both slopes.
#[derive(Debug)]
struct Viscous {
    side: usize,
    coefficient: f64,
}

impl Viscous {
    fn draw(draw: &mut Draw, site: Site) -> Values {
        let coefficient =
            if site == Site::Master { draw.uniform(0.05, 0.15) } else { draw.uniform(0.12, 0.25) };
        Values::of([("coefficient", coefficient, "N m s/rad")])
    }

    fn build(values: &Values, site: Site) -> Box<dyn Deviation> {
        Box::new(Self { side: site.side(), coefficient: values.get("coefficient") })
    }
}

impl Deviation for Viscous {
    fn side(&self, side: &mut Side, _view: &View<'_>, _own: &[f64], _rates: &mut [f64]) {
        if side.side == self.side {
            side.add_viscous(self.coefficient);
        }
    }
}

/// `c |q̇| q̇`.
#[derive(Debug)]
struct Drag {
    side: usize,
    coefficient: f64,
}

impl Drag {
    fn draw(draw: &mut Draw, _site: Site) -> Values {
        Values::of([("coefficient", draw.uniform(0.01, 0.03), "N m s^2/rad^2")])
    }

    fn build(values: &Values, site: Site) -> Box<dyn Deviation> {
        Box::new(Self { side: site.side(), coefficient: values.get("coefficient") })
    }
}

impl Deviation for Drag {
    fn side(&self, side: &mut Side, _view: &View<'_>, _own: &[f64], _rates: &mut [f64]) {
        if side.side == self.side {
            side.add_viscous(self.coefficient * side.velocity_rad_s.abs());
        }
    }
}

/// Additional friction `s exp(-(q̇/v_s)²)`.
#[derive(Debug)]
struct Breakaway {
    side: usize,
    level: f64,
    speed: f64,
}

impl Breakaway {
    fn draw(draw: &mut Draw, site: Site) -> Values {
        let level =
            if site == Site::Master { draw.uniform(0.3, 0.7) } else { draw.uniform(0.5, 1.2) };
        Values::of([("level", level, "N m"), ("speed", draw.log_uniform(0.5, 1.5), "rad/s")])
    }

    fn build(values: &Values, site: Site) -> Box<dyn Deviation> {
        Box::new(Self { side: site.side(), level: values.get("level"), speed: values.get("speed") })
    }
}

impl Deviation for Breakaway {
    fn side(&self, side: &mut Side, _view: &View<'_>, _own: &[f64], _rates: &mut [f64]) {
        if side.side == self.side {
            side.add_dry(self.level * (-(side.velocity_rad_s / self.speed).powi(2)).exp());
        }
    }
}

/// `+a (1 + t |q̇|)` forward, `-a (1 + t |q̇|)` backward.
#[derive(Debug)]
struct Asymmetric {
    side: usize,
    difference: f64,
    viscous_time: f64,
}

impl Asymmetric {
    fn draw(draw: &mut Draw, site: Site) -> Values {
        let size =
            if site == Site::Master { draw.uniform(0.15, 0.35) } else { draw.uniform(0.2, 0.5) };
        Values::of([
            ("difference", draw.sign() * size, "N m"),
            ("viscous_time", draw.uniform(0.0, 0.05), "s/rad"),
        ])
    }

    fn build(values: &Values, site: Site) -> Box<dyn Deviation> {
        let (difference, viscous_time) = (values.get("difference"), values.get("viscous_time"));
        Box::new(Self { side: site.side(), difference, viscous_time })
    }
}

impl Deviation for Asymmetric {
    fn side(&self, side: &mut Side, _view: &View<'_>, _own: &[f64], _rates: &mut [f64]) {
        if side.side != self.side {
            return;
        }
        let speed = side.velocity_rad_s.abs();
        // Friction never drives the machine: its total stays non-negative.
        let more = self.difference * (1.0 + self.viscous_time * speed);
        side.dry_forward = (side.dry_forward + more).max(0.0);
        side.dry_backward = (side.dry_backward - more).max(0.0);
    }
}

/// All dry friction times `1 + a sin(n q + φ)`.
#[derive(Debug)]
struct Uneven {
    side: usize,
    amplitude: f64,
    order: f64,
    phase: f64,
}

impl Uneven {
    fn draw(draw: &mut Draw, _site: Site) -> Values {
        Values::of([
            ("amplitude", draw.uniform(0.2, 0.45), "1"),
            ("order", draw.uniform(1.0, 5.0), "1/rad"),
            ("phase", draw.phase(), "rad"),
        ])
    }

    fn build(values: &Values, site: Site) -> Box<dyn Deviation> {
        let (amplitude, order, phase) =
            (values.get("amplitude"), values.get("order"), values.get("phase"));
        Box::new(Self { side: site.side(), amplitude, order, phase })
    }
}

impl Deviation for Uneven {
    fn side(&self, side: &mut Side, _view: &View<'_>, _own: &[f64], _rates: &mut [f64]) {
        if side.side == self.side {
            side.scale_dry(
                1.0 + self.amplitude * (self.order * side.position_rad + self.phase).sin(),
            );
        }
    }
}

/// Additional friction `μ |τ_line|`.
#[derive(Debug)]
struct Loaded {
    side: usize,
    coefficient: f64,
}

impl Loaded {
    fn draw(draw: &mut Draw, _site: Site) -> Values {
        Values::of([("coefficient", draw.uniform(0.12, 0.3), "1")])
    }

    fn build(values: &Values, site: Site) -> Box<dyn Deviation> {
        Box::new(Self { side: site.side(), coefficient: values.get("coefficient") })
    }
}

impl Deviation for Loaded {
    fn side(&self, side: &mut Side, _view: &View<'_>, _own: &[f64], _rates: &mut [f64]) {
        if side.side == self.side {
            side.add_dry(self.coefficient * side.transmitted_nm.abs());
        }
    }
}

/// A part `p` of the dry friction follows Dahl's law with the stiffness `p F₀/q_d`; the rest stays
/// dry.
#[derive(Debug)]
struct Bristles {
    side: usize,
    part: f64,
    travel: f64,
}

impl Bristles {
    fn draw(draw: &mut Draw, _site: Site) -> Values {
        Values::of([
            ("part", draw.uniform(0.5, 0.9), "1"),
            ("travel", draw.log_uniform(0.02, 0.06), "rad"),
        ])
    }

    fn build(values: &Values, site: Site) -> Box<dyn Deviation> {
        Box::new(Self { side: site.side(), part: values.get("part"), travel: values.get("travel") })
    }
}

impl Deviation for Bristles {
    fn states(&self) -> usize {
        1
    }

    fn side(&self, side: &mut Side, _view: &View<'_>, own: &[f64], rates: &mut [f64]) {
        if side.side != self.side {
            return;
        }
        let velocity = side.velocity_rad_s;
        let stiffness = self.part * side.dry_at_rest_nm / self.travel;
        let level = self.part * if velocity >= 0.0 { side.dry_forward } else { side.dry_backward };
        rates[0] = velocity - stiffness * velocity.abs() * own[0] / level.max(1e-3);
        side.torque_nm -= stiffness * own[0];
        side.scale_dry(1.0 - self.part);
    }
}

/// Friction times `1 + a exp(-t/τ)`.
#[derive(Debug)]
struct Warming {
    side: usize,
    excess: f64,
    time_constant_s: f64,
}

impl Warming {
    fn draw(draw: &mut Draw, _site: Site) -> Values {
        Values::of([
            ("excess", draw.uniform(0.4, 0.9), "1"),
            ("time_constant_s", draw.uniform(20.0, 60.0), "s"),
        ])
    }

    fn build(values: &Values, site: Site) -> Box<dyn Deviation> {
        let (excess, time_constant_s) = (values.get("excess"), values.get("time_constant_s"));
        Box::new(Self { side: site.side(), excess, time_constant_s })
    }
}

impl Deviation for Warming {
    fn side(&self, side: &mut Side, view: &View<'_>, _own: &[f64], _rates: &mut [f64]) {
        if side.side == self.side {
            let factor = 1.0 + self.excess * (-view.time_s / self.time_constant_s).exp();
            side.scale_dry(factor);
            side.viscous_forward *= factor;
            side.viscous_backward *= factor;
        }
    }
}
