//! Listed effects at the line, and backlash.

use super::{Entry, Site, Values, Variable};
use crate::deviation::{Deviation, Link, View};
use crate::machine_parameters::MachineParameters;
use crate::random::Draw;

/// Force at which `nonlinear_stiffness` has its reference deflection, N.
const REFERENCE_N: f64 = 20.0;
/// Cells of the ladder network that represents a lossless line.
const CELLS: usize = 8;

pub(super) const ENTRIES: &[Entry] = &[
    Entry {
        id: "line_compliance",
        site: Site::Line,
        depends_on: &[Variable::Load],
        // Beyond the tolerances of stiffness factor, modulus, area and length together: 0.67 of the
        // declared stiffness.
        draw: |draw, _| Values::of([("compliance_ratio", draw.uniform(0.9, 1.6), "1")]),
        build: |values, _| Box::new(Compliance { ratio: values.get("compliance_ratio") }),
    },
    Entry {
        id: "nonlinear_stiffness",
        site: Site::Line,
        depends_on: &[Variable::Load],
        draw: draw_nonlinear,
        build: build_nonlinear,
    },
    Entry {
        id: "nonlinear_stiffness",
        site: Site::Slave,
        depends_on: &[Variable::Load],
        draw: draw_nonlinear,
        build: build_nonlinear,
    },
    Entry {
        id: "viscoelastic_line",
        site: Site::Line,
        depends_on: &[Variable::Load],
        draw: |draw, _| {
            Values::of([
                ("stiffness_ratio", draw.uniform(0.3, 1.0), "1"),
                ("relaxation_s", draw.log_uniform(0.03, 0.3), "s"),
            ])
        },
        build: |values, _| {
            Box::new(Maxwell {
                ratio: values.get("stiffness_ratio"),
                relaxation_s: values.get("relaxation_s"),
            })
        },
    },
    Entry {
        id: "leakage",
        site: Site::Line,
        depends_on: &[Variable::Load],
        draw: |draw, _| Values::of([("conductance", draw.log_uniform(3e-13, 2e-12), "m^3/(s Pa)")]),
        build: |values, _| {
            Box::new(Leakage { conductance: values.get("conductance"), m_s_per_n: 0.0.into() })
        },
    },
    Entry {
        id: "backlash",
        site: Site::Line,
        depends_on: &[Variable::Load],
        draw: |draw, _| Values::of([("gap", draw.uniform(6e-4, 2e-3), "m")]),
        build: build_backlash,
    },
    Entry {
        id: "backlash",
        site: Site::Master,
        depends_on: &[Variable::Load],
        draw: |draw, _| Values::of([("gap", draw.uniform(0.02, 0.06), "rad")]),
        build: build_backlash,
    },
    Entry {
        id: "backlash",
        site: Site::Slave,
        depends_on: &[Variable::Load],
        draw: |draw, _| Values::of([("gap", draw.uniform(0.02, 0.06), "rad")]),
        build: build_backlash,
    },
    Entry {
        id: "transport_delay",
        site: Site::Line,
        depends_on: &[Variable::Time],
        draw: |draw, _| Values::of([("delay_s", draw.uniform(4e-3, 10e-3), "s")]),
        build: |values, _| {
            Box::new(Stretch { delay_s: values.get("delay_s"), cell: Cell::default().into() })
        },
    },
    Entry {
        id: "line_damping",
        site: Site::Line,
        depends_on: &[Variable::Velocity],
        draw: |draw, _| Values::of([("damping", draw.uniform(10.0, 40.0), "N s/m")]),
        build: |values, _| Box::new(Damping { damping: values.get("damping") }),
    },
    Entry {
        id: "thermal_drift",
        site: Site::Line,
        depends_on: &[Variable::Time],
        draw: |draw, _| {
            Values::of([
                ("excess", draw.uniform(1.5, 4.0), "1"),
                ("time_constant_s", draw.uniform(20.0, 60.0), "s"),
            ])
        },
        build: |values, _| {
            Box::new(ThinningOil {
                excess: values.get("excess"),
                time_constant_s: values.get("time_constant_s"),
            })
        },
    },
];

/// `1/K' = (1 + r)/K`.
#[derive(Debug)]
struct Compliance {
    ratio: f64,
}

impl Deviation for Compliance {
    fn alter(&self, machine: &mut MachineParameters) {
        machine.line_stiffness_factor /= 1.0 + self.ratio;
    }
}

fn draw_nonlinear(draw: &mut Draw, site: Site) -> Values {
    // At the slave only half of the springs are nonlinear.
    let more = if site == Site::Slave { 1.5 } else { 1.0 };
    let cubic =
        if draw.sign() > 0.0 { draw.uniform(0.1, 0.3) } else { -draw.uniform(0.05, 0.1) } * more;
    Values::of([
        ("cubic", cubic, "1"),
        ("even", draw.sign() * draw.uniform(0.02, 0.08) * more, "1"),
    ])
}

fn build_nonlinear(values: &Values, site: Site) -> Box<dyn Deviation> {
    Box::new(Nonlinear {
        cubic: values.get("cubic"),
        even: values.get("even"),
        slave_only: site == Site::Slave,
    })
}

/// `F = k x (1 + e y/x₀ + c (y/x₀)²)`, `x₀ = 20 N / 2K`, `y` positive while the slave is driven
/// forward; no softer than 5 %.
#[derive(Debug)]
struct Nonlinear {
    cubic: f64,
    even: f64,
    slave_only: bool,
}

