//! Listed effects that put a torque or an inertia on master or slave.

use super::{Entry, Site, Values, Variable};
use crate::deviation::{Deviation, Side, View};
use crate::random::Draw;

pub(super) const ENTRIES: &[Entry] = &[
    gravity(Site::Master),
    gravity(Site::Slave),
    inertia(Site::Master),
    inertia(Site::Slave),
    Entry {
        id: "hand_impedance",
        site: Site::Slave,
        depends_on: &[Variable::Position, Variable::Velocity],
        draw: |draw, _| {
            Values::of([
                ("stiffness", draw.uniform(0.4, 1.5), "N m/rad"),
                ("damper_time_s", draw.uniform(0.02, 0.1), "s"),
                ("inertia_time_s", draw.uniform(0.02, 0.06), "s"),
            ])
        },
        build: |values, _| {
            Box::new(Hand {
                stiffness: values.get("stiffness"),
                damper_time_s: values.get("damper_time_s"),
                inertia_time_s: values.get("inertia_time_s"),
            })
        },
    },
    periodic(Site::Slave),
    periodic(Site::Master),
];

const fn gravity(site: Site) -> Entry {
    Entry {
        id: "gravity_imbalance",
        site,
        depends_on: &[Variable::Position],
        draw: |draw, _| {
            Values::of([("torque", draw.uniform(0.2, 0.6), "N m"), ("phase", draw.phase(), "rad")])
        },
        build: |values, site| {
            Box::new(Gravity {
                side: site.side(),
                torque: values.get("torque"),
                phase: values.get("phase"),
            })
        },
    }
}

/// `τ = -m g l sin(q + φ)`.
#[derive(Debug)]
struct Gravity {
    side: usize,
    torque: f64,
    phase: f64,
}

impl Deviation for Gravity {
    fn side(&self, side: &mut Side, _view: &View<'_>, _own: &[f64], _rates: &mut [f64]) {
        if side.side == self.side {
            side.torque_nm -= self.torque * (side.position_rad + self.phase).sin();
        }
    }
}

const fn inertia(site: Site) -> Entry {
    Entry {
        id: "extra_inertia",
        site,
        depends_on: &[Variable::Acceleration],
        draw: draw_inertia,
        build: |values, site| {
            Box::new(Inertia { side: site.side(), inertia: values.get("inertia") })
        },
    }
}

/// Several times the tolerances of the inertia of the side and of the mass of the fluid.
fn draw_inertia(draw: &mut Draw, site: Site) -> Values {
    let inertia =
        if site == Site::Master { draw.uniform(3e-3, 8e-3) } else { draw.uniform(1.5e-3, 4e-3) };
    Values::of([("inertia", inertia, "kg m^2")])
}

/// `I' = I + J`.
#[derive(Debug)]
struct Inertia {
    side: usize,
    inertia: f64,
}

impl Deviation for Inertia {
    fn inertia(&self, side: usize) -> f64 {
        if side == self.side { self.inertia } else { 0.0 }
    }
}

/// `τ = -k q - k t_b q̇`, inertia `k t_J²`: a limb at the slave that the cell does not measure.
#[derive(Debug)]
struct Hand {
    stiffness: f64,
    damper_time_s: f64,
    inertia_time_s: f64,
}

impl Deviation for Hand {
    fn inertia(&self, side: usize) -> f64 {
        if side == 1 { self.stiffness * self.inertia_time_s.powi(2) } else { 0.0 }
    }

    fn side(&self, side: &mut Side, _view: &View<'_>, _own: &[f64], _rates: &mut [f64]) {
        if side.side == 1 {
            side.torque_nm -= self.stiffness * side.position_rad;
            side.add_viscous(self.stiffness * self.damper_time_s);
        }
    }
}

const fn periodic(site: Site) -> Entry {
    Entry {
        id: "periodic_disturbance",
        site,
        depends_on: &[Variable::Time],
        draw: |draw, site| {
            // Fast vibrations hardly move a machine that is held by friction.
            let size =
                if site == Site::Slave { draw.uniform(0.3, 0.7) } else { draw.uniform(0.2, 0.5) };
            let frequency = draw.log_uniform(4.0, 14.0);
            Values::of([
                ("amplitude", size, "N m"),
                ("frequency_hz", frequency, "Hz"),
                ("phase", draw.phase(), "rad"),
            ])
        },
        build: |values, site| {
            Box::new(Vibration {
                side: site.side(),
                amplitude: values.get("amplitude"),
                rate: std::f64::consts::TAU * values.get("frequency_hz"),
                phase: values.get("phase"),
            })
        },
    }
}

/// `τ = a sin(2π f t + φ)`, time since the start of the first record.
#[derive(Debug)]
struct Vibration {
    side: usize,
    amplitude: f64,
    rate: f64,
    phase: f64,
}

impl Deviation for Vibration {
    fn side(&self, side: &mut Side, view: &View<'_>, _own: &[f64], _rates: &mut [f64]) {
        if side.side == self.side {
            side.torque_nm += self.amplitude * (self.rate * view.time_s + self.phase).sin();
        }
    }
}
