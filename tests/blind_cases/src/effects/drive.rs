//! Listed effects at amplifier and motor.

use super::{Entry, Site, Values, Variable};
use crate::deviation::{Deviation, View};

pub(super) const ENTRIES: &[Entry] = &[
    Entry {
        id: "torque_ripple",
        site: Site::Drive,
        depends_on: &[Variable::Position],
        draw: |draw, _| {
            let order = draw.choose(&[4.0, 6.0, 8.0, 10.0, 12.0, 14.0, 18.0]);
            Values::of([
                ("amplitude", draw.uniform(0.1, 0.25), "N m"),
                ("order", order, "1"),
                ("phase", draw.phase(), "rad"),
            ])
        },
        build: |values, _| {
            Box::new(Ripple {
                amplitude: values.get("amplitude"),
                order: values.get("order"),
                phase: values.get("phase"),
            })
        },
    },
    Entry {
        id: "amplifier_saturation",
        site: Site::Drive,
        depends_on: &[Variable::Volts],
        draw: |draw, _| Values::of([("limit", draw.uniform(1.7, 2.3), "V")]),
        build: |values, _| Box::new(Saturation { limit: values.get("limit") }),
    },
    Entry {
        id: "amplifier_deadzone",
        site: Site::Drive,
        depends_on: &[Variable::Volts],
        draw: |draw, _| Values::of([("half_width", draw.uniform(0.15, 0.4), "V")]),
        build: |values, _| Box::new(Deadzone { half_width: values.get("half_width") }),
    },
    Entry {
        id: "amplifier_lag",
        site: Site::Drive,
        depends_on: &[Variable::Time, Variable::Volts],
        draw: |draw, _| Values::of([("time_constant", draw.log_uniform(5e-3, 20e-3), "s")]),
        build: |values, _| Box::new(Lag { time_constant: values.get("time_constant") }),
    },
    Entry {
        id: "transport_delay",
        site: Site::Drive,
        depends_on: &[Variable::Time, Variable::Volts],
        draw: |draw, _| Values::of([("delay_s", draw.uniform(4e-3, 12e-3), "s")]),
        build: |values, _| Box::new(Delay { delay_s: values.get("delay_s") }),
    },
];

/// `τ += a sin(n q_m + φ)`.
#[derive(Debug)]
struct Ripple {
    amplitude: f64,
    order: f64,
    phase: f64,
}

impl Deviation for Ripple {
    fn motor(&self, torque_nm: f64, view: &View<'_>) -> f64 {
        torque_nm + self.amplitude * (self.order * view.position[0] + self.phase).sin()
    }
}

/// The voltage is limited.
#[derive(Debug)]
struct Saturation {
    limit: f64,
}

impl Deviation for Saturation {
    fn amplifier(&self, volts: f64, _view: &View<'_>, _own: &[f64], _rates: &mut [f64]) -> f64 {
        volts.clamp(-self.limit.abs(), self.limit.abs())
    }
}

/// Small voltages have no effect, larger ones are reduced by as much.
#[derive(Debug)]
struct Deadzone {
    half_width: f64,
}

impl Deviation for Deadzone {
    fn amplifier(&self, volts: f64, _view: &View<'_>, _own: &[f64], _rates: &mut [f64]) -> f64 {
        (volts.abs() - self.half_width).max(0.0).copysign(volts)
    }
}

/// `T v̇ + v = v_in`.
#[derive(Debug)]
struct Lag {
    time_constant: f64,
}

impl Deviation for Lag {
    fn states(&self) -> usize {
        1
    }

    fn amplifier(&self, volts: f64, _view: &View<'_>, own: &[f64], rates: &mut [f64]) -> f64 {
        rates[0] = (volts - own[0]) / self.time_constant;
        own[0]
    }
}

/// The voltage `T` earlier; 0 before the record.
#[derive(Debug)]
struct Delay {
    delay_s: f64,
}

impl Deviation for Delay {
    fn amplifier(&self, _volts: f64, view: &View<'_>, _own: &[f64], _rates: &mut [f64]) -> f64 {
        let index = ((view.local_s - self.delay_s) / view.sample_s).floor();
        if index < 0.0 { 0.0 } else { view.volts.get(index as usize).copied().unwrap_or(0.0) }
    }
}