impl Deviation for Nonlinear {
    fn link(&self, link: &mut Link, _view: &View<'_>, _own: &[f64], _rates: &mut [f64]) {
        if self.slave_only && link.side == 0 {
            return;
        }
        let part = link.deflection_m * link.stiffness_n_per_m / REFERENCE_N;
        let forward = if link.side == 1 { part } else { -part };
        let more = (self.even * forward + self.cubic * part * part).max(-0.95);
        let force = link.stiffness_n_per_m * link.deflection_m * more;
        link.force_n += force;
        link.fluid_force_n += force;
    }
}

/// A Maxwell branch in parallel with each spring; its states are the displacements of the dashpots.
#[derive(Debug)]
struct Maxwell {
    ratio: f64,
    relaxation_s: f64,
}

impl Deviation for Maxwell {
    fn states(&self) -> usize {
        4
    }

    fn link(&self, link: &mut Link, _view: &View<'_>, own: &[f64], rates: &mut [f64]) {
        let index = 2 * link.line + link.side;
        let stretch = link.deflection_m - own[index];
        rates[index] = stretch / self.relaxation_s;
        let force = self.ratio * link.stiffness_n_per_m * stretch;
        link.force_n += force;
        link.fluid_force_n += force;
    }
}

/// `Q = G Δp` past each piston: a deflection under force creeps with `2 G F / A²`.
#[derive(Debug)]
struct Leakage {
    conductance: f64,
    m_s_per_n: std::cell::Cell<f64>,
}

impl Deviation for Leakage {
    fn states(&self) -> usize {
        4
    }

    fn alter(&self, machine: &mut MachineParameters) {
        self.m_s_per_n.set(2.0 * self.conductance / machine.hose_area_m2.powi(2));
    }

    fn stretch(&self, link: &mut Link, _view: &View<'_>, own: &[f64]) {
        link.deflection_m -= own[2 * link.line + link.side];
    }

    fn link(&self, link: &mut Link, _view: &View<'_>, _own: &[f64], rates: &mut [f64]) {
        rates[2 * link.line + link.side] = self.m_s_per_n.get() * link.force_n;
    }
}

fn build_backlash(values: &Values, site: Site) -> Box<dyn Deviation> {
    Box::new(Backlash { gap: values.get("gap"), site })
}

/// No force within a gap; at the line it is split between both ends, in m of fluid.
#[derive(Debug)]
struct Backlash {
    gap: f64,
    site: Site,
}

impl Deviation for Backlash {
    fn stretch(&self, link: &mut Link, _view: &View<'_>, _own: &[f64]) {
        let half = match (self.site, link.side) {
            (Site::Line, _) => 0.25 * self.gap,
            (Site::Master, 0) | (Site::Slave, 1) => 0.5 * self.gap * link.displacement_m_per_rad,
            _ => return,
        };
        if link.deflection_m.abs() <= half {
            (link.deflection_m, link.rate_m_s) = (0.0, 0.0);
        } else {
            link.deflection_m -= half.copysign(link.deflection_m);
        }
    }
}

/// Mass and spring of a cell of the ladder.
#[derive(Clone, Copy, Debug, Default)]
struct Cell {
    mass_kg: f64,
    stiffness_n_per_m: f64,
}

/// A lossless line of travel time `T` and wave impedance `Z = √(K m_l)` before the spring of the
/// slave: a ladder of masses `Z T/n` and springs `n Z/T`. States: position and speed of each mass,
/// per line.
#[derive(Debug)]
struct Stretch {
    delay_s: f64,
    cell: std::cell::Cell<Cell>,
}

impl Deviation for Stretch {
    fn states(&self) -> usize {
        4 * CELLS
    }

    fn alter(&self, machine: &mut MachineParameters) {
        let impedance = (machine.line_stiffness_n_per_m() * machine.fluid_mass_kg()).sqrt();
        let time = self.delay_s / CELLS as f64;
        self.cell.set(Cell { mass_kg: impedance * time, stiffness_n_per_m: impedance / time });
    }

    fn stretch(&self, link: &mut Link, view: &View<'_>, own: &[f64]) {
        if link.side == 1 {
            let last = 2 * CELLS * link.line + 2 * (CELLS - 1);
            link.deflection_m += own[last] - link.fluid_position_m;
            link.rate_m_s += own[last + 1] - view.fluid_velocity[link.line];
        }
    }

    fn link(&self, link: &mut Link, _view: &View<'_>, own: &[f64], rates: &mut [f64]) {
        if link.side == 0 {
            return;
        }
        let cell = self.cell.get();
        let from = 2 * CELLS * link.line;
        let mut before = link.fluid_position_m;
        for index in 0..CELLS {
            let at = from + 2 * index;
            let onward = if index + 1 < CELLS {
                cell.stiffness_n_per_m * (own[at] - own[at + 2])
            } else {
                link.force_n
            };
            rates[at] = own[at + 1];
            rates[at + 1] = (cell.stiffness_n_per_m * (before - own[at]) - onward) / cell.mass_kg;
            before = own[at];
        }
        link.fluid_force_n = cell.stiffness_n_per_m * (link.fluid_position_m - own[from]);
    }
}

/// `D' = D + c`.
#[derive(Debug)]
struct Damping {
    damping: f64,
}

impl Deviation for Damping {
    fn alter(&self, machine: &mut MachineParameters) {
        machine.port_damping_n_s_per_m += self.damping;
    }
}

/// The hose's loss times `1 + a exp(-t/τ)`.
#[derive(Debug)]
struct ThinningOil {
    excess: f64,
    time_constant_s: f64,
}

impl Deviation for ThinningOil {
    fn hose_loss(&self, _line: usize, loss: f64, view: &View<'_>) -> f64 {
        loss * (1.0 + self.excess * (-view.time_s / self.time_constant_s).exp())
    }
}
