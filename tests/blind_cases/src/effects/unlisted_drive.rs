//! Unlisted effects at amplifier and motor.

use super::{Entry, Site, Values, Variable};
use crate::deviation::{Deviation, View};

pub(super) const ENTRIES: &[Entry] = &[
    Entry {
        id: "gain_over_angle",
        site: Site::Drive,
        depends_on: &[Variable::Position],
        draw: |draw, _| {
            Values::of([
                ("amplitude", draw.uniform(0.15, 0.35), "1"),
                ("order", draw.choose(&[2.0, 3.0, 4.0]), "1"),
                ("phase", draw.phase(), "rad"),
            ])
        },
        build: |values, _| {
            Box::new(WeakPole {
                amplitude: values.get("amplitude"),
                order: values.get("order"),
                phase: values.get("phase"),
            })
        },
    },
    Entry {
        id: "gain_over_speed",
        site: Site::Drive,
        depends_on: &[Variable::Velocity],
        draw: |draw, _| Values::of([("speed", draw.uniform(5.0, 9.0), "rad/s")]),
        build: |values, _| Box::new(BackVoltage { speed: values.get("speed") }),
    },
    Entry {
        id: "magnetic_play",
        site: Site::Drive,
        depends_on: &[Variable::Volts, Variable::Load],
        draw: |draw, _| Values::of([("half_width", draw.uniform(0.25, 0.6), "V")]),
        build: |values, _| Box::new(Play { half_width: values.get("half_width") }),
    },
    Entry {
        id: "supply_droop",
        site: Site::Drive,
        depends_on: &[Variable::Volts, Variable::Load],
        draw: |draw, _| {
            Values::of([
                ("drop_per_volt", draw.uniform(0.08, 0.16), "1/V"),
                ("time_constant", draw.log_uniform(0.15, 0.6), "s"),
            ])
        },
        build: |values, _| {
            Box::new(Droop {
                drop: values.get("drop_per_volt"),
                time_constant: values.get("time_constant"),
            })
        },
    },
];

/// A magnet that is weaker on one side: motor constant times `1 + a sin(n q_m + φ)`.
#[derive(Debug)]
struct WeakPole {
    amplitude: f64,
    order: f64,
    phase: f64,
}

impl Deviation for WeakPole {
    fn motor(&self, torque_nm: f64, view: &View<'_>) -> f64 {
        torque_nm * (1.0 + self.amplitude * (self.order * view.position[0] + self.phase).sin())
    }
}

/// An amplifier with too low a supply voltage: while driving, its torque falls with speed,
/// `1/(1 + (q̇/v₀)⁴)`; while braking, the back-EMF of the motor helps.
#[derive(Debug)]
struct BackVoltage {
    speed: f64,
}

impl Deviation for BackVoltage {
    fn motor(&self, torque_nm: f64, view: &View<'_>) -> f64 {
        if torque_nm * view.velocity[0] > 0.0 {
            torque_nm / (1.0 + (view.velocity[0] / self.speed).powi(4))
        } else {
            torque_nm
        }
    }
}

/// Hysteresis of the iron: torque follows the voltage with play (Prandtl's operator), so that it
/// lags by the direction of change, not by time. The state is the output of the play.
#[derive(Debug)]
struct Play {
    half_width: f64,
}

impl Deviation for Play {
    fn states(&self) -> usize {
        1
    }

    fn amplifier(&self, volts: f64, _view: &View<'_>, own: &[f64], rates: &mut [f64]) -> f64 {
        // With a time constant of half a millisecond; voltages are held for two.
        let lag = volts - own[0];
        let beyond = (lag.abs() - self.half_width).max(0.0).copysign(lag);
        rates[0] = beyond / 0.5e-3;
        own[0]
    }
}

/// A supply that sags: the gain falls with the low-passed magnitude of the voltage.
#[derive(Debug)]
struct Droop {
    drop: f64,
    time_constant: f64,
}

impl Deviation for Droop {
    fn states(&self) -> usize {
        1
    }

    fn amplifier(&self, volts: f64, _view: &View<'_>, own: &[f64], rates: &mut [f64]) -> f64 {
        rates[0] = (volts.abs() - own[0]) / self.time_constant;
        volts * (1.0 - (self.drop * own[0]).min(0.7))
    }
}
