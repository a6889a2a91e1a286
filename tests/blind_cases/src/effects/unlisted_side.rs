//! Unlisted effects at master and slave.

use super::{Entry, Site, Values, Variable};
use crate::deviation::{Deviation, Link, Side, View};

pub(super) const ENTRIES: &[Entry] = &[
    Entry {
        id: "detent",
        site: Site::Slave,
        depends_on: &[Variable::Position],
        draw: |draw, _| {
            Values::of([
                ("torque", draw.uniform(0.5, 1.2), "N m"),
                ("angle", draw.uniform(-0.35, 0.35), "rad"),
                ("width", draw.uniform(0.05, 0.12), "rad"),
            ])
        },
        build: |values, _| {
            Box::new(Detent {
                torque: values.get("torque"),
                angle: values.get("angle"),
                width: values.get("width"),
            })
        },
    },
    Entry {
        id: "eddy_brake",
        site: Site::Master,
        depends_on: &[Variable::Velocity],
        draw: |draw, _| {
            Values::of([
                ("torque", draw.uniform(0.5, 1.0), "N m"),
                ("speed", draw.uniform(1.5, 3.0), "rad/s"),
            ])
        },
        build: |values, _| {
            Box::new(EddyBrake { torque: values.get("torque"), speed: values.get("speed") })
        },
    },
    Entry {
        id: "clutch_slip",
        site: Site::Master,
        depends_on: &[Variable::Load],
        draw: |draw, _| Values::of([("torque", draw.uniform(1.9, 2.3), "N m")]),
        build: |values, _| Box::new(Clutch { torque: values.get("torque") }),
    },
    Entry {
        id: "compliant_grip",
        site: Site::Slave,
        depends_on: &[Variable::Acceleration],
        draw: |draw, _| {
            Values::of([
                ("inertia", draw.uniform(2e-3, 5e-3), "kg m^2"),
                ("frequency_hz", draw.uniform(2.5, 5.0), "Hz"),
                ("damping_ratio", draw.uniform(0.05, 0.15), "1"),
            ])
        },
        build: |values, _| {
            let rate = std::f64::consts::TAU * values.get("frequency_hz");
            Box::new(Grip {
                inertia: values.get("inertia"),
                rate,
                damping_ratio: values.get("damping_ratio"),
            })
        },
    },
    Entry {
        id: "dwell_friction",
        site: Site::Master,
        depends_on: &[Variable::Time, Variable::Velocity],
        draw: |draw, _| {
            Values::of([
                ("level", draw.uniform(0.8, 1.6), "N m"),
                ("dwell_s", draw.uniform(0.05, 0.2), "s"),
            ])
        },
        build: |values, _| {
            Box::new(Dwell { level: values.get("level"), dwell_s: values.get("dwell_s") })
        },
    },
    Entry {
        id: "bumper",
        site: Site::Slave,
        depends_on: &[Variable::Position],
        draw: |draw, _| {
            Values::of([
                ("stiffness", draw.uniform(4.0, 12.0), "N m/rad"),
                ("angle", draw.sign() * draw.uniform(0.1, 0.3), "rad"),
            ])
        },
        build: |values, _| {
            Box::new(Bumper { stiffness: values.get("stiffness"), angle: values.get("angle") })
        },
    },
    Entry {
        id: "acceleration_friction",
        site: Site::Slave,
        depends_on: &[Variable::Acceleration],
        draw: |draw, _| {
            Values::of([
                ("share", draw.sign() * draw.uniform(0.2, 0.4), "1"),
                ("scale", draw.uniform(10.0, 25.0), "rad/s^2"),
            ])
        },
        build: |values, _| {
            Box::new(Squeeze { share: values.get("share"), scale: values.get("scale") })
        },
    },
];

/// A notch at one angle: a potential well of Gaussian shape, `τ = -τ_d √e (x/w) exp(-x²/2w²)`.
#[derive(Debug)]
struct Detent {
    torque: f64,
    angle: f64,
    width: f64,
}

impl Deviation for Detent {
    fn side(&self, side: &mut Side, _view: &View<'_>, _own: &[f64], _rates: &mut [f64]) {
        if side.side == 1 {
            let x = (side.position_rad - self.angle) / self.width;
            side.torque_nm -= self.torque * x * (0.5 - 0.5 * x * x).exp();
        }
    }
}

/// An eddy-current brake: drag that has its maximum at one speed, `2 τ_p x/(1 + x²)`.
#[derive(Debug)]
struct EddyBrake {
    torque: f64,
    speed: f64,
}

impl Deviation for EddyBrake {
    fn side(&self, side: &mut Side, _view: &View<'_>, _own: &[f64], _rates: &mut [f64]) {
        if side.side == 0 {
            let x = side.velocity_rad_s / self.speed;
            side.torque_nm -= 2.0 * self.torque * x / (1.0 + x * x);
        }
    }
}

/// Slip speed, rad/s per N·m beyond the torque of the clutch.
const SLIP_RAD_S_PER_NM: f64 = 20.0;

/// A belt that slips on its pulley beyond a torque, each of the two at half of it. States: slip of
/// each, rad.
#[derive(Debug)]
struct Clutch {
    torque: f64,
}

impl Deviation for Clutch {
    fn states(&self) -> usize {
        2
    }

    fn stretch(&self, link: &mut Link, _view: &View<'_>, own: &[f64]) {
        if link.side == 0 {
            link.deflection_m += link.displacement_m_per_rad * own[link.line];
        }
    }

    fn link(&self, link: &mut Link, _view: &View<'_>, _own: &[f64], rates: &mut [f64]) {
        if link.side == 0 {
            let torque = link.displacement_m_per_rad * link.force_n;
            let beyond = (torque.abs() - 0.5 * self.torque).max(0.0).copysign(torque);
            rates[link.line] = -SLIP_RAD_S_PER_NM * beyond;
        }
    }
}

/// A mass on a soft grip: a second oscillator at the slave. States: its angle and speed.
#[derive(Debug)]
struct Grip {
    inertia: f64,
    rate: f64,
    damping_ratio: f64,
}

impl Deviation for Grip {
    fn states(&self) -> usize {
        2
    }

    fn side(&self, side: &mut Side, _view: &View<'_>, own: &[f64], rates: &mut [f64]) {
        if side.side == 1 {
            let spring = self.rate * self.rate * (side.position_rad - own[0]);
            let damper = 2.0 * self.damping_ratio * self.rate * (side.velocity_rad_s - own[1]);
            rates[0] = own[1];
            rates[1] = spring + damper;
            side.torque_nm -= self.inertia * (spring + damper);
        }
    }
}

/// Ageing of contacts at rest: extra friction that builds up with the time at rest and vanishes
/// after a short travel. The state is the age, 0 to 1.
#[derive(Debug)]
struct Dwell {
    level: f64,
    dwell_s: f64,
}

impl Deviation for Dwell {
    fn states(&self) -> usize {
        1
    }

    fn side(&self, side: &mut Side, _view: &View<'_>, own: &[f64], rates: &mut [f64]) {
        if side.side == 0 {
            // Broken within a fiftieth of a radian.
            rates[0] = (1.0 - own[0]) / self.dwell_s - own[0] * side.velocity_rad_s.abs() / 0.02;
            side.add_dry(self.level * own[0].clamp(0.0, 1.0));
        }
    }
}

/// A soft bumper beyond one angle: `τ = -k x²/(x + 0.05 rad)`, in compression only.
#[derive(Debug)]
struct Bumper {
    stiffness: f64,
    angle: f64,
}

impl Deviation for Bumper {
    fn side(&self, side: &mut Side, _view: &View<'_>, _own: &[f64], _rates: &mut [f64]) {
        if side.side == 1 {
            let into = (side.position_rad - self.angle) * self.angle.signum();
            if into > 0.0 {
                side.torque_nm -=
                    self.stiffness * into * into / (into + 0.05) * self.angle.signum();
            }
        }
    }
}

/// Time constant of the oil film, s.
const FILM_S: f64 = 8e-3;

/// A squeezed film: dry friction that is larger during acceleration than during deceleration (or
/// vice versa), `1 + a tanh(v̇ sgn v/s)`. The state is the low-passed speed.
#[derive(Debug)]
struct Squeeze {
    share: f64,
    scale: f64,
}

impl Deviation for Squeeze {
    fn states(&self) -> usize {
        1
    }

    fn side(&self, side: &mut Side, _view: &View<'_>, own: &[f64], rates: &mut [f64]) {
        if side.side == 1 {
            let acceleration = (side.velocity_rad_s - own[0]) / FILM_S;
            rates[0] = acceleration;
            let away = acceleration * side.smoothing.share(side.velocity_rad_s);
            side.scale_dry(1.0 + self.share * (away / self.scale).tanh());
        }
    }
}
